//! The stage panel: six stages, what each needs, its settings with units and reasons; step, run, interrupt, progress.

use egui::{Align, Button, CollapsingHeader, DragValue, ProgressBar, RichText, ScrollArea, Ui};

use super::facts::mark;
use crate::network::{
    DevicePose, GrossErrors, IdentificationRule, MeasurementSettings, Network, Outcome, Stage,
};
use crate::project::edit::Edit;
use crate::targets::Family;
use crate::ui::action::{Action, RunRequest};
use crate::ui::context::ViewContext;
use crate::ui::runner::Runner;
use crate::ui::theme;

/// The stage panel.
#[derive(Default)]
pub struct StagesPanel {
    /// Settings that are being changed and not yet applied.
    draft: Option<MeasurementSettings>,
}

impl StagesPanel {
    /// Draws the panel and asks for what was clicked.
    pub fn ui(
        &mut self,
        ui: &mut Ui,
        context: &ViewContext<'_>,
        runner: &Runner,
        actions: &mut Vec<Action>,
    ) {
        ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            progress(ui, context.network, runner);
            if !context.pending.is_empty() {
                let text = match context.pending.len() {
                    1 => "1 edit waits for the end of this step".to_owned(),
                    count => format!("{count} edits wait for the end of this step"),
                };
                let titles: Vec<String> = context
                    .pending
                    .iter()
                    .map(|edit| edit.title(context.network))
                    .collect();
                ui.colored_label(theme::DOUBTFUL, text)
                    .on_hover_text(titles.join("\n"));
            }
            for stage in Stage::ALL {
                stage_row(ui, context.network, stage, runner, actions);
            }
            ui.separator();
            let settings = CollapsingHeader::new("Settings")
                .show(ui, |ui| self.settings(ui, context.network, actions));
            if settings.header_response.clicked() {
                // The panel is low: what was opened comes into sight.
                settings.header_response.scroll_to_me(Some(Align::TOP));
            }
        });
    }

    fn settings(&mut self, ui: &mut Ui, network: &Network, actions: &mut Vec<Action>) {
        let present = network.settings.as_ref();
        let draft = self.draft.get_or_insert_with(|| present.clone());
        heading(ui, Stage::Detect);
        ui.label("Codes to look for");
        ui.horizontal_wrapped(|ui| {
            for family in Family::ALL {
                let mut sought = draft.families.contains(&family);
                if ui.checkbox(&mut sought, family.to_string()).changed() {
                    draft.families.retain(|other| *other != family);
                    if sought {
                        draft.families.push(family);
                        draft.families.sort_unstable();
                    }
                }
            }
        })
        .response
        .on_hover_text(
            "Another choice detects all images again: labels given by hand go with their dots.",
        );
        number(
            ui,
            "Diameter of plain targets",
            "Their size tells them from other light, and carries their eccentricity.",
            DragValue::new(&mut draft.targets.plain_dot_mm)
                .range(0.1..=200.0)
                .speed(0.05)
                .suffix(" mm"),
        );
        number(
            ui,
            "Images in one step",
            "More are quicker on many cores, fewer answer an interrupt with less to do again.",
            DragValue::new(&mut draft.detection_batch)
                .range(1..=64)
                .speed(1.0),
        );
        heading(ui, Stage::FirstPair);
        ui.horizontal_wrapped(|ui| {
            ui.label("Pose from the cross").on_hover_text(
                "By the nominal principal distance is more exact; the DLT (Hattori et al., 2002) needs none, but two raised dots.",
            );
            let present = &mut draft.device_pose;
            ui.radio_value(present, DevicePose::Nominal, "nominal c");
            ui.radio_value(present, DevicePose::Dlt, "DLT");
        });
        heading(ui, Stage::Identify);
        number(
            ui,
            "Fewest rays of a target",
            "Two rays always nearly meet somewhere; three that meet are no accident.",
            DragValue::new(&mut draft.min_rays).range(3..=20).speed(1.0),
        );
        ui.label("Rays belong together").on_hover_text(
            "By how exactly each is known and what chance would do; or by one threshold for all (Hattori et al., 2002), which names less.",
        );
        ui.horizontal_wrapped(|ui| {
            let present = &mut draft.identification;
            ui.radio_value(present, IdentificationRule::Statistics, "by statistics");
            ui.radio_value(present, IdentificationRule::Paper, "by threshold");
        });
        heading(ui, Stage::Adjust);
        number(
            ui,
            "Rejection limit |w|",
            "Normalised residual (Baarda) above which an observation is a gross error; 4.0 rejects one good one in 16,000.",
            DragValue::new(&mut draft.critical_w)
                .range(2.5..=10.0)
                .speed(0.02)
                .suffix(" sigma"),
        );
        ui.horizontal_wrapped(|ui| {
            ui.label("Gross errors").on_hover_text(
                "What another program has left in its network may all be kept; nothing is rejected then.",
            );
            let present = &mut draft.gross_errors;
            ui.radio_value(present, GrossErrors::Reject, "reject");
            ui.radio_value(present, GrossErrors::Keep, "keep");
        });
        number(
            ui,
            "Seed of random samples",
            "The same seed gives the same digits.",
            DragValue::new(&mut draft.seed).speed(1.0),
        );
        let changed = draft != present;
        let looks = !draft.families.is_empty();
        ui.horizontal(|ui| {
            if ui
                .add_enabled(changed && looks, Button::new("Apply settings"))
                .clicked()
            {
                actions.push(Action::Edit(Edit::Settings(Box::new(draft.clone()))));
            }
            if ui.add_enabled(changed, Button::new("Discard")).clicked() {
                *draft = present.clone();
            }
        });
        if !looks {
            ui.weak("Codes of one family at least have to be looked for.");
        }
        if !changed {
            self.draft = None;
        }
    }
}

