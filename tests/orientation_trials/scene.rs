//! A random measurement as a table of observations, with its truth.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

use nalgebra::{Rotation3, Vector2, Vector3};
use rand::seq::SliceRandom as _;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tiepoint::camera::{Camera, InteriorOrientation};
use tiepoint::geometry::Pose;
use tiepoint::network::{
    CameraEntry, CameraId, Code, DevicePoint, ImageEntry, ImageFile, ImageId, InteriorSource,
    Network, PointId,
};
use tiepoint::stages::adopt;
use tiepoint::synthetic::default_cross;
use tiepoint::targets::{
    CodeEvidence, CodeReading, DOT420_AXES, Detections, Dot, DotIndex, Family, dot420_table,
};

use super::recipe::{Recipe, Told, WrongCodes};

/// Width of the object, mm.
const WIDTH_MM: f64 = 1500.0;
/// Its height as a share of the width.
const HEIGHT: f64 = 0.7;
const PITCH_MM: f64 = 5.0;
/// Steeper targets are not seen.
const STEEPEST: f64 = 70.0;
/// Dots nearer to the border are not found, px.
const BORDER_PX: f64 = 12.0;
/// A wrong code stands for a moved one by so much, mm.
const MOVED_MM: f64 = 120.0;

/// A measurement with its truth.
pub(crate) struct Scene {
    pub(crate) number: u64,
    pub(crate) recipe: Recipe,
    pub(crate) network: Network,
    pub(crate) poses: BTreeMap<ImageId, Pose>,
    pub(crate) points: BTreeMap<PointId, Vector3<f64>>,
    /// Codes that are read rightly, and how many readings are not, by image.
    pub(crate) shown: BTreeMap<ImageId, Shown>,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Shown {
    pub(crate) right: BTreeSet<Code>,
    pub(crate) wrong: usize,
    pub(crate) cross: bool,
}

/// A code in the world.
struct PlacedCode {
    id: u32,
    origin: Vector3<f64>,
    /// Unit vectors of its plane and normal.
    axes: [Vector3<f64>; 3],
}

impl PlacedCode {
    fn dots(&self, family: Family) -> Vec<Vector3<f64>> {
        match family {
            Family::Ring(_) => vec![self.origin],
            Family::Dot420 => DOT420_AXES
                .iter()
                .chain(&dot420_table()[self.id as usize - 1])
                .map(|[x, y]| {
                    self.origin
                        + (self.axes[0] * f64::from(x - 3) + self.axes[1] * f64::from(y - 3))
                            * PITCH_MM
                })
                .collect(),
        }
    }
}

impl Scene {
    /// The measurement with this number.
    pub(crate) fn any(number: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(number);
        let recipe = Recipe::any(&mut random);
        Self::of(number, recipe, &mut random)
    }

    pub(crate) fn of(number: u64, recipe: Recipe, random: &mut ChaCha8Rng) -> Self {
        let camera = true_camera(random);
        let mut world = World::of(&recipe, random);
        let poses: Vec<Pose> = (0..recipe.images)
            .map(|_| station(&recipe, &camera, random))
            .collect();
        let mut network = Network::default();
        Arc::make_mut(&mut network.settings).families = vec![recipe.family];
        if recipe.cross {
            network.device = Arc::new(default_cross().iter().map(DevicePoint::from).collect());
        }
        let told = told_camera(&camera, recipe.told);
        Arc::make_mut(&mut network.cameras).insert(CameraId(1), Arc::new(told));
        // The order of the files says nothing.
        let mut order: Vec<usize> = (0..poses.len()).collect();
        order.shuffle(random);
        let (mut placed, mut shown) = (BTreeMap::new(), BTreeMap::new());
        for (place, &taken) in order.iter().enumerate() {
            let id = ImageId(place as u32 + 1);
            let is_late = 2 * taken >= poses.len();
            world.codes_moved(recipe.moved_code && is_late);
            let view = View {
                recipe: &recipe,
                camera: &camera,
                pose: &poses[taken],
                world: &world,
            };
            let (detections, seen) = view.detected(recipe.moved_code && is_late, random);
            let mut image = ImageEntry::new(file_of(id, &camera), CameraId(1));
            adopt(&mut image, detections);
            Arc::make_mut(&mut network.images).insert(id, Arc::new(image));
            placed.insert(id, poses[taken]);
            shown.insert(id, seen);
        }
        network.inputs += 1;
        world.codes_moved(false);
        Self {
            number,
            points: world.points(&recipe),
            recipe,
            network,
            poses: placed,
            shown,
        }
    }

