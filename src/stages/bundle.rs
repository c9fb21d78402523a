//! Between the names of the network and the indices of an adjustment.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::components::components;
use super::gross::far_off;
use super::lens::{LensFreedom, images_of_cameras, parameter_states};
use super::scale::{bars_in_reach, scale_source};
use crate::adjustment::{
    Adjustment, AdjustmentError, BundleProblem, CameraBlock, CoordinatePrior, Datum,
    DistanceObservation, ImageObservation, ObservationStatus, ParameterName, PointBlock,
    ProblemPart, ResidualPlane, Settled, SettledPoint, Sharing, StationBlock,
};
use crate::camera::INTERIOR_NAMES;
use crate::geometry::ThreeTwoOne;
use crate::monitor::{Interrupted, Monitor};
use crate::network::{
    AdjustedObservation, AdjustmentResult, BarResult, BarRole, CameraId, CameraResult, ControlRole,
    FrameResult, ImageEntry, ImageId, Network, Point, PointId, PointKind, ScaleSource, Stage,
    Standing, Station,
};
use crate::targets::DotIndex;

/// Fewest rays that give a point coordinates.
const RAYS_TO_INTERSECT: usize = 2;

/// Standard deviation of a weighted control coordinate that is given without one, mm.
const UNSTATED_SIGMA_MM: f64 = 0.01;

/// Names of points or parameters that an error lists; more do not help anybody.
const NAMES_SHOWN: usize = 8;

/// An adjustment that was not made.
#[derive(Debug)]
pub(super) struct BundleFailure {
    pub(super) error: AdjustmentError,
    /// The reason for the operator: images by path, points by label.
    pub(super) in_words: String,
}

/// Over which points the datum's inner constraints run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DatumPoints {
    /// All points.
    All,
    /// The dots of the codes; all points where there are none.
    Codes,
    /// The plain targets; all points where there are none.
    Targets,
}

impl From<Interrupted> for BundleFailure {
    fn from(interrupted: Interrupted) -> Self {
        Self {
            error: interrupted.into(),
            in_words: interrupted.to_string(),
        }
    }
}

impl BundleFailure {
    /// Whether the observations leave unknowns loose, or nearly so.
    pub(super) fn leaves_unknowns_loose(&self) -> bool {
        matches!(
            self.error,
            AdjustmentError::RankDefect { .. } | AdjustmentError::NotConverged(_)
        )
    }

    /// Whether all went well but for the frame by three points.
    pub(super) fn is_of_frame(&self) -> bool {
        matches!(
            self.error,
            AdjustmentError::FramePoint { .. }
                | AdjustmentError::FrameShape(_)
                | AdjustmentError::InvalidInput {
                    part: ProblemPart::Frame,
                    ..
                }
        )
    }
}

impl DatumPoints {
    fn holds(self, id: PointId) -> bool {
        match self {
            DatumPoints::All => true,
            DatumPoints::Codes => id.kind() == PointKind::Code,
            DatumPoints::Targets => id.kind() == PointKind::Target,
        }
    }
}

/// An adjustment in indices with the names they stand for.
pub(super) struct Bundle {
    pub(super) problem: BundleProblem,
    datum: String,
    pub(super) images: Vec<ImageId>,
    cameras: Vec<CameraId>,
    points: Vec<PointId>,
    rows: Vec<(ImageId, DotIndex)>,
    bars: Vec<String>,
    frame: Option<ThreeTwoOne<PointId>>,
}

