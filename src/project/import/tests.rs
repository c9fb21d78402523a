//! Networks become projects, and what the projects compute is what the networks give.

use std::path::Path;

use super::document::document;
use super::pictures::{PictureFiles, beside};
use super::sources::Source;
use super::*;
use crate::adjustment::ResidualPlane;
use crate::camera::LensDirection;
use crate::geometry::{Scale, fit_similarity};
use crate::monitor::Monitor;
use crate::network::{
    About, ControlRole, FindingKind, GrossErrors, LensParameter, Network, PointId, Stage, Standing,
};
use crate::plain_network::fixture::network;
use crate::plain_network::{
    ColmapTexts, Known, NamedText, PlainDatum, PlainNetwork, PlainParameter, PlainSettings,
    PointRole, from_colmap, to_colmap,
};
use crate::project::edit::Edit;
use crate::project::sample_folder::Folder;
use crate::project::session::Finished;

/// The fixture as COLMAP can have it, with noise, one gross error, and starts that are a millimetre off.
fn colmap_network() -> PlainNetwork {
    let mut network = network(LensDirection::DisplacingAffinityLast);
    let camera = &mut network.cameras[0];
    camera.values[8] = 0.0;
    let shift = |index: usize| (index as f64 * 2.4).sin();
    for (index, seen) in network.observations.iter_mut().enumerate() {
        seen.x_px += 0.3 * shift(index);
        seen.y_px -= 0.3 * shift(7 * index);
    }
    network.observations[17].x_px += 9.0;
    for (index, point) in network.points.iter_mut().enumerate() {
        let start = point.start.as_mut().unwrap();
        start[0] += shift(3 * index);
    }
    network
}

/// Writes a network as a model into a folder and reads it back.
fn model(folder: &Folder, place: &str) -> PlainNetwork {
    let files = to_colmap(&colmap_network()).unwrap();
    for (name, text) in [
        ("cameras.txt", &files.cameras),
        ("images.txt", &files.images),
        ("points3D.txt", &files.points),
    ] {
        folder.write(&format!("{place}/{name}"), text.as_bytes());
    }
    let named = |file, text| NamedText { file, text };
    from_colmap(ColmapTexts {
        cameras: named("cameras.txt", &files.cameras),
        images: named("images.txt", &files.images),
        points: named("points3D.txt", &files.points),
    })
    .unwrap()
}

fn imported(folder: &Folder, program: Program, place: &str) -> Result<Session, ImportingError> {
    let plan = ImportPlan {
        program,
        folder: folder.at(place),
        project: folder.at("p.tiepoint"),
    };
    import(&plan, &Monitor::new())
}

/// Runs all stages.
fn measure(session: &mut Session) {
    for stage in Stage::ALL {
        while let Some(run) = session.begin(stage).unwrap() {
            let finished = session.finish(run.compute(&Monitor::new())).unwrap();
            if let Finished::Concluded(_) = finished {
                break;
            }
        }
    }
}

/// Largest distance between the points of a project and those of a network by their names, after a best fit, mm.
fn largest_difference(network: &Network, plain: &PlainNetwork, scale: Scale) -> f64 {
    let adjusted = plain
        .adjust(&PlainSettings::default(), &Monitor::new())
        .unwrap();
    let theirs = adjusted.points.iter().zip(&adjusted.adjustment.points);
    let pairs: Vec<_> = theirs
        .map(|(&index, point)| {
            let id = network.point_of_label(&plain.points[index].name).unwrap();
            (network.points[&id].position, point.position)
        })
        .collect();
    assert_eq!(pairs.len(), network.points.len());
    let fit = fit_similarity(&pairs, scale).unwrap();
    let off = pairs
        .iter()
        .map(|(own, their)| (fit.apply(own) - their).norm());
    off.fold(0.0, f64::max)
}

