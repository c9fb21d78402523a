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
//! What remains is a matter of how many plain targets there are and how well the dot fits (see [`super::surroundings`]).
//! Where dots of any size stand nearer to a code than that, the distance is no argument, and all exchanges count.

use std::sync::OnceLock;

use super::hypothesis::number_at;
use crate::targets::{DOT420_AXES, dot420_positions, dot420_table};

/// Foreign dots keep this distance from the dots of a code (and a little more than this never counts against one).
pub(super) const GUARD_PITCHES: f64 = 2.9;
const SIDE: i32 = 6;

/// A place of a code's square.
pub(super) type Place = [i32; 2];

/// One dot of a code taken for a plain target, and where the hidden dot of the other code is then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Exchange {
    /// Which of O, A, B, 1, 2, 3 would be the plain target.
    pub(super) plain: usize,
    /// Where the dot would stand that is not seen.
    pub(super) hidden: Place,
}

/// Whether foreign dots keep off a code's dots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ClearZone {
    /// Nothing stands nearer than [`GUARD_PITCHES`].
    Kept,
    /// Something does, so that a plain target might as well.
    Broken,
}

/// The exchanges of a code (number from 1).
pub(super) fn exchanges(id: u32, zone: ClearZone) -> &'static [Exchange] {
    static KEPT: OnceLock<Vec<Vec<Exchange>>> = OnceLock::new();
    static BROKEN: OnceLock<Vec<Vec<Exchange>>> = OnceLock::new();
    let (table, guard) = match zone {
        ClearZone::Kept => (&KEPT, GUARD_PITCHES),
        ClearZone::Broken => (&BROKEN, 0.0),
    };
    let all = || {
        let codes = dot420_table().iter();
        codes.map(|code| exchanges_of(*code, guard)).collect()
    };
    &table.get_or_init(all)[id as usize - 1]
}

fn exchanges_of(code: [Place; 3], guard_pitches: f64) -> Vec<Exchange> {
    let six: Vec<Place> = DOT420_AXES.iter().chain(&code).copied().collect();
    let fourth = [SIDE, SIDE];
    let mut found = Vec::new();
    for (plain, place) in six.iter().enumerate() {
        let five: Vec<Place> = six.iter().copied().filter(|other| other != place).collect();
        if five
            .iter()
            .any(|other| distance(*other, *place) < guard_pitches)
        {
            continue;
        }
        let hidden = dot420_positions().into_iter().chain([fourth]);
        let makes_code = |hidden: &Place| {
            !six.contains(hidden)
                && distance(*hidden, *place) >= guard_pitches
                && is_code(five.iter().copied().chain([*hidden]).collect())
        };
        found.extend(
            hidden
                .filter(makes_code)
                .map(|hidden| Exchange { plain, hidden }),
        );
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
        for id in 1..=420 {
            counts[exchanges(id, ClearZone::Kept).len()] += 1;
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
