//! Other codes of which a reading might be a part: one of its six dots a plain target, one of theirs hidden.
//!
//! Where a dot of a code is hidden, a plain target that happens to stand in the right place completes the five that are
//! left to another number, and the picture is then the same as that of a true code: no fit tells them apart. But the place
//! must be right to some hundredths of a pitch, and few exchanges make a code. The axes being at three corners of a square
//! of six pitches, the five common dots fix that square, and only these exchanges exist: an axis dot against the fourth
//! corner (the code is then seen turned by a quarter or a half), or a code dot against another position. Plain targets keep
//! [`GUARD_PITCHES`] from a code's dots: where the dot in question stands nearer to one of the other five, or a target
//! stands nearer to the place of the hidden dot, the exchange is ruled out.
//!
//! What remains is a matter of how many plain targets there are: `rivals times density times area`.

use std::sync::OnceLock;

use nalgebra::Vector2;

use super::hypothesis::{Field, Hypothesis, number_at};
use super::outline::{Agreement, agreement};
use crate::targets::{DOT420_AXES, dot420_positions, dot420_table};

/// Foreign dots keep this distance from the dots of a code (and a little more than this never counts against one).
const GUARD_PITCHES: f64 = 2.9;
/// Foreign dots are counted up to this distance from the middle of the code, pitches: some ten of them stand there in a
/// dense field.
const NEIGHBOURHOOD_PITCHES: f64 = 9.0;
/// A foreign dot this near to whole pitches (in x and in y) counts as standing on the code's own grid, pitches: one of
/// seventeen does by chance.
const ON_GRID_PITCHES: f64 = 0.12;
/// Middle of the square, pitches.
const MIDDLE: f64 = 3.0;
const SIDE: i32 = 6;

/// A place of a code's square.
type Place = [i32; 2];

/// What stands round a reading and speaks for other numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Surroundings {
    /// Exchanges that nothing in the picture rules out.
    pub(super) rivals: u32,
    /// Dots of no code that may lie in the code's plane, within [`NEIGHBOURHOOD_PITCHES`] of its middle.
    pub(super) foreign: u32,
    /// Of those: on the code's own grid, as targets in rows would be.
    pub(super) on_grid: u32,
}

impl Field<'_> {
    /// Looks round a reading; `taken` tells which dots belong to codes that were read.
    pub(super) fn surroundings(&self, reading: &Hypothesis, taken: &[bool]) -> Surroundings {
        let plane = &reading.plane;
        let middle = Vector2::repeat(MIDDLE);
        let map = plane.px_from_pitches(middle);
        let centre_px = self.dots[reading.slots[0]].centre_px + map * middle;
        let near = self.index.within(
            self.dots,
            centre_px,
            1.2 * NEIGHBOURHOOD_PITCHES * map.norm(),
        );
        let mut foreign = Vec::new();
        for slot in near {
            let Some(outline) = self.outlines[slot].filter(|_| !taken[slot]) else {
                continue;
            };
            let Some(place) = plane.grid_from_px(self.dots[slot].centre_px) else {
                continue;
            };
            let alike = || {
                let maps = [plane.px_from_pitches(place)];
                agreement(&[outline], &maps, 0.0, self.settings) == Agreement::Agree
            };
            if (place - middle).norm() < NEIGHBOURHOOD_PITCHES && alike() {
                foreign.push(place);
            }
        }
        let seen = |hidden: &Place| {
            let hidden = Vector2::new(f64::from(hidden[0]), f64::from(hidden[1]));
            foreign.iter().any(|f| (f - hidden).norm() < GUARD_PITCHES)
        };
        let hidden_places = &exchanges()[reading.id as usize - 1];
        Surroundings {
            rivals: hidden_places.iter().filter(|place| !seen(place)).count() as u32,
            foreign: foreign.len() as u32,
            on_grid: foreign.iter().filter(|f| is_on_grid(f)).count() as u32,
        }
    }
}

