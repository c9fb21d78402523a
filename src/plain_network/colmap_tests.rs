//! The reader against COLMAP's own projection, the writer against the reader.

use nalgebra::Vector2;
use proptest::prelude::*;

use super::super::fixture::{displaced, ideal, small_network};
use super::super::{ColmapFiles, PlainCamera, PlainParameter, to_colmap};
use super::*;
use crate::camera::LensDirection;

fn read(cameras: &str, images: &str, points: &str) -> Result<PlainNetwork, ImportError> {
    let named = |file, text| NamedText { file, text };
    from_colmap(ColmapTexts {
        cameras: named("cameras.txt", cameras),
        images: named("images.txt", images),
        points: named("points3D.txt", points),
    })
}

fn read_back(files: &ColmapFiles) -> PlainNetwork {
    read(&files.cameras, &files.images, &files.points).unwrap()
}

const IMAGE: &str = "1 0.851773 0.0165051 0.503764 -0.142941 -0.737434 1.02973 3.74354 1 A 1.JPG\n";
const POINTS: &str =
    "# ID\n58 1.67 0.29 0.61 115 121 122 1.3 1 0 2 1\n59 2 0.1 -0.03 1 2 3 1.7 1 2\n";

/// COLMAP's projection of a point, as `models.h` has it for `OPENCV` with k3.
fn colmap_pixel(parameters: &[f64; 9], q: [f64; 4], t: [f64; 3], point: [f64; 3]) -> Vector2<f64> {
    let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = *parameters;
    let q = UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]));
    let at = q * Vector3::from(point) + Vector3::from(t);
    let (u, v) = (at.x / at.z, at.y / at.z);
    let r2 = u * u + v * v;
    let radial = k1 * r2 + k2 * r2 * r2 + k3 * r2 * r2 * r2;
    let du = u * radial + 2.0 * p1 * u * v + p2 * (r2 + 2.0 * u * u);
    let dv = v * radial + 2.0 * p2 * u * v + p1 * (r2 + 2.0 * v * v);
    Vector2::new(fx * (u + du) + cx, fy * (v + dv) + cy)
}

/// The pixel that a network's own start gives.
fn own_pixel(network: &PlainNetwork, image: usize, point: [f64; 3]) -> Vector2<f64> {
    let image = &network.images[image];
    let camera = &network.cameras[image.camera];
    camera.pixel_from_image(&displaced(
        camera,
        &ideal(camera, &image.start.unwrap(), point),
    ))
}

#[test]
fn a_model_is_read() {
    let cameras = "# Camera list\n1 SIMPLE_RADIAL 3072 2304 2559.69 1536 1152 -0.0218531\n2 PINHOLE 100 100 90 90 50 50\n";
    let images = format!(
        "# Image list\n{IMAGE}2362.39 248.498 58 1784.7 268.254 59 1784.7 268.254 -1\n2 1 0 0 0 0 0 5 1 B.JPG\n\n"
    );
    let network = read(cameras, &images, POINTS).unwrap();
    assert_eq!(network.cameras.len(), 2, "a camera without image is kept");
    assert_eq!(network.images[0].name, "A 1.JPG");
    assert_eq!(network.images[1].name, "B.JPG", "an image may see nothing");
    assert_eq!(network.observations.len(), 2);
    assert_eq!(network.observations[1].x_px, 1784.7);
    assert_eq!(network.points[1].name, "59");
    let free = network.cameras[0]
        .parameters
        .map(|p| p == PlainParameter::Free);
    assert_eq!(
        free,
        [
            true, true, true, true, false, false, false, false, false, false
        ]
    );
    // The second camera stands 5 behind the origin of its z axis and looks along world z.
    let pose = network.images[1].start.unwrap();
    assert!((pose.centre_in_world - Vector3::new(0.0, 0.0, -5.0)).norm() < 1e-15);
    assert!(pose.camera_from_point(&Vector3::zeros()).z < 0.0);
}

