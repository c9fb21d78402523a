//! A random measurement, as a table of observations or from pictures, with its truth.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

use nalgebra::Vector3;
use rand::seq::SliceRandom as _;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tiepoint::camera::Camera;
use tiepoint::geometry::{Circle, Pose};
use tiepoint::network::{
    CameraId, Code, DevicePoint, ImageEntry, ImageFile, ImageId, InteriorSource, Network, PointId,
};
use tiepoint::stages::adopt;
use tiepoint::synthetic::default_cross;
use tiepoint::targets::{Detections, Family};

use super::cameras::{Cameras, Grip};
use super::picture::Studio;
use super::readings::Shown;
use super::recipe::Recipe;
use super::table::View;
use super::world::{HEIGHT, WIDTH_MM, World};

/// Streams of a measurement's generator: all that one camera sees; the other cameras; what only pictures need.
const OTHER_CAMERAS: u64 = 1;
const PICTURES: u64 = 2;

/// A measurement with its truth.
pub(crate) struct Scene {
    pub(crate) number: u64,
    pub(crate) recipe: Recipe,
    pub(crate) network: Network,
    pub(crate) poses: BTreeMap<ImageId, Pose>,
    pub(crate) points: BTreeMap<PointId, Vector3<f64>>,
    /// The edges of the points' targets.
    pub(crate) circles: BTreeMap<PointId, Circle>,
    /// As they are in truth.
    pub(crate) cameras: BTreeMap<CameraId, Camera>,
    pub(crate) shown: BTreeMap<ImageId, Shown>,
}

/// A picture before it is taken.
pub(crate) struct Shot {
    pub(crate) id: ImageId,
    pub(crate) camera: Camera,
    pub(crate) camera_id: CameraId,
    pub(crate) pose: Pose,
    /// The moved code stands at its second place.
    pub(crate) is_late: bool,
}

/// A measurement before its pictures are taken.
pub(crate) struct Plan {
    pub(crate) number: u64,
    pub(crate) recipe: Recipe,
    pub(crate) world: World,
    /// In the order of the files.
    pub(crate) shots: Vec<Shot>,
    /// With the cameras, but without images.
    pub(crate) network: Network,
}

fn generator(number: u64, stream: u64) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(number);
    random.set_stream(stream);
    random
}

impl Scene {
    /// The measurement with this number as a table of observations.
    pub(crate) fn table(number: u64) -> Self {
        Self::table_with(number, |recipe| recipe)
    }

    /// The same after a change of the recipe.
    pub(crate) fn table_with(number: u64, change: impl FnOnce(Recipe) -> Recipe) -> Self {
        let mut random = generator(number, 0);
        let mut others = generator(number, OTHER_CAMERAS);
        let recipe = change(Recipe::of_one_camera(&mut random).with_cameras(&mut others));
        Self::observed(
            Plan::of(number, recipe, &mut random, &mut others),
            &mut random,
        )
    }

    /// The same with one camera and no picture in portrait.
    pub(crate) fn table_of_one_camera(number: u64) -> Self {
        let mut random = generator(number, 0);
        let recipe = Recipe::of_one_camera(&mut random);
        let plan = Plan::of(
            number,
            recipe,
            &mut random,
            &mut generator(number, OTHER_CAMERAS),
        );
        Self::observed(plan, &mut random)
    }

    /// The measurement with this number from rendered pictures.
    pub(crate) fn pictures(number: u64) -> Self {
        Self::pictures_with(number, |recipe| recipe)
    }

    /// The same after a change of the recipe.
    pub(crate) fn pictures_with(number: u64, change: impl FnOnce(Recipe) -> Recipe) -> Self {
        let mut random = generator(number, 0);
        let mut others = generator(number, OTHER_CAMERAS);
        let recipe = change(Recipe::of_one_camera(&mut random).with_cameras(&mut others));
        let mut plan = Plan::of(number, recipe, &mut random, &mut others);
        let mut random = generator(number, PICTURES);
        let studio = Studio::of(&mut plan, &mut random);
        let taken = studio.detected(&plan, &mut random);
        Self::of(plan, taken)
    }

