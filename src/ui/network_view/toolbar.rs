//! Buttons over the canvas: where to look from, what to show.

use egui::DragValue;
use egui::PopupCloseBehavior;
use egui::containers::menu::MenuButton;
use egui::containers::menu::MenuConfig;

use super::boxing::Tool;
use super::camera::StandardView;
use super::options::Colouring;
use super::options::DisplayOptions;
use super::options::Exaggeration;
use super::options::Show;

/// Smallest and largest size of frusta that makes sense, relative to the automatic one.
const STATION_SIZES: std::ops::RangeInclusive<f64> = 0.05..=20.0;
/// Smallest and largest exaggeration of ellipsoids.
const EXAGGERATIONS: std::ops::RangeInclusive<f64> = 1.0..=1e7;

/// A viewpoint that was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wish {
    /// All in view, from the present direction.
    Fit,
    /// All in view, from a standard direction.
    View(StandardView),
}

/// Draws the buttons; `exaggeration` is what is drawn at present.
pub(super) fn draw(
    ui: &mut egui::Ui,
    options: &mut DisplayOptions,
    tool: &mut Tool,
    exaggeration: Option<f64>,
) -> Option<Wish> {
    let mut wish = None;
    ui.horizontal_wrapped(|ui| {
        if ui
            .button("Fit")
            .on_hover_text("Show the whole network (F over the view)")
            .clicked()
        {
            wish = Some(Wish::Fit);
        }
        for view in StandardView::ALL {
            if ui.button(view.name()).on_hover_text(view.hint()).clicked() {
                wish = Some(Wish::View(view));
            }
        }
        let boxing = ui.selectable_label(*tool == Tool::Box, "Box select");
        if boxing
            .on_hover_text("Dragging selects all points within a box (or hold B)")
            .clicked()
        {
            *tool = match *tool {
                Tool::Turn => Tool::Box,
                Tool::Box => Tool::Turn,
            };
        }
        let label = ui.label("Points");
        egui::ComboBox::from_id_salt("colour of points")
            .selected_text(options.colouring.name())
            .show_ui(ui, |ui| {
                for colouring in Colouring::ALL {
                    ui.selectable_value(&mut options.colouring, colouring, colouring.name());
                }
            })
            .response
            .labelled_by(label.id);
        let config = MenuConfig::new().close_behavior(PopupCloseBehavior::CloseOnClickOutside);
        MenuButton::new("Show")
            .config(config)
            .ui(ui, |ui| draw_menu(ui, options, exaggeration));
    });
    wish
}

fn draw_menu(ui: &mut egui::Ui, options: &mut DisplayOptions, exaggeration: Option<f64>) {
    toggle(ui, &mut options.stations, "Stations");
    toggle(ui, &mut options.station_names, "Names of stations");
    toggle(ui, &mut options.point_names, "Names of points");
    toggle(ui, &mut options.rays, "Rays of the selected point");
    toggle(ui, &mut options.scale_bars, "Scale bars");
    toggle(ui, &mut options.connection_order, "Order of connection");
    toggle(ui, &mut options.ellipsoids, "Error ellipsoids");
    ui.horizontal(|ui| {
        let label = ui.label("Ellipsoids enlarged");
        let mut factor = exaggeration.unwrap_or(1.0);
        let speed = factor / 50.0;
        let value = DragValue::new(&mut factor)
            .prefix("x ")
            .range(EXAGGERATIONS)
            .speed(speed);
        if ui
            .add_enabled(exaggeration.is_some(), value)
            .labelled_by(label.id)
            .changed()
        {
            options.exaggeration = Exaggeration::Fixed(factor);
        }
        let automatic = options.exaggeration == Exaggeration::Automatic;
        if ui
            .add_enabled(!automatic, egui::Button::new("Automatic"))
            .clicked()
        {
            options.exaggeration = Exaggeration::Automatic;
        }
    });
    ui.horizontal(|ui| {
        let label = ui.label("Size of stations");
        let speed = options.station_size / 50.0;
        let value = DragValue::new(&mut options.station_size)
            .prefix("x ")
            .range(STATION_SIZES)
            .speed(speed);
        ui.add(value).labelled_by(label.id);
    });
}

fn toggle(ui: &mut egui::Ui, show: &mut Show, text: &str) {
    let mut shown = show.is_shown();
    if ui.checkbox(&mut shown, text).changed() {
        *show = if shown { Show::Shown } else { Show::Hidden };
    }
}
