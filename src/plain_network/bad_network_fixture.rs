//! Networks with noise for the tests of bad ones: sound, flat, with control, in two blocks.

use nalgebra::Vector3;

use super::fixture::{imaged, lens, places, ring_poses};
use super::*;
use crate::adjustment::RejectionSettings;
use crate::camera::LensDirection;
use crate::geometry::{Pose, Scale, fit_similarity};
use crate::monitor::Monitor;

/// Control points of the networks with control, spread over the field.
pub(super) const CONTROL: [usize; 6] = [0, 5, 14, 21, 24, 29];

/// Noise of the image points, px (sigma 0.1 is stated): uniform within 0.15 px, by a sequence of low discrepancy.
pub(super) fn with_noise(mut network: PlainNetwork) -> PlainNetwork {
    for (k, seen) in network.observations.iter_mut().enumerate() {
        let part = |step: f64| (k as f64 * step).fract() * 0.3 - 0.15;
        seen.x_px += part(0.618_033_988_7);
        seen.y_px += part(0.754_877_666_2);
    }
    network
}

pub(super) fn sound() -> PlainNetwork {
    let places = places();
    with_noise(imaged(
        lens(LensDirection::Correcting),
        &places,
        &ring_poses(&places),
    ))
}

/// Flat points in the plane z = 0, seen as the others are; the principal distance is estimated.
pub(super) fn flat(poses: impl Fn(&[Vector3<f64>]) -> Vec<Pose>) -> PlainNetwork {
    let places: Vec<Vector3<f64>> = places()
        .iter()
        .map(|p| Vector3::new(p.x, p.y, 0.0))
        .collect();
    let mut camera = lens(LensDirection::Correcting);
    camera.parameters[0] = PlainParameter::Free;
    with_noise(imaged(camera, &places, &poses(&places)))
}

/// Seven images along a line, all towards the middle, alternately turned.
pub(super) fn along_a_line(places: &[Vector3<f64>]) -> Vec<Pose> {
    let middle = places.iter().sum::<Vector3<f64>>() / places.len() as f64;
    (0..7)
        .map(|k| {
            let from = middle + Vector3::new(150.0 * f64::from(k) - 450.0, 0.0, 900.0);
            Pose::looking_at(from, middle, Vector3::y(), 1.6 * f64::from(k))
        })
        .collect()
}

/// Eight images on a circle that look straight down.
pub(super) fn square_on(places: &[Vector3<f64>]) -> Vec<Pose> {
    let middle = places.iter().sum::<Vector3<f64>>() / places.len() as f64;
    (0..8)
        .map(|k| {
            let around = std::f64::consts::TAU * f64::from(k) / 8.0;
            let from = middle + Vector3::new(120.0 * around.cos(), 120.0 * around.sin(), 900.0);
            let below = Vector3::new(from.x, from.y, middle.z);
            Pose::looking_at(from, below, Vector3::y(), 0.0)
        })
        .collect()
}

/// [`sound`] with control points in the place of the distance.
pub(super) fn with_control(sigma_mm: Option<f64>) -> PlainNetwork {
    let mut network = sound();
    network.distances.clear();
    network.datum = PlainDatum::Control;
    let places = places();
    for point in CONTROL {
        network.points[point].role = PointRole::Control;
        network.points[point].known = [0, 1, 2].map(|axis| {
            Some(Known {
                value_mm: places[point][axis],
                sigma_mm,
            })
        });
    }
    network
}

/// [`sound`] with two more distances.
pub(super) fn with_three_distances() -> PlainNetwork {
    let mut network = sound();
    let places = places();
    for (name, from, to) in [("second", 5, 24), ("third", 2, 27)] {
        network.distances.push(PlainDistance {
            name: name.into(),
            from,
            to,
            length_mm: (places[to] - places[from]).norm(),
            ..network.distances[0].clone()
        });
    }
    network
}

/// [`with_control`] of which three images see the last twelve points alone, the others the rest.
pub(super) fn two_blocks_with_control() -> PlainNetwork {
    let mut network = with_control(Some(0.02));
    network
        .observations
        .retain(|o| (o.image < 3) == (o.point >= 18));
    network
}

pub(super) fn adjusted(
    network: &PlainNetwork,
    rejection: Option<RejectionSettings>,
) -> PlainAdjustment {
    let settings = PlainSettings {
        rejection,
        ..PlainSettings::default()
    };
    network.adjust(&settings, &Monitor::new()).unwrap()
}

/// Largest distance from the true places after a best fit without scale, mm.
pub(super) fn largest_error(
    adjusted: &PlainAdjustment,
    truth: &[Vector3<f64>],
    scale: Scale,
) -> f64 {
    let found = adjusted.points.iter().zip(&adjusted.adjustment.points);
    let pairs: Vec<_> = found.map(|(&k, own)| (own.position, truth[k])).collect();
    let fit = fit_similarity(&pairs, scale).unwrap();
    let errors = pairs
        .iter()
        .map(|(found, truth)| (fit.apply(found) - truth).norm());
    errors.fold(0.0, f64::max)
}

pub(super) fn without_starts(mut network: PlainNetwork) -> PlainNetwork {
    for image in &mut network.images {
        image.start = None;
    }
    for point in &mut network.points {
        point.start = None;
    }
    network
}
