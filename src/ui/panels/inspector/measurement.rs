//! The whole measurement: cameras with their ten parameters, precision, datum and scale.

use egui::{Grid, Ui};

use super::facts;
use crate::camera::INTERIOR_NAMES;
use crate::network::{AdjustmentResult, CameraEntry, CameraId, Network, PointKind};
use crate::ui::context::ViewContext;
use crate::ui::format::{self, pixels, sigma, with_sigma};
use crate::ui::panels::facts::{arbitrary_scale, mark};
use crate::ui::panels::stale::from_adjustment;
use crate::ui::panels::tables::{INTERIOR_UNITS, LENGTHS};
use crate::ui::theme;

/// A parameter whose value is smaller than so many sigmas is not told from zero (99 % of a normal distribution).
const SIGNIFICANT: f64 = 2.58;

pub(super) fn ui(ui: &mut Ui, context: &ViewContext<'_>) {
    let network = context.network;
    ui.heading("Measurement");
    let kind = |kind| network.points.keys().filter(|p| p.kind() == kind).count();
    let (used, oriented) = (
        network.used_images().count(),
        network.oriented_images().count(),
    );
    let counts = [
        ("images", format!("{oriented} of {used} oriented")),
        (
            "points",
            format!(
                "{} targets, {} dots of codes, {} of the cross",
                kind(PointKind::Target),
                kind(PointKind::Code),
                kind(PointKind::Cross)
            ),
        ),
    ];
    facts(ui, "counts", &counts);
    from_adjustment(ui, network, |ui| {
        match &network.adjustment {
            None => {
                ui.weak("There is no adjustment yet: precision comes with it.");
            }
            Some(adjustment) => precision(ui, network, adjustment),
        }
        for (id, camera) in network.cameras.iter() {
            ui.separator();
            self::camera(ui, network, *id, camera);
        }
    });
}

fn precision(ui: &mut Ui, network: &Network, adjustment: &AdjustmentResult) {
    let rows = [
        ("sigma0", format!("{:.3}", adjustment.sigma0)),
        ("sigma0 in the images", pixels(adjustment.sigma0_px)),
        ("rms residual", pixels(adjustment.rms_px)),
        (
            "rms sigma of stations",
            sigma(adjustment.sigma_station_mm, "mm"),
        ),
        ("redundancy", adjustment.redundancy.to_string()),
        ("made by", adjustment.stage.to_string()),
        ("datum", adjustment.datum.clone()),
        ("scale from", adjustment.scale_from.to_string()),
    ];
    facts(ui, "precision", &rows);
    ui.horizontal_wrapped(|ui| arbitrary_scale(ui, network));
    if adjustment.bars.is_empty() {
        return;
    }
    ui.strong("Scale bars, adjusted - known");
    Grid::new("bars")
        .num_columns(3)
        .striped(true)
        .show(ui, |ui| {
            for bar in &adjustment.bars {
                let known = network.scale_bars.iter().find(|b| b.name == bar.name);
                ui.label(&bar.name);
                let deviation = known.map(|b| b.sigma_mm);
                ui.label(with_sigma(bar.difference_mm, deviation, "mm"));
                ui.label(bar.test.map_or("check".into(), |w| format!("w = {w:.2}")));
                ui.end_row();
            }
        });
}

fn camera(ui: &mut Ui, network: &Network, id: CameraId, entry: &CameraEntry) {
    ui.strong(format!("Camera {}", entry.name));
    ui.weak(format!(
        "{} x {} px of {:.3} um; start from {}",
        entry.camera.width_px,
        entry.camera.height_px,
        entry.camera.pixel_pitch_mm * 1000.0,
        entry.source
    ));
    let mut results = network.adjustment.iter().flat_map(|a| &a.cameras);
    let covariance = results.find(|c| c.camera == id).map(|c| c.covariance);
    let values = entry.camera.interior.to_vector();
    Grid::new(("camera", id.0))
        .num_columns(4)
        .striped(true)
        .show(ui, |ui| {
            for title in ["", "value", "sigma", "value / sigma"] {
                ui.strong(title);
            }
            ui.end_row();
            for (i, name) in INTERIOR_NAMES.into_iter().enumerate() {
                let precision = match covariance.map(|q| q[(i, i)].max(0.0).sqrt()) {
                    None => Precision::NotYet,
                    Some(0.0) => Precision::Fixed,
                    Some(sigma) => Precision::Sigma(sigma),
                };
                parameter(ui, i, name, values[i], precision);
                ui.end_row();
            }
        });
}

/// What is known of the precision of a camera parameter.
#[derive(Clone, Copy)]
enum Precision {
    /// There is no adjustment.
    NotYet,
    /// The adjustment does not estimate it.
    Fixed,
    /// Its standard deviation.
    Sigma(f64),
}

fn parameter(ui: &mut Ui, place: usize, name: &str, value: f64, precision: Precision) {
    let unit = INTERIOR_UNITS[place];
    let deviation = match precision {
        Precision::Sigma(sigma) => Some(sigma),
        Precision::NotYet | Precision::Fixed => None,
    };
    let small = |number: f64| match unit {
        "1" => format::small(number, deviation),
        _ => format!("{} {unit}", format::small(number, deviation)),
    };
    ui.label(name);
    ui.label(match place < LENGTHS {
        true => with_sigma(value, deviation, unit),
        false => small(value),
    });
    let Some(deviation) = deviation else {
        let (text, why) = match precision {
            Precision::Fixed => ("fixed", "The adjustment does not estimate it."),
            _ => ("not adjusted yet", "It is as it was at the start."),
        };
        ui.weak(text).on_hover_text(why);
        ui.weak("");
        return;
    };
    ui.label(match place < LENGTHS {
        true => sigma(deviation, unit),
        false => small(deviation),
    });
    let significance = value / deviation;
    ui.horizontal(|ui| {
        ui.label(format!("{significance:.1}"));
        if significance.abs() < SIGNIFICANT {
            mark(ui, Some(theme::DOUBTFUL));
            ui.weak("not told from zero");
        }
    });
}
