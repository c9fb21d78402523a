//! Other programs' networks as projects: the commands give what the networks themselves give.

mod common;
mod data_sets;

use std::collections::BTreeMap;
use std::path::Path;

use common::Folder;
use data_sets::{adjusted, data, named, say, text};
use nalgebra::Vector3;
use tiepoint::adjustment::ResidualPlane;
use tiepoint::geometry::{Scale, fit_similarity};
use tiepoint::plain_network::{
    AiconTexts, DbatTexts, PlainAdjustment, PlainNetwork, from_aicon, from_dbat,
};

/// A project as its commands tell of it.
struct Measured {
    summary: serde_json::Value,
    points: BTreeMap<String, Vector3<f64>>,
}

/// Imports, runs and exports.
fn measured(folder: &Folder, program: &str, files: &Path) -> Measured {
    let files = files.to_str().expect("a path in UTF-8");
    folder
        .run(&["import", "--from", program, files, "p.tiepoint"])
        .done();
    let summary = folder.run(&["run", "p.tiepoint", "--json"]).json();
    folder
        .run(&["export", "p.tiepoint", "--points", "points.csv"])
        .done();
    let table = folder.text("points.csv");
    let row = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |index: usize| fields[index].parse::<f64>().expect("a number");
        let place = Vector3::new(number(2), number(3), number(4));
        (fields[0].to_owned(), place)
    };
    Measured {
        summary,
        points: table.lines().skip(1).map(row).collect(),
    }
}

impl Measured {
    fn figure(&self, name: &str) -> f64 {
        self.summary[name].as_f64().expect("a figure")
    }

    /// Largest distance of a point from that of an adjusted network, by name, after a best fit without scale, mm.
    fn largest_difference(&self, network: &PlainNetwork, adjusted: &PlainAdjustment) -> f64 {
        let theirs = adjusted.points.iter().zip(&adjusted.adjustment.points);
        let pairs: Vec<_> = theirs
            .map(|(&index, point)| (self.points[&network.points[index].name], point.position))
            .collect();
        assert_eq!(pairs.len(), self.points.len());
        let fit = fit_similarity(&pairs, Scale::One).expect("three points or more");
        let off = pairs
            .iter()
            .map(|(own, their)| (fit.apply(own) - their).norm());
        off.fold(0.0, f64::max)
    }
}

#[test]
fn an_aicon_bundle_as_a_project_gives_the_digits_of_its_network() {
    let Some(files) = data("aicon-bundle") else {
        return;
    };
    let folder = Folder::new("import-aicon");
    let project = measured(&folder, "aicon", &files);
    let texts =
        ["ior", "eor", "obc", "phc", "scale"].map(|end| text(&files, &format!("example.{end}")));
    let [cameras, orientations, points, image_points, bars] = texts.each_ref().map(|t| named(t));
    let network = from_aicon(AiconTexts {
        cameras,
        orientations,
        points,
        image_points,
        bars: Some(bars),
    })
    .expect("a bundle");
    let adjusted = adjusted(&network);
    let [own, theirs] = [project.figure("sigma0"), adjusted.adjustment.sigma0];
    let off = project.largest_difference(&network, &adjusted);
    say(&format!(
        "aicon-bundle as a project: sigma0 {:.8} mm (network {:.8}), redundancy {} (published 18804), coordinates within {:.4} um",
        own * 0.0005,
        theirs * 0.0005,
        project.summary["redundancy"],
        1e3 * off
    ));
    assert!((own / theirs - 1.0).abs() < 1e-7, "{own} {theirs}");
    assert_eq!(project.summary["redundancy"], 18804);
    assert_eq!(project.summary["images_oriented"], 115);
    assert_eq!(project.summary["scale_from"], "bars");
    // Exported to a millionth of a millimetre.
    assert!(off < 5e-6, "{off}");
}

#[test]
fn a_dbat_calibration_as_a_project_differs_by_the_plane_of_its_residuals_alone() {
    let Some(files) = data("dbat-camcal") else {
        return;
    };
    let folder = Folder::new("import-dbat");
    let project = measured(&folder, "dbat", &files);
    let texts = ["markpts.txt", "c4040z.xml", "camcal-fixed.txt"].map(|file| text(&files, file));
    let [marks, camera, control] = texts.each_ref().map(|t| named(t));
    let mut network = from_dbat(DbatTexts {
        marks,
        camera,
        control: Some(control),
        images: None,
        stations: None,
    })
    .expect("a project of DBAT");
    let corrected = adjusted(&network).adjustment;
    network.residuals = ResidualPlane::Measured;
    let measured = adjusted(&network);
    let own = project.figure("sigma0");
    let off = project.largest_difference(&network, &measured);
    say(&format!(
        "dbat-camcal as a project: sigma0 {own:.5}, redundancy {} (published 3725); network {:.5} in the measured image, {:.5} in the corrected plane (published 1.6148); coordinates within {off:.1e} of the control points' unit",
        project.summary["redundancy"], measured.adjustment.sigma0, corrected.sigma0
    ));
    assert!(
        (own / measured.adjustment.sigma0 - 1.0).abs() < 1e-6,
        "{own}"
    );
    assert!((corrected.sigma0 - 1.6148).abs() < 5e-5);
    assert_eq!(project.summary["redundancy"], 3725);
    assert!(off < 5e-6, "{off}");
    let findings = project.summary["findings"].to_string();
    assert!(findings.contains("in the corrected plane"), "{findings}");
}

#[test]
fn bad_arguments_and_files_are_answered_in_one_line() {
    let folder = Folder::new("import-bad");
    std::fs::create_dir(folder.at("none")).expect("a folder in the temporary folder");
    folder.write("a.ior", "1 2 3\n");
    for file in ["a.eor", "a.obc", "a.phc"] {
        folder.write(file, "");
    }
    folder.write("there.tiepoint", "mine");
    for (program, files, project, words) in [
        (
            "aicon",
            "gone",
            "p.tiepoint",
            ["gone: found no such folder", "expected the folder"],
        ),
        (
            "aicon",
            "none",
            "p.tiepoint",
            ["none: found no file .ior", "expected an AICON bundle"],
        ),
        (
            "aicon",
            ".",
            "p.tiepoint",
            ["a.ior, line 1: found a camera in 1 lines", "expected five"],
        ),
        (
            "dbat",
            ".",
            "p.tiepoint",
            [".: found no file .xml", "expected a camera (.xml)"],
        ),
        (
            "colmap",
            "none",
            "p.tiepoint",
            ["none: found no cameras.txt", "expected a COLMAP"],
        ),
        (
            "aicon",
            ".",
            "there.tiepoint",
            ["there.tiepoint: found an existing file", "expected"],
        ),
        (
            "metashape",
            ".",
            "p.tiepoint",
            ["found 'metashape'", "expected aicon, dbat or colmap"],
        ),
    ] {
        folder
            .run(&["import", "--from", program, files, project])
            .refused(2, &words);
        assert!(!folder.at("p.tiepoint").exists(), "{words:?}");
    }
    assert_eq!(folder.text("there.tiepoint"), "mine");
}
