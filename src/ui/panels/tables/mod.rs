//! Tables of points, images, observations, scale bars and camera parameters.
//!
//! Rows are built once for each state of the network, their order once for each sort and filter; only the rows in sight
//! are drawn, so that 100,000 observations scroll.

mod rows;
mod values;

pub(super) use rows::{INTERIOR_UNITS, LENGTHS};

use std::collections::BTreeSet;

use egui::{Button, Label, RichText, Sense, Shape, Stroke, TextStyle, TextWrapMode, Ui, vec2};
use egui_extras::{Column, TableBuilder};

use self::values::{Cell, Direction, Order, Sort, Table, as_text};
use super::basis::Cached;
use super::facts::arbitrary_scale;
use super::stale::from_adjustment;
use crate::ui::action::{Action, Selection};
use crate::ui::context::ViewContext;

/// What a table lists.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TableKind {
    /// Points with coordinates and sigmas.
    #[default]
    Points,
    /// Images with their stations.
    Images,
    /// Image observations with residuals.
    Observations,
    /// Scale bars.
    Bars,
    /// Camera parameters.
    Cameras,
}

impl TableKind {
    /// All tables in the order of their tabs.
    pub const ALL: [TableKind; 5] = [
        TableKind::Points,
        TableKind::Images,
        TableKind::Observations,
        TableKind::Bars,
        TableKind::Cameras,
    ];

    /// Its title.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            TableKind::Points => "Points",
            TableKind::Images => "Images",
            TableKind::Observations => "Observations",
            TableKind::Bars => "Bars",
            TableKind::Cameras => "Cameras",
        }
    }
}

/// The tables, one at a time.
#[derive(Default)]
pub struct Tables {
    kind: TableKind,
    sorts: [Option<Sort>; TableKind::ALL.len()],
    filter: String,
    rows: Rows,
    table: Cached<TableKind, Table>,
    order: Cached<(TableKind, Option<Sort>, String), Order>,
    /// The selection of the last frame: a new one is scrolled to.
    selected: Selection,
}

/// Which rows.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
enum Rows {
    #[default]
    All,
    /// Those of the points of the last box select.
    Group,
}

/// What a frame of a table asks for.
#[derive(Default)]
struct Clicks {
    header: Option<usize>,
    row: Option<usize>,
    look: Option<usize>,
}

impl Tables {
    /// Shows this table.
    pub fn show(&mut self, kind: TableKind) {
        self.kind = kind;
    }

    /// Draws it.
    pub fn ui(&mut self, ui: &mut Ui, context: &ViewContext<'_>, actions: &mut Vec<Action>) {
        let network = context.network;
        let copy = self.bar(ui);
        self.group_bar(ui, context, actions);
        let kind = self.kind;
        let sort = self.sorts[kind as usize];
        let table = self
            .table
            .get(network, kind, |kind| Table::of(*kind, network));
        let key = (kind, sort, self.filter.trim().to_lowercase());
        let order = self
            .order
            .get(network, key, |(_, sort, filter)| table.order(*sort, filter));
        let within: Order;
        let order = if self.rows == Rows::Group && !context.group.is_empty() {
            let of_group = |row: &&u32| {
                let point = table.rows[**row as usize].selection.point;
                point.is_some_and(|point| context.group.contains(&point))
            };
            within = order.iter().filter(of_group).copied().collect();
            &within
        } else {
            order
        };
        if copy {
            ui.ctx().copy_text(as_text(table, order));
        }
        if table.rows.is_empty() {
            ui.weak(table.empty);
            return;
        }
        ui.horizontal(|ui| {
            ui.weak(format!("{} of {} rows", order.len(), table.rows.len()));
            if matches!(kind, TableKind::Points | TableKind::Images) {
                arbitrary_scale(ui, network);
            }
        });
        let follow = self.selected != *context.selection;
        self.selected = context.selection.clone();
        let clicks = from_adjustment(ui, network, |ui| {
            draw(ui, kind, table, order, sort, context.selection, follow)
        });
        if let Some(column) = clicks.header {
            self.sorts[kind as usize] = Some(Sort::clicked(sort, column));
        }
        let selection = |row: usize| table.rows[row].selection.clone();
        if let Some(row) = clicks.look {
            actions.push(Action::LookAt(selection(row)));
        } else if let Some(row) = clicks.row {
            self.selected = selection(row);
            actions.push(Action::Select(selection(row)));
        }
    }

