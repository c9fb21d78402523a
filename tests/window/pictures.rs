//! Pictures of panels, compared with those under `tests/snapshots`; `UPDATE_SNAPSHOTS=1` writes them anew.

use egui::{Key, Modifiers, Rect};
use egui_kittest::kittest::Queryable as _;
use egui_kittest::{SnapshotOptions, image_snapshot_options};

use crate::bench::{Begun, Bench, first_image, folder, targets_of};

/// The software renderer gives the same picture in every run; its next version may round the edge of a letter or of a
/// line otherwise. So many pixels of a thousand may differ; a mark or a label that is gone is more.
const OTHER_PIXELS_PER_MILLE: usize = 3;

/// Compares a part of the window.
fn compare(bench: &mut Bench, part: Rect, name: &str) {
    bench.window.remove_cursor();
    bench.rest();
    bench.settle();
    let window = bench.window.render().expect("the software renderer");
    let (left, top) = (part.left().ceil() as u32, part.top().ceil() as u32);
    let (width, height) = (part.width().floor() as u32, part.height().floor() as u32);
    let picture = image::imageops::crop_imm(&window, left, top, width, height).to_image();
    let pixels = (width * height) as usize;
    let options = SnapshotOptions::new().max_failed_pixels(pixels * OTHER_PIXELS_PER_MILLE / 1000);
    image_snapshot_options(&picture, name, &options);
}

#[test]
fn an_image_panel_with_its_overlays() {
    let folder = folder("picture", Begun::Measured);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let image = first_image(&bench);
    bench.until("the picture", |app| {
        let network = app.network();
        let state = app.pictures().get(image, &network.images[&image]);
        matches!(state, tiepoint::ui::pictures::PictureState::Ready(_))
    });
    let seen = targets_of(&bench.network(), image)[0];
    let at = bench.zoom_to(image, seen.place_px);
    bench.click_at(at);
    let panel = bench.window.get_all_by_label("image view");
    let panel = panel.map(|node| node.rect()).find(|rect| rect.contains(at));
    let panel = panel.expect("the panel that was clicked");
    // Whole points, so that the part does not lose a row where the target moves by a thousandth.
    let round = Rect::from_center_size(at.round(), egui::vec2(260.0, 300.0));
    compare(&mut bench, panel.intersect(round), "image_panel");
}

#[test]
fn the_network_in_3d() {
    let folder = folder("network", Begun::Measured);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let panel = bench.window.get_by_label("3D view").rect();
    compare(&mut bench, panel, "network_3d");
}

#[test]
fn the_stage_panel() {
    let folder = folder("stages", Begun::Paired);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    bench.keys(Modifiers::NONE, Key::F5);
    bench.rest();
    let first = bench.window.get_by_label("Detect targets").rect();
    let last = bench.window.get_by_label("Settings").rect();
    let state = bench.window.get_by_label("10/10 done").rect();
    let panel = Rect::from_min_max(
        egui::pos2(0.0, first.top() - 6.0),
        egui::pos2(state.right() + 4.0, last.bottom() + 6.0),
    );
    compare(&mut bench, panel, "stage_panel");
}
