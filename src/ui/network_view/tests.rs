//! The panel as the operator meets it: by label, by pointer, by looking at the picture.

use std::collections::BTreeMap;
use std::sync::Arc;

use egui::Modifiers;
use egui::PointerButton;
use egui::Pos2;
use egui::Vec2;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use egui_kittest::wgpu::WgpuTestRenderer;
use egui_kittest::wgpu::create_render_state;
use egui_kittest::wgpu::default_wgpu_setup;
use nalgebra::Matrix3;
use nalgebra::Vector3;

use super::Colouring;
use super::Exaggeration;
use super::NetworkView;
use super::Target;
use crate::camera::Camera;
use crate::camera::InteriorOrientation;
use crate::geometry::Pose;
use crate::network::BarRole;
use crate::network::CameraEntry;
use crate::network::CameraId;
use crate::network::DevicePoint;
use crate::network::ImageEntry;
use crate::network::ImageFile;
use crate::network::ImageId;
use crate::network::InteriorSource;
use crate::network::Label;
use crate::network::Network;
use crate::network::Point;
use crate::network::PointId;
use crate::network::ScaleBar;
use crate::network::Source;
use crate::network::Station;
use crate::targets::DotIndex;
use crate::targets::Family;
use crate::ui::action::Action;
use crate::ui::action::Selection;

/// Stations on two rings round a box of 600 x 400 x 300 mm with points on its sides, whose sigmas grow with height;
/// every station shows every fifth point.
pub(super) fn ring_network(stations: u32, points: u32) -> Network {
    let mut network = Network::default();
    let camera = Camera {
        width_px: 3000,
        height_px: 2000,
        pixel_pitch_mm: 0.008,
        interior: InteriorOrientation::pinhole(24.0),
    };
    let entry = CameraEntry {
        name: "camera".into(),
        nominal: camera.clone(),
        camera,
        known_sigmas: [None; 10],
        parameters: Default::default(),
        stated: Default::default(),
        source: InteriorSource::CameraFile,
        exif_model: None,
    };
    network.cameras = Arc::new(BTreeMap::from([(CameraId(0), Arc::new(entry))]));
    let device = [
        (0.0, 0.0, 40.0),
        (100.0, 0.0, 0.0),
        (-100.0, 0.0, 0.0),
        (0.0, 100.0, 0.0),
    ];
    network.device = Arc::new(
        device
            .iter()
            .enumerate()
            .map(|(i, (x, y, z))| DevicePoint {
                label: format!("X{}", i + 1),
                position_mm: [*x, *y, *z],
            })
            .collect(),
    );
    let mut table: BTreeMap<PointId, Arc<Point>> = BTreeMap::new();
    for (place, dot) in device.iter().enumerate() {
        let position = Vector3::new(dot.0, dot.1, dot.2 + 300.0);
        table.insert(
            PointId::Device(place as u16),
            Arc::new(Point {
                position,
                covariance: None,
                rays: 4,
                circle: None,
            }),
        );
    }
    for number in 0..points {
        let point = box_point(number, points);
        let id = if number % 7 == 0 {
            PointId::of_code(Family::Dot420, 1 + (number / 42) % 420)[(number / 7 % 6) as usize]
        } else {
            PointId::Target(number)
        };
        table.insert(id, Arc::new(point));
    }
    let ids: Vec<PointId> = table.keys().copied().collect();
    network.points = Arc::new(table);
    network.images = Arc::new(
        (0..stations)
            .map(|number| {
                (
                    ImageId(number),
                    Arc::new(ring_image(number, stations, &ids)),
                )
            })
            .collect(),
    );
    network.connection_order = Arc::new((0..stations).map(ImageId).collect());
    network.scale_bars = Arc::new(vec![ScaleBar {
        name: "bar 1".into(),
        from: "M1".into(),
        to: "M20".into(),
        length_mm: 500.012,
        sigma_mm: 0.01,
        role: BarRole::Control,
        expansion: None,
    }]);
    network
}

fn box_point(number: u32, points: u32) -> Point {
    let part = f64::from(number) / f64::from(points);
    let along = (f64::from(number) * 0.618_034).fract() * 4.0;
    let (side, along) = (along.floor(), along.fract() - 0.5);
    let (x, y) = match side as u32 {
        0 => (600.0 * along, -200.0),
        1 => (300.0, 400.0 * along),
        2 => (600.0 * along, 200.0),
        _ => (-300.0, 400.0 * along),
    };
    let sigma = 0.01 + 0.03 * part;
    let covariance = Matrix3::new(1.0, 0.3, 0.0, 0.3, 1.5, 0.2, 0.0, 0.2, 3.0) * (sigma * sigma);
    Point {
        position: Vector3::new(x, y, 300.0 * part),
        covariance: Some(covariance),
        rays: 4 + number % 9,
        circle: None,
    }
}

