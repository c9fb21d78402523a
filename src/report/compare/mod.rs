//! The adjusted points against known coordinates: best fit, then differences.
//!
//! The transformation is fitted to the points found by label, every coordinate with weight 1 (Umeyama, 1991), and
//! nothing is left out as an outlier: a comparison that hides its worst point is none. Points without a label of ours
//! are then looked for where that transformation puts the adjusted ones, and reported apart.

mod matching;
mod table;

use std::collections::BTreeSet;

use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

use self::matching::{Candidate, by_place};
use super::export::{AdjustedPoint, NoFigures, adjusted_points, fresh_adjustment};
use crate::geometry::{FitError, Scale, Similarity, fit_similarity};
use crate::network::{Network, ScaleSource};

pub(super) use self::matching::place_distance;

/// A point with known coordinates to compare with.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferencePoint {
    /// Its label, where it has one; labels of other programs are possible.
    pub label: Option<String>,
    /// What to call it in reports.
    pub name: String,
    /// Known coordinates, mm; `None` where one is unknown.
    pub coordinates_mm: [Option<f64>; 3],
    /// Their standard deviations, mm, where they are known.
    pub sigmas_mm: [Option<f64>; 3],
}

impl ReferencePoint {
    /// The place of the point; `None` where a coordinate is unknown.
    #[must_use]
    pub fn position(&self) -> Option<Vector3<f64>> {
        let [x, y, z] = self.coordinates_mm;
        Some(Vector3::new(x?, y?, z?))
    }
}

/// How to compare.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CompareSettings {
    /// Whether the fit has a scale of its own (default: no, so that an error of scale shows).
    pub scale: Scale,
    /// Within what distance a point without label is the nearest one, mm; `None`: a third of the smallest spacing of the
    /// reference points, but no more than a hundredth of their extent.
    pub place_distance_mm: Option<f64>,
}

impl Default for CompareSettings {
    fn default() -> Self {
        Self {
            scale: Scale::One,
            place_distance_mm: None,
        }
    }
}

/// Why there is nothing to compare; one line.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CompareError {
    /// No figures of the adjustment.
    #[error(transparent)]
    NoFigures(#[from] NoFigures),
    /// Too few points in common.
    #[error(
        "comparison: {reason} ({common} labels with three coordinates in common; {points} adjusted points, {reference} reference points)"
    )]
    NoFit {
        /// What the fit says.
        reason: FitError,
        /// Points found by label.
        common: usize,
        /// Adjusted points.
        points: usize,
        /// Reference points.
        reference: usize,
    },
}

/// How the two were found to be the same point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Counterpart {
    /// They have the same label.
    Label,
    /// They lie at the same place.
    Place,
}

/// One adjusted point against its reference: adjusted and moved, minus known.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Label of the adjusted point.
    pub label: String,
    /// Name of the reference point.
    pub reference: String,
    /// How they were brought together.
    pub by: Counterpart,
    /// Difference in x, mm; `None` where the known coordinate is missing.
    pub dx_mm: Option<f64>,
    /// Difference in y, mm.
    pub dy_mm: Option<f64>,
    /// Difference in z, mm.
    pub dz_mm: Option<f64>,
    /// Length of the difference over the known coordinates, mm.
    pub distance_mm: f64,
    /// Differences over their standard deviations (of the adjustment and, where given, of the reference).
    pub over_sigma: [Option<f64>; 3],
}

impl Difference {
    fn axes(&self) -> [Option<f64>; 3] {
        [self.dx_mm, self.dy_mm, self.dz_mm]
    }
}

