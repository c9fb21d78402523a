//! How reliable the adjustment of a plain network is: tests of the whole, of its observations and of its lenses.

use serde::Serialize;

use crate::adjustment::{
    AdjustedCamera, Adjustment, ObservationStatus, Sigma0Test, Sigma0Verdict, TestPower,
    normal_critical, student_critical, tau_critical,
};
use crate::camera::INTERIOR_NAMES;
use crate::plain_network::GroupComponent;

/// Level of the test of sigma0 and of the significance of lens parameters.
const LEVEL: f64 = 0.05;

/// Tests of the adjustment as a whole.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReliabilityReport {
    /// Level of the tests of single observations (two-sided).
    pub level: f64,
    /// Probability with which an error of the smallest detectable size is found.
    pub power: f64,
    /// Critical value of |w| (Baarda, 1968).
    pub w_critical: f64,
    /// Critical value of |tau| (Pope, 1976); none with less than two degrees of freedom.
    pub tau_critical: Option<f64>,
    /// Image residuals that are controlled, x and y counted apart.
    pub residuals: usize,
    /// Of these with |w| beyond its critical value.
    pub beyond_w: usize,
    /// Of these with |tau| beyond its critical value.
    pub beyond_tau: usize,
    /// Least and mean redundancy number of used image coordinates.
    pub redundancy: Option<[f64; 2]>,
    /// The chi-square test of sigma0; none without redundancy.
    pub sigma0: Option<Sigma0Row>,
    /// Groups of observations.
    pub components: Vec<ComponentRow>,
}

/// The chi-square test of sigma0.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sigma0Row {
    /// Its level.
    pub level: f64,
    /// Least and greatest sigma0 that agree with the a-priori standard deviations.
    pub interval: [f64; 2],
    /// `as-expected`, `smaller` or `larger`.
    pub verdict: &'static str,
    /// The same as a sentence.
    pub text: String,
}

/// A group of observations.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComponentRow {
    /// The group.
    pub group: String,
    /// Residuals over what the given standard deviations let expect, or what these were multiplied by; none where the group has
    /// too little redundancy.
    pub factor: Option<f64>,
    /// Standard deviation of the factor.
    pub sigma: Option<f64>,
    /// Sum of redundancy numbers.
    pub redundancy: Option<f64>,
}

impl ReliabilityReport {
    /// Of an adjustment, with the components of its groups.
    #[must_use]
    pub fn new(adjustment: &Adjustment, components: &[GroupComponent]) -> Self {
        let power = TestPower::default();
        let w_critical = normal_critical(power.level);
        let tau_critical = tau_critical(power.level, adjustment.redundancy);
        let used = adjustment
            .observations
            .iter()
            .filter(|o| o.status == ObservationStatus::Used);
        let (mut residuals, mut beyond_w, mut beyond_tau) = (0, 0, 0);
        let (mut least, mut sum, mut count) = (f64::INFINITY, 0.0, 0);
        for observation in used {
            let Some(w) = observation.normalised else {
                continue;
            };
            for axis in 0..2 {
                let r = observation.redundancy[axis];
                least = least.min(r);
                sum += r;
                count += 1;
                residuals += usize::from(r > 0.0);
                beyond_w += usize::from(w[axis].abs() > w_critical);
                let tau = w[axis].abs() / adjustment.sigma0;
                beyond_tau += usize::from(tau_critical.is_some_and(|critical| tau > critical));
            }
        }
        let test = Sigma0Test::new(adjustment.sigma0, adjustment.redundancy, LEVEL);
        Self {
            level: power.level,
            power: power.power,
            w_critical,
            tau_critical,
            residuals,
            beyond_w,
            beyond_tau,
            redundancy: (count > 0).then(|| [least, sum / f64::from(count)]),
            sigma0: test.map(|test| Sigma0Row {
                level: test.level,
                interval: test.interval,
                verdict: match test.verdict {
                    Sigma0Verdict::AsExpected => "as-expected",
                    Sigma0Verdict::Smaller => "smaller",
                    Sigma0Verdict::Larger => "larger",
                },
                text: test.in_words(),
            }),
            components: components.iter().map(component_row).collect(),
        }
    }

