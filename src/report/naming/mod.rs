//! Names of plain targets by a list of approximate coordinates (drive-back): the targets of a measured network get the
//! names of the known places at which they lie.
//!
//! The transformation comes from what is in common by label (codes, cross, targets that have names); where that is too
//! little, from the two lists standing in one frame already; else from the geometry of the points alone, where that
//! allows one pose only ([`constellation`]). Then every known place is given to the point that is the nearest one to
//! it, and for which it is the nearest one, within a distance and with a margin, and the fit is repeated with all
//! pairs until nothing changes. A fit that is extrapolated so far that the nearest point may be the wrong one gives no
//! name there ([`reach`]).
//!
//! A name is given only where it is unmistakable; everything else is listed with its reason.

mod assignment;
mod constellation;
mod evidence;
mod labels;
mod lists;
mod mirror;
mod outcome;
mod places;
mod reach;
mod start;
mod table;
mod triangles;

use std::collections::BTreeMap;

use serde::Serialize;

use self::assignment::settle;
use self::lists::Lists;
use super::compare::{Agreement, Difference, ReferencePoint};
use super::export::{NoFigures, adjusted_points, fresh_adjustment};
use crate::geometry::Scale;
use crate::network::{Network, ScaleSource};

pub use self::outcome::{Ambiguity, ReferenceLeft, Rival, TargetLeft, WhyLeft};

/// How to name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NamingSettings {
    /// Whether the fit has a scale of its own (default: no).
    pub scale: Scale,
    /// Within what distance a point is at a known place, mm; `None`: as [`super::CompareSettings::place_distance_mm`].
    pub within_mm: Option<f64>,
    /// What happens to names that targets have (default: they stay).
    pub existing: ExistingNames,
    /// Seed of the samples (default 1): the same seed gives the same names.
    pub seed: u64,
}

impl Default for NamingSettings {
    fn default() -> Self {
        Self {
            scale: Scale::One,
            within_mm: None,
            existing: ExistingNames::Stay,
            seed: 1,
        }
    }
}

/// What happens to the names that targets have already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExistingNames {
    /// They stay, and their places in the list help to find the transformation.
    Stay,
    /// The list's names take their place.
    GiveWay,
}

/// How the transformation was come by at first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Way {
    /// By labels in common.
    Labels,
    /// The two stand in one frame.
    Frame,
    /// By the geometry of the points alone.
    Geometry,
}

/// Why nothing can be named; one line.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NamingError {
    /// No figures of the adjustment.
    #[error(transparent)]
    NoFigures(#[from] NoFigures),
    /// A distance that is none.
    #[error("naming: found a distance of {found} mm, expected a number above 0")]
    BadDistance {
        /// The distance, mm.
        found: f64,
    },
    /// Too few places on one of the sides.
    #[error(
        "naming: found {points} adjusted points and {reference} reference points with three coordinates at different places, expected 3 or more of both"
    )]
    TooFew {
        /// Adjusted points.
        points: usize,
        /// Reference points with three coordinates.
        reference: usize,
    },
    /// Most common labels contradict each other.
    #[error(
        "naming: found {agreeing} of {common} common labels within {within_mm:.3} mm of one best fit, expected half of them or more; {remedy}"
    )]
    LabelsDisagree {
        /// Labels of the largest set that agrees.
        agreeing: usize,
        /// Labels in common.
        common: usize,
        /// Within what distance, mm.
        within_mm: f64,
        /// What may help.
        remedy: &'static str,
    },
    /// Nothing is in common.
    #[error(
        "naming: found {common} labels in common and no pose in which the reference fits (the best brings {most} points to within {within_mm:.3} mm, no more than chance), expected 3 common labels or the same points"
    )]
    NoPose {
        /// Labels in common.
        common: usize,
        /// The most points that a pose brought together.
        most: usize,
        /// Within what distance, mm.
        within_mm: f64,
    },
    /// A symmetrical list.
    #[error(
        "naming: found {poses} poses in which the reference fits equally well ({points} points each), expected one; 3 common labels would decide"
    )]
    SeveralPoses {
        /// How many poses.
        poses: usize,
        /// Points that each brings together.
        points: usize,
    },
    /// A list that nearly repeats itself.
    #[error(
        "naming: found a second pose in which the reference fits ({rival} points, the best has {points}), expected one alone; 3 common labels would decide"
    )]
    RivalPose {
        /// Points that the best pose brings together.
        points: usize,
        /// Points of the second one.
        rival: usize,
    },
    /// The list fits when it is mirrored.
    #[error(
        "naming: found that the reference fits mirrored ({mirrored} points, as it is {points}), expected coordinates of a right-handed system"
    )]
    Mirrored {
        /// Points that it has in common when mirrored.
        mirrored: usize,
        /// Points that it has in common as it is.
        points: usize,
    },
    /// The pairs do not hold the fit.
    #[error(
        "naming: found {pairs} pairs left when the fit was repeated, expected 3 or more that are not on one line"
    )]
    Lost {
        /// Pairs left.
        pairs: usize,
    },
}

/// What can be named, and what is left on both sides.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Naming {
    /// How the transformation was come by at first.
    pub way: Way,
    /// Within what distance a point is at a known place, mm.
    pub within_mm: f64,
    /// Whether the scale was fitted.
    pub with_scale: bool,
    /// Where the scale of the measurement comes from.
    pub scale_from: ScaleSource,
    /// Scale of the transformation (1 where it was not fitted).
    pub scale: f64,
    /// Its rotation, row by row.
    pub rotation: [[f64; 3]; 3],
    /// Its translation, mm.
    pub translation_mm: [f64; 3],
    /// All pairs that the final fit rests on.
    pub fit: Agreement,
    /// The targets that get a name.
    pub named: Agreement,
    /// Targets that have the name of their place already.
    pub named_before: usize,
    /// Labels in common that do not lie within the distance and have no part in the fit.
    pub labels_off: Vec<Difference>,
    /// The targets that get a name: `label` is what they were called, `reference` the name they get.
    pub differences: Vec<Difference>,
    /// Places and targets that cannot be told from another.
    pub ambiguous: Vec<Ambiguity>,
    /// Other reference points that gave no name, and why.
    pub reference_left: Vec<ReferenceLeft>,
    /// Plain targets at no known place.
    pub targets_left: Vec<TargetLeft>,
    /// The names to give, by the numbers of targets.
    #[serde(skip)]
    pub names: BTreeMap<u32, String>,
}

/// The names that a list of approximate coordinates gives the plain targets of a measured network; nothing is changed.
///
/// # Errors
/// [`NamingError`]: no fresh adjustment, or no transformation that is beyond doubt.
pub fn name_by_reference(
    network: &Network,
    reference: &[ReferencePoint],
    settings: &NamingSettings,
) -> Result<Naming, NamingError> {
    let adjustment = fresh_adjustment(network, "naming")?;
    let points = adjusted_points(network, adjustment);
    let lists = Lists::new(network, points, reference, settings)?;
    let start = start::start(&lists)?;
    let assignment = settle(&lists, &start.pairs)?;
    mirror::check(&lists, &assignment)?;
    Ok(outcome::naming(
        &lists,
        &assignment,
        start.way,
        adjustment.scale_from,
    ))
}

#[cfg(test)]
mod tests;
