//! How exact the measured ellipses of dots are, from the dots that have names.
//!
//! A dot whose target's circle is known has an ellipse that is known too. What is measured beside it has a part that all dots share,
//! one that grows with the dot, as blur and threshold change from picture to picture, and one that goes with the error of its centre:
//! what is seen weakly or flatly has both worse. So `sigma^2 = a^2 + (b d)^2 + (c sigma_c)^2` for a dot of the mean diameter `d` and a
//! centre's sigma `sigma_c`. All come from the dots themselves, whatever made them: their ratios from medians of like dots, and how large
//! they are from the dots that fit worst but for a few. The few keep wrong names and spoilt dots out.

use nalgebra::{DMatrix, DVector, Matrix2};

use super::shape::{matrix_of, root};
use crate::camera::EllipseImage;

/// Standard deviation of the elements of an ellipse's root (the matrix whose square has the squared diameters as eigenvalues), px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EllipsePrecision {
    /// The part that all dots have, px.
    pub axis_px: f64,
    /// The part that grows with the mean diameter, as a share of it.
    pub share: f64,
    /// The part that goes with the error of the dot's centre, as a multiple of its standard deviation.
    pub by_centre: f64,
}

/// A measured ellipse with the one that its target's circle has there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EllipsePair {
    /// As measured.
    pub measured: EllipseImage,
    /// Standard deviation of the dot's centre, px.
    pub centre_px: f64,
    /// As the circle, the orientation and the camera have it.
    pub expected: EllipseImage,
    /// Rays from which the circle was estimated, this one among them.
    pub rays: usize,
}

/// Fewest like dots that tell one variance.
const GROUP: usize = 50;
/// Most groups by the centres' sigmas, and of each by size; more dots make larger ones.
const MOST_GROUPS: [usize; 2] = [6, 3];
/// Median of chi-square with 3 degrees of freedom.
const MEDIAN: f64 = 2.366;
/// Share of the dots that may fit worse than the errors are told, and the value of chi-square with 3 degrees of freedom that so many
/// exceed.
const SPOILT: f64 = 0.005;
const RARELY_EXCEEDED: f64 = 12.84;
/// Allowance for the error of the estimate.
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
        let mut dots: Vec<Off> = pairs
            .iter()
            .filter(|pair| pair.rays >= FEWEST_RAYS)
            .map(Off::of)
            .filter(|dot| dot.off.is_finite() && dot.parts.iter().all(|part| part.is_finite()))
            .collect();
        if dots.len() < GROUP {
            return None;
        }
        let mut told = Vec::new();
        for like in grouped(&mut dots, CENTRE, MOST_GROUPS[0]) {
            for like in grouped(like, SIZE, MOST_GROUPS[1]) {
                let parts = [0, 1, 2].map(|k| median(like.iter().map(|dot| dot.parts[k])));
                let off = median(like.iter().map(|dot| dot.off)) / MEDIAN;
                told.push(Off { parts, off });
            }
        }
        let parts = parts_of(&told);
        let misfit = |dot: &Off| {
            let variance: f64 = dot
                .parts
                .iter()
                .zip(&parts)
                .map(|(by, part)| by * part)
                .sum();
            dot.off / variance.max(f64::MIN_POSITIVE)
        };
        let mut misfits: Vec<f64> = dots.iter().map(misfit).collect();
        misfits.sort_by(f64::total_cmp);
        let spoilt = (SPOILT * misfits.len() as f64) as usize;
        let worse = (misfits[misfits.len() - 1 - spoilt] / RARELY_EXCEEDED).max(1.0);
        let [axis_px, share, by_centre] = parts.map(|part| ALLOWANCE * (worse * part).sqrt());
        Some(Self {
            axis_px: axis_px.max(LEAST_PX),
            share,
            by_centre,
        })
    }
}

/// How far a dot's ellipse is off, and what that may go with; all squared, px^2.
#[derive(Clone, Copy)]
struct Off {
    /// One, the mean diameter, the sigma of the centre.
    parts: [f64; 3],
    off: f64,
}

/// Places among [`Off::parts`].
const SIZE: usize = 1;
const CENTRE: usize = 2;

impl Off {
    fn of(pair: &EllipsePair) -> Self {
        let (measured, expected) = (root_of(&pair.measured), root_of(&pair.expected));
        // Three numbers of the circle are taken from the 3 n of its ellipses.
        let rays = pair.rays as f64;
        let freed = rays / (rays - 1.0);
        let size = expected.trace() / 2.0;
        Self {
            parts: [1.0, size * size, pair.centre_px * pair.centre_px],
            off: (measured - expected).norm_squared() * freed,
        }
    }
}

