//! Camera parameters that the observations determine, but so badly that their values say nothing.

use super::PlainNetwork;
use super::adjust::Part;
use super::words::with_unit;
use crate::adjustment::{Adjustment, ParameterState};
use crate::camera::Camera;

/// A parameter is badly determined where its standard deviation moves the corner of the image by more than this share of its
/// distance from the middle: for the principal distance, a standard deviation of a tenth of it.
const WEAK_SHARE: f64 = 0.1;

/// A line for every estimated parameter that is badly determined.
pub(super) fn badly_determined(
    network: &PlainNetwork,
    part: &Part,
    adjustment: &Adjustment,
) -> Vec<String> {
    let mut told = Vec::new();
    for (camera, adjusted) in adjustment.cameras.iter().enumerate() {
        let states = &part.problem.cameras[camera].parameters;
        let moved = moved_by_unit(&adjusted.camera);
        for parameter in (0..10).filter(|&k| states[k] != ParameterState::Fixed) {
            // A-priori: without noise the residuals would promise what the rays do not.
            let sigma = adjusted.covariance[(parameter, parameter)].max(0.0).sqrt();
            let sigma = sigma / adjustment.sigma0.max(f64::MIN_POSITIVE);
            let share = sigma * moved[parameter];
            if share > WEAK_SHARE {
                let value = adjusted.camera.interior.to_vector()[parameter];
                told.push(format!(
                    "{}: found {} +- {} (a-priori), which moves the corner of the image by {:.0} % of its radius: badly determined",
                    network.parameter_in_words(camera, parameter),
                    with_unit(value, parameter),
                    with_unit(sigma, parameter),
                    100.0 * share
                ));
            }
        }
    }
    told
}

/// By how much a unit of each parameter moves the corner of the image, in parts of its distance from the middle.
fn moved_by_unit(camera: &Camera) -> [f64; 10] {
    let side = |pixels: u32| f64::from(pixels) * camera.pixel_pitch_mm / 2.0;
    let r = side(camera.width_px).hypot(side(camera.height_px));
    let c = camera.interior.principal_distance;
    let radial = [2, 4, 6].map(|power| r.powi(power));
    [
        1.0 / c,
        1.0 / r,
        1.0 / r,
        radial[0],
        radial[1],
        radial[2],
        // Along the direction of the decentring: three times r squared.
        3.0 * r,
        3.0 * r,
        1.0,
        1.0,
    ]
}
