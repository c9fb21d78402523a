//! The window in a test, and projects for it at three times of the measurement.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::thread::sleep;
use std::time::Duration;

use egui::{Event, Key, Modifiers, PointerButton, Pos2, RawInput, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use nalgebra::Vector2;
use tiepoint::network::{Absence, AbsenceKind, ImageId, Label, Network, PointId};
use tiepoint::project::session::Session;
use tiepoint::targets::DotIndex;
use tiepoint::ui::app::App;
use tiepoint::ui::image_view::ImageView;
use tiepoint::ui::window::Beginning;

use crate::common::{Folder, NEW};

/// Frames after which a test gives up waiting: with its pause a frame takes some milliseconds, a measurement of the small
/// scene some hundred frames.
pub(crate) const MOST_FRAMES: usize = 20_000;

/// Frames within which all that was typed ahead is heard.
const MOST_TYPED: usize = 20;

/// Between two frames, so that the workers have the processor.
const PAUSE: Duration = Duration::from_millis(3);

/// How far a project of the small scene is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Begun {
    /// Just made.
    Fresh,
    /// Two images are oriented.
    Paired,
    /// All stages are done.
    Measured,
}

struct Projects {
    fresh: Vec<u8>,
    paired: Vec<u8>,
    measured: Vec<u8>,
    network: Network,
}

/// The project files, made once by the program without a window.
fn projects() -> &'static Projects {
    static PROJECTS: OnceLock<Projects> = OnceLock::new();
    PROJECTS.get_or_init(|| {
        let folder = Folder::with_scene("projects");
        folder.run(&NEW).done();
        let fresh = folder.read("p.tiepoint");
        folder
            .run(&["run", "p.tiepoint", "--until", "first-pair"])
            .done();
        let paired = folder.read("p.tiepoint");
        folder.run(&["run", "p.tiepoint"]).done();
        let measured = folder.read("p.tiepoint");
        let session = Session::open(&folder.at("p.tiepoint")).expect("the project just made");
        Projects {
            fresh,
            paired,
            measured,
            network: session.network().as_ref().clone(),
        }
    })
}

/// A folder of the small scene with its project `p.tiepoint`.
pub(crate) fn folder(name: &str, begun: Begun) -> Folder {
    let projects = projects();
    let folder = Folder::with_scene(name);
    folder.write(
        "p.tiepoint",
        match begun {
            Begun::Fresh => &projects.fresh,
            Begun::Paired => &projects.paired,
            Begun::Measured => &projects.measured,
        },
    );
    folder
}

/// Changes the project of a folder before a window opens it.
pub(crate) fn prepare(folder: &Folder, change: impl FnOnce(&mut Network)) {
    let mut session = Session::open(&folder.at("p.tiepoint")).expect("a project");
    let changed: Result<(), Infallible> = session.edit("prepared", |network| {
        change(network);
        Ok(())
    });
    changed.expect("an edit that cannot fail");
    session.flush().expect("a folder to write to");
}

/// Asserts that a measurement ended with the digits of one that nobody disturbed.
#[track_caller]
pub(crate) fn assert_undisturbed(network: &Network) {
    let expected = &projects().network;
    assert_eq!(network.points.len(), expected.points.len());
    assert!(network.points == expected.points, "other coordinates");
    for (id, image) in expected.images.iter() {
        let found = &network.images[id];
        assert!(
            found.station == image.station && found.labels == image.labels,
            "{} has another station or other labels",
            image.file.path
        );
    }
}

/// Something that was dropped on the window.
#[derive(Debug)]
struct Dropped(PathBuf);

impl egui::DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        Err("the window reads files itself".into())
    }
}

/// The window.
pub(crate) struct Bench {
    pub(crate) window: Harness<'static, App>,
}

impl Bench {
    /// A window that begins so.
    pub(crate) fn begin(beginning: Beginning) -> Self {
        let window = Harness::builder()
            .with_size(vec2(1400.0, 900.0))
            .wgpu()
            .build_eframe(|creation| App::new(creation, beginning).expect("threads"));
        Self { window }
    }

    /// A window with a project.
    pub(crate) fn open(project: &Path) -> Self {
        let mut bench = Self::begin(Beginning::Project(project.to_owned()));
        bench.rest();
        assert!(bench.app().session().is_some(), "{}", bench.app().message());
        bench
    }

    pub(crate) fn app(&self) -> &App {
        self.window.state()
    }

    /// The document as it is now.
    pub(crate) fn network(&self) -> Arc<Network> {
        let session = self.app().session().expect("an open project");
        Arc::clone(session.network())
    }

