//! Whether the agreement of an image's codes with its orientation could be chance (a contrario; Moisan and Stival, 2004, eq. 6).
//!
//! Three points give poses that fit them exactly, whatever they are named. If all names were wrong, every other point would fall
//! within a tolerance of its predicted place with the probability of the circle's area in the picture's. The expected number of
//! poses that so many codes agree with by chance is `4 C(n, 3) C(n, k) prod a / a0^3`, with `k` of `n` codes agreeing, `a` the
//! probability of each and `a0` that of a single place. A code of several dots shows its own shape besides: seen at a wrong place
//! it would be turned, scaled and sheared otherwise, which its two axes tell each with a probability of their own.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Vector2, Vector3};

use super::resection::KnownRay;
use crate::camera::Camera;
use crate::geometry::Pose;
use crate::network::{Code, PointId};

/// Expected number of wrong poses below which an agreement is none of chance, as its decimal logarithm.
pub(super) const UNLIKELY: f64 = -3.0;

/// A dot with how far it is from its predicted place, px; `None` where that is behind the camera.
pub(super) struct Dot {
    pub(super) point: PointId,
    pub(super) pixel: Vector2<f64>,
    pub(super) miss: Option<Vector2<f64>>,
}

impl Dot {
    /// A dot of a point at this position, under a pose.
    pub(super) fn under(
        camera: &Camera,
        pose: &Pose,
        (point, position): (PointId, &Vector3<f64>),
        pixel: Vector2<f64>,
    ) -> Self {
        let place = camera.project(&pose.camera_from_point(position));
        let miss = place.map(|place| pixel - place);
        Self { point, pixel, miss }
    }
}

/// The dots of known points under a pose.
pub(super) fn dots_under(camera: &Camera, pose: &Pose, rays: &[KnownRay]) -> Vec<Dot> {
    let dot = |ray: &KnownRay| {
        let seen = &ray.observation;
        Dot::under(camera, pose, (ray.point, &seen.point), seen.pixel)
    };
    rays.iter().map(dot).collect()
}

/// Logarithm of the expected number of poses that agree as well by chance, within `tolerance_px`.
pub(super) fn log_chance(dots: &[Dot], camera: &Camera, tolerance_px: f64) -> f64 {
    let area = f64::from(camera.width_px) * f64::from(camera.height_px);
    let place = (std::f64::consts::PI * tolerance_px * tolerance_px / area)
        .min(1.0)
        .log10();
    let mut groups: BTreeMap<Group, Vec<&Dot>> = BTreeMap::new();
    for dot in dots {
        let group = dot
            .point
            .code()
            .map_or(Group::Single(dot.point), Group::Code);
        groups.entry(group).or_default().push(dot);
    }
    let (all, mut agreeing, mut sum) = (groups.len(), 0, 0.0);
    for group in groups.values() {
        let within: Vec<&Dot> = group
            .iter()
            .copied()
            .filter(|dot| dot.miss.is_some_and(|miss| miss.norm() <= tolerance_px))
            .collect();
        // One dot of a code may be hidden in part.
        if within.is_empty() || within.len() + 1 < group.len() {
            continue;
        }
        agreeing += 1;
        sum += place + log_shape(&within);
    }
    4_f64.log10() + log_binomial(all.max(3), 3) + log_binomial(all, agreeing) + sum - 3.0 * place
}

/// Logarithm of the expected number of relative orientations under which `agreeing` of `common` dots of two images meet by chance:
/// five of them give up to ten, and each other one lies within `tolerance_px` of its epipolar line with the share of the picture
/// that the strip along it takes (Moisan and Stival, 2004, eq. 6; Moulon, Monasse and Marlet, 2012).
pub(super) fn log_chance_of_pair(
    common: usize,
    agreeing: usize,
    camera: &Camera,
    tolerance_px: f64,
) -> f64 {
    let [width, height] = [camera.width_px, camera.height_px].map(f64::from);
    let strip = 2.0 * tolerance_px * width.hypot(height) / (width * height);
    let others = agreeing.saturating_sub(5) as f64;
    1.0 + log_binomial(common, agreeing)
        + log_binomial(agreeing, 5)
        + others * strip.min(1.0).log10()
}

