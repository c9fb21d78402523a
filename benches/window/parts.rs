//! The parts of the table.

use std::collections::BTreeSet;
use std::fs;
use std::sync::Arc;
use std::time::{Duration, Instant};

use egui::{Event, Modifiers, MouseWheelUnit, PointerButton, Pos2, pos2, vec2};
use egui_kittest::Harness;
use tiepoint::network::{Network, PointId, Stage};
use tiepoint::ui::action::{Action, RunRequest, Selection};
use tiepoint::ui::app::App;
use tiepoint::ui::context::ViewContext;
use tiepoint::ui::network_view::NetworkView;
use tiepoint::ui::pictures::{PictureSettings, PictureState, PictureStore};

use super::desk::{Desk, Frame};
use super::inputs::{Inputs, ring_of_stations};
use super::{Row, median_and_worst, ms};

/// Interrupts that are tried in each stage, spread evenly over it.
const MOMENTS: u32 = 16;

/// The middle of the first image panel, in points.
const PANEL: Pos2 = pos2(457.0, 355.0);

/// The most memory that the process ever held.
fn peak_memory() -> String {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes: Option<f64> = line.and_then(|line| line.split_whitespace().next()?.parse().ok());
    kilobytes.map_or("-".into(), |kilobytes| {
        format!("{:.0} MB", kilobytes / 1000.0)
    })
}

pub(crate) fn opening_and_memory(inputs: &Inputs) -> Vec<Row> {
    let project = inputs.before(None, "opened.tiepoint");
    let mut desk = Desk::new();
    desk.frame();
    let begun = Instant::now();
    desk.apply(Action::Open(project));
    while desk.app().session().is_none() {
        desk.step();
    }
    desk.frame();
    let first = begun.elapsed();
    let all = |app: &App| {
        let network = app.network();
        network
            .images
            .iter()
            .filter(|(id, entry)| app.pictures().thumbnail(**id, entry).is_none())
            .count()
            == 0
    };
    desk.until(all);
    desk.frame();
    let thumbnails = begun.elapsed();
    let opened = peak_memory();
    drop(desk);
    let mut desk = Desk::new();
    desk.open(&inputs.before(Some(Stage::Detect), "measured-in-window.tiepoint"));
    desk.apply(Action::Run(RunRequest::Until(Stage::Adjust)));
    let begun = Instant::now();
    while desk.app().runner().is_running() {
        desk.frame();
    }
    let measured = begun.elapsed();
    vec![
        Row::new(
            "opening a measured project of 34 images, to its first picture",
            ms(first),
            "",
        ),
        Row::new("the same, to the last of 34 thumbnails", ms(thumbnails), ""),
        Row::new("memory with 34 images open, at most", opened, ""),
        Row::new(
            "memory while 34 images are measured, at most",
            peak_memory(),
            "",
        ),
        Row::new(
            "measuring 34 images in the window",
            format!("{:.1} s", measured.as_secs_f64()),
            "",
        ),
    ]
}

pub(crate) fn interrupts(inputs: &Inputs) -> Vec<Row> {
    let mut desk = Desk::new();
    let mut rows = Vec::new();
    for stage in Stage::ALL {
        desk.open(&inputs.before(Some(stage), &format!("{stage}.tiepoint")));
        desk.apply(Action::Run(RunRequest::Until(stage)));
        let lasts = desk.until(|app| !app.runner().is_running());
        let mut answers = Vec::new();
        for moment in 0..MOMENTS {
            desk.open(&inputs.before(Some(stage), &format!("{stage}-{moment}.tiepoint")));
            desk.apply(Action::Run(RunRequest::Until(stage)));
            let begun = Instant::now();
            while begun.elapsed() < lasts * (2 * moment + 1) / (2 * MOMENTS) {
                desk.step();
            }
            if desk.app().runner().is_running() {
                desk.apply(Action::Interrupt);
                answers.push(desk.until(|app| !app.runner().is_running()));
            }
        }
        let what = format!(
            "from Esc to standstill: {stage}, {} of {MOMENTS} moments in {}",
            answers.len(),
            ms(lasts)
        );
        rows.push(Row::new(what, median_and_worst(answers), "100 ms"));
    }
    rows
}

fn rows_of_frames(what: &str, frames: &[Frame]) -> Vec<Row> {
    let part = |of: fn(&Frame) -> Duration| median_and_worst(frames.iter().map(of).collect());
    vec![
        Row::new(
            format!("longest frame {what}, the window's part"),
            part(|f| f.window),
            "16 ms",
        ),
        Row::new(
            format!("longest frame {what}, the renderer's part"),
            part(|f| f.renderer),
            "",
        ),
    ]
}