impl Bundle {
    /// All used observations of points that two or more oriented images show.
    ///
    /// # Errors
    /// [`Interrupted`] when the work was asked to stop.
    pub(super) fn assemble(
        network: &Network,
        freedom: LensFreedom<'_>,
        datum: DatumPoints,
        monitor: &Monitor,
    ) -> Result<Self, Interrupted> {
        let points = points_with_rays(network, monitor)?;
        let point_index: BTreeMap<PointId, usize> = points
            .iter()
            .enumerate()
            .map(|(index, id)| (*id, index))
            .collect();
        let images_of_camera = images_of_cameras(network);
        let cameras: Vec<CameraId> = images_of_camera.keys().copied().collect();
        let camera_index = |id: CameraId| cameras.iter().position(|c| *c == id).unwrap_or_default();

        let mut images = Vec::new();
        let mut stations = Vec::new();
        let mut rows = Vec::new();
        let mut observations = Vec::new();
        for (id, image, station) in network.oriented_images() {
            monitor.check()?;
            let Some(detections) = &image.detections else {
                continue;
            };
            for (dot, label) in image.used_labels() {
                let Some(&point) = point_index.get(&label.point) else {
                    continue;
                };
                let measured = &detections.dots[dot.slot()];
                observations.push(ImageObservation {
                    station: stations.len(),
                    point,
                    pixel: measured.centre_px,
                    sigma_px: measured.sigma_px,
                });
                rows.push((id, dot));
            }
            stations.push(StationBlock {
                camera: camera_index(image.camera),
                pose: station.pose,
            });
            images.push(id);
        }

        let mut bars = Vec::new();
        let mut distances = Vec::new();
        if scale_source(network) == ScaleSource::Bars {
            for (bar, ends) in bars_in_reach(network) {
                let [Some(&from), Some(&to)] = ends.map(|id| point_index.get(&id)) else {
                    continue;
                };
                if bar.role == BarRole::Control {
                    distances.push(DistanceObservation {
                        from,
                        to,
                        length_mm: network.bar_length_mm(bar),
                        sigma_mm: bar.sigma_mm,
                    });
                    bars.push(bar.name.clone());
                }
            }
        }

        let mut blocks: Vec<PointBlock> = points
            .iter()
            .map(|id| PointBlock {
                circle: network.points[id].circle,
                ..PointBlock::unknown(network.points[id].position)
            })
            .collect();
        let known = add_control(network, &point_index, &mut blocks);
        let (datum, in_words) = if known {
            (Datum::Control, "control points".to_owned())
        } else {
            inner_constraints(datum, &points)
        };
        let mut problem = BundleProblem {
            cameras: cameras
                .iter()
                .map(|id| {
                    let entry = &network.cameras[id];
                    CameraBlock {
                        camera: entry.camera.clone(),
                        parameters: parameter_states((*id, entry), freedom, images_of_camera[id]),
                        sharing: [Sharing::Camera; 10],
                    }
                })
                .collect(),
            stations,
            points: blocks,
            observations,
            distances,
            residuals: ResidualPlane::Measured,
            datum,
            frame: None,
            rejected: BTreeSet::new(),
        };
        problem.rejected = far_off(&problem, monitor)?;
        Ok(Self {
            problem,
            datum: in_words,
            images,
            cameras,
            points,
            rows,
            bars,
            frame: None,
        })
    }

    /// The same with its result in the frame by three points, where one is asked for.
    pub(super) fn in_frame(
        mut self,
        network: &Network,
        frame: Option<&ThreeTwoOne<PointId>>,
    ) -> Self {
        let Some(frame) = frame else { return self };
        self.frame = Some(*frame);
        // A point that is not among the bundle's gets an index of none, which the adjustment refuses as such.
        let index = |id: &PointId| self.points.binary_search(id).unwrap_or(usize::MAX);
        self.problem.frame = Some(frame.map(index));
        let labels = frame.map(|id| network.label(*id));
        let shape = if self.stands_on_control() {
            "; known coordinates of control points hold shape and scale"
        } else {
            ""
        };
        self.datum = format!(
            "3-2-1: origin {}, {} axis through {}, {} plane through {}{shape}",
            labels.origin,
            frame.order.axis_name(),
            labels.axis,
            frame.order.plane_name(),
            labels.plane
        );
        self
    }

    /// Whether an adjustment has anything to do.
    pub(super) fn is_empty(&self) -> bool {
        self.problem.observations.is_empty()
    }

    /// Whether known coordinates fix the frame, so that nothing may move the result.
    pub(super) fn stands_on_control(&self) -> bool {
        self.problem.datum == Datum::Control
    }

    /// An error of the adjustment with its indices in the network's names.
    pub(super) fn failure(&self, network: &Network, error: AdjustmentError) -> BundleFailure {
        let image = |station: usize| network.images[&self.images[station]].file.path.clone();
        let label = |point: usize| network.label(self.points[point]);
        let camera = |index: usize| network.cameras[&self.cameras[index]].name.clone();
        let in_words = match &error {
            AdjustmentError::PointsUnderdetermined { points } => {
                let labels: Vec<String> =
                    points.iter().take(NAMES_SHOWN).map(|&p| label(p)).collect();
                format!(
                    "{} points have too few rays: {}",
                    points.len(),
                    labels.join(", ")
                )
            }
            AdjustmentError::InvalidInput {
                part: ProblemPart::Frame,
                index,
            } => {
                let frame = self.frame.as_ref();
                let point = frame.map(|frame| network.label(*frame.held()[*index].0));
                not_in_frame(&point.unwrap_or_default())
            }
            AdjustmentError::FramePoint { point } => not_in_frame(&label(*point)),
            AdjustmentError::StationUnderdetermined { station, found } => {
                format!("{} has {found} used image points, needs 3", image(*station))
            }
            AdjustmentError::RankDefect { defect, loose } => {
                let names: Vec<String> = loose
                    .iter()
                    .take(NAMES_SHOWN)
                    .map(|name| match name {
                        ParameterName::Camera { index, parameter } => {
                            format!(
                                "{} of camera '{}'",
                                INTERIOR_NAMES[*parameter],
                                camera(*index)
                            )
                        }
                        ParameterName::Image { index, parameter } => {
                            format!("{} of {}", INTERIOR_NAMES[*parameter], image(*index))
                        }
                        ParameterName::Station { index, component } => {
                            format!("{component} of {}", image(*index))
                        }
                        ParameterName::Point { index } => label(*index),
                    })
                    .collect();
                format!(
                    "rank defect of {defect}: the observations leave loose {}",
                    names.join(", ")
                )
            }
            other => other.to_string(),
        };
        BundleFailure { error, in_words }
    }

