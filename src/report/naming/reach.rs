//! How well a best fit is known at a place: where it is only extrapolated, the nearest point may be the wrong one.

use nalgebra::{Matrix3, Vector3};
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::geometry::Scale;

/// Probability with which a place is no farther off than said.
const CONFIDENCE: f64 = 0.999;

/// The precision of a best fit by its residuals.
#[derive(Clone, Debug)]
pub(super) struct Reach {
    centre: Vector3<f64>,
    count: f64,
    /// Inverse of the normal matrix of the turn.
    turn: Matrix3<f64>,
    /// Inverse of that of the scale; 0 where it is kept.
    scale: f64,
    /// Quantile of Student's distribution times the standard deviation of a coordinate, mm.
    largest: f64,
}

impl Reach {
    /// Of a fit by these pairs (moved place, known place); `None` where they say nothing about it.
    pub(super) fn of(pairs: &[(Vector3<f64>, Vector3<f64>)], scale: Scale) -> Option<Self> {
        let unknowns = match scale {
            Scale::One => 6,
            Scale::Free => 7,
        };
        let redundancy = (3 * pairs.len()).checked_sub(unknowns).filter(|r| *r > 0)? as f64;
        let count = pairs.len() as f64;
        let centre = pairs.iter().map(|pair| pair.0).sum::<Vector3<f64>>() / count;
        let mut normal = Matrix3::zeros();
        let mut squares = 0.0;
        for (moved, known) in pairs {
            let arm = moved - centre;
            normal += Matrix3::identity() * arm.norm_squared() - arm * arm.transpose();
            squares += (moved - known).norm_squared();
        }
        let student = StudentsT::new(0.0, 1.0, redundancy).ok()?;
        let quantile = student.inverse_cdf(0.5 + 0.5 * CONFIDENCE);
        Some(Self {
            centre,
            count,
            turn: normal.try_inverse()?,
            scale: match scale {
                Scale::One => 0.0,
                // The trace of the normal matrix is twice the sum of the squared arms.
                Scale::Free => 2.0 / normal.trace(),
            },
            largest: quantile * (squares / redundancy).sqrt(),
        })
    }

    /// Within what distance of the truth a moved place is, mm.
    pub(super) fn at(&self, place: &Vector3<f64>) -> f64 {
        let arm = place - self.centre;
        let across = arm.cross_matrix();
        let variance = 3.0 / self.count
            + (across * self.turn * across.transpose()).trace()
            + self.scale * arm.norm_squared();
        self.largest * variance.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::fit_similarity;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Errors of 0.1 mm in points of a cube of 100 mm; how far off places 100 to 1000 mm away come to lie.
    #[test]
    fn places_are_off_no_farther_than_said() {
        for scale in [Scale::One, Scale::Free] {
            let mut random = ChaCha8Rng::seed_from_u64(3);
            let mut inside = 0;
            let mut share = 0.0;
            for trial in 0..2000 {
                let mut vector = |size: f64| {
                    Vector3::from_fn(|_, _| {
                        let sum: f64 = (0..12).map(|_| random.random_range(-0.5..0.5)).sum();
                        size * sum
                    })
                };
                let pairs: Vec<_> = (0..4 + trial % 10)
                    .map(|_| [vector(40.0), vector(0.1)])
                    .map(|[place, error]| (place + error, place))
                    .collect();
                let fit = fit_similarity(&pairs, scale).unwrap();
                let moved: Vec<_> = pairs.iter().map(|p| (fit.apply(&p.0), p.1)).collect();
                let far = vector(400.0);
                let reach = Reach::of(&moved, scale).unwrap().at(&far);
                let off = (fit.apply(&far) - far).norm();
                inside += usize::from(off <= reach);
                share += off / reach / 2000.0;
            }
            assert!(inside >= 1990, "{inside} of 2000");
            assert!(share > 0.1, "said to be far more than it is: {share}");
        }
    }
}