impl Surroundings {
    /// What they say against a reading that misses the grid by `fit` (standardised), in the operator's words.
    pub(super) fn doubt(&self, fit: f64, rival_chance: f64) -> Option<String> {
        /// So many foreign dots on the code's grid, and a share of all, are more than chance: it may be one of rows.
        const ROWS: u32 = 3;
        const ROWS_SHARE: u32 = 8;
        let Self {
            rivals,
            foreign,
            on_grid,
        } = *self;
        if on_grid >= ROWS + foreign / ROWS_SHARE {
            return Some(format!(
                "{on_grid} of the {foreign} foreign dots round it continue its grid: plain targets in rows?"
            ));
        }
        // A dot passes by chance in proportion to the area in which it passes, the square of the misfit.
        let chance = f64::from(rivals) * f64::from(foreign) * fit * fit;
        (chance > rival_chance).then(|| {
            format!(
                "{rivals} other code(s) with a hidden dot would look the same if one of its dots was a plain target, \
                 and {foreign} stand round it"
            )
        })
    }
}

fn is_on_grid(place: &Vector2<f64>) -> bool {
    (place - place.map(f64::round)).amax() < ON_GRID_PITCHES
}

/// The exchanges of every code, each by the place of the hidden dot; code number = index + 1.
fn exchanges() -> &'static [Vec<Place>] {
    static EXCHANGES: OnceLock<Vec<Vec<Place>>> = OnceLock::new();
    EXCHANGES.get_or_init(|| {
        dot420_table()
            .iter()
            .map(|code| exchanges_of(*code))
            .collect()
    })
}

fn exchanges_of(code: [Place; 3]) -> Vec<Place> {
    let six: Vec<Place> = DOT420_AXES.iter().chain(&code).copied().collect();
    let fourth = [SIDE, SIDE];
    let mut found = Vec::new();
    for plain in &six {
        let five: Vec<Place> = six.iter().copied().filter(|place| place != plain).collect();
        if five
            .iter()
            .any(|place| distance(*place, *plain) < GUARD_PITCHES)
        {
            continue;
        }
        let hidden = dot420_positions().into_iter().chain([fourth]);
        found.extend(hidden.filter(|hidden| {
            !six.contains(hidden)
                && distance(*hidden, *plain) >= GUARD_PITCHES
                && is_code(five.iter().copied().chain([*hidden]).collect())
        }));
    }
    found
}

/// Whether six places of the square make a code, turned by quarters as need be.
fn is_code(mut places: Vec<Place>) -> bool {
    for _ in 0..4 {
        let (axes, dots): (Vec<Place>, Vec<Place>) =
            places.iter().partition(|place| DOT420_AXES.contains(place));
        if axes.len() == 3 {
            let positions = dot420_positions();
            let mut at: Vec<usize> = dots
                .iter()
                .filter_map(|dot| positions.iter().position(|p| p == dot))
                .collect();
            at.sort_unstable();
            return matches!(at[..], [i, j, k] if number_at([i, j, k]).is_some());
        }
        places
            .iter_mut()
            .for_each(|place| *place = [SIDE - place[1], place[0]]);
    }
    false
}

fn distance(a: Place, b: Place) -> f64 {
    f64::from(a[0] - b[0]).hypot(f64::from(a[1] - b[1]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_has_few_rivals_and_a_seventh_has_none() {
        let mut counts = [0; 7];
        for exchanges in exchanges() {
            counts[exchanges.len()] += 1;
        }
        assert_eq!(counts, [60, 143, 132, 65, 12, 6, 2]);
    }

    /// Seen from the other code, the reading is as much a rival as the other way round.
    #[test]
    fn the_fourth_corner_makes_a_code_seen_turned() {
        // O exchanged for the fourth corner: the same dots seen upside down.
        let dots = [[5, 3], [3, 5], [1, 4]];
        let mut six = vec![[6, 0], [0, 6], [6, 6]];
        six.extend(dots);
        assert!(is_code(six));
    }
}
