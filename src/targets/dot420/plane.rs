//! The plane of a code in perspective: a homography from grid to pixels, fitted to six centres.
//!
//! `x_px = (a X + b Y + c) / w`, `y_px = (d X + e Y + f) / w`, `w = 1 + g X + h Y`, with X, Y in pitches from the
//! middle (3, 3) of the code. Lens distortion and the offset of an ellipse's centre from the circle's centre vary so
//! little inside a code that the homography takes up all but some thousandths of a pitch.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use super::perspective::{NominalCamera, Perspective};

/// Middle of the code, pitches.
const MIDDLE: f64 = 3.0;
/// Gauss-Newton steps; from the affine start three reach 1e-9 px, as the perspective inside a code is slight.
const STEPS: usize = 5;
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
    /// What was known of g and h.
    perspective: Perspective,
    /// Root mean square of the residuals' coordinates, px.
    pub(super) rms_px: f64,
    /// Square root of the weighted sum of squares over its redundancy (6: twelve coordinates, two perspective terms
    /// observed by the areas, eight unknowns).
    pub(super) standardised: f64,
}

/// How far a dot may stand from where the other five say, and how far it does.
#[derive(Clone, Copy, Debug)]
pub(super) struct Departure {
    /// Root of the determinant of the covariance of the dot's place against the other five, pitches squared.
    pub(super) area_pitches2: f64,
    /// Squared distance of the dot in that covariance (chi-square with two degrees of freedom for a true dot).
    pub(super) squared: f64,
}

impl Plane {
    /// Fits the plane to the six dots; `None` where they do not determine it.
    pub(super) fn fit(dots: &[GridDot; 6]) -> Option<Self> {
        Self {
            unknowns: SVector::zeros(),
            base_px: dots[0].centre_px,
            perspective: Perspective::without_camera(dots),
            rms_px: 0.0,
            standardised: 0.0,
        }
        .fitted(dots)
    }

    /// Fits the plane again with the perspective that the camera expects of this one: of the two turns that its map leaves
    /// open the one that fits better.
    pub(super) fn with_camera(&self, dots: &[GridDot; 6], camera: &NominalCamera) -> Option<Self> {
        let middle_px = self.base_px + Vector2::new(self.unknowns[2], self.unknowns[5]);
        let map = self.px_from_pitches(Vector2::repeat(MIDDLE));
        let turns = Perspective::with_camera(dots, map, middle_px, camera)?;
        let [one, other] = turns.map(|perspective| {
            Self {
                perspective,
                ..*self
            }
            .fitted(dots)
        });
        let (one, other) = (one?, other?);
        Some(if one.standardised <= other.standardised {
            one
        } else {
            other
        })
    }

    fn fitted(mut self, dots: &[GridDot; 6]) -> Option<Self> {
        self.solve(dots)?;
        let mut cost = self.perspective.cost(self.terms());
        let mut squares = 0.0;
        for dot in dots {
            let square = self.residual(dot).0.norm_squared();
            squares += square;
            cost += square / (dot.sigma_px * dot.sigma_px);
        }
        self.rms_px = (squares / 12.0).sqrt();
        self.standardised = (cost / 6.0).sqrt();
        self.standardised.is_finite().then_some(self)
    }

    /// The perspective terms g and h.
    fn terms(&self) -> Vector2<f64> {
        Vector2::new(self.unknowns[6], self.unknowns[7])
    }

    /// Gauss-Newton steps from the present unknowns.
    fn solve(&mut self, dots: &[GridDot]) -> Option<()> {
        for _ in 0..STEPS {
            let (normal, right) = self.normal_equations(dots);
            self.unknowns += normal.cholesky()?.solve(&right);
        }
        Some(())
    }

    fn normal_equations(&self, dots: &[GridDot]) -> (SMatrix<f64, 8, 8>, SVector<f64, 8>) {
        let mut normal = SMatrix::<f64, 8, 8>::zeros();
        let mut right = SVector::<f64, 8>::zeros();
        for dot in dots {
            let (residual, jacobian) = self.residual(dot);
            let w = 1.0 / (dot.sigma_px * dot.sigma_px);
            normal += jacobian.transpose() * jacobian * w;
            right -= jacobian.transpose() * residual * w;
        }
        let to_expected = self.perspective.expected - self.terms();
        let mut corner = normal.fixed_view_mut::<2, 2>(6, 6);
        corner += self.perspective.weight;
        let mut tail = right.fixed_rows_mut::<2>(6);
        tail += self.perspective.weight * to_expected;
        (normal, right)
    }

    /// The dot at this place of the six against the plane of the other five; `None` where they determine none.
    pub(super) fn departure(&self, dots: &[GridDot; 6], place: usize) -> Option<Departure> {
        let dot = dots[place];
        let others: Vec<GridDot> = (0..6).filter(|k| *k != place).map(|k| dots[k]).collect();
        let mut plane = *self;
        plane.solve(&others)?;
        let (normal, _) = plane.normal_equations(&others);
        let (off, jacobian) = plane.residual(&dot);
        let predicted = jacobian * normal.cholesky()?.inverse() * jacobian.transpose();
        let covariance = predicted + Matrix2::identity() * dot.sigma_px * dot.sigma_px;
        let map = self.px_from_pitches(dot.grid.map(f64::from).into());
        Some(Departure {
            area_pitches2: covariance.determinant().sqrt() / map.determinant().abs(),
            squared: off.dot(&(covariance.try_inverse()? * off)),
        })
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

    #[test]
    fn a_displaced_dot_departs_from_the_other_five() {
        let mut dots = seen(PLACES, [0.0, 0.0]);
        let still = Plane::fit(&dots).unwrap().departure(&dots, 4).unwrap();
        assert!(still.squared < 0.1, "{still:?}");
        // At least the dot's own sigma in x and y: 0.05 px where a pitch has 9 by 7.
        assert!(still.area_pitches2 > 0.05 * 0.05 / 63.0, "{still:?}");
        dots[4].centre_px += Vector2::new(0.9, 0.9);
        let moved = Plane::fit(&dots).unwrap().departure(&dots, 4).unwrap();
        assert!(moved.squared > 40.0, "{moved:?}");
    }
}
