//! What the last look at an image missed, questions about its dots, their names, and what the graphics card keeps.

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
fn where_nothing_is_seen_only_a_click_makes_a_centre() {
    let (mut network, _, place) = with_a_missed_target();
    let beside = place + Vector2::new(0.0, 14.0);
    // No dot, no candidate: a predicted place in the dark.
    let mut harness = harness(std::mem::take(&mut network));
    harness.state_mut().view.edit_place(beside);
    harness.run_steps(3);
    let popup = harness
        .query_by_label_contains("Label of the dot")
        .is_some();
    let notice = harness
        .query_by_label_contains("Nothing measurable there")
        .is_some();
    assert!(notice && !popup, "{notice} {popup}");
    assert!(harness.state().view.tool == Tool::Measure && edits(&harness).is_empty());
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

#[test]
fn marks_carry_the_names_that_targets_have_now() {
    let mut network = scene().network.clone();
    let (dot, point, _) = a_plain_dot(&network);
    let PointId::Target(number) = point else {
        panic!("a plain target");
    };
    let mut cache = MarksCache::default();
    cache.get(&network, FIRST);
    network.names = Arc::new(BTreeMap::from([(number, "edge".to_owned())]));
    let marks = cache.get(&network, FIRST);
    let label = marks.of(dot).and_then(|mark| mark.label.as_deref());
    assert_eq!(label, Some("edge"));
}

#[test]
fn the_graphics_card_keeps_no_decoded_picture_in_memory() {
    use eframe::egui_wgpu::{CallbackTrait as _, RendererOptions, ScreenDescriptor};
    use egui_kittest::wgpu::{create_render_state, default_wgpu_setup};
    let state = create_render_state(default_wgpu_setup(), RendererOptions::PREDICTABLE);
    install(&state);
    let picture = GreyImage::new(64, 64, BitDepth::Eight, vec![0; 64 * 64]);
    let callback = tiles::PictureCallback {
        view: 1,
        image: FIRST,
        picture: Arc::new(picture.expect("as many samples as pixels")),
        transform: ScreenFromImage {
            scale: 1.0,
            origin: Vector2::zeros(),
        },
        rect: Rect::from_min_size(Pos2::ZERO, vec2(64.0, 64.0)),
        window: GreyWindow {
            black: 0.0,
            white: 255.0,
        },
        context: egui::Context::default(),
    };
    let screen = ScreenDescriptor {
        size_in_pixels: [64, 64],
        pixels_per_point: 1.0,
    };
    let encoder = wgpu::CommandEncoderDescriptor::default();
    let mut encoder = state.device.create_command_encoder(&encoder);
    let mut renderer = state.renderer.write();
    callback.prepare(
        &state.device,
        &state.queue,
        &screen,
        &mut encoder,
        &mut renderer.callback_resources,
    );
    let decoded = Arc::downgrade(&callback.picture);
    drop(callback);
    assert!(decoded.upgrade().is_none());
}
