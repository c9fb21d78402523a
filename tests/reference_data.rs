//! Real photographs with known points. They are not part of the project: where they are absent, the tests say so.

mod data_sets;

use std::collections::BTreeMap;
use std::path::Path;

use data_sets::{data, say};
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use tiepoint::commands::measure;
use tiepoint::geometry::{Scale, Similarity};
use tiepoint::monitor::Monitor;
use tiepoint::network::{Network, PointId, Stage};
use tiepoint::project::files::{read_cameras, read_reference};
use tiepoint::project::intake::{add_cameras, add_images};
use tiepoint::project::session::Session;
use tiepoint::report::{
    CompareSettings, Naming, NamingSettings, ReferencePoint, Way, compare, name_by_reference,
};
use tiepoint::targets::Family;

/// The centres of codes that another program found, by image and number.
fn published_centres(file: &Path) -> Vec<(String, u32, [f64; 2])> {
    let text = std::fs::read_to_string(file).expect("the published centres");
    text.lines()
        .skip(1)
        .map(|line| {
            let fields: Vec<&str> = line.split(',').collect();
            let number = |k: usize| fields[k].parse::<f64>().expect("a number");
            (
                fields[0].to_owned(),
                number(1) as u32,
                [number(2), number(3)],
            )
        })
        .collect()
}

#[test]
fn the_panel_of_known_points_is_measured_from_photographs() {
    let Some(folder) = data("aicon-panel") else {
        return;
    };
    let scratch = std::env::temp_dir().join(format!("tiepoint-panel-{}", std::process::id()));
    std::fs::create_dir_all(&scratch).expect("a temporary folder");
    let project = scratch.join("panel.tiepoint");

    let mut network = Network::default();
    std::sync::Arc::make_mut(&mut network.settings).families = vec![Family::Ring(14)];
    add_cameras(
        &mut network,
        &read_cameras(&folder.join("camera.toml")).expect("a camera"),
    );
    let monitor = Monitor::new();
    add_images(&mut network, &scratch, &[folder.join("images")], &monitor).expect("images");
    let mut session = Session::create(&project, network).expect("a project");
    measure(&mut session, Stage::Adjust, &Monitor::new()).expect("a measurement");
    let network = session.network().clone();
    drop(session);
    std::fs::remove_dir_all(&scratch).expect("the temporary folder");

    assert_eq!(network.oriented_images().count(), 20);
    compare_centres(
        &network,
        &published_centres(&folder.join("coded_observations_mmvii.csv")),
    );

    let reference = read_reference(&folder.join("points.csv")).expect("known points");
    let settings = CompareSettings {
        scale: Scale::Free,
        ..CompareSettings::default()
    };
    let comparison = compare(&network, &reference, &settings).expect("common points");
    assert_eq!(comparison.by_label.points, 73);
    // The other program's centres reach 0.008 mm; the known points' own uncertainty is not stated.
    for rms in [
        comparison.by_label.rms_x_mm,
        comparison.by_label.rms_y_mm,
        comparison.by_label.rms_z_mm,
    ] {
        assert!(rms.is_some_and(|rms| rms <= 0.015), "{rms:?} mm");
    }
    assert_eq!(comparison.by_place.points, 166, "plain dots as points");
    plain_dots_get_their_names(&network, &reference);
    every_plain_dot_is_what_it_is_called(&network, &reference);
}

/// By the codes, and by nothing but the irregularity of a panel on which dots stand every 82 mm.
fn plain_dots_get_their_names(network: &Network, reference: &[ReferencePoint]) {
    let settings = NamingSettings {
        scale: Scale::Free,
        ..NamingSettings::default()
    };
    let by_codes = name_by_reference(network, reference, &settings).expect("common codes");
    let without_labels: Vec<ReferencePoint> = reference
        .iter()
        .map(|point| ReferencePoint {
            label: Some(format!("known {}", point.name)),
            ..point.clone()
        })
        .collect();
    let by_geometry = name_by_reference(network, &without_labels, &settings);
    let told = |naming: &Naming| {
        format!(
            "{} dots named within {:.2} mm, rms {:.4} mm, largest {:.4} mm, {} ambiguous",
            naming.names.len(),
            naming.within_mm,
            naming.named.rms_mm.unwrap_or_default(),
            naming.named.largest_mm.unwrap_or_default(),
            naming.ambiguous.len()
        )
    };
    say(&format!("by codes: {}", told(&by_codes)));
    assert_eq!(by_codes.way, Way::Labels);
    assert!(by_codes.names.len() >= 160, "{}", by_codes.names.len());
    assert!(by_codes.named.rms_mm.is_some_and(|rms| rms < 0.03));
    let by_geometry = by_geometry.expect("one pose");
    say(&format!("by geometry: {}", told(&by_geometry)));
    let known = |name: &String| format!("known {name}");
    let named: Vec<_> = by_codes.names.values().map(known).collect();
    assert_eq!(by_geometry.names.into_values().collect::<Vec<_>>(), named);
}

