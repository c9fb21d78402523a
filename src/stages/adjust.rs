//! The adjustments: codes alone, everything, and the one between two passes of identification.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::bundle::{Bundle, BundleFailure, DatumPoints, restore_rejected};
use super::circles::{self, SETTLED_PX};
use super::code_shape::CodeShapes;
use super::lens::{IMAGES_FOR_ALL, LensFreedom, Weighed, all_weighed, images_of_cameras, untold};
use super::scale::{
    align_to_control, apply_frame, bars_in_reach, keep_frame, leave_frame, transform,
};
use super::set_aside::{
    OF_OTHER_SHAPE, codes_set_aside, intersect_operators_points, operators_labels_not_used,
    set_code_aside,
};
use super::take_up::take_up_codes;
use super::weak::{chance_orientations, chance_pair, weak_stations};
use super::what_holds::{adjust_all_that_holds, adjust_what_holds};
use super::{Halt, StageError};
use crate::adjustment::{AdjustmentError, BundleSettings, RobustAdjustment};
use crate::camera::INTERIOR_NAMES;
use crate::geometry::ThreeTwoOne;
use crate::monitor::Monitor;
use crate::network::{
    About, AdjustmentResult, Finding, FindingKind, Frame, FrameResult, GrossErrors, ImageId,
    Network, Outcome, PointId, Stage, Standing,
};
use crate::targets::Family;

/// Share of a code's dots that must be rejected for its reading to be set aside.
const SHARE_TO_SET_ASIDE: f64 = 0.5;

/// Share of an image's dots above which their rejection speaks against the image.
const SHARE_TO_DOUBT_IMAGE: f64 = 0.5;

/// Rounds of estimating circles and adjusting at most; two are the rule, since a circle depends on the network little.
const ROUNDS_OF_CIRCLES: usize = 5;

/// Between passes of identification and for the circles gross errors are looked for until no more than this share of the observations
/// changes its standing: the final adjustment looks until none does.
const ENOUGH: f64 = 1e-3;

/// A lens parameter is weighed by what is known beforehand where the images alone leave it this share of that, or more.
const LOOSE_SHARE: f64 = 0.3;

/// Where even so its standard deviation stays this share of what is known beforehand, or more, the images do not tell it.
const UNTOLD_SHARE: f64 = 0.7;

/// Where the adjustment does not settle even then.
const HELD_LENS: &str = "the images leave the lens so loose that most of its parameters are held at nominal values: the orientation is doubtful";

/// Whether this adjustment has not been made on the present inputs, of all oriented images, or for another frame.
pub(super) fn is_outdated(network: &Network, stage: Stage) -> bool {
    if leaves_images_out(network) {
        return true;
    }
    match (&network.adjustment, stage) {
        (Some(adjustment), Stage::AdjustCodes) => adjustment.basis != network.inputs,
        (Some(adjustment), _) => {
            adjustment.basis != network.inputs
                || adjustment.stage != stage
                || !network.frame_is_tried(adjustment)
        }
        (None, _) => true,
    }
}

/// Whether there is an adjustment, but images were connected after it.
pub(super) fn leaves_images_out(network: &Network) -> bool {
    let Some(adjustment) = &network.adjustment else {
        return false;
    };
    let adjusted: BTreeSet<ImageId> = adjustment
        .observations
        .iter()
        .map(|row| row.image)
        .collect();
    network
        .oriented_images()
        .any(|(id, ..)| !adjusted.contains(&id))
}

/// Whether the final adjustment was made on the present inputs but is no longer there: it could not be read from a damaged
/// file.
pub(super) fn is_lost(network: &Network, stage: Stage) -> bool {
    let made = network
        .conclusions
        .get(&stage)
        .is_some_and(|c| matches!(c.outcome, Outcome::Done | Outcome::Incomplete));
    stage == Stage::Adjust && made && network.adjustment.is_none()
}

/// The adjustment of a stage. Codes are looked at where their coordinates have standard deviations: those of a network that was
/// settled only get them here. What was set aside before is looked at again after it: it may have been the lens.
pub(super) fn run(network: &mut Network, stage: Stage, monitor: &Monitor) -> Result<(), Halt> {
    set_contradicted_codes_aside(network);
    adjust(network, stage, monitor)?;
    if stage != Stage::AdjustCodes {
        return Ok(());
    }
    if take_up_codes(network) {
        adjust(network, stage, monitor)?;
    }
    if set_contradicted_codes_aside(network) {
        adjust(network, stage, monitor)?;
    }
    Ok(())
}

