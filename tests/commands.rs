//! Every command as a program that calls it sees it: keys, headers, texts.

mod common;

use std::collections::BTreeMap;

use common::rays::{CENTRES, network_of_rays, places};
use common::{Folder, HEIGHT_PX, IMAGES, NEW, WIDTH_PX, scene};
use serde_json::Value;
use tiepoint::synthetic::TruthDot;

const STAGES: [&str; 6] = [
    "detect",
    "first-pair",
    "connect",
    "adjust-codes",
    "identify",
    "adjust",
];

/// A detected dot lies this near to where it truly is, px: six of the largest sigmas of such small dots.
const NEAR_PX: f64 = 0.3;

/// The keys of an object, in the order written.
fn keys(text: &str, value: &Value) -> Vec<String> {
    let mut keys: Vec<String> = value.as_object().unwrap().keys().cloned().collect();
    keys.sort_by_key(|key| text.find(&format!("\"{key}\"")).unwrap());
    keys
}

/// The rows of a table by the names of its header.
fn rows(text: &str) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    reader.deserialize().map(Result::unwrap).collect()
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column]
        .parse()
        .unwrap_or_else(|e| panic!("{column}: {e} in {row:?}"))
}

fn truth(image: &str) -> BTreeMap<String, TruthDot> {
    let mut truth = scene().experiment.truth();
    let dots = truth.images.remove(image).unwrap();
    dots.into_iter()
        .map(|dot| (dot.label.clone(), dot))
        .collect()
}

#[test]
fn help_and_version_are_results() {
    let folder = Folder::new("help");
    let help = folder.run(&["--help"]);
    for command in [
        "demo", "new", "add", "exclude", "run", "detect", "export", "compare", "codes", "adjust",
    ] {
        assert!(help.done().contains(&format!("\n  {command}")), "{help:?}");
        let own = folder.run(&[command, "--help"]);
        assert!(
            own.done().contains(&format!("Usage: tiepoint {command}")),
            "{own:?}"
        );
    }
    let version = folder.run(&["--version"]);
    assert_eq!(
        version.done(),
        format!("tiepoint {}\n", env!("CARGO_PKG_VERSION"))
    );
}

#[test]
fn without_a_display_a_window_is_refused_in_one_line_and_the_demo_is_not() {
    let folder = Folder::new("display");
    folder.run(&[]).refused(3, &["found no display"]);
    folder
        .run(&["nowhere.tiepoint"])
        .refused(2, &["nowhere.tiepoint", "found no file"]);
    // A folder that cannot be made ends the demo early, after its line on the display.
    folder.write("file", "");
    let demo = folder.run(&["demo", "file/inside"]);
    assert_eq!(demo.status, Some(2), "{demo:?}");
    let lines: Vec<&str> = demo.stderr.lines().collect();
    assert_eq!(lines.len(), 2, "{demo:?}");
    assert!(
        lines[0].contains("found no display") && lines[0].contains("headless"),
        "{demo:?}"
    );
}

