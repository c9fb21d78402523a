//! A rendered scene with its detections, labelled by its truth, looked at through a view.

mod looks;

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use egui::{Key, Modifiers, Pos2, vec2};
use egui_kittest::{Harness, kittest::Queryable};
use nalgebra::{Vector2, Vector3};

use super::*;
use crate::imaging::BitDepth;
use crate::network::{
    CameraEntry, CameraId, ImageFile, InteriorSource, Label, Network, Point, PointId, Source,
    Station,
};
use crate::project::edit::Edit;
use crate::synthetic::{BoxSettings, Experiment, RenderSettings, box_experiment, render};
use crate::targets::{DetectSettings, Detections, DotIndex, Family, detect};
use crate::ui::action::RunRequest;
use crate::ui::pictures::{PictureSettings, PictureStore};

const FIRST: ImageId = ImageId(1);

struct Scene {
    network: Network,
    pictures: BTreeMap<ImageId, Arc<GreyImage>>,
}

fn experiment() -> Experiment {
    let settings = BoxSettings {
        seed: 5,
        plain_targets: 60,
        codes: 12,
        width_px: 1024,
        height_px: 683,
        pixel_pitch_mm: 0.027,
        dot_mm: 8.0,
        pitch_mm: 8.0,
        ..BoxSettings::default()
    };
    box_experiment(&settings).expect("a scene")
}

/// Three pictures of a small box; every dot that the truth knows is labelled.
fn scene() -> &'static Scene {
    static SCENE: OnceLock<Scene> = OnceLock::new();
    SCENE.get_or_init(|| {
        let experiment = experiment();
        let truth = experiment.truth();
        let camera = CameraEntry {
            name: "rendered".into(),
            nominal: experiment.camera.clone(),
            camera: experiment.camera.clone(),
            known_sigmas: [None; 10],
            parameters: Default::default(),
            stated: Default::default(),
            source: InteriorSource::CameraFile,
            exif_model: None,
        };
        let mut network = Network {
            cameras: Arc::new(BTreeMap::from([(CameraId(1), Arc::new(camera))])),
            ..Network::default()
        };
        let mut pictures = BTreeMap::new();
        let mut images = BTreeMap::new();
        for (number, station) in (1..).zip(experiment.stations.iter().take(3)) {
            let look = RenderSettings::default();
            let drawn = render(
                &experiment.scene,
                &experiment.camera,
                &station.pose,
                &look,
                number,
            );
            let samples = drawn.image.iter().map(|&grey| u16::from(grey)).collect();
            let picture = GreyImage::new(drawn.width_px, drawn.height_px, BitDepth::Eight, samples);
            let picture = picture.expect("as many samples as pixels");
            let found = detect(&picture, &[Family::Dot420], &DetectSettings::default());
            let file = ImageFile {
                path: format!("pictures/img_{number:03}.png"),
                size_bytes: 0,
                sha256: String::new(),
                width_px: drawn.width_px,
                height_px: drawn.height_px,
            };
            let mut entry = ImageEntry::new(file, CameraId(1));
            entry.labels = Arc::new(labels(&found, &truth.images[&station.image]));
            entry.detections = Some(Arc::new(found));
            entry.station = Some(Station {
                pose: station.pose,
                covariance: None,
                with_camera: None,
            });
            let id = ImageId(number as u32);
            images.insert(id, Arc::new(entry));
            pictures.insert(id, Arc::new(picture));
        }
        network.images = Arc::new(images);
        let points = truth.points.iter().filter_map(|(label, place)| {
            let point = Point {
                position: Vector3::from(*place),
                covariance: None,
                rays: 3,
                circle: None,
            };
            Some((point_of(label)?, Arc::new(point)))
        });
        network.points = Arc::new(points.collect());
        Scene { network, pictures }
    })
}

/// The scene calls its plain targets T1, T2, ..
fn point_of(label: &str) -> Option<PointId> {
    match label.strip_prefix('T') {
        Some(number) => number.parse().ok().map(PointId::Target),
        None => label.parse().ok(),
    }
}

fn labels(found: &Detections, truth: &[crate::synthetic::TruthDot]) -> BTreeMap<DotIndex, Label> {
    let mut labels = BTreeMap::new();
    for (slot, dot) in (0..).zip(&found.dots) {
        let same = truth.iter().find(|t| {
            t.is_seen()
                && t.centre_of_image_px
                    .is_some_and(|place| (place - dot.centre_px).norm() < 0.5)
        });
        if let Some(point) = same.and_then(|t| point_of(&t.label)) {
            labels.insert(
                DotIndex(slot),
                Label {
                    point,
                    source: Source::Automatic,
                    rejected: None,
                },
            );
        }
    }
    labels
}

