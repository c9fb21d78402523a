//! A random measurement in rendered pictures: the object is built of dots that can be photographed, the program detects them.
//!
//! Of the recipe all holds but the noise of centres and the unread codes: they are what the pictures' grey values, the targets' sizes
//! and neighbours and the detection make them. What is read is held against the places where the true dots are imaged.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use nalgebra::{Vector2, Vector3};
use rand::RngExt as _;
use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;
use tiepoint::imaging::{BitDepth, GreyImage};
use tiepoint::monitor::Monitor;
use tiepoint::network::{DotFamily, ImageEntry, Network, Stage};
use tiepoint::stages::Pictures;
use tiepoint::synthetic::{Placement, RenderSettings, Scene as Object, Surface, default_cross};
use tiepoint::targets::{CodeReading, Detections, DotIndex, Family};

use super::readings::{Shown, most_wrong, spoil};
use super::recipe::{Recipe, WrongCodes};
use super::scene::{Plan, Shot};
use super::world::{HEIGHT, MOVED_MM, PlacedCode, WIDTH_MM, World};

/// Diameter of the dots where the picture shows most of the object, px.
const DOT_PX: std::ops::Range<f64> = 6.0..14.0;
/// Ring codes have more to show.
const RING_DOT_PX: std::ops::Range<f64> = 11.0..14.0;
/// Part of the object's face that its codes may take.
const FULLEST: f64 = 0.35;
/// A dot that is read stands so near to its true place, px.
const SAME_PX: f64 = 1.5;
/// Depth of the ground below the lowest target of a raised object, mm.
const GROUND_MM: f64 = -40.0;

/// What codes are physically wrong.
#[derive(Clone, Debug)]
enum Fraud {
    None,
    /// Another code with a number of the object.
    Twin(PlacedCode),
    /// Plain targets at different depths that, seen from one station, stand as the dots of a code.
    ChanceCodes(Vec<Vector3<f64>>),
}

/// The object as it is photographed, and the light.
pub(crate) struct Studio {
    fraud: Fraud,
    light: RenderSettings,
}

/// Radius of the free ground round a target, as a multiple of the dot's diameter.
fn room(family: Option<Family>) -> f64 {
    match family {
        // The corner dots stand 4.25 pitches from the middle, and foreign ones three pitches from them.
        Some(Family::Dot420) => 6.3,
        // The ring ends at 1.5.
        Some(Family::Ring(_)) => 2.2,
        None => 1.0,
    }
}

/// Where targets stand in the plan of the object, with their rooms.
#[derive(Default)]
struct Ground(Vec<(Vector2<f64>, f64)>);

impl Ground {
    fn is_free(&self, place: &Vector3<f64>, radius: f64) -> bool {
        let mut others = self.0.iter();
        others.all(|(other, taken)| (place.xy() - other).norm() >= radius + taken)
    }

    fn take(&mut self, place: &Vector3<f64>, radius: f64) {
        self.0.push((place.xy(), radius));
    }
}

impl Studio {
    /// Gives the targets of the plan a size that can be read and places where none covers another.
    pub(crate) fn of(plan: &mut Plan, random: &mut ChaCha8Rng) -> Self {
        let recipe = &plan.recipe;
        let widest = plan
            .shots
            .iter()
            .map(|shot| shot.camera.width_px.max(shot.camera.height_px));
        let mm_per_px = recipe.shown[1] * WIDTH_MM / f64::from(widest.max().unwrap_or(1));
        let wanted = match recipe.family {
            Family::Dot420 => random.random_range(DOT_PX),
            Family::Ring(_) => random.random_range(RING_DOT_PX),
        } * mm_per_px;
        let face = WIDTH_MM * WIDTH_MM * HEIGHT;
        let fits = (FULLEST * face / (PI * recipe.codes as f64)).sqrt() / room(Some(recipe.family));
        let dot_mm = wanted.min(fits);
        let world = &mut plan.world;
        world.pitch_mm = dot_mm;
        let mut ground = Ground::default();
        for (_, point) in &world.cross {
            ground.take(point, 1.5 * dot_mm);
        }
        settle(recipe, world, &mut ground, random);
        let settings = Arc::make_mut(&mut plan.network.settings);
        settings.targets.plain_dot_mm = dot_mm;
        settings.targets.families = vec![DotFamily {
            family: recipe.family,
            pitch_mm: dot_mm,
            dot_mm,
        }];
        let light = RenderSettings {
            peak_grey: random.random_range(70.0..230.0),
            blur_sigma_px: random.random_range(0.7..0.9),
            ..RenderSettings::default()
        };
        Self {
            fraud: fraud(plan, &mut ground, random),
            light,
        }
    }

