//! A group of dots that waits for a decision: which of them the reading in hand claims, and where it says they should be.

use egui::{Stroke, vec2};
use nalgebra::Vector2;

use super::overlay::Easel;
use super::prediction::Sight;
use crate::network::{ImageId, Network, ReadTarget, Reading};
use crate::targets::Dot;
use crate::ui::action::Question;
use crate::ui::theme;

/// Where an image shows, or should show, the target of a reading, px: its dot, else where it is predicted.
pub fn place_of_reading(
    network: &Network,
    image: ImageId,
    reading: &Reading,
) -> Option<Vector2<f64>> {
    let own = reading.dots.iter().find(|(of, _)| *of == image);
    match own {
        Some((_, dot)) => {
            let detections = network.images.get(&image)?.detections.as_ref()?;
            Some(detections.dots.get(dot.slot())?.centre_px)
        }
        None => predicted(network, image, reading),
    }
}

/// Where the target of a reading should be, px, within the picture.
fn predicted(network: &Network, image: ImageId, reading: &Reading) -> Option<Vector2<f64>> {
    let sight = Sight::of(network, network.images.get(&image)?)?;
    let place = match &reading.target {
        ReadTarget::New { position, .. } => sight.project(position)?,
        ReadTarget::Known(point) => sight.image_of(network.points.get(point)?)?,
    };
    sight.camera.contains(&place).then_some(place)
}

impl Easel<'_> {
    /// Thin rings round all dots of the group, thick ones round those of the reading in hand, arms towards where it predicts them.
    pub(super) fn question(&self, network: &Network, image: ImageId, question: &Question) {
        let Some(reading) = question.reading() else {
            return;
        };
        let dots = network
            .images
            .get(&image)
            .and_then(|entry| entry.detections.as_ref());
        let Some(dots) = dots.map(|detections| &detections.dots) else {
            return;
        };
        for (_, dot) in question
            .group
            .dots()
            .into_iter()
            .filter(|(of, _)| *of == image)
        {
            let Some(measured) = dots.get(dot.slot()) else {
                continue;
            };
            let stroke = if reading.dots.contains(&(image, dot)) {
                Stroke::new(2.5, theme::SELECTED)
            } else {
                Stroke::new(1.2, theme::DOUBTFUL)
            };
            self.ring_round(measured, stroke);
        }
        if let Some(place) = predicted(network, image, reading) {
            let sizes = dots.iter().map(|dot| dot.major_px);
            self.arms(place, sizes.fold(0.0, f64::max).min(40.0));
        }
    }

    fn ring_round(&self, dot: &Dot, stroke: Stroke) {
        const LEAST: f32 = 5.0;
        const OUTSIDE: f32 = 8.0;
        let radius = self.transform.length(dot.major_px).max(LEAST) / 2.0 + OUTSIDE;
        let centre = self.transform.point(dot.centre_px);
        self.painter.circle_stroke(centre, radius, stroke);
    }

    /// Four arms that leave the place itself free.
    fn arms(&self, place_px: Vector2<f64>, size_px: f64) {
        const LENGTH: f32 = 10.0;
        let stroke = Stroke::new(1.5, theme::PREDICTED);
        let centre = self.transform.point(place_px);
        let from = self.transform.length(size_px) / 2.0 + 2.0;
        for direction in [
            vec2(1.0, 0.0),
            vec2(-1.0, 0.0),
            vec2(0.0, 1.0),
            vec2(0.0, -1.0),
        ] {
            let ends = [
                centre + direction * from,
                centre + direction * (from + LENGTH),
            ];
            self.painter.line_segment(ends, stroke);
        }
    }
}