#[test]
fn new_add_and_exclude_count_images() {
    let folder = Folder::with_scene("count");
    assert_eq!(
        folder.run(&NEW).done(),
        format!("p.tiepoint: {IMAGES} images\n")
    );
    let name = |index: usize| format!("images/{}", scene().pictures[index].0);
    let exclude = folder.run(&["exclude", "p.tiepoint", "--images", &name(0), &name(1)]);
    assert_eq!(exclude.done(), "p.tiepoint: 2 images excluded\n");
    let again = folder.run(&["exclude", "p.tiepoint", "--images", &name(0)]);
    assert_eq!(again.done(), "p.tiepoint: 0 images excluded\n");
    let add = folder.run(&["add", "p.tiepoint", "--images", &name(0)]);
    assert_eq!(add.done(), "p.tiepoint: 1 images added\n");
    let all = folder.run(&["exclude", "p.tiepoint", "--images", "images"]);
    assert_eq!(
        all.done(),
        format!("p.tiepoint: {} images excluded\n", IMAGES - 1)
    );
    // Pictures that are gone by now can be excluded by any path, and what comes back is where it lies now.
    folder
        .run(&["add", "p.tiepoint", "--images", "images"])
        .done();
    let (here, there) = (folder.at(&name(1)), folder.at("moved.png"));
    std::fs::rename(&here, &there).unwrap();
    let gone = folder.run(&["exclude", "p.tiepoint", "--images", &here.to_string_lossy()]);
    assert_eq!(gone.done(), "p.tiepoint: 1 images excluded\n");
    let moved = folder.run(&["add", "p.tiepoint", "--images", "moved.png"]);
    assert_eq!(moved.done(), "p.tiepoint: 1 images added\n");
    let by_its_place = folder.run(&["exclude", "p.tiepoint", "--images", "./moved.png"]);
    assert_eq!(by_its_place.done(), "p.tiepoint: 1 images excluded\n");
    // The file of one image is not taken for the picture of another.
    std::fs::copy(&there, folder.at(&name(2))).unwrap();
    folder
        .run(&["add", "p.tiepoint", "--images", &name(2)])
        .refused(2, &[&name(2)]);
    let single = folder.run(&["new", "q.tiepoint", "--images", &name(3), &name(4)]);
    assert_eq!(single.done(), "q.tiepoint: 2 images\n");
}

#[test]
fn run_stops_after_the_stage_it_was_told() {
    let folder = Folder::with_scene("until");
    folder.run(&NEW).done();
    for (count, stage) in (1..).zip(STAGES) {
        let answer = folder.run(&["run", "p.tiepoint", "--until", stage, "--json"]);
        let summary = answer.json();
        let told: Vec<&str> = summary["stages"]
            .as_array()
            .unwrap()
            .iter()
            .map(|run| run["stage"].as_str().unwrap())
            .collect();
        assert_eq!(told, STAGES[..count]);
        assert_eq!(
            summary["stages"][count - 1]["outcome"],
            "done",
            "{summary:#}"
        );
        let oriented = summary["images_oriented"].as_u64().unwrap() as usize;
        match stage {
            "detect" => assert_eq!(oriented, 0),
            "first-pair" => assert_eq!(oriented, 2),
            _ => assert_eq!(oriented, IMAGES, "{summary:#}"),
        }
        assert!(answer.stderr.ends_with(" s)\n"), "{answer:?}");
    }
}

#[test]
fn run_json_has_the_keys_of_the_contract() {
    let folder = Folder::with_measured("run-json");
    let answer = folder.run(&["run", "p.tiepoint", "--json"]);
    let summary = answer.json();
    let expected = [
        "stages",
        "images",
        "images_oriented",
        "targets",
        "labelled",
        "points",
        "sigma0",
        "sigma0_px",
        "rms_px",
        "sigma_station_mm",
        "redundancy",
        "scale_from",
        "findings",
    ];
    assert_eq!(keys(&answer.stdout, &summary), expected);
    for run in summary["stages"].as_array().unwrap() {
        assert_eq!(keys(&answer.stdout, run), ["stage", "seconds", "outcome"]);
        assert!(run["seconds"].is_f64());
    }
    for finding in summary["findings"].as_array().unwrap() {
        assert_eq!(keys(&answer.stdout, finding), ["kind", "about", "text"]);
    }
    assert_eq!(summary["images"], IMAGES);
    assert_eq!(summary["scale_from"], "bars");
    assert!(
        (0.8..1.2).contains(&summary["sigma0"].as_f64().unwrap()),
        "{summary:#}"
    );
    assert!(summary["redundancy"].as_i64().unwrap() > 100);
    assert!(summary["labelled"].as_u64() <= summary["targets"].as_u64());
    assert!(summary["points"].as_u64().unwrap() > 100);

    let text = folder.run(&["run", "p.tiepoint"]);
    for (line, stage) in text.done().lines().zip(STAGES) {
        assert!(line.starts_with(stage) && line.ends_with("done"), "{line}");
    }
    assert!(
        text.stdout
            .contains(&format!("{IMAGES} oriented of {IMAGES}")),
        "{}",
        text.stdout
    );
    assert!(
        text.stdout.contains("scale from    bars"),
        "{}",
        text.stdout
    );
}

