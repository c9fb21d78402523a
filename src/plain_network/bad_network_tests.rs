//! Networks with one bad thing each, as files: the finding names it, and the rest is adjusted as without it.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use serde_json::{Value, json};

use super::bad_network_fixture::{
    adjusted, along_a_line, flat, largest_error, sound, square_on, two_blocks_with_control,
    with_control, with_noise, with_three_distances, without_starts,
};
use super::fixture::{imaged, lens, places, ring_poses};
use super::*;
use crate::adjustment::RejectionSettings;
use crate::camera::LensDirection;
use crate::geometry::{Pose, Scale};

fn value(network: &PlainNetwork) -> Value {
    serde_json::from_str(&to_json(network).unwrap()).unwrap()
}

fn read(text: &str) -> PlainNetwork {
    let file = "net.json";
    from_json(NamedText { file, text }).unwrap()
}

fn rows(file: &mut Value) -> &mut Vec<Value> {
    file["observations"].as_array_mut().unwrap()
}

fn keep(file: &mut Value, keeps: impl Fn(&str, &str) -> bool) {
    rows(file).retain(|row| keeps(row[0].as_str().unwrap(), row[1].as_str().unwrap()));
}

fn positions(network: &PlainNetwork, adjusted: &PlainAdjustment) -> BTreeMap<String, Vector3<f64>> {
    let found = adjusted.points.iter().zip(&adjusted.adjustment.points);
    found
        .map(|(&point, own)| (network.points[point].name.clone(), own.position))
        .collect()
}

type Change = fn(&mut Value);

/// A file with a bad thing.
struct Case {
    name: &'static str,
    sound: fn() -> PlainNetwork,
    damage: Change,
    /// What the sound file must be changed by to be without it.
    without: Change,
    rejects: bool,
    /// Beginnings of lines that are told.
    told: &'static [&'static str],
}

const NOTHING: Change = |_| {};

