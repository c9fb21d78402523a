//! What connecting costs as the number of images grows: `cargo bench --bench connection -- [N ...]` (numbers of images; without any 10 to
//! 1000).

#![allow(clippy::print_stdout, reason = "a program whose result is its table")]
#![allow(dead_code, reason = "what must be oriented is for others")]

#[path = "../tests/orientation_trials/mod.rs"]
mod orientation_trials;

use std::time::Instant;

use orientation_trials::recipe::{Recipe, Told, WrongCodes};
use orientation_trials::scene::Scene;
use orientation_trials::verdict::{concluded, station_errors};
use tiepoint::network::{InteriorSource, Stage};
use tiepoint::targets::Family;

/// Images of an object with 400 codes, some hundred of them in each.
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
        shown: [0.55, 0.7],
        unread: 0.0,
        rolls: true,
        obliqueness: 0.9,
        portrait: 0.0,
        second_camera: None,
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
        "| images | dots in each | first pair, s | connecting, s | ms an image | oriented | largest error of a station, mm |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    for images in sizes {
        let scene = Scene::table_with(1, |_| recipe(images));
        let labels = scene
            .network
            .images
            .values()
            .map(|image| image.labels.len());
        let dots = labels.sum::<usize>() as f64 / images as f64;
        let mut network = scene.network.clone();
        let mut seconds = [0.0; 2];
        for (stage, seconds) in [Stage::FirstPair, Stage::Connect]
            .into_iter()
            .zip(&mut seconds)
        {
            let begun = Instant::now();
            network = concluded(network, stage);
            *seconds = begun.elapsed().as_secs_f64();
        }
        let errors = station_errors(&scene, &network);
        println!(
            "| {images} | {dots:.0} | {:.3} | {:.2} | {:.1} | {} | {:.2} |",
            seconds[0],
            seconds[1],
            1e3 * seconds[1] / images as f64,
            errors.len(),
            errors.values().copied().fold(0.0, f64::max),
        );
    }
}
