//! The adjustment as a whole: against dense linear algebra, against simulated truth, against blunders.

use nalgebra::{DMatrix, DVector, Vector3};

use super::equations::{Equations, State};
use super::layout::{Layout, PointRole};
use super::normals::distance_row;
use super::simulation::{Noise, Scene, Simulated, box_network};
use super::*;

const FREE: [ParameterState; 10] = [ParameterState::Free; 10];

fn scene(seed: u64) -> Scene {
    Scene {
        stations: 12,
        points: 60,
        noise_px: 0.05,
        disturbance: 10.0,
        interior: ParameterState::Free,
        seed,
    }
}

fn toy(seed: u64) -> Simulated {
    box_network(&Scene {
        stations: 5,
        points: 15,
        disturbance: 1.0,
        ..scene(seed)
    })
}

fn bar(truth: &State, from: usize, to: usize, error: f64) -> DistanceObservation {
    DistanceObservation {
        from,
        to,
        length_mm: (truth.points[to] - truth.points[from]).norm() + error,
        sigma_mm: 0.01,
    }
}

fn solve(problem: &BundleProblem) -> Result<Adjustment, AdjustmentError> {
    adjust(problem.clone(), BundleSettings::default(), &Monitor::new())
}

/// Dense design matrix (whitened) at the adjusted state; columns as the layout's kept unknowns, then the other points.
fn dense_design(problem: &BundleProblem, layout: &Layout, state: &State) -> DMatrix<f64> {
    let equations = Equations::at(problem, layout, state);
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
                for (k, &p) in layout.camera_free[0].iter().enumerate() {
                    row[layout.camera_start[0] + k] = e.by_camera[(axis, p)] / o.sigma_px;
                }
                for k in 0..3 {
                    row[start_of(frame.point) + k] = e.by_point[(axis, k)] / o.sigma_px;
                }
                rows.push(row);
            }
        }
        for axis in 0..3 {
            if let Some(prior) = problem.points[frame.point].prior[axis] {
                let mut row = DVector::zeros(unknowns);
                row[start_of(frame.point) + axis] = 1.0 / prior.sigma;
                rows.push(row);
            }
        }
    }
    for (d, e) in problem.distances.iter().zip(&equations.distances) {
        let mut row = DVector::zeros(unknowns);
        for (i, a) in distance_row(layout, d, e.as_ref().unwrap()) {
            row[i] = a / d.sigma_mm;
        }
        rows.push(row);
    }
    for (k, &p) in layout.camera_free[0].iter().enumerate() {
        if let ParameterState::Weighted { sigma, .. } = problem.cameras[0].parameters[p] {
            let mut row = DVector::zeros(unknowns);
            row[layout.camera_start[0] + k] = 1.0 / sigma;
            rows.push(row);
        }
    }
    DMatrix::from_fn(rows.len(), unknowns, |i, j| rows[i][j])
}

fn point_start(layout: &Layout, point: usize) -> usize {
    if let PointRole::Kept { start } = layout.roles[point] {
        return start;
    }
    let before = (0..point).filter(|&p| layout.roles[p] == PointRole::Eliminated);
    layout.kept + 3 * before.count()
}

