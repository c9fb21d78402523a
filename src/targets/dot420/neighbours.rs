//! Which dots stand near a place, without looking at all of them.

use nalgebra::Vector2;

use crate::targets::Dot;

/// More cells than this many times the number of dots would be mostly empty.
const CELLS_PER_DOT: f64 = 4.0;

/// The dots of a picture sorted into square cells.
pub(super) struct Neighbourhood {
    origin: Vector2<f64>,
    cell_px: f64,
    columns: usize,
    rows: usize,
    /// Where each cell's dots begin in `members`; one more than there are cells.
    begins: Vec<usize>,
    members: Vec<u32>,
}

impl Neighbourhood {
    /// Sorts the dots with finite centres into cells of about `wanted_cell_px`.
    pub(super) fn new(dots: &[Dot], wanted_cell_px: f64) -> Self {
        let places = || dots.iter().map(|d| d.centre_px).filter(is_finite);
        let low = places().fold(Vector2::repeat(f64::INFINITY), |a, b| a.inf(&b));
        let high = places().fold(Vector2::repeat(f64::NEG_INFINITY), |a, b| a.sup(&b));
        let (origin, extent) = if low.x <= high.x {
            (low, high - low)
        } else {
            (Vector2::zeros(), Vector2::zeros())
        };
        let fewest = (extent.x * extent.y / (CELLS_PER_DOT * dots.len().max(1) as f64)).sqrt();
        let longest = extent.max() / (CELLS_PER_DOT * dots.len().max(1) as f64);
        let cell_px = wanted_cell_px.max(fewest).max(longest).max(1.0);
        let columns = (extent.x / cell_px) as usize + 1;
        let rows = (extent.y / cell_px) as usize + 1;
        let mut index = Self {
            origin,
            cell_px,
            columns,
            rows,
            begins: vec![0; columns * rows + 1],
            members: Vec::new(),
        };
        index.fill(dots);
        index
    }

    fn fill(&mut self, dots: &[Dot]) {
        let mut placed: Vec<(usize, u32)> = dots
            .iter()
            .enumerate()
            .filter(|(_, dot)| is_finite(&dot.centre_px))
            .map(|(slot, dot)| {
                let at = (dot.centre_px - self.origin) / self.cell_px;
                let column = (at.x as usize).min(self.columns - 1);
                let row = (at.y as usize).min(self.rows - 1);
                (row * self.columns + column, slot as u32)
            })
            .collect();
        placed.sort_unstable();
        for (cell, _) in &placed {
            self.begins[cell + 1] += 1;
        }
        for cell in 1..self.begins.len() {
            self.begins[cell] += self.begins[cell - 1];
        }
        self.members = placed.into_iter().map(|(_, slot)| slot).collect();
    }

    /// Slots of the dots within `radius_px` of `place`, in rising order.
    pub(super) fn within(&self, dots: &[Dot], place: Vector2<f64>, radius_px: f64) -> Vec<usize> {
        let low = (place - self.origin).add_scalar(-radius_px) / self.cell_px;
        let high = (place - self.origin).add_scalar(radius_px) / self.cell_px;
        if high.x < 0.0 || high.y < 0.0 {
            return Vec::new();
        }
        let (column_end, row_end) = (
            (high.x as usize).min(self.columns - 1),
            (high.y as usize).min(self.rows - 1),
        );
        let mut found = Vec::new();
        for row in low.y.max(0.0) as usize..=row_end {
            for column in low.x.max(0.0) as usize..=column_end {
                let cell = row * self.columns + column;
                let members = &self.members[self.begins[cell]..self.begins[cell + 1]];
                found.extend(members.iter().map(|&slot| slot as usize).filter(|&slot| {
                    (dots[slot].centre_px - place).norm_squared() <= radius_px * radius_px
                }));
            }
        }
        found.sort_unstable();
        found
    }
}

fn is_finite(place: &Vector2<f64>) -> bool {
    place.x.is_finite() && place.y.is_finite()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn dot(x: f64, y: f64) -> Dot {
        Dot {
            centre_px: Vector2::new(x, y),
            sigma_px: 0.03,
            major_px: 10.0,
            minor_px: 10.0,
            angle: 0.0,
            contrast: 100.0,
            background: 10.0,
        }
    }

    proptest! {
        #[test]
        fn the_cells_find_what_a_look_at_all_dots_finds(
            places in proptest::collection::vec((0.0..900.0, 0.0..700.0), 0..60),
            x in -200.0..1100.0, y in -200.0..900.0, radius in 0.0..400.0, cell in 0.1..300.0,
        ) {
            let dots: Vec<Dot> = places.into_iter().map(|(x, y)| dot(x, y)).collect();
            let place = Vector2::new(x, y);
            let all: Vec<usize> = (0..dots.len())
                .filter(|&slot| (dots[slot].centre_px - place).norm_squared() <= radius * radius)
                .collect();
            prop_assert_eq!(Neighbourhood::new(&dots, cell).within(&dots, place, radius), all);
        }
    }
}
