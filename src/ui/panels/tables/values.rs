//! Rows of a table as values: sorted, filtered and written as text without a window.

use std::cmp::Ordering;
use std::fmt;
use std::sync::Arc;

use crate::ui::action::Selection;
use crate::ui::format;

/// A column of a table.
pub(super) struct TableColumn {
    /// Its name with the unit.
    pub(super) title: &'static str,
    /// Its width at first, points.
    pub(super) width: f32,
}

pub(super) const fn column(title: &'static str, width: f32) -> TableColumn {
    TableColumn { title, width }
}

/// What stands in one place of a table.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Cell {
    /// Nothing is known.
    Empty,
    /// A text; texts that stand in many rows are shared.
    Text(Arc<str>),
    /// A number with so many digits.
    Number {
        /// The number.
        value: f64,
        /// Digits after the point.
        digits: u8,
    },
    /// A small number, written with an exponent.
    Small {
        /// The number.
        value: f64,
        /// Its standard deviation, which gives the digits.
        sigma: Option<f64>,
    },
}

impl Cell {
    pub(super) fn text(text: impl Into<Arc<str>>) -> Self {
        Cell::Text(text.into())
    }

    pub(super) fn number(value: f64, digits: usize) -> Self {
        Cell::Number {
            value,
            digits: digits as u8,
        }
    }

    pub(super) fn count(value: usize) -> Self {
        Cell::number(value as f64, 0)
    }

    pub(super) fn known(value: Option<f64>, digits: usize) -> Self {
        value.map_or(Cell::Empty, |v| Cell::number(v, digits))
    }

    fn value(&self) -> Option<f64> {
        match self {
            Cell::Number { value, .. } | Cell::Small { value, .. } => Some(*value),
            _ => None,
        }
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Cell::Empty => Ok(()),
            Cell::Text(text) => f.write_str(text),
            Cell::Number { value, digits } => {
                let text = format!("{value:.*}", usize::from(*digits));
                // What rounds to zero has no sign.
                let zero = text.bytes().all(|c| matches!(c, b'-' | b'0' | b'.'));
                f.write_str(if zero {
                    text.trim_start_matches('-')
                } else {
                    &text
                })
            }
            Cell::Small { value, sigma } => f.write_str(&format::small(*value, *sigma)),
        }
    }
}

/// A row, and what a click on it selects.
pub(super) struct Row {
    pub(super) selection: Selection,
    /// Whether it takes no part.
    pub(super) muted: bool,
    pub(super) cells: Vec<Cell>,
}

impl Row {
    /// Whether it is about what is selected.
    pub(super) fn is_selected(&self, selection: &Selection) -> bool {
        let own = &self.selection;
        match (own.dot, own.point, own.image) {
            (Some(_), point, _) => match selection.dot {
                Some(_) => own.dot == selection.dot,
                None => point.is_some() && point == selection.point,
            },
            (None, Some(_), _) => own.point == selection.point,
            (None, None, Some(_)) => own.image == selection.image,
            (None, None, None) => false,
        }
    }
}

/// A table with all its rows.
pub(super) struct Table {
    pub(super) columns: &'static [TableColumn],
    pub(super) rows: Vec<Row>,
    /// What to say where there are none.
    pub(super) empty: &'static str,
}

/// Places of rows in the order in which they are shown.
pub(super) type Order = Vec<u32>;

/// By which column rows are sorted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sort {
    column: usize,
    direction: Direction,
}

/// Which end comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Direction {
    /// Smallest first.
    Up,
    /// Largest first.
    Down,
}

impl Sort {
    /// The sort after a click on a header: up at first, then down, then up again.
    pub(super) fn clicked(before: Option<Sort>, column: usize) -> Sort {
        let up = Sort {
            column,
            direction: Direction::Up,
        };
        match before {
            Some(sort) if sort == up => Sort {
                direction: Direction::Down,
                ..up
            },
            _ => up,
        }
    }

    /// How this column is sorted; `None` where another is.
    pub(super) fn direction_of(sort: Option<Sort>, column: usize) -> Option<Direction> {
        sort.filter(|s| s.column == column).map(|s| s.direction)
    }
}

impl Table {
    /// The rows of which a text holds the filter (lower case), sorted; rows without a value stand last either way.
    pub(super) fn order(&self, sort: Option<Sort>, filter: &str) -> Order {
        let mut order: Order = (0..self.rows.len() as u32)
            .filter(|row| self.holds(*row, filter))
            .collect();
        if let Some(Sort { column, direction }) = sort {
            let cell = |row: u32| &self.rows[row as usize].cells[column];
            order.sort_by(|a, b| compare(cell(*a), cell(*b), direction));
        }
        order
    }

    fn holds(&self, row: u32, filter: &str) -> bool {
        let mut cells = self.rows[row as usize].cells.iter();
        filter.is_empty()
            || cells.any(|cell| match cell {
                Cell::Text(text) => text.to_lowercase().contains(filter),
                _ => false,
            })
    }
}

fn compare(a: &Cell, b: &Cell, direction: Direction) -> Ordering {
    let turned = |order: Ordering| match direction {
        Direction::Up => order,
        Direction::Down => order.reverse(),
    };
    match (a, b) {
        (Cell::Empty, Cell::Empty) => Ordering::Equal,
        (Cell::Empty, _) => Ordering::Greater,
        (_, Cell::Empty) => Ordering::Less,
        (Cell::Text(a), Cell::Text(b)) => turned(natural(a, b)),
        (Cell::Text(_), _) => Ordering::Greater,
        (_, Cell::Text(_)) => Ordering::Less,
        (a, b) => {
            let [a, b] = [a, b].map(|c| c.value().unwrap_or(f64::NAN));
            turned(a.total_cmp(&b))
        }
    }
}

/// The order in which people count: M2 before M10.
fn natural(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a, b);
    loop {
        let digits = |s: &str| s.find(|c: char| !c.is_ascii_digit()).unwrap_or(s.len());
        let (number_a, number_b) = (digits(a), digits(b));
        let order = if number_a > 0 && number_b > 0 {
            let [x, y] = [&a[..number_a], &b[..number_b]].map(|n| n.trim_start_matches('0'));
            (a, b) = (&a[number_a..], &b[number_b..]);
            x.len().cmp(&y.len()).then_with(|| x.cmp(y))
        } else {
            let (mut rest_a, mut rest_b) = (a.chars(), b.chars());
            let (x, y) = (rest_a.next(), rest_b.next());
            if x.is_none() && y.is_none() {
                return Ordering::Equal;
            }
            (a, b) = (rest_a.as_str(), rest_b.as_str());
            x.cmp(&y)
        };
        if order.is_ne() {
            return order;
        }
    }
}

/// The rows as shown, with tabs between the columns and a header.
pub(super) fn as_text(table: &Table, order: &[u32]) -> String {
    let titles: Vec<&str> = table.columns.iter().map(|c| c.title).collect();
    let mut text = titles.join("\t");
    for row in order {
        text.push('\n');
        for (place, cell) in table.rows[*row as usize].cells.iter().enumerate() {
            if place > 0 {
                text.push('\t');
            }
            text += &cell.to_string();
        }
    }
    text.push('\n');
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_sorted_as_people_count() {
        let mut labels = vec!["M10", "M2", "C1.B", "C10.A", "C2.O", "M02"];
        labels.sort_by(|a, b| natural(a, b));
        assert_eq!(labels, ["C1.B", "C2.O", "C10.A", "M2", "M02", "M10"]);
    }
}
