//! The camera: interior orientation, lens distortion, projection with Jacobians, images of circles.
//!
//! The lens is the ten-parameter set of close-range photogrammetry (Brown, 1971; Fraser, 1997). In the *correcting* direction, which is
//! the rule, the corrections are functions of the measured image point and are added to it: a measured point becomes a ray without
//! iteration, projection inverts the correction by Newton's method. Other programs' lenses are *displacing*: there the distortion is a
//! function of the ideal point, and it is the ray that takes Newton's method.
//!
//! Image coordinates: millimetres, x right, y up, origin at the image centre. Pixel coordinates: x right, y down,
//! origin at the top-left corner of the image, the first pixel's centre at (0.5, 0.5).

mod brown;
mod circle;
#[cfg(test)]
pub(crate) mod fixture;
mod interior;
mod projection;

pub use circle::EllipseImage;
pub use interior::{
    Correction, Displacement, INTERIOR_NAMES, ImagePoint, InteriorOrientation, LensDirection,
};
pub use projection::{Camera, Projection};
