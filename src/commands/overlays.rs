//! The pictures that `detect --overlay` writes.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use super::CommandError;
use crate::imaging::GreyImage;
use crate::report::{overlay, write_file};
use crate::targets::Detections;

/// A folder of overlays: each picture has a name of its own there.
pub(super) struct OverlayFolder {
    folder: PathBuf,
    /// Names that are given, and pictures that are looked at: none of these is written over.
    taken: BTreeSet<PathBuf>,
}

impl OverlayFolder {
    /// Makes the folder where it is missing.
    ///
    /// # Errors
    /// [`CommandError`] where no folder can be.
    pub(super) fn new(folder: &Path, images: &[PathBuf]) -> Result<Self, CommandError> {
        if folder.exists() && !folder.is_dir() {
            return Err(CommandError::input(format!(
                "{}: found a file, expected a folder for the overlays",
                folder.display()
            )));
        }
        fs::create_dir_all(folder).map_err(|error| {
            CommandError::input(format!("{}: cannot be made: {error}", folder.display()))
        })?;
        Ok(Self {
            folder: folder.canonicalize().unwrap_or_else(|_| folder.into()),
            taken: images
                .iter()
                .filter_map(|i| i.canonicalize().ok())
                .collect(),
        })
    }

    /// Draws what was found in a picture.
    ///
    /// # Errors
    /// [`CommandError`] where the file cannot be written.
    pub(super) fn write(
        &mut self,
        path: &Path,
        image: &GreyImage,
        detections: &Detections,
    ) -> Result<(), CommandError> {
        let file = self.name_for(path);
        let drawn = overlay(image, detections);
        let mut png = Vec::new();
        // Noise does not compress: the fast setting is nearly as small as the slow one.
        PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Sub)
            .write_image(
                drawn.as_raw(),
                drawn.width(),
                drawn.height(),
                ExtendedColorType::Rgb8,
            )
            .map_err(|error| CommandError::work(format!("{}: {error}", file.display())))?;
        write_file(&file, &png)?;
        Ok(())
    }

    /// `img-overlay.png` for `img.png`, `img-2-overlay.png` for the second picture of that stem, and so on.
    fn name_for(&mut self, path: &Path) -> PathBuf {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let mut file = self.folder.join(format!("{stem}-overlay.png"));
        let mut number = 2;
        while !self.taken.insert(file.clone()) {
            file = self.folder.join(format!("{stem}-{number}-overlay.png"));
            number += 1;
        }
        file
    }
}
