//! A random network: object, stations, lens, weights, what is known, datum.

use std::collections::BTreeSet;
use std::f64::consts::{PI, TAU};

use nalgebra::{Rotation3, SVector, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tiepoint::adjustment::{
    BundleProblem, CameraBlock, CoordinatePrior, Datum, DistanceObservation, ImageObservation,
    ParameterState, PointBlock, ResidualPlane, Sharing, StationBlock,
};
use tiepoint::camera::{Camera, InteriorOrientation};
use tiepoint::geometry::Pose;

/// A network with its truth. The observations of the problem carry the errors that their sigmas speak of.
pub(crate) struct Scene {
    /// True coordinates, by point.
    pub(crate) points: Vec<Vector3<f64>>,
    /// True interior orientation.
    pub(crate) interior: SVector<f64, 10>,
    /// What is adjusted.
    pub(crate) problem: BundleProblem,
}

/// Random numbers of one network.
struct Chance(ChaCha8Rng);

impl Chance {
    fn between(&mut self, least: f64, most: f64) -> f64 {
        least + (most - least) * self.0.random::<f64>()
    }

    /// Every size is as likely.
    fn of_size(&mut self, least: f64, most: f64) -> f64 {
        self.between(least.ln(), most.ln()).exp()
    }

    fn count(&mut self, least: usize, most: usize) -> usize {
        self.0.random_range(least..=most)
    }

    fn happens(&mut self, probability: f64) -> bool {
        self.0.random::<f64>() < probability
    }

    /// Box and Muller (1958).
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.0.random::<f64>()).ln()).sqrt();
        radius * (TAU * self.0.random::<f64>()).cos()
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }

    fn direction(&mut self) -> Vector3<f64> {
        self.vector().normalize()
    }
}

/// The shape of what is measured; it is some 1000 mm across.
#[derive(Clone, Copy)]
enum Shape {
    Box { height: f64 },
    Plate { relief: f64 },
    Cylinder { radius: f64 },
    Cloud,
}

impl Shape {
    fn any(chance: &mut Chance) -> Self {
        match chance.count(0, 3) {
            0 => Self::Box {
                height: chance.between(100.0, 800.0),
            },
            1 => Self::Plate {
                relief: chance.between(20.0, 150.0),
            },
            2 => Self::Cylinder {
                radius: chance.between(200.0, 500.0),
            },
            _ => Self::Cloud,
        }
    }

    /// A point with its outward normal; a cloud's points are seen from everywhere.
    fn point(self, chance: &mut Chance) -> (Vector3<f64>, Option<Vector3<f64>>) {
        let x = chance.between(-500.0, 500.0);
        let y = chance.between(-500.0, 500.0);
        match self {
            Self::Box { height } => match chance.count(0, 4) {
                0 => {
                    let normal = Vector3::x() * if chance.happens(0.5) { 1.0 } else { -1.0 };
                    let z = chance.between(-height, 0.0);
                    (normal * 500.0 + Vector3::new(0.0, y, z), Some(normal))
                }
                1 => {
                    let normal = Vector3::y() * if chance.happens(0.5) { 1.0 } else { -1.0 };
                    let z = chance.between(-height, 0.0);
                    (normal * 500.0 + Vector3::new(x, 0.0, z), Some(normal))
                }
                _ => (Vector3::new(x, y, 0.0), Some(Vector3::z())),
            },
            Self::Plate { relief } => {
                let z = chance.between(-relief, relief);
                (Vector3::new(x, y, z), Some(Vector3::z()))
            }
            Self::Cylinder { radius } => {
                let azimuth = chance.between(0.0, TAU);
                let normal = Vector3::new(azimuth.cos(), azimuth.sin(), 0.0);
                (radius * normal + Vector3::z() * y, None)
            }
            Self::Cloud => (chance.direction() * chance.between(100.0, 500.0), None),
        }
    }
}

fn camera(chance: &mut Chance) -> Camera {
    let c = chance.of_size(18.0, 60.0);
    let width_px = [2000, 4000, 6000][chance.count(0, 2)];
    let height_px = width_px * 3 / 4;
    let width_mm = c * chance.between(0.6, 1.3);
    let half = width_mm / 2.0;
    Camera {
        width_px,
        height_px,
        pixel_pitch_mm: width_mm / f64::from(width_px),
        interior: InteriorOrientation {
            principal_point: [0, 1].map(|_| 0.005 * c * chance.normal()),
            // Up to a per cent at the edge, the higher terms less.
            radial: [
                0.008 * chance.normal() / half.powi(2),
                0.003 * chance.normal() / half.powi(4),
                0.001 * chance.normal() / half.powi(6),
            ],
            tangential: [0, 1].map(|_| 0.0003 * chance.normal() / half),
            affinity: [0, 1].map(|_| 0.0002 * chance.normal()),
            ..InteriorOrientation::pinhole(c)
        },
    }
}

