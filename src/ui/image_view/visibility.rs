//! From which sides targets can be seen, as far as their other images tell.
//!
//! A target's normal is that of its circle, where the adjustment has one. Before that it is told by its ellipses: a round target
//! is imaged as an ellipse whose second moments are `k J (I - n n') J'` to first order: `J` is the
//! derivative of the picture by the point, `n` the target's normal, `k` a sixteenth of its squared diameter. That is
//! linear in the symmetric matrix `S = k (I - n n')`, so three rays or more give `S` by least squares, and the
//! eigenvector of its smallest eigenvalue is the normal: some tenths of a degree for dots of eight pixels. Nothing has to
//! be known of the object's faces.
//!
//! A target should be seen by a camera that is not farther from its normal than dots of this network are measured at,
//! and near enough to a ray that saw it, unless it is seen squarely: what hides it from afar is not known.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::prediction::{Facing, Sight};
use crate::network::{Network, PointId};
use crate::targets::Dot;

/// More labels than this are not searched for the side that points are seen from: it would take longer than a frame.
const MOST_LABELS: usize = 300_000;

/// A camera farther than this from all rays that saw a target may see something before it, degrees.
const NEAR_A_RAY_DEG: f64 = 30.0;

/// A target seen as squarely as this, degrees from its normal, is asked for from wherever: what would hide it must stand
/// in front of its face.
const SQUARELY_DEG: f64 = 45.0;

/// Retro-reflecting targets send light back up to this angle from their normal at least, degrees.
const LEAST_LIMIT_DEG: f64 = 60.0;

/// Whatever a network shows, nothing is asked for beyond this angle, degrees: an ellipse of ratio 0.17.
const LARGEST_LIMIT_DEG: f64 = 80.0;

/// Share of the measured dots that are seen at less than the limit; the rest may be faults.
const SHARE_WITHIN: f64 = 0.99;

/// Added to what is measured, degrees: the precision of a normal.
const WIDENING_DEG: f64 = 0.5;

/// So many points tell the limit.
const SAMPLE: usize = 500;

/// More rays do not make a normal better than it need be.
const RAYS_FOR_NORMAL: usize = 16;

/// The sides that points are seen from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Directions {
    seen: BTreeMap<PointId, Seen>,
    /// Largest angle between a target's normal and a ray at which dots are measured, degrees.
    limit_deg: f64,
}

/// What the images say of one target.
#[derive(Clone, Debug, Default, PartialEq)]
struct Seen {
    /// Unit vectors to the stations that see it.
    rays: Vec<Vector3<f64>>,
    normal: Option<Vector3<f64>>,
}

/// How a camera stands to a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Aspect {
    /// Angle to the target's normal, degrees; `None` where too few ellipses tell it.
    pub(super) incidence_deg: Option<f64>,
    /// Angle to the nearest ray that saw it, degrees.
    pub(super) nearest_deg: f64,
    pub(super) facing: Facing,
}

impl Directions {
    /// The sides that all oriented images see; empty where there are so many labels that a frame has no time for them.
    #[must_use]
    pub fn of(network: &Network) -> Self {
        Self::found(network, |_| true)
    }

    /// As [`Directions::of`] for some points (sorted), which is quicker; the limit is the same.
    pub(super) fn of_points(network: &Network, points: &[PointId]) -> Self {
        Self::found(network, |point| points.binary_search(&point).is_ok())
    }

