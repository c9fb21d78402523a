//! Taking images into a project: files, cameras, the same picture twice.

mod cameras;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;
use sha2::{Digest, Sha256};

pub use self::cameras::add_cameras;
use self::cameras::{camera_of_meta, complete_from_meta, matching_camera};
use crate::imaging::{LoadError, PictureMeta, read_meta, read_size};
use crate::monitor::{Interrupted, Monitor};
use crate::network::{ImageEntry, ImageFile, ImageId, ImageUse, Network};

/// Extensions that make a file of a folder an image.
const IMAGE_EXTENSIONS: [&str; 9] = [
    "png", "jpg", "jpeg", "tif", "tiff", "bmp", "pgm", "ppm", "pnm",
];

/// Why images could not be taken in.
#[derive(Debug, thiserror::Error)]
pub enum IntakeError {
    /// No such file or folder.
    #[error("{path}: found no such file or folder, expected images")]
    Missing {
        /// The path.
        path: String,
    },
    /// A folder without images.
    #[error("{path}: found no images in this folder, expected files such as .png, .jpg or .tif")]
    NoImages {
        /// The folder.
        path: String,
    },
    /// The file is no picture.
    #[error(transparent)]
    Picture(#[from] LoadError),
    /// The file cannot be read.
    #[error("{path}: {source}")]
    Unreadable {
        /// The file.
        path: String,
        /// Why.
        source: io::Error,
    },
    /// The picture is in the project already, or was given twice.
    #[error("{path}: found the same picture as {other}, expected each picture once")]
    Twice {
        /// The file.
        path: String,
        /// The other file.
        other: String,
    },
    /// The file is in the project already and holds another picture now.
    #[error(
        "{path}: found another picture than the one the project has under this name, expected it under a name of its own"
    )]
    Replaced {
        /// The file.
        path: String,
    },
    /// No camera has the size of the picture.
    #[error("{path}: found {width} x {height} px, expected {cameras}")]
    WrongSize {
        /// The file.
        path: String,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// The sizes of the cameras, in words.
        cameras: String,
    },
    /// Two cameras fit the picture.
    #[error(
        "{path}: found {found} cameras of its size, expected one, or names equal to the EXIF model"
    )]
    AmbiguousCamera {
        /// The file.
        path: String,
        /// Cameras of that size.
        found: usize,
    },
    /// The name of the file cannot be stored as text.
    #[error(
        "{path}: found a file name that is no UTF-8 text, expected one that a project can keep"
    )]
    Name {
        /// The file, as far as its name can be shown.
        path: String,
    },
    /// The operator stopped it.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
    /// The image to exclude is not in the project.
    #[error("{path}: found no such image in the project, expected one of its {images} images")]
    NotInProject {
        /// The file as given.
        path: String,
        /// Images in the project.
        images: usize,
    },
}

/// A file that is to become an image.
struct Candidate {
    path: PathBuf,
    stored: String,
    size_bytes: u64,
    sha256: String,
    width_px: u32,
    height_px: u32,
    meta: PictureMeta,
}