#[test]
fn detect_json_is_the_contract_to_the_letter() {
    let folder = Folder::with_scene("detect");
    let names: Vec<&str> = scene().pictures[..2]
        .iter()
        .map(|(n, _)| n.as_str())
        .collect();
    let paths = [
        format!("images/{}", names[0]),
        format!("images/{}", names[1]),
    ];
    let answer = folder.run(&[
        "detect",
        &paths[0],
        &paths[1],
        "--json",
        "--camera",
        "camera.toml",
    ]);
    let reports = answer.json();
    assert_eq!(reports.as_array().unwrap().len(), 2);
    for (report, (path, name)) in reports
        .as_array()
        .unwrap()
        .iter()
        .zip(paths.iter().zip(&names))
    {
        let text = answer.stdout.as_str();
        let expected = [
            "image",
            "width_px",
            "height_px",
            "codes",
            "targets",
            "rejected",
        ];
        assert_eq!(keys(text, report), expected);
        assert_eq!(report["image"], path.as_str());
        assert_eq!(
            [&report["width_px"], &report["height_px"]],
            [WIDTH_PX, HEIGHT_PX]
        );
        let truth = truth(name);
        let codes = report["codes"].as_array().unwrap();
        assert!(codes.len() >= 4, "{report:#}");
        let targets = report["targets"].as_array().unwrap();
        for code in codes {
            let expected = [
                "family",
                "id",
                "label",
                "dots",
                "doubt",
                "fit",
                "margin",
                "rivals",
                "rival_odds",
                "foreign_dots",
                "departing_segments",
            ];
            let mut found: Vec<&str> = code
                .as_object()
                .unwrap()
                .keys()
                .map(String::as_str)
                .collect();
            let mut expected = expected.to_vec();
            found.sort_unstable();
            expected.sort_unstable();
            assert_eq!(found, expected);
            assert_eq!(code["family"], "dot420");
            assert_eq!(code["label"], format!("C{}", code["id"]));
            let dots = code["dots"].as_array().unwrap();
            let names: Vec<&str> = dots.iter().map(|d| d["name"].as_str().unwrap()).collect();
            assert_eq!(names, ["O", "A", "B", "1", "2", "3"]);
            for dot in dots {
                assert_eq!(dot.as_object().unwrap().len(), 4);
                let label = format!(
                    "{}.{}",
                    code["label"].as_str().unwrap(),
                    dot["name"].as_str().unwrap()
                );
                assert_near(dot, &truth[&label]);
                let own = targets.iter().filter(|t| t["label"] == label.as_str());
                let places: Vec<_> = own
                    .map(|t| (&t["x_px"], &t["y_px"], &t["sigma_px"]))
                    .collect();
                assert_eq!(
                    places,
                    [(&dot["x_px"], &dot["y_px"], &dot["sigma_px"])],
                    "{label}"
                );
            }
        }
        let labelled = targets.iter().filter(|t| t["label"].is_string()).count();
        assert_eq!(labelled, 6 * codes.len());
        for target in targets {
            assert_eq!(target.as_object().unwrap().len(), 7);
            for key in [
                "x_px",
                "y_px",
                "sigma_px",
                "major_px",
                "minor_px",
                "angle_deg",
            ] {
                assert!(target[key].is_f64(), "{key}: {target}");
            }
            assert!(target["label"].is_string() || target["label"].is_null());
            assert!(target["major_px"].as_f64() >= target["minor_px"].as_f64());
            assert!(target["sigma_px"].as_f64().unwrap() > 0.0);
            assert!(
                truth.values().any(|dot| distance(target, dot) < NEAR_PX),
                "{target}"
            );
        }
        for place in report["rejected"].as_array().unwrap() {
            assert_eq!(place.as_object().unwrap().len(), 3);
            assert!(
                place["reason"].is_string() && place["x_px"].is_f64() && place["y_px"].is_f64()
            );
        }
    }
    let one = folder.run(&["detect", &paths[0], "--codes", "dot420,ring14"]);
    let line = one.done();
    assert_eq!(line.lines().count(), 1);
    let codes = reports[0]["codes"].as_array().unwrap().len();
    let targets = reports[0]["targets"].as_array().unwrap().len();
    let start = format!(
        "{}: {WIDTH_PX} x {HEIGHT_PX} px, {targets} targets, {codes} codes (C",
        paths[0]
    );
    assert!(line.starts_with(&start), "{line}");
    let rings = folder
        .run(&["detect", &paths[0], "--codes", "ring14", "--json"])
        .json();
    assert_eq!(rings[0]["codes"], serde_json::json!([]));
}

