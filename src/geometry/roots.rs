//! Real roots of polynomials.

/// The real roots of `coefficients[0] + coefficients[1] x + ...` in `[low, high]`, rising, each once.
///
/// Between two neighbouring roots of the derivative a polynomial rises or falls, so each such interval holds at most
/// one root, which bisection kept to Newton's pace cannot miss; the derivative's roots are found the same way. A place
/// where the polynomial touches zero within rounding counts as a root.
#[must_use]
pub fn real_roots(coefficients: &[f64], low: f64, high: f64) -> Vec<f64> {
    let largest = coefficients.iter().fold(0.0_f64, |m, a| m.max(a.abs()));
    if !(largest > 0.0 && largest.is_finite() && low < high) {
        return Vec::new();
    }
    let used = coefficients
        .iter()
        .rposition(|a| a.abs() > 1e-15 * largest)
        .map_or(0, |top| top + 1);
    let scaled: Vec<f64> = coefficients[..used].iter().map(|a| a / largest).collect();
    // No root is larger (Cauchy, 1829): bisection need not begin far out.
    let bound = 1.0 + 1.0 / scaled.last().map_or(1.0, |top| top.abs());
    roots_between(&scaled, low.max(-bound), high.min(bound))
}

fn roots_between(coefficients: &[f64], low: f64, high: f64) -> Vec<f64> {
    let degree = coefficients.len().saturating_sub(1);
    match degree {
        0 => return Vec::new(),
        1 => {
            let root = -coefficients[0] / coefficients[1];
            return if (low..=high).contains(&root) {
                vec![root]
            } else {
                Vec::new()
            };
        }
        _ => {}
    }
    let derivative: Vec<f64> = (1..=degree).map(|k| k as f64 * coefficients[k]).collect();
    let mut bounds = vec![low];
    bounds.extend(roots_between(&derivative, low, high));
    bounds.push(high);
    let mut roots: Vec<f64> = Vec::with_capacity(degree);
    for (index, pair) in bounds.windows(2).enumerate() {
        let (left, right) = (value(coefficients, pair[0]), value(coefficients, pair[1]));
        // A double root: the turning point lies on the axis within rounding.
        let touches = index > 0 && left.abs() <= 1e-13 * magnitude(coefficients, pair[0]);
        if touches || left == 0.0 {
            push_distinct(&mut roots, pair[0]);
        } else if left * right < 0.0 {
            push_distinct(
                &mut roots,
                bracketed_root(coefficients, &derivative, pair[0], pair[1]),
            );
        }
    }
    if value(coefficients, high) == 0.0 {
        push_distinct(&mut roots, high);
    }
    roots
}

fn push_distinct(roots: &mut Vec<f64>, root: f64) {
    if roots
        .last()
        .is_none_or(|last| root - last > 1e-12 * (1.0 + root.abs()))
    {
        roots.push(root);
    }
}

/// Horner's scheme.
fn value(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, a| sum * x + a)
}

/// The sum of the terms' sizes: what the rounding of [`value`] is relative to.
fn magnitude(coefficients: &[f64], x: f64) -> f64 {
    coefficients
        .iter()
        .rev()
        .fold(0.0, |sum, a| sum * x.abs() + a.abs())
}

/// The root between `low` and `high`, where the polynomial's signs differ: Newton steps, bisection where they leave.
fn bracketed_root(coefficients: &[f64], derivative: &[f64], mut low: f64, mut high: f64) -> f64 {
    let rising = value(coefficients, low) < 0.0;
    let mut x = 0.5 * (low + high);
    // Bisection alone would need some 60 halvings for the last bit and 40 more for a wide interval.
    for _ in 0..120 {
        let here = value(coefficients, x);
        if here == 0.0 {
            return x;
        }
        if (here < 0.0) == rising {
            low = x;
        } else {
            high = x;
        }
        let newton = x - here / value(derivative, x);
        let next = if newton > low && newton < high {
            newton
        } else {
            0.5 * (low + high)
        };
        if (next - x).abs() <= 4.0 * f64::EPSILON * x.abs() || high - low <= f64::MIN_POSITIVE {
            return next;
        }
        x = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn from_roots(roots: &[f64]) -> Vec<f64> {
        let mut coefficients = vec![1.0];
        for root in roots {
            let mut next = vec![0.0; coefficients.len() + 1];
            for (k, a) in coefficients.iter().enumerate() {
                next[k + 1] += a;
                next[k] -= a * root;
            }
            coefficients = next;
        }
        coefficients
    }

    proptest! {
        #[test]
        fn the_roots_of_a_product_are_found(gaps in prop::collection::vec(0.3..2.0, 1..7), first in -3.0..0.0) {
            let mut roots = vec![first];
            for gap in &gaps {
                roots.push(roots[roots.len() - 1] + gap);
            }
            let found = real_roots(&from_roots(&roots), -100.0, 100.0);
            prop_assert_eq!(found.len(), roots.len());
            for (a, b) in found.iter().zip(&roots) {
                // Seven roots some units apart: the condition number is below 1e6.
                prop_assert!((a - b).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn double_roots_none_and_nonsense() {
        let found = real_roots(&from_roots(&[1.0, 1.0, 3.0]), -10.0, 10.0);
        assert!(
            found.len() == 2 && (found[0] - 1.0).abs() < 1e-6 && (found[1] - 3.0).abs() < 1e-12
        );
        assert!(real_roots(&[1.0, 0.0, 1.0], -10.0, 10.0).is_empty());
        assert!(real_roots(&[], -1.0, 1.0).is_empty());
        assert!(real_roots(&[f64::NAN, 1.0, 2.0], -1.0, 1.0).is_empty());
        assert!(real_roots(&[0.0; 5], -1.0, 1.0).is_empty());
    }
}