/// Adds images (files, or all images of folders) to a network; paths are stored relative to `folder` where they can be.
///
/// # Errors
/// [`IntakeError`]; the network is unchanged then.
pub fn add_images(
    network: &mut Network,
    folder: &Path,
    paths: &[PathBuf],
    monitor: &Monitor,
) -> Result<usize, IntakeError> {
    let files = expand(paths)?;
    let candidates = files
        .par_iter()
        .map(|path| examine(path, folder, monitor))
        .collect::<Vec<_>>()
        .into_iter()
        .collect::<Result<Vec<_>, _>>()?;
    let mut changed = network.clone();
    // An image that was excluded comes back with all that was measured in it, from where its picture is now.
    let excluded: BTreeMap<&str, ImageId> = network
        .images
        .iter()
        .filter(|(_, image)| image.usage == ImageUse::Excluded)
        .map(|(id, image)| (image.file.sha256.as_str(), *id))
        .collect();
    let (returning, candidates): (Vec<Candidate>, Vec<Candidate>) = candidates
        .into_iter()
        .partition(|c| excluded.contains_key(c.sha256.as_str()));
    for candidate in &returning {
        let id = excluded[candidate.sha256.as_str()];
        let mut others = network.images.iter().filter(|(other, _)| **other != id);
        if others.any(|(_, other)| other.file.path == candidate.stored) {
            return Err(IntakeError::Replaced {
                path: candidate.path.display().to_string(),
            });
        }
        let image = changed.image_mut(id);
        let other = std::mem::replace(&mut image.file.path, candidate.stored.clone());
        if image.usage == ImageUse::Used {
            return Err(IntakeError::Twice {
                path: candidate.path.display().to_string(),
                other,
            });
        }
        image.usage = ImageUse::Used;
    }
    refuse_twice(network, &candidates)?;
    let from_files = changed.cameras.values().any(|c| c.exif_model.is_none());
    for candidate in &candidates {
        let camera = if from_files {
            let camera = matching_camera(&changed, candidate)?;
            complete_from_meta(changed.camera_mut(camera), candidate);
            camera
        } else {
            camera_of_meta(&mut changed, candidate)
        };
        let images = Arc::make_mut(&mut changed.images);
        let id = ImageId(images.keys().next_back().map_or(1, |last| last.0 + 1));
        let file = ImageFile {
            path: candidate.stored.clone(),
            size_bytes: candidate.size_bytes,
            sha256: candidate.sha256.clone(),
            width_px: candidate.width_px,
            height_px: candidate.height_px,
        };
        images.insert(id, Arc::new(ImageEntry::new(file, camera)));
    }
    changed.inputs += 1;
    *network = changed;
    Ok(candidates.len() + returning.len())
}

/// Refuses a picture whose content or whose file is there already.
fn refuse_twice(network: &Network, candidates: &[Candidate]) -> Result<(), IntakeError> {
    let mut contents = BTreeMap::new();
    let mut paths = BTreeMap::new();
    for image in network.images.values() {
        contents.insert(image.file.sha256.as_str(), image.file.path.as_str());
        paths.insert(image.file.path.as_str(), ());
    }
    for candidate in candidates {
        let other = contents.insert(&candidate.sha256, &candidate.stored);
        if let Some(other) = other {
            return Err(IntakeError::Twice {
                path: candidate.path.display().to_string(),
                other: other.to_owned(),
            });
        }
        if paths.insert(&candidate.stored, ()).is_some() {
            return Err(IntakeError::Replaced {
                path: candidate.path.display().to_string(),
            });
        }
    }
    Ok(())
}

/// Excludes images; what was measured in them stays but takes no part.
///
/// # Errors
/// [`IntakeError::NotInProject`]; the network is unchanged then.
pub fn exclude_images(
    network: &mut Network,
    folder: &Path,
    paths: &[PathBuf],
) -> Result<usize, IntakeError> {
    let mut changed = network.clone();
    let mut excluded = 0;
    for path in paths {
        let stored = stored_path(path, folder);
        let as_given = path.to_string_lossy().replace('\\', "/");
        let inside = format!("{stored}/");
        let named: Vec<ImageId> = changed
            .images
            .iter()
            .filter(|(_, image)| {
                let own = &image.file.path;
                *own == stored || *own == as_given || own.starts_with(&inside)
            })
            .map(|(id, _)| *id)
            .collect();
        if named.is_empty() {
            return Err(IntakeError::NotInProject {
                path: path.display().to_string(),
                images: network.images.len(),
            });
        }
        for id in named {
            let usage = &mut changed.image_mut(id).usage;
            excluded += usize::from(*usage == ImageUse::Used);
            *usage = ImageUse::Excluded;
        }
    }
    changed.inputs += 1;
    *network = changed;
    Ok(excluded)
}

/// The picture file of a stored path.
#[must_use]
pub fn picture_path(folder: &Path, stored: &str) -> PathBuf {
    let path = PathBuf::from(stored);
    if path.is_absolute() {
        path
    } else {
        folder.join(path)
    }
}

