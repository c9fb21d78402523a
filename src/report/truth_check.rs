//! How a measurement of rendered pictures stands against their truth.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector3;
use serde::Serialize;

use crate::geometry::{FitError, Scale, fit_similarity};
use crate::network::{BarRole, DevicePoint, ImageEntry, Network, PointId, PointKind, ScaleBar};
use crate::synthetic::{LabelledPoint, PublishedBar, Truth, TruthDot};
use crate::targets::DotIndex;

impl From<PublishedBar> for ScaleBar {
    fn from(bar: PublishedBar) -> Self {
        Self {
            name: bar.name,
            from: bar.from,
            to: bar.to,
            length_mm: bar.length_mm,
            sigma_mm: bar.sigma_mm,
            role: BarRole::Control,
            expansion: None,
        }
    }
}

impl From<&LabelledPoint> for DevicePoint {
    fn from(point: &LabelledPoint) -> Self {
        Self {
            label: point.label.clone(),
            position_mm: point.point,
        }
    }
}

/// A detected dot is the image of a true one when their centres are nearer than this, px, or a quarter of its diameter.
const SAME_DOT_PX: f64 = 1.5;

/// Fewest images that must show a target before it counts (three rays check each other).
const IMAGES_TO_COUNT: usize = 3;

/// The outcome of the comparison.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct TruthCheck {
    /// Images of the project.
    pub images: usize,
    /// Images with an orientation.
    pub images_oriented: usize,
    /// Dots wholly visible in truth.
    pub visible_dots: usize,
    /// Of these, dots that were detected.
    pub visible_detected: usize,
    /// Of these, dots that carry a label.
    pub visible_labelled: usize,
    /// Detected dots that are no target in truth.
    pub false_dots: usize,
    /// Detected dots whose target is detected in three or more images.
    pub countable_dots: usize,
    /// Of these, dots that carry a label.
    pub countable_labelled: usize,
    /// Code readings.
    pub codes: usize,
    /// Code readings whose number is not the true one, and that were not set aside, as `image: label`.
    pub wrong_codes: Vec<String>,
    /// Code readings that orientation set aside.
    pub codes_set_aside: usize,
    /// Used observations whose label is not the true one, as `image: label is truth`.
    pub wrong_labels: Vec<String>,
    /// Plain targets in truth.
    pub targets: usize,
    /// Plain targets with adjusted coordinates.
    pub targets_as_points: usize,
    /// True targets that carry two labels.
    pub split_targets: Vec<String>,
    /// Rms over all coordinates of the difference to truth after a best fit without scale, mm.
    pub rms_mm: f64,
    /// Rms per axis, mm.
    pub rms_axes_mm: [f64; 3],
    /// Largest difference of a point, mm.
    pub largest_mm: f64,
    /// Rms of the coordinate errors over their printed sigmas.
    pub error_over_sigma: f64,
    /// Adjusted scale less one, parts per million (best fit with scale).
    pub scale_ppm: f64,
}

/// Compares a network with the truth of its pictures.
///
/// Plain targets are named by the truth that most of their observations show.
///
/// # Errors
/// [`FitError`] where fewer than three points can be compared.
pub fn check_against_truth(network: &Network, truth: &Truth) -> Result<TruthCheck, FitError> {
    let true_points = &truth.points;
    let mut check = TruthCheck {
        images: network.images.len(),
        ..TruthCheck::default()
    };
    check.images_oriented = network.oriented_images().count();

    let mut shown: Vec<Shown> = Vec::new();
    for (_, image) in network.used_images() {
        let name = image.file.path.rsplit('/').next().unwrap_or_default();
        let dots = truth.images.get(name).map_or(&[][..], Vec::as_slice);
        let seen = Shown::of(image, dots);
        check.visible_dots += dots.iter().filter(|dot| dot.is_whole()).count();
        check.false_dots += seen
            .true_names
            .iter()
            .filter(|true_name| true_name.is_none())
            .count();
        check_codes(&mut check, name, image, &seen);
        shown.push(seen);
    }
    let true_names = names_of_points(network, &shown);
    count_labels(&mut check, network, &shown, &true_names);

    let plain = |label: &str| label.starts_with('T');
    check.targets = true_points.keys().filter(|label| plain(label)).count();
    let mut owners: BTreeMap<&str, Vec<PointId>> = BTreeMap::new();
    for (point, name) in &true_names {
        owners.entry(name).or_default().push(*point);
    }
    for (name, points) in &owners {
        if points.len() > 1 {
            let labels: Vec<String> = points.iter().map(|p| network.label(*p)).collect();
            check
                .split_targets
                .push(format!("{name}: {}", labels.join(", ")));
        }
    }
    let measured: Vec<PointId> = true_names
        .keys()
        .copied()
        .filter(|id| is_adjusted(network, *id))
        .collect();
    check.targets_as_points = measured
        .iter()
        .filter(|id| id.kind() == PointKind::Target && plain(&true_names[id]))
        .map(|id| &true_names[id])
        .collect::<BTreeSet<_>>()
        .len();
    compare_coordinates(&mut check, network, &measured, &true_names, true_points)?;
    Ok(check)
}

/// What one image shows: for every detected dot the true label, and whether all of it is visible.
struct Shown<'a> {
    image: &'a ImageEntry,
    true_names: Vec<Option<&'a str>>,
    whole: Vec<bool>,
}

