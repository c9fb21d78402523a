//! Resection from points without gross errors: every pose that they leave, the likeliest first.

use nalgebra::{Matrix6, Vector2, Vector3, Vector6};

use super::p3p::three_point_starts;
use super::refine::{PoseObservation, turn_between};
use crate::camera::Camera;
use crate::geometry::{Pose, rotation_from_vector};

/// Three points are fitted without residuals, or noise has lifted a double solution off them: by more than this many
/// standard errors once in three million times.
const LIFTED_SIGMAS: f64 = 5.0;

/// Starts nearer to each other than this (radians, and shares of the distance) end at the same pose, which is fitted once.
const SAME_START: f64 = 0.005;

/// Starts that are fitted at most, the best ones: of 1.4 million simulated sets of 4 to 12 points (noise of 0.04 and 1 px) none
/// had its best pose elsewhere.
const FITS: usize = 6;

/// Residuals of less than a millionth of their standard errors are rounding; this is the square.
const ROUNDING: f64 = 1e-12;

/// Fitted poses nearer to each other than this (radians, and shares of the distance) are one pose.
const SAME_POSE: f64 = 1e-5;

/// Steps of a fit at most; from the pose of a good triple three or four are needed, where two solutions nearly meet dozens.
const STEPS: usize = 100;

/// A step smaller than this (radians, and shares of the distance) is the last one: the next would be its square.
const LAST_STEP: f64 = 1e-7;

/// Damping, where there is any, in units of the normal equations' diagonal: less does nothing, more leaves no step.
const LEAST_DAMPING: f64 = 1e-6;
const MOST_DAMPING: f64 = 1e8;

/// A fit whose sum of squares is so many times the best pose's, and does not halve with a step, is given up: its residuals would
/// be ten times as large.
const HOPELESS: f64 = 100.0;

/// A pose fitted to points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedPose {
    /// The pose.
    pub pose: Pose,
    /// Sum of the squared residuals over their standard errors: of the order of the redundancy 2n - 6 where the pose is
    /// right. The likelihood of the pose is exp(-half of it).
    pub weighted_squares: f64,
}

/// All distinct poses from which three or more points are seen where they were measured, the best fit first; none for
/// fewer than three points, or points in a line.
///
/// Three points leave up to four poses without residuals, in the order of [`super::three_point_poses`]; where noise has lifted a
/// double one off the points, the pose that misses them least comes last. Of more points four are chosen that lie far
/// apart, and the poses of their four triples are fitted to all points by least squares: no starting value is needed, and
/// flat sets give both of their poses. Poses with ten times the residuals of the best are not pursued. Residuals are taken
/// in the ideal image, since the lens's correction does not change over their length.
///
/// One gross error spoils the result: see [`super::resect_by_consensus`].
#[must_use]
pub fn resect_from_points(camera: &Camera, observations: &[PoseObservation]) -> Vec<FittedPose> {
    let sights: Vec<Sight> = observations.iter().map(|o| Sight::of(camera, o)).collect();
    let mut poses: Vec<FittedPose> = Vec::new();
    let expected = 2.0 * sights.len() as f64;
    let mut best = f64::INFINITY;
    for start in starts(&sights) {
        let Some(fitted) = fit(&sights, start, HOPELESS * best.max(expected)) else {
            continue;
        };
        best = best.min(fitted.weighted_squares);
        let known = |p: &FittedPose| nearer(&p.pose, &fitted.pose, &sights, SAME_POSE);
        if !poses.iter().any(known) {
            poses.push(fitted);
        }
    }
    if sights.len() == 3 {
        poses.retain(|p| p.weighted_squares <= LIFTED_SIGMAS * LIFTED_SIGMAS);
    }
    poses.sort_by(|a, b| a.weighted_squares.total_cmp(&b.weighted_squares));
    poses
}

/// An object point and the direction in which it was seen.
#[derive(Clone, Copy)]
struct Sight {
    point: Vector3<f64>,
    /// Tangents of the ray: x' / c and y' / c.
    tangents: Vector2<f64>,
    /// One over the standard error of a tangent.
    weight: f64,
}

impl Sight {
    fn of(camera: &Camera, observation: &PoseObservation) -> Self {
        let c = camera.interior.principal_distance;
        Self {
            point: observation.point,
            tangents: camera.ideal_from_pixel(&observation.pixel) / c,
            weight: c / (camera.pixel_pitch_mm * observation.sigma_px),
        }
    }

    fn ray(&self) -> Vector3<f64> {
        Vector3::new(self.tangents.x, self.tangents.y, -1.0)
    }
}

