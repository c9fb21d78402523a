//! Identification of plain targets: which dots of which images show one target.
//!
//! Dots carry no names; what tells them apart is where their rays meet. The method is the multi-ray intersection of
//! Hattori, Akimoto, Fraser and Imoto (2002), carried further where their threshold alone would decide wrongly:
//!
//! 1. **Pairs.** Compared are views that ought to show a common point, whether they share a code that was read or not. The partners of
//!    a dot lie along its epipolar line, within the depth that the known points of its view suggest, in a band of the uncertainty of
//!    both predictions and both measurements; their ellipses must be images of one circle. A prediction's uncertainty is the covariance
//!    of the view's pose and its camera together, carried to that place.
//! 2. **Growing.** Each pair proposes a point; every other view is asked for a dot at its predicted place, the surest views first, the
//!    point improving with each ray (sequential least squares), then a strict intersection with tests of every ray and of the whole
//!    (chi-square), and of every ellipse (chi-square; how exact ellipses are is measured).
//! 3. **Accidents.** In a dense field rays meet by chance. How many accidental intersections of as many rays the whole measurement must
//!    be expected to hold follows from the pairs that were tried, the areas searched, the density of dots of that shape, the share of
//!    dots that belong to nothing, and the surface on which the targets lie (a contrario reasoning: Desolneux, Moisan and Morel, 2000);
//!    a target must be much rarer than that. Two targets whose images run together stand midway in every image alike: few rays are
//!    enough for a size that others have, not for an odd one.
//! 4. **Sweep.** What many rays agree on and nothing competes with is accepted a few views at a time, without asking its other dots:
//!    the cost goes with the targets, and what follows sees a thin field.
//! 5. **Agreement.** Of the others a target is accepted when its dots agree: each one's own best intersection is this one, and no
//!    other through any of them gathers as many rays. Best first; accepted dots are taken away, and the next round looks again. So
//!    targets of three rays come last, when nothing is left to mislead.
//! 6. **Prediction.** Accepted targets and known points are looked for in all other views; a dot goes to a target only
//!    if both are each other's clear choice.
//! 7. **Pairs that are left** on the surface of the targets are told: a third image may show them to who looks for them.
//! 8. **Readings that exclude each other** are told with their likelihoods: somebody who sees the pictures may decide.
//!
//! What neither dots nor precision explain of the residuals is measured from strong intersections; for views whose precision nobody
//! told, sigma_S bounds it. How exact ellipses are is told by the targets that have names ([`EllipsePrecision`]), or else by strong
//! intersections as well. What stays ambiguous waits for better orientations: adjust, and call [`identify`] again.
//!
//! The paper's own rule, its threshold alone, stands beside it as [`identify_by_threshold`].

mod calibration;
mod drafts;
mod ellipses;
mod hypothesis;
mod identify;
mod intersection;
mod limits;
mod meeting_places;
mod outcome;
mod paper_rule;
mod predictor;
mod problem;
mod readings;
mod shape;
mod sight;
mod sizes;
mod surface;
mod sweep;
mod threshold;

pub use ellipses::{EllipsePair, EllipsePrecision};
pub use identify::identify;
pub use paper_rule::identify_by_threshold;
pub use predictor::Predictor;
pub use problem::{
    Claim, Identification, IdentificationInput, IdentificationSettings, KnownCircle, KnownPoint,
    Leftover, LeftoverReason, Member, ObjectSpace, OrientationPrecision, Pair, Track, View,
    ViewDot,
};
pub use readings::{Agreement, Group, ReadAs, Reading};

#[cfg(test)]
mod paper_trials;
#[cfg(test)]
mod simulated;
#[cfg(test)]
mod trials;
