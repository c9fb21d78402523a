//! The adjustment of a plain network: everything that can take part, with a line for everything that cannot.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Vector2, Vector3};

use super::components::{GroupComponent, Weights, components};
use super::contradictions::{Contradiction, Search, Start};
use super::repair::{Failure, Repair};
use super::shape::{PrincipalDistance, Shape, hopeless_shape};
use super::starts::Starts;
use super::usable::{Usable, listed};
use super::weak::badly_determined;
use super::{DatumPoints, Known, PlainCamera, PlainDatum, PlainNetwork, PlainParameter, PointRole};
use crate::adjustment::{
    Adjustment, AdjustmentError, BundleProblem, BundleSettings, CameraBlock, CoordinatePrior,
    Datum, DistanceObservation, ImageObservation, ParameterState, PointBlock, RejectedObservation,
    RejectionSettings, SolvedNetwork, StationBlock, adjust, adjust_with_rejection,
};
use crate::camera::{Camera, InteriorOrientation};
use crate::monitor::Monitor;
use crate::network::BarRole;

/// How a network is adjusted.
#[derive(Clone, Debug, Default)]
pub struct PlainSettings {
    /// How its equations are iterated.
    pub bundle: BundleSettings,
    /// What counts as a gross error; `None`: every observation and every known value is used, and known values that contradict
    /// everything else are told only.
    pub rejection: Option<RejectionSettings>,
    /// Where the weights of image points and distances come from.
    pub weights: Weights,
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
    /// Camera parameters that are free in the network but were held, because the observations do not determine them.
    pub held: Vec<HeldParameter>,
    /// Known values that contradict everything else, the worst first; with rejection those are left out of which it is known that
    /// they are wrong.
    pub contradictions: Vec<Contradiction>,
    /// How exact each group of observations is by its own residuals.
    pub components: Vec<GroupComponent>,
    /// What could not take part or should be known, one line each.
    pub told: Vec<String>,
    /// What was adjusted.
    problem: BundleProblem,
}

