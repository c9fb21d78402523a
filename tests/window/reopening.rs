//! A window that is gone in the middle of a stage: what was finished is there when the project is opened again.

use std::sync::Arc;

use egui::{Key, Modifiers};
use tiepoint::network::Network;
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
