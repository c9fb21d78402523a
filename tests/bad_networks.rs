//! Bad networks of rays through the command: each is told in a finding that names the thing, and the rest is adjusted.

mod common;

use common::Folder;
use common::rays::{CENTRES, network_of_rays, places};
use serde_json::{Value, json};

fn list<'a>(network: &'a mut Value, key: &str) -> &'a mut Vec<Value> {
    network[key].as_array_mut().unwrap()
}

fn keep(network: &mut Value, keeps: impl Fn(&str, &str) -> bool) {
    list(network, "observations")
        .retain(|row| keeps(row[0].as_str().unwrap(), row[1].as_str().unwrap()));
}

fn sound() -> Value {
    network_of_rays(&places(), &CENTRES)
}

/// Six known points in the place of the distance.
fn with_control(known: impl Fn(f64) -> Value) -> Value {
    let mut network = sound();
    list(&mut network, "distances").clear();
    for (point, place) in places().iter().enumerate().step_by(2) {
        network["points"][point]["known"] = Value::Array(place.map(&known).into());
    }
    network
}

/// A bad network, the options it is adjusted with, beginnings of its findings, and how many points are left.
struct Case {
    network: Value,
    options: &'static [&'static str],
    findings: &'static [&'static str],
    points: usize,
}

fn changed(mut network: Value, change: impl Fn(&mut Value)) -> Value {
    change(&mut network);
    network
}

fn cases() -> Vec<Case> {
    let case = |network, findings, points| Case {
        network,
        options: &[],
        findings,
        points,
    };
    let flat: Vec<[f64; 3]> = places().iter().map(|p| [p[0], p[1], 0.0]).collect();
    let on_a_line = [-450.0, -200.0, 50.0, 180.0, 410.0].map(|x| [x, 0.5 * x, 1000.0]);
    let weighted = |value: f64| json!({"value_mm": value, "sigma_mm": 0.02});
    let fixed = |value: f64| json!({"value_mm": value});
    let off_by_five = |n: &mut Value| {
        let value = &mut n["points"][4]["known"][2]["value_mm"];
        *value = json!(value.as_f64().unwrap() + 5.0);
    };
    vec![
        case(
            changed(sound(), |n| list(n, "distances").clear()),
            &[
                "found no distance and no known coordinates: the scale is that of the starting values",
            ],
            12,
        ),
        case(
            changed(sound(), |n| {
                keep(n, |image, point| image != "I4" || point < "P10");
            }),
            &["image 'I4': found 2 points, expected 3 or more: left out"],
            12,
        ),
        case(
            changed(sound(), |n| {
                keep(n, |image, point| point != "P7" || image == "I3");
            }),
            &["point 'P7': found 1 rays, expected 2 or more: left out"],
            11,
        ),
        case(
            changed(sound(), |n| n["observations"][3][1] = json!("P2")),
            &["point 'P2' in image 'I0': found 2 observations, "],
            12,
        ),
        case(
            changed(sound(), |n| {
                let spare = json!({"name": "spare", "width_px": 10, "height_px": 10, "pixel_pitch_mm": 0.005, "values": {"c": 8}});
                list(n, "cameras").push(spare);
            }),
            &["camera 'spare': found no image of it"],
            12,
        ),
        case(
            network_of_rays(&flat, &CENTRES),
            &["all 12 points lie in a plane (within 0.000 mm, "],
            12,
        ),
        case(
            changed(network_of_rays(&flat, &CENTRES), |n| {
                n["cameras"][0]["free"] = json!(["c"]);
            }),
            &[
                "c of camera 'A': the observations do not determine it: held at 20.0000 mm",
                "all 12 points lie in a plane (within 0.000 mm, ",
            ],
            12,
        ),
        case(
            network_of_rays(&places(), &on_a_line),
            &["all 5 images were taken from one line (within 0.000 mm, "],
            12,
        ),
        case(
            changed(with_control(weighted), off_by_five),
            &[
                "z of point 'P4': the known 45.000 mm is off by +5.000 mm against everything else (|w| ",
            ],
            12,
        ),
        Case {
            options: &["--reject", "4"],
            ..case(
                changed(with_control(weighted), off_by_five),
                &[
                    "z of point 'P4': the known 45.000 mm is off by +5.000 mm against everything else (|w| ",
                ],
                12,
            )
        },
        Case {
            options: &["--reject", "4"],
            ..case(
                changed(with_control(fixed), off_by_five),
                &[
                    "z of point 'P4': the known 45.000 mm is off by +5.000 mm against everything else (|w| ",
                ],
                12,
            )
        },
        case(
            changed(sound(), |n| {
                keep(n, |image, point| {
                    (image < "I2") == ["P0", "P1", "P2", "P3"].contains(&point)
                });
            }),
            &[
                "images 'I0', 'I1': found no point in common with the other images, left out: a block of its own of 2 images and 4 points",
            ],
            8,
        ),
    ]
}