    /// What is to be done with the points of a box select.
    fn group_bar(&mut self, ui: &mut Ui, context: &ViewContext<'_>, actions: &mut Vec<Action>) {
        if context.group.is_empty() {
            return;
        }
        ui.horizontal(|ui| {
            let mut only = self.rows == Rows::Group;
            let text = format!("Only the {} points of the box", context.group.len());
            if ui.checkbox(&mut only, text).changed() {
                self.rows = if only { Rows::Group } else { Rows::All };
            }
            if ui.button("Let the box go").clicked() {
                actions.push(Action::Group(BTreeSet::new()));
            }
        });
    }

    /// Which table, filter and copy; answers whether to copy.
    fn bar(&mut self, ui: &mut Ui) -> bool {
        ui.horizontal_wrapped(|ui| {
            for kind in TableKind::ALL {
                ui.selectable_value(&mut self.kind, kind, kind.title());
            }
            ui.separator();
            let label = ui.label("Filter rows");
            let field = egui::TextEdit::singleline(&mut self.filter).desired_width(120.0);
            ui.add(field).labelled_by(label.id);
            ui.button("Copy as text")
                .on_hover_text("The rows as shown, with tabs between the columns")
                .clicked()
        })
        .inner
    }
}

fn draw(
    ui: &mut Ui,
    kind: TableKind,
    table: &Table,
    order: &Order,
    sort: Option<Sort>,
    selection: &Selection,
    follow: bool,
) -> Clicks {
    let mut clicks = Clicks::default();
    let height = ui.text_style_height(&TextStyle::Body) + 4.0;
    let chosen = |row: usize| table.rows[row].is_selected(selection);
    let place = follow
        .then(|| order.iter().position(|row| chosen(*row as usize)))
        .flatten();
    ui.style_mut().wrap_mode = Some(TextWrapMode::Truncate);
    egui::ScrollArea::horizontal().show(ui, |ui| {
        let mut builder = TableBuilder::new(ui)
            .id_salt(kind.title())
            .striped(true)
            .auto_shrink(false)
            .cell_layout(egui::Layout::left_to_right(egui::Align::Center))
            .sense(Sense::click());
        for column in table.columns {
            let width = Column::initial(column.width).at_least(30.0);
            builder = builder.column(width.resizable(true).clip(true));
        }
        if let Some(place) = place {
            builder = builder.scroll_to_row(place, None);
        }
        builder
            .header(height, |mut header| {
                for (index, column) in table.columns.iter().enumerate() {
                    header.col(|ui| {
                        if title(ui, column.title, Sort::direction_of(sort, index)) {
                            clicks.header = Some(index);
                        }
                    });
                }
            })
            .body(|body| {
                body.rows(height, order.len(), |mut row| {
                    let index = order[row.index()] as usize;
                    row.set_selected(chosen(index));
                    let content = &table.rows[index];
                    for cell in &content.cells {
                        row.col(|ui| draw_cell(ui, cell, content.muted));
                    }
                    let response = row.response();
                    if response.double_clicked() {
                        clicks.look = Some(index);
                    } else if response.clicked() {
                        clicks.row = Some(index);
                    }
                });
            });
    });
    clicks
}

fn title(ui: &mut Ui, text: &str, direction: Option<Direction>) -> bool {
    let button = ui.add(Button::new(RichText::new(text).strong()).frame(false));
    if let Some(direction) = direction {
        arrow(ui, direction);
    }
    button.on_hover_text("Sort by this column").clicked()
}

