//! A random field of targets in rendered pictures, with dots of its own in each picture that are no targets.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Vector2, Vector3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use tiepoint::geometry::Pose;
use tiepoint::imaging::{BitDepth, GreyImage};
use tiepoint::monitor::Monitor;
use tiepoint::network::{ImageEntry, ImageId, Network, PointId};
use tiepoint::stages::Pictures;
use tiepoint::synthetic::{Finish, Placement, RenderSettings, Scene as Things, TruthDot, render};

use super::object::{DOT_MM, Object, Spot};
use super::recipe::Recipe;
use super::scene::Scene;
use super::table::Truth;
use super::verdict::{Votes, owners_by, split};

/// A dot is the one that is found so near to its place, as a share of its larger diameter.
const SAME: f64 = 0.25;
/// Light of another dot within this distance touches a dot, px.
const TOUCHED_PX: f64 = 3.0;
/// A dot is visible that rises above its surroundings by so many times the noise of a pixel.
const LEAST_HEIGHT: f64 = 2.0;
/// Signal to noise of a whole dot from which it is visible: what detection asks for.
const VISIBLE: f64 = 8.0;

/// Pictures by image, and what they show in truth.
pub(crate) struct Pictured {
    pub(crate) scene: Scene,
    pub(crate) pictures: Memory,
    /// Dots of each image with what they are.
    truth: BTreeMap<ImageId, Vec<(TruthDot, Truth)>>,
    noise: f64,
    peak: f64,
}

/// Pictures by the path of their image.
pub(crate) struct Memory(BTreeMap<String, GreyImage>);

impl Pictures for Memory {
    fn load(&self, image: &ImageEntry, _monitor: &Monitor) -> Result<GreyImage, String> {
        let path = &image.file.path;
        let picture = self.0.get(path).cloned();
        picture.ok_or_else(|| format!("{path}: found no such picture"))
    }
}

/// How the visible dots of pictures fared.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Seen {
    /// Whole dots, touched by nothing, that rise above the noise, of targets that three images or more show so.
    pub(crate) visible: usize,
    /// Of these named rightly.
    pub(crate) labelled: usize,
    /// Of these measured in the second look.
    pub(crate) by_second_look: usize,
    /// Labels that the final adjustment uses, on dots that are something else.
    pub(crate) wrong_used: usize,
    /// Points beyond the first of one target.
    pub(crate) split: usize,
    pub(crate) missed: Vec<String>,
}

impl Pictured {
    /// The measurement of this number, photographed.
    pub(crate) fn numbered(number: u64) -> Self {
        let scene = Scene::with(number, |recipe| Recipe {
            // In pictures dots are missed where they are.
            missed: 0.0,
            stations: recipe.stations.min(24),
            targets: recipe.targets.min(800),
            ..recipe
        });
        let mut random = ChaCha8Rng::seed_from_u64(number);
        random.set_stream(2);
        let light = RenderSettings {
            peak_grey: random.random_range(90.0..200.0),
            blur_sigma_px: random.random_range(0.6..0.9),
            ..RenderSettings::default()
        };
        let things = things(&scene.object);
        let shots: Vec<(ImageId, Pose)> = scene.poses.iter().map(|(id, p)| (*id, *p)).collect();
        let taken: Vec<(GreyImage, Vec<(TruthDot, Truth)>)> = shots
            .par_iter()
            .map(|(id, pose)| {
                let seed = number * 1000 + u64::from(id.0);
                let mut things = things.clone();
                add_false(&mut things, &scene, pose, seed);
                let rendered = render(&things, &scene.camera, pose, &light, seed);
                let picture = GreyImage::new(
                    scene.camera.width_px,
                    scene.camera.height_px,
                    BitDepth::Eight,
                    rendered.image.iter().map(|grey| u16::from(*grey)).collect(),
                );
                let dots = rendered.truth.into_iter().map(|dot| {
                    let truth = truth_of(&dot.label);
                    (dot, truth)
                });
                (picture.expect("as many pixels"), dots.collect())
            })
            .collect();
        let mut pictures = BTreeMap::new();
        let mut truth = BTreeMap::new();
        let mut scene = scene;
        for ((id, _), (picture, dots)) in shots.iter().zip(taken) {
            let image = scene.network.image_mut(*id);
            image.detections = None;
            image.labels = Arc::default();
            pictures.insert(image.file.path.clone(), picture);
            truth.insert(*id, dots);
        }
        Self {
            scene,
            pictures: Memory(pictures),
            truth,
            noise: light.noise_sigma_grey,
            peak: light.peak_grey,
        }
    }

