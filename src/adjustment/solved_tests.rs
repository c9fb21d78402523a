//! Joint covariances against dense algebra, and what does not depend on the datum.

use nalgebra::{DMatrix, Matrix3, Vector3};
use proptest::prelude::*;

use super::dense::{bordered_cofactor, dense_constraints, dense_design, point_start};
use super::equations::State;
use super::layout::Layout;
use super::simulation::{Noise, Scene, Simulated, bar, box_network, scene, toy};
use super::*;
use crate::geometry::{AxisOrder, ThreeTwoOne};

fn solved(problem: &BundleProblem) -> SolvedNetwork {
    let mut solver =
        BundleSolver::new(problem.clone(), BundleSettings::default(), &Monitor::new()).unwrap();
    while solver
        .iterate(&Monitor::new())
        .unwrap()
        .termination
        .is_none()
    {}
    solver.solved(&Monitor::new()).unwrap()
}

/// A toy network with a lens that its few rays can carry.
fn toy_with_lens(seed: u64) -> Simulated {
    let mut simulated = toy(seed);
    simulated.problem.cameras[0].parameters = std::array::from_fn(|p| {
        if p < 5 {
            ParameterState::Free
        } else {
            ParameterState::Fixed
        }
    });
    simulated
}

fn start_of(layout: &Layout, part: Part) -> usize {
    match part {
        Part::Camera(c) => layout.camera_start[c],
        Part::Interior(s) => layout.own_start[s],
        Part::Station(s) => 6 * s,
        Part::Point(p) => point_start(layout, p),
    }
}

#[test]
fn joint_covariances_and_influences_agree_with_dense_algebra() {
    let Simulated { truth, mut problem } = toy_with_lens(31);
    problem.distances = vec![bar(&truth, 0, 7, 0.004)];
    problem.datum = Datum::InnerConstraints {
        points: vec![1, 3, 8, 12],
    };
    let network = solved(&problem);
    let adjustment = network.adjustment(&Monitor::new()).unwrap();
    let layout = Layout::new(&problem, &Monitor::new()).unwrap();
    let state = State::of(&adjustment);
    let a = dense_design(&problem, &layout, &state);
    let g = dense_constraints(&layout, &state, &layout.datum_points, 6);
    let q = bordered_cofactor(&a, &g);
    let parts = [
        Part::Point(9),
        Part::Station(1),
        Part::Camera(0),
        Part::Point(0),
        Part::Station(4),
        Part::Point(3),
    ];
    let joint = network.covariance(&parts).unwrap();
    let mut row = 0;
    for of in parts {
        let mut column = 0;
        for with in parts {
            // Of the camera the first five are estimated, in this order.
            let shown = |part: Part| {
                if part == Part::Camera(0) {
                    5
                } else {
                    part.width()
                }
            };
            for i in 0..shown(of) {
                for j in 0..shown(with) {
                    let (u, v) = (start_of(&layout, of) + i, start_of(&layout, with) + j);
                    let reference = q[(u, v)] * adjustment.sigma0.powi(2);
                    let size = (q[(u, u)] * q[(v, v)]).sqrt() * adjustment.sigma0.powi(2);
                    let found = joint[(row + i, column + j)];
                    assert!((found - reference).abs() < 1e-8 * size, "{of:?} {with:?}");
                }
            }
            column += with.width();
        }
        row += of.width();
    }
    let last_parameters = joint.view((9 + 5, 0), (5, joint.ncols())).amax();
    assert_eq!(last_parameters, 0.0, "fixed parameters do not vary");
    assert_eq!(network.covariance(&[Part::Point(99)]), None);

    // Q A^T P of each observation's own point.
    let response = &q * a.transpose();
    let mut row = 0;
    for frame in &layout.frames {
        for ray in &frame.rays {
            let sigma = problem.observations[ray.observation].sigma_px;
            let found = adjustment.observations[ray.observation].influence_mm_per_px;
            for axis in 0..2 {
                let own = response.view((point_start(&layout, frame.point), row + axis), (3, 1));
                let reference = own.norm() / sigma;
                assert!((found[axis] - reference).abs() < 1e-7 * reference.max(1e-3));
            }
            row += 2;
        }
    }
}

#[test]
fn a_station_knows_its_covariance_with_its_camera() {
    let Simulated { truth, mut problem } = toy_with_lens(31);
    problem.distances = vec![bar(&truth, 0, 7, 0.004)];
    let network = solved(&problem);
    for (index, station) in network
        .adjustment(&Monitor::new())
        .unwrap()
        .stations
        .iter()
        .enumerate()
    {
        let camera = Part::Camera(station.camera);
        let joint = network.covariance(&[Part::Station(index), camera]).unwrap();
        let reference = joint.view((0, 6), (6, 10));
        let off = (station.with_camera - reference).amax();
        assert!(off < 1e-8 * reference.amax(), "{index}: {off:e}");
        assert!(reference.amax() > 0.0);
    }
}

