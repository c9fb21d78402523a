//! What connecting costs as the number of images grows: `cargo bench --bench connection -- [N ...]` (numbers of images; without any 10 to
//! 1000).

#![allow(clippy::print_stdout, reason = "a program whose result is its table")]
#![allow(dead_code, reason = "what must be oriented is for others")]

#[path = "../tests/orientation_trials/mod.rs"]
mod orientation_trials;

use std::collections::BTreeSet;
use std::time::Instant;

use orientation_trials::recipe::{Recipe, Told, WrongCodes};
use orientation_trials::scene::Scene;
use orientation_trials::verdict::{Verdict, concluded};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use tiepoint::network::{InteriorSource, Stage};
use tiepoint::targets::Family;

/// Images of a long object of 420 codes, some hundred of them in each.
fn recipe(images: usize) -> Recipe {
    Recipe {
        images,
        family: Family::Dot420,
        codes: 400,
        plain_targets: 0,
        relief: 0.2,
        cross: false,
        told: Told::Wrong {
            source: InteriorSource::Exif,
            by: 0.03,
        },
        wrong: WrongCodes::Share(0.02),
        moved_code: false,
        noise_px: 0.05,
        shown: [0.45, 0.65],
        unread: 0.1,
        rolls: true,
        obliqueness: 0.9,
    }
}

fn main() {
    let wanted: Vec<usize> = std::env::args()
        .skip(1)
        .filter_map(|word| word.parse().ok())
        .collect();
    let sizes = if wanted.is_empty() {
        vec![10, 34, 100, 300, 1000]
    } else {
        wanted
    };
    println!(
        "| images | dots in each | first pair, s | connecting, s | ms an image | oriented | adjusting the codes, s | wrong |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- |");
    for images in sizes {
        let scene = Scene::of(1, recipe(images), &mut ChaCha8Rng::seed_from_u64(1));
        let dots = scene.network.images.values();
        let dots: usize = dots.map(|image| image.labels.len()).sum();
        let mut network = scene.network.clone();
        let mut seconds = Vec::new();
        for stage in [Stage::FirstPair, Stage::Connect, Stage::AdjustCodes] {
            let begun = Instant::now();
            network = concluded(network, stage);
            seconds.push(begun.elapsed().as_secs_f64());
        }
        let verdict = Verdict::with_required(&scene, &network, &BTreeSet::new());
        println!(
            "| {images} | {:.0} | {:.3} | {:.2} | {:.1} | {} | {:.2} | {} |",
            dots as f64 / images as f64,
            seconds[0],
            seconds[1],
            1e3 * seconds[1] / images as f64,
            network.oriented_images().count(),
            seconds[2],
            verdict.wrong.len(),
        );
    }
}
