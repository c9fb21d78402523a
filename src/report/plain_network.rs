//! The adjustment of a plain network, for people and for programs.

use std::fmt::Write;

use serde::Serialize;

use super::plain_answers::PlainAnswers;
use super::plain_reliability::{ReliabilityReport, SignificanceRow, significance};
use crate::adjustment::{
    AdjustedCamera, AdjustedStation, Datum, ErrorEllipsoid, ObservationStatus, Sharing, TestPower,
};
use crate::camera::INTERIOR_NAMES;
use crate::geometry::OmegaPhiKappa;
use crate::network::reason_of_length;
use crate::plain_network::{
    HeldParameter, PlainAdjustment, PlainCamera, PlainNetwork, PlainParameter,
};

/// Stands in the place of the state of a parameter that each image has for itself.
const PER_IMAGE: &str = "per image";

/// What `adjust --json` tells.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlainReport {
    /// Standard deviation of unit weight, without unit.
    pub sigma0: f64,
    /// The same as a pixel measure, px.
    pub sigma0_px: f64,
    /// Rms residual per coordinate, px.
    pub rms_px: f64,
    /// Degrees of freedom.
    pub redundancy: usize,
    /// Observed values that were used, known ones among them.
    pub observations: usize,
    /// Unknowns.
    pub unknowns: usize,
    /// Motions of the network that the observations leave free and the datum fixes.
    pub datum_defect: usize,
    /// Steps of the adjustment.
    pub iterations: usize,
    /// How it converged: the last change of the observations in sigmas, and its threshold.
    pub convergence: [f64; 2],
    /// What the coordinates refer to.
    pub datum: String,
    /// Cameras of adjusted images.
    pub cameras: Vec<CameraRow>,
    /// Adjusted images.
    pub images: Vec<ImageRow>,
    /// Adjusted points.
    pub points: Vec<PointRow>,
    /// Distances that took part.
    pub distances: Vec<DistanceRow>,
    /// Known coordinates that took part.
    pub known_coordinates: Vec<KnownRow>,
    /// Image points that took part or were rejected.
    pub image_points: Vec<ObservationRow>,
    /// Tests of the whole.
    pub reliability: ReliabilityReport,
    /// Checks, and what was asked for.
    #[serde(flatten)]
    pub answers: PlainAnswers,
    /// What could not take part or should be known.
    pub findings: Vec<String>,
}

/// A camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraRow {
    /// Its name.
    pub camera: String,
    /// Its parameters.
    pub parameters: Vec<ParameterRow>,
}

/// A camera parameter in its unit (mm, mm^-2, mm^-4, mm^-6, mm^-1, none).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterRow {
    /// Its name.
    pub name: &'static str,
    /// Its value; the starting value where each image has its own.
    pub value: f64,
    /// Its standard deviation; 0 where it was held or each image has its own.
    pub sigma: f64,
    /// `free`, `weighted`, `fixed`, or `held` where the observations do not determine a free one; `per image` in the row of a camera
    /// whose images have it for themselves.
    pub state: &'static str,
    /// Of a weighted one: computed minus known.
    pub residual: Option<f64>,
    /// Of a weighted one: redundancy number.
    pub redundancy: Option<f64>,
    /// Of a weighted one: normalised residual w (Baarda, 1968).
    pub test: Option<f64>,
    /// What it is worth; none for one that was not estimated.
    #[serde(flatten)]
    pub significance: Option<SignificanceRow>,
}

/// An image.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImageRow {
    /// Its name.
    pub image: String,
    /// Projection centre, mm.
    pub centre_mm: [f64; 3],
    /// Omega, phi, kappa, degrees.
    pub omega_phi_kappa_deg: [f64; 3],
    /// Rotation from the world into the camera.
    pub camera_from_world: [[f64; 3]; 3],
    /// Standard deviations of the centre, mm.
    pub sigma_mm: [f64; 3],
    /// Standard deviations of turns about the camera's axes, degrees.
    pub sigma_turn_deg: [f64; 3],
    /// Camera parameters that the image has for itself.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<ParameterRow>,
}

/// A point.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PointRow {
    /// Its name.
    pub point: String,
    /// Coordinates, mm.
    pub position_mm: [f64; 3],
    /// Their standard deviations, mm.
    pub sigma_mm: [f64; 3],
    /// Half axes of the standard ellipsoid, the longest first, mm.
    pub ellipsoid_mm: [f64; 3],
    /// Their directions.
    pub ellipsoid_directions: [[f64; 3]; 3],
    /// Rays used.
    pub rays: usize,
}

