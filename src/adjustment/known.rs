//! What is known beforehand, against what everything else gives: coordinates of points and camera parameters.

use serde::{Deserialize, Serialize};

use super::statistics::UNCONTROLLED;

/// Residual and reliability of a known coordinate or camera parameter; lengths in mm, others in the parameter's unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct KnownStatistics {
    /// Computed minus known.
    pub residual: f64,
    /// Redundancy number, 0 to 1.
    pub redundancy: f64,
    /// `w = v / (sigma sqrt(r))` with the a-priori sigma (Baarda, 1968); 0 where nothing controls it.
    pub normalised: f64,
}

impl KnownStatistics {
    /// Of a value known to `sigma` whose estimate has this cofactor (its variance for a standard deviation of unit
    /// weight of 1).
    ///
    /// Any generalised inverse of the normal matrix gives the cofactor: the observation of the value hinders every free
    /// motion that would change it, so that its row is in the row space (Teunissen, 1985).
    pub(super) fn of(residual: f64, sigma: f64, cofactor: f64) -> Self {
        let redundancy = (1.0 - cofactor / (sigma * sigma)).clamp(0.0, 1.0);
        let normalised = if redundancy > UNCONTROLLED {
            residual / (sigma * redundancy.sqrt())
        } else {
            0.0
        };
        Self {
            residual,
            redundancy,
            normalised,
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::super::simulation::{bar, solve, toy};
    use super::super::{
        Adjustment, BundleProblem, CoordinatePrior, Datum, ParameterState, PointBlock,
    };

    fn sum_of_redundancy_numbers(adjustment: &Adjustment) -> f64 {
        let rays = adjustment.observations.iter().map(|o| o.redundancy.sum());
        let bars = adjustment.distances.iter().flatten().map(|d| d.redundancy);
        let points = adjustment.points.iter().flat_map(|p| p.known);
        let cameras = adjustment.cameras.iter().flat_map(|c| c.known);
        let known = points.chain(cameras).flatten().map(|k| k.redundancy);
        rays.chain(bars).chain(known).sum()
    }

    /// Two known points, of which one lacks a coordinate, a bar and a known principal distance.
    fn partial_control() -> BundleProblem {
        let mut toy = toy(11);
        let problem = &mut toy.problem;
        for p in [0, 7] {
            problem.points[p] = PointBlock::control(toy.truth.points[p], Vector3::repeat(0.02));
        }
        problem.points[7].prior[1] = None;
        problem.distances = vec![bar(&toy.truth, 2, 9, 0.004)];
        problem.cameras[0].parameters[0] = ParameterState::Weighted {
            value: toy.truth.cameras[0].interior.principal_distance,
            sigma: 0.01,
        };
        toy.problem
    }

    #[test]
    fn with_partial_control_the_statistics_of_what_is_known_do_not_depend_on_the_datum() {
        let mut problem = partial_control();
        let mut results = Vec::new();
        for points in [(0..15).collect(), vec![2, 5, 11, 13]] {
            problem.datum = Datum::InnerConstraints { points };
            let adjustment = solve(&problem).unwrap();
            assert!(adjustment.datum_defect > 0);
            // Their sum is the redundancy only where every single one is right.
            let sum = sum_of_redundancy_numbers(&adjustment);
            assert!((sum - adjustment.redundancy as f64).abs() < 1e-6, "{sum}");
            results.push(adjustment);
        }
        let known = |a: &Adjustment| a.points[7].known[2].unwrap();
        let [one, other] = [&results[0], &results[1]].map(known);
        assert!((one.redundancy - other.redundancy).abs() < 1e-8);
        assert!((one.normalised - other.normalised).abs() < 1e-6);
        assert!(results[0].cameras[0].known[0].is_some());
        assert_eq!(results[0].points[7].known[1], None);
    }

    /// `v = -r e` (Baarda, 1968): a gross error shows in its own residual by its redundancy number, and the rest of it
    /// bends the network.
    #[test]
    fn a_gross_error_of_a_coordinate_shows_by_its_redundancy_number() {
        let mut toy = toy(12);
        for p in [0, 4, 9, 12] {
            toy.problem.points[p] = PointBlock::control(toy.truth.points[p], Vector3::repeat(0.02));
        }
        toy.problem.datum = Datum::Control;
        let before = solve(&toy.problem).unwrap().points[9].known[1].unwrap();
        toy.problem.points[9].prior[1] = Some(CoordinatePrior::Weighted {
            value: toy.truth.points[9].y + 0.005,
            sigma: 0.02,
        });
        let after = solve(&toy.problem).unwrap().points[9].known[1].unwrap();
        let change = after.residual - before.residual;
        let expected = -0.005 * before.redundancy;
        assert!(
            (change - expected).abs() < 0.05 * expected.abs(),
            "{change}"
        );
        let expected = after.residual / (0.02 * after.redundancy.sqrt());
        assert!((after.normalised - expected).abs() < 1e-12);
    }
}
