//! Two images by themselves: the dots that carry the same label in both, and the relative orientation that they tell.

use std::collections::BTreeMap;

use crate::camera::Camera;
use crate::network::{ImageEntry, ImageId, Network, PointId};
use crate::orientation::relative::{
    PixelPair, RelativeOrientation, RelativeSettings, relative_orientation,
};
use crate::targets::DotIndex;

/// Fewest common labelled dots from which two images are oriented to each other.
pub(super) const DOTS_FOR_A_PAIR: usize = 8;

/// How far a dot may lie from its place by the relative orientation, px; the next one is tried where fewer than
/// [`SHARE_TO_AGREE`] of the dots agree: a nominal lens is off by tens of pixels in the corners.
const TOLERANCES_PX: [f64; 4] = [2.0, 5.0, 12.0, 25.0];

/// Share of the common dots that must agree, else the tolerance counts at which most do.
const SHARE_TO_AGREE: f64 = 0.7;

/// Share without which there is no relative orientation: of six common codes two may be wrong in either image.
const SHARE_NEEDED: f64 = 0.5;

/// Two images and the dots that carry the same label.
pub(super) struct CommonPair {
    pub(super) images: [ImageId; 2],
    pub(super) dots: Vec<[DotIndex; 2]>,
}

impl CommonPair {
    pub(super) fn of(network: &Network, images: [ImageId; 2]) -> Self {
        let [first, second] = images.map(|id| &network.images[&id]);
        Self {
            images,
            dots: common_dots(first, second),
        }
    }

    /// The relative orientation at the tightest tolerance at which most dots agree.
    pub(super) fn oriented(&self, network: &Network) -> Option<RelativeOrientation> {
        let pixels = self.pixels(network)?;
        let entries = self.images.map(|id| &network.images[&id]);
        let cameras: [&Camera; 2] = entries.map(|entry| &network.camera_of(entry).camera);
        let share =
            |found: &RelativeOrientation| found.best.inlier_count as f64 / pixels.len() as f64;
        let mut best: Option<RelativeOrientation> = None;
        for tolerance_px in TOLERANCES_PX {
            let settings = RelativeSettings {
                tolerance_px,
                seed: network.settings.seed,
                ..RelativeSettings::default()
            };
            let Ok(next) = relative_orientation(cameras, &pixels, &settings) else {
                continue;
            };
            let most = best.as_ref().map_or(0, |best| best.best.inlier_count);
            if next.best.inlier_count > most && share(&next) >= SHARE_NEEDED {
                best = Some(next);
            }
            if best
                .as_ref()
                .is_some_and(|best| share(best) >= SHARE_TO_AGREE)
            {
                break;
            }
        }
        best
    }

    /// The places of the common dots in both images; `None` where one has no detections.
    pub(super) fn pixels(&self, network: &Network) -> Option<Vec<PixelPair>> {
        let [first, second] = self
            .images
            .map(|id| network.images[&id].detections.as_ref());
        let (first, second) = (first?, second?);
        let pair = |dots: &[DotIndex; 2]| PixelPair {
            first: first.dots[dots[0].slot()].centre_px,
            second: second.dots[dots[1].slot()].centre_px,
        };
        Some(self.dots.iter().map(pair).collect())
    }
}

/// The dots of two images that carry the same label.
pub(super) fn common_dots(first: &ImageEntry, second: &ImageEntry) -> Vec<[DotIndex; 2]> {
    let in_second: BTreeMap<PointId, DotIndex> = second
        .used_labels()
        .map(|(dot, label)| (label.point, dot))
        .collect();
    first
        .used_labels()
        .filter_map(|(dot, label)| Some([dot, *in_second.get(&label.point)?]))
        .collect()
}
