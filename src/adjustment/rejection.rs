//! Gross errors: a robust start, iterated data snooping (Baarda, 1968), restoration of what was rejected too early.

use std::collections::{BTreeMap, BTreeSet};

use super::datum::apply;
use super::equations::State;
use super::median::median;
use super::runaways::runaways;
use super::significance::{normal_level, tau_critical};
use super::solver::{LEAST_SCALE, SIGMA_FROM_MEDIAN, robust_scale};
use super::{
    Adjustment, AdjustmentError, BundleProblem, BundleSettings, BundleSolver, ObservationStatus,
    OutlierTest, ParameterName, Phase, RejectionSettings, RobustStart,
};
use crate::monitor::{Monitor, Task};

/// After the robust start residuals beyond this multiple of the critical value are rejected at once, one a point and
/// round; the finer ones wait for exact normalised residuals.
const COARSE: f64 = 2.0;

/// Rounds of robust iteration and coarse rejection.
const COARSE_ROUNDS: usize = 4;
/// Points with fewer rays absorb a gross error, so that the coarse test would take the wrong ray.
const COARSE_RAYS: usize = 4;

/// Between rejections an adjustment ends when a step changes the observations by less than this, rms, in sigmas.
const DRAFT_CONVERGENCE: f64 = 1e-2;
/// Between rejections at most so many iterations.
const DRAFT_ITERATIONS: usize = 12;

/// Why an observation was rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RejectionReason {
    /// Its residual is too large.
    Test,
    /// The start values put its point behind the camera.
    NotImaged,
    /// Its point was dropped.
    PointDropped,
}

/// A rejected image observation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RejectedObservation {
    /// Index into [`BundleProblem::observations`].
    pub index: usize,
    /// The larger `|w|` of x and y in a-priori sigmas: of the final prediction, or (where there is none) that at which
    /// it was rejected; `None` where it never had one.
    pub w: Option<f64>,
    /// Why.
    pub reason: RejectionReason,
}

/// An adjustment without gross errors.
#[derive(Clone, Debug, PartialEq)]
pub struct RobustAdjustment {
    /// The last pass.
    pub adjustment: Adjustment,
    /// What was rejected here, by index; observations rejected in the problem beforehand are not listed.
    pub rejected: Vec<RejectedObservation>,
    /// Points that were left with too few rays or whose rays do not intersect.
    pub dropped_points: Vec<usize>,
    /// Adjustments made.
    pub passes: usize,
}

#[derive(Clone, Copy)]
struct Verdict {
    reason: RejectionReason,
    w: Option<f64>,
}

pub(super) struct Snooping<'a> {
    pub(super) problem: BundleProblem,
    bundle: BundleSettings,
    settings: &'a RejectionSettings,
    pub(super) state: State,
    rejected: BTreeMap<usize, Verdict>,
    /// Restored once already: they may be rejected again but not restored again, so that the passes end.
    restored: BTreeSet<usize>,
    pub(super) dropped: BTreeSet<usize>,
}

/// Adjusts, rejects the largest normalised residuals of each point and station, and adjusts again until none is too
/// large; then restores rejected observations that fit after all.
///
/// The test is scaled by 1.4826 times the median `|w|`, so that a-priori sigmas that are too small (or large) as a whole
/// neither reject everything nor hide anything. Observations that the problem gives as rejected stay so.
///
/// # Errors
/// As [`super::adjust`].
pub fn adjust_with_rejection(
    problem: &BundleProblem,
    bundle: BundleSettings,
    settings: &RejectionSettings,
    monitor: &Monitor,
) -> Result<RobustAdjustment, AdjustmentError> {
    let task = monitor.task("Adjusting", 0);
    let mut snooping = Snooping::new(problem, bundle, settings);
    snooping.start_robustly(&task)?;
    let enough = settings.enough * problem.observations.len() as f64;
    let (mut passes, mut is_done) = (0, false);
    loop {
        let more = passes < settings.passes && !is_done;
        passes += 1;
        if more {
            let draft = snooping.draft(&task)?;
            let before = snooping.problem.rejected.len();
            if snooping.reject(&draft) || snooping.restore(&draft) {
                let changed = snooping.problem.rejected.len().abs_diff(before);
                is_done = changed as f64 <= enough;
                continue;
            }
        }
        let adjustment = snooping.adjust(&task)?;
        if !more || !(snooping.reject(&adjustment) || snooping.restore(&adjustment)) {
            return Ok(snooping.conclude(adjustment, passes));
        }
    }
}

