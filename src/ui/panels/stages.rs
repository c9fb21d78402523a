//! The stage panel: six stages, what each needs, step, run, interrupt, progress.

use egui::{Button, ProgressBar, RichText, Ui};

use crate::network::{Network, Outcome, Stage};
use crate::ui::action::{Action, RunRequest};
use crate::ui::runner::Runner;
use crate::ui::theme;

/// The stage panel.
#[derive(Default)]
pub struct StagesPanel;

impl StagesPanel {
    /// Draws the panel and asks for what was clicked.
    pub fn ui(&mut self, ui: &mut Ui, network: &Network, runner: &Runner, actions: &mut Vec<Action>) {
        let running = runner.is_running();
        ui.horizontal_wrapped(|ui| {
            let mut ask = |ui: &mut Ui, label: &str, enabled: bool, hint: &str, action: Action| {
                if ui.add_enabled(enabled, Button::new(label)).on_hover_text(hint).clicked() {
                    actions.push(action);
                }
            };
            ask(ui, "Step", !running, "One step of the next stage (F5)", Action::Run(RunRequest::Step));
            ask(ui, "Run stage", !running, "The next stage to its end (Shift+F5)", Action::Run(RunRequest::Stage));
            ask(
                ui,
                "Run all",
                !running,
                "All stages (Ctrl+F5)",
                Action::Run(RunRequest::Until(Stage::Adjust)),
            );
            ask(ui, "Interrupt", running, "Stop; finished steps are kept (Esc)", Action::Interrupt);
        });
        if let Some((stage, title, progress)) = runner.progress() {
            let what = if runner.is_stopping() { "stopping" } else { title };
            ui.label(format!("{stage}: {what}"));
            let share = progress.done as f32 / progress.total.max(1) as f32;
            let left = progress.total.saturating_sub(progress.done);
            let bar = ProgressBar::new(if progress.total > 0 { share } else { 0.0 });
            ui.add(bar.text(if progress.total > 0 {
                format!("{} ({left} left)", progress.title)
            } else {
                progress.title.clone()
            }));
        }
        if !runner.pending().is_empty() {
            let text = format!("{} edits wait for the end of this step", runner.pending().len());
            ui.colored_label(theme::DOUBTFUL, text);
        }
        ui.separator();
        for stage in Stage::ALL {
            stage_row(ui, network, stage, runner, actions);
        }
    }
}

fn stage_row(ui: &mut Ui, network: &Network, stage: Stage, runner: &Runner, actions: &mut Vec<Action>) {
    let state = state_of(network, stage);
    let now = runner.progress().is_some_and(|(running, ..)| running == stage);
    let mark = if now { ">" } else { " " };
    ui.horizontal(|ui| {
        ui.monospace(mark);
        let label = ui.add_enabled(!runner.is_running(), Button::new(title(stage)).frame(false));
        if label.on_hover_text(format!("{}\nClick: run up to here", hint(stage))).clicked() {
            actions.push(Action::Run(RunRequest::Until(stage)));
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(state);
        });
    });
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
        Stage::Detect => "Finds dots and reads codes in every image.",
        Stage::FirstPair => "Orients two images from the reference cross, or from the codes both show.",
        Stage::Connect => "Orients the other images one by one from known codes.",
        Stage::AdjustCodes => "Free-network adjustment of all code dots with self-calibration.",
        Stage::Identify => "Names the plain targets by multi-ray intersection, in passes.",
        Stage::Adjust => "Final free-network adjustment with inner constraints on the plain targets.",
    }
}

/// How far a stage is: counts where they say more than a word.
fn state_of(network: &Network, stage: Stage) -> RichText {
    let used = network.used_images().count();
    let detected = network.used_images().filter(|(_, i)| i.detections.is_some()).count();
    let oriented = network.oriented_images().count();
    let counted = match stage {
        Stage::Detect => Some((detected, used)),
        Stage::Connect => Some((oriented, used)),
        _ => None,
    };
    let word = match network.conclusions.get(&stage).filter(|_| network.is_concluded(stage)) {
        Some(conclusion) => conclusion.outcome.to_string(),
        None => "open".to_owned(),
    };
    let text = counted.map_or(word.clone(), |(done, all)| format!("{done}/{all} {word}"));
    let outcome = network.conclusions.get(&stage).filter(|_| network.is_concluded(stage)).map(|c| c.outcome);
    match outcome {
        Some(Outcome::Done) => RichText::new(text).color(theme::CODE),
        Some(Outcome::Incomplete) => RichText::new(text).color(theme::DOUBTFUL),
        Some(Outcome::Failed) => RichText::new(text).color(theme::REJECTED),
        Some(Outcome::Interrupted) | None => RichText::new(text).weak(),
    }
}