/// A camera parameter that was held at its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeldParameter {
    /// Index of the camera.
    pub camera: usize,
    /// Index into [`crate::camera::INTERIOR_NAMES`].
    pub parameter: usize,
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

    /// What the adjustment does with its parameters; `believed`: known values that are, `held`: free ones that are not estimated.
    fn states(&self, believed: &[bool; 10], held: &[bool; 10]) -> [ParameterState; 10] {
        std::array::from_fn(|k| match self.parameters[k] {
            PlainParameter::Weighted { sigma } if believed[k] => ParameterState::Weighted {
                value: self.values[k],
                sigma,
            },
            PlainParameter::Fixed => ParameterState::Fixed,
            _ if held[k] => ParameterState::Fixed,
            _ => ParameterState::Free,
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

/// What takes part, in the order in which the adjustment has it.
pub(super) struct Part {
    pub(super) images: Vec<usize>,
    pub(super) points: Vec<usize>,
    pub(super) observations: Vec<usize>,
    pub(super) distances: Vec<usize>,
    pub(super) problem: BundleProblem,
}

/// What came of one adjustment of a part.
pub(super) struct Adjusted {
    pub(super) adjustment: Adjustment,
    pub(super) rejected: Vec<RejectedObservation>,
}

impl PlainAdjustment {
    /// The solved equations, for covariances, derived quantities and other datums; indices are those of the adjustment's lists.
    ///
    /// Cost: one factorisation and inverse of the normal equations.
    ///
    /// # Errors
    /// As the adjustment.
    pub fn solved(&self, monitor: &Monitor) -> Result<SolvedNetwork, AdjustmentError> {
        SolvedNetwork::of(self.problem.clone(), &self.adjustment, monitor)
    }

    /// What was adjusted, with the rejected observations and the standard deviations that were used.
    #[must_use]
    pub fn problem(&self) -> &BundleProblem {
        &self.problem
    }
}

impl PlainNetwork {
    /// Adjusts what can take part: what is bad is left out, what the observations do not determine is held or left out, and each is
    /// told in one line; then everything else is adjusted again.
    ///
    /// # Errors
    /// [`PlainError`], in one line that names the thing.
    pub fn adjust(
        &self,
        settings: &PlainSettings,
        monitor: &Monitor,
    ) -> Result<PlainAdjustment, PlainError> {
        let mut usable = Usable::of(self);
        let mut starts = Starts::find(self, &usable);
        let mut contradictions_sought = settings.rejection.is_none();
        let mut hopeless = None;
        loop {
            usable.settle(self);
            hopeless = hopeless.or_else(|| self.hopeless(&usable, &starts));
            self.leave_out_unknown(&mut usable, &starts);
            usable.settle(self);
            let because = |error| hopeless.clone().map_or(error, PlainError::Failed);
            let mut part = self.part(&usable, &starts).map_err(because)?;
            let search = Search::of(&part, settings, monitor);
            let in_words = |error| self.in_words(&part, error);
            if let (false, Some(rejection)) = (contradictions_sought, &settings.rejection) {
                contradictions_sought = true;
                let found = contradictions_of_rays(&search, rejection).map_err(in_words)?;
                if self.leave_out_contradictions(&mut usable, &search, found) {
                    continue;
                }
            }
            let error = match adjust_part(&part, settings, monitor) {
                Ok(mut adjusted) => {
                    if settings.rejection.is_none() {
                        let result = Start::Result(&adjusted.adjustment);
                        let found = search.contradictions(result, &BTreeSet::new());
                        self.tell_contradictions(&mut usable, &search, found.map_err(in_words)?);
                    }
                    let rejected = adjusted.rejected.iter().map(|r| r.index);
                    part.problem.rejected.extend(rejected);
                    let components = components(
                        self,
                        &mut part,
                        &mut adjusted,
                        settings.weights,
                        settings.bundle,
                        monitor,
                    );
                    let components = match components {
                        Ok(components) => components,
                        Err(error) => return Err(self.in_words(&part, error)),
                    };
                    return Ok(self.concluded(part, adjusted, components, usable));
                }
                Err(error) => error,
            };
            let failure = Failure {
                network: self,
                part: &part,
                error: &error,
            };
            match failure.repair(&mut usable, &search).map_err(in_words)? {
                Repair::LeftOut => {}
                Repair::StartsChanged => starts = Starts::find(self, &usable),
                Repair::Impossible => return Err(because(in_words(error))),
            }
        }
    }

    /// Leaves out what is known to be wrong; whether there is any.
    fn leave_out_contradictions(
        &self,
        usable: &mut Usable,
        search: &Search<'_>,
        mut found: Vec<Contradiction>,
    ) -> bool {
        let mut any = false;
        for contradiction in found.iter_mut().filter(|found| found.can_be_left_out()) {
            contradiction.is_used = false;
            usable.leave_out_known(contradiction.value);
            any = true;
        }
        self.tell_contradictions(usable, search, found);
        any
    }

    fn tell_contradictions(
        &self,
        usable: &mut Usable,
        search: &Search<'_>,
        found: Vec<Contradiction>,
    ) {
        let lines = found
            .iter()
            .map(|found| found.in_words(self, search.critical));
        usable.told.extend(lines);
        usable.contradictions.extend(found);
    }

    /// Why nothing can be adjusted from these starts, where their shape forbids it.
    fn hopeless(&self, usable: &Usable, starts: &Starts) -> Option<String> {
        let points = (0..self.points.len()).filter(|&k| usable.points[k]);
        let points: Vec<Vector3<f64>> = points.filter_map(|k| starts.positions[k]).collect();
        let images = (0..self.images.len()).filter(|&k| usable.images[k]);
        let stations: Vec<Vector3<f64>> = images
            .filter_map(|k| Some(starts.poses[k]?.centre_in_world))
            .collect();
        hopeless_shape(&points, &stations)
    }

    fn concluded(
        &self,
        part: Part,
        adjusted: Adjusted,
        components: Vec<GroupComponent>,
        mut usable: Usable,
    ) -> PlainAdjustment {
        let Adjusted {
            adjustment,
            rejected,
        } = adjusted;
        self.tell_of_scale(&part, &mut usable);
        let seen = adjustment.points.iter().filter(|point| point.rays > 0);
        let points: Vec<Vector3<f64>> = seen.map(|point| point.position).collect();
        let stations = adjustment.stations.iter();
        let stations: Vec<Vector3<f64>> = stations.map(|s| s.pose.centre_in_world).collect();
        let mut cameras = part.problem.cameras.iter();
        let c = match cameras.any(|camera| camera.parameters[0] != ParameterState::Fixed) {
            true => PrincipalDistance::Estimated,
            false => PrincipalDistance::Held,
        };
        if let Some(shape) = Shape::of(&points, &stations) {
            usable.told.extend(shape.told(c));
        }
        usable
            .told
            .extend(badly_determined(self, &part, &adjustment));
        let held = usable.held.iter().enumerate().flat_map(|(camera, held)| {
            let held = (0..10).filter(|&parameter| held[parameter]);
            held.map(move |parameter| HeldParameter { camera, parameter })
        });
        PlainAdjustment {
            images: part.images,
            points: part.points,
            observations: part.observations,
            distances: part.distances,
            adjustment,
            rejected,
            held: held.collect(),
            contradictions: usable.contradictions,
            components,
            told: usable.told,
            problem: part.problem,
        }
    }

    /// The network as an adjustment begins with it: a pose and coordinates for everything that can take part, none for the
    /// rest; and a line for each thing of the rest.
    #[must_use]
    pub fn started(&self) -> (Self, Vec<String>) {
        let (usable, starts) = self.beginning();
        let mut network = self.clone();
        for (index, image) in network.images.iter_mut().enumerate() {
            image.start = starts.poses[index].filter(|_| usable.images[index]);
        }
        for (index, point) in network.points.iter_mut().enumerate() {
            let place = starts.positions[index].filter(|_| usable.points[index]);
            point.start = place.map(Into::into);
        }
        (network, usable.told)
    }

    /// What can be adjusted, and where it starts.
    fn beginning(&self) -> (Usable, Starts) {
        let mut usable = Usable::of(self);
        let starts = Starts::find(self, &usable);
        usable.settle(self);
        self.leave_out_unknown(&mut usable, &starts);
        usable.settle(self);
        (usable, starts)
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
        for (index, seen) in usable.seen(self) {
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
            let is_used = usable.distances[index] && distance.role == BarRole::Control;
            if let ([Some(from), Some(to)], true) = (ends, is_used) {
                distances.push(index);
                lengths.push(DistanceObservation {
                    from,
                    to,
                    length_mm: self.length_mm(distance),
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
            block.correlations = self.points[point].correlations;
            let is_control = self.points[point].role == PointRole::Control;
            let is_used = |axis: usize| is_control && usable.known[point][axis];
            block.prior = [0, 1, 2].map(|axis| {
                let known = self.points[point].known[axis].filter(|_| is_used(axis));
                Some(known?.prior())
            });
            Some(block)
        });
        let datum = match &usable.datum {
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
                    camera.states(&usable.known_parameters[index], &usable.held[index])
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

    fn tell_of_scale(&self, part: &Part, usable: &mut Usable) {
        let known = part
            .problem
            .points
            .iter()
            .filter(|p| p.prior.iter().any(Option::is_some));
        if part.problem.distances.is_empty() && known.count() < 2 {
            usable.told.push(
                "found no distance and no known coordinates: the scale is that of the starting values"
                    .into(),
            );
        }
        // Those that were left out for themselves are told already.
        let lost = self
            .distances
            .iter()
            .enumerate()
            .filter(|(index, distance)| {
                distance.role == BarRole::Control
                    && usable.distances[*index]
                    && !part.distances.contains(index)
            });
        let names: Vec<&str> = lost.map(|(_, distance)| distance.name.as_str()).collect();
        if !names.is_empty() {
            usable.told.push(format!(
                "{}: found an end that does not take part: not used",
                listed("distance", &names)
            ));
        }
    }
}

fn adjust_part(
    part: &Part,
    settings: &PlainSettings,
    monitor: &Monitor,
) -> Result<Adjusted, AdjustmentError> {
    match &settings.rejection {
        None => Ok(Adjusted {
            adjustment: adjust(part.problem.clone(), settings.bundle, monitor)?,
            rejected: Vec::new(),
        }),
        Some(rejection) => {
            let robust = adjust_with_rejection(&part.problem, settings.bundle, rejection, monitor)?;
            Ok(Adjusted {
                adjustment: robust.adjustment,
                rejected: robust.rejected,
            })
        }
    }
}

/// Contradictions of known values with rays of which the gross errors are gone: known values that hardly pull do not make good
/// rays look wrong, and so gross errors of the images are found first.
///
/// # Errors
/// [`AdjustmentError::Interrupted`].
fn contradictions_of_rays(
    search: &Search<'_>,
    rejection: &RejectionSettings,
) -> Result<Vec<Contradiction>, AdjustmentError> {
    if !search.is_possible() {
        return Ok(Vec::new());
    }
    let slack = search.slack();
    match adjust_with_rejection(&slack, search.bundle, rejection, search.monitor) {
        Ok(robust) => {
            let rejected = robust.rejected.iter().map(|rejected| rejected.index);
            search.contradictions(Start::Near(&robust.adjustment), &rejected.collect())
        }
        Err(AdjustmentError::Interrupted(stop)) => Err(AdjustmentError::Interrupted(stop)),
        Err(_) => search.contradictions(Start::Given, &BTreeSet::new()),
    }
}
