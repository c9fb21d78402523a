//! Whole measurements without pictures: what goes wrong in practice, and what the stages make of it.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::Vector3;

use super::trial::{code_panel, measured, run, texts};
use crate::geometry::{Scale, fit_similarity};
use crate::network::{
    Attempt, CameraId, ControlPoint, ControlRole, FindingKind, ImageId, ImageUse, InteriorSource,
    Network, Outcome, PointId, Stage,
};
use crate::synthetic::Experiment;
use crate::targets::{Detections, DotIndex, Family};

/// Five times the standard error that 0.02 px give on this panel.
const TOLERANCE_MM: f64 = 0.05;

/// Largest distance of an adjusted point from its true place after a best fit, mm.
pub(super) fn largest_error(network: &Network, experiment: &Experiment) -> f64 {
    let pairs: Vec<(Vector3<f64>, Vector3<f64>)> = network
        .points
        .iter()
        .filter(|(_, point)| point.covariance.is_some())
        .filter_map(|(id, point)| {
            let truth = experiment.scene.disc(&id.to_string())?.placement.origin;
            Some((point.position, truth))
        })
        .collect();
    assert!(pairs.len() > 30, "{} points are adjusted", pairs.len());
    let fit = fit_similarity(&pairs, Scale::Free).unwrap();
    pairs
        .iter()
        .map(|(found, truth)| (fit.apply(found) - truth).norm())
        .fold(0.0, f64::max)
}

/// An edit of the operator.
fn edited(network: &Network, edit: impl FnOnce(&mut Network)) -> Network {
    let mut edited = network.clone();
    edit(&mut edited);
    edited.inputs += 1;
    edited
}

fn oriented(network: &Network) -> usize {
    network.oriented_images().count()
}

pub(super) fn outcome(network: &Network, stage: Stage) -> Option<Outcome> {
    network.conclusions.get(&stage).map(|c| c.outcome)
}

fn set_use(network: &mut Network, id: ImageId, usage: ImageUse) {
    network.image_mut(id).usage = usage;
}

/// Changes what was read in an image and names its dots again.
pub(super) fn edited_codes(
    network: &mut Network,
    id: ImageId,
    change: impl FnOnce(&mut Detections),
) {
    let mut detections = network.images[&id].detections.as_deref().unwrap().clone();
    change(&mut detections);
    super::detect::adopt(network.image_mut(id), detections);
}

#[test]
fn codes_alone_make_a_measurement() {
    let experiment = code_panel(8);
    let network = run(measured(&experiment), Stage::Adjust);
    assert_eq!(oriented(&network), 8);
    assert!(largest_error(&network, &experiment) < TOLERANCE_MM);
    let adjustment = network.adjustment.as_ref().unwrap();
    // 1,000 degrees of freedom and more: sigma0 has a standard error of 2 %.
    assert!(
        (adjustment.sigma0 - 1.0).abs() < 0.15,
        "{}",
        adjustment.sigma0
    );
    assert_eq!(texts(&network.findings), [""; 0]);
    assert!(
        Stage::ALL
            .iter()
            .all(|stage| outcome(&network, *stage) == Some(Outcome::Done))
    );
    assert!(
        Stage::ALL
            .iter()
            .all(|stage| stage.next(&network).is_none())
    );
}

#[test]
fn two_cameras_are_calibrated_apart() {
    let experiment = code_panel(14);
    let mut network = measured(&experiment);
    let second = network.cameras[&CameraId(1)].clone();
    Arc::make_mut(&mut network.cameras).insert(CameraId(2), second);
    for number in 8..=14 {
        network.image_mut(ImageId(number)).camera = CameraId(2);
    }
    let network = run(network, Stage::AdjustCodes);
    assert_eq!(oriented(&network), 14, "{:?}", texts(&network.findings));
    assert!(largest_error(&network, &experiment) < TOLERANCE_MM);
    assert_eq!(network.adjustment.unwrap().cameras.len(), 2);
}

