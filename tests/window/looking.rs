//! One selection in all views: a table, the pictures, the 3D view.

use egui::Key;
use egui::Modifiers;
use egui_kittest::kittest::Queryable as _;
use nalgebra::Vector2;
use tiepoint::network::{ImageId, Network, PointId};
use tiepoint::ui::network_view::Target;

use crate::bench::{Begun, Bench, Seen, first_image, folder, targets_of};

/// Where an image shows a point.
fn place_of(network: &Network, image: ImageId, point: PointId) -> Option<Vector2<f64>> {
    let entry = &network.images[&image];
    let mut labels = entry.labels.iter();
    let (dot, _) = labels.find(|(_, label)| label.point == point)?;
    Some(entry.detections.as_ref()?.dots[dot.slot()].centre_px)
}

/// The target with the highest number in the first image: the tables list it far below.
fn last_target(bench: &Bench) -> Seen {
    let targets = targets_of(&bench.network(), first_image(bench));
    *targets.last().expect("a plain target in the first image")
}

/// Asserts that all image panels have the point in their middle, and the 3D view too.
#[track_caller]
fn assert_in_all_views(bench: &Bench, point: PointId) {
    let network = bench.network();
    let panels: Vec<egui::Rect> = bench
        .window
        .query_all_by_label("image view")
        .map(|panel| panel.rect())
        .collect();
    let views: Vec<ImageId> = bench.app().image_views().map(|view| view.image).collect();
    assert_eq!((panels.len(), views.len()), (2, 2));
    for image in views {
        let place = place_of(&network, image, point);
        let place = place.unwrap_or_else(|| panic!("image {} does not show it", image.0));
        let at = bench.place(image, place);
        // Half a screen point for the rounding of panels to whole points.
        let middle = panels.iter().any(|panel| panel.center().distance(at) < 1.0);
        assert!(middle, "image {}: {at} of {panels:?}", image.0);
    }
    let middle = bench.window.get_by_label("3D view").rect().center();
    let place = bench
        .app()
        .network_view()
        .place_on_screen(Target::Point(point));
    assert!(place.is_some_and(|place| place.distance(middle) < 1.0));
}

#[test]
fn a_row_of_a_table_leads_to_its_point_in_the_pictures_and_in_3d() {
    let folder = folder("table", Begun::Measured);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let point = last_target(&bench).point;
    let label = bench.network().label(point);
    bench.keys(Modifiers::ALT, Key::Num3);
    bench.click("Filter rows");
    bench.write(&label);
    bench.click(&label);
    assert_eq!(bench.app().selection().point, Some(point));
    assert!(bench.has("plain target"), "the inspector shows it");
    bench.key(Key::G);
    bench.settle();
    assert_in_all_views(&bench, point);
}

#[test]
fn a_click_in_3d_selects_for_the_inspector_and_the_pictures() {
    let folder = folder("3d", Begun::Measured);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let seen = last_target(&bench);
    let place = |bench: &Bench, point| {
        let view = bench.app().network_view();
        view.place_on_screen(Target::Point(point))
    };
    let at = place(&bench, seen.point).expect("all of the network is in sight");
    bench.click_at(at);
    let point = bench.app().selection().point.expect("a point is selected");
    // Another one may stand before it.
    let found = place(&bench, point).expect("it is where the click was");
    assert!(found.distance(at) < 2.0);
    assert!(bench.has(&bench.network().label(point)));
    assert!(bench.says("images: "), "the inspector lists its images");
    bench.key(Key::G);
    bench.settle();
    assert_in_all_views(&bench, point);

    // A station is selected as its image.
    let station = Target::Station(seen.image);
    bench.keys(Modifiers::COMMAND, Key::K);
    bench.write("fit the 3d");
    bench.key(Key::Enter);
    bench.settle();
    let at = bench.app().network_view().place_on_screen(station);
    bench.click_at(at.expect("the station is in sight"));
    assert_eq!(bench.app().selection().image, Some(seen.image));
}

#[test]
fn a_click_in_a_picture_selects_the_row_of_the_table() {
    let folder = folder("row", Begun::Measured);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let seen = last_target(&bench);
    let label = bench.network().label(seen.point);
    bench.keys(Modifiers::ALT, Key::Num3);
    bench.settle();
    let top = bench.window.get_by_label("Copy as text").rect().bottom();
    let in_table = |bench: &Bench| {
        let mut found = bench.window.query_all_by_label(&label);
        found.any(|node| node.rect().top() > top)
    };
    assert!(!in_table(&bench), "its row is far below");
    let at = bench.zoom_to(seen.image, seen.place_px);
    bench.click_at(at);
    assert_eq!(bench.app().selection().point, Some(seen.point));
    assert_eq!(bench.app().selection().dot, Some((seen.image, seen.dot)));
    bench.settle();
    assert!(in_table(&bench), "the table goes to its row");
}

#[test]
fn an_image_of_the_list_is_shown_and_pages_are_turned() {
    let folder = folder("list", Begun::Fresh);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let network = bench.network();
    let ids: Vec<ImageId> = network.images.keys().copied().collect();
    let path = &network.images[&ids[5]].file.path;
    bench.click(path);
    assert_eq!(bench.app().selection().image, Some(ids[5]));
    assert_eq!(first_image(&bench), ids[5]);
    bench.key(Key::N);
    assert_eq!(first_image(&bench), ids[6]);
    bench.key(Key::P);
    assert_eq!(first_image(&bench), ids[5]);
    bench.keys(Modifiers::COMMAND, Key::Num4);
    assert_eq!(bench.app().image_views().count(), 4);
    bench.keys(Modifiers::COMMAND, Key::Num1);
    assert_eq!(bench.app().image_views().count(), 1);
}