    /// Puts estimates and precision into the network.
    pub(super) fn write_back(&self, network: &mut Network, adjustment: &Adjustment) {
        for (id, adjusted) in self.images.iter().zip(&adjustment.stations) {
            network.image_mut(*id).station = Some(Station {
                pose: adjusted.pose,
                covariance: Some(adjusted.covariance),
                with_camera: Some(adjusted.with_camera),
            });
        }
        for (id, adjusted) in self.cameras.iter().zip(&adjustment.cameras) {
            network.camera_mut(*id).camera = adjusted.camera.clone();
        }
        let points = Arc::make_mut(&mut network.points);
        for point in points.values_mut() {
            if point.covariance.is_some() {
                Arc::make_mut(point).covariance = None;
            }
        }
        for (id, adjusted) in self.points.iter().zip(&adjustment.points) {
            let point = Point {
                position: adjusted.position,
                covariance: adjusted.covariance,
                rays: adjusted.rays as u32,
                circle: adjusted.circle,
            };
            points.insert(*id, Arc::new(point));
        }
    }

    /// Puts estimates without their precision into the network; what took no part has no coordinates.
    pub(super) fn write_back_settled(&self, network: &mut Network, settled: &Settled) {
        for (id, &pose) in self.images.iter().zip(&settled.poses) {
            network.image_mut(*id).station = Some(Station {
                pose,
                covariance: None,
                with_camera: None,
            });
        }
        for (id, camera) in self.cameras.iter().zip(&settled.cameras) {
            network.camera_mut(*id).camera = camera.clone();
        }
        let points = self.points.iter().zip(&settled.points);
        let point = |(id, settled): (&PointId, &Option<SettledPoint>)| {
            let settled = settled.as_ref()?;
            let point = Point {
                position: settled.position,
                covariance: None,
                rays: settled.rays as u32,
                circle: settled.circle,
            };
            Some((*id, Arc::new(point)))
        };
        network.points = Arc::new(points.filter_map(point).collect());
    }

    /// Marks the observations that the test rejected; they keep their label.
    pub(super) fn mark_rejected(&self, network: &mut Network, adjustment: &Adjustment) {
        for ((image, dot), row) in self.rows.iter().zip(&adjustment.observations) {
            if row.status == ObservationStatus::Used {
                continue;
            }
            let labels = Arc::make_mut(&mut network.image_mut(*image).labels);
            if let Some(label) = labels.get_mut(dot) {
                label.rejected = Some(match row.test() {
                    Some(w) => format!("rejected by the adjustment: |w| = {w:.1}"),
                    None => "rejected by the adjustment: its point has too few rays".to_owned(),
                });
            }
        }
    }

    /// The adjustment in the network's names.
    pub(super) fn result(
        &self,
        network: &Network,
        stage: Stage,
        adjustment: &Adjustment,
    ) -> AdjustmentResult {
        let observations = self
            .rows
            .iter()
            .zip(&adjustment.observations)
            .zip(&self.problem.observations)
            .filter_map(|((&(image, dot), row), observation)| {
                Some(AdjustedObservation {
                    image,
                    dot,
                    point: self.points[observation.point],
                    residual_px: row.residual_px?,
                    redundancy: row.redundancy.sum(),
                    test: row.test().unwrap_or(0.0),
                    standing: match row.status {
                        ObservationStatus::Used => Standing::Used,
                        ObservationStatus::Rejected => Standing::Rejected,
                    },
                })
            })
            .collect();
        AdjustmentResult {
            stage,
            basis: network.inputs,
            sigma0: adjustment.sigma0,
            sigma0_px: adjustment.sigma0_px,
            rms_px: adjustment.rms_px,
            sigma_station_mm: adjustment.sigma_station_mm(),
            redundancy: adjustment.redundancy as i64,
            datum: self.datum.clone(),
            frame: FrameResult::default(),
            scale_from: scale_source(network),
            cameras: self
                .cameras
                .iter()
                .zip(&adjustment.cameras)
                .map(|(&camera, adjusted)| CameraResult {
                    camera,
                    covariance: adjusted.covariance,
                })
                .collect(),
            bars: self.bar_results(network, adjustment),
            components: components(&self.problem, &self.points, adjustment),
            observations,
        }
    }

