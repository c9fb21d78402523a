//! Random fields of plain targets, identified and held against their truth: `cargo bench --bench identification -- N [FROM]
//! [paper]`; with `paper` by the threshold of Hattori et al. (2002).

#![allow(clippy::print_stdout, reason = "a program whose result is its table")]

#[path = "../tests/identification_trials/mod.rs"]
mod identification_trials;

use std::sync::Arc;
use std::time::Instant;

use identification_trials::scene::Scene;
use identification_trials::verdict::{Verdict, identified, oriented};
use tiepoint::network::IdentificationRule;

fn main() {
    let numbers: Vec<u64> = std::env::args()
        .skip(1)
        .filter_map(|word| word.parse().ok())
        .collect();
    let count = numbers.first().copied().unwrap_or(20);
    let from = numbers.get(1).copied().unwrap_or(0);
    let rule = match std::env::args().any(|word| word == "paper") {
        true => IdentificationRule::Paper,
        false => IdentificationRule::Statistics,
    };
    let mut total = Verdict::default();
    let mut seconds = 0.0;
    println!(
        "| scene | form | targets | spacing | noise | images | dots | labelled | missed | rejected | wrong used | wrong rejected | split | s |"
    );
    for number in from..from + count {
        let mut scene = Scene::numbered(number);
        Arc::make_mut(&mut scene.network.settings).identification = rule;
        let begun = Instant::now();
        let network = oriented(&scene.network);
        let middle = begun.elapsed().as_secs_f64();
        let network = identified(&network);
        let v = Verdict::of(&scene, &network);
        let r = &scene.recipe;
        println!(
            "| {number} | {:?} {:?} | {} | {:.1} | {:.3} | {}/{} | {} | {} | {} | {} | {} | {} | {} | {middle:.1} {:.1} | {:?}",
            r.form,
            r.layout,
            scene.object.targets.len(),
            r.spacing,
            r.noise_px,
            v.oriented,
            v.images,
            v.identifiable,
            v.labelled,
            v.missed(),
            v.rejected,
            v.wrong_used,
            v.wrong_rejected,
            v.split,
            begun.elapsed().as_secs_f64() - middle,
            v.reasons
        );
        seconds += begun.elapsed().as_secs_f64() - middle;
        total.add(&v);
    }
    println!(
        "{total:#?} {:.4} % in {seconds:.1} s by {rule:?}",
        100.0 * total.labelled as f64 / total.identifiable.max(1) as f64
    );
}
