//! Points that an iteration carries away: their rays do not meet, and a step far off costs no more than one just far enough.

use nalgebra::Vector3;

use super::equations::State;
use super::median::median;

/// Distance from the middle of all points, as a multiple of the median one, beyond which a point has run away.
const FAR: f64 = 100.0;

/// Those of the given points that have run away from them.
pub(super) fn runaways(state: &State, points: &[usize]) -> Vec<usize> {
    let of_axis = |axis: usize| {
        let coordinates = points.iter().map(|&p| state.points[p][axis]);
        median(coordinates.collect()).unwrap_or(0.0)
    };
    let middle = Vector3::new(of_axis(0), of_axis(1), of_axis(2));
    let distance = |p: &usize| (state.points[*p] - middle).norm();
    let limit = FAR * median(points.iter().map(distance).collect()).unwrap_or(f64::INFINITY);
    let all = points.iter().copied();
    all.filter(|p| distance(p) > limit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_point_far_off_has_run_away() {
        let mut points: Vec<Vector3<f64>> = (0..9)
            .map(|k| Vector3::new(f64::from(k % 3), f64::from(k / 3), 0.0))
            .collect();
        points[4].z = 1e4;
        let state = State {
            cameras: Vec::new(),
            own_cameras: Vec::new(),
            poses: Vec::new(),
            circles: vec![None; points.len()],
            points,
        };
        let all: Vec<usize> = (0..9).collect();
        assert_eq!(runaways(&state, &all), [4]);
        assert!(runaways(&state, &[0, 1, 2, 3, 5, 6, 7, 8]).is_empty());
    }
}
