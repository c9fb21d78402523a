//! Circles: found from their ellipses, and what they do to an adjustment.

use nalgebra::{Matrix2, Rotation3, SymmetricEigen, Vector3};

use super::equations::State;
use super::simulation::{Noise, Scene, Simulated, box_network, scene, solve};
use super::*;
use crate::camera::Camera;
use crate::camera::fixture::wide_angle_camera;
use crate::geometry::{AxisOrder, Circle, Pose, Scale, ThreeTwoOne, fit_similarity};

/// The ellipse with which a circle is imaged, its axes wrong by normal deviates of `sigma_px`.
fn ellipse(
    camera: &Camera,
    pose: &Pose,
    circle: &Circle,
    sigma_px: f64,
    noise: &mut Noise,
) -> MeasuredEllipse {
    let place = Vector3::zeros();
    let side = circle
        .normal
        .cross(&Vector3::new(0.3, 0.5, -0.8))
        .normalize();
    let other = circle.normal.cross(&side);
    const POINTS: usize = 90;
    let mut moments = Matrix2::zeros();
    let centre = camera.image_of_target(pose, &place, Some(circle)).unwrap();
    for k in 0..POINTS {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / POINTS as f64).sin_cos();
        let point = (side * cos + other * sin) * circle.radius_mm;
        let off = camera.project(&pose.camera_from_point(&point)).unwrap() - centre;
        moments += off * off.transpose() * (2.0 / POINTS as f64);
    }
    // The zeroth and second harmonics of the outline's error.
    let [even, along, across] = noise.vector().into();
    let harmonic =
        Matrix2::new(along, across, across, -along) + Matrix2::identity() * (even / 2_f64.sqrt());
    let eigen = SymmetricEigen::new(moments);
    let root = eigen.eigenvectors
        * Matrix2::from_diagonal(&eigen.eigenvalues.map(f64::sqrt))
        * eigen.eigenvectors.transpose();
    let root = root + harmonic * sigma_px;
    let eigen = SymmetricEigen::new(root * root);
    let (least, most) = (eigen.eigenvalues.imin(), eigen.eigenvalues.imax());
    let direction = eigen.eigenvectors.column(most);
    MeasuredEllipse {
        major_px: 2.0 * eigen.eigenvalues[most].sqrt(),
        minor_px: 2.0 * eigen.eigenvalues[least].sqrt(),
        angle: direction.y.atan2(direction.x),
        sigma_px,
    }
}

/// Stations round a disc of 5 mm, 1 m away, at these angles from its normal, degrees.
fn poses(angles: &[f64]) -> Vec<Pose> {
    (0..)
        .zip(angles)
        .map(|(k, angle)| {
            let azimuth = 2.4 * f64::from(k);
            let (sin, cos) = angle.to_radians().sin_cos();
            let centre = Vector3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos) * 1000.0;
            let aside = Vector3::new(120.0, -60.0, 0.0) * azimuth.cos();
            Pose::looking_at(centre, aside, Vector3::y(), azimuth)
        })
        .collect()
}

fn sights(angles: &[f64], normal: &Vector3<f64>, sigma_px: f64, seed: u64) -> Vec<EllipseSight> {
    let camera = wide_angle_camera();
    let turn = Rotation3::rotation_between(&Vector3::z(), normal).unwrap();
    let circle = Circle {
        normal: *normal,
        radius_mm: 2.5,
    };
    let mut noise = Noise::seeded(seed);
    poses(angles)
        .into_iter()
        .map(|pose| {
            let pose = Pose {
                camera_from_world: pose.camera_from_world * turn.inverse(),
                centre_in_world: turn * pose.centre_in_world,
            };
            let ellipse = ellipse(&camera, &pose, &circle, sigma_px, &mut noise);
            EllipseSight::new(&camera, &pose, &Vector3::zeros(), &ellipse).unwrap()
        })
        .collect()
}

#[test]
fn a_circle_is_found_from_noisy_ellipses_with_a_true_sigma() {
    let normal = Vector3::new(0.3, -0.4, 0.85).normalize();
    let (mut of_normal, mut of_radius, mut count) = (0.0, 0.0, 0.0);
    for seed in 0..200 {
        let sights = sights(&[10.0, 55.0, 40.0, 60.0, 30.0, 50.0], &normal, 0.03, seed);
        let found = estimate_circle(&sights).unwrap();
        let angle = found.circle.normal.cross(&normal).norm().asin();
        assert!(found.circle.normal.dot(&normal) > 0.0);
        assert!(angle < 0.02, "{} degrees", angle.to_degrees());
        of_normal += (angle / found.sigma_normal).powi(2);
        of_radius += ((found.circle.radius_mm - 2.5) / found.sigma_radius_mm).powi(2);
        count += 1.0;
    }
    // The sigma of the normal is that of its worse direction, so that two directions together have between 1 and 2.
    let of_normal: f64 = of_normal / count;
    assert!((0.8..2.3).contains(&of_normal), "{of_normal}");
    let of_radius: f64 = of_radius / count;
    assert!((0.6..1.5).contains(&of_radius), "{of_radius}");
}

