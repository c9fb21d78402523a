//! Time and accuracy on one picture with known centres: `cargo bench --bench picture -- PICTURE CENTRES [RUNS]`.
//!
//! `CENTRES` holds a dot a line, x and y first, the first pixel's centre at (0, 0); lines with `#` are comments. Detection
//! runs on one thread, with the picture in memory; the median of the runs counts.
#![allow(clippy::print_stdout, reason = "a program whose result is a line")]

use std::path::Path;
use std::time::Instant;

use nalgebra::Vector2;
use tiepoint::imaging::{LoadSettings, load_picture};
use tiepoint::targets::{DetectSettings, Family, detect};

/// Runs, where the command line names no number.
const RUNS: usize = 25;
/// A dot found farther off is another, px.
const SAME_PX: f64 = 3.0;

fn centres(file: &str) -> Vec<Vector2<f64>> {
    let text = std::fs::read_to_string(file).expect("a file of centres");
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines
        .map(|line| {
            let mut numbers = line
                .split_whitespace()
                .map(|number| number.parse::<f64>().expect("a number"));
            let mut next = || numbers.next().expect("x and y") + 0.5;
            Vector2::new(next(), next())
        })
        .collect()
}

fn main() {
    let arguments: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with("--"))
        .collect();
    let [picture, truth, rest @ ..] = &arguments[..] else {
        println!("usage: cargo bench --bench picture -- PICTURE CENTRES [RUNS]");
        return;
    };
    let runs = rest
        .first()
        .and_then(|runs| runs.parse().ok())
        .unwrap_or(RUNS);
    let image = load_picture(Path::new(picture), &LoadSettings::default())
        .expect("a picture")
        .image;
    let truth = centres(truth);
    let one_thread = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a thread");
    let detected =
        || one_thread.install(|| detect(&image, &[Family::Dot420], &DetectSettings::default()));
    let found = detected();
    let mut times: Vec<f64> = (0..runs)
        .map(|_| {
            let begun = Instant::now();
            std::hint::black_box(detected());
            begun.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    let median = times[times.len() / 2];

    let (mut matched, mut squares, mut in_sigmas) = (0, 0.0, 0.0);
    for centre in &truth {
        let near = found
            .dots
            .iter()
            .find(|dot| (dot.centre_px - centre).norm() < SAME_PX);
        if let Some(dot) = near {
            let error = (dot.centre_px - centre).norm_squared();
            matched += 1;
            squares += error;
            in_sigmas += error / dot.sigma_px.powi(2);
        }
    }
    let root = |sum: f64| (sum / f64::from(2 * matched)).sqrt();
    println!(
        "{median:.1} ms ({:.2} ms a megapixel); {matched} of {} found, {} others; rms {:.4} px, error over sigma {:.2}",
        median / (image.samples().len() as f64 / 1e6),
        truth.len(),
        found.dots.len() - matched as usize,
        root(squares),
        root(in_sigmas)
    );
}
