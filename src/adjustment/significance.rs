//! Critical values and statistical tests.

use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor, Normal, StudentsT};

/// The level and the power at which gross errors are looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TestPower {
    /// Share of good observations that a two-sided test rejects; default 0.001 (Baarda, 1968).
    pub level: f64,
    /// Probability with which an error of the smallest detectable size is found; default 0.80 (Baarda, 1968).
    pub power: f64,
}

impl Default for TestPower {
    fn default() -> Self {
        Self {
            level: 0.001,
            power: 0.80,
        }
    }
}

impl TestPower {
    /// Non-centrality `delta0`: by so many standard deviations of the residual an error must shift it; 4.13 by default.
    #[must_use]
    pub fn noncentrality(&self) -> f64 {
        normal_critical(self.level) + Normal::standard().inverse_cdf(self.power)
    }

    /// The smallest error of an observation that its test detects, `delta0 sigma / sqrt(r)` in the unit of its a-priori
    /// standard deviation `sigma` (Baarda, 1968); `None` where nothing controls the observation.
    #[must_use]
    pub fn smallest_detectable(&self, sigma: f64, redundancy: f64) -> Option<f64> {
        (redundancy > 0.0).then(|| self.noncentrality() * sigma / redundancy.sqrt())
    }
}

/// Two-sided critical value of a normal deviate.
#[must_use]
pub fn normal_critical(level: f64) -> f64 {
    // From the lower tail: one less a small level is one.
    -Normal::standard().inverse_cdf(level / 2.0)
}

/// The level whose two-sided critical value of a normal deviate this is.
#[must_use]
pub fn normal_level(critical: f64) -> f64 {
    2.0 * Normal::standard().sf(critical)
}

/// Two-sided critical value of Student's t with `freedom` degrees of freedom (> 0).
#[must_use]
pub fn student_critical(level: f64, freedom: f64) -> Option<f64> {
    /// Below this level the steps of the quantile's own iteration may overflow, so that it does not end.
    const LEAST_INVERTED: f64 = 1e-16;
    let student = StudentsT::new(0.0, 1.0, freedom).ok()?;
    if level >= LEAST_INVERTED {
        // From the lower tail: one less a small level is one.
        return Some(-student.inverse_cdf(level / 2.0));
    }
    // The upper tail itself keeps its digits: where it falls to the level is found by bisection.
    let is_short = |t: f64| student.sf(t) > level / 2.0;
    let mut high = 1.0_f64;
    while high.is_finite() && is_short(high) {
        high *= 2.0;
    }
    let mut low = high / 2.0;
    loop {
        let middle = (low + high) / 2.0;
        if middle <= low || middle >= high {
            return Some(high);
        }
        if is_short(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
}

/// Two-sided critical value of Pope's tau (1976) for residuals over their own a-posteriori standard deviation:
/// `tau^2 = r t^2 / (r - 1 + t^2)` with Student's t of r - 1 degrees of freedom; `None` where r < 2.
#[must_use]
pub fn tau_critical(level: f64, redundancy: usize) -> Option<f64> {
    let r = redundancy as f64;
    let t = student_critical(level, r - 1.0)?;
    let scaled = r * t * t;
    // For ever larger t the limit is r.
    let square = if scaled.is_finite() {
        scaled / (r - 1.0 + t * t)
    } else {
        r
    };
    Some(square.sqrt())
}

/// What the test of sigma0 found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sigma0Verdict {
    /// The residuals are as large as the a-priori sigmas say.
    AsExpected,
    /// They are smaller.
    Smaller,
    /// They are larger.
    Larger,
}

/// The chi-square test of sigma0 against 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sigma0Test {
    /// Share of good networks that the two-sided test rejects.
    pub level: f64,
    /// Least and greatest sigma0 that agree with the a-priori sigmas.
    pub interval: [f64; 2],
    /// What it found.
    pub verdict: Sigma0Verdict,
}

impl Sigma0Test {
    /// Tests `sigma0` of an adjustment with this redundancy: `r sigma0^2` is chi-square distributed with r degrees of freedom;
    /// `None` without redundancy.
    #[must_use]
    pub fn new(sigma0: f64, redundancy: usize, level: f64) -> Option<Self> {
        let r = redundancy as f64;
        let chi_square = ChiSquared::new(r).ok()?;
        let interval =
            [level / 2.0, 1.0 - level / 2.0].map(|p| (chi_square.inverse_cdf(p) / r).sqrt());
        let verdict = if sigma0 < interval[0] {
            Sigma0Verdict::Smaller
        } else if sigma0 > interval[1] {
            Sigma0Verdict::Larger
        } else {
            Sigma0Verdict::AsExpected
        };
        Some(Self {
            level,
            interval,
            verdict,
        })
    }

