//! Small pictures made quickly: sixteen samples a pixel, the lens's blur over whole pixels.

use nalgebra::Vector2;
use rand_chacha::ChaCha8Rng;
use tiepoint::imaging::{BitDepth, GreyImage};

use super::normal;

/// Samples a pixel side.
const FINE: usize = 4;

/// How light becomes grey values.
#[derive(Clone, Copy)]
pub(crate) struct Exposure {
    /// Standard deviation of the lens's blur, px.
    pub(crate) blur_px: f64,
    /// Standard deviation of the noise, grey values.
    pub(crate) noise: f64,
}

impl Default for Exposure {
    fn default() -> Self {
        Self {
            blur_px: 0.8,
            noise: 2.0,
        }
    }
}

/// A picture of `width` by `height` pixels whose light at a place (px) is `grey`.
pub(crate) fn picture(
    [width, height]: [usize; 2],
    grey: impl Fn(Vector2<f64>) -> f64,
    exposure: &Exposure,
    random: &mut ChaCha8Rng,
) -> GreyImage {
    let mut sharp = vec![0.0; width * height];
    for (index, value) in sharp.iter_mut().enumerate() {
        let corner = Vector2::new((index % width) as f64, (index / width) as f64);
        let mut sum = 0.0;
        for fine in 0..FINE * FINE {
            let step = Vector2::new((fine % FINE) as f64 + 0.5, (fine / FINE) as f64 + 0.5);
            sum += grey(corner + step / FINE as f64);
        }
        *value = sum / (FINE * FINE) as f64;
    }
    let across = blurred(&sharp, width, exposure.blur_px);
    let upright = turned(&across, width);
    let both = turned(&blurred(&upright, height, exposure.blur_px), height);
    let samples = both
        .iter()
        .map(|&v| {
            (v + exposure.noise * normal(random))
                .round()
                .clamp(0.0, 255.0) as u16
        })
        .collect();
    GreyImage::new(width as u32, height as u32, BitDepth::Eight, samples)
        .expect("as many samples as pixels")
}

/// Every row convolved with the Gaussian; beyond its ends a row goes on as it ends.
fn blurred(rows: &[f64], width: usize, sigma: f64) -> Vec<f64> {
    let reach = (3.5 * sigma).ceil() as isize;
    let mut kernel: Vec<f64> = (-reach..=reach)
        .map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp())
        .collect();
    let sum: f64 = kernel.iter().sum();
    kernel.iter_mut().for_each(|weight| *weight /= sum);
    let last = width as isize - 1;
    let mut out = Vec::with_capacity(rows.len());
    for row in rows.chunks(width) {
        out.extend((0..width as isize).map(|column| {
            (-reach..=reach)
                .zip(&kernel)
                .map(|(k, weight)| weight * row[(column + k).clamp(0, last) as usize])
                .sum::<f64>()
        }));
    }
    out
}

/// Rows as columns.
fn turned(rows: &[f64], width: usize) -> Vec<f64> {
    let height = rows.len() / width;
    (0..rows.len())
        .map(|index| rows[(index % height) * width + index / height])
        .collect()
}