impl<'a> Snooping<'a> {
    pub(super) fn new(
        problem: &BundleProblem,
        bundle: BundleSettings,
        settings: &'a RejectionSettings,
    ) -> Self {
        let mut snooping = Self {
            problem: problem.clone(),
            bundle,
            settings,
            state: State::start(problem),
            rejected: BTreeMap::new(),
            restored: BTreeSet::new(),
            dropped: BTreeSet::new(),
        };
        snooping.drop_thin_points();
        snooping
    }

    /// Robust iterations, then the coarse test, until the latter finds nothing.
    pub(super) fn start_robustly(&mut self, task: &Task<'_>) -> Result<(), AdjustmentError> {
        if self.settings.robust_start == RobustStart::Off {
            return Ok(());
        }
        for _ in 0..COARSE_ROUNDS {
            let settings = BundleSettings {
                robust_start: self.settings.robust_start,
                ..self.bundle
            };
            let found = self.solve(settings, task, |solver| {
                solver.phase() == Phase::LeastSquares
            })?;
            self.state = found.state().clone();
            task.monitor().check()?;
            if !self.reject_coarsely(&found) {
                break;
            }
        }
        Ok(())
    }

    /// An adjustment good enough to find gross errors; with them in it, Gauss-Newton may take long to settle.
    fn draft(&mut self, task: &Task<'_>) -> Result<Adjustment, AdjustmentError> {
        let settings = BundleSettings {
            convergence: self.bundle.convergence.max(DRAFT_CONVERGENCE),
            iterations: self.bundle.iterations.min(DRAFT_ITERATIONS),
            robust_start: RobustStart::Off,
        };
        let solver = self.solve(settings, task, |_| false)?;
        let draft = solver.finish_as_it_is(task.monitor())?;
        task.monitor().check()?;
        self.state = State::of(&draft);
        Ok(draft)
    }

    fn adjust(&mut self, task: &Task<'_>) -> Result<Adjustment, AdjustmentError> {
        let settings = BundleSettings {
            robust_start: RobustStart::Off,
            ..self.bundle
        };
        let solver = self.solve(settings, task, |_| false)?;
        let adjustment = solver.finish(task.monitor())?;
        task.monitor().check()?;
        self.state = State::of(&adjustment);
        if let Some(motion) = &adjustment.motion {
            // The datum and known coordinates refer to the place the problem was given in.
            apply(&motion.inverse(), &mut self.state);
        }
        Ok(adjustment)
    }

