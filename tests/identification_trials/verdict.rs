//! What became of a random field of targets.

use std::collections::{BTreeMap, BTreeSet};

use tiepoint::imaging::GreyImage;
use tiepoint::monitor::Monitor;
use tiepoint::network::{CodeDot, ImageEntry, Network, PointId, Stage};
use tiepoint::stages::{Advance, Halt, Pictures};
use tiepoint::targets::{DotIndex, Family};

use super::scene::Scene;
use super::table::Truth;

/// Pictures that nobody may ask for.
pub(crate) struct NoPictures;

impl Pictures for NoPictures {
    fn load(&self, image: &ImageEntry, _monitor: &Monitor) -> Result<GreyImage, String> {
        Err(format!("{}: a trial has no pictures", image.file.path))
    }
}

/// All steps of a stage without pictures, and its conclusion.
pub(crate) fn concluded(network: Network, stage: Stage) -> Network {
    concluded_with(network, stage, &NoPictures)
}

/// All steps of a stage, and its conclusion.
pub(crate) fn concluded_with(
    mut network: Network,
    stage: Stage,
    pictures: &dyn Pictures,
) -> Network {
    while let Some(step) = stage.next(&network) {
        match step.run(&network, pictures, &Monitor::new()) {
            Ok(Advance { network: after, .. }) => network = after,
            Err(Halt::Failed(error)) => return stage.conclude(&network, Some(&error)),
            Err(Halt::Interrupted) => unreachable!("nobody interrupts"),
        }
    }
    stage.conclude(&network, None)
}

/// The stages up to the adjustment of the codes.
pub(crate) fn oriented(network: &Network) -> Network {
    let stages = [Stage::FirstPair, Stage::Connect, Stage::AdjustCodes];
    stages.into_iter().fold(network.clone(), concluded)
}

/// The stages that identify and adjust everything.
pub(crate) fn identified(network: &Network) -> Network {
    let stages = [Stage::Identify, Stage::Adjust];
    stages.into_iter().fold(network.clone(), concluded)
}

/// How the dots of a measurement fared.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Verdict {
    pub(crate) images: usize,
    pub(crate) oriented: usize,
    /// Detected dots of targets and codes that are detected in three images or more.
    pub(crate) identifiable: usize,
    /// Those of them that have the right label.
    pub(crate) labelled: usize,
    /// Of these, rejected by the final adjustment.
    pub(crate) rejected: usize,
    /// Wrong labels that the final adjustment uses.
    pub(crate) wrong_used: usize,
    /// Wrong labels that it rejects.
    pub(crate) wrong_rejected: usize,
    /// Points beyond the first of one target.
    pub(crate) split: usize,
    /// Why identifiable dots stay without a label, with how many.
    pub(crate) reasons: BTreeMap<String, usize>,
}

impl Verdict {
    pub(crate) fn of(scene: &Scene, network: &Network) -> Self {
        let mut seen: BTreeMap<Truth, usize> = BTreeMap::new();
        for truth in scene.truth.values().flatten() {
            *seen.entry(*truth).or_default() += 1;
        }
        let owners = owners(scene, network);
        // A name in an image that is not oriented, of a code which no other shows, is no point yet.
        let mut points = owners.clone();
        points.retain(|point, _| network.points.contains_key(point));
        let mut verdict = Self {
            images: scene.truth.len(),
            oriented: network.oriented_images().count(),
            split: split(&points),
            ..Self::default()
        };
        for (id, truths) in &scene.truth {
            let image = &network.images[id];
            for (slot, truth) in truths.iter().enumerate() {
                let dot = DotIndex(slot as u32);
                let label = image.labels.get(&dot);
                let right = label
                    .is_some_and(|l| *truth != Truth::False && owners.get(&l.point) == Some(truth));
                if let Some(label) = label.filter(|_| !right) {
                    if label.rejected.is_none() {
                        verdict.wrong_used += 1;
                    } else {
                        verdict.wrong_rejected += 1;
                    }
                }
                if *truth == Truth::False || seen[truth] < 3 {
                    continue;
                }
                verdict.identifiable += 1;
                if right {
                    verdict.labelled += 1;
                    verdict.rejected += usize::from(label.is_some_and(|l| l.rejected.is_some()));
                } else {
                    let reason = image.unlabelled.get(&dot).cloned();
                    let reason = reason.unwrap_or_else(|| "no reason".into());
                    let words: String = reason
                        .chars()
                        .map(|c| if c.is_ascii_digit() { '#' } else { c })
                        .collect();
                    *verdict.reasons.entry(words).or_default() += 1;
                }
            }
        }
        verdict
    }

    pub(crate) fn missed(&self) -> usize {
        self.identifiable - self.labelled
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.images += other.images;
        self.oriented += other.oriented;
        self.identifiable += other.identifiable;
        self.labelled += other.labelled;
        self.rejected += other.rejected;
        self.wrong_used += other.wrong_used;
        self.wrong_rejected += other.wrong_rejected;
        self.split += other.split;
        for (reason, count) in &other.reasons {
            *self.reasons.entry(reason.clone()).or_default() += count;
        }
    }
}

/// What each point of a measurement is.
fn owners(scene: &Scene, network: &Network) -> BTreeMap<PointId, Truth> {
    let mut votes = Votes::new();
    for (id, image) in network.images.iter() {
        for (dot, label) in image.labels.iter() {
            let truth = scene.truth[id][dot.slot()];
            *votes
                .entry(label.point)
                .or_default()
                .entry(truth)
                .or_default() += 1;
        }
    }
    owners_by(&votes)
}

/// How many dots of each kind the labels of each point stand on.
pub(crate) type Votes = BTreeMap<PointId, BTreeMap<Truth, usize>>;

/// What each point is: codes by their names, plain targets by most of their dots.
pub(crate) fn owners_by(votes: &Votes) -> BTreeMap<PointId, Truth> {
    let owner = |(point, votes): (&PointId, &BTreeMap<Truth, usize>)| {
        let most = votes.iter().max_by_key(|(_, count)| **count);
        let truth = match *point {
            PointId::Code {
                family: Family::Dot420,
                code,
                dot,
            } => {
                let place = CodeDot::ALL.iter().position(|d| *d == dot);
                Truth::Code(code, place.unwrap_or_default())
            }
            _ => most.map_or(Truth::False, |(truth, _)| *truth),
        };
        (*point, truth)
    };
    votes.iter().map(owner).collect()
}

/// Points beyond the first of one target.
pub(crate) fn split(owners: &BTreeMap<PointId, Truth>) -> usize {
    let mut known = BTreeSet::new();
    owners
        .values()
        .filter(|truth| **truth != Truth::False)
        .filter(|truth| !known.insert(**truth))
        .count()
}
