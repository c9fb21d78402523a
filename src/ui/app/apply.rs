//! Actions: every way to change anything ends here.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use egui::{Context, Theme};

use super::banners::Seen;
use super::loader::{Loaded, Then};
use super::{App, Command, Document};
use crate::commands::DemoRequest;
use crate::network::Stage;
use crate::project::edit::Edit;
use crate::project::session::{Session, folder_of};
use crate::project::storage::StorageError;
use crate::ui::action::{Action, RunRequest, Selection};
use crate::ui::layout::first_layout;

/// Folder of the demo, beside where the program was started.
const DEMO_FOLDER: &str = "tiepoint-demo";

/// Factor of the size of everything that one press changes.
const ZOOM_STEP: f32 = 1.1;

impl App {
    /// Applies an action.
    pub fn apply(&mut self, action: Action, context: &Context) {
        match action {
            Action::Do(command) => self.command(command, context),
            Action::Open(path) => self.open(&path),
            Action::Dropped(paths) => self.loader.propose(paths),
            Action::Make(plan) => self.loader.make(*plan),
            Action::Chosen { form, path } => self.forms.chosen(form, &path),
            Action::SaveCopy(path) => self.save_copy(&path, context),
            Action::Say(line) => self.say(line),
            Action::Refuse(line) => self.refuse(line),
            Action::FindPictures(folder) => self.find_pictures(folder),
            Action::NameByList(list) => {
                if let Some(document) = &self.document {
                    let network = Arc::clone(document.session.network());
                    self.loader.name_by_list(network, list);
                }
            }
            Action::Run(request) => self.run(request),
            Action::Interrupt => self.interrupt(),
            Action::Edit(edit) => {
                if let Some(document) = &mut self.document
                    && let Some(line) = self.runner.edit(&mut document.session, edit)
                {
                    self.say(line);
                }
            }
            Action::Select(selection) => self.select(selection),
            Action::Group(points) => self.group = Arc::new(points),
            Action::LookAt(selection) => {
                self.look_at(&selection);
                self.select(selection);
            }
            Action::EditLabel(selection) => {
                self.type_ahead.wait_for_field();
                self.look_at(&selection);
                self.edit_label(&selection);
                self.select(selection);
            }
        }
        context.request_repaint();
    }

    fn select(&mut self, selection: Selection) {
        if self.selection != selection
            && selection.dot.is_none()
            && selection.point.is_none()
            && let Some(image) = selection.image
        {
            self.show_image(image);
        }
        self.selection = selection;
    }

    fn command(&mut self, command: Command, context: &Context) {
        if command.opens_a_field() {
            self.type_ahead.wait_for_field();
        }
        match command {
            Command::Step => self.run(RunRequest::Step),
            Command::RunStage => self.run(RunRequest::Stage),
            Command::RunAll => self.run(RunRequest::Until(Stage::Adjust)),
            Command::Interrupt => self.interrupt(),
            Command::Undo => self.undo(),
            Command::Redo => self.move_in_history(Session::redo, "Done again"),
            Command::New => self.forms.ask_new(),
            Command::Open => self.forms.ask_open(),
            Command::Demo => self.begin_demo(DemoRequest::usual(Path::new(DEMO_FOLDER))),
            Command::SaveCopy => {
                if let Some(document) = &self.document {
                    self.forms.ask_copy(&document.project);
                }
            }
            Command::FindPictures => self.forms.ask_pictures(),
            Command::NameByList => self.forms.ask_list(),
            Command::Close => self.close(),
            Command::Quit => context.send_viewport_cmd(egui::ViewportCommand::Close),
            Command::NextImage => self.turn_page(true),
            Command::PreviousImage => self.turn_page(false),
            Command::GoToSelection => self.look_at(&self.selection.clone()),
            Command::ImagePanels(count) => self.set_image_panels(count),
            Command::Show(pane) => self.show_pane(pane),
            Command::FirstLayout => self.tree = first_layout(self.panels.views.len()),
            Command::FitNetwork => self.panels.network.fit(),
            Command::Dark => context.set_theme(Theme::Dark),
            Command::Light => context.set_theme(Theme::Light),
            Command::Larger => context.set_zoom_factor(context.zoom_factor() * ZOOM_STEP),
            Command::Smaller => context.set_zoom_factor(context.zoom_factor() / ZOOM_STEP),
            Command::UsualSize => context.set_zoom_factor(1.0),
            Command::Palette => self.palette.open_commands(),
            Command::Keys => self.palette.open_keys(),
        }
    }

    /// Whether a command can do anything now.
    pub(super) fn can(&self, command: Command) -> bool {
        let history = self.session().map(Session::history);
        let open = self.document.is_some();
        match command {
            Command::Step | Command::RunStage | Command::RunAll => {
                open && !self.runner.is_running()
            }
            Command::Interrupt => !self.is_idle(),
            Command::Undo => {
                let waits = !self.runner.pending().is_empty();
                waits || history.is_some_and(|history| history.undo_title().is_some())
            }
            Command::Redo => history.is_some_and(|history| history.redo_title().is_some()),
            Command::SaveCopy
            | Command::FindPictures
            | Command::NameByList
            | Command::Close
            | Command::NextImage
            | Command::PreviousImage
            | Command::GoToSelection
            | Command::Show(_)
            | Command::FitNetwork => open,
            _ => true,
        }
    }

    fn run(&mut self, request: RunRequest) {
        if let Some(document) = &mut self.document {
            for line in self.runner.start(&mut document.session, request) {
                self.say(line);
            }
        }
    }

