//! Other settings, and what does not stand with them.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::network::{ImageEntry, MeasurementSettings, Network};
use crate::targets::Family;

/// Sets the settings; where other codes are to be looked for, all images are to be detected again.
pub(super) fn set(network: &mut Network, settings: &MeasurementSettings) {
    let detects_anew = !is_detected_alike(&network.settings, settings);
    network.settings = Arc::new(settings.clone());
    if detects_anew {
        forget_detections(network);
    }
}

/// Whether detection finds the same with both.
fn is_detected_alike(one: &MeasurementSettings, other: &MeasurementSettings) -> bool {
    let families = |settings: &MeasurementSettings| {
        let mut families = settings.families.clone();
        families.sort_unstable();
        families
    };
    let sizes = |settings: &MeasurementSettings| {
        let sizes = settings.targets.of(Family::Dot420);
        (sizes.pitch_mm, sizes.dot_mm)
    };
    families(one) == families(other) && sizes(one) == sizes(other)
}

/// Lets go of all dots and of what was made of them. Numbers of targets are not given a second time: a bar may name one.
fn forget_detections(network: &mut Network) {
    let images = network.images.iter().map(|(id, image)| {
        let anew = ImageEntry {
            usage: image.usage,
            ..ImageEntry::new(image.file.clone(), image.camera)
        };
        (*id, Arc::new(anew))
    });
    network.images = Arc::new(images.collect());
    network.points = Arc::default();
    network.tentative = Arc::default();
    network.ambiguous = Arc::default();
    network.moved_by = None;
    network.connection_order = Arc::default();
    network.passes = Arc::default();
    network.conclusions = BTreeMap::new();
    network.findings = Arc::default();
    network.adjustment = None;
}
