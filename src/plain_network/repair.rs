//! What an adjustment could not determine is held or left out, so that the rest can be adjusted.

use super::adjust::Part;
use super::contradictions::{KnownValue, Search};
use super::shape::{Extent, FLAT_SHARE};
use super::usable::{Usable, listed};
use super::words::with_unit;
use super::{DatumPoints, PlainDatum, PlainNetwork};
use crate::adjustment::{AdjustmentError, ParameterName, ParameterState, ProblemPart};
use crate::camera::INTERIOR_NAMES;

/// A given start of which more than this share of image points are not imaged is not believed.
const SHARE_NOT_IMAGED: f64 = 0.5;

/// Whether something was done about a failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Repair {
    /// Nothing can be done.
    Impossible,
    /// Something was held or left out.
    LeftOut,
    /// Something was left out on which starting values rest.
    StartsChanged,
}

/// A failed adjustment of a part of a network.
pub(super) struct Failure<'a> {
    pub(super) network: &'a PlainNetwork,
    pub(super) part: &'a Part,
    pub(super) error: &'a AdjustmentError,
}

impl Failure<'_> {
    /// Holds or leaves out what made the adjustment fail, and tells it; every call that does something removes something, so that
    /// repairs end.
    ///
    /// # Errors
    /// [`AdjustmentError::Interrupted`].
    pub(super) fn repair(
        &self,
        usable: &mut Usable,
        search: &Search<'_>,
    ) -> Result<Repair, AdjustmentError> {
        Ok(match self.error {
            AdjustmentError::RankDefect { loose, .. } => self.take_out_loose(usable, loose),
            AdjustmentError::NotImaged { observations } => {
                self.take_out_not_imaged(usable, observations)
            }
            AdjustmentError::PointsUnderdetermined { points } => {
                self.leave_points_out(usable, points, "too few rays")
            }
            AdjustmentError::StationUnderdetermined { station, found } => self.leave_images_out(
                usable,
                &[*station],
                &format!("found {found} points, expected 3 or more"),
            ),
            AdjustmentError::InvalidInput { part, index } => {
                self.take_out_invalid(usable, *part, *index)
            }
            AdjustmentError::DatumDefect { .. } | AdjustmentError::DatumPoints { .. } => {
                self.change_datum(usable)
            }
            AdjustmentError::NotConverged(_) => self.take_out_gross(usable, search)?,
            _ => Repair::Impossible,
        })
    }

    /// Of what is loose, one camera parameter is held; else images are left out, else points.
    fn take_out_loose(&self, usable: &mut Usable, loose: &[ParameterName]) -> Repair {
        let camera = loose.iter().find_map(|name| match name {
            ParameterName::Camera { index, parameter } => Some((*index, *parameter, None)),
            ParameterName::Image { index, parameter } => {
                let image = &self.network.images[self.part.images[*index]];
                Some((image.camera, *parameter, Some(&image.name)))
            }
            _ => None,
        });
        if let Some((camera, parameter, image)) = camera {
            usable.held[camera][parameter] = true;
            let value = self.network.cameras[camera].values[parameter];
            let of_image = image.map_or_else(String::new, |name| {
                format!(" ({} of image '{name}')", INTERIOR_NAMES[parameter])
            });
            usable.told.push(format!(
                "{}: the observations do not determine it{of_image}: held at {}",
                self.network.parameter_in_words(camera, parameter),
                with_unit(value, parameter)
            ));
            return Repair::LeftOut;
        }
        let mut stations: Vec<usize> = Vec::new();
        let mut points = Vec::new();
        for name in loose {
            match name {
                ParameterName::Station { index, .. } if !stations.contains(index) => {
                    stations.push(*index);
                }
                ParameterName::Point { index } => points.push(*index),
                _ => {}
            }
        }
        if stations.is_empty() {
            return self.leave_points_out(usable, &points, undetermined(points.len()));
        }
        // A few that hang loose go together; where most move, the one that moves most goes and the rest is tried.
        if 2 * stations.len() > self.part.images.len() {
            stations.truncate(1);
        }
        self.leave_images_out(usable, &stations, undetermined(stations.len()))
    }

    fn leave_points_out(&self, usable: &mut Usable, points: &[usize], reason: &str) -> Repair {
        if points.is_empty() {
            return Repair::Impossible;
        }
        let names: Vec<&str> = points
            .iter()
            .map(|&point| {
                let point = self.part.points[point];
                usable.points[point] = false;
                self.network.points[point].name.as_str()
            })
            .collect();
        let names = listed("point", &names);
        usable.told.push(format!("{names}: {reason}: left out"));
        Repair::LeftOut
    }

    fn leave_images_out(&self, usable: &mut Usable, stations: &[usize], reason: &str) -> Repair {
        let names: Vec<&str> = stations
            .iter()
            .map(|&station| {
                let image = self.part.images[station];
                usable.images[image] = false;
                self.network.images[image].name.as_str()
            })
            .collect();
        let names = listed("image", &names);
        usable.told.push(format!("{names}: {reason}: left out"));
        Repair::LeftOut
    }

    /// A given start that puts most of an image or all rays of a point where nothing is imaged is replaced; else the observations
    /// are left out.
    fn take_out_not_imaged(&self, usable: &mut Usable, observations: &[usize]) -> Repair {
        let (network, part) = (self.network, self.part);
        let mut of_image = vec![[0usize; 2]; network.images.len()];
        let mut of_point = vec![[0usize; 2]; network.points.len()];
        let mut count = |place: usize, observation: &usize| {
            let seen = &network.observations[part.observations[*observation]];
            of_image[seen.image][place] += 1;
            of_point[seen.point][place] += 1;
        };
        (0..part.observations.len()).for_each(|k| count(0, &k));
        observations.iter().for_each(|k| count(1, k));
        let mut changed = false;
        for (index, image) in network.images.iter().enumerate() {
            let [all, lost] = of_image[index];
            let is_believed = usable.image_starts[index] && image.start.is_some();
            if is_believed && lost as f64 > SHARE_NOT_IMAGED * all as f64 {
                usable.image_starts[index] = false;
                changed = true;
                usable.told.push(format!(
                    "image '{}': {lost} of {all} points lie behind the camera or outside the lens at its given pose: another is sought",
                    image.name
                ));
            }
        }
        if changed {
            return Repair::StartsChanged;
        }
        for (index, point) in network.points.iter().enumerate() {
            let [all, lost] = of_point[index];
            let is_believed = usable.point_starts[index] && point.start.is_some();
            if is_believed && lost > 0 && lost == all {
                usable.point_starts[index] = false;
                changed = true;
                usable.told.push(format!(
                    "point '{}': lies behind all its cameras or outside their lenses at its given coordinates: others are sought",
                    point.name
                ));
            }
        }
        if changed {
            return Repair::StartsChanged;
        }
        for &observation in observations {
            usable.observations[part.observations[observation]] = false;
        }
        usable.told.push(format!(
            "{} of {} observations lie behind the camera or outside the lens at the starting values and are left out, the first is {}",
            observations.len(),
            part.observations.len(),
            network.observation_in_words(part, observations[0])
        ));
        Repair::LeftOut
    }

    fn take_out_invalid(&self, usable: &mut Usable, of: ProblemPart, index: usize) -> Repair {
        let (network, part) = (self.network, self.part);
        let not_valid = "its numbers are not valid";
        match of {
            ProblemPart::Station if usable.image_starts[part.images[index]] => {
                usable.image_starts[part.images[index]] = false;
                let name = &network.images[part.images[index]].name;
                usable.told.push(format!(
                    "image '{name}': the numbers of its given pose are not valid: another is sought"
                ));
                Repair::StartsChanged
            }
            ProblemPart::Point => self.leave_points_out(usable, &[index], not_valid),
            ProblemPart::Observation => {
                usable.observations[part.observations[index]] = false;
                let name = network.observation_in_words(part, index);
                usable.told.push(format!("{name}: {not_valid}: left out"));
                Repair::LeftOut
            }
            ProblemPart::Distance => {
                usable.distances[part.distances[index]] = false;
                let name = &network.distances[part.distances[index]].name;
                usable
                    .told
                    .push(format!("distance '{name}': {not_valid}: left out"));
                Repair::LeftOut
            }
            _ => Repair::Impossible,
        }
    }

    /// Inner constraints on all points take what the chosen datum leaves free.
    fn change_datum(&self, usable: &mut Usable) -> Repair {
        let all = PlainDatum::InnerConstraints(DatumPoints::All);
        if usable.datum == all {
            return Repair::Impossible;
        }
        usable.told.push(match self.error {
            AdjustmentError::DatumDefect { defect, .. } => format!(
                "datum: the known coordinates leave {defect} of 7 motions of the network free: inner constraints on all points take them"
            ),
            _ => "datum: the listed points that take part do not fix the network: inner constraints on all points take their place".into(),
        });
        usable.datum = all;
        Repair::LeftOut
    }

    /// An adjustment that does not converge: the known value that is off most goes, else an image of points on a line, else all
    /// free camera parameters are held.
    fn take_out_gross(
        &self,
        usable: &mut Usable,
        search: &Search<'_>,
    ) -> Result<Repair, AdjustmentError> {
        if let Some(mut found) = search.gross()? {
            found.is_used = false;
            usable.leave_out_known(found.value);
            let line = found.in_words(self.network, search.critical);
            usable
                .told
                .push(format!("{line}, the adjustment does not converge with it"));
            usable.contradictions.push(found);
            return Ok(Repair::StartsChanged);
        }
        if self.leave_out_straight(usable) {
            return Ok(Repair::LeftOut);
        }
        let mut repair = Repair::Impossible;
        for (camera, block) in self.part.problem.cameras.iter().enumerate() {
            let free = (0..10).filter(|&k| block.parameters[k] == ParameterState::Free);
            let names: Vec<&str> = free
                .map(|parameter| {
                    usable.held[camera][parameter] = true;
                    INTERIOR_NAMES[parameter]
                })
                .collect();
            if !names.is_empty() {
                repair = Repair::LeftOut;
                usable.told.push(format!(
                    "{} of camera '{}': the adjustment does not converge while they are free: held at their values",
                    names.join(", "),
                    self.network.cameras[camera].name
                ));
            }
        }
        Ok(repair)
    }

    /// Leaves out the image whose points lie nearest to a line, about which it may turn; whether there is one.
    fn leave_out_straight(&self, usable: &mut Usable) -> bool {
        let problem = &self.part.problem;
        let mut places = vec![Vec::new(); problem.stations.len()];
        for seen in &problem.observations {
            places[seen.station].push(problem.points[seen.point].position);
        }
        let extents = places.iter().map(|places| Extent::of(places));
        let straight = extents.enumerate().filter_map(|(station, extent)| {
            let extent = extent?;
            Some((station, extent, extent.from_line / extent.length))
        });
        let straight = straight.min_by(|a, b| a.2.total_cmp(&b.2));
        let Some((station, extent, _)) = straight.filter(|(_, _, share)| *share < FLAT_SHARE)
        else {
            return false;
        };
        let image = self.part.images[station];
        usable.images[image] = false;
        usable.told.push(format!(
            "image '{}': its {} points lie on a line (within {:.3} mm, {:.0} mm long), and the adjustment does not converge with it: left out",
            self.network.images[image].name, extent.count, extent.from_line, extent.length
        ));
        true
    }
}

impl Usable {
    pub(super) fn leave_out_known(&mut self, value: KnownValue) {
        match value {
            KnownValue::Coordinate { point, axis } => self.known[point][axis] = false,
            KnownValue::Distance { index } => self.distances[index] = false,
            KnownValue::Parameter { camera, parameter } => {
                self.known_parameters[camera][parameter] = false;
            }
        }
    }
}

/// Why so many things are left out.
fn undetermined(count: usize) -> &'static str {
    match count {
        1 => "the observations do not determine it",
        _ => "the observations do not determine them",
    }
}
