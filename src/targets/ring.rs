//! Reading segmented ring codes round a centre dot.
//!
//! The dot's ellipse is the affine frame of the code: in its units the ring lies between 2 and 3. A first look along the ring tells
//! whether there is one, corrects the frame by the ring's edges and says where the grid of segments may begin
//! ([`first_look`]). Then the picture is explained as a whole: the code's picture is computed as a camera would see it
//! ([`sketch`]), the levels of all segments come from one least-squares fit ([`levels`]), the frame, the perspective and the blur from
//! the next ([`refine`]), in turn until the number stays ([`fitting`]). At last the picture is held against the one that the number
//! says ([`evidence`]), and against plain targets in the place of its segments ([`discs`]): where a part departs, or they explain it
//! as well, the reading carries a doubt.

mod discs;
mod evidence;
mod first_look;
mod fitting;
mod frame;
mod levels;
mod patch;
mod pen;
mod refine;
mod sketch;

use self::discs::discs_against_code;
use self::evidence::{RingEvidence, ring_evidence};
use self::first_look::{Grid, MIDDLE, changes, may_be_ring};
use self::fitting::{Fitted, fitted};
pub(super) use self::frame::RingFrame;
use self::frame::refined;
use self::patch::Patch;
use super::CodeEvidence;
use super::dot::{MeasuredDot, View};
use super::family::ring_number;

/// A ring code that was read.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RingReading {
    pub(super) segments: u8,
    pub(super) id: u32,
    /// Root mean square deviation of the segments from light and dark, as a share of the contrast.
    pub(super) misfit: f64,
    pub(super) doubt: Option<String>,
    pub(super) evidence: CodeEvidence,
    /// Where the code lies.
    pub(super) frame: RingFrame,
}

/// What round a dot is not empty but no code.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum RingOutcome {
    /// Nothing like a ring.
    Plain,
    /// Like a ring, but not readable, and why.
    Unreadable(String),
    /// A code.
    Read(RingReading),
}

/// Reads the code round a dot, of one of the given numbers of segments.
pub(super) fn read_ring(view: &View, dot: &MeasuredDot, segments: &[u8]) -> RingOutcome {
    let Some(frame) = RingFrame::of_dot(dot) else {
        return RingOutcome::Plain;
    };
    if segments.is_empty() || !may_be_ring(view, dot, &frame) {
        return RingOutcome::Plain;
    }
    best_fits(view, dot, frame, segments).map_or(RingOutcome::Plain, |(patch, fits)| {
        decide(&patch, dot, &fits)
    })
}

/// The fits of every number of segments, the best first; `None` where there is no ring.
fn best_fits(
    view: &View,
    dot: &MeasuredDot,
    frame: RingFrame,
    segments: &[u8],
) -> Option<(Patch, Vec<Fitted>)> {
    /// What a code leaves unexplained at most, as a share of its light.
    const LARGEST_REST: f64 = 0.2;
    let by_ring = refined(view, dot, &frame).and_then(|frame| refined(view, dot, &frame))?;
    let changes = changes(view, dot, &by_ring)?;
    let patch = Patch::of(view, dot, &by_ring, segments)?;
    let frames = [by_ring, frame];
    let mut fits: Vec<Fitted> = segments
        .iter()
        .filter_map(|&n| fit_of(&patch, dot, &frames, &changes, n))
        .filter(|fit| fit.rest < LARGEST_REST)
        .collect();
    fits.sort_by(|a, b| a.rest.total_cmp(&b.rest));
    (!fits.is_empty()).then_some((patch, fits))
}

