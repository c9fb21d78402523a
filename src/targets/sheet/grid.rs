//! Tiles on a page: how many fit, where each lies, where to cut.

use nalgebra::Vector2;

use super::shape::{PAGE_HEIGHT_MM, PAGE_WIDTH_MM, Shape};

/// Most printers print no nearer to the paper's edge.
pub(super) const MARGIN_MM: f64 = 8.0;
/// Height of the scale line and its text below the tiles.
pub(super) const FOOT_MM: f64 = 10.0;
/// Between two tiles.
const GAP_MM: f64 = 4.0;
/// Cut marks stand this far from a tile's corner, so that none is left on it.
const MARK_OFF_MM: f64 = 0.4;
const MARK_MM: f64 = 1.4;
const MARK_WIDTH_MM: f64 = 0.1;

/// Equal tiles in rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    tile: Vector2<f64>,
    columns: usize,
    /// Left edge of the first column.
    left: f64,
}

/// Room for tiles on a page, mm.
pub(super) fn room_mm() -> Vector2<f64> {
    Vector2::new(
        PAGE_WIDTH_MM - 2.0 * MARGIN_MM,
        PAGE_HEIGHT_MM - 2.0 * MARGIN_MM - FOOT_MM,
    )
}

/// How many columns and rows of such tiles a page has room for.
pub(super) fn capacity(tile: Vector2<f64>) -> [usize; 2] {
    /// Sums of lengths are equal to a millionth of a millimetre only.
    const ROUNDING_MM: f64 = 1e-6;
    let room = room_mm();
    let count = |room: f64, tile: f64| ((room + GAP_MM + ROUNDING_MM) / (tile + GAP_MM)) as usize;
    [count(room.x, tile.x), count(room.y, tile.y)]
}

impl Grid {
    /// The grid of `count` tiles, at most as many as the capacity, in the middle of the page's width.
    pub(super) fn new(tile: Vector2<f64>, count: usize) -> Self {
        let columns = count.clamp(1, capacity(tile)[0].max(1));
        let width = columns as f64 * (tile.x + GAP_MM) - GAP_MM;
        Self {
            tile,
            columns,
            left: 0.5 * (PAGE_WIDTH_MM - width),
        }
    }

    /// Top-left corner of a tile, row by row.
    pub(super) fn corner(&self, slot: usize) -> Vector2<f64> {
        let (column, row) = (slot % self.columns, slot / self.columns);
        Vector2::new(
            self.left + column as f64 * (self.tile.x + GAP_MM),
            MARGIN_MM + row as f64 * (self.tile.y + GAP_MM),
        )
    }

    /// Two short lines outside each of a tile's four corners: a ruler laid along them is the cut.
    pub(super) fn cut_marks(&self, slot: usize) -> Vec<Shape> {
        let corner = self.corner(slot);
        let mut marks = Vec::new();
        for (x, outward_x) in [(0.0, -1.0), (self.tile.x, 1.0)] {
            for (y, outward_y) in [(0.0, -1.0), (self.tile.y, 1.0)] {
                let place = corner + Vector2::new(x, y);
                for outward in [Vector2::new(outward_x, 0.0), Vector2::new(0.0, outward_y)] {
                    marks.push(Shape::Line {
                        from: place + outward * MARK_OFF_MM,
                        to: place + outward * (MARK_OFF_MM + MARK_MM),
                        width: MARK_WIDTH_MM,
                    });
                }
            }
        }
        marks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_fill_the_page_and_none_leaves_it() {
        let room = room_mm();
        for side in [3.0, 25.0, 45.0, 194.0] {
            let tile = Vector2::new(side, side + 5.0);
            let [columns, rows] = capacity(tile);
            let grid = Grid::new(tile, columns * rows);
            let last = grid.corner(columns * rows - 1) + tile;
            assert!(last.x <= MARGIN_MM + room.x + 1e-6 && last.y <= MARGIN_MM + room.y + 1e-6);
            assert!(last.x + side + GAP_MM > MARGIN_MM + room.x, "{side}");
            assert!(last.y + tile.y + GAP_MM > MARGIN_MM + room.y, "{side}");
            assert!(grid.corner(0).x >= MARGIN_MM - 1e-6);
        }
        assert_eq!(capacity(Vector2::new(195.0, 10.0))[0], 0);
    }
}