#[test]
fn an_image_that_nothing_holds_is_set_aside_and_the_rest_adjusted() {
    let experiment = code_panel(8);
    let connected = run(measured(&experiment), Stage::Connect);
    let thin = edited(&connected, |network| {
        let image = network.image_mut(ImageId(3));
        let two: BTreeMap<_, _> = image
            .labels
            .iter()
            .take(2)
            .map(|(d, l)| (*d, l.clone()))
            .collect();
        image.labels = Arc::new(two);
    });
    let network = run(thin, Stage::AdjustCodes);
    assert_eq!(
        outcome(&network, Stage::AdjustCodes),
        Some(Outcome::Incomplete)
    );
    assert_eq!(oriented(&network), 7);
    assert!(!network.connection_order.contains(&ImageId(3)));
    assert!(largest_error(&network, &experiment) < TOLERANCE_MM);
    let told = texts(&network.findings);
    assert!(
        told.iter()
            .any(|text| text.contains("image3.png: set aside")),
        "{told:?}"
    );
}

#[test]
fn an_image_that_waits_is_tried_again_after_the_adjustment() {
    let experiment = code_panel(8);
    let mut network = run(measured(&experiment), Stage::Connect);
    let basis = network.inputs;
    let image = network.image_mut(ImageId(3));
    image.station = None;
    let attempt = Attempt {
        basis,
        known_points: 1000,
        oriented: 7,
        knowledge: 0,
        reason: "a trial".into(),
    };
    image.attempt = Some(attempt);
    let basis = network.inputs;
    network
        .image_mut(ImageId(3))
        .attempt
        .as_mut()
        .unwrap()
        .basis = basis;
    Arc::make_mut(&mut network.connection_order).retain(|id| *id != ImageId(3));
    let network = run(network, Stage::AdjustCodes);
    assert_eq!(oriented(&network), 8);
    let adjustment = network.adjustment.as_ref().unwrap();
    assert!(
        adjustment
            .observations
            .iter()
            .any(|row| row.image == ImageId(3))
    );
    assert!(largest_error(&network, &experiment) < TOLERANCE_MM);
    assert_eq!(texts(&network.findings), Vec::<&str>::new());
    assert_eq!(outcome(&network, Stage::AdjustCodes), Some(Outcome::Done));
}

#[test]
fn a_wrong_reading_in_one_image_spoils_nothing() {
    let experiment = code_panel(8);
    for wrong in [1, 2, 3, 6] {
        let mut network = measured(&experiment);
        edited_codes(&mut network, ImageId(wrong), |detections| {
            let other = detections.codes[7].id;
            detections.codes[7].id = detections.codes[2].id;
            detections.codes[2].id = other;
        });
        let network = run(network, Stage::AdjustCodes);
        assert_eq!(
            oriented(&network),
            8,
            "image {wrong}: {:?}",
            texts(&network.findings)
        );
        let error = largest_error(&network, &experiment);
        assert!(error < TOLERANCE_MM, "image {wrong}: {error}");
        let told = texts(&network.findings);
        let path = format!("image{wrong}.png: C");
        assert!(
            told.iter().all(|text| text.starts_with(&path)),
            "image {wrong}: {told:?}"
        );
        assert_eq!(told.len(), 2, "image {wrong}: {told:?}");
    }
}

#[test]
fn a_number_on_two_targets_harms_no_other() {
    let experiment = code_panel(8);
    let mut network = measured(&experiment);
    for number in 1..=8 {
        edited_codes(&mut network, ImageId(number), |detections| {
            // Every image shows one of the two, the other is hidden.
            let (first, second) = (detections.codes[3].id, detections.codes[8].id);
            if number % 2 == 0 {
                detections.codes.retain(|code| code.id != first);
                for code in detections.codes.iter_mut().filter(|code| code.id == second) {
                    code.id = first;
                }
            } else {
                detections.codes.retain(|code| code.id != second);
            }
        });
    }
    let twice = network.images[&ImageId(1)]
        .detections
        .as_ref()
        .unwrap()
        .codes[3]
        .id;
    let mut network = run(network, Stage::AdjustCodes);
    assert_eq!(oriented(&network), 8);
    let told = texts(&network.findings).join("\n");
    assert!(told.contains(&format!("C{twice}")), "{told}");
    Arc::make_mut(&mut network.points)
        .retain(|point, _| point.code() != Some((Family::Dot420, twice)));
    assert!(largest_error(&network, &experiment) < TOLERANCE_MM);
}