/// The constraint rows of the datum points, written down anew: shifts, turns and (with seven) the scale.
fn dense_constraints(layout: &Layout, state: &State, points: &[usize], d: usize) -> DMatrix<f64> {
    let n = points.len() as f64;
    let centre: Vector3<f64> = points
        .iter()
        .map(|&p| state.points[p])
        .sum::<Vector3<f64>>()
        / n;
    let mut g = DMatrix::zeros(layout.unknowns(), d);
    for &p in points {
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
fn bordered_cofactor(a: &DMatrix<f64>, g: &DMatrix<f64>) -> DMatrix<f64> {
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
fn agrees_with_dense_algebra(problem: &BundleProblem, defect: usize) {
    let adjustment = solve(problem).unwrap();
    assert_eq!(adjustment.datum_defect, defect);
    let state = State::of(&adjustment);
    let layout = Layout::new(problem).unwrap();
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
        same(
            DMatrix::from_fn(3, 3, |i, j| c[(i, j)]),
            point_start(&layout, p),
            "point",
        );
    }
    let free = &layout.camera_free[0];
    let camera = &adjustment.cameras[0].covariance;
    let block = DMatrix::from_fn(free.len(), free.len(), |i, j| camera[(free[i], free[j])]);
    same(block, layout.camera_start[0], "camera");

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
        row += problem.points[frame.point].known_coordinates();
    }
    for d in adjustment.distances.iter().flatten() {
        assert!((d.redundancy - (1.0 - hat[(row, row)])).abs() < 1e-8);
        row += 1;
    }
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

/// One known point leaves three turns and the scale; the inner constraints take exactly these.
#[test]
fn partial_control_leaves_the_remaining_freedom_to_the_inner_constraints() {
    let Simulated { truth, mut problem } = toy(4);
    problem.points[0] = PointBlock::control(truth.points[0], Vector3::repeat(0.02));
    let adjustment = solve(&problem).unwrap();
    assert_eq!(adjustment.datum_defect, 4);
    let deviation = (adjustment.points[0].position - truth.points[0]).norm();
    assert!(
        deviation < 1e-9,
        "nothing else pulls at the only known point: {deviation:e}"
    );
    problem.datum = Datum::Control;
    assert_eq!(
        solve(&problem),
        Err(AdjustmentError::DatumDefect {
            defect: 4,
            motions: vec![
                DatumMotion::ShiftX,
                DatumMotion::ShiftY,
                DatumMotion::ShiftZ,
                DatumMotion::TurnX,
                DatumMotion::TurnY,
                DatumMotion::TurnZ,
                DatumMotion::Scale
            ],
        })
    );
}

#[test]
fn the_datum_points_keep_centre_attitude_and_scale_of_their_start_values() {
    let mut problem = box_network(&scene(5)).problem;
    problem.datum = Datum::InnerConstraints {
        points: (3..20).collect(),
    };
    let adjustment = solve(&problem).unwrap();
    let (mut shift, mut turn, mut stretch) = (Vector3::zeros(), Vector3::zeros(), 0.0);
    for p in 3..20 {
        let now = adjustment.points[p].position;
        let moved = problem.points[p].position - now;
        shift += moved;
        turn += now.cross(&moved);
        stretch += now.dot(&moved);
    }
    // Sums over 17 points at some 250 mm of shifts of some 10 mm: rounding only.
    assert!(
        shift.norm() < 1e-9 && turn.norm() < 1e-6 && f64::abs(stretch) < 1e-6,
        "{shift} {turn} {stretch}"
    );
}

#[test]
fn switching_the_datum_needs_no_new_iteration() {
    let mut problem = box_network(&scene(6)).problem;
    let mut solver = BundleSolver::new(problem.clone(), BundleSettings::default()).unwrap();
    while solver.iterate().unwrap().termination.is_none() {}
    solver.set_datum(vec![1, 5, 9, 14]).unwrap();
    let switched = solver.finish().unwrap();
    problem.datum = Datum::InnerConstraints {
        points: vec![1, 5, 9, 14],
    };
    let anew = solve(&problem).unwrap();
    for (a, b) in switched.points.iter().zip(&anew.points) {
        assert!((a.position - b.position).norm() < 1e-6);
        let (a, b) = (a.covariance.unwrap(), b.covariance.unwrap());
        assert!((a - b).norm() < 1e-6 * b.norm());
    }
}

/// Errors of the points against the truth, moved into the datum of the estimates at first order by the best fit.
fn errors_in_sigmas(truth: &State, adjustment: &Adjustment) -> Vec<f64> {
    let pairs: Vec<_> = truth
        .points
        .iter()
        .zip(&adjustment.points)
        .map(|(t, p)| (*t, p.position))
        .collect();
    let fit = crate::geometry::fit_similarity(&pairs, crate::geometry::Scale::Free).unwrap();
    let points = adjustment.points.iter().zip(&truth.points);
    points
        .flat_map(|(p, t)| {
            let error = p.position - fit.apply(t);
            let sigma = p.sigma_mm().unwrap();
            [error.x / sigma.x, error.y / sigma.y, error.z / sigma.z]
        })
        .collect()
}

#[test]
fn errors_are_as_large_as_their_sigmas_say() {
    let (mut squares, mut count, mut chi2, mut redundancy) = (0.0, 0.0, 0.0, 0.0);
    let (mut lens_squares, mut lens_count) = (0.0, 0.0);
    for seed in 0..20 {
        let Simulated { truth, problem } = box_network(&scene(100 + seed));
        let adjustment = solve(&problem).unwrap();
        assert!(adjustment.iterations <= 12, "{}", adjustment.iterations);
        for e in errors_in_sigmas(&truth, &adjustment) {
            squares += e * e;
            count += 1.0;
        }
        let estimated = adjustment.cameras[0].camera.interior.to_vector();
        let error = estimated - truth.cameras[0].interior.to_vector();
        for p in 0..10 {
            lens_squares += error[p].powi(2) / adjustment.cameras[0].covariance[(p, p)];
            lens_count += 1.0;
        }
        let r = adjustment.redundancy as f64;
        // Five standard deviations of chi-square, sqrt(2 r).
        let this = adjustment.sigma0.powi(2) * r;
        assert!(
            (this - r).abs() < 5.0 * (2.0 * r).sqrt(),
            "sigma0 {}",
            adjustment.sigma0
        );
        chi2 += this;
        redundancy += r;
    }
    assert!((chi2 - redundancy).abs() < 4.0 * f64::sqrt(2.0 * redundancy));
    // 3600 correlated errors: their rms is known to some 3 %; 200 of the lens to some 10 %.
    assert!(
        (f64::sqrt(squares / count) - 1.0).abs() < 0.08,
        "{}",
        f64::sqrt(squares / count)
    );
    assert!(
        (f64::sqrt(lens_squares / lens_count) - 1.0).abs() < 0.25,
        "{}",
        f64::sqrt(lens_squares / lens_count)
    );
}

#[test]
fn without_noise_the_truth_is_found() {
    let Simulated { truth, problem } = box_network(&Scene {
        noise_px: 0.0,
        ..scene(7)
    });
    let adjustment = solve(&problem).unwrap();
    let pairs: Vec<_> = truth
        .points
        .iter()
        .zip(&adjustment.points)
        .map(|(t, p)| (*t, p.position))
        .collect();
    let fit = crate::geometry::fit_similarity(&pairs, crate::geometry::Scale::Free).unwrap();
    for (t, p) in &pairs {
        assert!((fit.apply(t) - p).norm() < 1e-6);
    }
    assert!(adjustment.rms_px < 1e-7, "{}", adjustment.rms_px);
}

#[test]
fn one_and_two_threads_give_the_same_bits() {
    let Simulated { truth, mut problem } = box_network(&scene(8));
    problem.distances = vec![bar(&truth, 0, 7, 0.0)];
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| solve(&problem)).unwrap()
    };
    assert_eq!(on(1), on(2));
    assert_eq!(on(1), on(5));
}