/// What an error of an observation does to its point is what the network does when the error is made.
#[test]
fn an_error_moves_its_point_as_foretold() {
    let Simulated { mut problem, .. } = box_network(&scene(32));
    let before = solved(&problem).adjustment(&Monitor::new()).unwrap();
    problem.observations[77].pixel.y += 1e-3;
    let after = solved(&problem).adjustment(&Monitor::new()).unwrap();
    let point = problem.observations[77].point;
    let moved = (after.points[point].position - before.points[point].position).norm();
    let foretold = 1e-3 * before.observations[77].influence_mm_per_px.y;
    assert!(
        (moved - foretold).abs() < 2e-3 * foretold,
        "{moved} {foretold}"
    );
}

#[test]
fn another_datum_is_that_of_an_adjustment_in_it() {
    let Simulated { mut problem, .. } = box_network(&scene(33));
    for frame in [
        None,
        Some(ThreeTwoOne {
            origin: 2,
            axis: 11,
            plane: 7,
            order: AxisOrder::Yz,
        }),
    ] {
        problem.frame = frame;
        problem.datum = Datum::InnerConstraints {
            points: (0..60).collect(),
        };
        let first = solved(&problem);
        let chosen = vec![1, 5, 9, 14, 30];
        let switched = first.in_datum(chosen.clone(), &Monitor::new()).unwrap();
        problem.datum = Datum::InnerConstraints { points: chosen };
        let anew = solved(&problem);
        let (a, b) = (
            switched.adjustment(&Monitor::new()).unwrap(),
            anew.adjustment(&Monitor::new()).unwrap(),
        );
        let parts = [Part::Point(9), Part::Station(3), Part::Point(50)];
        let [joint, reference] = [&switched, &anew].map(|n| n.covariance(&parts).unwrap());
        assert!((joint - &reference).norm() < 1e-6 * reference.norm());
        for (a, b) in a.points.iter().zip(&b.points) {
            assert!((a.position - b.position).norm() < 1e-6);
            let (a, b) = (a.covariance.unwrap(), b.covariance.unwrap());
            assert!((a - b).norm() < 1e-6 * b.norm().max(1e-12));
        }
        for (a, b) in a.stations.iter().zip(&b.stations) {
            assert!((a.pose.centre_in_world - b.pose.centre_in_world).norm() < 1e-6);
            assert!((a.covariance - b.covariance).norm() < 1e-6 * b.covariance.norm());
        }
        for (a, b) in a.observations.iter().zip(&b.observations) {
            let (a, b) = (a.influence_mm_per_px, b.influence_mm_per_px);
            assert!((a - b).norm() < 1e-6 * (1.0 + b.norm()));
        }
    }
}

/// Points to choose a datum from, and quantities that a datum must not change.
fn invariants(distances: bool) -> Vec<Derived> {
    let mut quantities = vec![
        Derived::Angle {
            at: 0,
            from: 4,
            to: 9,
        },
        Derived::Angle {
            at: 12,
            from: 1,
            to: 7,
        },
        Derived::Ratio {
            of: [2, 8],
            over: [3, 11],
        },
        Derived::Ratio {
            of: [5, 6],
            over: [5, 14],
        },
    ];
    if distances {
        quantities.extend([
            Derived::Distance { from: 2, to: 8 },
            Derived::Distance { from: 13, to: 10 },
        ]);
    }
    quantities
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    /// With a bar that observes the scale distances and their covariance, without one angles and ratios of distances, are the
    /// same in every datum.
    #[test]
    fn what_was_measured_does_not_depend_on_the_datum(
        seed in 0u64..1000,
        with_bar in any::<bool>(),
        datum in prop::sample::subsequence((0..15).collect::<Vec<usize>>(), 4..15),
    ) {
        let Simulated { truth, mut problem } = toy_with_lens(4000 + seed);
        if with_bar {
            problem.distances = vec![bar(&truth, 0, 7, 0.004)];
        }
        let first = solved(&problem);
        let quantities = invariants(with_bar);
        let reference = first.derived(&quantities).unwrap();
        let other = first.in_datum(datum, &Monitor::new()).unwrap().derived(&quantities).unwrap();
        for k in 0..quantities.len() {
            let value = reference.values[k];
            prop_assert!((other.values[k] - value).abs() < 1e-9 * value.abs().max(1.0));
        }
        let size = |k: usize| reference.covariance[(k, k)].sqrt();
        for i in 0..quantities.len() {
            for j in 0..quantities.len() {
                let off = (other.covariance[(i, j)] - reference.covariance[(i, j)]).abs();
                prop_assert!(off < 1e-9 * size(i) * size(j), "{i} {j}: {:e}", off / (size(i) * size(j)));
            }
        }
    }
}