/// The fit in the grid that the changes between light and dark tell, or, where segments are few blurs wide, the best of those
/// that start from some grids in the frames of ring and dot.
fn fit_of(
    patch: &Patch,
    dot: &MeasuredDot,
    frames: &[RingFrame; 2],
    changes: &[f64],
    segments: u8,
) -> Option<Fitted> {
    /// Changes between light and dark lie this near to the grid, in segments.
    const LARGEST_RMS: f64 = 0.16;
    const LARGEST: f64 = 0.34;
    /// Segments narrower than so many blurs run into one another.
    const NARROW: f64 = 6.0;
    /// A good fit leaves no more than this unexplained beyond some noise, as a share of the light.
    const GOOD_REST: f64 = 0.02;
    const SIGMAS: f64 = 1.2;
    /// What leaves more is no ring in any frame.
    const HOPELESS_REST: f64 = 0.12;
    /// Places of the grid that are tried, in segments.
    const BEGINS: [f64; 5] = [0.0, 0.2, 0.4, 0.6, 0.8];
    let told = Grid::of(changes, segments)
        .filter(|grid| grid.rms < LARGEST_RMS && grid.largest < LARGEST)
        .and_then(|grid| fitted(patch, &frames[0], segments, &[grid.begin]));
    let width = MIDDLE * std::f64::consts::TAU / f64::from(segments) * 0.5 * dot.dot.minor_px;
    let good = |fit: &Fitted| {
        let noise = SIGMAS * patch.noise / fit.scene.light[0];
        fit.rest < GOOD_REST.hypot(noise)
    };
    let mut best = told;
    if width > NARROW * dot.blur {
        return best;
    }
    for frame in frames {
        let done = |fit: &Fitted| good(fit) || fit.rest > HOPELESS_REST;
        if best.as_ref().is_some_and(done) {
            break;
        }
        let tried = fitted(patch, frame, segments, &BEGINS);
        best = best
            .into_iter()
            .chain(tried)
            .min_by(|a, b| a.rest.total_cmp(&b.rest));
    }
    best
}

fn decide(patch: &Patch, dot: &MeasuredDot, fits: &[Fitted]) -> RingOutcome {
    let [best, others @ ..] = fits else {
        return RingOutcome::Plain;
    };
    /// Largest difference from the picture of its number, as a share of the contrast.
    const LARGEST_MISFIT: f64 = 0.15;
    let segments = best.segments();
    let (darkest, lightest) = (0.5, 1.8);
    let ring_light = 1.0 / best.scene.dot_light.max(1e-3);
    if !(darkest..lightest).contains(&ring_light) {
        return RingOutcome::Unreadable(format!(
            "ring is {:.0} % as light as its dot",
            100.0 * ring_light
        ));
    }
    if best.scene.strain(patch) > 1.0 {
        return RingOutcome::Unreadable("dot and ring do not belong together".into());
    }
    let Some(id) = ring_number(best.pattern(), segments) else {
        return RingOutcome::Unreadable(format!(
            "ring pattern {:0width$b} is no ring{segments} code: partly covered?",
            best.pattern(),
            width = usize::from(segments)
        ));
    };
    let Some(found) = ring_evidence(patch, best) else {
        return RingOutcome::Plain;
    };
    if found.misfit > LARGEST_MISFIT {
        return RingOutcome::Unreadable("its ring does not look like the one of any number".into());
    }
    let rival = others.iter().find(|fit| {
        ring_number(fit.pattern(), fit.segments()).is_some() && fit.rest < 1.5 * best.rest
    });
    let margins = best.shares.iter().map(|share| (share - 0.5).abs());
    let evidence = CodeEvidence {
        fit: found.departure,
        margin: Some(2.0 * margins.fold(f64::INFINITY, f64::min)),
        departing_segments: found.departing_segments,
        ..CodeEvidence::default()
    };
    RingOutcome::Read(RingReading {
        segments,
        id,
        misfit: misfit(best),
        doubt: doubt(patch, dot, best, rival, &found, &evidence),
        evidence,
        frame: best.scene.frame.back_from(patch.corner, patch.step),
    })
}

