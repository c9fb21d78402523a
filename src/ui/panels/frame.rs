//! The frame of the result: free, onto control, or by three points (3-2-1).

use egui::{Button, Grid, ScrollArea, TextEdit, Ui};

use super::basis::Cached;
use super::facts::mark;
use super::stale::from_adjustment;
use crate::geometry::{AxisOrder, ThreeTwoOne};
use crate::network::{self, Network, PointId, Stage};
use crate::project::edit::Edit;
use crate::ui::action::{Action, RunRequest};
use crate::ui::context::ViewContext;
use crate::ui::format::sigma;
use crate::ui::theme;

/// The three points in the order of the rule, and what each gives.
const ROLES: [(&str, &str); 3] = [
    ("Origin", "Its three coordinates become zero."),
    ("Axis", "It comes to lie on the positive axis."),
    (
        "Plane",
        "It comes to lie in the coordinate plane, on the positive side of the axis.",
    ),
];

/// Width of the fields for labels, points.
const FIELD: f32 = 90.0;

/// What is chosen but not set yet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Choice {
    #[default]
    Automatic,
    Free,
    Control,
    ThreeTwoOne,
}

impl Choice {
    const ALL: [(Self, &'static str, &'static str); 4] = [
        (
            Self::Automatic,
            "Automatic",
            "Onto the control points where three or more are known, else the network's own frame.",
        ),
        (
            Self::Free,
            "Free",
            "The network's own frame; inner constraints give the least sigmas on the whole.",
        ),
        (
            Self::Control,
            "Control",
            "Best fit onto the points with known coordinates; it bends nothing.",
        ),
        (
            Self::ThreeTwoOne,
            "3-2-1",
            "Origin, axis and plane by three points; sigmas are relative to them.",
        ),
    ];
}

/// Rms sigma of the adjusted points in x, y, z, mm, and their number.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Effect {
    rms_mm: [f64; 3],
    points: usize,
}

impl Effect {
    fn of(network: &Network) -> Option<Self> {
        let mut sums = [0.0; 3];
        let mut points = 0;
        for covariance in network.points.values().filter_map(|p| p.covariance) {
            for (axis, sum) in sums.iter_mut().enumerate() {
                *sum += covariance[(axis, axis)].max(0.0);
            }
            points += 1;
        }
        (points > 0).then(|| Self {
            rms_mm: sums.map(|sum| (sum / f64::from(points)).sqrt()),
            points: points as usize,
        })
    }
}

/// The panel.
#[derive(Default)]
pub struct Frame {
    choice: Choice,
    /// Labels of origin, axis and plane point as they are typed.
    labels: [String; 3],
    order: AxisOrder,
    /// The frame of the document that the fields were last filled from.
    filled_from: Option<network::Frame>,
    effect: Cached<(), Option<Effect>>,
}

