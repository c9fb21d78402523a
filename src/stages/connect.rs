//! Connecting images one by one: resection, intersection of new points, bundle update.

use std::sync::Arc;

use super::bundle::{Bundle, DatumPoints, restore_rejected};
use super::identify::set_code_aside;
use super::lens::LensFreedom;
use super::resection::{KnownRay, intersect_new_points, known_rays, resect};
use super::scale::apply_scale;
use super::{Halt, adjust};
use crate::adjustment::{BundleSettings, RejectionSettings, adjust_with_rejection};
use crate::monitor::Monitor;
use crate::network::{
    About, Attempt, Finding, FindingKind, ImageEntry, ImageId, Network, PointId, Stage, Station,
};

/// Fewest known points that orient an image: three give up to four poses, the fourth decides.
const POINTS_TO_CONNECT: usize = 4;

/// Convergence of an update, in standard deviations of the observations: the next update moves everything further.
const UPDATE_CONVERGENCE: f64 = 1e-2;

/// The image that comes next: the one that shows most known points, of those not tried with as many before.
///
/// Cost: labelled dots of all images that are not connected yet.
pub(super) fn next(network: &Network) -> Option<ImageId> {
    network
        .used_images()
        .filter(|(_, image)| image.station.is_none() && image.detections.is_some())
        .map(|(id, image)| (known_points(network, image), id, image))
        .filter(|(known, _, image)| {
            let tried = image.attempt.as_ref().filter(|a| a.basis == network.inputs);
            *known >= POINTS_TO_CONNECT && tried.is_none_or(|attempt| *known > attempt.known_points)
        })
        // Most known points first; of equal ones the first image.
        .min_by_key(|(known, id, _)| (std::cmp::Reverse(*known), *id))
        .map(|(_, id, _)| id)
}

fn known_points(network: &Network, image: &ImageEntry) -> usize {
    image
        .used_labels()
        .filter(|(_, label)| network.points.contains_key(&label.point))
        .count()
}

/// Connects one image, or records why it cannot be connected now.
pub(super) fn run(network: &mut Network, id: ImageId, monitor: &Monitor) -> Result<(), Halt> {
    let task = monitor.task(format!("connecting {}", network.images[&id].file.path), 3);
    task.step()?;
    let rays = known_rays(network, id);
    match resect(network, id, &rays) {
        Err(reason) => {
            let attempt = Attempt {
                basis: network.inputs,
                known_points: rays.len(),
                reason,
            };
            network.image_mut(id).attempt = Some(attempt);
            return Ok(());
        }
        Ok(resection) => {
            set_misfits_aside(network, id, &rays, &resection.misfits);
            let image = network.image_mut(id);
            image.station = Some(Station {
                pose: resection.pose,
                covariance: None,
            });
            image.attempt = None;
            Arc::make_mut(&mut network.connection_order).push(id);
        }
    }
    task.step()?;
    intersect_new_points(network);
    task.step()?;
    update(network, monitor)?;
    Ok(())
}

/// A bundle update of all that is connected: the lens held near its nominal values, gross errors left out for this time.
/// Returns the rms residual, px.
pub(super) fn update(network: &mut Network, monitor: &Monitor) -> Result<f64, Halt> {
    restore_rejected(network);
    let images = network.oriented_images().count();
    let bundle = Bundle::assemble(
        network,
        LensFreedom::Provisional { images },
        DatumPoints::All,
    );
    if bundle.is_empty() {
        return Ok(0.0);
    }
    let settings = RejectionSettings {
        critical: network.settings.critical_w,
        ..RejectionSettings::default()
    };
    let bundle_settings = BundleSettings {
        convergence: UPDATE_CONVERGENCE,
        ..BundleSettings::default()
    };
    let robust = adjust_with_rejection(&bundle.problem, bundle_settings, &settings, monitor)
        .map_err(adjust::halt)?;
    bundle.write_back(network, &robust.adjustment);
    apply_scale(network);
    Ok(robust.adjustment.rms_px)
}

/// Codes whose dots miss the resection by far are wrong readings here: their names are taken away.
fn set_misfits_aside(network: &mut Network, id: ImageId, rays: &[KnownRay], misfits: &[usize]) {
    let codes: std::collections::BTreeSet<_> = misfits
        .iter()
        .filter_map(|&index| match rays[index].point {
            PointId::Code { family, code, .. } => Some((family, code)),
            PointId::Device(_) | PointId::Target(_) => None,
        })
        .collect();
    for (family, code) in codes {
        let of_code = |ray: &KnownRay| matches!(ray.point, PointId::Code { family: f, code: c, .. } if (f, c) == (family, code));
        let all = rays.iter().filter(|ray| of_code(ray)).count();
        let missed = misfits
            .iter()
            .filter(|&&index| of_code(&rays[index]))
            .count();
        if 2 * missed > all {
            let path = network.images[&id].file.path.clone();
            let label = family.code_label(code);
            set_code_aside(
                network.image_mut(id),
                family,
                code,
                "it does not lie where the other codes put it",
            );
            network.note(Finding {
                stage: Stage::Connect,
                kind: FindingKind::DoubtfulCode,
                about: About::Image(id),
                text: format!(
                    "{path}: {label} does not lie where the other codes put it; set aside"
                ),
            });
        }
    }
}

/// The images that could not be connected, each with its reason.
pub(super) fn findings(network: &Network) -> Vec<Finding> {
    network
        .used_images()
        .filter(|(_, image)| image.station.is_none() && image.unreadable.is_none())
        .map(|(id, image)| {
            let reason = image.attempt.as_ref().map_or_else(
                || {
                    let known = known_points(network, image);
                    format!("it shows {known} known points, {POINTS_TO_CONNECT} are needed")
                },
                |attempt| attempt.reason.clone(),
            );
            Finding {
                stage: Stage::Connect,
                kind: FindingKind::UnconnectedImage,
                about: About::Image(id),
                text: format!("{}: not connected: {reason}", image.file.path),
            }
        })
        .collect()
}
