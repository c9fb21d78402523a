//! Image measurements without pictures.

use nalgebra::Vector2;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::noise::{generator, normal};
use super::{Scene, truth_dots};
use crate::camera::Camera;
use crate::geometry::Pose;

/// Dots seen more obliquely than this are too dark to be measured (retro-reflective film returns a quarter there).
pub const MAX_OBSERVED_INCIDENCE_DEG: f64 = 65.0;

/// A simulated measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SimulatedObservation {
    /// Label of the dot.
    pub label: String,
    /// Centre of the dot's image with noise, px.
    pub centre_px: Vector2<f64>,
}

/// The centres of the images of all wholly visible dots, with normal noise of `sigma_px` per coordinate: one list for
/// each pose, in the scene's order. Dots beyond [`MAX_OBSERVED_INCIDENCE_DEG`] are left out.
#[must_use]
pub fn simulate_observations(
    scene: &Scene,
    camera: &Camera,
    poses: &[Pose],
    sigma_px: f64,
    seed: u64,
) -> Vec<Vec<SimulatedObservation>> {
    poses
        .par_iter()
        .enumerate()
        .map(|(image, pose)| {
            let mut random = generator(seed, image as u64);
            truth_dots(scene, camera, pose)
                .into_iter()
                .filter(|dot| dot.is_whole() && dot.incidence_deg <= MAX_OBSERVED_INCIDENCE_DEG)
                .filter_map(|dot| {
                    let noise = Vector2::new(normal(&mut random), normal(&mut random)) * sigma_px;
                    Some(SimulatedObservation {
                        centre_px: dot.centre_of_image_px? + noise,
                        label: dot.label,
                    })
                })
                .collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::{BoxSettings, box_experiment};
    use super::*;

    #[test]
    fn observations_are_true_centres_with_the_noise_asked_for() {
        let settings = BoxSettings {
            stations: 6,
            ..BoxSettings::default()
        };
        let experiment = box_experiment(&settings).unwrap();
        let (scene, camera, poses) = (&experiment.scene, &experiment.camera, experiment.poses());
        let exact = simulate_observations(scene, camera, &poses, 0.0, 1);
        let noisy = simulate_observations(scene, camera, &poses, 0.05, 1);
        let truth = truth_dots(scene, camera, &poses[2]);
        for observation in &exact[2] {
            let dot = truth.iter().find(|dot| dot.label == observation.label);
            assert_eq!(dot.unwrap().centre_of_image_px, Some(observation.centre_px));
        }
        let (mut squares, mut count) = (0.0, 0.0);
        for (a, b) in exact.iter().flatten().zip(noisy.iter().flatten()) {
            assert_eq!(a.label, b.label);
            squares += (a.centre_px - b.centre_px).norm_squared();
            count += 2.0;
        }
        let sigma = f64::sqrt(squares / count);
        // The standard error of a sigma from `count` values is sigma / sqrt(2 count).
        assert!(
            count > 300.0 && (sigma / 0.05 - 1.0).abs() < 4.0 / f64::sqrt(2.0 * count),
            "{sigma} {count}"
        );
    }
}
