//! The image of a circle, and why its centre is not the image of the circle's centre.
//!
//! A circle with centre `P`, unit normal `n` and radius `r` stands in the camera frame, `k` is the frame's z axis and
//! `p_z = k . P`. The perspective image of a circle is an ellipse; its centre is the pole of the image plane's line at
//! infinity with respect to it. Poles and polars go through a projection unchanged, so the centre is the image of the
//! pole, with respect to the *circle*, of what is imaged at infinity: the line of the circle's plane at depth zero. With
//! axes `u`, `v` in the plane and `P + a u + b v` on that line, `p_z + a (k . u) + b (k . v) = 0`. The pole of a line
//! with respect to `a^2 + b^2 = r^2` is the point `(a0, b0)` whose polar `a a0 + b b0 = r^2` the line is, hence
//! `(a0, b0) = -(r^2 / p_z) (k . u, k . v)`, and in space
//!
//! `Q = P - (r^2 / p_z) (k - (n . k) n)`.
//!
//! This is exact, and even in `n`. The distance from the image of `P` to that of `Q` is the eccentricity (Heikkilae and
//! Silven, 1997; Ahn, Warnecke and Kotowski, 1999, give the same in other terms): some `r^2 sin t cos t / D` in the scale
//! of the picture for a dot seen at the angle `t` from the distance `D`; at 45 degrees and c = 2200 px that is 0.006 px for a
//! dot of 10 px and 0.6 px for one of 100 px.
//!
//! The lens then bends the ellipse. Let the picture be moved by `d_m(u) = 1/2 sum_ij D^m_ij u_i u_j` at the distance `u`
//! from the ellipse's centre, and let `S` be the matrix of the ellipse's semi-axes, so that the mean of `u u^T` over its
//! area is `S / 4`. What is measured is a shape: points that slide along the outline are not noticed, and so the shift is
//! that of the centre of area, `mean(d) + mean(u div d)`:
//!
//! `shift_m = 1/8 sum_ij D^m_ij S_ij + 1/4 sum_j S_mj sum_k D^k_kj`.
//!
//! (The mean of `d` over points of the outline would be `1/4 sum_ij D^m_ij S_ij`; no detector sees these points.)
//! Derivatives of the distortion follow from those of the correction `f`: a picture in which `f(x + u + d) = f(x) + f' u`
//! is moved by `d = -1/2 f'^-1 f''[u, u]`. It comes to 0.001 px for 10 px and to 0.1 px for 100 px dots in the corners of
//! a wide-angle lens.

use nalgebra::{Matrix2, Matrix3, SymmetricEigen, Vector2, Vector3};

use super::{Camera, ImagePoint};
use crate::geometry::{Circle, Pose};

/// The image of a circle, by its size and direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EllipseImage {
    /// Larger full diameter, px.
    pub major_px: f64,
    /// Smaller full diameter, px.
    pub minor_px: f64,
    /// Direction of the larger diameter from +x towards +y (down), radians in [0, pi).
    pub angle: f64,
}

impl Camera {
    /// Where a target is measured: the centre of the image of its circle, or the image of its place where no circle is
    /// known. Every computed minus measured place of a dot is to be taken from here. `None` where it is not imaged.
    #[must_use]
    pub fn image_of_target(
        &self,
        pose: &Pose,
        place: &Vector3<f64>,
        circle: Option<&Circle>,
    ) -> Option<Vector2<f64>> {
        let in_camera = pose.camera_from_point(place);
        match circle {
            None => self.project(&in_camera),
            Some(circle) => {
                let normal = pose.camera_from_world * circle.normal;
                self.centre_of_circle(&in_camera, &normal, circle.radius_mm)
            }
        }
    }

    /// The ellipse as which a target's circle is imaged, to first order: `J Q J^T` of `Q = d^2 (I - n n^T)`, with the derivative `J` of
    /// the picture by the place. `None` where the place is not imaged.
    #[must_use]
    pub fn ellipse_of_target(
        &self,
        pose: &Pose,
        place: &Vector3<f64>,
        circle: &Circle,
    ) -> Option<EllipseImage> {
        let projection = self.project_with_jacobians(&pose.camera_from_point(place))?;
        let by_point = projection.by_point * pose.camera_from_world.matrix();
        let flat = Matrix3::identity() - circle.normal * circle.normal.transpose();
        let squared: Matrix2<f64> = by_point * flat * by_point.transpose();
        let eigen = SymmetricEigen::new(squared * (2.0 * circle.radius_mm).powi(2));
        let (large, small) = (eigen.eigenvalues.imax(), eigen.eigenvalues.imin());
        let along = eigen.eigenvectors.column(large);
        Some(EllipseImage {
            major_px: eigen.eigenvalues[large].max(0.0).sqrt(),
            minor_px: eigen.eigenvalues[small].max(0.0).sqrt(),
            angle: along[1].atan2(along[0]).rem_euclid(std::f64::consts::PI),
        })
    }