    /// The result as a sentence.
    #[must_use]
    pub fn in_words(&self) -> String {
        let found = match self.verdict {
            Sigma0Verdict::AsExpected => "residuals are as large as the a-priori sigmas say",
            Sigma0Verdict::Smaller => {
                "residuals are smaller than the a-priori sigmas say: the sigmas are too large"
            }
            Sigma0Verdict::Larger => {
                "residuals are larger than the a-priori sigmas say: sigmas too small, gross errors, or a model that does not fit"
            }
        };
        format!(
            "chi-square test at {} %: {found} (sigma0 {:.4} to {:.4} would agree)",
            100.0 * self.level,
            self.interval[0],
            self.interval[1]
        )
    }
}

/// Which sigma0 a covariance was scaled with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VarianceOfUnitWeight {
    /// That of the a-priori sigmas, 1.
    APriori,
    /// That of the adjustment, of this redundancy.
    APosteriori {
        /// Degrees of freedom of sigma0.
        redundancy: usize,
    },
}

/// By how much the standard ellipsoid of a point is to be enlarged so that it holds the true point with this probability:
/// the root of the quantile of chi-square with 3 degrees of freedom, or of 3 F(3, r). `None` without redundancy.
#[must_use]
pub fn ellipsoid_factor(probability: f64, variance: VarianceOfUnitWeight) -> Option<f64> {
    let square = match variance {
        VarianceOfUnitWeight::APriori => ChiSquared::new(3.0).ok()?.inverse_cdf(probability),
        VarianceOfUnitWeight::APosteriori { redundancy } => {
            let f = FisherSnedecor::new(3.0, redundancy as f64).ok()?;
            3.0 * f.inverse_cdf(probability)
        }
    };
    Some(square.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Figures of printed tables.
    #[test]
    fn critical_values_are_those_of_the_tables() {
        let near = |found: f64, table: f64, digits: f64| {
            assert!((found - table).abs() < digits, "{found} for {table}");
        };
        near(normal_critical(0.001), 3.2905, 1e-4);
        near(normal_level(3.2905), 0.001, 1e-6);
        near(TestPower::default().noncentrality(), 4.1321, 1e-4);
        near(student_critical(0.05, 10.0).unwrap(), 2.228, 5e-4);
        near(student_critical(0.001, 30.0).unwrap(), 3.646, 5e-4);
        // From t = 2.262 of 9 degrees of freedom; the limits are sqrt(r) for small r and the normal value for large r.
        near(tau_critical(0.05, 10).unwrap(), 1.9039, 5e-4);
        assert!(tau_critical(1e-6, 3).unwrap() < 3f64.sqrt());
        near(tau_critical(0.001, 20_000).unwrap(), 3.2905, 1e-3);
        assert_eq!(tau_critical(0.05, 1), None);
        near(
            ellipsoid_factor(0.95, VarianceOfUnitWeight::APriori).unwrap(),
            7.815f64.sqrt(),
            1e-3,
        );
        let a_posteriori = VarianceOfUnitWeight::APosteriori { redundancy: 20 };
        near(
            ellipsoid_factor(0.95, a_posteriori).unwrap(),
            (3.0 * 3.098f64).sqrt(),
            1e-3,
        );
    }

    #[test]
    fn the_smallest_levels_have_critical_values() {
        let level = normal_level(12.0);
        assert!((normal_critical(level) - 12.0).abs() < 1e-8);
        // With many degrees of freedom it falls short of the normal value by its cube over 4 r, 0.02.
        let tau = tau_critical(level, 20_000).unwrap();
        assert!((11.95..12.0).contains(&tau), "{tau}");
        for level in [normal_level(9.0), 1e-40, 0.0] {
            let tau = tau_critical(level, 3).unwrap();
            assert!((tau - 3f64.sqrt()).abs() < 1e-9, "{tau} at {level}");
        }
    }

    #[test]
    fn sigma0_is_judged_in_words() {
        // chi-square of 20 degrees of freedom: 9.591 and 34.170 at 5 %.
        let test = Sigma0Test::new(1.1, 20, 0.05).unwrap();
        assert!((test.interval[0] - (9.591f64 / 20.0).sqrt()).abs() < 1e-4);
        assert!((test.interval[1] - (34.170f64 / 20.0).sqrt()).abs() < 1e-4);
        assert_eq!(test.verdict, Sigma0Verdict::AsExpected);
        let larger = Sigma0Test::new(1.4, 20, 0.05).unwrap();
        assert_eq!(larger.verdict, Sigma0Verdict::Larger);
        assert!(larger.in_words().contains("larger than"));
        let smaller = Sigma0Test::new(0.6, 20, 0.05).unwrap();
        assert_eq!(smaller.verdict, Sigma0Verdict::Smaller);
        assert_eq!(Sigma0Test::new(1.0, 0, 0.05), None);
    }
}
