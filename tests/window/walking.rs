//! Keys: the review queue, the palette, the list of keys, Esc, and what belongs to a text field.

use std::sync::Arc;

use egui::{Event, Key, Modifiers};
use egui_kittest::kittest::Queryable as _;
use nalgebra::{Matrix3, Vector3};
use tiepoint::network::{Agreement, AmbiguousGroup, ImageId, Network, ReadTarget, Reading, Source};
use tiepoint::project::edit::REJECTED_BY_OPERATOR;
use tiepoint::ui::panels::review::{ReviewItem, ReviewKind, review_items};

use crate::bench::{
    Begun, Bench, MOST_FRAMES, Seen, dot_of, first_image, folder, miss, prepare, targets_of,
};

/// Rejects a target in each of two images, as the test of the adjustment would.
fn reject_two(network: &mut Network) -> [Seen; 2] {
    let images: Vec<ImageId> = network.images.keys().copied().take(2).collect();
    [images[0], images[1]].map(|image| {
        let seen = targets_of(network, image)[2];
        let labels = Arc::make_mut(&mut network.image_mut(image).labels);
        let label = labels.get_mut(&seen.dot).expect("its label");
        label.rejected = Some("residual 3.0 px".into());
        seen
    })
}

/// Shows the review queue and goes on to its first item of a kind; returns its place and all items.
fn review(bench: &mut Bench, kind: ReviewKind) -> (usize, Vec<ReviewItem>) {
    let items = review_items(&bench.network());
    let place = items.iter().position(|item| item.kind == kind);
    let place = place.expect("an item of this kind");
    bench.keys(Modifiers::ALT, Key::Num2);
    bench.rest();
    assert!(bench.has(&format!("item 1 of {}", items.len())));
    for _ in 0..place {
        bench.key(Key::N);
    }
    assert!(bench.has(&format!("item {} of {}", place + 1, items.len())));
    (place, items)
}

/// A key that goes down.
fn press(key: Key, modifiers: Modifiers) -> Event {
    Event::Key {
        key,
        physical_key: None,
        pressed: true,
        repeat: false,
        modifiers,
    }
}

#[test]
fn the_review_queue_is_walked_through_by_one_key_each() {
    let folder = folder("review", Begun::Measured);
    let mut doubtful = None;
    prepare(&folder, |network| doubtful = Some(reject_two(network)));
    let doubtful = doubtful.expect("two rejected targets");
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let (place, items) = review(&mut bench, ReviewKind::RejectedObservation);
    bench.key(Key::N);
    assert_eq!(*bench.app().selection(), items[place + 1].about);
    bench.key(Key::Backspace);
    assert_eq!(*bench.app().selection(), items[place].about, "in all views");
    let of = |item: &ReviewItem| {
        let mut both = doubtful.into_iter();
        both.find(|seen| item.about.dot == Some((seen.image, seen.dot)))
            .expect("one of the two")
    };
    let [first, second] = [of(&items[place]), of(&items[place + 1])];

    // Accepting restores, and the next comes.
    let before = bench.network();
    bench.key(Key::Space);
    bench.rest();
    let label = first.label(&bench.network()).cloned().expect("its name");
    assert_eq!((label.rejected, label.source), (None, Source::Operator));
    assert!(bench.has(&format!("item {} of {}", place + 1, items.len() - 1)));
    assert_eq!(*bench.app().selection(), items[place + 1].about);
    bench.undo_and_redo(&before);
    bench.rest();

    // The next is rejected for good.
    let before = bench.network();
    bench.key(Key::X);
    bench.rest();
    let label = second.label(&bench.network()).cloned().expect("its name");
    assert_eq!(label.rejected.as_deref(), Some(REJECTED_BY_OPERATOR));
    let left = items.len() - 2;
    assert!(bench.has("Nothing is doubtful.") || bench.says(&format!(" of {left}")));
    bench.undo_and_redo(&before);
}

#[test]
fn a_missed_target_is_measured_and_named_by_one_key_of_the_review() {
    let folder = folder("missed", Begun::Measured);
    let mut missed = None;
    prepare(&folder, |network| {
        let image = *network.images.keys().next().expect("an image");
        let seen = targets_of(network, image)[0];
        miss(network, seen);
        missed = Some(seen);
    });
    let missed = missed.expect("a missed target");
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let (place, items) = review(&mut bench, ReviewKind::MissedTarget);
    let of = |item: &ReviewItem| item.about.point == Some(missed.point);
    let farther = items[place..].iter().position(of).expect("it is offered");
    for _ in 0..farther {
        bench.key(Key::N);
    }
    for _ in 0..MOST_FRAMES {
        if !bench.says("Its picture is being read.") {
            break;
        }
        bench.rest();
    }
    let before = bench.network();
    bench.key(Key::Space);
    let (place, by_hand) = dot_of(&bench.network(), missed).expect("a dot with its name");
    assert!((place - missed.place_px).norm() < 0.05 && by_hand);
    bench.undo_and_redo(&before);
}

