//! The frame by three points: against dense algebra, its laws, its refusals.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::dense::{bordered_cofactor, dense_constraints, dense_design, point_start};
use super::equations::State;
use super::layout::Layout;
use super::simulation::{Simulated, bar, solve, toy};
use super::*;
use crate::geometry::{AxisOrder, ThreePointsError, ThreeTwoOne};

fn frame(order: AxisOrder) -> ThreeTwoOne<usize> {
    ThreeTwoOne {
        origin: 2,
        axis: 11,
        plane: 7,
        order,
    }
}

/// A toy network with and without a frame.
fn with_and_without(problem: &BundleProblem, order: AxisOrder) -> (Adjustment, Adjustment) {
    let mut problem = problem.clone();
    let without = solve(&problem).unwrap();
    problem.frame = Some(frame(order));
    (solve(&problem).unwrap(), without)
}

fn held_problem(seed: u64, free_parameters: usize) -> Simulated {
    let mut simulated = toy(seed);
    simulated.problem.cameras[0].parameters = std::array::from_fn(|p| {
        if p < free_parameters {
            ParameterState::Free
        } else {
            ParameterState::Fixed
        }
    });
    simulated
}

/// The six functionals of the frame in its own axes, as columns.
fn constraints(layout: &Layout, frame: &ThreeTwoOne<usize>) -> DMatrix<f64> {
    let mut columns = Vec::new();
    for (p, axes) in frame.held() {
        for axis in axes {
            let mut column = DVector::zeros(layout.unknowns());
            column[point_start(layout, *p) + axis] = 1.0;
            columns.push(column);
        }
    }
    DMatrix::from_columns(&columns)
}

/// Every covariance of the adjustment against the bordered normal matrix with the frame's own minimum constraints (and
/// the datum's scale where nothing else holds it).
fn agrees_with_minimum_constraints(problem: &BundleProblem) {
    let adjustment = solve(problem).unwrap();
    let state = State::of(&adjustment);
    let layout = Layout::new(problem, &Monitor::new()).unwrap();
    let a = dense_design(problem, &layout, &state);
    let mut b = constraints(&layout, problem.frame.as_ref().unwrap());
    if adjustment.datum_defect == 7 {
        let inner = dense_constraints(&layout, &state, &layout.datum_points, 7);
        b = b.insert_column(6, 0.0);
        b.set_column(6, &inner.column(6));
    }
    let q = bordered_cofactor(&a, &b) * adjustment.sigma0.powi(2);
    let same = |block: DMatrix<f64>, at: usize, size: f64, what: &str| {
        let n = block.nrows();
        let error = (&block - q.view((at, at), (n, n))).amax();
        // The dense reference itself carries some 1e-10 of the largest variance.
        assert!(error <= 1e-8 * size, "{what}: {error:e} of {size:e}");
    };
    let largest = |blocks: &[DMatrix<f64>]| blocks.iter().map(DMatrix::amax).fold(0.0, f64::max);
    let points: Vec<DMatrix<f64>> = adjustment
        .points
        .iter()
        .map(|p| DMatrix::from_column_slice(3, 3, p.covariance.unwrap().as_slice()))
        .collect();
    let size = largest(&points);
    for (p, block) in points.into_iter().enumerate() {
        same(block, point_start(&layout, p), size, "point");
    }
    // Turn, centre and their correlation each by their own size.
    for (s, station) in adjustment.stations.iter().enumerate() {
        for (row, column) in [(0, 0), (0, 3), (3, 3)] {
            let of = |from: usize| from + 6 * s;
            let block = station.covariance.fixed_view::<3, 3>(row, column);
            let reference = q.view((of(row), of(column)), (3, 3));
            let error = (block - reference).amax();
            assert!(error <= 1e-8 * block.amax(), "station {s}: {error:e}");
        }
    }
    let free = &layout.camera_free[0];
    let camera = &adjustment.cameras[0].covariance;
    for (i, &p) in free.iter().enumerate() {
        let reference = q[(layout.camera_start[0] + i, layout.camera_start[0] + i)];
        assert!((camera[(p, p)] - reference).abs() <= 1e-8 * reference);
    }
}

#[test]
fn covariances_are_those_of_minimum_constraints() {
    let Simulated { mut problem, .. } = held_problem(1, 5);
    problem.datum = Datum::InnerConstraints {
        points: vec![0, 3, 4, 7, 9, 13],
    };
    for order in AxisOrder::ALL {
        problem.frame = Some(frame(order));
        agrees_with_minimum_constraints(&problem);
    }
}

