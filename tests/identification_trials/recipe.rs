//! What a random field of targets consists of.

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// The faces that carry the targets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Form {
    Flat,
    /// A surface of waves.
    Waves,
    /// Half a cylinder, seen from outside.
    Cylinder,
    /// Top and sides of a box.
    Box,
    /// Plateaus of different height.
    Steps,
}

impl Form {
    pub(crate) const ALL: [Form; 5] = [
        Form::Flat,
        Form::Waves,
        Form::Cylinder,
        Form::Box,
        Form::Steps,
    ];
}

/// How targets are spread on a face.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Layout {
    /// In rows and columns: every neighbour looks like every other.
    Grid,
    /// Anywhere, no nearer to each other than the spacing.
    Random,
}

/// Sizes and conditions of a measurement.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Recipe {
    pub(crate) form: Form,
    pub(crate) layout: Layout,
    pub(crate) targets: usize,
    /// Distance of neighbouring targets, dot diameters.
    pub(crate) spacing: f64,
    pub(crate) codes: usize,
    pub(crate) stations: usize,
    /// Standard deviation of the best centres, px; that of others is up to twice as large.
    pub(crate) noise_px: f64,
    /// Probability that a dot is not detected.
    pub(crate) missed: f64,
    /// False dots anywhere, as a share of the true ones.
    pub(crate) false_share: f64,
    /// Clusters of false dots beside true ones in each image.
    pub(crate) clusters: usize,
    /// Glints that lie on the surface and move with the camera, as a share of the targets.
    pub(crate) glints: f64,
    /// Part of the object's width that a picture shows.
    pub(crate) shown: [f64; 2],
}

impl Recipe {
    /// The recipe of this number.
    pub(crate) fn numbered(number: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(number);
        let random = &mut random;
        let form = Form::ALL[random.random_range(0..Form::ALL.len())];
        let layout = if random.random_bool(0.5) {
            Layout::Grid
        } else {
            Layout::Random
        };
        let targets = log_uniform(random, 50.0, 2001.0) as usize;
        Self {
            form,
            layout,
            targets,
            spacing: log_uniform(random, 2.0, 8.0),
            codes: codes_on(form)
                + ((targets as f64).sqrt() * random.random_range(0.3..1.0)) as usize,
            stations: (log_uniform(random, 6.0, 61.0) as usize).max(fewest_stations(form)),
            noise_px: log_uniform(random, 0.02, 0.1),
            missed: 0.1,
            false_share: random.random_range(0.0..0.15),
            clusters: random.random_range(0..6),
            glints: if random.random_bool(0.5) {
                0.0
            } else {
                random.random_range(0.0..0.05)
            },
            shown: if random.random_bool(0.5) || form == Form::Box {
                [0.9, 1.3]
            } else {
                [0.6, 1.0]
            },
        }
    }
}

/// So many codes that the pictures hang together, though half of those in sight miss a dot and are not read.
fn codes_on(form: Form) -> usize {
    match form {
        Form::Box => 90,
        Form::Cylinder => 70,
        Form::Flat | Form::Waves | Form::Steps => 32,
    }
}

/// Fewer do not see every face twice.
fn fewest_stations(form: Form) -> usize {
    match form {
        Form::Box => 10,
        Form::Cylinder => 8,
        Form::Flat | Form::Waves | Form::Steps => 6,
    }
}

pub(crate) fn log_uniform(random: &mut ChaCha8Rng, from: f64, to: f64) -> f64 {
    random.random_range(from.ln()..to.ln()).exp()
}

/// A number of the standard normal distribution (Box and Muller, 1958).
pub(crate) fn normal_deviate(random: &mut ChaCha8Rng) -> f64 {
    let u: f64 = random.random_range(1e-300..1.0);
    let v: f64 = random.random_range(0.0..1.0);
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}
