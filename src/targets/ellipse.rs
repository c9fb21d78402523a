//! Ellipses as the images of circles.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Vector2};

/// The points `p` with `(p - centre)^T shape (p - centre) = 1`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ellipse {
    /// Centre, px.
    pub(super) centre: Vector2<f64>,
    /// Symmetric and positive definite, px^-2.
    pub(super) shape: Matrix2<f64>,
}

/// Size and direction of an ellipse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Axes {
    /// Larger semi-axis, px.
    pub(super) major: f64,
    /// Smaller semi-axis, px.
    pub(super) minor: f64,
    /// Direction of the larger axis from +x towards +y, rad, in [0, pi).
    pub(super) angle: f64,
}

impl Ellipse {
    /// The ellipse whose area has these second central moments xx, xy, yy (px^2); `None` where they span no area.
    pub(super) fn from_moments(centre: Vector2<f64>, [xx, xy, yy]: [f64; 3]) -> Option<Self> {
        // The moments of a full ellipse are a quarter of the inverse of its shape.
        let shape = (Matrix2::new(xx, xy, xy, yy) * 4.0).try_inverse()?;
        let ellipse = Self { centre, shape };
        ellipse.axes().map(|_| ellipse)
    }

    /// The ellipse with these axes.
    pub(super) fn from_axes(centre: Vector2<f64>, axes: Axes) -> Self {
        let (sin, cos) = axes.angle.sin_cos();
        let turn = Matrix2::new(cos, -sin, sin, cos);
        let sizes = Matrix2::from_diagonal(&Vector2::new(axes.major.powi(-2), axes.minor.powi(-2)));
        Self {
            centre,
            shape: turn * sizes * turn.transpose(),
        }
    }

    /// Its axes; `None` where the shape is not positive definite.
    pub(super) fn axes(&self) -> Option<Axes> {
        let (xx, xy, yy) = (self.shape[(0, 0)], self.shape[(0, 1)], self.shape[(1, 1)]);
        let (mean, half_difference) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let large = mean + half_difference.hypot(xy);
        // As a quotient, because a difference loses the digits of a narrow ellipse.
        let small = (xx * yy - xy * xy) / large;
        // A NaN fails the comparison as well.
        if !(small > 0.0 && large.is_finite()) {
            return None;
        }
        let across = 0.5 * xy.atan2(half_difference);
        let angle = (across + 0.5 * PI).rem_euclid(PI);
        Some(Axes {
            major: small.sqrt().recip(),
            minor: large.sqrt().recip(),
            angle: if angle >= PI { 0.0 } else { angle },
        })
    }

    /// Half the width and half the height of its bounding box, px.
    pub(super) fn half_extent(&self) -> Vector2<f64> {
        let spread = self.shape.try_inverse().unwrap_or_else(Matrix2::zeros);
        Vector2::new(
            spread[(0, 0)].max(0.0).sqrt(),
            spread[(1, 1)].max(0.0).sqrt(),
        )
    }

    /// 1 on the ellipse, 0 at its centre, growing linearly outwards.
    pub(super) fn level(&self, place: Vector2<f64>) -> f64 {
        let from_centre = place - self.centre;
        (from_centre.dot(&(self.shape * from_centre)))
            .max(0.0)
            .sqrt()
    }
}

/// An ellipse of the same centre and direction as another, its semi-axes longer or shorter by a length or by a factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Nested {
    ellipse: Ellipse,
    /// Inverse of the shape's xx, px^2.
    per_xx: f64,
}

impl Nested {
    /// `None` where nothing is left of an axis.
    pub(super) fn of(ellipse: &Ellipse, longer_by: f64) -> Option<Self> {
        let axes = ellipse.axes()?;
        let nested = Axes {
            major: axes.major + longer_by,
            minor: axes.minor + longer_by,
            ..axes
        };
        let positive = nested.minor > 0.0;
        positive.then(|| Self::new(Ellipse::from_axes(ellipse.centre, nested)))
    }

