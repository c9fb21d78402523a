//! What was done, newest first: in this session, and below it in earlier ones.

use egui::{TextStyle, TextWrapMode, Ui};
use egui_extras::{Column, TableBuilder};

use crate::project::storage::JournalEntry;

/// Width of the column of numbers and times, points.
const WHEN_WIDTH: f32 = 150.0;

/// The list of what was done.
#[derive(Default)]
pub struct Journal;

/// A row of the list.
enum Row<'a> {
    /// A step or edit of this session, which can be taken back, with its number.
    Here(usize, &'a str),
    /// The line between this session and earlier ones.
    Earlier,
    /// A step or edit of an earlier session.
    Before(&'a JournalEntry),
}

impl Journal {
    /// Draws it; `titles` are the entries of the history and `earlier` those of the project file, oldest first.
    pub fn ui(&mut self, ui: &mut Ui, titles: &[String], earlier: &[JournalEntry]) {
        if titles.is_empty() && earlier.is_empty() {
            ui.weak("Nothing is done yet. Every step and every edit will stand here.");
            return;
        }
        let height = ui.text_style_height(&TextStyle::Body) + 4.0;
        let line_between = usize::from(!earlier.is_empty());
        ui.style_mut().wrap_mode = Some(TextWrapMode::Truncate);
        TableBuilder::new(ui)
            .striped(true)
            .auto_shrink(false)
            .column(Column::initial(WHEN_WIDTH).resizable(true).clip(true))
            .column(Column::remainder().clip(true))
            .body(|body| {
                let rows = titles.len() + line_between + earlier.len();
                body.rows(height, rows, |mut row| {
                    let content = content(row.index(), titles, earlier);
                    row.col(|ui| when(ui, &content));
                    row.col(|ui| what(ui, &content, titles.is_empty()));
                });
            });
    }
}

/// What stands in a row; those of this session first, newest above.
fn content<'a>(row: usize, titles: &'a [String], earlier: &'a [JournalEntry]) -> Row<'a> {
    let newest = |count: usize, row: usize| count.checked_sub(row + 1);
    if let Some(place) = newest(titles.len(), row) {
        return Row::Here(place + 1, &titles[place]);
    }
    row.checked_sub(titles.len() + 1)
        .and_then(|row| newest(earlier.len(), row))
        .map_or(Row::Earlier, |place| Row::Before(&earlier[place]))
}

fn when(ui: &mut Ui, row: &Row<'_>) {
    match row {
        Row::Here(number, _) => {
            ui.weak(number.to_string());
        }
        Row::Earlier => {
            ui.strong("Earlier");
        }
        Row::Before(entry) => {
            ui.weak(readable(&entry.line.utc));
        }
    }
}

fn what(ui: &mut Ui, row: &Row<'_>, nothing_here: bool) {
    match row {
        Row::Here(_, title) => {
            ui.label(*title).on_hover_text(*title);
        }
        Row::Earlier => {
            ui.weak(if nothing_here {
                "nothing is done in this session yet"
            } else {
                "before the project was opened; not to be undone any more"
            });
        }
        Row::Before(entry) => {
            ui.label(&entry.line.what).on_hover_text(told(entry));
        }
    }
}

/// A time of the journal, `2026-03-04T05:06:07Z`, as people write it.
fn readable(utc: &str) -> String {
    let time = utc.trim_end_matches('Z').replacen('T', " ", 1);
    format!("{time} UTC")
}

/// All that the journal tells of an entry but its settings.
fn told(entry: &JournalEntry) -> String {
    let mut lines = vec![entry.line.what.clone(), readable(&entry.line.utc)];
    if !entry.line.outcome.is_empty() {
        lines.push(entry.line.outcome.clone());
    }
    if let Some(sigma0) = entry.line.sigma0 {
        lines.push(format!("sigma0 {sigma0:.3}"));
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::project::storage::JournalLine;
    use egui_kittest::{Harness, kittest::Queryable as _};

    #[test]
    fn the_newest_entry_comes_first() {
        let titles = ["detect 16 images", "label M5 in img_3.png"].map(str::to_owned);
        let harness = Harness::new_ui(|ui| Journal.ui(ui, &titles, &[]));
        let old = harness.get_by_label("detect 16 images").rect();
        let new = harness.get_by_label("label M5 in img_3.png").rect();
        assert!(new.top() < old.top());
    }

    #[test]
    fn earlier_sessions_stand_below_with_their_time() {
        let titles = ["reject C5 in img_3.png".to_owned()];
        let earlier = [(1, "detect img_1.png"), (2, "detect img_2.png")].map(|(sequence, what)| {
            JournalEntry {
                sequence,
                line: JournalLine {
                    utc: format!("2026-03-04T05:06:0{sequence}Z"),
                    what: what.into(),
                    ..JournalLine::default()
                },
            }
        });
        let harness = Harness::new_ui(|ui| Journal.ui(ui, &titles, &earlier));
        let top = |label| harness.get_by_label(label).rect().top();
        assert!(top("reject C5 in img_3.png") < top("Earlier"));
        assert!(top("Earlier") < top("detect img_2.png"));
        assert!(top("detect img_2.png") < top("detect img_1.png"));
        assert_eq!(top("2026-03-04 05:06:02 UTC"), top("detect img_2.png"));
    }
}
