//! What the operator knows of a point: scale bars that end there, and its coordinates.

use egui::{Button, TextEdit, Ui};

use crate::network::{BarRole, ControlPoint, ControlRole, Network, PointId};
use crate::project::edit::Edit;
use crate::ui::action::Action;
use crate::ui::context::ViewContext;

/// Standard deviation of a bar's length that is offered, mm: that of a calibrated bar of a metre.
const BAR_SIGMA_MM: &str = "0.01";

/// Half-entered bars and coordinates.
pub(super) struct Known {
    bar: BarDraft,
    control: Option<ControlDraft>,
}

/// A bar of which one end is chosen.
struct BarDraft {
    from: Option<PointId>,
    name: String,
    length: String,
    sigma: String,
    role: BarRole,
}

/// Coordinates of a point while they are entered.
struct ControlDraft {
    point: PointId,
    coordinates: [String; 3],
    sigma: String,
    role: ControlRole,
}

impl Default for Known {
    fn default() -> Self {
        Self {
            bar: BarDraft {
                from: None,
                name: String::new(),
                length: String::new(),
                sigma: BAR_SIGMA_MM.into(),
                role: BarRole::Control,
            },
            control: None,
        }
    }
}

impl Known {
    pub(super) fn ui(
        &mut self,
        ui: &mut Ui,
        context: &ViewContext<'_>,
        id: PointId,
        actions: &mut Vec<Action>,
    ) {
        ui.strong("What is known of it");
        let network = context.network;
        self.bars(ui, network, id, actions);
        self.control(ui, network, id, actions);
    }

    fn bars(&mut self, ui: &mut Ui, network: &Network, id: PointId, actions: &mut Vec<Action>) {
        let is_end = |label: &str| network.point_of_label(label).is_ok_and(|end| end == id);
        let bars = network.scale_bars.iter();
        for bar in bars.filter(|bar| is_end(&bar.from) || is_end(&bar.to)) {
            ui.horizontal_wrapped(|ui| {
                let role = bar_role(bar.role);
                let length = ui.label(format!(
                    "bar {}: {} to {}, {:.3} mm, {role}",
                    bar.name,
                    bar.from,
                    bar.to,
                    network.bar_length_mm(bar)
                ));
                if let Some(reason) = network.reason_of_bar_length(bar) {
                    length.on_hover_text(format!("calibrated {:.4} mm; {reason}", bar.length_mm));
                }
                if ui
                    .small_button(format!("Remove bar {}", bar.name))
                    .clicked()
                {
                    actions.push(Action::Edit(Edit::RemoveBar {
                        name: bar.name.clone(),
                    }));
                }
            });
        }
        match self.bar.from {
            Some(from) if from != id => self.other_end(ui, network, from, id, actions),
            Some(_) => {
                ui.label("The bar begins here. Select its other end.");
                if ui.button("No bar").clicked() {
                    self.bar.from = None;
                }
            }
            None => {
                let button = ui.button("Bar from here");
                if button
                    .on_hover_text("One end of a scale bar; then select the other")
                    .clicked()
                {
                    self.bar.from = Some(id);
                    self.bar.name = free_name(network);
                }
            }
        }
    }

    fn other_end(
        &mut self,
        ui: &mut Ui,
        network: &Network,
        from: PointId,
        to: PointId,
        actions: &mut Vec<Action>,
    ) {
        let ends = [from, to].map(|end| network.label(end));
        ui.label(format!("Bar from {} to {}", ends[0], ends[1]));
        let draft = &mut self.bar;
        field(ui, "Name of the bar", &mut draft.name);
        field(ui, "Length, mm", &mut draft.length);
        field(ui, "Sigma of the length, mm", &mut draft.sigma);
        ui.horizontal(|ui| {
            for role in [BarRole::Control, BarRole::Check] {
                ui.radio_value(&mut draft.role, role, bar_role(role));
            }
        });
        let numbers = number(&draft.length).zip(number(&draft.sigma));
        let usable = numbers.filter(|(length, sigma)| *length > 0.0 && *sigma > 0.0);
        ui.horizontal(|ui| {
            let enabled = usable.is_some() && !draft.name.trim().is_empty();
            let button = ui.add_enabled(enabled, Button::new("Bar to here"));
            let why = "It needs a name, a length and a sigma above 0 mm.";
            if let (true, Some((length_mm, sigma_mm))) =
                (button.on_disabled_hover_text(why).clicked(), usable)
            {
                let [from, to] = ends.clone();
                actions.push(Action::Edit(Edit::AddBar {
                    name: draft.name.trim().to_owned(),
                    from,
                    to,
                    length_mm,
                    sigma_mm,
                    role: draft.role,
                }));
                draft.from = None;
                draft.length.clear();
            }
            if ui.button("No bar").clicked() {
                draft.from = None;
            }
        });
    }

