//! Which parts of the screen labels take already, so that no two lie on each other.

use egui::{Rect, Vec2, vec2};

/// Side of a cell, points: a line of small text is three cells high.
const CELL: f32 = 5.0;

/// A grid over one rectangle of the screen. It is kept between frames for its memory only.
#[derive(Clone, Debug, Default)]
pub(super) struct Occupancy {
    corner: egui::Pos2,
    columns: usize,
    rows: usize,
    taken: Vec<bool>,
}

impl Occupancy {
    /// Frees everything and covers `rect`. The grid is laid from `anchor`, which moves with the picture: labels do not
    /// flicker while it is dragged.
    pub(super) fn clear(&mut self, rect: Rect, anchor: egui::Pos2) {
        let rest = |offset: f32| offset.rem_euclid(CELL);
        let apart: Vec2 = rect.min - anchor;
        self.corner = rect.min - vec2(rest(apart.x), rest(apart.y));
        let cells = |length: f32| (length / CELL).ceil().max(0.0) as usize + 1;
        self.columns = cells(rect.width());
        self.rows = cells(rect.height());
        self.taken.clear();
        self.taken.resize(self.columns * self.rows, false);
    }

    /// Takes a place whatever stands there.
    pub(super) fn take(&mut self, place: Rect) {
        if let Some((columns, rows)) = self.cells(place) {
            for row in rows {
                let start = row * self.columns;
                self.taken[start + columns.start..start + columns.end].fill(true);
            }
        }
    }

    /// Takes a place if all of it is free; nothing is free outside the rectangle.
    pub(super) fn try_take(&mut self, place: Rect) -> Taken {
        let Some((columns, rows)) = self.cells(place) else {
            return Taken::No;
        };
        for row in rows {
            let start = row * self.columns;
            if self.taken[start + columns.start..start + columns.end].contains(&true) {
                return Taken::No;
            }
        }
        self.take(place);
        Taken::Yes
    }

    fn cells(&self, place: Rect) -> Option<(std::ops::Range<usize>, std::ops::Range<usize>)> {
        let range = |from: f32, to: f32, count: usize| {
            // Negative numbers become 0, so that a label at the edge takes what of it is in sight.
            let first = (from / CELL).floor().max(0.0) as usize;
            let end = ((to / CELL).ceil().max(0.0) as usize).min(count);
            (first < end).then_some(first..end)
        };
        let (from, to) = (place.min - self.corner, place.max - self.corner);
        Some((
            range(from.x, to.x, self.columns)?,
            range(from.y, to.y, self.rows)?,
        ))
    }
}

/// Whether a place was free.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Taken {
    Yes,
    No,
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::pos2;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn no_two_taken_places_overlap(
            corners in prop::collection::vec((0.0..380.0_f32, 0.0..280.0_f32), 2..60),
            anchor in (-500.0..500.0_f32, -500.0..500.0_f32),
        ) {
            let mut occupancy = Occupancy::default();
            let rect = Rect::from_min_size(pos2(20.0, 10.0), vec2(400.0, 300.0));
            occupancy.clear(rect, pos2(anchor.0, anchor.1));
            let mut taken: Vec<Rect> = Vec::new();
            for (x, y) in corners {
                let place = Rect::from_min_size(rect.min + vec2(x, y), vec2(24.0, 12.0));
                if occupancy.try_take(place) == Taken::Yes {
                    prop_assert!(taken.iter().all(|other| !other.intersects(place)));
                    taken.push(place);
                }
            }
            prop_assert!(!taken.is_empty(), "the first place is free");
        }
    }

    #[test]
    fn nothing_is_free_outside() {
        let mut occupancy = Occupancy::default();
        occupancy.clear(
            Rect::from_min_size(pos2(0.0, 0.0), vec2(100.0, 50.0)),
            pos2(0.0, 0.0),
        );
        let outside = Rect::from_min_size(pos2(300.0, 10.0), vec2(20.0, 12.0));
        assert_eq!(occupancy.try_take(outside), Taken::No);
        let above = Rect::from_min_size(pos2(10.0, -40.0), vec2(20.0, 12.0));
        assert_eq!(occupancy.try_take(above), Taken::No);
    }
}
