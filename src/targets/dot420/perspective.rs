//! What is known of a code's perspective before its centres are looked at.
//!
//! The two perspective terms (g, h) of `w = 1 + g X + h Y` are the change of depth along the grid. The outlines' areas show them,
//! as `det J ~ w^-3`, but poorly. Where the camera is known, if only roughly, they follow from the local map J itself:
//! turned onto the ray to the code's middle, J is a similarity times a foreshortening, whose larger singular value is the
//! scale `1 / D` and whose ratio is the cosine of the incidence; the turn of the plane is then known but for its sign
//! (scaled orthography: Alter, 3-D Pose from 3 Points Using Weak-Perspective, 1994).

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use super::plane::GridDot;
use crate::camera::Camera;

/// Perspective expected where no camera is given: standard deviation of the change of depth across six pitches, for dots
/// seen round (a plane parallel to the picture has none) and what obliquity adds.
const PERSPECTIVE_ROUND: f64 = 0.01;
const PERSPECTIVE_OBLIQUE: f64 = 0.04;
/// Standard deviation of the logarithm of an outline's area: this much, and this many pixels over its smaller diameter.
const LOG_AREA_SIGMA: f64 = 0.04;
const LOG_AREA_PX: f64 = 0.3;
/// Standard deviation of the foreshortening that the fitted map shows.
const FORESHORTENING_SIGMA: f64 = 0.01;
/// What lens distortion adds to the perspective terms, in units of pitch over distance: the scale of a wide-angle lens
/// changes by some per cent over half the picture.
const LENS_TERM: f64 = 0.1;

/// The camera as far as it is known beforehand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NominalCamera {
    /// Principal distance, px.
    pub principal_distance_px: f64,
    /// Principal point, px; the middle of the picture serves.
    pub principal_point_px: [f64; 2],
    /// Standard deviation of the principal distance as a share of it: 0.03 for a camera file, 0.1 for an engraved focal length,
    /// 0.3 for a guess.
    pub principal_distance_share: f64,
}

impl NominalCamera {
    /// A camera whose principal distance is right to `principal_distance_share` of itself.
    #[must_use]
    pub fn of(camera: &Camera, principal_distance_share: f64) -> Self {
        let interior = &camera.interior;
        let principal_point = camera.pixel_from_image(&Vector2::from(interior.principal_point));
        Self {
            principal_distance_px: interior.principal_distance / camera.pixel_pitch_mm,
            principal_point_px: principal_point.into(),
            principal_distance_share,
        }
    }
}

/// Expected perspective terms, pitches^-1, and the weight matrix of that expectation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Perspective {
    pub(super) expected: Vector2<f64>,
    pub(super) weight: Matrix2<f64>,
}

impl Perspective {
    /// Squared distance from other terms.
    pub(super) fn cost(&self, terms: Vector2<f64>) -> f64 {
        let off = terms - self.expected;
        off.dot(&(self.weight * off))
    }

    /// What two independent expectations say together.
    fn joined(&self, other: &Self) -> Option<Self> {
        let weight = self.weight + other.weight;
        let right = self.weight * self.expected + other.weight * other.expected;
        Some(Self {
            expected: weight.try_inverse()? * right,
            weight,
        })
    }

    /// What the areas of the outlines show, joined with the expectation of a slight perspective.
    pub(super) fn without_camera(dots: &[GridDot; 6]) -> Self {
        let aspect = |dot: &GridDot| (dot.minor_px * dot.minor_px / dot.log_area.exp()).min(1.0);
        let aspect = dots.iter().map(aspect).sum::<f64>() / 6.0;
        let obliquity = (1.0 - aspect * aspect).sqrt();
        let sigma = (PERSPECTIVE_ROUND + PERSPECTIVE_OBLIQUE * obliquity) / 6.0;
        let slight = Self {
            expected: Vector2::zeros(),
            weight: Matrix2::identity() / (sigma * sigma),
        };
        let (normal, right) = area_equations(dots);
        let weight = normal + slight.weight;
        Self {
            expected: weight.try_inverse().map_or(Vector2::zeros(), |q| q * right),
            weight,
        }
    }

    /// What a camera says of a code with this local map (pitches to pixels) at its middle, joined with the outlines' areas: one for
    /// either sign of the turn.
    pub(super) fn with_camera(
        dots: &[GridDot; 6],
        map: Matrix2<f64>,
        middle_px: Vector2<f64>,
        camera: &NominalCamera,
    ) -> Option<[Self; 2]> {
        let (normal, right) = area_equations(dots);
        let areas = Self {
            expected: normal.try_inverse()? * right,
            weight: normal,
        };
        let [one, other] = perspectives_of_turns(map, middle_px, camera)?;
        Some([areas.joined(&one)?, areas.joined(&other)?])
    }
}

