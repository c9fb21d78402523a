//! Findings: sentences with a link to what they are about.

use egui::{Align, Layout, TextStyle, TextWrapMode, Ui};
use egui_extras::{Column, TableBuilder};

use super::facts::{mark, select_image, select_point};
use crate::network::{About, Finding, FindingKind, Network};
use crate::ui::action::{Action, Selection};
use crate::ui::context::ViewContext;
use crate::ui::theme;

/// The list of findings.
#[derive(Default)]
pub struct Findings {
    filter: String,
}

impl Findings {
    /// The title of its tab, with their number.
    #[must_use]
    pub fn title(&self, context: &ViewContext<'_>) -> String {
        match context.network.findings.len() {
            0 => "Findings".into(),
            count => format!("Findings {count}"),
        }
    }

    /// Draws it.
    pub fn ui(&mut self, ui: &mut Ui, context: &ViewContext<'_>, actions: &mut Vec<Action>) {
        if context.network.findings.is_empty() {
            ui.weak("No findings. What the stages doubt will stand here.");
            return;
        }
        ui.horizontal(|ui| {
            let label = ui.label("Filter findings");
            ui.text_edit_singleline(&mut self.filter)
                .labelled_by(label.id);
        });
        let shown = newest_first(context.network, &self.filter);
        let height = ui.text_style_height(&TextStyle::Body) + 4.0;
        ui.style_mut().wrap_mode = Some(TextWrapMode::Truncate);
        TableBuilder::new(ui)
            .striped(true)
            .auto_shrink(false)
            .cell_layout(Layout::left_to_right(Align::Center))
            .column(Column::exact(14.0))
            .column(Column::initial(90.0))
            .column(Column::remainder().clip(true))
            .body(|body| {
                body.rows(height, shown.len(), |mut row| {
                    let finding = shown[row.index()];
                    row.col(|ui| mark(ui, Some(colour(finding.kind))));
                    row.col(|ui| {
                        ui.weak(finding.stage.to_string());
                    });
                    row.col(|ui| sentence(ui, finding, actions));
                });
            });
    }
}

fn sentence(ui: &mut Ui, finding: &Finding, actions: &mut Vec<Action>) {
    let Some(target) = target(&finding.about) else {
        ui.label(&finding.text).on_hover_text(&finding.text);
        return;
    };
    if ui
        .link(&finding.text)
        .on_hover_text(&finding.text)
        .clicked()
    {
        actions.push(Action::LookAt(target));
    }
}

/// What a finding leads to; `None` for what has no place in a view.
fn target(about: &About) -> Option<Selection> {
    match about {
        About::Image(id) => Some(select_image(*id)),
        About::Point(id) => Some(select_point(*id)),
        About::Project | About::Bar(_) | About::Camera(_) => None,
    }
}

fn colour(kind: FindingKind) -> egui::Color32 {
    match kind {
        FindingKind::UnreadableImage | FindingKind::StageFailed => theme::REJECTED,
        FindingKind::RejectedObservation => theme::REJECTED,
        _ => theme::DOUBTFUL,
    }
}

/// The findings that hold the text, those of the last stage first, each stage's in their order.
fn newest_first<'a>(network: &'a Network, filter: &str) -> Vec<&'a Finding> {
    let filter = filter.trim().to_lowercase();
    let mut shown: Vec<&Finding> = network
        .findings
        .iter()
        .filter(|f| filter.is_empty() || f.text.to_lowercase().contains(&filter))
        .collect();
    shown.sort_by_key(|f| std::cmp::Reverse(f.stage));
    shown
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{ImageId, Stage};
    use crate::ui::panels::fixture::{Bench, network};
    use egui_kittest::kittest::Queryable as _;

    #[test]
    fn the_last_stage_comes_first_and_the_filter_holds() {
        let network = network();
        let stages: Vec<Stage> = newest_first(&network, "").iter().map(|f| f.stage).collect();
        assert_eq!(stages, [Stage::Adjust, Stage::Connect, Stage::Detect]);
        assert_eq!(newest_first(&network, "TOO FEW").len(), 1);
    }

    #[test]
    fn a_click_leads_to_the_image() {
        let mut panel = Findings::default();
        let mut bench = Bench::new(network(), move |ui, context, actions| {
            assert_eq!(panel.title(context), "Findings 3");
            panel.ui(ui, context, actions);
        });
        bench
            .harness
            .get_by_label("img_2.png: too few codes")
            .click();
        let expected = Action::LookAt(select_image(ImageId(2)));
        assert_eq!(bench.actions(), [expected]);
    }
}
