//! The same point by its place.

use nalgebra::Vector3;

use super::{Pair, ReferencePoint};

/// Share of the smallest spacing within which a place is unmistakable: at less than a half a point cannot be near two.
const SHARE_OF_SPACING: f64 = 1.0 / 3.0;
/// Share of the extent beyond which a neighbour is another point, however far apart the reference points are.
const SHARE_OF_EXTENT: f64 = 0.01;

/// A point that looks for a counterpart.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    /// Its place in the list that it comes from.
    pub(super) index: usize,
    /// Where it is in the frame of the reference, mm.
    pub(super) place: Vector3<f64>,
}

/// Within what distance points of this reference are the same, mm; 0 where there are fewer than two places.
pub(in crate::report) fn place_distance(reference: &[ReferencePoint]) -> f64 {
    let places: Vec<Vector3<f64>> = reference
        .iter()
        .filter_map(ReferencePoint::position)
        .collect();
    let mut smallest = f64::INFINITY;
    let mut largest = 0.0_f64;
    for (index, place) in places.iter().enumerate() {
        for other in &places[..index] {
            let squared = (place - other).norm_squared();
            largest = largest.max(squared);
            // The same place twice says nothing about the spacing.
            if squared > 0.0 {
                smallest = smallest.min(squared);
            }
        }
    }
    if largest > 0.0 {
        (SHARE_OF_SPACING * smallest.sqrt()).min(SHARE_OF_EXTENT * largest.sqrt())
    } else {
        0.0
    }
}

/// Pairs that lie within `distance`, nearest first, each point in one pair at most.
///
/// Cost: the product of the two counts.
pub(super) fn by_place(points: &[Candidate], reference: &[Candidate], distance: f64) -> Vec<Pair> {
    let mut near = Vec::new();
    for known in reference {
        for point in points {
            let apart = (point.place - known.place).norm();
            if apart <= distance {
                near.push((apart, known.index, point.index));
            }
        }
    }
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut pairs: Vec<Pair> = Vec::new();
    let mut taken = std::collections::BTreeSet::new();
    let mut used = std::collections::BTreeSet::new();
    for (_, reference, point) in near {
        if !taken.contains(&reference) && !used.contains(&point) {
            taken.insert(reference);
            used.insert(point);
            pairs.push(Pair { point, reference });
        }
    }
    pairs.sort_by_key(|pair| pair.reference);
    pairs
}
