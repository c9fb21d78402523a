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
    /// Below this many differences nothing can be said.
    const TOO_FEW: usize = 100;
    let rounding = 1.0 / 12.0_f64.sqrt();
    let white = image.depth().white();
    let pixels = image.width() * image.height();
    let stride = (pixels / DIFFERENCES).max(1);
    let rows_apart = stride.isqrt().max(1);
    let columns_apart = stride.div_ceil(rows_apart).max(1);
    let mut sizes: Vec<u32> = Vec::new();
    for row in (0..image.height()).step_by(rows_apart) {
        for triple in image.row(row).windows(3).step_by(columns_apart) {
            let [left, middle, right] = [triple[0], triple[1], triple[2]];
            let open = |grey: u16| grey > 0 && grey < white;
            if open(left) && open(middle) && open(right) {
                let difference = i64::from(left) - 2 * i64::from(middle) + i64::from(right);
                sizes.push(difference.unsigned_abs() as u32);
            }
        }
    }
    if sizes.len() < TOO_FEW {
        return rounding;
    }
    (median_of_whole_numbers(&mut sizes) * 1.4826 / 6.0_f64.sqrt()).max(rounding)
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
}
