//! Window and level: which grey values are shown.

use super::transform::PixelRect;
use crate::imaging::GreyImage;

/// Grey values shown black and white.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GreyWindow {
    /// This grey value and darker ones are black.
    pub black: f64,
    /// This grey value and lighter ones are white.
    pub white: f64,
}

impl GreyWindow {
    /// The window that shows nearly all grey values of a picture.
    #[must_use]
    pub fn of_picture(picture: &GreyImage) -> Self {
        /// So many samples tell it well enough.
        const SAMPLES: usize = 20_000;
        let stride = (picture.samples().len() / SAMPLES).max(1) | 1;
        let mut greys: Vec<u16> = picture.samples().iter().copied().step_by(stride).collect();
        greys.sort_unstable();
        if greys.is_empty() {
            return Self {
                black: 0.0,
                white: 255.0,
            };
        }
        let at = |share: f64| f64::from(greys[((greys.len() - 1) as f64 * share) as usize]);
        // Targets are few: the lightest samples are theirs, and their profiles must not be cut off. The floor opens pictures of nothing but dark.
        let least_width = f64::from(picture.depth().white()) / 4.0;
        let black = at(0.005);
        Self {
            black,
            white: at(1.0).max(black + least_width),
        }
    }

    /// The window that opens a part of a picture, faint dots in the dark among it.
    #[must_use]
    pub(super) fn of_part(picture: &GreyImage, part: &PixelRect) -> Self {
        /// So many rows and columns tell it well enough.
        const SAMPLES_A_SIDE: usize = 160;
        /// Noise is not to be stretched over the whole range: a thirty-second of it is kept.
        const LEAST_SHARE: f64 = 1.0 / 32.0;
        let range = |from: f64, to: f64, count: usize| {
            let from = from.floor().clamp(0.0, count as f64) as usize;
            from..(to.ceil().clamp(0.0, count as f64) as usize).max(from)
        };
        let columns = range(part.min.x, part.max.x, picture.width());
        let rows = range(part.min.y, part.max.y, picture.height());
        let stride = |length: usize| length.div_ceil(SAMPLES_A_SIDE).max(1);
        let (across, down) = (stride(columns.len()), stride(rows.len()));
        let mut greys: Vec<u16> = rows
            .step_by(down)
            .flat_map(|row| picture.row(row)[columns.clone()].iter().step_by(across))
            .copied()
            .collect();
        greys.sort_unstable();
        let (Some(lowest), Some(highest)) = (greys.get(greys.len() / 100), greys.last()) else {
            return Self::of_picture(picture);
        };
        let (black, white) = (f64::from(*lowest), f64::from(*highest));
        let least = f64::from(picture.depth().white()) * LEAST_SHARE;
        Self {
            black,
            white: white.max(black + least),
        }
    }

    /// Dragged by `drag` points: across changes the width, down the middle.
    #[must_use]
    pub fn dragged(self, drag: egui::Vec2, white: f64) -> Self {
        let width = (self.white - self.black) * f64::from(-drag.x / 200.0).exp();
        let width = width.clamp(white / 500.0, white * 2.0);
        let middle = 0.5 * (self.white + self.black) + f64::from(drag.y) / 400.0 * width;
        let middle = middle.clamp(0.0, white);
        Self {
            black: middle - 0.5 * width,
            white: middle + 0.5 * width,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dark_part_is_opened_by_its_own_greys() {
        let samples = (0..100 * 80)
            .map(|slot| if slot % 100 < 50 { 20 + slot % 7 } else { 200 })
            .collect();
        let depth = crate::imaging::BitDepth::Eight;
        let picture = GreyImage::new(100, 80, depth, samples).expect("as many samples as pixels");
        let part = PixelRect {
            min: nalgebra::Vector2::new(-10.0, 5.0),
            max: nalgebra::Vector2::new(40.0, 60.0),
        };
        let dark = GreyWindow::of_part(&picture, &part);
        assert_eq!((dark.black, dark.white), (20.0, 20.0 + 255.0 / 32.0));
        let beside = PixelRect {
            min: nalgebra::Vector2::new(400.0, 5.0),
            max: nalgebra::Vector2::new(500.0, 60.0),
        };
        let whole = GreyWindow::of_picture(&picture);
        assert_eq!(GreyWindow::of_part(&picture, &beside), whole);
    }

    #[test]
    fn a_drag_to_the_right_narrows_the_window() {
        let before = GreyWindow {
            black: 0.0,
            white: 200.0,
        };
        let after = before.dragged(egui::vec2(100.0, 0.0), 255.0);
        assert!(after.white - after.black < 130.0 && after.black > 0.0);
    }
}
