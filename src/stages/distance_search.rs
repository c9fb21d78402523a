//! The principal distance of a camera of which nobody stated it: several are tried on the first images, the one with
//! which most of them fit together best is kept.

use std::sync::Arc;

use super::{Halt, adjust, connect, first_pair};
use crate::monitor::Monitor;
use crate::network::{InteriorSource, Network, Stage};

/// Principal distances that are tried, as shares of the guess: from short wide-angle to short telephoto lenses, so
/// near to each other that an adjustment finds its way from one of them.
const SHARES: [f64; 8] = [1.0, 0.71, 1.41, 0.84, 1.19, 0.5, 2.0, 2.8];

/// Images that a trial connects to its first pair: with eight a lens is calibrated, with rays to spare.
const IMAGES_TO_CONNECT: usize = 6;

/// Whether a camera in use has no stated principal distance.
pub(super) fn is_needed(network: &Network) -> bool {
    network
        .used_images()
        .any(|(_, image)| network.camera_of(image).source == InteriorSource::Unknown)
}

/// What came of one principal distance.
struct Trial {
    network: Network,
    images: usize,
    rms_px: f64,
}

/// Gives cameras without a stated principal distance the one that fits best; unchanged where none does.
///
/// Cost: as many first pairs and connections as there are shares.
pub(super) fn run(network: &mut Network, monitor: &Monitor) -> Result<(), Halt> {
    let task = monitor.task("searching the principal distance", SHARES.len() as u64);
    let mut best: Option<Trial> = None;
    for share in SHARES {
        task.step()?;
        let Some(trial) = try_share(network, share, monitor)? else {
            continue;
        };
        let is_better = |other: &Trial| {
            let images = trial.images.cmp(&other.images);
            images.then(other.rms_px.total_cmp(&trial.rms_px)).is_gt()
        };
        if best.as_ref().is_none_or(is_better) {
            best = Some(trial);
        }
    }
    let Some(best) = best else {
        return Ok(());
    };
    let cameras = Arc::make_mut(&mut network.cameras);
    for (id, entry) in cameras.iter_mut() {
        if entry.source == InteriorSource::Unknown {
            let found = best.network.cameras[id].camera.interior.principal_distance;
            let entry = Arc::make_mut(entry);
            entry.nominal.interior.principal_distance = found;
            entry.camera = entry.nominal.clone();
        }
    }
    Ok(())
}

/// The first images measured with this share of the guessed principal distances; `None` where they cannot be.
fn try_share(network: &Network, share: f64, monitor: &Monitor) -> Result<Option<Trial>, Halt> {
    let mut network = network.clone();
    for entry in Arc::make_mut(&mut network.cameras).values_mut() {
        if entry.source == InteriorSource::Unknown {
            let entry = Arc::make_mut(entry);
            entry.nominal.interior.principal_distance *= share;
            entry.camera = entry.nominal.clone();
        }
    }
    if succeeds(first_pair::orient(&mut network, monitor))?.is_none() {
        return Ok(None);
    }
    for _ in 0..IMAGES_TO_CONNECT {
        let Some(next) = connect::next(&network) else {
            break;
        };
        let Some(after) = succeeds(connect::run(network, &next, monitor))? else {
            return Ok(None);
        };
        network = after;
    }
    if succeeds(adjust::adjust(&mut network, Stage::AdjustCodes, monitor))?.is_none() {
        return Ok(None);
    }
    Ok(network
        .adjustment
        .as_ref()
        .map(|a| a.rms_px)
        .map(|rms_px| Trial {
            images: network.oriented_images().count(),
            rms_px,
            network,
        }))
}

/// What a step of a trial gave, `None` where it could not be done; an interrupt ends the search.
fn succeeds<T>(result: Result<T, Halt>) -> Result<Option<T>, Halt> {
    match result {
        Ok(given) => Ok(Some(given)),
        Err(Halt::Failed(_)) => Ok(None),
        Err(Halt::Interrupted) => Err(Halt::Interrupted),
    }
}
