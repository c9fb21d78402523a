//! How exact the measured ellipses of dots are, from the dots that have names.
//!
//! A dot whose target's circle is known has an ellipse that is known too. What is measured beside it has a part that all dots share,
//! the noise of the edge, and one that grows with the dot, as blur and threshold change from picture to picture:
//! `sigma^2 = a^2 + (b d)^2` for a dot of the mean diameter `d`. Both come from the dots themselves, whatever made them; medians keep
//! wrong names and spoilt dots out.

use nalgebra::{Matrix2, Rotation2, Vector2};

use super::shape::root;
use crate::camera::EllipseImage;

/// Standard deviation of the elements of an ellipse's root (the matrix whose square has the squared diameters as eigenvalues), px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EllipsePrecision {
    /// The part that all dots have, px.
    pub axis_px: f64,
    /// The part that grows with the mean diameter, as a share of it.
    pub share: f64,
}

/// A measured ellipse with the one that its target's circle has there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EllipsePair {
    /// As measured.
    pub measured: EllipseImage,
    /// As the circle, the orientation and the camera have it.
    pub expected: EllipseImage,
    /// Rays from which the circle was estimated, this one among them.
    pub rays: usize,
}

/// Dots of like size that tell one variance.
const GROUP: usize = 100;
/// Most groups; more dots make larger ones.
const MOST_GROUPS: usize = 8;
/// Median of chi-square with 3 degrees of freedom.
const MEDIAN: f64 = 2.366;
/// Allowance for the error of the estimate and for dots that are measured worse than most.
const ALLOWANCE: f64 = 1.15;
/// Ellipses are never trusted more than this, px.
const LEAST_PX: f64 = 0.02;
/// Fewest rays of a circle whose dots are asked: those of others bend it to themselves.
const FEWEST_RAYS: usize = 4;

impl EllipsePrecision {
    /// From these dots; `None` where they are too few to tell.
    ///
    /// Cost: a sort of the dots.
    #[must_use]
    pub fn measured(pairs: &[EllipsePair]) -> Option<Self> {
        let mut squares: Vec<[f64; 2]> = pairs
            .iter()
            .filter(|pair| pair.rays >= FEWEST_RAYS)
            .map(|pair| {
                let (measured, expected) = (matrix(&pair.measured), matrix(&pair.expected));
                // Three numbers of the circle are taken from the 3 n of its ellipses.
                let rays = pair.rays as f64;
                let freed = rays / (rays - 1.0);
                let size = expected.trace() / 2.0;
                [size * size, (measured - expected).norm_squared() * freed]
            })
            .filter(|[size, off]| size.is_finite() && off.is_finite())
            .collect();
        if squares.len() < GROUP {
            return None;
        }
        squares.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        let groups = (squares.len() / GROUP).min(MOST_GROUPS);
        let told: Vec<[f64; 2]> = squares
            .chunks(squares.len().div_ceil(groups))
            .map(|group| {
                let of = |which: usize| median(group.iter().map(|square| square[which]));
                [of(0), of(1) / MEDIAN]
            })
            .collect();
        let [of_all, of_size] = line(&told);
        Some(Self {
            axis_px: (ALLOWANCE * of_all.sqrt()).max(LEAST_PX),
            share: ALLOWANCE * of_size.sqrt(),
        })
    }
}

/// `a` and `b` of `v = a + b s`, neither below zero, by least squares with the weights that variances of equal samples have.
fn line(told: &[[f64; 2]]) -> [f64; 2] {
    let mean_of = |value: &dyn Fn(f64, f64) -> f64| {
        let weighted = told
            .iter()
            .map(|&[s, v]| value(s, v) / v.powi(2).max(f64::MIN_POSITIVE));
        weighted.sum::<f64>()
    };
    let [n, s, ss] = [
        mean_of(&|_, _| 1.0),
        mean_of(&|s, _| s),
        mean_of(&|s, _| s * s),
    ];
    let [v, sv] = [mean_of(&|_, v| v), mean_of(&|s, v| s * v)];
    let determinant = n * ss - s * s;
    let [a, b] = [ss * v - s * sv, n * sv - s * v];
    if determinant <= 1e-9 * n * ss || b <= 0.0 {
        return [v / n, 0.0];
    }
    if a <= 0.0 {
        return [0.0, sv / ss];
    }
    [a / determinant, b / determinant]
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn matrix(ellipse: &EllipseImage) -> Matrix2<f64> {
    let turn = Rotation2::new(ellipse.angle);
    let diameters = Vector2::new(ellipse.major_px, ellipse.minor_px);
    let squared = Matrix2::from_diagonal(&diameters.component_mul(&diameters));
    root(&(turn.matrix() * squared * turn.matrix().transpose()))
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn deviate(random: &mut ChaCha8Rng) -> f64 {
        (0..12).map(|_| random.random_range(-0.5..0.5)).sum()
    }

    /// Pairs whose diameters have these errors, and a share of which are spoilt.
    fn pairs(axis_px: f64, share: f64, spoilt: f64) -> Vec<EllipsePair> {
        let mut random = ChaCha8Rng::seed_from_u64(11);
        (0..4000)
            .map(|_| {
                let size = random.random_range(4.0..30.0);
                let expected = EllipseImage {
                    major_px: size,
                    minor_px: 0.6 * size,
                    angle: random.random_range(0.0..3.0),
                };
                let bad = random.random_range(0.0..1.0) < spoilt;
                let sigma = axis_px.hypot(share * 0.8 * size) * if bad { 20.0 } else { 1.0 };
                let turned = deviate(&mut random) * sigma / (2_f64.sqrt() * 0.4 * size);
                let measured = EllipseImage {
                    major_px: expected.major_px + deviate(&mut random) * sigma,
                    minor_px: expected.minor_px + deviate(&mut random) * sigma,
                    angle: expected.angle + turned,
                };
                EllipsePair {
                    measured,
                    expected,
                    rays: 1000,
                }
            })
            .collect()
    }

    #[test]
    fn both_parts_are_found_among_spoilt_dots() {
        for (axis_px, share) in [(0.1, 0.0), (0.05, 0.01), (0.02, 0.02)] {
            let found = EllipsePrecision::measured(&pairs(axis_px, share, 0.05)).expect("many");
            for size in [5.0, 10.0, 20.0] {
                let sigma = |axis: f64, share: f64| axis.hypot(share * size);
                let (true_one, told) = (sigma(axis_px, share), sigma(found.axis_px, found.share));
                let ratio = told / true_one;
                assert!(
                    (1.0..1.4).contains(&ratio),
                    "{axis_px} {share} {size}: {ratio}"
                );
            }
        }
    }

    #[test]
    fn a_few_dots_tell_nothing() {
        let few = &pairs(0.1, 0.0, 0.0)[..GROUP - 1];
        assert_eq!(EllipsePrecision::measured(few), None);
        let loose: Vec<EllipsePair> = pairs(0.1, 0.0, 0.0)
            .into_iter()
            .map(|pair| EllipsePair { rays: 3, ..pair })
            .collect();
        assert_eq!(EllipsePrecision::measured(&loose), None);
    }
}