    /// The level of `ellipse` that is `factor`, which is positive.
    pub(super) fn at_level(ellipse: &Ellipse, factor: f64) -> Self {
        Self::new(Ellipse {
            shape: ellipse.shape / (factor * factor),
            ..*ellipse
        })
    }

    fn new(ellipse: Ellipse) -> Self {
        Self {
            ellipse,
            per_xx: 1.0 / ellipse.shape.m11,
        }
    }

    /// Where a row at `y` enters and leaves it; `None` where it passes by.
    pub(super) fn along_row(&self, y: f64) -> Option<[f64; 2]> {
        let Ellipse { centre, shape } = self.ellipse;
        let dy = y - centre.y;
        // shape_xx dx^2 + 2 shape_xy dx dy + shape_yy dy^2 = 1.
        let b = shape.m12 * dy;
        let root = (b * b - shape.m11 * (shape.m22 * dy * dy - 1.0)).sqrt();
        (root >= 0.0).then(|| [-1.0, 1.0].map(|sign| centre.x + (sign * root - b) * self.per_xx))
    }

    /// Whether a place lies inside.
    pub(super) fn holds(&self, place: Vector2<f64>) -> bool {
        let from_centre = place - self.ellipse.centre;
        from_centre.dot(&(self.ellipse.shape * from_centre)) <= 1.0
    }
}

impl Axes {
    /// Maps the unit circle to the ellipse about its own centre: symmetric, so it does not turn.
    pub(super) fn frame(&self) -> Matrix2<f64> {
        let (sin, cos) = self.angle.sin_cos();
        let turn = Matrix2::new(cos, -sin, sin, cos);
        turn * Matrix2::from_diagonal(&Vector2::new(self.major, self.minor)) * turn.transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn axes_and_shape_say_the_same(major in 1.0..50.0_f64, ratio in 0.2..0.99_f64, angle in 0.0..PI) {
            let axes = Axes { major, minor: major * ratio, angle };
            let ellipse = Ellipse::from_axes(Vector2::new(3.0, 4.0), axes);
            let back = ellipse.axes().unwrap();
            prop_assert!((back.major - axes.major).abs() < 1e-9 * major);
            prop_assert!((back.minor - axes.minor).abs() < 1e-9 * major);
            prop_assert!((2.0 * (back.angle - angle)).cos() > 1.0 - 1e-9);
            let on_circle = Vector2::new(0.6, 0.8);
            let on_ellipse = ellipse.centre + back.frame() * on_circle;
            prop_assert!((ellipse.level(on_ellipse) - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn a_row_enters_and_leaves_an_ellipse_where_its_border_is() {
        let axes = Axes {
            major: 5.0,
            minor: 2.0,
            angle: 0.6,
        };
        let ellipse = Ellipse::from_axes(Vector2::new(1.0, -2.0), axes);
        let nested = Nested::of(&ellipse, 1.5).unwrap();
        let [enters, leaves] = nested.along_row(-1.2).unwrap();
        assert!(
            nested.holds(Vector2::new(enters + 1e-9, -1.2))
                && !nested.holds(Vector2::new(enters - 1e-9, -1.2))
        );
        assert!(
            nested.holds(Vector2::new(leaves - 1e-9, -1.2))
                && !nested.holds(Vector2::new(leaves + 1e-9, -1.2))
        );
        assert_eq!(nested.along_row(9.0), None);
        assert!(Nested::of(&ellipse, -2.5).is_none());
    }

    #[test]
    fn moments_without_area_are_no_ellipse() {
        assert!(Ellipse::from_moments(Vector2::zeros(), [1.0, 1.0, 1.0]).is_none());
        assert!(Ellipse::from_moments(Vector2::zeros(), [f64::NAN, 0.0, 1.0]).is_none());
    }
}
