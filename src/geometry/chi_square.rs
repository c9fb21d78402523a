//! Critical values of chi-square.

use statrs::distribution::{ChiSquared, ContinuousCDF};

/// The value that chi-square of `freedom` (> 0) degrees of freedom exceeds with probability `level`; `None` without freedom.
#[must_use]
pub fn chi_square_critical(level: f64, freedom: usize) -> Option<f64> {
    let chi_square = ChiSquared::new(freedom as f64).ok()?;
    Some(chi_square.inverse_cdf(1.0 - level))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn critical_values_are_those_of_the_tables() {
        for (level, freedom, value) in [(0.01, 3, 11.345), (0.01, 15, 30.578), (0.05, 1, 3.841)] {
            let found = chi_square_critical(level, freedom).unwrap();
            assert!((found - value).abs() < 1e-3, "{found} for {value}");
        }
        assert_eq!(chi_square_critical(0.01, 0), None);
    }
}
