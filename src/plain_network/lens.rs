//! Two choices that programs make differently: which way the lens parameters work, and where residuals are formed.

use serde::{Deserialize, Serialize};

/// Which image point the distortion is a function of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum LensDirection {
    /// `ideal = measured + correction(measured)`: a measured point becomes a ray without iteration (Brown, 1971; ours,
    /// DBAT's lens model 3).
    #[default]
    Correcting,
    /// `measured = ideal + distortion(ideal)`: AICON, OpenCV, COLMAP. With `p` the ideal point, mm from the principal
    /// point, and `r2 = |p|^2`, the radial factor is
    /// `f = K1 (r2 - R0^2) + K2 (r2^2 - R0^4) + K3 (r2^3 - R0^6)` and
    /// `x = x0 + px + px f + P1 (r2 + 2 px^2) + 2 P2 px py + B1 px + B2 py`,
    /// `y = y0 + py + py f + P2 (r2 + 2 py^2) + 2 P1 px py`.
    Displacing {
        /// Radius R0 at which the radial distortion is zero, mm; 0 where it is not balanced.
        balanced_radius_mm: f64,
    },
}

/// The plane in which the residuals of image points are formed and weighted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ResidualPlane {
    /// The measured image: residuals are what the measurement erred by.
    #[default]
    Measured,
    /// The image after the correction of the lens, as DBAT forms them.
    Corrected,
}