    /// Eccentricity: the image of a circle's centre less the centre of the circle's image, px. `None` where either is not
    /// imaged.
    #[must_use]
    pub fn eccentricity(
        &self,
        pose: &Pose,
        place: &Vector3<f64>,
        circle: &Circle,
    ) -> Option<Vector2<f64>> {
        let of_centre = self.image_of_target(pose, place, None)?;
        Some(of_centre - self.image_of_target(pose, place, Some(circle))?)
    }

    /// The centre of a circle's image, px; `centre` and `normal` in the camera frame.
    fn centre_of_circle(
        &self,
        centre: &Vector3<f64>,
        normal: &Vector3<f64>,
        radius: f64,
    ) -> Option<Vector2<f64>> {
        // What is not before the camera has no image, nor has what is no number.
        if centre.z.is_nan() || centre.z >= 0.0 {
            return None;
        }
        let axis = Vector3::z();
        let pole = centre - (axis - normal * normal.z) * (radius * radius / centre.z);
        let ideal = self.ideal_from_point(&pole)?;
        let there = self.interior.displacement(&ideal)?;
        let image = ImagePoint {
            ideal,
            measured: there.measured,
        };
        let outline = (Matrix3::identity() - normal * normal.transpose()) * (radius * radius);
        let shift = self.shift_by_bending(centre, &image, &there.by_ideal, &outline)?;
        Some(self.pixel_from_image(&(there.measured + shift)))
    }

