//! Least-squares intersection of rays with given orientations.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::problem::Member;
use super::sight::{Sight, Sighting};

/// A point with its normal matrix and the fit of its rays.
#[derive(Clone, Debug)]
pub(super) struct Intersection {
    pub(super) point: Vector3<f64>,
    /// Covariance of the point from the ray sigmas, mm^2.
    pub(super) covariance: Matrix3<f64>,
    /// Measured minus computed, ideal px, in the order of the members.
    pub(super) residuals: Vec<Vector2<f64>>,
    /// Squared misfit of each ray, standardised: chi-square with 2 degrees of freedom.
    pub(super) misfits: Vec<f64>,
    pub(super) chi_square: f64,
}

impl Intersection {
    pub(super) fn redundancy(&self) -> usize {
        (2 * self.residuals.len()).saturating_sub(3)
    }

    pub(super) fn rms_px(&self) -> f64 {
        let squares: f64 = self.residuals.iter().map(Vector2::norm_squared).sum();
        (squares / (2 * self.residuals.len()).max(1) as f64).sqrt()
    }

    /// The ray that fits worst and its misfit.
    pub(super) fn worst(&self) -> Option<(usize, f64)> {
        self.misfits
            .iter()
            .copied()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// How two rays pass each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Passing {
    /// Distances from the origins at which they are nearest to each other, mm; never behind a camera.
    pub(super) along: [f64; 2],
    /// Sine of the angle between them.
    pub(super) sine: f64,
}

/// Where two rays pass each other nearest, `None` if they are nearly parallel (below `min_angle`) or do so behind a camera.
pub(super) fn passing(
    (origin_a, a): (&Vector3<f64>, &Vector3<f64>),
    (origin_b, b): (&Vector3<f64>, &Vector3<f64>),
    min_angle: f64,
) -> Option<Passing> {
    let base = origin_b - origin_a;
    let cosine = a.dot(b);
    let sine_squared = 1.0 - cosine * cosine;
    if sine_squared < min_angle.sin().powi(2) {
        return None;
    }
    let along_a = (base.dot(a) - base.dot(b) * cosine) / sine_squared;
    let along_b = (base.dot(a) * cosine - base.dot(b)) / sine_squared;
    (along_a > 0.0 && along_b > 0.0).then(|| Passing {
        along: [along_a, along_b],
        sine: sine_squared.sqrt(),
    })
}

/// The point nearest to two rays, `None` as for [`passing`].
pub(super) fn meet(
    (origin_a, a): (&Vector3<f64>, &Vector3<f64>),
    (origin_b, b): (&Vector3<f64>, &Vector3<f64>),
    min_angle: f64,
) -> Option<Vector3<f64>> {
    let [along_a, along_b] = passing((origin_a, a), (origin_b, b), min_angle)?.along;
    Some((origin_a + a * along_a + origin_b + b * along_b) / 2.0)
}

/// Covariance of how far a dot lies from the prediction of an exactly known point, px^2.
pub(super) fn ray_covariance(sight: &Sight, dot: usize, seen: &Sighting) -> Matrix2<f64> {
    let own = sight.dots[dot].sigma_px;
    sight.uncertainty(seen) + Matrix2::identity() * (own * own)
}

/// Gauss-Newton intersection of the members' rays from a near `start`.
///
/// `None` where fewer than two rays are given, the rays do not fix a point, or it falls behind a camera.
pub(super) fn intersect(
    sights: &[Sight],
    members: &[Member],
    start: &Vector3<f64>,
) -> Option<Intersection> {
    /// Millimetres of a step that no longer matter beside a target's accuracy.
    const STILL_MM: f64 = 1e-6;
    let mut point = *start;
    let weights: Vec<Matrix2<f64>> = members
        .iter()
        .map(|member| {
            let sight = &sights[member.view];
            ray_covariance(sight, member.dot, &sight.sighting(start)?).try_inverse()
        })
        .collect::<Option<_>>()?;
    for _ in 0..6 {
        let mut normal = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for (member, weight) in members.iter().zip(&weights) {
            let sight = &sights[member.view];
            let seen = sight.sighting(&point)?;
            let misclosure = sight.dots[member.dot].place - seen.place;
            let weighted = seen.by_point.transpose() * weight;
            normal += weighted * seen.by_point;
            right += weighted * misclosure;
        }
        let covariance = normal.try_inverse()?;
        let step = covariance * right;
        point += step;
        if !point.iter().all(|v| v.is_finite()) {
            return None;
        }
        if step.norm() < STILL_MM {
            break;
        }
    }
    fit(sights, members, &point)
}

fn fit(sights: &[Sight], members: &[Member], point: &Vector3<f64>) -> Option<Intersection> {
    if members.len() < 2 {
        return None;
    }
    let mut normal = Matrix3::zeros();
    let mut seen = Vec::with_capacity(members.len());
    for member in members {
        let sight = &sights[member.view];
        let sighting = sight.sighting(point)?;
        let covariance = ray_covariance(sight, member.dot, &sighting);
        let weight = covariance.try_inverse()?;
        normal += sighting.by_point.transpose() * weight * sighting.by_point;
        let residual = sight.dots[member.dot].place - sighting.place;
        seen.push((sighting, covariance, weight, residual));
    }
    let covariance = normal.try_inverse()?;
    let mut chi_square = 0.0;
    let mut misfits = Vec::with_capacity(members.len());
    for (sighting, of_ray, weight, residual) in &seen {
        chi_square += residual.dot(&(weight * residual));
        let explained = sighting.by_point * covariance * sighting.by_point.transpose();
        // Covariance of the residual itself; where the ray alone fixes a direction nothing can be tested there.
        let own = of_ray - explained + of_ray * 0.02;
        misfits.push(
            own.try_inverse()
                .map_or(f64::INFINITY, |q| residual.dot(&(q * residual)).max(0.0)),
        );
    }
    Some(Intersection {
        point: *point,
        covariance,
        residuals: seen.into_iter().map(|s| s.3).collect(),
        misfits,
        chi_square,
    })
}

/// The squared misfit of a dot from where a point is predicted (chi-square, 2 degrees of freedom).
pub(super) fn prediction_misfit(
    sight: &Sight,
    dot: usize,
    point: &Vector3<f64>,
    covariance: &Matrix3<f64>,
) -> Option<f64> {
    let seen = sight.sighting(point)?;
    let spread =
        seen.by_point * covariance * seen.by_point.transpose() + ray_covariance(sight, dot, &seen);
    let offset = sight.dots[dot].place - seen.place;
    Some(offset.dot(&(spread.try_inverse()? * offset)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_rays_meet_halfway_between_their_nearest_points() {
        let (a, b) = (Vector3::new(0.0, 0.0, 0.0), Vector3::new(10.0, 0.0, 2.0));
        let (to_x, back) = (
            Vector3::new(1.0, 1.0, 0.0).normalize(),
            Vector3::new(-1.0, 1.0, 0.0).normalize(),
        );
        let point = meet((&a, &to_x), (&b, &back), 0.05).unwrap();
        assert!((point - Vector3::new(5.0, 5.0, 1.0)).norm() < 1e-12);
        assert_eq!(
            meet((&a, &to_x), (&b, &to_x), 0.05),
            None,
            "parallel rays tell no depth"
        );
        assert_eq!(
            meet((&a, &-to_x), (&b, &-back), 0.05),
            None,
            "nothing is seen behind a camera"
        );
    }
}