    fn found(network: &Network, wanted: impl Fn(PointId) -> bool) -> Self {
        let labels = network.oriented_images().map(|(_, e, _)| e.labels.len());
        if labels.sum::<usize>() > MOST_LABELS {
            return Self::default();
        }
        let stride = network.points.len().div_ceil(SAMPLE).max(1);
        let sample: Vec<PointId> = network.points.keys().copied().step_by(stride).collect();
        let is_sample = |point: &PointId| sample.binary_search(point).is_ok();
        let mut found: BTreeMap<PointId, (Seen, Shape)> = BTreeMap::new();
        for (_, entry, _) in network.oriented_images() {
            let (Some(sight), Some(detections)) = (Sight::of(network, entry), &entry.detections)
            else {
                continue;
            };
            for (dot, label) in entry.used_labels() {
                let point = label.point;
                if !wanted(point) && !is_sample(&point) {
                    continue;
                }
                let known = network.points.get(&point);
                let (Some(known), Some(dot)) = (known, detections.dots.get(dot.slot())) else {
                    continue;
                };
                let (seen, shape) = found.entry(point).or_default();
                let towards = sight.pose.centre_in_world - known.position;
                seen.rays.extend(towards.try_normalize(0.0));
                seen.normal = known.circle.map(|circle| circle.normal);
                if seen.normal.is_none() && seen.rays.len() <= RAYS_FOR_NORMAL {
                    shape.add(&sight, &known.position, dot);
                }
            }
        }
        let with_normal = |(point, (mut seen, shape)): (PointId, (Seen, Shape))| {
            let normal = seen.normal.or_else(|| shape.normal(&seen.rays));
            seen.normal = normal.map(|normal| on_their_side(normal, &seen.rays));
            (point, seen)
        };
        let seen: BTreeMap<PointId, Seen> = found.into_iter().map(with_normal).collect();
        let sampled = seen.iter().filter(|(point, _)| is_sample(point));
        let limit_deg = limit(sampled.map(|(_, seen)| seen));
        Self { seen, limit_deg }
    }

    /// How a camera in the direction `towards` stands to a point; `None` where no image tells.
    pub(super) fn aspect(&self, point: PointId, towards: &Vector3<f64>) -> Option<Aspect> {
        let seen = self.seen.get(&point)?;
        let towards = towards.try_normalize(0.0)?;
        let cosines = seen.rays.iter().map(|ray| ray.dot(&towards));
        let nearest_deg = degrees(cosines.fold(-1.0, f64::max));
        let incidence_deg = seen.normal.map(|normal| degrees(normal.dot(&towards)));
        let turned = incidence_deg.is_none_or(|angle| angle <= self.limit_deg);
        let squarely = incidence_deg.is_some_and(|angle| angle <= SQUARELY_DEG);
        let facing = if squarely || turned && nearest_deg <= NEAR_A_RAY_DEG {
            Facing::Towards
        } else {
            Facing::Unknown
        };
        Some(Aspect {
            incidence_deg,
            nearest_deg,
            facing,
        })
    }
}

fn degrees(cosine: f64) -> f64 {
    cosine.clamp(-1.0, 1.0).acos().to_degrees()
}

/// The angle to the normal within which most measured dots are seen.
fn limit<'a>(seen: impl Iterator<Item = &'a Seen>) -> f64 {
    let mut angles: Vec<f64> = seen
        .filter_map(|seen| Some((seen.normal?, &seen.rays)))
        .flat_map(|(normal, rays)| rays.iter().map(move |ray| degrees(normal.dot(ray))))
        .collect();
    angles.sort_by(f64::total_cmp);
    let place = (SHARE_WITHIN * angles.len() as f64) as usize;
    let measured = angles.get(place).map_or(0.0, |angle| angle + WIDENING_DEG);
    measured.clamp(LEAST_LIMIT_DEG, LARGEST_LIMIT_DEG)
}

/// Normal equations of a target's shape matrix: xx, yy, zz, xy, xz, yz.
#[derive(Default)]
struct Shape {
    matrix: SMatrix<f64, 6, 6>,
    right: SVector<f64, 6>,
}

impl Shape {
    fn add(&mut self, sight: &Sight<'_>, position: &Vector3<f64>, dot: &Dot) {
        let in_camera = sight.pose.camera_from_point(position);
        let Some(projection) = sight.camera.project_with_jacobians(&in_camera) else {
            return;
        };
        let by_point = projection.by_point * sight.pose.camera_from_world.matrix();
        let (sin, cos) = dot.angle.sin_cos();
        let (a, b) = (dot.major_px.powi(2), dot.minor_px.powi(2));
        // Near and far dots count alike.
        let weight = 1.0 / (a * b).sqrt();
        if !weight.is_finite() {
            return;
        }
        let moments = [
            (0, 0, a * cos * cos + b * sin * sin),
            (0, 1, (a - b) * sin * cos),
            (1, 1, a * sin * sin + b * cos * cos),
        ];
        for (first, second, moment) in moments {
            let (u, v) = (by_point.row(first), by_point.row(second));
            let row = SVector::<f64, 6>::from([
                u[0] * v[0],
                u[1] * v[1],
                u[2] * v[2],
                u[0] * v[1] + u[1] * v[0],
                u[0] * v[2] + u[2] * v[0],
                u[1] * v[2] + u[2] * v[1],
            ]) * weight;
            self.matrix += row * row.transpose();
            self.right += row * (moment * weight);
        }
    }

