//! Where on a picture is still room to write.

use nalgebra::Vector2;

/// Side of a cell, px: text covers whole cells.
const CELL_PX: usize = 4;

/// Which cells of a picture are taken. A text costs as many steps as it covers cells, however many there are already.
#[derive(Clone)]
pub(super) struct Room {
    columns: usize,
    rows: usize,
    taken: Vec<bool>,
}

impl Room {
    /// An empty picture of this size, px; cells cut by its edges count as taken.
    pub(super) fn new([width, height]: [usize; 2]) -> Self {
        let (columns, rows) = (width / CELL_PX, height / CELL_PX);
        Self {
            columns,
            rows,
            taken: vec![false; columns * rows],
        }
    }

    /// Takes the square that reaches this far from a place, px.
    pub(super) fn take_round(&mut self, place: Vector2<f64>, reach: f64) {
        let cells = |middle: f64, count: usize| {
            let (first, last) = (middle - reach, middle + reach);
            // Casts cut off at zero; what ends before it, or is no number, takes nothing.
            let end = if last >= 0.0 {
                (last / CELL_PX as f64) as usize + 1
            } else {
                0
            };
            let end = end.min(count);
            ((first / CELL_PX as f64) as usize).min(end)..end
        };
        let columns = cells(place.x, self.columns);
        for row in cells(place.y, self.rows) {
            self.taken[row * self.columns..][columns.clone()].fill(true);
        }
    }

    /// Takes what a thin line crosses.
    pub(super) fn take_along(&mut self, from: Vector2<f64>, to: Vector2<f64>) {
        let steps = ((to - from).norm() / CELL_PX as f64).ceil().max(1.0) as u32;
        // No line within a picture is longer.
        for step in 0..=steps.min((self.columns + self.rows) as u32) {
            let share = f64::from(step) / f64::from(steps);
            self.take_round(from + (to - from) * share, 0.5);
        }
    }

    /// Takes a rectangle, px.
    pub(super) fn take(&mut self, corner: [usize; 2], size: [usize; 2]) {
        let columns = corner[0] / CELL_PX..(corner[0] + size[0]).div_ceil(CELL_PX);
        let columns = columns.start.min(self.columns)..columns.end.min(self.columns);
        let rows = corner[1] / CELL_PX..(corner[1] + size[1]).div_ceil(CELL_PX);
        for row in rows.start.min(self.rows)..rows.end.min(self.rows) {
            self.taken[row * self.columns..][columns.clone()].fill(true);
        }
    }

    /// How many cells of a rectangle are taken.
    pub(super) fn taken_in(&self, corner: [usize; 2], size: [usize; 2]) -> usize {
        let columns = corner[0] / CELL_PX..(corner[0] + size[0]).div_ceil(CELL_PX);
        let columns = columns.start.min(self.columns)..columns.end.min(self.columns);
        let rows = corner[1] / CELL_PX..(corner[1] + size[1]).div_ceil(CELL_PX);
        (rows.start.min(self.rows)..rows.end.min(self.rows))
            .map(|row| {
                let cells = &self.taken[row * self.columns..][columns.clone()];
                cells.iter().filter(|&&taken| taken).count()
            })
            .sum()
    }

    /// As [`Room::beside`], and where there is none up to five heights of the text further away.
    pub(super) fn near(
        &mut self,
        place: Vector2<f64>,
        clear: f64,
        size: [usize; 2],
    ) -> Option<[usize; 2]> {
        (0..=10).find_map(|step| {
            let further = 0.5 * f64::from(step) * size[1] as f64;
            self.beside(place, clear + further, size)
        })
    }

    /// Finds and takes room for a text of this size beside a place: its top-left corner; `None` where all round is
    /// taken. `clear` is the distance from the place that stays empty, px.
    pub(super) fn beside(
        &mut self,
        place: Vector2<f64>,
        clear: f64,
        size: [usize; 2],
    ) -> Option<[usize; 2]> {
        let [width, height] = size.map(|side| side as f64);
        let (right, left) = (clear, -clear - width);
        let (below, above) = (clear, -clear - height);
        let (middle_x, middle_y) = (-0.5 * width, -0.5 * height);
        [
            [right, middle_y],
            [left, middle_y],
            [middle_x, below],
            [middle_x, above],
            [right, above],
            [right, below],
            [left, above],
            [left, below],
        ]
        .into_iter()
        .find_map(|[x, y]| {
            let corner = place + Vector2::new(x, y);
            let inside = corner.x >= 0.0
                && corner.y >= 0.0
                && corner.x + width <= (self.columns * CELL_PX) as f64
                && corner.y + height <= (self.rows * CELL_PX) as f64;
            let corner = [corner.x as usize, corner.y as usize];
            (inside && self.taken_in(corner, size) == 0).then(|| {
                self.take(corner, size);
                corner
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_stand_round_a_place_until_there_is_no_room() {
        let mut room = Room::new([200, 100]);
        let place = Vector2::new(100.0, 50.0);
        room.take_round(place, 4.0);
        let corners: Vec<[usize; 2]> =
            std::iter::from_fn(|| room.beside(place, 12.0, [60, 16])).collect();
        assert_eq!(corners[..2], [[112, 42], [28, 42]]);
        assert!((3..=8).contains(&corners.len()), "{corners:?}");
        let further = room.near(place, 12.0, [8, 8]);
        assert!(further.is_some());
        for (slot, a) in corners.iter().enumerate() {
            for b in &corners[..slot] {
                assert!(a[0].abs_diff(b[0]) >= 60 || a[1].abs_diff(b[1]) >= 16);
            }
        }
    }

    #[test]
    fn nothing_is_written_over_an_edge() {
        let mut room = Room::new([50, 50]);
        assert_eq!(room.beside(Vector2::new(3.0, 2.0), 4.0, [60, 8]), None);
        for outside in [[-1e9, f64::NAN], [1e9, 20.0], [20.0, 57.0], [-9.0, 5.0]] {
            room.take_round(Vector2::from(outside), 5.0);
        }
        room.take([40, 40], [100, 100]);
        assert_eq!(room.taken_in([0, 0], [40, 40]), 0);
        assert!(
            room.beside(Vector2::new(25.0, 25.0), 4.0, [16, 8])
                .is_some()
        );
    }
}
