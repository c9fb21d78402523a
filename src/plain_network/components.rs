//! Groups of a plain network's observations, and how exact each is by its own residuals.

use super::PlainNetwork;
use super::adjust::{Adjusted, Part};
use crate::adjustment::{
    AdjustmentError, BundleSettings, ObservationGroups, VarianceComponent, adjust_with_components,
    variance_components,
};
use crate::monitor::Monitor;

/// Where the weights of an adjustment come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Weights {
    /// The standard deviations that the network gives.
    #[default]
    AsGiven,
    /// Those times the variance component of their group, the image points of a camera or all distances.
    FromResiduals,
}

/// The variance component of a group.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupComponent {
    /// The group in words.
    pub group: String,
    /// Its component; where the weights come from residuals, what the given standard deviations were multiplied by. `None`
    /// where the group has too little redundancy.
    pub component: Option<VarianceComponent>,
}

/// Cameras that take part first, then the distances.
fn groups(network: &PlainNetwork, part: &Part) -> (Vec<String>, ObservationGroups) {
    let mut cameras: Vec<usize> = part.problem.stations.iter().map(|s| s.camera).collect();
    cameras.sort_unstable();
    cameras.dedup();
    let mut names: Vec<String> = cameras
        .iter()
        .map(|&camera| format!("image points of camera '{}'", network.cameras[camera].name))
        .collect();
    let distances = names.len();
    if !part.problem.distances.is_empty() {
        names.push("distances".into());
    }
    let camera_of = |station: usize| part.problem.stations[station].camera;
    let observations = part.problem.observations.iter();
    let groups = ObservationGroups {
        observations: observations
            .map(|o| cameras.binary_search(&camera_of(o.station)).ok())
            .collect(),
        distances: vec![Some(distances); part.problem.distances.len()],
    };
    (names, groups)
}

/// The components of what was adjusted; with weights from residuals it is adjusted again until they agree.
///
/// # Errors
/// As the adjustment.
pub(super) fn components(
    network: &PlainNetwork,
    part: &mut Part,
    adjusted: &mut Adjusted,
    weights: Weights,
    settings: BundleSettings,
    monitor: &Monitor,
) -> Result<Vec<GroupComponent>, AdjustmentError> {
    let (names, groups) = groups(network, part);
    let found = match weights {
        Weights::AsGiven => variance_components(&part.problem, &adjusted.adjustment, &groups),
        Weights::FromResiduals => {
            let found = adjust_with_components(&part.problem, &groups, settings, monitor)?;
            part.problem = found.problem;
            adjusted.adjustment = found.adjustment;
            found.components
        }
    };
    let named = names.into_iter().zip(found);
    Ok(named
        .map(|(group, component)| GroupComponent { group, component })
        .collect())
}
