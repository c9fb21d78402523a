//! The row over the picture: which image, what is drawn over it, which tool is in hand.

use egui::{Color32, Sense, Stroke, Ui, vec2};

use super::draw::SURROUNDINGS;
use super::{DotClass, ImageView, Loupe, Overlay, Tool, transform::Sight};
use crate::imaging::GreyImage;
use crate::network::{ImageId, Network};
use crate::ui::action::{Action, Selection};
use crate::ui::context::ViewContext;
use crate::ui::theme;

impl ImageView {
    pub(super) fn toolbar(
        &mut self,
        ui: &mut Ui,
        context: &ViewContext<'_>,
        picture: Option<&GreyImage>,
        actions: &mut Vec<Action>,
    ) {
        ui.horizontal_wrapped(|ui| {
            if let Some(image) = self.chooser(ui, context.network) {
                self.show(image);
                actions.push(Action::Select(Selection {
                    image: Some(image),
                    point: context.selection.point,
                    ..Selection::default()
                }));
            }
            if ui
                .button("Fit")
                .on_hover_text("The whole picture (F)")
                .clicked()
            {
                self.sight = Sight::Fit;
            }
            overlay_menu(ui, self);
            let measuring = ui.selectable_label(self.tool == Tool::Measure, "Measure");
            if measuring
                .on_hover_text("A click measures a dot that detection did not find (A)")
                .clicked()
            {
                self.toggle_measure();
            }
            let loupe = ui.selectable_label(self.loupe == Loupe::Open, "Loupe");
            if loupe
                .on_hover_text("The pixels round the pointer, up to 16 times magnified, with the measured ellipses (Z)")
                .clicked()
            {
                self.toggle_loupe();
            }
            let contrast = ui.button("Contrast");
            let text =
                "Contrast for what is in sight (0); W and drag, or drag with the right button, changes it";
            if contrast.on_hover_text(text).clicked() {
                self.open_greys(picture);
            }
        });
    }

    /// The image before, a list of all, the next one; the image that the operator chose.
    fn chooser(&self, ui: &mut Ui, network: &Network) -> Option<ImageId> {
        let before = network.images.range(..self.image).next_back();
        let after = network.images.range(self.image..).nth(1);
        let mut chosen = None;
        ui.scope(|ui| {
            ui.spacing_mut().item_spacing.x = 2.0;
            for (text, hover, image) in [
                ("<", "The image before, in this panel", before),
                (">", "The next image, in this panel", after),
            ] {
                let button = ui.add_enabled(image.is_some(), egui::Button::new(text));
                if button.on_hover_text(hover).clicked() {
                    chosen = image.map(|(id, _)| *id);
                }
            }
        });
        let list = ui.menu_button("List", |ui| {
            const HEIGHT: f32 = 360.0;
            let row = ui.spacing().interact_size.y;
            ui.set_min_width(180.0);
            egui::ScrollArea::vertical().max_height(HEIGHT).show_rows(
                ui,
                row,
                network.images.len(),
                |ui, rows| {
                    for (id, entry) in network.images.iter().skip(rows.start).take(rows.len()) {
                        let path = &entry.file.path;
                        let name = path.rsplit('/').next().unwrap_or(path);
                        if ui.selectable_label(*id == self.image, name).clicked() {
                            chosen = Some(*id);
                            ui.close();
                        }
                    }
                },
            );
        });
        list.response.on_hover_text("Which image this panel shows");
        chosen
    }
}

fn overlay_menu(ui: &mut Ui, view: &mut ImageView) {
    let config = egui::containers::menu::MenuConfig::new()
        .close_behavior(egui::PopupCloseBehavior::CloseOnClickOutside);
    egui::containers::menu::MenuButton::new("Overlays")
        .config(config)
        .ui(ui, |ui| {
            for overlay in Overlay::ALL {
                let mut shown = view.overlays.shows(overlay);
                if ui.checkbox(&mut shown, overlay.name()).changed() {
                    view.overlays.toggle(overlay);
                }
            }
            ui.separator();
            ui.add(
                egui::Slider::new(&mut view.exaggeration, 1.0..=5000.0)
                    .logarithmic(true)
                    .text("times the residuals"),
            );
            ui.separator();
            for (colour, meaning) in [
                (DotClass::Used.colour(), "used"),
                (DotClass::Code.colour(), "dot of a code"),
                (DotClass::Doubtful.colour(), "no certain label"),
                (DotClass::Rejected.colour(), "rejected"),
                (theme::PREDICTED, "predicted: missed, or (fainter) hidden"),
                (theme::SELECTED, "selected, epipolar lines"),
            ] {
                legend(ui, colour, meaning);
            }
        });
}

/// A sample of a colour on the dark of a picture, so that it looks the same in both themes.
fn legend(ui: &mut Ui, colour: Color32, meaning: &str) {
    ui.horizontal(|ui| {
        let (rect, _) = ui.allocate_exact_size(vec2(18.0, 14.0), Sense::hover());
        ui.painter().rect_filled(rect, 2.0, SURROUNDINGS);
        ui.painter()
            .circle_stroke(rect.center(), 4.0, Stroke::new(1.6, colour));
        ui.label(meaning);
    });
}
