//! The iteration, driven by the caller: one call is one accepted step.

use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::datum::{FreeMotions, move_onto_datum};
use super::equations::{Equations, State, distance_equation, image_residuals, trial_residuals};
use super::factor::Factor;
use super::interior::interior_priors;
use super::layout::Layout;
use super::median::median;
use super::normals::Normals;
use super::solved::SolvedNetwork;
use super::step::Step;
use super::{Adjustment, AdjustmentError, BundleProblem, BundleSettings, RobustStart};
use crate::monitor::Monitor;

/// A rise of the cost by less than this part, or by less than the square of 1e-7 sigma an observation, is rounding.
const ROUNDING_OF_COST: f64 = 1e-9;
const ROUNDING_OF_RESIDUAL: f64 = 1e-7;

/// The first damping when the cost rises, the factor from one to the next, the least and the greatest.
const FIRST_DAMPING: f64 = 1e-5;
const DAMPING_FACTOR: f64 = 10.0;
const LEAST_DAMPING: f64 = 1e-7;
const GREATEST_DAMPING: f64 = 1e10;

/// A singular system is passed with damping so often in a row (start values can be singular by chance) before it
/// counts as a rank defect.
const SINGULAR_ATTEMPTS: usize = 3;

/// The robust start ends when a step changes the observations by less than this, rms, in sigmas.
const ROBUST_CONVERGENCE: f64 = 1e-2;

/// At the last iteration a step that changes the observations by less than this, rms, in sigmas, is an end as well: where an image hangs
/// on a single code seen from afar, the rounding of the normal equations is amplified to 1e-5.
const NEGLIGIBLE_CHANGE: f64 = 1e-4;

/// The median of absolute values of normal deviates times this is their standard deviation.
pub(super) const SIGMA_FROM_MEDIAN: f64 = 1.4826;

/// Robust scales are taken as at least this, in sigmas: below it residuals are rounding.
pub(super) const LEAST_SCALE: f64 = 0.01;

/// How an iteration ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TerminationKind {
    /// An undamped step changed less than the threshold (value: rms change of the observations in sigmas).
    Converged,
    /// The last allowed iteration was made (value: the last change).
    IterationLimit,
    /// No damping made the cost fall (value: rise of the cost, relative).
    NoDescent,
}

/// How an iteration ended, with the measured value and its threshold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Termination {
    /// What happened.
    pub kind: TerminationKind,
    /// Its measure, see [`TerminationKind`].
    pub value: f64,
    /// What the value was compared with.
    pub threshold: f64,
}

/// The weights of an iteration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Down-weighted large residuals.
    Robust,
    /// The given weights.
    LeastSquares,
}

/// What one iteration did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Iteration {
    /// Counted from 1.
    pub number: usize,
    /// Its weights.
    pub phase: Phase,
    /// Weighted sum of squares (or of the robust loss) after the step, without unit.
    pub cost: f64,
    /// Rms change of the observations in sigmas.
    pub change: f64,
    /// Damping of the accepted step, 0 for plain Gauss-Newton.
    pub damping: f64,
    /// Whether and how the iteration ended.
    pub termination: Option<Termination>,
}

/// A bundle adjustment under way.
pub struct BundleSolver {
    problem: BundleProblem,
    settings: BundleSettings,
    layout: Layout,
    state: State,
    phase: Phase,
    damping: f64,
    number: usize,
    robust_number: usize,
    singular: usize,
    termination: Option<Termination>,
}

/// Parts of a bent step that are tried.
const BENT_PARTS: [f64; 4] = [1.0, 0.5, 0.25, 0.1];

/// A trial step that was accepted.
struct Accepted {
    state: State,
    cost: f64,
    change: f64,
    damping: f64,
}

impl BundleSolver {
    /// Checks the problem and sets out from its start values.
    ///
    /// # Errors
    /// Invalid input, points or stations with too few rays, a datum that does not take the freedom of the network.
    pub fn new(
        problem: BundleProblem,
        settings: BundleSettings,
        monitor: &Monitor,
    ) -> Result<Self, AdjustmentError> {
        let state = State::start(&problem);
        Self::resume(problem, settings, state, monitor)
    }