/// Distance of a measured dot from the true image of the circle, px.
fn distance(dot: &Value, truth: &TruthDot) -> f64 {
    let measured = ["x_px", "y_px"].map(|key| dot[key].as_f64().unwrap());
    let centre = truth.centre_of_image_px;
    centre.map_or(f64::INFINITY, |c| {
        (measured[0] - c.x).hypot(measured[1] - c.y)
    })
}

#[track_caller]
fn assert_near(dot: &Value, truth: &TruthDot) {
    assert!(distance(dot, truth) < NEAR_PX, "{dot} {truth:?}");
}

#[test]
fn export_writes_the_tables_of_the_contract() {
    let folder = Folder::with_measured("export");
    let summary = folder.run(&["run", "p.tiepoint", "--json"]).json();
    let answer = folder.run(&[
        "export",
        "p.tiepoint",
        "--points",
        "points.csv",
        "--observations",
        "observations.csv",
        "--stations",
        "stations.csv",
        "--cameras",
        "cameras.toml",
    ]);
    assert_eq!(answer.done(), "");
    for (table, header) in [
        (
            "points.csv",
            "label,kind,x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm,rays",
        ),
        (
            "observations.csv",
            "image,label,x_px,y_px,sigma_px,vx_px,vy_px,redundancy,test,status,source,reason,ecc_x_px,ecc_y_px",
        ),
        (
            "stations.csv",
            "image,x_mm,y_mm,z_mm,m11,m12,m13,m21,m22,m23,m31,m32,m33,omega_deg,phi_deg,kappa_deg,\
             sigma_x_mm,sigma_y_mm,sigma_z_mm,sigma_omega_deg,sigma_phi_deg,sigma_kappa_deg",
        ),
    ] {
        let text = folder.text(table);
        assert!(
            text.starts_with(header),
            "{table}: {:?}",
            text.lines().next()
        );
    }
    let points = rows(&folder.text("points.csv"));
    assert_eq!(points.len(), summary["points"].as_u64().unwrap() as usize);
    for row in &points {
        let kind = match row["label"].as_bytes()[0] {
            b'C' => "code",
            b'M' => "target",
            _ => "cross",
        };
        assert_eq!(row["kind"], kind, "{row:?}");
        for column in ["x_mm", "y_mm", "z_mm"] {
            assert!(number(row, column).is_finite());
            assert!(number(row, &format!("sigma_{column}")) > 0.0, "{row:?}");
        }
        assert!(number(row, "rays") >= 2.0, "{row:?}");
    }
    check_observations(&rows(&folder.text("observations.csv")), &summary);
    let stations = rows(&folder.text("stations.csv"));
    assert_eq!(stations.len(), IMAGES);
    for row in &stations {
        check_angles(row);
    }
    let first = format!("images/{}", scene().pictures[0].0);
    assert!(stations.iter().any(|row| row["image"] == first));
    // What was exported can be given to a new project.
    folder
        .run(&[
            "new",
            "q.tiepoint",
            "--images",
            "images",
            "--camera",
            "cameras.toml",
        ])
        .done();
}

