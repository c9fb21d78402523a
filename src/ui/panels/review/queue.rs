//! Review items of all images, found a few images a frame and kept for each image until it is another.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

use super::items::{ReviewItem, in_order, items_of_image};
use super::questions::question_items;
use crate::network::{
    AdjustmentResult, AmbiguousGroup, CameraEntry, CameraId, ImageEntry, ImageId, Network, Point,
    PointId,
};
use crate::ui::image_view::Directions;
use crate::ui::panels::basis::is_same;

/// Points predicted in one frame, about two milliseconds of one core.
const PREDICTIONS_A_FRAME: usize = 20_000;

/// What every image's items depend on.
struct Common {
    cameras: Arc<BTreeMap<CameraId, Arc<CameraEntry>>>,
    points: Arc<BTreeMap<PointId, Arc<Point>>>,
    names: Arc<BTreeMap<u32, String>>,
    adjustment: Option<Arc<AdjustmentResult>>,
    /// Edits change single labels, which turns no mean direction by much: they need not be found again.
    directions: Arc<Directions>,
}

struct Found {
    image: Arc<ImageEntry>,
    items: Vec<Arc<ReviewItem>>,
}

/// Questions, which hang on several images.
struct Questions {
    groups: Arc<Vec<AmbiguousGroup>>,
    images: Arc<BTreeMap<ImageId, Arc<ImageEntry>>>,
    names: Arc<BTreeMap<u32, String>>,
    items: Vec<Arc<ReviewItem>>,
}

impl Questions {
    fn of(network: &Network) -> Self {
        Self {
            groups: network.ambiguous.clone(),
            images: network.images.clone(),
            names: network.names.clone(),
            items: question_items(network).into_iter().map(Arc::new).collect(),
        }
    }

    fn hold(&self, network: &Network) -> bool {
        Arc::ptr_eq(&self.groups, &network.ambiguous)
            && Arc::ptr_eq(&self.images, &network.images)
            && Arc::ptr_eq(&self.names, &network.names)
    }
}

/// The items found so far.
#[derive(Default)]
pub(super) struct Queue {
    common: Option<Common>,
    questions: Option<Questions>,
    found: BTreeMap<ImageId, Found>,
    sorted: Vec<Arc<ReviewItem>>,
}

impl Queue {
    /// The items, best evidence first; complete where no image is left.
    pub(super) fn items(&self) -> &[Arc<ReviewItem>] {
        &self.sorted
    }

    /// Images that wait to be looked through; `None` where there is none.
    pub(super) fn images_left(&self, network: &Network) -> Option<usize> {
        let left = network
            .used_images()
            .count()
            .saturating_sub(self.found.len());
        (left > 0).then_some(left)
    }

    /// Looks through as many images as a frame has time for.
    pub(super) fn advance(&mut self, network: &Network) {
        let stands = self.common.as_ref().is_some_and(|c| c.holds(network));
        if !stands {
            self.common = Some(Common::of(network));
            self.found.clear();
        }
        let before = self.found.len();
        let present = |id: &ImageId, found: &Found| {
            let image = network.images.get(id);
            image.is_some_and(|i| Arc::ptr_eq(i, &found.image))
        };
        self.found.retain(|id, found| present(id, found));
        let mut changed = !stands || self.found.len() != before;
        if !self.questions.as_ref().is_some_and(|q| q.hold(network)) {
            self.questions = Some(Questions::of(network));
            changed = true;
        }
        let directions = self
            .common
            .as_ref()
            .map(|c| Arc::clone(&c.directions))
            .unwrap_or_default();
        let mut predictions = 0;
        for (id, _) in network.used_images() {
            if predictions >= PREDICTIONS_A_FRAME {
                break;
            }
            if let Entry::Vacant(place) = self.found.entry(id) {
                let image = network.images[&id].clone();
                let items = items_of_image(network, id, &image, &directions);
                let items = items.into_iter().map(Arc::new).collect();
                place.insert(Found { image, items });
                predictions += network.points.len();
                changed = true;
            }
        }
        if changed && self.images_left(network).is_none() {
            let of_images = self.found.values().flat_map(|found| &found.items);
            let questions = self.questions.iter().flat_map(|questions| &questions.items);
            self.sorted = of_images.chain(questions).cloned().collect();
            self.sorted.sort_by(|a, b| in_order(a, b));
        }
    }
}

impl Common {
    fn of(network: &Network) -> Self {
        Self {
            cameras: network.cameras.clone(),
            points: network.points.clone(),
            names: network.names.clone(),
            adjustment: network.adjustment.clone(),
            directions: Arc::new(Directions::of(network)),
        }
    }

    fn holds(&self, network: &Network) -> bool {
        is_same(&self.adjustment, &network.adjustment)
            && Arc::ptr_eq(&self.cameras, &network.cameras)
            && Arc::ptr_eq(&self.points, &network.points)
            && Arc::ptr_eq(&self.names, &network.names)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ui::panels::fixture::network;
    use crate::ui::panels::review::review_items;

    #[test]
    fn the_queue_holds_what_the_plain_function_finds() {
        let mut network = network();
        let mut queue = Queue::default();
        queue.advance(&network);
        assert!(queue.images_left(&network).is_none());
        let found = |queue: &Queue| -> Vec<ReviewItem> {
            queue.items().iter().map(|i| i.as_ref().clone()).collect()
        };
        assert_eq!(found(&queue), review_items(&network));
        assert!(!queue.items().is_empty());
        network.names = Arc::new(BTreeMap::from([(1, "edge".to_owned())]));
        queue.advance(&network);
        assert_eq!(found(&queue), review_items(&network), "by its new name");
        network.image_mut(ImageId(1)).labels = Arc::default();
        queue.advance(&network);
        assert_eq!(found(&queue), review_items(&network));
    }
}
