//! A random field of targets as a table of observations, with its truth.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use nalgebra::Vector3;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tiepoint::camera::{Camera, InteriorOrientation};
use tiepoint::geometry::Pose;
use tiepoint::network::{
    CameraEntry, CameraId, ImageEntry, ImageFile, ImageId, InteriorSource, Network,
};
use tiepoint::stages::adopt;
use tiepoint::targets::Family;

use super::object::Object;
use super::recipe::{Form, Recipe};
use super::table::{Truth, View};

/// A measurement with its truth.
pub(crate) struct Scene {
    pub(crate) number: u64,
    pub(crate) recipe: Recipe,
    pub(crate) network: Network,
    /// What every dot of every image is.
    pub(crate) truth: BTreeMap<ImageId, Vec<Truth>>,
    pub(crate) object: Object,
    pub(crate) camera: Camera,
    pub(crate) poses: BTreeMap<ImageId, Pose>,
}

impl Scene {
    /// The measurement of this number.
    pub(crate) fn numbered(number: u64) -> Self {
        Self::with(number, |recipe| recipe)
    }

    /// The same after a change of the recipe.
    pub(crate) fn with(number: u64, change: impl FnOnce(Recipe) -> Recipe) -> Self {
        let recipe = change(Recipe::numbered(number));
        let mut random = ChaCha8Rng::seed_from_u64(number);
        random.set_stream(1);
        let random = &mut random;
        let object = Object::of(&recipe, random);
        let camera = true_camera(random);
        let mut network = Network::default();
        Arc::make_mut(&mut network.settings).families = vec![Family::Dot420];
        let id = CameraId(1);
        Arc::make_mut(&mut network.cameras).insert(id, Arc::new(told(&camera, random)));
        let (mut truth, mut poses) = (BTreeMap::new(), BTreeMap::new());
        for index in 0..recipe.stations {
            let pose = station(&recipe, &object, &camera, index, random);
            let view = View {
                recipe: &recipe,
                object: &object,
                camera: &camera,
                pose: &pose,
            };
            let (detections, what) = view.detected(random);
            let image_id = ImageId(index as u32 + 1);
            let file = ImageFile {
                path: format!("image{:03}.png", image_id.0),
                size_bytes: 0,
                sha256: String::new(),
                width_px: camera.width_px,
                height_px: camera.height_px,
            };
            let mut image = ImageEntry::new(file, id);
            adopt(&mut image, detections);
            Arc::make_mut(&mut network.images).insert(image_id, Arc::new(image));
            truth.insert(image_id, what);
            poses.insert(image_id, pose);
        }
        network.inputs += 1;
        Self {
            number,
            recipe,
            network,
            truth,
            object,
            camera,
            poses,
        }
    }
}

/// A lens between wide and short telephoto with the distortion of a real one.
fn true_camera(random: &mut ChaCha8Rng) -> Camera {
    let pitch = 0.009;
    let (width, height) = (3072, 2048);
    let half_width = 0.5 * f64::from(width) * pitch;
    let corner = 1.2 * half_width;
    let radial = random.random_range(-0.010..0.004) / corner.powi(2);
    let mut interior = InteriorOrientation::pinhole(half_width * random.random_range(1.3..2.6));
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

/// What the operator has of it: a principal distance that is off by up to a per cent.
fn told(camera: &Camera, random: &mut ChaCha8Rng) -> CameraEntry {
    let c = camera.interior.principal_distance * (1.0 + random.random_range(-0.01..0.01));
    let nominal = Camera {
        interior: InteriorOrientation::pinhole(c),
        ..camera.clone()
    };
    CameraEntry {
        name: "trial".into(),
        camera: nominal.clone(),
        nominal,
        known_sigmas: [None; 10],
        parameters: Default::default(),
        stated: Default::default(),
        source: InteriorSource::CameraFile,
        exif_model: None,
    }
}

/// A picture of the object from where its faces are seen.
fn station(
    recipe: &Recipe,
    object: &Object,
    camera: &Camera,
    index: usize,
    random: &mut ChaCha8Rng,
) -> Pose {
    let seen = random.random_range(recipe.shown[0]..recipe.shown[1]) * object.width;
    let width = f64::from(camera.width_px) * camera.pixel_pitch_mm;
    let distance = seen * camera.interior.principal_distance / width;
    // The golden angle spreads stations evenly, whatever their number.
    let azimuth = index as f64 * 2.399_963 + random.random_range(-0.2..0.2);
    let tilt: f64 = match recipe.form {
        Form::Box => random.random_range(0.35..1.05),
        _ => random.random_range(0.1..0.9),
    };
    let away = match recipe.form {
        Form::Cylinder => {
            let round: f64 = random.random_range(-0.9..0.9);
            let up = 0.5 * (azimuth.sin());
            Vector3::new(round.sin(), up, round.cos()).normalize()
        }
        _ => Vector3::new(
            tilt.sin() * azimuth.cos(),
            tilt.sin() * azimuth.sin(),
            tilt.cos(),
        ),
    };
    let room = (1.1 * object.width - seen).max(0.05 * object.width);
    let middle = match recipe.form {
        Form::Box => Vector3::new(0.0, 0.0, -0.2 * object.width),
        Form::Cylinder => Vector3::new(0.0, 0.0, -0.25 * object.width),
        _ => Vector3::zeros(),
    };
    let distance = match recipe.form {
        Form::Box => distance * 1.15,
        _ => distance,
    };
    let aim = middle
        + Vector3::new(
            random.random_range(-0.35..0.35) * room,
            random.random_range(-0.35..0.35) * room / 1.4,
            0.0,
        );
    let roll = f64::from(random.random_range(0..4)) * FRAC_PI_2 + random.random_range(-0.2..0.2);
    let up = if away.z > 0.97 {
        Vector3::y()
    } else {
        Vector3::z()
    };
    Pose::looking_at(aim + away * distance, aim, up, roll)
}
