//! Networks with known truth for the tests of this folder.

use std::collections::BTreeSet;

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::equations::State;
use super::{
    Adjustment, AdjustmentError, BundleProblem, BundleSettings, CameraBlock, Datum,
    DistanceObservation, ImageObservation, ParameterState, PointBlock, ResidualPlane, Sharing,
    StationBlock, adjust,
};
use crate::camera::InteriorOrientation;
use crate::camera::fixture::wide_angle_camera;
use crate::geometry::{Circle, Pose};
use crate::monitor::Monitor;

/// What to simulate.
#[derive(Clone, Copy)]
pub(super) struct Scene {
    pub(super) stations: usize,
    pub(super) points: usize,
    /// Standard deviation of the simulated noise and of the observations, px.
    pub(super) noise_px: f64,
    /// Disturbance of the start values: mm, mrad and, times 1e-3, part of c.
    pub(super) disturbance: f64,
    pub(super) interior: ParameterState,
    pub(super) seed: u64,
    /// Radius of the round targets of whose images the centres are measured, mm; 0 for points.
    pub(super) radius_mm: f64,
}

pub(super) struct Simulated {
    pub(super) truth: State,
    pub(super) problem: BundleProblem,
}

pub(super) struct Noise(ChaCha8Rng);

impl Noise {
    pub(super) fn seeded(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    pub(super) fn uniform(&mut self) -> f64 {
        self.0.random::<f64>()
    }

    /// Box and Muller (1958).
    pub(super) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    pub(super) fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }
}

/// A box of 400 x 400 x 200 mm with points on five sides, seen from stations around and above it, rolled in turn.
pub(super) fn box_network(scene: &Scene) -> Simulated {
    let mut noise = Noise::seeded(scene.seed);
    let points: Vec<Vector3<f64>> = (0..scene.points)
        .map(|i| box_point(i, &mut noise))
        .collect();
    let poses: Vec<Pose> = (0..scene.stations)
        .map(|i| {
            let azimuth = std::f64::consts::TAU * i as f64 / scene.stations as f64;
            let height = 500.0 + 500.0 * ((i * 7) % 5) as f64 / 5.0;
            let centre = Vector3::new(900.0 * azimuth.cos(), 900.0 * azimuth.sin(), height);
            let roll = std::f64::consts::FRAC_PI_2 * (i % 4) as f64;
            Pose::looking_at(centre, noise.vector() * 30.0, Vector3::z(), roll)
        })
        .collect();
    let camera = wide_angle_camera();
    let circles: Vec<Option<Circle>> = (0..scene.points)
        .map(|p| {
            let circle = Circle {
                normal: box_normal(p),
                radius_mm: scene.radius_mm,
            };
            (scene.radius_mm > 0.0).then_some(circle)
        })
        .collect();
    let mut observations = Vec::new();
    for (p, point) in points.iter().enumerate() {
        for (s, pose) in poses.iter().enumerate() {
            let seen = (pose.centre_in_world - point).dot(&box_normal(p)) > 0.0;
            if let Some(pixel) = camera.image_of_target(pose, point, circles[p].as_ref())
                && seen
                && camera.contains(&pixel)
            {
                let error = noise.vector() * scene.noise_px;
                observations.push(ImageObservation {
                    station: s,
                    point: p,
                    pixel: pixel + error.xy(),
                    sigma_px: if scene.noise_px > 0.0 {
                        scene.noise_px
                    } else {
                        0.05
                    },
                });
            }
        }
    }
    let truth = State {
        cameras: vec![camera.clone()],
        own_cameras: vec![None; poses.len()],
        poses,
        points,
        circles,
    };
    let problem = disturbed(&truth, observations, scene, &mut noise);
    Simulated { truth, problem }
}

