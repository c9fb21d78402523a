//! Projection of points into pixels and rays of pixels.

use nalgebra::{Matrix2, Matrix2x3, SMatrix, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::InteriorOrientation;

/// A sensor with its lens.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Columns of the image.
    pub width_px: u32,
    /// Rows of the image.
    pub height_px: u32,
    /// Side of a pixel, mm.
    pub pixel_pitch_mm: f64,
    /// Principal distance, principal point, distortion.
    pub interior: InteriorOrientation,
}

/// A projected point with its derivatives, in pixels.
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    /// Pixel coordinates, y down.
    pub pixel: Vector2<f64>,
    /// Derivative by the point in the camera frame, px/mm.
    pub by_point: Matrix2x3<f64>,
    /// Derivative by the ten interior parameters, px per unit of each.
    pub by_interior: SMatrix<f64, 2, 10>,
}

impl Camera {
    /// Image coordinates (mm, y up, origin at the image centre) of a pixel.
    #[must_use]
    pub fn image_from_pixel(&self, pixel: &Vector2<f64>) -> Vector2<f64> {
        Vector2::new(
            pixel.x - f64::from(self.width_px) / 2.0,
            f64::from(self.height_px) / 2.0 - pixel.y,
        ) * self.pixel_pitch_mm
    }

    /// The pixel of image coordinates (mm).
    #[must_use]
    pub fn pixel_from_image(&self, image: &Vector2<f64>) -> Vector2<f64> {
        Vector2::new(
            image.x / self.pixel_pitch_mm + f64::from(self.width_px) / 2.0,
            f64::from(self.height_px) / 2.0 - image.y / self.pixel_pitch_mm,
        )
    }

    /// The ideal image point (mm from the principal point, distortion removed) of a pixel.
    #[must_use]
    pub fn ideal_from_pixel(&self, pixel: &Vector2<f64>) -> Vector2<f64> {
        self.interior
            .ideal_from_measured(&self.image_from_pixel(pixel))
    }

    /// The pixel of an ideal image point; `None` where the lens does not image it.
    #[must_use]
    pub fn pixel_from_ideal(&self, ideal: &Vector2<f64>) -> Option<Vector2<f64>> {
        Some(self.pixel_from_image(&self.interior.measured_from_ideal(ideal)?))
    }

    /// The ray `[x', y', -c]` of a pixel in the camera frame, mm; it points away from the camera.
    #[must_use]
    pub fn ray(&self, pixel: &Vector2<f64>) -> Vector3<f64> {
        let ideal = self.ideal_from_pixel(pixel);
        Vector3::new(ideal.x, ideal.y, -self.interior.principal_distance)
    }

    /// The pixel of a point in the camera frame; `None` behind the camera or where the lens does not image it.
    #[must_use]
    pub fn project(&self, point_in_camera: &Vector3<f64>) -> Option<Vector2<f64>> {
        self.pixel_from_ideal(&self.ideal_from_point(point_in_camera)?)
    }

    /// [`Self::project`] with derivatives by the point and by the ten parameters.
    ///
    /// In the correcting direction the measured point solves `correct(measured; interior) = ideal(point; c)`, so its derivatives follow
    /// from the correction's by the implicit function theorem.
    #[must_use]
    pub fn project_with_jacobians(&self, point_in_camera: &Vector3<f64>) -> Option<Projection> {
        let ideal = self.ideal_from_point(point_in_camera)?;
        let there = self.interior.displacement(&ideal)?;
        let pixel_by_measured = Matrix2::new(1.0, 0.0, 0.0, -1.0) / self.pixel_pitch_mm;
        let mut by_interior = there.by_interior;
        by_interior.set_column(
            0,
            &(there.by_ideal * ideal / self.interior.principal_distance),
        );
        Some(Projection {
            pixel: self.pixel_from_image(&there.measured),
            by_point: pixel_by_measured * there.by_ideal * self.ideal_by_point(point_in_camera),
            by_interior: pixel_by_measured * by_interior,
        })
    }

