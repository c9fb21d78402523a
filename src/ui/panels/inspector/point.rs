//! A point: coordinates, and its image in every picture that shows it.

use egui::{Grid, RichText, Ui};

use super::{decision, facts, image_link};
use crate::geometry::Circle;
use crate::network::{Network, PointId, PointKind};
use crate::ui::action::Action;
use crate::ui::context::ViewContext;
use crate::ui::format::{pixels, sigma, with_sigma};
use crate::ui::panels::facts::{Sight, mark, select_observation, select_point};
use crate::ui::panels::stale::from_adjustment;
use crate::ui::theme;

/// Its label and kind, and the way to it.
pub(super) fn heading(ui: &mut Ui, network: &Network, id: PointId, actions: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        ui.heading(network.label(id));
        ui.weak(match id.kind() {
            PointKind::Code => "dot of a coded target",
            PointKind::Target => "plain target",
            PointKind::Cross => "dot of the reference cross",
        });
        if ui
            .button("Show")
            .on_hover_text("Bring it into view")
            .clicked()
        {
            actions.push(Action::LookAt(select_point(id)));
        }
    });
}

/// Its coordinates, and its image in every picture that shows it.
pub(super) fn ui(
    ui: &mut Ui,
    context: &ViewContext<'_>,
    id: PointId,
    sights: &[Sight],
    actions: &mut Vec<Action>,
) {
    let network = context.network;
    from_adjustment(ui, network, |ui| coordinates(ui, context, id));
    ui.separator();
    if sights.is_empty() {
        ui.weak("No image in use shows it.");
        return;
    }
    let used = sights.iter().filter(|s| s.rejected.is_none()).count();
    ui.label(format!("images: {}, used in {used}", sights.len()));
    Grid::new("sights")
        .num_columns(6)
        .striped(true)
        .show(ui, |ui| {
            for title in ["", "image", "residual", "|w|", "", ""] {
                ui.strong(title);
            }
            ui.end_row();
            for sight in sights {
                row(ui, context, id, sight, actions);
                ui.end_row();
            }
        });
}

fn coordinates(ui: &mut Ui, context: &ViewContext<'_>, id: PointId) {
    let Some(point) = context.network.points.get(&id) else {
        ui.weak("It has no coordinates yet.");
        return;
    };
    Grid::new("coordinates")
        .num_columns(3)
        .striped(true)
        .show(ui, |ui| {
            for title in ["", "coordinate", "sigma"] {
                ui.strong(title);
            }
            ui.end_row();
            for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
                let deviation = point.covariance.map(|q| q[(axis, axis)].max(0.0).sqrt());
                ui.label(name);
                ui.label(with_sigma(point.position[axis], deviation, "mm"));
                ui.label(deviation.map_or("unknown".into(), |s| sigma(s, "mm")));
                ui.end_row();
            }
        });
    let mut known = vec![("rays used", point.rays.to_string())];
    if let Some(Circle { normal, radius_mm }) = point.circle {
        let [x, y, z] = normal.into();
        known.push(("diameter", format!("{:.2} mm", 2.0 * radius_mm)));
        known.push(("normal", format!("{x:.3}, {y:.3}, {z:.3}")));
    }
    facts(ui, "rays", &known);
}

fn row(
    ui: &mut Ui,
    context: &ViewContext<'_>,
    point: PointId,
    sight: &Sight,
    actions: &mut Vec<Action>,
) {
    let colour = match sight.rejected {
        Some(_) => theme::REJECTED,
        None => theme::USED,
    };
    mark(ui, Some(colour));
    image_link(ui, context, sight.image, actions);
    residual(ui, context, sight);
    let selection = select_observation(sight.image, sight.dot, Some(point));
    if ui
        .small_button("Look")
        .on_hover_text("Look at it in this image")
        .clicked()
    {
        actions.push(Action::LookAt(selection));
    }
    let rejected = sight.rejected.as_deref();
    decision(ui, context, sight.image, sight.dot, rejected, actions);
}

fn residual(ui: &mut Ui, context: &ViewContext<'_>, sight: &Sight) {
    let Some((residual, test)) = sight.residual else {
        ui.weak("none yet");
        ui.weak("");
        return;
    };
    let text = |text: String| match context.network.adjustment_is_fresh() {
        true => RichText::new(text),
        false => RichText::new(text).weak(),
    };
    let hover = format!("x {}, y {}", pixels(residual.x), pixels(residual.y));
    ui.label(text(pixels(residual.norm()))).on_hover_text(hover);
    ui.label(text(format!("{test:.1}")));
}
