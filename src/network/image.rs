//! An image of the measurement.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::{Matrix6, SMatrix};
use serde::{Deserialize, Serialize};

use super::{CameraId, Code, Look, PointId};
use crate::geometry::Pose;
use crate::targets::{Detections, DotIndex};

/// An image of the measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ImageId(pub u32);

/// The picture file; the picture itself stays where it is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ImageFile {
    /// Path relative to the project file's folder where it can be, with forward slashes.
    pub path: String,
    /// Size of the file, bytes; 0 where there was none when the image was imported.
    pub size_bytes: u64,
    /// SHA-256 of the file, hexadecimal; empty where there was none when the image was imported.
    pub sha256: String,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
}

/// Whether an image takes part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ImageUse {
    /// It takes part.
    Used,
    /// The operator excluded it.
    Excluded,
}

/// Reason of an operator's rejection, as shown and exported.
pub const REJECTED_BY_OPERATOR: &str = "rejected by the operator";

/// Reason of a dot of which the operator says that no reading is right, as shown and exported.
pub const NO_READING_BY_OPERATOR: &str = "the operator says that none of its readings is right";

/// Reason of a reading that the operator set aside, as shown and exported.
pub const SET_ASIDE_BY_OPERATOR: &str = "set aside by the operator";

/// Who decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// A stage, or another program.
    Automatic,
    /// The operator; no stage overrides it.
    Operator,
}

/// The name of a dot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Label {
    /// The point that the dot is an image of.
    pub point: PointId,
    /// Who named it.
    pub source: Source,
    /// Why the adjustment does not use it; `None` where it is used.
    pub rejected: Option<String>,
}

impl Label {
    /// Whether the operator rejected it. An adjustment may reject what the operator named, for its own computation; the
    /// next one decides that anew.
    #[must_use]
    pub fn is_rejected_by_operator(&self) -> bool {
        self.source == Source::Operator && self.rejected.as_deref() == Some(REJECTED_BY_OPERATOR)
    }
}

/// An exterior orientation with its precision.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Station {
    /// The orientation.
    pub pose: Pose,
    /// A-posteriori covariance of (turn in the camera frame, rad; centre, mm); `None` before an adjustment.
    pub covariance: Option<Matrix6<f64>>,
    /// Its covariance with the ten parameters of the camera; `None` before an adjustment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub with_camera: Option<SMatrix<f64, 6, 10>>,
}

/// An orientation that was tried and failed; it stands until more is known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Attempt {
    /// [`super::Network::inputs`] at that time.
    pub basis: u64,
    /// Known points that the image showed at that time.
    pub known_points: usize,
    /// Images that were oriented at that time: with more of them the points are known better, and it is tried again.
    #[serde(default)]
    pub oriented: usize,
    /// [`super::Network::knowledge`] at that time: with more of it lenses and points are known better, and it is tried again.
    #[serde(default)]
    pub knowledge: usize,
    /// Why it failed, in the operator's words.
    pub reason: String,
}

/// An image with what is known of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageEntry {
    /// The file.
    pub file: ImageFile,
    /// Its camera.
    pub camera: CameraId,
    /// Whether it takes part.
    pub usage: ImageUse,
    /// What detection found; `None` before.
    pub detections: Option<Arc<Detections>>,
    /// Why detection failed (file missing, unreadable); `None` where it did not.
    pub unreadable: Option<String>,
    /// Names of dots.
    pub labels: Arc<BTreeMap<DotIndex, Label>>,
    /// Code readings (by their place in the detections) that do not fit the network, with the reason.
    pub set_aside: Arc<BTreeMap<usize, String>>,
    /// Why dots stay without a name, where identification can say it.
    pub unlabelled: Arc<BTreeMap<DotIndex, String>>,
    /// Dots without a name that the operator rejected, with the reason: no stage looks at them again.
    #[serde(default, skip_serializing_if = "nothing_rejected")]
    pub rejected_dots: Arc<BTreeMap<DotIndex, String>>,
    /// Points of which the operator says that the image does not show them: nobody looks or asks for them here.
    #[serde(default, skip_serializing_if = "nothing_denied")]
    pub not_there: Arc<BTreeSet<PointId>>,
    /// The orientation; `None` while not connected.
    pub station: Option<Station>,
    /// The last orientation that failed.
    pub attempt: Option<Attempt>,
    /// The last look for targets that it ought to show; `None` before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub look: Option<Arc<Look>>,
}

/// Projects without such dots are written as they were before there were any.
fn nothing_rejected(dots: &Arc<BTreeMap<DotIndex, String>>) -> bool {
    dots.is_empty()
}

fn nothing_denied(points: &Arc<BTreeSet<PointId>>) -> bool {
    points.is_empty()
}

impl ImageEntry {
    /// An image of which nothing is known but its file.
    #[must_use]
    pub fn new(file: ImageFile, camera: CameraId) -> Self {
        Self {
            file,
            camera,
            usage: ImageUse::Used,
            detections: None,
            unreadable: None,
            labels: Arc::default(),
            set_aside: Arc::default(),
            unlabelled: Arc::default(),
            rejected_dots: Arc::default(),
            not_there: Arc::default(),
            station: None,
            attempt: None,
            look: None,
        }
    }

    /// Labelled dots that are used, with the dot's place in the detections.
    pub fn used_labels(&self) -> impl Iterator<Item = (DotIndex, &Label)> {
        self.labels
            .iter()
            .filter(|(_, l)| l.rejected.is_none())
            .map(|(d, l)| (*d, l))
    }
    /// The code that a reading stands for: the operator's number where there is one, else the number that was read.
    #[must_use]
    pub fn code_of_reading(&self, reading: usize) -> Option<Code> {
        let code = self.detections.as_ref()?.codes.get(reading)?;
        let named = code.dots.iter().find_map(|dot| {
            let label = self.labels.get(dot)?;
            let (family, number) = label.point.code()?;
            let by_operator = label.source == Source::Operator && family == code.family;
            by_operator.then_some((family, number))
        });
        Some(named.unwrap_or((code.family, code.id)))
    }

    /// Whether the operator gave or confirmed the number of a reading.
    #[must_use]
    pub fn is_reading_of_operator(&self, reading: usize) -> bool {
        let code = self.detections.as_ref().and_then(|d| d.codes.get(reading));
        code.is_some_and(|code| {
            code.dots.iter().any(|dot| {
                self.labels.get(dot).is_some_and(|label| {
                    label.source == Source::Operator && label.point.code().is_some()
                })
            })
        })
    }
}
