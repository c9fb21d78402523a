//! What stands above the panels until it is better or the operator has seen it: a fault of this program, a project that
//! cannot be saved, pictures that are not at their place.

use egui::{Color32, Response, Ui};

use super::{App, Command};
use crate::project::session::{Saving, Session};
use crate::ui::action::Action;
use crate::ui::panels::mark;
use crate::ui::theme;

/// What the operator has seen already.
#[derive(Default)]
pub(super) struct Seen {
    /// Why saving failed when the banner was dismissed.
    not_saved: Option<String>,
    /// Whether the banner on why the project is open for reading only was dismissed.
    reading_only: Answer,
    /// What could not be done last, until it is dismissed or a project opens.
    refused: Option<String>,
}

/// Whether a banner was dismissed.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
enum Answer {
    #[default]
    Stands,
    Dismissed,
}

impl App {
    /// Draws those there are reasons for.
    pub(super) fn banners(&mut self, ui: &mut Ui, actions: &mut Vec<Action>) {
        self.fault_banner(ui);
        self.refusal_banner(ui);
        self.reading_banner(ui, actions);
        self.saving_banner(ui, actions);
        self.missing_banner(ui, actions);
    }

    /// Something could not be done: told in the status line, and above until the operator has seen it.
    pub(super) fn refuse(&mut self, line: String) {
        self.say(line.clone());
        self.seen.refused = Some(line);
    }

    /// Says what could not be done.
    fn refusal_banner(&mut self, ui: &mut Ui) {
        let Some(line) = &self.seen.refused else {
            return;
        };
        let text = format!("Not done: {line}");
        egui::Panel::top("refused").show(ui, |ui| {
            ui.horizontal_wrapped(|ui| {
                banner_text(ui, theme::DOUBTFUL, text);
                if ui.button("Dismiss").clicked() {
                    self.seen.refused = None;
                }
            });
        });
    }

    /// Says why the project is open for reading only, and what of it could not be read.
    fn reading_banner(&mut self, ui: &mut Ui, actions: &mut Vec<Action>) {
        let warnings = self.session().map_or(&[][..], Session::warnings);
        let Some((first, more)) = warnings.split_first() else {
            return;
        };
        if self.seen.reading_only == Answer::Dismissed {
            return;
        }
        let text = match more.len() {
            0 => format!("The project is {first}."),
            1 => format!("The project is {first}: {}.", more[0]),
            count => format!(
                "The project is {first}: {}, and {} more.",
                more[0],
                count - 1
            ),
        };
        let all = warnings.join("\n");
        egui::Panel::top("reading only").show(ui, |ui| {
            ui.horizontal_wrapped(|ui| {
                banner_text(ui, theme::DOUBTFUL, text).on_hover_text(all);
                if ui.button(Command::SaveCopy.title()).clicked() {
                    actions.push(Action::Do(Command::SaveCopy));
                }
                if ui.button("Dismiss").clicked() {
                    self.seen.reading_only = Answer::Dismissed;
                }
            });
        });
    }

    /// Says that a step ended by our fault, and that the document stands.
    fn fault_banner(&mut self, ui: &mut Ui) {
        let Some(fault) = self.runner.fault() else {
            return;
        };
        let text = fault.to_string();
        egui::Panel::top("fault").show(ui, |ui| {
            ui.horizontal_wrapped(|ui| {
                banner_text(ui, theme::REJECTED, text);
                if ui.button("Dismiss").clicked() {
                    self.runner.dismiss_fault();
                }
            });
        });
    }

    /// Says that what was done is not on the disk, why, and what helps.
    fn saving_banner(&mut self, ui: &mut Ui, actions: &mut Vec<Action>) {
        let session = self.session().filter(|session| session.is_writable());
        let Some(Saving::Failed(reason)) = session.map(Session::saving) else {
            self.seen.not_saved = None;
            return;
        };
        if self.seen.not_saved.as_ref() == Some(&reason) {
            return;
        }
        egui::Panel::top("not saved").show(ui, |ui| {
            ui.horizontal_wrapped(|ui| {
                let text = format!(
                    "The project could not be saved: {reason}. What you did stands in this window, and saving is tried \
                     again; a copy in another place makes it safe."
                );
                banner_text(ui, theme::REJECTED, text);
                if ui.button(Command::SaveCopy.title()).clicked() {
                    actions.push(Action::Do(Command::SaveCopy));
                }
                if ui.button("Dismiss").clicked() {
                    self.seen.not_saved = Some(reason);
                }
            });
        });
    }

    /// Says that pictures are missing, and what helps.
    fn missing_banner(&self, ui: &mut Ui, actions: &mut Vec<Action>) {
        if self.missing.is_empty() {
            return;
        }
        egui::Panel::top("missing pictures").show(ui, |ui| {
            ui.horizontal(|ui| {
                let text = match self.missing.len() {
                    1 => "1 picture is not at its place; all that was measured in it stands.".to_owned(),
                    count => format!("{count} pictures are not at their place; all that was measured in them stands."),
                };
                let paths = self.missing.iter().filter_map(|id| self.network().images.get(id));
                let paths: Vec<&str> = paths.map(|image| image.file.path.as_str()).take(20).collect();
                banner_text(ui, theme::DOUBTFUL, text).on_hover_text(paths.join("\n"));
                if ui.button("Find folder ...").clicked() {
                    actions.push(Action::Do(Command::FindPictures));
                }
            });
        });
    }
}

/// The text of a banner: colour on the sign before it, so that the text stays legible in both themes.
fn banner_text(ui: &mut Ui, colour: Color32, text: String) -> Response {
    mark(ui, Some(colour));
    ui.label(text)
}
