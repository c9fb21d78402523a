//! Known values that contradict everything else: known coordinates, distances and camera parameters, found by their normalised
//! residuals one after the other (data snooping: Baarda, 1968), each judged by what the network is like without it.
//!
//! Removing an observation lowers the weighted sum of squares by exactly `w^2`, so that `sigma0` without it is known before it is
//! removed: a contradiction does not hide itself by making `sigma0` large. A fixed coordinate has no standard deviation to be
//! tested by; it is tested as if it were known as well as one ray sees.

use std::collections::BTreeSet;

use super::adjust::Part;
use super::known_values::{
    Candidate, candidates, known_value, leave_out, one_ray_sigma, slackened, started_at, value_of,
};
use super::usable::NAMES;
use super::words::with_unit;
use super::{PlainNetwork, PlainSettings};
use crate::adjustment::{
    Adjustment, AdjustmentError, BundleProblem, BundleSettings, CoordinatePrior, ParameterState,
    RejectionSettings, adjust,
};
use crate::monitor::Monitor;

/// Contradictions that are sought at most: with more, nothing says what is right.
const MOST: usize = 20;

/// A value whose |w| is this share of the largest explains the contradiction as well: the rest is nonlinearity.
const AS_LARGE: f64 = 0.99;

/// Search adjustments end when a step changes the observations by less than this, rms, in sigmas.
const SEARCH_CONVERGENCE: f64 = 1e-3;

/// A value far off is believed to be wrong where `sigma0` falls below this share without it.
const PROVING_SHARE: f64 = 0.5;

/// A value that is known beforehand, by its place in the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum KnownValue {
    /// A known coordinate of a control point.
    Coordinate {
        /// Index of the point.
        point: usize,
        /// 0, 1, 2 for x, y, z.
        axis: usize,
    },
    /// A distance.
    Distance {
        /// Its index.
        index: usize,
    },
    /// A weighted camera parameter.
    Parameter {
        /// Index of the camera.
        camera: usize,
        /// Index into [`crate::camera::INTERIOR_NAMES`].
        parameter: usize,
    },
}

/// A known value that contradicts everything else.
#[derive(Clone, Debug, PartialEq)]
pub struct Contradiction {
    /// Which.
    pub value: KnownValue,
    /// The known value less what everything else gives, mm or the parameter's unit.
    pub off: f64,
    /// Normalised residual |w| (Baarda, 1968).
    pub w: f64,
    /// Values that explain the contradiction as well.
    pub rivals: Vec<KnownValue>,
    /// Whether the others determine the network without it.
    pub is_dispensable: bool,
    /// Whether it took part all the same.
    pub is_used: bool,
}

impl Contradiction {
    /// Whether it is known which value is wrong, and the network can do without it.
    pub(super) fn can_be_left_out(&self) -> bool {
        self.rivals.is_empty() && self.is_dispensable
    }

    /// It in one line.
    pub(super) fn in_words(&self, network: &PlainNetwork, critical: f64) -> String {
        let rivals: Vec<String> = self
            .rivals
            .iter()
            .take(NAMES)
            .map(|&r| network.value_in_words(r))
            .collect();
        let fate = match (self.is_used, rivals.is_empty(), self.is_dispensable) {
            (false, ..) => "left out".to_owned(),
            (true, false, _) => format!(
                "or {} is wrong: nothing tells which, all are used",
                rivals.join(" or ")
            ),
            (true, true, true) => "used all the same".to_owned(),
            (true, true, false) => {
                "used all the same, the others do not determine the network".to_owned()
            }
        };
        let (known, off) = match self.value {
            KnownValue::Coordinate { point, axis } => {
                let known = network.points[point].known[axis];
                let known = known.map_or(f64::NAN, |known| known.value_mm);
                (format!("{known:.3} mm"), length(self.off))
            }
            KnownValue::Distance { index } => {
                let known = network.distances[index].length_mm;
                (format!("{known:.3} mm"), length(self.off))
            }
            KnownValue::Parameter { camera, parameter } => {
                let known = network.cameras[camera].values[parameter];
                let text = |value| with_unit(value, parameter);
                (text(known), text(self.off))
            }
        };
        format!(
            "{}: the known {known} is off by {off} against everything else (|w| {:.1}, critical {critical}): {fate}",
            network.value_in_words(self.value),
            self.w
        )
    }
}

