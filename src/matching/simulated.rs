//! Simulated measurements with truth, for the trials of this folder.

use nalgebra::{Matrix3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::problem::{
    Identification, IdentificationInput, KnownCircle, KnownPoint, ObjectSpace, View, ViewDot,
};
use crate::camera::{Camera, InteriorOrientation, LensDirection};
use crate::geometry::{Circle, Pose};

/// What a scene is like.
#[derive(Clone, Copy, Debug)]
pub(super) struct SceneSettings {
    pub(super) seed: u64,
    pub(super) object: ObjectKind,
    /// Distance of neighbouring targets, mm.
    pub(super) spacing_mm: f64,
    /// Random displacement of the targets from the lattice, as a share of the spacing.
    pub(super) jitter: f64,
    pub(super) stations: usize,
    pub(super) missing: f64,
    pub(super) false_share: f64,
    pub(super) ellipses: Ellipses,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum ObjectKind {
    Box(f64, f64, f64),
    Curved(f64, f64),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Ellipses {
    Measured,
    Unknown,
}

/// How far the orientations given to identification are from the truth.
#[derive(Clone, Copy, Debug)]
pub(super) enum Perturbation {
    /// Stations wander by so much (mm, each axis) and turn to keep the object in place, but for so many px.
    Compensated(f64, f64),
    /// Stations wander and nothing compensates it.
    Plain(f64),
}

struct Target {
    point: Vector3<f64>,
    normal: Vector3<f64>,
}

pub(super) struct Scene {
    targets: Vec<Target>,
    codes: Vec<Target>,
    camera: Camera,
    poses: Vec<Pose>,
    pub(super) neighbours: Vec<Vec<usize>>,
    /// Dots with what they are: `Some(target)`, `Some(targets + code)`, or false.
    pub(super) dots: Vec<Vec<(ViewDot, Option<usize>)>>,
    /// Views in which each code dot is labelled.
    code_seen: Vec<Vec<usize>>,
    space: ObjectSpace,
}

pub(super) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (rng.random::<f64>().max(1e-300), rng.random());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

fn normal3(rng: &mut ChaCha8Rng, sigma: f64) -> Vector3<f64> {
    Vector3::new(normal(rng), normal(rng), normal(rng)) * sigma
}

const DOT_MM: f64 = 5.0;

impl Scene {
    pub(super) fn new(settings: &SceneSettings) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
        let mut targets = surface(
            settings.object,
            settings.spacing_mm,
            settings.jitter,
            &mut rng,
        );
        // Code dots: every ninth place.
        let mut codes = Vec::new();
        let mut plain = Vec::new();
        for (i, t) in targets.drain(..).enumerate() {
            if i % 9 == 3 {
                codes.push(t);
            } else {
                plain.push(t);
            }
        }
        let camera = Camera {
            width_px: 3072,
            height_px: 2048,
            pixel_pitch_mm: 0.009,
            interior: InteriorOrientation {
                principal_distance: 20.0,
                principal_point: [0.1, -0.05],
                radial: [1.5e-4, -4e-7, 0.0],
                tangential: [1e-5, -2e-5],
                affinity: [0.0, 0.0],
                direction: LensDirection::Correcting,
            },
        };
        let poses = stations(settings, &mut rng);
        let mut scene = Self {
            space: ObjectSpace::around(codes.iter().map(|c| &c.point), 0.3).unwrap(),
            targets: plain,
            codes,
            camera,
            poses,
            neighbours: Vec::new(),
            dots: Vec::new(),
            code_seen: Vec::new(),
        };
        scene.photograph(settings, &mut rng);
        scene
    }

    fn image(&self, target: &Target, pose: &Pose) -> Option<ViewDot> {
        let towards = (pose.centre_in_world - target.point).normalize();
        if target.normal.dot(&towards) < 70_f64.to_radians().cos() {
            return None;
        }
        let k = pose.camera_from_point(&target.point);
        let projection = self.camera.project_with_jacobians(&k)?;
        if !self.camera.contains(&projection.pixel) {
            return None;
        }
        let circle = Circle {
            normal: target.normal,
            radius_mm: DOT_MM / 2.0,
        };
        let ellipse = self
            .camera
            .ellipse_of_target(pose, &target.point, &circle)?;
        Some(ViewDot {
            pixel: projection.pixel,
            sigma_px: 0.02,
            major_px: ellipse.major_px,
            minor_px: ellipse.minor_px,
            angle: ellipse.angle,
        })
    }

    fn photograph(&mut self, settings: &SceneSettings, rng: &mut ChaCha8Rng) {
        self.code_seen = vec![Vec::new(); self.codes.len()];
        for view in 0..self.poses.len() {
            let pose = self.poses[view];
            let mut dots = Vec::new();
            for (i, target) in self.targets.iter().chain(&self.codes).enumerate() {
                let Some(mut dot) = self.image(target, &pose) else {
                    continue;
                };
                if rng.random::<f64>() < settings.missing {
                    continue;
                }
                if let Some(code) = i.checked_sub(self.targets.len())
                    && rng.random::<f64>() < 0.7
                {
                    self.code_seen[code].push(view);
                    continue;
                }
                dot.pixel += Vector2::new(normal(rng), normal(rng)) * 0.02;
                dot.major_px += 0.1 * normal(rng);
                dot.minor_px = (dot.minor_px + 0.1 * normal(rng)).min(dot.major_px);
                dots.push((dot, Some(i)));
            }
            let false_dots = (dots.len() as f64 * settings.false_share).round() as usize;
            for _ in 0..false_dots {
                let size = rng.random_range(6.0..14.0);
                let pixel =
                    Vector2::new(rng.random_range(0.0..3072.0), rng.random_range(0.0..2048.0));
                let dot = ViewDot {
                    pixel,
                    sigma_px: 0.03,
                    major_px: size,
                    minor_px: size * rng.random_range(0.5..1.0),
                    angle: rng.random_range(0.0..3.1),
                };
                dots.push((dot, None));
            }
            if settings.ellipses == Ellipses::Unknown {
                for (dot, _) in &mut dots {
                    (dot.major_px, dot.minor_px) = (0.0, 0.0);
                }
            }
            dots.sort_by(|a, b| a.0.pixel.y.total_cmp(&b.0.pixel.y));
            self.dots.push(dots);
        }
        self.neighbours = (0..self.poses.len())
            .map(|a| {
                (0..self.poses.len())
                    .filter(|&b| {
                        a != b
                            && self
                                .code_seen
                                .iter()
                                .any(|s| s.contains(&a) && s.contains(&b))
                    })
                    .collect()
            })
            .collect();
    }

    /// The views as an adjustment of that quality would orient them, without the dots for which `labelled` holds.
    pub(super) fn views(
        &self,
        perturbation: Perturbation,
        seed: u64,
        labelled: impl Fn(usize, usize) -> bool,
    ) -> (Vec<View>, Vec<Vec<usize>>) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let centre = self.space.centre();
        let mut kept = Vec::new();
        let views = self
            .poses
            .iter()
            .enumerate()
            .map(|(v, pose)| {
                let moved = match perturbation {
                    Perturbation::Plain(mm) => {
                        pose.moved(&Vector3::zeros(), &normal3(&mut rng, mm))
                    }
                    Perturbation::Compensated(mm, px) => {
                        let shift = normal3(&mut rng, mm);
                        let before = pose.camera_from_point(&centre);
                        let after =
                            pose.camera_from_world * (centre - pose.centre_in_world - shift);
                        // The turn that brings the object's centre back onto its old image.
                        let turn = after.cross(&before) / (after.norm() * before.norm());
                        pose.moved(&(turn + normal3(&mut rng, px / 2222.0)), &shift)
                    }
                };
                let slots: Vec<usize> = (0..self.dots[v].len())
                    .filter(|&d| !labelled(v, d))
                    .collect();
                let dots = slots.iter().map(|&d| self.dots[v][d].0).collect();
                kept.push(slots);
                View {
                    camera: self.camera.clone(),
                    pose: moved,
                    precision: None,
                    dots,
                }
            })
            .collect();
        (views, kept)
    }

    pub(super) fn known_codes(&self, sigma_mm: f64, seed: u64) -> Vec<KnownPoint> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let codes = self.codes.iter().zip(&self.code_seen);
        codes
            .map(|(code, seen_in)| KnownPoint {
                position: code.point + normal3(&mut rng, sigma_mm),
                covariance: Matrix3::identity() * (sigma_mm * sigma_mm),
                seen_in: seen_in.clone(),
                circle: Some(KnownCircle {
                    diameter_mm: Some(DOT_MM),
                    normal: code.normal,
                }),
            })
            .collect()
    }

    pub(super) fn input<'a>(
        &'a self,
        views: &'a [View],
        known: &'a [KnownPoint],
        station_sigma_mm: f64,
        image_tolerance_px: f64,
    ) -> IdentificationInput<'a> {
        IdentificationInput {
            views,
            neighbours: &self.neighbours,
            known,
            space: self.space,
            station_sigma_mm,
            image_tolerance_px,
            ellipses: None,
        }
    }

    /// Compares labels with the truth.
    pub(super) fn score(&self, results: &[(&Identification, &[Vec<usize>])]) -> Score {
        let mut score = Score::default();
        let total = self.targets.len();
        let mut rays = vec![0; total];
        for (_, what) in self.dots.iter().flatten() {
            if let Some(t) = what
                && *t < total
            {
                rays[*t] += 1;
            }
        }
        score.identifiable = rays.iter().filter(|&&r| r >= 3).sum();
        let mut tracks_of = vec![0; total];
        for (found, kept) in results {
            let truth = |m: &super::Member| self.dots[m.view][kept[m.view][m.dot]].1;
            for track in &found.tracks {
                let owner = truth(&track.members[0]);
                let majority = track
                    .members
                    .iter()
                    .map(truth)
                    .max_by_key(|t| (track.members.iter().filter(|m| truth(m) == *t).count(), *t))
                    .unwrap_or(owner);
                if let Some(t) = majority.filter(|&t| t < total) {
                    tracks_of[t] += 1;
                }
                for member in &track.members {
                    if truth(member) == majority && majority.is_some_and(|t| t < total) {
                        score.right += 1;
                    } else {
                        score.wrong += 1;
                    }
                }
            }
            for claim in &found.claims {
                match truth(&claim.member) {
                    Some(t) if t == total + claim.known => score.claimed += 1,
                    // In later passes the new targets follow the codes among the known points.
                    Some(t) if t < total && claim.known >= self.codes.len() => score.right += 1,
                    _ => score.wrong += 1,
                }
            }
        }
        score.split = tracks_of.iter().filter(|&&n| n > 1).count();
        let code_dots = self.dots.iter().flatten();
        score.claimable = code_dots
            .filter(|d| d.1.is_some_and(|t| t >= total))
            .count();
        score
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Score {
    pub(super) identifiable: usize,
    pub(super) right: usize,
    pub(super) wrong: usize,
    pub(super) split: usize,
    pub(super) claimed: usize,
    pub(super) claimable: usize,
}

impl Score {
    pub(super) fn recall(&self) -> f64 {
        self.right as f64 / self.identifiable.max(1) as f64
    }
}

fn surface(kind: ObjectKind, spacing: f64, jitter: f64, rng: &mut ChaCha8Rng) -> Vec<Target> {
    let mut targets = Vec::new();
    let mut face = |origin: Vector3<f64>, u: Vector3<f64>, v: Vector3<f64>, w: f64, h: f64| {
        let (columns, rows) = ((w / spacing) as i32, (h / spacing) as i32);
        for row in 1..rows {
            for column in 1..columns {
                let mut place = || spacing * jitter * rng.random_range(-0.5..0.5);
                let (du, dv) = (place(), place());
                let point = origin
                    + u * (f64::from(column) * spacing + du)
                    + v * (f64::from(row) * spacing + dv);
                targets.push(Target {
                    point,
                    normal: u.cross(&v),
                });
            }
        }
    };
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    match kind {
        ObjectKind::Box(a, b, c) => {
            face(Vector3::new(-a / 2.0, -b / 2.0, c), x, y, a, b);
            face(Vector3::new(-a / 2.0, -b / 2.0, 0.0), x, z, a, c);
            face(Vector3::new(a / 2.0, b / 2.0, 0.0), -x, z, a, c);
            face(Vector3::new(a / 2.0, -b / 2.0, 0.0), y, z, b, c);
            face(Vector3::new(-a / 2.0, b / 2.0, 0.0), -y, z, b, c);
        }
        ObjectKind::Curved(a, b) => {
            face(Vector3::new(-a / 2.0, -b / 2.0, 0.0), x, y, a, b);
            for target in &mut targets {
                let (px, py) = (target.point.x, target.point.y);
                target.point.z = 60.0 * (px / 120.0).sin() + 40.0 * (py / 150.0).cos();
                let slope = Vector3::new(
                    -0.5 * (px / 120.0).cos(),
                    40.0 / 150.0 * (py / 150.0).sin(),
                    1.0,
                );
                target.normal = slope.normalize();
            }
        }
    }
    targets
}

fn stations(settings: &SceneSettings, rng: &mut ChaCha8Rng) -> Vec<Pose> {
    let middle = match settings.object {
        ObjectKind::Box(_, _, c) => Vector3::new(0.0, 0.0, c / 2.0),
        ObjectKind::Curved(..) => Vector3::zeros(),
    };
    (0..settings.stations)
        .map(|i| {
            let turn = i as f64 * 2.399963; // the golden angle
            let share = (i as f64 + 0.5) / settings.stations as f64;
            let elevation = match settings.object {
                ObjectKind::Box(..) => (20.0 + 65.0 * share).to_radians(),
                ObjectKind::Curved(..) => (40.0 + 48.0 * share).to_radians(),
            };
            let distance = rng.random_range(900.0..1100.0);
            let centre = middle
                + Vector3::new(
                    elevation.cos() * turn.cos(),
                    elevation.cos() * turn.sin(),
                    elevation.sin(),
                ) * distance;
            let aim = middle + normal3(rng, 10.0);
            let roll = std::f64::consts::FRAC_PI_2 * rng.random_range(0_i32..4) as f64;
            Pose::looking_at(centre, aim, Vector3::z(), roll + 0.05 * normal(rng))
        })
        .collect()
}
