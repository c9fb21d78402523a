//! The application: the document, what runs, what is selected, and the one place that applies actions.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};

use eframe::egui::{self, Context, Key, KeyboardShortcut, Modifiers};
use egui_tiles::{Behavior, SimplificationOptions, TileId, Tree, UiResponse};

use super::action::{Action, RunRequest, Selection};
use super::context::ViewContext;
use super::image_view::ImageView;
use super::layout::{IMAGE_PANELS, Pane, first_layout};
use super::network_view::NetworkView;
use super::panels::findings::FindingsPanel;
use super::panels::images::ImagesPanel;
use super::panels::inspector::InspectorPanel;
use super::panels::journal::JournalPanel;
use super::panels::plots::PlotsPanel;
use super::panels::review::ReviewPanel;
use super::panels::stages::StagesPanel;
use super::panels::tables::TablesPanel;
use super::pictures::PictureStore;
use super::runner::Runner;
use super::window::Beginning;
use crate::network::{ImageId, Network, Stage};
use crate::project::session::{Session, folder_of};

/// The application.
pub struct App {
    session: Option<Session>,
    empty: Network,
    project: Option<PathBuf>,
    runner: Runner,
    pictures: PictureStore,
    selection: Selection,
    message: String,
    panels: Panels,
    tree: Tree<Pane>,
    /// Answers of dialogs, which run on threads of their own.
    answers: Receiver<Action>,
    ask: Sender<Action>,
    open_path: String,
}

/// The panels with their small state.
struct Panels {
    stages: StagesPanel,
    images: ImagesPanel,
    views: Vec<Option<ImageView>>,
    network: NetworkView,
    inspector: InspectorPanel,
    findings: FindingsPanel,
    review: ReviewPanel,
    tables: TablesPanel,
    plots: PlotsPanel,
    journal: JournalPanel,
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
    pub fn new(creation: &eframe::CreationContext<'_>, beginning: Beginning) -> Result<Self, NoThread> {
        let waking = |context: &Context| {
            let context = context.clone();
            move || context.request_repaint()
        };
        let (ask, answers) = channel();
        let mut app = Self {
            session: None,
            empty: Network::default(),
            project: None,
            runner: Runner::new(waking(&creation.egui_ctx))?,
            pictures: PictureStore::new(waking(&creation.egui_ctx))?,
            selection: Selection::default(),
            message: String::new(),
            panels: Panels {
                stages: StagesPanel,
                images: ImagesPanel::default(),
                views: (0..IMAGE_PANELS).map(|_| None).collect(),
                network: NetworkView::default(),
                inspector: InspectorPanel::default(),
                findings: FindingsPanel::default(),
                review: ReviewPanel::default(),
                tables: TablesPanel::default(),
                plots: PlotsPanel::default(),
                journal: JournalPanel::default(),
            },
            tree: first_layout(),
            answers,
            ask,
            open_path: String::new(),
        };
        match beginning {
            Beginning::Empty => {}
            Beginning::Project(path) => app.open(&path),
            Beginning::Measure(path) => {
                app.open(&path);
                app.apply(Action::Run(RunRequest::Until(Stage::Adjust)), &creation.egui_ctx);
            }
        }
        Ok(app)
    }

    /// The document, where one is open.
    #[must_use]
    pub fn session(&self) -> Option<&Session> {
        self.session.as_ref()
    }

    /// What runs.
    #[must_use]
    pub fn runner(&self) -> &Runner {
        &self.runner
    }

    /// The last line for the operator.
    #[must_use]
    pub fn message(&self) -> &str {
        &self.message
    }

    /// What is selected.
    #[must_use]
    pub fn selection(&self) -> &Selection {
        &self.selection
    }

    fn open(&mut self, path: &Path) {
        match Session::open(path) {
            Ok(session) => {
                self.message = session.warnings().first().cloned().unwrap_or_else(|| format!("{} is open.", path.display()));
                self.pictures.set_folder(folder_of(path));
                self.show_first_images(session.network());
                self.session = Some(session);
                self.project = Some(path.to_owned());
                self.selection = Selection::default();
            }
            Err(error) => self.message = error.to_string(),
        }
    }

