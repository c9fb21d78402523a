//! The application: the document, what runs, what is selected, and the one place that applies actions.
//!
//! A frame goes in three parts: what workers finished is taken over, the panels draw and ask, the actions are applied
//! (`apply`). Opening, making and copying projects is slow and goes through the `loader`; every command has one
//! entry in the `catalogue`, from which menu, keys, palette and the list of keys are made.

mod apply;
mod banners;
mod catalogue;
mod forms;
mod loader;
mod menu;
mod palette;
mod panes;
mod sight;
mod start;
mod title;
mod type_ahead;

use std::collections::{BTreeSet, VecDeque};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use eframe::egui::{self, Context};
use egui_tiles::Tree;

use super::action::{Action, RunRequest, Selection};
use super::image_view::ImageView;
use super::layout::{Pane, first_layout};
use super::network_view::NetworkView;
use super::panels::findings::Findings;
use super::panels::frame::Frame;
use super::panels::images::Images;
use super::panels::inspector::Inspector;
use super::panels::journal::Journal;
use super::panels::plots::Plots;
use super::panels::review::Review;
use super::panels::stages::StagesPanel;
use super::panels::tables::Tables;
use super::pictures::{PictureSettings, PictureStore};
use super::runner::Runner;
use super::window::Beginning;
use crate::network::{ImageId, Network, PointId, Stage};
use crate::project::session::Session;
use crate::project::whereabouts::PictureMoves;
use loader::Loader;
use palette::Palette;
use start::Start;
use type_ahead::TypeAhead;

pub use catalogue::Command;

/// Image panels of the first layout.
const FIRST_IMAGE_PANELS: usize = 2;

/// Lines for the operator that are kept.
const MESSAGES_KEPT: usize = 100;

/// How often progress is looked at: it is state, not an event.
const PROGRESS_EVERY: Duration = Duration::from_millis(50);

/// An open project.
struct Document {
    session: Session,
    project: PathBuf,
}

/// The application.
pub struct App {
    document: Option<Document>,
    empty: Network,
    runner: Runner,
    loader: Loader,
    pictures: PictureStore,
    selection: Selection,
    /// Points of the last box select.
    group: Arc<BTreeSet<PointId>>,
    /// Lines for the operator, newest last.
    messages: VecDeque<String>,
    panels: Panels,
    tree: Tree<Pane>,
    /// Images whose picture was not at its place.
    missing: Vec<ImageId>,
    /// Where missing pictures were found, until it can be taken over.
    moves: Option<PictureMoves>,
    palette: Palette,
    type_ahead: TypeAhead,
    start: Start,
    forms: forms::Forms,
    /// Banners that the operator has dismissed.
    seen: banners::Seen,
    /// What the window's frame says.
    title: title::Title,
    /// Answers of dialogs, which run on threads of their own.
    answers: Receiver<Action>,
    ask: Sender<Action>,
    /// Tells what could not be saved when the window is gone.
    last_words: Option<Sender<String>>,
}

/// The panels with their small state.
struct Panels {
    stages: StagesPanel,
    images: Images,
    views: Vec<Option<ImageView>>,
    network: NetworkView,
    inspector: Inspector,
    frame: Frame,
    findings: Findings,
    review: Review,
    tables: Tables,
    plots: Plots,
    journal: Journal,
}

impl Panels {
    /// Lets go of what was typed and not yet asked for: it was about a document that goes.
    fn forget_drafts(&mut self) {
        self.stages = StagesPanel::default();
        self.inspector = Inspector::default();
        self.frame = Frame::default();
    }
}