#[test]
fn a_colmap_model_becomes_a_project_and_gives_the_same_adjustment() {
    let folder = Folder::new("import-colmap");
    let plain = model(&folder, "sparse/0");
    let mut session = imported(&folder, Program::Colmap, ".").unwrap();
    {
        let network = session.network();
        assert_eq!(network.oriented_images().count(), plain.images.len());
        for (entry, image) in network.images.values().zip(&plain.images) {
            assert_eq!(entry.file.path, image.name);
            assert_eq!(entry.station.as_ref().unwrap().pose, image.start.unwrap());
        }
        let camera = &network.cameras.values().next().unwrap();
        assert_eq!(camera.camera, plain.cameras[0].camera());
        let held = camera.parameters.map(|p| p == LensParameter::Held);
        assert_eq!(
            held,
            plain.cameras[0]
                .parameters
                .map(|p| p == PlainParameter::Fixed)
        );
        for seen in &plain.observations {
            let entry = &network.images.values().nth(seen.image).unwrap();
            let label = entry
                .labels
                .iter()
                .find(|(_, label)| network.label(label.point) == plain.points[seen.point].name);
            let dot = &entry.detections.as_ref().unwrap().dots[label.unwrap().0.slot()];
            assert_eq!((dot.centre_px.x, dot.centre_px.y), (seen.x_px, seen.y_px));
            assert_eq!(dot.sigma_px, seen.sigma_px);
        }
    }
    measure(&mut session);
    let adjusted = plain
        .adjust(&PlainSettings::default(), &Monitor::new())
        .unwrap()
        .adjustment;
    let network = session.network();
    let own = network.adjustment.as_ref().unwrap();
    assert!(
        (own.sigma0 / adjusted.sigma0 - 1.0).abs() < 1e-6,
        "{}",
        own.sigma0
    );
    assert_eq!(own.redundancy, adjusted.redundancy as i64);
    // The model has no scale: a project counts its first base 1000 mm.
    let off = largest_difference(network, &plain, Scale::Free);
    assert!(off < 1e-4, "{off}");
    // Names and lens are in the file.
    drop(session);
    let session = Session::open(&folder.at("p.tiepoint")).unwrap();
    let network = session.network();
    let id = network.point_of_label(&plain.points[3].name).unwrap();
    assert_eq!(network.label(id), plain.points[3].name);
}

#[test]
fn gross_errors_of_an_imported_network_are_kept_until_the_settings_say_so() {
    let folder = Folder::new("import-gross");
    model(&folder, "model");
    let mut session = imported(&folder, Program::Colmap, "model").unwrap();
    measure(&mut session);
    let redundancy = session.network().adjustment.as_ref().unwrap().redundancy;
    let mut settings = session.network().settings.as_ref().clone();
    settings.gross_errors = GrossErrors::Reject;
    session.apply(&Edit::Settings(Box::new(settings))).unwrap();
    measure(&mut session);
    let network = session.network();
    let adjustment = network.adjustment.as_ref().unwrap();
    assert_eq!(adjustment.redundancy, redundancy - 2);
    let rejected = adjustment.observations.iter();
    let rejected: Vec<String> = rejected
        .filter(|row| row.standing == Standing::Rejected)
        .map(|row| {
            format!(
                "{} {}",
                network.images[&row.image].file.path,
                network.label(row.point)
            )
        })
        .collect();
    assert_eq!(rejected, ["I0 18"]);
}

#[test]
fn an_edit_of_an_imported_network_leaves_nothing_to_detect_or_connect() {
    let folder = Folder::new("import-edit");
    model(&folder, "model");
    let mut session = imported(&folder, Program::Colmap, "model").unwrap();
    measure(&mut session);
    let redundancy = session.network().adjustment.as_ref().unwrap().redundancy;
    let changed: Result<(), ImportingError> = session.edit("again", |network| {
        network.inputs += 1;
        Ok(())
    });
    changed.unwrap();
    measure(&mut session);
    let network = session.network();
    assert_eq!(network.adjustment.as_ref().unwrap().redundancy, redundancy);
    let others: Vec<&str> = network
        .findings
        .iter()
        .filter(|finding| finding.kind != FindingKind::Import)
        .map(|finding| finding.text.as_str())
        .collect();
    assert_eq!(others, [] as [&str; 0]);
    let kept = network.findings.iter();
    assert!(
        kept.filter(|finding| finding.kind == FindingKind::Import)
            .count()
            > 0
    );
}

