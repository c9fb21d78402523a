//! A window that is gone in the middle of a stage: what was finished is there when the project is opened again.

use std::sync::Arc;

use egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable as _;
use tiepoint::network::{ImageUse, Network};
use tiepoint::project::session::{Saving, Session};
use tiepoint::ui::app::App;

use crate::bench::{Begun, Bench, assert_undisturbed, folder};
use crate::common::{Folder, IMAGES};

fn is_saved(app: &App) -> bool {
    app.session().map(Session::saving) == Some(Saving::Saved)
}

/// What a kill at this moment leaves on the disk; between two frames of a window that has saved nothing is written.
fn left_by_a_kill(of: &Folder) -> Folder {
    let copy = Folder::with_scene("left");
    for name in of.names() {
        if name.starts_with("p.tiepoint") && !name.ends_with("-lock") && !name.ends_with("-shm") {
            copy.write(&name, of.read(&name));
        }
    }
    copy
}

fn goes_on(folder: &Folder, before: &Network) {
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    assert!(
        *bench.network() == *before,
        "not as after the last finished step: {}",
        bench.app().message()
    );
    bench.keys(Modifiers::COMMAND, Key::F5);
    bench.rest();
    assert_undisturbed(&bench.network());
}

#[test]
fn a_killed_window_goes_on_from_its_last_finished_step() {
    let folder = folder("killed", Begun::Paired);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    bench.keys(Modifiers::COMMAND, Key::F5);
    type Come = fn(&Network) -> bool;
    let moments: [(&str, Come); 2] = [
        ("connecting", |network| {
            network.oriented_images().count() >= 4
        }),
        ("identifying", |network| !network.passes.is_empty()),
    ];
    let mut left: Vec<(Folder, Arc<Network>)> = Vec::new();
    for (moment, come) in moments {
        bench.until(moment, |app| come(app.network()) && is_saved(app));
        left.push((left_by_a_kill(&folder), bench.network()));
    }
    assert!(
        left[0].1.oriented_images().count() < IMAGES,
        "in the middle of connecting"
    );
    drop(bench);
    for (copy, network) in &left {
        goes_on(copy, network);
    }
}

#[test]
fn a_window_that_goes_in_the_middle_of_a_stage_leaves_all_finished_steps() {
    let folder = folder("gone", Begun::Paired);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    bench.keys(Modifiers::COMMAND, Key::F5);
    bench.until("four images", |app| {
        app.network().oriented_images().count() >= 4
    });
    assert!(bench.app().runner().is_running());
    let network = bench.network();
    drop(bench);
    let files = folder.names();
    let left: Vec<&String> = files.iter().filter(|n| n.starts_with("p.tiep")).collect();
    assert_eq!(left, ["p.tiepoint"], "closed as it should be");
    goes_on(&folder, &network);
}

#[test]
fn an_edit_that_waits_for_a_step_is_in_the_file_when_the_project_goes() {
    type Leave = fn(&mut Bench);
    let ways: [(&str, Leave); 2] = [
        ("closed", |bench| {
            bench.keys(Modifiers::COMMAND, Key::W);
            bench.rest();
        }),
        ("quit", |bench| {
            eframe::App::on_exit(bench.window.state_mut());
        }),
    ];
    for (way, leave) in ways {
        let folder = folder(way, Begun::Fresh);
        let mut bench = Bench::open(&folder.at("p.tiepoint"));
        let network = bench.network();
        let (id, image) = network.images.iter().nth(2).expect("an image");
        bench.click(&image.file.path);
        let exclude = bench.window.get_by_label("Exclude").rect().center();
        bench.hover(exclude);
        bench.window.key_down(Key::F5);
        bench.press_and_release(exclude);
        bench.window.step();
        let waiting = bench.app().runner().pending().len();
        assert_eq!(waiting, 1, "the step was too short");
        leave(&mut bench);
        assert!(bench.app().session().is_none());
        let session = Session::open(&folder.at("p.tiepoint")).expect("a closed project");
        let usage = session.network().images[id].usage;
        assert_eq!(usage, ImageUse::Excluded, "{way}");
    }
}

#[test]
fn what_is_half_typed_does_not_come_along_to_another_project() {
    const FIELD: &str = "Fewest rays of a target";
    let [one, other] = ["one", "other"].map(|name| folder(name, Begun::Fresh));
    let other = other.at("p.tiepoint");
    let mut bench = Bench::open(&one.at("p.tiepoint"));
    bench.window.get_by_label("Settings").click_accesskit();
    bench.settle();
    let rays = |bench: &Bench| bench.window.get_by_label(FIELD).value();
    let before = rays(&bench);
    let field = bench.window.get_by_label(FIELD);
    field.set_value_accesskit(f64::from(bench.network().settings.min_rays + 1));
    bench.settle();
    assert_ne!(rays(&bench), before, "it is typed and not applied");
    bench.keys(Modifiers::COMMAND, Key::O);
    bench.write(&other.display().to_string());
    bench.key(Key::Enter);
    bench.rest();
    let told = format!("{} is open.", other.display());
    assert_eq!(bench.app().message(), told);
    assert_eq!(rays(&bench), before);
}
