//! Relative orientation of simulated pairs of images.

use super::*;
use crate::orientation::simulation;

/// A second camera 1 from the first, both looking at (0, 0, -2).
pub(in crate::orientation) fn stereo(seed: u64) -> Pose {
    let mut rng = simulation::random(seed ^ 0x57e);
    let azimuth = rng.random_range(0.0..std::f64::consts::TAU);
    let back = rng.random_range(-0.3..0.5);
    let base = Vector3::new(azimuth.cos(), azimuth.sin(), back).normalize();
    let target = Vector3::new(0.0, 0.0, -2.0) + simulation::vector(&mut rng, 0.05);
    Pose::looking_at(base, target, Vector3::y(), rng.random_range(-3.0..3.0))
}

pub(in crate::orientation) fn pairs_of(pose: &Pose, points: &[Vector3<f64>]) -> Vec<RayPair> {
    points
        .iter()
        .map(|p| RayPair {
            first: *p,
            second: pose.camera_from_point(p),
        })
        .collect()
}

pub(in crate::orientation) fn flat_points(count: usize, seed: u64) -> Vec<Vector3<f64>> {
    let mut rng = simulation::random(seed ^ 0xf1a7);
    let tilt = rng.random_range(-0.5..0.5);
    let mut point = || {
        let (x, y) = (rng.random_range(-0.5..0.5), rng.random_range(-0.4..0.4));
        Vector3::new(x, y, -2.0 + tilt * x + 0.2 * y)
    };
    (0..count).map(|_| point()).collect()
}

fn pixels(
    pose: &Pose,
    points: &[Vector3<f64>],
    noise: f64,
    wrong: usize,
    seed: u64,
) -> Vec<PixelPair> {
    let camera = simulation::camera();
    let mut rng = simulation::random(seed ^ 0x91e5);
    let mut pairs = Vec::new();
    for point in points {
        let image = |k: Vector3<f64>| {
            let ideal = k.xy() * (-20.0 / k.z);
            camera.pixel_from_ideal(&ideal).unwrap_or_default()
        };
        let mut error =
            || noise * Vector2::new(simulation::normal(&mut rng), simulation::normal(&mut rng));
        let (e1, e2) = (error(), error());
        pairs.push(PixelPair {
            first: image(*point) + e1,
            second: image(pose.camera_from_point(point)) + e2,
        });
    }
    for pair in &mut pairs[..wrong] {
        pair.second = Vector2::new(rng.random_range(0.0..3072.0), rng.random_range(0.0..2048.0));
    }
    pairs
}

fn solve(pairs: &[PixelPair]) -> Result<RelativeOrientation, RelativeError> {
    let camera = simulation::camera();
    relative_orientation([&camera, &camera], pairs, &RelativeSettings::default())
}

fn error(found: &RelativePose, truth: &Pose) -> f64 {
    turn_between(&found.second, truth)
        + (found.second.centre_in_world - truth.centre_in_world).norm()
}

#[test]
fn spatial_points_with_a_fifth_wrong_give_the_pose() {
    let mut errors = Vec::new();
    for seed in 0..20 {
        let pose = stereo(seed);
        let mut rng = simulation::random(seed);
        let points: Vec<Vector3<f64>> = (0..30)
            .map(|_| simulation::vector(&mut rng, 0.35) - Vector3::z() * 2.0)
            .collect();
        let found = solve(&pixels(&pose, &points, 0.1, 6, seed)).unwrap();
        errors.push(error(&found.best, &pose));
        assert!(found.best.inliers[6..].iter().all(|used| *used));
        assert!(found.best.inliers[..6].iter().filter(|used| **used).count() <= 1);
        assert!(found.best.rms_px < 0.2);
        let exact = solve(&pixels(&pose, &points, 0.0, 0, seed)).unwrap();
        assert!(error(&exact.best, &pose) < 1e-9);
    }
    errors.sort_by(f64::total_cmp);
    // 0.1 px are 4.5e-5 rad; in a field of 20 degrees turn and base are told apart some hundred times worse.
    assert!(errors[10] < 5e-3 && errors[19] < 0.05, "{errors:?}");
}

#[test]
fn of_flat_points_the_true_pose_is_one_of_those_told() {
    for seed in 0..30 {
        let pose = stereo(seed);
        let found = solve(&pixels(&pose, &flat_points(40, seed), 0.1, 8, seed)).unwrap();
        let other = found
            .alternative
            .as_ref()
            .map_or(f64::INFINITY, |a| error(a, &pose));
        let nearest = error(&found.best, &pose).min(other);
        assert!(nearest < 0.06, "{seed}: {nearest}");
    }
}

#[test]
fn no_base_chance_and_degenerate_pairs_are_errors() {
    let still = Pose::looking_at(
        Vector3::zeros(),
        Vector3::new(0.05, 0.02, -2.0),
        Vector3::y(),
        0.2,
    );
    let mut rng = simulation::random(8);
    let points: Vec<Vector3<f64>> = (0..20)
        .map(|_| simulation::vector(&mut rng, 0.3) - Vector3::z() * 2.0)
        .collect();
    assert!(solve(&pixels(&still, &points, 0.1, 0, 8)).is_err());
    let wrong = solve(&pixels(&stereo(1), &points, 0.1, 20, 8));
    assert!(wrong.is_err() || wrong.is_ok_and(|w| w.best.inlier_count <= 12));
    assert!(matches!(
        solve(&pixels(&stereo(1), &points[..4], 0.0, 0, 8)),
        Err(RelativeError::TooFewPairs {
            found: 4,
            needed: 8
        })
    ));
    assert!(
        solve(
            &[PixelPair {
                first: Vector2::zeros(),
                second: Vector2::zeros()
            }; 12]
        )
        .is_err()
    );
    assert!(
        solve(
            &[PixelPair {
                first: Vector2::repeat(f64::NAN),
                second: Vector2::zeros()
            }; 12]
        )
        .is_err()
    );
}