/// Adjusts all labelled dots, rejects gross errors, and records the result as that of `stage`; the final one stands in
/// the frame that the operator asked for.
pub(super) fn adjust(network: &mut Network, stage: Stage, monitor: &Monitor) -> Result<(), Halt> {
    restore_rejected(network);
    intersect_operators_points(network);
    let mut frame = FrameResult::default();
    if stage == Stage::Adjust {
        leave_frame(network);
        frame.asked = network.frame;
    }
    apply_frame(network);
    settle_circles(network, stage, monitor)?;
    let problem = network.frame_problem(&frame.asked);
    frame.refused = problem.map(|problem| problem.to_string());
    let points = match frame.asked {
        Frame::ThreeTwoOne(points) if frame.refused.is_none() => Some(points),
        _ => None,
    };
    let enough = match stage {
        Stage::Identify => ENOUGH,
        _ => 0.0,
    };
    let (bundle, robust) = match solve(network, stage, points.as_ref(), enough, monitor) {
        Err(failure) if failure.is_of_frame() => {
            frame.refused = Some(failure.in_words);
            solve(network, stage, None, enough, monitor)
        }
        other => other,
    }
    .map_err(halt)?;
    let motion = robust.adjustment.motion;
    if let Some(motion) = &motion {
        // What is not adjusted moves along.
        transform(network, motion);
    }
    monitor.check()?;
    bundle.write_back(network, &robust.adjustment);
    bundle.mark_rejected(network, &robust.adjustment);
    let on_control = bundle.stands_on_control();
    match motion {
        Some(motion) if on_control => network.moved_by = Some(motion),
        Some(motion) => keep_frame(network, motion),
        None if on_control => {}
        None => align_to_control(network),
    }
    network.adjustment = Some(Arc::new(AdjustmentResult {
        frame,
        ..bundle.result(network, stage, &robust.adjustment)
    }));
    Ok(())
}

/// Estimates the circles of the targets from the network, adjusts with them, and again, until no eccentricity changes any
/// more. What these adjustments reject counts for them alone.
///
/// Between two passes of identification the circles are estimated once: names do not depend on the last of it.
fn settle_circles(network: &mut Network, stage: Stage, monitor: &Monitor) -> Result<(), Halt> {
    let rounds = match stage {
        Stage::Identify => 0,
        _ => ROUNDS_OF_CIRCLES,
    };
    let task = monitor.task("Estimating circles", 0);
    for round in 0..=rounds {
        task.step()?;
        let (before, now) = (
            circles::carried(network),
            circles::estimated(network, monitor)?,
        );
        let change = || circles::largest_change(network, &before, &now, monitor);
        let is_last = round == rounds || (round > 0 && change()? < SETTLED_PX);
        circles::carry(network, &now);
        monitor.check()?;
        if is_last {
            break;
        }
        let (bundle, robust) = solve(network, stage, None, ENOUGH, monitor).map_err(halt)?;
        bundle.write_back(network, &robust.adjustment);
    }
    Ok(())
}

