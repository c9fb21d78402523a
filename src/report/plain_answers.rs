//! What is asked of an adjusted plain network besides its coordinates: check points and distances, derived quantities, the
//! whole covariance matrix.

use std::fmt::Write;

use nalgebra::Vector3;
use serde::Serialize;

use crate::adjustment::{Derived, Part, SolvedNetwork};
use crate::camera::INTERIOR_NAMES;
use crate::geometry::{Scale, Similarity, fit_similarity};
use crate::network::BarRole;
use crate::plain_network::{PlainAdjustment, PlainDatum, PlainNetwork, PointRole};

/// A quantity that is asked for, by indices of the network's points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Question {
    /// The distance of two points.
    Distance([usize; 2]),
    /// The angle at the second of three points.
    Angle([usize; 3]),
}

/// The answers.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PlainAnswers {
    /// Points whose known coordinates took no part.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub check_points: Vec<CheckPointRow>,
    /// Distances that took no part.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub check_distances: Vec<CheckDistanceRow>,
    /// Quantities that were asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub derived: Vec<DerivedRow>,
    /// What could not be compared, and why, a line each: the report tells it among its findings.
    #[serde(skip)]
    pub not_compared: Vec<String>,
}

/// A check point.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CheckPointRow {
    /// Its name.
    pub point: String,
    /// Adjusted minus known coordinates, mm; none where nothing is known.
    pub difference_mm: [Option<f64>; 3],
    /// Differences over their standard deviations; none where the network was first fitted onto its check points.
    pub test: Option<[Option<f64>; 3]>,
}

/// A check distance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CheckDistanceRow {
    /// Its name.
    pub distance: String,
    /// Adjusted minus known, mm.
    pub difference_mm: f64,
    /// Standard deviation of the adjusted distance, mm.
    pub sigma_mm: f64,
    /// The difference over its standard deviation, that of the known length included.
    pub test: f64,
}

/// A derived quantity.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DerivedRow {
    /// What it is: `distance A B`, `angle A B C`.
    pub quantity: String,
    /// Its value.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
    /// `mm` or `deg`.
    pub unit: &'static str,
}

/// What is asked for has no answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoAnswer {
    /// A point takes no part in the adjustment.
    #[error("point '{0}': found no adjusted coordinates, expected a point that takes part")]
    Point(String),
    /// The quantity has no derivative there.
    #[error("{0}: found points at one place or on one line, expected others")]
    Quantity(String),
}

/// Whether anything is to be answered that needs the solved equations.
#[must_use]
pub fn asks(network: &PlainNetwork, questions: &[Question]) -> bool {
    let check_distances = network.distances.iter();
    let mut check_distances = check_distances.filter(|d| d.role == BarRole::Check);
    let mut check_points = network.points.iter().filter(|p| p.role == PointRole::Check);
    !questions.is_empty() || check_distances.next().is_some() || check_points.next().is_some()
}

impl PlainAnswers {
    /// Answers for an adjusted network.
    ///
    /// # Errors
    /// [`NoAnswer`] where a question names a point without coordinates, or points at one place.
    pub fn new(
        network: &PlainNetwork,
        adjusted: &PlainAdjustment,
        solved: &SolvedNetwork,
        questions: &[Question],
    ) -> Result<Self, NoAnswer> {
        let mut not_compared = Vec::new();
        Ok(Self {
            check_points: check_points(network, adjusted, &mut not_compared),
            check_distances: check_distances(network, adjusted, solved, &mut not_compared),
            derived: derived(network, adjusted, solved, questions)?,
            not_compared,
        })
    }