    /// Takes the pictures, has the program detect the targets, and falsifies labels up to what the recipe says.
    pub(crate) fn detected(
        &self,
        plan: &Plan,
        random: &mut ChaCha8Rng,
    ) -> Vec<(Detections, Shown)> {
        let mut network = plan.network.clone();
        for shot in &plan.shots {
            Arc::make_mut(&mut network.images).insert(shot.id, Arc::new(shot.image()));
        }
        let mut codes_at = [plan.world.codes.clone(), plan.world.codes.clone()];
        for (codes, place) in codes_at.iter_mut().zip(plan.world.places) {
            codes[0].origin = place;
        }
        let objects = codes_at.each_ref().map(|codes| self.object(plan, codes));
        let camera = PicturesOnDemand {
            plan,
            objects: &objects,
            light: &self.light,
        };
        let found = detected(network, &camera);
        plan.shots
            .iter()
            .map(|shot| {
                let detections = found.images[&shot.id].detections.as_ref();
                let detections = detections.expect("rendered pictures are readable");
                let late = plan.recipe.moved_code && shot.is_late;
                let judged = Judged {
                    plan,
                    shot,
                    codes: &codes_at[usize::from(late)],
                    ambiguous: self.ambiguous(plan, late),
                };
                judged.spoiled(detections.as_ref().clone(), random)
            })
            .collect()
    }

    /// The moved code where it stands elsewhere than before, and the number that stands on the object twice: of the twins none is
    /// the right one.
    fn ambiguous(&self, plan: &Plan, late: bool) -> Vec<u32> {
        let moved = late.then(|| plan.world.codes[0].id);
        moved
            .into_iter()
            .chain(self.twin().map(|twin| twin.id))
            .collect()
    }

    fn twin(&self) -> Option<&PlacedCode> {
        match &self.fraud {
            Fraud::Twin(twin) => Some(twin),
            _ => None,
        }
    }

    fn object(&self, plan: &Plan, codes: &[PlacedCode]) -> Object {
        let Plan { recipe, world, .. } = plan;
        let (family, dot_mm) = (recipe.family, world.pitch_mm);
        let is_raised = recipe.relief > 0.0;
        let mut object = Object::default();
        let ground = Vector3::new(0.0, 0.0, if is_raised { GROUND_MM } else { 0.0 });
        object.surfaces.push(Surface::rectangle(
            &Placement::horizontal(ground),
            1.6 * WIDTH_MM,
            1.6 * WIDTH_MM * HEIGHT,
            14.0,
        ));
        for (index, code) in codes.iter().chain(self.twin()).enumerate() {
            let placement = placement_of(code);
            if is_raised {
                let side = match family {
                    Family::Dot420 => 8.0,
                    Family::Ring(_) => 3.4,
                } * dot_mm;
                let board = Surface::rectangle(&placement, side, side, 16.0);
                object.surfaces.push(board);
            }
            let labels_before = object.discs.len();
            match family {
                Family::Dot420 => {
                    let corner = placement.moved(-3.0 * dot_mm, -3.0 * dot_mm, 0.0);
                    object.add_dot420(code.id, &corner, dot_mm, dot_mm);
                }
                Family::Ring(segments) => object.add_ring(segments, code.id, placement, dot_mm),
            }
            // Labels are unique, also where a number is there twice.
            if index == codes.len() {
                for disc in &mut object.discs[labels_before..] {
                    disc.label.push_str(" twin");
                }
            }
        }
        let chance = match &self.fraud {
            Fraud::ChanceCodes(dots) => &dots[..],
            _ => &[],
        };
        for (number, place) in (1..).zip(world.plain.iter().chain(chance)) {
            object.add_disc(format!("T{number}"), Placement::horizontal(*place), dot_mm);
        }
        if let Some((_, first)) = world.cross.first() {
            let points = default_cross();
            let frame = Placement::horizontal(first - Vector3::from(points[0].point));
            object.add_cross(&points, &frame, dot_mm);
        }
        object
    }
}

