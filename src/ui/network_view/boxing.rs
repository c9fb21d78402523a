//! Box select: all points within a rectangle of the screen.

use std::collections::BTreeSet;

use egui::Color32;
use egui::Key;
use egui::PointerButton;
use egui::Pos2;
use egui::Rect;
use egui::Response;
use egui::Stroke;

use super::camera::OrbitCamera;
use super::scene::Scene;
use crate::network::PointId;

/// What dragging does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Tool {
    /// Turns the view.
    #[default]
    Turn,
    /// Draws a box.
    Box,
}

/// A box that is being drawn.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Boxing {
    pub(super) tool: Tool,
    from: Option<Pos2>,
}

impl Boxing {
    /// Whether a drag draws a box: the tool is chosen, `B` is held, or a box has been begun.
    pub(super) fn takes(&self, ui: &egui::Ui, response: &Response) -> bool {
        let held = ui.input(|input| input.key_down(Key::B)) && !ui.ctx().text_edit_focused();
        let primary = response.dragged_by(PointerButton::Primary)
            || response.drag_stopped_by(PointerButton::Primary);
        primary && (self.tool == Tool::Box || held || self.from.is_some())
    }

    /// Forgets a box that was begun.
    pub(super) fn forget(&mut self) {
        self.from = None;
    }

    /// Draws the box; its rectangle when it is finished.
    pub(super) fn drag(
        &mut self,
        ui: &egui::Ui,
        response: &Response,
        colour: Color32,
    ) -> Option<Rect> {
        let pointer = response.interact_pointer_pos()?;
        let begin = ui
            .input(|input| input.pointer.press_origin())
            .unwrap_or(pointer);
        let from = *self.from.get_or_insert(begin);
        let rect = Rect::from_two_pos(from, pointer);
        if response.drag_stopped_by(PointerButton::Primary) {
            self.from = None;
            return Some(rect);
        }
        ui.painter_at(response.rect).rect_stroke(
            rect,
            0.0,
            Stroke::new(1.0, colour),
            egui::StrokeKind::Middle,
        );
        None
    }
}

/// The points within a rectangle of the screen.
pub(super) fn points_within(
    scene: &Scene,
    camera: &OrbitCamera,
    canvas: Rect,
    rect: Rect,
) -> BTreeSet<PointId> {
    let projector = camera.projector(canvas);
    scene
        .points
        .iter()
        .filter(|point| {
            let seen = projector.project(point.position);
            seen.is_some_and(|seen| rect.contains(seen.position))
        })
        .map(|point| point.id)
        .collect()
}