/// Stations on a part of a sphere about the object, each turned about its axis at random.
fn poses(chance: &mut Chance, camera: &Camera, count: usize, sideways: bool) -> Vec<Pose> {
    let c = camera.interior.principal_distance;
    let narrow = f64::from(camera.height_px) * camera.pixel_pitch_mm;
    // The object of some 1200 mm fills the narrow side of the image.
    let distance = 1250.0 * c / narrow;
    let widest = chance.between(0.5, 1.1);
    (0..count)
        .map(|number| {
            let azimuth = TAU * (number as f64 + chance.between(-0.3, 0.3)) / count as f64;
            let off_axis = widest * chance.between(0.2, 1.0).sqrt();
            let direction = if sideways {
                let height = chance.between(-0.5, 0.6);
                Vector3::new(azimuth.cos(), azimuth.sin(), height).normalize()
            } else {
                Vector3::new(
                    off_axis.sin() * azimuth.cos(),
                    off_axis.sin() * azimuth.sin(),
                    off_axis.cos(),
                )
            };
            let centre = direction * distance * chance.between(0.9, 1.4);
            let aim = chance.vector() * 40.0;
            let roll = chance.between(-PI, PI);
            Pose::looking_at(centre, aim, Vector3::new(0.1, 0.2, 1.0), roll)
        })
        .collect()
}

/// What the adjustment is told of the lens.
fn lens(chance: &mut Chance, truth: &Camera, stations: usize, solid: bool) -> CameraBlock {
    let values = truth.interior.to_vector();
    let half = f64::from(truth.width_px) * truth.pixel_pitch_mm / 2.0;
    let kind = if stations >= 8 && solid {
        chance.count(0, 3)
    } else {
        chance.count(2, 3)
    };
    let weighted = |chance: &mut Chance, value: f64, sigma: f64| ParameterState::Weighted {
        value: value + sigma * chance.normal(),
        sigma,
    };
    let mut camera = truth.clone();
    let parameters = match kind {
        // Everything is estimated.
        0 => [ParameterState::Free; 10],
        // The lower terms are.
        1 => std::array::from_fn(|p| [0, 1, 2, 3].contains(&p).then_some(ParameterState::Free))
            .map(|p| p.unwrap_or(ParameterState::Fixed)),
        // A calibration is known with its sigmas.
        2 => {
            let sigmas = [
                1e-4 * values[0],
                1e-4 * values[0],
                1e-4 * values[0],
                1e-3 / half.powi(2),
                1e-3 / half.powi(4),
                1e-3 / half.powi(6),
                1e-4 / half,
                1e-4 / half,
                1e-4,
                1e-4,
            ];
            let mut states = [ParameterState::Fixed; 10];
            for (p, state) in states.iter_mut().enumerate() {
                *state = weighted(chance, values[p], sigmas[p]);
            }
            states
        }
        // It is known.
        _ => [ParameterState::Fixed; 10],
    };
    let start: SVector<f64, 10> = SVector::from_fn(|p, _| match parameters[p] {
        ParameterState::Free if p == 0 => values[0] * (1.0 + 2e-3 * chance.normal()),
        ParameterState::Free => 0.0,
        ParameterState::Weighted { value, .. } => value,
        ParameterState::Fixed => values[p],
    });
    camera.interior = camera.interior.with_values(&start);
    CameraBlock {
        camera,
        parameters,
        sharing: [Sharing::Camera; 10],
    }
}