#[test]
fn one_wrong_ellipse_moves_the_circle_little() {
    let normal = Vector3::new(-0.2, 0.1, 1.0).normalize();
    let angles = [15.0, 55.0, 40.0, 60.0, 35.0];
    for wrong in 0..angles.len() {
        let mut seen = sights(&angles, &normal, 0.02, 7);
        let other = Vector3::new(0.7, 0.6, 0.4).normalize();
        seen[wrong] = sights(&angles, &other, 0.02, 8)[wrong];
        let found = estimate_circle(&seen).unwrap().circle;
        let angle = found.normal.cross(&normal).norm().asin().to_degrees();
        assert!(angle < 3.0, "{wrong}: {angle} degrees");
        assert!((found.radius_mm - 2.5).abs() < 0.05);
    }
}

#[test]
fn two_oblique_views_are_enough_and_what_is_loose_is_said() {
    let normal = Vector3::z();
    let found = estimate_circle(&sights(&[50.0, 40.0], &normal, 0.02, 1)).unwrap();
    assert!(found.circle.normal.dot(&normal) > 0.999 && found.sigma_normal < 0.03);
    assert_eq!(estimate_circle(&sights(&[50.0], &normal, 0.02, 1)), None);
    // Twice from the same side: the mirror image of the normal fits as well.
    let twice = [
        sights(&[50.0], &normal, 0.02, 1),
        sights(&[50.0], &normal, 0.02, 2),
    ]
    .concat();
    let mirrored = estimate_circle(&twice);
    assert!(
        mirrored.is_none_or(|found| found.sigma_normal > 0.5),
        "{mirrored:?}"
    );
    let squarely = estimate_circle(&sights(&[1.0, 2.0, 1.0], &normal, 0.05, 1));
    assert!(
        squarely.is_none_or(|found| found.sigma_normal > 0.05),
        "{squarely:?}"
    );
    let radius = estimate_radius(&sights(&[1.0, 50.0], &normal, 0.0001, 1), &normal).unwrap();
    assert!((radius - 2.5).abs() < 0.01, "{radius}");
}

/// Rms of the coordinates' errors over their sigmas.
fn error_over_sigma(truth: &State, adjustment: &Adjustment) -> f64 {
    let points = || truth.points.iter().zip(&adjustment.points);
    let pairs: Vec<_> = points().map(|(t, p)| (*t, p.position)).collect();
    let fit = fit_similarity(&pairs, Scale::Free).unwrap();
    let squares = points().map(|(t, p)| {
        let error = (p.position - fit.apply(t)).component_div(&p.sigma_mm().unwrap());
        error.norm_squared() / 3.0
    });
    (squares.sum::<f64>() / truth.points.len() as f64).sqrt()
}

#[test]
fn errors_are_as_large_as_their_sigmas_say_with_circles_only() {
    let (mut with, mut without) = (0.0, 0.0);
    const SEEDS: u64 = 10;
    for seed in 0..SEEDS {
        // Dots of some 60 px at a noise of 0.02 px.
        let Simulated { truth, mut problem } = box_network(&Scene {
            radius_mm: 15.0,
            noise_px: 0.02,
            ..scene(300 + seed)
        });
        without += error_over_sigma(&truth, &solve(&problem).unwrap()) / SEEDS as f64;
        for (block, circle) in problem.points.iter_mut().zip(&truth.circles) {
            block.circle = *circle;
        }
        let adjustment = solve(&problem).unwrap();
        with += error_over_sigma(&truth, &adjustment) / SEEDS as f64;
        assert!(
            (adjustment.sigma0 - 1.0).abs() < 0.15,
            "{}",
            adjustment.sigma0
        );
    }
    assert!((with - 1.0).abs() < 0.1, "{with}");
    assert!(without > 2.0, "{without}");
}

/// A box with dots of some 100 px: the derivatives leave out what the eccentricity changes along.
fn large_dots() -> Simulated {
    let mut simulated = box_network(&Scene {
        radius_mm: 25.0,
        noise_px: 0.005,
        ..scene(77)
    });
    for (block, circle) in simulated
        .problem
        .points
        .iter_mut()
        .zip(&simulated.truth.circles)
    {
        block.circle = *circle;
    }
    simulated
}

#[test]
fn circles_do_not_harm_convergence() {
    let adjustment = solve(&large_dots().problem).unwrap();
    assert!(adjustment.iterations <= 12, "{}", adjustment.iterations);
    assert!(
        (adjustment.sigma0 - 1.0).abs() < 0.2,
        "{}",
        adjustment.sigma0
    );
}

#[test]
fn a_frame_moves_circles_and_keeps_residuals() {
    let mut problem = large_dots().problem;
    let free = solve(&problem).unwrap();
    problem.frame = Some(ThreeTwoOne {
        origin: 3,
        axis: 17,
        plane: 40,
        order: AxisOrder::Xy,
    });
    let framed = solve(&problem).unwrap();
    for (o, (a, b)) in problem
        .observations
        .iter()
        .zip(free.observations.iter().zip(&framed.observations))
    {
        let (a, b) = (a.residual_px.unwrap(), b.residual_px.unwrap());
        assert!((a - b).norm() < 1e-9);
        // What the result predicts is what its residual says.
        for (adjustment, residual) in [(&free, a), (&framed, b)] {
            let station = &adjustment.stations[o.station];
            let point = &adjustment.points[o.point];
            let camera = &adjustment.cameras[station.camera].camera;
            let image = camera
                .image_of_target(&station.pose, &point.position, point.circle.as_ref())
                .unwrap();
            assert!((image - o.pixel - residual).norm() < 1e-9);
        }
    }
}
