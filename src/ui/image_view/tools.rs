//! What keys and clicks do with the dots of an image.

use egui::{Key, Modifiers, Ui};
use nalgebra::Vector2;

use super::hover::{self, Hovered};
use super::labelling::{Choice, Entered, LabelPopup, NumberPopup, Subject, rank_labels};
use super::marks::Marks;
use super::measuring::{MeasuredByHand, NOTHING_THERE};
use super::transform::Sight;
use super::{Canvas, ImageView, Popup, Tool};
use crate::network::{ImageId, Network};
use crate::project::edit::Edit;
use crate::targets::DotIndex;
use crate::ui::action::{Action, Selection};
use crate::ui::context::ViewContext;

/// Who says where a dot is to be measured.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Pointed {
    /// The operator, by a click (px).
    Clicked(Vector2<f64>),
    /// A prediction or a refused candidate (px).
    Predicted(Vector2<f64>),
}

/// A list of labels that another panel asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Asked {
    /// For this dot.
    Dot(DotIndex),
    /// For the dot that is measured at this place, px.
    Place(Vector2<f64>),
}

impl ImageView {
    pub(super) fn keys(
        &mut self,
        ui: &Ui,
        canvas: &Canvas<'_>,
        context: &ViewContext<'_>,
        actions: &mut Vec<Action>,
    ) {
        let escape = |input: &mut egui::InputState| input.consume_key(Modifiers::NONE, Key::Escape);
        // Wherever the pointer is: a tool that waits for a click would hold the key back from everything else.
        if self.tool == Tool::Measure && self.popup.is_none() && ui.input_mut(escape) {
            self.tool = Tool::Look;
            self.notice = None;
        }
        let open = canvas.pointer.is_some() || canvas.response.has_focus();
        if !open || self.popup.is_some() || ui.ctx().text_edit_focused() {
            return;
        }
        let pressed = |key: Key| ui.input_mut(|input| input.consume_key(Modifiers::NONE, key));
        if pressed(Key::F) {
            self.sight = Sight::Fit;
        }
        if pressed(Key::Num1) {
            let middle = canvas.pointer.unwrap_or(canvas.rect.center());
            let per_point = f64::from(ui.ctx().pixels_per_point());
            let factor = 1.0 / (canvas.transform.scale * per_point);
            let size = [canvas.entry.file.width_px, canvas.entry.file.height_px];
            self.sight = self.sight.zoomed(canvas.rect, size, middle, factor);
        }
        if pressed(Key::Num0) {
            self.open_greys(canvas.picture.as_deref());
        }
        if pressed(Key::Z) {
            self.toggle_loupe();
        }
        if pressed(Key::A) {
            self.measure_key(canvas, context);
        }
        self.dot_keys(&pressed, canvas, context, actions);
    }

    /// `A` over a missed target or a refused candidate measures there at once; elsewhere the next click measures.
    fn measure_key(&mut self, canvas: &Canvas<'_>, context: &ViewContext<'_>) {
        let place = match canvas.hovered {
            Some(Hovered::Missed(missed)) => Some(missed.place_px),
            Some(Hovered::Candidate(slot)) => {
                let detections = canvas.marks.detections.as_ref();
                detections
                    .and_then(|d| d.rejected.get(slot))
                    .map(|rejected| rejected.place_px)
            }
            _ => None,
        };
        match place {
            Some(place) => {
                self.measure(canvas, context, Pointed::Predicted(place));
            }
            None => self.toggle_measure(),
        }
    }

    fn dot_keys(
        &mut self,
        pressed: &dyn Fn(Key) -> bool,
        canvas: &Canvas<'_>,
        context: &ViewContext<'_>,
        actions: &mut Vec<Action>,
    ) {
        let selected = selected_dot(&canvas.marks, self.image, context.selection);
        let hovered = match canvas.hovered {
            Some(Hovered::Dot(dot)) => Some(dot),
            _ => None,
        };
        let Some(dot) = hovered.or(selected) else {
            return;
        };
        let image = self.image;
        if pressed(Key::X) {
            actions.push(Action::Edit(Edit::Reject { image, dot }));
        }
        if pressed(Key::R) {
            actions.push(Action::Edit(Edit::Restore { image, dot }));
        }
        if pressed(Key::Delete) {
            actions.push(Action::Edit(Edit::Unlabel { image, dot }));
        }
        if pressed(Key::L) {
            self.open_labels(Subject::Dot(dot), canvas, context.network);
        }
        let reading = canvas.marks.of(dot).and_then(|mark| mark.reading);
        let code = reading.and_then(|reading| {
            Some((
                reading,
                canvas.marks.detections.as_ref()?.codes.get(reading)?,
            ))
        });
        if let Some((reading, code)) = code
            && pressed(Key::N)
        {
            let at = canvas.pointer.unwrap_or(canvas.rect.center());
            self.popup = Some(Popup::Number(NumberPopup::new(
                reading,
                at,
                code.family.code_count(),
            )));
        }
    }

    fn open_labels(&mut self, subject: Subject, canvas: &Canvas<'_>, network: &Network) {
        let place = match &subject {
            Subject::Dot(dot) => canvas.marks.of(*dot).map(|mark| mark.dot.centre_px),
            Subject::New { dot, .. } => Some(dot.centre_px),
        };
        let Some(place) = place else {
            return;
        };
        let ranked = rank_labels(network, self.image, place);
        let on_screen = canvas.transform.point(place);
        let at = if canvas.rect.contains(on_screen) {
            on_screen
        } else {
            canvas.rect.center()
        };
        self.popup = Some(Popup::Label(LabelPopup::new(subject, at, ranked)));
    }

