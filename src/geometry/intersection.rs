//! Intersection of rays: the point nearest to all of them, and the shortest segment between two.

use nalgebra::{Matrix3, Vector3};

/// Rays that all lie within this angle of each other (radians) have no intersection that would be worth its name.
const PARALLEL: f64 = 1e-7;

/// A half-line in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts (the projection centre), mm.
    pub origin: Vector3<f64>,
    /// Unit vector of its direction.
    pub direction: Vector3<f64>,
}

impl Ray {
    /// A ray along `direction` (any length but zero).
    #[must_use]
    pub fn new(origin: Vector3<f64>, direction: &Vector3<f64>) -> Self {
        Self {
            origin,
            direction: direction.normalize(),
        }
    }

    /// The perpendicular distance of a point from the ray's line, mm.
    #[must_use]
    pub fn distance(&self, point: &Vector3<f64>) -> f64 {
        (point - self.origin).cross(&self.direction).norm()
    }

    /// How far along the ray the foot of a point lies, mm; negative behind the origin.
    #[must_use]
    pub fn range(&self, point: &Vector3<f64>) -> f64 {
        (point - self.origin).dot(&self.direction)
    }

    /// The angle between two rays, 0 to pi, exact for small angles too.
    #[must_use]
    pub fn angle(&self, other: &Ray) -> f64 {
        let cross = self.direction.cross(&other.direction).norm();
        cross.atan2(self.direction.dot(&other.direction))
    }
}

/// The shortest segment between two rays' lines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShortestSegment {
    /// Foot on the first ray, mm.
    pub on_first: Vector3<f64>,
    /// Foot on the second ray, mm.
    pub on_second: Vector3<f64>,
    /// Length of the segment, mm.
    pub length: f64,
    /// Places of the feet along the rays, mm; negative behind the origins.
    pub ranges: [f64; 2],
    /// Angle between the rays, radians.
    pub angle: f64,
}

/// The shortest segment between two rays; `None` for parallel ones.
#[must_use]
pub fn shortest_segment(first: &Ray, second: &Ray) -> Option<ShortestSegment> {
    let cosine = first.direction.dot(&second.direction);
    let sine2 = first.direction.cross(&second.direction).norm_squared();
    // NaN fails this test too.
    if !(sine2 > PARALLEL * PARALLEL) {
        return None;
    }
    let base = second.origin - first.origin;
    let (along_first, along_second) = (base.dot(&first.direction), base.dot(&second.direction));
    let s = (along_first - along_second * cosine) / sine2;
    let t = (along_first * cosine - along_second) / sine2;
    let on_first = first.origin + s * first.direction;
    let on_second = second.origin + t * second.direction;
    Some(ShortestSegment {
        on_first,
        on_second,
        length: (on_second - on_first).norm(),
        ranges: [s, t],
        angle: first.angle(second),
    })
}

/// The point that several rays share best.
#[derive(Clone, Debug, PartialEq)]
pub struct Intersection {
    /// The point, mm.
    pub point: Vector3<f64>,
    /// Times the squared angular standard error of a ray (rad^2 per direction across it): the point's covariance, mm^2.
    pub cofactor: Matrix3<f64>,
    /// Perpendicular distances of the point from the rays, mm.
    pub distances: Vec<f64>,
    /// Root mean square of the distances, mm.
    pub rms_distance: f64,
    /// Root mean square of distance over range per direction across the ray and degree of freedom, radians.
    pub angular_sigma: f64,
    /// Largest angle between two of the rays' lines, radians in [0, pi/2].
    pub largest_angle: f64,
    /// Rays on which the point lies behind the origin.
    pub behind: usize,
}

/// Why rays have no intersection.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum IntersectionError {
    /// Fewer than two rays.
    #[error("an intersection needs 2 rays, found {found}")]
    TooFewRays {
        /// Rays given.
        found: usize,
    },
    /// All rays run the same way, so their depth is free.
    #[error("the rays are parallel: their largest angle is {largest_angle:.1e} rad")]
    Parallel {
        /// Largest angle between two rays, radians.
        largest_angle: f64,
    },
}