/// Poses to start from, clearly different ones, the best first.
fn starts(sights: &[Sight]) -> Vec<FittedPose> {
    let chosen = far_apart(sights);
    let mut all: Vec<FittedPose> = Vec::new();
    for left_out in 0..4 {
        let kept: Vec<&Sight> = (0..chosen.len())
            .filter(|&k| k != left_out)
            .map(|k| &sights[chosen[k]])
            .collect();
        let Ok(triple) = <[&Sight; 3]>::try_from(kept) else {
            continue;
        };
        let poses = three_point_starts(&triple.map(Sight::ray), &triple.map(|s| s.point));
        all.extend(poses.into_iter().filter_map(|pose| {
            let weighted_squares = weighted_squares(sights, &pose)?;
            Some(FittedPose {
                pose,
                weighted_squares,
            })
        }));
    }
    if sights.len() == 3 {
        return all;
    }
    all.sort_by(|a, b| a.weighted_squares.total_cmp(&b.weighted_squares));
    let mut different: Vec<FittedPose> = Vec::new();
    for start in all {
        let known = |s: &FittedPose| nearer(&s.pose, &start.pose, sights, SAME_START);
        if different.len() < FITS && !different.iter().any(known) {
            different.push(start);
        }
    }
    different
}

/// Four points (all, where there are fewer) whose triples are as wide as can be: the farthest from the centroid, the farthest from
/// that, then those whose smallest triangle with two chosen ones is the largest.
fn far_apart(sights: &[Sight]) -> Vec<usize> {
    if sights.len() <= 4 {
        return (0..sights.len()).collect();
    }
    let centroid = sights.iter().map(|s| s.point).sum::<Vector3<f64>>() / sights.len() as f64;
    let largest = |measure: &dyn Fn(&Vector3<f64>) -> f64| {
        let measures = sights.iter().map(|s| measure(&s.point)).enumerate();
        measures.fold((0, f64::NEG_INFINITY), |best, now| {
            if now.1 > best.1 { now } else { best }
        })
    };
    let first = sights[largest(&|p| (p - centroid).norm_squared()).0].point;
    let mut chosen = vec![largest(&|p| (p - centroid).norm_squared()).0];
    chosen.push(largest(&|p| (p - first).norm_squared()).0);
    while chosen.len() < 4 {
        let smallest_triangle = |p: &Vector3<f64>| {
            let mut smallest = f64::INFINITY;
            for (k, &a) in chosen.iter().enumerate() {
                for &b in &chosen[..k] {
                    let (a, b) = (sights[a].point, sights[b].point);
                    smallest = smallest.min((p - a).cross(&(p - b)).norm_squared());
                }
            }
            smallest
        };
        chosen.push(largest(&smallest_triangle).0);
    }
    chosen
}

/// Whether two poses differ by less than `limit`, radians and shares of the distance from the points.
fn nearer(a: &Pose, b: &Pose, sights: &[Sight], limit: f64) -> bool {
    let distance = (a.centre_in_world - sights[0].point).norm();
    (a.centre_in_world - b.centre_in_world).norm() < limit * distance && turn_between(a, b) < limit
}

/// The point in the camera frame as tangents and depth; `None` behind the camera.
fn seen(pose: &Pose, point: &Vector3<f64>) -> Option<(Vector2<f64>, f64)> {
    let k = pose.camera_from_point(point);
    let depth = -k.z;
    (depth > 0.0).then(|| (Vector2::new(k.x, k.y) / depth, depth))
}

/// Sum of the squared residuals over their standard errors; `None` where a point is behind the camera.
fn weighted_squares(sights: &[Sight], pose: &Pose) -> Option<f64> {
    let mut sum = 0.0;
    for sight in sights {
        let (tangents, _) = seen(pose, &sight.point)?;
        sum += (tangents - sight.tangents).norm_squared() * sight.weight * sight.weight;
    }
    sum.is_finite().then_some(sum)
}

/// The pose of least squares next to a start: Gauss-Newton, damped after Levenberg and Marquardt where a step would not lower
/// the sum, as at a double solution, where the normal equations are singular.
fn fit(sights: &[Sight], start: FittedPose, hopeless: f64) -> Option<FittedPose> {
    if start.weighted_squares < ROUNDING {
        return Some(FittedPose {
            weighted_squares: 0.0,
            ..start
        });
    }
    let mut fitted = start;
    let mut damping = 0.0;
    for _ in 0..STEPS {
        let equations = NormalEquations::of(sights, &fitted.pose)?;
        let Some(next) = descend(sights, &equations, &fitted, &mut damping) else {
            break;
        };
        if next.weighted_squares > hopeless.max(0.5 * fitted.weighted_squares) {
            return None;
        }
        let last = nearer(&next.pose, &fitted.pose, sights, LAST_STEP);
        fitted = next;
        if last {
            break;
        }
    }
    Some(fitted)
}