    /// What can be taken back, latest first.
    pub(crate) fn history(&self) -> Vec<String> {
        let session = self.app().session().expect("an open project");
        let titles = session.history().undo_titles();
        titles.map(str::to_owned).collect()
    }

    /// Draws frames until the condition holds, and none after.
    #[track_caller]
    pub(crate) fn until(&mut self, what: &str, mut condition: impl FnMut(&App) -> bool) {
        for _ in 0..MOST_FRAMES {
            if condition(self.app()) {
                return;
            }
            self.window.step();
            sleep(PAUSE);
        }
        panic!(
            "{what} never came; the window says '{}', under way: {:?}",
            self.app().message(),
            self.app().runner().progress()
        );
    }

    /// Draws frames until nothing is under way and the frame stands still.
    #[track_caller]
    pub(crate) fn rest(&mut self) {
        self.until("rest", App::is_idle);
        for _ in 0..MOST_FRAMES {
            if self.window.run_ok().is_some() {
                return;
            }
        }
        panic!("the window never stops drawing");
    }

    /// Draws the few frames that lists and scrolling take.
    pub(crate) fn settle(&mut self) {
        self.window.run_steps(3);
    }

    /// Presses and releases a key.
    pub(crate) fn key(&mut self, key: Key) {
        self.keys(Modifiers::NONE, key);
    }

    /// Presses and releases a key while others are held.
    pub(crate) fn keys(&mut self, held: Modifiers, key: Key) {
        self.window.key_press_modifiers(held, key);
        self.settle();
    }

    /// Types a text into the field that has the focus.
    pub(crate) fn write(&mut self, text: &str) {
        self.window.event(Event::Text(text.to_owned()));
        self.settle();
    }

    /// What the operator typed while one slow frame was drawn: all of it comes with the next frame.
    pub(crate) fn type_ahead(&mut self, events: Vec<Event>) {
        let context = self.window.ctx.clone();
        let mut input = RawInput {
            events,
            ..RawInput::default()
        };
        // The harness leaves out this part of a frame.
        for _ in 0..MOST_TYPED {
            let app = self.window.state_mut();
            eframe::App::raw_input_hook(app, &context, &mut input);
            let heard = std::mem::take(&mut input.events);
            self.window.input_mut().events.extend(heard);
            self.window.step();
        }
    }

    /// Clicks what has this label.
    #[track_caller]
    pub(crate) fn click(&mut self, label: &str) {
        self.window.get_by_label(label).click();
        self.settle();
    }

    /// Moves the pointer to a place.
    pub(crate) fn hover(&mut self, at: Pos2) {
        self.window.hover_at(at);
        self.settle();
    }

    /// Clicks at a place; the pointer stays there.
    pub(crate) fn click_at(&mut self, at: Pos2) {
        self.hover(at);
        self.press_and_release(at);
        self.settle();
    }

    /// Presses and releases the button of the pointer in the next two frames.
    pub(crate) fn press_and_release(&self, at: Pos2) {
        for pressed in [true, false] {
            self.window.event(Event::PointerButton {
                pos: at,
                button: PointerButton::Primary,
                pressed,
                modifiers: Modifiers::NONE,
            });
        }
    }

    /// Whether something has this label.
    pub(crate) fn has(&self, label: &str) -> bool {
        self.window.query_all_by_label(label).next().is_some()
    }

    /// Whether the label of something holds this text.
    pub(crate) fn says(&self, text: &str) -> bool {
        self.window
            .query_all_by_label_contains(text)
            .next()
            .is_some()
    }

    /// How many things have this label.
    pub(crate) fn count(&self, label: &str) -> usize {
        self.window.query_all_by_label(label).count()
    }

    /// Drops a file or folder on the window.
    pub(crate) fn drop_on_window(&mut self, path: &Path) {
        let file = Arc::new(Dropped(path.to_owned()));
        self.window.input_mut().dropped_files.push(file);
        self.settle();
    }

    /// The panel that shows an image.
    #[track_caller]
    pub(crate) fn view(&self, image: ImageId) -> &ImageView {
        let mut views = self.app().image_views();
        let found = views.find(|view| view.image == image);
        found.unwrap_or_else(|| panic!("no panel shows image {}", image.0))
    }

    /// Where a place of an image (px) stands on the window.
    #[track_caller]
    pub(crate) fn place(&self, image: ImageId, place_px: Vector2<f64>) -> Pos2 {
        let place = self.view(image).place_on_screen(place_px);
        place.unwrap_or_else(|| panic!("{place_px:?} of image {} is out of sight", image.0))
    }

