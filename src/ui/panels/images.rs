//! The list of images.

use std::collections::BTreeMap;
use std::sync::Arc;

use egui::{
    Align, Layout, RichText, ScrollArea, Sense, TextStyle, TextWrapMode, TextureHandle, Ui,
    WidgetInfo, vec2,
};
use egui_extras::{Column, TableBuilder, TableRow};

use super::basis::Cached;
use super::facts::{ImageFacts, image_facts, mark, select_image};
use super::stale::{BEFORE_LAST_EDITS, is_stale};
use crate::network::{ImageId, ImageUse};
use crate::project::edit::Edit;
use crate::ui::action::Action;
use crate::ui::context::ViewContext;
use crate::ui::pictures::Thumbnail;
use crate::ui::theme;

/// The list of images with what became of each.
#[derive(Default)]
pub struct Images {
    filter: String,
    facts: Cached<(), Vec<ImageFacts>>,
    /// Thumbnails on the graphics card, with what they were made of.
    textures: BTreeMap<ImageId, (Arc<Thumbnail>, TextureHandle)>,
}

/// Height of a thumbnail, points.
const THUMBNAIL_HEIGHT: f32 = 34.0;

impl Images {
    /// Draws it.
    pub fn ui(&mut self, ui: &mut Ui, context: &ViewContext<'_>, actions: &mut Vec<Action>) {
        let network = context.network;
        if network.images.is_empty() {
            ui.weak("No images. Make a project from a folder, or drop pictures here.");
            return;
        }
        let facts = self.facts.get(network, (), |()| image_facts(network));
        ui.horizontal(|ui| {
            let label = ui.label("Filter images");
            ui.text_edit_singleline(&mut self.filter)
                .labelled_by(label.id);
        });
        if is_stale(network) {
            ui.weak(format!("rms px: {BEFORE_LAST_EDITS}"));
        }
        let shown = matching(facts, &self.filter);
        let header_height = ui.text_style_height(&TextStyle::Body) + 4.0;
        let height = THUMBNAIL_HEIGHT + 2.0;
        let textures = &mut self.textures;
        textures.retain(|id, _| network.images.contains_key(id));
        ui.style_mut().wrap_mode = Some(TextWrapMode::Truncate);
        let selected = shown
            .iter()
            .position(|f| context.selection.image == Some(f.id));
        // What says whether an image needs the operator stands first; a narrow panel scrolls to the counts.
        ScrollArea::horizontal().show(ui, |ui| {
            TableBuilder::new(ui)
                .striped(true)
                .auto_shrink(false)
                .sense(Sense::click())
                .cell_layout(Layout::left_to_right(Align::Center))
                .column(Column::exact(1.5 * THUMBNAIL_HEIGHT))
                .column(Column::initial(96.0).resizable(true).clip(true))
                .column(Column::initial(76.0).resizable(true).clip(true))
                .column(Column::initial(46.0).resizable(true).clip(true))
                .columns(Column::initial(56.0).resizable(true).clip(true), 4)
                .header(header_height, |mut header| {
                    let names = [
                        "", "image", "state", "rms px", "findings", "targets", "labelled", "codes",
                    ];
                    for name in names {
                        header.col(|ui| {
                            ui.strong(name);
                        });
                    }
                })
                .body(|body| {
                    body.rows(height, shown.len(), |mut row| {
                        row.set_selected(selected == Some(row.index()));
                        let facts = shown[row.index()];
                        row.col(|ui| thumbnail(ui, context, facts.id, textures));
                        cells(&mut row, facts, is_stale(network));
                        answer(&row, facts, actions);
                    });
                });
        });
    }
}

fn matching<'a>(facts: &'a [ImageFacts], filter: &str) -> Vec<&'a ImageFacts> {
    let filter = filter.trim().to_lowercase();
    facts
        .iter()
        .filter(|f| {
            f.name.to_lowercase().contains(&filter) || f.orientation.word().starts_with(&filter)
        })
        .collect()
}

