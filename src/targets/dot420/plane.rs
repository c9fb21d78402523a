//! The plane of a code in perspective: a homography from grid to pixels, fitted to six centres.
//!
//! `x_px = (a X + b Y + c) / w`, `y_px = (d X + e Y + f) / w`, `w = 1 + g X + h Y`, with X, Y in pitches from the
//! middle (3, 3) of the code. Lens distortion and the offset of an ellipse's centre from the circle's centre vary so
//! little inside a code that the homography takes up all but some thousandths of a pitch.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

/// Middle of the code, pitches.
const MIDDLE: f64 = 3.0;
/// Gauss-Newton steps; from the affine start three reach 1e-9 px, as the perspective inside a code is slight.
const STEPS: usize = 5;
/// Perspective expected without looking at the areas: standard deviation of the change of depth across six pitches, for dots
/// seen round (a plane parallel to the picture has none) and what obliquity adds.
const PERSPECTIVE_ROUND: f64 = 0.01;
const PERSPECTIVE_OBLIQUE: f64 = 0.04;
/// Standard deviation of the logarithm of an outline's area: this much, and this many pixels over its smaller diameter.
const LOG_AREA_SIGMA: f64 = 0.04;
const LOG_AREA_PX: f64 = 0.3;

/// A dot at its place in the code.
#[derive(Clone, Copy, Debug)]
pub(super) struct GridDot {
    /// Place in pitches.
    pub(super) grid: [i32; 2],
    /// Measured centre, px.
    pub(super) centre_px: Vector2<f64>,
    /// Standard deviation of the centre including that of the model, px.
    pub(super) sigma_px: f64,
    /// Logarithm of the product of the outline's diameters, px^2.
    pub(super) log_area: f64,
    /// Smaller diameter of the outline, px.
    pub(super) minor_px: f64,
}

/// The fitted plane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    /// a, b, c, d, e, f, g, h; c and f relative to `base_px`.
    unknowns: SVector<f64, 8>,
    base_px: Vector2<f64>,
    /// Root mean square of the residuals' coordinates, px.
    pub(super) rms_px: f64,
    /// Square root of the weighted sum of squares over its redundancy (6: twelve coordinates, two perspective terms
    /// observed by the areas, eight unknowns).
    pub(super) standardised: f64,
}

impl Plane {
    /// Fits the plane to the six dots; `None` where they do not determine it.
    pub(super) fn fit(dots: &[GridDot; 6]) -> Option<Self> {
        let (expected, weight) = perspective_from_areas(dots);
        let mut plane = Self {
            unknowns: SVector::zeros(),
            base_px: dots[0].centre_px,
            rms_px: 0.0,
            standardised: 0.0,
        };
        for _ in 0..STEPS {
            let mut normal = SMatrix::<f64, 8, 8>::zeros();
            let mut right = SVector::<f64, 8>::zeros();
            for dot in dots {
                let (residual, jacobian) = plane.residual(dot);
                let w = 1.0 / (dot.sigma_px * dot.sigma_px);
                normal += jacobian.transpose() * jacobian * w;
                right -= jacobian.transpose() * residual * w;
            }
            let to_expected = expected - plane.unknowns.fixed_rows::<2>(6);
            let mut corner = normal.fixed_view_mut::<2, 2>(6, 6);
            corner += weight;
            let mut tail = right.fixed_rows_mut::<2>(6);
            tail += weight * to_expected;
            plane.unknowns += normal.cholesky()?.solve(&right);
        }
        let off = plane.unknowns.fixed_rows::<2>(6) - expected;
        let mut cost = off.dot(&(weight * off));
        let mut squares = 0.0;
        for dot in dots {
            let square = plane.residual(dot).0.norm_squared();
            squares += square;
            cost += square / (dot.sigma_px * dot.sigma_px);
        }
        plane.rms_px = (squares / 12.0).sqrt();
        plane.standardised = (cost / 6.0).sqrt();
        plane.standardised.is_finite().then_some(plane)
    }

    /// Computed minus measured, px, and its derivative by the unknowns.
    fn residual(&self, dot: &GridDot) -> (Vector2<f64>, SMatrix<f64, 2, 8>) {
        let [x, y] = dot.grid.map(|g| f64::from(g) - MIDDLE);
        let u = &self.unknowns;
        let w = 1.0 + u[6] * x + u[7] * y;
        let computed = Vector2::new(u[0] * x + u[1] * y + u[2], u[3] * x + u[4] * y + u[5]) / w;
        #[rustfmt::skip]
        let jacobian = SMatrix::<f64, 2, 8>::from_row_slice(&[
            x, y, 1.0, 0.0, 0.0, 0.0, -computed.x * x, -computed.x * y,
            0.0, 0.0, 0.0, x, y, 1.0, -computed.y * x, -computed.y * y,
        ]) / w;
        (computed - (dot.centre_px - self.base_px), jacobian)
    }

    /// The local map from pitches to pixels at a place of the grid (pitches).
    pub(super) fn px_from_pitches(&self, grid: Vector2<f64>) -> Matrix2<f64> {
        let (x, y) = (grid.x - MIDDLE, grid.y - MIDDLE);
        let u = &self.unknowns;
        let w = 1.0 + u[6] * x + u[7] * y;
        let image = Vector2::new(u[0] * x + u[1] * y + u[2], u[3] * x + u[4] * y + u[5]) / w;
        let affine = Matrix2::new(u[0], u[1], u[3], u[4]);
        (affine - image * nalgebra::RowVector2::new(u[6], u[7])) / w
    }

