//! Mending by hand on rendered pictures: what an edit costs, what it decides, and that no stage takes it back.

mod rendered;

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::Vector3;
use tiepoint::geometry::{Scale, fit_similarity};
use tiepoint::monitor::Monitor;
use tiepoint::network::{ImageId, Network, PointId, Source, Stage};
use tiepoint::project::edit::Edit;
use tiepoint::stages::{Pictures, Step};
use tiepoint::targets::DotIndex;

use rendered::{measure, run_stage, small_box};

/// Runs all stages and counts the steps of each.
fn go_on(mut network: Network, pictures: &dyn Pictures) -> (Network, BTreeMap<Stage, usize>) {
    let mut steps = BTreeMap::new();
    for stage in Stage::ALL {
        while let Some(step) = stage.next(&network) {
            assert!(
                !matches!(step, Step::Detect(_)),
                "an edit must not cost a detection"
            );
            *steps.entry(stage).or_default() += 1;
            network = step
                .run(&network, pictures, &Monitor::new())
                .expect("a step")
                .network;
        }
        network = stage.conclude(&network, None);
    }
    (network, steps)
}

fn edited(network: &Network, edits: &[Edit]) -> Network {
    let mut edited = network.clone();
    for edit in edits {
        edit.apply(&mut edited).expect("an edit");
    }
    edited
}

fn oriented(network: &Network) -> Vec<ImageId> {
    network.oriented_images().map(|(id, ..)| id).collect()
}

/// The dots of an image that are named by points of codes with coordinates, with their places.
fn code_dots(network: &Network, image: ImageId) -> Vec<(DotIndex, PointId)> {
    let entry = &network.images[&image];
    let labels = entry.used_labels().map(|(dot, label)| (dot, label.point));
    labels
        .filter(|(_, point)| point.code().is_some() && network.points.contains_key(point))
        .collect()
}

/// Three dots that span the picture.
fn spread(
    network: &Network,
    image: ImageId,
    dots: &[(DotIndex, PointId)],
) -> [(DotIndex, PointId); 3] {
    let detections = network.images[&image].detections.as_ref().unwrap();
    let place = |dot: &(DotIndex, PointId)| detections.dots[dot.0.slot()].centre_px;
    let mut best = (0.0, [dots[0]; 3]);
    for (i, a) in dots.iter().enumerate() {
        for (j, b) in dots.iter().enumerate().skip(i + 1) {
            for c in &dots[j + 1..] {
                let area = (place(b) - place(a)).perp(&(place(c) - place(a))).abs();
                if area > best.0 {
                    best = (area, [*a, *b, *c]);
                }
            }
        }
    }
    best.1
}

/// A centre of the second network beside that of the first, moved into its frame, in standard errors of the first.
fn centre_in_sigmas(first: &Network, second: &Network, image: ImageId) -> f64 {
    let pairs: Vec<(Vector3<f64>, Vector3<f64>)> = second
        .points
        .iter()
        .filter(|(id, _)| id.code().is_some())
        .filter_map(|(id, point)| Some((point.position, first.points.get(id)?.position)))
        .collect();
    let fit = fit_similarity(&pairs, Scale::Free).expect("common points");
    let station = |network: &Network| network.images[&image].station.clone().expect("a station");
    let (a, b) = (station(first), station(second));
    let covariance = a
        .covariance
        .expect("an adjusted station")
        .fixed_view::<3, 3>(3, 3)
        .into_owned();
    let apart = fit.apply(&b.pose.centre_in_world) - a.pose.centre_in_world;
    apart
        .dot(&(covariance.try_inverse().expect("a precision") * apart))
        .sqrt()
}

