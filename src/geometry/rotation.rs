//! Rotation matrices, rotation vectors and the angles omega, phi, kappa.

use nalgebra::{Matrix3, Rotation3, Vector3};

/// The matrix `[v]x` with `[v]x w = v x w`.
#[must_use]
pub fn skew(v: &Vector3<f64>) -> Matrix3<f64> {
    v.cross_matrix()
}

/// The rotation by `|v|` radians about `v` (Rodrigues, 1840); the identity for the zero vector.
#[must_use]
pub fn rotation_from_vector(v: &Vector3<f64>) -> Rotation3<f64> {
    Rotation3::new(*v)
}

/// The angles of photogrammetry, in radians: `m31 = sin phi`, `m32 = -cos phi sin omega`, `m33 = cos phi cos omega`,
/// `m11 = cos phi cos kappa`, `m21 = -cos phi sin kappa` (Kraus, 2007, with `M = R^T`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OmegaPhiKappa {
    /// Primary rotation about x, radians.
    pub omega: f64,
    /// Secondary rotation about y, radians.
    pub phi: f64,
    /// Tertiary rotation about z, radians.
    pub kappa: f64,
}

impl OmegaPhiKappa {
    /// The angles of `camera_from_world`; at `phi = +-90` degrees, where only a sum is determined, omega is 0.
    #[must_use]
    pub fn from_rotation(camera_from_world: &Rotation3<f64>) -> Self {
        let m = camera_from_world.matrix();
        let phi = m[(2, 0)].clamp(-1.0, 1.0).asin();
        if m[(2, 0)].abs() > 1.0 - 1e-14 {
            return Self {
                omega: 0.0,
                phi,
                kappa: m[(0, 1)].atan2(m[(1, 1)]),
            };
        }
        Self {
            omega: (-m[(2, 1)]).atan2(m[(2, 2)]),
            phi,
            kappa: (-m[(1, 0)]).atan2(m[(0, 0)]),
        }
    }

    /// The rotation `camera_from_world` of these angles.
    #[must_use]
    pub fn rotation(&self) -> Rotation3<f64> {
        let (so, co) = self.omega.sin_cos();
        let (sp, cp) = self.phi.sin_cos();
        let (sk, ck) = self.kappa.sin_cos();
        Rotation3::from_matrix_unchecked(Matrix3::new(
            cp * ck,
            co * sk + so * sp * ck,
            so * sk - co * sp * ck,
            -cp * sk,
            co * ck - so * sp * sk,
            so * ck + co * sp * sk,
            sp,
            -cp * so,
            cp * co,
        ))
    }

    /// The 3x3 derivative of (omega, phi, kappa) by a small turn `w` of the camera in its own frame,
    /// `M -> exp([w]) M`; singular at `phi = +-90` degrees.
    #[must_use]
    pub fn jacobian_by_turn(&self) -> Matrix3<f64> {
        // M = K(kappa) P(phi) O(omega); a small turn is w = k_axis dkappa + K p_axis dphi + K P o_axis domega with the
        // axes of the three factors, all of which turn the frame (hence the minus signs); inverted below.
        let (sp, cp) = self.phi.sin_cos();
        let (sk, ck) = self.kappa.sin_cos();
        let turn_by_angles = Matrix3::from_columns(&[
            Vector3::new(-cp * ck, cp * sk, -sp),
            Vector3::new(-sk, -ck, 0.0),
            Vector3::new(0.0, 0.0, -1.0),
        ]);
        turn_by_angles.try_inverse().unwrap_or_else(Matrix3::zeros)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn angles_and_matrix_are_inverse_to_each_other(omega in -3.1..3.1, phi in -1.5..1.5, kappa in -3.1..3.1) {
            let angles = OmegaPhiKappa { omega, phi, kappa };
            let rotation = angles.rotation();
            prop_assert!((rotation.matrix() * rotation.matrix().transpose() - Matrix3::identity()).norm() < 1e-14);
            prop_assert!((rotation.matrix().determinant() - 1.0).abs() < 1e-14);
            let back = OmegaPhiKappa::from_rotation(&rotation);
            prop_assert!((back.omega - omega).abs() < 1e-12 && (back.phi - phi).abs() < 1e-12 && (back.kappa - kappa).abs() < 1e-12);
        }

        #[test]
        fn the_jacobian_agrees_with_differences(omega in -3.0..3.0, phi in -1.3..1.3, kappa in -3.0..3.0) {
            let angles = OmegaPhiKappa { omega, phi, kappa };
            let jacobian = angles.jacobian_by_turn();
            let h = 1e-6;
            for axis in 0..3 {
                let mut w = Vector3::zeros();
                w[axis] = h;
                let plus = OmegaPhiKappa::from_rotation(&(rotation_from_vector(&w) * angles.rotation()));
                let minus = OmegaPhiKappa::from_rotation(&(rotation_from_vector(&-w) * angles.rotation()));
                let difference = Vector3::new(plus.omega - minus.omega, plus.phi - minus.phi, plus.kappa - minus.kappa) / (2.0 * h);
                // Central differences of step 1e-6 are good to about 1e-9 of the largest entry.
                prop_assert!((difference - jacobian.column(axis)).norm() < 1e-7 * jacobian.norm().max(1.0));
            }
        }
    }
}
