//! Window and level: which grey values are shown.

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
    fn a_drag_to_the_right_narrows_the_window() {
        let before = GreyWindow {
            black: 0.0,
            white: 200.0,
        };
        let after = before.dragged(egui::vec2(100.0, 0.0), 255.0);
        assert!(after.white - after.black < 130.0 && after.black > 0.0);
    }
}
