//! Undo and redo: old values are kept, not inverse commands.
//!
//! Invariant: there is always a present network. What older entries hold beyond their successors is bounded by an
//! estimate of its bytes, and the oldest goes first. An entry keeps its adjustment, which later stages weigh by: going on from what
//! an undo brought back gives the digits that it gave before.

use std::collections::BTreeMap;
use std::mem::{size_of, size_of_val};
use std::sync::Arc;

use crate::network::{
    AdjustmentResult, Finding, IdentificationPass, ImageEntry, ImageId, Label, Network, Point,
    PointId,
};
use crate::targets::{Detections, DotIndex};

/// Bounds of the history.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HistorySettings {
    /// Bytes that older entries may hold beyond the present network; 1 GiB holds dozens of steps of a large project.
    pub bytes: usize,
}

impl Default for HistorySettings {
    fn default() -> Self {
        Self { bytes: 1 << 30 }
    }
}

/// A network after a step or edit.
#[derive(Clone, Debug)]
struct Entry {
    /// What led to it, in the operator's words.
    title: String,
    network: Arc<Network>,
    /// What it holds that its successor does not, bytes.
    extra_bytes: usize,
}

/// A step or edit that was undone or done again.
#[derive(Clone, Debug)]
pub struct Move {
    /// The step or edit, in the operator's words.
    pub title: String,
    /// The network that is now the present one.
    pub network: Arc<Network>,
}

/// The present network with those before it and, after an undo, those after it.
#[derive(Clone, Debug)]
pub struct History {
    settings: HistorySettings,
    /// Oldest first, never empty.
    entries: Vec<Entry>,
    present: usize,
}

impl History {
    /// A history that begins with a network.
    #[must_use]
    pub fn new(network: Arc<Network>, settings: HistorySettings) -> Self {
        Self {
            settings,
            entries: vec![Entry {
                title: String::new(),
                network,
                extra_bytes: 0,
            }],
            present: 0,
        }
    }

    /// The present network.
    #[must_use]
    pub fn present(&self) -> &Arc<Network> {
        &self.entries[self.present].network
    }

    /// Makes `network` the present one; what was undone before is gone.
    pub fn push(&mut self, title: impl Into<String>, network: Arc<Network>) {
        self.entries.truncate(self.present + 1);
        let last = &mut self.entries[self.present];
        last.extra_bytes = bytes_beyond(&last.network, &network);
        self.entries.push(Entry {
            title: title.into(),
            network,
            extra_bytes: 0,
        });
        self.forget_oldest();
        self.present = self.entries.len() - 1;
    }

    /// Makes `network` the present one without an entry of its own: what follows by itself from the last step or edit is
    /// undone with it.
    pub fn amend(&mut self, network: Arc<Network>) {
        if let Some(before) = self.present.checked_sub(1) {
            let before = &mut self.entries[before];
            before.extra_bytes = bytes_beyond(&before.network, &network);
        }
        if let Some(next) = self.entries.get(self.present + 1) {
            let extra_bytes = bytes_beyond(&network, &next.network);
            self.entries[self.present].extra_bytes = extra_bytes;
        }
        self.entries[self.present].network = network;
    }

    /// Back by one; `None` where nothing is left to undo.
    pub fn undo(&mut self) -> Option<Move> {
        let title = self.undo_title()?.to_owned();
        self.present -= 1;
        Some(Move {
            title,
            network: self.present().clone(),
        })
    }

    /// Forward by one; `None` where nothing was undone.
    pub fn redo(&mut self) -> Option<Move> {
        let title = self.redo_title()?.to_owned();
        self.present += 1;
        Some(Move {
            title,
            network: self.present().clone(),
        })
    }

    /// What [`Self::undo`] would undo.
    #[must_use]
    pub fn undo_title(&self) -> Option<&str> {
        self.undo_titles().next()
    }

    /// What [`Self::redo`] would do again.
    #[must_use]
    pub fn redo_title(&self) -> Option<&str> {
        self.redo_titles().next()
    }

    /// What can be undone, latest first.
    pub fn undo_titles(&self) -> impl Iterator<Item = &str> {
        let done = &self.entries[1..=self.present];
        done.iter().rev().map(|entry| entry.title.as_str())
    }

    /// What can be done again, next first.
    pub fn redo_titles(&self) -> impl Iterator<Item = &str> {
        let undone = &self.entries[self.present + 1..];
        undone.iter().map(|entry| entry.title.as_str())
    }

    /// Estimate of what the history holds beyond its newest network, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.entries.iter().map(|entry| entry.extra_bytes).sum()
    }

    fn forget_oldest(&mut self) {
        let mut bytes = self.bytes();
        let mut forgotten = 0;
        while bytes > self.settings.bytes && forgotten + 1 < self.entries.len() {
            bytes -= self.entries[forgotten].extra_bytes;
            forgotten += 1;
        }
        self.entries.drain(..forgotten);
    }
}

