//! The edge of a round target.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::Similarity;

/// A circle about a place that is kept elsewhere.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Circle {
    /// Unit normal of its plane; either side serves, nothing that is computed from it depends on the sign.
    pub normal: Vector3<f64>,
    /// Radius, mm.
    pub radius_mm: f64,
}

impl Circle {
    /// The same circle with the normal on this side.
    #[must_use]
    pub fn facing(&self, side: &Vector3<f64>) -> Self {
        let sign = if self.normal.dot(side) < 0.0 {
            -1.0
        } else {
            1.0
        };
        Self {
            normal: self.normal * sign,
            ..*self
        }
    }

    /// The same circle after its place was moved by a similarity.
    #[must_use]
    pub fn moved(&self, similarity: &Similarity) -> Self {
        Self {
            // Many motions in a row would let rounding lengthen it.
            normal: (similarity.rotation * self.normal).normalize(),
            radius_mm: similarity.scale * self.radius_mm,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_circle_shows_the_side_that_is_asked_for() {
        let circle = Circle {
            normal: Vector3::z(),
            radius_mm: 2.5,
        };
        let below = Vector3::new(3.0, 0.0, -0.1);
        assert_eq!(circle.facing(&below).normal, -Vector3::z());
        assert_eq!(circle.facing(&-below), circle);
    }
}
