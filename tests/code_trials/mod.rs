//! Trials of the code families against truth: single codes under hard conditions, by the hundred thousand.
//!
//! A trial shows some codes and says what became of each: read, read with a doubt, not read, or a wrong number. Every
//! trial has its own seed, so that a tally is the same on any number of threads and a bad trial can be looked at again.
//! [`six_dots`] simulates measured dots, [`rings`] and [`rendered`] make small pictures and go through detection.
#![allow(dead_code, reason = "every program uses its own part")]

pub(crate) mod picture;
pub(crate) mod plane_view;
pub(crate) mod rendered;
pub(crate) mod ring_scene;
pub(crate) mod rings;
pub(crate) mod six_dots;

use std::ops::{Add, Range};

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use tiepoint::targets::Family;

/// What became of the codes of one trial or of many.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Tally {
    pub(crate) trials: usize,
    /// Codes shown whole.
    pub(crate) shown: usize,
    /// Of those: right and without a doubt.
    pub(crate) read: usize,
    /// Of those: right, but with a doubt.
    pub(crate) doubtful: usize,
    /// Wrong numbers without a doubt whose picture the scene shows: no reader can tell.
    pub(crate) same_picture: usize,
    /// Other readings that are no code of the scene, without and with a doubt.
    pub(crate) wrong: usize,
    pub(crate) wrong_doubtful: usize,
}

impl Tally {
    /// Shown whole, but not read.
    pub(crate) fn not_read(&self) -> usize {
        self.shown.saturating_sub(self.read + self.doubtful)
    }

    /// Upper limit of the rate of wrong numbers, with 95 % certainty: 3/N where none was seen, else by the normal
    /// approximation to Poisson's limit (Garwood's limit to some per cent).
    pub(crate) fn wrong_bound(&self) -> f64 {
        let k = self.wrong as f64;
        let most = if self.wrong == 0 {
            3.0
        } else {
            k + 1.0 + 1.645 * (k + 1.0).sqrt()
        };
        most / self.trials.max(1) as f64
    }
}

impl Add for Tally {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            trials: self.trials + other.trials,
            shown: self.shown + other.shown,
            read: self.read + other.read,
            doubtful: self.doubtful + other.doubtful,
            same_picture: self.same_picture + other.same_picture,
            wrong: self.wrong + other.wrong,
            wrong_doubtful: self.wrong_doubtful + other.wrong_doubtful,
        }
    }
}

/// One kind of trial of one family.
pub(crate) struct Kind {
    pub(crate) family: Family,
    pub(crate) name: String,
    trial: Box<dyn Fn(&mut ChaCha8Rng) -> Tally + Sync>,
}

impl Kind {
    pub(crate) fn new(
        family: Family,
        name: impl Into<String>,
        trial: impl Fn(&mut ChaCha8Rng) -> Tally + Sync + 'static,
    ) -> Self {
        Self {
            family,
            name: name.into(),
            trial: Box::new(trial),
        }
    }

    /// The trials with these numbers, and the numbers of those that read a wrong number without a doubt.
    pub(crate) fn run(&self, numbers: Range<u64>) -> (Tally, Vec<u64>) {
        numbers
            .into_par_iter()
            .map(|number| {
                let tally = self.once(number);
                (tally, Vec::from_iter((tally.wrong > 0).then_some(number)))
            })
            .reduce(Default::default, |(tally, mut bad), (more, mut other)| {
                bad.append(&mut other);
                (tally + more, bad)
            })
    }

    /// The trial with this number.
    pub(crate) fn once(&self, number: u64) -> Tally {
        let mut random = ChaCha8Rng::seed_from_u64(number);
        Tally {
            trials: 1,
            ..(self.trial)(&mut random)
        }
    }
}

/// Every kind of every family, by family.
pub(crate) fn kinds() -> Vec<Kind> {
    let mut all = six_dots::kinds();
    all.extend(rendered::kinds());
    for segments in [12, 14, 20] {
        all.extend(rings::kinds(segments));
    }
    all
}

/// A number of the standard normal distribution.
pub(crate) fn normal(random: &mut ChaCha8Rng) -> f64 {
    normals(random)[0]
}

/// Two independent numbers of the standard normal distribution (Box and Muller, 1958).
pub(crate) fn normals(random: &mut ChaCha8Rng) -> [f64; 2] {
    use rand::RngExt as _;
    let (u, v): (f64, f64) = (
        random.random_range(1e-300..1.0),
        random.random_range(0.0..1.0),
    );
    let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
    let size = (-2.0 * u.ln()).sqrt();
    [size * cos, size * sin]
}
