//! A ring code that was read against the picture: does every part of it look as the number says?
//!
//! A cover over two segments can turn a number into another valid one, and parity does not see it. But the code's picture is
//! known once its number is ([`super::sketch`]), and what a cover leaves behind departs from it: a border off the grid or not
//! along a radius, a segment cut at its inner or outer edge, a grey level that is neither the ground's nor the code's.
//! The difference is averaged over three by three pixels, the size of the blur; it may be as large as the film is uneven, the frame
//! wrong and the noise strong. The levels of whole segments show slighter differences.

use super::fitting::Fitted;
use super::patch::{Patch, middle};

/// Largest error of the frame, pixels of the patch: it shows at the edges.
const FRAME_PX: f64 = 0.12;
/// Unevenness of what is dark, as a share of the contrast.
const DARK: f64 = 0.04;
/// The same as the level of a whole dark segment.
const DARK_SEGMENT: f64 = 0.03;
/// Unevenness of what is light: retro-reflective film, print.
const LIGHT: f64 = 0.12;
/// Noise that may be seen, in standard deviations.
const NOISE_SIGMAS: f64 = 4.5;

/// How a ring code compares with the picture that its number says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RingEvidence {
    /// Largest departure as a multiple of what is tolerated.
    pub(super) departure: f64,
    /// Segments with a part that departs by more than is tolerated.
    pub(super) departing_segments: u32,
    /// Root mean square difference over the code, as a share of the contrast.
    pub(super) misfit: f64,
}

/// Difference of a pixel.
#[derive(Clone, Copy, Default)]
struct Off {
    off: f64,
    tolerated: f64,
    count: f64,
}

/// Compares the picture with the fitted code.
pub(super) fn ring_evidence(patch: &Patch, fitted: &Fitted) -> Option<RingEvidence> {
    let scene = &fitted.scene;
    let mut offs = vec![Off::default(); patch.columns * patch.rows];
    let (mut squares, mut count) = (0.0, 0.0);
    scene.compare(patch, &fitted.sketch, &fitted.bits, |column, row, grey, seen| {
        let light = seen.light.max(0.25 * scene.light[0]);
        let share = seen.ring.value + seen.dot.value;
        let slope = (seen.ring.slope + scene.dot_light * seen.dot.slope).norm();
        let off = (grey - seen.grey) / light;
        offs[row * patch.columns + column] = Off {
            off,
            tolerated: DARK + (LIGHT - DARK) * share + FRAME_PX * slope,
            count: 1.0,
        };
        squares += off * off;
        count += 1.0;
    });
    let noise = NOISE_SIGMAS * patch.noise / scene.light[0];
    let mut departures: Vec<f64> = fitted
        .shares
        .iter()
        .zip(&fitted.bits)
        .zip(&fitted.sigmas)
        .map(|((share, &light), sigma)| {
            let (level, uneven) = if light { (1.0, LIGHT) } else { (0.0, DARK_SEGMENT) };
            (share - level).abs() / (uneven + NOISE_SIGMAS * sigma)
        })
        .collect();
    let back = scene.frame.map.try_inverse()?;
    for (column, row, _) in patch.pixels() {
        let sum = around(&offs, patch, column, row);
        let departure = sum.off.abs() / (sum.tolerated + noise * sum.count.sqrt());
        let place = back * (middle(column, row) - scene.frame.centre);
        let turn = (place.y.atan2(place.x) / std::f64::consts::TAU).rem_euclid(1.0);
        let segment = (turn * departures.len() as f64) as usize;
        if let Some(largest) = departures.get_mut(segment) {
            *largest = largest.max(departure);
        }
    }
    Some(RingEvidence {
        departure: departures.iter().copied().fold(0.0, f64::max),
        departing_segments: departures.iter().filter(|&&d| d > 1.0).count() as u32,
        misfit: (squares / f64::max(count, 1.0)).sqrt(),
    })
}

/// The sums over a pixel and its neighbours.
fn around(offs: &[Off], patch: &Patch, column: usize, row: usize) -> Off {
    let mut sum = Off::default();
    for line in row.saturating_sub(1)..(row + 2).min(patch.rows) {
        for place in column.saturating_sub(1)..(column + 2).min(patch.columns) {
            let off = &offs[line * patch.columns + place];
            sum.off += off.off;
            sum.tolerated += off.tolerated;
            sum.count += off.count;
        }
    }
    sum
}
