//! Bad files and arguments: each is answered by one clear line and an exit status, and nothing measured is lost.

mod common;

use std::fs;
use std::io::{BufRead, BufReader};

use common::{Folder, IMAGES, NEW, encoded, measured, pixels, program, scene};
use image::ImageFormat;
use image::imageops::crop_imm;
use rusqlite::Connection;
use tiepoint::project::session::Session;

/// `new` with this image beside the good ones.
fn new_with_image(folder: &Folder, image: &str) -> common::Answer {
    folder.run(&[
        "new",
        "p.tiepoint",
        "--images",
        "images",
        image,
        "--camera",
        "camera.toml",
    ])
}

#[test]
fn what_is_no_image_is_refused_before_a_project_is_made() {
    let folder = Folder::with_inputs("no-image");
    folder.add_picture(0);
    folder.write("text.png", "label,x_mm,y_mm\nX1,0,0\n");
    folder.write("empty.png", "");
    folder.write("head.png", &scene().pictures[1].1[..20]);
    let small = crop_imm(&pixels(1), 0, 0, 600, 400).to_image();
    folder.write("small.png", encoded(&small, ImageFormat::Png));
    fs::create_dir(folder.at("none")).unwrap();
    let no_picture = "found a file that is no picture, expected a TIFF, PNG, JPEG, BMP or PGM";
    for (image, words) in [
        ("text.png", ["text.png: ", no_picture]),
        (
            "empty.png",
            ["empty.png: ", "found an empty file, expected"],
        ),
        (
            "head.png",
            ["head.png: ", "found a damaged or incomplete PNG picture"],
        ),
        (
            "small.png",
            [
                "small.png: ",
                "found 600 x 400 px, expected 1200 x 800 px of camera 'small'",
            ],
        ),
        (
            "none",
            [
                "none: ",
                "found no images in this folder, expected files such as",
            ],
        ),
        (
            "gone",
            ["gone: ", "found no such file or folder, expected images"],
        ),
        (
            "gone.png",
            [
                "gone.png: ",
                "found no such file or folder, expected images",
            ],
        ),
    ] {
        new_with_image(&folder, image).refused(2, &words);
        assert!(!folder.at("p.tiepoint").exists(), "{image}");
    }
    assert!(!folder.names().iter().any(|name| name.ends_with("-lock")));
    for image in ["text.png", "empty.png", "small.png", "gone.png", "none"] {
        folder
            .run(&["detect", image, "--camera", "camera.toml"])
            .refused(2, &[image, "found ", "expected "]);
    }
}

#[test]
fn a_picture_given_twice_is_refused() {
    let folder = Folder::with_inputs("twice");
    folder.add_picture(0);
    folder.add_picture(1);
    let first = format!("images/{}", scene().pictures[0].0);
    folder.write("copy.png", &scene().pictures[0].1);
    let again = ["found the same picture as ", "expected each picture once"];
    new_with_image(&folder, &first).refused(2, &[&first, again[0], again[1]]);
    new_with_image(&folder, "copy.png").refused(2, &["copy.png: ", again[0], &first, again[1]]);
    folder
        .run(&["new", "p.tiepoint", "--images", "images"])
        .done();
    let before = folder.read("p.tiepoint");
    for image in [first.as_str(), "copy.png", "images"] {
        folder
            .run(&["add", "p.tiepoint", "--images", image])
            .refused(2, &again);
    }
    folder.write(&first, &scene().pictures[2].1);
    folder
        .run(&["add", "p.tiepoint", "--images", &first])
        .refused(
            2,
            &[&first, "found another picture than the one the project has"],
        );
    folder
        .run(&["exclude", "p.tiepoint", "--images", "images/no.png"])
        .refused(
            2,
            &[
                "images/no.png: ",
                "found no such image in the project, expected one of its 2",
            ],
        );
    assert_eq!(folder.read("p.tiepoint"), before);
}