fn project_of(network: PlainNetwork) -> Network {
    let pictures = beside(
        &network,
        Path::new("/no/such/folder"),
        Path::new("."),
        &Monitor::new(),
    )
    .unwrap();
    let told = Vec::new();
    document(&Source { network, told }, &pictures).unwrap()
}

#[test]
fn a_network_without_starts_gets_them_and_one_that_hangs_on_nothing_is_told() {
    let mut plain = network(LensDirection::Displacing {
        balanced_radius_mm: 8.0,
    });
    for image in &mut plain.images {
        image.start = None;
    }
    for point in &mut plain.points {
        point.start = None;
    }
    plain
        .observations
        .retain(|seen| seen.image != 7 || seen.point < 2);
    let own = project_of(plain);
    assert_eq!(own.oriented_images().count(), 7);
    assert_eq!(own.points.len(), 30);
    assert!(own.is_concluded(Stage::FirstPair) && !own.is_concluded(Stage::Connect));
    let told = "image 'I7': found 2 points, expected 3 or more: left out";
    assert!(
        own.findings.iter().any(|f| f.text == told),
        "{:?}",
        own.findings
    );
    let camera = own.cameras.values().next().unwrap();
    assert_eq!(camera.parameters, [LensParameter::Held; 10]);
    assert_eq!(
        camera.camera.interior.direction,
        LensDirection::Displacing {
            balanced_radius_mm: 8.0
        }
    );
    let bar = &own.scale_bars[0];
    assert_eq!((bar.from.as_str(), bar.to.as_str()), ("P0", "P29"));
    assert_eq!(own.point_of_label("P0"), Ok(PointId::Target(1)));
}

#[test]
fn known_coordinates_become_control_and_what_cannot_be_held_is_told() {
    let mut plain = network(LensDirection::Correcting);
    plain.residuals = ResidualPlane::Corrected;
    plain.datum = PlainDatum::Control;
    let known = |sigma_mm| {
        Some(Known {
            value_mm: 5.0,
            sigma_mm,
        })
    };
    for (point, coordinates, role) in [
        (0, [known(None); 3], PointRole::Control),
        (1, [known(Some(0.1)), None, known(None)], PointRole::Control),
        (2, [known(Some(0.2)); 3], PointRole::Check),
    ] {
        plain.points[point].known = coordinates;
        plain.points[point].role = role;
    }
    let own = project_of(plain);
    let roles: Vec<ControlRole> = own.control.iter().map(|control| control.role).collect();
    let expected = [
        ControlRole::Fixed,
        ControlRole::Weighted,
        ControlRole::Check,
    ];
    assert_eq!(roles, expected);
    assert_eq!(own.control[0].sigmas_mm, [None; 3]);
    assert_eq!(own.control[1].coordinates_mm, [Some(5.0), None, Some(5.0)]);
    assert_eq!(own.control[1].sigmas_mm, [Some(0.1), None, Some(1e-6)]);
    for words in ["in the corrected plane", "found 1 measured control points"] {
        let mut told = own.findings.iter().filter(|f| f.about == About::Project);
        assert!(told.any(|f| f.text.contains(words)), "{:?}", own.findings);
    }
}