/// Groups of dots that are alike in a part, of at least [`GROUP`], by that part.
fn grouped(dots: &mut [Off], part: usize, most: usize) -> impl Iterator<Item = &mut [Off]> {
    dots.sort_by(|a, b| {
        let by_part = a.parts[part].total_cmp(&b.parts[part]);
        by_part.then(a.off.total_cmp(&b.off))
    });
    let groups = (dots.len() / GROUP).clamp(1, most);
    dots.chunks_mut(dots.len().div_ceil(groups))
}

/// How much each part has of the variances, none below zero: least squares with the weights that variances of equal samples have, by all
/// choices of parts that are there at all.
fn parts_of(told: &[Off]) -> [f64; 3] {
    let mut best: Option<(f64, [f64; 3])> = None;
    for choice in 1..8_usize {
        let chosen: Vec<usize> = (0..3).filter(|k| choice >> k & 1 == 1).collect();
        let relative =
            |row: usize, part: usize| told[row].parts[part] / told[row].off.max(f64::MIN_POSITIVE);
        let design = DMatrix::from_fn(told.len(), chosen.len(), |row, k| relative(row, chosen[k]));
        let right = DVector::from_element(told.len(), 1.0);
        let Some(factor) = (design.transpose() * &design).cholesky() else {
            continue;
        };
        let found = factor.solve(&(design.transpose() * &right));
        if found.iter().any(|part| *part <= 0.0) {
            continue;
        }
        let cost = (design * &found - right).norm_squared();
        if best.is_none_or(|(least, _)| cost < least) {
            let mut parts = [0.0; 3];
            for (k, part) in chosen.iter().zip(found.iter()) {
                parts[*k] = *part;
            }
            best = Some((cost, parts));
        }
    }
    best.map_or([0.0; 3], |(_, parts)| parts)
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn root_of(ellipse: &EllipseImage) -> Matrix2<f64> {
    root(&matrix_of(
        ellipse.major_px,
        ellipse.minor_px,
        ellipse.angle,
    ))
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
    fn pairs(precision: &EllipsePrecision, spoilt: f64) -> Vec<EllipsePair> {
        let mut random = ChaCha8Rng::seed_from_u64(11);
        (0..4000)
            .map(|_| {
                let size = random.random_range(4.0..30.0);
                let centre_px = 0.005 * random.random_range(0.0_f64..4.0).exp();
                let expected = EllipseImage {
                    major_px: size,
                    minor_px: 0.6 * size,
                    angle: random.random_range(0.0..3.0),
                };
                let bad = random.random_range(0.0..1.0) < spoilt;
                let sigma = sigma(precision, 0.8 * size, centre_px) * if bad { 20.0 } else { 1.0 };
                let turned = deviate(&mut random) * sigma / (2_f64.sqrt() * 0.4 * size);
                let measured = EllipseImage {
                    major_px: expected.major_px + deviate(&mut random) * sigma,
                    minor_px: expected.minor_px + deviate(&mut random) * sigma,
                    angle: expected.angle + turned,
                };
                EllipsePair {
                    measured,
                    centre_px,
                    expected,
                    rays: 1000,
                }
            })
            .collect()
    }

    fn sigma(precision: &EllipsePrecision, size: f64, centre_px: f64) -> f64 {
        let of_dot = precision.axis_px.hypot(precision.share * size);
        of_dot.hypot(precision.by_centre * centre_px)
    }

    const PRECISIONS: [EllipsePrecision; 4] = [
        precision(0.1, 0.0, 0.0),
        precision(0.05, 0.01, 0.0),
        precision(0.02, 0.0, 2.5),
        precision(0.03, 0.01, 1.5),
    ];

    const fn precision(axis_px: f64, share: f64, by_centre: f64) -> EllipsePrecision {
        EllipsePrecision {
            axis_px,
            share,
            by_centre,
        }
    }

    #[test]
    fn all_parts_are_found_among_spoilt_dots() {
        for given in &PRECISIONS {
            let found = EllipsePrecision::measured(&pairs(given, 0.003)).expect("many");
            for size in [5.0, 10.0, 20.0] {
                for centre_px in [0.01, 0.05, 0.2] {
                    let told = sigma(&found, size, centre_px);
                    let ratio = told / sigma(given, size, centre_px);
                    assert!(
                        (0.95..1.5).contains(&ratio),
                        "{given:?} {found:?} {size} {centre_px}: {ratio}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_few_dots_tell_nothing() {
        let all = pairs(&PRECISIONS[0], 0.0);
        assert_eq!(EllipsePrecision::measured(&all[..GROUP - 1]), None);
        let loose: Vec<EllipsePair> = all
            .into_iter()
            .map(|pair| EllipsePair { rays: 3, ..pair })
            .collect();
        assert_eq!(EllipsePrecision::measured(&loose), None);
    }
}
