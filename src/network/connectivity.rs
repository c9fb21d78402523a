//! The paper's connectivity check: which images share codes, and what is missing to connect them.

use std::collections::{BTreeMap, BTreeSet};

use super::{ImageId, Network};
use crate::targets::Family;

/// A code, by family and number.
pub type Code = (Family, u32);

/// Codes that an image needs to be connected by the closed-form resection.
pub const CODES_TO_CONNECT: usize = 3;

/// One image in the connectivity check.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageConnectivity {
    /// The image.
    pub image: ImageId,
    /// Codes read in it.
    pub codes: BTreeSet<Code>,
    /// Other images with the number of codes shared, where there is at least one.
    pub shared: BTreeMap<ImageId, usize>,
    /// Codes still missing to the three that connect an image to the rest of its block.
    pub missing: usize,
}

/// The image-by-code table of the whole measurement.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Connectivity {
    /// Images in use, by id.
    pub images: Vec<ImageConnectivity>,
    /// Groups of images that are linked through shared codes (three or more between neighbours), largest first.
    pub blocks: Vec<Vec<ImageId>>,
    /// For every code the images that show it.
    pub images_of_code: BTreeMap<Code, BTreeSet<ImageId>>,
}

impl Connectivity {
    /// The table of a network's detections.
    ///
    /// Cost: images squared times codes per image.
    #[must_use]
    pub fn of(network: &Network) -> Self {
        let mut images_of_code: BTreeMap<Code, BTreeSet<ImageId>> = BTreeMap::new();
        let mut codes_of_image: BTreeMap<ImageId, BTreeSet<Code>> = BTreeMap::new();
        for (id, image) in network.used_images() {
            let codes = codes_of_image.entry(id).or_default();
            let Some(detections) = &image.detections else {
                continue;
            };
            for place in 0..detections.codes.len() {
                let code = image.code_of_reading(place);
                if let Some(code) = code.filter(|_| !image.set_aside.contains_key(&place)) {
                    codes.insert(code);
                    images_of_code.entry(code).or_default().insert(id);
                }
            }
        }
        let images = codes_of_image
            .iter()
            .map(|(&image, codes)| {
                let mut shared = BTreeMap::new();
                for code in codes {
                    for &other in images_of_code[code].iter().filter(|&&other| other != image) {
                        *shared.entry(other).or_insert(0) += 1;
                    }
                }
                let elsewhere = codes
                    .iter()
                    .filter(|code| images_of_code[code].len() > 1)
                    .count();
                ImageConnectivity {
                    image,
                    codes: codes.clone(),
                    shared,
                    missing: CODES_TO_CONNECT.saturating_sub(elsewhere),
                }
            })
            .collect::<Vec<_>>();
        let blocks = blocks(&images);
        Self {
            images,
            blocks,
            images_of_code,
        }
    }
}

/// Images linked by at least [`CODES_TO_CONNECT`] shared codes, as connected groups, largest first.
fn blocks(images: &[ImageConnectivity]) -> Vec<Vec<ImageId>> {
    let links: BTreeMap<ImageId, &ImageConnectivity> =
        images.iter().map(|i| (i.image, i)).collect();
    let mut left: BTreeSet<ImageId> = links.keys().copied().collect();
    let mut blocks = Vec::new();
    while let Some(start) = left.pop_first() {
        let mut block = vec![start];
        let mut next = 0;
        while next < block.len() {
            for (&other, &count) in &links[&block[next]].shared {
                if count >= CODES_TO_CONNECT && left.remove(&other) {
                    block.push(other);
                }
            }
            next += 1;
        }
        block.sort_unstable();
        blocks.push(block);
    }
    blocks.sort_by_key(|block| std::cmp::Reverse(block.len()));
    blocks
}
