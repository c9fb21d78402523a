//! The review queue: what is doubtful, one item after the other, one key each.
//!
//! [`review_items`] finds the items from the network alone. The panel computes them image by image over several frames,
//! keeps what it found in an image until that image is another, and walks through them.
//!
//! Where a target was missed, the present item is measured as soon as its picture is there, and accepting adds what was
//! measured. Detection's own estimator does that on a cut-out. Where it finds nothing, accepting only goes on: a centre
//! by hand is made by a click in the image, never from the predicted place.
//!
//! Where readings of dots exclude each other, the item shows them in a table, the likeliest first; their numbers decide, and the images
//! show the one in hand.

mod items;
mod measured;
mod questions;
mod queue;
#[cfg(test)]
mod tests;

pub use items::{ReviewItem, ReviewKind, review_items};

use std::sync::Arc;

use egui::{Context, Key, Modifiers, Pos2, Sense, TextStyle, TextWrapMode, Ui};
use egui_extras::{Column, TableBuilder};

use super::stale::{BEFORE_LAST_EDITS, is_stale};
use crate::network::ImageFile;
use crate::project::edit::Edit;
use crate::ui::action::{Action, Question, Selection};
use crate::ui::context::ViewContext;
use measured::{CLICK_SETS_IT, Measured};
use questions::Asked;
use queue::Queue;

/// What one key does to the queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Decision {
    Accept,
    Reject,
    Edit,
    Next,
    Back,
    /// The reading at this place is right.
    Take(usize),
}

/// Keys of readings, the likeliest first.
const NUMBERS: [Key; 9] = [
    Key::Num1,
    Key::Num2,
    Key::Num3,
    Key::Num4,
    Key::Num5,
    Key::Num6,
    Key::Num7,
    Key::Num8,
    Key::Num9,
];

impl Decision {
    const ALL: [(Decision, Key); 5] = [
        (Decision::Accept, Key::Space),
        (Decision::Reject, Key::X),
        (Decision::Edit, Key::E),
        (Decision::Next, Key::N),
        (Decision::Back, Key::Backspace),
    ];
}

/// The review queue.
#[derive(Default)]
pub struct Review {
    queue: Queue,
    place: usize,
    /// What stands where the present item says that a target was missed.
    measured: Measured,
    /// The item that the views were last sent to.
    looked_at: Option<(ReviewKind, Selection)>,
    /// What the last key did, where that is not what it says.
    said: Option<String>,
    /// The first picture of the document that is walked through: what was decided in another is no more.
    document: Option<ImageFile>,
    /// The views follow the queue as soon as the operator walks through it.
    following: Following,
    /// Where the pointer rested at the last decision; while it rests, the keys are the queue's.
    rested_at: Option<Pos2>,
    /// A key that was taken before the panels drew.
    taken: Option<Decision>,
    /// The reading that the operator looks at, of which item.
    in_hand: Option<((ReviewKind, Selection), usize)>,
    /// Readings of the present item.
    readings: usize,
}

/// Whether the views follow the queue.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
enum Following {
    #[default]
    NotYet,
    Yes,
}

impl Review {
    /// The title of its tab, with the number of items found so far.
    #[must_use]
    pub fn title(&self) -> String {
        match self.queue.items().len() {
            0 => "Review".into(),
            count => format!("Review {count}"),
        }
    }

    /// Takes the queue's keys before the panels draw, while the operator walks through it: the views bring what is
    /// looked at under the resting pointer, and a picture would take the key for its dot. A pointer that moves hands the
    /// keys back to what is under it.
    pub fn take_keys(&mut self, context: &Context) {
        let rests = context.pointer_latest_pos() == self.rested_at;
        if self.following == Following::Yes && rests && self.taken.is_none() {
            self.taken = pressed_key(context, self.readings);
        }
    }

