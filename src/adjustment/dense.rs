//! Covariances and redundancy numbers against plain dense linear algebra.

use nalgebra::{DMatrix, DVector, Vector3};

use super::equations::{Equations, State};
use super::interior::InteriorUnknown;
use super::layout::{Layout, PointRole};
use super::normals::distance_row;
use super::simulation::{Simulated, bar, solve, toy};
use super::*;

/// Dense design matrix (whitened) at the adjusted state; columns as the layout's kept unknowns, then the other points.
pub(super) fn dense_design(
    problem: &BundleProblem,
    layout: &Layout,
    state: &State,
) -> DMatrix<f64> {
    let equations = Equations::at(problem, layout, state, &Monitor::new()).unwrap();
    let mut rows: Vec<DVector<f64>> = Vec::new();
    let unknowns = layout.unknowns();
    let start_of = |p: usize| point_start(layout, p);
    for frame in &layout.frames {
        for ray in frame.rays.iter().filter(|r| r.used) {
            let o = &problem.observations[ray.observation];
            let e = equations.rays[ray.observation].as_ref().unwrap();
            for axis in 0..2 {
                let mut row = DVector::zeros(unknowns);
                for k in 0..6 {
                    row[6 * o.station + k] = e.by_station[(axis, k)] / o.sigma_px;
                }
                let shared = layout.shared_parameters(problem.stations[o.station].camera);
                for unknown in layout.own_parameters(o.station).chain(shared) {
                    row[unknown.at] = e.by_camera[(axis, unknown.parameter)] / o.sigma_px;
                }
                for (k, &of) in layout.unknown_axes[frame.point].iter().enumerate() {
                    row[start_of(frame.point) + k] = e.by_point[(axis, of)] / o.sigma_px;
                }
                rows.push(row);
            }
        }
        for (axis, _, sigma) in problem.points[frame.point].weighted_coordinates() {
            let axes = &layout.unknown_axes[frame.point];
            let k = axes.iter().position(|a| *a == axis).unwrap();
            let mut row = DVector::zeros(unknowns);
            row[start_of(frame.point) + k] = 1.0 / sigma;
            rows.push(row);
        }
    }
    for (d, e) in problem.distances.iter().zip(&equations.distances) {
        let mut row = DVector::zeros(unknowns);
        for (i, a) in distance_row(layout, d, e.as_ref().unwrap()) {
            row[i] = a / d.sigma_mm;
        }
        rows.push(row);
    }
    let mut know = |camera: usize, unknown: InteriorUnknown| {
        let known = problem.cameras[camera].parameters[unknown.parameter];
        if let ParameterState::Weighted { sigma, .. } = known {
            let mut row = DVector::zeros(unknowns);
            row[unknown.at] = 1.0 / sigma;
            rows.push(row);
        }
    };
    for camera in 0..problem.cameras.len() {
        let shared = layout.shared_parameters(camera);
        shared.for_each(|unknown| know(camera, unknown));
    }
    for (s, station) in problem.stations.iter().enumerate() {
        let own = layout.own_parameters(s);
        own.for_each(|unknown| know(station.camera, unknown));
    }
    DMatrix::from_fn(rows.len(), unknowns, |i, j| rows[i][j])
}

pub(super) fn point_start(layout: &Layout, point: usize) -> usize {
    if let PointRole::Kept { start } = layout.roles[point] {
        return start;
    }
    let before = (0..point).filter(|&p| layout.roles[p] == PointRole::Eliminated);
    layout.kept + before.map(|p| layout.unknown_axes[p].len()).sum::<usize>()
}

