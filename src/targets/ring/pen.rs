//! What draws a ring code: at every node the shares of dot and ring, and how it lies to the borders of the segments.
//!
//! Cost: the nodes within the ring, eight at a time.

use std::f64::consts::TAU;

use nalgebra::Vector2;
use wide::f32x4;

use super::first_look::OUTER;
use super::frame::RingFrame;
use crate::targets::lanes::{LANES, Lanes};

/// Inner edge of the ring, in radii of the dot.
const INNER: f64 = 2.0;

/// What draws the nodes.
pub(super) struct Pen {
    /// From the picture to the plane before the perspective, its columns.
    back: [Vector2<f64>; 2],
    tilt: Vector2<f64>,
    /// Half the width of a soft edge, pixels.
    pub(super) half_width: f64,
    dot_radius: f64,
    /// Nothing is drawn beyond this radius, perspective left out.
    reach: f64,
}

/// Neighbouring nodes as drawn.
pub(super) struct Strokes {
    pub(super) dot: Lanes,
    pub(super) ring: Lanes,
    /// Direction as a share of the turn, -0.5 to 0.5.
    turn: Lanes,
    /// Half widths of a soft edge to a full turn.
    per_turn: Lanes,
}

impl Pen {
    pub(super) fn new(frame: &RingFrame, half_width: f64, dot_radius: f64) -> Option<Self> {
        let back = frame.map.try_inverse()?;
        let tilt = frame.tilt.norm();
        let reach = OUTER + half_width * back.norm() * (1.0 + 4.0 * tilt);
        Some(Self {
            back: [back.column(0).into(), back.column(1).into()],
            tilt: frame.tilt,
            half_width,
            dot_radius,
            reach: reach / (1.0 - tilt * reach).max(0.2),
        })
    }

    /// Between which places from the centre a row at `y` from the centre is drawn.
    pub(super) fn along_row(&self, y: f64) -> Option<[f64; 2]> {
        let [by_x, by_y] = &self.back;
        let (a, b) = (by_x.norm_squared(), by_x.dot(by_y) * y);
        let c = by_y.norm_squared() * y * y - self.reach * self.reach;
        let root = (b * b - a * c).sqrt();
        (root >= 0.0).then(|| [(-b - root) / a, (root - b) / a])
    }

    /// Draws the nodes at `xs`, `y` from the centre; `None` where nothing is seen.
    #[inline(always)]
    pub(super) fn strokes(&self, xs: Lanes, y: f32) -> Option<Strokes> {
        let all = |value: f64| Lanes::splat(value as f32);
        let [by_x, by_y] = &self.back;
        let ys = Lanes::splat(y);
        let affine_x = all(by_x.x) * xs + all(by_y.x) * ys;
        let affine_y = all(by_x.y) * xs + all(by_y.y) * ys;
        let (tilt_x, tilt_y) = (all(self.tilt.x), all(self.tilt.y));
        let towards = Lanes::ONE - tilt_x * affine_x - tilt_y * affine_y;
        let scale = Lanes::ONE / towards.map(|towards| towards.max(0.1));
        let (plane_x, plane_y) = (affine_x * scale, affine_y * scale);
        let radius = (plane_x * plane_x + plane_y * plane_y).sqrt();
        let radius = radius.map(|radius| radius.max(1e-6));
        let (outward_x, outward_y) = (plane_x / radius, plane_y / radius);
        // Derivative of the plane by the picture: scale (I + plane tilt^T) back; softness of an edge with this normal.
        let half_width = all(self.half_width);
        let along_columns = (all(by_x.x), all(by_x.y));
        let along_rows = (all(by_y.x), all(by_y.y));
        let across_x = outward_x + tilt_x * radius;
        let across_y = outward_y + tilt_y * radius;
        let by_columns = along_columns.0 * across_x + along_columns.1 * across_y;
        let by_rows = along_rows.0 * across_x + along_rows.1 * across_y;
        let across = (by_columns * by_columns + by_rows * by_rows).sqrt() * scale * half_width;
        let sharpness = Lanes::ONE / across;
        let dot = soft((all(self.dot_radius) - radius) * sharpness);
        let ring =
            soft((radius - all(INNER)) * sharpness) * soft((all(OUTER) - radius) * sharpness);
        if !is_drawn(ring) {
            return is_drawn(dot).then_some(Strokes {
                dot,
                ring,
                turn: Lanes::ZERO,
                per_turn: Lanes::ZERO,
            });
        }
        let by_columns = along_columns.0 * -outward_y + along_columns.1 * outward_x;
        let by_rows = along_rows.0 * -outward_y + along_rows.1 * outward_x;
        let along = (by_columns * by_columns + by_rows * by_rows).sqrt() * scale * half_width;
        Some(Strokes {
            dot,
            ring,
            turn: direction(plane_y, plane_x) * all(1.0 / TAU),
            per_turn: radius * all(TAU) / along,
        })
    }
}

#[inline(always)]
fn is_drawn(shares: Lanes) -> bool {
    shares
        .0
        .iter()
        .fold(false, |any, &share| any | (share > 0.0))
}

/// Angles of directions, radians.
#[inline(always)]
fn direction(y: Lanes, x: Lanes) -> Lanes {
    const HALF: usize = LANES / 2;
    let mut angles = [0.0; LANES];
    for (half, angles) in angles.chunks_mut(HALF).enumerate() {
        let part = |of: Lanes| {
            let mut part = [0.0; HALF];
            part.copy_from_slice(&of.0[half * HALF..][..HALF]);
            f32x4::from(part)
        };
        angles.copy_from_slice(&part(y).atan2(part(x)).to_array());
    }
    Lanes(angles)
}

/// A soft step, half-way at 0, complete at 1: the integral of a parabola whose variance is 1/5.
#[inline(always)]
fn soft(t: Lanes) -> Lanes {
    // What is no number counts as outside.
    let t = t.map(|t| t.max(-1.0)).map(|t| t.min(1.0));
    Lanes::splat(0.5) + t * (Lanes::splat(0.75) - Lanes::splat(0.25) * t * t)
}

/// How neighbouring nodes of a ring lie to the borders of its segments.
pub(super) struct Borders {
    pub(super) segment: Lanes,
    /// Share of the segment that lies before the node.
    pub(super) within: Lanes,
    pub(super) mix: Lanes,
    pub(super) line: Lanes,
}

impl Borders {
    #[inline(always)]
    pub(super) fn near(strokes: &Strokes, segments: usize, half_width: f32) -> Self {
        let count = segments as f32;
        let turn = strokes.turn * Lanes::splat(count);
        let turn = turn.map(|turn| if turn < 0.0 { turn + count } else { turn });
        let segment = turn.map(|turn| (turn as i32 as f32).min(count - 1.0));
        let within = turn - segment;
        let border = within.map(|within| if within < 0.5 { within } else { 1.0 - within });
        let distance = border / Lanes::splat(count) * strokes.per_turn;
        let inside = (Lanes::ONE - distance * distance).map(|inside| inside.max(0.0));
        Self {
            segment,
            within,
            mix: soft(-distance),
            line: strokes.ring * Lanes::splat(0.75) * inside / Lanes::splat(half_width),
        }
    }
}
