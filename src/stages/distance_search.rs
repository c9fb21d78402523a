//! The principal distance of a camera of which neither a file nor EXIF says anything.
//!
//! Two images that look at the same place cannot tell it (Hartley and Zisserman, 2004, 19.9), a handful of convergent,
//! rolled ones can: a small network is begun with each of several distances and adjusted with the distance let go; the
//! one whose dots fit best wins, and its adjusted distance is the start of the measurement.

use super::connect::{self, update};
use super::{Halt, first_pair};
use crate::monitor::Monitor;
use crate::network::{About, CameraId, Finding, FindingKind, InteriorSource, Network, Stage};

/// Principal distances that are tried, as multiples of the image width: from a fisheye's neighbour to a telephoto lens.
const DISTANCES_PER_WIDTH: [f64; 7] = [0.5, 0.68, 0.93, 1.27, 1.73, 2.36, 3.2];

/// Images of the trial networks: enough that the adjustment lets the distance go.
const IMAGES_TO_TRY: usize = 7;

/// A network begun with one distance.
struct Trial {
    /// Adjusted principal distances of the unknown cameras, mm.
    distances: Vec<(CameraId, f64)>,
    images: usize,
    /// Rms residual, px.
    rms_px: f64,
}

/// Searches the principal distances of all cameras without one and puts them into the network as nominal values.
pub(super) fn run(network: &mut Network, monitor: &Monitor) -> Result<(), Halt> {
    let unknown: Vec<CameraId> = network
        .cameras
        .iter()
        .filter(|(_, camera)| camera.source == InteriorSource::Unknown)
        .map(|(id, _)| *id)
        .collect();
    if unknown.is_empty() {
        return Ok(());
    }
    let mut best: Option<Trial> = None;
    for ratio in DISTANCES_PER_WIDTH {
        match begin(network, &unknown, ratio, monitor) {
            Ok(trial) if best.as_ref().is_none_or(|best| trial.beats(best)) => best = Some(trial),
            Err(Halt::Interrupted) => return Err(Halt::Interrupted),
            // A wrong distance may well connect nothing.
            Ok(_) | Err(Halt::Failed(_)) => {}
        }
    }
    let Some(best) = best else { return Ok(()) };
    for (id, distance) in best.distances {
        let camera = network.camera_mut(id);
        camera.nominal.interior.principal_distance = distance;
        camera.camera = camera.nominal.clone();
        let width = camera.nominal.pixel_pitch_mm * f64::from(camera.nominal.width_px);
        let name = camera.name.clone();
        network.note(Finding {
            stage: Stage::FirstPair,
            kind: FindingKind::Camera,
            about: About::Camera(name.clone()),
            text: format!(
                "camera '{name}': no principal distance in a camera file or EXIF; the search found {:.2} times the \
                 image width ({} images, {:.2} px rms)",
                distance / width,
                best.images,
                best.rms_px
            ),
        });
    }
    Ok(())
}

impl Trial {
    /// More images, within one of each other the smaller residuals.
    fn beats(&self, other: &Trial) -> bool {
        if self.images.abs_diff(other.images) > 1 {
            self.images > other.images
        } else {
            self.rms_px < other.rms_px
        }
    }
}

fn begin(
    network: &Network,
    unknown: &[CameraId],
    ratio: f64,
    monitor: &Monitor,
) -> Result<Trial, Halt> {
    let mut trial = network.clone();
    for id in unknown {
        let camera = trial.camera_mut(*id);
        let width = camera.nominal.pixel_pitch_mm * f64::from(camera.nominal.width_px);
        camera.nominal.interior.principal_distance = ratio * width;
        camera.camera = camera.nominal.clone();
    }
    first_pair::orient(&mut trial, monitor)?;
    while trial.connection_order.len() < IMAGES_TO_TRY {
        let Some(next) = connect::next(&trial) else {
            break;
        };
        connect::run(&mut trial, next, monitor)?;
    }
    let rms_px = update(&mut trial, monitor)?;
    Ok(Trial {
        distances: unknown
            .iter()
            .map(|id| (*id, trial.cameras[id].camera.interior.principal_distance))
            .collect(),
        images: trial.connection_order.len(),
        rms_px,
    })
}