/// Of all datums that hold the motions of the network by as many conditions as there are motions, the inner constraints give
/// the datum points the smallest sum of variances (Meissl, 1969).
#[test]
fn inner_constraints_have_the_smallest_trace_of_a_thousand_minimum_datums() {
    /// Minimum datums that are tried.
    const DATUMS: usize = 1000;
    let datum: Vec<usize> = vec![0, 3, 4, 7, 9, 10, 13];
    let mut problem = toy_with_lens(34).problem;
    problem.datum = Datum::InnerConstraints {
        points: datum.clone(),
    };
    let network = solved(&problem);
    let parts: Vec<Part> = datum.iter().map(|&p| Part::Point(p)).collect();
    let inner = network.covariance(&parts).unwrap();
    let size = inner.nrows();
    let positions: Vec<Vector3<f64>> = datum
        .iter()
        .map(|&p| network.position(p).unwrap())
        .collect();
    let centre = positions.iter().sum::<Vector3<f64>>() / positions.len() as f64;
    let mut motions = DMatrix::zeros(size, 7);
    for (k, position) in positions.iter().enumerate() {
        let x = (position - centre) / 100.0;
        let mut rows = motions.fixed_view_mut::<3, 7>(3 * k, 0);
        rows.fixed_columns_mut::<3>(0)
            .copy_from(&Matrix3::identity());
        rows.fixed_columns_mut::<3>(3)
            .copy_from(&-crate::geometry::skew(&x));
        rows.fixed_columns_mut::<1>(6).copy_from(&x);
    }
    let mut noise = Noise::seeded(35);
    let mut closest = f64::INFINITY;
    for number in 0..DATUMS {
        // Seven single coordinates are held, or seven random combinations of all.
        let conditions = if number % 2 == 0 {
            let mut held: Vec<usize> = (0..size).collect();
            for k in 0..7 {
                let swap = k + (noise.uniform() * (size - k) as f64) as usize;
                held.swap(k, swap.min(size - 1));
            }
            DMatrix::from_fn(7, size, |i, j| f64::from(u8::from(held[i] == j)))
        } else {
            DMatrix::from_fn(7, size, |_, _| noise.normal())
        };
        let Some(inverse) = (&conditions * &motions).try_inverse() else {
            continue;
        };
        let s = DMatrix::identity(size, size) - &motions * inverse * &conditions;
        let trace = (&s * &inner * s.transpose()).trace();
        assert!(trace > inner.trace(), "datum {number}: {trace}");
        closest = closest.min(trace / inner.trace());
    }
    assert!(closest < 3.0, "some come near: {closest}");
}

#[test]
fn derived_sigmas_are_the_errors_that_are_made() {
    let quantities = invariants(false);
    let mut squares = 0.0;
    let mut count = 0.0;
    for seed in 0..60 {
        let Simulated { truth, mut problem } = box_network(&Scene {
            stations: 6,
            points: 15,
            disturbance: 1.0,
            ..scene(4100 + seed)
        });
        problem.cameras[0].parameters = [ParameterState::Fixed; 10];
        problem.cameras[0].camera = truth.cameras[0].clone();
        let network = solved(&problem);
        let found = network.derived(&quantities).unwrap();
        let sigma0 = network.adjustment(&Monitor::new()).unwrap().sigma0;
        let angle = |at: usize, from: usize, to: usize| {
            let [a, b] = [from, to].map(|p| truth.points[p] - truth.points[at]);
            a.cross(&b).norm().atan2(a.dot(&b))
        };
        let distance = |[a, b]: [usize; 2]| (truth.points[a] - truth.points[b]).norm();
        for (k, quantity) in quantities.iter().enumerate() {
            let value = match *quantity {
                Derived::Angle { at, from, to } => angle(at, from, to),
                Derived::Ratio { of, over } => distance(of) / distance(over),
                Derived::Distance { from, to } => distance([from, to]),
            };
            let sigma = found.sigma(k) / sigma0;
            squares += ((found.values[k] - value) / sigma).powi(2);
            count += 1.0;
        }
    }
    // 240 normal deviates, four a network that are hardly correlated: their rms is known to some 5 %.
    let rms = f64::sqrt(squares / count);
    assert!((rms - 1.0).abs() < 0.18, "{rms}");
}

#[test]
fn an_ellipsoid_has_the_axes_of_its_covariance() {
    let turn = nalgebra::Rotation3::new(Vector3::new(0.3, -0.7, 1.1));
    let squares = Matrix3::from_diagonal(&Vector3::new(4.0, 25.0, 9.0));
    let covariance = turn.matrix() * squares * turn.matrix().transpose();
    let ellipsoid = ErrorEllipsoid::of(&covariance);
    let expected = [5.0, 3.0, 2.0];
    for (k, axis) in [1, 2, 0].into_iter().enumerate() {
        assert!((ellipsoid.half_axes_mm[k] - expected[k]).abs() < 1e-12);
        let direction = ellipsoid.directions.column(k);
        let along = direction.dot(&turn.matrix().column(axis));
        assert!((along.abs() - 1.0).abs() < 1e-12);
    }
    let correlation = correlations(&DMatrix::from_row_slice(2, 2, &[4.0, 3.0, 3.0, 9.0]));
    assert!((correlation[(0, 1)] - 0.5).abs() < 1e-15);
}