#[test]
fn a_bad_network_is_adjusted_where_it_can_be_and_its_findings_name_the_thing() {
    let folder = Folder::new("bad-networks");
    for case in cases() {
        folder.write("net.json", case.network.to_string());
        let mut arguments = vec!["adjust", "--network", "net.json", "--json"];
        arguments.extend(case.options);
        let report = folder.run(&arguments).json();
        let findings: Vec<&str> = list_of(&report, "findings");
        for finding in case.findings {
            let told = findings
                .iter()
                .filter(|told| told.starts_with(finding))
                .count();
            assert_eq!(told, 1, "{finding}: {findings:#?}");
        }
        assert_eq!(
            report["points"].as_array().unwrap().len(),
            case.points,
            "{findings:#?}"
        );
        let contradicts = findings
            .iter()
            .any(|told| told.ends_with("used all the same"));
        let sigma0 = report["sigma0"].as_f64().unwrap();
        // Without noise only what contradicts and is used leaves residuals.
        assert_eq!(sigma0 > 1e-3, contradicts, "{sigma0}: {findings:#?}");
    }
}

fn list_of<'a>(report: &'a Value, key: &str) -> Vec<&'a str> {
    let list = report[key].as_array().unwrap();
    list.iter().map(|entry| entry.as_str().unwrap()).collect()
}

/// Other programs write `NaN` for a number that they do not have, which is no JSON.
#[test]
fn a_number_that_is_none_costs_its_observation_alone() {
    let folder = Folder::new("no-number");
    let mut network = sound();
    network["observations"][3][2] = json!("here");
    folder.write("net.json", network.to_string().replace("\"here\"", "NaN"));
    let report = folder
        .run(&["adjust", "--network", "net.json", "--json"])
        .json();
    assert_eq!(
        list_of(&report, "findings"),
        [
            "observation 4 of point 'P3' in image 'I0': found x_px NaN, expected a finite number: left out"
        ]
    );
    assert_eq!(report["image_points"].as_array().unwrap().len(), 71);
    network["observations"][3][2] = json!(1.0);
    network["points"][0]["start_mm"] = json!(["here", 0, 0]);
    folder.write("net.json", network.to_string().replace("\"here\"", "NaN"));
    let answer = folder.run(&["adjust", "--network", "net.json"]);
    answer.refused(2, &["net.json, line 1, column ", "found 'NaN,"]);
}

#[test]
fn images_from_one_place_are_no_network() {
    let folder = Folder::new("one-place");
    folder.write(
        "net.json",
        network_of_rays(&places(), &[CENTRES[0]; 4]).to_string(),
    );
    let answer = folder.run(&["adjust", "--network", "net.json"]);
    answer.refused(1, &["net.json: all 4 images were taken from one place"]);
}

/// What is known is told with its residual and what controls it.
#[test]
fn known_coordinates_have_their_residuals_and_tests() {
    let folder = Folder::new("known");
    let weighted = |value: f64| json!({"value_mm": value, "sigma_mm": 0.02});
    folder.write("net.json", with_control(weighted).to_string());
    let report = folder
        .run(&["adjust", "--network", "net.json", "--json"])
        .json();
    let known = report["known_coordinates"].as_array().unwrap();
    assert_eq!(known.len(), 18);
    assert_eq!(
        (&known[1]["point"], &known[1]["axis"]),
        (&json!("P0"), &json!("y"))
    );
    for row in known {
        assert!(
            (0.0..=1.0).contains(&row["redundancy"].as_f64().unwrap()),
            "{row}"
        );
        assert!(row["residual_mm"].as_f64().unwrap().abs() < 1e-6, "{row}");
    }
    assert_eq!(report["findings"], json!([]));
}