    /// How far the bending of the lens moves the centre of an ellipse, mm in the picture; `outline` is
    /// `r^2 (I - n n^T)` of the circle in the camera frame.
    fn shift_by_bending(
        &self,
        centre: &Vector3<f64>,
        image: &ImagePoint,
        measured_by_ideal: &Matrix2<f64>,
        outline: &Matrix3<f64>,
    ) -> Option<Vector2<f64>> {
        let by_point = measured_by_ideal * self.ideal_by_point(centre);
        let semi_axes: Matrix2<f64> = by_point * outline * by_point.transpose();
        let curvature = self.interior.curvature(image)?;
        let bend: [Matrix2<f64>; 2] = std::array::from_fn(|m| {
            -(curvature[0] * measured_by_ideal[(m, 0)] + curvature[1] * measured_by_ideal[(m, 1)])
        });
        let divergence: Vector2<f64> = bend[0].column(0) + bend[1].column(1);
        let mean = Vector2::new(
            bend[0].component_mul(&semi_axes).sum(),
            bend[1].component_mul(&semi_axes).sum(),
        );
        Some(mean / 8.0 + semi_axes * divergence / 4.0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixture::wide_angle_camera;
    use super::*;
    use crate::camera::InteriorOrientation;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    const OUTLINE: usize = 360;

    /// Points of the circle's image, px.
    fn outline(
        camera: &Camera,
        pose: &Pose,
        place: &Vector3<f64>,
        circle: &Circle,
    ) -> Vec<Vector2<f64>> {
        let side = if circle.normal.x.abs() < 0.9 {
            Vector3::x()
        } else {
            Vector3::y()
        };
        let u = circle.normal.cross(&side).normalize();
        let v = circle.normal.cross(&u);
        (0..OUTLINE)
            .map(|k| {
                let (sin, cos) = (std::f64::consts::TAU * k as f64 / OUTLINE as f64).sin_cos();
                let point = place + (u * cos + v * sin) * circle.radius_mm;
                camera.image_of_target(pose, &point, None).unwrap()
            })
            .collect()
    }

    #[test]
    fn the_ellipse_of_a_small_circle_is_its_outline() {
        let camera = wide_angle_camera();
        let pose = Pose::looking_at(
            Vector3::new(300.0, -200.0, 900.0),
            Vector3::new(150.0, 120.0, 0.0),
            Vector3::y(),
            0.4,
        );
        let place = Vector3::new(-60.0, 40.0, 10.0);
        let circle = Circle {
            normal: Vector3::new(-0.5, 0.4, 0.6).normalize(),
            radius_mm: 0.5,
        };
        let ellipse = camera.ellipse_of_target(&pose, &place, &circle).unwrap();
        let outline = outline(&camera, &pose, &place, &circle);
        let centre = outline.iter().sum::<Vector2<f64>>() / OUTLINE as f64;
        let (sin, cos) = ellipse.angle.sin_cos();
        let axes = [Vector2::new(cos, sin), Vector2::new(-sin, cos)];
        for (axis, diameter) in axes.iter().zip([ellipse.major_px, ellipse.minor_px]) {
            let along = outline.iter().map(|p| (p - centre).dot(axis).abs());
            let reach = along.fold(0.0, f64::max);
            // What the first order leaves out grows with the size over the distance, here 0.0005.
            let off = (2.0 * reach / diameter - 1.0).abs();
            assert!(off < 2e-3, "{diameter} px for {} px", 2.0 * reach);
        }
        assert!(ellipse.minor_px < 0.95 * ellipse.major_px);
    }

    /// The centre of the conic through points (algebraic least squares; exact for an ellipse).
    fn centre_of_conic(points: &[Vector2<f64>]) -> Vector2<f64> {
        let middle = points.iter().sum::<Vector2<f64>>() / points.len() as f64;
        let mut matrix = nalgebra::SMatrix::<f64, 5, 5>::zeros();
        let mut right = nalgebra::SVector::<f64, 5>::zeros();
        for p in points {
            let d = p - middle;
            let row = nalgebra::SVector::from([d.x * d.x, d.x * d.y, d.y * d.y, d.x, d.y]);
            matrix += row * row.transpose();
            right += row;
        }
        let [a, b, c, d, e]: [f64; 5] = matrix.lu().solve(&right).unwrap().into();
        let quadratic = Matrix2::new(2.0 * a, b, b, 2.0 * c);
        middle - quadratic.try_inverse().unwrap() * Vector2::new(d, e)
    }

    /// The centre of the area within a polygon.
    fn centre_of_area(points: &[Vector2<f64>]) -> Vector2<f64> {
        let near = points[0];
        let (mut area, mut first) = (0.0, Vector2::zeros());
        for k in 0..points.len() {
            let (p, q) = (points[k] - near, points[(k + 1) % points.len()] - near);
            area += p.perp(&q) / 2.0;
            first += (p + q) * (p.perp(&q) / 6.0);
        }
        near + first / area
    }

    /// A station 1000 mm from the place; the circle is seen at `incidence` about an axis of the azimuth.
    fn view(
        aside: [f64; 2],
        incidence: f64,
        azimuth: f64,
        diameter_px: f64,
        camera: &Camera,
    ) -> (Pose, Vector3<f64>, Circle) {
        let place = Vector3::new(10.0, -20.0, 5.0);
        let target = place + Vector3::new(aside[0], aside[1], 0.0);
        let pose = Pose::looking_at(
            Vector3::new(300.0, -400.0, 900.0),
            target,
            Vector3::y(),
            0.4,
        );
        let towards = (pose.centre_in_world - place).normalize();
        let side = towards.cross(&Vector3::x()).normalize();
        let turned = Rotation3::new(towards * azimuth) * side;
        let normal = Rotation3::new(turned * incidence.to_radians()) * towards;
        let px_per_mm = camera.interior.principal_distance
            / camera.pixel_pitch_mm
            / (pose.centre_in_world - place).norm();
        (
            pose,
            place,
            Circle {
                normal,
                radius_mm: diameter_px / 2.0 / px_per_mm,
            },
        )
    }

    proptest! {
        #[test]
        fn the_centre_of_a_circles_image_is_that_of_the_conic_through_it(
            x in -450.0..450.0, y in -300.0..300.0, incidence in 0.0..70.0, azimuth in 0.0..6.3, diameter in 4.0..100.0,
        ) {
            let lens = InteriorOrientation::pinhole(20.0);
            let camera = Camera { interior: lens, ..wide_angle_camera() };
            let (pose, place, circle) = view([x, y], incidence, azimuth, diameter, &camera);
            let brute = centre_of_conic(&outline(&camera, &pose, &place, &circle));
            let found = camera.image_of_target(&pose, &place, Some(&circle)).unwrap();
            // Rounding of the conic's five numbers from pixel coordinates of some 1000 px.
            prop_assert!((found - brute).norm() < 1e-8, "{found} {brute}");
            let turned = Circle { normal: -circle.normal, ..circle };
            prop_assert!((camera.image_of_target(&pose, &place, Some(&turned)).unwrap() - found).norm() < 1e-12);
        }

        #[test]
        fn a_lens_moves_the_centre_of_the_image_as_its_second_derivatives_tell(
            x in -450.0..450.0, y in -300.0..300.0, incidence in 0.0..70.0, azimuth in 0.0..6.3, diameter in 4.0..100.0,
        ) {
            let camera = wide_angle_camera();
            let (pose, place, circle) = view([x, y], incidence, azimuth, diameter, &camera);
            let image = outline(&camera, &pose, &place, &circle);
            let brute = centre_of_area(&image);
            let found = camera.image_of_target(&pose, &place, Some(&circle)).unwrap();
            // Third derivatives and the polygon of 360 corners: a hundredth of what the second ones make.
            prop_assert!((found - brute).norm() < 1e-3, "{} at {diameter} px", (found - brute).norm());
            let conic = centre_of_conic(&image);
            prop_assert!((conic - brute).norm() < 4e-3, "{} at {diameter} px", (conic - brute).norm());
        }
    }

    #[test]
    fn eccentricity_grows_with_the_square_of_the_dot_and_vanishes_for_a_dot_that_is_seen_squarely()
    {
        let camera = Camera {
            interior: InteriorOrientation::pinhole(20.0),
            ..wide_angle_camera()
        };
        let size = |incidence, diameter| {
            let (pose, place, circle) = view([0.0, 0.0], incidence, 0.3, diameter, &camera);
            camera.eccentricity(&pose, &place, &circle).unwrap().norm()
        };
        assert!(size(0.0, 100.0) < 1e-9);
        // r^2 sin t cos t / c = 5 px * 5 px / 2222 px * 0.5.
        assert!((size(45.0, 10.0) - 0.0056).abs() < 1e-4);
        assert!((size(45.0, 100.0) / size(45.0, 10.0) - 100.0).abs() < 0.5);
    }
}
