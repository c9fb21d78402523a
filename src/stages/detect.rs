//! Detection: targets and codes of every image, a batch of images a step.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use rayon::prelude::*;

use super::{Advance, Halt, Pictures, Step};
use crate::monitor::Monitor;
use crate::network::{
    About, Connectivity, Finding, FindingKind, ImageEntry, ImageId, Label, MeasurementSettings,
    Network, PointId, Source, Stage,
};
use crate::targets::{DetectSettings, Detections, Dot420Settings, DotIndex, Family, detect};

/// The images of the next step: the first ones without detections, a batch of them.
pub(super) fn next(network: &Network) -> Option<Step> {
    let batch: Vec<ImageId> = network
        .used_images()
        .filter(|(_, image)| image.detections.is_none() && image.unreadable.is_none())
        .map(|(id, _)| id)
        .take(network.settings.detection_batch.max(1))
        .collect();
    (!batch.is_empty()).then_some(Step::Detect(batch))
}

/// Detects targets in a batch of images; an interrupt keeps the images that were finished.
///
/// Cost: pixels of the batch; memory: one picture a thread.
pub(super) fn run(
    mut network: Network,
    images: &[ImageId],
    pictures: &dyn Pictures,
    monitor: &Monitor,
) -> Result<Advance, Halt> {
    let task = monitor.task("detecting targets", images.len() as u64);
    let settings = detect_settings(&network.settings);
    let found: Vec<Option<Result<Detections, String>>> = images
        .par_iter()
        .map(|id| {
            task.step().ok()?;
            let image = &network.images[id];
            Some(
                pictures
                    .load(image)
                    .map(|picture| detect(&picture, &network.settings.families, &settings)),
            )
        })
        .collect();
    let complete = found.iter().all(Option::is_some);
    if !complete && found.iter().all(Option::is_none) {
        return Err(Halt::Interrupted);
    }
    for (&id, found) in images.iter().zip(found) {
        let Some(found) = found else { continue };
        let image = network.image_mut(id);
        match found {
            Ok(detections) => adopt(image, detections),
            Err(reason) => image.unreadable = Some(reason),
        }
        // One a picture, not one a batch: an interrupted batch must count as much as a whole one.
        network.inputs += 1;
    }
    Ok(Advance { network, complete })
}

/// The settings of detection that the measurement's settings ask for.
fn detect_settings(settings: &MeasurementSettings) -> DetectSettings {
    let sizes = settings.targets.of(Family::Dot420);
    DetectSettings {
        dot420: Dot420Settings {
            pitch_mm: sizes.pitch_mm,
            dot_mm: sizes.dot_mm,
            ..Dot420Settings::default()
        },
        ..DetectSettings::default()
    }
}

/// Puts detections into an image and names the dots of its codes.
///
/// Where two readings claim one dot or one number, the one with the smaller misfit gets the labels.
fn adopt(image: &mut ImageEntry, detections: Detections) {
    let mut labels: BTreeMap<DotIndex, Label> = BTreeMap::new();
    let mut named: BTreeSet<PointId> = BTreeSet::new();
    let mut order: Vec<usize> = (0..detections.codes.len()).collect();
    order.sort_by(|&a, &b| {
        let [a, b] = [a, b].map(|place| &detections.codes[place]);
        a.doubt
            .is_some()
            .cmp(&b.doubt.is_some())
            .then(a.misfit.total_cmp(&b.misfit))
    });
    for place in order {
        let reading = &detections.codes[place];
        let points = PointId::of_code(reading.family, reading.id);
        let free = reading.dots.iter().all(|dot| !labels.contains_key(dot))
            && points.iter().all(|point| !named.contains(point));
        if !free {
            continue;
        }
        for (&dot, &point) in reading.dots.iter().zip(&points) {
            labels.insert(
                dot,
                Label {
                    point,
                    source: Source::Automatic,
                    rejected: None,
                },
            );
            named.insert(point);
        }
    }
    image.labels = Arc::new(labels);
    image.detections = Some(Arc::new(detections));
}

/// What the operator should know after detection: unreadable and empty images, images with too few codes.
pub(super) fn findings(network: &Network) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut note = |kind, id, text| {
        findings.push(Finding {
            stage: Stage::Detect,
            kind,
            about: About::Image(id),
            text,
        });
    };
    for (id, image) in network.used_images() {
        if let Some(reason) = &image.unreadable {
            note(FindingKind::UnreadableImage, id, reason.clone());
        }
        for reading in image.detections.iter().flat_map(|d| &d.codes) {
            if let Some(doubt) = &reading.doubt {
                let label = reading.family.code_label(reading.id);
                note(
                    FindingKind::DoubtfulCode,
                    id,
                    format!("{}: {label}: {doubt}", image.file.path),
                );
            }
        }
    }
    for image in Connectivity::of(network).images {
        let entry = &network.images[&image.image];
        if image.missing > 0 && entry.detections.is_some() {
            let text = format!(
                "{}: {} codes, {} more that other images show are needed to connect it by codes",
                entry.file.path,
                image.codes.len(),
                image.missing
            );
            note(FindingKind::Connectivity, image.image, text);
        }
    }
    findings
}
