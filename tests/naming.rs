//! Plain targets get the names of a list, in a project without pictures.

mod common;

use std::fmt::Write as _;

use common::Folder;
use nalgebra::{Rotation3, Vector3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tiepoint::geometry::OmegaPhiKappa;
use tiepoint::project::session::Session;
use tiepoint::project::storage::Store;

/// Principal distance, mm.
const C_MM: f64 = 28.8;
/// Targets M1, M2, ... of the object.
const TARGETS: usize = 30;
/// Codes, of each of which the dot O is measured.
const CODES: usize = 4;
/// Errors of the image points, mm: a tenth of a pixel.
const NOISE_MM: f64 = 0.0004;

/// Labels and places of a small object, mm.
fn object() -> Vec<(String, Vector3<f64>)> {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let size = [400.0, 300.0, 150.0];
    let mut place = || Vector3::from(size.map(|size| random.random_range(-size / 2.0..size / 2.0)));
    let targets = (1..=TARGETS).map(|number| format!("M{number}"));
    let codes = (1..=CODES).map(|code| format!("C{code}.O"));
    targets.chain(codes).map(|label| (label, place())).collect()
}

/// Where the eight pictures were taken from: all sides, turned about their axes.
fn orientations() -> Vec<(OmegaPhiKappa, Vector3<f64>)> {
    let angles = (0..8).map(f64::from).map(|k| OmegaPhiKappa {
        omega: 0.5 * (k * 0.8).sin(),
        phi: 0.5 * (k * 0.8).cos(),
        kappa: k * std::f64::consts::FRAC_PI_2,
    });
    let stand = |angles: OmegaPhiKappa| {
        let away = Vector3::new(0.0, 0.0, 900.0);
        (angles, angles.rotation().inverse() * away)
    };
    angles.map(stand).collect()
}

/// A bundle of the object as its files, with the distance from M1 to M2.
fn write_bundle(folder: &Folder) {
    let object = object();
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let (mut points, mut images, mut seen) = (String::new(), String::new(), String::new());
    for (label, place) in &object {
        let [x, y, z] = [place.x, place.y, place.z];
        writeln!(points, "{label} {x} {y} {z} .1 .1 .1 8 1 1 0").unwrap();
    }
    for (image, (angles, centre)) in orientations().iter().enumerate() {
        let [x, y, z] = [centre.x, centre.y, centre.z];
        let OmegaPhiKappa { omega, phi, kappa } = angles;
        writeln!(images, "{image} 1 {x} {y} {z} {omega} {phi} {kappa} 0 34 3").unwrap();
        for (label, place) in &object {
            let ray = angles.rotation() * (place - centre);
            let [x, y] = [ray.x, ray.y]
                .map(|side| -C_MM * side / ray.z + random.random_range(-NOISE_MM..NOISE_MM));
            writeln!(seen, "{image} {label} {x} {y} 0 0 0 0 1 1 1").unwrap();
        }
    }
    let length = (object[0].1 - object[1].1).norm();
    folder.write(
        "b.ior",
        format!("1 -999 -{C_MM} 0 0 0 0 13\n0\n0 0\n0 0\n36 24 9000 6000\n"),
    );
    folder.write("b.eor", images);
    folder.write("b.obc", points);
    folder.write("b.phc", seen);
    folder.write("b.scale", format!("0 \"Bar\" M1 M2 {length} 0.01 1\n"));
}

/// A folder with the object's project, measured.
fn measured(name: &str) -> Folder {
    let folder = Folder::new(name);
    write_bundle(&folder);
    folder
        .run(&["import", "--from", "aicon", ".", "p.tiepoint"])
        .done();
    folder.run(&["run", "p.tiepoint"]).done();
    folder
}

/// The object's places in another frame, to 0.3 mm, under the names that `name` gives their labels.
fn list(name: impl Fn(&str) -> String) -> String {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let turn = Rotation3::from_euler_angles(1.0, 0.3, -2.0);
    let mut text = "label,x_mm,y_mm,z_mm\n".to_owned();
    for (label, place) in object() {
        let error = Vector3::from_fn(|_, _| random.random_range(-0.3..0.3));
        let place = turn * place + error + Vector3::new(5000.0, 200.0, -70.0);
        writeln!(text, "{},{},{},{}", name(&label), place.x, place.y, place.z).unwrap();
    }
    text
}

/// `M7` is `P.7`; codes keep their labels.
fn of_targets(label: &str) -> String {
    label.replace('M', "P.")
}

const NAME: [&str; 4] = ["name", "p.tiepoint", "--reference", "names.csv"];

#[test]
fn a_list_in_another_frame_names_the_targets_of_a_project() {
    let folder = measured("named");
    folder.write("names.csv", list(of_targets));
    let arguments = [&NAME[..], &["--json"]].concat();
    let named = folder.run(&arguments).json();
    assert_eq!(named["way"], "labels");
    assert_eq!(named["named"]["points"], TARGETS);
    assert!(named["fit"]["rms_mm"].as_f64().is_some_and(|rms| rms < 0.3));
    for given in named["differences"].as_array().unwrap() {
        let (label, name) = (given["label"].as_str(), given["reference"].as_str());
        assert_eq!(of_targets(label.unwrap()), name.unwrap());
    }

    // Every table knows the names, and so do the bar and a comparison by label; nothing is older than its inputs.
    folder
        .run(&[
            "export",
            "p.tiepoint",
            "--points",
            "points.csv",
            "--observations",
            "seen.csv",
        ])
        .done();
    assert!(folder.text("points.csv").contains("\nP.7,target,"));
    assert!(folder.text("seen.csv").contains(",P.7,"));
    let compare = [
        "compare",
        "p.tiepoint",
        "--reference",
        "names.csv",
        "--json",
    ];
    assert_eq!(folder.run(&compare).json()["points"], TARGETS + CODES);
    let opened = Store::open_read_only(&folder.at("p.tiepoint")).unwrap();
    let bar = &opened.network.scale_bars[0];
    assert_eq!((bar.from.as_str(), bar.to.as_str()), ("P.1", "P.2"));
    let done = |what: &str| opened.journal.iter().any(|entry| entry.line.what == what);
    assert!(
        done(&format!("name {TARGETS} targets")),
        "{:?}",
        opened.journal
    );
    let run = folder.run(&["run", "p.tiepoint", "--json"]).json();
    assert_eq!(run["scale_from"], "bars");

    // A second time there is nothing to name.
    let again = folder.run(&NAME);
    let lines: Vec<&str> = again.done().lines().collect();
    assert_eq!(lines[0], "p.tiepoint: 0 targets named");
    assert!(
        lines.contains(&format!("{:<22}{TARGETS:>7}", "had their name").as_str()),
        "{again:?}"
    );
}

#[test]
fn without_labels_the_geometry_names_and_other_names_give_way_when_asked() {
    let folder = measured("by-geometry");
    folder.write("names.csv", list(|label| format!("first {label}")));
    let named = folder.run(&[&NAME[..], &["--json"]].concat()).json();
    assert_eq!(named["way"], "geometry");
    assert_eq!(named["named"]["points"], TARGETS);
    let left = named["reference_left"].as_array().unwrap();
    assert_eq!(left.len(), CODES);
    assert!(
        left.iter().all(|left| left["reason"] == "on-dot"),
        "{left:?}"
    );

    folder.write("names.csv", list(|label| format!("second {label}")));
    let kept = folder.run(&NAME);
    assert!(kept.done().starts_with("p.tiepoint: 0 targets named\n"));
    assert!(
        kept.stdout
            .contains("second M7 lies at 'first M7', which keeps its name")
    );
    folder.run(&[&NAME[..], &["--rename"]].concat()).done();
    let opened = Store::open_read_only(&folder.at("p.tiepoint")).unwrap();
    assert_eq!(opened.network.names[&7], "second M7");
    drop(opened);
    let mut session = Session::open(&folder.at("p.tiepoint")).unwrap();
    let edit = tiepoint::project::edit::Edit::RenameTarget {
        target: 7,
        name: None,
    };
    session.apply(&edit).unwrap();
    assert_eq!(
        session.undo().unwrap().as_deref(),
        Some("take the name of 'second M7' away")
    );
    assert_eq!(session.network().names[&7], "second M7");
}

#[test]
fn what_cannot_be_named_is_answered_in_one_line_and_changes_nothing() {
    let folder = measured("not-named");
    let before = folder.read("p.tiepoint");
    let row = |k: usize| format!("G{k},{},{},0\n", k % 6 * 50, k / 6 * 50);
    let grid: String = (0..24).map(row).collect();
    folder.write("grid.csv", format!("label,x_mm,y_mm,z_mm\n{grid}"));
    folder.write("short.csv", "label,x_mm,y_mm,z_mm\nA,1,2,3\nB,4,5,\n");
    folder.write("twice.csv", "label,x_mm,y_mm,z_mm\nA,1,2,3\nA,4,5,6\n");
    folder.write("bad.csv", "label,x_mm,y_mm,z_mm\nA,1,b,3\n");
    folder.write("names.csv", list(of_targets));
    for (status, arguments, words) in [
        (
            2,
            &["p.tiepoint", "--reference", "gone.csv"][..],
            ["gone.csv", "cannot be read"],
        ),
        (
            2,
            &["gone.tiepoint", "--reference", "names.csv"],
            ["gone.tiepoint", "found"],
        ),
        (
            2,
            &["p.tiepoint", "--reference", "bad.csv"],
            ["bad.csv, line 2, column 3 (y_mm)", "found 'b'"],
        ),
        (
            2,
            &["p.tiepoint", "--reference", "twice.csv"],
            ["twice.csv, line 3", "found the label A again"],
        ),
        (
            2,
            &["p.tiepoint", "--reference", "names.csv", "--within", "-1"],
            ["found a distance of -1 mm", "expected a number above 0"],
        ),
        (2, &["p.tiepoint"], ["--reference", "required"]),
        (
            1,
            &["p.tiepoint", "--reference", "short.csv"],
            ["p.tiepoint: naming: found", "1 reference points"],
        ),
        (
            1,
            &["p.tiepoint", "--reference", "grid.csv"],
            [
                "found 0 labels in common and no pose",
                "expected 3 common labels",
            ],
        ),
    ] {
        let arguments = [&["name"][..], arguments].concat();
        folder.run(&arguments).refused(status, &words);
    }
    assert!(folder.read("p.tiepoint") == before);
    let fresh = Folder::new("not-measured");
    write_bundle(&fresh);
    fresh
        .run(&["import", "--from", "aicon", ".", "p.tiepoint"])
        .done();
    fresh.write("names.csv", list(of_targets));
    fresh
        .run(&NAME)
        .refused(1, &["p.tiepoint: naming: there is no adjustment yet"]);
}
