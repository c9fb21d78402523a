//! Plots by which a result is judged: residuals over the image plane, their distribution, precision and rays of points.

mod data;

use egui::{Color32, Ui};
use egui_plot::{
    Arrows, Bar, BarChart, HoverPosition, Legend, Line, LineStyle, MarkerShape, Plot, PlotPoints,
    Points, VLine,
};

use self::data::{CLASS, CameraResiduals, LARGEST_W, PlotData, exaggeration, normal_curve};
use super::basis::Cached;
use super::facts::select_point;
use super::stale::from_adjustment;
use crate::network::{Network, PointId, PointKind};
use crate::ui::action::Action;
use crate::ui::context::ViewContext;
use crate::ui::theme;

/// Which plot is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlotKind {
    /// Residual vectors over the image plane of a camera.
    #[default]
    Residuals,
    /// Histogram of the normalised residuals.
    Histogram,
    /// Sigma of every point.
    Sigmas,
    /// Number of points by their number of rays.
    Rays,
}

impl PlotKind {
    /// All plots in the order of their tabs.
    pub const ALL: [PlotKind; 4] = [
        PlotKind::Residuals,
        PlotKind::Histogram,
        PlotKind::Sigmas,
        PlotKind::Rays,
    ];

    /// Its title.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            PlotKind::Residuals => "Residuals in the image",
            PlotKind::Histogram => "Normalised residuals",
            PlotKind::Sigmas => "Sigma of points",
            PlotKind::Rays => "Rays of points",
        }
    }
}

/// The plots, one at a time.
#[derive(Default)]
pub struct Plots {
    kind: PlotKind,
    camera: usize,
    /// Factor on the exaggeration that suits the residuals.
    zoom: Exaggeration,
    data: Cached<(), PlotData>,
}

/// What the operator makes of the proposed exaggeration.
struct Exaggeration(f64);

impl Default for Exaggeration {
    fn default() -> Self {
        Self(1.0)
    }
}

/// Factor of one click on longer or shorter.
const STEP: f64 = 2.0;

/// A curve for a smaller sigma0 would be a needle; it does not make the others flat.
const LEAST_SIGMA0: f64 = 0.25;

/// How near the pointer must be to a point of a plot to take it, points.
const REACH: f32 = 12.0;

impl Plots {
    /// Shows this plot.
    pub fn show(&mut self, kind: PlotKind) {
        self.kind = kind;
    }

    /// Draws it.
    pub fn ui(&mut self, ui: &mut Ui, context: &ViewContext<'_>, actions: &mut Vec<Action>) {
        let network = context.network;
        ui.horizontal_wrapped(|ui| {
            for kind in PlotKind::ALL {
                ui.selectable_value(&mut self.kind, kind, kind.title());
            }
        });
        if network.adjustment.is_none() {
            ui.weak("Plots come with the first adjustment.");
            return;
        }
        let data = self.data.get(network, (), |()| PlotData::of(network));
        let (camera, zoom) = (&mut self.camera, &mut self.zoom);
        let clicked = from_adjustment(ui, network, |ui| {
            match self.kind {
                PlotKind::Residuals => residuals(ui, data, camera, zoom),
                PlotKind::Histogram => histogram(ui, data),
                PlotKind::Sigmas => return sigmas(ui, data, context.selection.point),
                PlotKind::Rays => rays(ui, data, network),
            }
            None
        });
        if let Some(id) = clicked {
            actions.push(Action::Select(select_point(id)));
        }
    }
}

fn residuals(ui: &mut Ui, data: &PlotData, chosen: &mut usize, zoom: &mut Exaggeration) {
    *chosen = (*chosen).min(data.cameras.len().saturating_sub(1));
    let Some(camera) = data.cameras.get(*chosen) else {
        ui.weak("The adjustment uses no observation.");
        return;
    };
    let factor = exaggeration(camera) * zoom.0;
    ui.horizontal_wrapped(|ui| {
        if data.cameras.len() > 1 {
            for (place, camera) in data.cameras.iter().enumerate() {
                ui.selectable_value(chosen, place, &camera.name);
            }
        }
        if ui.small_button("Shorter").clicked() {
            zoom.0 /= STEP;
        }
        if ui.small_button("Longer").clicked() {
            zoom.0 *= STEP;
        }
        ui.label(format!(
            "residuals x {factor:.0}, rms length {:.3} px",
            camera.rms_px
        ));
        let (shown, count) = (camera.vectors.len(), camera.count);
        if shown < count {
            ui.weak(format!("{shown} of {count} drawn"));
        }
    });
    let lengths = format!("residual x {factor:.0}");
    Plot::new("residuals")
        .data_aspect(1.0)
        .invert_y(true)
        .x_axis_label("x px")
        .y_axis_label("y px")
        .legend(Legend::default())
        .show(ui, |plot| {
            plot.line(frame(camera, plot.ctx()));
            plot.arrows(vectors(camera, factor, lengths));
        });
}

