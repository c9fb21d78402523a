//! The known values of an adjustment's problem: what they are, how far they are off, and the problem without their pull.

use std::collections::BTreeSet;

use nalgebra::Vector3;

use super::contradictions::KnownValue;
use crate::adjustment::{Adjustment, BundleProblem, CoordinatePrior, ParameterState};
use crate::geometry::{Ray, intersect_rays};

/// Known values that hardly pull are known to this share of the network's extent (of their length, for distances).
const SLACK_SHARE: f64 = 0.1;

/// A distance that takes no part in a search is known to this multiple of its length.
const LOOSE_LENGTHS: f64 = 1e6;

/// A known value of the problem under test; indices are the problem's.
#[derive(Clone, Copy)]
pub(super) struct Candidate {
    pub(super) value: KnownValue,
    pub(super) residual: f64,
    pub(super) redundancy: f64,
    /// `|w|`.
    pub(super) w: f64,
}

/// What is known and controlled by something else.
pub(super) fn candidates(
    problem: &BundleProblem,
    adjustment: &Adjustment,
    left_out: &BTreeSet<KnownValue>,
) -> Vec<Candidate> {
    let mut found = Vec::new();
    let mut push = |value: KnownValue, [residual, redundancy, w]: [f64; 3]| {
        if w != 0.0 && !left_out.contains(&value) {
            found.push(Candidate {
                value,
                residual,
                redundancy,
                w: w.abs(),
            });
        }
    };
    for (point, own) in adjustment.points.iter().enumerate() {
        for (axis, known) in own.known.iter().enumerate() {
            if let Some(known) = known {
                let value = KnownValue::Coordinate { point, axis };
                push(value, [known.residual, known.redundancy, known.normalised]);
            }
        }
    }
    for (index, own) in adjustment.distances.iter().enumerate() {
        if let Some(own) = own {
            let value = KnownValue::Distance { index };
            push(value, [own.residual_mm, own.redundancy, own.normalised]);
        }
    }
    let in_use: BTreeSet<usize> = problem.stations.iter().map(|s| s.camera).collect();
    for camera in in_use {
        for (parameter, known) in adjustment.cameras[camera].known.iter().enumerate() {
            if let Some(known) = known {
                let value = KnownValue::Parameter { camera, parameter };
                push(value, [known.residual, known.redundancy, known.normalised]);
            }
        }
    }
    found
}

/// A value with its standard deviation, in its unit.
pub(super) struct WeightedValue {
    pub(super) value: f64,
    pub(super) sigma: f64,
}

/// What is known of a value of the problem; `None` where it is no observation.
pub(super) fn known_value(problem: &BundleProblem, value: KnownValue) -> Option<WeightedValue> {
    let known = |value, sigma| Some(WeightedValue { value, sigma });
    match value {
        KnownValue::Coordinate { point, axis } => match problem.points[point].prior[axis]? {
            CoordinatePrior::Weighted { value, sigma } => known(value, sigma),
            CoordinatePrior::Fixed { .. } => None,
        },
        KnownValue::Distance { index } => {
            let distance = &problem.distances[index];
            known(distance.length_mm, distance.sigma_mm)
        }
        KnownValue::Parameter { camera, parameter } => {
            match problem.cameras[camera].parameters[parameter] {
                ParameterState::Weighted { value, sigma } => known(value, sigma),
                _ => None,
            }
        }
    }
}

/// What an adjustment says of it.
pub(super) fn value_of(problem: &BundleProblem, adjustment: &Adjustment, value: KnownValue) -> f64 {
    match value {
        KnownValue::Coordinate { point, axis } => adjustment.points[point].position[axis],
        KnownValue::Distance { index } => {
            let distance = &problem.distances[index];
            let end = |point: usize| adjustment.points[point].position;
            (end(distance.to) - end(distance.from)).norm()
        }
        KnownValue::Parameter { camera, parameter } => {
            let interior = &adjustment.cameras[camera].camera.interior;
            interior.to_vector()[parameter]
        }
    }
}