    /// The place on the grid (pitches) of a pixel; `None` at the horizon.
    pub(super) fn grid_from_px(&self, px: Vector2<f64>) -> Option<Vector2<f64>> {
        let u = &self.unknowns;
        let v = px - self.base_px;
        let m = Matrix2::new(
            u[0] - v.x * u[6],
            u[1] - v.x * u[7],
            u[3] - v.y * u[6],
            u[4] - v.y * u[7],
        );
        let middle = m.try_inverse()? * Vector2::new(v.x - u[2], v.y - u[5]);
        Some(middle.add_scalar(MIDDLE))
    }

    /// Largest over smallest depth (w) among the corners of the parallelogram; infinite where the horizon crosses it.
    pub(super) fn depth_ratio(&self) -> f64 {
        let depths = [[-3.0, -3.0], [3.0, -3.0], [-3.0, 3.0], [3.0, 3.0]]
            .map(|[x, y]: [f64; 2]| 1.0 + self.unknowns[6] * x + self.unknowns[7] * y);
        let low = depths.into_iter().fold(f64::INFINITY, f64::min);
        let high = depths.into_iter().fold(f64::NEG_INFINITY, f64::max);
        if low > 0.0 { high / low } else { f64::INFINITY }
    }
}

/// The perspective terms (g, h) that the areas of the outlines show, with their weight matrix: `log area = const - 3 log w`
/// and `log w = g X + h Y` to first order, joined with the expectation of a slight perspective.
fn perspective_from_areas(dots: &[GridDot; 6]) -> (Vector2<f64>, Matrix2<f64>) {
    let place = |dot: &GridDot| Vector2::new(f64::from(dot.grid[0]), f64::from(dot.grid[1]));
    let weight = |dot: &GridDot| (LOG_AREA_SIGMA + LOG_AREA_PX / dot.minor_px).powi(-2);
    let total: f64 = dots.iter().map(weight).sum();
    let middle = dots
        .iter()
        .map(|d| place(d) * weight(d))
        .sum::<Vector2<f64>>()
        / total;
    let level = dots.iter().map(|d| d.log_area * weight(d)).sum::<f64>() / total;
    let aspect = |dot: &GridDot| (dot.minor_px * dot.minor_px / dot.log_area.exp()).min(1.0);
    let aspect = dots.iter().map(aspect).sum::<f64>() / 6.0;
    let obliquity = (1.0 - aspect * aspect).sqrt();
    let sigma = (PERSPECTIVE_ROUND + PERSPECTIVE_OBLIQUE * obliquity) / 6.0;
    let mut normal = Matrix2::identity() / (sigma * sigma);
    let mut right = Vector2::zeros();
    for dot in dots {
        let by_terms = (place(dot) - middle) * -3.0;
        normal += by_terms * by_terms.transpose() * weight(dot);
        right += by_terms * ((dot.log_area - level) * weight(dot));
    }
    let expected = normal.try_inverse().map_or(Vector2::zeros(), |q| q * right);
    (expected, normal)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACES: [[i32; 2]; 6] = [[0, 0], [6, 0], [0, 6], [2, 1], [5, 3], [3, 4]];

    fn seen(places: [[i32; 2]; 6], perspective: [f64; 2]) -> [GridDot; 6] {
        places.map(|grid| {
            let [x, y] = grid.map(|g| f64::from(g) - MIDDLE);
            let w = 1.0 + perspective[0] * x + perspective[1] * y;
            GridDot {
                grid,
                centre_px: Vector2::new(700.0 + (9.0 * x + 2.0 * y) / w, 400.0 + (x - 7.0 * y) / w),
                sigma_px: 0.05,
                log_area: (9.0_f64 * 6.0).ln() - 3.0 * w.ln(),
                minor_px: 6.0,
            }
        })
    }

    #[test]
    fn a_plane_in_perspective_is_found_again() {
        let dots = seen(PLACES, [0.006, -0.004]);
        let plane = Plane::fit(&dots).unwrap();
        // The expectation of no perspective pulls the terms a little: far below the sigma of a centre.
        assert!(plane.rms_px < 0.005, "{}", plane.rms_px);
        assert!(
            (plane.depth_ratio() - (1.03 / 0.97)).abs() < 0.01,
            "{}",
            plane.depth_ratio()
        );
        for dot in &dots {
            let grid = plane.grid_from_px(dot.centre_px).unwrap();
            let place = Vector2::new(f64::from(dot.grid[0]), f64::from(dot.grid[1]));
            assert!((grid - place).norm() < 0.002, "{grid} {place}");
            let step = Vector2::new(1e-4, -2e-4);
            let there = plane
                .grid_from_px(dot.centre_px + plane.px_from_pitches(grid) * step)
                .unwrap();
            assert!(
                (there - grid - step).norm() < 1e-7,
                "local map against the map"
            );
        }
    }

    #[test]
    fn a_displaced_dot_shows_in_the_misfit() {
        for moved in 0..6 {
            let mut dots = seen(PLACES, [0.0, 0.0]);
            // The far ends of the axes bend the plane most easily.
            let step = if moved < 3 { 1.8 } else { 0.9 };
            dots[moved].centre_px += Vector2::new(step, step);
            assert!(Plane::fit(&dots).unwrap().standardised > 2.5, "dot {moved}");
        }
    }
}
