//! Random measurements oriented, against truth: `cargo bench --bench orientation -- [KIND] N [FROM]` (N measurements from this number
//! on; without N a thousand). KIND is `pictures`, rendered and detected, or `one-camera`, tables of observations without a second
//! camera and pictures in portrait; else tables with both. With a third number, any, the findings are printed too.

#![allow(clippy::print_stdout, reason = "a program whose result is its table")]

#[path = "../tests/orientation_trials/mod.rs"]
mod orientation_trials;

use std::time::Instant;

use orientation_trials::bound::Known;
use orientation_trials::scene::Scene;
use orientation_trials::verdict::{Verdict, beyond_observations, oriented};
use rayon::prelude::*;
use tiepoint::network::Network;

/// A measurement that was tried.
struct Tried {
    scene: Scene,
    verdict: Verdict,
    /// Of the images that are missed or too weak, those that no estimate could orient better, with what can be known of these lenses and of
    /// any.
    beyond_observations: [usize; 2],
    /// To render and to detect, where there are pictures; it means something for a measurement that is alone.
    seconds_to_see: f64,
    seconds_to_orient: f64,
}

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| !word.starts_with("--"))
        .collect();
    let scene_of = match words.first().map(String::as_str) {
        Some("pictures") => Scene::pictures,
        Some("one-camera") => Scene::table_of_one_camera,
        _ => Scene::table,
    };
    let numbers: Vec<u64> = words
        .iter()
        .filter(|word| !["pictures", "one-camera"].contains(&word.as_str()))
        .map(|word| {
            word.parse()
                .expect("numbers: how many measurements, and the first one")
        })
        .collect();
    let count = numbers.first().copied().unwrap_or(1000);
    let from = numbers.get(1).copied().unwrap_or(0);
    let begun = Instant::now();
    let tried: Vec<Tried> = (from..from + count)
        .into_par_iter()
        .map(|number| {
            let begun = Instant::now();
            let scene = scene_of(number);
            let seconds_to_see = begun.elapsed().as_secs_f64();
            let begun = Instant::now();
            let network = oriented(&scene.network);
            let seconds_to_orient = begun.elapsed().as_secs_f64();
            let verdict = Verdict::of(&scene, &network);
            let beyond_observations = [Known::SpreadOfTrials, Known::SpreadOfLenses].map(|known| {
                let mut short = verdict
                    .missed
                    .iter()
                    .chain(&verdict.weak_required)
                    .peekable();
                if short.peek().is_none() {
                    return 0;
                }
                let beyond = beyond_observations(&scene, known);
                short.filter(|id| beyond.contains(id)).count()
            });
            if numbers.len() > 2 {
                print_details(&scene, &network);
            }
            Tried {
                scene,
                verdict,
                beyond_observations,
                seconds_to_see,
                seconds_to_orient,
            }
        })
        .collect();
    for measurement in &tried {
        if !measurement.verdict.holds() || count == 1 {
            print_measurement(measurement);
        }
    }
    print_readings(&tried);
    print_table(&tried, begun.elapsed().as_secs_f64());
}

fn print_measurement(tried: &Tried) {
    let Tried { scene, verdict, .. } = tried;
    println!(
        "{}: {} images, {} required, {} right, missed {:?}, wrong {:.3?}, doubted {:?}, weak {:?}, silent {:?}, cannot be told better {:?}; {:.2} s to see, {:.2} s to orient; {:?}",
        scene.number,
        verdict.images,
        verdict.required,
        verdict.right,
        verdict.missed,
        verdict.wrong,
        verdict.doubted,
        verdict.weak,
        verdict.silent,
        tried.beyond_observations,
        tried.seconds_to_see,
        tried.seconds_to_orient,
        scene.recipe
    );
}

fn print_details(scene: &Scene, network: &Network) {
    for finding in network.findings.iter() {
        println!("    {:?}: {}", finding.stage, finding.text);
    }
    let required = scene.required();
    for (id, shown) in &scene.shown {
        let image = &network.images[id];
        println!(
            "    image {} of camera {}: {} codes right, {} wrong, cross {}, required {}, oriented {}",
            id.0,
            image.camera.0,
            shown.right.len(),
            shown.wrong,
            shown.cross,
            required.contains(id),
            image.station.is_some()
        );
    }
    for (id, camera) in network.cameras.iter() {
        println!(
            "    camera {} ({:?}): told {:.3} mm, found {:.3}, true {:.3}",
            id.0,
            camera.source,
            scene.network.cameras[id].camera.interior.principal_distance,
            camera.camera.interior.principal_distance,
            scene.cameras[id].interior.principal_distance
        );
    }
}

/// What the images show of the codes.
fn print_readings(tried: &[Tried]) {
    let [mut right, mut wrong, mut by_detection] = [0; 3];
    for shown in tried.iter().flat_map(|tried| tried.scene.shown.values()) {
        right += shown.right.len();
        wrong += shown.wrong;
        by_detection += shown.wrong_by_detection;
    }
    println!(
        "codes read rightly {right}, wrongly {wrong}, of these {by_detection} before labels were falsified"
    );
}

fn print_table(tried: &[Tried], seconds: f64) {
    let mut sum = [0; 11];
    for measurement in tried {
        let verdict = &measurement.verdict;
        let parts = [
            verdict.images,
            verdict.required,
            verdict.right,
            verdict.missed.len(),
            verdict.wrong.len(),
            verdict.doubted.len(),
            verdict.silent.len(),
            verdict.weak.len(),
            verdict.weak_required.len(),
            measurement.beyond_observations[0],
            measurement.beyond_observations[1],
        ];
        for (sum, part) in sum.iter_mut().zip(parts) {
            *sum += part;
        }
    }
    let failed = tried.iter().filter(|tried| !tried.verdict.holds()).count();
    let [
        images,
        required,
        right,
        missed,
        wrong,
        doubted,
        silent,
        weak,
        weak_required,
        beyond,
        beyond_of_any,
    ] = sum;
    println!(
        "| measurements | images | required | right | required, but missed | wrong | wrong, but told | too weak, and told (required) | of the required these cannot be told better, lenses spread as these / as any | left out without a reason | measurements with a failure | s |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    println!(
        "| {} | {images} | {required} | {right} | {missed} | {wrong} | {doubted} | {weak} ({weak_required}) | {beyond} / {beyond_of_any} | {silent} | {failed} | {seconds:.0} |",
        tried.len(),
    );
}
