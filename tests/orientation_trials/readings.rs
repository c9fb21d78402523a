//! Readings of codes: which are right, and how right ones are made wrong.

use std::collections::{BTreeMap, BTreeSet};

use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use tiepoint::network::Code;
use tiepoint::targets::{CodeReading, DotIndex, Family};

use super::recipe::WrongCodes;
use super::world::World;

/// The codes that a picture shows.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shown {
    /// Codes that are read rightly.
    pub(crate) right: BTreeSet<Code>,
    /// How many readings are not.
    pub(crate) wrong: usize,
    /// How many of these were wrong before labels were falsified.
    pub(crate) wrong_by_detection: usize,
    pub(crate) cross: bool,
}

impl Shown {
    /// Of the readings those are right that have a true code's number and dots, and a number of their own.
    pub(crate) fn of(
        family: Family,
        readings: &[CodeReading],
        true_codes: &BTreeMap<Vec<DotIndex>, u32>,
    ) -> Self {
        let mut shown = Self::default();
        for reading in readings {
            let of_number = readings.iter().filter(|other| other.id == reading.id);
            let is_alone = of_number.count() == 1;
            if true_codes.get(&reading.dots) == Some(&reading.id) && is_alone {
                shown.right.insert((family, reading.id));
            } else {
                shown.wrong += 1;
            }
        }
        shown
    }
}

/// How many readings may be made wrong at most.
pub(crate) fn most_wrong(wrong: WrongCodes, readings: usize) -> usize {
    match wrong {
        WrongCodes::None => 0,
        WrongCodes::OneAnImage => 1,
        WrongCodes::Share(_) => readings / 5,
    }
}

/// Makes readings wrong, each in one of the ways in which readings are; `plain` are dots of no code.
pub(crate) fn spoil(
    readings: &mut Vec<CodeReading>,
    wrong: WrongCodes,
    most: usize,
    world: &World,
    plain: &[DotIndex],
    random: &mut ChaCha8Rng,
) {
    let mut left = most;
    for index in 0..readings.len() {
        let hit = match wrong {
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
                readings[index].id = world.free[random.random_range(0..world.free.len())];
            }
            // Two numbers exchanged.
            1 if left > 0 => {
                left -= 1;
                let other = random.random_range(0..readings.len());
                let id = readings[index].id;
                readings[index].id = readings[other].id;
                readings[other].id = id;
            }
            // A plain target, or plain targets near each other, read as a code of the object.
            2 if plain.len() >= 6 => {
                let count = readings[index].dots.len();
                let from = random.random_range(0..=plain.len() - count);
                readings[index].dots = plain[from..from + count].to_vec();
            }
            // The number of another code of the object.
            _ => {
                readings[index].id = world.codes[random.random_range(0..world.codes.len())].id;
            }
        }
    }
    // Two readings never share dots.
    let mut taken = BTreeSet::new();
    readings.retain(|reading| {
        let free = reading.dots.iter().all(|dot| !taken.contains(dot));
        if free {
            taken.extend(reading.dots.iter().copied());
        }
        free
    });
}
