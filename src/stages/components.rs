//! How exact each kind of observation is by its own residuals.

use crate::adjustment::{Adjustment, BundleProblem, ObservationGroups, variance_components};
use crate::network::{ComponentResult, PointId, PointKind};

/// Names of the groups, in order.
const GROUPS: [&str; 4] = ["code dots", "plain targets", "cross dots", "bars"];

/// The place of scale bars in [`GROUPS`].
const BARS: usize = 3;

/// The variance component of every kind of target, and of the bars, that has redundancy.
pub(super) fn components(
    problem: &BundleProblem,
    points: &[PointId],
    adjustment: &Adjustment,
) -> Vec<ComponentResult> {
    let group = |point: PointId| match point.kind() {
        PointKind::Code => 0,
        PointKind::Target => 1,
        PointKind::Cross => 2,
    };
    let observations = problem.observations.iter();
    let groups = ObservationGroups {
        observations: observations.map(|o| Some(group(points[o.point]))).collect(),
        distances: vec![Some(BARS); problem.distances.len()],
    };
    let found = variance_components(problem, adjustment, &groups);
    let named = GROUPS.iter().zip(found);
    named
        .filter_map(|(group, component)| {
            let component = component?;
            Some(ComponentResult {
                group: (*group).to_owned(),
                factor: component.factor,
                sigma: component.sigma,
                redundancy: component.redundancy,
            })
        })
        .collect()
}
