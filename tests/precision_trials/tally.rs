//! Counts over many networks, with how far chance may carry them.

use statrs::distribution::{ChiSquared, ContinuousCDF};
use tiepoint::adjustment::{VarianceOfUnitWeight, ellipsoid_factor};

use super::outcome::{LEVEL_OF_PLANTED, LEVELS, Outcome};

/// Probability of the ellipsoids that are counted.
const PROBABILITY: f64 = 0.95;

/// Classes of the test of sigma0's distribution.
const CLASSES: usize = 10;

/// A share over networks: what happened of what could have, and by how much chance may change it. Within a network things
/// hang together, so that its standard deviation is that of the networks' sums.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Share {
    pub(crate) share: f64,
    pub(crate) sigma: f64,
}

impl Share {
    /// Of (happened, possible) by network.
    fn of(networks: &[(f64, f64)]) -> Self {
        let happened: f64 = networks.iter().map(|n| n.0).sum();
        let possible: f64 = networks.iter().map(|n| n.1).sum();
        let share = happened / possible;
        let squares: f64 = networks.iter().map(|n| (n.0 - share * n.1).powi(2)).sum();
        Self {
            share,
            sigma: squares.sqrt() / possible,
        }
    }
}

/// What many networks showed together.
pub(crate) struct Tally {
    /// Networks.
    pub(crate) networks: usize,
    /// Points in their 95 % ellipsoids: a-priori with chi-square, a-posteriori with F.
    pub(crate) inside: [Share; 2],
    /// Rms error of lens parameters in sigmas.
    pub(crate) lens_rms: f64,
    /// Chi-square of sigma0's distribution over ten equal classes, and its critical value at 1 %.
    pub(crate) sigma0: [f64; 2],
    /// Mean square sigma0 over all degrees of freedom, and its standard deviation.
    pub(crate) mean_square_sigma0: Share,
    /// Rejected by the w-test, by level.
    pub(crate) rejected: [Share; 3],
    /// Planted errors that were found, less those that their redundancy foretold.
    pub(crate) found_less_foretold: Share,
    /// Share of planted errors that was foretold.
    pub(crate) foretold: f64,
    points: usize,
    tested: usize,
    planted: usize,
}

impl Tally {
    pub(crate) fn of(outcomes: &[Outcome]) -> Self {
        let inside = |is_inside: &dyn Fn(&Outcome, usize) -> bool| {
            let networks: Vec<(f64, f64)> = outcomes
                .iter()
                .map(|o| {
                    let inside = (0..o.points.len()).filter(|&p| is_inside(o, p)).count();
                    (inside as f64, o.points.len() as f64)
                })
                .collect();
            Share::of(&networks)
        };
        let square = |variance| {
            ellipsoid_factor(PROBABILITY, variance)
                .expect("a factor")
                .powi(2)
        };
        let chi_square = square(VarianceOfUnitWeight::APriori);
        let a_posteriori = |o: &Outcome, p: usize| {
            let redundancy = o.redundancy;
            let limit = square(VarianceOfUnitWeight::APosteriori { redundancy });
            o.points[p].a_posteriori <= limit
        };
        let mut classes = [0.0; CLASSES];
        for outcome in outcomes {
            let class = (outcome.sigma0_share * CLASSES as f64) as usize;
            classes[class.min(CLASSES - 1)] += 1.0;
        }
        let expected = outcomes.len() as f64 / CLASSES as f64;
        let departure = classes.iter().map(|n| (n - expected).powi(2) / expected);
        let critical = ChiSquared::new(CLASSES as f64 - 1.0).expect("classes");
        let lens: Vec<f64> = outcomes.iter().flat_map(|o| o.lens.clone()).collect();
        let rejected = |level: usize| {
            let networks: Vec<(f64, f64)> = outcomes
                .iter()
                .map(|o| (o.rejected[level] as f64, o.tested as f64))
                .collect();
            Share::of(&networks)
        };
        let planted = outcomes.iter().flat_map(|o| &o.planted);
        let differences: Vec<(f64, f64)> = planted
            .clone()
            .map(|p| (f64::from(u8::from(p.found)) - p.power, 1.0))
            .collect();
        let squares: Vec<(f64, f64)> = outcomes
            .iter()
            .map(|o| {
                let r = o.redundancy as f64;
                (chi_square_of(o), r)
            })
            .collect();
        Self {
            networks: outcomes.len(),
            inside: [
                inside(&|o, p| o.points[p].a_priori <= chi_square),
                inside(&a_posteriori),
            ],
            lens_rms: (lens.iter().sum::<f64>() / lens.len().max(1) as f64).sqrt(),
            sigma0: [departure.sum(), critical.inverse_cdf(0.99)],
            mean_square_sigma0: Share::of(&squares),
            rejected: [0, 1, 2].map(rejected),
            found_less_foretold: Share::of(&differences),
            foretold: planted.clone().map(|p| p.power).sum::<f64>() / differences.len() as f64,
            points: outcomes.iter().map(|o| o.points.len()).sum(),
            tested: outcomes.iter().map(|o| o.tested).sum(),
            planted: differences.len(),
        }
    }

    /// The counts as a table.
    pub(crate) fn table(&self) -> String {
        let percent = |s: &Share| format!("{:.3} +- {:.3} %", 100.0 * s.share, 100.0 * s.sigma);
        let mut lines = vec![
            "| what | expected | found |".to_owned(),
            "| --- | --- | --- |".to_owned(),
        ];
        let mut row = |what: String, expected: String, found: String| {
            lines.push(format!("| {what} | {expected} | {found} |"));
        };
        for (share, how) in self.inside.iter().zip(["chi-square", "F"]) {
            row(
                format!("{} points in their 95 % ellipsoids, {how}", self.points),
                "95 %".into(),
                percent(share),
            );
        }
        row(
            "rms error of lens parameters over sigma".into(),
            "1".into(),
            format!("{:.3}", self.lens_rms),
        );
        row(
            format!("sigma0 squared, {} networks", self.networks),
            "100 %".into(),
            percent(&self.mean_square_sigma0),
        );
        row(
            "chi-square of sigma0's distribution, ten classes".into(),
            format!("below {:.1}", self.sigma0[1]),
            format!("{:.1}", self.sigma0[0]),
        );
        for (share, level) in self.rejected.iter().zip(LEVELS) {
            row(
                format!("{} residuals, w-test at {} %", self.tested, 100.0 * level),
                format!("{} %", 100.0 * level),
                percent(share),
            );
        }
        row(
            format!(
                "{} errors of 5 sigma, w-test at {} %, found",
                self.planted,
                100.0 * LEVEL_OF_PLANTED
            ),
            format!("{:.2} %", 100.0 * self.foretold),
            format!(
                "{:.2} +- {:.2} %",
                100.0 * (self.foretold + self.found_less_foretold.share),
                100.0 * self.found_less_foretold.sigma
            ),
        );
        lines.join("\n")
    }
}

fn chi_square_of(outcome: &Outcome) -> f64 {
    let r = outcome.redundancy as f64;
    let chi_square = ChiSquared::new(r).expect("redundancy");
    chi_square.inverse_cdf(outcome.sigma0_share.clamp(1e-12, 1.0 - 1e-12))
}
