//! What detection would find in a picture of the object, without the picture.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::Vector2;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use tiepoint::camera::Camera;
use tiepoint::geometry::Pose;
use tiepoint::targets::{CodeEvidence, CodeReading, Detections, Dot, DotIndex, Family};

use super::object::{Object, Spot};
use super::recipe::{Recipe, normal_deviate};

/// Steeper targets are not seen.
const STEEPEST: f64 = 66.0;
/// Dots nearer to the border are not found, px.
const BORDER_PX: f64 = 10.0;
/// Dots whose edges are nearer than this are found as one, px.
const MERGED_PX: f64 = 1.5;
/// Standard deviation of a measured diameter, px.
const AXIS_PX: f64 = 0.1;
/// How far a glint strays on the surface as the camera goes round it, mm. (Were it in proportion to the direction, the glint would
/// be the image of a point at another depth, and stand still.)
const GLINT_MM: f64 = 40.0;

/// What a dot is in truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Truth {
    /// A plain target.
    Plain(usize),
    /// A dot of a code: number and place in the reading.
    Code(u32, usize),
    /// Nothing that stands still.
    False,
}

/// A dot with its truth.
#[derive(Clone, Debug)]
struct Found {
    dot: Dot,
    truth: Truth,
}

/// One picture of the object.
pub(crate) struct View<'a> {
    pub(crate) recipe: &'a Recipe,
    pub(crate) object: &'a Object,
    pub(crate) camera: &'a Camera,
    pub(crate) pose: &'a Pose,
}

impl View<'_> {
    /// A dot as it is measured; `None` where it is not seen.
    fn seen(&self, spot: &Spot, random: &mut ChaCha8Rng) -> Option<Dot> {
        let away = (self.pose.centre_in_world - spot.place).normalize();
        if spot.normal.dot(&away) < STEEPEST.to_radians().cos() {
            return None;
        }
        let circle = spot.circle();
        let camera = self.camera;
        let px = camera.image_of_target(self.pose, &spot.place, Some(&circle))?;
        let inside =
            |value: f64, size: u32| (BORDER_PX..f64::from(size) - BORDER_PX).contains(&value);
        if !(inside(px.x, camera.width_px) && inside(px.y, camera.height_px)) {
            return None;
        }
        let sigma_px = self.recipe.noise_px * random.random_range(1.0..2.0);
        let centre_px =
            px + Vector2::new(normal_deviate(random), normal_deviate(random)) * sigma_px;
        let ellipse = camera.ellipse_of_target(self.pose, &spot.place, &circle)?;
        let major_px = ellipse.major_px + AXIS_PX * normal_deviate(random);
        let minor_px = ellipse.minor_px + AXIS_PX * normal_deviate(random);
        // Of a dot that is nearly round noise decides which diameter is the larger.
        let turn = if major_px >= minor_px { 0.0 } else { FRAC_PI_2 };
        Some(Dot {
            centre_px,
            sigma_px,
            major_px: major_px.max(minor_px),
            minor_px: minor_px.min(major_px),
            angle: (ellipse.angle + turn).rem_euclid(PI),
            contrast: 120.0,
            background: 12.0,
        })
    }

    /// The dots and readings of the picture, with the truth of every dot.
    pub(crate) fn detected(&self, random: &mut ChaCha8Rng) -> (Detections, Vec<Truth>) {
        let mut found: Vec<Found> = Vec::new();
        for code in &self.object.codes {
            for (place, spot) in code.dots.iter().enumerate() {
                let dot = self.seen(spot, random);
                found.extend(dot.map(|dot| Found {
                    dot,
                    truth: Truth::Code(code.id, place),
                }));
            }
        }
        for (index, spot) in self.object.targets.iter().enumerate() {
            let dot = self.seen(spot, random);
            found.extend(dot.map(|dot| Found {
                dot,
                truth: Truth::Plain(index),
            }));
        }
        self.add_glints(&mut found, random);
        found.retain(|_| !random.random_bool(self.recipe.missed));
        let mut found = merged(found);
        self.add_false(&mut found, random);
        // By rows, as detection gives them: the order says nothing.
        found.sort_by(|a, b| a.dot.centre_px.y.total_cmp(&b.dot.centre_px.y));
        let codes = self.readings(&found);
        let detections = Detections {
            width_px: self.camera.width_px,
            height_px: self.camera.height_px,
            codes,
            dots: found.iter().map(|f| f.dot.clone()).collect(),
            ..Detections::default()
        };
        (detections, found.iter().map(|f| f.truth).collect())
    }

    /// Codes of which all six dots are found.
    fn readings(&self, found: &[Found]) -> Vec<CodeReading> {
        let mut readings: Vec<CodeReading> = Vec::new();
        for code in &self.object.codes {
            let of = |place: usize| {
                let truth = Truth::Code(code.id, place);
                let slot = found.iter().position(|f| f.truth == truth)?;
                Some(DotIndex(slot as u32))
            };
            let dots: Option<Vec<DotIndex>> = (0..code.dots.len()).map(of).collect();
            if let Some(dots) = dots {
                readings.push(CodeReading {
                    family: Family::Dot420,
                    id: code.id,
                    dots,
                    misfit: 0.1,
                    doubt: None,
                    evidence: CodeEvidence::default(),
                });
            }
        }
        readings.sort_by_key(|reading| reading.id);
        readings
    }

    /// Reflections: they lie on the surface, but elsewhere for every camera.
    fn add_glints(&self, found: &mut Vec<Found>, random: &mut ChaCha8Rng) {
        for (face, place) in &self.object.glints {
            let spot = self.object.spot(*face, place);
            let away = (self.pose.centre_in_world - spot.place).normalize();
            let slide = Vector2::new((9.0 * away.x).sin(), (9.0 * away.y).sin()) * GLINT_MM;
            let dot = self.seen(&self.object.spot(*face, &(place + slide)), random);
            found.extend(dot.map(|dot| Found {
                dot,
                truth: Truth::False,
            }));
        }
    }

    fn add_false(&self, found: &mut Vec<Found>, random: &mut ChaCha8Rng) {
        if found.is_empty() {
            return;
        }
        let like = |random: &mut ChaCha8Rng, found: &[Found]| {
            let true_one = &found[random.random_range(0..found.len())].dot;
            let size = true_one.major_px * random.random_range(0.8..1.25);
            Dot {
                major_px: size,
                minor_px: size * random.random_range(0.5..1.0),
                angle: random.random_range(0.0..PI),
                ..true_one.clone()
            }
        };
        let true_ones = found.clone();
        let count = (found.len() as f64 * self.recipe.false_share).round() as usize;
        for _ in 0..count {
            let mut dot = like(random, &true_ones);
            let reach = 6.0 * dot.major_px;
            dot.centre_px += Vector2::new(
                random.random_range(-reach..reach),
                random.random_range(-reach..reach),
            );
            found.push(Found {
                dot,
                truth: Truth::False,
            });
        }
        for _ in 0..self.recipe.clusters {
            let beside = like(random, &true_ones);
            for _ in 0..random.random_range(4..9) {
                let mut dot = like(random, &true_ones);
                let away = beside.major_px * random.random_range(1.3..4.0);
                let (sin, cos) = random.random_range(0.0..TAU).sin_cos();
                dot.centre_px = beside.centre_px + Vector2::new(cos, sin) * away;
                found.push(Found {
                    dot,
                    truth: Truth::False,
                });
            }
        }
        let (width, height) = (self.camera.width_px, self.camera.height_px);
        found.retain(|f| {
            let px = f.dot.centre_px;
            (0.0..f64::from(width)).contains(&px.x) && (0.0..f64::from(height)).contains(&px.y)
        });
        // Two dots of a picture are never at one place: the true ones stay.
        let clear = |f: &Found| {
            f.truth != Truth::False
                || true_ones.iter().all(|other| {
                    let apart = (other.dot.centre_px - f.dot.centre_px).norm();
                    apart == 0.0 || apart > 0.5 * (other.dot.major_px + f.dot.major_px)
                })
        };
        found.retain(clear);
    }
}

