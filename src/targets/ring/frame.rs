//! Where a ring code lies in the picture: the plane of the code seen in perspective.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use super::first_look::{MIDDLE, direction, middle_of_ring, towards};
use crate::targets::dot::{MeasuredDot, View};

/// From the plane of a code, in radii of its dot, to the picture: `p = centre + map q / (1 + tilt . q)`.
///
/// `tilt` is the perspective, and to first order a change of the lens's scale as well. Directions in the plane run
/// clockwise as seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::targets) struct RingFrame {
    /// Image of the dot's centre.
    pub(super) centre: Vector2<f64>,
    pub(super) map: Matrix2<f64>,
    /// Change of scale, per radius of the dot.
    pub(super) tilt: Vector2<f64>,
}

impl RingFrame {
    pub(super) fn of_dot(dot: &MeasuredDot) -> Option<Self> {
        let axes = dot.ellipse.axes()?;
        Some(Self {
            centre: dot.ellipse.centre,
            map: axes.frame(),
            tilt: Vector2::zeros(),
        })
    }

    /// Where a place of the plane is seen.
    pub(super) fn seen(&self, plane: Vector2<f64>) -> Vector2<f64> {
        self.centre + self.map * plane / (1.0 + self.tilt.dot(&plane))
    }

    /// Where the ring is seen in a direction at a radius.
    pub(super) fn place(&self, direction: f64, radius: f64) -> Vector2<f64> {
        self.seen(towards(direction) * radius)
    }

    /// Radius of a place of the picture in radii of the dot.
    pub(in crate::targets) fn radius_at(&self, place: Vector2<f64>) -> f64 {
        self.map.try_inverse().map_or(f64::INFINITY, |back| {
            let affine = back * (place - self.centre);
            // Beyond the horizon nothing is seen.
            affine.norm() / (1.0 - self.tilt.dot(&affine)).max(1e-6)
        })
    }

    /// The same frame with its first direction turned by an angle.
    pub(super) fn turned(&self, angle: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        let turn = Matrix2::new(cos, -sin, sin, cos);
        Self {
            map: self.map * turn,
            tilt: turn.transpose() * self.tilt,
            ..*self
        }
    }

    /// The frame in a picture whose pixels are `step` pixels wide and begin at `corner`.
    pub(super) fn within(&self, corner: Vector2<f64>, step: f64) -> Self {
        Self {
            centre: (self.centre - corner) / step,
            map: self.map / step,
            ..*self
        }
    }

    /// Undoes [`Self::within`].
    pub(super) fn back_from(&self, corner: Vector2<f64>, step: f64) -> Self {
        Self {
            centre: self.centre * step + corner,
            map: self.map * step,
            ..*self
        }
    }
}

/// The frame corrected by the ring's edges in the directions in which it is light.
pub(super) fn refined(view: &View, dot: &MeasuredDot, frame: &RingFrame) -> Option<RingFrame> {
    const UNKNOWNS: usize = 5;
    const DIRECTIONS: usize = 140;
    /// Weight of the frame of the dot against one direction of the ring: it decides where few directions are light.
    const TRUST: f64 = 4.0;
    let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::identity() * TRUST;
    // One radius at small, one at large lever: the scale is what a small dot shows worst.
    normal[(0, 0)] = 0.2 * TRUST;
    let mut right = SVector::<f64, UNKNOWNS>::zeros();
    let mut light = 0;
    for index in 0..DIRECTIONS {
        let direction = direction(index, DIRECTIONS);
        let Some(middle) = middle_of_ring(view, dot, frame, direction) else {
            continue;
        };
        light += 1;
        let (sin, cos) = direction.sin_cos();
        let (sin2, cos2) = (2.0 * direction).sin_cos();
        let row = SVector::<f64, UNKNOWNS>::from([1.0, cos2, sin2, cos, sin]);
        normal += row * row.transpose();
        right += row * (middle / MIDDLE - 1.0);
    }
    if light < DIRECTIONS / 50 {
        return None;
    }
    let by = normal.cholesky()?.solve(&right);
    let stretch = Matrix2::new(1.0 + by[0] + by[1], by[2], by[2], 1.0 + by[0] - by[1]);
    let map = frame.map * stretch;
    // In perspective the radius in a direction falls by tilt . q as a share of itself.
    let tilt = frame.tilt - Vector2::new(by[3], by[4]) / MIDDLE;
    let plausible = by[0].abs() < 0.25 && by[1].hypot(by[2]) < 0.25 && tilt.norm() < 0.15;
    plausible.then_some(RingFrame {
        map,
        tilt,
        ..*frame
    })
}