#[test]
fn three_labels_by_hand_connect_an_image_without_codes() {
    let scene = small_box(3, None);
    let detected = run_stage(scene.network, Stage::Detect, &scene.pictures);
    let (whole, _) = go_on(detected.clone(), &scene.pictures);
    let image = ImageId(7);
    let codes = detected.images[&image]
        .detections
        .as_ref()
        .unwrap()
        .codes
        .len();
    let aside: Vec<Edit> = (0..codes)
        .map(|reading| Edit::SetAside { image, reading })
        .collect();
    let (lost, _) = go_on(edited(&detected, &aside), &scene.pictures);
    assert!(lost.images[&image].station.is_none());
    let known: Vec<_> = code_dots(&whole, image)
        .into_iter()
        .filter(|(_, p)| lost.points.contains_key(p))
        .collect();
    let three = spread(&whole, image, &known);
    let labels = three.map(|(dot, point)| Edit::Label { image, dot, point });
    let (mended, steps) = go_on(edited(&lost, &labels), &scene.pictures);
    let reason = mended.images[&image]
        .attempt
        .as_ref()
        .map(|a| a.reason.clone());
    assert!(mended.images[&image].station.is_some(), "{reason:?}");
    assert_eq!(oriented(&mended), oriented(&whole));
    // Three standard errors in space: chi-square with three degrees of freedom exceeds 14.2 once in 370.
    let apart = centre_in_sigmas(&whole, &mended, image);
    assert!(apart < 14.2_f64.sqrt(), "{apart}");
    assert_eq!(steps[&Stage::Connect], 1);
    for (dot, point) in three {
        let label = &mended.images[&image].labels[&dot];
        assert_eq!((label.point, label.source), (point, Source::Operator));
    }
    let wrong = [three[0], three[1]].map(|(dot, point)| Edit::Label { image, dot, point });
    let (two, _) = go_on(edited(&lost, &wrong), &scene.pictures);
    assert!(
        two.images[&image].station.is_none(),
        "two labels are not enough"
    );
    // One label on a wrong dot: no pose is confirmed by the others.
    let elsewhere = known
        .iter()
        .find(|(_, p)| three.iter().all(|(_, q)| p.code() != q.code()))
        .unwrap();
    let mut wrong = labels.to_vec();
    wrong[2] = Edit::Label {
        image,
        dot: elsewhere.0,
        point: three[2].1,
    };
    let (refused, _) = go_on(edited(&lost, &wrong), &scene.pictures);
    let attempt = refused.images[&image]
        .attempt
        .as_ref()
        .map(|a| a.reason.clone());
    assert!(refused.images[&image].station.is_none());
    assert!(attempt.unwrap().contains("label one more"));
    // Any three of the known dots: nearly all triples do.
    let mut connected = 0;
    let triples: Vec<[usize; 3]> = (0..20)
        .map(|k| [k * 7, k * 7 + known.len() / 3, k * 7 + 2 * known.len() / 3])
        .collect();
    for triple in &triples {
        let labels = triple
            .map(|k| known[k % known.len()])
            .map(|(dot, point)| Edit::Label { image, dot, point });
        let connecting = run_stage(edited(&lost, &labels), Stage::Connect, &scene.pictures);
        connected += usize::from(connecting.images[&image].station.is_some());
    }
    assert!(4 * connected >= 3 * triples.len(), "{connected}");
}

#[test]
fn going_on_after_one_edit_costs_only_what_is_needed() {
    let scene = small_box(4, None);
    let done = measure(scene.network, &scene.pictures);
    let image = ImageId(5);
    let entry = &done.images[&image];
    let named = entry
        .labels
        .iter()
        .find(|(_, l)| matches!(l.point, PointId::Target(_)) && l.rejected.is_none());
    let (dot, point) = named.map(|(dot, label)| (*dot, label.point)).unwrap();
    let mut unlabelled = done.clone();
    Arc::make_mut(&mut unlabelled.image_mut(image).labels).remove(&dot);
    let readings = &entry.detections.as_ref().unwrap().codes;
    let reading = (0..readings.len())
        .find(|place| !entry.set_aside.contains_key(place))
        .unwrap();
    let id = readings[reading].id;
    for (what, network, edit) in [
        (
            "label a dot",
            &unlabelled,
            Edit::Label { image, dot, point },
        ),
        (
            "renumber a code wrongly",
            &done,
            Edit::Renumber {
                image,
                reading,
                id: id % 420 + 1,
            },
        ),
        ("accept a code", &done, Edit::AcceptCode { image, reading }),
        ("reject a dot", &done, Edit::Reject { image, dot }),
    ] {
        let (after, steps) = go_on(edited(network, &[edit]), &scene.pictures);
        assert_eq!(oriented(&after), oriented(&done), "{what}");
        assert!(
            !steps.contains_key(&Stage::FirstPair) && !steps.contains_key(&Stage::Connect),
            "{what}"
        );
        assert!(steps.values().sum::<usize>() <= 5, "{what}: {steps:?}");
        assert!(after.adjustment_is_fresh(), "{what}");
    }
}