pub(crate) fn frames_while_detecting(inputs: &Inputs) -> Vec<Row> {
    let mut desk = Desk::new();
    desk.open(&inputs.before(Some(Stage::Detect), "frames.tiepoint"));
    desk.frame();
    desk.apply(Action::Run(RunRequest::Until(Stage::Detect)));
    let mut frames = Vec::new();
    while desk.app().runner().is_running() {
        frames.push(desk.frame());
    }
    let mut rows = rows_of_frames("while 34 images are detected", &frames);
    desk.apply(Action::Run(RunRequest::Until(Stage::Adjust)));
    let mut frames = Vec::new();
    while desk.app().runner().is_running() {
        frames.push(desk.frame());
    }
    rows.extend(rows_of_frames("in all later stages", &frames));
    rows
}

pub(crate) fn frames_of_a_large_picture(inputs: &Inputs) -> Vec<Row> {
    let mut desk = Desk::new();
    let begun = Instant::now();
    desk.open(&inputs.large_picture());
    let mut frames = Vec::new();
    let is_there = |app: &App| {
        let network = app.network();
        network
            .images
            .iter()
            .all(|(id, entry)| matches!(app.pictures().get(*id, entry), PictureState::Ready(_)))
    };
    while !is_there(desk.app()) {
        frames.push(desk.frame());
    }
    for _ in 0..10 {
        frames.push(desk.frame());
    }
    let shown = begun.elapsed();
    let mut rows = vec![Row::new(
        "a picture of 24 megapixels, from opening to sharp on the screen",
        ms(shown),
        "",
    )];
    rows.extend(rows_of_frames("while it comes", &frames));
    desk.harness.event(Event::PointerMoved(PANEL));
    desk.frame();
    frames.clear();
    let wheel = |points| Event::MouseWheel {
        unit: MouseWheelUnit::Point,
        delta: vec2(0.0, points),
        phase: egui::TouchPhase::Move,
        source: egui::MouseWheelSource::Unknown,
        modifiers: Modifiers::NONE,
    };
    let mut turn = |desk: &mut Desk, points| {
        for _ in 0..40 {
            desk.harness.event(wheel(points));
            frames.push(desk.frame());
        }
    };
    turn(&mut desk, 30.0);
    let mut moves = Vec::new();
    let button = |pressed, pos| Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    desk.harness.event(button(true, PANEL));
    for place in 0..60 {
        let angle = place as f32 * 0.2;
        desk.harness.event(Event::PointerMoved(
            PANEL + 100.0 * vec2(angle.sin(), angle.cos()),
        ));
        moves.push(desk.frame());
    }
    desk.harness.event(button(false, PANEL));
    desk.frame();
    turn(&mut desk, -30.0);
    frames.extend(moves);
    rows.extend(rows_of_frames("while it is zoomed and moved", &frames));
    rows
}

/// The 3D view alone.
struct View {
    view: NetworkView,
    network: Network,
    pictures: PictureStore,
    selection: Selection,
    group: Arc<BTreeSet<PointId>>,
}

impl View {
    fn draw(ui: &mut egui::Ui, view: &mut View) {
        let context = ViewContext {
            network: &view.network,
            pictures: &view.pictures,
            selection: &view.selection,
            group: &view.group,
            pending: &[],
        };
        view.view.ui(ui, &context, &mut Vec::new());
    }
}

pub(crate) fn frames_of_a_large_network(_: &Inputs) -> Vec<Row> {
    let view = View {
        view: NetworkView::new(),
        network: ring_of_stations(2000, 20_000),
        pictures: PictureStore::new(PictureSettings::default(), || {}).expect("threads"),
        selection: Selection::default(),
        group: Arc::default(),
    };
    let begun = Instant::now();
    let mut harness = Harness::builder()
        .with_size([700.0, 600.0])
        .build_ui_state(View::draw, view);
    let first = begun.elapsed();
    let mut step = |events: &[Event]| {
        for event in events {
            harness.event(event.clone());
        }
        let begun = Instant::now();
        harness.step();
        begun.elapsed()
    };
    step(&[]);
    let middle = pos2(350.0, 350.0);
    let press = Event::PointerButton {
        pos: middle,
        button: PointerButton::Primary,
        pressed: true,
        modifiers: Modifiers::NONE,
    };
    step(&[Event::PointerMoved(middle)]);
    step(&[press]);
    let turning: Vec<Duration> = (0..100)
        .map(|place| step(&[Event::PointerMoved(middle + vec2(place as f32, 0.0))]))
        .collect();
    vec![
        Row::new(
            "3D view, 20,000 points and 2,000 stations: first frames",
            ms(first),
            "",
        ),
        Row::new(
            "the same while it is turned, the window's part",
            median_and_worst(turning),
            "4 ms",
        ),
    ]
}
