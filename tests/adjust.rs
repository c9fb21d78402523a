//! What `tiepoint adjust` tells of a network besides its coordinates, as a program calls it.

mod common;

use common::Folder;
use common::rays::{CENTRES, network_of_rays, places};
use serde_json::{Value, json};

/// Six images of twelve points with errors that are known, a check point and a check distance.
fn network() -> Value {
    let mut network = network_of_rays(&places(), &CENTRES);
    let observations = network["observations"].as_array_mut().unwrap();
    for (k, seen) in observations.iter_mut().enumerate() {
        // Up to 0.1 px, the a-priori standard deviation, without a pattern.
        for (axis, factor) in [(2, 0.137), (3, 0.731)] {
            let error = 0.17 * ((k as f64 * factor * 10.0).fract() - 0.5) * 2.0;
            seen[axis] = json!(seen[axis].as_f64().unwrap() + error);
        }
    }
    let between = |a: usize, b: usize| {
        let [a, b] = [a, b].map(|k| places()[k]);
        (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
    };
    network["distances"].as_array_mut().unwrap().push(
        json!({"name": "check", "from": "P4", "to": "P7", "length_mm": between(4, 7), "sigma_mm": 0.02, "role": "check"}),
    );
    network
}

/// What it answers about the network in the folder with these further arguments.
fn adjusted(folder: &Folder, more: &[&str]) -> Value {
    let arguments = [&["adjust", "--network", "net.json", "--json"], more].concat();
    folder.run(&arguments).json()
}

#[test]
fn distances_and_angles_have_their_standard_deviations() {
    let folder = Folder::new("derived");
    folder.write("net.json", network().to_string());
    let report = adjusted(
        &folder,
        &[
            "--distance",
            "P0,P11",
            "--distance",
            "P4,P7",
            "--angle",
            "P0,P5,P3",
        ],
    );
    let derived = report["derived"].as_array().unwrap();
    assert_eq!(derived.len(), 3);
    let number = |row: &Value, key: &str| row[key].as_f64().unwrap();
    for (row, unit) in derived.iter().zip(["mm", "mm", "deg"]) {
        assert_eq!(row["unit"], unit);
        assert!(number(row, "sigma") > 0.0);
    }
    let [a, b] = [places()[0], places()[11]];
    let truth = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
    let off = number(&derived[0], "value") - truth;
    assert!(off.abs() < 5.0 * number(&derived[0], "sigma"), "{off}");
    // The check distance is the same quantity.
    let check = &report["check_distances"][0];
    assert_eq!(check["distance"], "check");
    assert_eq!(number(check, "sigma_mm"), number(&derived[1], "sigma"));
    assert!(number(check, "test").abs() < 5.0);
}

#[test]
fn the_datum_changes_sigmas_and_nothing_that_was_measured() {
    let folder = Folder::new("datum");
    folder.write("net.json", network().to_string());
    let with = |datum: &str| adjusted(&folder, &["--distance", "P0,P11", "--datum", datum]);
    let [all, few] = ["all", "P0,P3,P8,P11"].map(with);
    for key in ["value", "sigma"] {
        let [a, b] = [&all, &few].map(|r| r["derived"][0][key].as_f64().unwrap());
        assert!((a - b).abs() < 1e-9 * a.abs(), "{key}: {a} {b}");
    }
    assert_ne!(all["points"][5]["sigma_mm"], few["points"][5]["sigma_mm"]);
    let answer = folder.run(&["adjust", "--network", "net.json", "--datum", "P0,P99"]);
    answer.refused(2, &["--datum", "'P99'"]);
    let answer = folder.run(&["adjust", "--network", "net.json", "--datum", "P0,P11"]);
    answer.refused(2, &["--datum", "found 2 points", "three or more"]);
    let answer = folder.run(&["adjust", "--network", "net.json", "--angle", "P0,P1"]);
    answer.refused(2, &["--angle", "found 2 names", "expected 3"]);
}

#[test]
fn what_cannot_be_compared_or_told_is_said() {
    let folder = Folder::new("not-compared");
    let mut network = network();
    let check = places()[5];
    let known = check.map(|value| json!({"value_mm": value, "sigma_mm": 0.01}));
    network["points"][5]["known"] = json!(known);
    network["points"][5]["role"] = json!("check");
    folder.write("net.json", network.to_string());
    let report = adjusted(&folder, &["--datum", "all"]);
    let findings = report["findings"].to_string();
    assert!(
        findings.contains("check points: not compared: found 1 in a free network"),
        "{findings}"
    );
    let answer = folder.run(&["adjust", "--network", "net.json", "--distance", "P3,P3"]);
    answer.refused(2, &["--distance", "found 'P3' again"]);
}

#[test]
fn the_whole_covariance_matrix_is_written() {
    let folder = Folder::new("covariance");
    folder.write("net.json", network().to_string());
    let report = adjusted(&folder, &["--covariance", "q.csv"]);
    let text = folder.text("q.csv");
    let rows: Vec<Vec<&str>> = text.lines().map(|l| l.split(',').collect()).collect();
    let names = &rows[0][1..];
    // A camera, six stations, twelve points.
    assert_eq!(names.len(), 10 + 6 * 6 + 12 * 3);
    let at = |name: &str| names.iter().position(|n| *n == name).unwrap();
    let entry = |i: usize, j: usize| rows[i + 1][j + 1].parse::<f64>().unwrap();
    let x = at("P5 x");
    let sigma = report["points"][5]["sigma_mm"][0].as_f64().unwrap();
    assert!((entry(x, x).sqrt() - sigma).abs() < 1e-9 * sigma);
    let station = at("I2 turn_x");
    assert_eq!(entry(x, station), entry(station, x));
}

#[test]
fn reliability_is_told() {
    let folder = Folder::new("reliability");
    folder.write("net.json", network().to_string());
    let report = adjusted(&folder, &[]);
    let sigma0 = report["sigma0"].as_f64().unwrap();
    let reliability = &report["reliability"];
    assert_eq!(reliability["residuals"], 2 * 72);
    assert_eq!(reliability["sigma0"]["verdict"], "as-expected");
    let component = &reliability["components"][0];
    // All of the redundancy that counts is in the image points.
    let factor = component["factor"].as_f64().unwrap();
    assert!((factor - sigma0).abs() < 0.02 * sigma0, "{factor} {sigma0}");
    for row in report["image_points"].as_array().unwrap() {
        for axis in 0..2 {
            let r = row["redundancy"][axis].as_f64().unwrap();
            let smallest = row["smallest_detectable_px"][axis].as_f64().unwrap();
            assert!((smallest - 4.1321 * 0.1 / r.sqrt()).abs() < 1e-4);
            assert!(row["effect_mm"][axis].as_f64().unwrap() > 0.0);
        }
    }
    let again = adjusted(&folder, &["--components"]);
    assert!((again["sigma0"].as_f64().unwrap() - 1.0).abs() < 1e-3);
    let answer = folder.run(&["adjust", "--network", "net.json"]);
    let text = answer.done();
    assert!(
        text.contains("chi-square test at 5 %: residuals are as large as"),
        "{text}"
    );
}

#[test]
fn gross_errors_are_found_by_each_test() {
    let folder = Folder::new("tests");
    let mut network = network();
    let seen = &mut network["observations"][17];
    seen[2] = json!(seen[2].as_f64().unwrap() + 3.0);
    let expected = [seen[0].clone(), seen[1].clone()];
    folder.write("net.json", network.to_string());
    for test in ["robust", "w", "tau"] {
        let report = adjusted(&folder, &["--reject", "--test", test]);
        let rows = report["image_points"].as_array().unwrap();
        let rejected: Vec<_> = rows.iter().filter(|r| r["status"] == "rejected").collect();
        assert_eq!(rejected.len(), 1, "{test}");
        assert_eq!(
            [&rejected[0]["image"], &rejected[0]["point"]],
            [&expected[0], &expected[1]]
        );
    }
}
