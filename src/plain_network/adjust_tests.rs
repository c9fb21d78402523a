//! Networks that are whole, and networks of which a part cannot be adjusted.

use nalgebra::Vector3;

use super::fixture::{network, places};
use super::*;
use crate::adjustment::Sharing;
use crate::camera::LensDirection;
use crate::geometry::{Pose, Scale, fit_similarity};
use crate::monitor::Monitor;
use crate::network::Expansion;

fn adjusted(network: &PlainNetwork) -> PlainAdjustment {
    network
        .adjust(&PlainSettings::default(), &Monitor::new())
        .unwrap()
}

/// Largest distance from the true places after a best fit without scale, mm.
fn largest_error(adjusted: &PlainAdjustment) -> f64 {
    let places = places();
    let found = adjusted.points.iter().zip(&adjusted.adjustment.points);
    let pairs: Vec<_> = found
        .map(|(&k, point)| (point.position, places[k]))
        .collect();
    let fit = fit_similarity(&pairs, Scale::One).unwrap();
    pairs
        .iter()
        .map(|(found, truth)| (fit.apply(found) - truth).norm())
        .fold(0.0, f64::max)
}

#[test]
fn without_starts_a_network_begins_with_its_best_pair() {
    for direction in [
        LensDirection::Correcting,
        LensDirection::Displacing {
            balanced_radius_mm: 8.0,
        },
    ] {
        let mut network = network(direction);
        for image in &mut network.images {
            image.start = None;
        }
        for point in &mut network.points {
            point.start = None;
        }
        network.cameras[0].parameters[..3].fill(PlainParameter::Free);
        network.cameras[0].values[0] *= 1.01;
        let adjusted = adjusted(&network);
        assert_eq!(adjusted.told, Vec::<String>::new());
        assert!(
            largest_error(&adjusted) < 1e-4,
            "{}",
            largest_error(&adjusted)
        );
        assert!(adjusted.adjustment.sigma0 < 1e-4);
    }
}

type Damage = fn(&mut PlainNetwork);

#[test]
fn what_cannot_take_part_is_told_and_the_rest_is_adjusted() {
    let cases: [(Damage, &[&str]); 6] = [
        (
            |n| n.observations.retain(|o| o.point != 3 || o.image == 0),
            &["point 'P3': found 1 rays, expected 2 or more: left out"],
        ),
        (
            |n| n.observations.retain(|o| o.image != 2 || o.point < 2),
            &["image 'I2': found 2 points, expected 3 or more: left out"],
        ),
        (
            |n| {
                let mut other = n.cameras[0].clone();
                other.name = "B".into();
                n.cameras.push(other);
            },
            &["camera 'B': found no image of it"],
        ),
        (
            |n| n.distances.clear(),
            &[
                "found no distance and no known coordinates: the scale is that of the starting values",
            ],
        ),
        (
            // Three images see the last ten points alone, the others the rest.
            |n| n.observations.retain(|o| (o.image < 3) == (o.point >= 20)),
            &[
                "images 'I0', 'I1', 'I2': found no point in common with the other images, left out: a block of its own of 3 images and 10 points",
                "distance 'bar': found an end that does not take part: not used",
            ],
        ),
        (
            |n| {
                n.images[1].start = None;
                n.observations.retain(|o| o.image != 1 || o.point < 3);
            },
            &["image 'I1': found no starting pose, and its points give none: left out"],
        ),
    ];
    for (damage, lines) in cases {
        let mut network = network(LensDirection::Correcting);
        damage(&mut network);
        let adjusted = adjusted(&network);
        for line in lines {
            assert!(
                adjusted.told.iter().any(|told| told == line),
                "{line}: {:?}",
                adjusted.told
            );
        }
        assert!(largest_error(&adjusted) < 1e-4);
        assert!(adjusted.points.len() >= 20 && adjusted.images.len() >= 5);
    }
}

#[test]
fn images_from_one_place_are_named_as_such() {
    let mut network = network(LensDirection::Correcting);
    // All images from one place, with the principal distance free.
    let from = Vector3::new(220.0, 220.0, 900.0);
    for image in &mut network.images {
        image.start.as_mut().unwrap().centre_in_world = from;
    }
    network.observations.clear();
    for (image, entry) in network.images.iter().enumerate() {
        for (point, place) in places().iter().enumerate() {
            let pose = entry.start.unwrap();
            if let Some(pixel) = network.cameras[0]
                .camera()
                .project(&pose.camera_from_point(place))
            {
                network.observations.push(PlainObservation {
                    image,
                    point,
                    x_px: pixel.x,
                    y_px: pixel.y,
                    sigma_px: 0.1,
                });
            }
        }
    }
    let error = network
        .adjust(&PlainSettings::default(), &Monitor::new())
        .unwrap_err();
    assert_eq!(
        error.to_string(),
        "all 8 images were taken from one place (within 0.000 mm): found no base, so that the rays of a point do not meet"
    );
}

#[test]
fn a_gross_error_is_rejected_where_that_is_asked_for() {
    let mut network = network(LensDirection::Correcting);
    // Noise of a tenth of the sigmas, and one observation off by fifty.
    for (k, seen) in network.observations.iter_mut().enumerate() {
        seen.x_px += 0.01 * ((k * 7919) % 13) as f64 / 6.5 - 0.01;
        seen.y_px += 0.01 * ((k * 104_729) % 11) as f64 / 5.5 - 0.01;
    }
    network.observations[77].x_px += 5.0;
    let settings = PlainSettings {
        rejection: Some(Default::default()),
        ..PlainSettings::default()
    };
    let robust = network.adjust(&settings, &Monitor::new()).unwrap();
    assert_eq!(robust.rejected.len(), 1);
    assert_eq!(robust.observations[robust.rejected[0].index], 77);
    assert!(adjusted(&network).adjustment.sigma0 > 5.0 * robust.adjustment.sigma0);
}