    fn control(&mut self, ui: &mut Ui, network: &Network, id: PointId, actions: &mut Vec<Action>) {
        let is_of = |label: &str| network.point_of_label(label).is_ok_and(|point| point == id);
        let present = network.control.iter().find(|control| is_of(&control.label));
        if let Some(control) = present {
            ui.label(format!(
                "control point: {}, {}",
                coordinates(control),
                control_role(control.role)
            ));
        }
        if let Some(draft) = self.control.as_mut().filter(|draft| draft.point == id) {
            if draft.ui(ui, network, actions) {
                self.control = None;
            }
            return;
        }
        ui.horizontal(|ui| {
            let text = match present {
                Some(_) => "Change control point",
                None => "Make control point",
            };
            if ui.button(text).clicked() {
                self.control = Some(ControlDraft::of(id, present));
            }
            if present.is_some() && ui.button("Remove control point").clicked() {
                let label = network.label(id);
                actions.push(Action::Edit(Edit::RemoveControl { label }));
            }
        });
    }
}

impl ControlDraft {
    fn of(point: PointId, present: Option<&ControlPoint>) -> Self {
        let text = |value: Option<f64>| value.map_or(String::new(), |v| v.to_string());
        let coordinates = present.map_or([None; 3], |control| control.coordinates_mm);
        let sigma = present.and_then(|control| control.sigmas_mm.into_iter().flatten().next());
        Self {
            point,
            coordinates: coordinates.map(text),
            sigma: text(sigma),
            role: present.map_or(ControlRole::Align, |control| control.role),
        }
    }

    /// Returns whether the operator is done.
    fn ui(&mut self, ui: &mut Ui, network: &Network, actions: &mut Vec<Action>) -> bool {
        for (text, name) in
            self.coordinates
                .iter_mut()
                .zip(["Known x, mm", "Known y, mm", "Known z, mm"])
        {
            field(ui, name, text);
        }
        field(ui, "Sigma of the coordinates, mm", &mut self.sigma);
        for role in [
            ControlRole::Align,
            ControlRole::Weighted,
            ControlRole::Fixed,
            ControlRole::Check,
        ] {
            ui.radio_value(&mut self.role, role, control_role(role));
        }
        // An empty field is a coordinate that is not known; what is no number must not be taken for one.
        let usable = |text: &String| text.trim().is_empty() || number(text).is_some();
        let coordinates_mm = [0, 1, 2].map(|axis: usize| number(&self.coordinates[axis]));
        let enabled = self.coordinates.iter().all(usable)
            && usable(&self.sigma)
            && coordinates_mm.iter().any(Option::is_some);
        let mut done = false;
        ui.horizontal(|ui| {
            let button = ui.add_enabled(enabled, Button::new("Set coordinates"));
            if button
                .on_disabled_hover_text("It needs one coordinate at least, mm.")
                .clicked()
            {
                let sigma = number(&self.sigma);
                actions.push(Action::Edit(Edit::SetControl {
                    label: network.label(self.point),
                    coordinates_mm,
                    sigmas_mm: coordinates_mm.map(|coordinate| coordinate.and(sigma)),
                    role: self.role,
                }));
                done = true;
            }
            done |= ui.button("Leave it").clicked();
        });
        done
    }
}

fn field(ui: &mut Ui, name: &str, text: &mut String) {
    ui.horizontal(|ui| {
        let title = ui.label(name);
        ui.add(TextEdit::singleline(text).desired_width(110.0))
            .labelled_by(title.id);
    });
}

