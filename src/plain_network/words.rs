//! Faults of an adjustment, and what it speaks of, with the names that the network has.

use super::PlainNetwork;
use super::adjust::{Part, PlainError};
use super::check::AXES;
use super::contradictions::KnownValue;
use super::usable::listed;
use crate::adjustment::{AdjustmentError, ParameterName, ProblemPart, TerminationKind};
use crate::camera::INTERIOR_NAMES;

/// Units of the camera parameters in the order of [`INTERIOR_NAMES`].
const INTERIOR_UNITS: [&str; 10] = [
    " mm", " mm", " mm", " mm^-2", " mm^-4", " mm^-6", " mm^-1", " mm^-1", "", "",
];

/// Unknowns that are told of many.
const UNKNOWNS: usize = 6;

/// A camera parameter's value with its unit.
pub(super) fn with_unit(value: f64, parameter: usize) -> String {
    match INTERIOR_UNITS[parameter] {
        " mm" => format!("{value:.4} mm"),
        unit => format!("{value:.3e}{unit}"),
    }
}

impl PlainNetwork {
    pub(super) fn parameter_in_words(&self, camera: usize, parameter: usize) -> String {
        let name = &self.cameras[camera].name;
        format!("{} of camera '{name}'", INTERIOR_NAMES[parameter])
    }

    pub(super) fn value_in_words(&self, value: KnownValue) -> String {
        match value {
            KnownValue::Coordinate { point, axis } => {
                format!("{} of point '{}'", AXES[axis], self.points[point].name)
            }
            KnownValue::Distance { index } => format!("distance '{}'", self.distances[index].name),
            KnownValue::Parameter { camera, parameter } => {
                self.parameter_in_words(camera, parameter)
            }
        }
    }

    /// `point 'P' in image 'I'` of an observation of the problem.
    pub(super) fn observation_in_words(&self, part: &Part, observation: usize) -> String {
        let seen = &self.observations[part.observations[observation]];
        format!(
            "point '{}' in image '{}'",
            self.points[seen.point].name, self.images[seen.image].name
        )
    }

    /// An error of the adjustment in one line.
    pub(super) fn in_words(&self, part: &Part, error: AdjustmentError) -> PlainError {
        let image = |station: usize| &self.images[part.images[station]].name;
        let point = |index: usize| &self.points[part.points[index]].name;
        PlainError::Failed(match error {
            AdjustmentError::Interrupted(_) => return PlainError::Interrupted,
            AdjustmentError::InvalidInput { part: of, index } => {
                let what = match of {
                    ProblemPart::Station => format!("image '{}'", image(index)),
                    ProblemPart::Camera => format!("camera '{}'", self.cameras[index].name),
                    ProblemPart::Point | ProblemPart::Datum | ProblemPart::Frame => {
                        format!("point '{}'", point(index))
                    }
                    ProblemPart::Observation => self.observation_in_words(part, index),
                    ProblemPart::Distance => {
                        format!("distance '{}'", self.distances[part.distances[index]].name)
                    }
                };
                format!("{what}: its numbers are not valid")
            }
            AdjustmentError::PointsUnderdetermined { points } => {
                let names: Vec<&str> = points.iter().map(|&p| point(p).as_str()).collect();
                format!("{}: too few rays", listed("point", &names))
            }
            AdjustmentError::StationUnderdetermined { station, found } => {
                format!(
                    "image '{}': found {found} points, expected 3 or more",
                    image(station)
                )
            }
            AdjustmentError::NotImaged { observations } => format!(
                "{} of {} observations lie behind the camera or outside the lens at the starting values, the first is {}",
                observations.len(),
                part.problem.observations.len(),
                self.observation_in_words(part, observations[0])
            ),
            AdjustmentError::RankDefect { defect, loose } => {
                let name = |parameter: &ParameterName| match parameter {
                    ParameterName::Camera { index, parameter } => {
                        self.parameter_in_words(*index, *parameter)
                    }
                    ParameterName::Image { index, parameter } => {
                        format!(
                            "{} of image '{}'",
                            INTERIOR_NAMES[*parameter],
                            image(*index)
                        )
                    }
                    ParameterName::Station { index, component } => {
                        format!("{component} of image '{}'", image(*index))
                    }
                    ParameterName::Point { index } => format!("point '{}'", point(*index)),
                };
                let names: Vec<String> = loose.iter().take(UNKNOWNS).map(name).collect();
                format!(
                    "the observations do not determine {} (rank defect {defect})",
                    names.join(", ")
                )
            }
            AdjustmentError::NotConverged(end) => match end.kind {
                TerminationKind::NoDescent => {
                    "the adjustment does not converge: no step makes the residuals smaller".into()
                }
                _ => format!(
                    "the adjustment does not converge: the last step still changes the observations by {:.1e} sigmas (threshold {:.1e})",
                    end.value, end.threshold
                ),
            },
            other => other.to_string(),
        })
    }
}