    /// Sets out from another state; the datum still refers to the start values in `problem`.
    pub(super) fn resume(
        problem: BundleProblem,
        settings: BundleSettings,
        mut state: State,
        monitor: &Monitor,
    ) -> Result<Self, AdjustmentError> {
        monitor.check()?;
        let layout = Layout::new(&problem, monitor)?;
        state.hold_fixed(&problem);
        FreeMotions::of(&problem, &layout, &state).check(&problem, &layout, &state)?;
        let phase = match settings.robust_start {
            RobustStart::Off => Phase::LeastSquares,
            RobustStart::Huber { .. } => Phase::Robust,
        };
        Ok(Self {
            problem,
            settings,
            layout,
            state,
            phase,
            damping: 0.0,
            number: 0,
            robust_number: 0,
            singular: 0,
            termination: None,
        })
    }

    /// Makes one step that does not raise the cost (or finds that there is none).
    ///
    /// # Errors
    /// [`AdjustmentError::Interrupted`] within the step, of which nothing stays;
    /// [`AdjustmentError::NotImaged`] when the start values put observed points behind their cameras,
    /// [`AdjustmentError::RankDefect`] when the observations leave unknowns undetermined.
    pub fn iterate(&mut self, monitor: &Monitor) -> Result<Iteration, AdjustmentError> {
        let equations = Equations::at(&self.problem, &self.layout, &self.state, monitor)?;
        self.check_imaged(&equations)?;
        let residuals: Vec<Option<Vector2<f64>>> = equations
            .rays
            .iter()
            .map(|r| r.map(|r| r.residual))
            .collect();
        let loss = self.loss(&residuals);
        let cost = self.cost(&self.state, &residuals, loss);
        monitor.check()?;
        let phase = self.phase;
        self.number += 1;
        let Some(accepted) = self.accepted_step(&equations, &residuals, loss, cost, monitor)?
        else {
            let (number, termination) = (self.number, self.termination);
            return Ok(Iteration {
                number,
                phase,
                cost,
                change: 0.0,
                damping: self.damping,
                termination,
            });
        };
        drop(equations);
        monitor.check()?;
        self.state = accepted.state;
        // A system that was singular by chance is tried undamped again at once.
        self.damping = if self.singular == 0 && accepted.damping > LEAST_DAMPING {
            accepted.damping / DAMPING_FACTOR
        } else {
            0.0
        };
        self.judge(accepted.change, accepted.damping);
        Ok(Iteration {
            number: self.number,
            phase,
            cost: accepted.cost,
            change: accepted.change,
            damping: accepted.damping,
            termination: self.termination,
        })
    }

    /// The estimates with their exact statistics, in the chosen datum and frame.
    ///
    /// # Errors
    /// [`AdjustmentError::NotConverged`] or [`AdjustmentError::NotFinished`] when the iteration has not converged;
    /// [`AdjustmentError::RankDefect`]; [`AdjustmentError::FramePoint`] or [`AdjustmentError::FrameShape`] where the
    /// three points do not give a frame.
    pub fn finish(self, monitor: &Monitor) -> Result<Adjustment, AdjustmentError> {
        Ok(self.solved(monitor)?.adjustment(monitor)?)
    }

    /// [`Self::finish`] at the present state, converged or not, and in the datum alone: good for finding gross errors,
    /// not for results.
    pub(super) fn finish_as_it_is(
        mut self,
        monitor: &Monitor,
    ) -> Result<Adjustment, AdjustmentError> {
        self.problem.frame = None;
        Ok(self.solved_as_it_is(monitor)?.adjustment(monitor)?)
    }

    /// The solved equations in the chosen datum and frame, for what [`Self::finish`] does not deliver.
    ///
    /// # Errors
    /// As [`Self::finish`].
    pub fn solved(self, monitor: &Monitor) -> Result<SolvedNetwork, AdjustmentError> {
        self.converged()?;
        self.solved_as_it_is(monitor)
    }

