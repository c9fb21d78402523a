//! Forms that ask for paths: no frame waits for them, and every one has a field to type into, because the dialogs of a
//! system may be missing.

use std::path::{Path, PathBuf};

use egui::{Align2, Context, TextEdit, Ui, Window, vec2};

use super::App;
use super::loader::Loader;
use crate::ui::action::Action;
use crate::worker::apart;

/// What is asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Form {
    Open,
    Copy,
    Pictures,
}

/// The open form.
#[derive(Default)]
pub(super) struct Forms {
    open: Option<Form>,
    path: String,
}

impl Forms {
    pub(super) fn is_open(&self) -> bool {
        self.open.is_some()
    }

    pub(super) fn close(&mut self) {
        self.open = None;
    }

    pub(super) fn ask_new(&mut self) {}

    pub(super) fn ask_open(&mut self) {
        self.ask(Form::Open, String::new());
    }

    pub(super) fn ask_copy(&mut self, project: &Path) {
        let copy = project.with_file_name("copy.tiepoint");
        self.ask(Form::Copy, copy.display().to_string());
    }

    pub(super) fn ask_pictures(&mut self) {
        self.ask(Form::Pictures, String::new());
    }

    fn ask(&mut self, form: Form, path: String) {
        *self = Self { open: Some(form), path };
    }

    pub(super) fn chosen(&mut self, path: PathBuf) {
        self.path = path.display().to_string();
    }

    pub(super) fn dropped(&mut self, _loader: &mut Loader, _paths: Vec<PathBuf>) {}
}

impl App {
    pub(super) fn find_pictures(&mut self, _folder: PathBuf) {}

    pub(super) fn forms_window(&mut self, context: &Context, actions: &mut Vec<Action>) {
        let Some(form) = self.forms.open.clone() else { return };
        let (title, button) = match form {
            Form::Open => ("Open a project", "Open"),
            Form::Copy => ("Save a copy", "Save"),
            Form::Pictures => ("Find pictures", "Look there"),
        };
        let mut answered = None;
        Window::new(title)
            .anchor(Align2::CENTER_CENTER, vec2(0.0, 0.0))
            .collapsible(false)
            .show(context, |ui| answered = self.path_field(ui, &form, button));
        if let Some(path) = answered {
            self.forms.close();
            actions.push(match form {
                Form::Open => Action::Open(path),
                Form::Copy => Action::SaveCopy(path),
                Form::Pictures => Action::FindPictures(path),
            });
        }
    }

    fn path_field(&mut self, ui: &mut Ui, form: &Form, button: &str) -> Option<PathBuf> {
        let label = ui.label("Path");
        let field = ui.add(TextEdit::singleline(&mut self.forms.path).desired_width(420.0)).labelled_by(label.id);
        let entered = field.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
        ui.horizontal(|ui| {
            if ui.button("Browse ...").clicked() {
                self.browse(form, ui.ctx());
            }
            let clicked = ui.button(button).clicked();
            if ui.button("Cancel").clicked() {
                self.forms.close();
            }
            let path = self.forms.path.trim();
            ((clicked || entered) && !path.is_empty()).then(|| PathBuf::from(path))
        })
        .inner
    }

    /// Asks by a dialog of the system, on a thread of its own: dialogs may wait, frames may not.
    fn browse(&mut self, form: &Form, context: &Context) {
        let (ask, context, form) = (self.ask.clone(), context.clone(), form.clone());
        let asked = apart("dialog", move || {
            let dialog = rfd::FileDialog::new();
            let chosen = match form {
                Form::Open => dialog.add_filter("Tiepoint project", &["tiepoint"]).pick_file(),
                Form::Copy => dialog.set_file_name("copy.tiepoint").save_file(),
                Form::Pictures => dialog.pick_folder(),
            };
            if let Some(path) = chosen
                && ask.send(Action::Chosen(path)).is_ok()
            {
                context.request_repaint();
            }
        });
        if let Err(error) = asked {
            self.say(format!("The dialog could not be opened: {error}; type the path instead."));
        }
    }
}