#[test]
fn detect_tells_of_the_good_pictures_beside_a_bad_one() {
    let folder = Folder::with_inputs("detect");
    folder.add_picture(0);
    let good = format!("images/{}", scene().pictures[0].0);
    let (_, png) = &scene().pictures[1];
    let tiff = encoded(&pixels(1), ImageFormat::Tiff);
    let jpeg = encoded(&pixels(1), ImageFormat::Jpeg);
    for (name, bytes) in [("a.png", png), ("a.tif", &tiff), ("a.jpg", &jpeg)] {
        for share in [3, 10, 17] {
            folder.write(name, &bytes[..bytes.len() * share / 18]);
            folder
                .run(&["detect", name])
                .refused(2, &[name, "found ", "expected a complete file"]);
        }
        let answer = folder.run(&["detect", name, &good, "--json"]);
        answer.failed(2, &[name]);
        let reports: serde_json::Value = serde_json::from_str(&answer.stdout).unwrap();
        assert_eq!(reports[0]["image"], good.as_str());
    }
    folder
        .run(&["detect", "a.png", &good, "a.tif", "a.jpg"])
        .failed(2, &["a.png: found ", "(and 2 more images like that)"]);
}

#[test]
fn truncated_pictures_are_findings_and_the_others_are_measured() {
    let folder = Folder::with_scene("truncated");
    let png = format!("images/{}", scene().pictures[0].0);
    let half = scene().pictures[0].1.len() / 2;
    folder.write(&png, &scene().pictures[0].1[..half]);
    for (name, format) in [("x.jpg", ImageFormat::Jpeg), ("y.tif", ImageFormat::Tiff)] {
        let bytes = encoded(&pixels(1), format);
        folder.write(&format!("images/{name}"), &bytes[..bytes.len() / 2]);
    }
    let made = folder.run(&NEW);
    // A TIFF file may have its directory at the end: then nothing can be said of it and it is refused at once.
    if made.status == Some(2) {
        made.refused(2, &["y.tif: ", "found a damaged or incomplete TIF"]);
        fs::remove_file(folder.at("images/y.tif")).unwrap();
        folder.run(&NEW).done();
    }
    let summary = folder.run(&["run", "p.tiepoint", "--json"]).json();
    assert_eq!(summary["stages"][0]["outcome"], "incomplete");
    assert_eq!(summary["stages"][5]["outcome"], "done");
    assert!(
        summary["images_oriented"].as_u64().unwrap() as usize >= IMAGES - 2,
        "{summary}"
    );
    assert!(summary["sigma0"].as_f64().unwrap() < 1.5, "{summary}");
    for name in [png.as_str(), "images/x.jpg"] {
        let finding = findings(&summary, "unreadable-image", name);
        assert_eq!(finding.len(), 1, "{summary:#}");
        assert!(
            finding[0].contains("expected a complete file"),
            "{finding:?}"
        );
    }
    // The picture is there again: only it is detected, and no word is left of its absence.
    folder.add_picture(0);
    let summary = folder.run(&["run", "p.tiepoint", "--json"]).json();
    assert!(
        findings(&summary, "unreadable-image", &png).is_empty(),
        "{summary:#}"
    );
    assert_eq!(
        findings(&summary, "unreadable-image", "images/x.jpg").len(),
        1
    );
    assert_eq!(summary["images_oriented"], IMAGES);
}

/// Texts of the findings of a kind about something.
fn findings(summary: &serde_json::Value, kind: &str, about: &str) -> Vec<String> {
    let all = summary["findings"].as_array().unwrap();
    all.iter()
        .filter(|f| f["kind"] == kind && f["about"] == about)
        .map(|f| f["text"].as_str().unwrap().to_owned())
        .collect()
}