/// A distance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DistanceRow {
    /// Its name.
    pub distance: String,
    /// Length as it was used, mm.
    pub length_mm: f64,
    /// Calibrated length, mm.
    pub calibrated_mm: f64,
    /// Why the two differ; none where nothing is known of temperatures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Computed minus measured, mm.
    pub residual_mm: f64,
    /// Redundancy number.
    pub redundancy: f64,
    /// Normalised residual w (Baarda, 1968).
    pub test: f64,
}

/// A known coordinate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KnownRow {
    /// Its point.
    pub point: String,
    /// `x`, `y` or `z`.
    pub axis: &'static str,
    /// Computed minus known, mm.
    pub residual_mm: f64,
    /// Redundancy number.
    pub redundancy: f64,
    /// Normalised residual w (Baarda, 1968).
    pub test: f64,
}

/// An image point.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ObservationRow {
    /// Its image.
    pub image: String,
    /// Its point.
    pub point: String,
    /// Computed minus measured, px; none where it is not imaged.
    pub residual_px: Option<[f64; 2]>,
    /// Redundancy numbers.
    pub redundancy: [f64; 2],
    /// The larger normalised residual |w| (Baarda, 1968).
    pub test: Option<f64>,
    /// The same over sigma0: Pope's tau (1976).
    pub tau: Option<f64>,
    /// Smallest errors in x and y that the test finds, px; none where nothing controls them.
    pub smallest_detectable_px: [Option<f64>; 2],
    /// How far errors of this size move the point, mm.
    pub effect_mm: [Option<f64>; 2],
    /// `used` or `rejected`.
    pub status: &'static str,
}