fn heading(ui: &mut Ui, stage: Stage) {
    ui.add_space(4.0);
    ui.weak(title(stage));
}

fn number(ui: &mut Ui, name: &str, reason: &str, field: DragValue<'_>) {
    ui.horizontal(|ui| {
        let label = ui.label(name).on_hover_text(reason);
        ui.add(field).labelled_by(label.id).on_hover_text(reason);
    });
}

fn progress(ui: &mut Ui, network: &Network, runner: &Runner) {
    let Some((stage, step, progress)) = runner.progress() else {
        return;
    };
    let what = if runner.is_stopping() {
        "stopping"
    } else {
        step
    };
    ui.label(format!("{}: {what}", title(stage)));
    let (done, total, title) = match progress.total {
        // Images are connected one by one, each a step of its own.
        0 if stage == Stage::Connect => (
            network.oriented_images().count() as u64,
            network.used_images().count() as u64,
            "connecting images".to_owned(),
        ),
        total => (progress.done, total, progress.title),
    };
    let share = done as f32 / total.max(1) as f32;
    let text = match total.saturating_sub(done) {
        left if total > 0 => format!("{title} ({left} left)"),
        _ => title,
    };
    ui.add(ProgressBar::new(share).text(text));
}

fn stage_row(
    ui: &mut Ui,
    network: &Network,
    stage: Stage,
    runner: &Runner,
    actions: &mut Vec<Action>,
) {
    let now = runner
        .progress()
        .is_some_and(|(running, ..)| running == stage);
    let arrow = if now { ">" } else { " " };
    ui.horizontal(|ui| {
        ui.monospace(arrow);
        let label = ui.add_enabled(!runner.is_running(), Button::new(title(stage)).frame(false));
        let needs = stage
            .missing(network)
            .map_or_else(String::new, |missing| format!("\nNow: {missing}."));
        if label
            .on_hover_text(format!("{}\nClick: run up to here.{needs}", hint(stage)))
            .clicked()
        {
            actions.push(Action::Run(RunRequest::Until(stage)));
        }
        ui.with_layout(egui::Layout::right_to_left(Align::Center), |ui| {
            ui.label(state_of(network, stage));
        });
    });
    if stage == Stage::Detect
        && network.is_concluded(stage)
        && let Some(hint) = no_codes(network)
    {
        ui.indent(title(stage), |ui| {
            ui.horizontal_wrapped(|ui| {
                mark(ui, Some(theme::DOUBTFUL));
                ui.label(hint);
            });
        });
    }
    // Later stages miss what this one gives: once is enough.
    let mut missing = Stage::ALL
        .into_iter()
        .filter(|stage| !network.is_concluded(*stage))
        .filter_map(|stage| Some((stage, stage.missing(network)?)));
    if let Some((first, missing)) = missing.next()
        && first == stage
    {
        ui.indent(title(stage), |ui| ui.weak(missing.to_string()));
    }
}