    /// Standard deviations of the interior orientations before they are scaled by sigma0.
    pub(super) fn lens_sigmas(&self, adjustment: &Adjustment) -> Vec<(CameraId, [f64; 10])> {
        let scale = adjustment.sigma0.max(f64::MIN_POSITIVE);
        let cameras = self.cameras.iter().zip(&adjustment.cameras);
        let sigma = |variance: f64| variance.max(0.0).sqrt() / scale;
        cameras
            .map(|(id, camera)| {
                let of = |parameter| sigma(camera.covariance[(parameter, parameter)]);
                (*id, std::array::from_fn(of))
            })
            .collect()
    }

    fn bar_results(&self, network: &Network, adjustment: &Adjustment) -> Vec<BarResult> {
        bars_in_reach(network)
            .into_iter()
            .map(|(bar, [from, to])| {
                let length = (network.points[&from].position - network.points[&to].position).norm();
                let used = self.bars.iter().position(|name| *name == bar.name);
                BarResult {
                    name: bar.name.clone(),
                    difference_mm: length - network.bar_length_mm(bar),
                    test: used
                        .and_then(|index| adjustment.distances[index])
                        .map(|statistics| statistics.normalised.abs()),
                }
            })
            .collect()
    }
}

fn not_in_frame(label: &str) -> String {
    format!(
        "{label} takes no part in the adjustment, expected a point with rays of two or more images"
    )
}

/// How many used dots of an image have a point with coordinates.
pub(super) fn known_points(network: &Network, image: &ImageEntry) -> usize {
    image
        .used_labels()
        .filter(|(_, label)| network.points.contains_key(&label.point))
        .count()
}

/// Takes back what earlier adjustments rejected, so that the next one decides anew; the operator's decisions stay.
pub(super) fn restore_rejected(network: &mut Network) {
    let ids: Vec<ImageId> = network.used_images().map(|(id, _)| id).collect();
    for id in ids {
        let touched = network.images[&id]
            .labels
            .values()
            .any(|l| l.rejected.is_some());
        if touched {
            for label in Arc::make_mut(&mut network.image_mut(id).labels).values_mut() {
                if !label.is_rejected_by_operator() {
                    label.rejected = None;
                }
            }
        }
    }
}

/// Points with coordinates that two or more oriented images show.
fn points_with_rays(network: &Network, monitor: &Monitor) -> Result<Vec<PointId>, Interrupted> {
    let mut rays: BTreeMap<PointId, usize> = BTreeMap::new();
    for (_, image, _) in network.oriented_images() {
        monitor.check()?;
        for (_, label) in image.used_labels() {
            *rays.entry(label.point).or_default() += 1;
        }
    }
    let held = rays
        .into_iter()
        .filter(|(id, rays)| *rays >= RAYS_TO_INTERSECT && network.points.contains_key(id));
    Ok(held.map(|(id, _)| id).collect())
}

fn inner_constraints(datum: DatumPoints, points: &[PointId]) -> (Datum, String) {
    let chosen: Vec<usize> = (0..points.len())
        .filter(|&index| datum.holds(points[index]))
        .collect();
    // Three points hold seven motions only just; with fewer the whole network does it.
    let all = chosen.len() < 3;
    let chosen = if all {
        (0..points.len()).collect()
    } else {
        chosen
    };
    let over = match datum {
        DatumPoints::Codes if !all => "the dots of the codes",
        DatumPoints::Targets if !all => "the plain targets",
        _ => "all points",
    };
    let text = format!("inner constraints on {over} ({})", chosen.len());
    (Datum::InnerConstraints { points: chosen }, text)
}

/// Weighted and fixed control; whether it determines the datum (three points with all coordinates).
fn add_control(
    network: &Network,
    index: &BTreeMap<PointId, usize>,
    blocks: &mut [PointBlock],
) -> bool {
    let mut whole = 0;
    for control in network.control.iter() {
        let prior = |axis: usize, value: f64| match control.role {
            ControlRole::Fixed => CoordinatePrior::Fixed { value },
            _ => CoordinatePrior::Weighted {
                value,
                sigma: control.sigmas_mm[axis].unwrap_or(UNSTATED_SIGMA_MM),
            },
        };
        let enters = matches!(control.role, ControlRole::Weighted | ControlRole::Fixed);
        let place = network
            .point_of_label(&control.label)
            .ok()
            .and_then(|id| index.get(&id));
        let (true, Some(&place)) = (enters, place) else {
            continue;
        };
        blocks[place].prior = std::array::from_fn(|axis| {
            control.coordinates_mm[axis].map(|value| prior(axis, value))
        });
        whole += usize::from(control.coordinates_mm.iter().all(Option::is_some));
    }
    if whole < 3 {
        for block in blocks {
            block.prior = [None; 3];
        }
        return false;
    }
    true
}
