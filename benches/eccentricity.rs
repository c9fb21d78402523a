//! Errors of coordinates over their printed sigmas, box experiment after box experiment:
//! `cargo bench --bench eccentricity [SEEDS]` (default 20; minutes).
//!
//! Sigmas are true when the mean over many seeds is one; a single network of some 350 points, whose errors go together,
//! strays by a tenth. The second group has dots of some 30 px, of which the eccentricity is several sigmas.

#![allow(clippy::print_stdout, reason = "a program whose result is its table")]

#[path = "../tests/rendered/mod.rs"]
mod rendered;

use std::sync::Arc;

use rendered::{measure, of_experiment_with};
use tiepoint::network::{DotFamily, Network, Standing};
use tiepoint::report::{TruthCheck, check_against_truth};
use tiepoint::synthetic::{BoxSettings, RenderSettings, box_experiment};
use tiepoint::targets::Family;

struct Group {
    name: &'static str,
    scene: BoxSettings,
}

fn groups() -> [Group; 2] {
    [
        Group {
            name: "the paper's box, dots of 5 mm",
            scene: BoxSettings::default(),
        },
        Group {
            name: "dots of 15 mm, pitch 12 mm, 8 codes, 60 targets",
            scene: BoxSettings {
                dot_mm: 15.0,
                pitch_mm: 12.0,
                codes: 8,
                plain_targets: 60,
                ..BoxSettings::default()
            },
        },
    ]
}

fn measured(scene: &BoxSettings, seed: u64) -> (Network, TruthCheck) {
    let settings = BoxSettings {
        seed,
        ..scene.clone()
    };
    let experiment = box_experiment(&settings).expect("a scene with room");
    let light = RenderSettings::default();
    let mut rendered = of_experiment_with(&experiment, seed, Family::Dot420, &light);
    let measurement = Arc::make_mut(&mut rendered.network.settings);
    measurement.targets.plain_dot_mm = scene.dot_mm;
    measurement.targets.families = vec![DotFamily {
        family: Family::Dot420,
        pitch_mm: scene.pitch_mm,
        dot_mm: scene.dot_mm,
    }];
    let network = measure(rendered.network, &rendered.pictures);
    let check = check_against_truth(&network, &rendered.truth).expect("points to compare");
    (network, check)
}

/// Rms eccentricity of the used dots per coordinate, px, and the share of them of which the circle is known.
fn eccentricity(network: &Network) -> (f64, f64) {
    let (mut squares, mut known, mut all) = (0.0, 0.0, 0.0);
    let rows = network.adjustment.iter().flat_map(|a| &a.observations);
    for row in rows.filter(|row| row.standing == Standing::Used) {
        let image = &network.images[&row.image];
        let point = &network.points[&row.point];
        all += 1.0;
        if let (Some(station), Some(circle)) = (&image.station, &point.circle) {
            let camera = &network.camera_of(image).camera;
            let shift = camera.eccentricity(&station.pose, &point.position, circle);
            squares += shift.expect("a dot that is imaged").norm_squared() / 2.0;
            known += 1.0;
        }
    }
    (f64::sqrt(squares / known), known / all)
}

fn main() {
    let seeds: u64 = std::env::args()
        .skip(1)
        .find_map(|word| word.parse().ok())
        .unwrap_or(20);
    for Group { name, scene } in groups() {
        println!("{name}");
        println!("seed  images  points  rms_mm  sigma0  errors/sigmas  eccentricity_px  circles");
        let (mut ratios, mut sigma0s, mut rms) = (Vec::new(), Vec::new(), Vec::new());
        for seed in 1..=seeds {
            let (network, check) = measured(&scene, seed);
            let sigma0 = network.adjustment.as_ref().map_or(f64::NAN, |a| a.sigma0);
            let (shift, share) = eccentricity(&network);
            println!(
                "{seed:4}  {:6}  {:6}  {:.4}  {sigma0:.3}   {:13.2}  {shift:15.4}  {:5.1} %",
                check.images_oriented,
                check.targets_as_points,
                check.rms_mm,
                check.error_over_sigma,
                100.0 * share,
            );
            ratios.push(check.error_over_sigma);
            sigma0s.push(sigma0);
            rms.push(check.rms_mm);
        }
        println!(
            "mean                  {:.4}  {:.3}   {:13.2} (least {:.2}, largest {:.2})",
            mean(&rms),
            mean(&sigma0s),
            mean(&ratios),
            ratios.iter().copied().fold(f64::INFINITY, f64::min),
            ratios.iter().copied().fold(0.0, f64::max),
        );
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