/// The adjustment with rejection until it changes no more than the share `enough`; where the images cannot tell all of the lens, what they leave loose is held.
fn solve(
    network: &mut Network,
    stage: Stage,
    frame: Option<&ThreeTwoOne<PointId>>,
    enough: f64,
    monitor: &Monitor,
) -> Result<(Bundle, RobustAdjustment), BundleFailure> {
    let datum = match stage {
        Stage::AdjustCodes => DatumPoints::Codes,
        Stage::Adjust => DatumPoints::Targets,
        _ => DatumPoints::All,
    };
    let assemble = |network: &Network, freedom: LensFreedom<'_>| {
        let bundle = Bundle::assemble(network, freedom, datum, monitor)?;
        Ok(bundle.in_frame(network, frame))
    };
    let loose_lens =
        |finding: &Finding| (finding.stage, finding.kind) == (stage, FindingKind::Camera);
    Arc::make_mut(&mut network.findings).retain(|finding| !loose_lens(finding));
    let settings = BundleSettings::default();
    let mut weighed = Weighed::new();
    loop {
        let calibrated = |network: &Network| assemble(network, LensFreedom::Calibrated(&weighed));
        let adjusted = match network.settings.gross_errors {
            GrossErrors::Reject => {
                adjust_what_holds(network, calibrated, settings, enough, monitor)
            }
            GrossErrors::Keep => adjust_all_that_holds(network, calibrated, settings, monitor),
        };
        match adjusted {
            Ok((bundle, robust)) => {
                let sigmas = bundle.lens_sigmas(&robust.adjustment);
                let loose = untold(network, &sigmas, LOOSE_SHARE);
                if weighed.is_empty() && is_calibrated(network) && !loose.is_empty() {
                    weighed = loose;
                    continue;
                }
                tell_of_lenses(network, stage, &untold(network, &sigmas, UNTOLD_SHARE));
                return Ok((bundle, robust));
            }
            Err(failure) if failure.leaves_unknowns_loose() => {
                let all = all_weighed(network);
                if weighed != all {
                    weighed = all;
                    continue;
                }
                network.note(Finding {
                    stage,
                    kind: FindingKind::Camera,
                    about: About::Project,
                    text: HELD_LENS.into(),
                });
                let held = |network: &Network| assemble(network, LensFreedom::Provisional);
                return adjust_what_holds(network, held, settings, enough, monitor);
            }
            other => return other,
        }
    }
}

/// Whether a camera has images enough to be calibrated.
fn is_calibrated(network: &Network) -> bool {
    let images = images_of_cameras(network);
    images.values().any(|images| *images >= IMAGES_FOR_ALL)
}

/// A finding for each camera of which the images leave parameters untold.
fn tell_of_lenses(network: &mut Network, stage: Stage, untold: &Weighed) {
    let images = images_of_cameras(network);
    for (id, untold) in untold {
        let names: Vec<&str> = INTERIOR_NAMES
            .iter()
            .zip(untold)
            .filter_map(|(name, untold)| untold.then_some(*name))
            .collect();
        let name = network.cameras[id].name.clone();
        let count = images.get(id).copied().unwrap_or_default();
        network.note(Finding {
            stage,
            kind: FindingKind::Camera,
            about: About::Camera(name.clone()),
            text: format!(
                "camera '{name}': its {count} images do not tell {} from their orientations: held near nominal values",
                names.join(", ")
            ),
        });
    }
}

pub(super) fn halt(failure: BundleFailure) -> Halt {
    match failure.error {
        AdjustmentError::Interrupted(_) => Halt::Interrupted,
        _ => Halt::Failed(StageError::Adjustment {
            reason: failure.in_words,
        }),
    }
}

/// Codes whose coordinates contradict the shape of a code are clusters of plain targets read as codes: they are set aside; whether
/// there were any.
fn set_contradicted_codes_aside(network: &mut Network) -> bool {
    let ids: Vec<ImageId> = network.images.keys().copied().collect();
    let contradicted = CodeShapes::of(network).contradicted(network);
    for &code in &contradicted {
        let of_code = |point: PointId| point.code() == Some((Family::Dot420, code));
        for id in &ids {
            let labels = &network.images[id].labels;
            if labels.values().any(|label| of_code(label.point)) {
                let image = network.image_mut(*id);
                set_code_aside(image, Family::Dot420, code, OF_OTHER_SHAPE);
            }
        }
        // Where the operator says that it is this code, its names stay and the adjustment tests them.
        let stays = |id| network.images[id].labels.values().any(|l| of_code(l.point));
        if !ids.iter().any(stays) {
            Arc::make_mut(&mut network.points).retain(|point, _| !of_code(*point));
        }
    }
    !contradicted.is_empty()
}

