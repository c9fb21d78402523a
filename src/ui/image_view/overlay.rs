//! Drawing over the picture: only what is in sight, and no more detail than the eye can tell.

use egui::{Align2, Color32, Painter, Pos2, Rect, Shape, Stroke, pos2, vec2};
use nalgebra::Vector2;

use super::marks::{CodeMark, Mark, Marks};
use super::occupancy::Occupancy;
use super::prediction::{Facing, Predicted};
use super::transform::{PixelRect, ScreenFromImage};
use crate::targets::{Dot, DotIndex};
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
    /// Predicted places of targets that are turned away or hidden, as far as other images tell.
    Hidden,
    /// Epipolar lines of what is selected.
    Epipolar,
}

impl Overlay {
    /// All of them, in the order of the menu.
    pub const ALL: [Overlay; 8] = [
        Overlay::Dots,
        Overlay::Labels,
        Overlay::Codes,
        Overlay::Candidates,
        Overlay::Residuals,
        Overlay::Missed,
        Overlay::Hidden,
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
            Overlay::Hidden => "Hidden targets, predicted",
            Overlay::Epipolar => "Epipolar lines of the selection",
        }
    }

    fn bit(self) -> u8 {
        1 << (self as u8)
    }
}

/// Which overlays are shown; at first all but hidden targets, which nobody can mend.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Overlays(u8);