impl<'a> Shown<'a> {
    fn of(image: &'a ImageEntry, truth: &'a [TruthDot]) -> Self {
        let dots = image.detections.as_ref().map_or(&[][..], |d| &d.dots);
        let nearest: Vec<Option<&TruthDot>> = dots
            .iter()
            .map(|dot| {
                truth
                    .iter()
                    .filter(|t| t.is_seen())
                    .filter_map(|t| Some(((t.centre_of_image_px? - dot.centre_px).norm(), t)))
                    .filter(|(distance, t)| *distance < SAME_DOT_PX.max(t.minor_px / 4.0))
                    .min_by(|a, b| a.0.total_cmp(&b.0))
                    .map(|(_, t)| t)
            })
            .collect();
        Self {
            image,
            true_names: nearest
                .iter()
                .map(|t| t.map(|t| t.label.as_str()))
                .collect(),
            whole: nearest
                .iter()
                .map(|t| t.is_some_and(TruthDot::is_whole))
                .collect(),
        }
    }

    fn true_name(&self, dot: DotIndex) -> Option<&'a str> {
        self.true_names.get(dot.slot()).copied().flatten()
    }
}

fn check_codes(check: &mut TruthCheck, name: &str, image: &ImageEntry, seen: &Shown<'_>) {
    let Some(detections) = &image.detections else {
        return;
    };
    for (place, reading) in detections.codes.iter().enumerate() {
        check.codes += 1;
        if image.set_aside.contains_key(&place) {
            check.codes_set_aside += 1;
            continue;
        }
        let points = PointId::of_code(reading.family, reading.id);
        let right = reading
            .dots
            .iter()
            .zip(&points)
            .all(|(&dot, point)| seen.true_name(dot) == Some(point.to_string().as_str()));
        if !right {
            check
                .wrong_codes
                .push(format!("{name}: {}", reading.family.code_label(reading.id)));
        }
    }
}

/// The true label of every labelled point: its own for codes and the cross, that of most observations for plain targets.
fn names_of_points(network: &Network, shown: &[Shown<'_>]) -> BTreeMap<PointId, String> {
    let mut votes: BTreeMap<PointId, BTreeMap<&str, usize>> = BTreeMap::new();
    for seen in shown {
        for (dot, label) in seen.image.used_labels() {
            let votes = votes.entry(label.point).or_default();
            if let Some(name) = seen.true_name(dot) {
                *votes.entry(name).or_default() += 1;
            }
        }
    }
    votes
        .into_iter()
        .filter_map(|(point, votes)| match point.kind() {
            PointKind::Target => {
                let (name, _) = votes.into_iter().max_by_key(|(_, count)| *count)?;
                Some((point, name.to_owned()))
            }
            PointKind::Code | PointKind::Cross => Some((point, network.label(point))),
        })
        .collect()
}

fn count_labels(
    check: &mut TruthCheck,
    network: &Network,
    shown: &[Shown<'_>],
    true_names: &BTreeMap<PointId, String>,
) {
    let mut images_of_target: BTreeMap<&str, usize> = BTreeMap::new();
    for name in shown
        .iter()
        .flat_map(|seen| seen.true_names.iter().flatten())
    {
        *images_of_target.entry(name).or_default() += 1;
    }
    for seen in shown {
        for (slot, name) in seen.true_names.iter().enumerate() {
            let label = seen.image.labels.get(&DotIndex(slot as u32));
            let named = label.is_some_and(|l| network.points.contains_key(&l.point));
            if let Some(name) = name
                && images_of_target[name] >= IMAGES_TO_COUNT
            {
                check.countable_dots += 1;
                check.countable_labelled += usize::from(named);
            }
            if seen.whole[slot] {
                check.visible_detected += 1;
                check.visible_labelled += usize::from(named);
            }
            if let Some(label) = label
                && label.rejected.is_none()
                && named
                && true_names.get(&label.point).map(String::as_str) != *name
            {
                let image = &seen.image.file.path;
                let truth = name.unwrap_or("no target");
                check.wrong_labels.push(format!(
                    "{image}: {} is {truth}",
                    network.label(label.point)
                ));
            }
        }
    }
}

fn is_adjusted(network: &Network, id: PointId) -> bool {
    network
        .points
        .get(&id)
        .is_some_and(|point| point.covariance.is_some())
}

fn compare_coordinates(
    check: &mut TruthCheck,
    network: &Network,
    measured: &[PointId],
    true_names: &BTreeMap<PointId, String>,
    true_points: &BTreeMap<String, [f64; 3]>,
) -> Result<(), FitError> {
    let pairs: Vec<_> = measured
        .iter()
        .filter_map(|id| {
            let truth = Vector3::from(*true_points.get(&true_names[id])?);
            Some((*id, (network.points[id].position, truth)))
        })
        .collect();
    let coordinates: Vec<_> = pairs.iter().map(|(_, pair)| *pair).collect();
    let fit = fit_similarity(&coordinates, Scale::One)?;
    check.scale_ppm = (1.0 / fit_similarity(&coordinates, Scale::Free)?.scale - 1.0) * 1e6;
    let mut squares = Vector3::zeros();
    let mut standardised = 0.0;
    for (id, (present, truth)) in &pairs {
        let difference = fit.apply(present) - truth;
        squares += difference.component_mul(&difference);
        check.largest_mm = check.largest_mm.max(difference.norm());
        if let Some(covariance) = network.points[id].covariance {
            let rotation = fit.rotation.matrix();
            let covariance = rotation * covariance * rotation.transpose();
            // What the frame holds has no variance to be measured by.
            standardised += (0..3)
                .filter(|&i| covariance[(i, i)] > 0.0)
                .map(|i| difference[i].powi(2) / covariance[(i, i)])
                .sum::<f64>();
        }
    }
    let count = pairs.len() as f64;
    check.rms_axes_mm = (squares / count).map(f64::sqrt).into();
    check.rms_mm = (squares.sum() / (3.0 * count)).sqrt();
    check.error_over_sigma = (standardised / (3.0 * count)).sqrt();
    Ok(())
}