proptest! {
    #[test]
    fn a_point_lands_where_colmap_puts_it(
        f in 500.0..4000.0,
        k in prop::array::uniform3(-0.1..0.1),
        p in prop::array::uniform2(-0.002..0.002),
        q in prop::array::uniform4(-1.0..1.0),
        u in -0.3..0.3, v in -0.3..0.3, depth in 1.0..9.0,
    ) {
        let length = q.iter().map(|x: &f64| x * x).sum::<f64>().sqrt();
        prop_assume!(length > 0.1);
        let q = q.map(|x| x / length);
        let t = [0.3, -0.7, 2.0];
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]));
        let from_camera: Vector3<f64> = Vector3::new(u, v, 1.0) * depth - Vector3::from(t);
        let point: [f64; 3] = (rotation.inverse() * from_camera).into();
        let parameters = [1.01 * f, f, 1510.0, 1140.0, k[0], k[1], p[0], p[1], k[2]];
        let cameras = format!(
            "1 FULL_OPENCV 3072 2304 {} {f} 1510 1140 {} {} {} {} {} 0 0 0\n", 1.01 * f, k[0], k[1], p[0], p[1], k[2]
        );
        let images = format!("1 {} {} {} {} 0.3 -0.7 2 1 A\n\n", q[0], q[1], q[2], q[3]);
        let network = read(&cameras, &images, POINTS).unwrap();
        let off = own_pixel(&network, 0, point) - colmap_pixel(&parameters, q, t, point);
        prop_assert!(off.norm() < 1e-9, "{off}");
    }

    #[test]
    fn what_is_written_is_read_back(
        radial in prop::array::uniform3(-1.0..1.0),
        tangential in prop::array::uniform2(-1e-5..1e-5),
        balanced in 0.0..12.0,
        affinity in -1e-3..1e-3,
        kind in 0..3,
    ) {
        let mut network = small_network();
        let camera = &mut network.cameras[0];
        camera.lens = LensDirection::Displacing { balanced_radius_mm: balanced };
        // With distortion there is no affinity in COLMAP.
        let [k1, k2, k3] = radial;
        camera.values = match kind {
            0 => [24.0, 0.1, -0.05, 0.0, 0.0, 0.0, 0.0, 0.0, affinity, 0.0],
            1 => [24.0, 0.1, -0.05, k1 * 1e-4, k2 * 1e-7, 0.0, tangential[0], tangential[1], 0.0, 0.0],
            _ => [24.0, 0.1, -0.05, k1 * 1e-4, k2 * 1e-7, k3 * 1e-10, tangential[0], tangential[1], 0.0, 0.0],
        };
        let files = to_colmap(&network).unwrap();
        let back = read_back(&files);
        prop_assert_eq!(back.images.len(), network.images.len());
        for (a, b) in network.observations.iter().zip(&back.observations) {
            prop_assert_eq!((a.image, a.point, a.x_px, a.y_px), (b.image, b.point, b.x_px, b.y_px));
        }
        for image in 0..2 {
            let (a, b) = (network.images[image].start.unwrap(), back.images[image].start.unwrap());
            prop_assert!((a.centre_in_world - b.centre_in_world).norm() < 1e-11);
            prop_assert!((a.camera_from_world.matrix() - b.camera_from_world.matrix()).amax() < 1e-14);
            for point in &network.points {
                let at = point.start.unwrap();
                let off = own_pixel(&network, image, at) - own_pixel(&back, image, at);
                prop_assert!(off.norm() < 1e-8, "{off}");
            }
        }
    }
}

#[test]
fn numbers_stay_and_names_become_numbers() {
    let mut network = small_network();
    network.cameras[0].values[3..].fill(0.0);
    let files = to_colmap(&network).unwrap();
    assert!(
        files
            .cameras
            .contains("\n1 PINHOLE 4000 3000 4800 4800 2020 1510\n"),
        "{}",
        files.cameras
    );
    assert!(
        files
            .points
            .contains("\n2 100 0 10 255 255 255 -1 1 1 2 1\n"),
        "{}",
        files.points
    );
    for (point, name) in network.points.iter_mut().zip(["7", "12", "58", "9"]) {
        point.name = name.into();
    }
    let back = read_back(&to_colmap(&network).unwrap());
    assert_eq!(back.points[1].name, "12");
    assert_eq!(back.observations.len(), 8);
}

