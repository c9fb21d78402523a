//! Adjustments that set images aside whose orientation nothing holds any more.

use std::sync::Arc;

use super::bundle::{Bundle, BundleFailure, known_points};
use super::set_aside::{readings_aside, take_reading_up};
use crate::adjustment::{
    AdjustmentError, BundleSettings, RejectionSettings, RobustAdjustment, Settled, adjust,
    adjust_with_rejection, settle,
};
use crate::monitor::{Interrupted, Monitor};
use crate::network::{Attempt, ImageId, Network};

/// Adjusts with rejection, until it changes no more than the share `enough` of the observations. An image whose orientation its
/// remaining points no longer determine is set aside, and the rest is adjusted; fewer than two images are an error.
///
/// # Errors
/// As [`adjust_with_rejection`].
pub(super) fn adjust_what_holds(
    network: &mut Network,
    assemble: impl Fn(&Network) -> Result<Bundle, Interrupted>,
    settings: BundleSettings,
    enough: f64,
    monitor: &Monitor,
) -> Result<(Bundle, RobustAdjustment), BundleFailure> {
    what_holds(network, assemble, monitor, |bundle, rejection| {
        let rejection = RejectionSettings {
            enough,
            ..*rejection
        };
        adjust_with_rejection(&bundle.problem, settings, &rejection, monitor)
    })
}

/// The same without rejection: every observation is used.
///
/// # Errors
/// As [`adjust`].
pub(super) fn adjust_all_that_holds(
    network: &mut Network,
    assemble: impl Fn(&Network) -> Result<Bundle, Interrupted>,
    settings: BundleSettings,
    monitor: &Monitor,
) -> Result<(Bundle, RobustAdjustment), BundleFailure> {
    let everything = |network: &Network| {
        let mut bundle = assemble(network)?;
        bundle.problem.rejected.clear();
        Ok(bundle)
    };
    what_holds(network, everything, monitor, |bundle, _| {
        Ok(RobustAdjustment {
            adjustment: adjust(bundle.problem.clone(), settings, monitor)?,
            rejected: Vec::new(),
            dropped_points: Vec::new(),
            passes: 1,
        })
    })
}

/// The same without precision and fine tests.
///
/// # Errors
/// As [`settle`].
pub(super) fn settle_what_holds(
    network: &mut Network,
    assemble: impl Fn(&Network) -> Result<Bundle, Interrupted>,
    settings: BundleSettings,
    monitor: &Monitor,
) -> Result<(Bundle, Settled), BundleFailure> {
    what_holds(network, assemble, monitor, |bundle, rejection| {
        settle(&bundle.problem, settings, rejection, monitor)
    })
}

fn what_holds<T>(
    network: &mut Network,
    assemble: impl Fn(&Network) -> Result<Bundle, Interrupted>,
    monitor: &Monitor,
    adjust: impl Fn(&Bundle, &RejectionSettings) -> Result<T, AdjustmentError>,
) -> Result<(Bundle, T), BundleFailure> {
    let rejection = RejectionSettings {
        critical: network.settings.critical_w,
        ..RejectionSettings::default()
    };
    loop {
        let bundle = assemble(network)?;
        monitor.check()?;
        match adjust(&bundle, &rejection) {
            Err(AdjustmentError::StationUnderdetermined { station, found })
                if bundle.images.len() > 2 =>
            {
                set_image_aside(network, bundle.images[station], found);
            }
            Ok(adjusted) => return Ok((bundle, adjusted)),
            Err(error) => return Err(bundle.failure(network, error)),
        }
    }
}

/// Takes an image's orientation away; it waits until more points are known.
fn set_image_aside(network: &mut Network, id: ImageId, found: usize) {
    let attempt = Attempt {
        basis: network.inputs,
        known_points: known_points(network, &network.images[&id]),
        oriented: network.oriented_images().count() - 1,
        knowledge: network.knowledge(),
        reason: format!("only {found} of its points hold its orientation, 3 are needed"),
    };
    let image = network.image_mut(id);
    image.station = None;
    image.attempt = Some(attempt);
    // It was the orientation that judged them.
    for place in readings_aside(image) {
        take_reading_up(image, place);
    }
    Arc::make_mut(&mut network.connection_order).retain(|other| *other != id);
}
