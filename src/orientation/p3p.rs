//! Resection from three points.

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::geometry::{Pose, real_roots};

/// The triangle's sine below which its three points count as lying on one line, and rays as being one.
const DEGENERATE_SINE: f64 = 1e-9;

/// Up to four poses from which three object points are seen along three rays (camera frame, any length, all in front).
///
/// The distances solve three cosine laws; Grunert's (1841) elimination in the form of Haralick et al. (1994, eq. 9)
/// gives a quartic in the ratio of two of them. Each root is polished by Newton's method on the cosine laws themselves,
/// so the poses are as exact as the rays even near double roots. Degenerate triples give no pose.
#[must_use]
pub fn three_point_poses(rays: &[Vector3<f64>; 3], points: &[Vector3<f64>; 3]) -> Vec<Pose> {
    let Some(triangle) = Triangle::seen(rays, points) else {
        return Vec::new();
    };
    let laws = &triangle.laws;
    triangle.poses(&laws.distances(&laws.ratios()))
}

/// [`three_point_poses`], and the pose at which two of them would meet where noise has left neither.
///
/// Near the danger cylinder of the points (Thompson, 1966) two of the poses are almost one. Noise may lift that double root of
/// the quartic off its axis, and the station is lost; the real part of the conjugate roots marks it still. Such a pose
/// does not quite fit its three points: it is a start for a fit, which also tells whether it was noise.
pub(super) fn three_point_starts(
    rays: &[Vector3<f64>; 3],
    points: &[Vector3<f64>; 3],
) -> Vec<Pose> {
    let Some(triangle) = Triangle::seen(rays, points) else {
        return Vec::new();
    };
    let laws = &triangle.laws;
    let ratios = laws.ratios();
    let mut distances = laws.distances(&ratios);
    distances.extend(laws.lifted_distances(&ratios));
    triangle.poses(&distances)
}

/// Three points and the rays along which they are seen.
struct Triangle<'a> {
    points: &'a [Vector3<f64>; 3],
    /// The points' frame.
    object: Matrix3<f64>,
    /// Rays of length one.
    units: [Vector3<f64>; 3],
    laws: CosineLaws,
}

impl<'a> Triangle<'a> {
    /// `None` for points in a line or rays that are one.
    fn seen(rays: &[Vector3<f64>; 3], points: &'a [Vector3<f64>; 3]) -> Option<Self> {
        let units = rays.map(|r| r.normalize());
        let rays_apart =
            (0..3).all(|k| units[k].cross(&units[(k + 1) % 3]).norm() > DEGENERATE_SINE);
        let [p1, p2, p3] = points;
        let laws = CosineLaws {
            sides2: [
                (p2 - p3).norm_squared(),
                (p1 - p3).norm_squared(),
                (p1 - p2).norm_squared(),
            ],
            cosines: [
                units[1].dot(&units[2]),
                units[0].dot(&units[2]),
                units[0].dot(&units[1]),
            ],
        };
        let object = triangle_frame(points)?;
        rays_apart.then_some(Self {
            points,
            object,
            units,
            laws,
        })
    }

    /// The poses at these distances.
    fn poses(&self, distances: &[[f64; 3]]) -> Vec<Pose> {
        let pose = |distances: &[f64; 3]| {
            let in_camera = [0, 1, 2].map(|k| self.units[k] * distances[k]);
            let camera = triangle_frame(&in_camera)?;
            let rotation = Rotation3::from_matrix_unchecked(camera * self.object.transpose());
            let centroid = self.points.iter().sum::<Vector3<f64>>() / 3.0;
            let seen = in_camera.iter().sum::<Vector3<f64>>() / 3.0;
            Some(Pose {
                camera_from_world: rotation,
                centre_in_world: centroid - rotation.inverse() * seen,
            })
        };
        distances.iter().filter_map(pose).collect()
    }
}