#[test]
fn the_palette_finds_commands_images_and_points() {
    let folder = folder("palette", Begun::Measured);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let network = bench.network();
    bench.keys(Modifiers::COMMAND, Key::K);
    bench.write("four image");
    bench.key(Key::Enter);
    assert_eq!(bench.app().image_views().count(), 4);

    let seen = targets_of(&network, first_image(&bench))[4];
    bench.keys(Modifiers::COMMAND, Key::K);
    bench.write(&network.label(seen.point).to_lowercase());
    bench.key(Key::Enter);
    assert_eq!(bench.app().selection().point, Some(seen.point));

    let (id, image) = network.images.iter().nth(7).expect("an image");
    bench.keys(Modifiers::COMMAND, Key::K);
    bench.write(&image.file.path);
    bench.key(Key::Enter);
    assert_eq!(bench.app().selection().image, Some(*id));
    assert!(!bench.has("Commands, images, points"), "it closes");
}

#[test]
fn keys_typed_within_one_frame_mean_what_they_mean_one_by_one() {
    let folder = folder("ahead", Begun::Measured);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let network = bench.network();
    let image = first_image(&bench);
    let targets = targets_of(&network, image);
    let other = targets[5];
    bench.zoom_to(image, targets[0].place_px);
    let go_to = |bench: &mut Bench, seen: Seen| {
        bench.keys(Modifiers::COMMAND, Key::K);
        bench.write(&network.label(seen.point).to_lowercase());
        bench.key(Key::Enter);
    };
    // The pointer rests where a target comes that is looked at.
    go_to(&mut bench, other);
    let middle = bench.place(image, other.place_px);
    bench.hover(middle);
    go_to(&mut bench, targets[0]);

    let mut typed = vec![press(Key::K, Modifiers::COMMAND)];
    let text = format!("point {}", network.label(other.point).to_lowercase());
    for letter in text.chars() {
        let key = match letter {
            ' ' => Key::Space,
            _ => Key::from_name(&letter.to_uppercase().to_string()).expect("a letter or digit"),
        };
        typed.push(press(key, Modifiers::NONE));
        typed.push(Event::Text(letter.to_string()));
    }
    typed.push(press(Key::Enter, Modifiers::NONE));
    typed.push(press(Key::X, Modifiers::NONE));
    bench.type_ahead(typed);
    bench.rest();

    assert_eq!(bench.app().selection().point, Some(other.point));
    assert!(!bench.has("Commands, images, points"), "it closes");
    assert_eq!(first_image(&bench), image, "N and P were letters");
    let label = other.label(&bench.network()).cloned().expect("its label");
    assert_eq!(label.rejected.as_deref(), Some(REJECTED_BY_OPERATOR));
}

#[test]
fn a_held_key_decides_one_item() {
    let folder = folder("held", Begun::Measured);
    prepare(&folder, |network| {
        reject_two(network);
    });
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let (_, items) = review(&mut bench, ReviewKind::RejectedObservation);
    bench.type_ahead(vec![press(Key::Space, Modifiers::NONE); 5]);
    bench.rest();
    assert!(bench.says(&format!(" of {}", items.len() - 1)));
    assert_eq!(bench.history().len(), 1, "{:?}", bench.history());
}

#[test]
fn behind_a_dialog_no_key_decides_or_turns_pages() {
    let folder = folder("behind", Begun::Measured);
    prepare(&folder, |network| {
        reject_two(network);
    });
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    review(&mut bench, ReviewKind::RejectedObservation);
    bench.key(Key::N);
    bench.key(Key::Backspace);
    bench.keys(Modifiers::SHIFT, Key::Questionmark);
    assert!(bench.has("All keys"));
    let before = bench.network();
    let (shown, selected) = (first_image(&bench), bench.app().selection().clone());
    for key in [Key::Space, Key::X, Key::N, Key::P] {
        bench.key(key);
    }
    assert!(*bench.network() == *before, "{:?}", bench.history());
    assert_eq!(first_image(&bench), shown);
    assert_eq!(*bench.app().selection(), selected);
    bench.key(Key::Escape);
    bench.key(Key::Space);
    assert!(*bench.network() != *before);
}

