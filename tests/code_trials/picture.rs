//! Small pictures made quickly: sixteen samples a pixel where something ends, the lens's blur over whole pixels.

use nalgebra::Vector2;
use rand_chacha::ChaCha8Rng;
use tiepoint::imaging::{BitDepth, GreyImage};

use super::normals;

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

/// What is seen at a place.
#[derive(Clone, Copy, PartialEq)]
pub(crate) struct Shade {
    /// Of which part of the scene; parts that touch have different numbers even where they are equally light.
    pub(crate) part: u32,
    /// Light, grey values.
    pub(crate) grey: f64,
}

/// A picture of `width` by `height` pixels whose light at a place (px) is `shade`.
pub(crate) fn picture(
    size: [usize; 2],
    shade: impl Fn(Vector2<f64>) -> Shade,
    exposure: &Exposure,
    random: &mut ChaCha8Rng,
) -> GreyImage {
    developed(size, &still(size, shade, exposure), exposure, random)
}

/// The picture without noise, row by row, grey values.
pub(crate) fn still(
    [width, height]: [usize; 2],
    shade: impl Fn(Vector2<f64>) -> Shade,
    exposure: &Exposure,
) -> Vec<f64> {
    let corners: Vec<Shade> = (0..(width + 1) * (height + 1))
        .map(|k| {
            shade(Vector2::new(
                (k % (width + 1)) as f64,
                (k / (width + 1)) as f64,
            ))
        })
        .collect();
    let mut sharp = vec![0.0; width * height];
    for (index, value) in sharp.iter_mut().enumerate() {
        let (column, row) = (index % width, index / width);
        // A part may reach into a pixel between its corners, but not past the corners of the pixels round it.
        let first = corners[row * (width + 1) + column];
        let even = (row.saturating_sub(1)..=(row + 2).min(height)).all(|row| {
            let line = &corners[row * (width + 1)..][..=width];
            let near = column.saturating_sub(1)..=(column + 2).min(width);
            line[near].iter().all(|corner| corner.part == first.part)
        });
        if even {
            *value = first.grey;
            continue;
        }
        let corner = Vector2::new(column as f64, row as f64);
        let mut sum = 0.0;
        for fine in 0..FINE * FINE {
            let step = Vector2::new((fine % FINE) as f64 + 0.5, (fine / FINE) as f64 + 0.5);
            sum += shade(corner + step / FINE as f64).grey;
        }
        *value = sum / (FINE * FINE) as f64;
    }
    let across = blurred(&sharp, width, exposure.blur_px);
    let upright = turned(&across, width);
    turned(&blurred(&upright, height, exposure.blur_px), height)
}

/// Noise and whole grey values on a picture.
pub(crate) fn developed(
    [width, height]: [usize; 2],
    still: &[f64],
    exposure: &Exposure,
    random: &mut ChaCha8Rng,
) -> GreyImage {
    let mut samples = Vec::with_capacity(still.len());
    for pair in still.chunks(2) {
        let noise = normals(random);
        samples.extend(pair.iter().zip(noise).map(|(value, noise)| {
            (value + exposure.noise * noise).round().clamp(0.0, 255.0) as u16
        }));
    }
    GreyImage::new(width as u32, height as u32, BitDepth::Eight, samples)
        .expect("as many samples as pixels")
}

/// Every row convolved with the Gaussian; beyond its ends a row goes on as it ends.
fn blurred(rows: &[f64], width: usize, sigma: f64) -> Vec<f64> {
    let reach = (3.5 * sigma).ceil() as usize;
    let mut kernel: Vec<f64> = (0..=2 * reach)
        .map(|k| (-0.5 * ((k as f64 - reach as f64) / sigma).powi(2)).exp())
        .collect();
    let sum: f64 = kernel.iter().sum();
    kernel.iter_mut().for_each(|weight| *weight /= sum);
    let mut out = Vec::with_capacity(rows.len());
    let mut longer = vec![0.0; width + 2 * reach];
    for row in rows.chunks(width) {
        longer[..reach].fill(row[0]);
        longer[reach..reach + width].copy_from_slice(row);
        longer[reach + width..].fill(row[width - 1]);
        out.extend(longer.windows(kernel.len()).map(|near| {
            let products = near.iter().zip(&kernel);
            products.map(|(value, weight)| value * weight).sum::<f64>()
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