#[test]
fn with_distances_too() {
    let Simulated { truth, mut problem } = toy(2);
    // One end of a distance gives the frame, the other ends do not.
    problem.distances = vec![bar(&truth, 0, 7, 0.004), bar(&truth, 12, 1, 0.006)];
    for order in [AxisOrder::Xy, AxisOrder::Zx] {
        problem.frame = Some(frame(order));
        agrees_with_minimum_constraints(&problem);
    }
}

/// With known coordinates the cofactor matrix is regular; the frame is then the plain propagation of
/// `S = I - G (B^T G)^-1 B^T`.
#[test]
fn known_coordinates_are_seen_relative_to_the_frame() {
    let Simulated { truth, mut problem } = toy(3);
    for p in [0, 4, 9, 12] {
        problem.points[p] = PointBlock::control(truth.points[p], Vector3::repeat(0.02));
    }
    problem.datum = Datum::Control;
    let (moved, known) = with_and_without(&problem, AxisOrder::Xy);
    let state = State::of(&known);
    let layout = Layout::new(&problem, &Monitor::new()).unwrap();
    let a = dense_design(&problem, &layout, &state);
    let q = bordered_cofactor(&a, &DMatrix::zeros(layout.unknowns(), 0)) * known.sigma0.powi(2);
    let motion = moved.motion.unwrap();
    let rotation = motion.rotation.matrix();
    let rigid = dense_constraints(&layout, &state, &(0..15).collect::<Vec<_>>(), 6);
    let mut turn = DMatrix::zeros(layout.unknowns(), layout.unknowns());
    for p in 0..15 {
        let at = point_start(&layout, p);
        turn.view_mut((at, at), (3, 3)).copy_from(rotation);
    }
    let b = turn.transpose() * constraints(&layout, &frame(AxisOrder::Xy));
    let s = DMatrix::identity(layout.unknowns(), layout.unknowns())
        - &rigid * (b.transpose() * &rigid).try_inverse().unwrap() * b.transpose();
    let expected = &turn * &s * q * s.transpose() * turn.transpose();
    for (p, point) in moved.points.iter().enumerate() {
        let at = point_start(&layout, p);
        let reference = expected.view((at, at), (3, 3));
        let error = (point.covariance.unwrap() - reference).amax();
        assert!(
            error < 1e-8 * expected.view((at, at), (3, 3)).amax().max(1e-6),
            "{error:e}"
        );
    }
}

#[test]
fn a_frame_changes_no_residual_and_no_distance() {
    let Simulated { problem, .. } = toy(5);
    let (framed, free) = with_and_without(&problem, AxisOrder::Yz);
    assert_eq!(framed.sigma0, free.sigma0);
    assert_eq!(framed.rms_px, free.rms_px);
    assert_eq!(framed.redundancy, free.redundancy);
    assert_eq!(framed.datum_defect, free.datum_defect);
    let tests = |a: &Adjustment| -> Vec<_> {
        let tests = a.observations.iter();
        tests
            .map(|o| (o.residual_px, o.redundancy, o.normalised))
            .collect()
    };
    assert_eq!(tests(&framed), tests(&free));
    assert_eq!(framed.cameras, free.cameras);
    for i in 0..15 {
        for j in 0..i {
            let between = |a: &Adjustment| (a.points[i].position - a.points[j].position).norm();
            assert!((between(&framed) - between(&free)).abs() < 1e-9);
        }
    }
}

#[test]
fn what_the_frame_holds_is_zero_and_has_no_variance() {
    let Simulated { problem, .. } = toy(6);
    for order in AxisOrder::ALL {
        let (framed, _) = with_and_without(&problem, order);
        assert_eq!(framed.points[2].position, Vector3::zeros());
        assert_eq!(framed.points[2].covariance, Some(Matrix3::zeros()));
        let axis = &framed.points[11];
        let sigmas = axis.sigma_mm().unwrap();
        assert!(axis.position[order.axis()] > 0.0 && sigmas[order.axis()] > 0.0);
        for k in [order.side(), order.normal()] {
            assert_eq!((axis.position[k], sigmas[k]), (0.0, 0.0));
        }
        let plane = &framed.points[7];
        let sigmas = plane.sigma_mm().unwrap();
        assert!(plane.position[order.side()] > 0.0);
        assert!(sigmas[order.side()] > 0.0 && sigmas[order.axis()] > 0.0);
        assert_eq!(
            (plane.position[order.normal()], sigmas[order.normal()]),
            (0.0, 0.0)
        );
    }
}

