//! Gross errors that no adjustment should begin with.

use std::collections::BTreeSet;

use rayon::prelude::*;

use crate::adjustment::{BundleProblem, ImageObservation};
use crate::monitor::{Interrupted, Monitor};

/// Observations far off their places for their station: gross errors that large would carry the iteration away before any test finds
/// them. They are told as rejected like the others, and the next adjustment looks at them anew.
///
/// # Errors
/// [`Interrupted`] when the work was asked to stop.
pub(super) fn far_off(
    problem: &BundleProblem,
    monitor: &Monitor,
) -> Result<BTreeSet<usize>, Interrupted> {
    /// How far off, as a multiple of the station's median miss, and at least, px.
    const MEDIANS: f64 = 8.0;
    const LEAST_PX: f64 = 3.0;
    let miss = |observation: &ImageObservation| {
        let station = &problem.stations[observation.station];
        let camera = &problem.cameras[station.camera].camera;
        let point = &problem.points[observation.point].position;
        let place = camera.project(&station.pose.camera_from_point(point));
        place.map_or(f64::INFINITY, |place| (place - observation.pixel).norm())
    };
    monitor.check()?;
    let misses: Vec<f64> = problem.observations.par_iter().map(miss).collect();
    monitor.check()?;
    let mut of_station: Vec<Vec<f64>> = vec![Vec::new(); problem.stations.len()];
    for (observation, &miss) in problem.observations.iter().zip(&misses) {
        of_station[observation.station].push(miss);
    }
    let limits: Vec<f64> = of_station
        .into_iter()
        .map(|mut misses| {
            misses.sort_by(f64::total_cmp);
            let median = misses.get(misses.len() / 2).copied().unwrap_or(0.0);
            (MEDIANS * median).max(LEAST_PX)
        })
        .collect();
    let observations = problem.observations.iter().zip(&misses).enumerate();
    let far = observations
        .filter(|(_, (observation, miss))| **miss > limits[observation.station])
        .map(|(index, _)| index);
    Ok(far.collect())
}