#[test]
fn fixed_control_stays_where_it_is() {
    let mut network = network(LensDirection::Correcting);
    network.distances.clear();
    network.datum = PlainDatum::Control;
    let places = places();
    for point in [0, 5, 24, 29, 14] {
        network.points[point].role = PointRole::Control;
        network.points[point].known = std::array::from_fn(|axis| {
            Some(Known {
                value_mm: places[point][axis],
                sigma_mm: None,
            })
        });
        network.points[point].start = None;
    }
    let adjusted = adjusted(&network);
    assert_eq!(adjusted.adjustment.datum_defect, 0);
    for point in [0, 5, 24, 29, 14] {
        let found = &adjusted.adjustment.points[point];
        assert_eq!(found.position, places[point]);
        assert_eq!(found.sigma_mm(), Some(Vector3::zeros()));
    }
    assert!(largest_error(&adjusted) < 1e-4);
}

#[test]
fn a_warm_bar_makes_the_network_longer_by_its_expansion() {
    let mut network = network(LensDirection::Correcting);
    let cold = adjusted(&network);
    network.distances[0].expansion = Some(Expansion {
        per_k: 11.5e-6,
        temperature_c: 30.0,
        reference_c: 20.0,
    });
    let warm = adjusted(&network);
    let length = |adjusted: &PlainAdjustment| {
        let points = &adjusted.adjustment.points;
        (points[29].position - points[0].position).norm()
    };
    let ratio = length(&warm) / length(&cold);
    assert!((ratio - 1.000_115).abs() < 1e-9, "{ratio}");
}

#[test]
fn each_image_finds_its_own_principal_point_and_distance() {
    let mut network = network(LensDirection::Correcting);
    let shared = network.cameras[0].camera();
    let of_image = |image: usize| {
        let k = image as f64;
        [
            0.01 * (k - 3.5),
            0.02 * (1.3 * k).sin(),
            0.02 * (2.1 * k).cos(),
        ]
    };
    for seen in &mut network.observations {
        let mut camera = network.cameras[0].clone();
        for (value, change) in camera.values.iter_mut().zip(of_image(seen.image)) {
            *value += change;
        }
        let place = Vector3::from(network.points[seen.point].start.unwrap());
        let pose = network.images[seen.image].start.unwrap();
        let in_camera = pose.camera_from_point(&place);
        let moved = camera.camera().project(&in_camera).unwrap();
        let before = shared.project(&in_camera).unwrap();
        seen.x_px += moved.x - before.x;
        seen.y_px += moved.y - before.y;
    }
    // Without noise the known values alone pull, by a part of some 1e-3 of what they are off.
    network.cameras[0].parameters[..3].fill(PlainParameter::Weighted { sigma: 1.0 });
    let together = adjusted(&network).adjustment.sigma0;
    network.cameras[0].sharing[..3].fill(Sharing::Image);
    let adjusted = adjusted(&network);
    let images = network.images.len();
    let weighted = 3 * images;
    assert_eq!(
        adjusted.adjustment.unknown_count,
        6 * images + weighted + 3 * 30
    );
    let own = adjusted.adjustment.sigma0;
    assert!(own < 0.02 && together > 20.0 * own, "{own} {together}");
    for (image, station) in adjusted.adjustment.stations.iter().enumerate() {
        let interior = station.interior.as_ref().unwrap();
        let found = interior.camera.interior.to_vector();
        for (k, change) in of_image(image).into_iter().enumerate() {
            let off = found[k] - network.cameras[0].values[k] - change;
            assert!(off.abs() < 1e-3, "{k} of image {image}: {off}");
        }
    }
}

#[test]
fn what_is_loose_is_named_with_its_image() {
    let mut network = network(LensDirection::Correcting);
    // A plane seen straight from above: a longer lens from higher up gives the same picture.
    let camera = network.cameras[0].camera();
    for (point, place) in network.points.iter_mut().zip(places()) {
        point.start = Some([place.x, place.y, 0.0]);
    }
    for (k, image) in network.images.iter_mut().enumerate() {
        let foot = Vector3::new(180.0 + 20.0 * k as f64, 200.0 + 15.0 * (k % 3) as f64, 0.0);
        let from = foot + Vector3::new(0.0, 0.0, 1200.0);
        image.start = Some(Pose::looking_at(from, foot, Vector3::y(), 1.6 * k as f64));
    }
    for seen in &mut network.observations {
        let pose = network.images[seen.image].start.unwrap();
        let place = Vector3::from(network.points[seen.point].start.unwrap());
        let pixel = camera.project(&pose.camera_from_point(&place)).unwrap();
        [seen.x_px, seen.y_px] = [pixel.x, pixel.y];
    }
    network.distances.clear();
    network.cameras[0].parameters[0] = PlainParameter::Free;
    network.cameras[0].sharing[0] = Sharing::Image;
    let adjusted = adjusted(&network);
    let told = adjusted.told.join("\n");
    assert!(told.contains("(c of image 'I"), "{told}");
    assert_eq!(adjusted.held.len(), 1);
}
