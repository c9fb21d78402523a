//! The adjustment of a plain network: everything that can take part, with a line for everything that cannot.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Vector2, Vector3};

use super::starts::Starts;
use super::usable::{Usable, listed};
use super::{
    DatumPoints, Known, PlainCamera, PlainDatum, PlainNetwork, PlainParameter, PlainPoint,
    PointRole,
};
use crate::adjustment::{
    Adjustment, AdjustmentError, BundleProblem, BundleSettings, CameraBlock, CoordinatePrior,
    Datum, DistanceObservation, ImageObservation, ParameterName, ParameterState, PointBlock,
    ProblemPart, RejectedObservation, RejectionSettings, StationBlock, adjust,
    adjust_with_rejection,
};
use crate::camera::{Camera, INTERIOR_NAMES, InteriorOrientation};
use crate::monitor::Monitor;
use crate::network::BarRole;

/// How a network is adjusted.
#[derive(Clone, Debug, Default)]
pub struct PlainSettings {
    /// How its equations are iterated.
    pub bundle: BundleSettings,
    /// What counts as a gross error; `None`: every observation is used.
    pub rejection: Option<RejectionSettings>,
}

/// An adjusted network: the adjustment's lists refer to the entries of the network by these indices.
#[derive(Clone, Debug)]
pub struct PlainAdjustment {
    /// Index of the network's image of every station.
    pub images: Vec<usize>,
    /// Index of the network's point of every point.
    pub points: Vec<usize>,
    /// Index of the network's observation of every observation.
    pub observations: Vec<usize>,
    /// Index of the network's distance of every distance.
    pub distances: Vec<usize>,
    /// The result.
    pub adjustment: Adjustment,
    /// Observations that were rejected, by their places in `observations`.
    pub rejected: Vec<RejectedObservation>,
    /// What could not take part or should be known, one line each.
    pub told: Vec<String>,
}

/// Why a network was not adjusted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlainError {
    /// The operator asked to stop.
    #[error("interrupted")]
    Interrupted,
    /// There is nothing to adjust.
    #[error("{0}")]
    Nothing(String),
    /// The adjustment failed.
    #[error("{0}")]
    Failed(String),
}

impl PlainCamera {
    /// The camera with these values.
    #[must_use]
    pub fn camera(&self) -> Camera {
        let lens = InteriorOrientation {
            direction: self.lens,
            ..InteriorOrientation::pinhole(1.0)
        };
        Camera {
            width_px: self.width_px,
            height_px: self.height_px,
            pixel_pitch_mm: self.pixel_pitch_mm,
            interior: lens.with_values(&self.values.into()),
        }
    }

    fn states(&self) -> [ParameterState; 10] {
        std::array::from_fn(|k| match self.parameters[k] {
            PlainParameter::Fixed => ParameterState::Fixed,
            PlainParameter::Free => ParameterState::Free,
            PlainParameter::Weighted { sigma } => ParameterState::Weighted {
                value: self.values[k],
                sigma,
            },
        })
    }
}

impl Known {
    fn prior(self) -> CoordinatePrior {
        let value = self.value_mm;
        match self.sigma_mm {
            Some(sigma) => CoordinatePrior::Weighted { value, sigma },
            None => CoordinatePrior::Fixed { value },
        }
    }
}

impl PlainPoint {
    /// Where it is by its known coordinates, else by its start.
    pub(super) fn place(&self) -> Option<Vector3<f64>> {
        let known = |axis: usize| match self.role {
            PointRole::Control => self.known[axis].map(|known| known.value_mm),
            PointRole::Check | PointRole::New => None,
        };
        let coordinate = |axis: usize| known(axis).or_else(|| Some(self.start.as_ref()?[axis]));
        Some(Vector3::new(coordinate(0)?, coordinate(1)?, coordinate(2)?))
    }
}

/// What takes part, in the order in which the adjustment has it.
struct Part {
    images: Vec<usize>,
    points: Vec<usize>,
    observations: Vec<usize>,
    distances: Vec<usize>,
    problem: BundleProblem,
}

