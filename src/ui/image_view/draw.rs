//! Drawing one frame: the picture, what lies over it, the loupe, the tooltip.

use std::sync::Arc;

use eframe::egui_wgpu;
use egui::{Color32, Pos2, Rect, Stroke, Ui, vec2};

use super::hover::{self, Hovered};
use super::labelling::{LabelPopup, Subject};
use super::marks::Marks;
use super::occupancy::Occupancy;
use super::overlay::{Easel, Focus, Overlay, Overlays};
use super::tiles::PictureCallback;
use super::tools::selected_dot;
use super::{Canvas, EpipolarCache, ImageView, Loupe, Popup, ScreenFromImage, prediction};
use crate::network::ImageId;
use crate::targets::DotIndex;
use crate::ui::action::Selection;
use crate::ui::context::ViewContext;

/// The surroundings of a dark picture are dark in both themes: the eye judges grey against them.
pub(super) const SURROUNDINGS: Color32 = Color32::from_gray(24);
/// Magnification of the loupe, screen points per pixel.
const LOUPE_SCALE: f64 = 16.0;
/// A small loupe magnifies less, so that so many pixels are seen across: a dot with its surroundings.
const LOUPE_LEAST_PX: f64 = 13.0;
/// Side of the loupe, points.
const LOUPE_SIDE: f32 = 220.0;

/// A part of the screen with what is drawn there.
#[derive(Clone, Copy)]
struct Field {
    rect: Rect,
    transform: ScreenFromImage,
    overlays: Overlays,
}

impl ImageView {
    pub(super) fn draw(&mut self, ui: &Ui, canvas: &Canvas<'_>, context: &ViewContext<'_>) {
        let painter = ui.painter_at(canvas.rect);
        painter.rect_filled(canvas.rect, 0.0, SURROUNDINGS);
        self.paint_picture(&painter, canvas, canvas.rect, canvas.transform, self.view);
        self.epipolar.update(context, self.image, &canvas.marks);
        // The memory of the grid goes from frame to frame.
        let mut occupancy = std::mem::take(&mut self.occupancy);
        let whole = Field {
            rect: canvas.rect,
            transform: canvas.transform,
            overlays: self.overlays,
        };
        self.overlay(&painter, canvas, context, whole, &mut occupancy);
        if self.loupe == Loupe::Open
            && let Some(pointer) = canvas.pointer
        {
            self.draw_loupe(ui, canvas, context, pointer, &mut occupancy);
        }
        self.occupancy = occupancy;
    }

    fn paint_picture(
        &self,
        painter: &egui::Painter,
        canvas: &Canvas<'_>,
        rect: Rect,
        transform: ScreenFromImage,
        view: u64,
    ) {
        if let (Some(picture), Some(window)) = (&canvas.picture, self.window) {
            let callback = PictureCallback {
                view,
                image: self.image,
                picture: Arc::clone(picture),
                transform,
                rect,
                window,
                context: painter.ctx().clone(),
            };
            painter.add(egui_wgpu::Callback::new_paint_callback(rect, callback));
        }
    }

    fn overlay(
        &self,
        painter: &egui::Painter,
        canvas: &Canvas<'_>,
        context: &ViewContext<'_>,
        field: Field,
        occupancy: &mut Occupancy,
    ) {
        let easel = Easel {
            painter,
            rect: field.rect,
            transform: field.transform,
            overlays: field.overlays,
            exaggeration: self.exaggeration,
        };
        let marks = &canvas.marks;
        let selected = selected_dot(marks, self.image, context.selection);
        let focus = self.focus(marks, selected, context.selection);
        easel.epipolar(&self.epipolar.lines, focus);
        let hovered = match canvas.hovered {
            Some(Hovered::Dot(dot)) => Some(dot),
            _ => None,
        };
        easel.draw(marks, [selected, hovered], occupancy);
        match &context.selection.question {
            Some(question) => easel.question(context.network, self.image, question),
            None => {
                if let Some(focus) = focus {
                    easel.selected(focus);
                }
            }
        }
        if let Some(Popup::Label(LabelPopup {
            subject: Subject::New { dot, .. },
            ..
        })) = &self.popup
        {
            easel.outline(dot, Stroke::new(2.0, crate::ui::theme::SELECTED));
        }
    }