/// The known points, brought into the network by the codes and projected with the final orientations: each labelled plain dot lies at
/// the place of its own point and of no other.
fn every_plain_dot_is_what_it_is_called(network: &Network, reference: &[ReferencePoint]) {
    /// A known point is projected to its dot within this distance, px: 0.02 mm in a picture of 3 px/mm and what a lens leaves.
    const NEAR_PX: f64 = 0.5;
    let settings = NamingSettings {
        scale: Scale::Free,
        ..NamingSettings::default()
    };
    let naming = name_by_reference(network, reference, &settings).expect("common codes");
    let fit = Similarity {
        scale: naming.scale,
        rotation: Rotation3::from_matrix_unchecked(Matrix3::from_fn(|r, c| naming.rotation[r][c])),
        translation: naming.translation_mm.into(),
    };
    let into_network = fit.inverse();
    let known: BTreeMap<&str, Vector3<f64>> = reference
        .iter()
        .filter_map(|point| Some((point.name.as_str(), into_network.apply(&point.position()?))))
        .collect();
    let (mut right, mut wrong, mut unlisted) = (0, Vec::new(), 0);
    for (_, image, station) in network.oriented_images() {
        let camera = &network.camera_of(image).camera;
        let detections = image.detections.as_ref().expect("detections");
        let places: Vec<(&str, Vector2<f64>)> = known
            .iter()
            .filter_map(|(name, point)| {
                Some((
                    *name,
                    camera.project(&station.pose.camera_from_point(point))?,
                ))
            })
            .collect();
        for (dot, label) in image.used_labels() {
            let PointId::Target(number) = label.point else {
                continue;
            };
            let Some(own) = naming.names.get(&number) else {
                unlisted += 1;
                continue;
            };
            let place = detections.dots[dot.slot()].centre_px;
            let nearest = places
                .iter()
                .map(|(name, at)| ((at - place).norm(), *name))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            match nearest {
                Some((distance, name)) if name == own && distance < NEAR_PX => right += 1,
                other => wrong.push(format!("{}: {own} at {other:?}", image.file.path)),
            }
        }
    }
    say(&format!(
        "{right} observations of plain dots at the places of their known points, {} elsewhere, {unlisted} of dots that are not listed",
        wrong.len()
    ));
    assert_eq!(wrong, [] as [String; 0]);
    assert!(right > 2400, "{right}");
}

/// At least 1060 of 1086 codes with the same number, none with another, centres within 0.05 px rms.
fn compare_centres(network: &Network, published: &[(String, u32, [f64; 2])]) {
    let readings: BTreeMap<&str, Vec<(u32, [f64; 2])>> = network
        .used_images()
        .map(|(_, image)| {
            let detections = image.detections.as_ref().expect("detections");
            let codes = detections.codes.iter().map(|code| {
                let centre = detections.dots[code.dots[0].slot()].centre_px;
                (code.id, [centre.x, centre.y])
            });
            (
                image.file.path.rsplit('/').next().expect("a name"),
                codes.collect(),
            )
        })
        .collect();
    let mut same = 0;
    let mut squares = 0.0;
    let mut other = Vec::new();
    for (image, number, centre) in published {
        // A code is some 40 px wide: nothing else can lie this near to its centre.
        let here = readings[image.as_str()]
            .iter()
            .find(|(_, c)| (c[0] - centre[0]).hypot(c[1] - centre[1]) < 5.0);
        match here {
            Some((found, c)) if found == number => {
                same += 1;
                squares += ((c[0] - centre[0]).powi(2) + (c[1] - centre[1]).powi(2)) / 2.0;
            }
            Some((found, _)) => other.push(format!("{image}: {found} is {number}")),
            None => {}
        }
    }
    let rms = (squares / f64::from(same)).sqrt();
    say(&format!(
        "{same} of {} codes with the same number, rms {rms:.4} px",
        published.len()
    ));
    assert_eq!(other, [] as [String; 0]);
    assert!(same >= 1060, "{same} codes");
    assert!(rms <= 0.05, "{rms} px");
}
