//! The box experiment over many seeds, lights and network sizes, against truth: `cargo bench --bench campaign [WORD]`
//! (only the cases whose name holds WORD). Minutes; one line a case.

#[path = "../tests/rendered/mod.rs"]
mod rendered;

use std::sync::Arc;
use std::time::Instant;

use rendered::{measure, of_experiment_with};
use tiepoint::network::DotFamily;
use tiepoint::report::check_against_truth;
use tiepoint::synthetic::{BoxSettings, RenderSettings, box_experiment};
use tiepoint::targets::Family;

struct Case {
    name: &'static str,
    scene: BoxSettings,
    light: RenderSettings,
}

fn cases() -> Vec<Case> {
    let scene = |seed| BoxSettings {
        seed,
        ..BoxSettings::default()
    };
    let light = RenderSettings::default;
    let case = |name, scene, light| Case { name, scene, light };
    vec![
        case("seed 201", scene(201), light()),
        case("seed 202", scene(202), light()),
        case("seed 203", scene(203), light()),
        case(
            "no cross",
            BoxSettings {
                cross: None,
                ..scene(204)
            },
            light(),
        ),
        case(
            "no cross, no bars",
            BoxSettings {
                cross: None,
                bars: 0,
                ..scene(205)
            },
            light(),
        ),
        case(
            "peak 100",
            scene(206),
            RenderSettings {
                peak_grey: 100.0,
                ..light()
            },
        ),
        case(
            "peak 60",
            scene(207),
            RenderSettings {
                peak_grey: 60.0,
                ..light()
            },
        ),
        case(
            "saturated",
            scene(208),
            RenderSettings {
                peak_grey: 300.0,
                ..light()
            },
        ),
        case(
            "noise 5",
            scene(209),
            RenderSettings {
                noise_sigma_grey: 5.0,
                ..light()
            },
        ),
        case(
            "blur 1.5 px",
            scene(210),
            RenderSettings {
                blur_sigma_px: 1.5,
                ..light()
            },
        ),
        case(
            "blur 0.4 px",
            scene(211),
            RenderSettings {
                blur_sigma_px: 0.4,
                ..light()
            },
        ),
        case(
            "black",
            scene(212),
            RenderSettings {
                background: 0.0,
                texture_grey: 0.0,
                ..light()
            },
        ),
        case(
            "bright texture",
            scene(213),
            RenderSettings {
                background: 3.0,
                texture_grey: 5.0,
                ..light()
            },
        ),
        case(
            "pitch 8 mm",
            BoxSettings {
                pitch_mm: 8.0,
                codes: 24,
                ..scene(214)
            },
            light(),
        ),
        case(
            "12 stations",
            BoxSettings {
                stations: 12,
                ..scene(215)
            },
            light(),
        ),
        case(
            "60 stations",
            BoxSettings {
                stations: 60,
                ..scene(216)
            },
            light(),
        ),
        case(
            "12 codes",
            BoxSettings {
                codes: 12,
                ..scene(217)
            },
            light(),
        ),
        case(
            "300 targets",
            BoxSettings {
                plain_targets: 300,
                codes: 20,
                ..scene(218)
            },
            light(),
        ),
    ]
}

fn main() {
    let word = std::env::args()
        .skip(1)
        .find(|a| !a.starts_with('-'))
        .unwrap_or_default();
    println!(
        "{:<18} {:>7} {:>11} {:>9} {:>5} {:>5} {:>8} {:>7} {:>8} {:>7}",
        "case",
        "images",
        "labelled",
        "targets",
        "wrong",
        "split",
        "rms mm",
        "sigma0",
        "err/sig",
        "s"
    );
    for case in cases().iter().filter(|case| case.name.contains(&word)) {
        run(case);
    }
}

fn run(case: &Case) {
    let experiment = match box_experiment(&case.scene) {
        Ok(experiment) => experiment,
        Err(error) => return println!("{:<18} {error}", case.name),
    };
    let mut rendered =
        of_experiment_with(&experiment, case.scene.seed, Family::Dot420, &case.light);
    let targets = &mut Arc::make_mut(&mut rendered.network.settings).targets;
    targets.plain_dot_mm = case.scene.dot_mm;
    targets.families = vec![DotFamily {
        family: Family::Dot420,
        pitch_mm: case.scene.pitch_mm,
        dot_mm: case.scene.dot_mm,
    }];
    let begun = Instant::now();
    let network = measure(rendered.network, &rendered.pictures);
    let seconds = begun.elapsed().as_secs_f64();
    match check_against_truth(&network, &rendered.truth) {
        Ok(check) => println!(
            "{:<18} {:>7} {:>11} {:>9} {:>5} {:>5} {:>8.4} {:>7.3} {:>8.2} {:>7.1}",
            case.name,
            format!("{}/{}", check.images_oriented, check.images),
            format!("{}/{}", check.countable_labelled, check.countable_dots),
            format!("{}/{}", check.targets_as_points, check.targets),
            check.wrong_labels.len() + check.wrong_codes.len(),
            check.split_targets.len(),
            check.rms_mm,
            network.adjustment.as_ref().map_or(f64::NAN, |a| a.sigma0),
            check.error_over_sigma,
            seconds
        ),
        Err(error) => println!("{:<18} {error}", case.name),
    }
}
