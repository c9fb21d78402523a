//! What stands round a reading, and how likely it is that a plain target completed it.
//!
//! For each exchange that the picture leaves open (see [`super::rivals`]) the reading is compared with its rival by their
//! likelihoods. If the code is true, the dot in question stands where the other five say, to within the covariance C of
//! that place; if it is a plain target it stands anywhere, with the density rho of plain targets. The ratio is
//! `rho 2 pi sqrt(det C) exp(d^2 / 2)` with d^2 the squared distance in C. A rule that calls a reading certain up to a ratio
//! t errs, by Neyman and Pearson's lemma, in fewer than t of all codes with a hidden dot, and no other rule that errs as
//! seldom calls more true codes certain.

use nalgebra::Vector2;

use super::hypothesis::{Field, Hypothesis};
use super::rivals::{ClearZone, Exchange, GUARD_PITCHES, exchanges};

/// Radii round the middle of the code within which foreign dots are counted, pitches: the densest counts, so that a
/// cluster beside the code and a field far round it are both seen.
const RADII_PITCHES: [f64; 3] = [9.0, 18.0, 36.0];
/// Area round a code's own dots where no foreign dots are, pitches squared: 94 to 105 for all codes.
const GUARDED_PITCHES2: f64 = 100.0;
/// A foreign dot counts where its area is that of a code's dot at its place within this factor: not by its shape, as a reading
/// made of targets in rows has them on another plane than they lie on.
const AREA_FACTOR: f64 = 1.7;
/// Codes that share four dots with one, about: any two of its six might be plain targets.
const RIVALS_BY_PAIRS: f64 = 100.0;
/// A foreign dot this near to whole pitches (in x and in y) counts as standing on the code's own grid, pitches: one of
/// seventeen does by chance.
const ON_GRID_PITCHES: f64 = 0.12;
/// The doubt of a reading whose rivals are too likely; how likely is in its evidence. It is the same for every code, so that those
/// of a picture can be told together.
const BY_ODDS: &str = "one of its dots may be a plain target in the stead of a hidden one, which would be another number";
/// Middle of the square, pitches.
const MIDDLE: f64 = 3.0;

/// What stands round a reading and speaks for other numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Surroundings {
    /// Exchanges that nothing in the picture rules out.
    pub(super) rivals: u32,
    /// Dots of no code that may lie in the code's plane, within 9 pitches of its middle.
    pub(super) foreign: u32,
    /// Of those: on the code's own grid, as targets in rows would be.
    pub(super) on_grid: u32,
    /// Foreign dots nearer to the code's than the design allows.
    pub(super) intruders: u32,
    /// Likelihood of all rivals together, as a multiple of the reading's.
    pub(super) chance: f64,
}