#[test]
fn without_its_first_image_the_rest_stays_measured() {
    let experiment = code_panel(8);
    let whole = run(measured(&experiment), Stage::Adjust);
    let first = whole.connection_order[0];
    let network = run(
        edited(&whole, |n| set_use(n, first, ImageUse::Excluded)),
        Stage::Adjust,
    );
    assert_eq!(oriented(&network), 7);
    assert!(network.adjustment_is_fresh());
    assert!(largest_error(&network, &experiment) < TOLERANCE_MM);
    let used = |row: &crate::network::AdjustedObservation| row.image != first;
    assert!(
        network
            .adjustment
            .as_ref()
            .unwrap()
            .observations
            .iter()
            .all(used)
    );
    // Used again, it stands where it stood.
    let again = run(
        edited(&network, |n| set_use(n, first, ImageUse::Used)),
        Stage::Adjust,
    );
    assert_eq!(oriented(&again), 8);
    assert!(largest_error(&again, &experiment) < TOLERANCE_MM);
}

#[test]
fn a_single_image_left_is_no_start() {
    let experiment = code_panel(8);
    let whole = run(measured(&experiment), Stage::Adjust);
    let one = edited(&whole, |network| {
        for number in 2..=8 {
            network.image_mut(ImageId(number)).station = None;
        }
        // In an old frame, far off.
        let station = network.image_mut(ImageId(1)).station.as_mut().unwrap();
        station.pose.centre_in_world += Vector3::new(5000.0, 0.0, 0.0);
    });
    let network = run(one, Stage::AdjustCodes);
    assert_eq!(oriented(&network), 8);
    assert!(largest_error(&network, &experiment) < TOLERANCE_MM);
}

#[test]
fn images_added_later_are_connected_and_adjusted() {
    let experiment = code_panel(8);
    let mut network = measured(&experiment);
    for number in [7, 8] {
        set_use(&mut network, ImageId(number), ImageUse::Excluded);
    }
    let six = run(network, Stage::Adjust);
    assert_eq!(oriented(&six), 6);
    let eight = edited(&six, |network| {
        for number in [7, 8] {
            set_use(network, ImageId(number), ImageUse::Used);
        }
    });
    assert!(Stage::ALL.iter().all(|stage| !eight.is_concluded(*stage)));
    let network = run(eight, Stage::Adjust);
    assert_eq!(oriented(&network), 8);
    assert!(largest_error(&network, &experiment) < TOLERANCE_MM);
    assert!(
        network
            .passes
            .iter()
            .all(|pass| pass.basis == network.inputs)
    );
}

#[test]
fn what_is_no_longer_true_is_no_longer_told() {
    let experiment = code_panel(8);
    let mut blind = measured(&experiment);
    edited_codes(&mut blind, ImageId(5), |detections| {
        detections.codes.clear();
    });
    let network = run(blind, Stage::Connect);
    assert_eq!(outcome(&network, Stage::Connect), Some(Outcome::Incomplete));
    let told = |network: &Network| texts(&network.findings).join("\n").contains("image5.png");
    assert!(told(&network));
    let network = run(
        edited(&network, |n| set_use(n, ImageId(5), ImageUse::Excluded)),
        Stage::Connect,
    );
    assert_eq!(outcome(&network, Stage::Connect), Some(Outcome::Done));
    assert!(!told(&network), "{:?}", texts(&network.findings));
}