/// Where a search begins.
#[derive(Clone, Copy)]
pub(super) enum Start<'a> {
    /// With the adjustment of the part.
    Result(&'a Adjustment),
    /// Near these estimates.
    Near(&'a Adjustment),
    /// At the starting values of the part.
    Given,
}

/// A contradiction, and the network without it; `None` where it is not known which value to take out, or the others do not
/// determine the network.
struct Removal {
    found: Contradiction,
    without: Option<Adjustment>,
}

/// A search among the known values of a part of a network.
pub(super) struct Search<'a> {
    pub(super) part: &'a Part,
    pub(super) bundle: BundleSettings,
    /// Critical value of |w|.
    pub(super) critical: f64,
    pub(super) monitor: &'a Monitor,
}

impl<'a> Search<'a> {
    pub(super) fn of(part: &'a Part, settings: &PlainSettings, monitor: &'a Monitor) -> Self {
        let usual = RejectionSettings::default();
        Self {
            part,
            bundle: settings.bundle,
            critical: settings.rejection.as_ref().unwrap_or(&usual).critical,
            monitor,
        }
    }

    /// Whether anything known can be contradicted.
    pub(super) fn is_possible(&self) -> bool {
        let problem = &self.part.problem;
        let coordinates = problem
            .points
            .iter()
            .any(|p| p.prior.iter().any(Option::is_some));
        let parameters = problem.cameras.iter().flat_map(|c| &c.parameters);
        let mut parameters = parameters.filter(|p| matches!(p, ParameterState::Weighted { .. }));
        coordinates || problem.distances.len() > 1 || parameters.next().is_some()
    }

    /// All contradictions, in the order in which they were found; `rejected`: image observations that take no part.
    ///
    /// # Errors
    /// [`AdjustmentError::Interrupted`]; another failure ends the search.
    pub(super) fn contradictions(
        &self,
        start: Start<'_>,
        rejected: &BTreeSet<usize>,
    ) -> Result<Vec<Contradiction>, AdjustmentError> {
        let mut found: Vec<Contradiction> = Vec::new();
        if !self.is_possible() {
            return Ok(found);
        }
        let mut problem = self.part.problem.clone();
        problem.rejected.extend(rejected);
        let mut known = problem.points.iter().flat_map(|p| p.prior).flatten();
        let has_fixed = known.any(|prior| matches!(prior, CoordinatePrior::Fixed { .. }));
        self.weigh_fixed(&mut problem);
        let first = match start {
            Start::Result(result) if !has_fixed => Some(result.clone()),
            Start::Result(near) | Start::Near(near) => self.adjust(started_at(&problem, near))?,
            Start::Given => self.adjust(problem.clone())?,
        };
        let mut adjustment = first;
        let mut left_out = BTreeSet::new();
        while found.len() < MOST {
            let next = self.next(&problem, adjustment.as_ref(), &left_out)?;
            let Some(Removal {
                found: one,
                without,
            }) = next
            else {
                break;
            };
            leave_out(&mut problem, one.value);
            left_out.insert(one.value);
            found.push(one);
            if without.is_none() {
                break;
            }
            adjustment = without;
        }
        for contradiction in &mut found {
            contradiction.value = self.in_network(contradiction.value);
            for rival in &mut contradiction.rivals {
                *rival = self.in_network(*rival);
            }
        }
        Ok(found)
    }

