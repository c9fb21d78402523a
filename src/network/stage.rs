//! Names of the six stages, what became of them, and what they noticed.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::{ImageId, PointId};

/// The six stages of a measurement, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// Find targets and read codes in every image.
    Detect,
    /// Orient the first two images.
    FirstPair,
    /// Connect the other images, one by one.
    Connect,
    /// Free-network adjustment of the codes.
    AdjustCodes,
    /// Name the plain targets.
    Identify,
    /// Final free-network adjustment.
    Adjust,
}

impl Stage {
    /// All stages in order.
    pub const ALL: [Stage; 6] = [
        Stage::Detect,
        Stage::FirstPair,
        Stage::Connect,
        Stage::AdjustCodes,
        Stage::Identify,
        Stage::Adjust,
    ];
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Stage::Detect => "detect",
            Stage::FirstPair => "first-pair",
            Stage::Connect => "connect",
            Stage::AdjustCodes => "adjust-codes",
            Stage::Identify => "identify",
            Stage::Adjust => "adjust",
        })
    }
}

/// A name that is no stage.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "found stage '{0}', expected detect, first-pair, connect, adjust-codes, identify or adjust"
)]
pub struct UnknownStage(String);

impl FromStr for Stage {
    type Err = UnknownStage;

    fn from_str(s: &str) -> Result<Self, Self::Err> {
        Stage::ALL
            .into_iter()
            .find(|stage| stage.to_string() == s)
            .ok_or_else(|| UnknownStage(s.into()))
    }
}

/// How a stage ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// Everything it was to do is done.
    Done,
    /// It ended, but something was left out; the findings say what.
    Incomplete,
    /// It could not be done; the findings say why.
    Failed,
    /// The operator stopped it.
    Interrupted,
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Outcome::Done => "done",
            Outcome::Incomplete => "incomplete",
            Outcome::Failed => "failed",
            Outcome::Interrupted => "interrupted",
        })
    }
}

/// A stage that ended, and the inputs it worked on; it stands while they stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Conclusion {
    /// [`super::Network::inputs`] at that time.
    pub basis: u64,
    /// How it ended.
    pub outcome: Outcome,
}

/// What a finding is about.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum About {
    /// The whole measurement.
    Project,
    /// An image.
    Image(ImageId),
    /// A point.
    Point(PointId),
    /// A scale bar, by name.
    Bar(String),
    /// A camera, by name.
    Camera(String),
}

/// The class of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FindingKind {
    /// An image could not be read.
    UnreadableImage,
    /// An image could not be connected.
    UnconnectedImage,
    /// A code reading does not fit the network or is doubtful.
    DoubtfulCode,
    /// Observations were rejected.
    RejectedObservation,
    /// Something about a scale bar.
    ScaleBar,
    /// Something about the camera.
    Camera,
    /// Something about the reference cross.
    Cross,
    /// The connectivity of the network is weak.
    Connectivity,
    /// The frame that was asked for cannot be had.
    Frame,
    /// A stage could not do its work.
    StageFailed,
    /// What another program has otherwise than this one; it stands as long as the project.
    Import,
}

/// Doubtful data: the work goes on, the operator reads it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// The stage that noticed it.
    pub stage: Stage,
    /// Its class.
    pub kind: FindingKind,
    /// What it is about.
    pub about: About,
    /// One sentence for the operator.
    pub text: String,
}
