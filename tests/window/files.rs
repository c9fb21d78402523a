//! Pictures that were moved, and a project made of a folder that was dropped on the window.

use std::fs;

use egui::accesskit::Role;
use egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable as _;
use tiepoint::network::ImageEntry;
use tiepoint::ui::pictures::PictureState;
use tiepoint::ui::window::Beginning;

use crate::bench::{Begun, Bench, assert_undisturbed, first_image, folder};
use crate::common::{Folder, IMAGES};

#[test]
fn moved_pictures_are_a_state_and_are_found_again() {
    let folder = folder("moved", Begun::Fresh);
    fs::rename(folder.at("images"), folder.at("elsewhere")).expect("the folder's own images");
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    assert_eq!(bench.app().missing_pictures().len(), IMAGES);
    assert!(bench.says(&format!("{IMAGES} pictures are not at their place")));
    // Nothing can be measured yet, and that is told image by image.
    bench.keys(Modifiers::COMMAND, Key::F5);
    bench.rest();
    let network = bench.network();
    let unreadable = |image: &&std::sync::Arc<ImageEntry>| image.unreadable.is_some();
    assert_eq!(network.images.values().filter(unreadable).count(), IMAGES);
    // Of those rows that are in sight.
    assert!(bench.count("unreadable") > IMAGES / 2);

    bench.click("Find folder ...");
    bench.write(&folder.at("elsewhere").display().to_string());
    bench.key(Key::Enter);
    bench.rest();
    assert_eq!(
        bench.app().missing_pictures(),
        [],
        "{}",
        bench.app().message()
    );
    assert!(!bench.says("not at their place"));
    let image = first_image(&bench);
    bench.until("the picture", |app| {
        let entry = &app.network().images[&image];
        matches!(app.pictures().get(image, entry), PictureState::Ready(_))
    });
    bench.keys(Modifiers::COMMAND, Key::F5);
    bench.rest();
    assert_undisturbed(&bench.network());
}

#[test]
fn a_folder_that_is_dropped_becomes_a_project() {
    let folder = Folder::with_scene("dropped");
    let mut bench = Bench::begin(Beginning::Empty);
    bench.drop_on_window(&folder.at("."));
    bench.rest();
    assert!(bench.has("New project"));
    let field = bench
        .window
        .get_by_role_and_label(Role::TextInput, "Project file");
    assert!(field.is_focused(), "what is typed is its path");
    bench.click("Make the project");
    bench.rest();
    let network = bench.network();
    assert_eq!(network.images.len(), IMAGES, "{}", bench.app().message());
    assert!(!network.device.is_empty() && !network.scale_bars.is_empty());
    assert_eq!(bench.app().image_views().count(), 2);
}
