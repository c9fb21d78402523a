//! The review queue: what is doubtful, one item after the other, one key each.
//!
//! [`review_items`] finds the items from the network alone. The panel computes them image by image over several frames,
//! keeps what it found in an image until that image is another, and walks through them.

mod items;
mod queue;

pub use items::{ReviewItem, ReviewKind, review_items};

use std::sync::Arc;

use egui::{Key, Modifiers, Sense, TextStyle, TextWrapMode, Ui};
use egui_extras::{Column, TableBuilder};

use super::stale::{BEFORE_LAST_EDITS, is_stale};
use crate::project::edit::Edit;
use crate::ui::action::{Action, Selection};
use crate::ui::context::ViewContext;
use queue::Queue;

/// What one key does to the queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Decision {
    Accept,
    Reject,
    Next,
    Back,
}

impl Decision {
    const ALL: [(Decision, Key); 4] = [
        (Decision::Accept, Key::Space),
        (Decision::Reject, Key::X),
        (Decision::Next, Key::N),
        (Decision::Back, Key::Backspace),
    ];
}

/// The review queue.
#[derive(Default)]
pub struct Review {
    queue: Queue,
    place: usize,
    /// Items that were decided without a change of the document.
    left_alone: Vec<(ReviewKind, Selection)>,
    /// The item that the views were last sent to.
    looked_at: Option<(ReviewKind, Selection)>,
    /// The views follow the queue as soon as the operator walks through it.
    following: Following,
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

    /// Draws it; takes the keys Space, X, N and Backspace unless a text field has the keyboard.
    pub fn ui(&mut self, ui: &mut Ui, context: &ViewContext<'_>, actions: &mut Vec<Action>) {
        self.queue.advance(context.network);
        if let Some(left) = self.queue.images_left(context.network) {
            ui.ctx().request_repaint();
            ui.weak(format!("Looking for doubtful places, {left} images left."));
            return;
        }
        let open = self.open_items(context);
        if open.is_empty() {
            ui.label("Nothing is doubtful.");
            return;
        }
        self.place = self.place.min(open.len() - 1);
        let decision = pressed_key(ui).or(self.item(ui, context, &open));
        if let Some(decision) = decision {
            self.decide(decision, &open, actions);
            ui.ctx().request_repaint();
        }
        ui.separator();
        self.list(ui, &open);
        self.follow(context, actions);
    }

    /// The items that wait for a decision.
    fn open_items(&self, context: &ViewContext<'_>) -> Vec<Arc<ReviewItem>> {
        let waits =
            |edit: &Option<Edit>| edit.as_ref().is_some_and(|e| context.pending.contains(e));
        self.queue
            .items()
            .iter()
            .filter(|i| !waits(&i.accept) && !waits(&i.reject))
            .filter(|i| !self.left_alone.contains(&i.key()))
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
        if item.kind.needs_adjustment() && is_stale(context.network) {
            ui.weak(BEFORE_LAST_EDITS);
        }
        let mut decision = None;
        ui.horizontal_wrapped(|ui| {
            let accept = effect(item.accept.as_ref(), "it is right, leave it");
            let reject = effect(item.reject.as_ref(), "leave it");
            let buttons = [
                (Decision::Accept, "Accept (Space)", accept),
                (Decision::Reject, "Reject (X)", reject),
                (Decision::Next, "Next (N)", "decide later"),
                (Decision::Back, "Back (Backspace)", "the item before"),
            ];
            for (what, text, hover) in buttons {
                if ui.button(text).on_hover_text(hover).clicked() {
                    decision = Some(what);
                }
            }
        });
        ui.weak(format!(
            "Accept: {}. Reject: {}.",
            effect(item.accept.as_ref(), "it is right, leave it"),
            effect(item.reject.as_ref(), "leave it")
        ));
        decision
    }