#[test]
fn what_colmap_lacks_is_refused_in_one_line() {
    type Damage = fn(&mut PlainNetwork);
    let displacing = |camera: &mut PlainCamera| {
        camera.lens = LensDirection::Displacing {
            balanced_radius_mm: 0.0,
        };
    };
    let cases: [(Damage, &str); 6] = [
        (
            |n| n.cameras[0].lens = LensDirection::Correcting,
            "camera 'A': found a distortion that corrects the measured point, expected one that displaces the ideal point, or none",
        ),
        (
            |n| n.cameras[0].values[8] = 1e-3,
            "camera 'A': found B1 and B2 that COLMAP lacks, 0.003 px at a corner, expected less than 0.001 px",
        ),
        (
            |n| n.cameras[0].values[9] = 1e-4,
            "camera 'A': found B1 and B2 that COLMAP lacks, 0.151 px at a corner, expected less than 0.001 px",
        ),
        (
            |n| n.images[1].start = None,
            "image 'right': found no start, expected where its camera stood",
        ),
        (
            |n| n.images[1].name = "a b".into(),
            "image 'a b': found a blank in its name, expected a name without",
        ),
        (
            |n| n.points[1].start = None,
            "point 'P2': found no start, expected where it is",
        ),
    ];
    for (damage, line) in cases {
        let mut network = small_network();
        network.cameras[0].values = [24.0, 0.1, -0.05, 1e-5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        displacing(&mut network.cameras[0]);
        damage(&mut network);
        assert_eq!(to_colmap(&network).unwrap_err().to_string(), line);
    }
}

#[test]
fn bad_models_are_answered_in_one_line() {
    let camera = "1 SIMPLE_PINHOLE 3072 2304 2559 1536 1152\n";
    let images = format!("{IMAGE}\n");
    let seen = format!("{IMAGE}1 2 58\n");
    for (cameras, images, points, line) in [
        (
            "1 FISHEYE 3 2 1 1 1\n",
            images.as_str(),
            POINTS,
            "cameras.txt, line 1, column 2 (model): found 'FISHEYE', expected one of SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV",
        ),
        (
            "1 RADIAL 3 2 1 1 1\n",
            &images,
            POINTS,
            "cameras.txt, line 1: found 3 parameters of RADIAL, expected 5 (f, cx, cy, k1, k2)",
        ),
        (
            "1 FULL_OPENCV 3 2 1 1 1 1 0 0 0 0 0 0.5 0 0\n",
            &images,
            POINTS,
            "cameras.txt, line 1, column 14 (k4): found '0.5', expected 0: a distortion without denominator",
        ),
        (
            "1 PINHOLE 3 2 1 -1 1 1\n",
            &images,
            POINTS,
            "cameras.txt, line 1, column 6 (fy): found '-1', expected a number greater than 0",
        ),
        (
            camera,
            IMAGE,
            POINTS,
            "images.txt, line 1: found the end of the text, expected a line of keypoints",
        ),
        (
            camera,
            &format!("{IMAGE}1 2\n"),
            POINTS,
            "images.txt, line 2: found 2 fields, expected three a keypoint (x, y, point)",
        ),
        (
            camera,
            &format!("{IMAGE}1 2 60\n"),
            POINTS,
            "images.txt, line 2, column 3 (point): found '60', expected a point of points3D.txt or -1",
        ),
        (
            camera,
            &format!("{IMAGE}1 2 58 3 4 58\n"),
            POINTS,
            "images.txt, observation 2 of point '58' in image 'A 1.JPG': found a second one of it, expected one",
        ),
        (
            camera,
            &images.replace("0.85", "1.85"),
            POINTS,
            "images.txt, line 1: found a quaternion of length 1.9245, expected 1",
        ),
        (
            camera,
            &images.replace(" 1 A", " 2 A"),
            POINTS,
            "images.txt, line 1, column 9 (camera): found '2', expected a camera of cameras.txt",
        ),
        (
            camera,
            &seen,
            "58 1 2\n",
            "points3D.txt, line 1: found 3 fields, expected 4 (point, X, Y, Z)",
        ),
        (
            camera,
            &seen,
            "58 1 2 3\n58 1 2 3\n",
            "points3D.txt, point '58': found a second one of this name, expected one",
        ),
    ] {
        assert_eq!(read(cameras, images, points).unwrap_err().to_string(), line);
    }
}
