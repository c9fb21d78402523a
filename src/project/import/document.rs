//! The network of a project from a network of rays.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::{Vector2, Vector3};

use super::ImportingError;
use super::names::Ids;
use super::pictures::PictureFiles;
use super::sources::Source;
use crate::adjustment::ResidualPlane;
use crate::network::{
    About, CameraEntry, CameraId, Conclusion, ControlPoint, ControlRole, Finding, FindingKind,
    GrossErrors, ImageEntry, ImageFile, ImageId, InteriorSource, Label, LensParameter, Network,
    Outcome, Point, PointId, ScaleBar, Source as NamedBy, Stage, Station,
};
use crate::plain_network::{
    PlainCamera, PlainNetwork, PlainObservation, PlainParameter, PlainPoint, PointRole,
};
use crate::targets::{Detections, Dot, DotIndex};

/// Standard deviation of a coordinate that is fixed while another of its point has one, mm: far below what pictures can tell.
const FIXED_SIGMA_MM: f64 = 1e-6;

/// Control points with three coordinates that an adjustment needs to stand on them.
const CONTROL_TO_STAND_ON: usize = 3;

/// Rays that give a point coordinates.
const RAYS_TO_INTERSECT: usize = 2;

/// The network of a project: image points with their sigmas and names, orientations and coordinates as far as the file gives
/// them or they can be had from it, and every stage concluded whose work is thereby done.
///
/// # Errors
/// [`ImportingError::OneLabel`] where two names of points are one here.
pub(super) fn document(
    source: &Source,
    pictures: &PictureFiles,
) -> Result<Network, ImportingError> {
    let ids = Ids::of(&source.network.points)?;
    let (started, left_out) = source.network.started();
    let plain = Imported {
        network: &started,
        ids: &ids,
    };
    let mut network = Network {
        cameras: Arc::new(plain.cameras()),
        images: Arc::new(plain.images(&pictures.files)),
        names: Arc::new(ids.names.clone()),
        inputs: 1,
        next_target: ids.last,
        ..Network::default()
    };
    let settings = Arc::make_mut(&mut network.settings);
    settings.gross_errors = GrossErrors::Keep;
    settings.targets.object = started.object;
    let rays = rays(&network);
    network.points = Arc::new(plain.points(&rays));
    network.control = Arc::new(plain.control(&network));
    network.scale_bars = Arc::new(plain.bars(&network));
    let oriented = network.oriented_images().map(|(id, ..)| id).collect();
    network.connection_order = Arc::new(oriented);
    conclude(&mut network);
    let mut told = source.told.clone();
    told.extend(left_out);
    told.extend(plain.differences(&network, &rays));
    if pictures.missing > 0 {
        told.push(format!(
            "found no picture of {} images: they keep their names",
            pictures.missing
        ));
    }
    for text in told {
        network.note(finding(About::Project, text));
    }
    for (image, reason) in &pictures.refused {
        network.note(finding(About::Image(image_id(*image)), reason.clone()));
    }
    Ok(network)
}

fn finding(about: About, text: String) -> Finding {
    Finding {
        stage: Stage::Detect,
        kind: FindingKind::Import,
        about,
        text,
    }
}

/// The id of the image of an index; ids count from 1.
fn image_id(index: usize) -> ImageId {
    ImageId(index as u32 + 1)
}

fn camera_id(index: usize) -> CameraId {
    CameraId(index as u32 + 1)
}

/// The stages whose work the file has done: all but the last where every image is oriented.
fn conclude(network: &mut Network) {
    let (all, oriented) = (
        network.used_images().count(),
        network.oriented_images().count(),
    );
    let done = match oriented {
        0 | 1 => Stage::Detect,
        some if some < all => Stage::FirstPair,
        _ => Stage::Identify,
    };
    for stage in Stage::ALL.into_iter().filter(|stage| *stage <= done) {
        let conclusion = Conclusion {
            basis: network.inputs,
            outcome: Outcome::Done,
        };
        network.conclusions.insert(stage, conclusion);
    }
}

/// Rays of oriented images by point.
fn rays(network: &Network) -> BTreeMap<PointId, usize> {
    let mut rays = BTreeMap::new();
    for (_, image, _) in network.oriented_images() {
        for label in image.labels.values() {
            *rays.entry(label.point).or_default() += 1;
        }
    }
    rays
}

/// A network of rays, with starts, and what its points are here.
struct Imported<'a> {
    network: &'a PlainNetwork,
    ids: &'a Ids,
}