    fn solved_as_it_is(mut self, monitor: &Monitor) -> Result<SolvedNetwork, AdjustmentError> {
        let termination = self.termination.ok_or(AdjustmentError::NotFinished)?;
        let reference: Vec<Vector3<f64>> = self.problem.points.iter().map(|p| p.position).collect();
        move_onto_datum(&self.problem, &self.layout, &mut self.state, &reference)?;
        SolvedNetwork::new(
            self.problem,
            self.layout,
            self.state,
            self.number,
            termination,
            monitor,
        )
    }

    /// The weights of the next iteration.
    #[must_use]
    pub fn phase(&self) -> Phase {
        self.phase
    }

    pub(super) fn state(&self) -> &State {
        &self.state
    }

    pub(super) fn residuals(&self) -> Vec<Option<Vector2<f64>>> {
        image_residuals(&self.problem, &self.layout, &self.state)
    }

    fn converged(&self) -> Result<(), AdjustmentError> {
        match self.termination {
            Some(end) if end.kind == TerminationKind::Converged => Ok(()),
            Some(end) => Err(AdjustmentError::NotConverged(end)),
            None => Err(AdjustmentError::NotFinished),
        }
    }

    fn check_imaged(&self, equations: &Equations) -> Result<(), AdjustmentError> {
        let observations: Vec<usize> = (0..equations.rays.len())
            .filter(|&i| self.layout.used[i] && equations.rays[i].is_none())
            .collect();
        if observations.is_empty() {
            Ok(())
        } else {
            Err(AdjustmentError::NotImaged { observations })
        }
    }

    /// Tries the plain step first, then ever more damping; `None` (with a termination) when nothing lowers the cost.
    fn accepted_step(
        &mut self,
        equations: &Equations,
        residuals: &[Option<Vector2<f64>>],
        loss: Loss,
        cost: f64,
        monitor: &Monitor,
    ) -> Result<Option<Accepted>, AdjustmentError> {
        let weights = self.weights(residuals, loss);
        let free = FreeMotions::of(&self.problem, &self.layout, &self.state);
        let observations = self.layout.used.iter().filter(|u| **u).count() as f64;
        let allowed = cost * (1.0 + ROUNDING_OF_COST) + observations * ROUNDING_OF_RESIDUAL.powi(2);
        let mut lowest_rise = f64::INFINITY;
        loop {
            let solved = Normals::build(
                &self.problem,
                &self.layout,
                &self.state,
                equations,
                &weights,
                self.damping,
                monitor,
            )
            .and_then(|normals| {
                let factor = Factor::new(&normals, &self.layout, &self.state, &free, monitor)?;
                let structure = &self.layout.structure;
                let kept = factor.solve(structure, &normals.right_side, monitor)?;
                Ok((kept, normals))
            });
            match solved {
                Err(AdjustmentError::Interrupted(interrupted)) => return Err(interrupted.into()),
                Err(defect) => {
                    if self.damping == 0.0 {
                        self.singular += 1;
                        if self.singular >= SINGULAR_ATTEMPTS {
                            return Err(defect);
                        }
                    } else if self.damping >= GREATEST_DAMPING {
                        return Err(defect);
                    }
                }
                Ok((kept, normals)) => {
                    if self.damping == 0.0 {
                        self.singular = 0;
                    }
                    monitor.check()?;
                    let step = Step::of(kept, &normals, &self.layout);
                    monitor.check()?;
                    let with_cost = |state: State| {
                        let trial = trial_residuals(&self.problem, &self.layout, &state, equations);
                        let cost = self.cost(&state, &trial, loss);
                        (state, cost)
                    };
                    let (straight, trial_cost) =
                        with_cost(step.from(&self.state, &self.layout, 1.0));
                    let lower = if trial_cost <= allowed {
                        Some((straight, trial_cost))
                    } else {
                        let bent =
                            self.bent_step(&step, equations, residuals, &weights, &free, monitor);
                        bent.and_then(|bent| {
                            let mut states = BENT_PARTS.iter().map(|&part| {
                                let step = step.bent_towards(&bent, part);
                                with_cost(step.from(&self.state, &self.layout, 1.0))
                            });
                            states.find(|(_, cost)| *cost <= allowed)
                        })
                    };
                    monitor.check()?;
                    if let Some((state, cost)) = lower {
                        let change = normals.predicted_change(&step.kept).max(0.0);
                        drop(normals);
                        monitor.check()?;
                        return Ok(Some(Accepted {
                            state,
                            cost,
                            change: (change / (2.0 * observations).max(1.0)).sqrt(),
                            damping: self.damping,
                        }));
                    }
                    lowest_rise = lowest_rise.min(trial_cost / cost.max(f64::MIN_POSITIVE) - 1.0);
                }
            }
            self.damping = (self.damping * DAMPING_FACTOR).max(FIRST_DAMPING);
            if self.damping > GREATEST_DAMPING {
                self.termination = Some(Termination {
                    kind: TerminationKind::NoDescent,
                    value: lowest_rise,
                    threshold: ROUNDING_OF_COST,
                });
                return Ok(None);
            }
        }
    }