impl Default for Overlays {
    fn default() -> Self {
        Self(
            Overlay::ALL
                .iter()
                .filter(|overlay| **overlay != Overlay::Hidden)
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

    /// The others of those that are shown.
    pub(super) fn without(self, overlay: Overlay) -> Self {
        Self(self.0 & !overlay.bit())
    }

    /// Whether a predicted place is shown.
    pub(super) fn shows_predicted(self, predicted: &Predicted) -> bool {
        self.shows(match predicted.facing {
            Facing::Towards => Overlay::Missed,
            Facing::Unknown => Overlay::Hidden,
        })
    }
}

/// Below this size on the screen a dot is drawn as a small mark, points: an ellipse would hide it.
pub(super) const LEAST_ELLIPSE: f32 = 5.0;

/// Shorter axes of a code are left out, points: they would be but a blot.
const LEAST_AXIS: f32 = 8.0;

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
    pub(super) fn visible(&self) -> PixelRect {
        self.transform.visible(self.rect)
    }

    /// Everything but the selection. The dots in `always` keep their labels however crowded the picture is.
    pub(super) fn draw(
        &self,
        marks: &Marks,
        always: [Option<DotIndex>; 2],
        occupancy: &mut Occupancy,
    ) {
        let visible = self.visible();
        if self.overlays.shows(Overlay::Candidates) {
            self.candidates(marks);
        }
        let in_sight = marks_in_sight(marks, &visible);
        if self.overlays.shows(Overlay::Codes) {
            codes_in_sight(marks, &visible).for_each(|code| self.axes(code));
        }
        if self.overlays.shows(Overlay::Dots) {
            for mark in &in_sight {
                self.outline(&mark.dot, Stroke::new(1.3, mark.class.colour()));
            }
        }
        if self.overlays.shows(Overlay::Residuals) {
            self.residuals(&in_sight);
        }
        let predicted = marks.missed.iter();
        for missed in predicted.filter(|m| self.overlays.shows_predicted(m)) {
            if visible.holds(missed.place_px, marks.dot_px) {
                self.missed(missed, marks.dot_px);
            }
        }
        self.labels(marks, &in_sight, always, occupancy);
    }

    /// The measured ellipse with its centre when there is room for it.
    pub(super) fn outline(&self, dot: &Dot, stroke: Stroke) {
        let centre = self.transform.point(dot.centre_px);
        let size = self.transform.length(dot.major_px);
        if size < LEAST_ELLIPSE {
            let radius = (0.35 * size).max(1.0);
            self.painter.circle_filled(centre, radius, stroke.color);
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

    fn axes(&self, code: &CodeMark) {
        if let [o, a, b] = code.axes[..] {
            let [o, a, b] = [o, a, b].map(|place| self.transform.point(place));
            if o.distance(a) >= LEAST_AXIS {
                let colour = code.colour();
                self.painter.line_segment([o, a], Stroke::new(1.5, colour));
                self.painter.line_segment([o, b], Stroke::new(1.0, colour));
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

    /// A ring that leaves the place itself free: what stands there is to be judged. What is seen flatly has a faint one without arms: there
    /// are many of those.
    fn missed(&self, missed: &Predicted, dot_px: f64) {
        let (strength, least) = match missed.turned {
            Facing::Towards => (1.0, 3.5),
            Facing::Unknown => (0.55, 1.5),
        };
        let stroke = Stroke::new(1.2, theme::PREDICTED.gamma_multiply(strength));
        let centre = self.transform.point(missed.place_px);
        let radius = (0.75 * self.transform.length(dot_px)).clamp(least, 40.0);
        self.painter.circle_stroke(centre, radius, stroke);
        if missed.turned == Facing::Unknown {
            return;
        }
        for side in [-1.0, 1.0] {
            let (from, to) = (vec2(side * radius, 0.0), vec2(side * (radius + 3.0), 0.0));
            self.painter
                .line_segment([centre + from, centre + to], stroke);
        }
    }

    /// A ring round what is selected.
    pub(super) fn selected(&self, focus: Focus) {
        let centre = self.transform.point(focus.place_px);
        let radius = self.ring(focus);
        self.painter
            .circle_stroke(centre, radius, Stroke::new(2.0, theme::SELECTED));
    }

    fn ring(&self, focus: Focus) -> f32 {
        self.transform.length(focus.size_px).max(LEAST_ELLIPSE) / 2.0 + 5.0
    }

    /// Epipolar lines, the fainter the more there are; they stop before what is selected, which they all go through.
    pub(super) fn epipolar(&self, lines: &[Vec<Vector2<f64>>], focus: Option<Focus>) {
        /// Lines keep off the ring by so much, and stop at least so far from its centre, points.
        const OFF_THE_RING: f32 = 3.0;
        const LEAST_GAP: f32 = 14.0;
        if !self.overlays.shows(Overlay::Epipolar) {
            return;
        }
        let gap = focus.map(|focus| {
            let radius = (self.ring(focus) + OFF_THE_RING).max(LEAST_GAP);
            (self.transform.point(focus.place_px), radius)
        });
        let crowd = (lines.len() as f32 / 3.0).max(1.0);
        let colour = theme::SELECTED.gamma_multiply((0.7 / crowd.sqrt()).max(0.25));
        let stroke = Stroke::new(if crowd > 1.0 { 0.7 } else { 1.0 }, colour);
        for line in lines {
            let points = line.iter().map(|place| self.transform.point(*place));
            for piece in outside(points, gap) {
                self.painter.add(Shape::line(piece, stroke));
            }
        }
    }
}

/// What is selected in this picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Focus {
    pub(super) place_px: Vector2<f64>,
    /// Its diameter, px.
    pub(super) size_px: f64,
}

/// The pieces of a line outside a circle (centre and radius, points).
pub(super) fn outside(
    line: impl Iterator<Item = Pos2>,
    circle: Option<(Pos2, f32)>,
) -> Vec<Vec<Pos2>> {
    let mut pieces: Vec<Vec<Pos2>> = vec![Vec::new()];
    let mut before: Option<Pos2> = None;
    for point in line {
        if let (Some(from), Some(circle)) = (before, circle)
            && let Some([enters, leaves]) = crossing(from, point, circle)
        {
            let at = |share: f32| from + share * (point - from);
            if let Some(piece) = pieces.last_mut().filter(|_| enters > 0.0) {
                piece.push(at(enters));
            }
            pieces.push(Vec::new());
            if let Some(piece) = pieces.last_mut().filter(|_| leaves < 1.0) {
                piece.push(at(leaves));
            }
        }
        let inside = circle.is_some_and(|(centre, radius)| centre.distance(point) < radius);
        if let Some(piece) = pieces.last_mut().filter(|_| !inside) {
            piece.push(point);
        }
        before = Some(point);
    }
    pieces.retain(|piece| piece.len() > 1);
    pieces
}

/// The part of a stretch within a circle, as shares of its length; `None` where it passes by.
fn crossing(from: Pos2, to: Pos2, (centre, radius): (Pos2, f32)) -> Option<[f32; 2]> {
    let (along, off) = (to - from, from - centre);
    let square = along.length_sq();
    let middle = -off.dot(along) / square;
    let under = middle * middle - (off.length_sq() - radius * radius) / square;
    let half = (under > 0.0).then(|| under.sqrt())?;
    let [enters, leaves] = [middle - half, middle + half];
    (enters < 1.0 && leaves > 0.0).then_some([enters, leaves])
}

/// The codes in a part of the picture.
pub(super) fn codes_in_sight<'a>(
    marks: &'a Marks,
    visible: &PixelRect,
) -> impl Iterator<Item = &'a CodeMark> + use<'a> {
    let visible = *visible;
    // A code reaches over some ten of its dots' diameters.
    const REACH_DIAMETERS: f64 = 20.0;
    let reach = REACH_DIAMETERS * marks.dot_px;
    marks.codes.iter().filter(move |code| {
        let first = code.axes.first();
        first.is_some_and(|o| visible.holds(*o, reach))
    })
}

/// The dots in a part of the picture, with those whose ellipse reaches into it.
pub(super) fn marks_in_sight<'a>(marks: &'a Marks, visible: &PixelRect) -> Vec<&'a Mark> {
    marks
        .dots
        .iter()
        .filter(|mark| visible.holds(mark.dot.centre_px, mark.dot.major_px / 2.0))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_left_of_a_line_is_outside_the_circle(
            ends in prop::collection::vec((-100.0..100.0_f32, -100.0..100.0_f32), 2..12),
            radius in 2.0..60.0_f32,
        ) {
            let line: Vec<Pos2> = ends.iter().map(|(x, y)| pos2(*x, *y)).collect();
            let pieces = outside(line.iter().copied(), Some((Pos2::ZERO, radius)));
            for pair in pieces.iter().flat_map(|piece| piece.windows(2)) {
                let (from, along) = (pair[0], pair[1] - pair[0]);
                let share = -from.to_vec2().dot(along) / along.length_sq().max(1e-9);
                let nearest = from + share.clamp(0.0, 1.0) * along;
                // Screen places are f32 of some hundred points.
                prop_assert!(nearest.to_vec2().length() > radius - 1e-2, "{pair:?}");
            }
        }
    }

    #[test]
    fn a_line_through_the_circle_has_two_pieces() {
        let line = || [pos2(-50.0, 0.0), pos2(50.0, 0.0)].into_iter();
        let pieces = outside(line(), Some((Pos2::ZERO, 10.0)));
        let ends: Vec<f32> = pieces.iter().flatten().map(|end| end.x).collect();
        assert_eq!(ends.len(), 4, "{pieces:?}");
        for (end, expected) in ends.iter().zip([-50.0, -10.0, 10.0, 50.0]) {
            // The rounding of f32.
            assert!((end - expected).abs() < 1e-4, "{pieces:?}");
        }
        assert_eq!(outside(line(), None).len(), 1);
        assert_eq!(outside(line(), Some((pos2(0.0, 40.0), 10.0))).len(), 1);
    }

    #[test]
    fn hidden_targets_are_not_shown_at_first() {
        let shown = Overlays::default();
        let hidden: Vec<Overlay> = (Overlay::ALL.into_iter())
            .filter(|overlay| !shown.shows(*overlay))
            .collect();
        assert_eq!(hidden, [Overlay::Hidden]);
    }
}