#[test]
fn pictures_that_were_moved_or_replaced_are_findings() {
    let folder = Folder::with_scene("moved");
    folder.run(&NEW).done();
    let names: Vec<String> = scene()
        .pictures
        .iter()
        .map(|(n, _)| format!("images/{n}"))
        .collect();
    fs::rename(folder.at(&names[2]), folder.at("away.png")).unwrap();
    let small = crop_imm(&pixels(3), 0, 0, 900, 800).to_image();
    folder.write(&names[3], encoded(&small, ImageFormat::Png));
    folder.write(&names[4], "no picture any more");
    let summary = folder.run(&["run", "p.tiepoint", "--json"]).json();
    for (name, words) in [
        (&names[2], "found no such file"),
        (
            &names[3],
            "found 900 x 800 px, expected 1200 x 800 px as when it was added",
        ),
        (&names[4], "found a file that is no picture"),
    ] {
        let texts = findings(&summary, "unreadable-image", name);
        assert!(
            texts.len() == 1 && texts[0].contains(words),
            "{name}: {summary:#}"
        );
    }
    assert!(
        summary["images_oriented"].as_u64().unwrap() >= 5,
        "{summary:#}"
    );
    assert!(summary["sigma0"].is_number(), "{summary:#}");
    let text = folder.run(&["run", "p.tiepoint"]);
    assert!(text.done().contains("found no such file"), "{text:?}");

    // None is left: there is nothing to measure, and the project says so.
    let folder = Folder::with_scene("all-moved");
    folder.run(&NEW).done();
    fs::rename(folder.at("images"), folder.at("elsewhere")).unwrap();
    folder.run(&["run", "p.tiepoint"]).failed(
        1,
        &["p.tiepoint: first-pair: no image has detected targets yet"],
    );
    fs::rename(folder.at("elsewhere"), folder.at("images")).unwrap();
    let summary = folder.run(&["run", "p.tiepoint", "--json"]).json();
    assert_eq!(summary["images_oriented"], IMAGES);
    let stale = ["unreadable-image", "stage-failed", "unconnected-image"];
    let findings = summary["findings"].as_array().unwrap();
    assert!(
        !findings
            .iter()
            .any(|f| stale.contains(&f["kind"].as_str().unwrap())),
        "{summary:#}"
    );
}

#[test]
fn a_project_is_never_overwritten() {
    let folder = Folder::with_measured("existing");
    folder
        .run(&NEW)
        .refused(2, &["p.tiepoint: found an existing file, expected"]);
    assert_eq!(folder.read("p.tiepoint"), measured());
    folder
        .new_with("new", "no/such/p.tiepoint")
        .refused(2, &["no/such/p.tiepoint: ", "create"]);
    folder
        .new_with("new", "images")
        .refused(2, &["images: found an existing"]);
}

#[test]
fn what_is_no_project_is_refused_by_every_command() {
    let folder = Folder::with_inputs("no-project");
    folder.add_picture(0);
    fs::create_dir(folder.at("folder")).unwrap();
    folder.write("empty", "");
    folder.write(
        "text",
        "this is no database, and long enough to be looked at as one. ".repeat(99),
    );
    folder.write("other", "");
    Connection::open(folder.at("other"))
        .unwrap()
        .execute_batch("CREATE TABLE a (b)")
        .unwrap();
    folder.write("newer", measured());
    Connection::open(folder.at("newer"))
        .unwrap()
        .pragma_update(None, "user_version", 99)
        .unwrap();
    let before: Vec<Vec<u8>> = ["empty", "text", "other", "newer"]
        .map(|n| folder.read(n))
        .into();
    for (name, words) in [
        ("folder", "not a Tiepoint project: found a folder"),
        ("empty", "not a Tiepoint project: found an empty file"),
        (
            "text",
            "not a Tiepoint project: found a file that is no database",
        ),
        ("other", "not a Tiepoint project: found application id"),
        (
            "newer",
            "made by a newer version of Tiepoint: found format 99, expected at most 1",
        ),
        ("gone", "found no such file, expected a Tiepoint project"),
    ] {
        for arguments in [
            vec!["run", name],
            vec!["add", name, "--images", "images"],
            vec!["exclude", name, "--images", "images"],
            vec!["export", name, "--points", "points.csv"],
            vec!["compare", name, "--reference", "reference.csv"],
        ] {
            folder.run(&arguments).refused(2, &[name, words]);
        }
    }
    assert!(
        ["empty", "text", "other", "newer"]
            .map(|n| folder.read(n))
            .to_vec()
            == before
    );
    assert!(!folder.at("points.csv").exists());
    assert!(
        !folder.names().iter().any(|n| n.contains('-')),
        "{:?}",
        folder.names()
    );
}

