//! What the observations of a random measurement can tell at best.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::Vector2;
use tiepoint::adjustment::{
    BundleProblem, BundleSettings, CameraBlock, Datum, ImageObservation, ParameterState,
    PointBlock, ResidualPlane, Sharing, StationBlock, adjust,
};
use tiepoint::camera::Camera;
use tiepoint::monitor::Monitor;
use tiepoint::network::{
    CameraEntry, CameraId, ImageId, InteriorSource, Network, Point, PointId, Station,
};

use super::cameras::{PRINCIPAL_POINT_MM, RADIAL_SHARES, corner_mm};
use super::scene::Scene;

/// A dot is one of the cross within so many standard deviations of where the truth has it.
const SIGMAS_OF_A_DOT: f64 = 5.0;

/// What is known of the lenses besides what was told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Known {
    /// How those of these trials are thrown (`cameras`).
    SpreadOfTrials,
    /// How real ones differ from nominal ones.
    SpreadOfLenses,
}

impl Scene {
    /// The measurement by least squares from the truth, with the right readings alone. Who knows no more of the lenses does not do
    /// better but by chance.
    ///
    /// Of the images that must be oriented; `None` where not even this can be computed.
    pub(crate) fn at_best(&self, known: Known) -> Option<Network> {
        let rays = self.right_rays();
        let stations: Vec<ImageId> = rays.keys().copied().collect();
        let points: BTreeSet<PointId> = rays.values().flatten().map(|(point, _)| *point).collect();
        let points: Vec<PointId> = points.into_iter().collect();
        let cameras: Vec<CameraId> = self.cameras.keys().copied().collect();
        let index_of = |point: &PointId| points.binary_search(point).ok();
        let observations = stations.iter().enumerate().flat_map(|(station, id)| {
            rays[id].iter().filter_map(move |(point, pixel)| {
                Some(ImageObservation {
                    station,
                    point: index_of(point)?,
                    pixel: *pixel,
                    sigma_px: self.recipe.noise_px,
                })
            })
        });
        let problem = BundleProblem {
            cameras: cameras
                .iter()
                .map(|id| self.camera_block(*id, known))
                .collect(),
            stations: stations
                .iter()
                .map(|id| {
                    let camera = cameras
                        .binary_search(&self.network.images[id].camera)
                        .ok()?;
                    let pose = self.poses[id];
                    Some(StationBlock { camera, pose })
                })
                .collect::<Option<_>>()?,
            points: points
                .iter()
                .map(|id| PointBlock {
                    circle: self.circles.get(id).copied(),
                    ..PointBlock::unknown(self.points[id])
                })
                .collect(),
            observations: observations.collect(),
            distances: Vec::new(),
            residuals: ResidualPlane::Measured,
            datum: Datum::InnerConstraints {
                points: (0..points.len()).collect(),
            },
            frame: None,
            rejected: BTreeSet::new(),
        };
        let adjusted = adjust(problem, BundleSettings::default(), &Monitor::new()).ok()?;
        let mut network = self.network.clone();
        for (id, station) in stations.iter().zip(&adjusted.stations) {
            let image = Arc::make_mut(Arc::make_mut(&mut network.images).get_mut(id)?);
            image.station = Some(Station {
                pose: station.pose,
                covariance: None,
                with_camera: None,
            });
        }
        let found = points.iter().zip(&adjusted.points);
        network.points = Arc::new(
            found
                .map(|(id, point)| {
                    let point = Point {
                        position: point.position,
                        covariance: None,
                        rays: 2,
                        circle: None,
                    };
                    (*id, Arc::new(point))
                })
                .collect(),
        );
        Some(network)
    }