fn check_observations(rows: &[BTreeMap<String, String>], summary: &Value) {
    assert_eq!(rows.len(), summary["targets"].as_u64().unwrap() as usize);
    let labelled = rows.iter().filter(|row| !row["label"].is_empty()).count();
    assert_eq!(labelled, summary["labelled"].as_u64().unwrap() as usize);
    let mut redundancy = 0.0;
    for row in rows {
        assert_eq!(row["source"], "automatic");
        assert!(number(row, "sigma_px") > 0.0 && number(row, "x_px") > 0.0);
        match row["status"].as_str() {
            "used" => {
                assert!(
                    !row["label"].is_empty() && row["reason"].is_empty(),
                    "{row:?}"
                );
                assert!((0.0..=2.0).contains(&number(row, "redundancy")), "{row:?}");
                redundancy += number(row, "redundancy");
                assert!(
                    number(row, "vx_px").hypot(number(row, "vy_px")) < 1.0,
                    "{row:?}"
                );
                assert!(number(row, "test") >= 0.0);
            }
            "rejected" => assert!(
                !row["label"].is_empty() && !row["reason"].is_empty(),
                "{row:?}"
            ),
            "unlabelled" => assert!(
                row["label"].is_empty() && !row["reason"].is_empty(),
                "{row:?}"
            ),
            other => panic!("status {other}"),
        }
    }
    // Bars and lens priors have the rest of the redundancy: at most one each.
    let all = summary["redundancy"].as_f64().unwrap();
    assert!(
        (all - 20.0..=all + 0.1).contains(&redundancy),
        "{redundancy} of {all}"
    );
}

/// The angles make the matrix, by the formulae of the contract.
fn check_angles(row: &BTreeMap<String, String>) {
    let [omega, phi, kappa] =
        ["omega_deg", "phi_deg", "kappa_deg"].map(|column| number(row, column).to_radians());
    for (column, value) in [
        ("m31", phi.sin()),
        ("m32", -phi.cos() * omega.sin()),
        ("m33", phi.cos() * omega.cos()),
        ("m11", phi.cos() * kappa.cos()),
        ("m21", -phi.cos() * kappa.sin()),
    ] {
        // Angles are printed to a millionth of a degree or finer.
        assert!(
            (number(row, column) - value).abs() < 1e-7,
            "{column} of {row:?}"
        );
    }
}

#[test]
fn compare_finds_the_truth_again() {
    let folder = Folder::with_measured("compare");
    let compare = ["compare", "p.tiepoint", "--reference", "reference.csv"];
    let answer = folder.run(&[&compare[..], &["--json"]].concat());
    let comparison = answer.json();
    let points = comparison["points"].as_u64().unwrap();
    assert!(points > 100, "{points}");
    // Some 0.02 px on an object of a metre in pictures of 1200 px: a twentieth of a millimetre, more along the rays.
    let rms = comparison["rms_mm"].as_f64().unwrap();
    assert!(rms < 0.1, "{rms} mm");
    for axis in ["rms_x_mm", "rms_y_mm", "rms_z_mm"] {
        assert!(
            comparison[axis].as_f64().unwrap() <= 3f64.sqrt() * rms,
            "{axis}"
        );
    }
    assert!(comparison["largest_mm"].as_f64().unwrap() >= rms);
    assert!(comparison["largest_label"].is_string());
    assert_eq!(comparison["with_scale"], false);
    assert_eq!(comparison["scale"], 1.0);
    assert_eq!(comparison["scale_from"], "bars");
    let by_place = comparison["by_place"]["points"].as_u64().unwrap();
    assert!(by_place >= 10, "{by_place} plain targets by place");
    assert!(comparison["place_distance_mm"].as_f64().unwrap() > 0.0);
    let differences = comparison["differences"].as_array().unwrap();
    assert_eq!(differences.len() as u64, points + by_place);

    let scaled = folder
        .run(&[&compare[..], &["--json", "--with-scale"]].concat())
        .json();
    assert_eq!(scaled["with_scale"], true);
    assert!(
        (scaled["scale"].as_f64().unwrap() - 1.0).abs() < 1e-3,
        "{}",
        scaled["scale"]
    );
    assert!(scaled["rms_mm"].as_f64().unwrap() <= rms * (1.0 + 1e-9));

    let text = folder.run(&compare);
    assert!(
        text.done()
            .starts_with("best fit onto the reference: six parameters"),
        "{text:?}"
    );
    for words in ["by label", "by place", "rms x", "largest"] {
        assert!(text.stdout.contains(words), "{words}: {}", text.stdout);
    }
}