/// How well a set of points agrees.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Agreement {
    /// Points compared.
    pub points: usize,
    /// Rms difference in x, mm.
    pub rms_x_mm: Option<f64>,
    /// Rms difference in y, mm.
    pub rms_y_mm: Option<f64>,
    /// Rms difference in z, mm.
    pub rms_z_mm: Option<f64>,
    /// Rms over all coordinates, mm.
    pub rms_mm: Option<f64>,
    /// Length of the largest difference, mm.
    pub largest_mm: Option<f64>,
    /// Label of the point with the largest difference.
    pub largest_label: Option<String>,
    /// Rms over all coordinates of difference over standard deviation: 1 where the sigmas are true.
    pub rms_over_sigma: Option<f64>,
}

/// The outcome of a comparison.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// The points found by label, to which the transformation is fitted.
    #[serde(flatten)]
    pub by_label: Agreement,
    /// The points found by place.
    pub by_place: Agreement,
    /// Within what distance they were looked for, mm.
    pub place_distance_mm: f64,
    /// Whether the scale was fitted.
    pub with_scale: bool,
    /// Where the scale of the measurement comes from.
    pub scale_from: ScaleSource,
    /// Scale of the transformation (1 where it was not fitted).
    pub scale: f64,
    /// Its rotation, row by row.
    pub rotation: [[f64; 3]; 3],
    /// Its translation, mm.
    pub translation_mm: [f64; 3],
    /// Reference points without a counterpart.
    pub reference_without_counterpart: Vec<String>,
    /// Adjusted points without a counterpart.
    pub points_without_counterpart: Vec<String>,
    /// All differences, those by label first.
    pub differences: Vec<Difference>,
}

/// A pair of an adjusted and a reference point, by their places in the two lists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Pair {
    point: usize,
    reference: usize,
}

/// Fits the adjusted points best onto the reference and compares them.
///
/// # Errors
/// [`CompareError`] where the network has no adjustment of its present inputs or fewer than three labels are in common.
pub fn compare(
    network: &Network,
    reference: &[ReferencePoint],
    settings: &CompareSettings,
) -> Result<Comparison, CompareError> {
    let adjustment = fresh_adjustment(network, "comparison")?;
    let points = adjusted_points(network, adjustment);
    let labelled = by_label(network, &points, reference);
    let common: Vec<_> = labelled
        .pairs
        .iter()
        .filter_map(|p| {
            let target = reference[p.reference].position()?;
            Some((points[p.point].point.position, target))
        })
        .collect();
    let fit = fit_similarity(&common, settings.scale).map_err(|reason| CompareError::NoFit {
        reason,
        common: common.len(),
        points: points.len(),
        reference: reference.len(),
    })?;
    let distance = settings
        .place_distance_mm
        .unwrap_or_else(|| place_distance(reference));
    let taken: BTreeSet<usize> = labelled.pairs.iter().map(|p| p.point).collect();
    let free: Vec<Candidate> = (0..points.len())
        .filter(|index| !taken.contains(index))
        .map(|index| Candidate {
            index,
            place: fit.apply(&points[index].point.position),
        })
        .collect();
    let places: Vec<Candidate> = labelled
        .foreign
        .iter()
        .filter_map(|&index| {
            let place = reference[index].position()?;
            Some(Candidate { index, place })
        })
        .collect();
    let placed = by_place(&free, &places, distance);

    let difference = |pair: &Pair, by| {
        let point = &points[pair.point];
        difference(network, point, &reference[pair.reference], &fit, by)
    };
    let of_label: Vec<Difference> = labelled
        .pairs
        .iter()
        .map(|p| difference(p, Counterpart::Label))
        .collect();
    let of_place: Vec<Difference> = placed
        .iter()
        .map(|p| difference(p, Counterpart::Place))
        .collect();
    let pairs = || labelled.pairs.iter().chain(&placed);
    let matched: BTreeSet<usize> = pairs().map(|p| p.point).collect();
    let known: BTreeSet<usize> = pairs().map(|p| p.reference).collect();
    Ok(Comparison {
        by_label: agreement(&of_label),
        by_place: agreement(&of_place),
        place_distance_mm: distance,
        with_scale: settings.scale == Scale::Free,
        scale_from: adjustment.scale_from,
        scale: fit.scale,
        rotation: std::array::from_fn(|r| std::array::from_fn(|c| fit.rotation.matrix()[(r, c)])),
        translation_mm: fit.translation.into(),
        reference_without_counterpart: (0..reference.len())
            .filter(|index| !known.contains(index))
            .map(|index| reference[index].name.clone())
            .collect(),
        points_without_counterpart: (0..points.len())
            .filter(|index| !matched.contains(index))
            .map(|index| network.label(points[index].id))
            .collect(),
        differences: of_label.into_iter().chain(of_place).collect(),
    })
}