impl Scene {
    /// The network of a number: geometry, lens, weights and what is known are random.
    pub(crate) fn numbered(number: u64) -> Self {
        let mut chance = Chance(ChaCha8Rng::seed_from_u64(number));
        let chance = &mut chance;
        let shape = Shape::any(chance);
        let solid = !matches!(shape, Shape::Plate { .. });
        let camera = camera(chance);
        let stations = chance.count(4, 20);
        let sideways = matches!(shape, Shape::Cylinder { .. } | Shape::Cloud);
        let poses = poses(chance, &camera, stations, sideways);
        let turn = Rotation3::new(chance.vector());
        let (points, normals): (Vec<_>, Vec<_>) = (0..chance.count(15, 70))
            .map(|_| shape.point(chance))
            .unzip();
        let noise = chance.of_size(0.02, 0.3);
        let detected = chance.between(0.7, 1.0);
        let mut observations = Vec::new();
        for (station, pose) in poses.iter().enumerate() {
            for (point, position) in points.iter().enumerate() {
                let sight = (pose.centre_in_world - position).normalize();
                let faces = normals[point].is_none_or(|normal| normal.dot(&sight) > 0.25);
                let pixel = camera.project(&pose.camera_from_point(position));
                let inside = |px: &Vector2<f64>| {
                    (0.0..f64::from(camera.width_px)).contains(&px.x)
                        && (0.0..f64::from(camera.height_px)).contains(&px.y)
                };
                if let (true, Some(pixel), true) = (faces, pixel, chance.happens(detected))
                    && inside(&pixel)
                {
                    let sigma_px = noise * chance.of_size(0.5, 2.0);
                    let error = Vector2::new(chance.normal(), chance.normal()) * sigma_px;
                    observations.push(ImageObservation {
                        station,
                        point,
                        pixel: pixel + error,
                        sigma_px,
                    });
                }
            }
        }
        // In its own frame: turned and moved at random.
        let away = chance.vector() * 300.0;
        let moved = |position: &Vector3<f64>| turn * position + away;
        let points: Vec<Vector3<f64>> = points.iter().map(moved).collect();
        let poses: Vec<Pose> = poses
            .iter()
            .map(|pose| Pose {
                camera_from_world: pose.camera_from_world * turn.inverse(),
                centre_in_world: moved(&pose.centre_in_world),
            })
            .collect();
        let mut scene = Self {
            interior: camera.interior.to_vector(),
            problem: BundleProblem {
                cameras: vec![lens(chance, &camera, stations, solid)],
                stations: poses
                    .iter()
                    .map(|pose| StationBlock {
                        camera: 0,
                        pose: pose.moved(&(chance.vector() * 2e-3), &(chance.vector() * 3.0)),
                    })
                    .collect(),
                points: points
                    .iter()
                    .map(|p| PointBlock::unknown(p + chance.vector() * 3.0))
                    .collect(),
                observations,
                distances: Vec::new(),
                residuals: ResidualPlane::Measured,
                datum: Datum::Control,
                frame: None,
                rejected: BTreeSet::new(),
            },
            points,
        };
        scene.leave_out_thin();
        scene.know_something(chance);
        scene
    }

    /// Points of one ray and stations of few points are left out until none is left.
    fn leave_out_thin(&mut self) {
        /// A station needs so many points.
        const LEAST_POINTS: usize = 6;
        loop {
            let problem = &mut self.problem;
            let mut rays = vec![0; problem.points.len()];
            let mut seen = vec![0; problem.stations.len()];
            for o in &problem.observations {
                rays[o.point] += 1;
                seen[o.station] += 1;
            }
            let before = problem.observations.len();
            problem
                .observations
                .retain(|o| rays[o.point] >= 2 && seen[o.station] >= LEAST_POINTS);
            if problem.observations.len() == before {
                let mut place = vec![0; seen.len()];
                let mut next = 0;
                for (station, count) in seen.iter().enumerate() {
                    place[station] = next;
                    next += usize::from(*count > 0);
                }
                let mut station = 0;
                problem.stations.retain(|_| {
                    station += 1;
                    seen[station - 1] > 0
                });
                for o in &mut problem.observations {
                    o.station = place[o.station];
                }
                return;
            }
        }
    }

    /// Bars, control points, datum.
    fn know_something(&mut self, chance: &mut Chance) {
        let mut seen: Vec<usize> = self.problem.observations.iter().map(|o| o.point).collect();
        seen.sort_unstable();
        seen.dedup();
        let mut chosen = |count: usize| -> Vec<usize> {
            let mut from = seen.clone();
            for k in 0..count.min(from.len()) {
                let swap = chance.count(k, from.len() - 1);
                from.swap(k, swap);
            }
            from.truncate(count);
            from
        };
        let ends = chosen(8);
        let known = chosen(12);
        let datum = chosen(seen.len());
        if chance.happens(0.5) {
            for pair in ends.chunks_exact(2).take(chance.count(1, 4)) {
                let sigma_mm = chance.of_size(0.002, 0.05);
                let length = (self.points[pair[1]] - self.points[pair[0]]).norm();
                self.problem.distances.push(DistanceObservation {
                    from: pair[0],
                    to: pair[1],
                    length_mm: length + sigma_mm * chance.normal(),
                    sigma_mm,
                });
            }
        }
        if chance.happens(0.25) {
            let sigma = chance.of_size(0.005, 0.1);
            for &point in known.iter().take(chance.count(4, 12)) {
                let truth = self.points[point];
                let block = &mut self.problem.points[point];
                // One coordinate in ten is not known.
                block.prior = [0, 1, 2].map(|axis| {
                    (!chance.happens(0.1)).then(|| CoordinatePrior::Weighted {
                        value: truth[axis] + sigma * chance.normal(),
                        sigma,
                    })
                });
            }
            return;
        }
        let rests_on = chance.count(5, datum.len().max(5)).min(datum.len());
        // The datum refers to the places where its points are taken to be.
        self.problem.datum = Datum::InnerConstraints {
            points: datum[..rests_on].to_vec(),
        };
    }

    /// The datum points; empty where control holds the network.
    pub(crate) fn datum_points(&self) -> &[usize] {
        match &self.problem.datum {
            Datum::InnerConstraints { points } => points,
            Datum::Control => &[],
        }
    }
}
