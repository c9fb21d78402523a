//! Grey values of a measuring picture as a person can see them.

use crate::imaging::GreyImage;

/// What is shown at most: drawings in full colours stand out even on white.
const BRIGHTEST: f64 = 215.0;

/// For every grey value of the picture what is shown, 0 to 255.
///
/// The window reaches from the darkest to the brightest grey values but for a few; a gamma then lifts the middle of
/// pictures that were exposed for retro-reflective targets and are black but for those.
pub(super) fn display_greys(image: &GreyImage) -> Vec<u8> {
    /// Shares of the pixels that may be darker than black and brighter than white: a hot spot of the flash should not
    /// darken all else, and targets are but a few thousandths of a picture.
    const DARKER: f64 = 0.01;
    const BRIGHTER: f64 = 0.001;
    /// What the median grey value is lifted to, as a share of white, as far as the gamma may go.
    const MEDIAN: f64 = 0.2;
    const STRONGEST_GAMMA: f64 = 0.5;

    let mut counts = vec![0_u64; usize::from(image.depth().white()) + 1];
    for &grey in image.samples() {
        if let Some(count) = counts.get_mut(usize::from(grey)) {
            *count += 1;
        }
    }
    let black = percentile(&counts, DARKER);
    let white = percentile(&counts, 1.0 - BRIGHTER).max(black + 1.0);
    let share = |grey: f64| ((grey - black) / (white - black)).clamp(0.0, 1.0);
    let median = share(percentile(&counts, 0.5));
    // A median at black or white has no logarithm to divide by, and the strongest or no gamma as its answer.
    let gamma = if median <= 0.0 {
        STRONGEST_GAMMA
    } else {
        (MEDIAN.ln() / median.min(0.999).ln()).clamp(STRONGEST_GAMMA, 1.0)
    };
    (0..counts.len())
        .map(|grey| (share(grey as f64).powf(gamma) * BRIGHTEST).round() as u8)
        .collect()
}

/// The grey value that this share of the pixels does not exceed.
fn percentile(counts: &[u64], share: f64) -> f64 {
    let all: u64 = counts.iter().sum();
    let place = (share * all as f64) as u64;
    let mut sum = 0;
    for (grey, count) in counts.iter().enumerate() {
        sum += count;
        if sum > place {
            return grey as f64;
        }
    }
    counts.len().saturating_sub(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::BitDepth;

    fn picture(greys: &[(u16, usize)], depth: BitDepth) -> GreyImage {
        let samples: Vec<u16> = greys
            .iter()
            .flat_map(|&(grey, count)| vec![grey; count])
            .collect();
        GreyImage::new(samples.len() as u32, 1, depth, samples).unwrap()
    }

    #[test]
    fn a_dark_picture_is_lifted_and_its_targets_keep_their_greys_apart() {
        let dark = picture(
            &[(2, 200), (6, 9000), (80, 100), (160, 100)],
            BitDepth::Eight,
        );
        let shown = display_greys(&dark);
        assert_eq!(shown[0], 0);
        assert!(shown[6] > 30, "{}", shown[6]);
        assert!(shown[80] > shown[6] + 60 && shown[160] > shown[80] + 40);
        assert_eq!(shown[160], BRIGHTEST as u8);
    }

    #[test]
    fn an_even_picture_keeps_its_proportions() {
        let even: Vec<(u16, usize)> = (0..=65_535).step_by(16).map(|grey| (grey, 1)).collect();
        let shown = display_greys(&picture(&even, BitDepth::Sixteen));
        assert!((f64::from(shown[32_768]) / BRIGHTEST - 0.5).abs() < 0.02);
    }

    #[test]
    fn pictures_of_one_grey_and_of_none_are_shown() {
        assert_eq!(display_greys(&picture(&[(7, 9)], BitDepth::Eight))[7], 0);
        assert_eq!(display_greys(&picture(&[], BitDepth::Eight)).len(), 256);
    }
}
