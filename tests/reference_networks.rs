//! Other programs' adjustments, made again from their data: what they published is found again.

mod data_sets;

use std::collections::BTreeMap;
use std::path::Path;

use data_sets::{adjusted, data, named, say, text};
use nalgebra::{Rotation3, Vector3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tiepoint::adjustment::AdjustedPoint;
use tiepoint::camera::INTERIOR_NAMES;
use tiepoint::geometry::{Scale, fit_similarity};
use tiepoint::plain_network::{
    AiconTexts, DbatTexts, PlainAdjustment, PlainNetwork, from_aicon, from_dbat,
};

/// A value of the adjusted camera and its standard deviation.
fn of_camera(adjusted: &PlainAdjustment, name: &str) -> [f64; 2] {
    let camera = &adjusted.adjustment.cameras[0];
    let parameter = INTERIOR_NAMES.iter().position(|n| *n == name).unwrap();
    let value = camera.camera.interior.to_vector()[parameter];
    [value, camera.covariance[(parameter, parameter)].sqrt()]
}

/// The bundle with the protocol's weights, from starts off by 10 mm, 10 mrad and 1 % of the principal distance.
fn aicon(folder: &Path) -> PlainNetwork {
    let files =
        ["ior", "eor", "obc", "phc", "scale"].map(|kind| text(folder, &format!("example.{kind}")));
    let [cameras, orientations, points, image_points, bars] = files.each_ref().map(|t| named(t));
    let mut network = from_aicon(AiconTexts {
        cameras,
        orientations,
        points,
        image_points,
        bars: Some(bars),
    })
    .unwrap();
    let four = [("27", "48"), ("49", "48"), ("60", "48"), ("49", "54")];
    let pitch = network.cameras[0].pixel_pitch_mm;
    for seen in &mut network.observations {
        let names = (
            network.points[seen.point].name.as_str(),
            network.images[seen.image].name.as_str(),
        );
        if four.contains(&names) {
            seen.sigma_px = 0.005 / pitch;
        }
    }
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut vector = |size: f64| Vector3::from_fn(|_, _| random.random_range(-size..size));
    for image in &mut network.images {
        let start = image.start.as_mut().unwrap();
        start.centre_in_world += vector(10.0);
        start.camera_from_world = Rotation3::new(vector(0.010)) * start.camera_from_world;
    }
    for point in &mut network.points {
        let start = point.start.as_mut().unwrap();
        let off = vector(10.0);
        *start = std::array::from_fn(|axis| start[axis] + off[axis]);
    }
    network.cameras[0].values[0] *= 1.01;
    network
}

/// A point as the protocol prints it, mm.
struct Printed {
    place: Vector3<f64>,
    sigmas: Vector3<f64>,
}

fn printed_points(text: &str) -> BTreeMap<String, Printed> {
    let row = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let three = |from: usize| {
            let number = |k: usize| words.get(from + k)?.parse::<f64>().ok();
            Some(Vector3::new(number(0)?, number(1)?, number(2)?))
        };
        let printed = Printed {
            place: three(1)?,
            sigmas: three(4)?,
        };
        Some(((*words.first()?).to_owned(), printed))
    };
    text.lines().filter_map(row).collect()
}