impl PlainNetwork {
    /// Adjusts what can take part.
    ///
    /// # Errors
    /// [`PlainError`], in one line that names the thing.
    pub fn adjust(
        &self,
        settings: &PlainSettings,
        monitor: &Monitor,
    ) -> Result<PlainAdjustment, PlainError> {
        let mut usable = Usable::of(self);
        let starts = Starts::find(self, [&usable.images, &usable.points]);
        self.leave_out_unknown(&mut usable, &starts);
        usable.settle(self);
        let part = self.part(&usable, &starts)?;
        self.tell_of_scale(&part, &mut usable.told);
        let in_words = |error| self.in_words(&part, error);
        let (adjustment, rejected) = match &settings.rejection {
            None => {
                let adjusted = adjust(part.problem.clone(), settings.bundle, monitor);
                (adjusted.map_err(in_words)?, Vec::new())
            }
            Some(rejection) => {
                let robust =
                    adjust_with_rejection(&part.problem, settings.bundle, rejection, monitor);
                let robust = robust.map_err(in_words)?;
                (robust.adjustment, robust.rejected)
            }
        };
        Ok(PlainAdjustment {
            images: part.images,
            points: part.points,
            observations: part.observations,
            distances: part.distances,
            adjustment,
            rejected,
            told: usable.told,
        })
    }

    fn leave_out_unknown(&self, usable: &mut Usable, starts: &Starts) {
        for (index, image) in self.images.iter().enumerate() {
            if usable.images[index] && starts.poses[index].is_none() {
                usable.images[index] = false;
                usable.told.push(format!(
                    "image '{}': found no starting pose, and its points give none: left out",
                    image.name
                ));
            }
        }
        for (index, point) in self.points.iter().enumerate() {
            if usable.points[index] && starts.positions[index].is_none() {
                usable.points[index] = false;
                usable.told.push(format!(
                    "point '{}': found no starting coordinates, and its rays do not meet: left out",
                    point.name
                ));
            }
        }
    }

    fn part(&self, usable: &Usable, starts: &Starts) -> Result<Part, PlainError> {
        let taken =
            |used: &[bool]| -> Vec<usize> { (0..used.len()).filter(|&k| used[k]).collect() };
        let (images, points) = (taken(&usable.images), taken(&usable.points));
        if images.len() < 2 {
            return Err(PlainError::Nothing(format!(
                "found {} images that can be adjusted, expected 2 or more{}",
                images.len(),
                usable
                    .told
                    .first()
                    .map(|first| format!("; {first}"))
                    .unwrap_or_default()
            )));
        }
        let place = |list: &[usize]| -> BTreeMap<usize, usize> {
            list.iter()
                .enumerate()
                .map(|(at, &index)| (index, at))
                .collect()
        };
        let (station_of, point_of) = (place(&images), place(&points));
        let mut observations = Vec::new();
        let mut rays = Vec::new();
        for (index, seen) in self.observations.iter().enumerate() {
            if let (Some(&station), Some(&point)) =
                (station_of.get(&seen.image), point_of.get(&seen.point))
            {
                observations.push(index);
                rays.push(ImageObservation {
                    station,
                    point,
                    pixel: Vector2::new(seen.x_px, seen.y_px),
                    sigma_px: seen.sigma_px,
                });
            }
        }
        let mut distances = Vec::new();
        let mut lengths = Vec::new();
        for (index, distance) in self.distances.iter().enumerate() {
            let ends = [distance.from, distance.to].map(|end| point_of.get(&end).copied());
            if let ([Some(from), Some(to)], BarRole::Control) = (ends, distance.role) {
                distances.push(index);
                lengths.push(DistanceObservation {
                    from,
                    to,
                    length_mm: distance.length_mm,
                    sigma_mm: distance.sigma_mm,
                });
            }
        }
        let stations = images.iter().filter_map(|&image| {
            Some(StationBlock {
                camera: self.images[image].camera,
                pose: starts.poses[image]?,
            })
        });
        let blocks = points.iter().filter_map(|&point| {
            let mut block = PointBlock::unknown(starts.positions[point]?);
            if self.points[point].role == PointRole::Control {
                let known = self.points[point].known;
                block.prior = known.map(|known| Some(known?.prior()));
            }
            Some(block)
        });
        let datum = match &self.datum {
            PlainDatum::Control => Datum::Control,
            PlainDatum::InnerConstraints(chosen) => Datum::InnerConstraints {
                points: match chosen {
                    DatumPoints::All => (0..points.len()).collect(),
                    DatumPoints::Listed(list) => list
                        .iter()
                        .filter_map(|point| point_of.get(point).copied())
                        .collect(),
                },
            },
        };
        let in_use: BTreeSet<usize> = images.iter().map(|&i| self.images[i].camera).collect();
        let cameras = self
            .cameras
            .iter()
            .enumerate()
            .map(|(index, camera)| CameraBlock {
                camera: camera.camera(),
                parameters: if in_use.contains(&index) {
                    camera.states()
                } else {
                    [ParameterState::Fixed; 10]
                },
                sharing: camera.sharing,
            });
        let problem = BundleProblem {
            cameras: cameras.collect(),
            stations: stations.collect(),
            points: blocks.collect(),
            observations: rays,
            distances: lengths,
            residuals: self.residuals,
            datum,
            frame: None,
            rejected: BTreeSet::new(),
        };
        Ok(Part {
            images,
            points,
            observations,
            distances,
            problem,
        })
    }