/// Side of the mark behind a sorted header, points.
const ARROW: f32 = 8.0;

/// A triangle: it points to the end where the large values stand.
fn arrow(ui: &mut Ui, direction: Direction) {
    let (rect, _) = ui.allocate_exact_size(vec2(ARROW, ARROW), Sense::empty());
    let corners = match direction {
        Direction::Up => vec![rect.left_top(), rect.right_top(), rect.center_bottom()],
        Direction::Down => vec![rect.left_bottom(), rect.right_bottom(), rect.center_top()],
    };
    let colour = ui.visuals().text_color();
    ui.painter()
        .add(Shape::convex_polygon(corners, colour, Stroke::NONE));
}

fn draw_cell(ui: &mut Ui, cell: &Cell, muted: bool) {
    let text = RichText::new(cell.to_string());
    let text = if muted { text.weak() } else { text };
    let label = Label::new(text).selectable(false);
    if matches!(cell, Cell::Number { .. } | Cell::Small { .. }) {
        // Numbers stand on the right, so that their digits stand below each other.
        let right = egui::Layout::right_to_left(egui::Align::Center);
        ui.with_layout(right, |ui| ui.add(label));
    } else {
        ui.add(label);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::ImageId;
    use crate::targets::DotIndex;
    use crate::ui::panels::facts::{select_observation, select_point};
    use crate::ui::panels::fixture::{Bench, network};
    use crate::ui::panels::stale::BEFORE_LAST_EDITS;
    use egui_kittest::kittest::Queryable as _;

    fn bench(network: crate::network::Network, selection: Selection) -> Bench {
        let mut panel = Tables::default();
        Bench::selecting(network, selection, move |ui, context, actions| {
            panel.ui(ui, context, actions);
        })
    }

    #[test]
    fn a_click_on_a_row_selects_its_point_and_its_observation() {
        let mut bench = bench(network(), Selection::default());
        bench.harness.get_by_label("C2.O").click();
        let point = "C2".parse().unwrap();
        assert_eq!(bench.actions(), [Action::Select(select_point(point))]);
        bench.harness.get_by_label("Observations").click();
        bench.actions();
        bench.harness.get_by_label("X1").click();
        let cross = Some("cross:1".parse().unwrap());
        let seen = select_observation(ImageId(1), DotIndex(2), cross);
        assert_eq!(bench.actions(), [Action::Select(seen)]);
    }

    #[test]
    fn a_click_on_a_header_sorts_and_another_turns_it_round() {
        let mut bench = bench(network(), Selection::default());
        let top = |bench: &Bench, label: &str| bench.harness.get_by_label(label).rect().top();
        assert!(top(&bench, "C1.O") < top(&bench, "C2.O"));
        bench.harness.get_by_label("x mm").click();
        bench.actions();
        assert!(
            top(&bench, "C1.O") > top(&bench, "C2.O"),
            "5 mm before 100 mm"
        );
        bench.harness.get_by_label("x mm").click();
        bench.actions();
        assert!(top(&bench, "C1.O") < top(&bench, "C2.O"));
    }

    #[test]
    fn copy_gives_the_rows_with_tabs() {
        let mut bench = bench(network(), Selection::default());
        bench.harness.get_by_label("Copy as text").click();
        bench.harness.step();
        let commands = &bench.harness.output().platform_output.commands;
        let copied = commands.iter().find_map(|command| match command {
            egui::OutputCommand::CopyText(text) => Some(text.clone()),
            _ => None,
        });
        assert!(copied.expect("a text").starts_with("point\tkind\tx mm\t"));
    }

    #[test]
    fn numbers_before_the_last_edits_say_so() {
        let mut bench = bench(network(), Selection::default());
        assert!(bench.harness.query_by_label(BEFORE_LAST_EDITS).is_none());
        bench.change(|network| network.inputs += 1);
        bench.harness.get_by_label(BEFORE_LAST_EDITS);
    }
}
