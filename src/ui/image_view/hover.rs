//! What stands under the pointer, and what is said of it.

use egui::{Pos2, Ui};

use super::marks::{Mark, Marks};
use super::overlay::{Overlay, Overlays};
use super::prediction::{Facing, Predicted};
use super::transform::ScreenFromImage;
use crate::network::{Absence, Network};
use crate::targets::{DotIndex, Rejected};
use crate::ui::format;

/// What stands under the pointer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Hovered {
    Dot(DotIndex),
    Missed(Predicted),
    /// A refused candidate, by its place in the detections.
    Candidate(usize),
}

/// The pointer may miss a mark by so many points.
const REACH: f32 = 9.0;

/// The nearest dot, else the nearest missed target, else the nearest refused candidate that is shown there.
pub(super) fn hovered(
    marks: &Marks,
    transform: &ScreenFromImage,
    overlays: Overlays,
    pointer: Pos2,
) -> Option<Hovered> {
    let distance = |place| transform.point(place).distance(pointer);
    let dots = marks.dots.iter().map(|mark| {
        let reach = REACH.max(transform.length(mark.dot.major_px) / 2.0);
        (
            distance(mark.dot.centre_px),
            reach,
            Hovered::Dot(mark.index),
        )
    });
    let missed = marks
        .missed
        .iter()
        .filter(|m| overlays.shows_predicted(m))
        .map(|m| (distance(m.place_px), REACH, Hovered::Missed(*m)));
    let rejected = marks
        .detections
        .iter()
        .flat_map(|detections| &detections.rejected)
        .enumerate();
    let rejected =
        rejected.map(|(slot, r)| (distance(r.place_px), REACH, Hovered::Candidate(slot)));
    nearest(dots).or_else(|| nearest(missed)).or_else(|| {
        overlays
            .shows(Overlay::Candidates)
            .then(|| nearest(rejected))
            .flatten()
    })
}

fn nearest(found: impl Iterator<Item = (f32, f32, Hovered)>) -> Option<Hovered> {
    found
        .filter(|(distance, reach, _)| distance <= reach)
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(.., hovered)| hovered)
}

/// The tooltip of a dot.
pub(super) fn dot_tooltip(ui: &mut Ui, mark: &Mark) {
    let dot = &mark.dot;
    ui.strong(mark.label.as_deref().unwrap_or("dot without a label"));
    let mut rows = vec![
        ("x", format::pixels(dot.centre_px.x)),
        ("y", format::pixels(dot.centre_px.y)),
        ("sigma", format::sigma(dot.sigma_px, "px")),
        (
            "size",
            format!("{:.1} x {:.1} px", dot.major_px, dot.minor_px),
        ),
        ("contrast", format!("{:.0} grey values", dot.contrast)),
    ];
    if let Some(observation) = &mark.observation {
        let v = observation.residual_px;
        rows.push(("residual", format!("{:.3}, {:.3} px", v.x, v.y)));
        rows.push(("|w|", format!("{:.1}", observation.test)));
    }
    rows.push(("status", mark.class.words().to_owned()));
    rows.push(("source", mark.origin.words().to_owned()));
    egui::Grid::new("dot tooltip")
        .num_columns(2)
        .spacing([10.0, 2.0])
        .show(ui, |ui| {
            for (name, value) in rows {
                ui.weak(name);
                ui.label(value);
                ui.end_row();
            }
        });
    if let Some(reason) = &mark.reason {
        ui.label(reason);
    }
}

/// The tooltip of a missed target.
pub(super) fn missed_tooltip(
    ui: &mut Ui,
    missed: &Predicted,
    absence: Option<&Absence>,
    refused: Option<&Rejected>,
    network: &Network,
) {
    let name = network.label(missed.point);
    ui.strong(match missed.facing {
        Facing::Towards => format!("{name} should be here"),
        Facing::Unknown => format!("{name} is not to be seen here"),
    });
    ui.label(format!(
        "x {}, y {}",
        format::pixels(missed.place_px.x),
        format::pixels(missed.place_px.y)
    ));
    match (absence, missed.facing) {
        (Some(absence), _) => {
            ui.strong(absence.kind.to_string());
            ui.label(&absence.reason);
        }
        (None, Facing::Towards) => {
            ui.label("It is turned to this camera.");
        }
        (None, Facing::Unknown) => {
            ui.label("It is turned away, or nothing sees it from near here.");
        }
    }
    if let Some(angle) = missed.incidence_deg {
        ui.label(format!("{angle:.0} deg from its normal"));
    }
    if let Some(angle) = missed.nearest_deg {
        ui.label(format!("{angle:.0} deg from the nearest of its rays"));
    }
    if let Some(refused) = refused {
        ui.label(format!("Detection refused one here: {}", refused.reason));
    }
    ui.weak("A measures it here");
}

/// The tooltip of a refused candidate.
pub(super) fn candidate_tooltip(ui: &mut Ui, rejected: &Rejected) {
    ui.strong("Refused by detection");
    ui.label(&rejected.reason);
    ui.label(format!(
        "x {}, y {}",
        format::pixels(rejected.place_px.x),
        format::pixels(rejected.place_px.y)
    ));
    ui.weak("A measures it all the same");
}