    /// Iterates until `enough` or the end; start values that are not imaged and points whose rays do not intersect are
    /// taken out on the way.
    fn solve(
        &mut self,
        settings: BundleSettings,
        task: &Task<'_>,
        enough: impl Fn(&BundleSolver) -> bool,
    ) -> Result<BundleSolver, AdjustmentError> {
        let monitor = task.monitor();
        'restart: loop {
            monitor.check()?;
            let mut solver =
                BundleSolver::resume(self.problem.clone(), settings, self.state.clone(), monitor)?;
            loop {
                task.step()?;
                match solver.iterate(monitor) {
                    Ok(_) if self.drop_runaways(solver.state()) => {
                        self.state = solver.state().clone();
                        continue 'restart;
                    }
                    Ok(iteration) if iteration.termination.is_some() || enough(&solver) => {
                        return Ok(solver);
                    }
                    Ok(_) => {}
                    Err(error) => {
                        if !self.take_out(&error) {
                            return Err(error);
                        }
                        continue 'restart;
                    }
                }
            }
        }
    }

    /// Whether the cause of an error could be taken out of the problem.
    fn take_out(&mut self, error: &AdjustmentError) -> bool {
        match error {
            AdjustmentError::NotImaged { observations } => {
                for &index in observations {
                    self.take(index, RejectionReason::NotImaged, None);
                }
                self.drop_thin_points();
                true
            }
            AdjustmentError::RankDefect { loose, .. } => {
                let points: Vec<usize> = loose
                    .iter()
                    .filter_map(|name| match name {
                        ParameterName::Point { index } => Some(*index),
                        _ => None,
                    })
                    .collect();
                let only_points = !points.is_empty()
                    && points.len() == loose.len()
                    && points.iter().all(|p| !self.dropped.contains(p));
                if only_points {
                    for point in points {
                        self.drop_point(point);
                    }
                }
                only_points
            }
            _ => false,
        }
    }

    fn take(&mut self, index: usize, reason: RejectionReason, w: Option<f64>) {
        self.problem.rejected.insert(index);
        self.rejected.insert(index, Verdict { reason, w });
    }

    pub(super) fn rays_of_points(&self) -> Vec<usize> {
        let mut rays = vec![0; self.problem.points.len()];
        for (o, used) in self.problem.observations.iter().zip(self.problem.used()) {
            // The check of the input tells of a point that is not there.
            if let Some(rays) = rays.get_mut(o.point) {
                *rays += usize::from(used);
            }
        }
        rays
    }

    fn rays_of_stations(&self) -> Vec<usize> {
        let mut rays = vec![0; self.problem.stations.len()];
        for (o, used) in self.problem.observations.iter().zip(self.problem.used()) {
            rays[o.station] += usize::from(used);
        }
        rays
    }

    fn drop_thin_points(&mut self) {
        let least = self.settings.min_rays.max(2);
        let rays = self.rays_of_points();
        let thin: Vec<usize> = (0..rays.len())
            .filter(|&p| rays[p] < least && self.problem.points[p].known_coordinates() < 3)
            .filter(|p| !self.dropped.contains(p))
            .collect();
        for point in thin {
            self.drop_point(point);
        }
    }

    /// Drops points that the iteration carries away from the others; whether there are any.
    fn drop_runaways(&mut self, state: &State) -> bool {
        let rays = self.rays_of_points();
        let unknown = |p: &usize| rays[*p] > 0 && self.problem.points[*p].known_coordinates() == 0;
        let points: Vec<usize> = (0..state.points.len()).filter(unknown).collect();
        let away = runaways(state, &points);
        for &point in &away {
            self.drop_point(point);
        }
        !away.is_empty()
    }

    fn drop_point(&mut self, point: usize) {
        self.dropped.insert(point);
        for index in 0..self.problem.observations.len() {
            let of_point = self.problem.observations[index].point == point;
            if of_point && !self.problem.rejected.contains(&index) {
                self.take(index, RejectionReason::PointDropped, None);
            }
        }
    }

    /// The largest residual of each point, where it is far too large.
    fn reject_coarsely(&mut self, solver: &BundleSolver) -> bool {
        let residuals = solver.residuals();
        let used = self.problem.used();
        let scale = robust_scale(&self.problem, &used, &residuals);
        let rays = self.rays_of_points();
        let candidates = (0..residuals.len()).filter_map(|index| {
            let observation = &self.problem.observations[index];
            let length = residuals[index]?.amax() / observation.sigma_px;
            let gross = length > COARSE * self.settings.critical * scale;
            (used[index] && gross && rays[observation.point] >= COARSE_RAYS)
                .then_some(Candidate { index, w: length })
        });
        let chosen = self.locally_largest(candidates.collect(), Neighbourhood::Point);
        self.reject_all(chosen)
    }

    /// The normalised residuals that are too large, the largest of each point and station.
    fn reject(&mut self, adjustment: &Adjustment) -> bool {
        let critical = limit(self.settings.test, self.settings.critical, adjustment);
        let candidates = adjustment
            .observations
            .iter()
            .enumerate()
            .filter(|(_, o)| o.status == ObservationStatus::Used)
            .filter_map(|(index, o)| {
                Some(Candidate {
                    index,
                    w: o.test()?,
                })
            })
            .filter(|c| c.w > critical)
            .collect();
        let chosen = self.locally_largest(candidates, Neighbourhood::PointAndStation);
        self.reject_all(chosen)
    }

    fn reject_all(&mut self, chosen: Vec<Candidate>) -> bool {
        let any = !chosen.is_empty();
        for candidate in chosen {
            self.take(candidate.index, RejectionReason::Test, Some(candidate.w));
        }
        self.drop_thin_points();
        any
    }

    /// Those that no larger candidate of their neighbourhood precedes and that their station can spare.
    fn locally_largest(
        &self,
        mut candidates: Vec<Candidate>,
        neighbourhood: Neighbourhood,
    ) -> Vec<Candidate> {
        candidates.sort_by(|a, b| b.w.total_cmp(&a.w).then(a.index.cmp(&b.index)));
        let mut of_station = self.rays_of_stations();
        let (mut points, mut stations) = (BTreeSet::new(), BTreeSet::new());
        let mut chosen = Vec::new();
        for candidate in candidates {
            let observation = &self.problem.observations[candidate.index];
            let first_of_point = points.insert(observation.point);
            let first_of_station = stations.insert(observation.station);
            let first = match neighbourhood {
                Neighbourhood::Point => first_of_point,
                Neighbourhood::PointAndStation => first_of_point && first_of_station,
            };
            if first && of_station[observation.station] > self.settings.min_station_rays {
                of_station[observation.station] -= 1;
                chosen.push(candidate);
            }
        }
        chosen
    }

    fn restore(&mut self, adjustment: &Adjustment) -> bool {
        let limit = limit(self.settings.test, self.settings.restore, adjustment);
        let fitting: Vec<usize> = self
            .rejected
            .keys()
            .copied()
            .filter(|i| !self.restored.contains(i))
            .filter(|&i| adjustment.observations[i].test().is_some_and(|w| w < limit))
            .collect();
        for index in &fitting {
            self.rejected.remove(index);
            self.problem.rejected.remove(index);
            self.restored.insert(*index);
        }
        !fitting.is_empty()
    }

    fn conclude(self, adjustment: Adjustment, passes: usize) -> RobustAdjustment {
        let rejected = self
            .rejected
            .iter()
            .map(|(&index, verdict)| RejectedObservation {
                index,
                w: adjustment.observations[index].test().or(verdict.w),
                reason: verdict.reason,
            })
            .collect();
        RobustAdjustment {
            adjustment,
            rejected,
            dropped_points: self.dropped.into_iter().collect(),
            passes,
        }
    }
}

