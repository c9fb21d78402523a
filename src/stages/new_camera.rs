//! The first image of a camera whose principal distance nobody stated, among images of other cameras.
//!
//! The search at the first pair ([`super::distance_search`]) gives a principal distance to the cameras of the first images. Another
//! one gets its own from the known points that its first image shows: the one with which they fit best.

use super::resection::{FoundPose, KnownRay, resect};
use crate::monitor::{Interrupted, Monitor};
use crate::network::{ImageId, InteriorSource, Network};

/// Least and most principal distance that is tried, as shares of the width of the picture, and the factor from one to the next.
const SHARES: [f64; 2] = [0.4, 4.0];
const FACTOR: f64 = 1.06;

/// Halvings of the factor round the best one.
const HALVINGS: usize = 5;

/// A dot that misses its place by more is as good as any other that does, px.
const FAR_PX: f64 = 25.0;

/// Whether an image is of a camera without a stated principal distance of which no image is oriented.
pub(super) fn is_first_of_camera(network: &Network, id: ImageId) -> bool {
    let camera = network.images[&id].camera;
    network.cameras[&camera].source == InteriorSource::Unknown
        && !network
            .oriented_images()
            .any(|(_, image, _)| image.camera == camera)
}

/// An orientation with the principal distance that it needs.
struct Fit {
    log_distance: f64,
    found: FoundPose,
    cost: f64,
}

/// Orients an image with the principal distance, mm, that fits its known points best; `None` where none does.
///
/// Cost: some fifty resections.
///
/// # Errors
/// [`Interrupted`] when the work was asked to stop.
pub(super) fn orient(
    network: &Network,
    id: ImageId,
    rays: &[KnownRay],
    monitor: &Monitor,
) -> Result<Option<(f64, FoundPose)>, Interrupted> {
    let camera = &network.camera_of(&network.images[&id]).nominal;
    let width = f64::from(camera.width_px) * camera.pixel_pitch_mm;
    let [from, to] = SHARES.map(|share| (share * width).ln());
    let step = FACTOR.ln();
    let count = ((to - from) / step) as usize;
    let mut best: Option<Fit> = None;
    for k in 0..=count {
        monitor.check()?;
        let tried = fit(network, id, rays, from + k as f64 * step);
        best = best.into_iter().chain(tried).reduce(better);
    }
    let Some(mut best) = best else {
        return Ok(None);
    };
    for halving in 1..=HALVINGS {
        monitor.check()?;
        let aside = step * 0.5_f64.powi(halving as i32);
        let near = [-aside, aside].map(|by| fit(network, id, rays, best.log_distance + by));
        best = near.into_iter().flatten().fold(best, better);
    }
    Ok(Some((best.log_distance.exp(), best.found)))
}

fn better(one: Fit, other: Fit) -> Fit {
    if other.cost < one.cost { other } else { one }
}

fn fit(network: &Network, id: ImageId, rays: &[KnownRay], log_distance: f64) -> Option<Fit> {
    let mut trial = network.clone();
    set_distance(&mut trial, id, log_distance.exp());
    let found = resect(&trial, id, rays).ok()?;
    let camera = &trial.camera_of(&trial.images[&id]).camera;
    let square = |ray: &KnownRay| {
        let seen = &ray.observation;
        let place = camera.project(&found.pose.camera_from_point(&seen.point));
        place
            .map_or(FAR_PX, |place| (place - seen.pixel).norm().min(FAR_PX))
            .powi(2)
    };
    Some(Fit {
        log_distance,
        cost: rays.iter().map(square).sum(),
        found,
    })
}

/// Gives the camera of an image a principal distance, mm.
pub(super) fn set_distance(network: &mut Network, id: ImageId, distance: f64) {
    let entry = network.camera_mut(network.images[&id].camera);
    entry.nominal.interior.principal_distance = distance;
    entry.camera = entry.nominal.clone();
}