/// The constraint rows of the datum points, written down anew: shifts, turns and (with seven) the scale.
pub(super) fn dense_constraints(
    layout: &Layout,
    state: &State,
    points: &[usize],
    d: usize,
) -> DMatrix<f64> {
    let n = points.len() as f64;
    let centre: Vector3<f64> = points
        .iter()
        .map(|&p| state.points[p])
        .sum::<Vector3<f64>>()
        / n;
    let mut g = DMatrix::zeros(layout.unknowns(), d);
    for &p in points {
        // All three coordinates are unknowns.
        let start = point_start(layout, p);
        let x = (state.points[p] - centre) / 100.0;
        for axis in 0..3 {
            let mut unit = Vector3::zeros();
            unit[axis] = 1.0;
            g[(start + axis, axis)] = 1.0;
            let turned: Vector3<f64> = unit.cross(&x);
            for k in 0..3 {
                g[(start + k, 3 + axis)] = turned[k];
            }
            if d == 7 {
                g[(start + axis, 6)] = x[axis];
            }
        }
    }
    g
}

/// Cofactors by the bordered normal matrix [N G; G^T 0], whose inverse holds the free-network cofactor matrix.
pub(super) fn bordered_cofactor(a: &DMatrix<f64>, g: &DMatrix<f64>) -> DMatrix<f64> {
    let (u, d) = g.shape();
    let n = a.transpose() * a;
    let scale = DVector::from_fn(
        u + d,
        |i, _| if i < u { 1.0 / n[(i, i)].sqrt() } else { 1.0 },
    );
    let mut bordered = DMatrix::zeros(u + d, u + d);
    bordered.view_mut((0, 0), (u, u)).copy_from(&n);
    bordered.view_mut((0, u), (u, d)).copy_from(g);
    bordered.view_mut((u, 0), (d, u)).copy_from(&g.transpose());
    let scaled = DMatrix::from_fn(u + d, u + d, |i, j| bordered[(i, j)] * scale[i] * scale[j]);
    let border = scaled.view((0, u), (u, d)).norm() / (d.max(1) as f64).sqrt();
    let scaled = DMatrix::from_fn(u + d, u + d, |i, j| {
        if (i < u) == (j < u) {
            scaled[(i, j)]
        } else {
            scaled[(i, j)] / border
        }
    });
    let inverse = scaled.full_piv_lu().try_inverse().unwrap();
    DMatrix::from_fn(u, u, |i, j| inverse[(i, j)] * scale[i] * scale[j])
}

