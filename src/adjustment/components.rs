//! Variance components: how exact each kind of observation is, from its own residuals.

use super::{
    Adjustment, AdjustmentError, BundleProblem, BundleSettings, ObservationStatus, adjust,
};
use crate::monitor::Monitor;

/// Which group each observation belongs to: numbers from 0 on; `None` stays out.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ObservationGroups {
    /// By index of [`BundleProblem::observations`].
    pub observations: Vec<Option<usize>>,
    /// By index of [`BundleProblem::distances`].
    pub distances: Vec<Option<usize>>,
}

/// How exact a group of observations is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VarianceComponent {
    /// Root of the variance component: the group's a-priori standard deviations times this agree with its residuals.
    pub factor: f64,
    /// Standard deviation of the factor, `factor / sqrt(2 redundancy)`.
    pub sigma: f64,
    /// Sum of the group's redundancy numbers.
    pub redundancy: f64,
    /// Observed values, x and y of an image point counted apart.
    pub observations: usize,
}

/// A group with less redundancy than this says nothing of its variance.
const LEAST_REDUNDANCY: f64 = 1.0;

/// The variance component of each group, `v^T P v / sum r` over its observations (Helmert, 1907, in the form of Foerstner,
/// 1979); `None` for a group without redundancy. It is unbiased where all components are near one: see
/// [`adjust_with_components`].
#[must_use]
pub fn variance_components(
    problem: &BundleProblem,
    adjustment: &Adjustment,
    groups: &ObservationGroups,
) -> Vec<Option<VarianceComponent>> {
    #[derive(Clone, Copy, Default)]
    struct Sum {
        squares: f64,
        redundancy: f64,
        observations: usize,
    }
    let all = groups.observations.iter().chain(&groups.distances);
    let count = all.flatten().max().map_or(0, |largest| largest + 1);
    let mut sums = vec![Sum::default(); count];
    let observations = problem.observations.iter().zip(&adjustment.observations);
    for ((observation, found), group) in observations.zip(&groups.observations) {
        let (Some(group), Some(v)) = (group, found.residual_px) else {
            continue;
        };
        if found.status == ObservationStatus::Used {
            sums[*group].squares += v.norm_squared() / observation.sigma_px.powi(2);
            sums[*group].redundancy += found.redundancy.sum();
            sums[*group].observations += 2;
        }
    }
    let distances = problem.distances.iter().zip(&adjustment.distances);
    for ((distance, found), group) in distances.zip(&groups.distances) {
        let (Some(group), Some(found)) = (group, found) else {
            continue;
        };
        sums[*group].squares += (found.residual_mm / distance.sigma_mm).powi(2);
        sums[*group].redundancy += found.redundancy;
        sums[*group].observations += 1;
    }
    sums.iter()
        .map(|sum| {
            (sum.redundancy >= LEAST_REDUNDANCY).then(|| {
                let factor = (sum.squares / sum.redundancy).sqrt();
                VarianceComponent {
                    factor,
                    sigma: factor / (2.0 * sum.redundancy).sqrt(),
                    redundancy: sum.redundancy,
                    observations: sum.observations,
                }
            })
        })
        .collect()
}

/// An adjustment whose a-priori sigmas agree with the residuals of each group.
#[derive(Clone, Debug, PartialEq)]
pub struct ComponentAdjustment {
    /// The problem with the sigmas that were found.
    pub problem: BundleProblem,
    /// Its adjustment.
    pub adjustment: Adjustment,
    /// What each group's sigmas were multiplied by; `None` where they stay: it has too little redundancy, or no residuals. One that
    /// comes to have too little redundancy on the way keeps what was found before.
    pub components: Vec<Option<VarianceComponent>>,
}

/// Adjusts, multiplies the sigmas of each group by its component, and adjusts again until no component is off one.
///
/// # Errors
/// As [`adjust`]; where the components do not settle the last ones are taken.
pub fn adjust_with_components(
    problem: &BundleProblem,
    groups: &ObservationGroups,
    settings: BundleSettings,
    monitor: &Monitor,
) -> Result<ComponentAdjustment, AdjustmentError> {
    /// A component this near to one is one.
    const SETTLED: f64 = 1e-4;
    /// At most so many adjustments; a group of little redundancy converges linearly.
    const ROUNDS: usize = 50;
    let mut problem = problem.clone();
    let mut total: Vec<Option<VarianceComponent>> = Vec::new();
    let mut adjustment = adjust(problem.clone(), settings, monitor)?;
    for _ in 0..ROUNDS {
        let found = variance_components(&problem, &adjustment, groups).into_iter();
        // A group without residuals keeps its sigmas: there is nothing to learn from.
        let found = found.map(|component| component.filter(|c| c.factor > 0.0));
        let components: Vec<Option<VarianceComponent>> = found.collect();
        let so_far = |group: usize| total.get(group).copied().flatten();
        total = components
            .iter()
            .enumerate()
            .map(|(group, component)| {
                let before = so_far(group);
                let Some(c) = component else {
                    return before;
                };
                let factor = before.map_or(1.0, |before| before.factor);
                Some(VarianceComponent {
                    factor: c.factor * factor,
                    sigma: c.sigma * factor,
                    ..*c
                })
            })
            .collect();
        let off = components.iter().flatten();
        let off = off.map(|c| (c.factor - 1.0).abs()).fold(0.0, f64::max);
        if off < SETTLED {
            break;
        }
        let factor = |group: &Option<usize>| {
            let component = group.and_then(|group| components[group]);
            component.map_or(1.0, |c| c.factor)
        };
        for (observation, group) in problem.observations.iter_mut().zip(&groups.observations) {
            observation.sigma_px *= factor(group);
        }
        for (distance, group) in problem.distances.iter_mut().zip(&groups.distances) {
            distance.sigma_mm *= factor(group);
        }
        adjustment = adjust(problem.clone(), settings, monitor)?;
    }
    Ok(ComponentAdjustment {
        problem,
        adjustment,
        components: total,
    })
}

