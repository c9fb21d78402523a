//! What detection costs as pictures and dots grow, on one thread: `cargo bench --bench growth`.
#![allow(clippy::print_stdout, reason = "a program whose result is a table")]
#![allow(dead_code, reason = "the bound of the exact picture is for others")]

#[path = "centres/exact.rs"]
mod exact;

use std::time::Instant;

use exact::{Cover, ExactDot};
use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tiepoint::imaging::{BitDepth, GreyImage};
use tiepoint::targets::{DetectSettings, Family, detect};

const GROUND: f64 = 20.0;
const AMPLITUDE: f64 = 150.0;
const NOISE: f64 = 1.5;
const RUNS: usize = 5;

/// A dark picture of so many pixels with round dots of 9 px on a loose grid.
fn picture(megapixels: f64, dots: usize) -> GreyImage {
    let width = (1.5e6 * megapixels).sqrt() as usize;
    let height = (1e6 * megapixels) as usize / width;
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let covers: Vec<Cover> = (0..16)
        .map(|_| {
            let centre = Vector2::new(20.0 + random.random::<f64>(), 20.0 + random.random::<f64>());
            ExactDot::seen(centre, 9.0, 0.5, 3.0 * random.random::<f64>(), 0.8).cover()
        })
        .collect();
    let mut samples: Vec<u16> = (0..width * height)
        .map(|_| {
            let normal = (0..4).map(|_| random.random::<f32>()).sum::<f32>() - 2.0;
            (GROUND + NOISE * f64::from(normal) * 3.0_f64.sqrt()).round() as u16
        })
        .collect();
    let across = ((dots as f64 * 1.5).sqrt().ceil() as usize).max(1);
    let down = dots.div_ceil(across);
    for dot in 0..dots {
        let cover = &covers[dot % covers.len()];
        let left = (dot % across) * (width - 50) / across + 2;
        let top = (dot / across) * (height - 50) / down + 2;
        for (slot, share) in cover.shares.iter().enumerate() {
            let place = (top + slot / cover.side) * width + left + slot % cover.side;
            samples[place] = (f64::from(samples[place]) + AMPLITUDE * share).round() as u16;
        }
    }
    GreyImage::new(width as u32, height as u32, BitDepth::Eight, samples).expect("a full picture")
}

/// Milliseconds of the quickest run, and the dots found.
fn cost(image: &GreyImage) -> (f64, usize) {
    let one_thread = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a thread");
    let mut least = f64::INFINITY;
    let mut found = 0;
    for _ in 0..RUNS {
        let begun = Instant::now();
        let detections =
            one_thread.install(|| detect(image, &[Family::Dot420], &DetectSettings::default()));
        least = least.min(begun.elapsed().as_secs_f64() * 1e3);
        found = detections.dots.len();
    }
    (least, found)
}

fn main() {
    println!("megapixels   dots  found       ms  ms a megapixel");
    for megapixels in [1.0, 3.0, 10.0, 30.0, 100.0] {
        let dots = (24.0 * megapixels) as usize;
        let (ms, found) = cost(&picture(megapixels, dots));
        println!(
            "{megapixels:>10} {dots:>6} {found:>6} {ms:>8.1} {:>8.2}",
            ms / megapixels
        );
    }
    println!("\nmegapixels   dots  found       ms  us a dot, less the empty picture");
    let (empty, _) = cost(&picture(24.0, 0));
    println!("{:>10} {:>6} {:>6} {empty:>8.1}", 24, 0, 0);
    for dots in [10, 100, 1000, 5000, 20_000] {
        let (ms, found) = cost(&picture(24.0, dots));
        println!(
            "{:>10} {dots:>6} {found:>6} {ms:>8.1} {:>8.1}",
            24,
            1e3 * (ms - empty) / dots as f64
        );
    }
}