/// Stations that all look straight at a plane: c, the heights and K cannot be told apart.
#[test]
fn a_rank_defect_names_what_is_loose() {
    let Simulated { truth, mut problem } = box_network(&Scene {
        noise_px: 0.0,
        disturbance: 0.0,
        ..scene(9)
    });
    let camera = truth.cameras[0].clone();
    problem.cameras[0].parameters = std::array::from_fn(|p| {
        if p == 0 {
            ParameterState::Free
        } else {
            ParameterState::Fixed
        }
    });
    for (i, point) in problem.points.iter_mut().enumerate() {
        point.position = Vector3::new(
            40.0 * (i % 8) as f64 - 140.0,
            40.0 * (i / 8) as f64 - 140.0,
            0.0,
        );
    }
    problem.stations.truncate(4);
    problem.observations.clear();
    for (s, station) in problem.stations.iter_mut().enumerate() {
        let foot = Vector3::new(
            30.0 * s as f64 - 45.0,
            if s % 2 == 0 { 30.0 } else { -30.0 },
            0.0,
        );
        station.pose = crate::geometry::Pose::looking_at(
            foot + Vector3::z() * 1000.0,
            foot,
            Vector3::y(),
            s as f64,
        );
        for (p, point) in problem.points.iter().enumerate() {
            let pixel = camera
                .project(&station.pose.camera_from_point(&point.position))
                .unwrap();
            problem.observations.push(ImageObservation {
                station: s,
                point: p,
                pixel,
                sigma_px: 0.05,
            });
        }
    }
    problem.datum = Datum::InnerConstraints {
        points: (0..60).collect(),
    };
    let Err(AdjustmentError::RankDefect { defect, loose }) = solve(&problem) else {
        panic!("not seen");
    };
    assert!(defect >= 1);
    assert!(
        loose.contains(&ParameterName::Camera {
            index: 0,
            parameter: 0
        }),
        "{loose:?}"
    );
    assert!(
        loose.contains(&ParameterName::Station {
            index: 2,
            component: StationComponent::Z
        }),
        "{loose:?}"
    );
    problem.cameras[0].parameters[0] = ParameterState::Fixed;
    assert!(solve(&problem).is_ok(), "with c fixed nothing is loose");
}

