//! The queue by its keys.

use super::*;
use crate::imaging::{BitDepth, GreyImage};
use crate::network::{
    Agreement, AmbiguousGroup, CameraId, ImageId, Label, Network, Point, PointId, ReadTarget,
    Reading, Source,
};
use crate::targets::DotIndex;
use crate::ui::panels::fixture::{Bench, network};
use egui_kittest::kittest::Queryable as _;
use nalgebra::{Vector2, Vector3};

fn bench() -> Bench {
    let mut panel = Review::default();
    Bench::new(network(), move |ui, context, actions| {
        panel.ui(ui, context, actions);
    })
}

#[test]
fn space_restores_x_rejects_and_the_views_follow() {
    let mut bench = bench();
    let items = review_items(&network());
    bench.actions();
    bench
        .harness
        .get_by_label(&format!("item 1 of {}", items.len()));
    bench.harness.key_press(Key::N);
    let expected = Action::LookAt(items[1].about.clone());
    assert_eq!(bench.actions(), [expected]);
    bench.harness.key_press(Key::Backspace);
    assert_eq!(bench.actions(), [Action::LookAt(items[0].about.clone())]);
    let rejected = items
        .iter()
        .position(|i| i.kind == ReviewKind::RejectedObservation)
        .unwrap();
    for _ in 0..rejected {
        bench.harness.key_press(Key::N);
        bench.actions();
    }
    let (image, dot) = (ImageId(1), DotIndex(1));
    bench.harness.key_press(Key::Space);
    assert_eq!(
        bench.actions()[0],
        Action::Edit(Edit::Restore { image, dot })
    );
    bench.harness.get_by_label("Reject (X)").click();
    assert_eq!(
        bench.actions()[0],
        Action::Edit(Edit::Reject { image, dot })
    );
}

#[test]
fn a_decided_item_leaves_the_queue() {
    let mut bench = bench();
    let count = review_items(&network()).len();
    bench.actions();
    bench.change(|network| {
        let edit = Edit::Reject {
            image: ImageId(1),
            dot: DotIndex(1),
        };
        edit.apply(network).unwrap();
    });
    bench
        .harness
        .get_by_label(&format!("item 1 of {}", count - 1));
}

/// A point that the first image should show and does not, seen by the second from the same side; where it should be.
fn with_a_missed_target() -> (Network, PointId, Vector2<f64>) {
    let mut network = network();
    let (first, second) = (ImageId(1), ImageId(2));
    let station = network.images[&first].station.clone().unwrap();
    let ahead = station
        .pose
        .world_from_direction(&Vector3::new(0.0, 0.0, -1000.0));
    let point: PointId = "M700".parse().unwrap();
    let position = station.pose.centre_in_world + ahead;
    let camera = &network.cameras[&CameraId(1)].camera;
    let place = camera
        .project(&station.pose.camera_from_point(&position))
        .unwrap();
    let coordinates = Point {
        position,
        covariance: None,
        rays: 2,
        circle: None,
    };
    Arc::make_mut(&mut network.points).insert(point, Arc::new(coordinates));
    let label = Label {
        point,
        source: Source::Automatic,
        rejected: None,
    };
    let seen = network.image_mut(second);
    seen.station = Some(station);
    seen.labels = Arc::new([(DotIndex(0), label)].into());
    (network, point, place)
}

/// A dark picture of the first image's size, with a light dot of 9 px where one is.
fn picture(dot: Option<Vector2<f64>>) -> Arc<GreyImage> {
    let (width, height) = (3008_usize, 1960_usize);
    let mut samples: Vec<u16> = (0..width * height)
        .map(|slot| 20 + (slot * 7 % 5) as u16)
        .collect();
    if let Some(dot) = dot {
        for row in dot.y as usize - 12..dot.y as usize + 12 {
            for column in dot.x as usize - 12..dot.x as usize + 12 {
                let distance = (column as f64 + 0.5 - dot.x).hypot(row as f64 + 0.5 - dot.y);
                samples[row * width + column] +=
                    (120.0 / (1.0 + ((distance - 4.5) / 0.45).exp())) as u16;
            }
        }
    }
    Arc::new(GreyImage::new(width as u32, height as u32, BitDepth::Eight, samples).unwrap())
}