/// Whether all dots belong to one code: its shape gives the pose, and no other code speaks for its number or against it.
pub(super) fn is_single_code(dots: &[Dot]) -> bool {
    let codes: BTreeSet<Option<Code>> = dots.iter().map(|dot| dot.point.code()).collect();
    codes.len() == 1 && !codes.contains(&None)
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Group {
    Code(Code),
    Single(PointId),
}

/// Logarithm of the probability that dots are seen in the right shape by chance.
fn log_shape(dots: &[&Dot]) -> f64 {
    /// The places of a code's dots relative to each other are not better than this, px.
    const LEAST_PX: f64 = 0.3;
    /// Dots that tell a shape: two axes and one more.
    const LEAST_DOTS: usize = 4;
    if dots.len() < LEAST_DOTS {
        return 0.0;
    }
    let count = dots.len() as f64;
    let spread = |of: &dyn Fn(&Dot) -> Vector2<f64>| {
        let mean: Vector2<f64> = dots.iter().map(|dot| of(dot)).sum::<Vector2<f64>>() / count;
        let squares: f64 = dots.iter().map(|dot| (of(dot) - mean).norm_squared()).sum();
        (squares / count).sqrt()
    };
    let extent = spread(&|dot| dot.pixel);
    let departure = spread(&|dot| dot.miss.unwrap_or_default()).max(LEAST_PX);
    let each = (3.0 * departure / extent.max(f64::MIN_POSITIVE))
        .min(1.0)
        .powi(2);
    2.0 * each.log10()
}

fn log_binomial(n: usize, k: usize) -> f64 {
    let term = |i: usize| ((n - i) as f64 / (i + 1) as f64).log10();
    (0..k.min(n)).map(term).sum()
}

#[cfg(test)]
mod tests {
    use super::super::trial::code_camera;
    use super::*;
    use crate::targets::Family;

    fn ring(number: u32, miss_px: f64) -> Dot {
        let [point] = PointId::of_code(Family::Ring(14), number)[..] else {
            unreachable!("a ring has one dot");
        };
        Dot {
            point,
            pixel: Vector2::new(100.0 * f64::from(number), 500.0),
            miss: Some(Vector2::new(miss_px, 0.0)),
        }
    }

    #[test]
    fn a_fourth_point_counts_by_how_near_it_must_be() {
        let camera = code_camera();
        let dots: Vec<Dot> = (1..=4).map(|number| ring(number, 0.5)).collect();
        assert!(log_chance(&dots, &camera, 1.0) < UNLIKELY);
        assert!(log_chance(&dots, &camera, 25.0) > UNLIKELY);
    }

    #[test]
    fn eight_points_of_two_images_prove_what_seven_of_nine_do_not() {
        let camera = code_camera();
        assert!(log_chance_of_pair(8, 8, &camera, 1.0) < UNLIKELY);
        assert!(log_chance_of_pair(9, 7, &camera, 1.0) > UNLIKELY);
        assert!(log_chance_of_pair(5, 5, &camera, 1e-3) > UNLIKELY);
        assert!(log_chance_of_pair(18, 18, &camera, 25.0) < UNLIKELY);
    }

    #[test]
    fn three_points_prove_nothing() {
        let camera = code_camera();
        let dots: Vec<Dot> = (1..=3).map(|number| ring(number, 0.0)).collect();
        assert!(log_chance(&dots, &camera, 1.0) > 0.0);
    }

    #[test]
    fn points_elsewhere_speak_against_an_agreement() {
        let camera = code_camera();
        let few: Vec<Dot> = (1..=5).map(|number| ring(number, 1.0)).collect();
        let mut many: Vec<Dot> = (6..=15).map(|number| ring(number, 900.0)).collect();
        many.extend((1..=5).map(|number| ring(number, 1.0)));
        let [alone, among] = [&few, &many].map(|dots| log_chance(dots, &camera, 2.0));
        assert!(alone + 3.0 < among, "{alone} {among}");
    }
}