/// What to do where no image shows a code: mostly others were looked for. A network that stands without codes needs none.
fn no_codes(network: &Network) -> Option<String> {
    let mut detections = network
        .used_images()
        .filter_map(|(_, image)| image.detections.as_ref())
        .peekable();
    detections.peek()?;
    let is_oriented = network.oriented_images().next().is_some();
    if is_oriented || detections.any(|detections| !detections.codes.is_empty()) {
        return None;
    }
    let families: Vec<String> = network
        .settings
        .families
        .iter()
        .map(Family::to_string)
        .collect();
    Some(format!(
        "No code ({}) is read in any image: choose the codes of your targets in the settings below.",
        families.join(", ")
    ))
}

/// The stage's name as the operator reads it.
#[must_use]
pub fn title(stage: Stage) -> &'static str {
    match stage {
        Stage::Detect => "Detect targets",
        Stage::FirstPair => "First pair",
        Stage::Connect => "Connect images",
        Stage::AdjustCodes => "Adjust codes",
        Stage::Identify => "Identify targets",
        Stage::Adjust => "Adjust",
    }
}

fn hint(stage: Stage) -> &'static str {
    match stage {
        Stage::Detect => {
            "Finds dots and reads codes in every image. Needs images that can be read."
        }
        Stage::FirstPair => {
            "Orients two images from the reference cross, or from the codes both show. Needs two detected images."
        }
        Stage::Connect => {
            "Orients the other images one by one from points known so far. Needs a first pair."
        }
        Stage::AdjustCodes => {
            "Free-network adjustment of all code dots with self-calibration. Needs oriented images."
        }
        Stage::Identify => {
            "Names the plain targets by multi-ray intersection, in passes. Needs oriented images."
        }
        Stage::Adjust => {
            "Final adjustment of everything, with the datum on the plain targets. Needs oriented images."
        }
    }
}

/// How far a stage is: counts where they say more than a word.
fn state_of(network: &Network, stage: Stage) -> RichText {
    let used = network.used_images().count();
    let detected = network
        .used_images()
        .filter(|(_, i)| i.detections.is_some())
        .count();
    let oriented = network.oriented_images().count();
    let counted = match stage {
        Stage::Detect => Some((detected, used)),
        Stage::Connect => Some((oriented, used)),
        _ => None,
    };
    let outcome = network
        .conclusions
        .get(&stage)
        .filter(|_| network.is_concluded(stage))
        .map(|c| c.outcome);
    let word = outcome.map_or_else(
        || match network.conclusions.contains_key(&stage) {
            // It was done, and what it worked on has changed since: mostly it finds nothing more to do.
            true => "to update".to_owned(),
            false => "open".to_owned(),
        },
        |outcome| outcome.to_string(),
    );
    let text = counted.map_or(word.clone(), |(done, all)| format!("{done}/{all} {word}"));
    match outcome {
        Some(Outcome::Done) => RichText::new(text).color(theme::CODE),
        Some(Outcome::Incomplete) => RichText::new(text).color(theme::DOUBTFUL),
        Some(Outcome::Failed) => RichText::new(text).color(theme::REJECTED),
        Some(Outcome::Interrupted) | None => RichText::new(text).weak(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ui::panels::fixture::{Bench, network};
    use egui_kittest::kittest::Queryable as _;

    #[test]
    fn codes_are_exchanged_for_others_one_by_one() {
        let mut panel = StagesPanel::default();
        let runner = Runner::new(|| ()).expect("a thread");
        let mut bench = Bench::new(network(), move |ui, context, actions| {
            panel.ui(ui, context, &runner, actions);
        });
        let mut click = |label: &str| {
            bench.harness.get_by_label(label).click_accesskit();
            let actions = bench.actions();
            let hint = "Codes of one family at least have to be looked for.";
            (actions, bench.harness.query_by_label(hint).is_some())
        };
        assert_eq!(click("Settings"), (vec![], false));
        assert_eq!(click("dot420"), (vec![], true), "none is ticked");
        assert_eq!(click("Apply settings"), (vec![], true), "with no code");
        assert_eq!(click("ring14"), (vec![], false));
        let expected = MeasurementSettings {
            families: vec![Family::Ring(14)],
            ..MeasurementSettings::default()
        };
        let applied = Action::Edit(Edit::Settings(Box::new(expected)));
        assert_eq!(click("Apply settings"), (vec![applied], false));
    }
}