/// The same project in a file that holds nothing but what is valid: damage to remains of former rows harms nobody.
fn without_free_space(folder: &Folder, project: &[u8]) -> Vec<u8> {
    folder.write("loose", project);
    let database = Connection::open(folder.at("loose")).unwrap();
    let compact = folder.at("compact");
    database
        .execute("VACUUM INTO ?1", [compact.to_str().unwrap()])
        .unwrap();
    drop(database);
    let bytes = std::fs::read(&compact).unwrap();
    for file in ["loose", "compact"] {
        std::fs::remove_file(folder.at(file)).unwrap();
    }
    bytes
}

#[test]
fn a_damaged_project_is_said_to_be_so_and_stays_as_it_is() {
    let folder = Folder::with_scene("damaged");
    let whole = measured();
    let page = 4096;
    let mut pages_of_zeros = whole.to_vec();
    pages_of_zeros[3 * page..5 * page].fill(0);
    let mut flipped = without_free_space(&folder, whole);
    // Digits in the middle of the file: SQLite would not notice.
    let digit = flipped
        .windows(8)
        .rposition(|w| w.iter().all(u8::is_ascii_digit))
        .unwrap();
    flipped[digit] = if flipped[digit] == b'1' { b'2' } else { b'1' };
    for (name, bytes) in [
        ("cut", &whole[..whole.len() / 2]),
        ("start", &whole[..3000]),
        ("zeros", &pages_of_zeros[..]),
        ("flipped", &flipped[..]),
    ] {
        folder.write(name, bytes);
        folder.run(&["run", name]).refused(2, &[name, "damaged"]);
        folder
            .run(&["exclude", name, "--images", "images"])
            .refused(2, &[name, "damaged"]);
        let exported = folder.run(&["export", name, "--points", "points.csv"]);
        assert!(matches!(exported.status, Some(1 | 2)), "{exported:?}");
        exported.refused(exported.status.unwrap(), &[name, "damaged"]);
        assert!(folder.read(name) == bytes, "{name} was changed");
    }
    assert!(
        !folder.names().iter().any(|n| n.contains('-')),
        "{:?}",
        folder.names()
    );
}

#[test]
fn camera_files_with_faults_are_refused() {
    let folder = Folder::with_inputs("camera");
    folder.add_picture(0);
    let good = &scene().camera;
    let without = |key: &str| {
        let lines = good.lines().filter(|line| !line.starts_with(key));
        lines.collect::<Vec<_>>().join("\n")
    };
    let pitch = without("pixel_pitch_mm");
    for (text, words) in [
        (
            without("width_px"),
            ["camera.toml", "found no key width_px, expected it"],
        ),
        (
            format!("pitch_mm = 1\n{good}"),
            [
                "camera.toml, line 1",
                "found the key 'pitch_mm', expected one of",
            ],
        ),
        (
            format!("pixel_pitch_mm = -0.02\n{pitch}"),
            ["camera.toml, line 1", "expected a number from"],
        ),
        (
            format!("pixel_pitch_mm = nan\n{pitch}"),
            [
                "camera.toml, line 1",
                "found 'pixel_pitch_mm = nan', expected",
            ],
        ),
        (
            format!("pixel_pitch_mm = 'small'\n{pitch}"),
            ["camera.toml, line 1", "expected a number from"],
        ),
        (
            "label,x_mm\n".into(),
            ["camera.toml, line 1", "expected TOML"],
        ),
        (
            String::new(),
            ["camera.toml", "found no key name, expected it"],
        ),
    ] {
        folder.write("camera.toml", &text);
        folder.run(&NEW).refused(2, &words);
    }
    let mut bytes = b"# M\xe4rz\n".to_vec();
    bytes.extend(good.as_bytes());
    folder.write("camera.toml", bytes);
    folder.run(&NEW).refused(
        2,
        &["camera.toml, line 1: found the byte 0xe4, expected UTF-8 text"],
    );
    fs::remove_file(folder.at("camera.toml")).unwrap();
    folder
        .run(&NEW)
        .refused(2, &["camera.toml: cannot be read: "]);
    assert!(!folder.at("p.tiepoint").exists());
}

