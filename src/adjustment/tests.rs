//! The adjustment as a whole: against simulated truth, its datum, its defects, its refusals.

use nalgebra::Vector3;

use super::equations::State;
use super::simulation::{Scene, Simulated, bar, box_network, nadir_network, scene, solve, toy};
use super::*;

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

/// Two fixed points leave the turn about their line, which moves neither.
#[test]
fn datum_points_that_the_remaining_motion_does_not_move_are_refused() {
    let Simulated { truth, mut problem } = box_network(&scene(9));
    for p in [0, 21] {
        problem.points[p] = PointBlock::fixed(truth.points[p]);
    }
    let mut begin = |points: Vec<usize>| {
        problem.datum = Datum::InnerConstraints { points };
        BundleSolver::new(problem.clone(), BundleSettings::default(), &Monitor::new())
    };
    let refused = begin(vec![0, 21]).map(|_| ());
    let wanted = AdjustmentError::DatumPoints {
        found: 2,
        defect: 1,
    };
    assert_eq!(refused, Err(wanted));
    assert!(begin(vec![0, 21, 37]).is_ok());
}

/// Without rays the third known point does not hinder the turn about the line of the others, and does not take part in it.
#[test]
fn a_known_point_without_rays_does_not_fix_the_datum() {
    let Simulated { truth, mut problem } = box_network(&Scene {
        disturbance: 1.0,
        ..scene(9)
    });
    for p in [0, 21, 37] {
        problem.points[p] = PointBlock::control(truth.points[p], Vector3::repeat(0.02));
    }
    let observations = problem.observations.iter().enumerate();
    let of_last = observations.filter(|(_, o)| o.point == 37);
    problem.rejected = of_last.map(|(index, _)| index).collect();
    let adjustment = solve(&problem).unwrap();
    assert_eq!(adjustment.datum_defect, 1);
    let unseen = &adjustment.points[37];
    assert!((unseen.position - truth.points[37]).norm() < 1e-9);
    let sigma = unseen.sigma_mm().unwrap() / adjustment.sigma0;
    assert!((sigma - Vector3::repeat(0.02)).norm() < 1e-9, "{sigma}");
    problem.datum = Datum::Control;
    assert!(matches!(
        solve(&problem),
        Err(AdjustmentError::DatumDefect { defect: 1, .. })
    ));
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
    let mut solver =
        BundleSolver::new(problem.clone(), BundleSettings::default(), &Monitor::new()).unwrap();
    while solver
        .iterate(&Monitor::new())
        .unwrap()
        .termination
        .is_none()
    {}
    let solved = solver.solved(&Monitor::new()).unwrap();
    let switched = solved
        .in_datum(vec![1, 5, 9, 14], &Monitor::new())
        .unwrap()
        .adjustment(&Monitor::new())
        .unwrap();
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

#[test]
fn a_rank_defect_names_what_is_loose() {
    let mut problem = nadir_network();
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
    let mut solver =
        BundleSolver::new(problem, BundleSettings::default(), &Monitor::new()).unwrap();
    let mut last = f64::INFINITY;
    let end = loop {
        let iteration = solver.iterate(&Monitor::new()).unwrap();
        assert!(iteration.cost <= last * (1.0 + 1e-8));
        last = iteration.cost;
        if let Some(end) = iteration.termination {
            break end;
        }
    };
    assert_eq!(end.kind, TerminationKind::Converged);
    assert!(end.value < end.threshold);
    assert!((solver.finish(&Monitor::new()).unwrap().sigma0 - 1.0).abs() < 0.15);
}

#[test]
fn two_cameras_are_estimated_side_by_side() {
    let Simulated { truth, mut problem } = box_network(&Scene {
        stations: 16,
        ..scene(17)
    });
    problem.cameras.push(problem.cameras[0].clone());
    problem.cameras[1].parameters[9] = ParameterState::Fixed;
    problem.cameras[1].camera.interior.affinity[1] = truth.cameras[0].interior.affinity[1];
    for station in problem.stations.iter_mut().step_by(2) {
        station.camera = 1;
    }
    let adjustment = solve(&problem).unwrap();
    assert_eq!(adjustment.unknown_count, 16 * 6 + 19 + 60 * 3);
    assert!(
        (adjustment.sigma0 - 1.0).abs() < 0.1,
        "{}",
        adjustment.sigma0
    );
    for camera in &adjustment.cameras {
        let error = camera.camera.interior.to_vector() - truth.cameras[0].interior.to_vector();
        for p in (0..10).filter(|p| camera.covariance[(*p, *p)] > 0.0) {
            // 19 normal deviates: 4.5 sigmas come once in 10,000 trials.
            assert!(error[p].abs() < 4.5 * camera.covariance[(p, p)].sqrt());
        }
    }
    assert_eq!(adjustment.cameras[1].covariance[(9, 9)], 0.0);
}
