//! Images that cannot be joined to the oriented ones but belong together: a block of their own.
//!
//! Two blocks without common points have no common frame: their seven motions against each other are in no picture. The larger one
//! is the network; of the other it is found out whether it holds together and which codes a picture between the two must show.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::first_pair;
use super::pair::DOTS_FOR_A_PAIR;
use super::{Halt, connect};
use crate::monitor::Monitor;
use crate::network::{Attempt, Code, ImageId, Network, PointId};

/// Codes of each block that are named for the picture between them.
const CODES_NAMED: usize = 4;

/// The largest group of images that nothing was tried with and that show enough common points; only where others are oriented.
///
/// Cost: labelled dots of the images that are left, and points times the squared number of those that show each.
pub(super) fn next(network: &Network) -> Option<Vec<ImageId>> {
    if network.oriented_images().count() < 2 {
        return None;
    }
    let untried = network.used_images().filter(|(_, image)| {
        let tried = image.attempt.as_ref();
        image.station.is_none()
            && image.detections.is_some()
            && tried.is_none_or(|attempt| attempt.basis != network.inputs)
    });
    let mut shown_in: BTreeMap<PointId, BTreeSet<ImageId>> = BTreeMap::new();
    for (id, image) in untried {
        for (_, label) in image.used_labels() {
            shown_in.entry(label.point).or_default().insert(id);
        }
    }
    let mut common: BTreeMap<[ImageId; 2], usize> = BTreeMap::new();
    for images in shown_in.values() {
        for &first in images {
            for &second in images.range(first..).skip(1) {
                *common.entry([first, second]).or_default() += 1;
            }
        }
    }
    common.retain(|_, dots| *dots >= DOTS_FOR_A_PAIR);
    let mut groups = Vec::new();
    while let Some((&[seed, _], _)) = common.first_key_value() {
        let group = reached(seed, &common);
        common.retain(|[first, _], _| !group.contains(first));
        groups.push(group);
    }
    // Of equal ones the first.
    let largest = groups.into_iter().rev().max_by_key(BTreeSet::len)?;
    Some(largest.into_iter().collect())
}

/// All images that links lead to.
fn reached(seed: ImageId, links: &BTreeMap<[ImageId; 2], usize>) -> BTreeSet<ImageId> {
    let mut group = BTreeSet::from([seed]);
    loop {
        let before = group.len();
        for pair in links.keys() {
            if pair.iter().any(|id| group.contains(id)) {
                group.extend(pair);
            }
        }
        if group.len() == before {
            return group;
        }
    }
}

/// Orients these images by themselves and writes down what they are; where they are more than the oriented ones, they take their place.
pub(super) fn run(network: Network, ids: &[ImageId], monitor: &Monitor) -> Result<Network, Halt> {
    let block = match oriented(&network, ids, monitor) {
        Ok(block) => block,
        Err(Halt::Interrupted) => return Err(Halt::Interrupted),
        Err(Halt::Failed(error)) => {
            let mut network = network;
            let reason = format!(
                "it shares too few points with the oriented images, and {} images like it give no block of their own: {error}",
                ids.len()
            );
            refuse(&mut network, ids, &reason);
            return Ok(network);
        }
    };
    let count = |network: &Network| network.oriented_images().count();
    let (mut larger, smaller) = if count(&block) > count(&network) {
        (replaced(&network, &block), network)
    } else {
        (network, block)
    };
    let apart: Vec<ImageId> = smaller.oriented_images().map(|(id, ..)| id).collect();
    let reason = format!(
        "it belongs to a block of its own, {} images with {} points, that shares too few codes with the {} oriented images: a picture \
         that shows {} and {} would join them, or exclude the others to measure it by itself",
        apart.len(),
        smaller.points.len(),
        count(&larger),
        names(&larger),
        names(&smaller),
    );
    refuse(&mut larger, &apart, &reason);
    let left: Vec<ImageId> = ids
        .iter()
        .copied()
        .filter(|id| larger.images[id].station.is_none() && !apart.contains(id))
        .collect();
    refuse(
        &mut larger,
        &left,
        "it shares too few points with the oriented images",
    );
    Ok(larger)
}

/// The network of these images alone.
fn oriented(network: &Network, ids: &[ImageId], monitor: &Monitor) -> Result<Network, Halt> {
    let mut block = network.clone();
    Arc::make_mut(&mut block.images).retain(|id, _| ids.contains(id));
    block.connection_order = Arc::default();
    block.points = Arc::default();
    first_pair::orient(&mut block, monitor)?;
    while let Some(wave) = connect::next(&block) {
        block = connect::run(block, &wave, monitor)?;
    }
    Ok(block)
}

/// The network with a block in the place of what was oriented.
fn replaced(network: &Network, block: &Network) -> Network {
    let mut replaced = network.clone();
    let ids: Vec<ImageId> = network.images.keys().copied().collect();
    for id in ids {
        match block.images.get(&id) {
            Some(image) => *replaced.image_mut(id) = image.as_ref().clone(),
            None if network.images[&id].station.is_some() => {
                replaced.image_mut(id).station = None;
            }
            None => {}
        }
    }
    replaced.cameras = Arc::clone(&block.cameras);
    replaced.points = Arc::clone(&block.points);
    replaced.connection_order = Arc::clone(&block.connection_order);
    replaced.moved_by = block.moved_by;
    replaced
}

fn refuse(network: &mut Network, ids: &[ImageId], reason: &str) {
    let oriented = network.oriented_images().count();
    for &id in ids {
        let attempt = Attempt {
            basis: network.inputs,
            known_points: super::bundle::known_points(network, &network.images[&id]),
            oriented,
            knowledge: network.knowledge(),
            reason: reason.to_owned(),
        };
        network.image_mut(id).attempt = Some(attempt);
    }
}

/// The codes that most images of a block show.
fn names(network: &Network) -> String {
    let mut shown: BTreeMap<Code, BTreeSet<ImageId>> = BTreeMap::new();
    for (id, image, _) in network.oriented_images() {
        for (_, label) in image.used_labels() {
            if let Some(code) = label.point.code() {
                shown.entry(code).or_default().insert(id);
            }
        }
    }
    let mut codes: Vec<(usize, Code)> = shown
        .into_iter()
        .map(|(code, images)| (images.len(), code))
        .collect();
    codes.sort_by_key(|(images, code)| (std::cmp::Reverse(*images), *code));
    let labels = codes.iter().take(CODES_NAMED);
    let labels: Vec<String> = labels
        .map(|(_, (family, code))| family.code_label(*code))
        .collect();
    labels.join(", ")
}