/// Files and the images in folders, in the order given, folders sorted by name.
fn expand(paths: &[PathBuf]) -> Result<Vec<PathBuf>, IntakeError> {
    let mut files = Vec::new();
    for path in paths {
        if path.is_dir() {
            let entries = fs::read_dir(path)
                .and_then(Iterator::collect::<io::Result<Vec<_>>>)
                .map_err(|source| IntakeError::Unreadable {
                    path: path.display().to_string(),
                    source,
                })?;
            let mut images: Vec<PathBuf> = entries
                .into_iter()
                .map(|e| e.path())
                .filter(|p| p.is_file() && has_image_extension(p))
                .collect();
            if images.is_empty() {
                return Err(IntakeError::NoImages {
                    path: path.display().to_string(),
                });
            }
            images.sort();
            files.append(&mut images);
        } else if path.is_file() {
            files.push(path.clone());
        } else {
            return Err(IntakeError::Missing {
                path: path.display().to_string(),
            });
        }
    }
    Ok(files)
}

/// Whether a file is an image by its name.
pub(super) fn has_image_extension(path: &Path) -> bool {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    extension.is_some_and(|e| IMAGE_EXTENSIONS.contains(&e.as_str()))
}

fn examine(path: &Path, folder: &Path, monitor: &Monitor) -> Result<Candidate, IntakeError> {
    monitor.check()?;
    let unreadable = |source| IntakeError::Unreadable {
        path: path.display().to_string(),
        source,
    };
    let (width_px, height_px) = read_size(path)?;
    let meta = read_meta(path)?;
    let stored = stored_path(path, folder);
    if !picture_path(folder, &stored).is_file() {
        return Err(IntakeError::Name {
            path: path.display().to_string(),
        });
    }
    let (size_bytes, sha256) = hash_unless_interrupted(path, monitor)?.map_err(unreadable)?;
    Ok(Candidate {
        path: path.to_owned(),
        stored,
        size_bytes,
        sha256,
        width_px,
        height_px,
        meta,
    })
}

/// Size in bytes and SHA-256 (hexadecimal) of a file.
pub(super) fn hash(path: &Path) -> io::Result<(u64, String)> {
    // Nobody interrupts this monitor.
    hash_unless_interrupted(path, &Monitor::new())
        .unwrap_or_else(|Interrupted| Err(io::ErrorKind::Interrupted.into()))
}

/// As [`hash`], but obeys an interrupt within the file.
fn hash_unless_interrupted(
    path: &Path,
    monitor: &Monitor,
) -> Result<io::Result<(u64, String)>, Interrupted> {
    let mut file = match File::open(path) {
        Ok(file) => file,
        Err(error) => return Ok(Err(error)),
    };
    let mut hasher = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    let mut size = 0;
    loop {
        monitor.check()?;
        match file.read(&mut buffer) {
            Ok(0) => break,
            Ok(read) => {
                size += read as u64;
                hasher.update(&buffer[..read]);
            }
            Err(error) => return Ok(Err(error)),
        }
    }
    let digest = hasher.finalize();
    let digest = digest.iter().map(|byte| format!("{byte:02x}")).collect();
    Ok(Ok((size, digest)))
}

/// The absolute path without links; of what is gone, as much of it as is there.
fn real_path(path: &Path) -> PathBuf {
    let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let real = |there: &Path| {
        let gone = whole.strip_prefix(there).ok()?;
        Some(
            gone.iter()
                .fold(fs::canonicalize(there).ok()?, |path, name| path.join(name)),
        )
    };
    let found = whole.ancestors().find_map(real);
    found.unwrap_or(whole)
}

/// The path relative to the project's folder where the file lies in or beside it, else the absolute one; with slashes.
pub(super) fn stored_path(path: &Path, folder: &Path) -> String {
    let folder = fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
    let path = real_path(path);
    let common = path
        .components()
        .zip(folder.components())
        .take_while(|(a, b)| a == b)
        .count();
    // With nothing but the root in common, a relative path would be longer and no easier to move.
    let named = path
        .components()
        .take(common)
        .filter(|c| matches!(c, Component::Normal(_)))
        .count();
    if named == 0 {
        return path.to_string_lossy().replace('\\', "/");
    }
    let up = folder.components().skip(common).map(|_| "..".to_owned());
    let down = path
        .components()
        .skip(common)
        .map(|c| c.as_os_str().to_string_lossy().into_owned());
    up.chain(down).collect::<Vec<_>>().join("/")
}