    fn show_first_images(&mut self, network: &Network) {
        let ids: Vec<ImageId> = network.used_images().map(|(id, _)| id).collect();
        for (place, view) in self.panels.views.iter_mut().enumerate() {
            *view = ids.get(place).map(|id| ImageView::new(*id));
        }
    }

    /// Shows an image in the first image panel unless one shows it already.
    fn show_image(&mut self, id: ImageId) {
        let shown = self.panels.views.iter().flatten().any(|view| view.image() == id);
        if !shown && let Some(first) = self.panels.views.first_mut() {
            *first = Some(ImageView::new(id));
        }
    }

    /// Applies an action; every way to change anything ends here.
    pub fn apply(&mut self, action: Action, context: &Context) {
        match action {
            Action::Open(path) => {
                self.runner.interrupt();
                self.open(&path);
            }
            Action::AskOpen => self.ask_for_project(context),
            Action::New { project, images } => match make_project(&project, &images) {
                Ok(()) => self.open(&project),
                Err(line) => self.message = line,
            },
            Action::Demo => self.message = "The demo is rendered by: tiepoint demo".into(),
            Action::SaveCopy(path) => {
                let saved = self.session.as_ref().map(|session| session.save_copy(&path));
                self.message = match saved {
                    Some(Err(error)) => error.to_string(),
                    _ => format!("A copy is at {}.", path.display()),
                };
            }
            Action::Run(request) => {
                if let Some(session) = &mut self.session {
                    let lines = self.runner.start(session, request);
                    self.say(lines);
                }
            }
            Action::Interrupt => self.runner.interrupt(),
            Action::Edit(edit) => {
                if let Some(session) = &mut self.session
                    && let Some(line) = self.runner.edit(session, edit)
                {
                    self.message = line;
                }
            }
            Action::Undo => self.move_in_history(Session::undo, "Taken back"),
            Action::Redo => self.move_in_history(Session::redo, "Done again"),
            Action::Select(selection) => self.selection = selection,
            Action::LookAt(selection) => {
                if let Some(image) = selection.dot.map(|(image, _)| image).or(selection.image) {
                    self.show_image(image);
                }
                for view in self.panels.views.iter_mut().flatten() {
                    view.look_at(&selection);
                }
                self.selection = selection;
            }
        }
        context.request_repaint();
    }

    fn move_in_history(
        &mut self,
        go: impl FnOnce(&mut Session) -> Result<Option<String>, crate::project::storage::StorageError>,
        verb: &str,
    ) {
        if self.runner.is_running() {
            self.runner.interrupt();
            self.message = "The step under way was interrupted; ask again.".into();
            return;
        }
        let Some(session) = &mut self.session else { return };
        self.message = match go(session) {
            Ok(Some(title)) => format!("{verb}: {title}."),
            Ok(None) => "There is nothing more in the history.".into(),
            Err(error) => error.to_string(),
        };
    }

    fn say(&mut self, lines: Vec<String>) {
        if let Some(last) = lines.into_iter().next_back() {
            self.message = last;
        }
    }

    /// Asks for a project file on a thread of its own: dialogs may wait, frames may not.
    fn ask_for_project(&mut self, context: &Context) {
        let (ask, context) = (self.ask.clone(), context.clone());
        let asked = std::thread::Builder::new().name("dialog".into()).spawn(move || {
            let file = rfd::FileDialog::new().add_filter("Tiepoint project", &["tiepoint"]).pick_file();
            if let Some(path) = file
                && ask.send(Action::Open(path)).is_ok()
            {
                context.request_repaint();
            }
        });
        if let Err(error) = asked {
            self.message = format!("The dialog could not be opened: {error}; type the path instead.");
        }
    }

    fn shortcuts(&self, context: &Context) -> Vec<Action> {
        let keys = [
            (Modifiers::CTRL, Key::F5, Action::Run(RunRequest::Until(Stage::Adjust))),
            (Modifiers::SHIFT, Key::F5, Action::Run(RunRequest::Stage)),
            (Modifiers::NONE, Key::F5, Action::Run(RunRequest::Step)),
            (Modifiers::NONE, Key::Escape, Action::Interrupt),
            (Modifiers::COMMAND, Key::Z, Action::Undo),
            (Modifiers::COMMAND, Key::Y, Action::Redo),
            (Modifiers::COMMAND, Key::O, Action::AskOpen),
        ];
        let mut actions = Vec::new();
        context.input_mut(|input| {
            for (modifiers, key, action) in keys {
                if input.consume_shortcut(&KeyboardShortcut::new(modifiers, key)) {
                    actions.push(action);
                }
            }
            for file in std::mem::take(&mut input.raw.dropped_files) {
                actions.extend(file.path.map(Action::Open));
            }
        });
        actions
    }

