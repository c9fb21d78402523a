//! Starts of a resection from bodies: points that are named together, rightly or wrongly all of them, as a code's dots are.

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::refine::PoseObservation;
use super::resect_from_points;
use crate::camera::Camera;
use crate::geometry::Pose;

/// Up to so many bodies all singles, pairs and triples are tried: 92.
const FEW: usize = 8;

/// Of more bodies so many triples: where half of them are wrong, all of these have a wrong one once in three thousand times.
const TRIPLES: usize = 60;

/// Fewest points of a body: three leave up to four poses, and one more decides.
const POINTS: usize = 4;

/// The poses that fit the points of some bodies together, given by the places of their points.
///
/// Three dots of different codes may be right where three of a single one give a pose too loose to find the others; the six dots of
/// each of three codes give the pose of the image as well as they can.
pub(super) fn poses_of_bodies(
    camera: &Camera,
    observations: &[PoseObservation],
    bodies: &[Vec<usize>],
    seed: u64,
) -> Vec<Pose> {
    let bodies: Vec<&Vec<usize>> = bodies.iter().filter(|b| b.len() >= POINTS).collect();
    let mut poses = Vec::new();
    for chosen in combinations(bodies.len(), seed) {
        let points = chosen.iter().flat_map(|&body| bodies[body]);
        let points: Vec<PoseObservation> = points.map(|&point| observations[point]).collect();
        let fitted = resect_from_points(camera, &points);
        poses.extend(fitted.iter().map(|fitted| fitted.pose));
    }
    poses
}

fn combinations(bodies: usize, seed: u64) -> Vec<Vec<usize>> {
    let mut chosen = Vec::new();
    if bodies > FEW {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        while chosen.len() < TRIPLES {
            let triple = [0; 3].map(|_| random.random_range(0..bodies));
            if triple[0] < triple[1] && triple[1] < triple[2] {
                chosen.push(triple.to_vec());
            }
        }
        return chosen;
    }
    for i in 0..bodies {
        chosen.push(vec![i]);
        for j in i + 1..bodies {
            chosen.push(vec![i, j]);
            chosen.extend((j + 1..bodies).map(|k| vec![i, j, k]));
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::orientation::simulation::{self, Noise, normal, random, vector};
    use crate::orientation::{ConsensusSettings, resect_by_consensus};

    /// Codes of six dots within 12 mm as a station sees them, the first `wrong` ones named as others.
    fn codes(
        count: usize,
        wrong: usize,
        seed: u64,
    ) -> (Pose, Vec<PoseObservation>, Vec<Vec<usize>>) {
        let camera = simulation::camera();
        let scene = simulation::scene(&camera, count, Noise(0.0), seed);
        let mut rng = random(seed + 5);
        let mut observations = Vec::new();
        for (code, middle) in scene.observations.iter().enumerate() {
            let elsewhere = middle.pixel + Vector2::new(600.0, -450.0);
            for _ in 0..6 {
                let point = middle.point + vector(&mut rng, 12.0);
                let seen = camera.project(&scene.pose.camera_from_point(&point));
                let noise = 0.1 * Vector2::new(normal(&mut rng), normal(&mut rng));
                let pixel = seen.expect("it is in the picture") + noise;
                let pixel = if code < wrong {
                    pixel - middle.pixel + elsewhere
                } else {
                    pixel
                };
                observations.push(PoseObservation {
                    pixel,
                    point,
                    sigma_px: 0.1,
                });
            }
        }
        let bodies = (0..count).map(|code| (6 * code..6 * code + 6).collect());
        (scene.pose, observations, bodies.collect())
    }

    #[test]
    fn the_poses_of_right_codes_are_among_them_whatever_the_others_say() {
        let camera = simulation::camera();
        for (count, wrong) in [(1, 0), (3, 1), (4, 2), (12, 5)] {
            for seed in 0..10 {
                let (pose, observations, bodies) = codes(count, wrong, seed);
                let poses = poses_of_bodies(&camera, &observations, &bodies, 1);
                let nearest = poses
                    .iter()
                    .map(|found| (found.centre_in_world - pose.centre_in_world).norm())
                    .fold(f64::INFINITY, f64::min);
                // A single code of 24 mm at a metre knows its distance to some per cent.
                let limit = if count == 1 { 80.0 } else { 15.0 };
                assert!(nearest < limit, "{count} {wrong} {seed}: {nearest} mm");
            }
        }
    }

    #[test]
    fn the_consensus_agrees_with_the_right_codes_only() {
        let camera = simulation::camera();
        for (count, wrong) in [(4, 1), (5, 2), (12, 5)] {
            for seed in 0..10 {
                let (_, observations, bodies) = codes(count, wrong, seed);
                let settings = ConsensusSettings {
                    tolerance_px: 1.0,
                    ..ConsensusSettings::default()
                };
                let found = resect_by_consensus(&camera, &observations, &bodies, &settings)
                    .expect("a pose");
                let expected: Vec<bool> = (0..6 * count).map(|dot| dot >= 6 * wrong).collect();
                assert_eq!(found.inliers, expected, "{count} {wrong} {seed}");
            }
        }
    }

    #[test]
    fn few_bodies_are_all_combined_and_many_at_random_but_always_alike() {
        assert_eq!(combinations(4, 1).len(), 4 + 6 + 4);
        assert_eq!(combinations(30, 1).len(), TRIPLES);
        assert_eq!(combinations(30, 7), combinations(30, 7));
        assert_eq!(combinations(0, 1), Vec::<Vec<usize>>::new());
    }
}
