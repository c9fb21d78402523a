//! Where a camera stands and how it looks.

use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};

use super::rotation_from_vector;

/// An exterior orientation: `M` and `X0` of `[x', y', -c] ~ M (X - X0)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// `M`: turns world directions into the camera frame (x right, y up, z backwards).
    pub camera_from_world: Rotation3<f64>,
    /// `X0`: the projection centre in the world, mm.
    pub centre_in_world: Vector3<f64>,
}

impl Pose {
    /// The pose of a camera at `centre_in_world` that looks at `target_in_world` with image-up as near to `up` as can
    /// be, then rolled by `roll` radians counter-clockwise about the viewing axis as seen from behind the camera.
    #[must_use]
    pub fn looking_at(
        centre_in_world: Vector3<f64>,
        target_in_world: Vector3<f64>,
        up: Vector3<f64>,
        roll: f64,
    ) -> Self {
        let backwards = (centre_in_world - target_in_world).normalize();
        let right = up.cross(&backwards);
        let right = if right.norm() > 1e-9 {
            right.normalize()
        } else {
            Vector3::x().cross(&backwards).normalize()
        };
        let above = backwards.cross(&right);
        let upright = Rotation3::from_matrix_unchecked(Matrix3::from_rows(&[
            right.transpose(),
            above.transpose(),
            backwards.transpose(),
        ]));
        Self {
            camera_from_world: rotation_from_vector(&Vector3::new(0.0, 0.0, -roll)) * upright,
            centre_in_world,
        }
    }

    /// A world point in the camera frame, mm; in front of the camera its z is negative.
    #[must_use]
    pub fn camera_from_point(&self, point_in_world: &Vector3<f64>) -> Vector3<f64> {
        self.camera_from_world * (point_in_world - self.centre_in_world)
    }

    /// A direction of the camera frame in the world.
    #[must_use]
    pub fn world_from_direction(&self, direction_in_camera: &Vector3<f64>) -> Vector3<f64> {
        self.camera_from_world.inverse() * direction_in_camera
    }

    /// The pose after a small turn `turn` (radians, camera frame) and a shift of the centre (mm, world).
    #[must_use]
    pub fn moved(&self, turn: &Vector3<f64>, shift: &Vector3<f64>) -> Self {
        let turned = rotation_from_vector(turn) * self.camera_from_world;
        // Products of many small turns drift off the rotations by rounding; one Gram-Schmidt step puts them back.
        let m = turned.matrix();
        let x = m.row(0).transpose().normalize();
        let y = m.row(1).transpose();
        let y = (y - x * x.dot(&y)).normalize();
        let z = x.cross(&y);
        Self {
            camera_from_world: Rotation3::from_matrix_unchecked(Matrix3::from_rows(&[
                x.transpose(),
                y.transpose(),
                z.transpose(),
            ])),
            centre_in_world: self.centre_in_world + shift,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_looks_along_its_negative_z_axis() {
        let pose = Pose::looking_at(
            Vector3::new(0.0, 0.0, 1000.0),
            Vector3::zeros(),
            Vector3::new(0.0, 1.0, 0.0),
            0.0,
        );
        assert!(
            (pose.camera_from_point(&Vector3::zeros()) - Vector3::new(0.0, 0.0, -1000.0)).norm()
                < 1e-12
        );
        let right = pose.camera_from_point(&Vector3::new(10.0, 0.0, 0.0));
        assert!(
            right.x > 0.0 && right.y.abs() < 1e-12,
            "x stays to the right"
        );
    }

    #[test]
    fn a_camera_rolled_counter_clockwise_sees_the_world_turn_clockwise() {
        let up = Vector3::new(0.0, 1.0, 0.0);
        let pose = Pose::looking_at(
            Vector3::new(0.0, 0.0, 1000.0),
            Vector3::zeros(),
            up,
            std::f64::consts::FRAC_PI_2,
        );
        let seen = pose.camera_from_point(&Vector3::new(0.0, 10.0, 0.0));
        assert!(
            (seen - Vector3::new(10.0, 0.0, -1000.0)).norm() < 1e-9,
            "{seen}"
        );
    }
}