#[test]
fn the_aicon_bundle_gives_its_protocol() {
    let Some(folder) = data("aicon-bundle") else {
        return;
    };
    let network = aicon(&folder);
    let printed = printed_points(&text(&folder, "example.obc"));
    let adjusted = adjusted(&network);
    assert_eq!(adjusted.told, Vec::<String>::new());
    let a = &adjusted.adjustment;
    // The network's unit is the millimetre, its image unit the pixel; the protocol's weights are 0.0005 mm.
    let sigma0_mm = a.sigma0 * 0.0005;
    say(&format!(
        "aicon-bundle: sigma0 {sigma0_mm:.8} mm (published 0.000405), redundancy {} (published 18804), {} iterations",
        a.redundancy, a.iterations
    ));
    assert!((sigma0_mm - 0.000_405).abs() < 5e-7, "{sigma0_mm}");
    assert_eq!(a.redundancy, 18804);
    let found: Vec<(&AdjustedPoint, &Printed)> = adjusted
        .points
        .iter()
        .zip(&a.points)
        .filter_map(|(&index, point)| Some((point, printed.get(&network.points[index].name)?)))
        .collect();
    assert_eq!(found.len(), 150);
    let pairs: Vec<(Vector3<f64>, Vector3<f64>)> = found
        .iter()
        .map(|(own, theirs)| (own.position, theirs.place))
        .collect();
    let fit = fit_similarity(&pairs, Scale::One).unwrap();
    let off = pairs
        .iter()
        .map(|(own, theirs)| (fit.apply(own) - theirs).amax());
    let largest = off.fold(0.0, f64::max);
    let mut worst_sigma = 0.0_f64;
    for (own, theirs) in &found {
        // In the frame of the print, which the disturbed starts turned by some 0.1 mrad.
        let turn = fit.rotation.matrix();
        let covariance = turn * own.covariance.unwrap() * turn.transpose();
        let sigmas = covariance.diagonal().map(f64::sqrt);
        worst_sigma = worst_sigma.max((sigmas - theirs.sigmas).amax());
    }
    let bar = a.distances[0].unwrap();
    say(&format!(
        "aicon-bundle: coordinates within {:.4} um, point sigmas within {worst_sigma:.6} mm, bar {:+.5} mm",
        1e3 * largest,
        bar.residual_mm
    ));
    // Printed to 0.1 um.
    assert!(largest < 1e-4, "{largest}");
    assert!(worst_sigma < 5.0e-5, "{worst_sigma}");
    let printed = [
        ("c", 28.78507, 2.513e-4),
        ("x0", 0.017_348_92, 3.442e-4),
        ("y0", 0.056_687_31, 3.263e-4),
        ("K1", -1.096_069e-4, 2.979e-8),
        ("K2", 1.495_660e-7, 7.656e-11),
        ("P1", 5.798_428e-6, 1.191e-7),
        ("P2", -8.644_540e-6, 1.044e-7),
    ];
    for (name, value, sigma) in printed {
        let [found, found_sigma] = of_camera(&adjusted, name);
        say(&format!(
            "aicon-bundle: {name} {found:.7e} +- {found_sigma:.4e} (published {value:.7e} +- {sigma:.3e})"
        ));
        assert!((found / value - 1.0).abs() < 1e-4, "{name}: {found}");
        // Four printed digits.
        assert!(
            (found_sigma / sigma - 1.0).abs() < 2.5e-4,
            "{name}: {found_sigma}"
        );
    }
}

#[test]
fn the_dbat_calibration_gives_its_report() {
    let Some(folder) = data("dbat-camcal") else {
        return;
    };
    let [marks, camera, control] =
        ["markpts.txt", "c4040z.xml", "camcal-fixed.txt"].map(|file| text(&folder, file));
    let network = from_dbat(DbatTexts {
        marks: named(&marks),
        camera: named(&camera),
        control: Some(named(&control)),
        images: None,
        stations: None,
    })
    .unwrap();
    let adjusted = adjusted(&network);
    // The corners of the sheet are held at a flat unit square; the images see it warped by some thousandths.
    let [warp] = &adjusted.told[..] else {
        panic!("{:#?}", adjusted.told);
    };
    say(&format!("dbat-camcal: {warp}"));
    let corners = ["1001", "1002", "1003", "1004"].map(|name| format!("z of point '{name}'"));
    assert!(corners.iter().all(|corner| warp.contains(corner)), "{warp}");
    assert!(
        warp.ends_with("nothing tells which, all are used"),
        "{warp}"
    );
    let a = &adjusted.adjustment;
    say(&format!(
        "dbat-camcal: sigma0 {:.5} (published 1.6148), redundancy {} (published 3725), {} iterations",
        a.sigma0, a.redundancy, a.iterations
    ));
    let half = [1136.0, 852.0].map(|n| n * network.cameras[0].pixel_pitch_mm);
    // Value and deviation as they are printed, with half of the last digit of either.
    let printed = [
        ("c", 7.457, 5e-4, 0.00105, 5e-6),
        ("x0", 3.61546 - half[0], 5e-6, 0.00082, 5e-6),
        ("y0", half[1] - 2.61329, 5e-6, 0.00098, 5e-6),
        ("K1", 4.588_61e-3, 5e-9, 2.21e-5, 5e-8),
        ("K2", -4.513_51e-5, 5e-11, 2.65e-6, 5e-9),
        ("K3", -2.052_53e-6, 5e-12, 1.01e-7, 5e-10),
        ("P1", -6.128_03e-5, 5e-11, 3.52e-6, 5e-9),
        ("P2", -4.411_72e-5, 5e-11, 3.94e-6, 5e-9),
        ("B1", 3.895_98e-4, 5e-10, 2.08e-5, 5e-8),
    ];
    for (name, value, value_half, sigma, sigma_half) in printed {
        let [found, found_sigma] = of_camera(&adjusted, name);
        say(&format!(
            "dbat-camcal: {name} {found:.6e} +- {found_sigma:.3e} (published {value:.6e} +- {sigma:.3e})"
        ));
        // Nor does the other program end at the last digit of the minimum.
        assert!((found - value).abs() < 1.5 * value_half, "{name}: {found}");
        assert!(
            (found_sigma - sigma).abs() < 1.01 * sigma_half,
            "{name}: {found_sigma}"
        );
    }
    assert!((a.sigma0 - 1.6148).abs() < 5e-5, "{}", a.sigma0);
    assert_eq!(a.redundancy, 3725);
}
