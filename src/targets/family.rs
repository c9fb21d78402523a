//! The code families and their tables.

use std::fmt;
use std::str::FromStr;
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

/// A family of coded targets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Family {
    /// Six dots: the axis dots O, A, B and three of 21 positions (Hattori et al., 2002); 420 codes.
    Dot420,
    /// A segmented ring round a centre dot with this many segments: 12, 14 or 20.
    Ring(u8),
}

impl Family {
    /// All families.
    pub const ALL: [Family; 4] = [
        Family::Dot420,
        Family::Ring(12),
        Family::Ring(14),
        Family::Ring(20),
    ];

    /// How many codes the family has; they are numbered from 1.
    #[must_use]
    pub fn code_count(self) -> u32 {
        match self {
            Family::Dot420 => dot420_table().len() as u32,
            Family::Ring(segments) => ring_table(segments).len() as u32,
        }
    }

    /// The label of a code: `C17`, `R14-57`.
    #[must_use]
    pub fn code_label(self, id: u32) -> String {
        match self {
            Family::Dot420 => format!("C{id}"),
            Family::Ring(segments) => format!("R{segments}-{id}"),
        }
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Family::Dot420 => write!(f, "dot420"),
            Family::Ring(segments) => write!(f, "ring{segments}"),
        }
    }
}

/// A name that is no code family.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("found code family '{0}', expected dot420, ring12, ring14 or ring20")]
pub struct UnknownFamily(String);

impl FromStr for Family {
    type Err = UnknownFamily;

    fn from_str(s: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|f| f.to_string() == s.trim())
            .ok_or_else(|| UnknownFamily(s.trim().to_owned()))
    }
}

impl TryFrom<String> for Family {
    type Error = UnknownFamily;

    fn try_from(s: String) -> Result<Self, Self::Error> {
        s.parse()
    }
}

impl From<Family> for String {
    fn from(family: Family) -> Self {
        family.to_string()
    }
}

/// Places of the axis dots O, A, B in pitches.
pub const DOT420_AXES: [[i32; 2]; 3] = [[0, 0], [6, 0], [0, 6]];

/// The 21 places of a `dot420` code in pitches, numbered row by row: the 5 x 5 grid 1..5 without its corners.
#[must_use]
pub fn dot420_positions() -> [[i32; 2]; 21] {
    let mut positions = [[0; 2]; 21];
    let mut next = 0;
    for y in 1..=5 {
        for x in 1..=5 {
            let corner = (x == 1 || x == 5) && (y == 1 || y == 5);
            if !corner {
                positions[next] = [x, y];
                next += 1;
            }
        }
    }
    positions
}

/// The places of the three code dots of every `dot420` code, in pitches and position order; code number = index + 1.
///
/// A code is three positions any two of which differ by at least 2 in x or in y, at least one of them beyond the line
/// AB (x + y > 6); triples are numbered in lexicographic order.
#[must_use]
pub fn dot420_table() -> &'static [[[i32; 2]; 3]] {
    static TABLE: OnceLock<Vec<[[i32; 2]; 3]>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let positions = dot420_positions();
        let apart = |a: [i32; 2], b: [i32; 2]| (a[0] - b[0]).abs() >= 2 || (a[1] - b[1]).abs() >= 2;
        let mut table = Vec::new();
        for i in 0..21 {
            for j in i + 1..21 {
                for k in j + 1..21 {
                    let [a, b, c] = [positions[i], positions[j], positions[k]];
                    let beyond = [a, b, c].iter().any(|p| p[0] + p[1] > 6);
                    if apart(a, b) && apart(a, c) && apart(b, c) && beyond {
                        table.push([a, b, c]);
                    }
                }
            }
        }
        table
    })
}

/// The number of the code with these three places (pitches, any order); `None` where it is no code.
#[must_use]
pub fn dot420_number(mut places: [[i32; 2]; 3]) -> Option<u32> {
    places.sort_by_key(|p| (p[1], p[0]));
    dot420_table()
        .iter()
        .position(|code| *code == places)
        .map(|index| index as u32 + 1)
}

