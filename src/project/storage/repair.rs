//! What is left of a damaged file made consistent again: nothing refers to what was lost.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::network::{AdjustmentResult, ImageEntry, Network};

/// Removes from a network what refers to lost rows; one line for each thing removed.
pub(super) fn repair(network: &mut Network) -> Vec<String> {
    let mut lines = Vec::new();
    let mut images = BTreeMap::new();
    for (&id, image) in network.images.iter() {
        if !network.cameras.contains_key(&image.camera) {
            lines.push(format!("images {}: left out, its camera is lost", id.0));
            continue;
        }
        let mut image = image.clone();
        if refers_to_lost_dots(&image) {
            let entry = Arc::make_mut(&mut image);
            entry.labels = Arc::default();
            entry.set_aside = Arc::default();
            entry.unlabelled = Arc::default();
            entry.rejected_dots = Arc::default();
            lines.push(format!("marks {}: left out, the detections are lost", id.0));
        }
        images.insert(id, image);
    }
    network.images = Arc::new(images);
    let images = network.images.clone();
    Arc::make_mut(&mut network.connection_order).retain(|id| images.contains_key(id));
    let broken = |adjustment: &Arc<AdjustmentResult>| !fits(adjustment, network);
    if network.adjustment.as_ref().is_some_and(broken) {
        network.adjustment = None;
        lines.push("document adjustment: left out, some of its images are lost".into());
    }
    lines
}

/// Whether marks or code readings name dots that are not there.
fn refers_to_lost_dots(image: &ImageEntry) -> bool {
    let dots = image.detections.as_ref().map_or(0, |d| d.dots.len());
    let codes = image.detections.as_ref().map_or(0, |d| d.codes.len());
    image.labels.keys().any(|dot| dot.slot() >= dots)
        || image.unlabelled.keys().any(|dot| dot.slot() >= dots)
        || image.rejected_dots.keys().any(|dot| dot.slot() >= dots)
        || image.set_aside.keys().any(|&place| place >= codes)
}

/// Whether all that an adjustment speaks of is there.
fn fits(adjustment: &AdjustmentResult, network: &Network) -> bool {
    let cameras = adjustment.cameras.iter().map(|result| result.camera);
    cameras
        .into_iter()
        .all(|id| network.cameras.contains_key(&id))
        && adjustment.observations.iter().all(|observation| {
            let image = network.images.get(&observation.image);
            let dots = image.and_then(|i| i.detections.as_ref());
            dots.is_some_and(|d| observation.dot.slot() < d.dots.len())
                && network.points.contains_key(&observation.point)
        })
}