fn disturbed(
    truth: &State,
    observations: Vec<ImageObservation>,
    scene: &Scene,
    noise: &mut Noise,
) -> BundleProblem {
    let size = scene.disturbance;
    let mut camera = truth.cameras[0].clone();
    if scene.interior != ParameterState::Fixed && size > 0.0 {
        camera.interior =
            InteriorOrientation::pinhole(camera.interior.principal_distance * (1.0 + 1e-3 * size));
    }
    BundleProblem {
        cameras: vec![CameraBlock {
            camera,
            parameters: [scene.interior; 10],
            sharing: [Sharing::Camera; 10],
        }],
        stations: truth
            .poses
            .iter()
            .map(|pose| StationBlock {
                camera: 0,
                pose: pose.moved(&(noise.vector() * 1e-3 * size), &(noise.vector() * size)),
            })
            .collect(),
        points: truth
            .points
            .iter()
            .map(|p| PointBlock::unknown(p + noise.vector() * size))
            .collect(),
        observations,
        distances: Vec::new(),
        residuals: ResidualPlane::Measured,
        datum: Datum::InnerConstraints {
            points: (0..truth.points.len()).collect(),
        },
        frame: None,
        rejected: BTreeSet::new(),
    }
}

fn box_normal(point: usize) -> Vector3<f64> {
    match point % 5 {
        0 => Vector3::z(),
        1 => Vector3::x(),
        2 => -Vector3::x(),
        3 => Vector3::y(),
        _ => -Vector3::y(),
    }
}

fn box_point(index: usize, noise: &mut Noise) -> Vector3<f64> {
    let normal = box_normal(index);
    let inside = Vector3::new(
        400.0 * (noise.uniform() - 0.5),
        400.0 * (noise.uniform() - 0.5),
        200.0 * (noise.uniform() - 0.5),
    );
    let half = Vector3::new(200.0, 200.0, 100.0);
    inside - normal * normal.dot(&inside) + normal.component_mul(&half).component_mul(&normal.abs())
}

pub(super) fn scene(seed: u64) -> Scene {
    Scene {
        stations: 12,
        points: 60,
        noise_px: 0.05,
        disturbance: 10.0,
        interior: ParameterState::Free,
        seed,
        radius_mm: 0.0,
    }
}

pub(super) fn toy(seed: u64) -> Simulated {
    box_network(&Scene {
        stations: 5,
        points: 15,
        disturbance: 1.0,
        ..scene(seed)
    })
}

/// Four stations that look straight down at a plane, seen without noise: principal distances and heights cannot be told apart.
pub(super) fn nadir_network() -> BundleProblem {
    let Simulated { truth, mut problem } = box_network(&Scene {
        noise_px: 0.0,
        disturbance: 0.0,
        ..scene(9)
    });
    let camera = truth.cameras[0].clone();
    problem.cameras[0].parameters = std::array::from_fn(|p| {
        if p == 0 {
            ParameterState::Free
        } else {
            ParameterState::Fixed
        }
    });
    for (i, point) in problem.points.iter_mut().enumerate() {
        point.position = Vector3::new(
            40.0 * (i % 8) as f64 - 140.0,
            40.0 * (i / 8) as f64 - 140.0,
            0.0,
        );
    }
    problem.stations.truncate(4);
    problem.observations.clear();
    for (s, station) in problem.stations.iter_mut().enumerate() {
        let foot = Vector3::new(
            30.0 * s as f64 - 45.0,
            if s % 2 == 0 { 30.0 } else { -30.0 },
            0.0,
        );
        station.pose = Pose::looking_at(foot + Vector3::z() * 1000.0, foot, Vector3::y(), s as f64);
        for (p, point) in problem.points.iter().enumerate() {
            let pixel = camera
                .project(&station.pose.camera_from_point(&point.position))
                .unwrap();
            problem.observations.push(ImageObservation {
                station: s,
                point: p,
                pixel,
                sigma_px: 0.05,
            });
        }
    }
    problem.datum = Datum::InnerConstraints {
        points: (0..60).collect(),
    };
    problem
}

pub(super) fn bar(truth: &State, from: usize, to: usize, error: f64) -> DistanceObservation {
    DistanceObservation {
        from,
        to,
        length_mm: (truth.points[to] - truth.points[from]).norm() + error,
        sigma_mm: 0.01,
    }
}

pub(super) fn solve(problem: &BundleProblem) -> Result<Adjustment, AdjustmentError> {
    adjust(problem.clone(), BundleSettings::default(), &Monitor::new())
}