struct Labelled {
    pairs: Vec<Pair>,
    /// Reference points without a label of ours.
    foreign: Vec<usize>,
}

fn by_label(
    network: &Network,
    points: &[AdjustedPoint<'_>],
    reference: &[ReferencePoint],
) -> Labelled {
    let mut labelled = Labelled {
        pairs: Vec::new(),
        foreign: Vec::new(),
    };
    for (index, known) in reference.iter().enumerate() {
        let label = known.label.as_deref();
        match label.and_then(|label| network.point_of_label(label).ok()) {
            None => labelled.foreign.push(index),
            Some(id) => {
                // Points come by id.
                if let Ok(point) = points.binary_search_by_key(&id, |p| p.id) {
                    labelled.pairs.push(Pair {
                        point,
                        reference: index,
                    });
                }
            }
        }
    }
    labelled
}

/// An adjusted point, moved by a fit, against its reference.
pub(super) fn difference(
    network: &Network,
    point: &AdjustedPoint<'_>,
    known: &ReferencePoint,
    fit: &Similarity,
    by: Counterpart,
) -> Difference {
    let moved = fit.apply(&point.point.position);
    let turn = fit.rotation.matrix();
    let covariance: Matrix3<f64> =
        turn * point.covariance * turn.transpose() * (fit.scale * fit.scale);
    let axes: [Option<f64>; 3] =
        std::array::from_fn(|axis| known.coordinates_mm[axis].map(|k| moved[axis] - k));
    let over_sigma = std::array::from_fn(|axis| {
        let of_reference = known.sigmas_mm[axis].unwrap_or(0.0);
        let sigma = (covariance[(axis, axis)].max(0.0) + of_reference * of_reference).sqrt();
        axes[axis].filter(|_| sigma > 0.0).map(|d| d / sigma)
    });
    let [dx_mm, dy_mm, dz_mm] = axes;
    Difference {
        label: network.label(point.id),
        reference: known.name.clone(),
        by,
        dx_mm,
        dy_mm,
        dz_mm,
        distance_mm: axes.iter().flatten().map(|d| d * d).sum::<f64>().sqrt(),
        over_sigma,
    }
}

pub(super) fn agreement(differences: &[Difference]) -> Agreement {
    let axis = |axis: usize| rms(differences.iter().filter_map(|d| d.axes()[axis]));
    let largest = differences
        .iter()
        .max_by(|a, b| a.distance_mm.total_cmp(&b.distance_mm));
    Agreement {
        points: differences.len(),
        rms_x_mm: axis(0),
        rms_y_mm: axis(1),
        rms_z_mm: axis(2),
        rms_mm: rms(differences.iter().flat_map(Difference::axes).flatten()),
        largest_mm: largest.map(|d| d.distance_mm),
        largest_label: largest.map(|d| d.label.clone()),
        rms_over_sigma: rms(differences.iter().flat_map(|d| d.over_sigma).flatten()),
    }
}

/// Root mean square; `None` of nothing.
fn rms(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut count = 0;
    let mut sum = 0.0;
    for value in values {
        count += 1;
        sum += value * value;
    }
    (count > 0).then(|| (sum / f64::from(count)).sqrt())
}

#[cfg(test)]
mod tests;