impl PlainReport {
    /// The report of an adjustment of this network.
    #[must_use]
    pub fn new(network: &PlainNetwork, adjusted: &PlainAdjustment) -> Self {
        let a = &adjusted.adjustment;
        let used = |camera: usize| {
            adjusted
                .images
                .iter()
                .any(|&i| network.images[i].camera == camera)
        };
        let cameras = (0..network.cameras.len())
            .filter(|&camera| used(camera))
            .map(|camera| {
                let own = &network.cameras[camera];
                let held = |parameter: usize| HeldParameter { camera, parameter };
                let row = |k: usize| {
                    let known = a.cameras[camera].known[k];
                    let state = match own.parameters[k] {
                        PlainParameter::Fixed => "fixed",
                        _ if adjusted.held.contains(&held(k)) => "held",
                        _ if own.sharing[k] == Sharing::Image => PER_IMAGE,
                        PlainParameter::Weighted { .. } if known.is_some() => "weighted",
                        _ => "free",
                    };
                    parameter_row(&a.cameras[camera], a.redundancy, k, state)
                };
                CameraRow {
                    camera: own.name.clone(),
                    parameters: (0..10).map(row).collect(),
                }
            });
        let images = adjusted
            .images
            .iter()
            .zip(&a.stations)
            .map(|(&image, station)| {
                let angles = OmegaPhiKappa::from_rotation(&station.pose.camera_from_world);
                let matrix = station.pose.camera_from_world.matrix();
                let sigma = |k: usize| station.covariance[(k, k)].max(0.0).sqrt();
                ImageRow {
                    image: network.images[image].name.clone(),
                    centre_mm: station.pose.centre_in_world.into(),
                    omega_phi_kappa_deg: [angles.omega, angles.phi, angles.kappa]
                        .map(f64::to_degrees),
                    camera_from_world: std::array::from_fn(|i| {
                        std::array::from_fn(|j| matrix[(i, j)])
                    }),
                    sigma_mm: [3, 4, 5].map(sigma),
                    sigma_turn_deg: [0, 1, 2].map(|k| sigma(k).to_degrees()),
                    parameters: own_parameters(
                        &network.cameras[station.camera],
                        station,
                        a.redundancy,
                    ),
                }
            });
        let points = adjusted
            .points
            .iter()
            .zip(&a.points)
            .filter_map(|(&index, point)| {
                let ellipsoid = ErrorEllipsoid::of(point.covariance.as_ref()?);
                let directions = ellipsoid.directions;
                Some(PointRow {
                    ellipsoid_mm: ellipsoid.half_axes_mm,
                    ellipsoid_directions: [0, 1, 2]
                        .map(|k| directions.column(k).into_owned().into()),
                    point: network.points[index].name.clone(),
                    position_mm: point.position.into(),
                    sigma_mm: point.sigma_mm()?.into(),
                    rays: point.rays,
                })
            });
        let distances = adjusted
            .distances
            .iter()
            .zip(&a.distances)
            .filter_map(|(&index, own)| {
                let own = own.as_ref()?;
                let distance = &network.distances[index];
                let bodies = [distance.expansion.as_ref(), network.object.as_ref()];
                Some(DistanceRow {
                    distance: distance.name.clone(),
                    length_mm: network.length_mm(distance),
                    calibrated_mm: distance.length_mm,
                    reason: reason_of_length(bodies[0], bodies[1]),
                    residual_mm: own.residual_mm,
                    redundancy: own.redundancy,
                    test: own.normalised,
                })
            });
        let points_in_turn = adjusted.points.iter().zip(&a.points);
        let known_coordinates = points_in_turn.flat_map(|(&index, point)| {
            let rows = ["x", "y", "z"].into_iter().zip(point.known);
            rows.filter_map(move |(axis, known)| {
                let known = known?;
                Some(KnownRow {
                    point: network.points[index].name.clone(),
                    axis,
                    residual_mm: known.residual,
                    redundancy: known.redundancy,
                    test: known.normalised,
                })
            })
        });
        let rows = adjusted.observations.iter().zip(&a.observations);
        let given = &adjusted.problem().observations;
        let power = TestPower::default();
        let image_points = rows.zip(given).map(|((&index, own), given)| {
            let smallest =
                [0, 1].map(|axis| power.smallest_detectable(given.sigma_px, own.redundancy[axis]));
            let effect = [0, 1].map(|axis| Some(smallest[axis]? * own.influence_mm_per_px[axis]));
            ObservationRow {
                image: network.images[network.observations[index].image]
                    .name
                    .clone(),
                point: network.points[network.observations[index].point]
                    .name
                    .clone(),
                residual_px: own.residual_px.map(Into::into),
                redundancy: own.redundancy.into(),
                test: own.test(),
                tau: own
                    .test()
                    .map(|w| w / a.sigma0)
                    .filter(|tau| tau.is_finite()),
                smallest_detectable_px: smallest,
                effect_mm: effect,
                status: match own.status {
                    ObservationStatus::Used => "used",
                    ObservationStatus::Rejected => "rejected",
                },
            }
        });
        Self {
            sigma0: a.sigma0,
            sigma0_px: a.sigma0_px,
            rms_px: a.rms_px,
            redundancy: a.redundancy,
            observations: a.observation_count,
            unknowns: a.unknown_count,
            datum_defect: a.datum_defect,
            iterations: a.iterations,
            convergence: [a.termination.value, a.termination.threshold],
            // The one that was used: where the chosen one leaves the network loose, it is not that.
            datum: match &adjusted.problem().datum {
                Datum::Control => "control points".into(),
                Datum::InnerConstraints { .. } => "inner constraints".into(),
            },
            cameras: cameras.collect(),
            images: images.collect(),
            points: points.collect(),
            distances: distances.collect(),
            known_coordinates: known_coordinates.collect(),
            image_points: image_points.collect(),
            reliability: ReliabilityReport::new(a, &adjusted.components),
            answers: PlainAnswers::default(),
            findings: adjusted.told.clone(),
        }
    }

