//! Identification of plain targets: which dots of which images show one target.
//!
//! Dots carry no names; what tells them apart is where their rays meet. The method is the multi-ray intersection of
//! Hattori, Akimoto, Fraser and Imoto (2002), carried further where their threshold alone would decide wrongly:
//!
//! 1. **Pairs.** Only views that share codes are compared. The partners of a dot lie along its epipolar line, within the
//!    object's depth and within a band: the threshold `Th = sqrt(2) max(sigma_S, 3 sigma_xy D / c)` of two rays, in
//!    pixels.
//! 2. **Growing.** Each pair proposes a point; every other view is asked for a dot at its predicted place, the surest
//!    views first, the point improving with each ray (sequential least squares), then a strict intersection with tests
//!    of every ray and of the whole (chi-square), and of the ellipses: they must be images of one circle that faces the
//!    cameras.
//! 3. **Accidents.** In a dense field rays meet by chance. How many accidental intersections of as many rays must be
//!    expected follows from the local density of dots and the areas searched (a contrario reasoning: Desolneux, Moisan
//!    and Morel, 2000); a target must be much rarer than that.
//! 4. **Agreement.** A target is accepted when its dots agree: each one's own best intersection is this one, and no
//!    other through any of them gathers as many rays. Best first; accepted dots are taken away, which thins the field,
//!    and the next round looks again. So targets of three rays come last, when nothing is left to mislead.
//! 5. **Prediction.** Accepted targets and known points are looked for in all other views; a dot goes to a target only
//!    if both are each other's clear choice.
//!
//! sigma_S bounds the errors of rays; how large they really are is measured from the residuals of strong intersections.
//! What stays ambiguous waits for better orientations: adjust, and call [`identify`] again.
//!
//! The paper's own rule, its threshold alone, stands beside it as [`identify_by_threshold`].

mod calibration;
mod drafts;
mod hypothesis;
mod identify;
mod intersection;
mod limits;
mod meeting_places;
mod outcome;
mod paper_rule;
mod predictor;
mod problem;
mod shape;
mod sight;
mod sizes;
mod surface;
mod sweep;
mod threshold;

pub use identify::identify;
pub use paper_rule::identify_by_threshold;
pub use predictor::Predictor;
pub use problem::{
    Claim, Identification, IdentificationInput, IdentificationSettings, KnownCircle, KnownPoint,
    Leftover, LeftoverReason, Member, ObjectSpace, OrientationPrecision, Pair, Track, View,
    ViewDot,
};

#[cfg(test)]
mod paper_trials;
#[cfg(test)]
mod simulated;
#[cfg(test)]
mod trials;
