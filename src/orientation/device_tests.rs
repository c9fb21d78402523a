//! Recognition of the reference cross in simulated dot fields.

use super::*;
use crate::orientation::simulation::{self, Noise, REFERENCE_CROSS};
use nalgebra::Rotation3;
use rand::RngExt;

fn device() -> Vec<Vector3<f64>> {
    REFERENCE_CROSS.map(Vector3::from).to_vec()
}

fn dot(ideal: Vector2<f64>) -> ImageDot {
    ImageDot {
        ideal,
        diameter_mm: None,
    }
}

/// A station that sees the device anywhere in the frame.
fn station(seed: u64) -> Pose {
    let pose = simulation::station(seed);
    let mut rng = simulation::random(seed ^ 0xfeed);
    let turn = Vector3::new(
        rng.random_range(-0.25..0.25),
        rng.random_range(-0.4..0.4),
        0.0,
    );
    pose.moved(&turn, &Vector3::zeros())
}

fn random_field(count: usize, seed: u64) -> Vec<ImageDot> {
    let mut rng = simulation::random(seed ^ 0xf1e1d);
    (0..count)
        .map(|_| {
            dot(Vector2::new(
                rng.random_range(-13.8..13.8),
                rng.random_range(-9.2..9.2),
            ))
        })
        .collect()
}

/// A plane of dots `pitch` mm apart as a pose sees it.
fn grid_field(pose: &Pose, pitch: f64, half: i32, tilt: f64, seed: u64) -> Vec<ImageDot> {
    let mut rng = simulation::random(seed ^ 0x621d);
    let turn = Rotation3::new(Vector3::new(tilt, 0.0, 0.0));
    let mut dots = Vec::new();
    for i in -half..=half {
        for j in -half..=half {
            let point = turn * Vector3::new(f64::from(i) * pitch, f64::from(j) * pitch, -30.0);
            let k = pose.camera_from_point(&point);
            let error =
                0.0009 * Vector2::new(simulation::normal(&mut rng), simulation::normal(&mut rng));
            let ideal = k.xy() * (-20.0 / k.z) + error;
            if ideal.x.abs() < 13.8 && ideal.y.abs() < 9.2 {
                dots.push(dot(ideal));
            }
        }
    }
    dots
}

#[test]
fn the_cross_is_found_among_many_dots() {
    let (mut found, mut trials) = (0, 0);
    let mut reasons = Vec::new();
    for seed in 0..12 {
        let pose = station(seed);
        let seen = simulation::ideal_points(&REFERENCE_CROSS, &pose, Noise(0.1), seed);
        if seen
            .iter()
            .any(|p| p.ideal.x.abs() > 13.8 || p.ideal.y.abs() > 9.2)
        {
            continue;
        }
        let mut dots = random_field(120, seed);
        for (k, p) in seen.iter().enumerate() {
            dots.insert(17 * k, dot(p.ideal));
        }
        trials += 1;
        match recognise_device(&device(), &dots, &[], 20.0, &DeviceSettings::default()) {
            Ok(device) => {
                let expected: Vec<Option<usize>> = (0..6).map(|k| Some(17 * k)).collect();
                assert_eq!(device.dots, expected, "seed {seed}");
                assert!(
                    (device.poses[0].pose.centre_in_world - pose.centre_in_world).norm() < 20.0
                );
                found += 1;
            }
            Err(reason) => reasons.push(format!("{seed}: {reason}")),
        }
    }
    assert!(
        trials >= 6 && found + 1 >= trials,
        "{found} of {trials}: {reasons:?}"
    );
}