    /// Where the selected dot, target or place stands in this picture.
    fn focus(
        &self,
        marks: &Marks,
        selected: Option<DotIndex>,
        selection: &Selection,
    ) -> Option<Focus> {
        let dot = selected.and_then(|dot| marks.of(dot)).map(|mark| Focus {
            place_px: mark.dot.centre_px,
            size_px: mark.dot.major_px,
        });
        let missed = || {
            let point = selection.point?;
            let missed = marks.missed.iter().find(|m| m.point == point)?;
            Some(missed.place_px)
        };
        let place = || {
            let (_, place) = selection.place.filter(|(image, _)| *image == self.image)?;
            Some(place.into())
        };
        dot.or_else(|| {
            Some(Focus {
                place_px: missed().or_else(place)?,
                size_px: marks.dot_px,
            })
        })
    }

    fn draw_loupe(
        &self,
        ui: &Ui,
        canvas: &Canvas<'_>,
        context: &ViewContext<'_>,
        pointer: Pos2,
        occupancy: &mut Occupancy,
    ) {
        let side = LOUPE_SIDE
            .min(0.6 * canvas.rect.width())
            .min(0.6 * canvas.rect.height());
        let margin = vec2(8.0, 8.0);
        let mut rect = Rect::from_min_max(
            canvas.rect.max - margin - vec2(side, side),
            canvas.rect.max - margin,
        );
        if rect.expand(20.0).contains(pointer) {
            rect = Rect::from_min_size(canvas.rect.min + margin, vec2(side, side));
        }
        let painter = ui.painter_at(rect);
        let scale = LOUPE_SCALE.min(f64::from(side) / LOUPE_LEAST_PX);
        let transform = ScreenFromImage::centred(rect, canvas.transform.pixel(pointer), scale);
        painter.rect_filled(rect, 0.0, SURROUNDINGS);
        self.paint_picture(&painter, canvas, rect, transform, self.view.wrapping_add(1));
        let field = Field {
            rect,
            transform,
            // Vectors hundreds of times as long as they are would only cross the pixels.
            overlays: self.overlays.without(Overlay::Residuals),
        };
        self.overlay(&painter, canvas, context, field, occupancy);
        let line = Stroke::new(1.0, Color32::from_white_alpha(120));
        let centre = rect.center();
        painter.line_segment([centre - vec2(6.0, 0.0), centre + vec2(6.0, 0.0)], line);
        painter.line_segment([centre - vec2(0.0, 6.0), centre + vec2(0.0, 6.0)], line);
        painter.rect_stroke(
            rect,
            0.0,
            Stroke::new(1.0, Color32::from_gray(140)),
            egui::StrokeKind::Inside,
        );
    }

    pub(super) fn tooltip(&self, canvas: &Canvas<'_>, context: &ViewContext<'_>) {
        let Some(hovered) = canvas
            .hovered
            .filter(|_| self.popup.is_none() && !canvas.response.dragged())
        else {
            return;
        };
        let marks = &canvas.marks;
        canvas
            .response
            .clone()
            .on_hover_ui_at_pointer(|ui| match hovered {
                Hovered::Dot(dot) => {
                    if let Some(mark) = marks.of(dot) {
                        hover::dot_tooltip(ui, mark);
                    }
                }
                Hovered::Missed(missed) => {
                    let refused = marks.refused_near(missed.place_px);
                    let mut absent = canvas.entry.absent();
                    let absence = absent.find(|(point, _)| *point == missed.point);
                    let absence = absence.filter(|_| missed.absence.is_some());
                    let absence = absence.map(|(_, absence)| absence);
                    hover::missed_tooltip(ui, &missed, absence, refused, context.network);
                }
                Hovered::Candidate(slot) => {
                    if let Some(rejected) =
                        marks.detections.as_ref().and_then(|d| d.rejected.get(slot))
                    {
                        hover::candidate_tooltip(ui, rejected);
                    }
                }
            });
    }
}

impl EpipolarCache {
    fn update(&mut self, context: &ViewContext<'_>, image: ImageId, marks: &Arc<Marks>) {
        let known = self.of.as_ref().is_some_and(|(selection, of)| {
            selection == context.selection && Arc::ptr_eq(of, marks)
        });
        if !known {
            self.lines = prediction::epipolar_lines(context.network, image, context.selection);
            self.of = Some((context.selection.clone(), Arc::clone(marks)));
        }
    }
}