    pub(super) fn write(&self, text: &mut dyn Write) -> std::fmt::Result {
        for row in &self.check_points {
            let differences: Vec<String> = ["x", "y", "z"]
                .iter()
                .zip(row.difference_mm)
                .filter_map(|(axis, value)| Some(format!("{axis} {:+.4}", value?)))
                .collect();
            let fitted = match row.test {
                Some(_) => "",
                None => " after a best fit",
            };
            writeln!(
                text,
                "check point '{}': off by {} mm{fitted}",
                row.point,
                differences.join("  ")
            )?;
        }
        for row in &self.check_distances {
            writeln!(
                text,
                "check distance '{}': off by {:+.4} +- {:.4} mm, {:.1} standard deviations",
                row.distance,
                row.difference_mm,
                row.sigma_mm,
                row.test.abs()
            )?;
        }
        for row in &self.derived {
            writeln!(
                text,
                "{}: {:.6} +- {:.6} {}",
                row.quantity, row.value, row.sigma, row.unit
            )?;
        }
        Ok(())
    }
}

/// The place of a point of the network in the adjustment.
fn place(adjusted: &PlainAdjustment, point: usize) -> Option<usize> {
    adjusted.points.iter().position(|&index| index == point)
}

/// In the datum of control the differences themselves; in a free network those after a best fit onto three check points or more.
fn check_points(
    network: &PlainNetwork,
    adjusted: &PlainAdjustment,
    not_compared: &mut Vec<String>,
) -> Vec<CheckPointRow> {
    let adjustment = &adjusted.adjustment;
    let checked: Vec<(usize, usize)> = adjusted
        .points
        .iter()
        .enumerate()
        .filter(|(_, point)| network.points[**point].role == PointRole::Check)
        .map(|(place, &point)| (place, point))
        .collect();
    let is_free = adjustment.datum_defect > 0 || network.datum != PlainDatum::Control;
    let fit = is_free.then(|| best_fit(network, adjusted, &checked));
    let motion = match fit {
        None => Similarity::identity(),
        Some(Some(fit)) => fit,
        Some(None) => {
            if !checked.is_empty() {
                not_compared.push(format!(
                    "check points: not compared: found {} in a free network, expected three or more that are wholly known and not on a line",
                    checked.len()
                ));
            }
            return Vec::new();
        }
    };
    checked
        .iter()
        .map(|&(place, point)| {
            let found = &adjustment.points[place];
            let position = motion.apply(&found.position);
            let known = network.points[point].known;
            let difference =
                [0, 1, 2].map(|axis| Some(position[axis] - known[axis].as_ref()?.value_mm));
            let test = [0, 1, 2].map(|axis| {
                let known = known[axis].as_ref()?;
                let own = found.covariance?[(axis, axis)];
                let variance = own + known.sigma_mm.unwrap_or(0.0).powi(2);
                (variance > 0.0).then(|| (position[axis] - known.value_mm) / variance.sqrt())
            });
            CheckPointRow {
                point: network.points[point].name.clone(),
                difference_mm: difference,
                test: (!is_free).then_some(test),
            }
        })
        .collect()
}

fn best_fit(
    network: &PlainNetwork,
    adjusted: &PlainAdjustment,
    checked: &[(usize, usize)],
) -> Option<Similarity> {
    let pairs: Vec<_> = checked
        .iter()
        .filter_map(|&(place, point)| {
            let [x, y, z] = network.points[point].known;
            let known = Vector3::new(x?.value_mm, y?.value_mm, z?.value_mm);
            Some((adjusted.adjustment.points[place].position, known))
        })
        .collect();
    let scale = match adjusted.adjustment.datum_defect {
        7 => Scale::Free,
        _ => Scale::One,
    };
    fit_similarity(&pairs, scale).ok()
}

fn check_distances(
    network: &PlainNetwork,
    adjusted: &PlainAdjustment,
    solved: &SolvedNetwork,
    not_compared: &mut Vec<String>,
) -> Vec<CheckDistanceRow> {
    let checked = network.distances.iter();
    let checked = checked.filter(|distance| distance.role == BarRole::Check);
    let rows = checked.filter_map(|distance| {
        let ends = place(adjusted, distance.from).zip(place(adjusted, distance.to));
        let found = ends.and_then(|(from, to)| solved.derived(&[Derived::Distance { from, to }]));
        let Some(found) = found else {
            not_compared.push(format!(
                "check distance '{}': not compared: found an end that takes no part, expected both",
                distance.name
            ));
            return None;
        };
        let difference = found.values[0] - network.length_mm(distance);
        let sigma = found.sigma(0);
        Some(CheckDistanceRow {
            distance: distance.name.clone(),
            difference_mm: difference,
            sigma_mm: sigma,
            test: difference / sigma.hypot(distance.sigma_mm),
        })
    });
    rows.collect()
}