/// Compares every delivered covariance and redundancy number with dense algebra.
pub(super) fn agrees_with_dense_algebra(problem: &BundleProblem, defect: usize) {
    let adjustment = solve(problem).unwrap();
    assert_eq!(adjustment.datum_defect, defect);
    let state = State::of(&adjustment);
    let layout = Layout::new(problem, &Monitor::new()).unwrap();
    let a = dense_design(problem, &layout, &state);
    let g = dense_constraints(&layout, &state, &layout.datum_points, defect);
    let q = bordered_cofactor(&a, &g) * adjustment.sigma0.powi(2);
    // Relative to the block's largest entry; the dense reference itself carries some 1e-11.
    let same = |block: DMatrix<f64>, at: usize, what: &str| {
        let n = block.nrows();
        let reference = q.view((at, at), (n, n));
        for i in 0..n {
            for j in 0..n {
                let size = (reference[(i, i)] * reference[(j, j)]).sqrt();
                let error = (block[(i, j)] - reference[(i, j)]).abs();
                assert!(
                    error <= 1e-9 * size,
                    "{what} {i} {j}: {error:e} of {size:e}"
                );
            }
        }
    };
    for (s, station) in adjustment.stations.iter().enumerate() {
        same(
            DMatrix::from_fn(6, 6, |i, j| station.covariance[(i, j)]),
            6 * s,
            "station",
        );
    }
    for (p, point) in adjustment.points.iter().enumerate() {
        let c = point.covariance.unwrap();
        let axes = &layout.unknown_axes[p];
        same(
            DMatrix::from_fn(axes.len(), axes.len(), |i, j| c[(axes[i], axes[j])]),
            point_start(&layout, p),
            "point",
        );
        for (axis, value) in problem.points[p].fixed_coordinates() {
            assert_eq!(point.position[axis], value);
            assert!(
                c.row(axis)
                    .iter()
                    .chain(c.column(axis).iter())
                    .all(|c| *c == 0.0)
            );
        }
    }
    for (c, camera) in adjustment.cameras.iter().enumerate() {
        let free = &layout.camera_free[c];
        let of = |i: usize, j: usize| camera.covariance[(free[i], free[j])];
        let block = DMatrix::from_fn(free.len(), free.len(), of);
        same(block, layout.camera_start[c], "camera");
    }
    for (s, station) in adjustment.stations.iter().enumerate() {
        let Some(interior) = &station.interior else {
            assert_eq!(layout.own_parameters(s).count(), 0);
            continue;
        };
        let unknowns = || {
            layout
                .own_parameters(s)
                .chain(layout.shared_parameters(station.camera))
        };
        for (one, other) in unknowns().flat_map(|one| unknowns().map(move |other| (one, other))) {
            let size = (q[(one.at, one.at)] * q[(other.at, other.at)]).sqrt();
            let own = interior.covariance[(one.parameter, other.parameter)];
            assert!(
                (own - q[(one.at, other.at)]).abs() < 1e-9 * size,
                "interior of {s}"
            );
        }
    }

    let unscaled = &q / adjustment.sigma0.powi(2);
    let hat = &a * unscaled * a.transpose();
    let rays = layout
        .frames
        .iter()
        .flat_map(|f| &f.rays)
        .filter(|r| r.used);
    let mut row = 0;
    for frame in &layout.frames {
        for ray in &frame.rays {
            let r = adjustment.observations[ray.observation].redundancy;
            for axis in 0..2 {
                assert!((r[axis] - (1.0 - hat[(row, row)])).abs() < 1e-9);
                row += 1;
            }
        }
        for known in adjustment.points[frame.point].known.iter().flatten() {
            assert!((known.redundancy - (1.0 - hat[(row, row)])).abs() < 1e-8);
            row += 1;
        }
    }
    for d in adjustment.distances.iter().flatten() {
        assert!((d.redundancy - (1.0 - hat[(row, row)])).abs() < 1e-8);
        row += 1;
    }
    let shared = adjustment.cameras.iter();
    let own = adjustment.stations.iter().flat_map(|s| &s.interior);
    for known in shared.chain(own).flat_map(|c| c.known).flatten() {
        assert!((known.redundancy - (1.0 - hat[(row, row)])).abs() < 1e-8);
        row += 1;
    }
    assert_eq!(row, a.nrows());
    assert!(rays.count() > 0);
    let total = a.nrows() as f64 - hat.trace();
    assert!(
        (total - adjustment.redundancy as f64).abs() < 1e-7,
        "sum of redundancy numbers"
    );
}

#[test]
fn free_network_statistics_agree_with_dense_algebra() {
    let mut problem = toy(1).problem;
    problem.cameras[0].parameters = std::array::from_fn(|p| {
        if p < 5 {
            ParameterState::Free
        } else {
            ParameterState::Fixed
        }
    });
    for points in [
        (0..15).collect(),
        (0..15).step_by(3).collect(),
        vec![2, 7, 11],
    ] {
        problem.datum = Datum::InnerConstraints { points };
        agrees_with_dense_algebra(&problem, 7);
    }
}

#[test]
fn statistics_with_distances_agree_with_dense_algebra() {
    let Simulated { truth, mut problem } = toy(2);
    problem.cameras[0].parameters[5] = ParameterState::Weighted {
        value: 2e-10,
        sigma: 1e-11,
    };
    problem.distances = vec![
        bar(&truth, 0, 7, 0.004),
        bar(&truth, 7, 3, -0.003),
        bar(&truth, 12, 1, 0.006),
    ];
    for points in [(0..15).collect(), vec![0, 4, 8, 9], vec![5, 6, 13]] {
        problem.datum = Datum::InnerConstraints { points };
        agrees_with_dense_algebra(&problem, 6);
    }
}

#[test]
fn statistics_with_control_agree_with_dense_algebra() {
    let Simulated { truth, mut problem } = toy(3);
    problem.distances = vec![bar(&truth, 0, 7, 0.004)];
    for p in [0, 4, 9, 12] {
        problem.points[p] = PointBlock::control(truth.points[p], Vector3::repeat(0.02));
    }
    problem.datum = Datum::Control;
    agrees_with_dense_algebra(&problem, 0);
}