fn a_plain_dot(network: &Network) -> (DotIndex, PointId, Vector2<f64>) {
    let entry = &network.images[&FIRST];
    let detections = entry.detections.as_ref().expect("detections");
    let (dot, label) = entry
        .labels
        .iter()
        .find(|(_, label)| matches!(label.point, PointId::Target(_)))
        .expect("a plain target in the first picture");
    (*dot, label.point, detections.dots[dot.slot()].centre_px)
}

/// The network with one plain target of the first image taken away.
fn with_a_missed_target() -> (Network, PointId, Vector2<f64>) {
    let mut network = scene().network.clone();
    let (dot, point, place) = a_plain_dot(&network);
    let entry = network.image_mut(FIRST);
    let mut detections = entry.detections.as_deref().expect("detections").clone();
    detections.dots.remove(dot.slot());
    detections.codes.clear();
    let labels = entry
        .labels
        .iter()
        .filter(|(index, _)| **index != dot)
        .map(|(index, label)| {
            let moved = if *index > dot {
                DotIndex(index.0 - 1)
            } else {
                *index
            };
            (moved, label.clone())
        });
    entry.labels = Arc::new(labels.collect());
    entry.detections = Some(Arc::new(detections));
    (network, point, place)
}

struct Stage {
    network: Network,
    pictures: PictureStore,
    selection: Selection,
    view: ImageView,
    actions: Vec<Action>,
}

fn stage(network: Network) -> Stage {
    let mut pictures = PictureStore::new(PictureSettings::default(), || {}).expect("a thread");
    for (id, picture) in &scene().pictures {
        pictures.insert(*id, &network.images[id], Arc::clone(picture));
    }
    let view = ImageView::new(FIRST);
    Stage {
        network,
        pictures,
        selection: Selection::default(),
        view,
        actions: Vec::new(),
    }
}

fn show(ui: &mut egui::Ui, stage: &mut Stage) {
    let Stage {
        network,
        pictures,
        selection,
        view,
        actions,
    } = stage;
    let group = std::sync::Arc::default();
    let context = ViewContext {
        group: &group,
        network,
        pictures,
        selection,
        pending: &[],
    };
    view.ui(ui, &context, actions);
}

fn harness(network: Network) -> Harness<'static, Stage> {
    let mut harness = Harness::builder()
        .with_size(vec2(1100.0, 800.0))
        .build_ui_state(show, stage(network));
    harness.run_ok();
    harness
}

/// Where a place of the picture stands on the screen.
fn on_screen(harness: &Harness<'_, Stage>, place: Vector2<f64>) -> Pos2 {
    let rect = harness.get_by_label("image view").rect();
    Sight::Fit.transform(rect, [1024, 683]).point(place)
}

fn click(harness: &mut Harness<'_, Stage>, at: Pos2) {
    harness.hover_at(at);
    harness.step();
    harness.drag_at(at);
    harness.step();
    harness.drop_at(at);
    harness.step();
}

fn edits(harness: &Harness<'_, Stage>) -> Vec<Edit> {
    let edit = |action: &Action| match action {
        Action::Edit(edit) => Some(edit.clone()),
        _ => None,
    };
    harness.state().actions.iter().filter_map(edit).collect()
}

#[test]
fn a_click_on_a_dot_selects_it_with_its_point() {
    let (dot, point, place) = a_plain_dot(&scene().network);
    let mut harness = harness(scene().network.clone());
    let at = on_screen(&harness, place);
    harness.hover_at(at);
    harness.step();
    let status = harness
        .state()
        .view
        .status()
        .expect("the pointer is over the picture");
    assert!(
        status.contains("img_001.png") && status.contains("grey"),
        "{status}"
    );
    click(&mut harness, at);
    let expected = Selection {
        point: Some(point),
        image: Some(FIRST),
        dot: Some((FIRST, dot)),
        ..Selection::default()
    };
    assert_eq!(harness.state().actions, [Action::Select(expected)]);
}

#[test]
fn a_dot_without_a_name_gets_the_nearest_by_two_keys() {
    let (dot, point, place) = a_plain_dot(&scene().network);
    let mut network = scene().network.clone();
    Arc::make_mut(&mut network.image_mut(FIRST).labels).remove(&dot);
    let mut harness = harness(network);
    let at = on_screen(&harness, place);
    harness.hover_at(at);
    harness.step();
    harness.key_press(Key::L);
    harness.run_steps(2);
    harness.key_press(Key::Enter);
    harness.run_steps(2);
    assert_eq!(
        edits(&harness),
        [Edit::Label {
            image: FIRST,
            dot,
            point
        }]
    );
}

