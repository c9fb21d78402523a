//! What the ellipse of a dot says about the plane it lies on.

use nalgebra::{Matrix2, Vector2};

use super::Dot420Settings;
use crate::targets::Dot;

/// The least share of a semi-axis that is left when its tolerance is taken off, so that an outline never degenerates.
const LEAST_AXIS_SHARE: f64 = 0.3;

/// What blur may take from or add to the square of a semi-axis, px^2: an edge drawn too far inside, or moments of a grey dot
/// under a lens blur of half a pixel.
const BLUR_SQUARE_PX2: [f64; 2] = [-0.3, 1.0];

/// The ellipse `{ w : w^T E^-1 w = 1 }` of a dot.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outline {
    /// Semi-axes a >= b, px.
    pub(super) semi_axes: [f64; 2],
    /// Columns: directions of the semi-axes.
    axes: Matrix2<f64>,
}

impl Outline {
    /// The outline of a dot; `None` where its numbers make no ellipse.
    pub(super) fn new(dot: &Dot) -> Option<Self> {
        let sound = dot.minor_px > 0.0
            && dot.major_px >= dot.minor_px
            && dot.major_px.is_finite()
            && dot.angle.is_finite();
        let (sin, cos) = dot.angle.sin_cos();
        sound.then(|| Self {
            semi_axes: [dot.major_px / 2.0, dot.minor_px / 2.0],
            axes: Matrix2::new(cos, -sin, sin, cos),
        })
    }

    /// Logarithm of the product of the semi-axes (px^2).
    pub(super) fn log_area(&self) -> f64 {
        (self.semi_axes[0] * self.semi_axes[1]).ln()
    }

    /// The outline with each semi-axis changed by `sign` times its tolerance, as matrix `E`.
    fn bound(&self, sign: f64, px: f64, share: f64) -> Matrix2<f64> {
        let [a, b] = self
            .semi_axes
            .map(|s| (s + sign * (px + share * s)).max(LEAST_AXIS_SHARE * s));
        self.axes * Matrix2::new(a * a, 0.0, 0.0, b * b) * self.axes.transpose()
    }

    /// The largest number of pixels a pitch can have here.
    pub(super) fn largest_px_per_pitch(&self, settings: &Dot420Settings) -> f64 {
        let a = self.semi_axes[0];
        (a * (1.0 + settings.common_size_share) + settings.outline_px) / settings.dot_radius()
    }
}

/// The least and the largest distance in pitches that the outlines at both ends allow for a step of `step_px`.
pub(super) fn distance_bounds(
    ends: [&Outline; 2],
    step_px: Vector2<f64>,
    settings: &Dot420Settings,
) -> Option<[f64; 2]> {
    let share = settings.common_size_share;
    let distance = |sign: f64| {
        let mean = (ends[0].bound(sign, settings.outline_px, share)
            + ends[1].bound(sign, settings.outline_px, share))
            / 2.0;
        let squared = step_px.dot(&(mean.try_inverse()? * step_px));
        Some(squared.max(0.0).sqrt() * settings.dot_radius())
    };
    Some([distance(1.0)?, distance(-1.0)?])
}

/// How the outlines of several dots agree with the local maps (pitches to pixels) that a plane predicts there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Agreement {
    /// Each within its tolerance, after a common factor on all diameters.
    Agree,
    /// All dots are larger or smaller than the plane says by this factor.
    SizeOff(f64),
    /// The dot at this place of the list has another shape or size.
    Differs(usize),
}

/// Compares outlines with predicted local maps; `extra_share` widens the tolerance for a coarse prediction.
pub(super) fn agreement(
    outlines: &[Outline],
    px_from_pitches: &[Matrix2<f64>],
    extra_share: f64,
    settings: &Dot420Settings,
) -> Agreement {
    let radius = settings.dot_radius();
    let log_factors = outlines
        .iter()
        .zip(px_from_pitches)
        .map(|(o, j)| 0.5 * (o.log_area() - (j.determinant().abs() * radius * radius).ln()));
    let factor = (log_factors.sum::<f64>() / outlines.len() as f64).exp();
    // Small dots are known to a share of a pixel only.
    let mean_axis = outlines.iter().map(|o| o.semi_axes[1]).sum::<f64>() / outlines.len() as f64;
    let slack =
        (settings.common_size_share + settings.outline_px / mean_axis.max(1.0)).ln_1p() + 1e-12;
    if factor.is_nan() || factor.ln().abs() > slack {
        return Agreement::SizeOff(factor);
    }
    let share = settings.outline_share + extra_share;
    for (place, (outline, j)) in outlines.iter().zip(px_from_pitches).enumerate() {
        let predicted = j * j.transpose() * (radius * factor).powi(2);
        let larger = outline.bound(1.0, settings.outline_px, share) - predicted;
        let smaller = predicted - outline.bound(-1.0, settings.outline_px, share);
        if !(is_positive(&larger) && is_positive(&smaller)) {
            return Agreement::Differs(place);
        }
    }
    Agreement::Agree
}