    fn tell_of_scale(&self, part: &Part, told: &mut Vec<String>) {
        let known = part
            .problem
            .points
            .iter()
            .filter(|p| p.prior.iter().any(Option::is_some));
        if part.problem.distances.is_empty() && known.count() < 2 {
            told.push(
                "found no distance and no known coordinates: the scale is that of the starting values"
                    .into(),
            );
        }
        let lost = self.distances.iter().enumerate();
        let lost = lost.filter(|(k, d)| d.role == BarRole::Control && !part.distances.contains(k));
        let names: Vec<&str> = lost.map(|(_, distance)| distance.name.as_str()).collect();
        if !names.is_empty() {
            told.push(format!(
                "{}: found an end that does not take part: not used",
                listed("distance", &names)
            ));
        }
    }

    /// An error of the adjustment with the names that the network has.
    fn in_words(&self, part: &Part, error: AdjustmentError) -> PlainError {
        let image = |station: usize| &self.images[part.images[station]].name;
        let point = |index: usize| &self.points[part.points[index]].name;
        let observation = |index: usize| {
            let seen = &part.problem.observations[index];
            format!(
                "point '{}' in image '{}'",
                point(seen.point),
                image(seen.station)
            )
        };
        PlainError::Failed(match error {
            AdjustmentError::Interrupted(_) => return PlainError::Interrupted,
            AdjustmentError::InvalidInput { part: of, index } => {
                let what = match of {
                    ProblemPart::Station => format!("image '{}'", image(index)),
                    ProblemPart::Camera => format!("camera '{}'", self.cameras[index].name),
                    ProblemPart::Point | ProblemPart::Datum | ProblemPart::Frame => {
                        format!("point '{}'", point(index))
                    }
                    ProblemPart::Observation => observation(index),
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
                observation(observations[0])
            ),
            AdjustmentError::RankDefect { defect, loose } => {
                let name = |parameter: &ParameterName| match parameter {
                    ParameterName::Camera { index, parameter } => {
                        format!(
                            "{} of camera '{}'",
                            INTERIOR_NAMES[*parameter], self.cameras[*index].name
                        )
                    }
                    ParameterName::Image { index, parameter } => {
                        let name = INTERIOR_NAMES[*parameter];
                        format!("{name} of image '{}'", image(*index))
                    }
                    ParameterName::Station { index, component } => {
                        format!("{component} of image '{}'", image(*index))
                    }
                    ParameterName::Point { index } => format!("point '{}'", point(*index)),
                };
                let names: Vec<String> = loose.iter().take(6).map(name).collect();
                format!(
                    "the observations do not determine {} (rank defect {defect})",
                    names.join(", ")
                )
            }
            other => other.to_string(),
        })
    }
}