fn cases() -> Vec<Case> {
    let case = |name, sound, damage, without, told| Case {
        name,
        sound,
        damage,
        without,
        rejects: false,
        told,
    };
    let rejecting = |name, sound, damage, without, told| Case {
        rejects: true,
        ..case(name, sound, damage, without, told)
    };
    vec![
        case(
            "a station with two observations",
            sound,
            |n| {
                keep(n, |image, point| {
                    image != "I2" || ["P4", "P9"].contains(&point)
                });
            },
            |n| keep(n, |image, _| image != "I2"),
            &["image 'I2': found 2 points, expected 3 or more: left out"],
        ),
        case(
            "a point seen once",
            sound,
            |n| keep(n, |image, point| point != "P3" || image == "I0"),
            |n| keep(n, |_, point| point != "P3"),
            &["point 'P3': found 1 rays, expected 2 or more: left out"],
        ),
        case(
            "two equal observations",
            sound,
            |n| {
                let row = rows(n)[3].clone();
                rows(n).push(row);
            },
            NOTHING,
            &[
                "point 'P3' in image 'I0': found 2 observations, 0.000 px apart, expected one: the first is used",
            ],
        ),
        case(
            "two different observations",
            sound,
            |n| {
                let mut row = rows(n)[3].clone();
                row[2] = json!(row[2].as_f64().unwrap() + 40.0);
                rows(n).push(row);
            },
            |n| keep(n, |image, point| (image, point) != ("I0", "P3")),
            &[
                "point 'P3' in image 'I0': found 2 observations, 40.000 px apart, expected one: all are left out",
            ],
        ),
        case(
            "a number that is none",
            sound,
            |n| rows(n)[3][3] = Value::Null,
            |n| keep(n, |image, point| (image, point) != ("I0", "P3")),
            &[
                "observation 4 of point 'P3' in image 'I0': found y_px NaN, expected a finite number: left out",
            ],
        ),
        case(
            "a camera with no image",
            sound,
            |n| {
                let mut spare = n["cameras"][0].clone();
                spare["name"] = json!("spare");
                spare["free"] = json!(["c", "K1"]);
                n["cameras"].as_array_mut().unwrap().push(spare);
            },
            NOTHING,
            &["camera 'spare': found no image of it"],
        ),
        case(
            "two blocks",
            sound,
            |n| {
                keep(n, |image, point| {
                    (image < "I3") == (point.len() == 3 && point >= "P20")
                });
            },
            |n| {
                keep(n, |image, point| {
                    image >= "I3" && !(point.len() == 3 && point >= "P20")
                });
            },
            &[
                "images 'I0', 'I1', 'I2': found no point in common with the other images, left out: a block of its own of 3 images and 10 points",
            ],
        ),
        case(
            "two blocks of which one has too little control",
            two_blocks_with_control,
            |n| {
                for point in [21, 24] {
                    n["points"][point].as_object_mut().unwrap().remove("known");
                    n["points"][point].as_object_mut().unwrap().remove("role");
                }
            },
            |n| {
                keep(n, |image, _| image >= "I3");
                for point in [21, 24, 29] {
                    n["points"][point].as_object_mut().unwrap().remove("known");
                    n["points"][point].as_object_mut().unwrap().remove("role");
                }
                n["points"].as_array_mut().unwrap().truncate(18);
            },
            &[
                "images 'I0', 'I1', 'I2': found no point in common with the other images and 1 known points, expected 3 or more that do not lie on a line, left out: a block of its own of 3 images and 12 points",
            ],
        ),
        rejecting(
            "a known coordinate off by five millimetres",
            || with_control(Some(0.02)),
            |n| n["points"][14]["known"][1]["value_mm"] = json!(225.0),
            |n| n["points"][14]["known"][1] = Value::Null,
            &["y of point 'P14': the known 225.000 mm is off by +4.9"],
        ),
        rejecting(
            "a fixed coordinate off by one millimetre",
            || with_control(None),
            |n| n["points"][21]["known"][0]["value_mm"] = json!(271.0),
            |n| n["points"][21]["known"][0] = Value::Null,
            &["x of point 'P21': the known 271.000 mm is off by +"],
        ),
        rejecting(
            "all coordinates of a point off",
            || with_control(Some(0.02)),
            |n| {
                for (axis, value) in [(0, 275.0), (1, 327.0), (2, 45.0)] {
                    n["points"][21]["known"][axis]["value_mm"] = json!(value);
                }
            },
            |n| {
                n["points"][21].as_object_mut().unwrap().remove("known");
                n["points"][21].as_object_mut().unwrap().remove("role");
            },
            &[
                "x of point 'P21': the known 275.000 mm is off by ",
                "y of point 'P21': the known 327.000 mm is off by ",
                "z of point 'P21': the known 45.000 mm is off by ",
            ],
        ),
        rejecting(
            "a distance off by five millimetres",
            with_three_distances,
            |n| {
                let length = &mut n["distances"][1]["length_mm"];
                *length = json!(length.as_f64().unwrap() + 5.0);
            },
            |n| {
                n["distances"].as_array_mut().unwrap().remove(1);
            },
            &["distance 'second': the known "],
        ),
    ]
}

#[test]
fn the_finding_names_the_bad_thing_and_the_rest_is_adjusted_as_without_it() {
    for case in cases() {
        let rejection = case.rejects.then(RejectionSettings::default);
        let sound = value(&(case.sound)());
        let (mut bad, mut without) = (sound.clone(), sound);
        (case.damage)(&mut bad);
        (case.without)(&mut without);
        let bad = read(
            &bad.to_string()
                .replace("null", "NaN")
                .replace(":[NaN", ":[null"),
        );
        let without = read(&without.to_string());
        let (found, expected) = (adjusted(&bad, rejection), adjusted(&without, rejection));
        let name = case.name;
        for line in case.told {
            let is_told = found.told.iter().any(|told| told.starts_with(line));
            assert!(is_told, "{name}: {line}: {:#?}", found.told);
        }
        let more = found.told.len() - case.told.len();
        assert!(more <= expected.told.len(), "{name}: {:#?}", found.told);
        let [here, there] = [positions(&bad, &found), positions(&without, &expected)];
        assert_eq!(
            here.keys().collect::<Vec<_>>(),
            there.keys().collect::<Vec<_>>(),
            "{name}"
        );
        for (point, place) in &here {
            let off = (place - there[point]).norm();
            assert!(off < 1e-9, "{name}: {point} off by {off:e} mm");
        }
        assert!(here.len() >= 18 && found.images.len() >= 5, "{name}");
        assert!(
            (0.4..1.2).contains(&found.adjustment.sigma0),
            "{name}: {}",
            found.adjustment.sigma0
        );
    }
}