fn frame(camera: &CameraResiduals, context: &egui::Context) -> Line<'static> {
    let (w, h) = (camera.width_px, camera.height_px);
    let corners = vec![[0.0, 0.0], [w, 0.0], [w, h], [0.0, h], [0.0, 0.0]];
    Line::new(format!("image of {}", camera.name), corners)
        .color(context.global_style().visuals.weak_text_color())
        .allow_hover(false)
}

fn vectors(camera: &CameraResiduals, factor: f64, name: String) -> Arrows<'static> {
    let at = |v: nalgebra::Vector2<f64>| [v.x, v.y];
    let origins: PlotPoints<'_> = camera.vectors.iter().map(|v| at(v.place_px)).collect();
    let tips: PlotPoints<'_> = camera
        .vectors
        .iter()
        .map(|v| at(v.place_px + factor * v.residual_px))
        .collect();
    Arrows::new(name, origins, tips)
        .color(theme::USED)
        .allow_hover(false)
}

fn histogram(ui: &mut Ui, data: &PlotData) {
    ui.label(format!(
        "{} normalised residuals w of used observations; sigma0 = {:.3}",
        data.normalised, data.sigma0
    ));
    let bars = data.histogram.iter().enumerate().map(|(place, count)| {
        let middle = -LARGEST_W + (place as f64 + 0.5) * CLASS;
        Bar::new(middle, *count as f64).width(CLASS * 0.95)
    });
    let bars: Vec<Bar> = bars.collect();
    let (count, sigma0) = (data.normalised, data.sigma0);
    let curve = move |sigma: f64| {
        let range = -LARGEST_W..=LARGEST_W;
        PlotPoints::from_explicit_callback(move |w| normal_curve(w, sigma, count), range, 200)
    };
    Plot::new("histogram")
        .x_axis_label("w")
        .y_axis_label("residuals")
        // A curve given by a function does not ask for room itself.
        .include_y(1.05 * normal_curve(0.0, sigma0.clamp(LEAST_SIGMA0, 1.0), count))
        .legend(Legend::default())
        .show(ui, |plot| {
            plot.bar_chart(
                BarChart::new("residuals", bars)
                    .color(theme::USED)
                    .element_formatter(Box::new(|bar, _| {
                        format!("w = {:.2}: {:.0} residuals", bar.argument, bar.value)
                    })),
            );
            let normal = Line::new("normal curve, sigma 1", curve(1.0));
            plot.line(normal.color(theme::REJECTED).width(2.0).allow_hover(false));
            if sigma0 > 0.0 {
                let scaled = Line::new(format!("normal curve, sigma {sigma0:.2}"), curve(sigma0));
                let scaled = scaled.style(LineStyle::dashed_loose());
                plot.line(scaled.color(theme::PREDICTED).width(2.0).allow_hover(false));
            }
        });
}

/// Colours of x, y and z.
const AXES: [(&str, Color32, MarkerShape); 3] = [
    ("sigma x", theme::USED, MarkerShape::Circle),
    ("sigma y", theme::CODE, MarkerShape::Square),
    ("sigma z", theme::DOUBTFUL, MarkerShape::Diamond),
];

/// The label of the point at this place of the axis; empty between two places and beyond the ends.
fn label_at(data: &PlotData, place: f64) -> String {
    let is_place = place >= 0.0 && place.fract() == 0.0;
    data.sigmas
        .get(place as usize)
        .filter(|_| is_place)
        .map_or_else(String::new, |point| point.label.clone())
}