    fn judge(&mut self, change: f64, damping: f64) {
        if self.phase == Phase::Robust {
            self.robust_number += 1;
            let limit = match self.settings.robust_start {
                RobustStart::Huber { iterations, .. } => iterations,
                RobustStart::Off => 0,
            };
            let settled = damping == 0.0 && change < ROBUST_CONVERGENCE;
            if settled || self.robust_number >= limit {
                self.phase = Phase::LeastSquares;
            }
            return;
        }
        let end = |kind| {
            Some(Termination {
                kind,
                value: change,
                threshold: self.settings.convergence,
            })
        };
        if damping == 0.0 && change < self.settings.convergence {
            self.termination = end(TerminationKind::Converged);
        } else if self.number >= self.settings.iterations {
            let kind = if damping == 0.0 && change < NEGLIGIBLE_CHANGE {
                TerminationKind::Converged
            } else {
                TerminationKind::IterationLimit
            };
            self.termination = end(kind);
        }
    }

    /// The step corrected for the curvature of the observations along it, by their second differences (geodesic acceleration;
    /// Transtrum and Sethna, 2012): where a lens can hardly be told from the stations, the valley of the cost is narrow and bent,
    /// and straight steps stay short.
    ///
    /// Cost: as the step itself, and two times the residuals.
    fn bent_step(
        &self,
        step: &Step,
        equations: &Equations,
        residuals: &[Option<Vector2<f64>>],
        weights: &[f64],
        free: &FreeMotions,
        monitor: &Monitor,
    ) -> Option<Step> {
        /// Part of the step over which the differences are taken.
        const PART: f64 = 0.1;
        let [ahead, behind] = [PART, -PART].map(|part| {
            let state = step.from(&self.state, &self.layout, part);
            trial_residuals(&self.problem, &self.layout, &state, equations)
        });
        let mut bent = equations.clone();
        let around = ahead.iter().zip(&behind).zip(residuals);
        for (ray, ((ahead, behind), here)) in bent.rays.iter_mut().zip(around) {
            if let (Some(ray), Some(here)) = (ray, here) {
                let second = (*ahead)? + (*behind)? - 2.0 * here;
                ray.residual += 0.5 * second / (PART * PART);
            }
        }
        let (problem, layout) = (&self.problem, &self.layout);
        let normals = Normals::build(
            problem,
            layout,
            &self.state,
            &bent,
            weights,
            self.damping,
            monitor,
        )
        .ok()?;
        let factor = Factor::new(&normals, layout, &self.state, free, monitor).ok()?;
        let kept = factor.solve(&layout.structure, &normals.right_side, monitor);
        let kept = kept.ok()?;
        Some(Step::of(kept, &normals, layout))
    }

