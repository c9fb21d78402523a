//! The second look at an image: for targets that it ought to show.

use std::collections::BTreeMap;
use std::fmt;

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::{ImageEntry, Network, PointId};

/// A second look at an image, with the targets that it ought to show and does not.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Look {
    /// [`super::Network::inputs`] at that time.
    pub basis: u64,
    /// What there was to look for.
    #[serde(default)]
    pub sought: Sought,
    /// Why the picture could not be looked at; `None` where it was.
    pub unreadable: Option<String>,
    /// Targets that are predicted in the image and have no dot there.
    pub absent: BTreeMap<PointId, Absence>,
}

/// What there is to look for in all images: how many points, and how many that two images alone show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sought {
    /// [`super::Network::points`].
    pub points: usize,
    /// [`super::Network::tentative`].
    pub tentative: usize,
}

impl Sought {
    /// What there is in a network.
    #[must_use]
    pub fn of(network: &Network) -> Self {
        Self {
            points: network.points.len(),
            tentative: network.tentative.len(),
        }
    }
}

/// A target that an image ought to show and does not.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Absence {
    /// Where it is predicted, px.
    pub place_px: Vector2<f64>,
    /// The class of the reason.
    pub kind: AbsenceKind,
    /// The reason in the operator's words.
    pub reason: String,
}

impl Absence {
    /// Of a target that the operator says is not there.
    #[must_use]
    pub fn denied(place_px: Vector2<f64>) -> Self {
        Self {
            place_px,
            kind: AbsenceKind::Denied,
            reason: "the operator says that it is not there".to_owned(),
        }
    }
}

/// Why a target has no dot in an image that ought to show it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AbsenceKind {
    /// Nothing is there, where a dot would be seen.
    Covered,
    /// What is there may be noise.
    Weak,
    /// It is seen too flatly.
    Oblique,
    /// The picture's border cuts it.
    Border,
    /// It merges with a neighbour's light.
    Merged,
    /// Glare, or surroundings in which no dot can be told.
    Glare,
    /// What is there is partly covered, of another shape, or no dot.
    Shape,
    /// What is there lies beside the predicted place.
    Elsewhere,
    /// A dot is there whose target is not decided.
    Ambiguous,
    /// Its place is predicted too roughly to look.
    Vague,
    /// The picture could not be read again to look.
    Unreadable,
    /// The operator says that it is not there.
    Denied,
}

impl AbsenceKind {
    /// Whether the operator's eye may find the target all the same. What is hidden, cut off, seen too flatly or in no picture is no
    /// question.
    #[must_use]
    pub fn is_doubtful(self) -> bool {
        match self {
            AbsenceKind::Covered
            | AbsenceKind::Oblique
            | AbsenceKind::Border
            | AbsenceKind::Unreadable
            | AbsenceKind::Denied => false,
            AbsenceKind::Weak
            | AbsenceKind::Merged
            | AbsenceKind::Glare
            | AbsenceKind::Shape
            | AbsenceKind::Elsewhere
            | AbsenceKind::Ambiguous
            | AbsenceKind::Vague => true,
        }
    }
}

impl fmt::Display for AbsenceKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            AbsenceKind::Covered => "covered",
            AbsenceKind::Weak => "too weak",
            AbsenceKind::Oblique => "too oblique",
            AbsenceKind::Border => "at the border",
            AbsenceKind::Merged => "merged with a neighbour",
            AbsenceKind::Glare => "in glare",
            AbsenceKind::Shape => "of another shape",
            AbsenceKind::Elsewhere => "beside the predicted place",
            AbsenceKind::Ambiguous => "ambiguous",
            AbsenceKind::Vague => "predicted too roughly",
            AbsenceKind::Unreadable => "in a picture that cannot be read",
            AbsenceKind::Denied => "not there",
        })
    }
}

/// The class and the reason; the reason alone where it begins with its class.
impl fmt::Display for Absence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = self.kind.to_string();
        if !self.reason.starts_with(&kind) {
            write!(f, "{kind}: ")?;
        }
        f.write_str(&self.reason)
    }
}

impl ImageEntry {
    /// The targets that the image ought to show and does not, as its last look has it; none that got a dot since.
    pub fn absent(&self) -> impl Iterator<Item = (PointId, &Absence)> {
        let named: std::collections::BTreeSet<PointId> =
            self.labels.values().map(|label| label.point).collect();
        self.look
            .iter()
            .flat_map(|look| &look.absent)
            .filter(move |(point, _)| !named.contains(point))
            .map(|(point, absence)| (*point, absence))
    }
}