/// Shapes and the missing scale cannot be taken away: the true places are the measure.
#[test]
fn shapes_and_a_missing_scale_are_told_and_adjusted() {
    let on_a_line = || {
        let places = places();
        with_noise(imaged(
            lens(LensDirection::Correcting),
            &places,
            &along_a_line(&places),
        ))
    };
    let no_scale = || {
        let mut network = sound();
        network.distances.clear();
        network
    };
    let cases: [(&str, PlainNetwork, &[&str], Scale); 4] = [
        (
            "no scale",
            no_scale(),
            &[
                "found no distance and no known coordinates: the scale is that of the starting values",
            ],
            Scale::Free,
        ),
        (
            "flat points",
            flat(ring_poses),
            &["all 30 points lie in a plane (within 0."],
            Scale::One,
        ),
        (
            "stations on a line",
            on_a_line(),
            &["all 7 images were taken from one line (within 0."],
            Scale::One,
        ),
        (
            "flat points, stations on a line",
            flat(along_a_line),
            &[
                "all 30 points lie in a plane (within 0.",
                "all 7 images were taken from one line (within 0.",
            ],
            Scale::One,
        ),
    ];
    for (name, network, lines, scale) in cases {
        let truth: Vec<Vector3<f64>> = network
            .points
            .iter()
            .map(|p| p.start.unwrap().into())
            .collect();
        for network in [network.clone(), without_starts(network)] {
            let found = adjusted(&read(&to_json(&network).unwrap()), None);
            for line in lines {
                let told = found.told.iter().any(|told| told.starts_with(line));
                assert!(told, "{name}: {line}: {:#?}", found.told);
            }
            assert_eq!(found.told.len(), lines.len(), "{name}: {:#?}", found.told);
            let error = largest_error(&found, &truth, scale);
            // Sigmas are some 0.02 mm; along one line of stations they grow to 0.1 mm.
            assert!(error < 0.3, "{name}: {error}");
            assert!(
                found.adjustment.sigma0 < 1.2,
                "{name}: {}",
                found.adjustment.sigma0
            );
        }
    }
}

#[test]
fn blocks_that_known_points_place_are_adjusted_together() {
    let network = two_blocks_with_control();
    let found = adjusted(&read(&to_json(&network).unwrap()), None);
    assert_eq!(found.told, Vec::<String>::new());
    assert_eq!(found.images.len(), 8);
    for (&point, own) in found.points.iter().zip(&found.adjustment.points) {
        let off = (own.position - places()[point]).norm();
        let sigma = own.sigma_mm().unwrap().norm() / found.adjustment.sigma0;
        assert!(off < 4.0 * sigma, "{point}: {off} of {sigma}");
    }
}

#[test]
fn a_principal_distance_that_nothing_determines_is_held() {
    let truth: Vec<Vector3<f64>> = places()
        .iter()
        .map(|p| Vector3::new(p.x, p.y, 0.0))
        .collect();
    let mut camera = lens(LensDirection::Correcting);
    camera.values[1..].fill(0.0);
    camera.parameters[0] = PlainParameter::Free;
    let exact = imaged(camera, &truth, &square_on(&truth));
    for network in [exact.clone(), with_noise(exact)] {
        let found = adjusted(&network, None);
        let held = "c of camera 'A': the observations do not determine it: held at 24.0000 mm";
        assert_eq!(found.told[0], held);
        let camera = HeldParameter {
            camera: 0,
            parameter: 0,
        };
        assert_eq!(found.held, [camera]);
        let error = largest_error(&found, &truth, Scale::One);
        assert!(error < 0.3, "{error}");
    }
}