/// Root mean square deviation of the segments from light and dark.
fn misfit(fit: &Fitted) -> f64 {
    let squares: f64 = fit
        .shares
        .iter()
        .zip(&fit.bits)
        .map(|(share, &light)| (share - f64::from(u8::from(light))).powi(2))
        .sum();
    (squares / fit.shares.len() as f64).sqrt()
}

fn doubt(
    patch: &Patch,
    dot: &MeasuredDot,
    best: &Fitted,
    rival: Option<&Fitted>,
    found: &RingEvidence,
    evidence: &CodeEvidence,
) -> Option<String> {
    /// The ring is half as wide as its dot, and two or three of its segments are no longer than wide: where that is less than a few
    /// blurs, they look like dots and dots like them.
    const LEAST_DOT_PX: f64 = 5.0;
    /// Perspective, print, blur and light of the dot together: 0.6 at most for a thousand codes in photographs, less than 0.9 for all
    /// but one of ten thousand in computed pictures; 1.2 and more for plain targets that otherwise look like a code.
    const LARGEST_STRAIN: f64 = 0.9;
    /// A segment must be this clearly light or dark: the difference between the two is 1.
    const LEAST_MARGIN: f64 = 0.36;
    /// Largest difference from the picture of its number that nothing speaks against, as a share of the contrast.
    const LARGEST_MISFIT: f64 = 0.1;
    const LARGEST_SLOPE: f64 = 0.7;
    /// Change of the ground from the middle to the edge of the ring: what lies over half of a code looks like more.
    const LARGEST_GROUND_SLOPE: f64 = 0.08;
    /// The same with what departs, both as multiples of what is tolerated: a part of such a cover is taken for a slope, the rest departs. True
    /// codes: 1.0 at most in computed pictures, 1.16 for all but two of a thousand in photographs.
    const LARGEST_WITH_DEPARTURE: f64 = 1.2;
    /// What plain targets in the place of the segments leave unexplained, as a multiple of what the code leaves. True codes: 6.5 at least in
    /// photographs, 1.08 in computed pictures but where the dot is less than three pixels wide; 0.5 for plain targets that read as a code.
    const LEAST_OF_DISCS: f64 = 1.0;
    if let Some(rival) = rival {
        return Some(format!("reads as ring{} as well", rival.segments()));
    }
    let across_px = dot.dot.major_px;
    if across_px < LEAST_DOT_PX {
        return Some(format!(
            "its dot is {across_px:.1} px across: other dots beside one so small look like segments"
        ));
    }
    if evidence.margin.is_some_and(|margin| margin < LEAST_MARGIN) {
        return Some("a segment is neither light nor dark: partly covered?".into());
    }
    if found.misfit > LARGEST_MISFIT {
        return Some("its picture is not the one of its number".into());
    }
    if found.departing_segments > 0 {
        return Some(format!(
            "{} of its {} segments depart from its number in grey level or edge: partly covered?",
            found.departing_segments,
            best.segments()
        ));
    }
    if best.scene.strain_together(patch) > LARGEST_STRAIN {
        return Some(
            "its dot and its ring agree only just: plain targets beside one another?".into(),
        );
    }
    let sloping = best.ground_slope() / LARGEST_GROUND_SLOPE;
    if sloping.hypot(found.departure) > LARGEST_WITH_DEPARTURE {
        return Some("a ground that slopes and what departs hide a cover between them?".into());
    }
    if sloping > 1.0 {
        return Some("the ground grows lighter across the ring".into());
    }
    if best.slope() > LARGEST_SLOPE {
        return Some("the light falls off across the ring".into());
    }
    if found.roundness > 1.0 {
        return Some("the ends of its light parts are round: plain targets in a row?".into());
    }
    let frame = RingFrame::of_dot(dot)?.within(patch.corner, patch.step);
    if discs_against_code(patch, &frame, best).is_some_and(|rest| rest < LEAST_OF_DISCS) {
        return Some(
            "plain targets in the place of its segments explain the picture as well".into(),
        );
    }
    None
}