/// How far the mean of the outlines, seen on the plane, is from a circle: the relative difference of its squared semi-axes,
/// after the part that blur alone explains.
///
/// On the plane `J^-1 E J^-T / r^2` is `k^2 I` with the common size k; blur adds `c^2 I` in the picture, hence
/// `c^2 (J^T J)^-1 / r^2` on the plane, which for an oblique view is no circle.
pub(super) fn ovalness(
    outlines: &[Outline],
    px_from_pitches: &[Matrix2<f64>],
    settings: &Dot420Settings,
) -> Option<f64> {
    let area = settings.dot_radius().powi(2);
    let (mut seen, mut blur) = (Matrix2::zeros(), Matrix2::zeros());
    for (outline, j) in outlines.iter().zip(px_from_pitches) {
        let pitches_from_px = j.try_inverse()?;
        let on_plane = |e: Matrix2<f64>| pitches_from_px * e * pitches_from_px.transpose() / area;
        seen += on_plane(outline.bound(0.0, 0.0, 0.0));
        blur += on_plane(Matrix2::identity());
    }
    // A symmetric matrix without its circular part is a vector of two numbers.
    let oval = |m: &Matrix2<f64>| Vector2::new(m[(0, 0)] - m[(1, 1)], 2.0 * m[(0, 1)]);
    let (oval_seen, oval_blur) = (oval(&seen), oval(&blur));
    let blur_square = oval_seen.dot(&oval_blur) / oval_blur.norm_squared().max(f64::MIN_POSITIVE);
    let explained = oval_blur * blur_square.clamp(BLUR_SQUARE_PX2[0], BLUR_SQUARE_PX2[1]);
    Some((oval_seen - explained).norm() / seen.trace())
}

fn is_positive(m: &Matrix2<f64>) -> bool {
    m[(0, 0)] >= 0.0 && m[(1, 1)] >= 0.0 && m.determinant() >= 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dot(major_px: f64, minor_px: f64, angle: f64) -> Dot {
        Dot {
            centre_px: Vector2::zeros(),
            sigma_px: 0.03,
            major_px,
            minor_px,
            angle,
            contrast: 100.0,
            background: 10.0,
        }
    }

    #[test]
    fn a_foreshortened_dot_measures_foreshortened_distances() {
        let settings = Dot420Settings::default();
        // 20 px per pitch along 30 degrees, 10 px across; dots as wide as the pitch.
        let angle = 30_f64.to_radians();
        let outline = Outline::new(&dot(20.0, 10.0, angle)).unwrap();
        let along = Vector2::new(angle.cos(), angle.sin());
        let across = Vector2::new(-angle.sin(), angle.cos());
        for step in [along * 120.0, across * 60.0, along * 72.0 + across * 48.0] {
            let [low, high] = distance_bounds([&outline; 2], step, &settings).unwrap();
            assert!(low < 6.0 && 6.0 < high, "{low} {high}");
            assert!(low > 4.5 && high < 9.0, "{low} {high}");
        }
        let [low, _] = distance_bounds([&outline; 2], across * 120.0, &settings).unwrap();
        assert!(low > 6.6, "twice as far across: {low}");
    }

    #[test]
    fn outlines_agree_with_their_own_plane_only() {
        let settings = Dot420Settings::default();
        let outlines = [Outline::new(&dot(20.0, 10.0, 0.0)).unwrap(); 3];
        let own = Matrix2::new(20.0, 0.0, 0.0, -10.0);
        assert_eq!(
            agreement(&outlines, &[own; 3], 0.0, &settings),
            Agreement::Agree
        );
        assert_eq!(
            agreement(&outlines, &[own, own, own * 1.3], 0.0, &settings),
            Agreement::Differs(2)
        );
        let turned = Matrix2::new(0.0, 20.0, 10.0, 0.0);
        assert_eq!(
            agreement(&outlines, &[turned; 3], 0.0, &settings),
            Agreement::Agree,
            "a circle has no direction"
        );
        let other = Matrix2::new(10.0, 0.0, 0.0, -20.0);
        assert_eq!(
            agreement(&outlines, &[other; 3], 0.0, &settings),
            Agreement::Differs(0)
        );
        assert!(matches!(
            agreement(&outlines, &[own * 1.5; 3], 0.0, &settings),
            Agreement::SizeOff(_)
        ));
    }
}