    /// The known value that is off most where the network is left to its rays; `None` where none contradicts them.
    ///
    /// # Errors
    /// [`AdjustmentError::Interrupted`].
    pub(super) fn gross(&self) -> Result<Option<Contradiction>, AdjustmentError> {
        let found = self.gross_of(&self.part.problem, &BTreeSet::new())?;
        Ok(found.map(|(found, _)| Contradiction {
            value: self.in_network(found.value),
            ..found
        }))
    }

    /// The next contradiction: by the linear test, or where `sigma0` stays large, the value that is off most where the network is
    /// left to its rays, if that makes `sigma0` fall by much. A value far off bends the network beyond what is linear.
    fn next(
        &self,
        problem: &BundleProblem,
        adjustment: Option<&Adjustment>,
        left_out: &BTreeSet<KnownValue>,
    ) -> Result<Option<Removal>, AdjustmentError> {
        let worst = adjustment.and_then(|present| {
            let worst = self.worst(problem, present, left_out)?;
            Some((worst, present))
        });
        let linear = match worst {
            Some((found, present)) if found.rivals.is_empty() => {
                Some(self.removal(problem, found, present)?)
            }
            Some((found, _)) => {
                let without = None;
                return Ok(Some(Removal { found, without }));
            }
            None => None,
        };
        let of_linear = linear.as_ref().and_then(|removal| removal.without.as_ref());
        let reached = of_linear.or(adjustment);
        let reached = reached.map_or(f64::INFINITY, |adjustment| adjustment.sigma0);
        if reached > self.critical
            && let Some((found, near)) = self.gross_of(problem, left_out)?
        {
            let gross = self.removal(problem, found, &near)?;
            let sigma0 = gross.without.as_ref().map(|without| without.sigma0);
            if sigma0.is_some_and(|sigma0| sigma0 < PROVING_SHARE * reached) {
                return Ok(Some(gross));
            }
        }
        Ok(linear)
    }

    /// What the network is like without a value, beginning near these estimates.
    fn removal(
        &self,
        problem: &BundleProblem,
        mut found: Contradiction,
        near: &Adjustment,
    ) -> Result<Removal, AdjustmentError> {
        let mut trial = started_at(problem, near);
        leave_out(&mut trial, found.value);
        let without = self.adjust(trial)?;
        found.is_dispensable = without.is_some();
        // Exact, where the estimated gross error is linear.
        let given = without
            .as_ref()
            .map(|without| value_of(problem, without, found.value));
        if let (Some(given), Some(known)) = (given, known_value(problem, found.value)) {
            found.off = known.value - given;
        }
        Ok(Removal { found, without })
    }

    /// The value of the problem that is off most where known values hardly pull, and that adjustment.
    fn gross_of(
        &self,
        problem: &BundleProblem,
        left_out: &BTreeSet<KnownValue>,
    ) -> Result<Option<(Contradiction, Adjustment)>, AdjustmentError> {
        if !self.is_possible() {
            return Ok(None);
        }
        let mut given = problem.clone();
        self.weigh_fixed(&mut given);
        let slack = slackened(&given);
        let Some(adjustment) = self.adjust(slack.clone())? else {
            return Ok(None);
        };
        let mut candidates = candidates(&slack, &adjustment, left_out);
        for candidate in &mut candidates {
            let sigma = |problem| known_value(problem, candidate.value).map(|known| known.sigma);
            if let (Some(slack), Some(given)) = (sigma(&slack), sigma(&given)) {
                candidate.w *= slack / given;
            }
        }
        let worst = candidates.into_iter().max_by(|a, b| a.w.total_cmp(&b.w));
        let worst = worst.filter(|worst| worst.w > self.critical);
        Ok(worst.map(|worst| (contradiction(&worst), adjustment)))
    }

    /// The problem with known values that hardly pull.
    pub(super) fn slack(&self) -> BundleProblem {
        let mut problem = self.part.problem.clone();
        self.weigh_fixed(&mut problem);
        slackened(&problem)
    }