#[test]
fn no_stage_takes_back_what_the_operator_decided() {
    let scene = small_box(5, None);
    let done = measure(scene.network, &scene.pictures);
    let image = ImageId(4);
    let targets: Vec<(DotIndex, PointId)> = done.images[&image]
        .used_labels()
        .filter(|(_, l)| matches!(l.point, PointId::Target(_)))
        .map(|(dot, l)| (dot, l.point))
        .collect();
    let [wrong, other, rejected, false_dot] = [0, 1, 2, 3].map(|k: usize| targets[k]);
    // A wrong name, a rejected name, and a dot that is no target.
    let edits = [
        Edit::Label {
            image,
            dot: wrong.0,
            point: other.1,
        },
        Edit::Reject {
            image,
            dot: rejected.0,
        },
        Edit::Unlabel {
            image,
            dot: false_dot.0,
        },
        Edit::Reject {
            image,
            dot: false_dot.0,
        },
    ];
    let (after, _) = go_on(edited(&done, &edits), &scene.pictures);
    let entry = &after.images[&image];
    let label = &entry.labels[&wrong.0];
    assert_eq!(
        (label.point, label.source),
        (other.1, Source::Operator),
        "a name stays"
    );
    assert!(
        label
            .rejected
            .as_ref()
            .is_some_and(|reason| reason.contains("|w|")),
        "the test speaks: {label:?}"
    );
    let told = after
        .findings
        .iter()
        .any(|f| f.text.contains("named by hand, is not used"));
    assert!(told, "{:?}", after.findings);
    assert!(entry.labels[&rejected.0].is_rejected_by_operator());
    assert!(
        !entry.labels.contains_key(&false_dot.0),
        "a false dot gets no name again"
    );
    // The right name again: what the adjustment rejected is decided anew.
    let (again, _) = go_on(
        edited(
            &after,
            &[Edit::Label {
                image,
                dot: wrong.0,
                point: wrong.1,
            }],
        ),
        &scene.pictures,
    );
    let label = &again.images[&image].labels[&wrong.0];
    assert_eq!((label.point, &label.rejected), (wrong.1, &None));
    let restore = [
        Edit::Restore {
            image,
            dot: rejected.0,
        },
        Edit::Restore {
            image,
            dot: false_dot.0,
        },
    ];
    let (restored, _) = go_on(edited(&again, &restore), &scene.pictures);
    let entry = &restored.images[&image];
    assert!(entry.labels[&rejected.0].rejected.is_none());
    assert_eq!(
        entry.labels[&false_dot.0].point, false_dot.1,
        "identification names it again"
    );
    // A new number in two images becomes a point.
    let second = ImageId(5);
    let shown = |id: ImageId| {
        let found = done.images[&id]
            .used_labels()
            .find(|(_, l)| l.point == wrong.1);
        found.map(|(dot, _)| dot)
    };
    let images: Vec<(ImageId, DotIndex)> = oriented(&done)
        .into_iter()
        .filter_map(|id| Some((id, shown(id)?)))
        .collect();
    assert!(images.len() >= 3, "{second:?}");
    let point = PointId::Target(5000);
    let renamed: Vec<Edit> = images
        .iter()
        .map(|(image, dot)| Edit::Label {
            image: *image,
            dot: *dot,
            point,
        })
        .collect();
    let (renamed, _) = go_on(edited(&done, &renamed), &scene.pictures);
    assert!(
        renamed
            .points
            .get(&point)
            .is_some_and(|p| p.covariance.is_some()),
        "a point named by hand is adjusted"
    );
    assert!(renamed.next_target >= 5000);
}
