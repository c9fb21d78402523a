//! What was done, newest first.

use egui::{TextStyle, TextWrapMode, Ui};
use egui_extras::{Column, TableBuilder};

/// The list of what was done.
#[derive(Default)]
pub struct Journal;

impl Journal {
    /// Draws it; `titles` are the entries of the history, oldest first.
    pub fn ui(&mut self, ui: &mut Ui, titles: &[String]) {
        if titles.is_empty() {
            ui.weak("Nothing is done yet. Every step and every edit will stand here.");
            return;
        }
        let height = ui.text_style_height(&TextStyle::Body) + 4.0;
        ui.style_mut().wrap_mode = Some(TextWrapMode::Truncate);
        TableBuilder::new(ui)
            .striped(true)
            .auto_shrink(false)
            .column(Column::initial(50.0))
            .column(Column::remainder().clip(true))
            .body(|body| {
                body.rows(height, titles.len(), |mut row| {
                    let number = titles.len() - row.index();
                    let title = &titles[number - 1];
                    row.col(|ui| {
                        ui.weak(number.to_string());
                    });
                    row.col(|ui| {
                        ui.label(title).on_hover_text(title);
                    });
                });
            });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui_kittest::{Harness, kittest::Queryable as _};

    #[test]
    fn the_newest_entry_comes_first() {
        let titles = ["detect 16 images", "label M5 in img_3.png"].map(str::to_owned);
        let harness = Harness::new_ui(|ui| Journal.ui(ui, &titles));
        let old = harness.get_by_label("detect 16 images").rect();
        let new = harness.get_by_label("label M5 in img_3.png").rect();
        assert!(new.top() < old.top());
    }
}