/// The pose a step further, damped until the sum does not rise; `None` where no step is left.
fn descend(
    sights: &[Sight],
    equations: &NormalEquations,
    fitted: &FittedPose,
    damping: &mut f64,
) -> Option<FittedPose> {
    while *damping < MOST_DAMPING {
        if let Some(step) = equations.step(*damping) {
            let pose = equations.moved(&fitted.pose, &step);
            let now = weighted_squares(sights, &pose).filter(|&s| s <= fitted.weighted_squares);
            if let Some(weighted_squares) = now {
                *damping = if *damping > LEAST_DAMPING {
                    0.1 * *damping
                } else {
                    0.0
                };
                return Some(FittedPose {
                    pose,
                    weighted_squares,
                });
            }
            if step.norm() < LAST_STEP {
                return None;
            }
        }
        *damping = (10.0 * *damping).max(LEAST_DAMPING);
    }
    None
}

/// Normal equations of turn (radians, camera frame) and shift (camera frame, shares of the points' mean depth).
struct NormalEquations {
    /// The lower triangle is filled.
    normal: Matrix6<f64>,
    right: Vector6<f64>,
    mean_depth: f64,
}

impl NormalEquations {
    fn of(sights: &[Sight], pose: &Pose) -> Option<Self> {
        let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
        let to = sights.iter().map(|s| s.point).sum::<Vector3<f64>>() / sights.len() as f64;
        let (_, mean_depth) = seen(pose, &to)?;
        for sight in sights {
            let (t, depth) = seen(pose, &sight.point)?;
            let shift = mean_depth / depth;
            // k moves by w x k + s; with k = depth [t.x, t.y, -1] the tangents k.x / -k.z and k.y / -k.z move by:
            let by_x = [t.x * t.y, -1.0 - t.x * t.x, -t.y, shift, 0.0, shift * t.x];
            let by_y = [1.0 + t.y * t.y, -t.x * t.y, t.x, 0.0, shift, shift * t.y];
            let miss = sight.tangents - t;
            let weight = sight.weight * sight.weight;
            for i in 0..6 {
                right[i] += weight * (by_x[i] * miss.x + by_y[i] * miss.y);
                for j in 0..=i {
                    normal[(i, j)] += weight * (by_x[i] * by_x[j] + by_y[i] * by_y[j]);
                }
            }
        }
        Some(Self {
            normal,
            right,
            mean_depth,
        })
    }

    /// Solves `(N + damping diag N) x = r`.
    fn step(&self, damping: f64) -> Option<Vector6<f64>> {
        let mut damped = self.normal;
        for k in 0..6 {
            damped[(k, k)] *= 1.0 + damping;
        }
        let step = damped.cholesky()?.solve(&self.right);
        step.iter().all(|x| x.is_finite()).then_some(step)
    }

