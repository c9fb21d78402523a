//! Whether chance explains that places agree: the expected number of false alarms (Moisan and Stival, 2004).

use nalgebra::{Matrix3, Vector3};
use statrs::function::factorial::ln_binomial;

/// Natural logarithm of how much rarer than once in all trials an agreement must be to be none of chance: once in a
/// thousand lists.
pub(super) const LEAST_EVIDENCE: f64 = 6.9;

/// Share of the place distance below which nearer says nothing more: lists are rounded.
const FINEST_SHARE: f64 = 1e-3;

/// What chance could do with a list.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chance {
    /// Points of the shorter list.
    smaller: usize,
    /// Known places.
    known: f64,
    /// Lengths of the room they fill, along its principal axes, mm.
    lengths: [f64; 3],
    /// Logarithm of the number of trials.
    ln_trials: f64,
    /// Points that a trial brings together by itself.
    given: usize,
    /// Distance below which nearer says nothing more, mm.
    finest: f64,
}

impl Chance {
    /// One trial: the lists as they are.
    pub(super) fn of_one_frame(points: usize, known: &[Vector3<f64>], within: f64) -> Self {
        Self {
            smaller: points.min(known.len()),
            known: known.len() as f64,
            lengths: principal_lengths(known),
            ln_trials: 0.0,
            given: 0,
            finest: within * FINEST_SHARE,
        }
    }

    /// Every triangle of one list laid on every triangle of the other.
    pub(super) fn of_triangles(points: usize, known: &[Vector3<f64>], within: f64) -> Self {
        let triangles = |count: usize| ln_binomial(count as u64, 3);
        Self {
            ln_trials: 6_f64.ln() + triangles(points) + triangles(known.len()),
            given: 3,
            ..Self::of_one_frame(points, known, within)
        }
    }

    /// How much rarer than once in all trials chance gives what is found (natural logarithm), at the most telling of the
    /// distances, which are sorted, mm.
    pub(super) fn evidence(&self, distances: &[f64]) -> f64 {
        let of_nearest = |count: usize| {
            let free = count.saturating_sub(self.given) as f64;
            let ways = ln_binomial(self.smaller as u64, count as u64);
            -free * self.ln_near_by_chance(distances[count - 1]) - ways - self.ln_trials
        };
        let counts = self.given + 1..=distances.len().min(self.smaller);
        counts.map(of_nearest).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Logarithm of the probability that a place by chance has a known one within a distance; a flat or long list fills
    /// no more than a layer of that distance about it.
    fn ln_near_by_chance(&self, distance: f64) -> f64 {
        let distance = distance.max(self.finest);
        let ball = 4.0 / 3.0 * std::f64::consts::PI * distance.powi(3);
        let room: f64 = self.lengths.iter().map(|l| l.max(2.0 * distance)).product();
        (self.known * ball / room).ln().min(0.0)
    }
}

/// The lengths of a box with evenly spread points of the same principal deviations, longest first, mm.
pub(super) fn principal_lengths(places: &[Vector3<f64>]) -> [f64; 3] {
    let count = places.len().max(1) as f64;
    let centre = places.iter().sum::<Vector3<f64>>() / count;
    let square = |place: &Vector3<f64>| (place - centre) * (place - centre).transpose();
    let spread: Matrix3<f64> = places.iter().map(square).sum::<Matrix3<f64>>() / count;
    let mut lengths = spread
        .symmetric_eigenvalues()
        .map(|variance| (12.0 * variance.max(0.0)).sqrt());
    lengths.as_mut_slice().sort_by(|a, b| b.total_cmp(a));
    lengths.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_is_telling_and_far_is_not() {
        let known: Vec<Vector3<f64>> = (0..100)
            .map(f64::from)
            .map(|i| Vector3::new((i * 37.0) % 1000.0, (i * 71.0) % 700.0, (i * 13.0) % 400.0))
            .collect();
        let chance = Chance::of_triangles(100, &known, 5.0);
        assert!(chance.evidence(&[0.01; 20]) > 300.0);
        assert!(chance.evidence(&[0.01; 3]) < 0.0, "three are laid on three");
        assert!(chance.evidence(&[80.0; 20]) < LEAST_EVIDENCE);
        // A few far ones take nothing from the near ones.
        let mut mixed = vec![0.01; 20];
        mixed.extend([60.0; 5]);
        assert_eq!(chance.evidence(&mixed), chance.evidence(&[0.01; 20]));
        assert!(Chance::of_one_frame(100, &known, 5.0).evidence(&[]) < 0.0);
    }
}
