//! Fixed coordinates: they are no unknowns, and the limit of ever better known ones.

use nalgebra::{Matrix3, Vector3};

use super::dense::agrees_with_dense_algebra;
use super::simulation::{Simulated, bar, box_network, scene, solve, toy};
use super::*;

/// A point that knows some coordinates.
fn partly(position: Vector3<f64>, prior: [Option<CoordinatePrior>; 3]) -> PointBlock {
    PointBlock {
        prior,
        ..PointBlock::unknown(position)
    }
}

fn fixed(value: f64) -> Option<CoordinatePrior> {
    Some(CoordinatePrior::Fixed { value })
}

fn weighted(value: f64, sigma: f64) -> Option<CoordinatePrior> {
    Some(CoordinatePrior::Weighted { value, sigma })
}

/// Every fixed coordinate weighted with this standard deviation instead, mm.
fn loosened(problem: &BundleProblem, sigma: f64) -> BundleProblem {
    let mut problem = problem.clone();
    for point in &mut problem.points {
        point.prior = point.prior.map(|prior| match prior {
            Some(CoordinatePrior::Fixed { value }) => weighted(value, sigma),
            other => other,
        });
    }
    problem
}

/// Points fixed wholly, in plan, in height and in one coordinate beside a weighted one; bars between two fixed points, between a
/// fixed and a partly fixed one, and from a partly fixed one to an unknown one.
fn control_network(seed: u64) -> Simulated {
    let Simulated { truth, mut problem } = toy(seed);
    let at = |p: usize| truth.points[p];
    for p in [0, 9] {
        problem.points[p] = PointBlock::fixed(at(p));
        // The start does not count.
        problem.points[p].position += Vector3::new(3.0, -2.0, 1.0);
    }
    problem.points[4] = partly(at(4), [fixed(at(4).x), fixed(at(4).y), None]);
    problem.points[7] = partly(at(7), [None, None, fixed(at(7).z)]);
    problem.points[12] = partly(at(12), [weighted(at(12).x, 0.02), None, fixed(at(12).z)]);
    problem.distances = vec![
        bar(&truth, 0, 9, 0.004),
        bar(&truth, 9, 4, -0.003),
        bar(&truth, 12, 2, 0.006),
    ];
    problem.datum = Datum::Control;
    Simulated { truth, problem }
}

#[test]
fn statistics_agree_with_dense_algebra() {
    for seed in [3, 4] {
        agrees_with_dense_algebra(&control_network(seed).problem, 0);
    }
}

#[test]
fn fixed_heights_of_a_free_network_are_that_limit_too() {
    let Simulated { truth, mut problem } = toy(5);
    // Heights of three points leave the shift in plan and the turn about the vertical, and with a bar no scale.
    for p in [1, 6, 10] {
        problem.points[p] = partly(truth.points[p], [None, None, fixed(truth.points[p].z)]);
    }
    problem.distances = vec![bar(&truth, 0, 7, 0.004), bar(&truth, 6, 2, 0.0)];
    problem.datum = Datum::InnerConstraints {
        points: vec![0, 3, 4, 8, 9],
    };
    let adjustment = solve(&problem).unwrap();
    assert_eq!(adjustment.datum_defect, 3);
    let weighted = solve(&loosened(&problem, 1e-5)).unwrap();
    assert_same(&problem, &adjustment, &weighted);
}

#[test]
fn what_is_fixed_is_neither_observed_nor_unknown() {
    let Simulated { problem, .. } = control_network(6);
    let adjustment = solve(&problem).unwrap();
    let rays = problem.observations.len();
    // Nine fixed coordinates and a weighted one; ten camera parameters.
    assert_eq!(adjustment.unknown_count, 5 * 6 + 10 + 15 * 3 - 10);
    assert_eq!(adjustment.observation_count, 2 * rays + 3 + 1);
    let loose = solve(&loosened(&problem, 1e-5)).unwrap();
    assert_eq!(adjustment.redundancy, loose.redundancy);
    let statistics = adjustment.distances[0].unwrap();
    assert_eq!(statistics.redundancy, 1.0, "both ends are fixed");
    assert!((statistics.residual_mm + 0.004).abs() < 1e-9);
    assert!((statistics.normalised + 0.4).abs() < 1e-6);
}

