//! Code readings that do not fit the network: their names are taken away, the reason stays with the image.

use std::sync::Arc;

use super::resection::intersect_new_points;
use crate::network::{
    About, Finding, FindingKind, ImageEntry, Label, Network, PointId, Source, Stage,
};
use crate::targets::{CodeReading, Family};

/// A resection contradicts the reading.
pub(super) const OFF_ITS_PLACE: &str = "it does not lie where the other codes put it";

/// Identification found other targets in its dots.
pub(super) const OF_OTHER_TARGETS: &str = "its dots belong to other targets";

/// The coordinates contradict the reading.
pub(super) const OF_OTHER_SHAPE: &str = "its dots do not have the shape of the code in space";

/// Takes the names of a code's dots away in one image, for this reason.
pub(super) fn set_code_aside(image: &mut ImageEntry, family: Family, code: u32, reason: &str) {
    let Some(detections) = image.detections.clone() else {
        return;
    };
    let of_code = |r: &CodeReading| (r.family, r.id) == (family, code);
    for place in (0..detections.codes.len()).filter(|&place| of_code(&detections.codes[place])) {
        // What the operator said of a reading stands; the adjustment tests its dots one by one.
        if !image.is_reading_of_operator(place) {
            let aside = Arc::make_mut(&mut image.set_aside);
            aside.entry(place).or_insert_with(|| reason.to_owned());
        }
    }
    Arc::make_mut(&mut image.labels).retain(|_, label| {
        label.point.code() != Some((family, code)) || label.source == Source::Operator
    });
}

/// The readings of an image that a stage after detection set aside, by their places.
pub(super) fn readings_aside(image: &ImageEntry) -> Vec<usize> {
    let by_network = |reason: &str| [OFF_ITS_PLACE, OF_OTHER_SHAPE].contains(&reason);
    let aside = image.set_aside.iter();
    aside
        .filter(|(_, reason)| by_network(reason))
        .map(|(place, _)| *place)
        .collect()
}

/// Gives the dots of a reading that was set aside their names back, those that have no other now and that nobody rejected.
pub(super) fn take_reading_up(image: &mut ImageEntry, place: usize) {
    let Some(detections) = image.detections.clone() else {
        return;
    };
    let reading = &detections.codes[place];
    let rejected = Arc::clone(&image.rejected_dots);
    let labels = Arc::make_mut(&mut image.labels);
    let points = PointId::of_code(reading.family, reading.id);
    let named = reading.dots.iter().zip(points);
    // What the operator said of a dot stands.
    for (dot, point) in named.filter(|(dot, _)| !rejected.contains_key(dot)) {
        labels.entry(*dot).or_insert(Label {
            point,
            source: Source::Automatic,
            rejected: None,
        });
    }
    Arc::make_mut(&mut image.set_aside).remove(&place);
}

/// Names given by the operator that this adjustment did not use: they stay, and the operator reads why they do not help.
pub(super) fn operators_labels_not_used(network: &Network, stage: Stage) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (id, image) in network.used_images() {
        for label in image.labels.values() {
            let by_operator = label.source == Source::Operator;
            let Some(reason) = label.rejected.as_ref().filter(|_| by_operator) else {
                continue;
            };
            if !label.is_rejected_by_operator() {
                let name = network.label(label.point);
                findings.push(Finding {
                    stage,
                    kind: FindingKind::RejectedObservation,
                    about: About::Image(id),
                    text: format!(
                        "{}: {name}, named by hand, is not used: {reason}",
                        image.file.path
                    ),
                });
            }
        }
    }
    findings
}

/// Points that the operator named and that have no coordinates get them where their rays meet: identification does not
/// touch what the operator named, and an image that is connected already is not connected again.
pub(super) fn intersect_operators_points(network: &mut Network) {
    let waiting = network.oriented_images().any(|(_, image, _)| {
        image.used_labels().any(|(_, label)| {
            label.source == Source::Operator && !network.points.contains_key(&label.point)
        })
    });
    if waiting {
        intersect_new_points(network);
    }
}

/// A finding for each reading that was set aside for this reason, by image and place.
pub(super) fn codes_set_aside(network: &Network, stage: Stage, reason: &str) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (id, image) in network.used_images() {
        let Some(detections) = &image.detections else {
            continue;
        };
        for (&place, why) in image.set_aside.iter() {
            let Some(reading) = detections.codes.get(place).filter(|_| why == reason) else {
                continue;
            };
            let label = reading.family.code_label(reading.id);
            findings.push(Finding {
                stage,
                kind: FindingKind::DoubtfulCode,
                about: About::Image(id),
                text: format!("{}: {label} is set aside: {reason}", image.file.path),
            });
        }
    }
    findings
}