    /// What a dot of the network is in truth, by its place.
    fn at(&self, id: ImageId, place: &Vector2<f64>) -> Option<&(TruthDot, Truth)> {
        let dots = self.truth[&id].iter();
        dots.filter(|(dot, _)| dot.is_seen())
            .filter_map(|entry| Some(((entry.0.centre_of_image_px? - place).norm(), entry)))
            .filter(|(distance, (dot, _))| *distance < (SAME * dot.major_px).max(1.0))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, entry)| entry)
    }

    /// Signal to noise of a whole dot above what surrounds it.
    fn signal(&self, id: ImageId, dot: &TruthDot) -> f64 {
        let returned = Finish::default().returned(dot.incidence_deg.to_radians().cos());
        let height = self.peak * returned - self.ground(id, dot);
        let area = std::f64::consts::FRAC_PI_4 * dot.major_px * dot.minor_px;
        // Blur spreads a small dot over more pixels.
        let spread = area / (area + 4.0 * std::f64::consts::PI * 0.8 * 0.8).max(1.0);
        if height < LEAST_HEIGHT * self.noise {
            return 0.0;
        }
        height * (area * spread).sqrt() / self.noise
    }

    /// Median grey value round a dot.
    fn ground(&self, id: ImageId, dot: &TruthDot) -> f64 {
        let picture = &self.pictures.0[&self.scene.network.images[&id].file.path];
        let Some(centre) = dot.centre_of_image_px else {
            return 0.0;
        };
        let radius = dot.major_px / 2.0 + 3.0;
        let mut greys: Vec<f64> = (0..32)
            .filter_map(|k| {
                let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / 32.0).sin_cos();
                picture.sample(centre.x + radius * cos, centre.y + radius * sin)
            })
            .collect();
        greys.sort_by(f64::total_cmp);
        greys.get(greys.len() / 2).copied().unwrap_or_default()
    }

    fn is_visible(&self, id: ImageId, dot: &TruthDot) -> bool {
        dot.is_whole()
            && dot.near_px.is_none_or(|near| near > TOUCHED_PX)
            && self.signal(id, dot) >= VISIBLE
    }

    pub(crate) fn judge(&self, network: &Network) -> Seen {
        let mut seen = Seen::default();
        let mut votes = Votes::new();
        let mut labels: BTreeMap<(ImageId, Truth), (PointId, bool)> = BTreeMap::new();
        let mut used: Vec<(PointId, Truth)> = Vec::new();
        for (id, image) in network.images.iter() {
            let Some(detections) = &image.detections else {
                continue;
            };
            for (dot, label) in image.labels.iter() {
                let place = detections.dots[dot.slot()].centre_px;
                let truth = self.at(*id, &place).map_or(Truth::False, |entry| entry.1);
                *votes
                    .entry(label.point)
                    .or_default()
                    .entry(truth)
                    .or_default() += 1;
                labels.insert(
                    (*id, truth),
                    (label.point, detections.expected.contains(dot)),
                );
                if label.rejected.is_none() {
                    used.push((label.point, truth));
                }
            }
        }
        let owners = owners_by(&votes);
        let right =
            |point: &PointId, truth: &Truth| *truth != Truth::False && owners[point] == *truth;
        seen.wrong_used = used.iter().filter(|(p, t)| !right(p, t)).count();
        seen.split = split(&owners);
        let mut shown: BTreeMap<Truth, usize> = BTreeMap::new();
        for (id, dots) in &self.truth {
            for (_, truth) in dots.iter().filter(|(dot, _)| self.is_visible(*id, dot)) {
                *shown.entry(*truth).or_default() += 1;
            }
        }
        for (id, dots) in &self.truth {
            for (dot, truth) in dots {
                if *truth == Truth::False || !self.is_visible(*id, dot) || shown[truth] < 3 {
                    continue;
                }
                seen.visible += 1;
                match labels.get(&(*id, *truth)) {
                    Some((point, second)) if right(point, truth) => {
                        seen.labelled += 1;
                        seen.by_second_look += usize::from(*second);
                    }
                    _ => seen.missed.push(self.words(network, *id, dot, truth)),
                }
            }
        }
        seen
    }

    /// Why a visible dot has no name, as the program tells it.
    fn words(&self, network: &Network, id: ImageId, dot: &TruthDot, truth: &Truth) -> String {
        let image = &network.images[&id];
        let place = dot.centre_of_image_px.unwrap_or_default();
        let near = image.detections.as_ref().and_then(|detections| {
            let mut dots = detections.dots.iter().enumerate();
            let found = dots.find(|(_, d)| (d.centre_px - place).norm() < 1.5)?;
            let index = tiepoint::targets::DotIndex(found.0 as u32);
            let label = image.labels.get(&index).map(|l| network.label(l.point));
            Some(format!("dot: {label:?} {:?}", image.unlabelled.get(&index)))
        });
        let refused = image.detections.as_ref().and_then(|detections| {
            let mut refused = detections.rejected.iter();
            let found = refused.find(|r| (r.place_px - place).norm() < 0.5 * dot.major_px)?;
            Some(&found.reason)
        });
        let absent = image
            .absent()
            .find(|(_, absence)| (absence.place_px - place).norm() < 1.5)
            .map(|(_, absence)| absence.reason.clone());
        format!(
            "{} {truth:?} at {:.0} degrees, {:.1} x {:.1} px, signal {:.0}, near {:?}: {near:?} {refused:?} {absent:?}",
            image.file.path,
            dot.incidence_deg,
            dot.major_px,
            dot.minor_px,
            self.signal(id, dot),
            dot.near_px
        )
    }
}

