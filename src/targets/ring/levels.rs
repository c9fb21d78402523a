//! How light each segment of a ring is: all of them at once, by least squares over the pixels.
//!
//! Under the blur of an oblique view a pixel shows parts of two or three segments, of the dot and of the ground. The picture is
//! linear in their grey values, `I(p) = ground(p) + dot D(p) + sum of level_k S_k(p)`, with the drawn shares `D` and
//! `S_k` ([`super::sketch`]); so each segment's level comes out free of its neighbours'.

use nalgebra::{DMatrix, DVector, Vector2};

use super::patch::{Patch, middle};
use super::sketch::Sketch;

/// Grey values of the parts of a code.
pub(super) struct Levels {
    /// Of each segment, above the ground.
    pub(super) segments: Vec<f64>,
    /// Their standard deviations from the noise alone.
    pub(super) sigmas: Vec<f64>,
    /// Of the dot, above the ground.
    pub(super) dot: f64,
    /// Of the ground: at the middle of the patch, slopes per pixel.
    pub(super) ground: [f64; 3],
    /// Root mean square of what is left, grey values.
    pub(super) rest: f64,
}

/// `None` where the parts are not told apart.
pub(super) fn levels(patch: &Patch, sketch: &Sketch, segments: u8) -> Option<Levels> {
    /// Of a share below this nothing is learnt.
    const LEAST_SHARE: f64 = 1e-3;
    /// Weight of a level of zero, pixels: only a segment that is not seen at all feels it.
    const RIDGE: f64 = 1e-3;
    let n = usize::from(segments);
    let parts: Vec<_> = (0..n)
        .map(|segment| sketch.segment(segment))
        .chain([sketch.dot_at_middles()])
        .collect();
    let unknowns = n + 4;
    let mut normal = DMatrix::<f64>::zeros(unknowns, unknowns);
    let mut right = DVector::<f64>::zeros(unknowns);
    let (mut squares, mut count) = (0.0, 0.0);
    let mut row: Vec<(usize, f64)> = Vec::with_capacity(unknowns);
    // What the parts give to a line of pixels, from a column on.
    let mut of_line: Vec<(usize, usize, &[f32])> = Vec::with_capacity(unknowns);
    let mut line_of_parts = None;
    for (column, line, grey) in patch.pixels() {
        if line_of_parts.replace(line) != Some(line) {
            of_line.clear();
            for (unknown, part) in parts.iter().enumerate() {
                let (from, shares) = part.row(line);
                if !shares.is_empty() {
                    of_line.push((unknown, from, shares));
                }
            }
        }
        let away = away(patch, column, line);
        row.clear();
        for &(unknown, from, shares) in &of_line {
            let place = column.checked_sub(from);
            let share = place.and_then(|place| shares.get(place)).copied();
            let share = share.map_or(0.0, f64::from);
            if share > LEAST_SHARE {
                row.push((unknown, share));
            }
        }
        row.extend([(n + 1, 1.0), (n + 2, away.x), (n + 3, away.y)]);
        // The triangle that the factorisation reads.
        for (k, &(i, a)) in row.iter().enumerate() {
            right[i] += a * grey;
            for &(j, b) in &row[..=k] {
                normal[(i, j)] += a * b;
            }
        }
        squares += grey * grey;
        count += 1.0;
    }
    for unknown in 0..unknowns {
        normal[(unknown, unknown)] += RIDGE;
    }
    let factor = normal.cholesky()?;
    let found = factor.solve(&right);
    let cofactor = factor.inverse();
    let freedom: f64 = count - unknowns as f64;
    (freedom > 0.0).then(|| Levels {
        segments: found.as_slice()[..n].to_vec(),
        sigmas: (0..n)
            .map(|k| patch.noise * cofactor[(k, k)].sqrt())
            .collect(),
        dot: found[n],
        ground: [found[n + 1], found[n + 2], found[n + 3]],
        rest: ((squares - found.dot(&right)).max(0.0) / freedom).sqrt(),
    })
}

/// From the middle of the patch to a pixel, pixels.
pub(super) fn away(patch: &Patch, column: usize, row: usize) -> Vector2<f64> {
    middle(column, row) - 0.5 * Vector2::new(patch.columns as f64, patch.rows as f64)
}
