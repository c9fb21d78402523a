//! What the last look at an image missed, and questions about its dots.

use super::*;
use crate::network::{Absence, AbsenceKind, Agreement, AmbiguousGroup, Look, ReadTarget, Reading};
use crate::ui::action::Question;

#[test]
fn what_a_look_missed_is_marked_with_its_reason_and_nothing_else_is() {
    let (mut network, point, place) = with_a_missed_target();
    let beside = place + Vector2::new(0.4, 0.0);
    let absence = Absence {
        place_px: beside,
        kind: AbsenceKind::Glare,
        reason: "too bright to tell a dot".into(),
    };
    network.image_mut(FIRST).look = Some(Arc::new(Look {
        absent: [(point, absence)].into(),
        ..Look::default()
    }));
    let missed = missed_targets(&network, &network.images[&FIRST]);
    let towards: Vec<_> = missed
        .iter()
        .filter(|m| m.facing == Facing::Towards)
        .collect();
    assert_eq!(towards.len(), 1, "{towards:?}");
    assert_eq!((towards[0].point, towards[0].place_px), (point, beside));
    assert_eq!(towards[0].absence, Some(AbsenceKind::Glare));
    let (predicted, of_image) = (*towards[0], network.images[&FIRST].clone());
    let told = Harness::new_ui(move |ui| {
        let absence = of_image.absent().next().map(|(_, absence)| absence);
        hover::missed_tooltip(ui, &predicted, absence, None, &network);
    });
    told.get_by_label("in glare");
    told.get_by_label("too bright to tell a dot");
}

#[test]
fn the_dots_of_a_question_have_rings_and_its_reading_a_place() {
    let network = &scene().network;
    let (dot, point, place) = a_plain_dot(network);
    let reading = |target, dots: &[(ImageId, DotIndex)]| Reading {
        target,
        dots: dots.to_vec(),
        rays: Agreement::default(),
        shape: Agreement::default(),
        diameter_mm: None,
        log_likelihood: 1.0,
    };
    let of_first = reading(ReadTarget::Known(point), &[(FIRST, dot)]);
    let elsewhere = reading(ReadTarget::Known(point), &[]);
    let near =
        |found: Option<Vector2<f64>>| found.is_some_and(|found| (found - place).norm() < 1.0);
    assert!(near(place_of_reading(network, FIRST, &of_first)), "its dot");
    assert!(
        near(place_of_reading(network, FIRST, &elsewhere)),
        "predicted"
    );
    let others: Vec<(ImageId, DotIndex)> = network
        .oriented_images()
        .filter(|(id, ..)| *id != FIRST)
        .filter_map(|(id, image, _)| {
            let mut labels = image.used_labels();
            Some((id, labels.find(|(_, label)| label.point == point)?.0))
        })
        .collect();
    let group = AmbiguousGroup {
        readings: vec![reading(ReadTarget::Known(point), &others)],
    };
    let selection = Selection {
        question: Some(Question {
            group: Arc::new(group),
            in_hand: 0,
        }),
        ..Selection::default()
    };
    let lines = prediction::epipolar_lines(network, FIRST, &selection);
    assert!(!others.is_empty() && lines.len() >= others.len());
}
