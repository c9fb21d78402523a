//! Dots that several readings claim: what they may be, for the operator to decide.

use std::collections::BTreeSet;

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::{ImageEntry, ImageId, ImageUse, Network, PointId, Source};
use crate::targets::DotIndex;

/// Dots of which readings exclude each other, as the last pass of identification left them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AmbiguousGroup {
    /// The readings, the likeliest first. Every other one excludes it.
    pub readings: Vec<Reading>,
}

/// One way to read dots of different images: as one target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// Which target.
    pub target: ReadTarget,
    /// The dots, by image.
    pub dots: Vec<(ImageId, DotIndex)>,
    /// How well the rays agree.
    pub rays: Agreement,
    /// How well the ellipses agree; no freedom where they tell nothing.
    pub shape: Agreement,
    /// Diameter of the target, mm, where the ellipses tell it.
    pub diameter_mm: Option<f64>,
    /// Natural logarithm of its likelihood over that of dots which belong to nothing.
    pub log_likelihood: f64,
}

/// The target of a reading.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReadTarget {
    /// One that nobody knows yet.
    New {
        /// Where the rays meet, mm.
        position: Vector3<f64>,
        /// Covariance of the place, mm^2.
        covariance: Matrix3<f64>,
    },
    /// A point that is there.
    Known(PointId),
}

/// A square sum of standardised misfits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Agreement {
    /// The sum.
    pub chi_square: f64,
    /// Its degrees of freedom.
    pub freedom: usize,
}

impl Agreement {
    /// The misfit in standard deviations: 1 is what is to be expected. `None` where nothing is tested.
    #[must_use]
    pub fn sigmas(&self) -> Option<f64> {
        (self.freedom > 0).then(|| (self.chi_square / self.freedom as f64).max(0.0).sqrt())
    }
}

impl AmbiguousGroup {
    /// All dots that its readings claim, by image.
    #[must_use]
    pub fn dots(&self) -> BTreeSet<(ImageId, DotIndex)> {
        let readings = self.readings.iter();
        readings
            .flat_map(|reading| reading.dots.iter().copied())
            .collect()
    }

    /// By how many times the likeliest reading is likelier than this one.
    #[must_use]
    pub fn odds_against(&self, reading: &Reading) -> f64 {
        let best = self.readings.first();
        best.map_or(1.0, |best| {
            (best.log_likelihood - reading.log_likelihood).exp()
        })
    }
}

impl Network {
    /// The groups that still wait for a decision: names that were given since leave fewer readings, and one alone is no question.
    #[must_use]
    pub fn open_groups(&self) -> Vec<AmbiguousGroup> {
        let open = |group: &AmbiguousGroup| AmbiguousGroup {
            readings: group
                .readings
                .iter()
                .filter(|reading| self.is_open(reading))
                .cloned()
                .collect(),
        };
        let groups = self.ambiguous.iter().map(open);
        groups.filter(|group| group.readings.len() > 1).collect()
    }

    /// Whether a reading may still be right: its dots wait for a name, and its target has no other dot in their images.
    #[must_use]
    pub fn is_open(&self, reading: &Reading) -> bool {
        let known = match reading.target {
            ReadTarget::New { .. } => None,
            ReadTarget::Known(point) if self.points.contains_key(&point) => Some(point),
            ReadTarget::Known(_) => return false,
        };
        reading.dots.iter().all(|(image, dot)| {
            self.images.get(image).is_some_and(|image| {
                image.usage == ImageUse::Used
                    && self.awaits_name(image, *dot)
                    && !image
                        .labels
                        .values()
                        .any(|label| Some(label.point) == known)
            })
        })
    }

    /// Whether a dot has no name that holds: none, or that of a code which only this image shows; and the operator did not reject it.
    #[must_use]
    pub fn awaits_name(&self, image: &ImageEntry, dot: DotIndex) -> bool {
        let detected = image.detections.as_ref();
        if detected.is_none_or(|detections| dot.slot() >= detections.dots.len()) {
            return false;
        }
        match image.labels.get(&dot) {
            None => !image.rejected_dots.contains_key(&dot),
            Some(label) => {
                label.source == Source::Automatic && !self.points.contains_key(&label.point)
            }
        }
    }
}
