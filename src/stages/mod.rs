//! The six stages of a measurement (Hattori et al., 2002), each a sequence of steps.
//!
//! A step is a pure function of the network: it gets a value and returns a new one, so an interrupt, an error or a panic
//! leaves no trace. Which step comes next follows from the network alone; "step", "run stage", "run all", "interrupt",
//! "mend by hand, go on" and "reopen tomorrow, go on" are therefore one mechanism.
//!
//! Deliberately absent: files (a step asks [`Pictures`]), clocks, and randomness without a seed from the settings.

mod adjust;
mod ambiguous;
#[cfg(test)]
mod ambiguous_tests;
#[cfg(test)]
mod block_tests;
mod blocks;
mod bundle;
mod by_hand;
mod by_pair;
#[cfg(test)]
mod by_pair_tests;
mod chance;
#[cfg(test)]
mod circle_tests;
mod circles;
mod code_shape;
mod components;
mod connect;
mod detect;
mod device;
mod distance_search;
mod first_pair;
#[cfg(test)]
mod frame_tests;
mod gross;
mod identify;
#[cfg(test)]
mod identify_tests;
mod lens;
mod look_again;
mod new_camera;
mod pair;
mod resection;
mod scale;
mod set_aside;
mod take_up;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod trial;
mod weak;
mod what_holds;

use std::sync::Arc;

pub use detect::adopt;

use crate::imaging::GreyImage;
use crate::monitor::{Interrupted, Monitor};
use crate::network::{
    About, Conclusion, Finding, FindingKind, ImageEntry, ImageId, Network, Outcome, Stage,
};

/// Where steps get their pictures from.
pub trait Pictures: Sync {
    /// The picture of an image.
    ///
    /// # Errors
    /// One line for the operator: which file, what is wrong with it. Whatever it says where the monitor was interrupted
    /// meanwhile means nothing.
    fn load(&self, image: &ImageEntry, monitor: &Monitor) -> Result<GreyImage, String>;
}

/// One step of a stage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// Detect targets in these images.
    Detect(Vec<ImageId>),
    /// Orient the first two images.
    FirstPair,
    /// Connect these images.
    Connect(Vec<ImageId>),
    /// Orient these images, which share too little with the oriented ones, as a block of their own.
    Block(Vec<ImageId>),
    /// Adjust all codes.
    AdjustCodes,
    /// One pass of identification.
    Identify,
    /// Look in these images for targets that they ought to show.
    LookAgain(Vec<ImageId>),
    /// The final adjustment.
    Adjust,
}

/// What a step achieved.
#[derive(Clone, Debug)]
pub struct Advance {
    /// The network after the step.
    pub network: Network,
    /// `false`: interrupted, the network holds what was finished.
    pub complete: bool,
}

impl Advance {
    fn complete(network: Network) -> Self {
        Self {
            network,
            complete: true,
        }
    }
}

/// Why a step ended without a new network.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Halt {
    /// The operator stopped it.
    #[error("interrupted")]
    Interrupted,
    /// It cannot be done with what there is.
    #[error("{0}")]
    Failed(StageError),
}

impl From<Interrupted> for Halt {
    fn from(_: Interrupted) -> Self {
        Self::Interrupted
    }
}

/// Why a stage cannot do its work.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StageError {
    /// Fewer than two images have targets.
    #[error("found {found} images with targets, at least 2 are needed")]
    TooFewImages {
        /// Images with targets.
        found: usize,
    },
    /// No pair of images could be oriented.
    #[error("no pair of images could be oriented: {reason}")]
    NoFirstPair {
        /// What came nearest.
        reason: String,
    },
    /// The adjustment failed.
    #[error("the adjustment failed: {reason}")]
    Adjustment {
        /// Why.
        reason: String,
    },
}

impl Stage {
    /// What must come first, in the operator's words; `None` where the stage can run.
    #[must_use]
    pub fn missing(self, network: &Network) -> Option<String> {
        let oriented = network.oriented_images().count();
        match self {
            Stage::Detect if network.images.is_empty() => Some("the project has no images".into()),
            Stage::Detect => None,
            Stage::FirstPair => {
                let detected = network.used_images().any(|(_, i)| i.detections.is_some());
                (!detected).then(|| "no image has detected targets yet".into())
            }
            Stage::Connect | Stage::AdjustCodes | Stage::Identify | Stage::Adjust => {
                (oriented < 2).then(|| "no two images are oriented yet".into())
            }
        }
    }

