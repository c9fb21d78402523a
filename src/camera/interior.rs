//! The ten parameters of interior orientation and the correction of a measured image point.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use serde::{Deserialize, Serialize};

/// Names of the ten parameters in the order of [`InteriorOrientation::to_vector`], as they stand in reports.
pub const INTERIOR_NAMES: [&str; 10] = ["c", "x0", "y0", "K1", "K2", "K3", "P1", "P2", "B1", "B2"];

/// Principal distance, principal point and lens distortion, in millimetres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct InteriorOrientation {
    /// Principal distance c > 0, mm.
    pub principal_distance: f64,
    /// Principal point (x0, y0), mm from the image centre, y up.
    pub principal_point: [f64; 2],
    /// Radial distortion K1 mm^-2, K2 mm^-4, K3 mm^-6.
    pub radial: [f64; 3],
    /// Decentring distortion P1, P2, mm^-1.
    pub tangential: [f64; 2],
    /// Affinity B1 and shear B2, without unit.
    pub affinity: [f64; 2],
}

/// A measured image point corrected to the ideal one, with derivatives.
#[derive(Clone, Copy, Debug)]
pub struct Correction {
    /// The ideal image point (x', y'), mm from the principal point.
    pub ideal: Vector2<f64>,
    /// Derivative of the ideal by the measured point, 2x2.
    pub by_measured: Matrix2<f64>,
    /// Derivative of the ideal point by the ten parameters, 2x10; the column of c is zero.
    pub by_interior: SMatrix<f64, 2, 10>,
}

impl InteriorOrientation {
    /// A lens without distortion.
    #[must_use]
    pub fn pinhole(principal_distance: f64) -> Self {
        Self {
            principal_distance,
            principal_point: [0.0; 2],
            radial: [0.0; 3],
            tangential: [0.0; 2],
            affinity: [0.0; 2],
        }
    }

    /// c, x0, y0, K1, K2, K3, P1, P2, B1, B2.
    #[must_use]
    pub fn to_vector(&self) -> SVector<f64, 10> {
        let [x0, y0] = self.principal_point;
        let [k1, k2, k3] = self.radial;
        let [p1, p2] = self.tangential;
        let [b1, b2] = self.affinity;
        SVector::from([self.principal_distance, x0, y0, k1, k2, k3, p1, p2, b1, b2])
    }

    /// The inverse of [`Self::to_vector`].
    #[must_use]
    pub fn from_vector(v: &SVector<f64, 10>) -> Self {
        Self {
            principal_distance: v[0],
            principal_point: [v[1], v[2]],
            radial: [v[3], v[4], v[5]],
            tangential: [v[6], v[7]],
            affinity: [v[8], v[9]],
        }
    }

    /// The ideal image point of a measured one, mm: `x' = xb + xb rad + P1 (r2 + 2 xb^2) + 2 P2 xb yb + B1 xb + B2 yb`,
    /// `y' = yb + yb rad + P2 (r2 + 2 yb^2) + 2 P1 xb yb` with `xb = x - x0`, `rad = K1 r2 + K2 r2^2 + K3 r2^3`.
    #[must_use]
    pub fn ideal_from_measured(&self, measured: &Vector2<f64>) -> Vector2<f64> {
        let xb = measured.x - self.principal_point[0];
        let yb = measured.y - self.principal_point[1];
        let [k1, k2, k3] = self.radial;
        let [p1, p2] = self.tangential;
        let [b1, b2] = self.affinity;
        let r2 = xb * xb + yb * yb;
        let radial = r2 * (k1 + r2 * (k2 + r2 * k3));
        Vector2::new(
            xb + xb * radial + p1 * (r2 + 2.0 * xb * xb) + 2.0 * p2 * xb * yb + b1 * xb + b2 * yb,
            yb + yb * radial + p2 * (r2 + 2.0 * yb * yb) + 2.0 * p1 * xb * yb,
        )
    }

    /// [`Self::ideal_from_measured`] with its derivatives.
    #[must_use]
    pub fn correction(&self, measured: &Vector2<f64>) -> Correction {
        let xb = measured.x - self.principal_point[0];
        let yb = measured.y - self.principal_point[1];
        let [k1, k2, k3] = self.radial;
        let [p1, p2] = self.tangential;
        let [b1, b2] = self.affinity;
        let r2 = xb * xb + yb * yb;
        let radial = r2 * (k1 + r2 * (k2 + r2 * k3));
        let radial_by_r2 = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let cross = 2.0 * xb * yb * radial_by_r2 + 2.0 * p1 * yb + 2.0 * p2 * xb;
        let by_measured = Matrix2::new(
            1.0 + radial + 2.0 * xb * xb * radial_by_r2 + 6.0 * p1 * xb + 2.0 * p2 * yb + b1,
            cross + b2,
            cross,
            1.0 + radial + 2.0 * yb * yb * radial_by_r2 + 6.0 * p2 * yb + 2.0 * p1 * xb,
        );
        let (r4, r6) = (r2 * r2, r2 * r2 * r2);
        #[rustfmt::skip]
        let by_interior = SMatrix::<f64, 2, 10>::from_row_slice(&[
            0.0, -by_measured[(0, 0)], -by_measured[(0, 1)], xb * r2, xb * r4, xb * r6,
            r2 + 2.0 * xb * xb, 2.0 * xb * yb, xb, yb,
            0.0, -by_measured[(1, 0)], -by_measured[(1, 1)], yb * r2, yb * r4, yb * r6,
            2.0 * xb * yb, r2 + 2.0 * yb * yb, 0.0, 0.0,
        ]);
        Correction {
            ideal: self.ideal_from_measured(measured),
            by_measured,
            by_interior,
        }
    }