fn derived(
    network: &PlainNetwork,
    adjusted: &PlainAdjustment,
    solved: &SolvedNetwork,
    questions: &[Question],
) -> Result<Vec<DerivedRow>, NoAnswer> {
    let name = |point: usize| network.points[point].name.as_str();
    let of = |point: usize| {
        place(adjusted, point).ok_or_else(|| NoAnswer::Point(network.points[point].name.clone()))
    };
    questions
        .iter()
        .map(|question| {
            let (quantity, derived, unit, scale) = match *question {
                Question::Distance([from, to]) => (
                    format!("distance {} {}", name(from), name(to)),
                    Derived::Distance {
                        from: of(from)?,
                        to: of(to)?,
                    },
                    "mm",
                    1.0,
                ),
                Question::Angle([from, at, to]) => (
                    format!("angle {} {} {}", name(from), name(at), name(to)),
                    Derived::Angle {
                        at: of(at)?,
                        from: of(from)?,
                        to: of(to)?,
                    },
                    "deg",
                    1f64.to_degrees(),
                ),
            };
            let found = solved
                .derived(&[derived])
                .ok_or_else(|| NoAnswer::Quantity(quantity.clone()))?;
            Ok(DerivedRow {
                quantity,
                value: scale * found.values[0],
                sigma: scale * found.sigma(0),
                unit,
            })
        })
        .collect()
}

/// The whole covariance matrix as CSV, a-posteriori, in the datum of the adjustment: a row and a column for every unknown of cameras,
/// stations (turns in rad, centres in mm) and points, named by what it belongs to.
#[must_use]
pub fn covariance_csv(
    network: &PlainNetwork,
    adjusted: &PlainAdjustment,
    solved: &SolvedNetwork,
) -> String {
    let parts = solved.parts();
    let names: Vec<String> = parts
        .iter()
        .flat_map(|part| names_of(network, adjusted, *part))
        .collect();
    let mut writer = csv::Writer::from_writer(Vec::new());
    let header: Vec<&str> = std::iter::once("unknown")
        .chain(names.iter().map(String::as_str))
        .collect();
    // Writing into memory does not fail.
    let _ = writer.write_record(&header);
    if let Some(covariance) = solved.covariance(&parts) {
        for (row, name) in names.iter().enumerate() {
            let values = covariance.row(row);
            let fields = std::iter::once(name.clone())
                .chain(values.iter().map(|value| format!("{value:e}")));
            let _ = writer.write_record(fields);
        }
    }
    let bytes = writer.into_inner().unwrap_or_default();
    String::from_utf8_lossy(&bytes).into_owned()
}

fn names_of(network: &PlainNetwork, adjusted: &PlainAdjustment, part: Part) -> Vec<String> {
    let named = |name: &str, of: &[&str]| -> Vec<String> {
        of.iter().map(|of| format!("{name} {of}")).collect()
    };
    match part {
        Part::Camera(camera) => named(&network.cameras[camera].name, &INTERIOR_NAMES),
        Part::Interior(station) => named(
            &network.images[adjusted.images[station]].name,
            &INTERIOR_NAMES,
        ),
        Part::Station(station) => named(
            &network.images[adjusted.images[station]].name,
            &["turn_x", "turn_y", "turn_z", "x", "y", "z"],
        ),
        Part::Point(point) => named(
            &network.points[adjusted.points[point]].name,
            &["x", "y", "z"],
        ),
    }
}
