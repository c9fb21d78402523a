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
