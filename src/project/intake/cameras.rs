//! The cameras of images that are taken in: by camera files, else by EXIF data.

use std::sync::Arc;

use super::{Candidate, IntakeError};
use crate::camera::{Camera, InteriorOrientation};
use crate::imaging::PictureMeta;
use crate::network::{CameraEntry, CameraId, InteriorSource, Network, StatedScale};
use crate::project::files::CameraFile;

/// Principal distance over image width where nothing is known, as of a moderate wide-angle lens; the start of a search.
const UNKNOWN_DISTANCE_PER_WIDTH: f64 = 1.0;

/// Image width of a camera of which nothing is known, mm (a full-frame sensor); only ratios matter then.
const UNKNOWN_WIDTH_MM: f64 = 36.0;

/// Diagonal of 36 mm x 24 mm film, to which "35 mm equivalent" focal lengths refer, mm.
const FILM_DIAGONAL_MM: f64 = 43.266_615_305_567_87;

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
        // A principal distance in millimetres says nothing without the pitch, nor does its standard deviation.
        let stated = StatedScale {
            pitch: file.pixel_pitch_mm.is_some(),
            distance: file.principal_distance_mm.is_some(),
        };
        let known = stated.pitch && stated.distance;
        let mut known_sigmas = file.known_sigmas;
        if !known {
            known_sigmas[0] = None;
        }
        add_camera(
            network,
            CameraEntry {
                name: file.name.clone(),
                camera: nominal.clone(),
                nominal,
                known_sigmas,
                parameters: Default::default(),
                stated,
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

/// The camera file whose size, and where several have it whose name, fits the picture.
pub(super) fn matching_camera(
    network: &Network,
    candidate: &Candidate,
) -> Result<CameraId, IntakeError> {
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

/// Gives a camera whose file leaves pitch or principal distance open what the picture's EXIF data say of it; what the file states
/// stands, and so does what a measurement has found.
pub(super) fn complete_from_meta(entry: &mut CameraEntry, candidate: &Candidate) {
    if entry.source != InteriorSource::Unknown || entry.camera != entry.nominal {
        return;
    }
    let meta = &candidate.meta;
    let by_meta = camera_from_meta(meta, candidate.width_px, candidate.height_px);
    let distance = by_meta.interior.principal_distance;
    let nominal = &mut entry.nominal;
    match (entry.stated.pitch, meta.focal_length_mm) {
        // In millimetres the focal length needs no other pitch than the file's.
        (true, Some(focal)) if focal > 0.0 => nominal.interior.principal_distance = focal,
        _ if !has_focal_length(meta) => return,
        (true, _) => {
            nominal.interior.principal_distance =
                distance * nominal.pixel_pitch_mm / by_meta.pixel_pitch_mm;
        }
        (false, _) => {
            nominal.pixel_pitch_mm = by_meta.pixel_pitch_mm;
            if !entry.stated.distance {
                nominal.interior.principal_distance = distance;
            }
        }
    }
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
pub(super) fn camera_of_meta(network: &mut Network, candidate: &Candidate) -> CameraId {
    let nominal = camera_from_meta(&candidate.meta, candidate.width_px, candidate.height_px);
    let known = has_focal_length(&candidate.meta);
    let model = candidate
        .meta
        .model
        .clone()
        .unwrap_or_default()
        .trim()
        .to_owned();
    // The search changes the principal distance of a camera of which nothing is known.
    let of_size = |c: &CameraEntry| {
        (c.nominal.width_px, c.nominal.height_px) == (candidate.width_px, candidate.height_px)
    };
    let alike = |c: &CameraEntry| {
        let searched = !known && c.source == InteriorSource::Unknown && of_size(c);
        c.nominal == nominal || searched
    };
    let same = network
        .cameras
        .iter()
        .find(|(_, c)| c.exif_model.as_deref() == Some(model.as_str()) && alike(c));
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
            stated: StatedScale::default(),
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

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    /// A picture of 4000 x 3000 px taken with a lens of 28 mm that is one of 43.3 mm on film.
    fn candidate() -> Candidate {
        Candidate {
            path: PathBuf::from("a.jpg"),
            stored: "a.jpg".into(),
            size_bytes: 1,
            sha256: "a".into(),
            width_px: 4000,
            height_px: 3000,
            meta: PictureMeta {
                focal_length_mm: Some(28.0),
                focal_length_35mm: Some(FILM_DIAGONAL_MM),
                ..PictureMeta::default()
            },
        }
    }

    fn file(pixel_pitch_mm: Option<f64>, principal_distance_mm: Option<f64>) -> CameraFile {
        let mut known_sigmas = [None; 10];
        known_sigmas[0] = principal_distance_mm.map(|_| 0.003);
        CameraFile {
            name: "A".into(),
            width_px: 4000,
            height_px: 3000,
            pixel_pitch_mm,
            principal_distance_mm,
            principal_point: [0.0; 2],
            radial: [0.0; 3],
            tangential: [0.0; 2],
            affinity: [0.0; 2],
            direction: Default::default(),
            known_sigmas,
        }
    }

    /// Pitch, principal distance and its sigma after a picture was taken in.
    fn completed(file: CameraFile) -> (f64, f64, Option<f64>) {
        let mut network = Network::default();
        add_cameras(&mut network, &[file]);
        let entry = network.camera_mut(CameraId(1));
        complete_from_meta(entry, &candidate());
        assert_eq!(entry.nominal, entry.camera);
        let camera = &entry.camera;
        let distance = camera.interior.principal_distance;
        (camera.pixel_pitch_mm, distance, entry.known_sigmas[0])
    }

    #[test]
    fn what_a_camera_file_states_stands_beside_exif_data() {
        // 28 mm on a diagonal of 5000 px.
        let pitch = 28.0 / 5000.0;
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12 * b;
        let (p, c, sigma) = completed(file(None, Some(28.785)));
        assert!(
            near(p, pitch) && c == 28.785 && sigma.is_none(),
            "{p} {c} {sigma:?}"
        );
        let (p, c, _) = completed(file(Some(0.006), None));
        assert!(p == 0.006 && c == 28.0, "{p} {c}");
        let (p, c, _) = completed(file(None, None));
        assert!(near(p, pitch) && c == 28.0, "{p} {c}");
        let stated = completed(file(Some(0.006), Some(28.785)));
        assert_eq!(stated, (0.006, 28.785, Some(0.003)));
    }

    #[test]
    fn a_camera_whose_distance_was_searched_is_the_same_camera() {
        let unknown = Candidate {
            meta: PictureMeta::default(),
            ..candidate()
        };
        let mut network = Network::default();
        let first = camera_of_meta(&mut network, &unknown);
        network
            .camera_mut(first)
            .nominal
            .interior
            .principal_distance = 50.0;
        assert_eq!(camera_of_meta(&mut network, &unknown), first);
        let known = camera_of_meta(&mut network, &candidate());
        assert_ne!(known, first);
        assert_eq!(camera_of_meta(&mut network, &candidate()), known);
    }
}