    /// How far, in the corrected plane and px, the ideal image of a point is from the corrected place of a pixel, with derivatives; the
    /// difference stands in `pixel`.
    #[must_use]
    pub fn corrected_difference(
        &self,
        point_in_camera: &Vector3<f64>,
        pixel: &Vector2<f64>,
    ) -> Option<Projection> {
        let ideal = self.ideal_from_point(point_in_camera)?;
        let correction = self.interior.correction(&self.image_from_pixel(pixel))?;
        let in_pixels = Matrix2::new(1.0, 0.0, 0.0, -1.0) / self.pixel_pitch_mm;
        let mut by_interior = -correction.by_interior;
        by_interior.set_column(0, &(ideal / self.interior.principal_distance));
        Some(Projection {
            pixel: in_pixels * (ideal - correction.ideal),
            by_point: in_pixels * self.ideal_by_point(point_in_camera),
            by_interior: in_pixels * by_interior,
        })
    }

    /// Whether a pixel lies inside the image.
    #[must_use]
    pub fn contains(&self, pixel: &Vector2<f64>) -> bool {
        pixel.x >= 0.0
            && pixel.y >= 0.0
            && pixel.x <= f64::from(self.width_px)
            && pixel.y <= f64::from(self.height_px)
    }

    /// Derivative of the ideal image point by the point in the camera frame.
    pub(super) fn ideal_by_point(&self, k: &Vector3<f64>) -> Matrix2x3<f64> {
        let c = self.interior.principal_distance;
        Matrix2x3::new(
            -c / k.z,
            0.0,
            c * k.x / (k.z * k.z),
            0.0,
            -c / k.z,
            c * k.y / (k.z * k.z),
        )
    }

    pub(super) fn ideal_from_point(&self, k: &Vector3<f64>) -> Option<Vector2<f64>> {
        (k.z < 0.0).then(|| Vector2::new(k.x, k.y) * (-self.interior.principal_distance / k.z))
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixture::wide_angle_camera;
    use super::*;
    use nalgebra::SVector;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_ray_goes_through_the_point_that_is_imaged_there(x in -600.0..600.0, y in -400.0..400.0, z in -1500.0..-800.0) {
            let point = Vector3::new(x, y, z);
            let ray = wide_angle_camera().ray(&wide_angle_camera().project(&point).unwrap());
            prop_assert!((ray.normalize() - point.normalize()).norm() < 1e-12);
        }

        #[test]
        fn jacobians_agree_with_differences(x in -600.0..600.0, y in -400.0..400.0, z in -1500.0..-800.0) {
            let point = Vector3::new(x, y, z);
            let projection = wide_angle_camera().project_with_jacobians(&point).unwrap();
            let h = 1e-3;
            for axis in 0..3 {
                let mut step = Vector3::zeros();
                step[axis] = h;
                let difference = (wide_angle_camera().project(&(point + step)).unwrap() - wide_angle_camera().project(&(point - step)).unwrap()) / (2.0 * h);
                prop_assert!((difference - projection.by_point.column(axis)).norm() < 1e-6);
            }
            for parameter in 0..10 {
                let h = [1e-4, 1e-4, 1e-4, 1e-7, 1e-9, 1e-11, 1e-6, 1e-6, 1e-5, 1e-5][parameter];
                let moved = |sign: f64| {
                    let mut step = SVector::<f64, 10>::zeros();
                    step[parameter] = sign * h;
                    let interior = wide_angle_camera().interior.with_values(&(wide_angle_camera().interior.to_vector() + step));
                    Camera { interior, ..wide_angle_camera() }.project(&point).unwrap()
                };
                let difference = (moved(1.0) - moved(-1.0)) / (2.0 * h);
                let derivative = projection.by_interior.column(parameter);
                // Rounding: pixel coordinates of some 1000 px carry 1e-12 px.
                prop_assert!((difference - derivative).norm() < 1e-5 * (1.0 + derivative.norm()) + 2e-12 / h, "{parameter}");
            }
        }
    }
}
