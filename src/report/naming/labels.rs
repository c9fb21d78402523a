//! The transformation by points that have the same label in both lists.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::geometry::{Scale, Similarity, fit_similarity};

/// Up to this number of points all triangles are tried, of more a sample.
const MOST_FOR_ALL: usize = 20;
/// Triangles of a sample: where half of the labels are right, all of them miss with a probability of 1e-58.
const SAMPLE: usize = 1000;
/// Rounds of fitting and choosing again; two or three are enough.
const MOST_ROUNDS: usize = 10;

/// A place and the known one of the same label.
pub(super) type LabelledPair = (Vector3<f64>, Vector3<f64>);

/// The largest set of pairs that one similarity brings to within a distance, mm, by their places in the list.
pub(super) fn agreeing(pairs: &[LabelledPair], scale: Scale, within: f64, seed: u64) -> Vec<usize> {
    let all: Vec<usize> = (0..pairs.len()).collect();
    if grown(pairs, &all, scale, within).len() == pairs.len() {
        return all;
    }
    let mut best = Vec::new();
    for triangle in triangles(pairs.len(), seed) {
        let found = grown(pairs, &triangle, scale, within);
        if found.len() > best.len() {
            best = found;
        }
    }
    best
}

/// The pairs that agree with a fit to some, and with the fit to those that agree.
fn grown(pairs: &[LabelledPair], of: &[usize], scale: Scale, within: f64) -> Vec<usize> {
    let mut chosen = of.to_vec();
    for _ in 0..MOST_ROUNDS {
        let used: Vec<LabelledPair> = chosen.iter().map(|&index| pairs[index]).collect();
        let Ok(fit) = fit_similarity(&used, scale) else {
            return Vec::new();
        };
        let near = near(pairs, &fit, within);
        if near == chosen {
            return near;
        }
        chosen = near;
    }
    chosen
}

fn near(pairs: &[LabelledPair], fit: &Similarity, within: f64) -> Vec<usize> {
    let is_near = |index: &usize| {
        let (place, known) = pairs[*index];
        (fit.apply(&place) - known).norm() <= within
    };
    (0..pairs.len()).filter(is_near).collect()
}

fn triangles(count: usize, seed: u64) -> Vec<[usize; 3]> {
    if count <= MOST_FOR_ALL {
        let third = |a: usize, b: usize| (b + 1..count).map(move |c| [a, b, c]);
        let second = |a: usize| (a + 1..count).flat_map(move |b| third(a, b));
        return (0..count).flat_map(second).collect();
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut draw = || std::array::from_fn(|_| random.random_range(0..count));
    (0..SAMPLE)
        .map(|_| draw())
        .filter(|[a, b, c]| a != b && b != c && a != c)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    #[test]
    fn wrong_labels_are_left_out() {
        let truth = Similarity {
            scale: 1.0,
            rotation: Rotation3::from_euler_angles(0.4, -1.1, 2.5),
            translation: Vector3::new(300.0, -20.0, 77.0),
        };
        for count in [6, 40] {
            let mut pairs: Vec<LabelledPair> = (0..count)
                .map(f64::from)
                .map(|i| Vector3::new((i * 37.0) % 101.0, (i * 71.0) % 93.0, (i * 13.0) % 57.0))
                .map(|place| (place, truth.apply(&place)))
                .collect();
            pairs[1].1.x += 40.0;
            pairs[4].1.z -= 8.0;
            let right: Vec<usize> = (0..pairs.len()).filter(|i| ![1, 4].contains(i)).collect();
            assert_eq!(agreeing(&pairs, Scale::One, 1.0, 7), right);
            for pair in &mut pairs {
                pair.1 *= 1.3;
            }
            assert_eq!(agreeing(&pairs, Scale::Free, 1.0, 7), right);
            assert!(agreeing(&pairs, Scale::One, 1.0, 7).len() < right.len());
        }
    }
}