#[test]
fn codes_have_as_many_rows_as_codes() {
    let folder = Folder::new("codes");
    for (family, header, count) in [
        ("dot420", "id,x1,y1,x2,y2,x3,y3", 420),
        ("ring12", "id,pattern", 147),
        ("ring14", "id,pattern", 516),
        ("ring20", "id,pattern", 24_793),
    ] {
        folder
            .run(&["codes", "--table", "codes.csv", "--family", family])
            .done();
        let text = folder.text("codes.csv");
        assert_eq!(text.lines().next(), Some(header));
        let rows = rows(&text);
        assert_eq!(rows.len(), count, "{family}");
        for (row, id) in rows.iter().zip(1..) {
            assert_eq!(row["id"], id.to_string());
        }
    }
    // Without a family it is that of the paper.
    folder.run(&["codes", "--table", "codes.csv"]).done();
    assert_eq!(folder.text("codes.csv").lines().count(), 421);
    folder
        .run(&["codes", "--table", "codes.csv", "--family", "ring14"])
        .done();
    assert!(
        folder
            .text("codes.csv")
            .starts_with("id,pattern\n1,129\n2,135\n3,139\n")
    );
}

#[test]
fn adjust_tells_of_a_network_without_pictures() {
    let folder = Folder::new("adjust");
    // Three images of eight points, and a point that is seen once.
    let mut network = network_of_rays(&places()[..8], &CENTRES[..3]);
    let lost = serde_json::json!({"name": "lost"});
    network["points"].as_array_mut().unwrap().push(lost);
    let seen = serde_json::json!(["I0", "lost", 100.0, 100.0]);
    network["observations"].as_array_mut().unwrap().push(seen);
    folder.write("net.json", network.to_string());
    let report = folder
        .run(&["adjust", "--network", "net.json", "--json"])
        .json();
    // 24 image points and a bar; three stations and eight points, six motions that nothing fixes.
    assert_eq!(report["redundancy"], 2 * 24 + 1 - (18 + 24) + 6);
    assert_eq!(report["datum_defect"], 6);
    assert_eq!(report["points"].as_array().unwrap().len(), 8);
    assert!(report["sigma0"].as_f64().unwrap() < 1e-6, "{report}");
    assert_eq!(
        report["findings"],
        serde_json::json!(["point 'lost': found 1 rays, expected 2 or more: left out"])
    );
    let text = folder.run(&["adjust", "--network", "net.json"]);
    assert!(text.done().contains("redundancy 13\n"), "{text:?}");

    let mut bad = network;
    bad["observations"][3][1] = "P99".into();
    folder.write("bad.json", bad.to_string());
    let answer = folder.run(&["adjust", "--network", "bad.json"]);
    answer.refused(2, &["bad.json", "'P99' in image 'I0'"]);
}
