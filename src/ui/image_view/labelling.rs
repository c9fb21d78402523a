//! Naming a dot by hand: which points it may be, nearest first, in a small list at the pointer.

use egui::{Align2, Key, Pos2, RichText};
use nalgebra::Vector2;

use super::prediction::{Misfit, Sight};
use crate::network::{ImageId, Network, PointId};
use crate::targets::{Dot, DotIndex};

/// A point that a dot may be the image of.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelCandidate {
    /// The point.
    pub point: PointId,
    /// Its label.
    pub label: String,
    /// Distance of its predicted place from the dot, px; `None` where nothing predicts it.
    pub distance_px: Option<f64>,
    /// The same in standard deviations of the prediction.
    pub sigmas: Option<f64>,
    /// Another dot of this image that has the name now, and would lose it.
    pub held_by: Option<DotIndex>,
}

/// All points with coordinates, likeliest at a place of an image first (by the distance in standard deviations of the
/// prediction); without an orientation by their names.
#[must_use]
pub fn rank_labels(
    network: &Network,
    image: ImageId,
    place_px: Vector2<f64>,
) -> Vec<LabelCandidate> {
    let Some(entry) = network.images.get(&image) else {
        return Vec::new();
    };
    let sight = Sight::of(network, entry);
    let held = |point: PointId| {
        entry
            .labels
            .iter()
            .find(|(_, label)| label.point == point)
            .map(|(dot, _)| *dot)
    };
    let mut near: Vec<(Option<Misfit>, PointId)> = network
        .points
        .iter()
        .filter_map(|(id, point)| match &sight {
            Some(sight) => Some((Some(sight.misfit(point, place_px)?), *id)),
            None => Some((None, *id)),
        })
        .collect();
    near.sort_by(|(a, first), (b, second)| {
        let rank = |misfit: &Option<Misfit>| misfit.map_or(f64::INFINITY, |m| m.rank);
        rank(a).total_cmp(&rank(b)).then(first.cmp(second))
    });
    /// Nobody looks farther down the list; the filter has the others.
    const MOST: usize = 5000;
    near.truncate(MOST);
    near.into_iter()
        .map(|(misfit, point)| LabelCandidate {
            point,
            label: network.label(point),
            distance_px: misfit.map(|m| m.distance_px),
            sigmas: misfit.map(|m| m.sigmas),
            held_by: held(point),
        })
        .collect()
}

/// The candidates whose label holds the text; a label that is typed in full comes first, even where nothing is known of
/// its point.
#[must_use]
pub fn filtered(ranked: &[LabelCandidate], text: &str, network: &Network) -> Vec<LabelCandidate> {
    let text = text.trim();
    let wanted = text.to_lowercase();
    let mut found: Vec<LabelCandidate> = ranked
        .iter()
        .filter(|c| c.label.to_lowercase().contains(&wanted))
        .cloned()
        .collect();
    let typed = network
        .point_of_label(text)
        .or_else(|_| network.point_of_label(&text.to_uppercase()));
    if let (false, Ok(point)) = (text.is_empty(), typed) {
        let known = found.iter().position(|c| c.point == point);
        let first = match known {
            Some(place) => found.remove(place),
            None => LabelCandidate {
                point,
                label: network.label(point),
                distance_px: None,
                sigmas: None,
                held_by: None,
            },
        };
        found.insert(0, first);
    }
    found
}

/// What gets the name.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Subject {
    /// A dot that is there.
    Dot(DotIndex),
    /// A dot that was just measured; it is added with its name.
    New {
        dot: Dot,
        /// How it was measured, for the operator.
        note: String,
    },
}

/// The list while it is open.
#[derive(Clone, Debug)]
pub(super) struct LabelPopup {
    pub(super) subject: Subject,
    at: Pos2,
    filter: String,
    ranked: Vec<LabelCandidate>,
    frames: u32,
}

/// What the operator chose.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Choice {
    /// This name.
    Point(PointId),
    /// The dot stays without a name.
    NoName,
    /// Nothing is done.
    Cancel,
}

impl LabelPopup {
    pub(super) fn new(subject: Subject, at: Pos2, ranked: Vec<LabelCandidate>) -> Self {
        Self {
            subject,
            at,
            filter: String::new(),
            ranked,
            frames: 0,
        }
    }