#[test]
fn esc_closes_what_lies_on_top_before_it_interrupts() {
    let folder = folder("esc", Begun::Fresh);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    bench
        .window
        .key_press_modifiers(Modifiers::SHIFT, Key::Questionmark);
    bench.settle();
    assert!(bench.says("name the dot"), "the list of keys");
    bench.key(Key::Escape);
    assert!(!bench.says("name the dot"));

    bench.keys(Modifiers::COMMAND, Key::K);
    bench.window.key_down_modifiers(Modifiers::COMMAND, Key::F5);
    bench.window.key_down(Key::Escape);
    bench.window.step();
    let runner = bench.app().runner();
    assert!(
        runner.is_running() && !runner.is_stopping(),
        "the palette closes first"
    );
    bench.window.key_down(Key::Escape);
    bench.window.step();
    let runner = bench.app().runner();
    assert!(runner.is_stopping() || !runner.is_running());
    bench.rest();
    assert_eq!(bench.network().oriented_images().count(), 0);
}

#[test]
fn a_text_field_keeps_its_keys() {
    let folder = folder("typing", Begun::Measured);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let seen = targets_of(&bench.network(), first_image(&bench))[0];
    bench.zoom_to(seen.image, seen.place_px);
    bench.key(Key::X);
    let edited = bench.network();
    bench.click("Filter images");
    let first = first_image(&bench);
    for (key, text) in [(Key::N, "n"), (Key::P, "p"), (Key::G, "g")] {
        bench.key(key);
        bench.write(text);
    }
    assert_eq!(first_image(&bench), first, "no page was turned");
    bench.keys(Modifiers::COMMAND, Key::Z);
    assert!(
        *bench.network() == *edited,
        "the text is taken back, not the edit"
    );
    // Back in the picture the same keys are commands again.
    bench.window.remove_cursor();
    let title = bench.window.get_by_label("3D view").rect().left_bottom();
    bench.click_at(title + egui::vec2(4.0, -4.0));
    bench.keys(Modifiers::COMMAND, Key::Z);
    assert!(*bench.network() != *edited);
}

#[test]
fn keys_with_alt_bring_panels_to_the_front_wherever_the_pointer_is() {
    let folder = folder("alt", Begun::Measured);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let seen = targets_of(&bench.network(), first_image(&bench))[0];
    let at = bench.zoom_to(seen.image, seen.place_px);
    bench.keys(Modifiers::ALT, Key::Num3);
    assert!(bench.has("Filter rows"));
    bench.keys(Modifiers::ALT, Key::Num1);
    assert!(!bench.has("Filter rows"));
    assert_eq!(bench.place(seen.image, seen.place_px), at, "not one to one");
    bench.keys(Modifiers::ALT, Key::A);
    let measures = bench
        .app()
        .image_views()
        .any(tiepoint::ui::image_view::ImageView::wants_escape);
    assert!(!measures, "the tool was not armed");
}

/// Leaves a dot without a name that a new target and the old one claim.
fn ask_about_a_dot(network: &mut Network) {
    let image = *network.images.keys().next().expect("an image");
    let seen = targets_of(network, image)[0];
    Arc::make_mut(&mut network.image_mut(image).labels).remove(&seen.dot);
    let reading = |target, log_likelihood| Reading {
        target,
        dots: vec![(image, seen.dot)],
        rays: Agreement::default(),
        shape: Agreement::default(),
        diameter_mm: None,
        log_likelihood,
    };
    let new = ReadTarget::New {
        position: Vector3::zeros(),
        covariance: Matrix3::identity(),
    };
    network.ambiguous = Arc::new(vec![AmbiguousGroup {
        readings: vec![
            reading(new, 9.0),
            reading(ReadTarget::Known(seen.point), 7.0),
        ],
    }]);
}

#[test]
fn keys_with_alt_answer_no_question_of_the_review() {
    let folder = folder("question", Begun::Measured);
    prepare(&folder, ask_about_a_dot);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let (place, items) = review(&mut bench, ReviewKind::AmbiguousGroup);
    bench.key(Key::N);
    bench.key(Key::Backspace);
    assert!(bench.has(&format!("item {} of {}", place + 1, items.len())));
    let before = bench.network();
    bench.keys(Modifiers::ALT, Key::Num1);
    assert!(*bench.network() == *before, "{:?}", bench.history());
    bench.keys(Modifiers::ALT, Key::Num2);
    bench.key(Key::Num2);
    assert!(*bench.network() != *before, "without Alt it answers");
}