    /// The normal, on either side; `None` where the ellipses do not make a flat disc.
    fn normal(&self, rays: &[Vector3<f64>]) -> Option<Vector3<f64>> {
        /// Two rays leave one of the six numbers free.
        const LEAST_RAYS: usize = 3;
        /// Of the three eigenvalues of a disc two are alike and one is nought; so far off they may be.
        const LARGEST_THICKNESS: f64 = 0.3;
        const LEAST_ROUNDNESS: f64 = 0.5;
        if rays.len() < LEAST_RAYS {
            return None;
        }
        let s = self.matrix.cholesky()?.solve(&self.right);
        let shape = Matrix3::new(s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2]);
        let disc = shape.symmetric_eigen();
        let (least, most) = (disc.eigenvalues.imin(), disc.eigenvalues.imax());
        let middle = disc.eigenvalues.sum() - disc.eigenvalues[least] - disc.eigenvalues[most];
        let largest = disc.eigenvalues[most];
        let flat = disc.eigenvalues[least].abs() < LARGEST_THICKNESS * largest;
        if !(flat && middle > LEAST_ROUNDNESS * largest) {
            return None;
        }
        Some(disc.eigenvectors.column(least).into())
    }
}

/// A normal on the side of the rays.
fn on_their_side(normal: Vector3<f64>, rays: &[Vector3<f64>]) -> Vector3<f64> {
    let side: Vector3<f64> = rays.iter().sum();
    if normal.dot(&side) < 0.0 {
        -normal
    } else {
        normal
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(normal: Option<Vector3<f64>>, rays: &[Vector3<f64>]) -> Directions {
        let seen = Seen {
            rays: rays.iter().map(Vector3::normalize).collect(),
            normal,
        };
        Directions {
            seen: BTreeMap::from([(PointId::Target(1), seen)]),
            limit_deg: 65.0,
        }
    }

    fn at(angle_deg: f64) -> Vector3<f64> {
        let angle = angle_deg.to_radians();
        Vector3::new(angle.sin(), 0.0, angle.cos())
    }

    #[test]
    fn a_target_faces_what_is_within_the_limit_and_near_a_ray() {
        let directions = seen(Some(Vector3::z()), &[at(50.0), at(-10.0)]);
        let facing = |angle: f64| {
            let aspect = directions.aspect(PointId::Target(1), &(at(angle) * 700.0));
            aspect.map(|aspect| aspect.facing)
        };
        assert_eq!(facing(60.0), Some(Facing::Towards));
        assert_eq!(facing(70.0), Some(Facing::Unknown), "too oblique");
        assert_eq!(
            facing(-55.0),
            Some(Facing::Unknown),
            "never seen from there"
        );
        assert_eq!(facing(-44.0), Some(Facing::Towards), "seen squarely");
        assert!(directions.aspect(PointId::Target(2), &at(0.0)).is_none());
        let without = seen(None, &[at(0.0)]);
        let aspect = without.aspect(PointId::Target(1), &at(20.0)).unwrap();
        assert_eq!(aspect.facing, Facing::Towards);
        assert!((aspect.nearest_deg - 20.0).abs() < 1e-9);
    }

    #[test]
    fn the_limit_is_what_the_network_shows() {
        let many: Vec<Vector3<f64>> = (0..700).map(|n| at(f64::from(n) * 0.1)).collect();
        let seen = |rays: &[Vector3<f64>]| Seen {
            rays: rays.to_vec(),
            normal: Some(Vector3::z()),
        };
        let oblique = limit([seen(&many)].iter());
        assert!((oblique - 69.8).abs() < 0.01, "{oblique}");
        assert_eq!(limit([seen(&many[..100])].iter()), LEAST_LIMIT_DEG);
        assert_eq!(limit([].iter()), LEAST_LIMIT_DEG);
    }
}
