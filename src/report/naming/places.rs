//! Places in space, found by nearness.

use nalgebra::Vector3;

/// A place that is near.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Near {
    /// Its place in the list.
    pub(super) index: usize,
    /// How far it is, mm.
    pub(super) distance: f64,
}

/// A list of places in the order of their coordinate along the axis in which they lie widest apart.
pub(super) struct Places<'a> {
    places: &'a [Vector3<f64>],
    axis: usize,
    order: Vec<usize>,
    coordinates: Vec<f64>,
}

impl<'a> Places<'a> {
    pub(super) fn new(places: &'a [Vector3<f64>]) -> Self {
        let extent = |axis: &usize| {
            let values = places.iter().map(|place| place[*axis]);
            values.clone().fold(f64::NEG_INFINITY, f64::max) - values.fold(f64::INFINITY, f64::min)
        };
        let axis = (0..3)
            .max_by(|a, b| extent(a).total_cmp(&extent(b)))
            .unwrap_or_default();
        let mut order: Vec<usize> = (0..places.len()).collect();
        order.sort_by(|&a, &b| places[a][axis].total_cmp(&places[b][axis]).then(a.cmp(&b)));
        Self {
            coordinates: order.iter().map(|&index| places[index][axis]).collect(),
            places,
            axis,
            order,
        }
    }

    /// The nearest of the list within `limit`, mm.
    pub(super) fn nearest(&self, place: &Vector3<f64>, limit: f64) -> Option<Near> {
        self.nearest_of::<1>(place, limit)[0]
    }

    /// The two nearest of the list, the nearer one first.
    pub(super) fn two_nearest(&self, place: &Vector3<f64>) -> [Option<Near>; 2] {
        self.nearest_of::<2>(place, f64::INFINITY)
    }

    /// Outwards from the place along the axis, until what follows must be farther than what was found.
    fn nearest_of<const N: usize>(&self, place: &Vector3<f64>, limit: f64) -> [Option<Near>; N] {
        let mut found = [None; N];
        let start = self.coordinates.partition_point(|c| *c < place[self.axis]);
        let ways: [&mut dyn Iterator<Item = usize>; 2] =
            [&mut (start..self.order.len()), &mut (0..start).rev()];
        for way in ways {
            for at in way {
                let reach = found[N - 1].map_or(limit, |near: Near| near.distance);
                if (self.coordinates[at] - place[self.axis]).abs() > reach {
                    break;
                }
                let index = self.order[at];
                let distance = (self.places[index] - place).norm();
                if distance <= reach {
                    insert(&mut found, Near { index, distance });
                }
            }
        }
        found
    }
}

/// Puts a place among the nearest, nearest first; of two at one distance the one that is earlier in the list is first.
fn insert<const N: usize>(found: &mut [Option<Near>; N], near: Near) {
    let is_nearer = |other: &Option<Near>| {
        other.is_none_or(|other| (near.distance, near.index) < (other.distance, other.index))
    };
    if let Some(at) = found.iter().position(is_nearer) {
        found[at..].rotate_right(1);
        found[at] = Some(near);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn the_nearest_are_those_of_a_look_at_all() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut place = || {
            let size = [300.0, 1000.0, 50.0];
            Vector3::from(size.map(|size| random.random_range(0.0..size)))
        };
        let places: Vec<Vector3<f64>> = (0..200).map(|_| place()).collect();
        let index = Places::new(&places);
        for _ in 0..200 {
            let here = place();
            let mut all: Vec<(f64, usize)> = places
                .iter()
                .enumerate()
                .map(|(index, place)| ((place - here).norm(), index))
                .collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
            let found = index.two_nearest(&here).map(|near| near.unwrap().index);
            assert_eq!(found, [all[0].1, all[1].1]);
            let limit = all[0].0 * 0.999;
            assert_eq!(index.nearest(&here, limit), None);
            assert!(index.nearest(&here, all[0].0 * 1.001).is_some());
        }
        assert_eq!(Places::new(&[]).two_nearest(&Vector3::zeros()), [None; 2]);
    }
}
