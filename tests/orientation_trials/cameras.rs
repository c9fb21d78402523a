//! The cameras of a random measurement, and which of them takes which picture.

use std::collections::BTreeMap;

use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use tiepoint::camera::{Camera, InteriorOrientation};
use tiepoint::network::{CameraEntry, InteriorSource};

use super::recipe::{Recipe, Told};

/// Images that tell a principal distance of which nothing is known.
const IMAGES_TO_SEARCH: usize = 4;

/// The corner of a picture of three to two, as a share of its half width.
const CORNER_OF_HALF_WIDTH: f64 = 1.2;

/// Farthest that the principal point is from the middle, in either direction, mm.
pub(crate) const PRINCIPAL_POINT_MM: f64 = 0.15;

/// Least and most distortion of the first order in the corner, as a share of the radius.
pub(crate) const RADIAL_SHARES: [f64; 2] = [-0.010, 0.004];

/// How a picture is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Grip {
    pub(crate) lens: usize,
    /// The file is turned upright: its width is the sensor's height.
    pub(crate) is_portrait: bool,
}

/// The true cameras, and what is told of them.
pub(crate) struct Cameras {
    lenses: Vec<(Camera, Told)>,
    /// Of every picture, in the order in which they are taken.
    grips: Vec<Grip>,
}

impl Cameras {
    /// The first camera from the first generator, all others and who takes what from the second.
    pub(crate) fn of(recipe: &Recipe, random: &mut ChaCha8Rng, others: &mut ChaCha8Rng) -> Self {
        let mut lenses = vec![(true_camera(random), recipe.told)];
        if let Some(second) = &recipe.second_camera {
            lenses.push((true_camera(others), second.told));
        }
        let mut grip = || Grip {
            lens: recipe
                .second_camera
                .map_or(0, |second| usize::from(others.random_bool(second.share))),
            is_portrait: others.random_bool(recipe.portrait),
        };
        let grips: Vec<Grip> = (0..recipe.images).map(|_| grip()).collect();
        let mut images: BTreeMap<Grip, usize> = BTreeMap::new();
        for grip in &grips {
            *images.entry(*grip).or_default() += 1;
        }
        // A turned file makes a camera of its own, so that one body may need four images twice.
        for (index, (_, told)) in lenses.iter_mut().enumerate() {
            let mut own = images.iter().filter(|(grip, _)| grip.lens == index);
            if *told == Told::Unknown && own.any(|(_, count)| *count < IMAGES_TO_SEARCH) {
                *told = Told::Wrong {
                    source: InteriorSource::Exif,
                    by: others.random_range(-0.1..0.1),
                };
            }
        }
        Self { lenses, grips }
    }

    /// The sensor that takes a picture, as it is built into its body.
    pub(crate) fn body(&self, taken: usize) -> &Camera {
        &self.lenses[self.grips[taken].lens].0
    }

    pub(crate) fn grip(&self, taken: usize) -> Grip {
        self.grips[taken]
    }

    /// The camera whose picture the file shows.
    pub(crate) fn of_file(&self, grip: Grip) -> Camera {
        let body = &self.lenses[grip.lens].0;
        if grip.is_portrait {
            turned(body)
        } else {
            body.clone()
        }
    }

    /// What the operator has of a camera: no distortion, perhaps a wrong principal distance, perhaps none.
    pub(crate) fn told(&self, grip: Grip) -> CameraEntry {
        let camera = self.of_file(grip);
        let c = camera.interior.principal_distance;
        let (source, c) = match self.lenses[grip.lens].1 {
            Told::Wrong { source, by } => (source, c * (1.0 + by)),
            // What the program guesses where nothing is known: the width of the file.
            Told::Unknown => (
                InteriorSource::Unknown,
                f64::from(camera.width_px) * camera.pixel_pitch_mm,
            ),
        };
        let nominal = Camera {
            interior: InteriorOrientation::pinhole(c),
            ..camera
        };
        CameraEntry {
            name: format!("trial {}", grip.lens + 1),
            camera: nominal.clone(),
            nominal,
            known_sigmas: [None; 10],
            parameters: Default::default(),
            stated: Default::default(),
            source,
            exif_model: None,
        }
    }
}

/// A lens between wide and short telephoto with the distortion of a real one.
fn true_camera(random: &mut ChaCha8Rng) -> Camera {
    let pitch = 0.009;
    let (width, height) = (3072, 2048);
    let half_width = 0.5 * f64::from(width) * pitch;
    let c = half_width * random.random_range(1.3..2.6);
    let [barrel, cushion] = RADIAL_SHARES;
    let corner = half_width * CORNER_OF_HALF_WIDTH;
    let radial = random.random_range(barrel..cushion) / corner.powi(2);
    let mut interior = InteriorOrientation::pinhole(c);
    interior.radial = [radial, -0.1 * radial / corner.powi(2), 0.0];
    interior.principal_point = [
        random.random_range(-PRINCIPAL_POINT_MM..PRINCIPAL_POINT_MM),
        random.random_range(-PRINCIPAL_POINT_MM..PRINCIPAL_POINT_MM),
    ];
    Camera {
        width_px: width,
        height_px: height,
        pixel_pitch_mm: pitch,
        interior,
    }
}

/// Where the distortion is stated, mm from the middle.
pub(crate) fn corner_mm(camera: &Camera) -> f64 {
    let width = camera.width_px.max(camera.height_px);
    0.5 * f64::from(width) * camera.pixel_pitch_mm * CORNER_OF_HALF_WIDTH
}

/// The camera of files that are turned by a quarter counter-clockwise.
fn turned(camera: &Camera) -> Camera {
    let [x, y] = camera.interior.principal_point;
    Camera {
        width_px: camera.height_px,
        height_px: camera.width_px,
        interior: InteriorOrientation {
            principal_point: [-y, x],
            ..camera.interior
        },
        ..camera.clone()
    }
}