fn number(text: &str) -> Option<f64> {
    text.trim()
        .parse()
        .ok()
        .filter(|number: &f64| number.is_finite())
}

/// A name that no bar has yet.
fn free_name(network: &Network) -> String {
    let names = (1..).map(|number: u32| format!("bar {number}"));
    let taken = |name: &String| network.scale_bars.iter().any(|bar| bar.name == *name);
    names
        .into_iter()
        .find(|name| !taken(name))
        .unwrap_or_default()
}

fn coordinates(control: &ControlPoint) -> String {
    let text = |value: Option<f64>| value.map_or("unknown".into(), |v| format!("{v:.3}"));
    let [x, y, z] = control.coordinates_mm.map(text);
    format!("{x}, {y}, {z} mm")
}

fn bar_role(role: BarRole) -> &'static str {
    match role {
        BarRole::Control => "gives scale",
        BarRole::Check => "check only",
    }
}

fn control_role(role: ControlRole) -> &'static str {
    match role {
        ControlRole::Align => "the network is moved onto it",
        ControlRole::Weighted => "enters with its weight",
        ControlRole::Fixed => "is not changed",
        ControlRole::Check => "is only compared",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ui::panels::facts::select_point;
    use crate::ui::panels::fixture::{Bench, network};
    use crate::ui::panels::inspector::Inspector;
    use egui_kittest::kittest::Queryable as _;

    fn bench(label: &str) -> Bench {
        let mut panel = Inspector::default();
        Bench::selecting(
            network(),
            select_point(label.parse().unwrap()),
            move |ui, context, actions| {
                panel.ui(ui, context, actions);
            },
        )
    }

    fn enter(bench: &mut Bench, field: &str, text: &str) {
        let role = egui::accesskit::Role::TextInput;
        bench.harness.get_by_role_and_label(role, field).focus();
        bench.harness.run();
        bench
            .harness
            .get_by_role_and_label(role, field)
            .type_text(text);
        bench.harness.run();
    }

    #[test]
    fn a_bar_goes_from_one_point_to_another() {
        let mut bench = bench("M1");
        bench.harness.get_by_label("Bar from here").click();
        assert_eq!(bench.actions(), []);
        bench.select(select_point("C2".parse().unwrap()));
        bench.harness.get_by_label("Bar from M1 to C2.O");
        bench.harness.get_by_label("Bar to here").click();
        assert_eq!(bench.actions(), [], "without a length there is no bar");
        enter(&mut bench, "Length, mm", "500.25");
        bench.harness.get_by_label("Bar to here").click();
        let expected = Edit::AddBar {
            name: "bar 1".into(),
            from: "M1".into(),
            to: "C2.O".into(),
            length_mm: 500.25,
            sigma_mm: 0.01,
            role: BarRole::Control,
        };
        assert_eq!(bench.actions(), [Action::Edit(expected.clone())]);
        bench.change(|network| expected.apply(network).unwrap());
        bench.harness.get_by_label("Remove bar bar 1").click();
        let name = "bar 1".into();
        assert_eq!(bench.actions(), [Action::Edit(Edit::RemoveBar { name })]);
    }

    #[test]
    fn a_point_becomes_control_and_loses_it() {
        let mut bench = bench("M1");
        bench.harness.get_by_label("Make control point").click();
        bench.actions();
        enter(&mut bench, "Known x, mm", "12.5");
        enter(&mut bench, "Known z, mm", "-3");
        enter(&mut bench, "Sigma of the coordinates, mm", "0.02");
        bench.harness.get_by_label("enters with its weight").click();
        bench.actions();
        bench.harness.get_by_label("Set coordinates").click();
        let expected = Edit::SetControl {
            label: "M1".into(),
            coordinates_mm: [Some(12.5), None, Some(-3.0)],
            sigmas_mm: [Some(0.02), None, Some(0.02)],
            role: ControlRole::Weighted,
        };
        assert_eq!(bench.actions(), [Action::Edit(expected.clone())]);
        bench.change(|network| expected.apply(network).unwrap());
        bench.harness.get_by_label("Remove control point").click();
        let label = "M1".into();
        assert_eq!(
            bench.actions(),
            [Action::Edit(Edit::RemoveControl { label })]
        );
    }
}