    fn observed(mut plan: Plan, random: &mut ChaCha8Rng) -> Self {
        let mut taken = Vec::new();
        for shot in &plan.shots {
            let moved = plan.recipe.moved_code && shot.is_late;
            plan.world.codes_moved(moved);
            let view = View {
                recipe: &plan.recipe,
                camera: &shot.camera,
                pose: &shot.pose,
                world: &plan.world,
            };
            taken.push(view.detected(moved.then(|| plan.world.codes[0].id), random));
        }
        Self::of(plan, taken)
    }

    /// What was taken, in the order of the shots, as a measurement.
    fn of(plan: Plan, taken: Vec<(Detections, Shown)>) -> Self {
        let Plan {
            number,
            recipe,
            mut world,
            shots,
            mut network,
        } = plan;
        let (mut poses, mut shown) = (BTreeMap::new(), BTreeMap::new());
        for (shot, (detections, seen)) in shots.iter().zip(taken) {
            let mut image = shot.image();
            adopt(&mut image, detections);
            Arc::make_mut(&mut network.images).insert(shot.id, Arc::new(image));
            poses.insert(shot.id, shot.pose);
            shown.insert(shot.id, seen);
        }
        network.inputs += 1;
        world.codes_moved(false);
        Self {
            number,
            cameras: shots
                .iter()
                .map(|shot| (shot.camera_id, shot.camera.clone()))
                .collect(),
            circles: world.circles(&recipe),
            points: world.points(&recipe),
            recipe,
            network,
            poses,
            shown,
        }
    }

    /// The images that must be oriented: every one shares enough true codes with the others of the largest block that grows from
    /// one pair. Where no principal distance is told, fewer than four images cannot tell it.
    pub(crate) fn required(&self) -> BTreeSet<ImageId> {
        /// Images that tell a principal distance of which nothing is known.
        const IMAGES_TO_SEARCH: usize = 4;
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
        let mut cameras = self.network.cameras.values();
        if cameras.any(|camera| camera.source == InteriorSource::Unknown)
            && best.len() < IMAGES_TO_SEARCH
        {
            best.clear();
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

impl Plan {
    pub(crate) fn of(
        number: u64,
        recipe: Recipe,
        random: &mut ChaCha8Rng,
        others: &mut ChaCha8Rng,
    ) -> Self {
        let cameras = Cameras::of(&recipe, random, others);
        let world = World::of(&recipe, random);
        let poses: Vec<Pose> = (0..recipe.images)
            .map(|taken| station(&recipe, cameras.body(taken), random))
            .collect();
        let mut network = Network::default();
        Arc::make_mut(&mut network.settings).families = vec![recipe.family];
        if recipe.cross {
            network.device = Arc::new(default_cross().iter().map(DevicePoint::from).collect());
        }
        // The order of the files says nothing.
        let mut order: Vec<usize> = (0..poses.len()).collect();
        order.shuffle(random);
        // As the program takes files in: the first one of its kind makes a camera.
        let mut known: BTreeMap<Grip, CameraId> = BTreeMap::new();
        let mut shots = Vec::new();
        for (place, &taken) in order.iter().enumerate() {
            let grip = cameras.grip(taken);
            let next = CameraId(known.len() as u32 + 1);
            let camera_id = *known.entry(grip).or_insert_with(|| {
                let told = Arc::new(cameras.told(grip));
                Arc::make_mut(&mut network.cameras).insert(next, told);
                next
            });
            shots.push(Shot {
                id: ImageId(place as u32 + 1),
                camera: cameras.of_file(grip),
                camera_id,
                pose: poses[taken],
                is_late: 2 * taken >= poses.len(),
            });
        }
        Self {
            number,
            recipe,
            world,
            shots,
            network,
        }
    }
}

impl Shot {
    /// Its image before detection.
    pub(crate) fn image(&self) -> ImageEntry {
        let file = ImageFile {
            path: format!("image{:02}.png", self.id.0),
            size_bytes: 0,
            sha256: String::new(),
            width_px: self.camera.width_px,
            height_px: self.camera.height_px,
        };
        ImageEntry::new(file, self.camera_id)
    }
}

/// A picture that shows the object from anywhere before it, with the long side of the sensor.
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
