//! What panels ask for; one place applies it after the frame.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

use super::app::Command;
use crate::network::{AmbiguousGroup, ImageId, PointId, Reading, Stage};
use crate::project::edit::Edit;
use crate::project::making::ProjectPlan;
use crate::targets::DotIndex;

/// What the operator has selected; shared by images, 3D view and tables.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// The selected point.
    pub point: Option<PointId>,
    /// The selected image.
    pub image: Option<ImageId>,
    /// The selected dot of an image.
    pub dot: Option<(ImageId, DotIndex)>,
    /// A place of an image (px) where there is no dot yet: a target that was missed.
    pub place: Option<(ImageId, [f64; 2])>,
    /// Dots whose readings exclude each other.
    pub question: Option<Question>,
}

/// A group of dots that waits for a decision, and the reading that is looked at.
#[derive(Clone, Debug, PartialEq)]
pub struct Question {
    /// The group.
    pub group: Arc<AmbiguousGroup>,
    /// Place of the reading in hand.
    pub in_hand: usize,
}

impl Question {
    /// The reading in hand.
    #[must_use]
    pub fn reading(&self) -> Option<&Reading> {
        self.group.readings.get(self.in_hand)
    }
}

/// How far to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunRequest {
    /// One step of the next stage that has one.
    Step,
    /// The next stage that is not done.
    Stage,
    /// Everything up to and including this stage.
    Until(Stage),
}

/// What a panel, a key or a menu asks for.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// A command of the menus.
    Do(Command),
    /// Open a project file.
    Open(PathBuf),
    /// Files or folders were dropped on the window.
    Dropped(Vec<PathBuf>),
    /// Make a project.
    Make(Box<ProjectPlan>),
    /// Something that was under way ended with this line for the operator.
    Say(String),
    /// Something could not be done, for this reason.
    Refuse(String),
    /// A dialog of the system answered the form that asked.
    Chosen {
        /// Number of the form.
        form: u64,
        /// The answer.
        path: PathBuf,
    },
    /// Save a copy of the project.
    SaveCopy(PathBuf),
    /// Name the targets by this list of approximate coordinates.
    NameByList(PathBuf),
    /// Look for missing pictures in this folder.
    FindPictures(PathBuf),
    /// Run stages.
    Run(RunRequest),
    /// Stop what runs.
    Interrupt,
    /// Change the document.
    Edit(Edit),
    /// Select something.
    Select(Selection),
    /// Select these points together; none: let them go.
    Group(BTreeSet<PointId>),
    /// Select something and bring it into view.
    LookAt(Selection),
    /// As that, and open the list of labels of its dot, or of what is measured at its place.
    EditLabel(Selection),
}