#[test]
fn pictures_beside_the_files_are_the_images_where_they_have_its_size() {
    let folder = Folder::new("import-pictures");
    folder.picture("model/images/left.pgm", 1);
    folder.picture("model/deep/RIGHT.PGM", 2);
    folder.picture("model/7.pgm", 3);
    folder.picture("model/one/twice.pgm", 4);
    folder.picture("model/two/twice.pgm", 5);
    let mut plain = network(LensDirection::Correcting);
    let names = [
        "left.pgm",
        "right.pgm",
        "7",
        "twice",
        "gone",
        "6.pgm",
        "5",
        "4",
    ];
    for (image, name) in plain.images.iter_mut().zip(names) {
        image.name = name.to_owned();
    }
    let found = |plain: &PlainNetwork| -> PictureFiles {
        beside(plain, &folder.at("model"), &folder.at("."), &Monitor::new()).unwrap()
    };
    let other = found(&plain);
    assert_eq!((other.missing, other.refused.len()), (5, 3));
    assert!(other.refused[&0].ends_with("found 4 x 3 px, expected 4000 x 3000 px of its camera"));
    (plain.cameras[0].width_px, plain.cameras[0].height_px) = (4, 3);
    let same = found(&plain);
    let paths: Vec<&str> = same.files.iter().map(|file| file.path.as_str()).collect();
    let expected = [
        "model/images/left.pgm",
        "model/deep/RIGHT.PGM",
        "model/7.pgm",
        "twice",
    ];
    assert_eq!(paths[..4], expected);
    assert!(same.files[..3].iter().all(|file| file.sha256.len() == 64));
    assert!(same.files[3..].iter().all(|file| file.sha256.is_empty()));
    assert_eq!((same.missing, same.refused.len()), (5, 0));
}

#[test]
fn bad_input_is_one_line_and_leaves_no_project() {
    let folder = Folder::new("import-bad");
    folder.write("empty/readme.md", b"");
    folder.write("binary/sparse/0/cameras.bin", b"");
    folder.write("half/cameras.txt", b"1 PINHOLE 4 3 1 1 2 1.5\n");
    folder.write("twice/a.ior", b"");
    folder.write("twice/b.IOR", b"");
    folder.write("marks/c.xml", b"<camera>");
    folder.write("marks/a.txt", b"1, 2, 3, 4\n");
    folder.write("marks/b.txt", b"1, 2, 3, 4\n");
    folder.write("words/c.xml", b"\xff\xfe");
    for (program, place, words) in [
        (
            Program::Aicon,
            "gone",
            "gone: found no such folder, expected the folder of",
        ),
        (
            Program::Aicon,
            "twice/a.ior",
            "a.ior: found a file, expected the folder of",
        ),
        (
            Program::Aicon,
            "empty",
            "empty: found no file .ior, expected an AICON bundle",
        ),
        (
            Program::Aicon,
            "twice",
            "twice: found 2 files .ior (a.ior, b.IOR), expected one of them",
        ),
        (
            Program::Dbat,
            "empty",
            "empty: found no file .xml, expected a camera",
        ),
        (
            Program::Dbat,
            "marks",
            "marks: found 2 tables of marked points (a.txt, b.txt), expected one",
        ),
        (
            Program::Dbat,
            "words",
            "c.xml: found text in UTF-16, expected UTF-8",
        ),
        (
            Program::Colmap,
            "empty",
            "empty: found no cameras.txt, expected a COLMAP text model",
        ),
        (
            Program::Colmap,
            "binary",
            "binary: found a binary model, expected a text model",
        ),
        (Program::Colmap, "half", "images.txt: cannot be read: "),
    ] {
        let line = imported(&folder, program, place)
            .map(drop)
            .unwrap_err()
            .to_string();
        assert!(line.contains(words) && !line.contains('\n'), "{line}");
        assert!(!folder.at("p.tiepoint").exists(), "{line}");
    }
    folder.write("p.tiepoint", b"");
    let line = imported(&folder, Program::Colmap, "gone")
        .map(drop)
        .unwrap_err();
    assert!(matches!(line, ImportingError::Exists { .. }), "{line}");
}
