//! Which unknown stands where: stations, cameras and the ends of distances are kept in the reduced system, all other
//! points are eliminated.

use std::ops::Range;

use rayon::prelude::*;

use super::error::{ParameterName, ProblemPart, StationComponent};
use super::structure::{Structure, spread_stations};
use super::{AdjustmentError, BundleProblem, CoordinatePrior, ParameterState, PointBlock, Sharing};
use crate::monitor::{Interrupted, Monitor};

/// The part a point takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PointRole {
    /// None: it has no used observation.
    Absent,
    /// Its rays only: it has no unknowns.
    Fixed,
    /// Its unknowns are eliminated.
    Eliminated,
    /// Its unknowns belong to the reduced system (an end of a distance), from this index on.
    Kept { start: usize },
}

/// A ray of a point, with the places of its station's unknowns, those of its interior orientation that the station has for itself,
/// and its camera's in [`PointFrame::index`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub(super) observation: usize,
    pub(super) station_at: usize,
    pub(super) own_at: usize,
    pub(super) camera_at: usize,
    pub(super) camera: usize,
    pub(super) used: bool,
}

/// A point that takes part, with all kept unknowns that its rays touch.
#[derive(Clone, Debug)]
pub(super) struct PointFrame {
    pub(super) point: usize,
    /// Indices in the reduced system, rising.
    pub(super) index: Vec<usize>,
    /// How many stations they belong to; each has six places, the other unknowns follow.
    pub(super) stations: usize,
    /// Where the places of the stations' own interior parameters end, which follow those six.
    pub(super) own_end: usize,
    /// By station.
    pub(super) rays: Vec<Ray>,
    /// Place of the point's own unknowns in `index`, for a kept point.
    pub(super) own_at: Option<usize>,
    /// The blocks of unknowns that `index` consists of, each with its first place.
    pub(super) blocks: Vec<(usize, usize)>,
}

impl PointFrame {
    /// The block whose unknowns begin at a place.
    pub(super) fn block_at(&self, place: usize) -> usize {
        match place < 6 * self.stations {
            true => self.blocks[place / 6].0,
            false => self.blocks[self.blocks.partition_point(|(_, at)| *at < place)].0,
        }
    }

    /// The places of one of its blocks.
    pub(super) fn places(&self, at: usize) -> Range<usize> {
        let end = self
            .blocks
            .get(at + 1)
            .map_or(self.index.len(), |next| next.1);
        self.blocks[at].1..end
    }

    /// The rays that may touch one of its blocks: every ray touches a camera or, where the point is kept, the point; the unknowns of
    /// a station are touched by its own rays alone.
    fn rays_of(&self, at: usize) -> Range<usize> {
        let places = self.places(at);
        let of_ray = |ray: &Ray| match places.start < 6 * self.stations {
            true => ray.station_at,
            false => ray.own_at,
        };
        if places.start >= self.own_end {
            return 0..self.rays.len();
        }
        let before = |limit: usize| self.rays.partition_point(|ray| of_ray(ray) < limit);
        before(places.start)..before(places.end)
    }
}

/// A point that has to do with a block of unknowns.
#[derive(Clone, Debug)]
pub(super) struct FrameOfBlock {
    pub(super) frame: usize,
    /// Which of the frame's blocks it is.
    pub(super) at: usize,
    /// The rays that may touch it.
    pub(super) rays: Range<usize>,
}

/// The order of the unknowns.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    /// Size of the reduced system: 6 a station, the interior parameters that stations have for themselves, those of cameras, the unknown coordinates of kept points.
    pub(super) kept: usize,
    /// By station, its camera.
    pub(super) camera_of: Vec<usize>,
    /// By station, where its own interior parameters begin.
    pub(super) own_start: Vec<usize>,
    /// Per camera, the interior parameters that are estimated for each image.
    pub(super) camera_own: Vec<Vec<usize>>,
    pub(super) camera_start: Vec<usize>,
    /// Per camera, the interior parameters that are estimated for all of its images.
    pub(super) camera_free: Vec<Vec<usize>>,
    pub(super) roles: Vec<PointRole>,
    /// By point, the axes of the coordinates that are unknowns, rising; the others are fixed.
    pub(super) unknown_axes: Vec<Vec<usize>>,
    pub(super) distance_used: Vec<bool>,
    /// By point, whether a used ray or distance ties it to others: a known point without either takes part but has nothing to say of
    /// where the network lies.
    pub(super) tied: Vec<bool>,
    pub(super) frames: Vec<PointFrame>,
    /// Observations that take part.
    pub(super) used: Vec<bool>,
    /// Points given by the datum that take part.
    pub(super) datum_points: Vec<usize>,
    /// Where the reduced system has entries.
    pub(super) structure: Structure,
    /// By block, the points that have to do with it.
    pub(super) frames_of_block: Vec<Vec<FrameOfBlock>>,
}