#[test]
fn random_fields_and_grids_are_not_taken_for_the_cross() {
    let mut alarms = Vec::new();
    for seed in 0..3 {
        let fields = [
            random_field(60 + 40 * seed as usize, seed),
            grid_field(&station(seed), 40.0, 6, 0.0, seed),
            grid_field(&station(seed), 25.0, 6, 0.3, seed),
        ];
        for field in fields {
            if let Ok(found) =
                recognise_device(&device(), &field, &[], 20.0, &DeviceSettings::default())
            {
                alarms.push((seed, field.len(), found));
            }
        }
    }
    assert!(alarms.is_empty(), "{alarms:?}");
}

#[test]
fn one_dot_may_be_missing_where_few_others_stand() {
    for missing in 0..6 {
        let pose = simulation::station(40 + missing as u64);
        let seen = simulation::ideal_points(&REFERENCE_CROSS, &pose, Noise(0.05), 3);
        let mut dots: Vec<ImageDot> = seen
            .iter()
            .enumerate()
            .filter(|(k, _)| *k != missing)
            .map(|(_, p)| dot(p.ideal))
            .collect();
        dots.extend(random_field(12, missing as u64));
        let found = recognise_device(&device(), &dots, &[], 20.0, &DeviceSettings::default());
        if missing == 5 {
            // Without X6 the cross looks the same after a quarter turn.
            assert!(matches!(found, Err(NotRecognised::Ambiguous { .. })));
            continue;
        }
        let found = found.unwrap();
        let expected: Vec<Option<usize>> = (0..6)
            .map(|k| (k != missing).then(|| k - usize::from(k > missing)))
            .collect();
        assert_eq!(found.dots, expected);
    }
}

#[test]
fn a_symmetric_flat_device_is_ambiguous_and_a_lopsided_one_has_two_poses() {
    let pose = simulation::station(11);
    let square = [
        [100.0, 0.0, 0.0],
        [-100.0, 0.0, 0.0],
        [0.0, 100.0, 0.0],
        [0.0, -100.0, 0.0],
        [0.0, 0.0, 0.0],
    ];
    let lopsided = [
        [100.0, 0.0, 0.0],
        [-80.0, 0.0, 0.0],
        [0.0, 100.0, 0.0],
        [0.0, -100.0, 0.0],
        [35.0, 60.0, 0.0],
    ];
    let recognise = |points: &[[f64; 3]]| {
        let dots: Vec<ImageDot> = simulation::ideal_points(points, &pose, Noise(0.02), 1)
            .iter()
            .map(|p| dot(p.ideal))
            .collect();
        let device: Vec<Vector3<f64>> = points.iter().map(|p| Vector3::from(*p)).collect();
        recognise_device(&device, &dots, &[], 20.0, &DeviceSettings::default())
    };
    assert!(matches!(
        recognise(&square),
        Err(NotRecognised::Ambiguous { .. })
    ));
    let found = recognise(&lopsided).unwrap();
    assert_eq!(found.dots, (0..5).map(Some).collect::<Vec<_>>());
    assert!((found.poses[0].pose.centre_in_world - pose.centre_in_world).norm() < 20.0);
}

#[test]
fn useless_input_has_a_reason() {
    let settings = DeviceSettings::default();
    let line: Vec<Vector3<f64>> = (0..5).map(|k| Vector3::x() * f64::from(k)).collect();
    let dots = random_field(10, 1);
    assert!(matches!(
        recognise_device(&line, &dots, &[], 20.0, &settings),
        Err(NotRecognised::DeviceShape(PlaneError::Collinear))
    ));
    assert!(matches!(
        recognise_device(&line[..3], &dots, &[], 20.0, &settings),
        Err(NotRecognised::DeviceSize { found: 3 })
    ));
    assert!(matches!(
        recognise_device(&device(), &dots, &[0, 1, 2, 3, 4, 5], 20.0, &settings),
        Err(NotRecognised::TooFewDots {
            found: 4,
            needed: 5
        })
    ));
    let mut odd = vec![dot(Vector2::zeros()); 30];
    odd[3].ideal.x = f64::NAN;
    assert!(recognise_device(&device(), &odd, &[], 20.0, &settings).is_err());
}