    /// Measures at a place and asks for the label; `None` while the picture is not there.
    ///
    /// Where nothing can be fitted only a click makes a centre: a predicted place that is put in as a measurement
    /// confirms itself.
    fn measure(
        &mut self,
        canvas: &Canvas<'_>,
        context: &ViewContext<'_>,
        pointed: Pointed,
    ) -> Option<()> {
        let picture = canvas.picture.as_ref()?;
        // A dot is added to detections; before them there is nothing to add it to.
        let detections = canvas.marks.detections.as_ref()?;
        let (Pointed::Clicked(place) | Pointed::Predicted(place)) = pointed;
        let Some(measured) = MeasuredByHand::at(picture, place, &detections.dots) else {
            return Some(());
        };
        if let (Pointed::Predicted(_), Some(reason)) = (pointed, &measured.refused) {
            self.notice = Some(format!(
                "{NOTHING_THERE}; it is set where you click. {reason}"
            ));
            self.tool = Tool::Measure;
            return Some(());
        }
        self.notice = None;
        self.tool = Tool::Look;
        // A dot that is there already is named, not added a second time.
        let subject = match measured.known {
            Some(slot) => Subject::Dot(DotIndex(slot as u32)),
            None => Subject::New {
                note: measured.note(),
                dot: measured.dot,
            },
        };
        self.open_labels(subject, canvas, context.network);
        Some(())
    }

    /// Opens the list of labels that was asked for from outside, as soon as there is what it needs.
    pub(super) fn open_asked(&mut self, canvas: &Canvas<'_>, context: &ViewContext<'_>) {
        let opened = match self.asked {
            None => return,
            Some(Asked::Dot(dot)) => canvas.marks.of(dot).map(|mark| {
                let subject = Subject::Dot(mark.index);
                self.open_labels(subject, canvas, context.network);
            }),
            Some(Asked::Place(place)) => self.measure(canvas, context, Pointed::Predicted(place)),
        };
        if opened.is_some() {
            self.asked = None;
        }
    }

    pub(super) fn clicks(
        &mut self,
        canvas: &Canvas<'_>,
        context: &ViewContext<'_>,
        actions: &mut Vec<Action>,
    ) {
        let response = &canvas.response;
        if response.double_clicked() && canvas.hovered.is_none() {
            self.sight = Sight::Fit;
            return;
        }
        let Some(at) = response
            .interact_pointer_pos()
            .filter(|_| response.clicked())
        else {
            return;
        };
        if self.tool == Tool::Measure {
            let place = canvas.transform.pixel(at);
            self.measure(canvas, context, Pointed::Clicked(place));
            return;
        }
        self.popup = None;
        let image = Some(self.image);
        let selection = match hover::hovered(&canvas.marks, &canvas.transform, self.overlays, at) {
            Some(Hovered::Dot(dot)) => {
                let point = canvas.marks.of(dot).and_then(|mark| mark.point);
                Selection {
                    point,
                    image,
                    dot: Some((self.image, dot)),
                    ..Selection::default()
                }
            }
            Some(Hovered::Missed(missed)) => Selection {
                point: Some(missed.point),
                image,
                place: Some((self.image, missed.place_px.into())),
                ..Selection::default()
            },
            Some(Hovered::Candidate(_)) | None => Selection {
                image,
                ..Selection::default()
            },
        };
        actions.push(Action::Select(selection));
    }

    pub(super) fn popups(
        &mut self,
        ui: &Ui,
        canvas: &Canvas<'_>,
        context: &ViewContext<'_>,
        actions: &mut Vec<Action>,
    ) {
        let id = canvas.response.id.with("popup");
        let image = self.image;
        let was_open = self.popup.is_some();
        match &mut self.popup {
            Some(Popup::Label(popup)) => {
                let Some(choice) = popup.ui(ui.ctx(), id, context.network) else {
                    return;
                };
                let subject = popup.subject.clone();
                actions.extend(edit_of(image, subject, &choice).map(Action::Edit));
                self.popup = None;
            }
            Some(Popup::Number(popup)) => {
                let Some(entered) = popup.ui(ui.ctx(), id) else {
                    return;
                };
                if let Entered::Number(id) = entered {
                    let reading = popup.reading;
                    actions.push(Action::Edit(Edit::Renumber { image, reading, id }));
                }
                self.popup = None;
            }
            None => {}
        }
        if was_open && self.popup.is_none() {
            // Else the field keeps the keyboard until a frame has missed it.
            ui.memory_mut(egui::Memory::stop_text_input);
        }
    }
}

fn edit_of(image: ImageId, subject: Subject, choice: &Choice) -> Option<Edit> {
    let point = match choice {
        Choice::Point(point) => Some(*point),
        Choice::NoName => None,
        Choice::Cancel => return None,
    };
    match (subject, point) {
        (Subject::Dot(dot), Some(point)) => Some(Edit::Label { image, dot, point }),
        (Subject::Dot(_), None) => None,
        (Subject::New { dot, .. }, point) => Some(Edit::AddDot { image, dot, point }),
    }
}

/// The dot of this image that is selected itself, or by its point.
pub(super) fn selected_dot(
    marks: &Marks,
    image: ImageId,
    selection: &Selection,
) -> Option<DotIndex> {
    match selection.dot {
        Some((of, dot)) if of == image => Some(dot),
        _ => selection
            .point
            .and_then(|point| marks.of_point(point))
            .map(|mark| mark.index),
    }
}