/// Normal equations of the perspective terms from the areas: `log area = const - 3 log w`, `log w = g X + h Y` to first
/// order.
fn area_equations(dots: &[GridDot; 6]) -> (Matrix2<f64>, Vector2<f64>) {
    let place = |dot: &GridDot| Vector2::from(dot.grid.map(f64::from));
    let weight = |dot: &GridDot| (LOG_AREA_SIGMA + LOG_AREA_PX / dot.minor_px).powi(-2);
    let total: f64 = dots.iter().map(weight).sum();
    let weighted = dots.iter().map(|d| place(d) * weight(d));
    let middle = weighted.sum::<Vector2<f64>>() / total;
    let level = dots.iter().map(|d| d.log_area * weight(d)).sum::<f64>() / total;
    let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
    for dot in dots {
        let by_terms = (place(dot) - middle) * -3.0;
        normal += by_terms * by_terms.transpose() * weight(dot);
        right += by_terms * ((dot.log_area - level) * weight(dot));
    }
    (normal, right)
}

/// The perspective terms of a plane by its local map, for both signs of its turn against the ray.
fn perspectives_of_turns(
    map: Matrix2<f64>,
    middle_px: Vector2<f64>,
    camera: &NominalCamera,
) -> Option<[Perspective; 2]> {
    let c = camera.principal_distance_px;
    let share = camera.principal_distance_share;
    let ray = (middle_px - Vector2::from(camera.principal_point_px)) / c;
    let slope = ray.norm();
    let outward = if slope > 0.0 {
        ray / slope
    } else {
        Vector2::x()
    };
    // From the picture's plane to one across the ray: shorter by sec^2 along the ray's slope, by sec across it.
    let secant = slope.hypot(1.0);
    let radial = outward * outward.transpose();
    let onto_ray = radial / (secant * secant) + (Matrix2::identity() - radial) / secant;
    let across = onto_ray * map / c;
    let eigen = (across.transpose() * across).symmetric_eigen();
    let large = usize::from(eigen.eigenvalues[1] > eigen.eigenvalues[0]);
    let (long, short) = (eigen.eigenvalues[large], eigen.eigenvalues[1 - large]);
    if !(long > 0.0 && long.is_finite() && share > 0.0) {
        return None;
    }
    let distance = long.sqrt().recip();
    let cosine = (short.max(0.0) / long).sqrt();
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let along = eigen.eigenvectors.column(1 - large).into_owned();
    // The depth rises with the turn of the plane, and falls outwards as the ray is oblique to the axis.
    let turn = along * (sine / distance);
    let oblique = -(across.transpose() * outward) * slope;
    let sine_sigma = cosine * FORESHORTENING_SIGMA / sine.max((2.0 * FORESHORTENING_SIGMA).sqrt());
    let floor = LENS_TERM.hypot(sine_sigma) / distance;
    let covariance = (turn * turn.transpose() + oblique * oblique.transpose() * 4.0)
        * (share * share)
        + Matrix2::identity() * (floor * floor);
    let weight = covariance.try_inverse()?;
    Some([1.0, -1.0].map(|sign| Perspective {
        expected: turn * sign + oblique,
        weight,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;
    use nalgebra::Vector3;

    /// One of the two turns is the true one, anywhere in the picture.
    #[test]
    fn the_map_shows_the_perspective_of_a_known_camera() {
        let camera = NominalCamera {
            principal_distance_px: 2000.0,
            principal_point_px: [1500.0, 1000.0],
            principal_distance_share: 0.1,
        };
        let viewpoint = Vector3::new(60.0, -70.0, 110.0);
        for aim in [Vector3::zeros(), Vector3::new(40.0, 20.0, -5.0)] {
            let pose = Pose::looking_at(viewpoint, aim, Vector3::y(), 0.4);
            // The camera looks along -z, rows of the picture run downwards.
            let seen = |x: f64, y: f64| pose.camera_from_point(&Vector3::new(x, y, 0.0));
            let px = |x: f64, y: f64| {
                let p = seen(x, y);
                Vector2::new(1500.0 - 2000.0 * p.x / p.z, 1000.0 + 2000.0 * p.y / p.z)
            };
            let step = 1e-4;
            let map = Matrix2::from_columns(&[
                (px(step, 0.0) - px(-step, 0.0)) / (2.0 * step),
                (px(0.0, step) - px(0.0, -step)) / (2.0 * step),
            ]);
            let depth = seen(0.0, 0.0).z;
            let truth = Vector2::new(seen(1.0, 0.0).z - depth, seen(0.0, 1.0).z - depth) / depth;
            let turns = perspectives_of_turns(map, px(0.0, 0.0), &camera).unwrap();
            let nearest = turns.map(|t| (t.expected - truth).norm());
            let least = nearest[0].min(nearest[1]);
            assert!(least < 1e-6 * truth.norm(), "{truth} {turns:?}");
        }
    }
}
