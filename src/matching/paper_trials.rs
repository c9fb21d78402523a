//! The paper's rule against truth: what its threshold names in sparse fields and leaves in dense ones.

use super::simulated::{Ellipses, ObjectKind, Perturbation, Scene, SceneSettings, Score};
use super::{
    Identification, IdentificationSettings, KnownPoint, LeftoverReason, Member,
    identify_by_threshold,
};
use crate::monitor::{Interrupted, Monitor};

/// The paper's box (600 x 400 x 300 mm), or a part of it, from twelve stations.
fn field(spacing_mm: f64, false_share: f64) -> SceneSettings {
    SceneSettings {
        seed: 5,
        object: ObjectKind::Box(600.0, 400.0, 300.0),
        spacing_mm,
        jitter: 0.5,
        stations: 12,
        missing: 0.0,
        false_share,
        ellipses: Ellipses::Measured,
    }
}

/// Orientations as good as those of the paper's second iteration.
const SIGMA_S_MM: f64 = 0.1;

fn first_pass(scene: &Scene, station_sigma_mm: f64) -> (Identification, Vec<Vec<usize>>) {
    let fine = Perturbation::Compensated(0.5 * station_sigma_mm, 0.02);
    let (views, kept) = scene.views(fine, 1, |_, _| false);
    let known = scene.known_codes(0.02, 2);
    let input = scene.input(&views, &known, station_sigma_mm, 0.3);
    let settings = IdentificationSettings::default();
    let found = identify_by_threshold(&input, &settings, &Monitor::new()).unwrap();
    (found, kept)
}

fn score(settings: &SceneSettings, station_sigma_mm: f64) -> (Score, Identification) {
    let scene = Scene::new(settings);
    let (found, kept) = first_pass(&scene, station_sigma_mm);
    (scene.score(&[(&found, &kept)]), found)
}

fn ambiguous(found: &Identification) -> usize {
    let is_ambiguous = |reason: &LeftoverReason| matches!(reason, LeftoverReason::Ambiguous { .. });
    let left = found.leftover.iter();
    left.filter(|left| is_ambiguous(&left.reason)).count()
}

#[test]
fn a_sparse_field_is_named_in_one_pass() {
    let (score, found) = score(&field(60.0, 0.0), SIGMA_S_MM);
    assert_eq!((score.wrong, score.split), (0, 0), "{score:?}");
    assert!(score.recall() > 0.95, "{score:?}");
    assert!(score.claimed * 10 > score.claimable * 9, "{score:?}");
    assert!(found.tracks.iter().all(|t| t.log10_accidents.is_none()));
}

#[test]
fn the_denser_the_field_and_the_wider_the_threshold_the_more_is_left_ambiguous() {
    let (sparse, _) = score(&field(60.0, 0.05), SIGMA_S_MM);
    let (dense, found) = score(&field(25.0, 0.05), SIGMA_S_MM);
    let (wide, found_wide) = score(&field(25.0, 0.05), 7.0 * SIGMA_S_MM);
    assert!(dense.recall() < sparse.recall(), "{sparse:?} {dense:?}");
    assert!(wide.recall() < dense.recall(), "{dense:?} {wide:?}");
    assert!(ambiguous(&found) > 0);
    assert!(ambiguous(&found_wide) > ambiguous(&found));
}

#[test]
fn what_is_left_is_claimed_by_the_targets_once_they_are_known() {
    let scene = Scene::new(&field(25.0, 0.0));
    let (first, kept) = first_pass(&scene, SIGMA_S_MM);
    let mut named: Vec<Member> = first.claims.iter().map(|c| c.member).collect();
    named.extend(first.tracks.iter().flat_map(|t| t.members.clone()));
    let fine = Perturbation::Compensated(0.01, 0.01);
    let (views, kept_second) = scene.views(fine, 3, |view, slot| {
        let dot = kept[view].iter().position(|&kept| kept == slot);
        dot.is_some_and(|dot| named.contains(&Member { view, dot }))
    });
    let mut known = scene.known_codes(0.02, 2);
    known.extend(first.tracks.iter().map(|track| KnownPoint {
        position: track.position,
        covariance: nalgebra::Matrix3::zeros(),
        seen_in: track.members.iter().map(|m| m.view).collect(),
        circle: None,
    }));
    let input = scene.input(&views, &known, SIGMA_S_MM, 0.1);
    let settings = IdentificationSettings::default();
    let second = identify_by_threshold(&input, &settings, &Monitor::new()).unwrap();
    let before = scene.score(&[(&first, &kept)]);
    let after = scene.score(&[(&first, &kept), (&second, &kept_second)]);
    assert!(after.right > before.right, "{before:?} {after:?}");
    let of_targets = |claim: &&super::Claim| claim.known >= scene.known_codes(0.02, 2).len();
    assert!(second.claims.iter().filter(of_targets).count() > 0);
}

#[test]
fn every_dot_is_accounted_for_once() {
    let scene = Scene::new(&field(25.0, 0.05));
    let (found, kept) = first_pass(&scene, SIGMA_S_MM);
    let mut told: Vec<Member> = found.claims.iter().map(|c| c.member).collect();
    told.extend(found.tracks.iter().flat_map(|t| t.members.clone()));
    told.extend(found.leftover.iter().map(|l| l.member));
    told.sort_unstable();
    let all: Vec<Member> = kept
        .iter()
        .enumerate()
        .flat_map(|(view, dots)| (0..dots.len()).map(move |dot| Member { view, dot }))
        .collect();
    assert_eq!(told, all);
}

#[test]
fn views_that_share_no_codes_are_not_compared() {
    let scene = Scene::new(&field(60.0, 0.0));
    let fine = Perturbation::Compensated(0.05, 0.02);
    let (views, _) = scene.views(fine, 1, |_, _| false);
    let mut input = scene.input(&views, &[], SIGMA_S_MM, 0.3);
    input.neighbours = &[];
    let settings = IdentificationSettings::default();
    let found = identify_by_threshold(&input, &settings, &Monitor::new()).unwrap();
    assert!(found.tracks.is_empty());
    let mut reasons = found.leftover.iter().map(|l| l.reason);
    assert!(reasons.all(|reason| reason == LeftoverReason::NoPartner));
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let scene = Scene::new(&field(25.0, 0.05));
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| first_pass(&scene, SIGMA_S_MM).0)
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn an_interrupt_ends_the_pass_wherever_it_comes() {
    let scene = Scene::new(&field(60.0, 0.0));
    let fine = Perturbation::Compensated(0.05, 0.02);
    let (views, _) = scene.views(fine, 1, |_, _| false);
    let known = scene.known_codes(0.02, 2);
    let input = scene.input(&views, &known, SIGMA_S_MM, 0.3);
    let settings = IdentificationSettings::default();
    for calls in [0, 1, 12, 13, 100, 400] {
        let monitor = Monitor::interrupting_after(calls);
        let end = identify_by_threshold(&input, &settings, &monitor);
        assert_eq!(end, Err(Interrupted), "after {calls} steps");
    }
}