impl Imported<'_> {
    fn cameras(&self) -> BTreeMap<CameraId, Arc<CameraEntry>> {
        let cameras = self.network.cameras.iter().enumerate();
        cameras
            .map(|(index, own)| (camera_id(index), Arc::new(camera(own))))
            .collect()
    }

    fn images(&self, files: &[ImageFile]) -> BTreeMap<ImageId, Arc<ImageEntry>> {
        let mut seen: Vec<Vec<&PlainObservation>> = vec![Vec::new(); self.network.images.len()];
        for observation in &self.network.observations {
            seen[observation.image].push(observation);
        }
        let mut images = BTreeMap::new();
        for (index, (image, file)) in self.network.images.iter().zip(files).enumerate() {
            let mut entry = ImageEntry::new(file.clone(), camera_id(image.camera));
            // As detection has them: by rows, then columns.
            seen[index].sort_by(|a, b| {
                let rows = a.y_px.total_cmp(&b.y_px);
                rows.then(a.x_px.total_cmp(&b.x_px))
            });
            entry.detections = Some(Arc::new(Detections {
                width_px: file.width_px,
                height_px: file.height_px,
                dots: seen[index].iter().map(|seen| dot(seen)).collect(),
                ..Detections::default()
            }));
            let labels = (0..).map(DotIndex).zip(&seen[index]).map(|(dot, seen)| {
                let label = Label {
                    point: self.ids.of_points[seen.point],
                    source: NamedBy::Automatic,
                    rejected: None,
                };
                (dot, label)
            });
            entry.labels = Arc::new(labels.collect());
            entry.station = image.start.map(|pose| Station {
                pose,
                covariance: None,
                with_camera: None,
            });
            images.insert(image_id(index), Arc::new(entry));
        }
        images
    }

    fn points(&self, rays: &BTreeMap<PointId, usize>) -> BTreeMap<PointId, Arc<Point>> {
        let points = self.ids.of_points.iter().zip(&self.network.points);
        points
            .filter_map(|(id, point)| {
                let rays = rays.get(id).copied().unwrap_or_default();
                let place = point.start.filter(|_| rays >= RAYS_TO_INTERSECT)?;
                let point = Point {
                    position: Vector3::from(place),
                    covariance: None,
                    rays: rays as u32,
                    circle: None,
                };
                Some((*id, Arc::new(point)))
            })
            .collect()
    }

    fn control(&self, network: &Network) -> Vec<ControlPoint> {
        let points = self.ids.of_points.iter().zip(&self.network.points);
        points
            .filter_map(|(id, point)| {
                Some(ControlPoint {
                    label: network.label(*id),
                    coordinates_mm: point.known.map(|known| Some(known?.value_mm)),
                    sigmas_mm: sigmas(point),
                    role: role(point)?,
                })
            })
            .collect()
    }

    fn bars(&self, network: &Network) -> Vec<ScaleBar> {
        let label = |point: usize| network.label(self.ids.of_points[point]);
        let bars = self.network.distances.iter();
        bars.map(|bar| ScaleBar {
            name: bar.name.clone(),
            from: label(bar.from),
            to: label(bar.to),
            length_mm: bar.length_mm,
            sigma_mm: bar.sigma_mm,
            role: bar.role,
            expansion: bar.expansion,
        })
        .collect()
    }

    /// What a project makes otherwise than an adjustment of the file's network.
    fn differences(&self, network: &Network, rays: &BTreeMap<PointId, usize>) -> Vec<String> {
        let mut told = Vec::new();
        if !self.network.observations.is_empty() {
            told.push(
                "every image point of the file is used: none is rejected until the settings say so"
                    .to_owned(),
            );
        }
        if self.network.residuals == ResidualPlane::Corrected {
            told.push(
                "the file's program forms residuals in the corrected plane, a project in the measured image: sigma0 differs by what the lens stretches"
                    .to_owned(),
            );
        }
        let control: Vec<(&PointId, &PlainPoint)> = self
            .ids
            .of_points
            .iter()
            .zip(&self.network.points)
            .filter(|(_, point)| point.role == PointRole::Control)
            .collect();
        let stands: BTreeSet<&PointId> = control
            .iter()
            .filter(|(id, point)| {
                network.points.contains_key(id) && point.known.iter().all(Option::is_some)
            })
            .map(|(id, _)| *id)
            .collect();
        if !control.is_empty() && stands.len() < CONTROL_TO_STAND_ON {
            told.push(format!(
                "found {} measured control points with all coordinates, expected {CONTROL_TO_STAND_ON} or more: the project does not stand on them",
                stands.len()
            ));
        }
        for (id, _) in control {
            if rays.get(id) == Some(&1) {
                told.push(format!(
                    "{}: found one ray to a control point, expected {RAYS_TO_INTERSECT} or more: it takes no part in a project",
                    network.label(*id)
                ));
            }
        }
        told
    }
}

/// A camera with its lens as it is, whichever way that works.
fn camera(own: &PlainCamera) -> CameraEntry {
    CameraEntry {
        name: own.name.clone(),
        nominal: own.camera(),
        camera: own.camera(),
        known_sigmas: own.parameters.map(|parameter| match parameter {
            PlainParameter::Weighted { sigma } => Some(sigma),
            PlainParameter::Fixed | PlainParameter::Free => None,
        }),
        parameters: own.parameters.map(|parameter| match parameter {
            PlainParameter::Fixed => LensParameter::Held,
            PlainParameter::Free => LensParameter::Free,
            PlainParameter::Weighted { .. } => LensParameter::Automatic,
        }),
        stated: Default::default(),
        source: InteriorSource::CameraFile,
        exif_model: None,
    }
}

/// A measured image point: a place with its sigma. The file tells no ellipse, so that it has no size, and the target no circle.
fn dot(seen: &PlainObservation) -> Dot {
    Dot {
        centre_px: Vector2::new(seen.x_px, seen.y_px),
        sigma_px: seen.sigma_px,
        major_px: 0.0,
        minor_px: 0.0,
        angle: 0.0,
        contrast: 0.0,
        background: 0.0,
    }
}

/// What a point with known coordinates is for; `None` for a new one.
fn role(point: &PlainPoint) -> Option<ControlRole> {
    let has_sigma = point
        .known
        .iter()
        .flatten()
        .any(|known| known.sigma_mm.is_some());
    match point.role {
        PointRole::New => None,
        PointRole::Check => Some(ControlRole::Check),
        PointRole::Control if has_sigma => Some(ControlRole::Weighted),
        PointRole::Control => Some(ControlRole::Fixed),
    }
}

/// Standard deviations of known coordinates; none of a point that is fixed.
fn sigmas(point: &PlainPoint) -> [Option<f64>; 3] {
    match role(point) {
        Some(ControlRole::Weighted) => point
            .known
            .map(|known| known.map(|known| known.sigma_mm.unwrap_or(FIXED_SIGMA_MM))),
        _ => point
            .known
            .map(|known| known.and_then(|known| known.sigma_mm)),
    }
}
