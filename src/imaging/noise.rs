//! The noise level of a picture.

use super::GreyImage;

/// Robust standard deviation of the grey values' noise, from second differences along the rows.
///
/// The differences `I(x-1) - 2 I(x) + I(x+1)` have a standard deviation of sqrt(6) times the noise. Pixels
/// at black or white are left out (clipping hides their noise); the result is at least that of rounding to whole grey
/// values, 1/sqrt(12).
#[must_use]
pub fn noise_level(image: &GreyImage) -> f64 {
    /// About this many differences are enough: their median is then known to half a per cent.
    const DIFFERENCES: usize = 50_000;
    let white = image.depth().white();
    let [rows_apart, columns_apart] = steps(image, DIFFERENCES);
    let mut sizes: Vec<u32> = Vec::new();
    let mut looked_at = 0;
    for row in (0..image.height()).step_by(rows_apart) {
        for triple in image.row(row).windows(3).step_by(columns_apart) {
            looked_at += 1;
            let [left, middle, right] = [triple[0], triple[1], triple[2]];
            let open = |grey: u16| grey > 0 && grey < white;
            if open(left) && open(middle) && open(right) {
                let difference = i64::from(left) - 2 * i64::from(middle) + i64::from(right);
                sizes.push(difference.unsigned_abs() as u32);
            }
        }
    }
    spread(sizes, looked_at).max(ROUNDING)
}

/// Twice the robust standard deviation of the means of 2 x 2 pixels: [`noise_level`] where the noise of the pixels is
/// independent, more where they hang together or the surface has a texture.
///
/// From second differences of means 4 px apart, as [`noise_level`]; left out are means with a white pixel or of black ones alone.
#[must_use]
pub fn noise_of_means(image: &GreyImage) -> f64 {
    /// Enough for two per cent.
    const DIFFERENCES: usize = 12_500;
    /// Columns of three pairs, 4 px apart.
    const REACH: usize = 10;
    let white = image.depth().white();
    let [rows_apart, columns_apart] = steps(image, DIFFERENCES);
    let mut sizes: Vec<u32> = Vec::new();
    let mut looked_at = 0;
    for row in (1..image.height()).step_by(rows_apart) {
        let [upper, lower] = [row - 1, row].map(|row| image.row(row).windows(REACH));
        for (upper, lower) in upper.zip(lower).step_by(columns_apart) {
            looked_at += 1;
            let sums = [0, 4, 8].map(|first| {
                let four = [
                    upper[first],
                    upper[first + 1],
                    lower[first],
                    lower[first + 1],
                ];
                let sum: u32 = four.into_iter().map(u32::from).sum();
                (sum > 0 && !four.contains(&white)).then_some(i64::from(sum))
            });
            if let [Some(left), Some(middle), Some(right)] = sums {
                sizes.push((left - 2 * middle + right).unsigned_abs() as u32);
            }
        }
    }
    (0.5 * spread(sizes, looked_at)).max(ROUNDING)
}

/// Standard deviation of rounding to whole grey values, 1/sqrt(12).
const ROUNDING: f64 = 0.288_675_134_594_812_9;

/// Rows and columns apart at which a picture is looked at so often.
fn steps(image: &GreyImage, looks: usize) -> [usize; 2] {
    let stride = (image.width() * image.height() / looks).max(1);
    let rows_apart = stride.isqrt().max(1);
    [rows_apart, stride.div_ceil(rows_apart).max(1)]
}

/// Robust standard deviation of what second differences of these sizes were taken of; 0 where too few of those looked at are left.
fn spread(mut sizes: Vec<u32>, looked_at: usize) -> f64 {
    /// Below this many differences nothing can be said.
    const TOO_FEW: usize = 100;
    /// Where fewer than one in so many is open, the picture is black and white, and what is open are edges.
    const ONE_OPEN_IN: usize = 10;
    if sizes.len() < TOO_FEW.max(looked_at / ONE_OPEN_IN) {
        return 0.0;
    }
    median_of_whole_numbers(&mut sizes) * 1.4826 / 6.0_f64.sqrt()
}

/// Median of whole numbers whose true values are spread over half a unit either way: interpolates inside the class of
/// the median, because noise of one grey value would otherwise come in steps of half of it.
fn median_of_whole_numbers(sizes: &mut [u32]) -> f64 {
    let half = sizes.len() / 2;
    let (_, &mut middle, _) = sizes.select_nth_unstable(half);
    let below = sizes.iter().filter(|&&size| size < middle).count();
    let equal = sizes.iter().filter(|&&size| size == middle).count();
    let share = (sizes.len() as f64 / 2.0 - below as f64) / equal as f64;
    // Sizes are absolute: the class 0 reaches from 0 to one half only.
    if middle == 0 {
        share * 0.5
    } else {
        f64::from(middle) - 0.5 + share
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::BitDepth;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn a_picture_of_black_and_white_has_no_noise_at_its_edges() {
        let samples = (0..400 * 200)
            .map(|i| match i % 50 {
                0..20 => 0,
                20 => 90,
                21 => 160,
                22 => 230,
                _ => 255,
            })
            .collect();
        let image = GreyImage::new(400, 200, BitDepth::Eight, samples).unwrap();
        assert_eq!(noise_level(&image), 1.0 / 12.0_f64.sqrt());
    }

    #[test]
    fn the_noise_of_a_slope_with_bright_spots_is_found() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let truth = 2.0;
        let samples = (0..300 * 200)
            .map(|i| {
                let gauss: f64 = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
                let spot = if i % 37 < 3 { 100.0 } else { 0.0 };
                (40.0 + f64::from(i % 300) * 0.1 + spot + truth * gauss).round() as u16
            })
            .collect();
        let image = GreyImage::new(300, 200, BitDepth::Eight, samples).unwrap();
        // A tenth of the pixels lie at the spots' edges, which the median feels a little.
        assert!((noise_level(&image) / truth - 1.0).abs() < 0.25);
    }

    #[test]
    fn the_noise_of_means_is_that_of_pixels_unless_they_hang_together() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(2);
        let (width, height, truth) = (300, 200, 4.0);
        let noise: Vec<f64> = (0..width * height)
            .map(|_| truth * ((0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0))
            .collect();
        let picture = |grey: &dyn Fn(usize) -> f64| {
            let samples = (0..width * height).map(|slot| grey(slot).round() as u16);
            let samples = samples.collect();
            GreyImage::new(width as u32, height as u32, BitDepth::Eight, samples).unwrap()
        };
        let independent = noise_of_means(&picture(&|slot| 60.0 + noise[slot]));
        assert!((independent / truth - 1.0).abs() < 0.05, "{independent}");
        // Grain of 4 x 4 pixels beside it.
        let grain = |slot: usize| noise[slot / width / 4 * 100 + slot % width / 4];
        let textured = picture(&|slot| 60.0 + noise[slot] + grain(slot));
        assert!(noise_of_means(&textured) > 1.8 * noise_level(&textured));
    }
}