/// Answers the point that was clicked.
fn sigmas(ui: &mut Ui, data: &PlotData, selected: Option<PointId>) -> Option<PointId> {
    if data.sigmas.is_empty() {
        ui.weak("No point has a sigma yet.");
        return None;
    }
    ui.weak("Points in the order of their labels; click one to select it.");
    let name = |place: f64| {
        let point = data.sigmas.get(place.round().max(0.0) as usize)?;
        let kind = match point.kind {
            PointKind::Code => "dot of a code",
            PointKind::Target => "plain target",
            PointKind::Cross => "dot of the cross",
        };
        let [x, y, z] = point.sigma_mm;
        Some(format!(
            "{} ({kind})\nsigma {x:.4} {y:.4} {z:.4} mm",
            point.label
        ))
    };
    let response = Plot::new("sigmas")
        .x_axis_label("point")
        .x_axis_formatter(|mark, _| label_at(data, mark.value))
        .y_axis_label("sigma mm")
        .include_y(0.0)
        .legend(Legend::default())
        .label_formatter(move |hover| match hover {
            HoverPosition::NearDataPoint { position, .. } => name(position.x),
            HoverPosition::Elsewhere { .. } => None,
        })
        .show(ui, |plot| {
            for (axis, (name, colour, shape)) in AXES.into_iter().enumerate() {
                let place = |(i, p): (usize, &data::PointSigma)| [i as f64, p.sigma_mm[axis]];
                let series: PlotPoints<'_> = data.sigmas.iter().enumerate().map(place).collect();
                plot.points(
                    Points::new(name, series)
                        .color(colour)
                        .shape(shape)
                        .radius(2.5),
                );
            }
            let chosen = data.sigmas.iter().position(|p| Some(p.id) == selected);
            if let Some(place) = chosen {
                plot.vline(VLine::new("selected", place as f64).color(theme::SELECTED));
            }
        });
    let pointer = response.response.interact_pointer_pos();
    let pointer = pointer.filter(|_| response.response.clicked())?;
    let place = response.transform.value_from_position(pointer).x.round();
    let point = data.sigmas.get(place.max(0.0) as usize)?;
    let near = point.sigma_mm.iter().any(|sigma| {
        let at = egui_plot::PlotPoint::new(place, *sigma);
        response
            .transform
            .position_from_point(&at)
            .distance(pointer)
            < REACH
    });
    near.then_some(point.id)
}

fn rays(ui: &mut Ui, data: &PlotData, network: &Network) {
    let least = network.settings.min_rays;
    let points: usize = data.rays.values().sum();
    let total: usize = data
        .rays
        .iter()
        .map(|(rays, points)| *rays as usize * points)
        .sum();
    let mean = total as f64 / points.max(1) as f64;
    ui.label(format!("{points} points, {mean:.1} rays a point"));
    let bars = |weak: bool| -> Vec<Bar> {
        let of_side = data
            .rays
            .iter()
            .filter(|(rays, _)| (**rays < least) == weak);
        of_side
            .map(|(rays, points)| Bar::new(f64::from(*rays), *points as f64))
            .collect()
    };
    let chart = |name: String, weak: bool, colour: Color32| {
        BarChart::new(name, bars(weak))
            .width(0.8)
            .color(colour)
            .element_formatter(Box::new(|bar, _| {
                format!("{:.0} rays: {:.0} points", bar.argument, bar.value)
            }))
    };
    Plot::new("rays")
        .x_axis_label("rays")
        .y_axis_label("points")
        .include_x(0.0)
        .legend(Legend::default())
        .show(ui, |plot| {
            plot.bar_chart(chart(format!("{least} rays and more"), false, theme::USED));
            plot.bar_chart(chart(
                format!("less than {least} rays"),
                true,
                theme::DOUBTFUL,
            ));
        });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ui::panels::fixture::{Bench, network};
    use crate::ui::panels::stale::BEFORE_LAST_EDITS;
    use egui_kittest::kittest::Queryable as _;

    #[test]
    fn each_plot_says_what_it_shows() {
        let mut panel = Plots::default();
        let mut bench = Bench::new(network(), move |ui, context, actions| {
            panel.ui(ui, context, actions);
        });
        bench
            .harness
            .get_by_label("residuals x 2000, rms length 0.022 px");
        bench.harness.get_by_label("Longer").click();
        bench.actions();
        bench
            .harness
            .get_by_label("residuals x 4000, rms length 0.022 px");
        for (kind, says) in [
            (
                PlotKind::Histogram,
                "6 normalised residuals w of used observations; sigma0 = 1.020",
            ),
            (
                PlotKind::Sigmas,
                "Points in the order of their labels; click one to select it.",
            ),
            (PlotKind::Rays, "4 points, 2.0 rays a point"),
        ] {
            bench.harness.get_by_label(kind.title()).click();
            bench.actions();
            bench.harness.get_by_label(says);
        }
        bench.change(|network| network.inputs += 1);
        bench.harness.get_by_label(BEFORE_LAST_EDITS);
    }
}