    /// The images that must be oriented: every one shares enough true codes with the others of the largest block that grows from
    /// one pair.
    pub(crate) fn required(&self) -> BTreeSet<ImageId> {
        let is_ring = self.recipe.family != Family::Dot420;
        let enough = |shared: usize, wrong: usize| {
            if is_ring {
                shared >= 5 && shared >= wrong + 2
            } else {
                shared >= 3
            }
        };
        let ids: Vec<ImageId> = self.shown.keys().copied().collect();
        let mut best = BTreeSet::new();
        for (index, first) in ids.iter().enumerate() {
            for second in &ids[index + 1..] {
                let [a, b] = [first, second].map(|id| &self.shown[id]);
                let shared = a.right.intersection(&b.right).count();
                let by_cross = a.cross && b.cross;
                // Five points alone leave ten relative orientations, and each fits.
                let starts = enough(shared, a.wrong.max(b.wrong))
                    && (!is_ring || by_cross || shared >= 8 + a.wrong + b.wrong);
                if !starts || best.contains(first) && best.contains(second) {
                    continue;
                }
                let grown = self.grown([*first, *second], &enough);
                if grown.len() > best.len() {
                    best = grown;
                }
            }
        }
        best
    }

    fn grown(
        &self,
        pair: [ImageId; 2],
        enough: &impl Fn(usize, usize) -> bool,
    ) -> BTreeSet<ImageId> {
        let mut images: BTreeSet<ImageId> = pair.into();
        loop {
            let mut seen: BTreeMap<Code, usize> = BTreeMap::new();
            for code in images.iter().flat_map(|id| &self.shown[id].right) {
                *seen.entry(*code).or_default() += 1;
            }
            let next = self.shown.iter().find(|(id, shown)| {
                let known = shown
                    .right
                    .iter()
                    .filter(|c| seen.get(c).is_some_and(|n| *n >= 2));
                !images.contains(id) && enough(known.count(), shown.wrong)
            });
            match next {
                Some((id, _)) => images.insert(*id),
                None => return images,
            };
        }
    }
}

fn file_of(id: ImageId, camera: &Camera) -> ImageFile {
    ImageFile {
        path: format!("image{:02}.png", id.0),
        size_bytes: 0,
        sha256: String::new(),
        width_px: camera.width_px,
        height_px: camera.height_px,
    }
}

/// A lens between wide and short telephoto with the distortion of a real one.
fn true_camera(random: &mut ChaCha8Rng) -> Camera {
    let pitch = 0.009;
    let (width, height) = (3072, 2048);
    let half_width = 0.5 * f64::from(width) * pitch;
    let c = half_width * random.random_range(1.3..2.6);
    let corner = half_width * 1.2;
    // Barrel distortion up to one per cent of the radius in the corner.
    let radial = random.random_range(-0.010..0.004) / corner.powi(2);
    let mut interior = InteriorOrientation::pinhole(c);
    interior.radial = [radial, -0.1 * radial / corner.powi(2), 0.0];
    interior.principal_point = [
        random.random_range(-0.15..0.15),
        random.random_range(-0.15..0.15),
    ];
    Camera {
        width_px: width,
        height_px: height,
        pixel_pitch_mm: pitch,
        interior,
    }
}

/// What the operator has of the camera: no distortion, perhaps a wrong principal distance, perhaps none.
fn told_camera(camera: &Camera, told: Told) -> CameraEntry {
    let c = camera.interior.principal_distance;
    let (source, c) = match told {
        Told::Wrong { source, by } => (source, c * (1.0 + by)),
        // What the program guesses where nothing is known: the longer side of the picture.
        Told::Unknown => (
            InteriorSource::Unknown,
            f64::from(camera.width_px) * camera.pixel_pitch_mm,
        ),
    };
    let nominal = Camera {
        interior: InteriorOrientation::pinhole(c),
        ..camera.clone()
    };
    CameraEntry {
        name: "trial".into(),
        camera: nominal.clone(),
        nominal,
        known_sigmas: [None; 10],
        source,
        exif_model: None,
    }
}

/// A picture that shows the object from anywhere before it.
fn station(recipe: &Recipe, camera: &Camera, random: &mut ChaCha8Rng) -> Pose {
    let shown = random.random_range(recipe.shown[0]..recipe.shown[1]) * WIDTH_MM;
    let width = f64::from(camera.width_px) * camera.pixel_pitch_mm;
    let distance = shown * camera.interior.principal_distance / width;
    let tilt = random.random_range(0.1..recipe.obliqueness);
    let azimuth = random.random_range(0.0..TAU);
    let away = Vector3::new(
        tilt.sin() * azimuth.cos(),
        tilt.sin() * azimuth.sin(),
        tilt.cos(),
    );
    // Where less than the whole object is shown, the pictures look at its parts.
    let room = (1.1 * WIDTH_MM - shown).max(0.05 * WIDTH_MM);
    let aim = Vector3::new(
        random.random_range(-0.5..0.5) * room,
        random.random_range(-0.5..0.5) * room * HEIGHT,
        0.0,
    );
    let quarter = if recipe.rolls {
        random.random_range(0..4)
    } else {
        0
    };
    let roll = f64::from(quarter) * FRAC_PI_2 + random.random_range(-0.2..0.2);
    let centre = aim + away * distance;
    Pose::looking_at(centre, aim, Vector3::y(), roll)
}

/// Everything that carries dots.
struct World {
    codes: Vec<PlacedCode>,
    /// The first code's place, and where it stands in the later pictures.
    places: [Vector3<f64>; 2],
    plain: Vec<Vector3<f64>>,
    cross: Vec<(PointId, Vector3<f64>)>,
    /// Numbers that no code of the object has.
    free: Vec<u32>,
}

impl World {
    fn of(recipe: &Recipe, random: &mut ChaCha8Rng) -> Self {
        let mut ids: Vec<u32> = (1..=recipe.family.code_count()).collect();
        ids.shuffle(random);
        let free = ids.split_off(recipe.codes);
        // Nothing overlaps: the nearest of several tries is farthest from all.
        let mut places: Vec<Vector2<f64>> = vec![Vector2::zeros()];
        let mut place = |random: &mut ChaCha8Rng| {
            let tries = (0..12).map(|_| {
                Vector2::new(
                    random.random_range(-0.5..0.5),
                    random.random_range(-0.5..0.5) * HEIGHT,
                ) * WIDTH_MM
            });
            let room = |p: &Vector2<f64>| {
                let away = places.iter().map(|q| (p - q).norm());
                away.fold(f64::INFINITY, f64::min)
            };
            let best = tries
                .max_by(|a, b| room(a).total_cmp(&room(b)))
                .expect("some tries");
            places.push(best);
            best
        };
        // A smooth surface with steps, as a block with parts on it.
        let phases: [f64; 4] = std::array::from_fn(|_| random.random_range(0.0..TAU));
        let height = |p: &Vector2<f64>, step: f64| {
            let waves = (p.x / 260.0 + phases[0]).sin() * (p.y / 190.0 + phases[1]).sin();
            recipe.relief * WIDTH_MM * (0.4 * (1.0 + waves) + 0.2 * step)
        };
        let codes: Vec<PlacedCode> = ids
            .iter()
            .map(|&id| {
                let at = place(random);
                let step = random.random_range(0.0..1.0);
                let lean = if recipe.relief > 0.0 {
                    Vector3::new(
                        random.random_range(-0.35..0.35),
                        random.random_range(-0.35..0.35),
                        0.0,
                    )
                } else {
                    Vector3::zeros()
                };
                let turn = Rotation3::new(lean)
                    * Rotation3::from_axis_angle(&Vector3::z_axis(), random.random_range(0.0..TAU));
                PlacedCode {
                    id,
                    origin: Vector3::new(at.x, at.y, height(&at, step)),
                    axes: [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| turn * axis),
                }
            })
            .collect();
        let plain = (0..recipe.plain_targets)
            .map(|_| {
                let at = place(random);
                let step = random.random_range(0.0..1.0);
                Vector3::new(at.x, at.y, height(&at, step))
            })
            .collect();
        let lift = Vector3::new(0.0, 0.0, recipe.relief * WIDTH_MM * 0.5);
        let cross = if recipe.cross {
            default_cross()
                .iter()
                .enumerate()
                .map(|(k, p)| (PointId::Device(k as u16), Vector3::from(p.point) + lift))
                .collect()
        } else {
            Vec::new()
        };
        let first = codes[0].origin;
        let direction = random.random_range(0.0..TAU);
        let moved = first + Vector3::new(direction.cos(), direction.sin(), 0.0) * MOVED_MM;
        Self {
            codes,
            places: [first, moved],
            plain,
            cross,
            free,
        }
    }