/// Why the application could not be made.
#[derive(Debug, thiserror::Error)]
#[error("the system gives no thread: {0}")]
pub struct NoThread(#[from] std::io::Error);

impl App {
    /// The application in its window.
    ///
    /// # Errors
    /// [`NoThread`].
    pub fn new(
        creation: &eframe::CreationContext<'_>,
        beginning: Beginning,
    ) -> Result<Self, NoThread> {
        if let Some(state) = &creation.wgpu_render_state {
            super::image_view::install(state);
            NetworkView::install(state);
        }
        // Retro-reflective pictures are dark, and so is the room where they are looked at.
        creation.egui_ctx.set_theme(egui::Theme::Dark);
        let waking = |context: &Context| {
            let context = context.clone();
            move || context.request_repaint()
        };
        let (ask, answers) = channel();
        let mut app = Self {
            document: None,
            empty: Network::default(),
            runner: Runner::new(waking(&creation.egui_ctx))?,
            loader: Loader::new(waking(&creation.egui_ctx))?,
            pictures: PictureStore::new(PictureSettings::default(), waking(&creation.egui_ctx))?,
            selection: Selection::default(),
            group: Arc::default(),
            messages: VecDeque::new(),
            panels: Panels {
                stages: StagesPanel::default(),
                images: Images::default(),
                views: Vec::new(),
                network: NetworkView::new(),
                inspector: Inspector::default(),
                frame: Frame::default(),
                findings: Findings::default(),
                review: Review::default(),
                tables: Tables::default(),
                plots: Plots::default(),
                journal: Journal,
            },
            tree: first_layout(FIRST_IMAGE_PANELS),
            missing: Vec::new(),
            moves: None,
            palette: Palette::default(),
            type_ahead: TypeAhead::default(),
            start: Start::default(),
            forms: forms::Forms::default(),
            seen: banners::Seen::default(),
            title: title::Title::default(),
            answers,
            ask,
            last_words: None,
        };
        app.set_image_panels(FIRST_IMAGE_PANELS);
        match beginning {
            Beginning::Empty => {}
            Beginning::Project(path) => app.apply(Action::Open(path), &creation.egui_ctx),
            Beginning::Demo(request) => app.begin_demo(request),
        }
        Ok(app)
    }

    /// The same application, remembering in this folder which projects were open.
    #[must_use]
    pub fn remembering(mut self, state_folder: Option<PathBuf>) -> Self {
        self.loader.state_folder = state_folder;
        self.loader.recall();
        self
    }

    /// The same application, telling by this what could not be saved when its window is gone.
    #[must_use]
    pub fn telling(mut self, last_words: Sender<String>) -> Self {
        self.last_words = Some(last_words);
        self
    }

    /// Images whose picture is not at its place.
    #[must_use]
    pub fn missing_pictures(&self) -> &[ImageId] {
        &self.missing
    }

    /// The document, where one is open.
    #[must_use]
    pub fn session(&self) -> Option<&Session> {
        self.document.as_ref().map(|document| &document.session)
    }

    /// The measurement; empty where no project is open.
    #[must_use]
    pub fn network(&self) -> &Network {
        self.session()
            .map_or(&self.empty, |session| session.network())
    }

    /// What runs.
    #[must_use]
    pub fn runner(&self) -> &Runner {
        &self.runner
    }

    /// Whether nothing is under way: no step, no file.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        !self.runner.is_running() && !self.loader.is_busy()
    }

    /// The last line for the operator.
    #[must_use]
    pub fn message(&self) -> &str {
        self.messages.back().map_or("", String::as_str)
    }

    /// What is selected.
    #[must_use]
    pub fn selection(&self) -> &Selection {
        &self.selection
    }

    /// Points of the last box select.
    #[must_use]
    pub fn group(&self) -> &BTreeSet<PointId> {
        &self.group
    }

    /// The image panels, in their order.
    pub fn image_views(&self) -> impl Iterator<Item = &ImageView> {
        self.panels.views.iter().flatten()
    }

    /// The 3D view.
    #[must_use]
    pub fn network_view(&self) -> &NetworkView {
        &self.panels.network
    }

    /// Pictures that are decoded.
    #[must_use]
    pub fn pictures(&self) -> &PictureStore {
        &self.pictures
    }

    fn say(&mut self, line: impl Into<String>) {
        if self.messages.len() == MESSAGES_KEPT {
            self.messages.pop_front();
        }
        self.messages.push_back(line.into());
    }

    /// Takes over what workers finished.
    fn take_over(&mut self, context: &Context) {
        self.pictures.poll();
        self.take_loaded(context);
        self.move_pictures();
        if let Some(document) = &mut self.document {
            for line in self.runner.poll(&mut document.session) {
                self.say(line);
            }
        }
        if !self.is_idle() {
            context.request_repaint_after(PROGRESS_EVERY);
        }
        let answers: Vec<Action> = self.answers.try_iter().collect();
        for action in answers {
            self.apply(action, context);
        }
    }

    /// Runs everything that is still to do.
    fn run_all(&mut self, context: &Context) {
        self.apply(Action::Run(RunRequest::Until(Stage::Adjust)), context);
    }
}

impl eframe::App for App {
    fn raw_input_hook(&mut self, context: &Context, input: &mut egui::RawInput) {
        self.type_ahead.hear(context, input);
    }

    fn logic(&mut self, context: &Context, _frame: &mut eframe::Frame) {
        self.take_over(context);
        self.show_title(context);
    }

    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        let context = ui.ctx().clone();
        let mut actions = Vec::new();
        self.modal_keys(&context);
        actions.extend(self.keys_with_alt(&context));
        // Behind a dialog no panel hears a key.
        let keys_of_dialog = self.take_keys_of_dialog(&context);
        if self.is_in_front(Pane::Review) {
            self.panels.review.take_keys(&context);
        }
        egui::Panel::top("menu").show(ui, |ui| self.menu(ui, &mut actions));
        egui::Panel::bottom("status").show(ui, |ui| self.status(ui, &mut actions));
        self.banners(ui, &mut actions);
        egui::CentralPanel::default().show(ui, |ui| match &self.document {
            Some(_) => self.panes(ui, &mut actions),
            None => self.start_page(ui, &mut actions),
        });
        context.input_mut(|input| input.events.extend(keys_of_dialog));
        self.windows(&context, &mut actions);
        // Keys after the panels: a text field or a panel with the focus has taken its own by now.
        actions.extend(self.shortcuts(&context));
        for action in actions {
            self.apply(action, &context);
        }
    }

    /// Closes the document as the command does, and waits until it is on the disk.
    fn on_exit(&mut self) {
        self.close();
        for line in self.loader.wait_for_closing() {
            if let Some(last_words) = &self.last_words {
                // Who started the window may be gone too.
                let _ = last_words.send(line);
            }
        }
    }
}