    fn interrupt(&mut self) {
        self.runner.interrupt();
        self.loader.interrupt();
    }

    /// Takes back the last edit that waits, else the last step or edit.
    fn undo(&mut self) {
        match self.runner.take_back_pending() {
            Some(edit) => {
                let line = format!(
                    "Taken back before it was made: {}.",
                    edit.title(self.network())
                );
                self.say(line);
            }
            None => self.move_in_history(Session::undo, "Taken back"),
        }
    }

    fn move_in_history(
        &mut self,
        go: impl FnOnce(&mut Session) -> Result<Option<String>, StorageError>,
        verb: &str,
    ) {
        if self.runner.is_running() {
            self.say("A step is under way: interrupt it first (Esc).");
            return;
        }
        let Some(document) = &mut self.document else {
            return;
        };
        let line = match go(&mut document.session) {
            Ok(Some(title)) => format!("{verb}: {title}."),
            Ok(None) => "There is nothing more in the history.".into(),
            Err(error) => error.to_string(),
        };
        self.say(line);
    }

    fn open(&mut self, path: &Path) {
        if self
            .document
            .as_ref()
            .is_some_and(|document| document.project == path)
        {
            self.say(format!("{} is open.", path.display()));
            return;
        }
        self.loader.open(path);
    }

    /// Renders the demo and measures it.
    pub(super) fn begin_demo(&mut self, request: DemoRequest) {
        // Its own file would be in use.
        self.close();
        self.loader.demo(request);
    }

    /// Lets the document go; a step under way is stopped, what is finished is in the file, and what the operator edited
    /// meanwhile or found again too.
    pub(super) fn close(&mut self) {
        self.clear_image_panels();
        self.panels.forget_drafts();
        self.missing.clear();
        let moves = self.moves.take();
        self.selection = Selection::default();
        self.group = Arc::default();
        if let Some(mut document) = self.document.take() {
            for line in self.runner.forget(&mut document.session) {
                self.say(line);
            }
            if let Some(moves) = moves
                && let Err(error) = document.session.move_pictures(&moves)
            {
                self.say(error.to_string());
            }
            self.loader.close(document.session);
            self.loader.recall();
        }
    }

    /// Writes a copy on the saving thread; its answer comes like that of a dialog.
    fn save_copy(&mut self, path: &Path, context: &Context) {
        let Some(document) = &self.document else {
            return;
        };
        let (ask, context, target) = (self.ask.clone(), context.clone(), path.to_owned());
        document.session.copy_request(path, move |copied| {
            let answer = match copied {
                Ok(()) => Action::Say(format!("A copy is at {}.", target.display())),
                Err(error) => Action::Refuse(error.to_string()),
            };
            if ask.send(answer).is_ok() {
                context.request_repaint();
            }
        });
    }

    fn find_pictures(&mut self, folder: PathBuf) {
        if let Some(document) = &self.document {
            let network = Arc::clone(document.session.network());
            self.loader
                .find_pictures(network, &document.project, folder);
        }
    }

    /// Takes over where pictures were found; between two steps, as every edit.
    pub(super) fn move_pictures(&mut self) {
        if self.runner.is_running() {
            return;
        }
        let (Some(document), Some(moves)) = (&mut self.document, self.moves.take()) else {
            return;
        };
        let line = match document.session.move_pictures(&moves) {
            Ok(counts) => {
                self.missing.retain(|id| !moves.found.contains_key(id));
                self.pictures.set_folder(&folder_of(&document.project));
                format!("{counts}.")
            }
            Err(error) => error.to_string(),
        };
        self.say(line);
    }

    /// Takes over what the loader finished.
    pub(super) fn take_loaded(&mut self, context: &Context) {
        while let Some(answer) = self.loader.poll() {
            match answer {
                Err(line) => self.refuse(line),
                Ok(Loaded::Line(line)) if line.is_empty() => {}
                Ok(Loaded::Line(line)) => self.say(line),
                Ok(Loaded::Recent(projects)) => self.start.recent = projects,
                Ok(Loaded::Moves(moves)) => self.moves = Some(moves),
                Ok(Loaded::Names { names, line, text }) => {
                    if !names.is_empty() {
                        self.apply(Action::Edit(Edit::NameTargets { names }), context);
                    }
                    self.say(line);
                    self.forms.tell("Names by a list", text);
                }
                Ok(Loaded::Proposal(proposal)) => {
                    if let Some(action) = self.forms.take(proposal) {
                        self.apply(action, context);
                    }
                }
                Ok(Loaded::Project {
                    session,
                    path,
                    missing,
                    then,
                }) => {
                    self.adopt(*session, path, context);
                    self.missing = missing;
                    if then == Then::Measure {
                        self.run_all(context);
                    }
                }
            }
            context.request_repaint();
        }
    }

    /// Makes a session the document of the window.
    fn adopt(&mut self, mut session: Session, path: PathBuf, context: &Context) {
        self.close();
        self.forms.close();
        self.seen = Seen::default();
        let waking = context.clone();
        session.on_saved(move || waking.request_repaint());
        let mut lines = session.warnings().to_vec();
        lines.push(format!("{} is open.", path.display()));
        self.pictures.set_folder(&folder_of(&path));
        self.document = Some(Document {
            session,
            project: path,
        });
        self.fill_image_panels();
        self.panels.network.fit();
        for line in lines {
            self.say(line);
        }
    }
}