impl Layout {
    pub(super) fn new(problem: &BundleProblem, monitor: &Monitor) -> Result<Self, AdjustmentError> {
        check_input(problem)?;
        monitor.check()?;
        let used = problem.used();
        let mut rays = vec![0usize; problem.points.len()];
        for (o, _) in problem.observations.iter().zip(&used).filter(|u| *u.1) {
            rays[o.point] += 1;
        }
        let present: Vec<bool> = (0..rays.len())
            .map(|i| rays[i] > 0 || problem.points[i].known_coordinates() == 3)
            .collect();
        let distance_used: Vec<bool> = problem
            .distances
            .iter()
            .map(|d| present[d.from] && present[d.to])
            .collect();
        let mut tied: Vec<bool> = rays.iter().map(|&rays| rays > 0).collect();
        let distances = problem.distances.iter().zip(&distance_used);
        for (d, _) in distances.filter(|d| *d.1) {
            tied[d.from] = true;
            tied[d.to] = true;
        }
        check_determined(problem, &rays, &present, &distance_used, &used)?;
        monitor.check()?;

        let mut kept = 6 * problem.stations.len();
        let cameras = problem.cameras.iter();
        let camera_own: Vec<_> = cameras.map(|c| c.estimated(Sharing::Image)).collect();
        let camera_of: Vec<usize> = problem.stations.iter().map(|s| s.camera).collect();
        let mut own_start = Vec::new();
        for &camera in &camera_of {
            own_start.push(kept);
            kept += camera_own[camera].len();
        }
        let (mut camera_start, mut camera_free) = (Vec::new(), Vec::new());
        for camera in &problem.cameras {
            let free = camera.estimated(Sharing::Camera);
            camera_start.push(kept);
            kept += free.len();
            camera_free.push(free);
        }
        let unknown_axes: Vec<Vec<usize>> = problem
            .points
            .iter()
            .map(PointBlock::unknown_axes)
            .collect();
        let mut roles: Vec<PointRole> = present
            .iter()
            .zip(&unknown_axes)
            .map(|(present, axes)| match (present, axes.is_empty()) {
                (false, _) => PointRole::Absent,
                (true, true) => PointRole::Fixed,
                (true, false) => PointRole::Eliminated,
            })
            .collect();
        let ends = problem.distances.iter().zip(&distance_used);
        for end in ends.filter(|d| *d.1).flat_map(|d| [d.0.from, d.0.to]) {
            if roles[end] == PointRole::Eliminated {
                roles[end] = PointRole::Kept { start: kept };
                kept += unknown_axes[end].len();
            }
        }
        let mut starts: Vec<usize> = (0..problem.stations.len()).map(|s| 6 * s).collect();
        let own = own_start.iter().zip(&camera_of);
        starts.extend(own.filter(|o| !camera_own[*o.1].is_empty()).map(|o| *o.0));
        let cameras = camera_start.iter().zip(&camera_free);
        starts.extend(cameras.filter(|c| !c.1.is_empty()).map(|c| *c.0));
        let mut ends: Vec<usize> = roles
            .iter()
            .filter_map(|role| match role {
                PointRole::Kept { start } => Some(*start),
                _ => None,
            })
            .collect();
        ends.sort_unstable();
        starts.extend(ends);
        starts.push(kept);
        let mut layout = Self {
            structure: Structure::default(),
            frames_of_block: Vec::new(),
            kept,
            camera_of,
            own_start,
            camera_own,
            camera_start,
            camera_free,
            roles,
            unknown_axes,
            distance_used,
            tied,
            frames: Vec::new(),
            used,
            datum_points: Vec::new(),
        };
        if let super::Datum::InnerConstraints { points } = &problem.datum {
            layout.set_datum_points(points);
        }
        layout.frames = layout.point_frames(problem, &starts, monitor)?;
        monitor.check()?;
        let of_frames = layout.frames.iter();
        let of_frames = of_frames.map(|frame| frame.blocks.iter().map(|block| block.0).collect());
        let of_distances = problem.distances.iter().zip(&layout.distance_used);
        let of_distances = of_distances.filter(|d| *d.1).map(|(distance, _)| {
            let ends = [distance.from, distance.to].into_iter();
            let ends = ends.filter_map(|point| match layout.roles[point] {
                PointRole::Kept { start } => starts.binary_search(&start).ok(),
                _ => None,
            });
            ends.collect()
        });
        layout.structure = Structure::new(
            starts.clone(),
            of_frames.chain(of_distances),
            spread_stations(problem),
        );
        monitor.check()?;
        let mut frames_of_block = vec![Vec::new(); layout.structure.blocks()];
        for (index, frame) in layout.frames.iter().enumerate() {
            monitor.check()?;
            for (at, &(block, _)) in frame.blocks.iter().enumerate() {
                frames_of_block[block].push(FrameOfBlock {
                    frame: index,
                    at,
                    rays: frame.rays_of(at),
                });
            }
        }
        layout.frames_of_block = frames_of_block;
        Ok(layout)
    }

