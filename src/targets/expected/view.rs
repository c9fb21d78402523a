//! What all expected dots of a picture share.

use nalgebra::Vector2;

use super::super::Dot;
use super::super::dot::View;
use super::super::ellipse::{Axes, Ellipse};
use super::super::rows::ByRows;
use super::ExpectedSettings;
use super::filter::{Search, best_place};
use super::fit::{Estimate, Observed, estimate};
use super::patch::Patch;
use crate::imaging::{GreyImage, noise_level, noise_of_means};

/// A picture with its noise, its measured dots and their blur: made once for all dots that are expected in it.
#[derive(Clone, Debug)]
pub struct ExpectedView<'a> {
    pub(super) view: View<'a>,
    pub(super) dots: &'a [Dot],
    pub(super) blur: Blur,
    /// How many times larger sigmas are than independent residuals make them.
    pub(super) widening: f64,
    by_rows: ByRows<usize>,
}

/// Standard deviation of the edges' blur, the pixel's own width included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Blur {
    pub(super) px: f64,
    /// Its own standard deviation, as a share.
    pub(super) sigma: f64,
}

/// That of a sharp lens, where no dot tells it.
const UNKNOWN: Blur = Blur {
    px: 0.8,
    sigma: 0.4,
};

impl<'a> ExpectedView<'a> {
    /// Of a picture and the dots that are measured in it, labelled or not: they are the neighbours of those expected, and some
    /// of them tell the blur.
    #[must_use]
    pub fn new(image: &'a GreyImage, dots: &'a [Dot]) -> Self {
        let noise = noise_level(image);
        let rows = dots.iter().enumerate().map(|(slot, dot)| {
            let reach = 0.5 * dot.major_px;
            (dot.centre_px.y, reach, slot)
        });
        let mut own = Self {
            view: View {
                image,
                noise,
                grain: noise_of_means(image).max(noise),
                clipping: image.clipping().map(f64::from),
            },
            dots,
            blur: UNKNOWN,
            widening: 1.0,
            by_rows: ByRows::new(rows),
        };
        own.learn();
        own
    }

    /// Standard deviation of the noise as a filter of a dot's size feels it, grey values: that of texture where there is one.
    pub(super) fn noise(&self) -> f64 {
        match self.view.is_even() {
            true => self.view.noise,
            false => self.view.grain,
        }
    }

    /// Dots whose rows come nearer than `reach` px to that of a place.
    pub(super) fn near(&self, row: f64, reach: f64) -> impl Iterator<Item = usize> {
        self.by_rows.between(row - reach, row + reach).copied()
    }

    /// Learns from some bright dots, measured once more, the common blur and how far residuals hang together: detection's
    /// sigmas hold that.
    fn learn(&mut self) {
        /// So many dots are asked, spread over the picture.
        const MOST: usize = 15;
        /// Fewer tell nothing.
        const LEAST: usize = 3;
        /// Narrower dots tell the blur from the width badly, px.
        const LEAST_MINOR_PX: f64 = 3.0;
        const LEAST_CONTRAST_TO_NOISE: f64 = 10.0;
        /// Blurs are no better known than this, as a share.
        const LEAST_SIGMA: f64 = 0.1;
        let largest_px = ExpectedSettings::default().largest_px;
        let is_clear = |dot: &&Dot| {
            dot.minor_px >= LEAST_MINOR_PX
                && dot.major_px <= largest_px
                && dot.contrast >= LEAST_CONTRAST_TO_NOISE * self.view.noise
        };
        let clear: Vec<&Dot> = self.dots.iter().filter(is_clear).collect();
        let every = clear.len().div_ceil(MOST).max(1);
        let (mut blurs, mut wider) = (Vec::new(), Vec::new());
        for dot in clear.into_iter().step_by(every) {
            if let Some(found) = self.measured_again(dot) {
                blurs.push(found.blur);
                wider.push(dot.sigma_px / found.sigma_px);
            }
        }
        if blurs.len() < LEAST {
            return;
        }
        let px = quantile(&mut blurs, 0.5);
        let mut departures: Vec<f64> = blurs.iter().map(|blur| (blur / px).ln().abs()).collect();
        self.blur = Blur {
            px,
            sigma: (1.4826 * quantile(&mut departures, 0.5)).max(LEAST_SIGMA),
        };
        // What is wider than others has a reason of its own.
        self.widening = quantile(&mut wider, 1.0 / 3.0).max(1.0);
    }

    fn measured_again(&self, dot: &Dot) -> Option<Estimate> {
        /// Root mean square, as a share of the contrast.
        const LARGEST_MISFIT: f64 = 0.1;
        let settings = ExpectedSettings::default();
        let observed = Observed {
            axes: axes_of(dot),
            blur: UNKNOWN.px,
            axes_sigma: [settings.axes_sigma; 2],
            angle_sigma: settings.angle_sigma,
            blur_sigma: UNKNOWN.sigma,
        };
        let patch = Patch::without_neighbours(self, dot.centre_px, &observed, 0.0);
        let best = best_place(&patch, &observed, &Search::at_one_place(&settings))?;
        let found = estimate(&patch, &observed, &best).ok()?;
        (found.residual < LARGEST_MISFIT * found.contrast).then_some(found)
    }
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[(share * values.len() as f64) as usize]
}

fn axes_of(dot: &Dot) -> Axes {
    Axes {
        major: 0.5 * dot.major_px,
        minor: 0.5 * dot.minor_px,
        angle: dot.angle,
    }
}

/// The outline of a dot, relative to an origin, px.
pub(super) fn ellipse_of(dot: &Dot, origin: Vector2<f64>) -> Ellipse {
    Ellipse::from_axes(dot.centre_px - origin, axes_of(dot))
}