    fn decide(&mut self, decision: Decision, open: &[Arc<ReviewItem>], actions: &mut Vec<Action>) {
        let item = &open[self.place];
        let edit = match decision {
            Decision::Accept => &item.accept,
            Decision::Reject => &item.reject,
            Decision::Next => {
                self.place = (self.place + 1) % open.len();
                self.following = Following::Yes;
                return;
            }
            Decision::Back => {
                self.place = self.place.checked_sub(1).unwrap_or(open.len() - 1);
                self.following = Following::Yes;
                return;
            }
        };
        self.following = Following::Yes;
        match edit {
            // The item leaves the queue when the network holds the edit, and comes back with its undo.
            Some(edit) => actions.push(Action::Edit(edit.clone())),
            None => self.left_alone.push(item.key()),
        }
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
        actions.push(Action::LookAt(item.about.clone()));
    }
}

fn pressed_key(ui: &Ui) -> Option<Decision> {
    if ui.ctx().egui_wants_keyboard_input() {
        return None;
    }
    ui.input_mut(|input| {
        Decision::ALL
            .into_iter()
            .find(|(_, key)| input.consume_key(Modifiers::NONE, *key))
            .map(|(decision, _)| decision)
    })
}

/// What a decision does, in the operator's words.
fn effect(edit: Option<&Edit>, without: &'static str) -> &'static str {
    match edit {
        None => without,
        Some(Edit::Label { .. }) => "name the dot",
        Some(Edit::Accept { .. }) => "its name is right",
        Some(Edit::AcceptCode { .. }) => "the code is as read",
        Some(Edit::Unlabel { .. }) => "take its name away",
        Some(Edit::Reject { .. }) => "do not use it",
        Some(Edit::Restore { .. }) => "use it",
        Some(Edit::Renumber { .. }) => "give the code a number",
        Some(Edit::SetAside { .. }) => "set the code aside",
        Some(Edit::AddDot { .. }) => "measure a dot",
        Some(Edit::AddBar { .. } | Edit::RemoveBar { .. }) => "change scale bars",
        Some(Edit::SetControl { .. } | Edit::RemoveControl { .. }) => "change control points",
        Some(Edit::UseImage { .. }) => "use the image or not",
        Some(Edit::Settings(_)) => "change settings",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::ImageId;
    use crate::targets::DotIndex;
    use crate::ui::panels::fixture::{Bench, network};
    use egui_kittest::kittest::Queryable as _;

    fn bench() -> Bench {
        let mut panel = Review::default();
        Bench::new(network(), move |ui, context, actions| {
            panel.ui(ui, context, actions);
        })
    }

    #[test]
    fn space_restores_x_rejects_and_the_views_follow() {
        let mut bench = bench();
        let items = review_items(&network());
        bench.actions();
        bench
            .harness
            .get_by_label(&format!("item 1 of {}", items.len()));
        bench.harness.key_press(Key::N);
        let expected = Action::LookAt(items[1].about.clone());
        assert_eq!(bench.actions(), [expected]);
        bench.harness.key_press(Key::Backspace);
        assert_eq!(bench.actions(), [Action::LookAt(items[0].about.clone())]);
        let rejected = items
            .iter()
            .position(|i| i.kind == ReviewKind::RejectedObservation)
            .unwrap();
        for _ in 0..rejected {
            bench.harness.key_press(Key::N);
            bench.actions();
        }
        let (image, dot) = (ImageId(1), DotIndex(1));
        bench.harness.key_press(Key::Space);
        assert_eq!(
            bench.actions()[0],
            Action::Edit(Edit::Restore { image, dot })
        );
        bench.harness.get_by_label("Reject (X)").click();
        assert_eq!(
            bench.actions()[0],
            Action::Edit(Edit::Reject { image, dot })
        );
    }

    #[test]
    fn a_decided_item_leaves_the_queue() {
        let mut bench = bench();
        let count = review_items(&network()).len();
        bench.actions();
        bench.change(|network| {
            let edit = Edit::Reject {
                image: ImageId(1),
                dot: DotIndex(1),
            };
            edit.apply(network).unwrap();
        });
        bench
            .harness
            .get_by_label(&format!("item 1 of {}", count - 1));
    }
}