    /// Those of the points that are tied to the network are what the datum rests on.
    pub(super) fn set_datum_points(&mut self, points: &[usize]) {
        let tied = points.iter().copied().filter(|&p| self.tied[p]);
        let mut points: Vec<usize> = tied.collect();
        points.sort_unstable();
        points.dedup();
        self.datum_points = points;
    }

    pub(super) fn takes_part(&self, point: usize) -> bool {
        self.roles[point] != PointRole::Absent
    }

    /// The blocks of a station's unknowns: its own, those that its camera has for this image alone and for all of its images.
    pub(super) fn station_blocks(&self, station: usize) -> Vec<usize> {
        let shared = self.shared_parameters(self.camera_of[station]).next();
        let own = self.own_parameters(station).next();
        let interior = own.into_iter().chain(shared);
        let interior = interior.map(|first| self.structure.block_of(first.at));
        std::iter::once(station).chain(interior).collect()
    }

    /// All unknowns, those of eliminated points included.
    pub(super) fn unknowns(&self) -> usize {
        let points = self.roles.iter().zip(&self.unknown_axes);
        let eliminated = points.filter(|(role, _)| **role == PointRole::Eliminated);
        self.kept + eliminated.map(|(_, axes)| axes.len()).sum::<usize>()
    }

    /// Axis and place in the reduced system of the unknown coordinates of a kept point; none of any other.
    pub(super) fn kept_coordinates(&self, point: usize) -> impl Iterator<Item = (usize, usize)> {
        let start = match self.roles[point] {
            PointRole::Kept { start } => Some(start),
            _ => None,
        };
        let axes = self.unknown_axes[point].iter().enumerate();
        start
            .into_iter()
            .flat_map(move |start| axes.clone().map(move |(k, &axis)| (axis, start + k)))
    }

    /// The name of an unknown of the reduced system.
    pub(super) fn name(&self, index: usize) -> ParameterName {
        if index < 6 * self.camera_of.len() {
            return ParameterName::Station {
                index: index / 6,
                component: StationComponent::ALL[index % 6],
            };
        }
        for station in 0..self.camera_of.len() {
            if let Some(own) = self.own_parameters(station).find(|own| own.at == index) {
                return ParameterName::Image {
                    index: station,
                    parameter: own.parameter,
                };
            }
        }
        for camera in 0..self.camera_start.len() {
            if let Some(own) = self.shared_parameters(camera).find(|own| own.at == index) {
                return ParameterName::Camera {
                    index: camera,
                    parameter: own.parameter,
                };
            }
        }
        let holds = |&point: &usize| self.kept_coordinates(point).any(|(_, own)| own == index);
        let point = (0..self.roles.len()).find(holds);
        ParameterName::Point {
            index: point.unwrap_or(usize::MAX),
        }
    }

    fn point_frames(
        &self,
        problem: &BundleProblem,
        starts: &[usize],
        monitor: &Monitor,
    ) -> Result<Vec<PointFrame>, Interrupted> {
        let mut rays_of_points = vec![Vec::new(); problem.points.len()];
        for (i, o) in problem.observations.iter().enumerate() {
            rays_of_points[o.point].push(i);
        }
        (0..problem.points.len())
            .into_par_iter()
            .filter(|&p| self.takes_part(p))
            .map(|p| {
                monitor.check()?;
                Ok(self.point_frame(problem, p, &rays_of_points[p], starts))
            })
            .collect()
    }

    fn point_frame(
        &self,
        problem: &BundleProblem,
        point: usize,
        observations: &[usize],
        starts: &[usize],
    ) -> PointFrame {
        let station_of = |o: &usize| problem.observations[*o].station;
        let camera_of = |o: &usize| problem.stations[station_of(o)].camera;
        let distinct = |mut list: Vec<usize>| {
            list.sort_unstable();
            list.dedup();
            list
        };
        let stations = distinct(observations.iter().map(station_of).collect());
        let cameras = distinct(observations.iter().map(camera_of).collect());
        let mut index: Vec<usize> = stations.iter().flat_map(|s| 6 * s..6 * s + 6).collect();
        let mut own_at = Vec::new();
        for &station in &stations {
            own_at.push(index.len());
            index.extend(self.own_parameters(station).map(|own| own.at));
        }
        let own_end = index.len();
        let mut camera_at = Vec::new();
        for &camera in &cameras {
            camera_at.push(index.len());
            index.extend(self.shared_parameters(camera).map(|own| own.at));
        }
        let point_at = matches!(self.roles[point], PointRole::Kept { .. }).then_some(index.len());
        index.extend(self.kept_coordinates(point).map(|(_, own)| own));
        let mut rays: Vec<Ray> = observations
            .iter()
            .map(|o| {
                let station = stations.partition_point(|s| *s < station_of(o));
                Ray {
                    observation: *o,
                    station_at: 6 * station,
                    own_at: own_at[station],
                    camera_at: camera_at[cameras.partition_point(|c| *c < camera_of(o))],
                    camera: camera_of(o),
                    used: self.used[*o],
                }
            })
            .collect();
        rays.sort_by_key(|ray| ray.station_at);
        let begins = index.iter().enumerate();
        let begins = begins.filter_map(|(place, i)| Some((starts.binary_search(i).ok()?, place)));
        let blocks = begins.collect();
        PointFrame {
            blocks,
            point,
            stations: stations.len(),
            own_end,
            index,
            rays,
            own_at: point_at,
        }
    }
}

