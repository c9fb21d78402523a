//! Numbers on screen: with their unit, and as many digits as their sigma gives sense to.

/// A value whose standard deviation is known: digits down to a tenth of it.
#[must_use]
pub fn with_sigma(value: f64, sigma: Option<f64>, unit: &str) -> String {
    let digits = sigma.map_or(4, digits_of_sigma);
    format!("{value:.digits$} {unit}")
}

/// Digits after the point that end at the second significant one of a standard deviation, at most 6.
#[must_use]
pub fn digits_of_sigma(sigma: f64) -> usize {
    if !(sigma.is_finite() && sigma > 0.0) {
        return 4;
    }
    // 0.0123 has its second significant digit at the third place.
    (1.0 - sigma.log10().floor()).clamp(0.0, 6.0) as usize
}

/// A pixel measure.
#[must_use]
pub fn pixels(value: f64) -> String {
    format!("{value:.3} px")
}

/// A standard deviation with two significant digits.
#[must_use]
pub fn sigma(value: f64, unit: &str) -> String {
    let digits = digits_of_sigma(value);
    format!("{value:.digits$} {unit}")
}

/// A small value, written with an exponent and as many digits as its standard deviation gives sense to.
#[must_use]
pub fn small(value: f64, sigma: Option<f64>) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let sigma = sigma.filter(|sigma| sigma.is_finite() && *sigma > 0.0);
    let digits = sigma.map_or(3.0, |sigma| {
        // One more than the decades between them: the second significant digit of the sigma.
        (value.abs().log10().floor() - sigma.log10().floor() + 1.0).clamp(0.0, 8.0)
    });
    format!("{value:.*e}", digits as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_follow_the_sigma() {
        assert_eq!(with_sigma(123.456_789, Some(0.0123), "mm"), "123.457 mm");
        assert_eq!(with_sigma(123.456_789, Some(2.3), "mm"), "123.5 mm");
        assert_eq!(sigma(0.004_56, "mm"), "0.0046 mm");
        assert_eq!(digits_of_sigma(f64::NAN), 4);
    }

    #[test]
    fn small_values_have_the_digits_of_their_sigma() {
        assert_eq!(small(6.859_12e-5, Some(4.345e-8)), "6.8591e-5");
        assert_eq!(small(4.345e-8, Some(4.345e-8)), "4.3e-8");
        assert_eq!(small(-2.0e-9, Some(4.0e-8)), "-2e-9");
        assert_eq!(small(1.25e-4, None), "1.250e-4");
        assert_eq!(small(0.0, None), "0");
    }
}
