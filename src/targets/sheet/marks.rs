//! The marks of one code and the ground they need.

use nalgebra::Vector2;

use super::shape::{Shape, Tone};
use crate::targets::{DOT420_AXES, Family, dot420_table, ring_table};

/// Pitches from O to A and from O to B.
const AXIS_PITCHES: f64 = 6.0;
/// Radius of a ring's outer edge in radii of its dot; the inner one has 2.
const RING_OUTER: f64 = 3.0;
const RING_INNER: f64 = 2.0;

/// Sizes of the marks of a family, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MarkSize {
    pub(super) family: Family,
    pub(super) pitch_mm: f64,
    pub(super) dot_mm: f64,
}

impl MarkSize {
    /// Side of the square patch: the marks, with a dot or a pitch of empty ground all round.
    pub(super) fn patch_mm(&self) -> f64 {
        match self.family {
            Family::Dot420 => {
                AXIS_PITCHES * self.pitch_mm + self.dot_mm + 2.0 * self.pitch_mm.max(self.dot_mm)
            }
            Family::Ring(_) => (RING_OUTER + 2.0) * self.dot_mm,
        }
    }
}

/// The marks of a code on a patch with this centre.
pub(super) fn marks(size: MarkSize, id: u32, centre: Vector2<f64>, tone: Tone) -> Vec<Shape> {
    let slot = id.saturating_sub(1) as usize;
    match size.family {
        Family::Dot420 => dot420_table()
            .get(slot)
            .map_or_else(Vec::new, |code| dots(size, code, centre, tone)),
        Family::Ring(segments) => ring_table(segments)
            .get(slot)
            .map_or_else(Vec::new, |&bits| ring(size, segments, bits, centre, tone)),
    }
}

fn dots(size: MarkSize, code: &[[i32; 2]; 3], centre: Vector2<f64>, tone: Tone) -> Vec<Shape> {
    DOT420_AXES
        .iter()
        .chain(code)
        .map(|&[x, y]| {
            // The code's y points up, the page's down.
            let from_middle = Vector2::new(f64::from(x), -f64::from(y))
                + Vector2::new(-1.0, 1.0) * 0.5 * AXIS_PITCHES;
            Shape::Disc {
                centre: centre + from_middle * size.pitch_mm,
                radius: 0.5 * size.dot_mm,
                tone,
            }
        })
        .collect()
}

fn ring(size: MarkSize, segments: u8, bits: u32, centre: Vector2<f64>, tone: Tone) -> Vec<Shape> {
    let radius = 0.5 * size.dot_mm;
    let mut shapes = vec![Shape::Disc {
        centre,
        radius,
        tone,
    }];
    let turn = std::f64::consts::TAU / f64::from(segments);
    // Light segments that meet are one shape: between two a printer would leave a hair line.
    shapes.extend(
        runs(segments, bits)
            .into_iter()
            .map(|(first, count)| Shape::RingSector {
                centre,
                inner: RING_INNER * radius,
                outer: RING_OUTER * radius,
                begin: turn * f64::from(first),
                end: turn * f64::from(first + count),
                tone,
            }),
    );
    shapes
}

/// The runs of ones round a pattern as first segment and length; a run may go on beyond the last segment to the first.
fn runs(segments: u8, bits: u32) -> Vec<(u8, u8)> {
    let is_one = |segment: u8| (bits >> (segments - 1 - segment % segments)) & 1 == 1;
    (0..segments)
        .filter(|&segment| is_one(segment) && !is_one(segment + segments - 1))
        .map(|first| {
            let count = (first..first + segments).take_while(|&s| is_one(s)).count();
            (first, count as u8)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_go_round_the_ring() {
        assert_eq!(runs(12, 0b1000_0100_0011), [(5, 1), (10, 3)]);
        assert_eq!(runs(14, 0b11), [(12, 2)]);
        assert_eq!(runs(20, 0), []);
    }

    #[test]
    fn axes_of_a_dot_code_turn_counter_clockwise_as_seen() {
        let size = MarkSize {
            family: Family::Dot420,
            pitch_mm: 5.0,
            dot_mm: 5.0,
        };
        let shapes = marks(size, 1, Vector2::new(100.0, 100.0), Tone::White);
        let centres: Vec<[f64; 2]> = shapes
            .iter()
            .filter_map(|shape| match shape {
                Shape::Disc { centre, .. } => Some([centre.x, centre.y]),
                _ => None,
            })
            .collect();
        assert_eq!(
            centres[..4],
            [[85.0, 115.0], [115.0, 115.0], [85.0, 85.0], [95.0, 110.0]]
        );
        assert_eq!(size.patch_mm(), 45.0);
    }

    /// Every ring code has as much light as ones.
    #[test]
    fn sectors_hold_all_ones() {
        for segments in [12, 14] {
            let size = MarkSize {
                family: Family::Ring(segments),
                pitch_mm: 5.0,
                dot_mm: 4.0,
            };
            for (id, pattern) in (1..).zip(ring_table(segments)) {
                let light: f64 = marks(size, id, Vector2::zeros(), Tone::White)
                    .iter()
                    .map(|shape| match shape {
                        Shape::RingSector { begin, end, .. } => end - begin,
                        _ => 0.0,
                    })
                    .sum();
                let ones = light * f64::from(segments) / std::f64::consts::TAU;
                assert!(
                    (ones - f64::from(pattern.count_ones())).abs() < 1e-9,
                    "{pattern:b}"
                );
            }
        }
    }
}