fn placement_of(code: &PlacedCode) -> Placement {
    Placement {
        origin: code.origin,
        x: code.axes[0],
        y: code.axes[1],
    }
}

fn anywhere(random: &mut ChaCha8Rng) -> Vector2<f64> {
    Vector2::new(
        random.random_range(-0.5..0.5),
        random.random_range(-0.5..0.5) * HEIGHT,
    ) * WIDTH_MM
}

/// Moves what stands on other targets; plain targets without room are left out.
fn settle(recipe: &Recipe, world: &mut World, ground: &mut Ground, random: &mut ChaCha8Rng) {
    const TRIES: usize = 10_000;
    let radius = room(Some(recipe.family)) * world.pitch_mm;
    for index in 0..world.codes.len() {
        let mut place = world.codes[index].origin;
        for _ in 0..TRIES {
            if ground.is_free(&place, radius) {
                break;
            }
            let at = anywhere(random);
            place = Vector3::new(at.x, at.y, place.z);
        }
        assert!(
            ground.is_free(&place, radius),
            "codes take {FULLEST} of the face"
        );
        ground.take(&place, radius);
        world.codes[index].origin = place;
        if index == 0 && recipe.moved_code {
            let mut second = place;
            while !ground.is_free(&second, radius) {
                let direction = random.random_range(0.0..TAU);
                let far = random.random_range(1.0..2.0) * MOVED_MM;
                second = place + Vector3::new(direction.cos(), direction.sin(), 0.0) * far;
            }
            ground.take(&second, radius);
            world.places = [place, second];
        } else if index == 0 {
            world.places = [place; 2];
        }
    }
    let radius = room(None) * world.pitch_mm;
    world.plain.retain(|place| {
        let free = ground.is_free(place, radius);
        if free {
            ground.take(place, radius);
        }
        free
    });
}

/// Wrong codes that can be photographed, where the recipe has wrong ones; at most one a picture.
fn fraud(plan: &Plan, ground: &mut Ground, random: &mut ChaCha8Rng) -> Fraud {
    const TRIES: usize = 1000;
    let Plan { recipe, world, .. } = plan;
    if recipe.wrong == WrongCodes::None {
        return Fraud::None;
    }
    let radius = room(Some(recipe.family)) * world.pitch_mm;
    let free = |ground: &Ground, random: &mut ChaCha8Rng| {
        let places = (0..TRIES).map(|_| {
            let at = anywhere(random);
            Vector3::new(at.x, at.y, 0.0)
        });
        places
            .into_iter()
            .find(|place| ground.is_free(place, radius))
    };
    let model = &world.codes[random.random_range(0..world.codes.len())];
    if recipe.family != Family::Dot420 || random.random_bool(0.5) {
        return free(ground, random).map_or(Fraud::None, |place| {
            let origin = place + Vector3::new(0.0, 0.0, model.origin.z);
            Fraud::Twin(PlacedCode {
                origin,
                ..model.clone()
            })
        });
    }
    let stations = plan.shots.len().div_ceil(3);
    let dots = plan.shots[..stations].iter().flat_map(|shot| {
        let code = &world.codes[random.random_range(0..world.codes.len())];
        let Some(place) = free(ground, random) else {
            return Vec::new();
        };
        ground.take(&place, radius);
        let flat = PlacedCode {
            id: code.id,
            origin: place,
            axes: [Vector3::x(), Vector3::y(), Vector3::z()],
        };
        let eye = shot.pose.centre_in_world;
        let dots = flat.dots(recipe.family, world.pitch_mm);
        dots.into_iter()
            .map(|dot| dot + (eye - dot) * random.random_range(0.0..0.06))
            .collect()
    });
    Fraud::ChanceCodes(dots.collect())
}

/// Renders a picture when it is asked for.
struct PicturesOnDemand<'a> {
    plan: &'a Plan,
    /// With the moved code at its first and at its second place.
    objects: &'a [Object; 2],
    light: &'a RenderSettings,
}

