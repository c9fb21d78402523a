//! Drawing over the picture: only what is in sight, and no more detail than the eye can tell.

use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Shape, Stroke, pos2, vec2};
use nalgebra::Vector2;

use super::marks::{CodeMark, Mark, Marks};
use super::prediction::{Facing, Predicted};
use super::transform::{PixelRect, ScreenFromImage};
use crate::targets::Dot;
use crate::ui::theme;

/// One kind of overlay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overlay {
    /// Dots with their ellipses.
    Dots,
    /// Labels of dots.
    Labels,
    /// Codes with axes and number.
    Codes,
    /// Refused candidates.
    Candidates,
    /// Residual vectors.
    Residuals,
    /// Predicted places of missed targets.
    Missed,
    /// Epipolar lines of what is selected.
    Epipolar,
}

impl Overlay {
    /// All of them, in the order of the menu.
    pub const ALL: [Overlay; 7] = [
        Overlay::Dots,
        Overlay::Labels,
        Overlay::Codes,
        Overlay::Candidates,
        Overlay::Residuals,
        Overlay::Missed,
        Overlay::Epipolar,
    ];

    /// As the menu says it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Overlay::Dots => "Dots",
            Overlay::Labels => "Labels",
            Overlay::Codes => "Codes with axes",
            Overlay::Candidates => "Refused candidates",
            Overlay::Residuals => "Residuals",
            Overlay::Missed => "Missed targets, predicted",
            Overlay::Epipolar => "Epipolar lines of the selection",
        }
    }

    fn bit(self) -> u8 {
        1 << (self as u8)
    }
}

/// Which overlays are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Overlays(u8);

impl Default for Overlays {
    fn default() -> Self {
        Self(
            Overlay::ALL
                .iter()
                .fold(0, |bits, overlay| bits | overlay.bit()),
        )
    }
}

impl Overlays {
    /// No overlay.
    pub const NONE: Overlays = Overlays(0);

    /// Whether one is shown.
    #[must_use]
    pub fn shows(self, overlay: Overlay) -> bool {
        self.0 & overlay.bit() != 0
    }

    /// Shows what is hidden, hides what is shown.
    pub fn toggle(&mut self, overlay: Overlay) {
        self.0 ^= overlay.bit();
    }
}

/// Labels are drawn while no more dots than this are in sight: more would cover the picture and each other.
const MOST_LABELS: usize = 250;
/// Below this size on the screen an ellipse is drawn as a small circle, points.
const LEAST_ELLIPSE: f32 = 5.0;

/// Draws over one rectangle.
pub(super) struct Easel<'a> {
    pub(super) painter: &'a Painter,
    pub(super) rect: Rect,
    pub(super) transform: ScreenFromImage,
    pub(super) overlays: Overlays,
    /// Residual vectors are drawn so many times as long as they are.
    pub(super) exaggeration: f64,
}

