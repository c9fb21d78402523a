//! Seeded normal deviates: exact ones for lengths and observations, tabulated ones for the millions of pixels.

use std::sync::OnceLock;

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use statrs::distribution::{ContinuousCDF, Normal};

/// Bits of a random number that choose one entry of the table.
const TABLE_BITS: u32 = 14;

/// The generator of one purpose: streams of the same seed are independent.
pub(super) fn generator(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(stream);
    generator
}

/// A standard normal deviate (Box and Muller, 1958).
pub(super) fn normal(generator: &mut ChaCha8Rng) -> f64 {
    // 1 - u lies in (0, 1], so the logarithm is finite.
    let u: f64 = 1.0 - generator.random::<f64>();
    let v: f64 = generator.random();
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Calls `use_value(column, deviate)` with a standard normal deviate for each column of a row.
///
/// Each deviate is the quantile of one of 2^14 equal shares of the distribution: mean and sigma are right to 1e-3, and
/// the tails end at 4 sigma, which 8-bit pictures do not show.
pub(super) fn for_each_normal(
    generator: &mut ChaCha8Rng,
    columns: usize,
    mut use_value: impl FnMut(usize, f32),
) {
    let table = quantiles();
    let mask = (1_u64 << TABLE_BITS) - 1;
    for first in (0..columns).step_by(4) {
        let mut bits = generator.next_u64();
        for column in first..(first + 4).min(columns) {
            use_value(column, table[(bits & mask) as usize]);
            bits >>= 16;
        }
    }
}

fn quantiles() -> &'static [f32] {
    static TABLE: OnceLock<Vec<f32>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let count = 1_u32 << TABLE_BITS;
        let standard = Normal::standard();
        (0..count)
            .map(|k| standard.inverse_cdf((f64::from(k) + 0.5) / f64::from(count)) as f32)
            .collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviates_have_mean_zero_and_sigma_one() {
        let count = 200_000;
        let mut values = Vec::new();
        for_each_normal(&mut generator(7, 1), count, |_, value| {
            values.push(f64::from(value));
        });
        values.extend({
            let mut exact = generator(7, 2);
            (0..count).map(|_| normal(&mut exact)).collect::<Vec<f64>>()
        });
        for half in values.chunks(count) {
            let mean = half.iter().sum::<f64>() / count as f64;
            let variance = half.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count as f64;
            // Five standard errors of mean and variance of 200,000 deviates.
            assert!(mean.abs() < 0.011, "{mean}");
            assert!((variance - 1.0).abs() < 0.016, "{variance}");
        }
    }

    #[test]
    fn streams_of_one_seed_differ() {
        assert_ne!(generator(1, 0).next_u64(), generator(1, 1).next_u64());
        assert_eq!(generator(1, 3).next_u64(), generator(1, 3).next_u64());
    }
}