    /// Draws it; takes the keys Space, X, E, N and Backspace, and the numbers of readings, unless a text field has the keyboard.
    pub fn ui(&mut self, ui: &mut Ui, context: &ViewContext<'_>, actions: &mut Vec<Action>) {
        self.forget_other_documents(context);
        self.queue.advance(context.network);
        if let Some(left) = self.queue.images_left(context.network) {
            ui.ctx().request_repaint();
            ui.weak(format!("Looking for doubtful places, {left} images left."));
            return;
        }
        let open = self.open_items(context);
        self.readings = 0;
        if open.is_empty() {
            ui.label("Nothing is doubtful.");
            return;
        }
        self.place = self.place.min(open.len() - 1);
        let item = &open[self.place];
        self.measured.look(context, item);
        let question = item.about.question.as_ref();
        self.readings = question.map_or(0, |question| question.group.readings.len());
        let taken = self.taken.take();
        let key = taken.or_else(|| pressed_key(ui.ctx(), self.readings));
        let decision = key.or(self.item(ui, context, &open)).or(self.table(
            ui,
            context,
            &open[self.place],
            actions,
        ));
        if let Some(decision) = decision {
            self.rested_at = ui.ctx().pointer_latest_pos();
            self.decide(decision, &open, context, actions);
            ui.ctx().request_repaint();
        }
        ui.separator();
        self.list(ui, &open);
        self.follow(context, actions);
    }

    fn forget_other_documents(&mut self, context: &ViewContext<'_>) {
        let first = context.network.images.values().next();
        if first.map(|image| &image.file) != self.document.as_ref() {
            self.document = first.map(|image| image.file.clone());
            self.looked_at = None;
            self.said = None;
            self.following = Following::NotYet;
            self.taken = None;
            self.in_hand = None;
        }
    }

    /// The items that wait for a decision.
    fn open_items(&self, context: &ViewContext<'_>) -> Vec<Arc<ReviewItem>> {
        let waits = |edit: &Edit| context.pending.contains(edit);
        self.queue
            .items()
            .iter()
            .filter(|i| !i.accept.as_ref().is_some_and(waits) && !waits(&i.reject))
            .filter(|i| !is_being_measured(i, context) && !is_being_answered(i, context))
            .cloned()
            .collect()
    }

    fn item(
        &self,
        ui: &mut Ui,
        context: &ViewContext<'_>,
        open: &[Arc<ReviewItem>],
    ) -> Option<Decision> {
        let item = &open[self.place];
        ui.horizontal(|ui| {
            ui.heading(format!("item {} of {}", self.place + 1, open.len()));
            ui.weak(item.kind.to_string());
        });
        ui.label(&item.evidence);
        if item.kind == ReviewKind::MissedTarget {
            ui.label(self.measured.note());
        }
        if item.kind.needs_adjustment() && is_stale(context.network) {
            ui.weak(BEFORE_LAST_EDITS);
        }
        let mut decision = None;
        ui.horizontal_wrapped(|ui| {
            let (accept, reject) = effects(item);
            let buttons = [
                (Decision::Accept, "Accept (Space)", accept),
                (Decision::Reject, "Reject (X)", reject),
                (Decision::Edit, "Edit (E)", "the list of labels of its dot"),
                (Decision::Next, "Next (N)", "decide later"),
                (Decision::Back, "Back (Backspace)", "the item before"),
            ];
            for (what, text, hover) in buttons {
                if ui.button(text).on_hover_text(hover).clicked() {
                    decision = Some(what);
                }
            }
        });
        let (accept, reject) = effects(item);
        ui.weak(format!("Accept: {accept}. Reject: {reject}."));
        if let Some(said) = &self.said {
            ui.label(said);
        }
        decision
    }

    /// The readings of a question; a click shows one in the images.
    fn table(
        &mut self,
        ui: &mut Ui,
        context: &ViewContext<'_>,
        item: &ReviewItem,
        actions: &mut Vec<Action>,
    ) -> Option<Decision> {
        let question = self.question(item)?;
        match questions::table(ui, context.network, &question)? {
            Asked::Take(place) => Some(Decision::Take(place)),
            Asked::Show(place) => {
                self.in_hand = Some((item.key(), place));
                self.following = Following::Yes;
                self.looked_at = Some(item.key());
                actions.push(Action::LookAt(self.about(item)));
                None
            }
        }
    }