impl Easel<'_> {
    fn visible(&self) -> PixelRect {
        self.transform.visible(self.rect)
    }

    /// Everything but the selection.
    pub(super) fn draw(&self, marks: &Marks) {
        if self.overlays.shows(Overlay::Candidates) {
            self.candidates(marks);
        }
        let in_sight = marks_in_sight(marks, &self.visible());
        if self.overlays.shows(Overlay::Codes) {
            self.codes(&marks.codes);
        }
        if self.overlays.shows(Overlay::Dots) {
            for mark in &in_sight {
                self.outline(&mark.dot, Stroke::new(1.3, mark.class.colour()));
            }
        }
        if self.overlays.shows(Overlay::Labels) && in_sight.len() <= MOST_LABELS {
            for mark in &in_sight {
                self.label(mark);
            }
        }
        if self.overlays.shows(Overlay::Residuals) {
            self.residuals(&in_sight);
        }
        if self.overlays.shows(Overlay::Missed) {
            let visible = self.visible();
            for missed in marks
                .missed
                .iter()
                .filter(|m| visible.holds(m.place_px, 8.0))
            {
                self.missed(missed);
            }
        }
    }

    /// The measured ellipse with its centre when there is room for it.
    pub(super) fn outline(&self, dot: &Dot, stroke: Stroke) {
        let centre = self.transform.point(dot.centre_px);
        let size = self.transform.length(dot.major_px);
        if size < LEAST_ELLIPSE {
            self.painter
                .circle_stroke(centre, LEAST_ELLIPSE / 2.0, stroke);
            return;
        }
        self.painter
            .add(Shape::closed_line(self.ellipse(dot), stroke));
        if size > 24.0 {
            self.cross(centre, 3.0, stroke);
        }
    }

    fn ellipse(&self, dot: &Dot) -> Vec<Pos2> {
        let corners = if self.transform.length(dot.major_px) > 40.0 {
            64
        } else {
            20
        };
        let (sin, cos) = dot.angle.sin_cos();
        (0..corners)
            .map(|index| {
                let angle = std::f64::consts::TAU * f64::from(index) / f64::from(corners);
                let along = 0.5 * dot.major_px * angle.cos();
                let across = 0.5 * dot.minor_px * angle.sin();
                let offset = Vector2::new(along * cos - across * sin, along * sin + across * cos);
                self.transform.point(dot.centre_px + offset)
            })
            .collect()
    }

    fn cross(&self, centre: Pos2, arm: f32, stroke: Stroke) {
        self.painter
            .line_segment([centre - vec2(arm, 0.0), centre + vec2(arm, 0.0)], stroke);
        self.painter
            .line_segment([centre - vec2(0.0, arm), centre + vec2(0.0, arm)], stroke);
    }

    fn label(&self, mark: &Mark) {
        let Some(label) = &mark.label else {
            return;
        };
        let radius = self.transform.length(mark.dot.major_px).max(LEAST_ELLIPSE) / 2.0;
        let place =
            self.transform.point(mark.dot.centre_px) + vec2(0.75 * radius + 3.0, -0.75 * radius);
        self.text(place, Align2::LEFT_BOTTOM, label, mark.class.colour());
    }

    /// Text with a dark shadow, legible on light and dark grey.
    fn text(&self, place: Pos2, align: Align2, text: &str, colour: Color32) {
        let font = FontId::proportional(11.0);
        let shadow = Color32::from_black_alpha(200);
        self.painter
            .text(place + vec2(1.0, 1.0), align, text, font.clone(), shadow);
        self.painter.text(place, align, text, font, colour);
    }

    fn codes(&self, codes: &[CodeMark]) {
        let visible = self.visible();
        // A code reaches over some ten of its dots' diameters.
        const REACH_PX: f64 = 200.0;
        let in_sight: Vec<&CodeMark> = codes
            .iter()
            .filter(|code| {
                code.axes
                    .first()
                    .is_some_and(|o| visible.holds(*o, REACH_PX))
            })
            .collect();
        for code in &in_sight {
            let colour = if code.doubt.is_some() {
                theme::DOUBTFUL
            } else {
                theme::CODE
            };
            let points: Vec<Pos2> = code
                .axes
                .iter()
                .map(|place| self.transform.point(*place))
                .collect();
            if let [o, a, b] = points[..] {
                self.painter.line_segment([o, a], Stroke::new(1.5, colour));
                self.painter.line_segment([o, b], Stroke::new(1.0, colour));
                if o.distance(a) > 30.0 {
                    self.text(a + vec2(-6.0, -4.0), Align2::RIGHT_BOTTOM, "A", colour);
                    self.text(b + vec2(-6.0, -4.0), Align2::RIGHT_BOTTOM, "B", colour);
                }
                if in_sight.len() <= MOST_LABELS {
                    self.text(
                        o + (a - o) * 0.5 + (b - o) * 0.5,
                        Align2::CENTER_CENTER,
                        &code.label,
                        colour,
                    );
                }
            }
        }
    }

    fn candidates(&self, marks: &Marks) {
        let visible = self.visible();
        let stroke = Stroke::new(1.0, theme::REJECTED.gamma_multiply(0.8));
        for rejected in marks
            .detections
            .iter()
            .flat_map(|detections| &detections.rejected)
        {
            if visible.holds(rejected.place_px, 0.0) {
                let centre = self.transform.point(rejected.place_px);
                self.painter
                    .line_segment([centre - vec2(3.0, 3.0), centre + vec2(3.0, 3.0)], stroke);
                self.painter
                    .line_segment([centre - vec2(3.0, -3.0), centre + vec2(3.0, -3.0)], stroke);
            }
        }
    }

    fn residuals(&self, marks: &[&Mark]) {
        let mut any = false;
        for mark in marks {
            let Some(observation) = &mark.observation else {
                continue;
            };
            any = true;
            let start = self.transform.point(mark.dot.centre_px);
            let end = self
                .transform
                .point(mark.dot.centre_px + observation.residual_px * self.exaggeration);
            self.arrow(start, end, Stroke::new(1.2, mark.class.colour()));
        }
        if any {
            self.residual_scale();
        }
    }

    fn arrow(&self, start: Pos2, end: Pos2, stroke: Stroke) {
        let along = end - start;
        let length = along.length();
        if length < 1.0 {
            return;
        }
        self.painter.line_segment([start, end], stroke);
        let head = along / length * length.min(6.0);
        self.painter
            .line_segment([end, end - head + 0.5 * head.rot90()], stroke);
        self.painter
            .line_segment([end, end - head - 0.5 * head.rot90()], stroke);
    }

    /// A bar of a round number of pixels with the scale in words.
    fn residual_scale(&self) {
        let points_a_px = self.transform.scale * self.exaggeration;
        if !(points_a_px.is_finite() && points_a_px > 0.0) {
            return;
        }
        let decade = 10.0_f64.powf((120.0 / points_a_px).log10().floor());
        let length = (decade * points_a_px) as f32;
        let start = pos2(self.rect.left() + 12.0, self.rect.bottom() - 14.0);
        self.painter.line_segment(
            [start, start + vec2(length, 0.0)],
            Stroke::new(2.0, Color32::WHITE),
        );
        let text = format!("residuals x {:.0}: {decade} px", self.exaggeration);
        self.text(
            start - vec2(0.0, 4.0),
            Align2::LEFT_BOTTOM,
            &text,
            Color32::WHITE,
        );
    }

    fn missed(&self, missed: &Predicted) {
        let strength = match missed.facing {
            Facing::Towards => 1.0,
            Facing::Unknown => 0.4,
        };
        let stroke = Stroke::new(1.2, theme::PREDICTED.gamma_multiply(strength));
        let centre = self.transform.point(missed.place_px);
        self.painter.circle_stroke(centre, 6.0, stroke);
        self.painter
            .line_segment([centre - vec2(2.0, 0.0), centre + vec2(2.0, 0.0)], stroke);
    }

    /// A ring round what is selected.
    pub(super) fn selected(&self, place: Vector2<f64>, size_px: f64) {
        let centre = self.transform.point(place);
        let radius = self.transform.length(size_px).max(LEAST_ELLIPSE) / 2.0 + 5.0;
        self.painter
            .circle_stroke(centre, radius, Stroke::new(2.0, theme::SELECTED));
    }

    pub(super) fn epipolar(&self, lines: &[Vec<Vector2<f64>>]) {
        if !self.overlays.shows(Overlay::Epipolar) {
            return;
        }
        for line in lines {
            let points = line
                .iter()
                .map(|place| self.transform.point(*place))
                .collect();
            self.painter.add(Shape::line(
                points,
                Stroke::new(1.0, theme::SELECTED.gamma_multiply(0.7)),
            ));
        }
    }
}

/// The dots in a part of the picture, with those whose ellipse reaches into it.
pub(super) fn marks_in_sight<'a>(marks: &'a Marks, visible: &PixelRect) -> Vec<&'a Mark> {
    marks
        .dots
        .iter()
        .filter(|mark| visible.holds(mark.dot.centre_px, mark.dot.major_px / 2.0))
        .collect()
}