impl Frame {
    /// Draws the panel and asks for what was clicked.
    pub fn ui(&mut self, ui: &mut Ui, context: &ViewContext<'_>, actions: &mut Vec<Action>) {
        let network = context.network;
        self.fill_from(network);
        ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            ui.horizontal_wrapped(|ui| {
                for (choice, text, hint) in Choice::ALL {
                    ui.radio_value(&mut self.choice, choice, text)
                        .on_hover_text(hint);
                }
            });
            self.set(ui, network, actions);
            for (choice, _, hint) in Choice::ALL {
                if choice == self.choice && choice != Choice::ThreeTwoOne {
                    ui.weak(hint);
                }
            }
            if self.choice == Choice::ThreeTwoOne {
                self.points(ui, context);
                self.axes(ui);
            }
            ui.separator();
            self.present(ui, network);
        });
    }

    /// Takes over the frame of the document whenever it is another one (opened, undone, set elsewhere).
    fn fill_from(&mut self, network: &Network) {
        if self.filled_from == Some(network.frame) {
            return;
        }
        self.filled_from = Some(network.frame);
        self.choice = match network.frame {
            network::Frame::Automatic => Choice::Automatic,
            network::Frame::Free => Choice::Free,
            network::Frame::Control => Choice::Control,
            network::Frame::ThreeTwoOne(points) => {
                let labels = points.map(|p| network.label(*p));
                self.labels = [labels.origin, labels.axis, labels.plane];
                self.order = points.order;
                Choice::ThreeTwoOne
            }
        };
    }

    /// The frame of the present result and its effect.
    fn present(&mut self, ui: &mut Ui, network: &Network) {
        let Some(adjustment) = &network.adjustment else {
            ui.weak("There is no adjustment yet: the frame is applied by the final one.");
            return;
        };
        let effect = *self.effect.get(network, (), |()| Effect::of(network));
        from_adjustment(ui, network, |ui| {
            ui.weak("Frame of the present result");
            ui.label(&adjustment.datum);
            let Some(effect) = effect else { return };
            Grid::new("effect of the frame")
                .num_columns(4)
                .show(ui, |ui| {
                    ui.weak(format!("rms sigma of {} points", effect.points));
                    for (axis, rms) in ["x", "y", "z"].iter().zip(effect.rms_mm) {
                        ui.label(format!("{axis} {}", sigma(rms, "mm")));
                    }
                    ui.end_row();
                });
        });
        if let Some(reason) = &adjustment.frame.refused {
            problem(
                ui,
                &format!("The frame that was set could not be had: {reason}"),
            );
        }
    }

    fn points(&mut self, ui: &mut Ui, context: &ViewContext<'_>) {
        let selected = context.selection.point;
        Grid::new("points of the frame")
            .num_columns(3)
            .show(ui, |ui| {
                for ((role, hint), label) in ROLES.into_iter().zip(&mut self.labels) {
                    let name = ui.label(role).on_hover_text(hint);
                    ui.add(
                        TextEdit::singleline(label)
                            .desired_width(FIELD)
                            // A cell of a grid is narrower at first.
                            .min_size(egui::vec2(FIELD, 0.0))
                            .hint_text("such as C17.O"),
                    )
                    .labelled_by(name.id);
                    let button = Button::new(format!("{role} from selection"));
                    let clicked = ui
                        .add_enabled(selected.is_some(), button)
                        .on_disabled_hover_text("Select a point in an image, in 3D or in a table.")
                        .clicked();
                    if let Some(point) = selected.filter(|_| clicked) {
                        *label = context.network.label(point);
                    }
                    ui.end_row();
                }
            });
    }

    fn axes(&mut self, ui: &mut Ui) {
        let present = self.order;
        ui.horizontal_wrapped(|ui| {
            ui.weak("The axis point gives the");
            for first in [AxisOrder::Xy, AxisOrder::Yz, AxisOrder::Zx] {
                let text = format!("{} axis", first.axis_name());
                let chosen = present.axis() == first.axis();
                if ui.selectable_label(chosen, text).clicked() && !chosen {
                    self.order = first;
                }
            }
        });
        ui.horizontal_wrapped(|ui| {
            ui.weak("The plane point lies in the");
            let present = self.order;
            for order in AxisOrder::ALL {
                if order.axis() == present.axis() {
                    let side = ["x", "y", "z"][order.side()];
                    let text = format!("{} plane, {side} > 0", order.plane_name());
                    ui.selectable_value(&mut self.order, order, text);
                }
            }
        });
    }

    /// The choice as the document would hold it, or why it cannot be set, in one line.
    fn asked(&self, network: &Network) -> Result<network::Frame, String> {
        let frame = match self.choice {
            Choice::Automatic => network::Frame::Automatic,
            Choice::Free => network::Frame::Free,
            Choice::Control => network::Frame::Control,
            Choice::ThreeTwoOne => {
                let mut points = [None; 3];
                for (point, ((role, _), label)) in
                    points.iter_mut().zip(ROLES.into_iter().zip(&self.labels))
                {
                    *point = Some(point_of(network, role, label)?);
                }
                let [Some(origin), Some(axis), Some(plane)] = points else {
                    return Err("Three points are needed.".into());
                };
                network::Frame::ThreeTwoOne(ThreeTwoOne {
                    origin,
                    axis,
                    plane,
                    order: self.order,
                })
            }
        };
        match network.frame_problem(&frame) {
            Some(problem) => Err(problem.to_string()),
            None => Ok(frame),
        }
    }

    fn set(&mut self, ui: &mut Ui, network: &Network, actions: &mut Vec<Action>) {
        let asked = self.asked(network);
        let frame = asked.as_ref().ok().copied();
        let button = Button::new("Set frame");
        let hint = "Sets it and makes the final adjustment again; distances and residuals stay.";
        let clicked = ui
            .add_enabled(frame.is_some(), button)
            .on_hover_text(hint)
            .clicked();
        if let Some(frame) = frame.filter(|_| clicked) {
            actions.push(Action::Edit(Edit::Frame(frame)));
            if Stage::Adjust.missing(network).is_none() {
                actions.push(Action::Run(RunRequest::Until(Stage::Adjust)));
            }
        }
        if let Err(reason) = asked {
            problem(ui, &reason);
        }
    }
}

