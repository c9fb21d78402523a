//! The camera that tests measure with.

use super::{Camera, InteriorOrientation, LensDirection};

/// A wide-angle camera whose lens errs by some tens of pixels in the corners, all ten parameters away from zero.
pub(crate) fn wide_angle_camera() -> Camera {
    Camera {
        width_px: 3072,
        height_px: 2048,
        pixel_pitch_mm: 0.009,
        interior: InteriorOrientation {
            principal_distance: 20.0,
            principal_point: [0.1, -0.05],
            radial: [1.5e-4, -4e-7, 2e-10],
            tangential: [1e-5, -2e-5],
            affinity: [1e-4, -5e-5],
            direction: LensDirection::Correcting,
        },
    }
}