/// The picture in small; asked for by looking, so only rows in sight are read.
fn thumbnail(
    ui: &mut Ui,
    context: &ViewContext<'_>,
    id: ImageId,
    textures: &mut BTreeMap<ImageId, (Arc<Thumbnail>, TextureHandle)>,
) {
    let entry = context.network.images.get(&id);
    let Some(thumbnail) = entry.and_then(|entry| context.pictures.thumbnail(id, entry)) else {
        return;
    };
    let stands = textures
        .get(&id)
        .is_some_and(|(of, _)| Arc::ptr_eq(of, &thumbnail));
    if !stands {
        let picture = thumbnail.to_color_image();
        let name = format!("thumbnail {}", id.0);
        let texture = ui
            .ctx()
            .load_texture(name, picture, egui::TextureOptions::LINEAR);
        textures.insert(id, (thumbnail, texture));
    }
    if let Some((_, texture)) = textures.get(&id) {
        let size = vec2(1.5 * THUMBNAIL_HEIGHT, THUMBNAIL_HEIGHT);
        ui.add(egui::Image::new(texture).fit_to_exact_size(size));
    }
}

fn cells(row: &mut TableRow<'_, '_>, facts: &ImageFacts, stale: bool) {
    let excluded = facts.usage == ImageUse::Excluded;
    let text = |text: String| {
        let text = RichText::new(text);
        if excluded { text.weak() } else { text }
    };
    let plain =
        |ui: &mut Ui, content: RichText| ui.add(egui::Label::new(content).selectable(false));
    row.col(|ui| {
        let name = text(facts.short.clone());
        let response = plain(ui, if excluded { name.strikethrough() } else { name });
        response.widget_info(|| WidgetInfo::labeled(egui::Role::Label, true, &facts.name));
        response.on_hover_text(&facts.name);
    });
    row.col(|ui| {
        if excluded {
            plain(ui, text("excluded".into()));
            return;
        }
        mark(ui, facts.orientation.colour());
        let response = plain(ui, text(facts.orientation.word().into()));
        if let Some(reason) = facts.orientation.reason() {
            response.on_hover_text(reason);
        }
    });
    row.col(|ui| {
        if let Some(rms) = facts.rms_px {
            let rms = text(format!("{rms:.3}"));
            plain(ui, if stale { rms.weak() } else { rms });
        }
    });
    row.col(|ui| {
        if !facts.findings.is_empty() {
            mark(ui, Some(theme::DOUBTFUL));
            plain(ui, text(facts.findings.len().to_string()))
                .on_hover_text(facts.findings.join("\n"));
        }
    });
    for number in [facts.targets, facts.labelled, facts.codes] {
        row.col(|ui| {
            plain(ui, text(number.to_string()));
        });
    }
}

fn answer(row: &TableRow<'_, '_>, facts: &ImageFacts, actions: &mut Vec<Action>) {
    let response = row.response();
    let selection = select_image(facts.id);
    if response.double_clicked() {
        actions.push(Action::LookAt(selection));
    } else if response.clicked() {
        actions.push(Action::Select(selection));
    }
    response.context_menu(|ui| {
        let (text, usage) = match facts.usage {
            ImageUse::Used => ("Exclude this image", ImageUse::Excluded),
            ImageUse::Excluded => ("Use this image", ImageUse::Used),
        };
        if ui.button(text).clicked() {
            let image = facts.id;
            actions.push(Action::Edit(Edit::UseImage { image, usage }));
            ui.close();
        }
        if ui.button("Look at it").clicked() {
            actions.push(Action::LookAt(select_image(facts.id)));
            ui.close();
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::ImageId;
    use crate::ui::panels::fixture::{Bench, network};
    use egui_kittest::kittest::Queryable as _;

    fn bench() -> Bench {
        let mut panel = Images::default();
        Bench::new(network(), move |ui, context, actions| {
            panel.ui(ui, context, actions);
        })
    }

    #[test]
    fn the_filter_holds_names_and_states() {
        let facts = image_facts(&network());
        let names = |filter: &str| matching(&facts, filter).len();
        assert_eq!(
            (names(""), names("IMG_2"), names("orient"), names("x")),
            (3, 1, 1, 0)
        );
    }

    #[test]
    fn a_click_selects_and_the_menu_excludes() {
        let mut bench = bench();
        bench.harness.get_by_label("failed");
        bench.harness.get_by_label("img_1.png").click();
        assert_eq!(bench.actions(), [Action::Select(select_image(ImageId(1)))]);
        bench.harness.get_by_label("img_1.png").click_secondary();
        bench.actions();
        bench.harness.get_by_label("Exclude this image").click();
        let expected = Action::Edit(Edit::UseImage {
            image: ImageId(1),
            usage: ImageUse::Excluded,
        });
        assert_eq!(bench.actions(), [expected]);
    }
}
