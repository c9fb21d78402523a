//! Projects: what was measured stays, whatever happens in between.

mod common;

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::process::Command;
use std::sync::OnceLock;

use common::{Folder, IMAGES, NEW, program, scene};
use tiepoint::monitor::Monitor;
use tiepoint::network::{ImageEntry, Network, Outcome, Stage};
use tiepoint::project::session::{Finished, Session};
use tiepoint::project::storage::Store;

/// Every table that `export` writes.
const TABLES: [&str; 4] = [
    "points.csv",
    "observations.csv",
    "stations.csv",
    "cameras.toml",
];

/// The tables of the project, one after the other.
fn exported(folder: &Folder) -> String {
    folder
        .run(&[
            "export",
            "p.tiepoint",
            "--points",
            TABLES[0],
            "--observations",
            TABLES[1],
            "--stations",
            TABLES[2],
            "--cameras",
            TABLES[3],
        ])
        .done();
    TABLES.map(|table| folder.text(table)).join("\n")
}

/// The tables of a run that nobody disturbed.
fn undisturbed() -> &'static str {
    static TEXT: OnceLock<String> = OnceLock::new();
    TEXT.get_or_init(|| exported(&Folder::with_measured("undisturbed")))
}

fn network(folder: &Folder) -> Network {
    let opened = Store::open_read_only(&folder.at("p.tiepoint")).unwrap();
    opened.network.as_ref().clone()
}

/// The images by their paths.
fn images(network: &Network) -> BTreeMap<String, ImageEntry> {
    let by_path = |image: &ImageEntry| (image.file.path.clone(), image.clone());
    network.images.values().map(|i| by_path(i)).collect()
}

/// Asserts that the project is one file: nothing of a writer is left beside it.
#[track_caller]
fn assert_at_rest(folder: &Folder) {
    let names = folder.names();
    let beside = names
        .iter()
        .any(|n| n.starts_with("p.tiepoint") && n != "p.tiepoint");
    assert!(!beside, "{names:?}");
}

/// Path of a picture of the scene.
fn picture(index: usize) -> String {
    format!("images/{}", scene().pictures[index].0)
}

#[test]
fn a_project_that_is_opened_again_is_the_same_to_the_bit() {
    let folder = Folder::with_scene("reopened");
    folder.run(&NEW).done();
    assert_at_rest(&folder);
    let path = folder.at("p.tiepoint");
    let mut session = Session::open(&path).unwrap();
    for stage in Stage::ALL {
        while let Some(run) = session.begin(stage).unwrap() {
            let finished = session.finish(run.compute(&Monitor::new())).unwrap();
            session.flush().unwrap();
            // What is on the disk is what is in memory, after every step.
            let opened = Store::open_read_only(&path).unwrap();
            assert!(opened.network == *session.network(), "{stage}");
            if let Finished::Concluded(outcome) = finished {
                assert_eq!(outcome, Outcome::Done, "{stage}");
                break;
            }
        }
    }
    let before = session.network().clone();
    assert_eq!(before.oriented_images().count(), IMAGES);
    drop(session);
    assert_at_rest(&folder);
    let session = Session::open(&path).unwrap();
    assert!(*session.network() == before);
    assert_eq!(session.warnings(), &[] as &[String]);
    drop(session);
    // The window's way and the command's way are one.
    assert!(exported(&folder) == undisturbed());
}

#[test]
fn a_second_run_finds_nothing_to_do() {
    let folder = Folder::with_measured("second-run");
    let before = folder.read("p.tiepoint");
    let answer = folder.run(&["run", "p.tiepoint", "--json"]);
    let summary = answer.json();
    for (run, stage) in summary["stages"].as_array().unwrap().iter().zip(Stage::ALL) {
        assert_eq!(run["stage"], stage.to_string());
        assert_eq!(run["outcome"], "done");
        assert!(
            answer.stderr.contains(&format!("{stage}: done")),
            "{answer:?}"
        );
    }
    assert!(!answer.stderr.contains("detecting"), "{answer:?}");
    assert_eq!(summary["images_oriented"], IMAGES);
    assert!(folder.read("p.tiepoint") == before, "the file was changed");
    assert_at_rest(&folder);
}

#[test]
fn stages_one_by_one_end_as_all_at_once() {
    let folder = Folder::with_scene("one-by-one");
    folder.run(&NEW).done();
    for stage in Stage::ALL {
        folder
            .run(&["run", "p.tiepoint", "--until", &stage.to_string()])
            .done();
    }
    assert!(exported(&folder) == undisturbed());
}

#[test]
fn later_images_are_added_and_the_rest_stays_measured() {
    let folder = Folder::with_inputs("later");
    for index in 0..IMAGES - 1 {
        folder.add_picture(index);
    }
    folder.run(&NEW).done();
    folder.run(&["run", "p.tiepoint"]).done();
    let first = images(&network(&folder));

    folder.add_picture(IMAGES - 1);
    let last = picture(IMAGES - 1);
    let answer = folder.run(&["add", "p.tiepoint", "--images", &last]);
    assert_eq!(answer.done(), "p.tiepoint: 1 images added\n");
    let added = images(&network(&folder));
    assert_eq!(added.len(), IMAGES);
    for (path, image) in &first {
        assert!(added[path] == *image, "{path}");
    }
    // The pictures that are measured are not needed any more.
    for index in 0..IMAGES - 1 {
        std::fs::remove_file(folder.at(&picture(index))).unwrap();
    }
    let summary = folder.run(&["run", "p.tiepoint", "--json"]).json();
    assert_eq!(summary["images_oriented"], IMAGES, "{summary:#}");
    let after = images(&network(&folder));
    for (path, image) in &first {
        assert!(after[path].detections == image.detections, "{path}");
        for (dot, label) in image.used_labels() {
            let now = after[path].labels.get(&dot).map(|l| l.point);
            assert_eq!(now, Some(label.point), "{path} {dot:?}");
        }
    }
    assert!(after[&last].station.is_some() && !after[&last].labels.is_empty());
    assert_at_rest(&folder);
}

