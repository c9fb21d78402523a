//! The similarity transformation that fits one set of points best onto another.

use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};

/// `target = scale * rotation * source + translation`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Similarity {
    /// Scale, without unit.
    pub scale: f64,
    /// Rotation from the source to the target frame.
    pub rotation: Rotation3<f64>,
    /// Translation in the target frame, mm.
    pub translation: Vector3<f64>,
}

impl Similarity {
    /// The transformation that changes nothing.
    #[must_use]
    pub fn identity() -> Self {
        Self {
            scale: 1.0,
            rotation: Rotation3::identity(),
            translation: Vector3::zeros(),
        }
    }

    /// A point of the source frame in the target frame.
    #[must_use]
    pub fn apply(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.scale * (self.rotation * point) + self.translation
    }

    /// This transformation after another one.
    #[must_use]
    pub fn after(&self, first: &Self) -> Self {
        Self {
            scale: self.scale * first.scale,
            rotation: self.rotation * first.rotation,
            translation: self.apply(&first.translation),
        }
    }

    /// The transformation back.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.inverse();
        let scale = 1.0 / self.scale;
        Self {
            scale,
            rotation,
            translation: -scale * (rotation * self.translation),
        }
    }
}

/// Whether the scale is estimated or kept at one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Six parameters.
    One,
    /// Seven parameters.
    Free,
}

/// Why no similarity could be fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FitError {
    /// Fewer than three pairs.
    #[error("a best fit needs 3 common points, found {found}")]
    TooFewPoints {
        /// Pairs given.
        found: usize,
    },
    /// All source or target points lie on one line, so the turn about it is free.
    #[error("the common points lie on one line")]
    Collinear,
}

/// The least-squares similarity of pairs (source, target), each pair with weight 1 (Umeyama, 1991, eqs. 39-42: the
/// sign matrix keeps the rotation proper, also for flat point sets).
///
/// # Errors
/// [`FitError`] with fewer than three pairs or collinear points.
pub fn fit_similarity(
    pairs: &[(Vector3<f64>, Vector3<f64>)],
    scale: Scale,
) -> Result<Similarity, FitError> {
    if pairs.len() < 3 {
        return Err(FitError::TooFewPoints { found: pairs.len() });
    }
    let n = pairs.len() as f64;
    let source_centre = pairs.iter().map(|p| p.0).sum::<Vector3<f64>>() / n;
    let target_centre = pairs.iter().map(|p| p.1).sum::<Vector3<f64>>() / n;
    let mut correlation = Matrix3::zeros();
    let mut source_spread = 0.0;
    for (source, target) in pairs {
        correlation += (target - target_centre) * (source - source_centre).transpose();
        source_spread += (source - source_centre).norm_squared();
    }
    let svd = correlation.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Err(FitError::Collinear);
    };
    if svd.singular_values[1] <= 1e-10 * svd.singular_values[0] {
        return Err(FitError::Collinear);
    }
    let sign = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    let rotation = Rotation3::from_matrix_unchecked(u * sign * v_t);
    let scale = match scale {
        Scale::One => 1.0,
        Scale::Free => {
            (Matrix3::from_diagonal(&svd.singular_values) * sign).trace() / source_spread
        }
    };
    Ok(Similarity {
        scale,
        rotation,
        translation: target_centre - scale * (rotation * source_centre),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(range: f64) -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-range..range).prop_map(Vector3::from)
    }

    proptest! {
        #[test]
        fn an_exact_similarity_is_found_again(
            points in prop::collection::vec(vector(500.0), 4..12),
            turn in vector(1.7),
            translation in vector(1000.0),
            scale in 0.2..5.0,
        ) {
            let truth = Similarity { scale, rotation: Rotation3::new(turn), translation };
            let pairs: Vec<_> = points.iter().map(|p| (*p, truth.apply(p))).collect();
            if let Ok(found) = fit_similarity(&pairs, Scale::Free) {
                for (source, target) in &pairs {
                    prop_assert!((found.apply(source) - target).norm() < 1e-8);
                }
                prop_assert!(found.rotation.matrix().determinant() > 0.0);
            }
        }
    }

    #[test]
    fn points_on_a_line_are_refused() {
        let pairs: Vec<_> = (0..5)
            .map(|i| (Vector3::x() * f64::from(i), Vector3::y() * f64::from(i)))
            .collect();
        assert_eq!(fit_similarity(&pairs, Scale::One), Err(FitError::Collinear));
    }
}
