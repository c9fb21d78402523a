//! Stages: the demo, all of them, one step, an interrupt, an edit that comes meanwhile.

use std::collections::BTreeSet;
use std::fs;
use std::sync::Arc;

use egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable as _;
use tiepoint::commands::DemoRequest;
use tiepoint::network::{ImageUse, Stage};
use tiepoint::synthetic::RenderSettings;
use tiepoint::ui::window::Beginning;

use crate::bench::{Begun, Bench, assert_undisturbed, folder, prepare};
use crate::common::{Folder, IMAGES, scene};

#[test]
fn the_demo_is_measured_before_the_operators_eyes() {
    // A folder of a demo whose pictures are there already, those of the small scene.
    let folder = folder("demo", Begun::Fresh);
    fs::rename(folder.at("p.tiepoint"), folder.at("box.tiepoint")).expect("the folder's own file");
    let truth = serde_json::json!({
        "seed": 1,
        "cross": "Present",
        "render": RenderSettings::default(),
        "truth": scene().experiment.truth(),
    });
    folder.write("truth.json", truth.to_string());
    let request = DemoRequest::usual(&folder.at(""));
    let mut bench = Bench::begin(Beginning::Demo(request));
    let mut grown = BTreeSet::new();
    bench.until("the end of the demo", |app| {
        grown.insert(app.network().oriented_images().count());
        app.is_idle()
    });
    bench.rest();
    assert_undisturbed(&bench.network());
    // Not every image of ten needs a frame of its own, but most have one.
    assert!(grown.len() > IMAGES / 2, "{grown:?}");
    assert!(bench.says(&format!("{IMAGES} stations")));
    assert!(bench.says("sigma0"));
}

#[test]
fn the_rendering_of_the_demo_can_be_stopped() {
    let folder = Folder::new("rendering");
    let request = DemoRequest::usual(&folder.at("demo"));
    let mut bench = Bench::begin(Beginning::Demo(request));
    assert!(bench.says("rendering the demo"));
    bench.click("Stop");
    bench.rest();
    assert!(bench.says("interrupted"), "{}", bench.app().message());
    // The empty window says what can be done first.
    for label in ["New project ...", "Open ...", "Demo"] {
        assert!(bench.has(label), "no button '{label}'");
    }
}

#[test]
fn all_stages_run_by_one_key() {
    let folder = folder("all", Begun::Fresh);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    assert!(bench.has(&format!("0/{IMAGES} open")));
    bench.keys(Modifiers::COMMAND, Key::F5);
    assert!(bench.app().runner().is_running());
    bench.rest();
    assert_undisturbed(&bench.network());
    let done = format!("{IMAGES}/{IMAGES} done");
    let counted = bench.window.query_all_by_label(&done).count();
    assert_eq!(counted, 2, "detected and connected");
}

#[test]
fn a_step_is_one_entry_of_the_history_and_a_stage_runs_to_its_end() {
    let folder = folder("step", Begun::Fresh);
    prepare(&folder, |network| {
        Arc::make_mut(&mut network.settings).detection_batch = 4;
    });
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let detected = |bench: &Bench| {
        let network = bench.network();
        let images = network.images.values();
        images.filter(|image| image.detections.is_some()).count()
    };
    let before = bench.network();
    bench.click("Step");
    bench.rest();
    assert_eq!(detected(&bench), 4);
    let history = bench.history();
    assert_eq!(history.len(), 1, "{history:?}");
    assert!(history[0].contains("detect"), "{history:?}");
    bench.undo_and_redo(&before);

    bench.keys(Modifiers::SHIFT, Key::F5);
    bench.rest();
    let network = bench.network();
    assert_eq!(detected(&bench), IMAGES);
    assert!(network.is_concluded(Stage::Detect));
    assert!(
        !network.is_concluded(Stage::FirstPair),
        "one stage, no more"
    );
    assert_eq!(network.oriented_images().count(), 0);

    // The first pair by the key.
    bench.key(Key::F5);
    bench.rest();
    assert!(bench.network().oriented_images().count() >= 2);
}

#[test]
fn an_interrupt_while_connecting_keeps_what_is_done_and_goes_on_to_the_same_points() {
    let folder = folder("interrupt", Begun::Paired);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    bench.click("Run all");
    bench.until("four images", |app| {
        app.network().oriented_images().count() >= 4
    });
    bench.key(Key::Escape);
    bench.rest();
    let oriented = bench.network().oriented_images().count();
    assert!((4..IMAGES).contains(&oriented), "{oriented} images");
    assert!(bench.says("Interrupted"), "{}", bench.app().message());
    bench.click("Run all");
    bench.rest();
    assert_undisturbed(&bench.network());
}

#[test]
fn an_edit_that_comes_during_a_step_is_made_at_its_end() {
    let folder = folder("pending", Begun::Fresh);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let network = bench.network();
    let (id, image) = network.images.iter().nth(2).expect("an image");
    let path = image.file.path.as_str();
    bench.click(path);
    let exclude = bench.window.get_by_label("Exclude").rect().center();
    bench.hover(exclude);
    // The step, the edit, the edit again, and that one taken back, within seven frames: the step is still under way.
    bench.window.key_down(Key::F5);
    bench.press_and_release(exclude);
    bench.press_and_release(exclude);
    bench.window.key_down_modifiers(Modifiers::COMMAND, Key::Z);
    bench.window.step();
    assert!(bench.app().runner().is_running(), "the step was too short");
    assert_eq!(bench.app().runner().pending().len(), 1);
    assert!(bench.has("1 edit waits for the end of this step"));
    assert_eq!(bench.network().images[id].usage, ImageUse::Used);
    bench.rest();
    assert_eq!(bench.network().images[id].usage, ImageUse::Excluded);
    assert_eq!(bench.history()[0], format!("exclude {path}"));
}