/// Estimates, standard deviations and redundancy numbers of a network with fixed coordinates beside those with nearly fixed ones.
fn assert_same(problem: &BundleProblem, fixed: &Adjustment, nearly: &Adjustment) {
    // A part of some 1e-8 of the network's size.
    let near = 1e-5;
    for (p, (one, other)) in fixed.points.iter().zip(&nearly.points).enumerate() {
        assert!((one.position - other.position).norm() < near, "point {p}");
        let [mine, other] = [one, other].map(|point| point.sigma_mm().unwrap());
        let unknown = problem.points[p].unknown_axes();
        for axis in 0..3 {
            assert!((mine[axis] - other[axis]).abs() < 2.0 * near, "point {p}");
            assert_eq!(mine[axis] == 0.0, !unknown.contains(&axis));
        }
    }
    for (one, other) in fixed.stations.iter().zip(&nearly.stations) {
        assert!((one.pose.centre_in_world - other.pose.centre_in_world).norm() < 10.0 * near);
        let of = |station: &AdjustedStation| station.covariance.diagonal().map(f64::sqrt);
        let size = of(other);
        assert!((of(one) - size).component_div(&size).amax() < 1e-3);
    }
    for (one, other) in fixed.observations.iter().zip(&nearly.observations) {
        assert!((one.redundancy - other.redundancy).norm() < 1e-4);
        assert!((one.residual_px.unwrap() - other.residual_px.unwrap()).norm() < 1e-4);
    }
    assert!((fixed.sigma0 - nearly.sigma0).abs() < 1e-4);
    assert_eq!(fixed.redundancy, nearly.redundancy);
    assert_eq!(fixed.datum_defect, nearly.datum_defect);
}

#[test]
fn fixed_is_the_limit_of_ever_better_known() {
    let Simulated { problem, .. } = control_network(7);
    let adjustment = solve(&problem).unwrap();
    let nearly = solve(&loosened(&problem, 1e-5)).unwrap();
    assert_same(&problem, &adjustment, &nearly);
    for p in [0, 9] {
        assert_eq!(adjustment.points[p].covariance, Some(Matrix3::zeros()));
        assert!(adjustment.points[p].rays > 0);
    }
}

/// What is fixed stays while gross errors are rejected and while the datum and a frame move the rest.
#[test]
fn rejection_keeps_what_is_fixed() {
    let Simulated { truth, mut problem } = box_network(&scene(8));
    for p in [0, 21, 37] {
        problem.points[p] = PointBlock::fixed(truth.points[p]);
    }
    problem.datum = Datum::Control;
    let of_fixed = (0..problem.observations.len()).find(|&i| problem.observations[i].point == 21);
    let blunder = of_fixed.unwrap();
    problem.observations[blunder].pixel.x += 5.0;
    let (bundle, rejection) = (BundleSettings::default(), RejectionSettings::default());
    let robust = adjust_with_rejection(&problem, bundle, &rejection, &Monitor::new()).unwrap();
    assert!(robust.rejected.iter().any(|r| r.index == blunder));
    for p in [0, 21, 37] {
        assert_eq!(robust.adjustment.points[p].position, truth.points[p]);
    }
    let rejected = &robust.adjustment.observations[blunder];
    assert!((rejected.residual_px.unwrap().x + 5.0).abs() < 0.3);
}

/// A single fixed coordinate leaves six motions; the datum moves the network along them by some millimetres, yet not that
/// coordinate, and no residual changes.
#[test]
fn the_datum_does_not_move_what_is_fixed() {
    let Simulated { truth, mut problem } = box_network(&scene(9));
    let known = [(2, 0), (9, 1), (14, 0)];
    for (p, axis) in known {
        problem.points[p].prior[axis] = fixed(truth.points[p][axis]);
    }
    let free = solve(&problem).unwrap();
    assert_eq!(free.datum_defect, 4);
    problem.datum = Datum::InnerConstraints {
        points: (30..40).collect(),
    };
    let moved = solve(&problem).unwrap();
    assert!((free.points[50].position - moved.points[50].position).norm() > 0.1);
    for (p, axis) in known {
        for adjustment in [&free, &moved] {
            assert_eq!(adjustment.points[p].position[axis], truth.points[p][axis]);
            assert_eq!(adjustment.points[p].sigma_mm().unwrap()[axis], 0.0);
        }
    }
    for (one, other) in free.observations.iter().zip(&moved.observations) {
        let off = one.residual_px.unwrap() - other.residual_px.unwrap();
        assert!(off.norm() < 1e-6, "{off}");
    }
    assert!((free.sigma0 - moved.sigma0).abs() < 1e-9);
}

#[test]
fn a_fixed_point_without_rays_has_no_part_in_the_counts() {
    let Simulated { truth, mut problem } = control_network(10);
    let without = solve(&problem).unwrap();
    problem.points.push(PointBlock::fixed(truth.points[1]));
    let with = solve(&problem).unwrap();
    assert_eq!(with.unknown_count, without.unknown_count);
    assert_eq!(with.observation_count, without.observation_count);
    assert_eq!(with.points[15].covariance, Some(Matrix3::zeros()));
    problem.points[15].prior[1] = fixed(f64::NAN);
    assert_eq!(
        solve(&problem),
        Err(AdjustmentError::InvalidInput {
            part: ProblemPart::Point,
            index: 15
        })
    );
}
