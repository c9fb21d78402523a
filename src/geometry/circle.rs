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
