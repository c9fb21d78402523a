//! What detection would find in a picture, without the picture.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use nalgebra::{Vector2, Vector3};
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use tiepoint::camera::Camera;
use tiepoint::geometry::{Circle, Pose};
use tiepoint::targets::{CodeEvidence, CodeReading, Detections, Dot, DotIndex};

use super::readings::{Shown, most_wrong, spoil};
use super::recipe::Recipe;
use super::world::World;

/// Diameter of every dot, mm, as the program takes it where nothing else is stated.
const DOT_MM: f64 = 5.0;
/// Steeper targets are not seen.
const STEEPEST: f64 = 70.0;
/// Dots nearer to the border are not found, px.
const BORDER_PX: f64 = 12.0;

/// One picture of the world.
pub(crate) struct View<'a> {
    pub(crate) recipe: &'a Recipe,
    pub(crate) camera: &'a Camera,
    pub(crate) pose: &'a Pose,
    pub(crate) world: &'a World,
}

impl View<'_> {
    fn dot(
        &self,
        point: &Vector3<f64>,
        normal: Option<&Vector3<f64>>,
        random: &mut ChaCha8Rng,
    ) -> Option<Dot> {
        let away = (self.pose.centre_in_world - point).normalize();
        if normal.is_some_and(|n| n.dot(&away) < STEEPEST.to_radians().cos()) {
            return None;
        }
        // The cross and plain targets face the way the base plane does.
        let circle = Circle {
            normal: normal.copied().unwrap_or_else(Vector3::z),
            radius_mm: 0.5 * DOT_MM,
        };
        let px = self
            .camera
            .image_of_target(self.pose, point, Some(&circle))?;
        let inside =
            |value: f64, size: u32| (BORDER_PX..f64::from(size) - BORDER_PX).contains(&value);
        if !(inside(px.x, self.camera.width_px) && inside(px.y, self.camera.height_px)) {
            return None;
        }
        let noise = self.recipe.noise_px;
        let centre_px = px + Vector2::new(normal_deviate(random), normal_deviate(random)) * noise;
        // What is seen of the circle across the line of sight is its longest diameter.
        let across = circle.normal.cross(&away);
        let across = across.try_normalize(1e-9).unwrap_or_else(Vector3::x);
        let along = circle.normal.cross(&across);
        let diameter = |axis: &Vector3<f64>| {
            let [from, to] = [-1.0, 1.0].map(|sign| point + axis * (sign * circle.radius_mm));
            let [from, to] = [from, to].map(|end| self.pose.camera_from_point(&end));
            Some(self.camera.project(&to)? - self.camera.project(&from)?)
        };
        let (major, minor) = (diameter(&across)?, diameter(&along)?);
        Some(Dot {
            centre_px,
            sigma_px: noise,
            major_px: major.norm(),
            minor_px: minor.norm().min(major.norm()),
            angle: major.y.atan2(major.x).rem_euclid(PI),
            contrast: 120.0,
            background: 12.0,
        })
    }

    /// The dots and readings of the picture; `moved` is a code that stands elsewhere than in the others.
    pub(crate) fn detected(
        &self,
        moved: Option<u32>,
        random: &mut ChaCha8Rng,
    ) -> (Detections, Shown) {
        let family = self.recipe.family;
        let mut dots: Vec<Dot> = Vec::new();
        let mut readings: Vec<CodeReading> = Vec::new();
        for code in &self.world.codes {
            let seen: Option<Vec<Dot>> = code
                .dots(family, self.world.pitch_mm)
                .iter()
                .map(|dot| self.dot(dot, Some(&code.axes[2]), random))
                .collect();
            let Some(seen) = seen else { continue };
            let from = dots.len();
            dots.extend(seen);
            if !random.random_bool(self.recipe.unread) {
                readings.push(CodeReading {
                    family,
                    id: code.id,
                    dots: numbered(from..dots.len()),
                    misfit: 0.1,
                    doubt: None,
                    evidence: CodeEvidence::default(),
                });
            }
        }
        let plain = dots.len();
        for point in &self.world.plain {
            dots.extend(self.dot(point, None, random));
        }
        let plain = numbered(plain..dots.len());
        let before = dots.len();
        for (_, point) in &self.world.cross {
            dots.extend(self.dot(point, None, random));
        }
        let cross = !self.world.cross.is_empty() && dots.len() == before + self.world.cross.len();
        let true_codes: BTreeMap<Vec<DotIndex>, u32> = readings
            .iter()
            .filter(|reading| moved != Some(reading.id))
            .map(|reading| (reading.dots.clone(), reading.id))
            .collect();
        let most = most_wrong(self.recipe.wrong, readings.len());
        spoil(
            &mut readings,
            self.recipe.wrong,
            most,
            self.world,
            &plain,
            random,
        );
        let shown = Shown {
            cross,
            ..Shown::of(family, &readings, &true_codes)
        };
        // By rows, as detection gives them: the order says nothing.
        let mut order: Vec<usize> = (0..dots.len()).collect();
        order.sort_by(|&a, &b| dots[a].centre_px.y.total_cmp(&dots[b].centre_px.y));
        let mut slots = vec![DotIndex(0); dots.len()];
        for (slot, &index) in order.iter().enumerate() {
            slots[index] = DotIndex(slot as u32);
        }
        for dot in readings.iter_mut().flat_map(|reading| &mut reading.dots) {
            *dot = slots[dot.slot()];
        }
        readings.sort_by_key(|reading| (reading.id, reading.dots.clone()));
        let detections = Detections {
            width_px: self.camera.width_px,
            height_px: self.camera.height_px,
            dots: order.iter().map(|&index| dots[index].clone()).collect(),
            codes: readings,
            ..Detections::default()
        };
        (detections, shown)
    }
}

fn numbered(slots: std::ops::Range<usize>) -> Vec<DotIndex> {
    slots.map(|slot| DotIndex(slot as u32)).collect()
}

/// A number of the standard normal distribution (Box and Muller, 1958).
fn normal_deviate(random: &mut ChaCha8Rng) -> f64 {
    let u: f64 = random.random_range(1e-300..1.0);
    let v: f64 = random.random_range(0.0..1.0);
    (-2.0 * u.ln()).sqrt() * (TAU * v).cos()
}