impl Pictures for PicturesOnDemand<'_> {
    fn load(&self, image: &ImageEntry, _monitor: &Monitor) -> Result<GreyImage, String> {
        let shots = &self.plan.shots;
        let shot = shots
            .iter()
            .find(|shot| shot.image().file.path == image.file.path)
            .ok_or("no such picture")?;
        let moved = self.plan.recipe.moved_code && shot.is_late;
        let seed = self.plan.number * 1000 + u64::from(shot.id.0);
        let object = &self.objects[usize::from(moved)];
        let picture =
            tiepoint::synthetic::render(object, &shot.camera, &shot.pose, self.light, seed);
        let samples = picture.image.into_iter().map(u16::from).collect();
        GreyImage::new(
            picture.width_px,
            picture.height_px,
            BitDepth::Eight,
            samples,
        )
        .map_err(|error| error.to_string())
    }
}

/// The network after the stage that detects targets.
fn detected(mut network: Network, pictures: &PicturesOnDemand<'_>) -> Network {
    while let Some(step) = Stage::Detect.next(&network) {
        let advance = step.run(&network, pictures, &Monitor::new());
        network = advance.expect("nobody interrupts").network;
    }
    network
}

/// A picture with what it truly shows.
struct Judged<'a> {
    plan: &'a Plan,
    shot: &'a Shot,
    codes: &'a [PlacedCode],
    /// Numbers that are no code's own in this picture.
    ambiguous: Vec<u32>,
}

impl Judged<'_> {
    fn px(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let Shot { camera, pose, .. } = self.shot;
        camera.project(&pose.camera_from_point(point))
    }

    /// Whether dots are detected where these points are.
    fn is_at(&self, detections: &Detections, dots: &[DotIndex], points: &[Vector3<f64>]) -> bool {
        let near = |dot: &DotIndex, point: &Vector3<f64>| {
            let off = |px: Vector2<f64>| (detections.dots[dot.slot()].centre_px - px).norm();
            self.px(point).is_some_and(|px| off(px) < SAME_PX)
        };
        dots.len() == points.len() && dots.iter().zip(points).all(|(dot, point)| near(dot, point))
    }

    /// The readings that are of a code of the object, in its place.
    fn true_codes(&self, detections: &Detections) -> BTreeMap<Vec<DotIndex>, u32> {
        let Plan { recipe, world, .. } = self.plan;
        let is_true = |reading: &CodeReading| {
            let mut codes = self.codes.iter();
            !self.ambiguous.contains(&reading.id)
                && codes.any(|code| {
                    let dots = code.dots(recipe.family, world.pitch_mm);
                    code.id == reading.id && self.is_at(detections, &reading.dots, &dots)
                })
        };
        let readings = detections.codes.iter().filter(|reading| is_true(reading));
        readings.map(|r| (r.dots.clone(), r.id)).collect()
    }

    fn shows_cross(&self, detections: &Detections) -> bool {
        let cross = &self.plan.world.cross;
        let is_found = |point: &Vector3<f64>| {
            let slots = (0..detections.dots.len() as u32).map(DotIndex);
            let mut dots = slots;
            dots.any(|dot| self.is_at(detections, &[dot], &[*point]))
        };
        !cross.is_empty() && cross.iter().all(|(_, point)| is_found(point))
    }

    /// The detections with labels falsified until the recipe's share is wrong.
    fn spoiled(&self, mut detections: Detections, random: &mut ChaCha8Rng) -> (Detections, Shown) {
        let Plan { recipe, world, .. } = self.plan;
        let true_codes = self.true_codes(&detections);
        let cross = self.shows_cross(&detections);
        let by_detection = Shown::of(recipe.family, &detections.codes, &true_codes).wrong;
        let mut readings = std::mem::take(&mut detections.codes);
        let most = most_wrong(recipe.wrong, readings.len()).saturating_sub(by_detection);
        let is_plain = |dot: &DotIndex| !readings.iter().any(|r| r.dots.contains(dot));
        let slots = (0..detections.dots.len() as u32).map(DotIndex);
        let plain: Vec<DotIndex> = slots.filter(is_plain).collect();
        if most > 0 {
            readings.shuffle(random);
            spoil(&mut readings, recipe.wrong, most, world, &plain, random);
            readings.sort_by_key(|reading| (reading.id, reading.dots.clone()));
        }
        let shown = Shown {
            cross,
            wrong_by_detection: by_detection,
            ..Shown::of(recipe.family, &readings, &true_codes)
        };
        detections.codes = readings;
        (detections, shown)
    }
}