#[test]
fn a_missed_target_is_measured_and_named_by_two_keys() {
    let (network, point, place) = with_a_missed_target();
    let missed = missed_targets(&network, &network.images[&FIRST]);
    let predicted = missed
        .iter()
        .find(|m| m.point == point)
        .expect("it is missed");
    assert!(
        (predicted.place_px - place).norm() < 0.5,
        "true station, true point: {predicted:?} {place}"
    );
    let mut harness = harness(network);
    let at = on_screen(&harness, place);
    harness.hover_at(at);
    harness.step();
    harness.key_press(Key::A);
    harness.run_steps(2);
    harness.key_press(Key::Enter);
    harness.run_steps(2);
    let edits = edits(&harness);
    let [
        Edit::AddDot {
            image: FIRST,
            dot,
            point: Some(named),
        },
    ] = &edits[..]
    else {
        panic!("{edits:?}");
    };
    // The same estimator on the same picture; only the levels round the dot differ.
    assert!(
        (dot.centre_px - place).norm() < 0.05 && dot.sigma_px < 0.2,
        "{dot:?} {place}"
    );
    assert_eq!(*named, point);
}

/// The true normals of the scene's dots tell what the ellipses are to tell.
#[test]
fn the_normals_of_ellipses_are_those_of_the_scene() {
    let network = &scene().network;
    let directions = Directions::of(network);
    let experiment = experiment();
    let truth = experiment.truth();
    let mut errors = Vec::new();
    for station in experiment.stations.iter().take(3) {
        for dot in &truth.images[&station.image] {
            let Some(point) = point_of(&dot.label) else {
                continue;
            };
            let Some(known) = network.points.get(&point) else {
                continue;
            };
            let towards = station.pose.centre_in_world - known.position;
            let aspect = directions.aspect(point, &towards);
            if let Some(angle) = aspect.and_then(|aspect| aspect.incidence_deg) {
                errors.push((angle - dot.incidence_deg).abs());
            }
        }
    }
    errors.sort_by(f64::total_cmp);
    // Three rays only, dots of some eight pixels: of a dot seen squarely by all three the ellipses tell little.
    let (half, most) = (errors[errors.len() / 2], errors[errors.len() * 9 / 10]);
    assert!(errors.len() > 30 && half < 3.0 && most < 6.0, "{errors:?}");
}

#[test]
fn a_code_is_named_once() {
    let marks = MarksCache::default().get(&scene().network, FIRST);
    let code = marks.codes.first().expect("a code in the first picture");
    let parts: Vec<&str> = (marks.dots.iter())
        .filter(|mark| mark.reading == Some(0))
        .filter_map(|mark| mark.part())
        .collect();
    assert_eq!(parts.len(), 6, "{parts:?}");
    assert!(parts.contains(&"O") && parts.contains(&"1"), "{parts:?}");
    assert!(code.label.starts_with('C') && !code.label.contains('.'));
    assert!(code.spacing_px > code.dot_px && code.spacing_px < 20.0 * code.dot_px);
}

#[test]
fn reject_restore_and_unlabel_are_one_key_each() {
    let (dot, _, place) = a_plain_dot(&scene().network);
    let mut harness = harness(scene().network.clone());
    let at = on_screen(&harness, place);
    harness.hover_at(at);
    harness.step();
    for key in [Key::X, Key::R, Key::Delete] {
        harness.key_press(key);
        harness.step();
    }
    let image = FIRST;
    let expected = [
        Edit::Reject { image, dot },
        Edit::Restore { image, dot },
        Edit::Unlabel { image, dot },
    ];
    assert_eq!(edits(&harness), expected);
}

#[test]
fn a_code_gets_another_number() {
    let network = scene().network.clone();
    let detections = network.images[&FIRST]
        .detections
        .clone()
        .expect("detections");
    let code = detections
        .codes
        .first()
        .expect("a code in the first picture");
    let place = detections.dots[code.dots[0].slot()].centre_px;
    let mut harness = harness(network);
    let at = on_screen(&harness, place);
    harness.hover_at(at);
    harness.step();
    harness.key_press(Key::N);
    harness.run_steps(2);
    harness.get_by_label_contains("Number of the code");
    harness.event(egui::Event::Text("17".into()));
    harness.run_steps(2);
    harness.key_press(Key::Enter);
    harness.run_steps(2);
    assert_eq!(
        edits(&harness),
        [Edit::Renumber {
            image: FIRST,
            reading: 0,
            id: 17
        }]
    );
}

#[test]
fn labels_are_ranked_by_their_predicted_distance_and_filtered() {
    let network = &scene().network;
    let (_, point, place) = a_plain_dot(network);
    let ranked = rank_labels(network, FIRST, place);
    assert_eq!(ranked[0].point, point);
    assert!(ranked[0].held_by.is_some());
    assert!(
        ranked
            .windows(2)
            .all(|pair| pair[0].distance_px <= pair[1].distance_px)
    );
    let typed = filtered(&ranked, "c420.a", network);
    assert_eq!(
        typed[0].label, "C420.A",
        "a label typed in full comes first, known or not"
    );
    assert!(filtered(&ranked, "no such label", network).is_empty());
    let PointId::Target(number) = network.new_target() else {
        panic!("a plain target");
    };
    assert!(!network.points.contains_key(&PointId::Target(number)));
}