fn point_of(network: &Network, role: &str, label: &str) -> Result<PointId, String> {
    if label.trim().is_empty() {
        return Err(format!("{role}: type a label, or take the selected point"));
    }
    network
        .point_of_label(label)
        .map_err(|unknown| format!("{role}: {unknown}"))
}

fn problem(ui: &mut Ui, text: &str) {
    ui.horizontal_wrapped(|ui| {
        mark(ui, Some(theme::DOUBTFUL));
        ui.label(text);
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::FrameResult;
    use crate::ui::action::Selection;
    use crate::ui::panels::facts::select_point;
    use crate::ui::panels::fixture::{Bench, network};
    use egui::accesskit::Role;
    use egui_kittest::kittest::Queryable as _;
    use std::sync::Arc;

    fn bench(selection: Selection) -> Bench {
        let mut network = network();
        // Two oriented images: then there is something to adjust.
        let station = network.images[&network::ImageId(1)].station.clone();
        network.image_mut(network::ImageId(2)).station = station;
        let mut panel = Frame::default();
        Bench::selecting(network, selection, move |ui, context, actions| {
            panel.ui(ui, context, actions);
        })
    }

    fn point(label: &str) -> PointId {
        network().point_of_label(label).unwrap()
    }

    fn type_into(bench: &mut Bench, field: &str, text: &str) {
        let input = |bench: &Bench| {
            let node = bench.harness.get_by_role_and_label(Role::TextInput, field);
            node.focus();
        };
        input(bench);
        bench.harness.run();
        bench
            .harness
            .get_by_role_and_label(Role::TextInput, field)
            .type_text(text);
        bench.harness.run();
    }

    #[test]
    fn three_points_set_the_frame_and_adjust_again() {
        let mut bench = bench(select_point(point("M1")));
        bench.harness.get_by_label("3-2-1").click();
        bench.harness.run();
        bench
            .harness
            .get_by_label("Origin: type a label, or take the selected point");
        bench.harness.get_by_label("Origin from selection").click();
        bench.harness.run();
        type_into(&mut bench, "Axis", "C1");
        type_into(&mut bench, "Plane", "X1");
        bench.harness.get_by_label("Y axis").click();
        bench.harness.run();
        bench.harness.get_by_label("XY plane, x > 0").click();
        bench.actions();
        bench.harness.get_by_label("Set frame").click();
        let frame = network::Frame::ThreeTwoOne(ThreeTwoOne {
            origin: point("M1"),
            axis: point("C1"),
            plane: point("X1"),
            order: AxisOrder::Yx,
        });
        assert_eq!(
            bench.actions(),
            [
                Action::Edit(Edit::Frame(frame)),
                Action::Run(RunRequest::Until(Stage::Adjust))
            ]
        );
    }

    #[test]
    fn what_cannot_be_set_is_told_and_not_asked_for() {
        let mut bench = bench(Selection::default());
        bench.harness.get_by_label("3-2-1").click();
        bench.harness.run();
        type_into(&mut bench, "Origin", "M1");
        type_into(&mut bench, "Axis", "C1");
        type_into(&mut bench, "Plane", "M77");
        bench.harness.get_by_label(
            "found no coordinates of M77, expected a point that two or more oriented images show",
        );
        bench.harness.get_by_label("Set frame").click();
        assert_eq!(bench.actions(), []);
        bench.harness.get_by_label("Control").click();
        bench.harness.run();
        bench
            .harness
            .get_by_label_contains("a best fit needs 3 common points");
        bench.harness.get_by_label("Free").click();
        bench.harness.run();
        bench.harness.get_by_label("Set frame").click();
        assert_eq!(bench.actions().len(), 2);
    }

    #[test]
    fn the_frame_of_the_result_and_its_effect_are_shown() {
        let mut bench = bench(Selection::default());
        bench
            .harness
            .get_by_label("inner constraints on the plain targets");
        bench.harness.get_by_label("rms sigma of 4 points");
        bench.harness.get_by_label("z 0.030 mm");
        bench.change(|network| {
            let frame = network::Frame::ThreeTwoOne(ThreeTwoOne {
                origin: point("M1"),
                axis: point("C2"),
                plane: point("X1"),
                order: AxisOrder::Zx,
            });
            network.frame = frame;
        });
        bench.harness.get_by_label("before your last edits");
        bench.harness.get_by_label("ZX plane, x > 0");
        bench.change(|network| {
            let adjustment = network.adjustment.as_mut().unwrap();
            Arc::make_mut(adjustment).frame = FrameResult {
                asked: network.frame,
                refused: Some("M1 is gone".into()),
            };
        });
        bench
            .harness
            .get_by_label("The frame that was set could not be had: M1 is gone");
    }
}