    /// The loss function of this iteration: the scale of the robust one follows the present residuals.
    fn loss(&self, residuals: &[Option<Vector2<f64>>]) -> Loss {
        match (self.phase, self.settings.robust_start) {
            (Phase::Robust, RobustStart::Huber { threshold, .. }) => {
                let scale = robust_scale(&self.problem, &self.layout.used, residuals);
                Loss::Huber {
                    bend: threshold * scale,
                }
            }
            _ => Loss::Square,
        }
    }

    fn weights(&self, residuals: &[Option<Vector2<f64>>], loss: Loss) -> Vec<f64> {
        let rays = self.problem.observations.iter().zip(residuals);
        rays.zip(&self.layout.used)
            .map(|((o, v), used)| match v {
                Some(v) if *used => loss.weight(v.norm() / o.sigma_px) * o.sigma_px.powi(-2),
                _ => 0.0,
            })
            .collect()
    }

    /// The weighted sum of squares of all observations; infinite where a used one is not imaged.
    fn cost(&self, state: &State, residuals: &[Option<Vector2<f64>>], loss: Loss) -> f64 {
        if !state.has_sound_lenses() {
            return f64::INFINITY;
        }
        let mut sum = 0.0;
        for ((o, v), _) in self
            .problem
            .observations
            .iter()
            .zip(residuals)
            .zip(&self.layout.used)
            .filter(|o| *o.1)
        {
            match v {
                Some(v) => sum += loss.value(v.norm() / o.sigma_px),
                None => return f64::INFINITY,
            }
        }
        let sum = sum + other_squares(&self.problem, &self.layout, state);
        if sum.is_finite() { sum } else { f64::INFINITY }
    }
}

/// The weighted squares of distances, weighted coordinates and known camera parameters.
pub(super) fn other_squares(problem: &BundleProblem, layout: &Layout, state: &State) -> f64 {
    let mut sum = 0.0;
    for (d, _) in problem
        .distances
        .iter()
        .zip(&layout.distance_used)
        .filter(|d| *d.1)
    {
        let equation = distance_equation(&state.points[d.from], &state.points[d.to], d.length_mm);
        sum += (equation.residual / d.sigma_mm).powi(2);
    }
    for frame in &layout.frames {
        let block = &problem.points[frame.point];
        let off = block.off_known(&state.points[frame.point]);
        if let Some(weights) = block.weights() {
            sum += off.dot(&(weights * off));
        }
    }
    for prior in interior_priors(problem, layout, state) {
        sum += (prior.residual / prior.sigma).powi(2);
    }
    sum
}

/// 1.4826 times the median of the absolute residuals in sigmas, at least [`LEAST_SCALE`].
pub(super) fn robust_scale(
    problem: &BundleProblem,
    used: &[bool],
    residuals: &[Option<Vector2<f64>>],
) -> f64 {
    let rays = problem.observations.iter().zip(residuals).zip(used);
    let values: Vec<f64> = rays
        .filter(|r| *r.1)
        .filter_map(|((o, v), _)| v.map(|v| [v.x.abs() / o.sigma_px, v.y.abs() / o.sigma_px]))
        .flatten()
        .collect();
    (SIGMA_FROM_MEDIAN * median(values).unwrap_or(0.0)).max(LEAST_SCALE)
}

/// The loss of an image observation as a function of its residual's length in sigmas.
#[derive(Clone, Copy)]
enum Loss {
    Square,
    /// Quadratic up to `bend`, linear beyond (Huber, 1964).
    Huber {
        bend: f64,
    },
}

impl Loss {
    fn value(self, length: f64) -> f64 {
        match self {
            Self::Huber { bend } if length > bend => bend * (2.0 * length - bend),
            _ => length * length,
        }
    }

    fn weight(self, length: f64) -> f64 {
        match self {
            Self::Huber { bend } if length > bend => bend / length,
            _ => 1.0,
        }
    }
}
