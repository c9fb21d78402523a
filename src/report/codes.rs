//! The tables of the code families.

use super::csv_text;
use crate::targets::{Family, dot420_table, ring_table};

/// The table of a family: `id,x1,y1,x2,y2,x3,y3` in pitches, or `id,pattern` for rings (the pattern as a decimal number).
#[must_use]
pub fn codes_csv(family: Family) -> String {
    match family {
        Family::Dot420 => csv_text(
            "id,x1,y1,x2,y2,x3,y3",
            dot420_table().iter().enumerate().map(|(index, places)| {
                let mut row = vec![(index + 1).to_string()];
                row.extend(places.iter().flatten().map(ToString::to_string));
                row
            }),
        ),
        Family::Ring(segments) => csv_text(
            "id,pattern",
            ring_table(segments)
                .iter()
                .enumerate()
                .map(|(index, pattern)| vec![(index + 1).to_string(), pattern.to_string()]),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_have_a_line_for_every_code() {
        let dots = codes_csv(Family::Dot420);
        assert_eq!(dots.lines().count(), 421);
        // The first triple of positions 1, 3, k with one beyond the line AB: (2,1), (4,1) and the first with x + y > 6.
        assert!(
            dots.starts_with("id,x1,y1,x2,y2,x3,y3\n1,2,1,4,1,"),
            "{dots}"
        );
        let rings = codes_csv(Family::Ring(14));
        assert!(
            rings.starts_with("id,pattern\n1,129\n2,135\n3,139\n"),
            "{rings}"
        );
        assert_eq!(rings.lines().count(), 517);
    }
}
