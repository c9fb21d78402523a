//! The grey values of a blurred elliptic dot, and their derivatives.

use nalgebra::{Matrix2, SVector, Vector2};

use super::ellipse::Ellipse;

/// Number of parameters of a [`Profile`].
pub(super) const PARAMETERS: usize = 12;

/// Parameters in the order of the derivatives: centre x, y; shape xx, xy, yy; blur; background and its slopes along
/// x, y; amplitude and its slopes along x, y.
pub(super) type Parameters = SVector<f64, PARAMETERS>;

/// Place of the blur in [`Parameters`].
pub(super) const BLUR: usize = 5;
/// Place of the background at the origin.
pub(super) const BACKGROUND: usize = 6;
/// Place of the amplitude at the origin.
pub(super) const AMPLITUDE: usize = 9;

/// `I(p) = background(p) + amplitude(p) Phi((d(p) - blur^2 k(p) / 2) / blur)` with the signed distance `d` from the
/// ellipse, positive inside, to first order of its implicit equation (Sampson, 1982), and the curvature `k` of the
/// ellipse in the direction of `p`: a blurred convex edge retreats by half the curvature times the blur's variance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Profile {
    pub(super) parameters: Parameters,
}

impl Profile {
    pub(super) fn new(ellipse: &Ellipse, blur: f64, background: f64, amplitude: f64) -> Self {
        let mut parameters = Parameters::zeros();
        parameters[0] = ellipse.centre.x;
        parameters[1] = ellipse.centre.y;
        parameters[2] = ellipse.shape[(0, 0)];
        parameters[3] = ellipse.shape[(0, 1)];
        parameters[4] = ellipse.shape[(1, 1)];
        parameters[BLUR] = blur;
        parameters[BACKGROUND] = background;
        parameters[AMPLITUDE] = amplitude;
        Self { parameters }
    }

    pub(super) fn ellipse(&self) -> Ellipse {
        let p = &self.parameters;
        Ellipse {
            centre: Vector2::new(p[0], p[1]),
            shape: Matrix2::new(p[2], p[3], p[3], p[4]),
        }
    }

    pub(super) fn blur(&self) -> f64 {
        self.parameters[BLUR]
    }

    /// Background at the dot's centre.
    pub(super) fn background(&self) -> f64 {
        let p = &self.parameters;
        p[6] + p[7] * p[0] + p[8] * p[1]
    }

    /// Amplitude at the dot's centre.
    pub(super) fn amplitude(&self) -> f64 {
        let p = &self.parameters;
        p[9] + p[10] * p[0] + p[11] * p[1]
    }

    /// Signed distance from the edge, px, positive inside.
    #[cfg(test)]
    pub(super) fn distance(&self, place: Vector2<f64>) -> f64 {
        let ellipse = self.ellipse();
        let from_centre = place - ellipse.centre;
        let normal = ellipse.shape * from_centre;
        let level = from_centre.dot(&normal).max(0.0).sqrt();
        let gradient = normal.norm();
        if gradient > 0.0 {
            (level - level * level) / gradient
        } else {
            // The centre itself: as far inside as the mean radius.
            ellipse
                .shape
                .determinant()
                .max(f64::MIN_POSITIVE)
                .powf(-0.25)
        }
    }
}