#[test]
fn an_excluded_image_takes_no_part_and_comes_back_as_it_was() {
    let folder = Folder::with_measured("excluded");
    let first = images(&network(&folder));
    let name = picture(4);
    let answer = folder.run(&["exclude", "p.tiepoint", "--images", &name]);
    assert_eq!(answer.done(), "p.tiepoint: 1 images excluded\n");
    for index in 0..IMAGES {
        std::fs::rename(
            folder.at(&picture(index)),
            folder.at(&format!("{index}.png")),
        )
        .unwrap();
    }
    let answer = folder.run(&["run", "p.tiepoint", "--json"]);
    let summary = answer.json();
    assert_eq!(summary["images"], IMAGES - 1);
    assert_eq!(summary["images_oriented"], IMAGES - 1, "{summary:#}");
    assert!(!answer.stderr.contains("detecting"), "{answer:?}");
    let tables = exported(&folder);
    assert!(!tables.contains(&name));
    let without = images(&network(&folder));
    for (path, image) in &first {
        assert!(without[path].detections == image.detections, "{path}");
    }
    assert!(without[&name].labels == first[&name].labels);

    std::fs::rename(folder.at("4.png"), folder.at(&name)).unwrap();
    folder.run(&["add", "p.tiepoint", "--images", &name]).done();
    let answer = folder.run(&["run", "p.tiepoint", "--json"]);
    let summary = answer.json();
    assert_eq!(summary["images_oriented"], IMAGES, "{summary:#}");
    assert!(!answer.stderr.contains("detecting"), "{answer:?}");
    assert!(exported(&folder).contains(&name));
}

#[test]
fn a_run_that_is_killed_goes_on_with_the_same_digits() {
    let folder = Folder::with_scene("killed");
    folder.run(&NEW).done();
    // Killed once in every stage, the last time after everything is saved.
    for line in [
        "detecting",
        "detect: ",
        "connecting",
        "connect: ",
        "identifying",
        "adjust: ",
    ] {
        let mut run = program(&folder.at("."), &["run", "p.tiepoint"])
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(run.stderr.take().unwrap()).lines();
        let met = lines.any(|text| text.is_ok_and(|text| text.starts_with(line)));
        assert!(met, "no line '{line}'");
        run.kill().unwrap();
        run.wait().unwrap();
    }
    let answer = folder.run(&["run", "p.tiepoint"]);
    answer.done();
    assert!(exported(&folder) == undisturbed());
    assert_at_rest(&folder);
}

#[cfg(unix)]
#[test]
fn a_run_that_is_interrupted_says_so_and_goes_on_with_the_same_digits() {
    let folder = Folder::with_scene("interrupted");
    folder.run(&NEW).done();
    // One thread: on many, all pictures could be under way, and soon finished, when the signal comes.
    let mut run = program(&folder.at("."), &["run", "p.tiepoint", "--json"])
        .env("RAYON_NUM_THREADS", "1")
        .spawn()
        .unwrap();
    let process = run.id().to_string();
    let mut lines = BufReader::new(run.stderr.take().unwrap()).lines();
    assert_eq!(lines.next().unwrap().unwrap(), "detecting targets");
    let signalled = Command::new("kill")
        .args(["-INT", &process])
        .status()
        .unwrap();
    assert!(signalled.success());
    let rest: Vec<String> = lines.map(Result::unwrap).collect();
    let output = run.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{rest:?}");
    let last =
        "tiepoint: interrupted; all finished steps are kept, the same command goes on from there";
    assert_eq!(rest.last().unwrap(), last);
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["stages"][0]["outcome"], "interrupted", "{summary}");
    assert_at_rest(&folder);

    // The pictures that were finished are kept: that they are gone does no harm.
    let detected: Vec<String> = images(&network(&folder))
        .into_values()
        .filter(|image| image.detections.is_some())
        .map(|image| image.file.path)
        .collect();
    assert!(detected.len() < IMAGES, "{detected:?}");
    for path in &detected {
        std::fs::remove_file(folder.at(path)).unwrap();
    }
    folder.run(&["run", "p.tiepoint"]).done();
    assert!(exported(&folder) == undisturbed());
}

#[test]
fn a_project_moves_with_its_pictures() {
    let folder = Folder::with_scene("moving");
    std::fs::create_dir(folder.at("old")).unwrap();
    folder.new_with("new", "old/p.tiepoint").done();
    std::fs::create_dir(folder.at("a")).unwrap();
    std::fs::rename(folder.at("old"), folder.at("a/old")).unwrap();
    std::fs::rename(folder.at("images"), folder.at("a/images")).unwrap();
    let summary = folder.run(&["run", "a/old/p.tiepoint", "--json"]).json();
    assert_eq!(summary["images_oriented"], IMAGES);
}
