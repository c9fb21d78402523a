//! Connecting images one by one: resection, intersection of new points, bundle update.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::bundle::{Bundle, DatumPoints, adjust_what_holds, known_points, restore_rejected};
use super::by_hand::{POINTS_BY_HAND, give_names};
use super::lens::LensFreedom;
use super::resection::{KnownRay, intersect_new_points, known_rays, misfits, resect};
use super::scale::apply_frame;
use super::set_aside::{OFF_ITS_PLACE, codes_set_aside, set_code_aside};
use super::{Halt, adjust};
use crate::adjustment::BundleSettings;
use crate::monitor::Monitor;
use crate::network::{
    About, Attempt, Code, Finding, FindingKind, ImageEntry, ImageId, Network, PointId, Source,
    Stage, Station,
};

/// Fewest known points that orient an image: three give up to four poses, the fourth decides. Three that the operator
/// named do ([`super::by_hand`]).
const POINTS_TO_CONNECT: usize = 4;

/// Convergence of an update, in standard deviations of the observations: the next update moves everything further.
const UPDATE_CONVERGENCE: f64 = 1e-2;

/// The image that comes next: the one that shows most known points, of those not tried with as many before; then those that were, as
/// long as others are connected meanwhile: the points are known better now, and the lens too.
///
/// Cost: labelled dots of all images that are not connected yet.
pub(super) fn next(network: &Network) -> Option<ImageId> {
    let oriented = network.oriented_images().count();
    let turn = |image: &ImageEntry, known: usize| {
        let tried = image.attempt.as_ref().filter(|a| a.basis == network.inputs);
        match tried {
            Some(attempt) if known <= attempt.known_points => {
                (oriented > attempt.oriented).then_some(Turn::Again)
            }
            _ => Some(Turn::New),
        }
    };
    let waiting = network
        .used_images()
        .filter(|(_, image)| image.station.is_none() && image.detections.is_some());
    waiting
        .map(|(id, image)| (known_points(network, image), id, image))
        .filter(|(known, _, image)| is_enough(network, image, *known))
        .filter_map(|(known, id, image)| Some((turn(image, known)?, known, id)))
        // Most known points first; of equal ones the first image.
        .min_by_key(|(turn, known, id)| (*turn, std::cmp::Reverse(*known), *id))
        .map(|(.., id)| id)
}

/// Whether an image is tried with what is known now for the first time.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Turn {
    New,
    Again,
}

/// Whether an image with so many known points can be oriented.
fn is_enough(network: &Network, image: &ImageEntry, known: usize) -> bool {
    let by_hand = image.used_labels().filter(|(_, label)| {
        label.source == Source::Operator && network.points.contains_key(&label.point)
    });
    known >= POINTS_TO_CONNECT || by_hand.count() >= POINTS_BY_HAND
}

/// Connects one image, or records why it cannot be connected now.
pub(super) fn run(network: &mut Network, id: ImageId, monitor: &Monitor) -> Result<(), Halt> {
    let task = monitor.task(format!("connecting {}", network.images[&id].file.path), 3);
    task.step()?;
    let rays = known_rays(network, id);
    let before = network.clone();
    let open = match resect(network, id, &rays) {
        Err(reason) => {
            let attempt = Attempt {
                basis: network.inputs,
                known_points: rays.len(),
                oriented: network.oriented_images().count(),
                reason,
            };
            network.image_mut(id).attempt = Some(attempt);
            return Ok(());
        }
        Ok(resection) => {
            let open = settle_misfits(network, id, &rays, &resection.misfits);
            let image = network.image_mut(id);
            image.station = Some(Station {
                pose: resection.pose,
                covariance: None,
            });
            image.attempt = None;
            give_names(image, &resection.named);
            Arc::make_mut(&mut network.connection_order).push(id);
            open
        }
    };
    task.step()?;
    intersect_new_points(network);
    settle_minority(network, &open);
    task.step()?;
    match update(network, monitor) {
        // The others were adjusted without it before: it is this image that they cannot be adjusted with.
        Err(Halt::Failed(error)) => {
            *network = before;
            network.image_mut(id).attempt = Some(Attempt {
                basis: network.inputs,
                known_points: rays.len(),
                oriented: network.oriented_images().count(),
                reason: error.to_string(),
            });
            Ok(())
        }
        other => other,
    }
}