fn is_same<T>(a: &Option<Arc<T>>, b: &Option<Arc<T>>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => Arc::ptr_eq(a, b),
        (None, None) => true,
        _ => false,
    }
}

/// Bytes of what `network` holds and `successor` does not share with it.
fn bytes_beyond(network: &Network, successor: &Network) -> usize {
    let mut bytes = size_of::<Network>();
    if !Arc::ptr_eq(&network.points, &successor.points) {
        let points = unshared(&network.points, &successor.points);
        bytes += nodes::<PointId, Point>(&network.points)
            + points.map(|_| size_of::<Point>()).sum::<usize>();
    }
    if !Arc::ptr_eq(&network.images, &successor.images) {
        bytes += nodes::<ImageId, ImageEntry>(&network.images);
        for (id, image) in unshared(&network.images, &successor.images) {
            bytes += bytes_of_image(image, successor.images.get(id).map(Arc::as_ref));
        }
    }
    if let Some(adjustment) = &network.adjustment
        && !is_same(&network.adjustment, &successor.adjustment)
    {
        bytes += bytes_of_adjustment(adjustment);
    }
    if !Arc::ptr_eq(&network.findings, &successor.findings) {
        let findings = network.findings.iter();
        bytes += findings
            .map(|finding| size_of::<Finding>() + finding.text.len())
            .sum::<usize>();
    }
    if !Arc::ptr_eq(&network.passes, &successor.passes) {
        bytes += network.passes.len() * size_of::<IdentificationPass>();
    }
    bytes
}

/// Bytes of the nodes of a table, without what they point to.
fn nodes<K, V>(table: &BTreeMap<K, Arc<V>>) -> usize {
    table.len() * (size_of::<K>() + size_of::<Arc<V>>())
}

/// Rows of a table that another one does not share.
fn unshared<'a, K: Ord, V>(
    table: &'a BTreeMap<K, Arc<V>>,
    other: &'a BTreeMap<K, Arc<V>>,
) -> impl Iterator<Item = (&'a K, &'a V)> {
    table
        .iter()
        .filter(|(key, value)| {
            other
                .get(key)
                .is_none_or(|other| !Arc::ptr_eq(value, other))
        })
        .map(|(key, value)| (key, value.as_ref()))
}

fn bytes_of_image(image: &ImageEntry, successor: Option<&ImageEntry>) -> usize {
    let mut bytes = size_of::<ImageEntry>() + image.file.path.len() + image.file.sha256.len();
    if let Some(detections) = &image.detections
        && !successor.is_some_and(|next| is_same(&image.detections, &next.detections))
    {
        bytes += bytes_of_detections(detections);
    }
    if !successor.is_some_and(|next| Arc::ptr_eq(&image.labels, &next.labels)) {
        let reasons = image.labels.values().filter_map(|l| l.rejected.as_ref());
        bytes += image.labels.len() * size_of::<(DotIndex, Label)>()
            + reasons.map(String::len).sum::<usize>();
    }
    if !successor.is_some_and(|next| Arc::ptr_eq(&image.unlabelled, &next.unlabelled)) {
        let reasons = image.unlabelled.values();
        bytes += reasons
            .map(|reason| size_of::<(DotIndex, String)>() + reason.len())
            .sum::<usize>();
    }
    if !successor.is_some_and(|next| Arc::ptr_eq(&image.set_aside, &next.set_aside)) {
        let reasons = image.set_aside.values();
        bytes += reasons
            .map(|reason| size_of::<(usize, String)>() + reason.len())
            .sum::<usize>();
    }
    bytes
}

fn bytes_of_detections(detections: &Detections) -> usize {
    let codes = detections.codes.iter();
    let rejected = detections.rejected.iter();
    size_of_val(detections.dots.as_slice())
        + size_of_val(detections.codes.as_slice())
        + codes
            .map(|code| {
                size_of_val(code.dots.as_slice()) + code.doubt.as_ref().map_or(0, String::len)
            })
            .sum::<usize>()
        + size_of_val(detections.rejected.as_slice())
        + rejected.map(|r| r.reason.len()).sum::<usize>()
}