    fn menu(&mut self, ui: &mut egui::Ui, actions: &mut Vec<Action>) {
        egui::MenuBar::new().ui(ui, |ui| {
            ui.menu_button("File", |ui| {
                if ui.button("Open ...").clicked() {
                    actions.push(Action::AskOpen);
                    ui.close();
                }
                ui.horizontal(|ui| {
                    ui.text_edit_singleline(&mut self.open_path);
                    if ui.button("Open path").clicked() {
                        actions.push(Action::Open(PathBuf::from(self.open_path.trim())));
                        ui.close();
                    }
                });
                if ui.button("Quit").clicked() {
                    ui.ctx().send_viewport_cmd(egui::ViewportCommand::Close);
                }
            });
            ui.menu_button("Edit", |ui| {
                let history = self.session.as_ref().map(Session::history);
                let undo = history.and_then(|h| h.undo_title()).map(|title| format!("Undo: {title}"));
                let redo = history.and_then(|h| h.redo_title()).map(|title| format!("Redo: {title}"));
                let button = |ui: &mut egui::Ui, text: Option<String>, none: &str| {
                    let enabled = text.is_some();
                    ui.add_enabled(enabled, egui::Button::new(text.unwrap_or_else(|| none.to_owned()))).clicked()
                };
                if button(ui, undo, "Undo") {
                    actions.push(Action::Undo);
                    ui.close();
                }
                if button(ui, redo, "Redo") {
                    actions.push(Action::Redo);
                    ui.close();
                }
            });
            ui.menu_button("View", |ui| {
                if ui.button("First layout").clicked() {
                    self.tree = first_layout();
                    ui.close();
                }
                egui::widgets::global_theme_preference_buttons(ui);
            });
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                ui.label(self.summary());
            });
        });
    }

    /// Figures that the operator always sees.
    fn summary(&self) -> String {
        let Some(session) = &self.session else { return String::new() };
        let network = session.network();
        let oriented = network.oriented_images().count();
        let images = network.used_images().count();
        let sigma0 = network.adjustment.as_ref().map_or_else(String::new, |adjustment| {
            let age = if network.adjustment_is_fresh() { "" } else { " before your last edits" };
            format!("sigma0 {:.3} ({:.4} px){age}   ", adjustment.sigma0, adjustment.sigma0_px)
        });
        format!("{sigma0}{oriented}/{images} images")
    }

    fn empty_window(&mut self, ui: &mut egui::Ui, actions: &mut Vec<Action>) {
        ui.vertical_centered(|ui| {
            ui.add_space(80.0);
            ui.heading("Tiepoint");
            ui.label("From photographs of coded and plain targets to coordinates with true sigmas.");
            ui.add_space(16.0);
            if ui.button("Open a project ...").clicked() {
                actions.push(Action::AskOpen);
            }
            ui.horizontal(|ui| {
                ui.label("or its path:");
                ui.text_edit_singleline(&mut self.open_path);
                if ui.button("Open path").clicked() {
                    actions.push(Action::Open(PathBuf::from(self.open_path.trim())));
                }
            });
            ui.add_space(16.0);
            ui.label("A new project is made by:  tiepoint new NAME.tiepoint --images FOLDER --camera camera.toml");
            ui.label("The box experiment is rendered and measured by:  tiepoint demo");
        });
    }
}

/// A project of images in the project file's own folder, named after it.
fn make_project(project: &Path, images: &[PathBuf]) -> Result<(), String> {
    let mut network = Network::default();
    crate::project::intake::add_images(&mut network, &folder_of(project), images).map_err(|e| e.to_string())?;
    Session::create(project, network).map(drop).map_err(|e| e.to_string())
}

