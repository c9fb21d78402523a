//! What detection found in one picture.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::Family;

/// A dot of one picture by its place in [`Detections::dots`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct DotIndex(pub u32);

impl DotIndex {
    /// The place in a slice of dots.
    #[must_use]
    pub fn slot(self) -> usize {
        self.0 as usize
    }
}

/// An accepted dot: the image of a circular target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dot {
    /// Centre of the dot's image as measured, px, without eccentricity correction.
    pub centre_px: Vector2<f64>,
    /// Standard error of the centre, rms over x and y, px.
    pub sigma_px: f64,
    /// Larger full diameter of the ellipse, px.
    pub major_px: f64,
    /// Smaller full diameter of the ellipse, px.
    pub minor_px: f64,
    /// Direction of the larger diameter, radians from +x towards +y (down), in [0, pi).
    pub angle: f64,
    /// Grey value of the dot above its background.
    pub contrast: f64,
    /// Local background, grey value.
    pub background: f64,
}

/// A coded target as read in one picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CodeReading {
    /// Family of the code.
    pub family: Family,
    /// Its number in the family's table, from 1.
    pub id: u32,
    /// Its dots: O, A, B, 1, 2, 3 (`dot420`) or the centre dot alone (rings).
    pub dots: Vec<DotIndex>,
    /// Root mean square misfit of the reading, in pixels (`dot420`) or as a share of the contrast (rings).
    pub misfit: f64,
    /// Why the reading may be another code or no code; `None` where nothing speaks against it.
    pub doubt: Option<String>,
    /// The evidence that decided.
    #[serde(default)]
    pub evidence: CodeEvidence,
}

/// What speaks for a reading and against it, in numbers. All zero and none in readings of older project files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CodeEvidence {
    /// Misfit as a multiple of what is expected of the code (`dot420`: root of the weighted mean square, usually below 1.8) or
    /// tolerated (rings: the part that departs most from the picture that the number says, at most 1).
    pub fit: f64,
    /// Lead over what would be another number. `dot420`: how many times worse than this one the next reading fits that
    /// shares dots with it; none where there is no other. Rings: least difference between a light and a dark segment, as a
    /// share of the contrast.
    pub margin: Option<f64>,
    /// `dot420`: other numbers that the picture would show as well if one dot of theirs were hidden and one of these six
    /// were a plain target.
    pub rivals: u32,
    /// `dot420`: likelihood of those numbers together, as a multiple of the reading's; plain targets round the code raise it.
    pub rival_odds: f64,
    /// `dot420`: dots near the code that belong to no code and may lie in its plane.
    pub foreign_dots: u32,
    /// Rings: segments whose grey level or edge departs from what the number says.
    pub departing_segments: u32,
}

/// A place that looked like a target and was refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rejected {
    /// Where, px.
    pub place_px: Vector2<f64>,
    /// Why, in the operator's words.
    pub reason: String,
}

/// Everything found in one picture.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Detections {
    /// Columns of the picture.
    pub width_px: u32,
    /// Rows of the picture.
    pub height_px: u32,
    /// Accepted dots, by rows and then columns of their centres.
    pub dots: Vec<Dot>,
    /// Decoded targets, by family and number.
    pub codes: Vec<CodeReading>,
    /// Refused candidates.
    pub rejected: Vec<Rejected>,
    /// Dots that the operator measured by hand; they stand behind the detected ones.
    #[serde(default)]
    pub by_hand: Vec<DotIndex>,
    /// Dots that were measured where the network said that a target must be; they too stand behind the detected ones.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub expected: Vec<DotIndex>,
}