/// The right-handed frame of a triangle, axes in columns; `None` for three points on a line.
fn triangle_frame(points: &[Vector3<f64>; 3]) -> Option<Matrix3<f64>> {
    let (u, v) = (points[1] - points[0], points[2] - points[0]);
    let normal = u.cross(&v);
    if !(normal.norm() > DEGENERATE_SINE * u.norm() * v.norm()) {
        return None;
    }
    let (x, z) = (u.normalize(), normal.normalize());
    Some(Matrix3::from_columns(&[x, z.cross(&x), z]))
}

/// A ratio of distances beyond this is no measurement.
const LARGEST_RATIO: f64 = 1e4;

/// `s2^2 + s3^2 - 2 s2 s3 cos a = a^2` and so on round the triangle, for the distances (s1, s2, s3) > 0.
struct CosineLaws {
    sides2: [f64; 3],
    cosines: [f64; 3],
}

impl CosineLaws {
    /// The real roots of the quartic: the ratios `s3 / s1`.
    fn ratios(&self) -> Vec<f64> {
        real_roots(&self.quartic(), 1.0 / LARGEST_RATIO, LARGEST_RATIO)
    }

    /// The distances that fulfil all three laws.
    fn distances(&self, ratios: &[f64]) -> Vec<[f64; 3]> {
        let mut solutions: Vec<[f64; 3]> = Vec::new();
        for start in ratios.iter().flat_map(|v| self.distances_at(*v)) {
            let Some(polished) = self.polish(start) else {
                continue;
            };
            let known = |s: &[f64; 3]| (0..3).all(|k| (s[k] - polished[k]).abs() < 1e-7 * s[k]);
            if !solutions.iter().any(known) {
                solutions.push(polished);
            }
        }
        solutions
    }

    /// The distances at the real part of two conjugate roots beside two real ones: the sum of all four is `-a3 / a4`, their
    /// product `a0 / a4`.
    fn lifted_distances(&self, ratios: &[f64]) -> Vec<[f64; 3]> {
        let [a, b] = ratios else { return Vec::new() };
        let [a0, _, _, a3, a4] = self.quartic();
        let real_part = -0.5 * (a3 / a4 + a + b);
        let squared_size = a0 / (a4 * a * b);
        if !(real_part > 0.0 && squared_size > real_part * real_part) {
            return Vec::new();
        }
        let mut distances = self.distances_at(real_part);
        distances.retain(|s| s.iter().all(|x| *x > 0.0));
        distances
    }

    /// The quartic of Haralick et al. (1994, eq. 9) in `v = s3 / s1`, the constant first.
    fn quartic(&self) -> [f64; 5] {
        let [a2, b2, c2] = self.sides2;
        let [ca, cb, cc] = self.cosines;
        let (p, q, r) = ((a2 - c2) / b2, (a2 + c2) / b2, c2 / b2);
        let s = a2 / b2;
        [
            (1.0 + p).powi(2) - 4.0 * s * cc * cc,
            4.0 * (-p * (1.0 + p) * cb + 2.0 * s * cc * cc * cb - (1.0 - q) * ca * cc),
            2.0 * (p * p - 1.0 + 2.0 * p * p * cb * cb + 2.0 * (1.0 - r) * ca * ca
                - 4.0 * q * ca * cb * cc
                + 2.0 * (1.0 - s) * cc * cc),
            4.0 * (p * (1.0 - p) * cb - (1.0 - q) * ca * cc + 2.0 * r * ca * ca * cb),
            (p - 1.0).powi(2) - 4.0 * r * ca * ca,
        ]
    }

    /// The distances that belong to `v = s3 / s1`: `u = s2 / s1` from the linear equation of the elimination, or, where that is
    /// singular, both from the cosine law.
    fn distances_at(&self, v: f64) -> Vec<[f64; 3]> {
        let [a2, b2, c2] = self.sides2;
        let [ca, cb, cc] = self.cosines;
        let p = (a2 - c2) / b2;
        let s1 = (b2 / (1.0 + v * v - 2.0 * v * cb)).sqrt();
        let with = |u: f64| [s1, u * s1, v * s1];
        let divisor = 2.0 * (cc - v * ca);
        if divisor.abs() > 1e-6 {
            return vec![with(
                ((p - 1.0) * v * v - 2.0 * p * cb * v + 1.0 + p) / divisor,
            )];
        }
        let root = (cc * cc - 1.0 + c2 / (s1 * s1)).max(0.0).sqrt();
        vec![with(cc + root), with(cc - root)]
    }