#[test]
fn tables_with_faults_are_refused() {
    let folder = Folder::with_inputs("tables");
    folder.add_picture(0);
    let head = "name,from,to,length_mm,sigma_mm\n";
    let bar = "a,C1,C2,1000,0.01\n";
    for (rows, words) in [
        (
            format!("{bar}a,C3,C4,1000,0.01\n"),
            [
                "bars.csv, line 3, column 1 (name)",
                "found the bar a again, expected it once",
            ],
        ),
        (
            "a,C1,C1,1000,0.01\n".into(),
            [
                "bars.csv, line 2, column 3 (to)",
                "found a bar from C1 to C1, expected two points",
            ],
        ),
        (
            "a,C1,C1.O,1000,0.01\n".into(),
            ["bars.csv, line 2, column 3 (to)", "expected two points"],
        ),
        (
            "a,C1,C999,1000,0.01\n".into(),
            ["bars.csv, line 2, column 3 (to)", "found 'C999', expected"],
        ),
        (
            "a,C1,Q7,1000,0.01\n".into(),
            ["bars.csv, line 2, column 3 (to)", "found 'Q7', expected"],
        ),
        (
            "a,C1,C2,-1000,0.01\n".into(),
            [
                "bars.csv, line 2, column 4 (length_mm)",
                "found '-1000', expected a number greater than 0",
            ],
        ),
        (
            "a,C1,C2,long,0.01\n".into(),
            [
                "bars.csv, line 2, column 4 (length_mm)",
                "found 'long', expected a number",
            ],
        ),
        (
            "a,C1,C2,1000\n".into(),
            ["bars.csv, line 2", "found 4 fields, expected 5"],
        ),
        (
            String::new(),
            [
                "bars.csv",
                "found nothing below the header, expected at least one line",
            ],
        ),
    ] {
        folder.write("bars.csv", format!("{head}{rows}"));
        folder.run(&NEW).refused(2, &words);
    }
    folder.write("bars.csv", &scene().bars);
    let five: Vec<&str> = scene().cross.lines().take(6).collect();
    folder.write("cross.csv", five.join("\n"));
    folder.run(&NEW).refused(
        2,
        &["cross.csv", "found a cross with 5 dots, expected 6 or more"],
    );
    folder.write("cross.csv", &scene().cross);
    folder.write("targets.toml", "[plain]\ndot_mm = 0\n");
    folder
        .run(&NEW)
        .refused(2, &["targets.toml, line 2", "expected a number"]);
    folder.write("targets.toml", &scene().targets);
    folder.write("control.csv", "label,x_mm,y_mm,z_mm,role\nC1,0,0,0,loose\n");
    folder.new_with("--control", "control.csv").refused(
        2,
        &[
            "control.csv, line 2, column 5 (role)",
            "found 'loose', expected",
        ],
    );
    assert!(!folder.at("p.tiepoint").exists());
    folder.run(&NEW).done();
}

#[test]
fn a_bar_that_is_never_seen_is_a_finding_and_scale_comes_from_the_next_source() {
    let folder = Folder::with_scene("bar");
    let seen: Vec<&str> = scene()
        .experiment
        .scene
        .bars
        .iter()
        .map(|b| b.from.as_str())
        .collect();
    let absent = (1..=420)
        .map(|id| format!("C{id}.O"))
        .find(|label| {
            scene()
                .experiment
                .scene
                .discs
                .iter()
                .all(|d| d.label != *label)
        })
        .unwrap();
    folder.write(
        "bars.csv",
        format!(
            "name,from,to,length_mm,sigma_mm\nlost,{},{absent},1000,0.01\n",
            seen[0]
        ),
    );
    folder.run(&NEW).done();
    let answer = folder.run(&["run", "p.tiepoint", "--json"]);
    let summary = answer.json();
    let texts = findings(&summary, "scale-bar", "lost");
    assert!(
        texts.len() == 1 && texts[0].contains(&absent),
        "{summary:#}"
    );
    assert_eq!(summary["scale_from"], "cross", "{summary:#}");
    assert!(summary["sigma0"].is_number(), "{summary:#}");
    let text = folder.run(&["run", "p.tiepoint"]);
    assert!(text.done().contains(&texts[0]), "{text:?}");
}