#[derive(Clone, Copy)]
struct Candidate {
    index: usize,
    w: f64,
}

#[derive(Clone, Copy)]
enum Neighbourhood {
    Point,
    PointAndStation,
}

/// The largest `|w|` that agrees with a critical value of a standard normal deviate.
fn limit(test: OutlierTest, critical: f64, adjustment: &Adjustment) -> f64 {
    match test {
        OutlierTest::RobustScale => critical * scale_of_tests(adjustment),
        OutlierTest::APriori => critical,
        OutlierTest::APosteriori => {
            let tau = tau_critical(normal_level(critical), adjustment.redundancy);
            // One degree of freedom: every tau is one, and nothing can be told.
            adjustment.sigma0 * tau.unwrap_or(critical)
        }
    }
}

/// 1.4826 times the median `|w|` of the used observations: `sigma0` as gross errors cannot spoil it.
fn scale_of_tests(adjustment: &Adjustment) -> f64 {
    let used = adjustment
        .observations
        .iter()
        .filter(|o| o.status == ObservationStatus::Used);
    let values: Vec<f64> = used
        .filter_map(|o| o.normalised)
        .flat_map(|w| [w.x.abs(), w.y.abs()])
        .collect();
    (SIGMA_FROM_MEDIAN * median(values).unwrap_or(0.0)).max(LEAST_SCALE)
}

#[cfg(test)]
#[path = "rejection_tests.rs"]
mod tests;
