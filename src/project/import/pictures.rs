//! Picture files beside the files of another program.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use crate::imaging::read_size;
use crate::monitor::{Interrupted, Monitor};
use crate::network::ImageFile;
use crate::plain_network::PlainNetwork;
use crate::project::intake::{has_image_extension, hash, stored_path};

/// The files of a network's images.
#[derive(Clone, Debug, Default)]
pub(super) struct PictureFiles {
    /// The file of every image; one without a picture has the image's name for its path, no size and no checksum.
    pub(super) files: Vec<ImageFile>,
    /// Images whose picture was not found.
    pub(super) missing: usize,
    /// Why a picture that was found is not taken, by image.
    pub(super) refused: BTreeMap<usize, String>,
}

/// Looks for the picture of every image in a folder and the folders in it: by the image's name as a path, as a file's name,
/// and as a file's name without its ending, where only one file has it.
///
/// # Errors
/// [`Interrupted`].
pub(super) fn beside(
    network: &PlainNetwork,
    folder: &Path,
    project_folder: &Path,
    monitor: &Monitor,
) -> Result<PictureFiles, Interrupted> {
    let there = Pictures::of(folder);
    let mut taken = BTreeSet::new();
    let mut found = PictureFiles::default();
    for (index, image) in network.images.iter().enumerate() {
        monitor.check()?;
        let camera = &network.cameras[image.camera];
        let mut file = ImageFile {
            path: image.name.clone(),
            size_bytes: 0,
            sha256: String::new(),
            width_px: camera.width_px,
            height_px: camera.height_px,
        };
        match there
            .find(&image.name)
            .filter(|path| taken.insert(path.clone()))
        {
            None => found.missing += 1,
            Some(path) => match known(&path, &file) {
                Ok((size_bytes, sha256)) => {
                    file = ImageFile {
                        path: stored_path(&path, project_folder),
                        size_bytes,
                        sha256,
                        ..file
                    };
                }
                Err(reason) => {
                    found.refused.insert(index, reason);
                }
            },
        }
        found.files.push(file);
    }
    Ok(found)
}

/// Size and checksum of a picture, or why it cannot be the image's.
fn known(path: &Path, file: &ImageFile) -> Result<(u64, String), String> {
    let (width, height) = read_size(path).map_err(|error| error.to_string())?;
    if (width, height) != (file.width_px, file.height_px) {
        return Err(format!(
            "{}: found {width} x {height} px, expected {} x {} px of its camera",
            path.display(),
            file.width_px,
            file.height_px
        ));
    }
    hash(path).map_err(|error| format!("{}: {error}", path.display()))
}

/// The pictures of a folder and the folders in it.
struct Pictures {
    folder: PathBuf,
    /// By name and by name without ending, in small letters.
    by_name: BTreeMap<String, Vec<PathBuf>>,
}

impl Pictures {
    fn of(folder: &Path) -> Self {
        let mut by_name: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
        let inner = entries(folder).into_iter().filter(|path| path.is_dir());
        let folders: Vec<PathBuf> = std::iter::once(folder.to_owned()).chain(inner).collect();
        for path in folders.iter().flat_map(|folder| entries(folder)) {
            if !path.is_file() || !has_image_extension(&path) {
                continue;
            }
            for name in [path.file_name(), path.file_stem()].into_iter().flatten() {
                let name = name.to_string_lossy().to_lowercase();
                by_name.entry(name).or_default().push(path.clone());
            }
        }
        Self {
            folder: folder.to_owned(),
            by_name,
        }
    }

    fn find(&self, image: &str) -> Option<PathBuf> {
        let as_path = ["", "images"].map(|place| self.folder.join(place).join(image));
        let is_picture = |path: &&PathBuf| path.is_file() && has_image_extension(path);
        if let Some(path) = as_path.iter().find(is_picture) {
            return Some(path.clone());
        }
        match self.by_name.get(&image.to_lowercase()).map(Vec::as_slice) {
            Some([path]) => Some(path.clone()),
            _ => None,
        }
    }
}

/// What lies in a folder, sorted; a folder that may not be read holds no picture for us.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}