pub(super) fn leave_out(problem: &mut BundleProblem, value: KnownValue) {
    match value {
        KnownValue::Coordinate { point, axis } => problem.points[point].prior[axis] = None,
        KnownValue::Distance { index } => {
            let distance = &mut problem.distances[index];
            distance.sigma_mm = LOOSE_LENGTHS * distance.length_mm;
        }
        KnownValue::Parameter { camera, parameter } => {
            problem.cameras[camera].parameters[parameter] = ParameterState::Free;
        }
    }
}

/// The problem with the estimates of an adjustment as its start values.
pub(super) fn started_at(problem: &BundleProblem, adjustment: &Adjustment) -> BundleProblem {
    let mut problem = problem.clone();
    for (block, found) in problem.stations.iter_mut().zip(&adjustment.stations) {
        block.pose = found.pose;
    }
    for (block, found) in problem.points.iter_mut().zip(&adjustment.points) {
        block.position = found.position;
    }
    for (block, found) in problem.cameras.iter_mut().zip(&adjustment.cameras) {
        block.camera = found.camera.clone();
    }
    problem
}

/// The problem with known values that hardly pull, so that its rays alone give its shape.
///
/// A standard deviation that is only many times larger would not do: a robust start bounds the pull of rays, not of known values.
pub(super) fn slackened(problem: &BundleProblem) -> BundleProblem {
    let mut problem = problem.clone();
    begin_where_rays_meet(&mut problem);
    let extent = SLACK_SHARE * extent(&problem);
    for prior in problem
        .points
        .iter_mut()
        .flat_map(|p| &mut p.prior)
        .flatten()
    {
        let known = match *prior {
            CoordinatePrior::Weighted { value, sigma } => WeightedValue { value, sigma },
            CoordinatePrior::Fixed { value } => WeightedValue { value, sigma: 0.0 },
        };
        *prior = CoordinatePrior::Weighted {
            value: known.value,
            sigma: known.sigma.max(extent),
        };
    }
    for distance in &mut problem.distances {
        distance.sigma_mm = distance.sigma_mm.max(SLACK_SHARE * distance.length_mm);
    }
    problem
}

/// Median distance of the points from their median, mm: a point far off does not change it.
fn extent(problem: &BundleProblem) -> f64 {
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    let places = || problem.points.iter().map(|point| point.position);
    let middle = [0, 1, 2].map(|axis| median(places().map(|place| place[axis]).collect()));
    median(
        places()
            .map(|place| (place - Vector3::from(middle)).norm())
            .collect(),
    )
}

/// Points with known coordinates start where their rays meet, wherever that is: known coordinates may be far off.
fn begin_where_rays_meet(problem: &mut BundleProblem) {
    let mut rays: Vec<Vec<Ray>> = vec![Vec::new(); problem.points.len()];
    for seen in &problem.observations {
        let station = &problem.stations[seen.station];
        let direction = problem.cameras[station.camera].camera.ray(&seen.pixel);
        let direction = station.pose.world_from_direction(&direction);
        rays[seen.point].push(Ray::new(station.pose.centre_in_world, &direction));
    }
    for (block, rays) in problem.points.iter_mut().zip(&rays) {
        if let (true, Ok(meeting)) = (
            block.prior.iter().any(Option::is_some),
            intersect_rays(rays),
        ) {
            block.position = meeting.point;
        }
    }
}

/// How well one ray sees across itself, mm: the median over the image points of their standard deviations in the object.
pub(super) fn one_ray_sigma(problem: &BundleProblem) -> f64 {
    let mut sigmas: Vec<f64> = problem
        .observations
        .iter()
        .map(|seen| {
            let station = &problem.stations[seen.station];
            let camera = &problem.cameras[station.camera].camera;
            let place = problem.points[seen.point].position;
            let depth = station.pose.camera_from_point(&place).z.abs();
            seen.sigma_px * camera.pixel_pitch_mm * depth / camera.interior.principal_distance
        })
        .filter(|sigma| *sigma > 0.0)
        .collect();
    sigmas.sort_by(f64::total_cmp);
    sigmas.get(sigmas.len() / 2).copied().unwrap_or(1.0)
}
