//! The bar above: menus, the four buttons that run stages, and the figures that the operator always sees; and the line
//! below.

use egui::{Button, KeyboardShortcut, Ui};

use super::catalogue::Menu;
use super::{App, Command};
use crate::project::session::{Saving, Session};
use crate::ui::action::Action;
use crate::ui::image_view::ImageView;
use crate::ui::theme;

impl App {
    pub(super) fn menu(&mut self, ui: &mut Ui, actions: &mut Vec<Action>) {
        egui::MenuBar::new().ui(ui, |ui| {
            ui.menu_button("File", |ui| {
                for command in Command::of_menu(Menu::File) {
                    self.item(ui, command, actions);
                }
            });
            ui.menu_button("Edit", |ui| {
                let history = self.session().map(Session::history);
                let undo = history.and_then(|history| history.undo_title());
                let redo = history.and_then(|history| history.redo_title());
                let title = |verb: &str, what: Option<&str>| match what {
                    Some(what) => format!("{verb}: {what}"),
                    None => verb.to_owned(),
                };
                self.item_named(ui, Command::Undo, &title("Undo", undo), actions);
                self.item_named(ui, Command::Redo, &title("Redo", redo), actions);
                ui.separator();
                self.item(ui, Command::NameByList, actions);
            });
            ui.menu_button("View", |ui| {
                for command in Command::of_menu(Menu::View) {
                    self.item(ui, command, actions);
                }
                ui.separator();
                for command in Command::of_menu(Menu::Panels) {
                    self.item(ui, command, actions);
                }
            });
            ui.menu_button("Help", |ui| {
                for command in Command::of_menu(Menu::Help) {
                    self.item(ui, command, actions);
                }
            });
            ui.separator();
            for command in Command::of_menu(Menu::Bar) {
                let button = ui.add_enabled(self.can(command), Button::new(command.title()));
                let hint = command
                    .shortcut()
                    .map_or_else(String::new, |keys| ui.ctx().format_shortcut(&keys));
                if button.on_hover_text(hint).clicked() {
                    actions.push(Action::Do(command));
                }
            }
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                ui.label(self.summary());
            });
        });
    }

    fn item(&self, ui: &mut Ui, command: Command, actions: &mut Vec<Action>) {
        self.item_named(ui, command, command.title(), actions);
    }

    fn item_named(&self, ui: &mut Ui, command: Command, name: &str, actions: &mut Vec<Action>) {
        let keys = |keys: KeyboardShortcut| ui.ctx().format_shortcut(&keys);
        let keys = command.shortcut().map_or_else(String::new, keys);
        let button = Button::new(name).shortcut_text(keys);
        if ui.add_enabled(self.can(command), button).clicked() {
            actions.push(Action::Do(command));
            ui.close();
        }
    }

    /// Figures that the operator always sees.
    fn summary(&self) -> String {
        if self.document.is_none() {
            return String::new();
        }
        let network = self.network();
        let oriented = network.oriented_images().count();
        let images = network.used_images().count();
        let sigma0 = network
            .adjustment
            .as_ref()
            .map_or_else(String::new, |adjustment| {
                let age = if network.adjustment_is_fresh() {
                    ""
                } else {
                    " before your last edits"
                };
                format!(
                    "sigma0 {:.3} ({:.4} px){age}   ",
                    adjustment.sigma0, adjustment.sigma0_px
                )
            });
        format!(
            "{sigma0}{oriented}/{images} images   {} points",
            network.points.len()
        )
    }

    /// The line below: what happened last, and what is under the pointer.
    pub(super) fn status(&mut self, ui: &mut Ui, actions: &mut Vec<Action>) {
        ui.horizontal(|ui| {
            let earlier: Vec<&str> = self
                .messages
                .iter()
                .rev()
                .take(12)
                .map(String::as_str)
                .collect();
            if let Some((title, progress)) = self.loader.progress() {
                ui.spinner();
                // Before the text, which grows as it counts: a button that moves away is missed.
                if ui.button("Stop").clicked() {
                    actions.push(Action::Interrupt);
                }
                let counted = if progress.total > 0 {
                    format!("{title}: {} of {}", progress.done, progress.total)
                } else {
                    title.to_owned()
                };
                ui.label(counted);
            } else {
                ui.label(self.message()).on_hover_text(earlier.join("\n"));
            }
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                match self.not_saved() {
                    Some(NotSaved::Soon(line)) => {
                        ui.weak(line);
                    }
                    Some(NotSaved::Not(line)) => {
                        ui.colored_label(theme::REJECTED, line);
                    }
                    None => {}
                }
                for status in self
                    .panels
                    .views
                    .iter()
                    .flatten()
                    .filter_map(ImageView::status)
                {
                    ui.monospace(status);
                }
            });
        });
    }

    /// Why the newest state is not on the disk, where it is not.
    fn not_saved(&self) -> Option<NotSaved> {
        let session = self.session()?;
        if !session.is_writable() {
            let line = "open for reading only: changes are not saved";
            return Some(NotSaved::Not(line.to_owned()));
        }
        match session.saving() {
            Saving::Saved => None,
            Saving::Behind { steps } => Some(NotSaved::Soon(format!("saving {steps}"))),
            Saving::Failed(reason) => Some(NotSaved::Not(format!("not saved: {reason}"))),
        }
    }
}

/// Why the newest state is not on the disk.
enum NotSaved {
    /// It is being written: no reason to worry.
    Soon(String),
    /// It cannot be written.
    Not(String),
}
