//! Simulated truth for the tests of this folder.

use nalgebra::{Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{IdealPoint, PoseObservation};
use crate::camera::{Camera, InteriorOrientation};
use crate::geometry::Pose;

/// Standard error of a simulated pixel coordinate, px.
#[derive(Clone, Copy)]
pub(super) struct Noise(pub(super) f64);

pub(super) struct Scene {
    pub(super) pose: Pose,
    pub(super) observations: Vec<PoseObservation>,
}

pub(super) fn camera() -> Camera {
    Camera {
        width_px: 3072,
        height_px: 2048,
        pixel_pitch_mm: 0.009,
        interior: InteriorOrientation::pinhole(20.0),
    }
}

pub(super) fn distorted_camera() -> Camera {
    let mut camera = camera();
    camera.interior.radial = [1.5e-4, -4e-7, 0.0];
    camera.interior.principal_point = [0.1, -0.05];
    camera
}

pub(super) fn random(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// A normal deviate as the sum of twelve uniform ones.
pub(super) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}

pub(super) fn vector(rng: &mut ChaCha8Rng, range: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-range..range))
}

/// A station 0.7 to 1.5 m above the origin, up to 60 degrees from the z axis, any roll.
pub(super) fn station(seed: u64) -> Pose {
    let mut rng = random(seed ^ 0x5717);
    let tilt = rng.random_range(0.0..60_f64.to_radians());
    let azimuth = rng.random_range(0.0..std::f64::consts::TAU);
    let distance = rng.random_range(700.0..1500.0);
    let roll = rng.random_range(0.0..std::f64::consts::TAU);
    let direction = Vector3::new(
        tilt.sin() * azimuth.cos(),
        tilt.sin() * azimuth.sin(),
        tilt.cos(),
    );
    Pose::looking_at(
        direction * distance,
        vector(&mut rng, 40.0),
        Vector3::y(),
        roll,
    )
}

/// `count` points within a box of 400 mm as a station sees them.
pub(super) fn scene(camera: &Camera, count: usize, noise: Noise, seed: u64) -> Scene {
    let pose = station(seed);
    let mut rng = random(seed);
    let mut observations = Vec::new();
    while observations.len() < count {
        let point = vector(&mut rng, 200.0);
        let Some(pixel) = camera.project(&pose.camera_from_point(&point)) else {
            continue;
        };
        let pixel = pixel + noise.0 * Vector2::new(normal(&mut rng), normal(&mut rng));
        if camera.contains(&pixel) {
            observations.push(PoseObservation {
                pixel,
                point,
                sigma_px: noise.0.max(0.01),
            });
        }
    }
    Scene { pose, observations }
}

/// Six dots, X1 and X6 raised.
pub(super) const REFERENCE_CROSS: [[f64; 3]; 6] = [
    [0.0, 0.0, 40.0],
    [100.0, 0.0, 0.0],
    [-100.0, 0.0, 0.0],
    [0.0, 100.0, 0.0],
    [0.0, -100.0, 0.0],
    [50.0, 50.0, 25.0],
];

/// Ideal image points of `points`, with noise in pixels of 9 um.
pub(super) fn ideal_points(
    points: &[[f64; 3]],
    pose: &Pose,
    noise: Noise,
    seed: u64,
) -> Vec<IdealPoint> {
    let mut rng = random(seed ^ 0x1dea1);
    let image = |point: &[f64; 3]| {
        let point = Vector3::from(*point);
        let k = pose.camera_from_point(&point);
        let error = Vector2::new(normal(&mut rng), normal(&mut rng)) * noise.0 * 0.009;
        IdealPoint {
            point,
            ideal: Vector2::new(k.x, k.y) * (-20.0 / k.z) + error,
        }
    };
    points.iter().map(image).collect()
}