    /// Shows the list; `Some` when the operator has chosen.
    pub(super) fn ui(
        &mut self,
        context: &egui::Context,
        id: egui::Id,
        network: &Network,
    ) -> Option<Choice> {
        let (enter, escape) = context.input_mut(|input| {
            let escape = input.consume_key(egui::Modifiers::NONE, Key::Escape);
            (input.key_pressed(Key::Enter), escape)
        });
        if escape {
            return Some(Choice::Cancel);
        }
        let mut choice = None;
        let area = egui::Area::new(id)
            .order(egui::Order::Foreground)
            .pivot(Align2::LEFT_TOP)
            .fixed_pos(self.at + egui::vec2(12.0, 12.0))
            .constrain(true);
        area.show(context, |ui| {
            egui::Frame::popup(ui.style()).show(ui, |ui| {
                ui.set_width(230.0);
                choice = self.content(ui, network);
            });
        });
        // The list is shown once before a key chooses, so that the operator sees what it takes.
        if enter && self.frames > 0 {
            let first = filtered(&self.ranked, &self.filter, network)
                .first()
                .map(|c| c.point);
            choice = choice.or(first.map(Choice::Point));
        }
        self.frames = self.frames.saturating_add(1);
        choice
    }

    fn content(&mut self, ui: &mut egui::Ui, network: &Network) -> Option<Choice> {
        /// So many rows fit the eye.
        const ROWS: usize = 8;
        let mut choice = None;
        if let Subject::New { note, .. } = &self.subject {
            ui.label(RichText::new(note).small());
        }
        let title = ui.label("Label of the dot");
        let field = egui::TextEdit::singleline(&mut self.filter)
            .hint_text("type to filter, Enter takes the first")
            .desired_width(f32::INFINITY);
        let field = ui.add(field).labelled_by(title.id);
        if !field.has_focus() {
            field.request_focus();
        }
        let found = filtered(&self.ranked, &self.filter, network);
        for (row, candidate) in found.iter().take(ROWS).enumerate() {
            if ui.selectable_label(row == 0, row_text(candidate)).clicked() {
                choice = Some(Choice::Point(candidate.point));
            }
        }
        if found.is_empty() {
            ui.weak("No point has such a label.");
        }
        ui.separator();
        let new = network.new_target();
        if ui
            .button(format!("New target {}", network.label(new)))
            .clicked()
        {
            choice = Some(Choice::Point(new));
        }
        if matches!(self.subject, Subject::New { .. }) && ui.button("Add without a label").clicked()
        {
            choice = Some(Choice::NoName);
        }
        if ui.button("Cancel (Esc)").clicked() {
            choice = Some(Choice::Cancel);
        }
        choice
    }
}

fn row_text(candidate: &LabelCandidate) -> String {
    let distance = match (candidate.distance_px, candidate.sigmas) {
        (Some(distance), Some(sigmas)) => format!("{distance:.1} px, {sigmas:.1} sigma"),
        _ => "no place known".into(),
    };
    let held = candidate.held_by.map_or("", |_| ", now on another dot");
    format!("{}   {distance}{held}", candidate.label)
}

/// The field for a code's number while it is open.
#[derive(Clone, Debug)]
pub(super) struct NumberPopup {
    pub(super) reading: usize,
    at: Pos2,
    text: String,
    largest: u32,
    frames: u32,
}

/// What the operator entered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Entered {
    /// This number.
    Number(u32),
    /// Nothing is done.
    Cancel,
}

impl NumberPopup {
    pub(super) fn new(reading: usize, at: Pos2, largest: u32) -> Self {
        Self {
            reading,
            at,
            text: String::new(),
            largest,
            frames: 0,
        }
    }

    pub(super) fn ui(&mut self, context: &egui::Context, id: egui::Id) -> Option<Entered> {
        let (enter, escape) = context.input_mut(|input| {
            let escape = input.consume_key(egui::Modifiers::NONE, Key::Escape);
            (input.key_pressed(Key::Enter), escape)
        });
        if escape {
            return Some(Entered::Cancel);
        }
        let number = self.text.trim().parse::<u32>().ok();
        let number = number.filter(|number| (1..=self.largest).contains(number));
        let mut entered = None;
        let area = egui::Area::new(id)
            .order(egui::Order::Foreground)
            .fixed_pos(self.at + egui::vec2(12.0, 12.0))
            .constrain(true);
        area.show(context, |ui| {
            egui::Frame::popup(ui.style()).show(ui, |ui| {
                ui.set_width(200.0);
                let title = ui.label(format!("Number of the code, 1 to {}", self.largest));
                let field = ui
                    .text_edit_singleline(&mut self.text)
                    .labelled_by(title.id);
                if !field.has_focus() {
                    field.request_focus();
                }
                if number.is_none() && !self.text.is_empty() {
                    ui.weak("There is no such code.");
                }
                if ui
                    .add_enabled(number.is_some(), egui::Button::new("Give number (Enter)"))
                    .clicked()
                {
                    entered = number.map(Entered::Number);
                }
                if ui.button("Cancel (Esc)").clicked() {
                    entered = Some(Entered::Cancel);
                }
            });
        });
        if enter && self.frames > 0 {
            entered = entered.or(number.map(Entered::Number));
        }
        self.frames = self.frames.saturating_add(1);
        entered
    }
}