    /// Newton's method on the three laws; `None` where it does not end at positive distances that fulfil them.
    fn polish(&self, start: [f64; 3]) -> Option<[f64; 3]> {
        let Self { sides2, cosines } = self;
        let scale = sides2[0] + sides2[1] + sides2[2];
        let mut s = Vector3::from(start);
        let law = |s: &Vector3<f64>| {
            Vector3::from_fn(|k, _| {
                let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                s[i] * s[i] + s[j] * s[j] - 2.0 * s[i] * s[j] * cosines[k] - sides2[k]
            })
        };
        for _ in 0..6 {
            let mut jacobian = Matrix3::zeros();
            for k in 0..3 {
                let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                jacobian[(k, i)] = 2.0 * (s[i] - s[j] * cosines[k]);
                jacobian[(k, j)] = 2.0 * (s[j] - s[i] * cosines[k]);
            }
            let Some(inverse) = jacobian.try_inverse() else {
                break;
            };
            let step = inverse * law(&s);
            s -= step;
            if !(step.norm() > 1e-13 * s.norm()) {
                break;
            }
        }
        // A root of the quartic that is none of the laws (or a double root split by noise) misses them by more.
        let solved = law(&s).norm() < 1e-6 * scale && s.iter().all(|x| *x > 0.0);
        solved.then(|| [s.x, s.y, s.z])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::simulation::{self, Noise};
    use nalgebra::Vector2;

    #[test]
    fn the_true_pose_is_among_the_solutions() {
        let camera = simulation::camera();
        let (mut misses, mut loose) = (0, 0);
        for seed in 0..2000 {
            let scene = simulation::scene(&camera, 3, Noise(0.0), seed);
            let points = [0, 1, 2].map(|k: usize| scene.observations[k].point);
            let rays = [0, 1, 2].map(|k: usize| camera.ray(&scene.observations[k].pixel));
            let poses = three_point_poses(&rays, &points);
            assert!(poses.len() <= 4);
            for pose in &poses {
                for (ray, point) in rays.iter().zip(&points) {
                    let seen = pose.camera_from_point(point).normalize();
                    assert!((seen - ray.normalize()).norm() < 1e-5);
                }
            }
            let error = poses
                .iter()
                .map(|p| (p.centre_in_world - scene.pose.centre_in_world).norm())
                .fold(f64::INFINITY, f64::min);
            misses += usize::from(error > 1.0);
            loose += usize::from(error > 1e-6);
        }
        // Stations on the danger cylinder have a double root, which rounding may lift off the axis.
        assert!(misses <= 2, "{misses}");
        assert!(loose <= 20, "{loose}");
    }

    #[test]
    fn degenerate_triples_give_no_pose_and_no_panic() {
        let x = Vector3::x();
        let ray = |x: f64, y: f64| Vector2::new(x, y).push(-20.0);
        let rays = [ray(0.0, 0.0), ray(1.0, 0.0), ray(0.0, 1.0)];
        assert!(three_point_poses(&rays, &[x, x * 2.0, x * 3.0]).is_empty());
        assert!(three_point_poses(&rays, &[x, x, x]).is_empty());
        assert!(three_point_poses(&[rays[0]; 3], &[x, Vector3::y(), Vector3::z()]).is_empty());
        assert!(three_point_poses(&rays, &[x * f64::NAN, x, Vector3::y()]).is_empty());
        assert!(
            three_point_poses(&[Vector3::zeros(); 3], &[x, Vector3::y(), Vector3::z()]).is_empty()
        );
    }
}
