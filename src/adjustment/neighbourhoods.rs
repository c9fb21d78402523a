//! Neighbours in space: what they have in common is still at hand when one is worked on after the other.

use nalgebra::Vector3;

/// Places in groups of neighbours, at most so many each: halved at the median of their longest extent (Friedman, Bentley and
/// Finkel, 1977).
///
/// Cost: the places, times the logarithm of the groups.
pub(super) fn neighbourhoods(places: &[Vector3<f64>], most: usize) -> Vec<Vec<usize>> {
    let mut groups = Vec::new();
    let mut all: Vec<usize> = (0..places.len()).collect();
    halve(places, &mut all, most.max(1), &mut groups);
    groups
}

fn halve(places: &[Vector3<f64>], group: &mut [usize], most: usize, groups: &mut Vec<Vec<usize>>) {
    if group.len() <= most {
        if !group.is_empty() {
            groups.push(group.to_vec());
        }
        return;
    }
    let extent = |axis: usize| {
        let coordinates = || group.iter().map(|&k| places[k][axis]);
        coordinates().fold(f64::NEG_INFINITY, f64::max)
            - coordinates().fold(f64::INFINITY, f64::min)
    };
    let extents = [0, 1, 2].map(extent);
    let longest = |a: &usize, b: &usize| extents[*a].total_cmp(&extents[*b]);
    let axis = (0..3).max_by(longest).unwrap_or(0);
    let half = group.len() / 2;
    // Places that agree are told apart by their number, so that the groups are the same each time.
    group.select_nth_unstable_by(half, |&a, &b| {
        places[a][axis].total_cmp(&places[b][axis]).then(a.cmp(&b))
    });
    let (before, after) = group.split_at_mut(half);
    halve(places, before, most, groups);
    halve(places, after, most, groups);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_place_is_in_one_group_with_its_neighbours() {
        let places: Vec<Vector3<f64>> = (0..100)
            .map(|k| Vector3::new(f64::from(k % 10), f64::from(k / 10), 0.0))
            .collect();
        let groups = neighbourhoods(&places, 8);
        let mut all: Vec<usize> = groups.concat();
        all.sort_unstable();
        assert_eq!(all, (0..100).collect::<Vec<_>>());
        for group in groups {
            assert!(group.len() <= 8);
            let near = |a: usize, b: usize| (places[a] - places[b]).norm() < 5.0;
            assert!(group.iter().all(|&a| group.iter().all(|&b| near(a, b))));
        }
    }

    #[test]
    fn places_that_agree_are_parted_as_well() {
        let groups = neighbourhoods(&[Vector3::zeros(); 9], 2);
        assert!(groups.iter().all(|group| group.len() <= 2));
        assert_eq!(groups.concat().len(), 9);
        assert!(neighbourhoods(&[], 4).is_empty());
    }
}