/// Dots that touch are found as one, where neither is.
fn merged(mut found: Vec<Found>) -> Vec<Found> {
    found.sort_by(|a, b| a.dot.centre_px.x.total_cmp(&b.dot.centre_px.x));
    let largest = found.iter().map(|f| f.dot.major_px).fold(0.0, f64::max);
    let mut gone = vec![false; found.len()];
    let mut joined = Vec::new();
    for i in 0..found.len() {
        for j in i + 1..found.len() {
            let (a, b) = (&found[i].dot, &found[j].dot);
            let way = b.centre_px - a.centre_px;
            if way.x > largest + MERGED_PX {
                break;
            }
            if way.norm() - reach(a, &way) - reach(b, &way) > MERGED_PX || gone[i] || gone[j] {
                continue;
            }
            (gone[i], gone[j]) = (true, true);
            let mut dot = a.clone();
            dot.centre_px += way / 2.0;
            dot.major_px = way.norm() + 0.5 * (a.major_px + b.major_px);
            dot.angle = way.y.atan2(way.x).rem_euclid(PI);
            // Half of them look like one dot after all.
            if i % 2 == 0 {
                joined.push(Found {
                    dot,
                    truth: Truth::False,
                });
            }
        }
    }
    let mut kept: Vec<Found> = found
        .into_iter()
        .zip(gone)
        .filter_map(|(f, gone)| (!gone).then_some(f))
        .collect();
    kept.extend(joined);
    kept
}

/// How far a dot's ellipse reaches in a direction, px.
fn reach(dot: &Dot, way: &Vector2<f64>) -> f64 {
    let turn = way.y.atan2(way.x) - dot.angle;
    0.5 * (dot.major_px * turn.cos()).hypot(dot.minor_px * turn.sin())
}
