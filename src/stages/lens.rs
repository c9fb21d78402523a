//! What an adjustment may do with the lens.

use std::collections::BTreeMap;

use crate::adjustment::ParameterState;
use crate::network::{CameraEntry, CameraId, InteriorSource, Network};

/// How far the lens is let go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LensFreedom {
    /// Every parameter is held near its nominal value by what any real lens keeps to, and those that so few images of
    /// the camera cannot tell from their orientations keep it: K1 alone up to three images, no K3, P, B up to five.
    Provisional,
    /// Self-calibration: every parameter is free but those known beforehand. A camera of fewer than
    /// [`IMAGES_FOR_ALL`] oriented images stays provisional.
    Free,
}

/// Images from which c, x0, y0 and K2 are let go provisionally: with rolls and convergence they are no longer one with
/// the orientations.
const IMAGES_FOR_POINT_AND_DISTANCE: usize = 4;

/// Images from which all ten are, and from which a lens is calibrated; fewer cannot tell its parameters from their
/// orientations.
pub(super) const IMAGES_FOR_ALL: usize = 6;

/// Standard deviation of a principal distance taken from a camera file or EXIF, as a share of it: focusing changes it
/// by some per cent.
const DISTANCE_SHARE: f64 = 0.05;
/// The same where the principal distance was searched.
const SEARCHED_DISTANCE_SHARE: f64 = 0.3;
/// Standard deviation of the principal point, as a share of the half diagonal.
const PRINCIPAL_POINT_SHARE: f64 = 0.03;
/// Standard deviation of the radial distortion of each order in the image corner, as a share of the radius.
const RADIAL_SHARE: f64 = 0.05;
/// The same of the decentring distortion.
const TANGENTIAL_SHARE: f64 = 0.003;
/// Standard deviation of affinity and shear.
const AFFINITY: f64 = 0.002;

/// Oriented images of each camera.
pub(super) fn images_of_cameras(network: &Network) -> BTreeMap<CameraId, usize> {
    let mut images = BTreeMap::new();
    for (_, image, _) in network.oriented_images() {
        *images.entry(image.camera).or_default() += 1;
    }
    images
}

/// The part that the ten parameters take, in the order of `INTERIOR_NAMES`; `images` are the camera's oriented ones.
pub(super) fn parameter_states(
    entry: &CameraEntry,
    freedom: LensFreedom,
    images: usize,
) -> [ParameterState; 10] {
    let nominal = entry.nominal.interior.to_vector();
    let usual = usual_sigmas(entry);
    std::array::from_fn(|parameter| {
        let value = nominal[parameter];
        match (entry.known_sigmas[parameter], freedom) {
            (Some(sigma), _) => ParameterState::Weighted { value, sigma },
            (None, LensFreedom::Free) if images >= IMAGES_FOR_ALL => ParameterState::Free,
            (None, LensFreedom::Provisional) if images < images_for(parameter) => {
                ParameterState::Fixed
            }
            (None, _) => ParameterState::Weighted {
                value,
                sigma: usual[parameter],
            },
        }
    })
}

/// Images from which a parameter (in the order of `INTERIOR_NAMES`) is let go provisionally.
fn images_for(parameter: usize) -> usize {
    match parameter {
        3 => 2,
        0..=2 | 4 => IMAGES_FOR_POINT_AND_DISTANCE,
        _ => IMAGES_FOR_ALL,
    }
}

/// By how much the parameters of real lenses differ from nominal ones.
fn usual_sigmas(entry: &CameraEntry) -> [f64; 10] {
    let camera = &entry.nominal;
    let radius =
        camera.pixel_pitch_mm * f64::from(camera.width_px).hypot(f64::from(camera.height_px)) / 2.0;
    let distance_share = match entry.source {
        InteriorSource::Unknown => SEARCHED_DISTANCE_SHARE,
        InteriorSource::CameraFile => DISTANCE_SHARE,
        InteriorSource::Exif => 2.0 * DISTANCE_SHARE,
    };
    let point = PRINCIPAL_POINT_SHARE * radius;
    let radial = |order: i32| RADIAL_SHARE / radius.powi(2 * order);
    let tangential = TANGENTIAL_SHARE / radius;
    [
        distance_share * camera.interior.principal_distance,
        point,
        point,
        radial(1),
        radial(2),
        radial(3),
        tangential,
        tangential,
        AFFINITY,
        AFFINITY,
    ]
}