    /// Fixed coordinates have no standard deviation to be tested by: they count as known as well as one ray sees.
    fn weigh_fixed(&self, problem: &mut BundleProblem) {
        let sigma = one_ray_sigma(&self.part.problem);
        let priors = problem.points.iter_mut().flat_map(|p| &mut p.prior);
        for prior in priors.flatten() {
            if let CoordinatePrior::Fixed { value } = *prior {
                *prior = CoordinatePrior::Weighted { value, sigma };
            }
        }
    }

    fn adjust(&self, problem: BundleProblem) -> Result<Option<Adjustment>, AdjustmentError> {
        let settings = BundleSettings {
            convergence: self.bundle.convergence.max(SEARCH_CONVERGENCE),
            ..self.bundle
        };
        match adjust(problem, settings, self.monitor) {
            Ok(adjustment) => Ok(Some(adjustment)),
            Err(AdjustmentError::Interrupted(stop)) => Err(AdjustmentError::Interrupted(stop)),
            Err(_) => Ok(None),
        }
    }

    /// The largest |w| beyond the critical one, in units of `sigma0` without it where that is more than 1.
    fn worst(
        &self,
        problem: &BundleProblem,
        adjustment: &Adjustment,
        left_out: &BTreeSet<KnownValue>,
    ) -> Option<Contradiction> {
        let candidates = candidates(problem, adjustment, left_out);
        let worst = *candidates.iter().max_by(|a, b| a.w.total_cmp(&b.w))?;
        let squares = adjustment.sigma0.powi(2) * adjustment.redundancy as f64;
        // Distances that were left out stand in the count, with a redundancy number of 1 and no residual.
        let loose = left_out
            .iter()
            .filter(|v| matches!(v, KnownValue::Distance { .. }));
        let freedom = adjustment.redundancy.saturating_sub(1 + loose.count());
        let without = if freedom > 0 {
            ((squares - worst.w.powi(2)).max(0.0) / freedom as f64).sqrt()
        } else {
            1.0
        };
        let limit = self.critical * without.max(1.0);
        if worst.w <= limit {
            return None;
        }
        let least = (worst.w.powi(2) - limit.powi(2)).max(0.0).sqrt();
        let as_good = |other: &&Candidate| {
            other.w > limit && (other.w > least || other.w > AS_LARGE * worst.w)
        };
        let rivals = candidates.iter().filter(as_good).map(|other| other.value);
        Some(Contradiction {
            rivals: rivals
                .filter(|&other| !is_of_one_thing(worst.value, other))
                .collect(),
            ..contradiction(&worst)
        })
    }

    fn in_network(&self, value: KnownValue) -> KnownValue {
        match value {
            KnownValue::Coordinate { point, axis } => KnownValue::Coordinate {
                point: self.part.points[point],
                axis,
            },
            KnownValue::Distance { index } => KnownValue::Distance {
                index: self.part.distances[index],
            },
            KnownValue::Parameter { .. } => value,
        }
    }
}

/// A length with its sign; small ones with more digits.
fn length(value: f64) -> String {
    match value.abs() >= 0.01 {
        true => format!("{value:+.3} mm"),
        false => format!("{value:+.6} mm"),
    }
}

fn contradiction(candidate: &Candidate) -> Contradiction {
    Contradiction {
        value: candidate.value,
        // The estimated gross error of the value (Baarda, 1968).
        off: -candidate.residual / candidate.redundancy,
        w: candidate.w,
        rivals: Vec::new(),
        is_dispensable: true,
        is_used: true,
    }
}

fn is_of_one_thing(one: KnownValue, other: KnownValue) -> bool {
    match (one, other) {
        (KnownValue::Coordinate { point: a, .. }, KnownValue::Coordinate { point: b, .. }) => {
            a == b
        }
        (one, other) => one == other,
    }
}
