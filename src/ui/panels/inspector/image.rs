//! An image with its station, and one dot of an image.

use egui::{Grid, Ui};

use super::{decision, facts, image_link};
use crate::geometry::OmegaPhiKappa;
use crate::network::{ImageEntry, ImageId, ImageUse, Source, Station};
use crate::project::edit::Edit;
use crate::targets::DotIndex;
use crate::ui::action::Action;
use crate::ui::context::ViewContext;
use crate::ui::format::{pixels, sigma, with_sigma};
use crate::ui::panels::facts::{select_image, select_point};
use crate::ui::panels::stale::from_adjustment;

/// A dot: place, size, contrast, name or why it has none.
pub(super) fn dot(
    ui: &mut Ui,
    context: &ViewContext<'_>,
    id: ImageId,
    index: DotIndex,
    actions: &mut Vec<Action>,
) {
    let network = context.network;
    let image = network.images.get(&id);
    let detections = image.and_then(|i| i.detections.as_ref());
    let (Some(image), Some(detections)) = (image, detections) else {
        ui.weak("The dot is gone.");
        return;
    };
    let Some(dot) = detections.dots.get(index.slot()) else {
        ui.weak("The dot is gone.");
        return;
    };
    ui.horizontal(|ui| {
        ui.heading(format!("dot {}", index.0 + 1));
        image_link(ui, context, id, actions);
    });
    let by_hand = detections.by_hand.contains(&index);
    facts(
        ui,
        "dot",
        &[
            (
                "centre",
                format!("{}, {}", pixels(dot.centre_px.x), pixels(dot.centre_px.y)),
            ),
            ("sigma", pixels(dot.sigma_px)),
            (
                "axes",
                format!("{:.2} x {:.2} px", dot.major_px, dot.minor_px),
            ),
            ("contrast", format!("{:.1} grey values", dot.contrast)),
            ("background", format!("{:.1} grey values", dot.background)),
            (
                "measured",
                if by_hand { "by hand" } else { "by detection" }.into(),
            ),
        ],
    );
    let Some(label) = image.labels.get(&index) else {
        ui.label("It has no name.");
        let rejected = image.rejected_dots.get(&index);
        if let Some(reason) = rejected.or_else(|| image.unlabelled.get(&index)) {
            ui.label(reason);
        }
        decision(
            ui,
            context,
            id,
            index,
            rejected.map(String::as_str),
            actions,
        );
        return;
    };
    ui.horizontal_wrapped(|ui| {
        ui.label("It is");
        if ui.link(network.label(label.point)).clicked() {
            actions.push(Action::Select(select_point(label.point)));
        }
        ui.label(match label.source {
            Source::Automatic => "as named by a stage.",
            Source::Operator => "as named by you.",
        });
    });
    if let Some(reason) = &label.rejected {
        ui.label(format!("It is not used: {reason}"));
    }
    ui.horizontal(|ui| {
        decision(ui, context, id, index, label.rejected.as_deref(), actions);
        let confirm = label.source == Source::Automatic && label.rejected.is_none();
        if confirm
            && ui
                .small_button("Accept")
                .on_hover_text("The name is right; no stage changes it any more.")
                .clicked()
        {
            actions.push(Action::Edit(Edit::Accept {
                image: id,
                dot: index,
            }));
        }
        if ui.small_button("Take its name away").clicked() {
            actions.push(Action::Edit(Edit::Unlabel {
                image: id,
                dot: index,
            }));
        }
    });
}

/// An image: camera, station, what it shows.
pub(super) fn ui(ui: &mut Ui, context: &ViewContext<'_>, id: ImageId, actions: &mut Vec<Action>) {
    let network = context.network;
    let Some(image) = network.images.get(&id) else {
        ui.weak("The image is gone.");
        return;
    };
    ui.heading(&image.file.path);
    ui.horizontal(|ui| {
        if ui.button("Look at it").clicked() {
            actions.push(Action::LookAt(select_image(id)));
        }
        let (text, usage) = match image.usage {
            ImageUse::Used => ("Exclude", ImageUse::Excluded),
            ImageUse::Excluded => ("Use", ImageUse::Used),
        };
        if ui.button(text).clicked() {
            actions.push(Action::Edit(Edit::UseImage { image: id, usage }));
        }
    });
    let detections = image.detections.as_ref();
    let named = image.labels.len();
    let used = image.used_labels().count();
    facts(
        ui,
        "image",
        &[
            ("camera", network.camera_of(image).name.clone()),
            (
                "size",
                format!("{} x {} px", image.file.width_px, image.file.height_px),
            ),
            (
                "targets",
                detections.map_or("not looked for".into(), |d| d.dots.len().to_string()),
            ),
            ("named", format!("{named}, used {used}")),
            (
                "codes",
                detections.map_or(String::new(), |d| d.codes.len().to_string()),
            ),
        ],
    );
    ui.separator();
    match &image.station {
        Some(station) => from_adjustment(ui, network, |ui| self::station(ui, station)),
        None => not_oriented(ui, image),
    }
}

fn not_oriented(ui: &mut Ui, image: &ImageEntry) {
    let reason = image.attempt.as_ref().map(|a| &a.reason);
    match image.unreadable.as_ref().or(reason) {
        None => {
            ui.weak("It is not oriented yet.");
        }
        Some(reason) => {
            ui.label("It is not oriented:");
            ui.label(reason);
        }
    }
}

fn station(ui: &mut Ui, station: &Station) {
    let angles = OmegaPhiKappa::from_rotation(&station.pose.camera_from_world);
    let turn = angles.jacobian_by_turn();
    let angle_sigmas = station.covariance.map(|q| {
        let of_turn = q.fixed_view::<3, 3>(0, 0).into_owned();
        (turn * of_turn * turn.transpose())
            .diagonal()
            .map(|v| v.max(0.0).sqrt().to_degrees())
    });
    let centre_sigmas = station
        .covariance
        .map(|q| q.diagonal().fixed_rows::<3>(3).map(|v| v.max(0.0).sqrt()));
    let centre = station.pose.centre_in_world;
    Grid::new("station")
        .num_columns(3)
        .striped(true)
        .show(ui, |ui| {
            for title in ["", "station", "sigma"] {
                ui.strong(title);
            }
            ui.end_row();
            let mut row = |name: &str, value: f64, deviation: Option<f64>, unit: &str| {
                ui.label(name);
                ui.label(with_sigma(value, deviation, unit));
                // At 90 degrees of phi omega and kappa have no sigma of their own.
                let deviation = deviation.filter(|s| s.is_finite());
                ui.label(deviation.map_or("unknown".into(), |s| sigma(s, unit)));
                ui.end_row();
            };
            for (axis, name) in ["X", "Y", "Z"].into_iter().enumerate() {
                row(name, centre[axis], centre_sigmas.map(|s| s[axis]), "mm");
            }
            let values = [angles.omega, angles.phi, angles.kappa];
            for (i, name) in ["omega", "phi", "kappa"].into_iter().enumerate() {
                row(
                    name,
                    values[i].to_degrees(),
                    angle_sigmas.map(|s| s[i]),
                    "deg",
                );
            }
        });
}