fn bytes_of_adjustment(adjustment: &AdjustmentResult) -> usize {
    size_of::<AdjustmentResult>()
        + size_of_val(adjustment.observations.as_slice())
        + size_of_val(adjustment.cameras.as_slice())
        + size_of_val(adjustment.bars.as_slice())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{FrameResult, ScaleSource, Stage};
    use nalgebra::Vector3;

    fn point() -> Point {
        Point {
            position: Vector3::zeros(),
            covariance: None,
            rays: 2,
            circle: None,
        }
    }

    fn adjustment() -> Option<Arc<AdjustmentResult>> {
        Some(Arc::new(AdjustmentResult {
            stage: Stage::Adjust,
            basis: 0,
            sigma0: 1.0,
            sigma0_px: 0.05,
            rms_px: 0.05,
            sigma_station_mm: 0.1,
            redundancy: 10,
            datum: String::new(),
            frame: FrameResult::default(),
            scale_from: ScaleSource::Codes,
            cameras: Vec::new(),
            components: Vec::new(),
            bars: Vec::new(),
            observations: Vec::new(),
        }))
    }

    /// `network` with `inputs` counted up.
    fn next(network: &Network) -> Arc<Network> {
        let mut network = network.clone();
        network.inputs += 1;
        Arc::new(network)
    }

    /// A network with all of `count` points new.
    fn with_points(network: &Network, count: u32) -> Arc<Network> {
        let mut network = network.clone();
        let points = (0..count).map(|n| (PointId::Target(n), Arc::new(point())));
        network.points = Arc::new(points.collect());
        Arc::new(network)
    }

    fn history(bytes: usize) -> History {
        History::new(Arc::default(), HistorySettings { bytes })
    }

    #[test]
    fn undo_and_redo_walk_through_the_same_values() {
        let mut history = history(usize::MAX);
        let mut networks = vec![history.present().clone()];
        for step in 1..=4 {
            networks.push(next(&networks[step - 1]));
            history.push(format!("step {step}"), networks[step].clone());
        }
        assert!(history.redo().is_none());
        for step in (1..=4).rev() {
            let undone = history.undo().unwrap();
            assert_eq!(undone.title, format!("step {step}"));
            assert!(Arc::ptr_eq(&undone.network, &networks[step - 1]));
        }
        assert!(history.undo().is_none());
        let redone = history.redo().unwrap();
        assert_eq!(redone.title, "step 1");
        assert!(Arc::ptr_eq(&redone.network, &networks[1]));
        assert_eq!(history.undo_titles().collect::<Vec<_>>(), ["step 1"]);
        assert_eq!(
            history.redo_titles().collect::<Vec<_>>(),
            ["step 2", "step 3", "step 4"]
        );
    }

    #[test]
    fn a_new_step_after_an_undo_ends_the_redo() {
        let mut history = history(usize::MAX);
        history.push("a", next(history.present()));
        history.push("b", next(history.present()));
        history.undo();
        let other = next(history.present());
        history.push("c", other.clone());
        assert!(history.redo().is_none());
        assert!(Arc::ptr_eq(history.present(), &other));
        assert_eq!(history.undo_titles().collect::<Vec<_>>(), ["c", "a"]);
    }

    #[test]
    fn the_oldest_are_forgotten_and_the_present_stays() {
        let points = 100;
        let step = bytes_beyond(
            &with_points(&Network::default(), points),
            &Network::default(),
        );
        let mut history = history(3 * step);
        for number in 0..10 {
            let network = with_points(history.present(), points);
            history.push(number.to_string(), network);
            assert!(history.bytes() <= 3 * step);
        }
        assert_eq!(history.undo_titles().collect::<Vec<_>>(), ["9", "8", "7"]);
        let mut tight = History::new(history.present().clone(), HistorySettings { bytes: 0 });
        let last = with_points(tight.present(), points);
        tight.push("huge", last.clone());
        assert!(Arc::ptr_eq(tight.present(), &last));
        assert!(tight.undo().is_none());
    }

    #[test]
    fn what_is_shared_is_not_counted() {
        let network = with_points(&Network::default(), 1000);
        let few = bytes_beyond(&network, &next(&network));
        assert_eq!(few, size_of::<Network>());
        let mut moved = network.as_ref().clone();
        Arc::make_mut(&mut moved.points).insert(PointId::Target(0), Arc::new(point()));
        let nodes = nodes::<PointId, Point>(&network.points);
        let one = bytes_beyond(&network, &moved);
        assert_eq!(one, few + nodes + size_of::<Point>());
    }

    #[test]
    fn every_entry_keeps_its_adjustment() {
        let mut history = history(usize::MAX);
        let adjusted = |network: &Network| {
            let mut network = network.clone();
            network.adjustment = adjustment();
            Arc::new(network)
        };
        history.push("adjust", adjusted(history.present()));
        let first = history.present().clone();
        history.push("edit", next(history.present()));
        history.push("adjust again", adjusted(history.present()));
        assert!(!is_same(&history.present().adjustment, &first.adjustment));
        history.undo();
        let undone = history.undo().unwrap().network;
        assert!(Arc::ptr_eq(&undone, &first));
        assert!(is_same(&undone.adjustment, &first.adjustment));
        assert!(undone.adjustment.is_some());
    }
}