#[test]
fn two_networks_without_a_common_point_are_a_rank_defect() {
    let mut problem = box_network(&scene(10)).problem;
    problem.cameras[0].parameters = [ParameterState::Fixed; 10];
    problem
        .observations
        .retain(|o| (o.station < 6) == (o.point < 30));
    let seen = |p: usize| problem.observations.iter().filter(|o| o.point == p).count() >= 2;
    let thin: Vec<usize> = (0..60).filter(|p| !seen(*p)).collect();
    problem.observations.retain(|o| !thin.contains(&o.point));
    let result = solve(&problem);
    assert!(
        matches!(result, Err(AdjustmentError::RankDefect { defect: 7, .. })),
        "{result:?}"
    );
}

#[test]
fn a_camera_that_no_station_uses_is_named() {
    let mut problem = box_network(&scene(11)).problem;
    problem.cameras.push(problem.cameras[0].clone());
    let result = solve(&problem);
    let Err(AdjustmentError::RankDefect { defect: 10, loose }) = result else {
        panic!("{result:?}");
    };
    assert!(
        loose
            .iter()
            .all(|n| matches!(n, ParameterName::Camera { index: 1, .. }))
    );
}

#[test]
fn wrong_input_is_refused() {
    let good = toy(12).problem;
    let mut problem = good.clone();
    problem.datum = Datum::Control;
    assert!(matches!(
        solve(&problem),
        Err(AdjustmentError::DatumDefect { defect: 7, .. })
    ));
    problem.datum = Datum::InnerConstraints { points: vec![0, 1] };
    assert_eq!(
        solve(&problem),
        Err(AdjustmentError::DatumPoints {
            found: 2,
            defect: 7
        })
    );
    let mut problem = good.clone();
    problem.observations[4].sigma_px = 0.0;
    assert_eq!(
        solve(&problem),
        Err(AdjustmentError::InvalidInput {
            part: ProblemPart::Observation,
            index: 4
        })
    );
    let mut problem = good.clone();
    let mut seen = 0;
    problem.observations.retain(|o| {
        seen += usize::from(o.point == 3);
        o.point != 3 || seen == 1
    });
    assert_eq!(
        solve(&problem),
        Err(AdjustmentError::PointsUnderdetermined { points: vec![3] })
    );
    let mut problem = good.clone();
    problem.points[2].position = Vector3::new(0.0, 0.0, 5000.0);
    assert!(matches!(
        solve(&problem),
        Err(AdjustmentError::NotImaged { .. })
    ));
    let monitor = Monitor::interrupting_after(1);
    assert!(matches!(
        adjust(good, BundleSettings::default(), &monitor),
        Err(AdjustmentError::Interrupted(_))
    ));
}

#[test]
fn the_cost_never_rises_and_bad_starts_are_damped() {
    let problem = box_network(&Scene {
        disturbance: 60.0,
        ..scene(13)
    })
    .problem;
    let mut solver = BundleSolver::new(problem, BundleSettings::default()).unwrap();
    let mut last = f64::INFINITY;
    let end = loop {
        let iteration = solver.iterate().unwrap();
        assert!(iteration.cost <= last * (1.0 + 1e-8));
        last = iteration.cost;
        if let Some(end) = iteration.termination {
            break end;
        }
    };
    assert_eq!(end.kind, TerminationKind::Converged);
    assert!(end.value < end.threshold);
    assert!((solver.finish().unwrap().sigma0 - 1.0).abs() < 0.15);
}

