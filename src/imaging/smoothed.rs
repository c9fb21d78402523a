//! A region of a picture with its noise smoothed: where faint targets keep their shape.

use super::tiles::TILE;
use super::{BitDepth, GreyImage, Region};

/// A region smoothed by the binomial of 3 x 3 pixels, as a picture of its own.
///
/// Independent noise becomes [`Smoothed::NOISE`] of what it was, and a dot of 4 px keeps nine tenths of its peak.
#[derive(Clone, Debug, PartialEq)]
pub struct Smoothed {
    /// The pixels of the region; 0 round them.
    pub image: GreyImage,
    /// The region in that picture, in its grey values.
    pub region: Region,
    /// Column and row of its first pixel in the whole picture.
    pub corner: [usize; 2],
    /// What a grey value of the whole picture is in it.
    pub scale: f64,
}

impl Smoothed {
    /// Noise that is left, as a share of that of independent pixels: 6/16.
    pub const NOISE: f64 = 0.375;

    /// Smooths a region of the picture.
    #[must_use]
    pub fn of(image: &GreyImage, region: &Region) -> Self {
        let [columns, rows] = region.bounds();
        let corner = [columns.start, rows.start];
        // Sixteen grey values of 8 bit are one of these; of 16 bit the sum is divided again.
        let shift = match image.depth() {
            BitDepth::Eight => 0,
            BitDepth::Sixteen => 4,
        };
        let scale = 16.0 / f64::from(1_u32 << shift);
        let width = columns.len();
        let mut samples = vec![0; width * rows.len()];
        let mut down = vec![0_u32; width + 2];
        for [row, first, end] in region.pieces() {
            let above = image.row(row.saturating_sub(1));
            let below = image.row((row + 1).min(image.height() - 1));
            let middle = image.row(row);
            // A column more on either side; the picture goes on as it ends.
            let reach = first.saturating_sub(1)..(end + 1).min(image.width());
            let sums = &mut down[1 - (first - reach.start)..][..reach.len()];
            let both = above[reach.clone()].iter().zip(&below[reach.clone()]);
            for ((sum, &grey), (&above, &below)) in
                sums.iter_mut().zip(&middle[reach.clone()]).zip(both)
            {
                *sum = binomial(u32::from(above), u32::from(grey), u32::from(below));
            }
            let count = end - first;
            if reach.start == first {
                down[0] = down[1];
            }
            if reach.end == end {
                down[count + 1] = down[count];
            }
            let place = (row - corner[1]) * width + first - corner[0];
            let samples = &mut samples[place..place + count];
            let (before, after) = (&down[..count], &down[2..count + 2]);
            let around = before.iter().zip(after).zip(&down[1..=count]);
            for (sample, ((&before, &after), &middle)) in samples.iter_mut().zip(around) {
                *sample = (binomial(before, middle, after) >> shift) as u16;
            }
        }
        Self {
            image: GreyImage::of_size([width, rows.len()], BitDepth::Sixteen, samples),
            region: region.moved([columns.start / TILE, rows.start / TILE], scale),
            corner,
            scale,
        }
    }
}

/// At most 2^20: a check for overflow would take longer than the sum.
fn binomial(before: u32, middle: u32, after: u32) -> u32 {
    before.wrapping_add(middle << 1).wrapping_add(after)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::Tiles;

    #[test]
    fn each_pixel_is_the_binomial_of_nine() {
        for (depth, scale) in [(BitDepth::Eight, 16.0), (BitDepth::Sixteen, 1.0)] {
            let (width, height) = (100, 70);
            let white = usize::from(depth.white()) + 1;
            let spot = |x: usize, y: usize| usize::from(x.abs_diff(60) < 20 && y.abs_diff(40) < 20);
            let grey = |x: usize, y: usize| {
                (white / 8 + spot(x, y) * white / 2 + (x * 7 + y * 13) % (white / 8)) as u16
            };
            let samples = (0..width * height)
                .map(|slot| grey(slot % width, slot / width))
                .collect();
            let image = GreyImage::new(width as u32, height as u32, depth, samples).unwrap();
            let rise = 0.2 * white as f64;
            let regions = Tiles::of(&image, 20.0).faint_regions(rise, white as f64);
            assert_eq!(regions.len(), 1);
            let smoothed = Smoothed::of(&image, &regions[0]);
            assert_eq!(smoothed.scale, scale);
            for [row, first, end] in smoothed.region.pieces() {
                for column in first..end {
                    let (x, y) = (column + smoothed.corner[0], row + smoothed.corner[1]);
                    let at = |dx: usize, dy: usize| {
                        let (x, y) = ((x + dx).max(1) - 1, (y + dy).max(1) - 1);
                        u32::from(grey(x.min(width - 1), y.min(height - 1)))
                    };
                    let weights = [1, 2, 1];
                    let sum: u32 = (0..9)
                        .map(|k| weights[k % 3] * weights[k / 3] * at(k % 3, k / 3))
                        .sum();
                    let expected = f64::from(sum) / 16.0 * scale;
                    assert_eq!(f64::from(smoothed.image.row(row)[column]), expected.floor());
                }
            }
        }
    }
}
