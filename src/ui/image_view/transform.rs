//! Where a pixel of the picture stands on the screen.

use egui::{Pos2, Rect, Vec2, pos2};
use nalgebra::Vector2;

/// Least and largest magnification, screen points per pixel.
const SCALES: std::ops::RangeInclusive<f64> = 0.005..=200.0;

/// The one transform between picture (px, y down, origin at the corner of the first pixel) and screen (points).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScreenFromImage {
    /// Screen points per pixel.
    pub scale: f64,
    /// Where the picture's corner stands, points.
    pub origin: Vector2<f64>,
}

/// A part of the picture, px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelRect {
    /// Upper left corner.
    pub min: Vector2<f64>,
    /// Lower right corner.
    pub max: Vector2<f64>,
}

impl PixelRect {
    /// Whether a place is inside, or no farther outside than `margin` px.
    #[must_use]
    pub fn holds(&self, place: Vector2<f64>, margin: f64) -> bool {
        place.x >= self.min.x - margin
            && place.x <= self.max.x + margin
            && place.y >= self.min.y - margin
            && place.y <= self.max.y + margin
    }
}

impl ScreenFromImage {
    /// The transform that shows `centre` (px) in the middle of `rect`.
    #[must_use]
    pub fn centred(rect: Rect, centre: Vector2<f64>, scale: f64) -> Self {
        let middle = Vector2::new(f64::from(rect.center().x), f64::from(rect.center().y));
        Self {
            scale,
            origin: middle - centre * scale,
        }
    }

    /// The magnification at which a picture just fits.
    #[must_use]
    pub fn fitting_scale(rect: Rect, size: [u32; 2]) -> f64 {
        let across = f64::from(rect.width()) / f64::from(size[0].max(1));
        let down = f64::from(rect.height()) / f64::from(size[1].max(1));
        across.min(down).clamp(*SCALES.start(), *SCALES.end())
    }

    /// Screen place of a place in the picture.
    #[must_use]
    pub fn point(&self, place: Vector2<f64>) -> Pos2 {
        let point = self.origin + place * self.scale;
        pos2(point.x as f32, point.y as f32)
    }

    /// Place in the picture of a screen place.
    #[must_use]
    pub fn pixel(&self, point: Pos2) -> Vector2<f64> {
        (Vector2::new(f64::from(point.x), f64::from(point.y)) - self.origin) / self.scale
    }

    /// A length in px on the screen.
    #[must_use]
    pub fn length(&self, px: f64) -> f32 {
        (px * self.scale) as f32
    }

    /// The part of the picture in a part of the screen.
    #[must_use]
    pub fn visible(&self, rect: Rect) -> PixelRect {
        PixelRect {
            min: self.pixel(rect.min),
            max: self.pixel(rect.max),
        }
    }
}

/// What the operator looks at: independent of the panel's size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Sight {
    /// The whole picture.
    Fit,
    /// A place in the middle of the panel.
    At {
        /// The place, px.
        centre: Vector2<f64>,
        /// Screen points per pixel.
        scale: f64,
    },
}

impl Sight {
    /// The transform for a panel and a picture of `size` columns and rows.
    #[must_use]
    pub(super) fn transform(&self, rect: Rect, size: [u32; 2]) -> ScreenFromImage {
        match *self {
            Sight::Fit => {
                let middle = Vector2::new(f64::from(size[0]), f64::from(size[1])) / 2.0;
                ScreenFromImage::centred(rect, middle, ScreenFromImage::fitting_scale(rect, size))
            }
            Sight::At { centre, scale } => ScreenFromImage::centred(rect, centre, scale),
        }
    }

    /// Magnified by a factor; the place under `about` stays where it is.
    #[must_use]
    pub(super) fn zoomed(&self, rect: Rect, size: [u32; 2], about: Pos2, factor: f64) -> Self {
        let before = self.transform(rect, size);
        let scale = (before.scale * factor).clamp(*SCALES.start(), *SCALES.end());
        let fixed = before.pixel(about);
        let of = |point: Pos2| Vector2::new(f64::from(point.x), f64::from(point.y));
        let offset = (of(about) - of(rect.center())) / scale;
        Sight::At {
            centre: fixed - offset,
            scale,
        }
    }

    /// Moved by a drag on the screen.
    #[must_use]
    pub(super) fn moved(&self, rect: Rect, size: [u32; 2], drag: Vec2) -> Self {
        let before = self.transform(rect, size);
        Sight::At {
            centre: before.pixel(rect.center() - drag),
            scale: before.scale,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::vec2;
    use proptest::prelude::*;

    fn rect() -> Rect {
        Rect::from_min_size(pos2(30.0, 50.0), vec2(800.0, 500.0))
    }

    proptest! {
        #[test]
        fn there_and_back(x in 0.0..6000.0, y in 0.0..4000.0, scale in 0.05..64.0) {
            let sight = Sight::At { centre: Vector2::new(3000.0, 2000.0), scale };
            let transform = sight.transform(rect(), [6000, 4000]);
            let place = Vector2::new(x, y);
            // Screen places are f32 of up to 2e5 points: a hundredth of a point.
            let error = (transform.pixel(transform.point(place)) - place).norm();
            prop_assert!(error < 0.03 / scale + 1e-9, "{error}");
        }

        #[test]
        fn the_place_under_the_pointer_stays(x in 30.0..830.0_f32, y in 50.0..550.0_f32, factor in 0.2..8.0) {
            let about = pos2(x, y);
            let before = Sight::Fit.transform(rect(), [3000, 2000]).pixel(about);
            let after = Sight::Fit.zoomed(rect(), [3000, 2000], about, factor);
            let after = after.transform(rect(), [3000, 2000]).pixel(about);
            prop_assert!((before - after).norm() < 1e-6);
        }
    }

    #[test]
    fn a_fitted_picture_is_all_visible() {
        let transform = Sight::Fit.transform(rect(), [3000, 1000]);
        let visible = transform.visible(rect());
        // A millipixel for the f32 of the screen.
        assert!(visible.min.x.abs() < 1e-3 && (visible.max.x - 3000.0).abs() < 1e-3);
        assert!(visible.holds(Vector2::new(1500.0, 999.0), 0.0));
        assert!(!visible.holds(Vector2::new(3100.0, 500.0), 50.0));
    }

    #[test]
    fn a_drag_moves_the_picture_with_the_pointer() {
        let place = Sight::Fit
            .transform(rect(), [3000, 2000])
            .pixel(pos2(200.0, 200.0));
        let moved = Sight::Fit.moved(rect(), [3000, 2000], vec2(40.0, -30.0));
        let found = moved.transform(rect(), [3000, 2000]).point(place);
        assert!((found - pos2(240.0, 170.0)).length() < 1e-2);
    }
}