#[test]
fn arguments_with_faults_are_one_line() {
    let folder = Folder::with_inputs("arguments");
    for (arguments, words) in [
        (
            vec!["detect", "a.png", "--codes", "dot421"],
            vec!["dot421", "--codes"],
        ),
        (
            vec!["detect", "a.png", "--codes", "dot420,,"],
            vec!["--codes"],
        ),
        (
            vec!["run", "p.tiepoint", "--until", "lunch"],
            vec!["lunch", "--until", "first-pair"],
        ),
        (vec!["run"], vec!["PROJECT"]),
        (vec!["new", "p.tiepoint"], vec!["--images"]),
        (
            vec![
                "new",
                "p.tiepoint",
                "--images",
                "images",
                "--identification",
                "luck",
            ],
            vec!["luck", "--identification", "paper"],
        ),
        (vec!["weigh"], vec!["weigh"]),
        (vec!["run", "p.tiepoint", "--fast"], vec!["--fast"]),
        (
            vec!["codes", "--table", "t.csv", "--family", "ring13"],
            vec!["ring13"],
        ),
        (
            vec!["codes", "--table", "no/t.csv"],
            vec!["no/t.csv: cannot be written"],
        ),
        (
            vec!["export", "p.tiepoint"],
            vec!["found no table to write, expected --points"],
        ),
    ] {
        folder.run(&arguments).refused(2, &words);
    }
}

#[test]
fn a_second_writer_is_refused_and_readers_are_not() {
    let folder = Folder::with_measured("second");
    let session = Session::open(&folder.at("p.tiepoint")).unwrap();
    let process = format!("process {}", std::process::id());
    let name = format!("images/{}", scene().pictures[0].0);
    for arguments in [
        vec!["run", "p.tiepoint"],
        vec!["exclude", "p.tiepoint", "--images", &name],
    ] {
        folder
            .run(&arguments)
            .refused(1, &["p.tiepoint is open in another Tiepoint", &process]);
    }
    folder
        .run(&["export", "p.tiepoint", "--points", "points.csv"])
        .done();
    drop(session);
    folder.run(&["run", "p.tiepoint"]).done();
}

#[test]
fn another_process_that_runs_is_a_writer_too() {
    let folder = Folder::with_scene("running");
    folder.run(&NEW).done();
    // One thread: it must not be ready before the second begins.
    let mut first = program(&folder.at("."), &["run", "p.tiepoint"])
        .env("RAYON_NUM_THREADS", "1")
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(first.stderr.take().unwrap()).lines();
    lines.next().unwrap().unwrap();
    let second = folder.run(&["run", "p.tiepoint"]);
    second.refused(
        1,
        &[
            "p.tiepoint is open in another Tiepoint",
            &first.id().to_string(),
        ],
    );
    for line in lines {
        line.unwrap();
    }
    assert!(first.wait().unwrap().success());
}