fn ring_image(number: u32, stations: u32, ids: &[PointId]) -> ImageEntry {
    let angle = std::f64::consts::TAU * f64::from(number) / f64::from(stations);
    let height = if number.is_multiple_of(2) {
        250.0
    } else {
        900.0
    };
    let centre = Vector3::new(1500.0 * angle.cos(), 1500.0 * angle.sin(), height);
    let roll = if number.is_multiple_of(4) {
        std::f64::consts::FRAC_PI_2
    } else {
        0.0
    };
    let file = ImageFile {
        path: format!("images/img_{number:03}.jpg"),
        size_bytes: 1,
        sha256: String::new(),
        width_px: 3000,
        height_px: 2000,
    };
    let mut image = ImageEntry::new(file, CameraId(0));
    let pose = Pose::looking_at(centre, Vector3::new(0.0, 0.0, 150.0), Vector3::z(), roll);
    image.station = Some(Station {
        pose,
        covariance: None,
        with_camera: None,
    });
    image.labels = Arc::new(
        ids.iter()
            .enumerate()
            .filter(|(place, _)| (*place as u32 + number).is_multiple_of(5))
            .map(|(place, id)| {
                let rejected = (place as u32 + number)
                    .is_multiple_of(35)
                    .then(|| "w = 9.1".to_owned());
                (
                    DotIndex(place as u32),
                    Label {
                        point: *id,
                        source: Source::Automatic,
                        rejected,
                    },
                )
            })
            .collect(),
    );
    image
}

/// Seconds of a frame: two clicks in a row are a double click.
const FRAME_S: f32 = 1.0 / 60.0;

#[derive(Default)]
pub(super) struct Bench {
    pub(super) view: NetworkView,
    network: Network,
    pub(super) selection: Selection,
    group: Arc<std::collections::BTreeSet<PointId>>,
    actions: Vec<Action>,
}

impl Bench {
    pub(super) fn of(network: Network) -> Self {
        Self {
            network,
            ..Default::default()
        }
    }

    pub(super) fn draw(ui: &mut egui::Ui, bench: &mut Self) {
        bench.view.show(
            ui,
            &bench.network,
            &bench.selection,
            &bench.group,
            &mut bench.actions,
        );
    }
}

pub(super) fn harness(network: Network) -> Harness<'static, Bench> {
    let mut harness = Harness::builder()
        .with_size(Vec2::new(900.0, 600.0))
        .with_step_dt(FRAME_S)
        .build_ui_state(Bench::draw, Bench::of(network));
    harness.step();
    harness.step();
    harness
}

/// Presses and releases at a place, as often as told.
fn click(harness: &mut Harness<'_, Bench>, place: Pos2, times: usize) {
    harness.hover_at(place);
    // Long enough after any click before.
    harness.run_steps(30);
    for _ in 0..times {
        for pressed in [true, false] {
            harness.event(egui::Event::PointerButton {
                pos: place,
                button: PointerButton::Primary,
                pressed,
                modifiers: Modifiers::NONE,
            });
        }
    }
    harness.step();
    harness.step();
}

#[test]
fn an_empty_network_says_what_comes_first() {
    let mut harness = harness(Network::default());
    harness.get_by_label("no oriented images yet: run the first pair");
    harness.get_by_label("3D view");
    harness.get_by_label("Run the first pair").click();
    harness.step();
    harness.step();
    assert!(matches!(harness.state().actions[..], [Action::Run(_)]));
}

#[test]
fn a_click_selects_the_point_that_is_seen_there() {
    let network = ring_network(12, 120);
    let mut harness = harness(network.clone());
    harness.get_by_label("12 stations, 124 points");
    let mut selected = 0;
    for id in [PointId::Target(3), PointId::Target(60), PointId::Device(1)] {
        let place = harness
            .state()
            .view
            .place_on_screen(Target::Point(id))
            .unwrap();
        click(&mut harness, place, 1);
        let Some(Action::Select(selection)) = harness.state_mut().actions.pop() else {
            panic!("no selection")
        };
        // Another point may stand before it; then it is that one that must be at the pointer.
        let found = harness
            .state()
            .view
            .place_on_screen(Target::Point(selection.point.unwrap()))
            .unwrap();
        assert!(found.distance(place) <= 1.5);
        selected += usize::from(selection.point == Some(id));
    }
    assert!(selected >= 2);
    let station = harness
        .state()
        .view
        .place_on_screen(Target::Station(ImageId(3)))
        .unwrap();
    click(&mut harness, station, 1);
    let Some(Action::Select(selection)) = harness.state_mut().actions.pop() else {
        panic!("no selection")
    };
    assert_eq!(selection.image, Some(ImageId(3)));
}