/// Shifts 5 % of the observations by 1 to 50 px.
fn with_blunders(seed: u64, problem: &mut BundleProblem) -> Vec<usize> {
    let mut noise = Noise::seeded(seed);
    let mut blunders = Vec::new();
    for i in 0..problem.observations.len() {
        if noise.uniform() < 0.05 {
            let angle = std::f64::consts::TAU * noise.uniform();
            let size = 50f64.powf(noise.uniform());
            problem.observations[i].pixel +=
                nalgebra::Vector2::new(angle.cos(), angle.sin()) * size;
            blunders.push(i);
        }
    }
    blunders
}

fn snoop(problem: &BundleProblem, settings: &RejectionSettings) -> RobustAdjustment {
    adjust_with_rejection(
        problem,
        BundleSettings::default(),
        settings,
        &Monitor::new(),
    )
    .unwrap()
}

fn blunders_are_found(settings: &RejectionSettings, sigma_factor: f64) {
    let (mut missed, mut false_alarms, mut all) = (0, 0, 0);
    for seed in 0..4 {
        let mut problem = box_network(&scene(200 + seed)).problem;
        let blunders = with_blunders(seed, &mut problem);
        for o in &mut problem.observations {
            o.sigma_px *= sigma_factor;
        }
        let robust = snoop(&problem, settings);
        let rejected: Vec<usize> = robust.rejected.iter().map(|r| r.index).collect();
        missed += blunders.iter().filter(|b| !rejected.contains(b)).count();
        false_alarms += rejected.iter().filter(|r| !blunders.contains(r)).count();
        all += blunders.len();
        let sigma0 = robust.adjustment.sigma0 * sigma_factor;
        assert!(
            (sigma0 - 1.0).abs() < 0.1,
            "{sigma0} after {} passes",
            robust.passes
        );
    }
    assert!(all > 50);
    assert_eq!(missed, 0, "of {all}, the least 1 px, twenty sigmas");
    assert!(false_alarms <= 6, "{false_alarms}");
}

#[test]
fn blunders_are_found_after_a_robust_start() {
    blunders_are_found(&RejectionSettings::default(), 1.0);
}

#[test]
fn blunders_are_found_by_least_squares_alone() {
    let settings = RejectionSettings {
        robust_start: RobustStart::Off,
        ..RejectionSettings::default()
    };
    blunders_are_found(&settings, 1.0);
}

#[test]
fn wrong_a_priori_sigmas_neither_reject_everything_nor_hide_blunders() {
    blunders_are_found(&RejectionSettings::default(), 0.2);
    blunders_are_found(&RejectionSettings::default(), 10.0);
}

#[test]
fn clean_data_keep_their_observations() {
    let problem = box_network(&scene(14)).problem;
    let robust = snoop(&problem, &RejectionSettings::default());
    assert!(robust.rejected.len() <= 1 && robust.dropped_points.is_empty());
    let same = FREE == problem.cameras[0].parameters;
    assert!(same);
}

#[test]
fn a_point_with_too_few_rays_is_dropped_and_rejections_of_the_caller_stay() {
    let mut problem = box_network(&scene(15)).problem;
    let of_point: Vec<usize> = (0..problem.observations.len())
        .filter(|&i| problem.observations[i].point == 6)
        .collect();
    problem.rejected.extend(&of_point[1..]);
    let other = (0..problem.observations.len())
        .find(|&i| problem.observations[i].point == 8)
        .unwrap();
    problem.rejected.insert(other);
    let robust = snoop(&problem, &RejectionSettings::default());
    assert_eq!(robust.dropped_points, vec![6]);
    assert!(
        robust
            .rejected
            .iter()
            .any(|r| r.index == of_point[0] && r.reason == RejectionReason::PointDropped)
    );
    assert!(robust.adjustment.points[6].covariance.is_none());
    assert!(robust.rejected.iter().all(|r| r.index != other));
    let predicted = robust.adjustment.observations[other];
    assert_eq!(predicted.status, ObservationStatus::Rejected);
    assert!(
        predicted.test().unwrap() < 6.0,
        "a good observation is predicted well"
    );
}
