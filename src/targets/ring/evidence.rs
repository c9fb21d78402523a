//! A ring code that was read against the picture: does every part of it look as the number says?
//!
//! A cover over two segments can turn a number into another valid one, and parity does not see it. But the code's picture is
//! known once its number is ([`super::sketch`]), and what a cover leaves behind departs from it: a border off the grid or not
//! along a radius, a segment cut at its inner or outer edge, a grey level that is neither the ground's nor the code's.
//! Three things are looked at:
//! - the difference in the mean of three by three pixels, the size of the blur: it may be as large as film and print are uneven
//!   and the noise is strong;
//! - the borders: how far along the ring each one between light and dark is from the grid, and how wide a line lies on the others, by
//!   least squares over their pixels;
//! - the levels of whole segments, which show slighter differences in grey.
//!
//! What cannot be told: a cover of the ground's own grey whose borders lie in dark segments or on the grid leaves the picture of
//! another number.

use nalgebra::{Matrix2, Vector2};

use super::first_look::MIDDLE;
use super::fitting::{Fitted, shown};
use super::frame::RingFrame;
use super::patch::{Patch, middle};

/// Largest error of the frame, pixels of the patch: it shows at the edges.
const FRAME_PX: f64 = 0.12;
/// How far the border of two segments may be from where it should be, and how wide a line on it, pixels of the patch.
const BORDER_PX: f64 = 0.16;
/// Unevenness of what is dark, as a share of the contrast.
const DARK: f64 = 0.05;
/// The same as the level of a whole dark segment.
const DARK_SEGMENT: f64 = 0.03;
/// How far the level of a whole light segment may be from the others'.
const LIGHT_SEGMENT: f64 = 0.25;
/// Unevenness of what is light within a segment: retro-reflective film, print.
const LIGHT: f64 = 0.12;
/// Unevenness of single pixels.
const UNEVEN: f64 = 0.02;
/// Noise that may be seen, in standard deviations.
const NOISE_SIGMAS: f64 = 5.0;

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

/// Where a pixel lies in the code.
struct Place {
    /// In radii of the dot, perspective left out.
    affine: Vector2<f64>,
    /// Direction as a share of the turn.
    turn: f64,
}

impl Place {
    fn of(frame: &RingFrame, back: &Matrix2<f64>, column: usize, row: usize) -> Self {
        let affine = back * (middle(column, row) - frame.centre);
        Self {
            affine,
            turn: (affine.y.atan2(affine.x) / std::f64::consts::TAU).rem_euclid(1.0),
        }
    }

    fn segment(&self, segments: usize) -> usize {
        ((self.turn * segments as f64) as usize).min(segments - 1)
    }

    /// The border with this number begins the segment with the same.
    fn nearest_border(&self, segments: usize) -> usize {
        (self.turn * segments as f64).round() as usize % segments
    }
}

/// How far the border between a light and a dark segment is from where it should be, or how wide a line of the other kind lies
/// between two that are alike, by least squares.
#[derive(Clone, Copy, Default)]
struct Border {
    product: f64,
    square: f64,
}

impl Border {
    fn add(&mut self, off: f64, by: f64) {
        self.product += off * by;
        self.square += by * by;
    }

    /// Radians, or pixels of a line's width.
    fn shift(&self) -> f64 {
        self.product / self.square.max(f64::MIN_POSITIVE)
    }

    /// Its standard deviation from noise.
    fn sigma(&self, noise: f64) -> f64 {
        noise / self.square.max(f64::MIN_POSITIVE).sqrt()
    }
}

/// Compares the picture with the fitted code.
pub(super) fn ring_evidence(patch: &Patch, fitted: &Fitted) -> Option<RingEvidence> {
    let scene = &fitted.scene;
    let frame = &scene.frame;
    let back = frame.map.try_inverse()?;
    let mut offs = vec![Off::default(); patch.columns * patch.rows];
    let (mut squares, mut count) = (0.0, 0.0);
    let lines = fitted.sketch.lines();
    let mut cracks = vec![Border::default(); fitted.bits.len()];
    let mut borders = vec![Border::default(); fitted.bits.len()];
    scene.compare(
        patch,
        &fitted.sketch,
        &shown(&fitted.shares),
        |column, row, grey, seen| {
            let light = seen.light.max(0.25 * scene.light[0]);
            let share = seen.ring.value + seen.dot.value;
            let slope = (seen.ring.slope + scene.dot_light * seen.dot.slope).norm();
            let off = (grey - seen.grey) / light;
            offs[row * patch.columns + column] = Off {
                off,
                tolerated: (DARK + (LIGHT - DARK) * (2.0 * share).min(1.0)).max(FRAME_PX * slope),
                count: 1.0,
            };
            let place = Place::of(frame, &back, column, row);
            // The picture as a border goes forward by a radian.
            let turned = frame.map * Vector2::new(-place.affine.y, place.affine.x);
            let border = place.nearest_border(fitted.bits.len());
            borders[border].add(grey - seen.grey, -seen.light * seen.ring.slope.dot(&turned));
            cracks[border].add(grey - seen.grey, seen.light * lines.value(column, row));
            squares += off * off;
            count += 1.0;
        },
    );
    let noise = NOISE_SIGMAS * patch.noise / scene.light[0];
    // What is uneven round a narrow segment is taken for its level as noise is.
    let uneven = f64::hypot(
        1.0,
        UNEVEN * scene.light[0] / patch.noise.max(f64::MIN_POSITIVE),
    );
    let mut departures: Vec<f64> = fitted
        .shares
        .iter()
        .zip(&fitted.bits)
        .zip(&fitted.sigmas)
        .map(|((share, &light), sigma)| {
            let (level, even) = if light {
                (1.0, LIGHT_SEGMENT)
            } else {
                (0.0, DARK_SEGMENT)
            };
            (share - level).abs() / f64::hypot(even, NOISE_SIGMAS * uneven * sigma)
        })
        .collect();
    for (index, border) in borders.iter().enumerate() {
        let behind = (index + departures.len() - 1) % departures.len();
        let (border, px) = if fitted.bits[index] == fitted.bits[behind] {
            (&cracks[index], 1.0)
        } else {
            let angle = std::f64::consts::TAU * index as f64 / departures.len() as f64;
            let along = frame.map * Vector2::new(-angle.sin(), angle.cos());
            (border, MIDDLE * along.norm())
        };
        let departure = px * border.shift().abs()
            / f64::hypot(BORDER_PX, NOISE_SIGMAS * px * border.sigma(patch.noise));
        departures[index] = departures[index].max(departure);
    }
    for (column, row, _) in patch.pixels() {
        let sum = around(&offs, patch, column, row);
        let departure = sum.off.abs() / sum.tolerated.hypot(noise * sum.count.sqrt());
        let place = Place::of(frame, &back, column, row);
        let largest = &mut departures[place.segment(fitted.bits.len())];
        *largest = largest.max(departure);
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
