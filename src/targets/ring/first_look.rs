//! The first look round a dot: is there a ring at all, and where does its grid of segments begin?
//!
//! The ring is unrolled along its middle. Where it is seen sharply the changes between light and dark tell the grid.

use nalgebra::{SMatrix, SVector, Vector2};

use super::frame::RingFrame;
use crate::targets::dot::{MeasuredDot, View};

/// Middle radius of the ring, in radii of the dot.
pub(super) const MIDDLE: f64 = 2.5;
/// Its outer edge.
pub(super) const OUTER: f64 = 3.0;
/// Directions in which the ring is unrolled.
const DIRECTIONS: usize = 210;

/// The direction with this index of `count`, radians.
pub(super) fn direction(index: usize, count: usize) -> f64 {
    std::f64::consts::TAU * (index as f64 + 0.5) / count as f64
}

/// The unit vector in a direction.
pub(super) fn towards(direction: f64) -> Vector2<f64> {
    let (sin, cos) = direction.sin_cos();
    Vector2::new(cos, sin)
}

/// Grey values above the background as a share of the dot's contrast; `None` outside the picture.
fn share(view: &View, dot: &MeasuredDot, place: Vector2<f64>) -> Option<f64> {
    let grey = view.image.sample(place.x, place.y)?;
    Some((grey - dot.dot.background) / dot.dot.contrast)
}

/// A quick look at the middle of the ring: light and dark must both be seen there.
pub(super) fn may_be_ring(view: &View, dot: &MeasuredDot, frame: &RingFrame) -> bool {
    const LOOKS: usize = 84;
    const LEAST_LIGHT: f64 = 0.02;
    let light = (0..LOOKS)
        .filter_map(|index| share(view, dot, frame.place(direction(index, LOOKS), MIDDLE)))
        .filter(|&share| share > 0.35)
        .count() as f64;
    light > LEAST_LIGHT * LOOKS as f64 && light < 0.98 * LOOKS as f64
}

/// Radius half-way between the inner and the outer edge of the ring in a direction; `None` where it is not light or
/// its edges are not seen.
pub(super) fn middle_of_ring(
    view: &View,
    dot: &MeasuredDot,
    frame: &RingFrame,
    direction: f64,
) -> Option<f64> {
    const STEP: f64 = 0.1;
    const FIRST: f64 = 1.4;
    const COUNT: usize = 25;
    const DARK: f64 = 0.35;
    let outward = towards(direction);
    let share_at = |radius: f64| share(view, dot, frame.seen(outward * radius));
    if share_at(MIDDLE)? < 0.5 * DARK {
        return None;
    }
    let mut shares = [0.0; COUNT];
    for (index, slot) in shares.iter_mut().enumerate() {
        *slot = share_at(FIRST + STEP * index as f64)?;
    }
    let (top, &most) = shares
        .iter()
        .enumerate()
        .skip(7)
        .take(9)
        .max_by(|a, b| a.1.total_cmp(b.1))?;
    if most < DARK {
        return None;
    }
    let half = 0.5 * most;
    let radius = |below: usize, above: usize| {
        let part = (half - shares[below]) / (shares[above] - shares[below]);
        FIRST + STEP * (below as f64 + part * (above as f64 - below as f64))
    };
    let inner = (1..=top)
        .rev()
        .find(|&i| shares[i] >= half && shares[i - 1] < half)?;
    let outer = (top..COUNT - 1).find(|&i| shares[i] >= half && shares[i + 1] < half)?;
    let (inner, outer) = (radius(inner - 1, inner), radius(outer + 1, outer));
    let width = outer - inner;
    (0.5..1.6).contains(&width).then_some(0.5 * (inner + outer))
}

/// Places of the changes between light and dark along the ring, as shares of the full turn; `None` where it leaves the
/// picture or is not light anywhere.
pub(super) fn changes(view: &View, dot: &MeasuredDot, frame: &RingFrame) -> Option<Vec<f64>> {
    const ACROSS: [f64; 3] = [2.35, 2.5, 2.65];
    let mut shares = Vec::with_capacity(DIRECTIONS);
    for index in 0..DIRECTIONS {
        let mut sum = 0.0;
        let outward = towards(direction(index, DIRECTIONS));
        share(view, dot, frame.seen(outward * OUTER))?;
        for radius in ACROSS {
            sum += share(view, dot, frame.seen(outward * radius))?;
        }
        shares.push(sum / ACROSS.len() as f64);
    }
    even_out(&mut shares)?;
    let turn_of = |index: usize| {
        let (here, next) = (shares[index], shares[(index + 1) % DIRECTIONS]);
        let part = (0.5 - here) / (next - here);
        ((here > 0.5) != (next > 0.5)).then(|| (index as f64 + 0.5 + part) / DIRECTIONS as f64)
    };
    Some((0..DIRECTIONS).filter_map(turn_of).collect())
}

/// Divides by the light level, a plane fitted to what is light: shadows and flash fall off across a code.
fn even_out(shares: &mut [f64]) -> Option<()> {
    let mut plane = SVector::<f64, 3>::new(brightest_share(shares)?, 0.0, 0.0);
    let row = |index: usize| {
        let (sin, cos) = direction(index, DIRECTIONS).sin_cos();
        SVector::<f64, 3>::new(1.0, cos, sin)
    };
    for _ in 0..3 {
        let mut normal = SMatrix::<f64, 3, 3>::identity();
        // The slope is held near zero unless the light parts show it.
        normal[(0, 0)] = 1e-6;
        normal[(1, 1)] = 8.0;
        normal[(2, 2)] = 8.0;
        let mut right = SVector::<f64, 3>::zeros();
        for (index, &share) in shares.iter().enumerate() {
            let row = row(index);
            // The rims of light parts are blurred: only what is nearly as light as expected counts.
            if share > 0.65 * row.dot(&plane) {
                normal += row * row.transpose();
                right += row * share;
            }
        }
        plane = normal.cholesky()?.solve(&right);
    }
    for (index, share) in shares.iter_mut().enumerate() {
        *share /= row(index).dot(&plane).max(0.25 * plane[0]);
    }
    Some(())
}

fn brightest_share(shares: &[f64]) -> Option<f64> {
    let mut sorted = shares.to_vec();
    sorted.sort_by(f64::total_cmp);
    let top = *sorted.get(shares.len() - shares.len() / 14)?;
    (top > 0.3).then_some(top)
}

/// Where the grid of a number of segments begins, told by the changes.
pub(super) struct Grid {
    /// Where the first segment begins, in segments.
    pub(super) begin: f64,
    /// Root mean square and largest distance of the changes from the grid, in segments.
    pub(super) rms: f64,
    pub(super) largest: f64,
}

impl Grid {
    /// `None` where there is no change, or more than there are segments.
    pub(super) fn of(changes: &[f64], segments: u8) -> Option<Self> {
        let n = f64::from(segments);
        if changes.is_empty() || changes.len() > usize::from(segments) {
            return None;
        }
        let sum = changes.iter().fold(Vector2::zeros(), |sum, turn| {
            let (sin, cos) = (std::f64::consts::TAU * n * turn).sin_cos();
            sum + Vector2::new(cos, sin)
        });
        let begin = sum.y.atan2(sum.x) / std::f64::consts::TAU;
        let off = |turn: &f64| {
            let segment = turn * n - begin;
            (segment - segment.round()).abs()
        };
        let squares: f64 = changes.iter().map(|turn| off(turn).powi(2)).sum();
        Some(Self {
            begin,
            rms: (squares / changes.len() as f64).sqrt(),
            largest: changes.iter().map(off).fold(0.0, f64::max),
        })
    }
}
