//! Colours of the 3D view: the meanings of `ui/theme.rs`, neutral lines for either theme, and viridis for numbers.

use egui::Color32;

use super::options::Colouring;
use crate::network::Point;
use crate::network::PointKind;
use crate::ui::theme;

/// Viridis (van der Walt and Smith, 2015) at nine even steps, from small to large.
const VIRIDIS: [[f64; 3]; 9] = [
    [68.0, 1.0, 84.0],
    [71.0, 45.0, 123.0],
    [59.0, 82.0, 139.0],
    [44.0, 114.0, 142.0],
    [33.0, 145.0, 140.0],
    [40.0, 174.0, 128.0],
    [94.0, 201.0, 98.0],
    [173.0, 220.0, 48.0],
    [253.0, 231.0, 37.0],
];

/// The colour of a part from 0 to 1; beyond, the ends.
#[must_use]
pub(super) fn viridis(part: f64) -> Color32 {
    let part = if part.is_finite() {
        part.clamp(0.0, 1.0)
    } else {
        0.0
    };
    let place = part * (VIRIDIS.len() - 1) as f64;
    let below = (place.floor() as usize).min(VIRIDIS.len() - 2);
    let along = place - below as f64;
    let [r, g, b] = std::array::from_fn(|channel| {
        let (low, high) = (VIRIDIS[below][channel], VIRIDIS[below + 1][channel]);
        (low + (high - low) * along).round() as u8
    });
    Color32::from_rgb(r, g, b)
}

/// Neutral colours for a dark or a light canvas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Palette {
    /// Behind everything.
    pub(super) canvas: Color32,
    /// Names and numbers.
    pub(super) text: Color32,
    /// Stations.
    pub(super) station: Color32,
    /// Scale bars.
    pub(super) bar: Color32,
    /// The line of the connection order.
    pub(super) order: Color32,
    /// Points whose number is not known, and dots of the reference cross.
    pub(super) neutral: Color32,
    /// Rim of points, so that pale ones stand out on a pale ground.
    pub(super) rim: Color32,
}

impl Palette {
    /// The palette of a theme.
    pub(super) fn of(theme: egui::Theme) -> Self {
        match theme {
            egui::Theme::Dark => Self {
                canvas: Color32::from_rgb(19, 21, 25),
                text: Color32::from_rgb(222, 224, 228),
                station: Color32::from_rgb(150, 156, 168),
                bar: Color32::from_rgb(236, 238, 242),
                order: Color32::from_rgb(96, 104, 124),
                neutral: Color32::from_rgb(200, 202, 206),
                rim: Color32::from_rgb(19, 21, 25),
            },
            egui::Theme::Light => Self {
                canvas: Color32::from_rgb(248, 248, 246),
                text: Color32::from_rgb(36, 38, 42),
                station: Color32::from_rgb(104, 110, 122),
                bar: Color32::from_rgb(20, 22, 26),
                order: Color32::from_rgb(172, 178, 190),
                neutral: Color32::from_rgb(96, 98, 104),
                rim: Color32::from_rgb(48, 50, 56),
            },
        }
    }

    /// The colour of a kind of point.
    pub(super) fn kind(&self, kind: PointKind) -> Color32 {
        match kind {
            PointKind::Code => theme::CODE,
            PointKind::Target => theme::USED,
            PointKind::Cross => self.neutral,
        }
    }
}

/// Numbers that colours stand for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ColourScale {
    /// At the dark end of viridis.
    pub(super) low: f64,
    /// At its light end.
    pub(super) high: f64,
    /// The largest of all values, which may lie beyond the light end.
    pub(super) largest: f64,
}

/// Part of the points at either end of the colours that has the end's colour, so that one bad point does not take the
/// contrast from all others.
const CLIPPED_PART: f64 = 0.02;

impl ColourScale {
    /// The scale over these values; `None` where there are none.
    pub(super) fn over(values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let last = values.len().checked_sub(1)?;
        let clipped = (last as f64 * CLIPPED_PART).floor() as usize;
        Some(Self {
            low: values[clipped],
            high: values[last - clipped],
            largest: values[last],
        })
    }

    /// The colour of a value.
    pub(super) fn colour(&self, value: f64) -> Color32 {
        let width = self.high - self.low;
        viridis(if width > 0.0 {
            (value - self.low) / width
        } else {
            0.5
        })
    }
}

/// The number that a colouring shows of a point: sigma in mm, rays without unit; `None` where it is not known or the
/// colouring shows no number.
pub(super) fn shown_number(colouring: Colouring, point: &Point) -> Option<f64> {
    match colouring {
        Colouring::Kind => None,
        Colouring::Precision => point
            .covariance
            .map(|covariance| (covariance.trace() / 3.0).sqrt()),
        Colouring::Rays => Some(f64::from(point.rays)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn viridis_rises_from_dark_to_light() {
        let brightness = |part: f64| {
            let [r, g, b, _] = viridis(part).to_array();
            0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b)
        };
        for step in 0..50 {
            assert!(brightness(f64::from(step + 1) / 50.0) > brightness(f64::from(step) / 50.0));
        }
        assert_eq!(viridis(-1.0), viridis(0.0));
        assert_eq!(viridis(2.0), Color32::from_rgb(253, 231, 37));
    }

    #[test]
    fn one_bad_point_leaves_the_scale() {
        let mut values = vec![1e6, f64::NAN];
        values.extend((0..100).map(f64::from));
        let scale = ColourScale::over(values.into_iter()).unwrap();
        assert!(scale.high < 100.0 && scale.low >= 0.0);
        assert_eq!(scale.largest, 1e6);
        assert_eq!(ColourScale::over(std::iter::empty()), None);
    }
}
