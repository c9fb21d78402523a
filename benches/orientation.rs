//! Random measurements oriented from tables of observations, against truth: `cargo bench --bench orientation -- N [FROM]` (N
//! measurements from this number on; without N a thousand).

#![allow(clippy::print_stdout, reason = "a program whose result is its table")]

#[path = "../tests/orientation_trials/mod.rs"]
mod orientation_trials;

use std::time::Instant;

use orientation_trials::scene::Scene;
use orientation_trials::verdict::{Verdict, oriented};
use rayon::prelude::*;

fn main() {
    let words: Vec<u64> = std::env::args()
        .skip(1)
        .filter(|word| !word.starts_with("--"))
        .map(|word| {
            word.parse()
                .expect("numbers: how many measurements, and the first one")
        })
        .collect();
    let count = words.first().copied().unwrap_or(1000);
    let from = words.get(1).copied().unwrap_or(0);
    let begun = Instant::now();
    let verdicts: Vec<(Scene, Verdict, f64)> = (from..from + count)
        .into_par_iter()
        .map(|number| {
            let scene = Scene::any(number);
            let begun = Instant::now();
            let network = oriented(&scene.network);
            let seconds = begun.elapsed().as_secs_f64();
            let verdict = Verdict::of(&scene, &network);
            if words.len() > 2 {
                for finding in network.findings.iter() {
                    println!("    {:?}: {}", finding.stage, finding.text);
                }
            }
            (scene, verdict, seconds)
        })
        .collect();
    let mut sum = [0; 9];
    for (scene, verdict, seconds) in &verdicts {
        let parts = [
            verdict.images,
            verdict.required,
            verdict.right,
            verdict.missed.len(),
            verdict.wrong.len(),
            verdict.doubted.len(),
            verdict.silent.len(),
            verdict.weak.len(),
            verdict.weak_required,
        ];
        for (sum, part) in sum.iter_mut().zip(parts) {
            *sum += part;
        }
        if !verdict.holds() || count == 1 {
            println!(
                "{}: {} images, {} required, {} right, missed {:?}, wrong {:.3?}, doubted {:?}, weak {:?}, silent {:?}; {seconds:.2} s; {:?}",
                scene.number,
                verdict.images,
                verdict.required,
                verdict.right,
                verdict.missed,
                verdict.wrong,
                verdict.doubted,
                verdict.weak,
                verdict.silent,
                scene.recipe
            );
        }
    }
    let failed = verdicts
        .iter()
        .filter(|(_, verdict, _)| !verdict.holds())
        .count();
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
    ] = sum;
    println!(
        "| measurements | images | required | right | required, but missed | wrong | wrong, but told | too weak, and told (required) | left out without a reason | measurements with a failure | s |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    println!(
        "| {} | {images} | {required} | {right} | {missed} | {wrong} | {doubted} | {weak} ({weak_required}) | {silent} | {failed} | {:.0} |",
        verdicts.len(),
        begun.elapsed().as_secs_f64()
    );
}
