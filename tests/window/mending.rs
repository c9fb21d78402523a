//! Fixing by hand: every kind of edit by its keys, taken back and done again.

use egui::{Key, Modifiers, Pos2, vec2};
use egui_kittest::kittest::Queryable as _;
use tiepoint::network::{ImageUse, Network, PointId, Source};
use tiepoint::project::edit::REJECTED_BY_OPERATOR;

use crate::bench::{Begun, Bench, Seen, dot_of, first_image, folder, miss, prepare, targets_of};
use crate::common::{Folder, IMAGES};

/// A measured project, a window with it, and the pointer on a plain target of the first image, near by.
fn at_a_target(name: &str) -> (Folder, Bench, Seen, Pos2) {
    let folder = folder(name, Begun::Measured);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let seen = targets_of(&bench.network(), first_image(&bench))[0];
    let at = bench.zoom_to(seen.image, seen.place_px);
    (folder, bench, seen, at)
}

#[test]
fn a_missed_label_is_given_by_two_keys_and_stands() {
    let (_folder, mut bench, seen, _) = at_a_target("label");
    let before = bench.network();
    bench.key(Key::Delete);
    assert_eq!(seen.label(&bench.network()), None);
    bench.undo_and_redo(&before);

    let before = bench.network();
    bench.key(Key::L);
    assert!(bench.has("Label of the dot"));
    bench.key(Key::Enter);
    assert!(!bench.has("Label of the dot"), "the list closes");
    let label = seen.label(&bench.network()).cloned().expect("a label");
    assert_eq!(
        (label.point, label.source),
        (seen.point, Source::Operator),
        "the nearest prediction stands first"
    );
    bench.undo_and_redo(&before);
    assert!(bench.says("before your last edits"));

    // Going on continues: nothing is detected or connected anew, and the name stands.
    bench.keys(Modifiers::COMMAND, Key::F5);
    bench.rest();
    let network = bench.network();
    assert!(network.adjustment_is_fresh(), "{}", bench.app().message());
    assert_eq!(network.oriented_images().count(), IMAGES);
    assert_eq!(seen.label(&network), Some(&label));
    let again = |title: &String| {
        let step = !title.ends_with("done");
        step && (title.starts_with("detect") || title.starts_with("connect"))
    };
    assert!(!bench.history().iter().any(again), "{:?}", bench.history());
}

#[test]
fn a_label_is_found_by_typing() {
    let (_folder, mut bench, seen, _) = at_a_target("typed");
    let network = bench.network();
    let other = targets_of(&network, seen.image)[1].point;
    bench.key(Key::L);
    bench.write(&network.label(other).to_lowercase());
    bench.key(Key::Enter);
    let network = bench.network();
    assert_eq!(seen.label(&network).map(|label| label.point), Some(other));
    let named = network.images[&seen.image].labels.values();
    assert_eq!(named.filter(|label| label.point == other).count(), 1);

    // Esc leaves all as it is.
    bench.key(Key::L);
    bench.key(Key::Escape);
    assert!(!bench.has("Label of the dot"));
    assert!(*bench.network() == *network);
}

#[test]
fn a_target_that_detection_missed_is_measured_where_the_operator_clicks() {
    let folder = folder("add", Begun::Measured);
    let mut missed = None;
    prepare(&folder, |network| {
        let image = *network.images.keys().next().expect("an image");
        let seen = targets_of(network, image)[0];
        miss(network, seen);
        missed = Some(seen);
    });
    let missed = missed.expect("a target that is missed");
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let before = bench.network();
    assert_eq!(dot_of(&before, missed), None);
    let at = bench.zoom_to(missed.image, missed.place_px);

    // With the pointer on its predicted place one key measures.
    bench.key(Key::A);
    assert!(bench.says("Measured: sigma"));
    bench.key(Key::Enter);
    let (place, by_hand) = dot_of(&bench.network(), missed).expect("the dot has its name");
    // The same estimator on the same picture; only the levels round the dot differ.
    assert!(
        (place - missed.place_px).norm() < 0.05,
        "{place} {missed:?}"
    );
    assert!(by_hand);
    bench.undo_and_redo(&before);
    bench.keys(Modifiers::COMMAND, Key::Z);

    // Elsewhere the key arms the tool, and the next click measures.
    bench.hover(at + vec2(-60.0, 45.0));
    bench.key(Key::A);
    assert!(!bench.says("Measured: sigma"));
    bench.click_at(at);
    assert!(bench.says("Measured: sigma"));
    bench.key(Key::Enter);
    let (again, _) = dot_of(&bench.network(), missed).expect("the dot has its name");
    assert!((again - place).norm() < 0.05, "{again} {place}");
    bench.undo_and_redo(&before);
}

