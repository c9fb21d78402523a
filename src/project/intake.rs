//! Taking images into a project: files, cameras, the same picture twice.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::files::CameraFile;
use crate::camera::{Camera, InteriorOrientation};
use crate::imaging::{LoadError, PictureMeta, read_meta, read_size};
use crate::network::{
    CameraEntry, CameraId, ImageEntry, ImageFile, ImageId, ImageUse, InteriorSource, Network,
};

/// Extensions that make a file of a folder an image.
const IMAGE_EXTENSIONS: [&str; 9] = [
    "png", "jpg", "jpeg", "tif", "tiff", "bmp", "pgm", "ppm", "pnm",
];

/// Principal distance over image width where nothing is known, as of a moderate wide-angle lens; the start of a search.
const UNKNOWN_DISTANCE_PER_WIDTH: f64 = 1.0;

/// Image width of a camera of which nothing is known, mm (a full-frame sensor); only ratios matter then.
const UNKNOWN_WIDTH_MM: f64 = 36.0;

/// Diagonal of 36 mm x 24 mm film, to which "35 mm equivalent" focal lengths refer, mm.
const FILM_DIAGONAL_MM: f64 = 43.266_615_305_567_87;

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

/// Adds the cameras of camera files to a network.
pub fn add_cameras(network: &mut Network, files: &[CameraFile]) {
    for file in files {
        let pitch = file
            .pixel_pitch_mm
            .unwrap_or(UNKNOWN_WIDTH_MM / f64::from(file.width_px));
        let nominal = Camera {
            width_px: file.width_px,
            height_px: file.height_px,
            pixel_pitch_mm: pitch,
            interior: InteriorOrientation {
                principal_distance: file
                    .principal_distance_mm
                    .unwrap_or(UNKNOWN_DISTANCE_PER_WIDTH * pitch * f64::from(file.width_px)),
                ..file.interior()
            },
        };
        // A principal distance in millimetres says nothing without the pitch.
        let known = file.principal_distance_mm.is_some() && file.pixel_pitch_mm.is_some();
        add_camera(
            network,
            CameraEntry {
                name: file.name.clone(),
                camera: nominal.clone(),
                nominal,
                known_sigmas: file.known_sigmas,
                parameters: Default::default(),
                source: if known {
                    InteriorSource::CameraFile
                } else {
                    InteriorSource::Unknown
                },
                exif_model: None,
            },
        );
    }
}

fn add_camera(network: &mut Network, entry: CameraEntry) -> CameraId {
    let cameras = Arc::make_mut(&mut network.cameras);
    let id = CameraId(cameras.keys().next_back().map_or(1, |last| last.0 + 1));
    cameras.insert(id, Arc::new(entry));
    id
}