    /// Zooms in at a place of an image by the wheel, moves the pointer onto it and says where it stands then.
    pub(crate) fn zoom_to(&mut self, image: ImageId, place_px: Vector2<f64>) -> Pos2 {
        let at = self.place(image, place_px);
        self.hover(at);
        self.window.event(Event::MouseWheel {
            unit: egui::MouseWheelUnit::Point,
            delta: vec2(0.0, 400.0),
            phase: egui::TouchPhase::Move,
            source: egui::MouseWheelSource::Unknown,
            modifiers: Modifiers::NONE,
        });
        self.window.run_steps(20);
        let at = self.place(image, place_px);
        self.hover(at);
        at
    }

    /// Takes the last change back and does it again by the keys; the document is as it was before it, and after it.
    #[track_caller]
    pub(crate) fn undo_and_redo(&mut self, before: &Network) {
        let after = self.network();
        assert!(*after != *before, "nothing was changed");
        self.keys(Modifiers::COMMAND, Key::Z);
        assert!(*self.network() == *before, "not taken back");
        self.keys(Modifiers::COMMAND, Key::Y);
        assert!(*self.network() == *after, "not done again");
    }
}

/// A dot of an image that is a plain target.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    pub(crate) image: ImageId,
    pub(crate) dot: DotIndex,
    pub(crate) point: PointId,
    pub(crate) place_px: Vector2<f64>,
}

impl Seen {
    /// The label of the dot in another state of the document.
    pub(crate) fn label(self, network: &Network) -> Option<&Label> {
        network.images[&self.image].labels.get(&self.dot)
    }
}

/// The plain targets of an image that are used, by their numbers.
pub(crate) fn targets_of(network: &Network, image: ImageId) -> Vec<Seen> {
    let entry = &network.images[&image];
    let detections = entry.detections.as_ref().expect("a detected image");
    let targets = entry.used_labels();
    let mut targets: Vec<Seen> = targets
        .filter(|(_, label)| matches!(label.point, PointId::Target(_)))
        .map(|(dot, label)| Seen {
            image,
            dot,
            point: label.point,
            place_px: detections.dots[dot.slot()].centre_px,
        })
        .collect();
    targets.sort_by_key(|seen| seen.point);
    targets
}

/// The image in the first panel.
pub(crate) fn first_image(bench: &Bench) -> ImageId {
    let mut views = bench.app().image_views();
    views.next().expect("an image panel").image
}

/// Takes a dot out of an image, as if neither detection nor the look for missing targets had found it; the last dot gets its place.
pub(crate) fn miss(network: &mut Network, seen: Seen) {
    network.adjustment = None;
    let dot = seen.dot;
    let entry = network.image_mut(seen.image);
    let detections = Arc::make_mut(entry.detections.as_mut().expect("detections"));
    let last = DotIndex(detections.dots.len() as u32 - 1);
    detections.dots.swap_remove(dot.slot());
    let moved = |old: DotIndex| if old == last { dot } else { old };
    for code in &mut detections.codes {
        code.dots.iter_mut().for_each(|dot| *dot = moved(*dot));
    }
    let labels = entry.labels.iter().filter(|(old, _)| **old != dot);
    let labels: BTreeMap<_, _> = labels.map(|(old, l)| (moved(*old), l.clone())).collect();
    let reasons = entry.unlabelled.iter().filter(|(old, _)| **old != dot);
    let reasons: BTreeMap<_, _> = reasons.map(|(old, r)| (moved(*old), r.clone())).collect();
    entry.labels = Arc::new(labels);
    entry.unlabelled = Arc::new(reasons);
    let absence = Absence {
        place_px: seen.place_px,
        kind: AbsenceKind::Weak,
        reason: "taken out of the trial".into(),
    };
    let mut look = entry.look.as_deref().cloned().unwrap_or_default();
    look.absent.insert(seen.point, absence);
    entry.look = Some(Arc::new(look));
}

/// The dot of the image that carries this point's name, and whether it was measured by hand.
pub(crate) fn dot_of(network: &Network, missed: Seen) -> Option<(Vector2<f64>, bool)> {
    let entry = &network.images[&missed.image];
    let detections = entry.detections.as_ref()?;
    let mut labels = entry.labels.iter();
    let (dot, _) = labels.find(|(_, label)| label.point == missed.point)?;
    let place = detections.dots.get(dot.slot())?.centre_px;
    Some((place, detections.by_hand.contains(dot)))
}