#[test]
fn where_nothing_can_be_measured_the_centre_is_set_by_hand() {
    let (_folder, mut bench, seen, at) = at_a_target("by hand");
    let before = bench.network();
    let count = |network: &Network| {
        let detections = network.images[&seen.image].detections.as_ref();
        detections.map_or(0, |detections| detections.dots.len())
    };
    bench.hover(at + vec2(-60.0, 45.0));
    bench.key(Key::A);
    bench.click_at(at + vec2(-60.0, 45.0));
    assert!(bench.says("Set by hand, sigma"));
    bench.click("Add without a label");
    assert_eq!(count(&bench.network()), count(&before) + 1);
    bench.undo_and_redo(&before);
}

#[test]
fn a_dot_is_rejected_and_restored() {
    let (_folder, mut bench, seen, at) = at_a_target("reject");
    let reason = |bench: &Bench| {
        let label = seen.label(&bench.network()).cloned();
        label.expect("it keeps its name").rejected
    };
    let before = bench.network();
    bench.key(Key::X);
    assert_eq!(reason(&bench).as_deref(), Some(REJECTED_BY_OPERATOR));
    bench.undo_and_redo(&before);
    bench.click_at(at);
    let told = format!("It is not used: {REJECTED_BY_OPERATOR}");
    assert!(bench.has(&told), "the inspector says why");

    let before = bench.network();
    bench.key(Key::R);
    assert_eq!(reason(&bench), None);
    assert!(!bench.has(&told));
    bench.undo_and_redo(&before);
}

#[test]
fn a_code_gets_another_number() {
    let folder = folder("renumber", Begun::Measured);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let before = bench.network();
    let image = first_image(&bench);
    let detections = before.images[&image].detections.clone();
    let code = detections.as_ref().expect("detections").codes[0].clone();
    let detections = detections.expect("detections");
    let dot = code.dots[0];
    let at = bench.zoom_to(image, detections.dots[dot.slot()].centre_px);
    bench.hover(at);
    let used: Vec<u32> = detections.codes.iter().map(|code| code.id).collect();
    let free = (1..).find(|id| !used.contains(id)).expect("a number");
    bench.key(Key::N);
    assert!(bench.has("Number of the code, 1 to 420"));
    // There is no code 421: Enter does nothing.
    bench.write("421");
    bench.key(Key::Enter);
    assert!(bench.has("There is no such code."));
    for _ in 0..3 {
        bench.key(Key::Backspace);
    }
    bench.write(&free.to_string());
    bench.key(Key::Enter);
    let network = bench.network();
    let labels = &network.images[&image].labels;
    for (dot, point) in code.dots.iter().zip(PointId::of_code(code.family, free)) {
        assert_eq!(labels[dot].point, point);
        assert_eq!(labels[dot].source, Source::Operator);
    }
    bench.undo_and_redo(&before);
}

#[test]
fn an_image_is_excluded_and_settings_are_changed() {
    let folder = folder("settings", Begun::Measured);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let before = bench.network();
    let (id, image) = before.images.iter().nth(3).expect("an image");
    bench
        .window
        .get_by_label(&image.file.path)
        .click_secondary();
    bench.settle();
    bench.click("Exclude this image");
    assert_eq!(bench.network().images[id].usage, ImageUse::Excluded);
    bench.undo_and_redo(&before);

    let before = bench.network();
    bench.window.get_by_label("Settings").click_accesskit();
    bench.settle();
    let field = bench.window.get_by_label("Fewest rays of a target");
    field.set_value_accesskit(f64::from(before.settings.min_rays + 1));
    bench.settle();
    bench
        .window
        .get_by_label("Apply settings")
        .click_accesskit();
    bench.settle();
    let rays = |network: &Network| network.settings.min_rays;
    assert_eq!(rays(&bench.network()), rays(&before) + 1);
    bench.undo_and_redo(&before);
}

#[test]
fn a_list_names_the_targets_and_tells_what_is_left() {
    let folder = folder("list", Begun::Measured);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let network = bench.network();
    let mut list = "label,x_mm,y_mm,z_mm\n".to_owned();
    for (id, point) in network.points.iter() {
        let label = match id {
            PointId::Target(number) => format!("T-{number}"),
            PointId::Code { .. } | PointId::Device(_) => network.label(*id),
        };
        let [x, y, z] = point.position.into();
        list += &format!("{label},{x:.1},{y:.1},{z:.1}\n");
    }
    folder.write("list.csv", list.as_bytes());
    bench.keys(Modifiers::COMMAND, Key::K);
    bench.write("name targets by a list");
    bench.key(Key::Enter);
    bench.write(&folder.at("list.csv").display().to_string());
    bench.key(Key::Enter);
    bench.rest();
    let targets = network.targets().len();
    let named = bench.network();
    assert_eq!(named.names.len(), targets, "{}", bench.app().message());
    for (number, name) in named.names.iter() {
        assert_eq!(*name, format!("T-{number}"));
    }
    assert!(bench.says("transformation onto the reference"));
    bench.click("Close");
    bench.rest();
    assert!(bench.says(&format!("{targets} targets named by")));
    bench.undo_and_redo(&network);
}