fn missed_bench(network: Network, picture: Arc<GreyImage>) -> Bench {
    let mut panel = Review::default();
    let pictures = [(ImageId(1), picture)].into();
    let mut bench = Bench::with_pictures(
        network.clone(),
        Selection::default(),
        pictures,
        move |ui, context, actions| {
            panel.ui(ui, context, actions);
        },
    );
    let items = review_items(&network);
    let place = items
        .iter()
        .position(|i| i.kind == ReviewKind::MissedTarget);
    for _ in 0..place.expect("a missed target") {
        bench.harness.key_press(Key::N);
        bench.actions();
    }
    bench
}

#[test]
fn a_missed_target_is_measured_and_named_by_one_key() {
    let (network, point, place) = with_a_missed_target();
    let true_centre = place + Vector2::new(1.2, -0.7);
    let mut bench = missed_bench(network, picture(Some(true_centre)));
    bench.harness.get_by_label_contains("Measured: sigma");
    bench
        .harness
        .get_by_label_contains("sigma) from its predicted place");
    bench.harness.key_press(Key::Space);
    let actions = bench.actions();
    let Action::Edit(Edit::AddDot {
        image,
        dot,
        point: named,
    }) = &actions[0]
    else {
        panic!("{actions:?}");
    };
    assert_eq!((*image, *named), (ImageId(1), Some(point)));
    // Made by hand with whole grey values: a twentieth of a pixel is asked.
    assert!(
        (dot.centre_px - true_centre).norm() < 0.05 && dot.sigma_px < 0.1,
        "{dot:?}"
    );
    bench.change(|network| {
        let edit = Edit::AddDot {
            image: ImageId(1),
            dot: dot.clone(),
            point: Some(point),
        };
        edit.apply(network).unwrap();
    });
    assert!(
        bench.harness.query_by_label("missed target").is_none(),
        "it left the queue"
    );
}

#[test]
fn a_predicted_place_is_never_taken_for_a_measurement() {
    let (network, ..) = with_a_missed_target();
    let count = review_items(&network).len();
    let mut bench = missed_bench(network, picture(None));
    bench
        .harness
        .get_by_label_contains("Nothing measurable there:");
    bench.harness.key_press(Key::Space);
    let actions = bench.actions();
    assert!(
        !actions.iter().any(|a| matches!(a, Action::Edit(_))),
        "{actions:?}"
    );
    bench
        .harness
        .get_by_label_contains("M700: nothing measurable there");
    // It still waits: a click in the image may set it.
    let heading = format!("of {count}");
    let items = bench.harness.query_all_by_label_contains(&heading);
    assert_eq!(items.count(), 1);
}

#[test]
fn e_asks_for_the_list_of_labels() {
    let (network, point, place) = with_a_missed_target();
    let mut bench = missed_bench(network, picture(Some(place)));
    bench.harness.key_press(Key::E);
    let actions = bench.actions();
    let Some(Action::EditLabel(about)) = actions.first() else {
        panic!("{actions:?}");
    };
    assert_eq!((about.point, about.image), (Some(point), Some(ImageId(1))));
    assert!(about.place.is_some());
}

#[test]
fn a_target_that_is_not_there_is_never_asked_for_again() {
    let (network, point, _) = with_a_missed_target();
    let count = review_items(&network).len();
    let mut bench = missed_bench(network, picture(None));
    bench.harness.key_press(Key::X);
    let image = ImageId(1);
    let edit = Edit::NotThere { image, point };
    assert_eq!(bench.actions()[0], Action::Edit(edit.clone()));
    bench.change(|network| edit.apply(network).unwrap());
    assert!(bench.harness.query_by_label("missed target").is_none());
    let left = format!("of {}", count - 1);
    let items = bench.harness.query_all_by_label_contains(&left);
    assert_eq!(items.count(), 1);
}

/// Two dots without a name that a new target and an old one claim.
fn with_a_question() -> Network {
    let mut network = network();
    let new = ReadTarget::New {
        position: Vector3::new(10.0, 0.0, 0.0),
        covariance: nalgebra::Matrix3::identity(),
    };
    let reading = |target, dots: &[u32], log_likelihood| Reading {
        target,
        dots: dots
            .iter()
            .map(|dot| (ImageId(1), DotIndex(*dot)))
            .collect(),
        rays: Agreement {
            chi_square: 8.0,
            freedom: 2,
        },
        shape: Agreement::default(),
        diameter_mm: Some(5.0),
        log_likelihood,
    };
    let old = ReadTarget::Known("M2".parse().unwrap());
    let point = Point {
        position: Vector3::new(1.0, 2.0, 3.0),
        covariance: None,
        rays: 3,
        circle: None,
    };
    Arc::make_mut(&mut network.points).insert("M2".parse().unwrap(), Arc::new(point));
    network.ambiguous = Arc::new(vec![AmbiguousGroup {
        readings: vec![reading(new, &[4, 6], 9.0), reading(old, &[4], 7.0)],
    }]);
    network
}