    fn codes_moved(&mut self, moved: bool) {
        self.codes[0].origin = self.places[usize::from(moved)];
    }

    fn points(&self, recipe: &Recipe) -> BTreeMap<PointId, Vector3<f64>> {
        let mut points: BTreeMap<PointId, Vector3<f64>> = self.cross.iter().copied().collect();
        for code in &self.codes {
            let names = PointId::of_code(recipe.family, code.id);
            points.extend(names.into_iter().zip(code.dots(recipe.family)));
        }
        points
    }
}

/// One picture of the world.
struct View<'a> {
    recipe: &'a Recipe,
    camera: &'a Camera,
    pose: &'a Pose,
    world: &'a World,
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
        let px = self.camera.project(&self.pose.camera_from_point(point))?;
        let inside =
            |value: f64, size: u32| (BORDER_PX..f64::from(size) - BORDER_PX).contains(&value);
        if !(inside(px.x, self.camera.width_px) && inside(px.y, self.camera.height_px)) {
            return None;
        }
        let noise = self.recipe.noise_px;
        let centre_px = px + Vector2::new(normal_deviate(random), normal_deviate(random)) * noise;
        Some(Dot {
            centre_px,
            sigma_px: noise,
            major_px: 10.0,
            minor_px: 8.0,
            angle: 0.0,
            contrast: 120.0,
            background: 12.0,
        })
    }

    fn detected(&self, code_moved: bool, random: &mut ChaCha8Rng) -> (Detections, Shown) {
        let mut dots: Vec<Dot> = Vec::new();
        let mut readings: Vec<(u32, Vec<usize>)> = Vec::new();
        for code in &self.world.codes {
            let seen: Option<Vec<Dot>> = code
                .dots(self.recipe.family)
                .iter()
                .map(|dot| self.dot(dot, Some(&code.axes[2]), random))
                .collect();
            let Some(seen) = seen else { continue };
            let from = dots.len();
            dots.extend(seen);
            if !random.random_bool(self.recipe.unread) {
                readings.push((code.id, (from..dots.len()).collect()));
            }
        }
        let plain = dots.len();
        for point in &self.world.plain {
            dots.extend(self.dot(point, None, random));
        }
        let before = dots.len();
        for (_, point) in &self.world.cross {
            dots.extend(self.dot(point, None, random));
        }
        let cross = !self.world.cross.is_empty() && dots.len() == before + self.world.cross.len();
        let moved = self.world.codes[0].id;
        let true_codes: BTreeMap<Vec<usize>, u32> = readings
            .iter()
            .filter(|(id, _)| !(code_moved && *id == moved))
            .map(|(id, dots)| (dots.clone(), *id))
            .collect();
        let most = match self.recipe.wrong {
            WrongCodes::None => 0,
            WrongCodes::OneAnImage => 1,
            WrongCodes::Share(_) => readings.len() / 5,
        };
        self.spoil(&mut readings, most, plain..before, random);
        // By rows, as detection gives them: the order says nothing.
        let mut order: Vec<usize> = (0..dots.len()).collect();
        order.sort_by(|&a, &b| dots[a].centre_px.y.total_cmp(&dots[b].centre_px.y));
        let mut slots = vec![0; dots.len()];
        for (slot, &index) in order.iter().enumerate() {
            slots[index] = slot;
        }
        let mut shown = Shown {
            cross,
            ..Shown::default()
        };
        let mut codes: Vec<CodeReading> = Vec::new();
        for (id, of_code) in &readings {
            let twice = readings.iter().filter(|(other, _)| other == id).count() > 1;
            if true_codes.get(of_code) == Some(id) && !twice {
                shown.right.insert((self.recipe.family, *id));
            } else {
                shown.wrong += 1;
            }
            codes.push(CodeReading {
                family: self.recipe.family,
                id: *id,
                dots: of_code
                    .iter()
                    .map(|&dot| DotIndex(slots[dot] as u32))
                    .collect(),
                misfit: 0.1,
                doubt: None,
                evidence: CodeEvidence::default(),
            });
        }
        codes.sort_by_key(|code| (code.id, code.dots.clone()));
        let detections = Detections {
            width_px: self.camera.width_px,
            height_px: self.camera.height_px,
            dots: order.iter().map(|&index| dots[index].clone()).collect(),
            codes,
            ..Detections::default()
        };
        (detections, shown)
    }

    /// Makes readings wrong, each in one of the ways in which readings are.
    fn spoil(
        &self,
        readings: &mut Vec<(u32, Vec<usize>)>,
        most: usize,
        plain: std::ops::Range<usize>,
        random: &mut ChaCha8Rng,
    ) {
        let mut left = most;
        for index in 0..readings.len() {
            let hit = match self.recipe.wrong {
                WrongCodes::None => false,
                WrongCodes::OneAnImage => index + 1 == readings.len(),
                WrongCodes::Share(share) => random.random_bool(share),
            };
            if !hit || left == 0 {
                continue;
            }
            left -= 1;
            match random.random_range(0..4) {
                // A number that is nowhere else.
                0 => {
                    readings[index].0 =
                        self.world.free[random.random_range(0..self.world.free.len())];
                }
                // Two numbers exchanged.
                1 if left > 0 => {
                    left -= 1;
                    let other = random.random_range(0..readings.len());
                    let id = readings[index].0;
                    readings[index].0 = readings[other].0;
                    readings[other].0 = id;
                }
                // A plain target, or plain targets near each other, read as a code of the object.
                2 if plain.len() >= 6 => {
                    let count = readings[index].1.len();
                    let from = random.random_range(plain.start..=plain.end - count);
                    readings[index].1 = (from..from + count).collect();
                }
                // The number of another code of the object.
                _ => {
                    readings[index].0 =
                        self.world.codes[random.random_range(0..self.world.codes.len())].id;
                }
            }
        }
        // Two readings never share dots.
        let mut taken = BTreeSet::new();
        readings.retain(|(_, dots)| {
            let free = dots.iter().all(|dot| !taken.contains(dot));
            if free {
                taken.extend(dots.iter().copied());
            }
            free
        });
    }
}

/// A number of the standard normal distribution (Box and Muller, 1958).
fn normal_deviate(random: &mut ChaCha8Rng) -> f64 {
    let u: f64 = random.random_range(1e-300..1.0);
    let v: f64 = random.random_range(0.0..1.0);
    (-2.0 * u.ln()).sqrt() * (TAU * v).cos()
}
