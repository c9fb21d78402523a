//! What is known beforehand, against what everything else gives: coordinates of points and camera parameters.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::PointBlock;
use super::statistics::UNCONTROLLED;

/// Residual and reliability of a known coordinate or camera parameter; lengths in mm, others in the parameter's unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct KnownStatistics {
    /// Computed minus known.
    pub residual: f64,
    /// Redundancy number, 0 to 1; that of a correlated coordinate may lie beyond.
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

/// Statistics of a point's observed coordinates with these residuals (computed less known) and cofactors of the point.
///
/// Of correlated ones the redundancy numbers are the diagonal of `Qvv P`, and `w` is `(P v) / sqrt(diag(P Qvv P))` (Baarda, 1968): the
/// test of an error in this coordinate alone.
pub(super) fn known_coordinates(
    block: &PointBlock,
    residuals: &Vector3<f64>,
    cofactors: &Matrix3<f64>,
) -> [Option<KnownStatistics>; 3] {
    let mut known = [None; 3];
    if block.correlations == [0.0; 3] {
        for (axis, _, sigma) in block.weighted_coordinates() {
            let cofactor = cofactors[(axis, axis)];
            known[axis] = Some(KnownStatistics::of(residuals[axis], sigma, cofactor));
        }
        return known;
    }
    // The problem was checked.
    let weights = block.weights().unwrap_or_else(Matrix3::zeros);
    // P Qvv P = P - P Q P, as P is the inverse of the observations' covariance.
    let of_weighted = weights - weights * cofactors * weights;
    let share = weights * cofactors;
    let weighted = weights * residuals;
    for (axis, ..) in block.weighted_coordinates() {
        let variance = of_weighted[(axis, axis)];
        known[axis] = Some(KnownStatistics {
            residual: residuals[axis],
            redundancy: 1.0 - share[(axis, axis)],
            normalised: if variance > UNCONTROLLED * weights[(axis, axis)] {
                weighted[axis] / variance.sqrt()
            } else {
                0.0
            },
        });
    }
    known
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Rotation3, Vector3};

    use super::super::simulation::{Noise, bar, solve, toy};
    use super::super::{
        Adjustment, AdjustmentError, BundleProblem, CoordinatePrior, Datum, ParameterState,
        PointBlock, ProblemPart,
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

    /// Correlated coordinates are those of a turned frame with one sigma an axis: turned as a whole, the network is the same.
    #[test]
    fn correlated_control_is_uncorrelated_control_in_another_frame() {
        let mut toy = toy(14);
        let sigmas = Vector3::new(0.01, 0.02, 0.04);
        let mut noise = Noise::seeded(3);
        for p in [0, 4, 9, 12] {
            let error = sigmas.component_mul(&noise.vector());
            toy.problem.points[p] = PointBlock::control(toy.truth.points[p] + error, sigmas);
        }
        // One of them at the end of a bar, which keeps it in the reduced system.
        toy.problem.distances = vec![bar(&toy.truth, 4, 7, 0.01)];
        toy.problem.datum = Datum::Control;
        let plain = solve(&toy.problem).unwrap();
        let turn = Rotation3::new(Vector3::new(0.4, -0.7, 0.2));
        let mut turned = toy.problem.clone();
        for station in &mut turned.stations {
            station.pose.centre_in_world = turn * station.pose.centre_in_world;
            station.pose.camera_from_world *= turn.inverse();
        }
        for point in &mut turned.points {
            let known = point.prior.map(|prior| match prior {
                Some(CoordinatePrior::Weighted { value, .. }) => Some(value),
                _ => None,
            });
            point.position = turn * point.position;
            let [Some(x), Some(y), Some(z)] = known else {
                continue;
            };
            let value = turn * Vector3::new(x, y, z);
            let squares = Matrix3::from_diagonal(&sigmas.component_mul(&sigmas));
            let covariance = turn.matrix() * squares * turn.matrix().transpose();
            let sigma = covariance.diagonal().map(f64::sqrt);
            let correlation = |i: usize, j: usize| covariance[(i, j)] / (sigma[i] * sigma[j]);
            point.prior = [0, 1, 2].map(|axis| {
                Some(CoordinatePrior::Weighted {
                    value: value[axis],
                    sigma: sigma[axis],
                })
            });
            point.correlations = [correlation(0, 1), correlation(0, 2), correlation(1, 2)];
        }
        let found = solve(&turned).unwrap();
        assert!((found.sigma0 - plain.sigma0).abs() < 1e-9);
        for (found, plain) in found.points.iter().zip(&plain.points) {
            assert!((found.position - turn * plain.position).norm() < 1e-7);
            let covariance = plain.covariance.unwrap();
            let expected = turn.matrix() * covariance * turn.matrix().transpose();
            assert!((found.covariance.unwrap() - expected).norm() < 1e-7 * expected.norm());
        }
        let redundancy = sum_of_redundancy_numbers(&found);
        assert!((redundancy - found.redundancy as f64).abs() < 1e-6);
    }

    #[test]
    fn a_gross_error_of_a_correlated_coordinate_has_the_largest_test() {
        let mut toy = toy(15);
        for p in [0, 4, 9, 12] {
            toy.problem.points[p] = PointBlock::control(toy.truth.points[p], Vector3::repeat(0.02));
            toy.problem.points[p].correlations = [0.8, 0.1, -0.2];
        }
        toy.problem.datum = Datum::Control;
        let value = toy.truth.points[9].y + 0.5;
        toy.problem.points[9].prior[1] = Some(CoordinatePrior::Weighted { value, sigma: 0.02 });
        let found = solve(&toy.problem).unwrap();
        let w = |p: usize, axis: usize| found.points[p].known[axis].unwrap().normalised.abs();
        for p in [0, 4, 9, 12] {
            for axis in 0..3 {
                assert!((p, axis) == (9, 1) || w(p, axis) < w(9, 1));
            }
        }
        toy.problem.points[9].correlations = [0.9, 0.9, -0.9];
        let refused = solve(&toy.problem);
        let part = ProblemPart::Point;
        assert_eq!(
            refused,
            Err(AdjustmentError::InvalidInput { part, index: 9 })
        );
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