    /// The report for people.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = String::new();
        // Writing into a string does not fail.
        let _ = self.write(&mut text);
        text
    }

    fn write(&self, text: &mut String) -> std::fmt::Result {
        writeln!(
            text,
            "{} images, {} points, {} distances",
            self.images.len(),
            self.points.len(),
            self.distances.len()
        )?;
        writeln!(
            text,
            "{} observations, {} unknowns, datum defect {} ({}), redundancy {}",
            self.observations, self.unknowns, self.datum_defect, self.datum, self.redundancy
        )?;
        writeln!(
            text,
            "sigma0 {:.5} ({:.5} px), rms {:.5} px",
            self.sigma0, self.sigma0_px, self.rms_px
        )?;
        writeln!(
            text,
            "converged in {} steps: last change {:.1e} sigmas (threshold {:.1e})",
            self.iterations, self.convergence[0], self.convergence[1]
        )?;
        self.reliability.write(text)?;
        for camera in &self.cameras {
            writeln!(text, "\ncamera '{}'", camera.camera)?;
            for row in &camera.parameters {
                match row.state {
                    PER_IMAGE => writeln!(text, "  {:<3} {PER_IMAGE}", row.name)?,
                    "fixed" | "held" => {
                        writeln!(
                            text,
                            "  {:<3} {:>15.7e}  {}",
                            row.name, row.value, row.state
                        )?;
                    }
                    state => {
                        write!(
                            text,
                            "  {:<3} {:>15.7e} +- {:.2e}  {state}",
                            row.name, row.value, row.sigma
                        )?;
                        if let Some(significance) = &row.significance {
                            significance.write(text)?;
                        }
                        writeln!(text)?;
                    }
                }
            }
        }
        for image in self.images.iter().filter(|i| !i.parameters.is_empty()) {
            write!(text, "\nimage '{}'", image.image)?;
            for row in &image.parameters {
                write!(
                    text,
                    "  {} {:.7e} +- {:.2e}",
                    row.name, row.value, row.sigma
                )?;
            }
        }
        if self.images.iter().any(|i| !i.parameters.is_empty()) {
            writeln!(text)?;
        }
        if let Some(rms) = rms(self.points.iter().map(|point| point.sigma_mm)) {
            writeln!(
                text,
                "\nrms sigma of points    x {:.4}  y {:.4}  z {:.4} mm",
                rms[0], rms[1], rms[2]
            )?;
        }
        if let Some(rms) = rms(self.images.iter().map(|image| image.sigma_mm)) {
            writeln!(
                text,
                "rms sigma of stations  x {:.4}  y {:.4}  z {:.4} mm",
                rms[0], rms[1], rms[2]
            )?;
        }
        for row in &self.distances {
            writeln!(
                text,
                "distance '{}': off by {:+.4} mm, |w| {:.1}",
                row.distance,
                row.residual_mm,
                row.test.abs()
            )?;
            if let Some(reason) = &row.reason {
                writeln!(
                    text,
                    "  used as {:.4} mm, calibrated {:.4} mm: {reason}",
                    row.length_mm, row.calibrated_mm
                )?;
            }
        }
        self.answers.write(text)?;
        self.write_tests(text)?;
        for finding in &self.findings {
            writeln!(text, "{finding}")?;
        }
        Ok(())
    }

    /// The image points with the largest tests.
    fn write_tests(&self, text: &mut String) -> std::fmt::Result {
        /// So many are shown.
        const SHOWN: usize = 5;
        let mut rows: Vec<(&ObservationRow, f64)> = self
            .image_points
            .iter()
            .filter_map(|row| Some((row, row.test?)))
            .collect();
        rows.sort_by(|a, b| b.1.total_cmp(&a.1));
        writeln!(text, "largest tests:")?;
        for (row, test) in rows.iter().take(SHOWN) {
            writeln!(
                text,
                "  point '{}' in image '{}': |w| {test:.1}, {}",
                row.point, row.image, row.status
            )?;
        }
        Ok(())
    }
}

fn state(parameter: PlainParameter) -> &'static str {
    match parameter {
        PlainParameter::Fixed => "fixed",
        PlainParameter::Free => "free",
        PlainParameter::Weighted { .. } => "weighted",
    }
}

fn parameter_row(
    camera: &AdjustedCamera,
    redundancy: usize,
    parameter: usize,
    state: &'static str,
) -> ParameterRow {
    let known = camera.known[parameter];
    ParameterRow {
        name: INTERIOR_NAMES[parameter],
        value: camera.camera.interior.to_vector()[parameter],
        sigma: camera.covariance[(parameter, parameter)].max(0.0).sqrt(),
        state,
        residual: known.map(|known| known.residual),
        redundancy: known.map(|known| known.redundancy),
        test: known.map(|known| known.normalised),
        significance: significance(camera, redundancy, parameter),
    }
}

/// The parameters of its camera that a station has for itself.
fn own_parameters(
    camera: &PlainCamera,
    station: &AdjustedStation,
    redundancy: usize,
) -> Vec<ParameterRow> {
    let own = (0..10).filter(|&k| camera.sharing[k] == Sharing::Image);
    let row = |k: usize| {
        let interior = station.interior.as_ref()?;
        let state = state(camera.parameters[k]);
        Some(parameter_row(interior, redundancy, k, state))
    };
    own.filter_map(row).collect()
}

fn rms(rows: impl Iterator<Item = [f64; 3]>) -> Option<[f64; 3]> {
    let mut count = 0;
    let mut squares = [0.0; 3];
    for row in rows {
        count += 1;
        for (sum, value) in squares.iter_mut().zip(row) {
            *sum += value * value;
        }
    }
    (count > 0).then(|| squares.map(|sum| (sum / f64::from(count)).sqrt()))
}

#[cfg(test)]
#[path = "plain_network_tests.rs"]
mod tests;
