//! How exactly a view predicts the place of a point.

use nalgebra::{Matrix2, Matrix3, Vector3};

use super::problem::{ObjectSpace, View};
use super::sight::Sight;

/// A view that predicts how exactly it ought to show a point.
pub struct Predictor(Sight);

impl Predictor {
    /// That of a view; its dots mean nothing.
    #[must_use]
    pub fn new(view: &View) -> Self {
        let everywhere = ObjectSpace {
            min: Vector3::repeat(f64::MIN),
            max: Vector3::repeat(f64::MAX),
        };
        Self(Sight::new(view, 0.0, everywhere))
    }

    /// Covariance of a point's place in the picture, px^2, from that of the point (mm^2) and of the view's orientation; `None` for a
    /// point behind the camera.
    #[must_use]
    pub fn covariance(
        &self,
        point: &Vector3<f64>,
        covariance: &Matrix3<f64>,
    ) -> Option<Matrix2<f64>> {
        let seen = self.0.sighting(point)?;
        let of_point = seen.by_point * covariance * seen.by_point.transpose();
        // In ideal pixels y is down as well; the lens changes lengths by little.
        Some(of_point + self.0.uncertainty(&seen))
    }
}