/// A bundle update of all that is connected: the lens held near its nominal values, gross errors left out for this time.
pub(super) fn update(network: &mut Network, monitor: &Monitor) -> Result<(), Halt> {
    restore_rejected(network);
    apply_frame(network);
    let held =
        |network: &Network| Bundle::assemble(network, LensFreedom::Provisional, DatumPoints::All);
    if held(network).is_empty() {
        return Ok(());
    }
    let settings = BundleSettings {
        convergence: UPDATE_CONVERGENCE,
        ..BundleSettings::default()
    };
    let (bundle, robust) =
        adjust_what_holds(network, held, settings, monitor).map_err(adjust::halt)?;
    bundle.write_back(network, &robust.adjustment);
    // What took no part stands where the network was before, and is intersected anew.
    Arc::make_mut(&mut network.points).retain(|_, point| point.covariance.is_some());
    if !bundle.stands_on_control() {
        apply_frame(network);
    }
    Ok(())
}

/// Codes most of whose dots miss the resection by far. Where three or more images agree on the code, its reading is
/// wrong here and its names are taken away. Where only two do, either may be wrong: the code loses its coordinates and
/// is returned, to be intersected anew with this image as judge.
fn settle_misfits(
    network: &mut Network,
    id: ImageId,
    rays: &[KnownRay],
    misfits: &[usize],
) -> Vec<Code> {
    let mut open = Vec::new();
    for code in mostly_missing(rays, misfits) {
        let (family, number) = code;
        let agreeing = PointId::of_code(family, number)
            .iter()
            .filter_map(|point| Some(network.points.get(point)?.rays))
            .max();
        if agreeing.is_some_and(|rays| rays <= 2) {
            Arc::make_mut(&mut network.points).retain(|point, _| point.code() != Some(code));
            open.push(code);
        } else {
            set_code_aside(network.image_mut(id), family, number, OFF_ITS_PLACE);
        }
    }
    open
}

/// Takes the names of these codes away in the images that the new intersections contradict.
fn settle_minority(network: &mut Network, open: &[Code]) {
    if open.is_empty() {
        return;
    }
    let ids: Vec<ImageId> = network.oriented_images().map(|(id, ..)| id).collect();
    for id in ids {
        let rays = known_rays(network, id);
        let misfits = misfits(network, id, &rays);
        for code in mostly_missing(&rays, &misfits) {
            if open.contains(&code) {
                set_code_aside(network.image_mut(id), code.0, code.1, OFF_ITS_PLACE);
            }
        }
    }
}

/// Codes more than half of whose dots are among the misfits.
fn mostly_missing(rays: &[KnownRay], misfits: &[usize]) -> Vec<Code> {
    let missed: BTreeSet<Code> = misfits
        .iter()
        .filter_map(|&index| rays[index].point.code())
        .collect();
    missed
        .into_iter()
        .filter(|code| {
            let of_code = |index: &usize| rays[*index].point.code() == Some(*code);
            let all = (0..rays.len()).filter(of_code).count();
            2 * misfits.iter().filter(|index| of_code(index)).count() > all
        })
        .collect()
}

/// The images that could not be connected and the readings set aside, each with its reason.
pub(super) fn findings(network: &Network) -> Vec<Finding> {
    let unconnected = network
        .used_images()
        .filter(|(_, image)| image.station.is_none() && image.unreadable.is_none())
        .map(|(id, image)| {
            let reason = image.attempt.as_ref().map_or_else(
                || {
                    let known = known_points(network, image);
                    format!(
                        "it shows {known} known points, {POINTS_TO_CONNECT} are needed, or {POINTS_BY_HAND} that you label"
                    )
                },
                |attempt| attempt.reason.clone(),
            );
            Finding {
                stage: Stage::Connect,
                kind: FindingKind::UnconnectedImage,
                about: About::Image(id),
                text: format!("{}: not connected: {reason}", image.file.path),
            }
        });
    unconnected
        .chain(codes_set_aside(network, Stage::Connect, OFF_ITS_PLACE))
        .collect()
}