    /// Points that two or more of the required images show rightly, and where.
    fn right_rays(&self) -> BTreeMap<ImageId, Vec<(PointId, Vector2<f64>)>> {
        let mut rays: BTreeMap<ImageId, Vec<(PointId, Vector2<f64>)>> = BTreeMap::new();
        for id in self.required() {
            let image = &self.network.images[&id];
            let Some(detections) = &image.detections else {
                continue;
            };
            let right = &self.shown[&id].right;
            let of_codes = image.used_labels().filter_map(|(dot, label)| {
                let code = label.point.code()?;
                let pixel = detections.dots[dot.slot()].centre_px;
                right.contains(&code).then_some((label.point, pixel))
            });
            let camera = &self.cameras[&image.camera];
            let limit = SIGMAS_OF_A_DOT * self.recipe.noise_px;
            let cross = self.points.iter().filter_map(|(point, place)| {
                let circle = self.circles.get(point);
                let px = camera.image_of_target(&self.poses[&id], place, circle)?;
                let mut near = detections.dots.iter().map(|dot| dot.centre_px);
                let pixel = near.find(|centre| (centre - px).norm() <= limit)?;
                matches!(point, PointId::Device(_)).then_some((*point, pixel))
            });
            rays.insert(id, of_codes.chain(cross).collect());
        }
        let mut images_of: BTreeMap<PointId, usize> = BTreeMap::new();
        for (point, _) in rays.values().flatten() {
            *images_of.entry(*point).or_default() += 1;
        }
        for seen in rays.values_mut() {
            seen.retain(|(point, _)| images_of[point] >= 2);
        }
        rays
    }

    /// The true lens and what is known of it.
    fn camera_block(&self, id: CameraId, known: Known) -> CameraBlock {
        let told = &self.network.cameras[&id];
        let camera = self.cameras[&id].clone();
        let parameters = match known {
            Known::SpreadOfTrials => spread_of_trials(told, &camera),
            Known::SpreadOfLenses => spread_of_lenses(told),
        };
        CameraBlock {
            camera,
            parameters,
            sharing: [Sharing::Camera; 10],
        }
    }
}

/// Everything is spread evenly, by so much to either side.
fn spread_of_trials(told: &CameraEntry, camera: &Camera) -> [ParameterState; 10] {
    let even = |value: f64, to_either_side: f64| ParameterState::Weighted {
        value,
        sigma: to_either_side / 3_f64.sqrt(),
    };
    let c = told.nominal.interior.principal_distance;
    let mut parameters = [ParameterState::Fixed; 10];
    parameters[0] = match told.source {
        InteriorSource::CameraFile => even(c, 0.02 * c),
        InteriorSource::Exif => even(c, 0.2 * c),
        InteriorSource::Unknown => ParameterState::Free,
    };
    parameters[1] = even(0.0, PRINCIPAL_POINT_MM);
    parameters[2] = even(0.0, PRINCIPAL_POINT_MM);
    let [least, most] = RADIAL_SHARES.map(|share| share / corner_mm(camera).powi(2));
    parameters[3] = even(0.5 * (least + most), 0.5 * (most - least));
    parameters
}

/// As the program takes it: every parameter by what real lenses differ from nominal ones.
fn spread_of_lenses(told: &CameraEntry) -> [ParameterState; 10] {
    let camera = &told.nominal;
    let c = camera.interior.principal_distance;
    let [width, height] = [camera.width_px, camera.height_px].map(f64::from);
    let radius = 0.5 * camera.pixel_pitch_mm * width.hypot(height);
    let sigmas = [
        match told.source {
            InteriorSource::CameraFile => 0.05 * c,
            InteriorSource::Exif => 0.1 * c,
            InteriorSource::Unknown => f64::INFINITY,
        },
        0.03 * radius,
        0.03 * radius,
        0.05 / radius.powi(2),
        0.05 / radius.powi(4),
        0.05 / radius.powi(6),
        0.003 / radius,
        0.003 / radius,
        0.002,
        0.002,
    ];
    let nominal = camera.interior.to_vector();
    std::array::from_fn(|k| {
        if sigmas[k].is_finite() {
            ParameterState::Weighted {
                value: nominal[k],
                sigma: sigmas[k],
            }
        } else {
            ParameterState::Free
        }
    })
}
