//! The window without a project: what can be done first.

use egui::Ui;

use super::App;
use crate::ui::action::Action;
use crate::ui::app::Command;

/// The start page's state.
#[derive(Default)]
pub(super) struct Start {
    /// Projects that were open before, newest first.
    pub(super) recent: Vec<std::path::PathBuf>,
}

impl App {
    pub(super) fn start_page(&mut self, ui: &mut Ui, actions: &mut Vec<Action>) {
        ui.vertical_centered(|ui| {
            ui.add_space(80.0);
            ui.heading("Tiepoint");
            ui.label(
                "From photographs of coded and plain targets to coordinates with true sigmas.",
            );
            ui.add_space(16.0);
            for (command, hint) in [
                (
                    Command::New,
                    "from a folder of images; or drop the folder on this window",
                ),
                (Command::Open, "a project file (.tiepoint)"),
                (
                    Command::Demo,
                    "renders a box with targets and measures it before your eyes",
                ),
            ] {
                if ui.button(command.title()).clicked() {
                    actions.push(Action::Do(command));
                }
                ui.weak(hint);
                ui.add_space(8.0);
            }
            if !self.start.recent.is_empty() {
                ui.add_space(16.0);
                ui.strong("Recent projects");
                for path in &self.start.recent {
                    if ui.link(path.display().to_string()).clicked() {
                        actions.push(Action::Open(path.clone()));
                    }
                }
            }
        });
    }
}
