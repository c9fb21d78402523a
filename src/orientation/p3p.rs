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
    let units = rays.map(|r| r.normalize());
    let [p1, p2, p3] = points;
    let sides2 = [
        (p2 - p3).norm_squared(),
        (p1 - p3).norm_squared(),
        (p1 - p2).norm_squared(),
    ];
    let cosines = [
        units[1].dot(&units[2]),
        units[0].dot(&units[2]),
        units[0].dot(&units[1]),
    ];
    let Some(object) = triangle_frame(points) else {
        return Vec::new();
    };
    let rays_apart = (0..3).all(|k| units[k].cross(&units[(k + 1) % 3]).norm() > DEGENERATE_SINE);
    if !rays_apart {
        return Vec::new();
    }
    let mut poses = Vec::new();
    for distances in distances(&sides2, &cosines) {
        let in_camera = [0, 1, 2].map(|k| units[k] * distances[k]);
        let Some(camera) = triangle_frame(&in_camera) else {
            continue;
        };
        let rotation = Rotation3::from_matrix_unchecked(camera * object.transpose());
        let centroid = (p1 + p2 + p3) / 3.0;
        let seen = (in_camera[0] + in_camera[1] + in_camera[2]) / 3.0;
        poses.push(Pose {
            camera_from_world: rotation,
            centre_in_world: centroid - rotation.inverse() * seen,
        });
    }
    poses
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

/// The distances (s1, s2, s3) > 0 with `s2^2 + s3^2 - 2 s2 s3 cos a = a^2` and so on round the triangle.
fn distances(sides2: &[f64; 3], cosines: &[f64; 3]) -> Vec<[f64; 3]> {
    let [a2, b2, c2] = *sides2;
    let [ca, cb, cc] = *cosines;
    let (p, q, r) = ((a2 - c2) / b2, (a2 + c2) / b2, c2 / b2);
    let s = a2 / b2;
    let quartic = [
        (1.0 + p).powi(2) - 4.0 * s * cc * cc,
        4.0 * (-p * (1.0 + p) * cb + 2.0 * s * cc * cc * cb - (1.0 - q) * ca * cc),
        2.0 * (p * p - 1.0 + 2.0 * p * p * cb * cb + 2.0 * (1.0 - r) * ca * ca
            - 4.0 * q * ca * cb * cc
            + 2.0 * (1.0 - s) * cc * cc),
        4.0 * (p * (1.0 - p) * cb - (1.0 - q) * ca * cc + 2.0 * r * ca * ca * cb),
        (p - 1.0).powi(2) - 4.0 * r * ca * ca,
    ];
    let mut solutions: Vec<[f64; 3]> = Vec::new();
    // A ratio of distances beyond 1e4 is no measurement.
    for v in real_roots(&quartic, 1e-4, 1e4) {
        let s1 = (b2 / (1.0 + v * v - 2.0 * v * cb)).sqrt();
        for u in ratios(v, s1, p, c2, cosines) {
            let Some(polished) = polish([s1, u * s1, v * s1], sides2, cosines) else {
                continue;
            };
            let known = |s: &[f64; 3]| (0..3).all(|k| (s[k] - polished[k]).abs() < 1e-7 * s[k]);
            if !solutions.iter().any(known) {
                solutions.push(polished);
            }
        }
    }
    solutions
}

/// The ratio `s2 / s1` that belongs to `v = s3 / s1`: from the linear equation of the elimination, or, where that is
/// singular, both from the cosine law.
fn ratios(v: f64, s1: f64, p: f64, c2: f64, cosines: &[f64; 3]) -> Vec<f64> {
    let [ca, cb, cc] = *cosines;
    let divisor = 2.0 * (cc - v * ca);
    if divisor.abs() > 1e-6 {
        return vec![((p - 1.0) * v * v - 2.0 * p * cb * v + 1.0 + p) / divisor];
    }
    let root = (cc * cc - 1.0 + c2 / (s1 * s1)).max(0.0).sqrt();
    vec![cc + root, cc - root]
}

/// Newton's method on the three cosine laws; `None` where it does not end at positive distances that fulfil them.
fn polish(start: [f64; 3], sides2: &[f64; 3], cosines: &[f64; 3]) -> Option<[f64; 3]> {
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