    /// Second derivatives of the ideal point's x' and y' by the measured point at a measured one, mm^-1.
    ///
    /// With `h = K1 s + K2 s^2 + K3 s^3`, `s = r2`, and `h'`, `h''` by `s`: `d2(xb h)/dxb2 = 6 xb h' + 4 xb^3 h''`,
    /// `d2(xb h)/dxb dyb = 2 yb h' + 4 xb^2 yb h''`, `d2(xb h)/dyb2 = 2 xb h' + 4 xb yb^2 h''`; y likewise.
    #[must_use]
    pub fn curvature(&self, measured: &Vector2<f64>) -> [Matrix2<f64>; 2] {
        let xb = measured.x - self.principal_point[0];
        let yb = measured.y - self.principal_point[1];
        let [k1, k2, k3] = self.radial;
        let [p1, p2] = self.tangential;
        let r2 = xb * xb + yb * yb;
        let first = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let second = 2.0 * k2 + r2 * 6.0 * k3;
        let along = |u: f64| 6.0 * u * first + 4.0 * u * u * u * second;
        let mixed = |u: f64, v: f64| 2.0 * v * first + 4.0 * u * u * v * second;
        let across = |u: f64, v: f64| 2.0 * u * first + 4.0 * u * v * v * second;
        let of_x = mixed(xb, yb) + 2.0 * p2;
        let of_y = mixed(yb, xb) + 2.0 * p1;
        [
            Matrix2::new(along(xb) + 6.0 * p1, of_x, of_x, across(xb, yb) + 2.0 * p1),
            Matrix2::new(across(yb, xb) + 2.0 * p2, of_y, of_y, along(yb) + 6.0 * p2),
        ]
    }

    /// The measured image point whose correction gives `ideal`, mm (Newton's method from the point itself).
    ///
    /// `None` where the distortion folds over on the way there: such a point is not imaged by this lens.
    #[must_use]
    pub fn measured_from_ideal(&self, ideal: &Vector2<f64>) -> Option<Vector2<f64>> {
        let principal_point = Vector2::from(self.principal_point);
        let mut measured = ideal + principal_point;
        for _ in 0..30 {
            let correction = self.correction(&measured);
            if correction.by_measured.determinant() <= 0.0 {
                return None;
            }
            let step = correction.by_measured.try_inverse()? * (ideal - correction.ideal);
            measured += step;
            // Image coordinates are some 10 mm: the last bits are 1e-15 mm; 1e-13 mm is 1e-11 of a pixel.
            if step.norm() < 1e-13 * (1.0 + measured.norm()) {
                return Some(measured);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lens() -> InteriorOrientation {
        InteriorOrientation {
            principal_distance: 20.0,
            principal_point: [0.1, -0.05],
            radial: [1.5e-4, -4e-7, 2e-10],
            tangential: [1e-5, -2e-5],
            affinity: [1e-4, -5e-5],
        }
    }

    proptest! {
        #[test]
        fn correcting_and_its_inverse_agree(x in -13.0..13.0, y in -9.0..9.0) {
            let measured = Vector2::new(x, y);
            let back = lens().measured_from_ideal(&lens().ideal_from_measured(&measured)).unwrap();
            prop_assert!((back - measured).norm() < 1e-11);
        }

        #[test]
        fn derivatives_agree_with_differences(x in -13.0..13.0, y in -9.0..9.0) {
            let measured = Vector2::new(x, y);
            let correction = lens().correction(&measured);
            let h = 1e-5;
            for axis in 0..2 {
                let mut step = Vector2::zeros();
                step[axis] = h;
                let difference = (lens().ideal_from_measured(&(measured + step)) - lens().ideal_from_measured(&(measured - step))) / (2.0 * h);
                prop_assert!((difference - correction.by_measured.column(axis)).norm() < 1e-9);
                let bent = (lens().correction(&(measured + step)).by_measured - lens().correction(&(measured - step)).by_measured) / (2.0 * h);
                let curvature = lens().curvature(&measured);
                for (row, curvature) in curvature.iter().enumerate() {
                    prop_assert!((bent.row(row).transpose() - curvature.column(axis)).norm() < 1e-9);
                }
            }
            for parameter in 0..10 {
                // Steps that move the point by some 1e-4 mm whatever the parameter's unit.
                let h = [1e-4, 1e-4, 1e-4, 1e-7, 1e-9, 1e-11, 1e-6, 1e-6, 1e-5, 1e-5][parameter];
                let mut step = SVector::<f64, 10>::zeros();
                step[parameter] = h;
                let plus = InteriorOrientation::from_vector(&(lens().to_vector() + step)).ideal_from_measured(&measured);
                let minus = InteriorOrientation::from_vector(&(lens().to_vector() - step)).ideal_from_measured(&measured);
                let difference = (plus - minus) / (2.0 * h);
                let derivative = correction.by_interior.column(parameter);
                // Rounding: coordinates of some 10 mm carry 1e-14 mm.
                prop_assert!((difference - derivative).norm() < 1e-6 * (1.0 + derivative.norm()) + 1e-14 / h, "{parameter}");
            }
        }
    }

    #[test]
    fn a_point_beyond_the_fold_is_not_imaged() {
        let mut folding = InteriorOrientation::pinhole(20.0);
        folding.radial[0] = -2e-3;
        assert_eq!(folding.measured_from_ideal(&Vector2::new(40.0, 0.0)), None);
    }
}
