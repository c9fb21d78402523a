//! Dots whose readings exclude each other: one item for each group, its readings in a table, one key each.

use std::sync::Arc;

use egui::{Grid, ScrollArea, Ui};

use super::items::{ReviewItem, ReviewKind};
use crate::network::{Agreement, AmbiguousGroup, ImageId, Network, ReadTarget, Reading};
use crate::project::edit::Edit;
use crate::ui::action::{Question, Selection};
use crate::ui::panels::facts::image_name;

/// Odds beyond which nobody asks how many zeros there are.
const LARGEST_ODDS: f64 = 1e6;

/// What the operator did to the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Asked {
    /// This reading is right.
    Take(usize),
    /// Show this one in the images.
    Show(usize),
}

/// The questions that are open, in the order of what they settle.
pub(super) fn question_items(network: &Network) -> Vec<ReviewItem> {
    let groups = network.open_groups().into_iter().map(Arc::new);
    let items = groups.enumerate().filter_map(|(place, group)| {
        let best = group.readings.first()?;
        let (image, dot) = *best.dots.first()?;
        Some(ReviewItem {
            kind: ReviewKind::AmbiguousGroup,
            evidence: evidence(network, &group),
            accept: Some(Edit::TakeReading(Box::new(best.clone()))),
            reject: Edit::DismissReadings {
                dots: group.dots().into_iter().collect(),
            },
            about: Selection {
                image: Some(image),
                dot: Some((image, dot)),
                question: Some(Question { group, in_hand: 0 }),
                ..Selection::default()
            },
            rank: place as f64,
        })
    });
    items.collect()
}

fn evidence(network: &Network, group: &AmbiguousGroup) -> String {
    let dots = group.dots();
    let images: std::collections::BTreeSet<ImageId> =
        dots.iter().map(|(image, _)| *image).collect();
    let [best, next, ..] = &group.readings[..] else {
        return String::new();
    };
    let dots = match dots.len() {
        1 => "1 dot".to_owned(),
        count => format!("{count} dots"),
    };
    let images = match images.len() {
        1 => "1 image".to_owned(),
        count => format!("{count} images"),
    };
    format!(
        "{dots} of {images} with {} readings; {} of {} is likeliest, {} times as likely as the next",
        group.readings.len(),
        target(network, best),
        rays(best),
        odds(group.odds_against(next))
    )
}

/// The readings, the likeliest first.
pub(super) fn table(ui: &mut Ui, network: &Network, question: &Question) -> Option<Asked> {
    let mut asked = None;
    ScrollArea::horizontal().show(ui, |ui| {
        Grid::new("readings")
            .num_columns(7)
            .striped(true)
            .show(ui, |ui| {
                for (title, hover) in [
                    ("key", "decides"),
                    (
                        "reading",
                        "what its dots are; a click shows it in the images",
                    ),
                    ("dots", "in how many images, and which"),
                    (
                        "rays",
                        "misfit of its rays: 1 sigma is what is to be expected",
                    ),
                    (
                        "ellipses",
                        "misfit of its ellipses: 1 sigma is what is to be expected",
                    ),
                    ("size", "diameter that its ellipses tell"),
                    (
                        "odds against",
                        "by how many times the first reading is likelier",
                    ),
                ] {
                    ui.strong(title).on_hover_text(hover);
                }
                ui.end_row();
                for (place, reading) in question.group.readings.iter().enumerate() {
                    let key = format!("{}", place + 1);
                    let button = ui.button(key).on_hover_text("This reading is right.");
                    if button.clicked() {
                        asked = Some(Asked::Take(place));
                    }
                    let in_hand = place == question.in_hand;
                    if ui
                        .selectable_label(in_hand, target(network, reading))
                        .clicked()
                    {
                        asked = Some(Asked::Show(place));
                    }
                    let names = reading.dots.iter();
                    let names: Vec<&str> = names
                        .map(|(image, _)| short_name(network, *image))
                        .collect();
                    ui.label(format!("{}: {}", names.len(), names.join(", ")));
                    ui.label(sigmas(reading.rays));
                    ui.label(sigmas(reading.shape));
                    let size = reading.diameter_mm;
                    ui.label(size.map_or_else(String::new, |mm| format!("{mm:.1} mm")));
                    ui.label(odds(question.group.odds_against(reading)));
                    ui.end_row();
                }
            });
    });
    asked
}

/// The last part of an image's path.
fn short_name(network: &Network, image: ImageId) -> &str {
    let path = image_name(network, image);
    path.rsplit('/').next().unwrap_or(path)
}

fn target(network: &Network, reading: &Reading) -> String {
    match reading.target {
        ReadTarget::New { .. } => "a new target".into(),
        ReadTarget::Known(point) => network.label(point),
    }
}

fn rays(reading: &Reading) -> String {
    match reading.dots.len() {
        1 => "1 ray".into(),
        count => format!("{count} rays"),
    }
}

fn sigmas(agreement: Agreement) -> String {
    let sigmas = agreement.sigmas();
    sigmas.map_or_else(String::new, |sigmas| format!("{sigmas:.1} sigma"))
}

fn odds(odds: f64) -> String {
    if odds > LARGEST_ODDS {
        format!("over {LARGEST_ODDS:.0}")
    } else if odds < 10.0 {
        format!("{odds:.1}")
    } else {
        format!("{odds:.0}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odds_are_as_exact_as_they_can_be_read() {
        let texts = [1.0, 3.26, 40.4, 1e9].map(odds);
        assert_eq!(texts, ["1.0", "3.3", "40", "over 1000000"]);
    }
}
