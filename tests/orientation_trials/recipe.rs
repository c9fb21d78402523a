//! What a random measurement consists of.

use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use tiepoint::network::InteriorSource;
use tiepoint::targets::Family;

/// What is told of the principal distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Told {
    /// In a camera file or in EXIF, wrong by this share.
    Wrong { source: InteriorSource, by: f64 },
    /// Nothing.
    Unknown,
}

/// How readings are wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum WrongCodes {
    None,
    /// Each reading with this probability, never more than a fifth of an image's.
    Share(f64),
    /// One in every image.
    OneAnImage,
}

/// Sizes and conditions of a measurement.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Recipe {
    pub(crate) images: usize,
    pub(crate) family: Family,
    pub(crate) codes: usize,
    pub(crate) plain_targets: usize,
    /// Largest height above the base plane as a share of the object's width; zero: flat.
    pub(crate) relief: f64,
    pub(crate) cross: bool,
    pub(crate) told: Told,
    pub(crate) wrong: WrongCodes,
    /// A code stands elsewhere in the later pictures.
    pub(crate) moved_code: bool,
    /// Standard deviation of a centre, px.
    pub(crate) noise_px: f64,
    /// Part of the object's width that a picture shows.
    pub(crate) shown: [f64; 2],
    /// Probability that a code in sight is not read.
    pub(crate) unread: f64,
    /// Pictures are taken in four rolls instead of upright.
    pub(crate) rolls: bool,
    /// Largest angle of a picture's axis from the base plane's normal, radians.
    pub(crate) obliqueness: f64,
    pub(crate) second_camera: Option<SecondCamera>,
    /// Probability that a picture is taken in portrait and its file turned upright.
    pub(crate) portrait: f64,
}

/// Another lens beside the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SecondCamera {
    pub(crate) told: Told,
    /// Probability that a picture is taken with it.
    pub(crate) share: f64,
}

impl Recipe {
    /// With one camera, held upright or rolled, but never in portrait.
    pub(crate) fn of_one_camera(random: &mut ChaCha8Rng) -> Self {
        let images = log_uniform(random, 2.0, 61.0) as usize;
        let family = match random.random_range(0..10) {
            0..6 => Family::Dot420,
            6 => Family::Ring(12),
            7..9 => Family::Ring(14),
            _ => Family::Ring(20),
        };
        let least = if family == Family::Dot420 { 4.0 } else { 6.0 };
        let most = f64::from(family.code_count().min(100));
        let rolls = random.random_bool(0.7);
        Self {
            images,
            family,
            codes: log_uniform(random, least, most + 1.0) as usize,
            plain_targets: random.random_range(0..200),
            relief: if random.random_bool(0.4) {
                0.0
            } else {
                random.random_range(0.02..0.3)
            },
            cross: random.random_bool(0.5),
            told: told(images, random),
            wrong: match random.random_range(0..5) {
                0 | 1 => WrongCodes::None,
                2 => WrongCodes::OneAnImage,
                _ => WrongCodes::Share(random.random_range(0.0..0.2)),
            },
            moved_code: random.random_bool(0.15),
            noise_px: log_uniform(random, 0.02, 0.5),
            shown: if random.random_bool(0.5) {
                [0.9, 1.3]
            } else {
                [0.4, 1.0]
            },
            unread: random.random_range(0.0..0.3),
            rolls,
            obliqueness: random.random_range(25.0_f64..60.0).to_radians(),
            second_camera: None,
            portrait: 0.0,
        }
    }

    /// A quarter of the measurements with a second camera, a fifth with pictures in portrait.
    pub(crate) fn with_cameras(self, random: &mut ChaCha8Rng) -> Self {
        let second_camera = random.random_bool(0.25).then(|| SecondCamera {
            told: told(self.images, random),
            share: random.random_range(0.2..0.8),
        });
        let portrait = if random.random_bool(0.2) {
            random.random_range(0.2..0.8)
        } else {
            0.0
        };
        Self {
            second_camera,
            portrait,
            ..self
        }
    }
}

fn told(images: usize, random: &mut ChaCha8Rng) -> Told {
    let wrong = |random: &mut ChaCha8Rng, most: f64, source| Told::Wrong {
        source,
        by: random.random_range(-most..most),
    };
    match random.random_range(0..4) {
        0 if images >= 4 => Told::Unknown,
        0 | 1 => wrong(random, 0.02, InteriorSource::CameraFile),
        2 => wrong(random, 0.1, InteriorSource::Exif),
        _ => wrong(random, 0.2, InteriorSource::Exif),
    }
}

pub(crate) fn log_uniform(random: &mut ChaCha8Rng, from: f64, to: f64) -> f64 {
    random.random_range(from.ln()..to.ln()).exp()
}