    fn moved(&self, pose: &Pose, step: &Vector6<f64>) -> Pose {
        let turn = rotation_from_vector(&step.fixed_rows::<3>(0).into_owned());
        let shift = step.fixed_rows::<3>(3) * self.mean_depth;
        let camera_from_world = turn * pose.camera_from_world;
        Pose {
            camera_from_world,
            centre_in_world: pose.centre_in_world - camera_from_world.inverse() * shift,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::simulation::{self, Noise};
    use crate::orientation::{
        IdealPoint, RefineSettings, plane_poses, refine_pose, three_point_poses,
    };

    fn station_error(fitted: &FittedPose, truth: &Pose) -> f64 {
        (fitted.pose.centre_in_world - truth.centre_in_world).norm()
    }

    #[test]
    fn no_pose_fits_better_than_the_first() {
        let camera = simulation::camera();
        for count in 4..9 {
            for seed in 0..100 {
                let scene = simulation::scene(&camera, count, Noise(0.05), seed);
                let found = resect_from_points(&camera, &scene.observations);
                let settings = RefineSettings::default();
                let truth =
                    refine_pose(&camera, &scene.observations, &scene.pose, &settings).unwrap();
                let squares = truth.rms_px.powi(2) * (2 * count) as f64 / 0.05_f64.powi(2);
                assert!(found[0].weighted_squares < squares + 1e-6, "{count} {seed}");
                assert!(
                    station_error(&found[0], &truth.pose) < 1e-3,
                    "{count} {seed}"
                );
            }
        }
    }

    #[test]
    fn a_bent_lens_changes_little() {
        let camera = simulation::distorted_camera();
        for seed in 0..50 {
            let scene = simulation::scene(&camera, 8, Noise(0.05), seed);
            let found = resect_from_points(&camera, &scene.observations);
            assert!(station_error(&found[0], &scene.pose) < 2.0, "{seed}");
        }
    }

    /// A plane of 60 mm at 1 m, where the tilt's sign hangs on the noise.
    const SMALL_PLANE: [[f64; 3]; 5] = [
        [30.0, 0.0, 0.0],
        [-30.0, 0.0, 0.0],
        [0.0, 30.0, 0.0],
        [0.0, -30.0, 0.0],
        [15.0, 15.0, 0.0],
    ];

    #[test]
    fn both_poses_of_a_far_plane_are_found() {
        let camera = simulation::camera();
        let mut two = 0;
        for seed in 0..100 {
            let pose = simulation::station(seed);
            let points = simulation::ideal_points(&SMALL_PLANE, &pose, Noise(0.5), seed);
            let observe = |p: &IdealPoint| PoseObservation {
                pixel: camera.pixel_from_ideal(&p.ideal).unwrap(),
                point: p.point,
                sigma_px: 0.5,
            };
            let observations: Vec<PoseObservation> = points.iter().map(observe).collect();
            let found = resect_from_points(&camera, &observations);
            let known = plane_poses(&points, 20.0).unwrap()[0];
            let squares = 10.0 * (known.rms_mm / (0.5 * 0.009)).powi(2);
            assert!(found[0].weighted_squares < squares + 1e-3, "{seed}");
            two += usize::from(found.len() == 2);
        }
        // Seen from the front both are one.
        assert!(two > 70, "{two}");
    }

    #[test]
    fn a_double_solution_that_noise_lifted_is_kept() {
        let camera = simulation::camera();
        let points = [0.0_f64, 2.0, 4.3]
            .map(|angle| Vector3::new(200.0 * angle.cos(), 200.0 * angle.sin(), 0.0));
        let (mut lost, mut lost_by_roots) = (0, 0);
        for seed in 0..200 {
            // On the danger cylinder: above the circle through the points.
            let mut rng = simulation::random(seed);
            let angle = std::f64::consts::PI * simulation::vector(&mut rng, 1.0).x;
            let centre = Vector3::new(200.0 * angle.cos(), 200.0 * angle.sin(), 1000.0);
            let pose = Pose::looking_at(centre, Vector3::zeros(), Vector3::y(), 0.3);
            let observations = points.map(|point| {
                let noise =
                    Vector2::new(simulation::normal(&mut rng), simulation::normal(&mut rng));
                PoseObservation {
                    pixel: camera.project(&pose.camera_from_point(&point)).unwrap() + 0.04 * noise,
                    point,
                    sigma_px: 0.04,
                }
            });
            let far = |p: &Pose| (p.centre_in_world - centre).norm() > 40.0;
            let found = resect_from_points(&camera, &observations);
            lost += usize::from(found.iter().all(|f| far(&f.pose)));
            let roots = three_point_poses(&observations.map(|o| camera.ray(&o.pixel)), &points);
            lost_by_roots += usize::from(roots.iter().all(far));
        }
        assert!(lost_by_roots > 60, "{lost_by_roots}");
        assert!(lost <= 4, "{lost}");
    }

    #[test]
    fn three_exact_points_give_the_poses_of_their_triangle() {
        let camera = simulation::camera();
        for seed in 0..50 {
            let scene = simulation::scene(&camera, 3, Noise(0.0), seed);
            let rays = [0, 1, 2].map(|k: usize| camera.ray(&scene.observations[k].pixel));
            let points = [0, 1, 2].map(|k: usize| scene.observations[k].point);
            let poses = three_point_poses(&rays, &points);
            let found = resect_from_points(&camera, &scene.observations);
            for (pose, fitted) in poses.iter().zip(&found) {
                assert!(turn_between(pose, &fitted.pose) < 1e-6, "{seed}");
                assert!(fitted.weighted_squares < 1e-9, "{seed}");
            }
            assert!(found.len() >= poses.len());
        }
    }

    #[test]
    fn degenerate_points_give_no_pose() {
        let camera = simulation::camera();
        let scene = simulation::scene(&camera, 6, Noise(0.1), 1);
        let given = scene.observations;
        assert!(resect_from_points(&camera, &[]).is_empty());
        assert!(resect_from_points(&camera, &given[..2]).is_empty());
        assert!(resect_from_points(&camera, &[given[0]; 5]).is_empty());
        let mut line = given.clone();
        for (k, o) in line.iter_mut().enumerate() {
            o.point = Vector3::x() * k as f64;
        }
        assert!(resect_from_points(&camera, &line).is_empty());
        let mut wrong = given.clone();
        wrong[2].pixel.x = f64::NAN;
        assert!(resect_from_points(&camera, &wrong).is_empty());
    }
}
