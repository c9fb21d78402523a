//! Labels over the picture: as many as can be read, none on another.

use egui::{Align2, Color32, FontId, Pos2, Rect, Vec2, vec2};

use super::marks::{CodeMark, Mark, Marks};
use super::occupancy::{Occupancy, Taken};
use super::overlay::{Easel, LEAST_ELLIPSE, Overlay, codes_in_sight};
use crate::targets::DotIndex;

/// Height of the letters, points.
const TEXT_SIZE: f32 = 11.0;

/// Width of a letter and height of a line, points: for the free place that a label needs.
const LETTER: f32 = 6.4;
const LINE: f32 = 12.0;

/// The dots of a code are named one by one where they stand so far apart, points.
const ROOM_FOR_PARTS: f32 = 25.0;

/// Whether a label needs a free place.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Place {
    /// It is drawn on whatever stands there.
    Any,
    /// It is left out where another stands.
    Free,
}

impl Easel<'_> {
    /// Labels of the dots in `always`, then the numbers of codes, then the names of their dots and of plain targets.
    ///
    /// Cost: marks in sight.
    pub(super) fn labels(
        &self,
        marks: &Marks,
        in_sight: &[&Mark],
        always: [Option<DotIndex>; 2],
        occupancy: &mut Occupancy,
    ) {
        let origin = self.transform.point(nalgebra::Vector2::zeros());
        occupancy.clear(self.rect, origin);
        let names = self.overlays.shows(Overlay::Labels);
        let wanted = always.into_iter().flatten().filter(|_| names);
        for mark in wanted.filter_map(|dot| marks.of(dot)) {
            let label = mark.label.as_deref().unwrap_or_default();
            self.beside(mark, label, Place::Any, occupancy);
        }
        if self.overlays.shows(Overlay::Codes) {
            for code in codes_in_sight(marks, &self.visible()) {
                self.number(code, occupancy);
            }
        }
        if !names {
            return;
        }
        for mark in in_sight.iter().filter(|m| !always.contains(&Some(m.index))) {
            let code = mark.reading.and_then(|reading| marks.codes.get(reading));
            let label = match (mark.part(), code) {
                (Some(part), Some(code)) => {
                    let room = self.transform.length(code.spacing_px) >= ROOM_FOR_PARTS;
                    Some(part).filter(|_| room)
                }
                _ => mark.label.as_deref(),
            };
            if let Some(label) = label {
                self.beside(mark, label, Place::Free, occupancy);
            }
        }
    }

    /// To the upper right of a dot.
    fn beside(&self, mark: &Mark, label: &str, place: Place, occupancy: &mut Occupancy) {
        let radius = self.transform.length(mark.dot.major_px).max(LEAST_ELLIPSE) / 2.0;
        let at =
            self.transform.point(mark.dot.centre_px) + vec2(0.75 * radius + 2.0, -0.75 * radius);
        let taken = Rect::from_min_size(at - vec2(0.0, LINE), size_of(label));
        if self.finds(taken, place, occupancy) {
            self.text(at, Align2::LEFT_BOTTOM, label, mark.class.colour());
        }
    }

    /// The number of a code, off its first dot and away from the others.
    fn number(&self, code: &CodeMark, occupancy: &mut Occupancy) {
        let Some(o) = code.axes.first().map(|o| self.transform.point(*o)) else {
            return;
        };
        let into = code
            .axes
            .iter()
            .skip(1)
            .map(|place| self.transform.point(*place) - o)
            .fold(Vec2::ZERO, |sum, axis| sum + axis);
        let away = match into.length() > 0.0 {
            true => -into.normalized(),
            false => vec2(0.7, -0.7),
        };
        let radius = self.transform.length(code.dot_px).max(LEAST_ELLIPSE) / 2.0;
        let size = size_of(&code.label);
        // The nearest place of the box in that direction that does not touch the dot.
        let reach = radius + 0.5 * (size.x * away.x.abs() + size.y * away.y.abs());
        let taken = Rect::from_center_size(o + reach * away, size);
        if self.finds(taken, Place::Free, occupancy) {
            let centre = taken.center();
            self.text(centre, Align2::CENTER_CENTER, &code.label, code.colour());
        }
    }

    fn finds(&self, taken: Rect, place: Place, occupancy: &mut Occupancy) -> bool {
        match place {
            Place::Any => {
                occupancy.take(taken);
                self.rect.intersects(taken)
            }
            Place::Free => occupancy.try_take(taken) == Taken::Yes,
        }
    }

    /// Text with a dark shadow, legible on light and dark grey.
    pub(super) fn text(&self, place: Pos2, align: Align2, text: &str, colour: Color32) {
        let font = FontId::proportional(TEXT_SIZE);
        let shadow = Color32::from_black_alpha(200);
        let galley = self
            .painter
            .layout_no_wrap(text.to_owned(), font, Color32::PLACEHOLDER);
        let corner = align.anchor_size(place, galley.size()).min;
        self.painter
            .galley(corner + vec2(1.0, 1.0), galley.clone(), shadow);
        self.painter.galley(corner, galley, colour);
    }
}

fn size_of(label: &str) -> Vec2 {
    vec2(LETTER * label.len() as f32, LINE)
}
