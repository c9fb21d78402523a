//! Drawing one frame: the picture, what lies over it, the loupe, the tooltip.

use std::sync::Arc;

use eframe::egui_wgpu;
use egui::{Color32, Pos2, Rect, Stroke, Ui, vec2};

use super::hover::{self, Hovered};
use super::labelling::{LabelPopup, Subject};
use super::marks::Marks;
use super::overlay::Easel;
use super::tiles::PictureCallback;
use super::tools::selected_dot;
use super::{Canvas, EpipolarCache, ImageView, Loupe, Popup, ScreenFromImage, prediction};
use crate::network::{ImageId, PointId};
use crate::ui::context::ViewContext;

/// Magnification of the loupe, screen points per pixel.
const LOUPE_SCALE: f64 = 16.0;
/// Side of the loupe, points.
const LOUPE_SIDE: f32 = 220.0;

impl ImageView {
    pub(super) fn draw(&mut self, ui: &Ui, canvas: &Canvas<'_>, context: &ViewContext<'_>) {
        let painter = ui.painter_at(canvas.rect);
        // The surroundings of a dark picture are dark in both themes: the eye judges grey against them.
        painter.rect_filled(canvas.rect, 0.0, Color32::from_gray(24));
        self.paint_picture(&painter, canvas, canvas.rect, canvas.transform, self.view);
        self.epipolar.update(context, self.image, &canvas.marks);
        self.overlay(&painter, canvas, context, canvas.rect, canvas.transform);
        if self.loupe == Loupe::Open
            && let Some(pointer) = canvas.pointer
        {
            self.draw_loupe(ui, canvas, context, pointer);
        }
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
        rect: Rect,
        transform: ScreenFromImage,
    ) {
        let easel = Easel {
            painter,
            rect,
            transform,
            overlays: self.overlays,
            exaggeration: self.exaggeration,
        };
        easel.epipolar(&self.epipolar.lines);
        easel.draw(&canvas.marks);
        let marks = &canvas.marks;
        if let Some(mark) =
            selected_dot(marks, self.image, context.selection).and_then(|dot| marks.of(dot))
        {
            easel.selected(mark.dot.centre_px, mark.dot.major_px);
        } else if let Some(missed) = context
            .selection
            .point
            .and_then(|point| marks.missed.iter().find(|m| m.point == point))
        {
            easel.selected(missed.place_px, 6.0);
        } else if let Some((_, place)) = context
            .selection
            .place
            .filter(|(image, _)| *image == self.image)
        {
            easel.selected(place.into(), 6.0);
        }
        if let Some(Popup::Label(LabelPopup {
            subject: Subject::New { dot, .. },
            ..
        })) = &self.popup
        {
            easel.outline(dot, Stroke::new(2.0, crate::ui::theme::SELECTED));
        }
    }

    fn draw_loupe(&self, ui: &Ui, canvas: &Canvas<'_>, context: &ViewContext<'_>, pointer: Pos2) {
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
        let transform =
            ScreenFromImage::centred(rect, canvas.transform.pixel(pointer), LOUPE_SCALE);
        painter.rect_filled(rect, 0.0, Color32::from_gray(24));
        self.paint_picture(&painter, canvas, rect, transform, self.view.wrapping_add(1));
        self.overlay(&painter, canvas, context, rect, transform);
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
                Hovered::Missed(missed) => hover::missed_tooltip(ui, &missed, context.network),
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
            let point: Option<PointId> = context.selection.point;
            self.lines =
                prediction::epipolar_lines(context.network, image, context.selection.dot, point);
            self.of = Some((context.selection.clone(), Arc::clone(marks)));
        }
    }
}
