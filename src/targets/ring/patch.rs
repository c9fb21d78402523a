//! The pixels round a dot that show a ring code.

use nalgebra::Vector2;

use super::frame::RingFrame;
use crate::targets::dot::{MeasuredDot, View};

/// Pixels within this radius belong to the code, in radii of the dot: the ring and the beginning of the ground.
const REACH: f64 = 3.2;
/// The smaller semi-axis of a dot keeps at least so many pixels when the picture is reduced, for up to fourteen segments; more
/// are narrower, and leave more numbers to be mistaken for: what moves a border by the same share of a segment must show better.
const LEAST_RADIUS: f64 = 4.0;
const SEGMENTS: f64 = 14.0;
/// Variance of a pixel's square, pixels^2.
const VARIANCE_OF_PIXEL: f64 = 1.0 / 12.0;
/// A lens is not sharper, pixels.
const LEAST_BLUR: f64 = 0.3;

/// A rectangle of the picture, reduced by the mean of `step` x `step` pixels where the dot is large: what is left tells the
/// number as well and costs no more than a small code.
pub(super) struct Patch {
    /// Where the first pixel begins, px.
    pub(super) corner: Vector2<f64>,
    /// Side of a pixel of the patch, px.
    pub(super) step: f64,
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Grey values, row by row.
    greys: Vec<f32>,
    /// Whether a pixel belongs to the code.
    used: Vec<bool>,
    /// Standard deviation of the noise of a pixel of the patch, grey values.
    pub(super) noise: f64,
    /// Standard deviation of the blur, its own pixels included, in pixels of the patch.
    pub(super) blur: f64,
}

impl Patch {
    /// The part within the picture of what a dot and its frame say; `None` where nothing of it is.
    pub(super) fn of(
        view: &View,
        dot: &MeasuredDot,
        frame: &RingFrame,
        segments: &[u8],
    ) -> Option<Self> {
        let minor = dot.ellipse.axes()?.minor;
        let most = f64::from(segments.iter().copied().max()?);
        let step = ((minor / (LEAST_RADIUS * (most / SEGMENTS).max(1.0).powi(2))) as usize).max(1);
        let spread = (frame.map * frame.map.transpose()).diagonal();
        // The perspective moves the outline a little: the frame itself says what is used.
        let half = spread.map(|square| 1.05 * REACH * square.sqrt());
        let picture = [view.image.width(), view.image.height()];
        let first = (frame.centre - half).map(|place| place.max(0.0).floor());
        // Whole pixels of the patch.
        let pixels = |axis: usize| {
            let end = (frame.centre[axis] + half[axis]).min(picture[axis] as f64);
            ((end - first[axis]).max(0.0) / step as f64) as usize
        };
        let (columns, rows) = (pixels(0), pixels(1));
        if columns == 0 || rows == 0 {
            return None;
        }
        let (left, top) = (first.x as usize, first.y as usize);
        let share = 1.0 / (step * step) as f32;
        let mut greys = vec![0.0_f32; columns * rows];
        for (row, greys) in greys.chunks_mut(columns).enumerate() {
            for line in 0..step {
                let samples = &view.image.row(top + row * step + line)[left..];
                for (grey, block) in greys.iter_mut().zip(samples.chunks(step)) {
                    *grey += share * block.iter().map(|&sample| f32::from(sample)).sum::<f32>();
                }
            }
        }
        let step = step as f64;
        let lens = dot.blur * dot.blur - VARIANCE_OF_PIXEL;
        let blur = (lens / (step * step) + VARIANCE_OF_PIXEL).max(LEAST_BLUR * LEAST_BLUR);
        let mut patch = Self {
            corner: first,
            step,
            columns,
            rows,
            greys,
            used: Vec::with_capacity(columns * rows),
            noise: view.noise / step,
            blur: blur.sqrt(),
        };
        let local = frame.within(patch.corner, patch.step);
        for row in 0..rows {
            for column in 0..columns {
                let within = local.radius_at(middle(column, row)) < REACH;
                patch.used.push(within);
            }
        }
        Some(patch)
    }

    /// Column, row and grey value of every pixel of the code.
    pub(super) fn pixels(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        let all = self.used.iter().zip(&self.greys).enumerate();
        all.filter(|(_, (used, _))| **used)
            .map(|(slot, (_, grey))| (slot % self.columns, slot / self.columns, f64::from(*grey)))
    }
}

/// Middle of a pixel, in pixels of the patch.
pub(super) fn middle(column: usize, row: usize) -> Vector2<f64> {
    Vector2::new(column as f64 + 0.5, row as f64 + 0.5)
}