#[test]
fn a_double_click_looks_at_it() {
    let mut harness = harness(ring_network(12, 120));
    let place = harness
        .state()
        .view
        .place_on_screen(Target::Station(ImageId(3)))
        .unwrap();
    click(&mut harness, place, 2);
    let wanted = Selection {
        image: Some(ImageId(3)),
        ..Default::default()
    };
    assert_eq!(
        harness.state().actions.last(),
        Some(&Action::LookAt(wanted.clone()))
    );
    harness.state_mut().view.look_at(&wanted);
    harness.step();
    let centre = harness.get_by_label("3D view").rect().center();
    let place = harness
        .state()
        .view
        .place_on_screen(Target::Station(ImageId(3)))
        .unwrap();
    assert!(place.distance(centre) < 0.5);
}

#[test]
fn the_scene_is_made_again_only_for_another_network() {
    let mut harness = harness(ring_network(12, 120));
    let made = harness.state().view.scenes_made();
    harness.hover_at(Pos2::new(400.0, 300.0));
    harness.run_steps(3);
    harness.state_mut().selection.point = Some(PointId::Target(3));
    // A finding or another conclusion shows nothing here.
    harness.state_mut().network.inputs += 1;
    harness.run_steps(2);
    assert_eq!(harness.state().view.scenes_made(), made);
    Arc::make_mut(&mut harness.state_mut().network.points).remove(&PointId::Target(3));
    harness.step();
    assert_eq!(harness.state().view.scenes_made(), made + 1);
    harness.state_mut().view.options_mut().colouring = Colouring::Precision;
    harness.step();
    assert_eq!(harness.state().view.scenes_made(), made + 2);
}

#[test]
fn the_viewpoint_stays_when_the_network_grows() {
    let full = ring_network(12, 120);
    let mut small = full.clone();
    Arc::make_mut(&mut small.images).retain(|id, _| id.0 < 2);
    let mut harness = harness(small);
    let canvas = harness.get_by_label("3D view").rect();
    harness.drag_at(canvas.center());
    harness.hover_at(canvas.center() + Vec2::new(60.0, 20.0));
    harness.step();
    harness.drop_at(canvas.center() + Vec2::new(60.0, 20.0));
    harness.run_steps(2);
    let camera = *harness.state().view.camera();
    harness.state_mut().network = full;
    harness.run_steps(4);
    assert_eq!(*harness.state().view.camera(), camera);
    harness.get_by_label("12 stations (+10), 124 points");
    harness.get_by_label("Fit").click();
    harness.run_steps(2);
    assert_eq!(stations_in_sight(&harness), 12);
}

#[test]
fn until_the_operator_turns_it_the_view_follows_the_growing_network() {
    let full = ring_network(12, 120);
    let mut small = full.clone();
    Arc::make_mut(&mut small.images).retain(|id, _| id.0 < 2);
    let mut harness = harness(small);
    harness.state_mut().network = full;
    harness.run_steps(4);
    assert_eq!(stations_in_sight(&harness), 12);
}

fn stations_in_sight(harness: &Harness<'static, Bench>) -> usize {
    let view = &harness.state().view;
    let in_sight = |number: &u32| {
        view.place_on_screen(Target::Station(ImageId(*number)))
            .is_some()
    };
    (0..12).filter(in_sight).count()
}

#[test]
fn the_wheel_keeps_the_point_under_the_pointer() {
    let mut harness = harness(ring_network(12, 120));
    let id = Target::Point(PointId::Device(0));
    let before = harness.state().view.place_on_screen(id).unwrap();
    let distance = harness.state().view.camera().distance;
    harness.hover_at(before);
    harness.step();
    harness.event(egui::Event::MouseWheel {
        unit: egui::MouseWheelUnit::Point,
        delta: Vec2::new(0.0, 120.0),
        source: egui::MouseWheelSource::Wheel,
        phase: egui::TouchPhase::Move,
        modifiers: Modifiers::NONE,
    });
    harness.run_steps(60);
    assert!(harness.state().view.camera().distance < 0.8 * distance);
    assert!(
        harness
            .state()
            .view
            .place_on_screen(id)
            .unwrap()
            .distance(before)
            < 0.5
    );
}

