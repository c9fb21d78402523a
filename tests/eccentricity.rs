//! Large dots in a rendered picture: detection measures the centre of the circle's image, bent by the lens.

use nalgebra::{Rotation3, Vector2, Vector3};
use tiepoint::camera::{Camera, InteriorOrientation, LensDirection};
use tiepoint::geometry::{Circle, Pose};
use tiepoint::imaging::{BitDepth, GreyImage};
use tiepoint::synthetic::{Disc, Finish, Placement, RenderSettings, Scene, render};
use tiepoint::targets::{DetectSettings, Dot, detect};

fn camera() -> Camera {
    Camera {
        width_px: 3072,
        height_px: 2048,
        pixel_pitch_mm: 0.009,
        interior: InteriorOrientation {
            principal_distance: 20.0,
            principal_point: [0.1, -0.05],
            radial: [1.5e-4, -4e-7, 2e-10],
            tangential: [1e-5, -2e-5],
            affinity: [0.0; 2],
            direction: LensDirection::Correcting,
        },
    }
}

/// Twelve discs all over the picture, at 0 to 60 degrees to their rays.
fn discs(diameter_mm: f64, eye: &Vector3<f64>) -> Vec<Disc> {
    let places = [-540.0, -180.0, 180.0, 540.0]
        .into_iter()
        .flat_map(|x| [-330.0, 0.0, 330.0].map(|y| Vector3::new(x, y, 0.0)));
    (1..)
        .zip(places)
        .map(|(number, origin)| {
            let towards = (eye - origin).normalize();
            let azimuth = 0.7 * f64::from(number);
            let side = Rotation3::new(towards * azimuth) * towards.cross(&Vector3::x()).normalize();
            let incidence = f64::from(number % 4 * 20).to_radians();
            let x = Rotation3::new(side * incidence) * towards.cross(&side);
            Disc {
                label: format!("T{number}"),
                placement: Placement {
                    origin,
                    x,
                    y: side * -1.0,
                },
                radius: diameter_mm / 2.0,
                finish: Finish::Matt { brightness: 1.0 },
            }
        })
        .collect()
}

fn nearest(dots: &[Dot], place: Vector2<f64>) -> &Dot {
    let far = |dot: &&Dot| (dot.centre_px - place).norm();
    dots.iter()
        .min_by(|a, b| far(a).total_cmp(&far(b)))
        .expect("dots")
}

#[test]
fn the_centre_of_a_large_dot_is_measured_where_the_camera_says() {
    let camera = camera();
    let pose = Pose::looking_at(
        Vector3::new(0.0, 0.0, 1000.0),
        Vector3::zeros(),
        Vector3::y(),
        0.0,
    );
    // Of some 45 and 100 px, without noise.
    for diameter_mm in [20.0, 45.0] {
        let scene = Scene {
            discs: discs(diameter_mm, &pose.centre_in_world),
            ..Scene::default()
        };
        let settings = RenderSettings {
            noise_sigma_grey: 0.0,
            ..RenderSettings::default()
        };
        let picture = render(&scene, &camera, &pose, &settings, 1);
        let grey = picture.image.iter().map(|&g| u16::from(g)).collect();
        let grey = GreyImage::new(picture.width_px, picture.height_px, BitDepth::Eight, grey)
            .expect("as many samples as pixels");
        let found = detect(&grey, &[], &DetectSettings::default());
        assert_eq!(found.dots.len(), scene.discs.len());
        let pinhole = Camera {
            interior: InteriorOrientation::pinhole(20.0),
            ..camera.clone()
        };
        let (mut worst, mut eccentric, mut bent) = (0.0_f64, 0.0_f64, 0.0_f64);
        for disc in &scene.discs {
            let circle = Circle {
                normal: disc.placement.normal(),
                radius_mm: disc.radius,
            };
            let place = &disc.placement.origin;
            let of_centre = camera.image_of_target(&pose, place, None);
            let dot = nearest(&found.dots, of_centre.expect("a place in the picture"));
            let predicted = camera.image_of_target(&pose, place, Some(&circle));
            worst = worst.max((dot.centre_px - predicted.expect("a dot")).norm());
            let shift = camera.eccentricity(&pose, place, &circle).expect("a dot");
            let of_plane = pinhole.eccentricity(&pose, place, &circle).expect("a dot");
            eccentric = eccentric.max(shift.norm());
            bent = bent.max((shift - of_plane).norm());
        }
        // Grey values of 8 bits leave 0.001 px of so many pixels at the edge.
        assert!(worst < 0.004, "{diameter_mm} mm: {worst} px");
        assert!(eccentric > 10.0 * worst && bent > 3.0 * worst);
    }
}
