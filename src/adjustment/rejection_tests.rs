//! Gross errors are found, and what is good stays.

use super::super::ProblemPart;
use super::super::simulation::{Noise, Scene, box_network, scene};
use super::*;

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
fn blunders_are_found_by_the_sigmas_that_were_given_and_by_their_ratios() {
    for (test, sigma_factor) in [
        (OutlierTest::APriori, 1.0),
        (OutlierTest::APosteriori, 1.0),
        (OutlierTest::APosteriori, 5.0),
    ] {
        let settings = RejectionSettings {
            test,
            ..RejectionSettings::default()
        };
        blunders_are_found(&settings, sigma_factor);
    }
}

#[test]
fn an_observation_of_a_point_that_is_not_there_is_refused() {
    let mut problem = box_network(&scene(14)).problem;
    problem.observations[3].point = problem.points.len();
    let (bundle, rejection) = (BundleSettings::default(), RejectionSettings::default());
    let refused = adjust_with_rejection(&problem, bundle, &rejection, &Monitor::new());
    let part = ProblemPart::Observation;
    assert_eq!(
        refused,
        Err(AdjustmentError::InvalidInput { part, index: 3 })
    );
}

#[test]
fn clean_data_keep_their_observations() {
    let problem = box_network(&scene(14)).problem;
    let robust = snoop(&problem, &RejectionSettings::default());
    assert!(robust.rejected.len() <= 1 && robust.dropped_points.is_empty());
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

#[test]
fn blunders_in_perfect_data_are_found() {
    let mut problem = box_network(&Scene {
        noise_px: 0.0,
        disturbance: 0.0,
        ..scene(16)
    })
    .problem;
    let blunders = with_blunders(3, &mut problem);
    let robust = snoop(&problem, &RejectionSettings::default());
    let rejected: Vec<usize> = robust.rejected.iter().map(|r| r.index).collect();
    assert_eq!(rejected, blunders);
}

#[test]
fn what_is_good_enough_ends_with_one_look_at_all_residuals() {
    let mut problem = box_network(&scene(200)).problem;
    with_blunders(0, &mut problem);
    let thorough = RejectionSettings {
        robust_start: RobustStart::Off,
        ..RejectionSettings::default()
    };
    let all = snoop(&problem, &thorough);
    let once = RejectionSettings {
        enough: 1.0,
        ..thorough
    };
    let first = snoop(&problem, &once);
    assert_eq!(first.passes, 2);
    assert!(all.passes > 2 && all.rejected.len() > first.rejected.len());
    let also_later =
        |r: &RejectedObservation| all.rejected.iter().any(|other| other.index == r.index);
    assert!(first.rejected.iter().all(also_later));
}
