//! What an adjustment may do with the lens.

use std::collections::BTreeMap;

use crate::adjustment::ParameterState;
use crate::network::{CameraEntry, CameraId, InteriorSource, LensParameter, Network};

/// How far the lens is let go.
#[derive(Clone, Copy, Debug)]
pub(super) enum LensFreedom<'a> {
    /// Every parameter is held near its nominal value by what any real lens keeps to, and those that so few images of
    /// the camera cannot tell from their orientations keep it: K1 alone up to three images, no K3, P, B up to five.
    Provisional,
    /// Self-calibration: every parameter is free but those held or known beforehand and the given ones; these, and all of a camera of fewer
    /// than [`IMAGES_FOR_ALL`] oriented images, are weighed by what any real lens keeps to. What the images do not tell then
    /// enters the standard deviations of everything else.
    Calibrated(&'a Weighed),
}

/// Parameters (in the order of `INTERIOR_NAMES`) that the images cannot tell by themselves.
pub(super) type Weighed = BTreeMap<CameraId, [bool; 10]>;

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
    (id, entry): (CameraId, &CameraEntry),
    freedom: LensFreedom<'_>,
    images: usize,
) -> [ParameterState; 10] {
    let nominal = entry.nominal.interior.to_vector();
    let usual = usual_sigmas(entry);
    std::array::from_fn(|parameter| {
        let value = nominal[parameter];
        let own = entry.parameters[parameter];
        match (entry.known_sigmas[parameter], freedom) {
            _ if own == LensParameter::Held => ParameterState::Fixed,
            (None, LensFreedom::Calibrated(_)) if own == LensParameter::Free => {
                ParameterState::Free
            }
            (Some(sigma), _) => ParameterState::Weighted { value, sigma },
            (None, LensFreedom::Calibrated(weighed))
                if images >= IMAGES_FOR_ALL
                    && !weighed.get(&id).is_some_and(|camera| camera[parameter]) =>
            {
                ParameterState::Free
            }
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

/// All parameters of all cameras.
pub(super) fn all_weighed(network: &Network) -> Weighed {
    network.cameras.keys().map(|id| (*id, [true; 10])).collect()
}

/// The parameters whose standard deviation (before it is scaled by sigma0) exceeds this share of what real lenses vary by: as much
/// is known of them without any image.
pub(super) fn untold(network: &Network, cameras: &[(CameraId, [f64; 10])], share: f64) -> Weighed {
    let mut untold = Weighed::new();
    for (id, sigmas) in cameras {
        let entry = &network.cameras[id];
        let usual = usual_sigmas(entry);
        let loose = std::array::from_fn(|parameter| {
            let is_chosen = entry.known_sigmas[parameter].is_some()
                || entry.parameters[parameter] != LensParameter::Automatic;
            !is_chosen && sigmas[parameter] > share * usual[parameter]
        });
        if loose.contains(&true) {
            untold.insert(*id, loose);
        }
    }
    untold
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
