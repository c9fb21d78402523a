//! Things in the picture by their rows, so that what lies near a place is found without looking at all.

/// Things with their rows, sorted.
#[derive(Clone, Debug)]
pub(super) struct ByRows<T> {
    /// Row of the middle, px, and the thing.
    things: Vec<(f64, T)>,
    /// How far the largest reaches from its middle, px.
    reach: f64,
}

impl<T> ByRows<T> {
    /// Of things with the row of their middle and how far they reach from it, px.
    pub(super) fn new(things: impl IntoIterator<Item = (f64, f64, T)>) -> Self {
        let mut reach = 0.0;
        let mut sorted: Vec<(f64, T)> = things
            .into_iter()
            .map(|(row, own_reach, thing)| {
                reach = f64::max(reach, own_reach);
                (row, thing)
            })
            .collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self {
            things: sorted,
            reach,
        }
    }

    /// What may reach a row, in the order of the rows.
    pub(super) fn near(&self, row: f64) -> impl Iterator<Item = &T> {
        self.between(row, row)
    }

    /// What may reach some rows, in the order of the rows.
    pub(super) fn between(&self, first: f64, last: f64) -> impl Iterator<Item = &T> {
        let (first, last) = (first - self.reach, last + self.reach);
        let begin = self.things.partition_point(|(other, _)| *other < first);
        let rest = self.things[begin..].iter();
        rest.take_while(move |(other, _)| *other <= last)
            .map(|(_, thing)| thing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_may_reach_a_row_is_found_and_nothing_else() {
        let rows = ByRows::new([(5.0, 1.0, 'b'), (1.0, 2.0, 'a'), (9.0, 0.5, 'c')]);
        let near = |row: f64| rows.near(row).copied().collect::<String>();
        assert_eq!(near(3.0), "ab");
        assert_eq!(near(7.5), "c");
        assert_eq!(near(-1.5), "");
        assert_eq!(ByRows::<u8>::new([]).near(0.0).count(), 0);
    }
}