#[cfg(test)]
mod tests {
    use super::super::equations::State;
    use super::super::simulation::{Noise, Scene, Simulated, bar, box_network, scene, solve};
    use super::super::{Datum, PointBlock};
    use super::*;

    /// Observations of one half of the stations are three times, bars four times less exact than their sigmas say.
    #[test]
    fn what_each_group_errs_by_is_found() {
        let (mut squares, mut count) = (0.0, 0.0);
        for seed in 0..6 {
            let scene = Scene {
                stations: 16,
                ..scene(900 + seed)
            };
            let simulated = box_network(&scene);
            let mut problem = simulated.problem;
            let mut noise = Noise::seeded(seed);
            for o in problem
                .observations
                .iter_mut()
                .filter(|o| o.station % 2 == 0)
            {
                // The same errors, and smaller sigmas.
                o.sigma_px /= 3.0;
            }
            problem.distances = (0..40)
                .map(|k| bar(&simulated.truth, k, 59 - k / 2, 0.04 * noise.normal()))
                .collect();
            let groups = ObservationGroups {
                observations: problem
                    .observations
                    .iter()
                    .map(|o| Some(o.station % 2))
                    .collect(),
                distances: vec![Some(2); 40],
            };
            let found = adjust_with_components(
                &problem,
                &groups,
                BundleSettings::default(),
                &Monitor::new(),
            )
            .unwrap();
            assert!((found.adjustment.sigma0 - 1.0).abs() < 1e-3);
            for (component, truth) in found.components.iter().zip([3.0, 1.0, 4.0]) {
                let component = component.unwrap();
                squares += ((component.factor - truth) / component.sigma).powi(2);
                count += 1.0;
            }
        }
        // 18 deviates: their rms is known to 17 %.
        let rms: f64 = (squares / count).sqrt();
        assert!((0.5..1.5).contains(&rms), "{rms}");
    }

    #[test]
    fn a_group_without_redundancy_says_nothing() {
        let simulated = box_network(&scene(910));
        let mut problem = simulated.problem;
        problem.distances = vec![bar(&simulated.truth, 0, 7, 0.0)];
        let groups = ObservationGroups {
            observations: vec![Some(0); problem.observations.len()],
            distances: vec![Some(1)],
        };
        let adjustment =
            adjust(problem.clone(), BundleSettings::default(), &Monitor::new()).unwrap();
        let found = variance_components(&problem, &adjustment, &groups);
        assert!(found[0].is_some() && found[1].is_none());
    }

    /// Only distances are in a group.
    fn of_distances(problem: &BundleProblem) -> ObservationGroups {
        ObservationGroups {
            observations: vec![None; problem.observations.len()],
            distances: vec![Some(0); problem.distances.len()],
        }
    }

    /// Bars that agree far better than their sigmas say lose their redundancy as soon as their sigmas say so too.
    #[test]
    fn a_group_that_drops_out_tells_what_it_was_multiplied_by() {
        let mut problem = box_network(&scene(911)).problem;
        let places = State::of(&solve(&problem).unwrap());
        problem.distances = vec![
            bar(&places, 0, 7, 1e-4),
            bar(&places, 3, 21, -1e-4),
            bar(&places, 12, 40, 1e-4),
        ];
        for distance in &mut problem.distances {
            distance.sigma_mm = 1.0;
        }
        let groups = of_distances(&problem);
        let (settings, monitor) = (BundleSettings::default(), Monitor::new());
        let found = adjust_with_components(&problem, &groups, settings, &monitor).unwrap();
        let last = variance_components(&found.problem, &found.adjustment, &groups);
        assert_eq!(last, vec![None]);
        let sigma = found.problem.distances[0].sigma_mm;
        let factor = found.components[0].unwrap().factor;
        assert!(sigma < 1e-3 && (factor - sigma).abs() < 1e-12, "{factor}");
    }

    #[test]
    fn a_group_without_residuals_keeps_its_sigmas() {
        let Simulated { truth, mut problem } = box_network(&Scene {
            disturbance: 1.0,
            ..scene(8)
        });
        for p in [0, 21, 37] {
            problem.points[p] = PointBlock::fixed(truth.points[p]);
        }
        problem.datum = Datum::Control;
        problem.distances = vec![bar(&truth, 0, 21, 0.0), bar(&truth, 21, 37, 0.0)];
        let groups = of_distances(&problem);
        let (settings, monitor) = (BundleSettings::default(), Monitor::new());
        let found = adjust_with_components(&problem, &groups, settings, &monitor).unwrap();
        assert_eq!(found.components, vec![None]);
        assert_eq!(found.problem, problem);
    }
}