/// The valid patterns of a ring code with `segments` segments, sorted; code number = index + 1. Empty for a number of
/// segments that is no family.
///
/// A pattern is the least of the rotations of an n-bit number; valid are those with an even number of ones, at least
/// one pair of diametrically opposite ones, and not all ones.
#[must_use]
pub fn ring_table(segments: u8) -> &'static [u32] {
    static TABLES: [OnceLock<Vec<u32>>; 3] = [OnceLock::new(), OnceLock::new(), OnceLock::new()];
    let slot = match segments {
        12 => 0,
        14 => 1,
        20 => 2,
        _ => return &[],
    };
    TABLES[slot].get_or_init(|| {
        (1..(1_u32 << segments) - 1)
            .filter(|&bits| {
                let opposite = bits & (bits >> (segments / 2)) != 0;
                bits.count_ones() % 2 == 0 && opposite && least_rotation(bits, segments) == bits
            })
            .collect()
    })
}

/// The least of the numbers that the rotations of `segments` bits give.
#[must_use]
pub fn least_rotation(bits: u32, segments: u8) -> u32 {
    let mask = (1_u32 << segments) - 1;
    (0..segments)
        .map(|turn| ((bits << turn) | (bits >> (segments - turn))) & mask)
        .min()
        .unwrap_or(bits)
}

/// The number of the ring code with these bits, read clockwise from any segment, the first most significant; `None`
/// where the pattern is not valid.
#[must_use]
pub fn ring_number(bits: u32, segments: u8) -> Option<u32> {
    ring_table(segments)
        .binary_search(&least_rotation(bits, segments))
        .ok()
        .map(|index| index as u32 + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tables_have_their_known_sizes() {
        assert_eq!(Family::ALL.map(Family::code_count), [420, 147, 516, 24_793]);
    }

    #[test]
    fn the_first_fourteen_bit_codes_are_those_in_industrial_use() {
        assert_eq!(ring_table(14)[..3], [129, 135, 139]);
    }

    #[test]
    fn a_code_is_found_by_its_places_in_any_order() {
        for (index, code) in dot420_table().iter().enumerate() {
            assert_eq!(
                dot420_number([code[2], code[0], code[1]]),
                Some(index as u32 + 1)
            );
        }
        assert_eq!(
            dot420_number([[2, 1], [3, 1], [4, 4]]),
            None,
            "neighbours are no code"
        );
    }

    /// Over all 420 x 120 ordered choices of three dots as right-handed (O, A, B), only the true one puts the other
    /// three inside the parallelogram: the code is unambiguous under any affine view that is not a mirror image.
    #[test]
    fn only_the_true_axes_contain_the_other_dots() {
        let mut choices = 0;
        for code in dot420_table() {
            let dots: Vec<[i32; 2]> = DOT420_AXES.iter().chain(code).copied().collect();
            for o in 0..6 {
                for a in (0..6).filter(|&a| a != o) {
                    for b in (0..6).filter(|&b| b != o && b != a) {
                        choices += 1;
                        let u = [dots[a][0] - dots[o][0], dots[a][1] - dots[o][1]];
                        let v = [dots[b][0] - dots[o][0], dots[b][1] - dots[o][1]];
                        let area = u[0] * v[1] - u[1] * v[0];
                        let inside = (0..6).filter(|&d| d != o && d != a && d != b).all(|d| {
                            let w = [dots[d][0] - dots[o][0], dots[d][1] - dots[o][1]];
                            let s = w[0] * v[1] - w[1] * v[0];
                            let t = u[0] * w[1] - u[1] * w[0];
                            (0..=area).contains(&s) && (0..=area).contains(&t)
                        });
                        let true_axes = (o, a, b) == (0, 1, 2);
                        assert_eq!(area > 0 && inside, true_axes, "{code:?} {o} {a} {b}");
                    }
                }
            }
        }
        assert_eq!(choices, 420 * 120);
    }

    #[test]
    fn families_are_written_as_they_are_read() {
        for family in Family::ALL {
            assert_eq!(family.to_string().parse(), Ok(family));
        }
        assert!("ring13".parse::<Family>().is_err());
    }
}