/// The point with the least sum of squared angular misses of `rays` (perpendicular distance over range; the ranges are
/// those of the unweighted solution, Foerstner and Wrobel, 2016, 13.4).
///
/// # Errors
/// [`IntersectionError`] with fewer than two rays or parallel ones. A point behind origins is returned and counted.
pub fn intersect_rays(rays: &[Ray]) -> Result<Intersection, IntersectionError> {
    if rays.len() < 2 {
        return Err(IntersectionError::TooFewRays { found: rays.len() });
    }
    let largest_angle = largest_angle(rays);
    let parallel = IntersectionError::Parallel { largest_angle };
    if !(largest_angle > PARALLEL) {
        return Err(parallel);
    }
    // Sums relative to the first origin keep digits when the world's origin is far away.
    let origin = rays[0].origin;
    let mut weights = vec![1.0; rays.len()];
    let mut point = Vector3::zeros();
    let mut cofactor = Matrix3::zeros();
    for _ in 0..2 {
        let mut normal = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for (ray, weight) in rays.iter().zip(&weights) {
            let across = Matrix3::identity() - ray.direction * ray.direction.transpose();
            normal += *weight * across;
            right += *weight * (across * (ray.origin - origin));
        }
        cofactor = normal.try_inverse().ok_or(parallel)?;
        point = origin + cofactor * right;
        for (ray, weight) in rays.iter().zip(&mut weights) {
            let range2 = (point - ray.origin).norm_squared();
            *weight = if range2 > 0.0 { 1.0 / range2 } else { 1.0 };
        }
    }
    if !point.iter().all(|x| x.is_finite()) {
        return Err(parallel);
    }
    let distances: Vec<f64> = rays.iter().map(|ray| ray.distance(&point)).collect();
    let squares: f64 = distances.iter().map(|d| d * d).sum();
    let weighted: f64 = distances.iter().zip(&weights).map(|(d, w)| w * d * d).sum();
    Ok(Intersection {
        point,
        cofactor,
        rms_distance: (squares / rays.len() as f64).sqrt(),
        angular_sigma: (weighted / (2 * rays.len() - 3) as f64).sqrt(),
        largest_angle,
        behind: rays.iter().filter(|ray| ray.range(&point) <= 0.0).count(),
        distances,
    })
}

/// The largest angle between two rays' lines.
fn largest_angle(rays: &[Ray]) -> f64 {
    let mut largest: f64 = 0.0;
    for (i, first) in rays.iter().enumerate() {
        for second in &rays[i + 1..] {
            let angle = first.angle(second);
            largest = largest.max(angle.min(std::f64::consts::PI - angle));
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Rays from three stations towards a point.
    fn rays(point: &Vector3<f64>) -> [Ray; 3] {
        [
            [0.0, -300.0, 900.0],
            [500.0, 0.0, 800.0],
            [-400.0, 200.0, 1000.0],
        ]
        .map(|station| {
            let station = Vector3::from(station);
            Ray::new(station, &(point - station))
        })
    }

    proptest! {
        #[test]
        fn exact_rays_meet_in_their_point(x in -200.0..200.0, y in -200.0..200.0, z in -200.0..200.0) {
            let point = Vector3::new(x, y, z);
            let found = intersect_rays(&rays(&point)).unwrap();
            // Coordinates of 1 m carry 1e-13 mm; the geometry multiplies that by some 100.
            prop_assert!((found.point - point).norm() < 1e-9);
        }

        #[test]
        fn the_shortest_segment_is_perpendicular_to_both_rays(
            a in prop::array::uniform3(-9.0..9.0), b in prop::array::uniform3(-9.0..9.0),
            u in prop::array::uniform3(-1.0..1.0), v in prop::array::uniform3(-1.0..1.0),
        ) {
            let first = Ray::new(Vector3::from(a), &(Vector3::from(u) + Vector3::x() * 3.0));
            let second = Ray::new(Vector3::from(b), &(Vector3::from(v) + Vector3::y() * 3.0));
            let segment = shortest_segment(&first, &second).unwrap();
            let across = segment.on_second - segment.on_first;
            prop_assert!(across.dot(&first.direction).abs() < 1e-9 && across.dot(&second.direction).abs() < 1e-9);
            prop_assert!(first.distance(&segment.on_first) < 1e-9 && second.distance(&segment.on_second) < 1e-9);
        }
    }

    #[test]
    fn parallel_and_single_rays_are_refused() {
        let ray = Ray::new(Vector3::zeros(), &Vector3::z());
        let beside = Ray::new(Vector3::x(), &Vector3::z());
        assert_eq!(
            intersect_rays(&[ray]),
            Err(IntersectionError::TooFewRays { found: 1 })
        );
        assert!(matches!(
            intersect_rays(&[ray, beside]),
            Err(IntersectionError::Parallel { .. })
        ));
        assert_eq!(shortest_segment(&ray, &beside), None);
        let not_a_number = Ray {
            direction: Vector3::repeat(f64::NAN),
            ..ray
        };
        assert!(intersect_rays(&[ray, not_a_number]).is_err());
    }

    #[test]
    fn a_point_behind_the_cameras_is_told() {
        let first = Ray::new(Vector3::zeros(), &Vector3::new(1.0, 0.0, 1.0));
        let second = Ray::new(Vector3::x() * 10.0, &Vector3::new(2.0, 0.0, 1.0));
        assert_eq!(intersect_rays(&[first, second]).unwrap().behind, 2);
    }
}