    pub(super) fn write(&self, text: &mut dyn std::fmt::Write) -> std::fmt::Result {
        if let Some(test) = &self.sigma0 {
            writeln!(text, "{}", test.text)?;
        }
        writeln!(
            text,
            "w-test at {} %: {} of {} image residuals beyond {:.2}",
            100.0 * self.level,
            self.beyond_w,
            self.residuals,
            self.w_critical
        )?;
        if let Some(tau) = self.tau_critical {
            writeln!(
                text,
                "tau-test at {} %: {} beyond {tau:.2}",
                100.0 * self.level,
                self.beyond_tau
            )?;
        }
        if let Some([least, mean]) = self.redundancy {
            writeln!(
                text,
                "redundancy numbers of image coordinates {least:.3} at least, {mean:.3} in the mean"
            )?;
        }
        for row in &self.components {
            if let (Some(factor), Some(sigma)) = (row.factor, row.sigma) {
                writeln!(
                    text,
                    "{}: residuals {factor:.3} +- {sigma:.3} times the given standard deviations",
                    row.group
                )?;
            }
        }
        Ok(())
    }
}

fn component_row(group: &GroupComponent) -> ComponentRow {
    let component = group.component;
    ComponentRow {
        group: group.group.clone(),
        factor: component.map(|c| c.factor),
        sigma: component.map(|c| c.sigma),
        redundancy: component.map(|c| c.redundancy),
    }
}

/// What a lens parameter is worth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SignificanceRow {
    /// Value over standard deviation; none for the principal distance, which is never zero.
    pub t: Option<f64>,
    /// Whether the value differs from zero at 5 % (Student's t).
    pub significant: Option<bool>,
    /// The lens parameter that it is most correlated with.
    pub correlated_with: Option<&'static str>,
    /// That correlation.
    pub correlation: Option<f64>,
}

impl SignificanceRow {
    /// What is worth a word: a value that may as well be zero, a correlation that hides it.
    pub(super) fn write(&self, text: &mut dyn std::fmt::Write) -> std::fmt::Result {
        /// Correlations beyond this are told.
        const TOLD: f64 = 0.9;
        if self.significant == Some(false) {
            write!(text, ", not significant at {} %", 100.0 * LEVEL)?;
        }
        if let (Some(with), Some(correlation)) = (self.correlated_with, self.correlation)
            && correlation.abs() > TOLD
        {
            write!(text, ", correlation {correlation:+.2} with {with}")?;
        }
        Ok(())
    }
}

/// The significance of an estimated parameter of a camera; `None` for one that was held.
pub(super) fn significance(
    camera: &AdjustedCamera,
    redundancy: usize,
    parameter: usize,
) -> Option<SignificanceRow> {
    let covariance = &camera.covariance;
    let sigma = covariance[(parameter, parameter)].max(0.0).sqrt();
    if sigma <= 0.0 {
        return None;
    }
    let value = camera.camera.interior.to_vector()[parameter];
    let t = (parameter > 0).then_some(value / sigma);
    let critical = student_critical(LEVEL, redundancy as f64);
    let correlation = |other: usize| {
        let scale = sigma * covariance[(other, other)].max(0.0).sqrt();
        (other != parameter && scale > 0.0).then(|| covariance[(parameter, other)] / scale)
    };
    let most = (0..INTERIOR_NAMES.len())
        .filter_map(|other| Some((other, correlation(other)?)))
        .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    Some(SignificanceRow {
        t,
        significant: t.zip(critical).map(|(t, critical)| t.abs() > critical),
        correlated_with: most.map(|(other, _)| INTERIOR_NAMES[other]),
        correlation: most.map(|(_, correlation)| correlation),
    })
}
