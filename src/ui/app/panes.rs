//! The panes of the layout: which panel is drawn where.

use egui_tiles::{Behavior, SimplificationOptions, TileId, UiResponse};

use super::{App, Panels};
use crate::project::storage::JournalEntry;
use crate::ui::action::Action;
use crate::ui::context::ViewContext;
use crate::ui::layout::Pane;
use crate::ui::runner::Runner;

/// Space round the text of a pane, points.
const TEXT_MARGIN: i8 = 5;

impl App {
    /// Draws the panels of the open project.
    pub(super) fn panes(&mut self, ui: &mut egui::Ui, actions: &mut Vec<Action>) {
        let Some(document) = &self.document else {
            return;
        };
        let mut titles: Vec<String> = document
            .session
            .history()
            .undo_titles()
            .map(str::to_owned)
            .collect();
        // The history tells the latest first.
        titles.reverse();
        let mut draw = Draw {
            view: ViewContext {
                network: document.session.network(),
                pictures: &self.pictures,
                selection: &self.selection,
                group: &self.group,
                pending: self.runner.pending(),
            },
            titles: &titles,
            earlier: document.session.earlier(),
            runner: &self.runner,
            panels: &mut self.panels,
            actions,
        };
        self.tree.ui(&mut draw, ui);
    }
}

/// Draws the panes of the layout.
struct Draw<'a> {
    view: ViewContext<'a>,
    runner: &'a Runner,
    panels: &'a mut Panels,
    titles: &'a [String],
    earlier: &'a [JournalEntry],
    actions: &'a mut Vec<Action>,
}

impl Draw<'_> {
    fn image(&mut self, ui: &mut egui::Ui, place: usize) {
        match self.panels.views.get_mut(place).and_then(Option::as_mut) {
            Some(image) => image.ui(ui, &self.view, self.actions),
            None => {
                ui.centered_and_justified(|ui| ui.label("No image: choose one in the list."));
            }
        }
    }

    fn text(&mut self, ui: &mut egui::Ui, pane: Pane) {
        let (view, actions, panels) = (&self.view, &mut *self.actions, &mut *self.panels);
        match pane {
            Pane::Stages => panels.stages.ui(ui, view, self.runner, actions),
            Pane::Images => panels.images.ui(ui, view, actions),
            Pane::Inspector => panels.inspector.ui(ui, view, actions),
            Pane::Frame => panels.frame.ui(ui, view, actions),
            Pane::Image(_) | Pane::Network => {}
            Pane::Findings => panels.findings.ui(ui, view, actions),
            Pane::Review => panels.review.ui(ui, view, actions),
            Pane::Tables => panels.tables.ui(ui, view, actions),
            Pane::Plots => panels.plots.ui(ui, view, actions),
            Pane::Journal => panels.journal.ui(ui, self.titles, self.earlier),
        }
    }

    fn image_title(&self, place: usize) -> String {
        let view = self.panels.views.get(place).and_then(Option::as_ref);
        let image = view.and_then(|view| self.view.network.images.get(&view.image));
        image.map_or_else(
            || "Image".into(),
            |image| {
                let path = &image.file.path;
                path.rsplit('/').next().unwrap_or(path).to_owned()
            },
        )
    }
}

impl Behavior<Pane> for Draw<'_> {
    fn pane_ui(&mut self, ui: &mut egui::Ui, _tile: TileId, pane: &mut Pane) -> UiResponse {
        match pane {
            Pane::Image(place) => self.image(ui, *place),
            Pane::Network => self.panels.network.ui(ui, &self.view, self.actions),
            // Pictures take the whole pane, text keeps off its edge.
            text => {
                egui::Frame::new()
                    .inner_margin(TEXT_MARGIN)
                    .show(ui, |ui| self.text(ui, *text));
            }
        }
        UiResponse::None
    }

    fn tab_title_for_pane(&mut self, pane: &Pane) -> egui::WidgetText {
        match pane {
            Pane::Image(place) => self.image_title(*place),
            Pane::Findings => self.panels.findings.title(&self.view),
            Pane::Review => self.panels.review.title(),
            other => other.title().to_owned(),
        }
        .into()
    }

    fn simplification_options(&self) -> SimplificationOptions {
        SimplificationOptions {
            all_panes_must_have_tabs: true,
            ..SimplificationOptions::default()
        }
    }
}
