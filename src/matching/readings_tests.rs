//! Fields in which nothing but somebody's eye decides, with truth.

use nalgebra::Vector2;

use super::*;
use crate::camera::{Camera, InteriorOrientation};
use crate::geometry::{Circle, Pose};
use crate::matching::{
    Identification, IdentificationInput, IdentificationSettings, KnownCircle, KnownPoint,
    ObjectSpace, View, ViewDot, identify,
};
use crate::monitor::Monitor;

/// Height of the cameras above the plane of the targets, mm.
const HEIGHT_MM: f64 = 900.0;
/// Distance of neighbouring cameras, mm.
const BASE_MM: f64 = 180.0;
/// Diameter of all targets, mm.
const DOT_MM: f64 = 5.0;

/// Three cameras in a row that look straight down.
fn views() -> Vec<View> {
    [-1.0, 0.0, 1.0]
        .map(|place| {
            let centre = Vector3::new(place * BASE_MM, 0.0, HEIGHT_MM);
            let below = Vector3::new(centre.x, 0.0, 0.0);
            View {
                camera: Camera {
                    width_px: 3072,
                    height_px: 2048,
                    pixel_pitch_mm: 0.009,
                    interior: InteriorOrientation::pinhole(20.0),
                },
                pose: Pose::looking_at(centre, below, Vector3::y(), 0.0),
                precision: None,
                dots: Vec::new(),
            }
        })
        .into()
}

fn dot(view: &View, target: &Vector3<f64>) -> ViewDot {
    let circle = Circle {
        normal: Vector3::z(),
        radius_mm: DOT_MM / 2.0,
    };
    let ellipse = view.camera.ellipse_of_target(&view.pose, target, &circle);
    let ellipse = ellipse.expect("a target before the camera");
    let pixel = view.camera.project(&view.pose.camera_from_point(target));
    ViewDot {
        pixel: pixel.expect("a target before the camera"),
        sigma_px: 0.02,
        major_px: ellipse.major_px,
        minor_px: ellipse.minor_px,
        angle: ellipse.angle,
    }
}

/// A lattice of points in the plane z = 0 that are known and labelled in all views.
fn known() -> Vec<KnownPoint> {
    let places = (-2..=2).flat_map(|i| (-2..=2).map(move |j| (f64::from(i), f64::from(j))));
    places
        .map(|(i, j)| KnownPoint {
            position: Vector3::new(60.0 * i, 45.0 * j + 5.0, 0.0),
            covariance: Matrix3::identity() * 1e-4,
            seen_in: vec![0, 1, 2],
            circle: Some(KnownCircle {
                diameter_mm: Some(DOT_MM),
                normal: Vector3::z(),
            }),
        })
        .collect()
}

fn identified(views: &[View], known: &[KnownPoint]) -> Identification {
    let neighbours = vec![vec![1, 2], vec![0, 2], vec![0, 1]];
    let space = ObjectSpace::around(known.iter().map(|k| &k.position), 0.7);
    let input = IdentificationInput {
        views,
        neighbours: &neighbours,
        known,
        space: space.expect("known points"),
        station_sigma_mm: 0.02,
        image_tolerance_px: 0.05,
        ellipses: None,
    };
    identify(&input, &IdentificationSettings::default(), &Monitor::new()).expect("no interrupt")
}

/// Three targets in a row, a sixth of the base apart: the rays to the first, second and third meet in one point 200 mm below the plane,
/// those to the third, second and first 140 mm above it, as exactly as those of each target.
#[test]
fn a_row_that_repeats_itself_leaves_one_question_with_the_truth_first() {
    let mut views = views();
    let row = [-1.0, 0.0, 1.0].map(|place| Vector3::new(33.0 * place, 12.0, 0.0));
    for view in &mut views {
        view.dots = row.iter().map(|target| dot(view, target)).collect();
    }
    let found = identified(&views, &known());
    assert!(found.tracks.is_empty(), "{:?}", found.tracks);
    assert_eq!(found.groups.len(), 1, "one answer settles the others");
    let readings = &found.groups[0].readings;
    assert_eq!(readings.len(), 3, "{readings:#?}");
    let depth = |reading: &Reading| match reading.target {
        ReadAs::NewTarget { position, .. } => position.z,
        ReadAs::Known(_) | ReadAs::Track(_) => f64::NAN,
    };
    let truth = &readings[0];
    assert!(depth(truth).abs() < 1.0, "{truth:?}");
    let right = |place: usize| (0..3).map(move |view| Member { view, dot: place });
    assert!((0..3).any(|place| right(place).eq(truth.members.iter().copied())));
    for ghost in &readings[1..] {
        let away = depth(ghost);
        assert!((away + 202.0).abs() < 3.0 || (away - 139.0).abs() < 3.0);
        assert!(ghost.rays.chi_square < 0.1, "it is as exact as the truth");
        assert!(truth.log_likelihood > ghost.log_likelihood);
    }
}

#[test]
fn odds_of_two_dots_at_one_place_are_those_of_their_distances() {
    let mut views = views();
    let mut known = known();
    // Two images show the last point; in the third, two specks lie beside its place.
    let last = known.last_mut().expect("a point");
    last.seen_in = vec![0, 1];
    let place = dot(&views[2], &last.position);
    let beside = |px: f64| ViewDot {
        pixel: place.pixel + Vector2::new(px, 0.0),
        major_px: 0.0,
        minor_px: 0.0,
        ..place
    };
    views[2].dots = vec![beside(0.08), beside(-0.05)];
    let found = identified(&views, &known);
    assert!(found.claims.is_empty(), "{:?}", found.claims);
    assert_eq!(found.groups.len(), 1);
    let [near, far] = &found.groups[0].readings[..] else {
        panic!("two dots claim the place: {:?}", found.groups);
    };
    assert_eq!(near.members, [Member { view: 2, dot: 1 }]);
    assert_eq!(far.target, ReadAs::Known(known.len() - 1));
    let apart = (far.rays.chi_square - near.rays.chi_square) / 2.0;
    assert!(apart > 0.0);
    assert!((near.log_likelihood - far.log_likelihood - apart).abs() < 1e-6);
}

#[test]
fn what_leaves_no_doubt_is_no_question() {
    let mut views = views();
    for view in &mut views {
        view.dots = vec![dot(view, &Vector3::new(20.0, 17.0, 0.0))];
    }
    let found = identified(&views, &known());
    assert_eq!((found.tracks.len(), found.groups.len()), (1, 0));
}