    /// The question of an item with the reading that the operator looks at; `None` where it is no question.
    fn question(&self, item: &ReviewItem) -> Option<Question> {
        let asked = item.about.question.as_ref()?;
        let in_hand = self.in_hand.as_ref().filter(|(of, _)| *of == item.key());
        let in_hand = in_hand.map_or(0, |(_, place)| *place);
        Some(Question {
            in_hand: in_hand.min(asked.group.readings.len().saturating_sub(1)),
            ..asked.clone()
        })
    }

    /// Where an item sends the views.
    fn about(&self, item: &ReviewItem) -> Selection {
        let question = self.question(item);
        let reading = question.as_ref().and_then(Question::reading);
        let dot = reading.and_then(|reading| reading.dots.first().copied());
        Selection {
            image: dot.map(|(image, _)| image).or(item.about.image),
            dot: dot.or(item.about.dot),
            question,
            ..item.about.clone()
        }
    }

    fn decide(
        &mut self,
        decision: Decision,
        open: &[Arc<ReviewItem>],
        context: &ViewContext<'_>,
        actions: &mut Vec<Action>,
    ) {
        let item = &open[self.place];
        self.said = None;
        let edit = match decision {
            Decision::Accept
                if item.kind == ReviewKind::MissedTarget && self.measured.is_nothing() =>
            {
                let name = item.about.point.map(|point| context.network.label(point));
                self.said = Some(format!(
                    "{}: nothing measurable there; {CLICK_SETS_IT}.",
                    name.unwrap_or_default()
                ));
                self.go_on(open.len());
                return;
            }
            Decision::Accept if item.kind == ReviewKind::MissedTarget => {
                // Without a picture, or where another target's dot stands, there is nothing to accept.
                let edit = self.measured.edit(context.network, item);
                if let Some(edit) = edit {
                    self.following = Following::Yes;
                    actions.push(Action::Edit(edit));
                } else {
                    self.said = Some(self.measured.note());
                }
                return;
            }
            Decision::Accept | Decision::Take(_) if item.kind == ReviewKind::AmbiguousGroup => {
                self.answer(decision, item, actions);
                return;
            }
            Decision::Take(_) => return,
            Decision::Accept => item.accept.as_ref(),
            Decision::Reject => Some(&item.reject),
            Decision::Edit => {
                self.following = Following::Yes;
                self.looked_at = Some(item.key());
                actions.push(Action::EditLabel(item.about.clone()));
                return;
            }
            Decision::Next => {
                self.go_on(open.len());
                return;
            }
            Decision::Back => {
                self.place = self.place.checked_sub(1).unwrap_or(open.len() - 1);
                self.following = Following::Yes;
                return;
            }
        };
        self.following = Following::Yes;
        // The item leaves the queue when the network holds the edit, and comes back with its undo.
        actions.extend(edit.cloned().map(Action::Edit));
    }

    /// The reading in hand is right, or the one of the key.
    fn answer(&mut self, decision: Decision, item: &ReviewItem, actions: &mut Vec<Action>) {
        let Some(question) = self.question(item) else {
            return;
        };
        let place = match decision {
            Decision::Take(place) => place,
            _ => question.in_hand,
        };
        if let Some(reading) = question.group.readings.get(place) {
            self.following = Following::Yes;
            let edit = Edit::TakeReading(Box::new(reading.clone()));
            actions.push(Action::Edit(edit));
        }
    }

    fn go_on(&mut self, count: usize) {
        self.place = (self.place + 1) % count;
        self.following = Following::Yes;
    }

    fn list(&mut self, ui: &mut Ui, open: &[Arc<ReviewItem>]) {
        let height = ui.text_style_height(&TextStyle::Body) + 4.0;
        ui.style_mut().wrap_mode = Some(TextWrapMode::Truncate);
        let mut chosen = None;
        TableBuilder::new(ui)
            .striped(true)
            .auto_shrink(false)
            .sense(Sense::click())
            .column(Column::initial(150.0).clip(true))
            .column(Column::remainder().clip(true))
            .body(|body| {
                body.rows(height, open.len(), |mut row| {
                    let place = row.index();
                    row.set_selected(place == self.place);
                    row.col(|ui| {
                        ui.add(egui::Label::new(open[place].kind.to_string()).selectable(false));
                    });
                    row.col(|ui| {
                        ui.add(egui::Label::new(&open[place].evidence).selectable(false));
                    });
                    if row.response().clicked() {
                        chosen = Some(place);
                    }
                });
            });
        if let Some(place) = chosen {
            self.place = place;
            self.following = Following::Yes;
            self.looked_at = None;
        }
    }