#[test]
fn weighted_control_fixes_the_frame_in_every_adjustment() {
    let experiment = code_panel(8);
    let mut network = measured(&experiment);
    // In a frame of its own, turned and far from where the free network stands.
    let in_frame =
        |place: Vector3<f64>| Vector3::new(2000.0 - place.y, place.x + 500.0, place.z - 100.0);
    let origins = experiment
        .scene
        .discs
        .iter()
        .filter(|disc| disc.label.ends_with(".O"));
    let control = origins.take(4).map(|disc| ControlPoint {
        label: disc.label.clone(),
        coordinates_mm: <[f64; 3]>::from(in_frame(disc.placement.origin)).map(Some),
        sigmas_mm: [Some(0.01); 3],
        role: ControlRole::Weighted,
    });
    network.control = Arc::new(control.collect());
    let network = run(network, Stage::Adjust);
    assert_eq!(oriented(&network), 8);
    let adjustment = network.adjustment.as_ref().unwrap();
    assert_eq!(adjustment.datum, "control points");
    assert!(
        (adjustment.sigma0 - 1.0).abs() < 0.15,
        "{}",
        adjustment.sigma0
    );
    for disc in &experiment.scene.discs {
        let id: PointId = disc.label.parse().unwrap();
        let error = network.points[&id].position - in_frame(disc.placement.origin);
        assert!(error.norm() < TOLERANCE_MM, "{}: {error:?}", disc.label);
    }
}

#[test]
fn without_codes_the_first_pair_fails_in_words() {
    let mut network = measured(&code_panel(4));
    for number in 1..=4 {
        edited_codes(&mut network, ImageId(number), |detections| {
            detections.codes.clear();
        });
    }
    let network = run(network, Stage::FirstPair);
    assert_eq!(outcome(&network, Stage::FirstPair), Some(Outcome::Failed));
    let told = network
        .findings
        .iter()
        .find(|f| f.kind == FindingKind::StageFailed)
        .unwrap();
    assert!(told.text.contains("share 0 code dots"), "{}", told.text);
    assert!(Stage::Connect.missing(&network).is_some());
}

#[test]
fn an_unreadable_image_leaves_the_others_measured() {
    let experiment = code_panel(8);
    let mut network = measured(&experiment);
    let image = network.image_mut(ImageId(4));
    image.detections = None;
    image.labels = Arc::default();
    let network = run(network, Stage::AdjustCodes);
    assert_eq!(outcome(&network, Stage::Detect), Some(Outcome::Incomplete));
    assert_eq!(oriented(&network), 7);
    assert!(largest_error(&network, &experiment) < TOLERANCE_MM);
}

#[test]
fn an_unknown_principal_distance_is_found() {
    let experiment = code_panel(10);
    for share in [0.6, 0.8, 1.25, 1.6] {
        let mut network = measured(&experiment);
        let camera = network.camera_mut(CameraId(1));
        camera.source = InteriorSource::Unknown;
        camera.nominal.interior.principal_distance *= share;
        camera.camera = camera.nominal.clone();
        let network = run(network, Stage::AdjustCodes);
        assert_eq!(
            oriented(&network),
            10,
            "{share}: {:?}",
            texts(&network.findings)
        );
        let error = largest_error(&network, &experiment);
        assert!(error < TOLERANCE_MM, "{share}: {error}");
    }
}

#[test]
fn images_from_one_place_make_no_pair() {
    let mut network = measured(&code_panel(4));
    let seen = network.images[&ImageId(1)].clone();
    for number in 2..=4 {
        let image = network.image_mut(ImageId(number));
        image.detections = seen.detections.clone();
        image.labels = seen.labels.clone();
    }
    let network = run(network, Stage::FirstPair);
    assert_eq!(outcome(&network, Stage::FirstPair), Some(Outcome::Failed));
    assert_eq!(oriented(&network), 0);
}

#[test]
fn a_few_wild_dots_are_rejected_and_kept_in_the_table() {
    let experiment = code_panel(8);
    let mut network = measured(&experiment);
    edited_codes(&mut network, ImageId(6), |detections| {
        for place in [4, 30] {
            detections.dots[DotIndex(place).slot()].centre_px.x += 0.5;
        }
    });
    let network = run(network, Stage::AdjustCodes);
    let rejected = network.images[&ImageId(6)]
        .labels
        .values()
        .filter(|l| l.rejected.is_some());
    assert_eq!(rejected.count(), 2);
    assert!(largest_error(&network, &experiment) < TOLERANCE_MM);
}