impl Field<'_> {
    /// Looks round a reading; `taken` tells which dots belong to codes that were read.
    pub(super) fn surroundings(&self, reading: &Hypothesis, taken: &[bool]) -> Surroundings {
        let foreign = self.foreign_dots(reading, taken);
        let middle = Vector2::repeat(MIDDLE);
        let within = |radius: f64| {
            let near = foreign.iter().filter(|f| (*f - middle).norm() < radius);
            near.count() as u32
        };
        // The dot in question would be one of the plain targets too, which matters where they are few.
        let density = RADII_PITCHES
            .map(|radius| match f64::from(within(radius)) {
                0.0 => 0.0,
                count => {
                    (count + 1.0) / (std::f64::consts::PI * radius * radius - GUARDED_PITCHES2)
                }
            })
            .into_iter()
            .fold(0.0, f64::max);
        let (zone, intruders) = self.clear_zone(reading, &foreign);
        let open = |exchange: &&Exchange| {
            let hidden = Vector2::from(exchange.hidden.map(f64::from));
            zone == ClearZone::Broken
                || foreign.iter().all(|f| (f - hidden).norm() >= GUARD_PITCHES)
        };
        let rivals: Vec<&Exchange> = exchanges(reading.id, zone).iter().filter(open).collect();
        let near = foreign
            .iter()
            .filter(|f| (*f - middle).norm() < RADII_PITCHES[0]);
        Surroundings {
            rivals: rivals.len() as u32,
            foreign: within(RADII_PITCHES[0]),
            on_grid: near.filter(|f| is_on_grid(f)).count() as u32,
            intruders,
            chance: if density > 0.0 {
                self.chance(reading, &rivals, density)
            } else {
                0.0
            },
        }
    }

    /// Places, in pitches, of the dots of no code that may lie in the code's plane.
    fn foreign_dots(&self, reading: &Hypothesis, taken: &[bool]) -> Vec<Vector2<f64>> {
        let plane = &reading.plane;
        let middle = Vector2::repeat(MIDDLE);
        let map = plane.px_from_pitches(middle);
        let centre_px = self.dots[reading.slots[0]].centre_px + map * middle;
        let reach_px = RADII_PITCHES[2] * map.norm();
        let near = self.index.within(self.dots, centre_px, reach_px);
        let own_sizes = reading
            .slots
            .iter()
            .zip(reading.grid)
            .filter_map(|(&slot, grid)| {
                self.log_size(reading, slot, Vector2::from(grid.map(f64::from)))
            });
        let own_size = own_sizes.sum::<f64>() / 6.0;
        let place_if_alike = |slot: usize| {
            let place = plane
                .grid_from_px(self.dots[slot].centre_px)
                .filter(|_| !taken[slot])?;
            let size = self.log_size(reading, slot, place)?;
            ((size - own_size).abs() < AREA_FACTOR.ln()).then_some(place)
        };
        near.into_iter().filter_map(place_if_alike).collect()
    }

    /// Logarithm of a dot's area over that of a circle of a pitch's radius at its place on the reading's plane.
    fn log_size(&self, reading: &Hypothesis, slot: usize, place: Vector2<f64>) -> Option<f64> {
        let map = reading.plane.px_from_pitches(place);
        Some(self.outlines[slot]?.log_area() - map.determinant().abs().ln())
    }

    /// Whether anything stands nearer to the code's dots than the design allows, and how many foreign dots do.
    fn clear_zone(&self, reading: &Hypothesis, foreign: &[Vector2<f64>]) -> (ClearZone, u32) {
        let reach = self.settings.clear_pitches;
        let grid = reading.grid.map(|grid| Vector2::from(grid.map(f64::from)));
        let near_any = |place: &Vector2<f64>| grid.iter().any(|g| (place - g).norm() < reach);
        let intruders = foreign.iter().filter(|place| near_any(place)).count() as u32;
        let stands_near = |(&slot, place): (&usize, &Vector2<f64>)| {
            let reach_px = reach * reading.plane.px_from_pitches(*place).norm();
            let near = self
                .index
                .within(self.dots, self.dots[slot].centre_px, reach_px);
            near.into_iter().any(|other| {
                let stands = reading.plane.grid_from_px(self.dots[other].centre_px);
                !reading.slots.contains(&other)
                    && stands.is_some_and(|stands| (stands - place).norm() < reach)
            })
        };
        let broken = intruders > 0 || reading.slots.iter().zip(&grid).any(stands_near);
        let zone = if broken {
            ClearZone::Broken
        } else {
            ClearZone::Kept
        };
        (zone, intruders)
    }

    /// Likelihood of the rivals as a multiple of the reading's: `rho 2 pi sqrt(det C) exp(d^2 / 2)` over all exchanges, and the
    /// square of that with the whole misfit for exchanges of two dots.
    fn chance(&self, reading: &Hypothesis, rivals: &[&Exchange], density: f64) -> f64 {
        let dots = self.grid_dots_of(reading);
        let mut chance = 0.0;
        let mut log_area = 0.0;
        for place in 0..6 {
            let Some(departure) = reading.plane.departure(&dots, place) else {
                return f64::INFINITY;
            };
            let count = rivals.iter().filter(|rival| rival.plain == place).count();
            let expected = density * std::f64::consts::TAU * departure.area_pitches2;
            chance += count as f64 * expected * (0.5 * departure.squared).exp();
            log_area += expected.ln() / 6.0;
        }
        let misfit = 6.0 * reading.plane.standardised.powi(2);
        chance + RIVALS_BY_PAIRS * (2.0 * log_area + 0.5 * misfit).exp()
    }
}

impl Surroundings {
    /// What they say against a reading, in the operator's words.
    pub(super) fn doubt(&self, rival_chance: f64) -> Option<String> {
        /// So many foreign dots on the code's grid, and a share of all, are more than chance: it may be one of rows.
        const ROWS: u32 = 3;
        const ROWS_SHARE: u32 = 8;
        let Self {
            foreign,
            on_grid,
            intruders,
            chance,
            ..
        } = *self;
        if intruders > 0 {
            return Some(format!(
                "{intruders} foreign dot(s) of about their size too near to its dots"
            ));
        }
        if on_grid >= ROWS + foreign / ROWS_SHARE {
            return Some(format!(
                "{on_grid} of the {foreign} foreign dots round it continue its grid: plain targets in rows?"
            ));
        }
        (chance > rival_chance).then(|| BY_ODDS.to_owned())
    }
}

fn is_on_grid(place: &Vector2<f64>) -> bool {
    (place - place.map(f64::round)).amax() < ON_GRID_PITCHES
}