    /// Sends the views to the present item when it is another than the last time.
    fn follow(&mut self, context: &ViewContext<'_>, actions: &mut Vec<Action>) {
        let open = self.open_items(context);
        let Some(item) = open.get(self.place).or(open.last()) else {
            return;
        };
        let edited = actions.iter().any(|a| matches!(a, Action::Edit(_)));
        if self.following == Following::NotYet || edited || self.looked_at == Some(item.key()) {
            return;
        }
        self.looked_at = Some(item.key());
        actions.push(Action::LookAt(self.about(item)));
    }
}

/// The queue's key that is pressed, those of so many readings among them.
fn pressed_key(context: &Context, readings: usize) -> Option<Decision> {
    if context.egui_wants_keyboard_input() {
        return None;
    }
    let numbers = NUMBERS.into_iter().take(readings).enumerate();
    let numbers = numbers.map(|(place, key)| (Decision::Take(place), key));
    context.input_mut(|input| {
        Decision::ALL
            .into_iter()
            .chain(numbers)
            .find(|(_, key)| input.consume_key(Modifiers::NONE, *key))
            .map(|(decision, _)| decision)
    })
}

/// Whether an edit waits that measures this missed target.
fn is_being_measured(item: &ReviewItem, context: &ViewContext<'_>) -> bool {
    item.kind == ReviewKind::MissedTarget
        && context.pending.iter().any(|edit| match edit {
            Edit::AddDot { image, point, .. } => {
                (Some(*image), *point) == (item.about.image, item.about.point)
            }
            _ => false,
        })
}

/// Whether an edit waits that answers this question.
fn is_being_answered(item: &ReviewItem, context: &ViewContext<'_>) -> bool {
    let Some(question) = &item.about.question else {
        return false;
    };
    context.pending.iter().any(|edit| match edit {
        Edit::TakeReading(reading) => question.group.readings.contains(reading),
        _ => false,
    })
}

/// What accepting and rejecting an item do.
fn effects(item: &ReviewItem) -> (&'static str, &'static str) {
    match item.kind {
        ReviewKind::MissedTarget => (
            "take what is measured here",
            "there is no target, do not ask again",
        ),
        ReviewKind::UnnamedDot => ("name the dot", "no target, never use the dot"),
        ReviewKind::AmbiguousGroup => (
            "the reading in hand is right",
            "none is right, never use these dots",
        ),
        _ => (
            item.accept.as_ref().map_or("leave it", effect),
            effect(&item.reject),
        ),
    }
}

/// What a decision does, in the operator's words.
fn effect(edit: &Edit) -> &'static str {
    match edit {
        Edit::Label { .. } => "name the dot",
        Edit::Accept { .. } => "its name is right",
        Edit::AcceptCode { .. } => "the code is as read",
        Edit::Unlabel { .. } => "take its name away",
        Edit::Reject { .. } => "do not use it",
        Edit::Restore { .. } => "use it",
        Edit::Renumber { .. } => "give the code a number",
        Edit::SetAside { .. } => "set the code aside",
        Edit::AddDot { .. } => "measure a dot",
        Edit::TakeReading(_) => "name its dots",
        Edit::NotThere { .. } => "never ask for it here",
        Edit::DismissReadings { .. } => "never use its dots",
        Edit::AddBar { .. } | Edit::RemoveBar { .. } => "change scale bars",
        Edit::SetControl { .. } | Edit::RemoveControl { .. } => "change control points",
        Edit::UseImage { .. } => "use the image or not",
        Edit::Settings(_) => "change settings",
        Edit::Frame(_) => "set the frame",
        Edit::NameTargets { .. } | Edit::RenameTarget { .. } => "name targets",
    }
}