impl eframe::App for App {
    fn logic(&mut self, context: &Context, _frame: &mut eframe::Frame) {
        self.pictures.poll();
        if let Some(session) = &mut self.session {
            let lines = self.runner.poll(session);
            self.say(lines);
        }
        if self.runner.is_running() {
            // Progress is state, not an event: it is looked at ten times a second.
            context.request_repaint_after(std::time::Duration::from_millis(100));
        }
        let answers: Vec<Action> = self.answers.try_iter().collect();
        for action in answers {
            self.apply(action, context);
        }
    }

    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        let context = ui.ctx().clone();
        let mut actions = Vec::new();
        egui::Panel::top("menu").show(ui, |ui| self.menu(ui, &mut actions));
        egui::Panel::bottom("status").show(ui, |ui| {
            ui.horizontal(|ui| {
                ui.label(&self.message);
                ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                    for status in self.panels.views.iter().flatten().filter_map(ImageView::status) {
                        ui.monospace(status);
                    }
                });
            });
        });
        egui::CentralPanel::default().show(ui, |ui| {
            if self.session.is_none() {
                self.empty_window(ui, &mut actions);
                return;
            }
            let network = self.session.as_ref().map_or(&self.empty, |session| session.network().as_ref());
            let titles: Vec<String> = self
                .session
                .as_ref()
                .map(|session| session.history().undo_titles().map(str::to_owned).collect())
                .unwrap_or_default();
            let mut draw = Draw {
                view: ViewContext {
                    network,
                    pictures: &self.pictures,
                    selection: &self.selection,
                    pending: self.runner.pending(),
                },
                runner: &self.runner,
                panels: &mut self.panels,
                titles: &titles,
                actions: &mut actions,
            };
            self.tree.ui(&mut draw, ui);
        });
        // Keys after the panels: a text field or a panel with the focus has taken its own by now.
        actions.extend(self.shortcuts(&context));
        for action in actions {
            self.apply(action, &context);
        }
    }
}

/// Draws the panes of the layout.
struct Draw<'a> {
    view: ViewContext<'a>,
    runner: &'a Runner,
    panels: &'a mut Panels,
    titles: &'a [String],
    actions: &'a mut Vec<Action>,
}

impl Behavior<Pane> for Draw<'_> {
    fn pane_ui(&mut self, ui: &mut egui::Ui, _tile: TileId, pane: &mut Pane) -> UiResponse {
        let (view, actions) = (&self.view, &mut *self.actions);
        match pane {
            Pane::Stages => self.panels.stages.ui(ui, view.network, self.runner, actions),
            Pane::Images => self.panels.images.ui(ui, view, actions),
            Pane::Image(place) => match self.panels.views.get_mut(*place).and_then(Option::as_mut) {
                Some(image) => image.ui(ui, view, actions),
                None => {
                    ui.centered_and_justified(|ui| ui.label("No image: choose one in the list."));
                }
            },
            Pane::Network => self.panels.network.ui(ui, view, actions),
            Pane::Inspector => self.panels.inspector.ui(ui, view, actions),
            Pane::Findings => self.panels.findings.ui(ui, view, actions),
            Pane::Review => self.panels.review.ui(ui, view, actions),
            Pane::Tables => self.panels.tables.ui(ui, view, actions),
            Pane::Plots => self.panels.plots.ui(ui, view, actions),
            Pane::Journal => self.panels.journal.ui(ui, self.titles),
        }
        UiResponse::None
    }

    fn tab_title_for_pane(&mut self, pane: &Pane) -> egui::WidgetText {
        match pane {
            Pane::Stages => "Stages".into(),
            Pane::Images => "Images".into(),
            Pane::Image(place) => match self.panels.views.get(*place).and_then(Option::as_ref) {
                Some(view) => {
                    let image = self.view.network.images.get(&view.image());
                    image.map_or_else(String::new, |i| i.file.path.rsplit('/').next().unwrap_or_default().to_owned()).into()
                }
                None => "Image".into(),
            },
            Pane::Network => "Network".into(),
            Pane::Inspector => "Inspector".into(),
            Pane::Findings => self.panels.findings.title(&self.view).into(),
            Pane::Review => "Review".into(),
            Pane::Tables => "Tables".into(),
            Pane::Plots => "Plots".into(),
            Pane::Journal => "History".into(),
        }
    }

    fn simplification_options(&self) -> SimplificationOptions {
        SimplificationOptions { all_panes_must_have_tabs: true, ..SimplificationOptions::default() }
    }
}