/// Code readings of one image most of whose dots the adjustment rejected, with the largest |w|.
fn misfitting_codes(network: &Network) -> Vec<(ImageId, Family, u32, f64)> {
    let Some(adjustment) = &network.adjustment else {
        return Vec::new();
    };
    #[derive(Default)]
    struct Tally {
        rejected: usize,
        all: usize,
        largest: f64,
    }
    let mut tallies: BTreeMap<(ImageId, Family, u32), Tally> = BTreeMap::new();
    for row in &adjustment.observations {
        let PointId::Code { family, code, .. } = row.point else {
            continue;
        };
        let tally = tallies.entry((row.image, family, code)).or_default();
        tally.all += 1;
        if row.standing == Standing::Rejected {
            tally.rejected += 1;
            tally.largest = tally.largest.max(row.test);
        }
    }
    tallies
        .into_iter()
        .filter(|(_, tally)| tally.rejected as f64 > SHARE_TO_SET_ASIDE * tally.all as f64)
        .map(|((image, family, code), tally)| (image, family, code, tally.largest))
        .collect()
}

/// What the operator should know after an adjustment: bars without ends, codes that do not fit, a sigma0 that is not one.
pub(super) fn findings(network: &Network, stage: Stage) -> Vec<Finding> {
    let mut findings = Vec::new();
    let reached: Vec<&str> = bars_in_reach(network)
        .iter()
        .map(|(bar, _)| bar.name.as_str())
        .collect();
    for bar in network
        .scale_bars
        .iter()
        .filter(|bar| !reached.contains(&bar.name.as_str()))
    {
        let lost: Vec<&str> = [bar.from.as_str(), bar.to.as_str()]
            .into_iter()
            .filter(|end| {
                network
                    .point_of_label(end)
                    .map_or(true, |id| !network.points.contains_key(&id))
            })
            .collect();
        findings.push(Finding {
            stage,
            kind: FindingKind::ScaleBar,
            about: About::Bar(bar.name.clone()),
            text: format!(
                "bar '{}': found no coordinates of {}, expected both ends in two or more oriented images; not used",
                bar.name,
                lost.join(" and ")
            ),
        });
    }
    for (id, family, code, w) in misfitting_codes(network) {
        findings.push(Finding {
            stage,
            kind: FindingKind::DoubtfulCode,
            about: About::Image(id),
            text: format!(
                "{}: {} does not fit the network (|w| = {w:.1}); its dots are not used",
                network.images[&id].file.path,
                family.code_label(code)
            ),
        });
    }
    let refused = network
        .adjustment
        .as_ref()
        .and_then(|a| a.frame.refused.as_ref());
    if let Some(reason) = refused.filter(|_| stage == Stage::Adjust) {
        findings.push(Finding {
            stage,
            kind: FindingKind::Frame,
            about: About::Project,
            text: format!("the frame stays as it would be without a choice: {reason}"),
        });
    }
    findings.extend(codes_set_aside(network, stage, OF_OTHER_SHAPE));
    findings.extend(operators_labels_not_used(network, stage));
    findings.extend(doubtful_images(network, stage));
    findings.extend(weak_stations(network, stage));
    findings.extend(chance_orientations(network, stage));
    findings.extend(chance_pair(network, stage));
    findings
}

/// Images that this stage set aside, and those of which it rejected most dots.
fn doubtful_images(network: &Network, stage: Stage) -> Vec<Finding> {
    let mut findings = Vec::new();
    let told = |id: ImageId| {
        network.findings.iter().any(|finding| {
            finding.stage == Stage::Connect
                && finding.kind == FindingKind::UnconnectedImage
                && finding.about == About::Image(id)
        })
    };
    let mut tallies: BTreeMap<ImageId, (usize, usize)> = BTreeMap::new();
    for row in network.adjustment.iter().flat_map(|a| &a.observations) {
        let (rejected, all) = tallies.entry(row.image).or_default();
        *rejected += usize::from(row.standing == Standing::Rejected);
        *all += 1;
    }
    for (id, image) in network.used_images() {
        let (rejected, all) = tallies.get(&id).copied().unwrap_or_default();
        let (kind, text) = match (&image.station, &image.attempt) {
            (None, Some(attempt)) if !told(id) => (
                FindingKind::UnconnectedImage,
                format!("set aside: {}", attempt.reason),
            ),
            (Some(_), _) if rejected as f64 > SHARE_TO_DOUBT_IMAGE * all as f64 => (
                FindingKind::RejectedObservation,
                format!("{rejected} of its {all} dots are rejected: its orientation is doubtful"),
            ),
            _ => continue,
        };
        findings.push(Finding {
            stage,
            kind,
            about: About::Image(id),
            text: format!("{}: {text}", image.file.path),
        });
    }
    findings
}
