//! The title of the window: which project, how far it is, and how much of it is on the disk; read in the list of windows
//! while another is in front.

use egui::{Context, ViewportCommand};

use super::App;
use crate::network::{Network, Stage};
use crate::project::session::Saving;

/// The title that was shown last.
#[derive(Default)]
pub(super) struct Title(String);

impl App {
    /// Shows the title where it is another than before.
    pub(super) fn show_title(&mut self, context: &Context) {
        let title = self.window_title();
        if title != self.title.0 {
            context.send_viewport_cmd(ViewportCommand::Title(title.clone()));
            self.title.0 = title;
        }
    }

    /// What the window's frame says.
    #[must_use]
    pub fn window_title(&self) -> String {
        let Some(document) = &self.document else {
            return "Tiepoint".into();
        };
        let name = document
            .project
            .file_name()
            .unwrap_or(document.project.as_os_str());
        let network = self.network();
        let oriented = network.oriented_images().count();
        let images = network.used_images().count();
        let doing = match self.runner.progress() {
            Some((stage, _, _)) if self.runner.is_stopping() => format!("{stage} stopping"),
            Some((stage, _, _)) => format!("{stage} running"),
            None => last_stage(network),
        };
        let saved = match document.session.saving() {
            Saving::Failed(_) => "NOT SAVED".into(),
            Saving::Saved | Saving::Behind { .. } => {
                format!("{} saved", document.session.changes_saved())
            }
        };
        format!(
            "{} - {oriented}/{images} images - {doing} - {saved} - Tiepoint",
            name.display()
        )
    }
}

/// The last stage that stands on the present inputs, and how it ended.
fn last_stage(network: &Network) -> String {
    let ended = |stage: &Stage| {
        network
            .is_concluded(*stage)
            .then(|| network.conclusions.get(stage))
            .flatten()
    };
    let last = Stage::ALL
        .iter()
        .rev()
        .find_map(|stage| Some((stage, ended(stage)?.outcome)));
    match last {
        None if network.conclusions.is_empty() => "not measured".into(),
        None => "edited".into(),
        Some((stage, outcome)) => format!("{stage} {outcome}"),
    }
}