fn at_the_question() -> (Bench, AmbiguousGroup) {
    let network = with_a_question();
    let group = network.open_groups().remove(0);
    let items = review_items(&network);
    let question = |item: &ReviewItem| item.kind == ReviewKind::AmbiguousGroup;
    assert_eq!(items.iter().filter(|item| question(item)).count(), 1);
    let place = items.iter().position(question).unwrap();
    let mut panel = Review::default();
    let mut bench = Bench::new(network, move |ui, context, actions| {
        panel.ui(ui, context, actions);
    });
    for _ in 0..place {
        bench.harness.key_press(Key::N);
        bench.actions();
    }
    (bench, group)
}

#[test]
fn a_question_shows_its_readings_and_a_number_decides() {
    let (mut bench, group) = at_the_question();
    bench.harness.get_by_label("a new target");
    bench.harness.get_by_label("7.4");
    bench.harness.get_by_label("M2").click();
    let actions = bench.actions();
    let [Action::LookAt(about)] = &actions[..] else {
        panic!("{actions:?}");
    };
    let question = about.question.as_ref().expect("the question in hand");
    assert_eq!(question.reading(), Some(&group.readings[1]));
    assert_eq!(about.dot, Some((ImageId(1), DotIndex(4))));
    let take = |place: usize| {
        let reading = group.readings[place].clone();
        Action::Edit(Edit::TakeReading(Box::new(reading)))
    };
    bench.harness.key_press(Key::Num1);
    assert_eq!(bench.actions()[0], take(0));
    bench.harness.key_press(Key::Space);
    assert_eq!(bench.actions()[0], take(1), "the reading in hand");
    bench.harness.key_press(Key::Num3);
    assert_eq!(bench.actions(), [], "there is no third reading");
    bench.harness.key_press(Key::X);
    let dots = group.dots().into_iter().collect();
    let none = Action::Edit(Edit::DismissReadings { dots });
    assert_eq!(bench.actions()[0], none);
    bench.change(|network| {
        let edit = Edit::TakeReading(Box::new(group.readings[1].clone()));
        edit.apply(network).unwrap();
    });
    assert!(bench.harness.query_by_label("ambiguous group").is_none());
}

#[test]
fn after_a_look_the_queue_asks_for_what_may_still_be_found() {
    use crate::network::{Absence, AbsenceKind, Look};
    let (mut network, point, place) = with_a_missed_target();
    let looked = |kind| Look {
        absent: [(
            point,
            Absence {
                place_px: place,
                kind,
                reason: "its reason".into(),
            },
        )]
        .into(),
        ..Look::default()
    };
    let mut missed_after = |look| {
        network.image_mut(ImageId(1)).look = Some(Arc::new(look));
        let mut items = review_items(&network);
        items.retain(|item| item.kind == ReviewKind::MissedTarget);
        items
    };
    let weak = missed_after(looked(AbsenceKind::Weak));
    assert_eq!(weak.len(), 1);
    assert!(
        weak[0].evidence.ends_with("too weak: its reason"),
        "{}",
        weak[0].evidence
    );
    let mut in_its_words = looked(AbsenceKind::Weak);
    in_its_words.absent.get_mut(&point).unwrap().reason = "too weak: 0.1 of 2.0".into();
    let weak = missed_after(in_its_words);
    let evidence = &weak[0].evidence;
    assert!(evidence.ends_with("; too weak: 0.1 of 2.0"), "{evidence}");
    assert_eq!(missed_after(looked(AbsenceKind::Covered)), []);
    assert_eq!(missed_after(Look::default()), [], "the look expects it not");
    let unreadable = Look {
        unreadable: Some("no file".into()),
        ..Look::default()
    };
    assert_eq!(missed_after(unreadable).len(), 1, "nobody could look");
}