#[test]
fn dragging_orbits_and_with_shift_it_shifts() {
    let mut harness = harness(ring_network(12, 120));
    let drag = |harness: &mut Harness<'_, Bench>, from: Pos2, by: Vec2| {
        harness.drag_at(from);
        harness.step();
        harness.hover_at(from + by);
        harness.step();
        harness.drop_at(from + by);
        harness.step();
    };
    let before = *harness.state().view.camera();
    drag(&mut harness, Pos2::new(450.0, 80.0), Vec2::new(50.0, 20.0));
    let orbited = *harness.state().view.camera();
    assert_eq!(orbited.target, before.target);
    assert!(
        orbited
            .world_from_view
            .angle_between(before.world_from_view)
            > 0.2
    );
    harness.event(egui::Event::ModifiersChanged(Modifiers::SHIFT));
    drag(&mut harness, Pos2::new(450.0, 80.0), Vec2::new(50.0, 20.0));
    let panned = *harness.state().view.camera();
    assert_eq!(panned.world_from_view, orbited.world_from_view);
    assert!(panned.target.distance(orbited.target) > 10.0);
    assert!(harness.state().actions.is_empty(), "dragging is no click");
}

#[test]
fn keys_turn_and_zoom_while_the_pointer_is_over_the_view() {
    let mut harness = harness(ring_network(12, 120));
    let camera = |harness: &Harness<'_, Bench>| *harness.state().view.camera();
    let before = camera(&harness);
    harness.key_press(egui::Key::ArrowRight);
    harness.step();
    assert_eq!(camera(&harness), before, "the pointer is elsewhere");
    harness.hover_at(Pos2::new(450.0, 300.0));
    harness.run_steps(3);
    assert_eq!(camera(&harness), before, "no key is pressed");
    harness.key_press(egui::Key::ArrowRight);
    harness.step();
    let turned = camera(&harness);
    assert_eq!(turned.target, before.target);
    let turn = turned.world_from_view;
    assert!(turn.angle_between(before.world_from_view) > 0.05);
    harness.key_press(egui::Key::Plus);
    harness.step();
    let near = camera(&harness);
    assert_eq!(near.target, before.target);
    assert!(near.distance < 0.9 * before.distance);
}

#[test]
fn only_the_primary_button_draws_a_box() {
    let mut harness = harness(ring_network(12, 120));
    harness.get_by_label("Box select").click();
    harness.run_steps(2);
    let (from, to) = (Pos2::new(300.0, 200.0), Pos2::new(600.0, 450.0));
    let drag = |harness: &mut Harness<'_, Bench>, button: PointerButton| {
        let event = |pos: Pos2, pressed: bool| egui::Event::PointerButton {
            pos,
            button,
            pressed,
            modifiers: Modifiers::NONE,
        };
        harness.hover_at(from);
        harness.event(event(from, true));
        harness.hover_at(to);
        harness.event(event(to, false));
        harness.step();
    };
    let boxes = |harness: &Harness<'_, Bench>| {
        let actions = harness.state().actions.iter();
        actions.filter(|a| matches!(a, Action::Group(_))).count()
    };
    drag(&mut harness, PointerButton::Primary);
    assert_eq!(boxes(&harness), 1);
    for button in [PointerButton::Secondary, PointerButton::Middle] {
        drag(&mut harness, button);
        assert_eq!(boxes(&harness), 1, "{button:?} lets the box go");
    }
}

#[test]
fn the_exaggeration_is_shown() {
    let mut harness = harness(ring_network(12, 120));
    harness.state_mut().view.options_mut().exaggeration = Exaggeration::Fixed(500.0);
    harness.step();
    harness.step();
    harness.get_by_label("ellipsoids: 1 sigma x 500");
    harness.get_by_label("coded target");
}

/// Renders without any screen.
pub(super) fn rendered(theme: egui::Theme, bench: Bench) -> image::RgbaImage {
    let state = create_render_state(
        default_wgpu_setup(),
        eframe::egui_wgpu::RendererOptions::PREDICTABLE,
    );
    NetworkView::install(&state);
    let mut harness = Harness::builder()
        .with_size(Vec2::new(900.0, 600.0))
        .with_theme(theme)
        .renderer(WgpuTestRenderer::from_render_state(state))
        .build_ui_state(Bench::draw, bench);
    harness.run_steps(3);
    harness.render().expect("a picture")
}

#[test]
fn a_picture_shows_points_stations_and_rays() {
    let mut bench = Bench::of(ring_network(12, 120));
    bench.selection.point = Some(PointId::Target(60));
    bench.selection.image = Some(ImageId(3));
    let picture = rendered(egui::Theme::Dark, bench);
    let count = |colour: egui::Color32| {
        let [r, g, b, _] = colour.to_array();
        let near = |a: u8, b: u8| a.abs_diff(b) <= 12;
        picture
            .pixels()
            .filter(|p| near(p[0], r) && near(p[1], g) && near(p[2], b))
            .count()
    };
    // Discs and ellipsoids of 120 points; ring, rays and frustum of the selection.
    assert!(count(crate::ui::theme::USED) > 500);
    assert!(count(crate::ui::theme::CODE) > 100);
    assert!(count(crate::ui::theme::SELECTED) > 200);
}