fn check_input(problem: &BundleProblem) -> Result<(), AdjustmentError> {
    let positive = |x: f64| x.is_finite() && x > 0.0;
    let check = |part: ProblemPart, index: usize, valid: bool| {
        if valid {
            Ok(())
        } else {
            Err(AdjustmentError::InvalidInput { part, index })
        }
    };
    for (i, c) in problem.cameras.iter().enumerate() {
        let priors = c.parameters.iter().all(|p| match p {
            ParameterState::Weighted { value, sigma } => value.is_finite() && positive(*sigma),
            ParameterState::Fixed | ParameterState::Free => true,
        });
        let interior = c.camera.interior.to_vector();
        let valid = interior.iter().all(|x| x.is_finite())
            && positive(interior[0])
            && positive(c.camera.pixel_pitch_mm);
        check(ProblemPart::Camera, i, priors && valid)?;
    }
    for (i, s) in problem.stations.iter().enumerate() {
        let pose = s.pose.centre_in_world.iter().all(|x| x.is_finite())
            && s.pose
                .camera_from_world
                .matrix()
                .iter()
                .all(|x| x.is_finite());
        check(
            ProblemPart::Station,
            i,
            s.camera < problem.cameras.len() && pose,
        )?;
    }
    for (i, p) in problem.points.iter().enumerate() {
        let priors = p.prior.iter().flatten().all(|c| match *c {
            CoordinatePrior::Fixed { value } => value.is_finite(),
            CoordinatePrior::Weighted { value, sigma } => value.is_finite() && positive(sigma),
        });
        check(
            ProblemPart::Point,
            i,
            priors && p.weights().is_some() && p.position.iter().all(|x| x.is_finite()),
        )?;
    }
    for (i, o) in problem.observations.iter().enumerate() {
        let indices = o.station < problem.stations.len() && o.point < problem.points.len();
        let numbers = positive(o.sigma_px) && o.pixel.iter().all(|x| x.is_finite());
        check(ProblemPart::Observation, i, indices && numbers)?;
    }
    for (i, d) in problem.distances.iter().enumerate() {
        let indices =
            d.from < problem.points.len() && d.to < problem.points.len() && d.from != d.to;
        check(
            ProblemPart::Distance,
            i,
            indices && positive(d.length_mm) && positive(d.sigma_mm),
        )?;
    }
    if let super::Datum::InnerConstraints { points } = &problem.datum {
        for (i, p) in points.iter().enumerate() {
            check(ProblemPart::Datum, i, *p < problem.points.len())?;
        }
    }
    if let Some(frame) = &problem.frame {
        for (i, (p, _)) in frame.held().into_iter().enumerate() {
            check(ProblemPart::Frame, i, *p < problem.points.len())?;
        }
    }
    Ok(())
}

fn check_determined(
    problem: &BundleProblem,
    rays: &[usize],
    present: &[bool],
    distance_used: &[bool],
    used: &[bool],
) -> Result<(), AdjustmentError> {
    let mut equations: Vec<usize> = (0..rays.len())
        .map(|i| 2 * rays[i] + problem.points[i].known_coordinates())
        .collect();
    for (d, _) in problem.distances.iter().zip(distance_used).filter(|d| *d.1) {
        equations[d.from] += 1;
        equations[d.to] += 1;
    }
    let points: Vec<usize> = (0..rays.len())
        .filter(|&i| present[i] && equations[i] < 3)
        .collect();
    if !points.is_empty() {
        return Err(AdjustmentError::PointsUnderdetermined { points });
    }
    let mut found = vec![0usize; problem.stations.len()];
    for (o, _) in problem.observations.iter().zip(used).filter(|o| *o.1) {
        found[o.station] += 1;
    }
    match found.iter().position(|&n| n < 3) {
        Some(station) => Err(AdjustmentError::StationUnderdetermined {
            station,
            found: found[station],
        }),
        None => Ok(()),
    }
}