    /// The next step of this stage; `None` where it is done or something is missing.
    #[must_use]
    pub fn next(self, network: &Network) -> Option<Step> {
        let done = network.is_concluded(self) && !adjust::is_lost(network, self);
        if self.missing(network).is_some() || done {
            return None;
        }
        match self {
            Stage::Detect => detect::next(network),
            Stage::FirstPair => (network.oriented_images().count() < 2).then_some(Step::FirstPair),
            Stage::Connect => connect::next(network)
                .map(Step::Connect)
                .or_else(|| blocks::next(network).map(Step::Block)),
            Stage::AdjustCodes if adjust::is_outdated(network, self) => Some(Step::AdjustCodes),
            Stage::AdjustCodes => connect::again(network).map(Step::Connect),
            Stage::Identify => connect::again(network)
                .map(Step::Connect)
                .or_else(|| identify::is_unfinished(network).then_some(Step::Identify))
                .or_else(|| look_again::next(network))
                .or_else(|| identify::has_new_dots(network).then_some(Step::Identify)),
            Stage::Adjust => adjust::is_outdated(network, Stage::Adjust).then_some(Step::Adjust),
        }
    }

    /// Closes a stage that has no next step: findings on what was left out, and the conclusion. What the stage found
    /// when it concluded before is forgotten: what is still true is found again.
    ///
    /// `failure` is the reason of a step that could not be done.
    #[must_use]
    pub fn conclude(self, network: &Network, failure: Option<&StageError>) -> Network {
        let mut network = network.clone();
        let findings = match self {
            Stage::Detect => detect::findings(&network),
            Stage::FirstPair => first_pair::findings(&network),
            Stage::Connect => connect::findings(&network),
            Stage::AdjustCodes | Stage::Adjust => adjust::findings(&network, self),
            Stage::Identify => identify::findings(&network),
        };
        let left_out = findings.iter().any(|f| {
            matches!(
                f.kind,
                FindingKind::UnreadableImage | FindingKind::UnconnectedImage
            )
        });
        Arc::make_mut(&mut network.findings).retain(|finding| !self.judges_anew(finding));
        for finding in findings {
            network.note(finding);
        }
        if self >= Stage::Connect {
            connect::settle_findings(&mut network);
            detect::settle_doubts(&mut network);
        }
        let outcome = match failure {
            Some(error) => {
                network.note(Finding {
                    stage: self,
                    kind: FindingKind::StageFailed,
                    about: About::Project,
                    text: error.to_string(),
                });
                Outcome::Failed
            }
            None if self.missing(&network).is_some() => Outcome::Failed,
            None if left_out => Outcome::Incomplete,
            None => Outcome::Done,
        };
        network.conclusions.insert(
            self,
            Conclusion {
                basis: network.inputs,
                outcome,
            },
        );
        network
    }

    /// Whether the conclusion of this stage takes the place of a finding.
    fn judges_anew(self, finding: &Finding) -> bool {
        if finding.kind == FindingKind::Import {
            return false;
        }
        let own = finding.stage == self;
        // The adjustments themselves say, each time anew, what they could not tell of the lens.
        let of_an_adjustment = matches!(self, Stage::AdjustCodes | Stage::Identify | Stage::Adjust)
            && finding.kind == FindingKind::Camera;
        // The final adjustment judges bars and codes again, with more points.
        let superseded = (self, finding.stage) == (Stage::Adjust, Stage::AdjustCodes)
            && matches!(
                finding.kind,
                FindingKind::ScaleBar
                    | FindingKind::DoubtfulCode
                    | FindingKind::RejectedObservation
                    | FindingKind::Connectivity
            );
        (own && !of_an_adjustment) || superseded
    }
}

impl Step {
    /// What the step does, as an entry of the history.
    #[must_use]
    pub fn title(&self, network: &Network) -> String {
        match self {
            Step::Detect(images) => format!("detect targets in {} images", images.len()),
            Step::FirstPair => "orient the first pair".into(),
            Step::Connect(images) => format!("connect {}", connect::named(network, images)),
            Step::Block(images) => format!("orient {} images by themselves", images.len()),
            Step::AdjustCodes => "adjust the codes".into(),
            Step::Identify => "identify plain targets".into(),
            Step::LookAgain(images) => {
                format!("look for missing targets in {} images", images.len())
            }
            Step::Adjust => "adjust everything".into(),
        }
    }

    /// Does the step.
    ///
    /// # Errors
    /// [`Halt::Interrupted`] when the monitor says so, [`Halt::Failed`] when it cannot be done.
    pub fn run(
        &self,
        network: &Network,
        pictures: &dyn Pictures,
        monitor: &Monitor,
    ) -> Result<Advance, Halt> {
        let mut network = network.clone();
        match self {
            Step::Detect(images) => return detect::run(network, images, pictures, monitor),
            Step::FirstPair => first_pair::run(&mut network, monitor)?,
            Step::Connect(images) => network = connect::run(network, images, monitor)?,
            Step::Block(images) => network = blocks::run(network, images, monitor)?,
            Step::AdjustCodes => adjust::run(&mut network, Stage::AdjustCodes, monitor)?,
            Step::Identify => identify::run(&mut network, monitor)?,
            Step::LookAgain(images) => {
                return look_again::run(network, images, pictures, monitor);
            }
            Step::Adjust => adjust::run(&mut network, Stage::Adjust, monitor)?,
        }
        Ok(Advance::complete(network))
    }
}