fn things(object: &Object) -> Things {
    let mut things = Things::default();
    for code in &object.codes {
        for (place, spot) in code.dots.iter().enumerate() {
            add(&mut things, format!("C{}.{place}", code.id), spot, DOT_MM);
        }
    }
    for (index, spot) in object.targets.iter().enumerate() {
        add(&mut things, format!("T{index}"), spot, DOT_MM);
    }
    things
}

fn add(things: &mut Things, label: String, spot: &Spot, diameter: f64) {
    let across = if spot.normal.x.abs() < 0.7 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let y = spot.normal.cross(&across).normalize();
    let placement = Placement {
        origin: spot.place,
        x: y.cross(&spot.normal),
        y,
    };
    things.add_disc(label, placement, diameter);
}

/// Dots that one picture alone shows: beside true ones, of other sizes and tilts.
fn add_false(things: &mut Things, scene: &Scene, pose: &Pose, seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let count = (scene.object.targets.len() as f64 * scene.recipe.false_share) as usize;
    for index in 0..count {
        let beside = &scene.object.targets[random.random_range(0..scene.object.targets.len())];
        let away = (pose.centre_in_world - beside.place).normalize();
        let tilt = Vector3::from_fn(|_, _| random.random_range(-0.6..0.6));
        let shift = Vector3::from_fn(|_, _| random.random_range(-1.0..1.0)) * 8.0 * DOT_MM;
        let spot = Spot {
            place: beside.place + shift,
            normal: (away + tilt).normalize(),
        };
        let diameter = DOT_MM * random.random_range(0.7..1.3);
        add(things, format!("F{index}"), &spot, diameter);
    }
}

fn truth_of(label: &str) -> Truth {
    let number = |text: &str| text.parse().unwrap_or_default();
    match label.split_at(1) {
        ("T", rest) => Truth::Plain(number(rest)),
        ("C", rest) => {
            let (code, place) = rest.split_once('.').unwrap_or((rest, "0"));
            Truth::Code(number(code) as u32, number(place))
        }
        _ => Truth::False,
    }
}