#[test]
fn an_epipolar_line_goes_through_the_same_target() {
    let network = &scene().network;
    let (_, point, place) = a_plain_dot(network);
    let selection = Selection {
        point: Some(point),
        ..Selection::default()
    };
    let lines = prediction::epipolar_lines(network, FIRST, &selection);
    assert!(!lines.is_empty());
    for line in lines {
        let distance = line
            .windows(2)
            .map(|pair| distance_to(pair[0], pair[1], place))
            .fold(f64::INFINITY, f64::min);
        // Two measured dots of some hundredths of a pixel and the chords of a curve.
        assert!(distance < 1.0, "{distance}");
    }
}

fn distance_to(a: Vector2<f64>, b: Vector2<f64>, place: Vector2<f64>) -> f64 {
    let along = b - a;
    let share = ((place - a).dot(&along) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    (a + along * share - place).norm()
}

#[test]
fn only_dots_in_sight_are_drawn() {
    let mut cache = MarksCache::default();
    let marks = cache.get(&scene().network, FIRST);
    assert!(
        Arc::ptr_eq(&marks, &cache.get(&scene().network, FIRST)),
        "gathered once"
    );
    let (_, _, place) = a_plain_dot(&scene().network);
    let margin = Vector2::new(20.0, 20.0);
    let near = PixelRect {
        min: place - margin,
        max: place + margin,
    };
    let in_sight = overlay::marks_in_sight(&marks, &near);
    assert!(!in_sight.is_empty() && in_sight.len() < marks.dots.len());
    assert!(
        in_sight
            .iter()
            .all(|mark| near.holds(mark.dot.centre_px, mark.dot.major_px))
    );
}

#[test]
fn an_image_without_detections_says_what_comes_first() {
    let mut network = scene().network.clone();
    let entry = network.image_mut(FIRST);
    entry.detections = None;
    entry.labels = Arc::default();
    let mut harness = harness(network);
    harness.get_by_label("Detect targets").click();
    harness.run_ok();
    let expected = Action::Run(RunRequest::Until(crate::network::Stage::Detect));
    assert!(harness.state().actions.contains(&expected));
}

#[test]
fn the_wheel_zooms_at_the_pointer() {
    let mut harness = harness(scene().network.clone());
    let at = on_screen(&harness, Vector2::new(300.0, 200.0));
    harness.hover_at(at);
    harness.step();
    harness.event(egui::Event::MouseWheel {
        unit: egui::MouseWheelUnit::Point,
        delta: vec2(0.0, 200.0),
        phase: egui::TouchPhase::Move,
        source: egui::MouseWheelSource::Unknown,
        modifiers: Modifiers::NONE,
    });
    harness.run_steps(20);
    let rect = harness.get_by_label("image view").rect();
    let transform = harness.state().view.sight.transform(rect, [1024, 683]);
    assert!(transform.scale > 1.5 * Sight::Fit.transform(rect, [1024, 683]).scale);
    assert!((transform.pixel(at) - Vector2::new(300.0, 200.0)).norm() < 0.1);
}

struct App(Stage);

impl eframe::App for App {
    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        self.0.pictures.poll();
        show(ui, &mut self.0);
    }
}

#[test]
fn the_picture_is_drawn_under_its_marks() {
    let (_, point, place) = a_plain_dot(&scene().network);
    let mut harness = Harness::builder()
        .with_size(vec2(1100.0, 800.0))
        .wgpu()
        .build_eframe(|cc| {
            install(cc.wgpu_render_state.as_ref().expect("wgpu draws"));
            let mut stage = stage(scene().network.clone());
            stage.selection.point = Some(point);
            stage.view.loupe = Loupe::Open;
            stage.view.look_at(place, 6.0);
            App(stage)
        });
    harness.run_steps(3);
    let rect = harness.get_by_label("image view").rect();
    harness.hover_at(rect.center() + vec2(3.0, 3.0));
    harness.run_steps(8);
    let drawn = harness.render().expect("a picture of the window");
    if let Some(file) = option_env!("TIEPOINT_SHOT") {
        drawn.save(file).expect("a picture file");
    }
    let grey = |offset: egui::Vec2| {
        let at = rect.center() + offset;
        drawn.get_pixel(at.x as u32, at.y as u32).0
    };
    // Inside the dot, beside the cross of its centre, and outside it.
    let inside = grey(vec2(6.0, 6.0));
    assert!(inside[0] > 150 && inside[0] == inside[2], "{inside:?}");
    assert!(grey(vec2(-120.0, 90.0))[0] < 120);
}