#[test]
fn export_refuses_what_is_not_there_or_stale() {
    let folder = Folder::with_scene("export");
    folder.run(&NEW).done();
    let export = ["export", "p.tiepoint", "--points", "points.csv"];
    let compare = ["compare", "p.tiepoint", "--reference", "reference.csv"];
    for arguments in [export, compare] {
        folder.run(&arguments).refused(
            1,
            &[
                "p.tiepoint: ",
                "there is no adjustment yet; run the stages first",
            ],
        );
    }
    folder.write("p.tiepoint", measured());
    folder
        .run(&["export", "p.tiepoint", "--points", "no/points.csv"])
        .refused(2, &["no/points.csv: cannot be written: "]);
    folder
        .run(&["export", "p.tiepoint", "--points", "images"])
        .refused(2, &["images: cannot be written: "]);
    let name = format!("images/{}", scene().pictures[0].0);
    folder
        .run(&["exclude", "p.tiepoint", "--images", &name])
        .done();
    let stale = "the adjustment is older than the last changes; run the stages again first";
    for table in ["--points", "--observations", "--stations", "--cameras"] {
        folder
            .run(&["export", "p.tiepoint", table, "points.csv"])
            .refused(1, &["p.tiepoint: ", stale]);
    }
    folder.run(&compare).refused(1, &[stale]);
    assert!(!folder.at("points.csv").exists());

    folder.run(&["add", "p.tiepoint", "--images", &name]).done();
    folder.run(&export).refused(1, &[stale]);
    folder.run(&["run", "p.tiepoint"]).done();
    folder.run(&export).done();
}

#[test]
fn a_comparison_needs_three_common_points() {
    let folder = Folder::with_measured("compare");
    let compare = ["compare", "p.tiepoint", "--reference", "few.csv"];
    let lines: Vec<&str> = scene().reference.lines().collect();
    folder.write("few.csv", lines[..1].join("\n"));
    folder
        .run(&compare)
        .refused(2, &["few.csv: found nothing below the header"]);
    let crosses: Vec<&str> = lines
        .iter()
        .copied()
        .filter(|l| l.starts_with("X"))
        .collect();
    folder.write("few.csv", [&lines[..1], &crosses[..2]].concat().join("\n"));
    folder.run(&compare).refused(
        1,
        &["p.tiepoint: ", "2 labels with three coordinates in common"],
    );
    folder.write("few.csv", "label,x_mm,y_mm\nX1,0,0\n");
    folder
        .run(&compare)
        .refused(2, &["few.csv, line 1: found no column z_mm"]);
    folder.write("few.csv", [&lines[..1], &crosses[..3]].concat().join("\n"));
    folder.run(&compare).done();
}

#[test]
fn no_table_is_written_over_what_it_is_made_of_or_over_another() {
    let folder = Folder::with_measured("over");
    let before = folder.read("p.tiepoint");
    let two_roles = |arguments: &[&str], words: &[&str]| {
        let export = [&["export", "p.tiepoint"], arguments].concat();
        folder.run(&export).refused(2, words);
        assert_eq!(folder.read("p.tiepoint"), before);
    };
    two_roles(
        &["--points", "./p.tiepoint"],
        &["p.tiepoint: ", "of the project and of --points"],
    );
    two_roles(
        &["--points", "a.csv", "--stations", "./a.csv"],
        &["a.csv: ", "of --points and of --stations"],
    );
    assert!(!folder.at("a.csv").exists());
    // Standard output takes several, one after the other.
    let export = ["export", "p.tiepoint", "--points", "/dev/stdout"];
    let answer = folder.run(&[&export[..], &["--stations", "/dev/stdout"]].concat());
    for head in ["label,kind,", "omega_deg"] {
        assert!(answer.done().contains(head), "{answer:#?}");
    }
    folder.write("net.json", "{}");
    folder
        .run(&[
            "adjust",
            "--network",
            "net.json",
            "--covariance",
            "net.json",
        ])
        .refused(2, &["net.json: ", "of the network and of --covariance"]);
    assert_eq!(folder.text("net.json"), "{}");
}

#[test]
fn the_demo_is_not_rendered_over_somebodys_files() {
    let folder = Folder::with_inputs("foreign");
    let camera = folder.text("camera.toml");
    let demo = folder.run(&["demo", "."]);
    assert_eq!(demo.status, Some(2), "{demo:?}");
    let line = demo.stderr.lines().last().unwrap();
    assert!(
        line.contains("found something that is no demo's"),
        "{demo:?}"
    );
    assert_eq!(folder.text("camera.toml"), camera);
}
