//! Keys: the review queue, the palette, the list of keys, Esc, and what belongs to a text field.

use std::sync::Arc;

use egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable as _;
use tiepoint::network::{Label, Source};
use tiepoint::project::edit::REJECTED_BY_OPERATOR;
use tiepoint::ui::panels::review::{ReviewKind, review_items};

use crate::bench::{Begun, Bench, Seen, first_image, folder, prepare, targets_of};

#[test]
fn the_review_queue_is_walked_through_by_one_key_each() {
    let folder = folder("review", Begun::Measured);
    let mut doubtful: Vec<Seen> = Vec::new();
    prepare(&folder, |network| {
        let images: Vec<_> = network.images.keys().copied().collect();
        for image in images.into_iter().take(2) {
            let seen = targets_of(network, image)[2];
            let labels = &mut network.image_mut(image).labels;
            let label: &mut Label = Arc::make_mut(labels).get_mut(&seen.dot).expect("a label");
            label.rejected = Some("residual 3.0 px".into());
            doubtful.push(seen);
        }
    });
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let items = review_items(&bench.network());
    let rejected = |seen: Seen| {
        let of = |item: &&_| {
            let item: &&tiepoint::ui::panels::review::ReviewItem = item;
            item.kind == ReviewKind::RejectedObservation
                && item.about.dot == Some((seen.image, seen.dot))
        };
        items.iter().find(of).expect("it is in the queue")
    };
    let first = items
        .iter()
        .position(|item| item.kind == ReviewKind::RejectedObservation)
        .expect("two of them");
    bench.keys(Modifiers::ALT, Key::Num2);
    bench.rest();
    assert!(bench.has(&format!("item 1 of {}", items.len())));
    for _ in 0..=first {
        bench.key(Key::N);
    }
    bench.key(Key::Backspace);
    assert!(bench.has(&format!("item {} of {}", first + 1, items.len())));
    assert_eq!(*bench.app().selection(), items[first].about, "in all views");

    // Accepting restores.
    let seen = doubtful
        .iter()
        .find(|seen| items[first].about.dot == Some((seen.image, seen.dot)));
    let seen = *seen.expect("one of the two");
    let before = bench.network();
    bench.key(Key::Space);
    let label = seen.label(&bench.network()).cloned().expect("its name");
    assert_eq!((label.rejected, label.source), (None, Source::Operator));
    bench.rest();
    assert!(bench.has(&format!("item {} of {}", first + 1, items.len() - 1)));
    bench.undo_and_redo(&before);
    bench.rest();

    // The next is rejected for good.
    let next = *doubtful
        .iter()
        .find(|other| other.dot != seen.dot || other.image != seen.image)
        .expect("the other");
    assert_eq!(*bench.app().selection(), rejected(next).about);
    let before = bench.network();
    bench.key(Key::X);
    let label = next.label(&bench.network()).cloned().expect("its name");
    assert_eq!(label.rejected.as_deref(), Some(REJECTED_BY_OPERATOR));
    bench.undo_and_redo(&before);
    bench.rest();
    let left = items.len() - 2;
    assert!(bench.says(&format!(" of {left}")) || left == 0);
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
    bench.keys(Modifiers::COMMAND, Key::F5);
    assert!(bench.app().runner().is_running());
    bench.window.key_down(Key::Escape);
    bench.window.step();
    assert!(
        !bench.app().runner().is_stopping(),
        "the palette closes first"
    );
    assert!(bench.app().runner().is_running());
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
    let measures = bench.app().image_views().any(|view| view.wants_escape());
    assert!(!measures, "the tool was not armed");
}