#[test]
fn there_and_back_gives_the_same_digits() {
    let Simulated { mut problem, .. } = toy(7);
    problem.datum = Datum::InnerConstraints {
        points: (3..12).collect(),
    };
    // To rounding: what the default convergence leaves open is more than the digits compared here.
    let settings = BundleSettings {
        convergence: 1e-9,
        ..BundleSettings::default()
    };
    let exactly =
        |problem: &BundleProblem| adjust(problem.clone(), settings, &Monitor::new()).unwrap();
    let free = exactly(&problem);
    problem.frame = Some(frame(AxisOrder::Zy));
    let framed = exactly(&problem);
    problem.frame = None;
    let back = framed.motion.unwrap().inverse();
    for (moved, own) in framed.points.iter().zip(&free.points) {
        assert!((back.apply(&moved.position) - own.position).norm() < 1e-9);
    }
    // From the moved place into inner constraints over the same points.
    let mut again = problem.clone();
    for (block, point) in again.points.iter_mut().zip(&framed.points) {
        block.position = point.position;
    }
    for (block, station) in again.stations.iter_mut().zip(&framed.stations) {
        block.pose = station.pose;
    }
    again.cameras[0].camera = framed.cameras[0].camera.clone();
    let again = exactly(&again);
    let turn = back.rotation.matrix();
    for (moved, own) in again.points.iter().zip(&free.points) {
        // A new adjustment of a self-calibrating network of five stations has rounding of its own.
        assert!((back.apply(&moved.position) - own.position).norm() < 1e-8);
        let covariance = turn * moved.covariance.unwrap() * turn.transpose();
        let expected = own.covariance.unwrap();
        assert!((covariance - expected).amax() < 1e-8 * expected.amax());
    }
}

#[test]
fn rejection_works_as_without_a_frame() {
    let Simulated { truth, mut problem } = toy(8);
    problem.observations[17].pixel.x += 3.0;
    for p in [0, 4, 9, 12] {
        problem.points[p] = PointBlock::control(truth.points[p], Vector3::repeat(0.02));
    }
    let settings = RejectionSettings::default();
    let run = |problem: &BundleProblem| {
        adjust_with_rejection(
            problem,
            BundleSettings::default(),
            &settings,
            &Monitor::new(),
        )
        .unwrap()
    };
    for datum in [
        Datum::Control,
        Datum::InnerConstraints {
            points: (0..15).collect(),
        },
    ] {
        problem.datum = datum;
        problem.frame = None;
        let free = run(&problem);
        problem.frame = Some(frame(AxisOrder::Xy));
        let framed = run(&problem);
        assert!(free.rejected.iter().any(|r| r.index == 17));
        assert_eq!(framed.rejected, free.rejected);
        assert_eq!(framed.adjustment.sigma0, free.adjustment.sigma0);
    }
}

#[test]
fn points_that_give_no_frame_are_refused() {
    let Simulated { mut problem, .. } = toy(9);
    let asked = |origin, axis, plane| {
        Some(ThreeTwoOne {
            origin,
            axis,
            plane,
            order: AxisOrder::Xy,
        })
    };
    let refused = |problem: &BundleProblem| solve(problem).unwrap_err();
    for (frame, at_origin) in [
        (asked(2, 2, 7), true),
        (asked(2, 7, 7), false),
        (asked(2, 7, 2), false),
    ] {
        problem.frame = frame;
        let error = refused(&problem);
        let found = match error {
            AdjustmentError::FrameShape(ThreePointsError::AtOrigin { found_mm, .. })
                if at_origin =>
            {
                found_mm
            }
            AdjustmentError::FrameShape(ThreePointsError::OnLine { found_mm, .. })
                if !at_origin =>
            {
                found_mm
            }
            other => panic!("{other}"),
        };
        assert!(found < 1e-9);
    }
    problem.frame = asked(2, 11, 99);
    assert_eq!(
        refused(&problem),
        AdjustmentError::InvalidInput {
            part: ProblemPart::Frame,
            index: 2
        }
    );
    problem.frame = asked(2, 11, 7);
    problem.observations.retain(|o| o.point != 7);
    assert_eq!(refused(&problem), AdjustmentError::FramePoint { point: 7 });
}