#[test]
fn a_pose_that_looks_away_is_found_anew() {
    let mut network = sound();
    let expected = adjusted(&network, None);
    let pose = network.images[4].start.as_mut().unwrap();
    let away = pose.centre_in_world * 2.0;
    *pose = Pose::looking_at(pose.centre_in_world, away, Vector3::y(), 0.0);
    let found = adjusted(&network, None);
    assert_eq!(
        found.told,
        [
            "image 'I4': 30 of 30 points lie behind the camera or outside the lens at its given pose: another is sought"
        ]
    );
    let [here, there] = [&found, &expected].map(|a| a.adjustment.points[7].position);
    assert!((here - there).norm() < 1e-6);
}

#[test]
fn too_little_control_is_told_and_the_rest_of_the_freedom_taken_by_all_points() {
    let mut network = sound();
    let known = |value_mm| {
        Some(Known {
            value_mm,
            sigma_mm: Some(0.01),
        })
    };
    network.points[0].role = PointRole::Control;
    network.points[0].known = [0.0; 3].map(known);
    network.datum = PlainDatum::Control;
    let found = adjusted(&network, None);
    assert_eq!(
        found.told,
        [
            "datum: the known coordinates leave 3 of 7 motions of the network free: inner constraints on all points take them"
        ]
    );
    assert!(largest_error(&found, &places(), Scale::One) < 0.1);
}

/// Steep images of a flat field tell it badly: it is told, and estimated.
#[test]
fn a_principal_distance_that_is_badly_determined_is_told() {
    let truth: Vec<Vector3<f64>> = places()
        .iter()
        .map(|p| Vector3::new(p.x, p.y, 0.0))
        .collect();
    let mut camera = lens(LensDirection::Correcting);
    camera.parameters[0] = PlainParameter::Free;
    let mut poses = square_on(&truth);
    for (k, pose) in poses.iter_mut().enumerate() {
        // A thousandth of a radian off the plumb line.
        let turn = Vector3::new(
            1e-3 * (k as f64 * 2.4).sin(),
            1e-3 * (k as f64 * 2.4).cos(),
            0.0,
        );
        *pose = pose.moved(&turn, &Vector3::zeros());
    }
    let network = with_noise(imaged(camera, &truth, &poses));
    let found = adjusted(&network, None);
    assert!(
        found
            .told
            .iter()
            .any(|told| told.starts_with("c of camera 'A': ")),
        "{:#?}",
        found.told
    );
    assert!(largest_error(&found, &truth, Scale::One) < 0.3);
}

#[test]
fn an_image_that_hangs_on_a_line_of_points_is_left_out() {
    // The first six points lie on a line in x, but for their heights.
    let mut flat: Vec<Vector3<f64>> = places();
    flat[..6].iter_mut().for_each(|p| p.z = 0.0);
    let mut network = with_noise(imaged(
        lens(LensDirection::Correcting),
        &flat,
        &ring_poses(&flat),
    ));
    network.observations.retain(|o| o.image != 6 || o.point < 6);
    let found = adjusted(&network, None);
    assert_eq!(
        found.told,
        [
            "image 'I6': its 6 points lie on a line (within 0.000 mm, 450 mm long), and the adjustment does not converge with it: left out"
        ]
    );
    assert_eq!(found.images.len(), 7);
    assert!(largest_error(&found, &flat, Scale::One) < 0.1);
}

#[test]
fn a_point_seen_from_one_place_alone_is_left_out() {
    let places = places();
    let mut poses = ring_poses(&places);
    poses[7].centre_in_world = poses[0].centre_in_world;
    poses[7].camera_from_world = poses[0].camera_from_world;
    let mut network = imaged(lens(LensDirection::Correcting), &places, &poses);
    let from_there = |o: &PlainObservation| o.image == 0 || o.image == 7;
    network
        .observations
        .retain(|o| o.point != 3 || from_there(o));
    let found = adjusted(&network, None);
    assert_eq!(
        found.told,
        ["point 'P3': the observations do not determine it: left out"]
    );
    assert!(largest_error(&found, &places, Scale::One) < 1e-4);
}