/// Adds images (files, or all images of folders) to a network; paths are stored relative to `folder` where they can be.
///
/// # Errors
/// [`IntakeError`]; the network is unchanged then.
pub fn add_images(
    network: &mut Network,
    folder: &Path,
    paths: &[PathBuf],
) -> Result<usize, IntakeError> {
    let files = expand(paths)?;
    let candidates = files
        .par_iter()
        .map(|path| examine(path, folder))
        .collect::<Vec<_>>()
        .into_iter()
        .collect::<Result<Vec<_>, _>>()?;
    let mut changed = network.clone();
    // An image that was excluded comes back with all that was measured in it.
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
        changed.image_mut(excluded[candidate.sha256.as_str()]).usage = ImageUse::Used;
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
        let is_folder = path.is_dir();
        let named: Vec<ImageId> = changed
            .images
            .iter()
            .filter(|(_, image)| {
                let own = &image.file.path;
                *own == stored || *own == as_given || (is_folder && own.starts_with(&inside))
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

fn examine(path: &Path, folder: &Path) -> Result<Candidate, IntakeError> {
    let unreadable = |source| IntakeError::Unreadable {
        path: path.display().to_string(),
        source,
    };
    let (width_px, height_px) = read_size(path)?;
    let meta = read_meta(path)?;
    let (size_bytes, sha256) = hash(path).map_err(unreadable)?;
    Ok(Candidate {
        path: path.to_owned(),
        stored: stored_path(path, folder),
        size_bytes,
        sha256,
        width_px,
        height_px,
        meta,
    })
}

/// Size in bytes and SHA-256 (hexadecimal) of a file.
pub(super) fn hash(path: &Path) -> io::Result<(u64, String)> {
    let mut file = File::open(path)?;
    let mut hasher = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    let mut size = 0;
    loop {
        let read = file.read(&mut buffer)?;
        if read == 0 {
            break;
        }
        size += read as u64;
        hasher.update(&buffer[..read]);
    }
    let digest = hasher.finalize();
    Ok((
        size,
        digest.iter().map(|byte| format!("{byte:02x}")).collect(),
    ))
}

/// The path relative to the project's folder where the file lies in or beside it, else the absolute one; with slashes.
pub(super) fn stored_path(path: &Path, folder: &Path) -> String {
    let absolute = |p: &Path| fs::canonicalize(p).unwrap_or_else(|_| p.to_owned());
    let (path, folder) = (absolute(path), absolute(folder));
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

/// The camera file whose size, and where several have it whose name, fits the picture.
fn matching_camera(network: &Network, candidate: &Candidate) -> Result<CameraId, IntakeError> {
    let path = || candidate.path.display().to_string();
    let of_size: Vec<(CameraId, &CameraEntry)> = network
        .cameras
        .iter()
        .filter(|(_, c)| {
            (c.camera.width_px, c.camera.height_px) == (candidate.width_px, candidate.height_px)
        })
        .map(|(id, c)| (*id, c.as_ref()))
        .collect();
    match of_size.as_slice() {
        [(id, _)] => Ok(*id),
        [] => Err(IntakeError::WrongSize {
            path: path(),
            width: candidate.width_px,
            height: candidate.height_px,
            cameras: network
                .cameras
                .values()
                .map(|c| {
                    format!(
                        "{} x {} px of camera '{}'",
                        c.camera.width_px, c.camera.height_px, c.name
                    )
                })
                .collect::<Vec<_>>()
                .join(" or "),
        }),
        several => {
            let model = candidate.meta.model.as_deref().map(str::trim);
            several
                .iter()
                .find(|(_, c)| model == Some(c.name.trim()))
                .map(|(id, _)| *id)
                .ok_or_else(|| IntakeError::AmbiguousCamera {
                    path: path(),
                    found: several.len(),
                })
        }
    }
}

/// Gives a camera whose file names no principal distance that of the picture's EXIF data, where they have one.
fn complete_from_meta(entry: &mut CameraEntry, candidate: &Candidate) {
    if entry.source != InteriorSource::Unknown || !has_focal_length(&candidate.meta) {
        return;
    }
    let by_meta = camera_from_meta(&candidate.meta, candidate.width_px, candidate.height_px);
    entry.nominal.pixel_pitch_mm = by_meta.pixel_pitch_mm;
    entry.nominal.interior.principal_distance = by_meta.interior.principal_distance;
    entry.camera = entry.nominal.clone();
    entry.source = InteriorSource::Exif;
}

fn has_focal_length(meta: &PictureMeta) -> bool {
    match (
        meta.focal_length_mm,
        meta.focal_length_35mm,
        meta.pixel_pitch_mm,
    ) {
        (_, Some(focal_35), _) => focal_35 > 0.0,
        (Some(focal), None, Some(_)) => focal > 0.0,
        _ => false,
    }
}

/// The camera that the picture's EXIF data describe, new where it is the first of its kind.
fn camera_of_meta(network: &mut Network, candidate: &Candidate) -> CameraId {
    let nominal = camera_from_meta(&candidate.meta, candidate.width_px, candidate.height_px);
    let known = has_focal_length(&candidate.meta);
    let model = candidate
        .meta
        .model
        .clone()
        .unwrap_or_default()
        .trim()
        .to_owned();
    let same = network
        .cameras
        .iter()
        .find(|(_, c)| c.exif_model.as_deref() == Some(model.as_str()) && c.nominal == nominal);
    if let Some((id, _)) = same {
        return *id;
    }
    let name = if model.is_empty() {
        "unknown camera".to_owned()
    } else {
        model.clone()
    };
    add_camera(
        network,
        CameraEntry {
            name,
            camera: nominal.clone(),
            nominal,
            known_sigmas: [None; 10],
            parameters: Default::default(),
            source: if known {
                InteriorSource::Exif
            } else {
                InteriorSource::Unknown
            },
            exif_model: Some(model),
        },
    )
}

/// Pitch and principal distance from EXIF: the focal length with the sensor's pitch, else the 35 mm equivalent, which
/// fixes the ratio of principal distance and diagonal.
fn camera_from_meta(meta: &PictureMeta, width_px: u32, height_px: u32) -> Camera {
    let diagonal_px = f64::from(width_px).hypot(f64::from(height_px));
    let reduced = meta
        .taken_width_px
        .map_or(1.0, |taken| f64::from(taken) / f64::from(width_px.max(1)));
    let plausible = |pitch: &f64| (2e-4..0.1).contains(pitch);
    let (pitch, distance) = match (
        meta.focal_length_mm,
        meta.focal_length_35mm,
        meta.pixel_pitch_mm,
    ) {
        (Some(focal), Some(focal_35), _) if focal > 0.0 && focal_35 > 0.0 => {
            (FILM_DIAGONAL_MM * focal / focal_35 / diagonal_px, focal)
        }
        (Some(focal), None, Some(pitch)) if focal > 0.0 => (pitch * reduced, focal),
        (None, Some(focal_35), _) if focal_35 > 0.0 => (FILM_DIAGONAL_MM / diagonal_px, focal_35),
        _ => {
            let pitch = UNKNOWN_WIDTH_MM / f64::from(width_px.max(1));
            (pitch, UNKNOWN_DISTANCE_PER_WIDTH * UNKNOWN_WIDTH_MM)
        }
    };
    let (pitch, distance) = if plausible(&pitch) {
        (pitch, distance)
    } else {
        let pitch = UNKNOWN_WIDTH_MM / f64::from(width_px.max(1));
        (pitch, UNKNOWN_DISTANCE_PER_WIDTH * UNKNOWN_WIDTH_MM)
    };
    Camera {
        width_px,
        height_px,
        pixel_pitch_mm: pitch,
        interior: InteriorOrientation::pinhole(distance),
    }
}
