//! How near the centres of dots come to what noise allows: `cargo bench --bench centres -- [DOTS] [PLOT.svg]`.
//!
//! Dots of many diameters, incidences, blurs and signals are drawn exactly (`exact`), in 8 and 16 bit, and detected as
//! in any picture. Errors are divided by the Cramer-Rao bound of each case, all nuisance parameters unknown. Cases count
//! where the peak after blur stands 5 sigma above the noise and the bound is at most 0.1 px; the others print how many
//! dots were found. Signal to noise is amplitude over noise, before blur.
#![allow(clippy::print_stdout, reason = "a program whose result is a table")]

#[path = "centres/exact.rs"]
mod exact;
#[path = "centres/plot.rs"]
mod plot;

use std::collections::BTreeMap;

use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use tiepoint::imaging::{BitDepth, GreyImage};
use tiepoint::targets::{DetectSettings, detect};

use exact::{Cover, ExactDot};

const DIAMETERS_PX: [f64; 8] = [4.0, 6.0, 8.0, 12.0, 20.0, 30.0, 50.0, 100.0];
const INCIDENCES_DEG: [f64; 6] = [0.0, 20.0, 40.0, 50.0, 60.0, 70.0];
const BLURS_PX: [f64; 4] = [0.5, 0.8, 1.2, 2.0];
const SIGNALS: [f64; 6] = [5.0, 10.0, 20.0, 50.0, 100.0, 200.0];
const DEPTHS: [BitDepth; 2] = [BitDepth::Eight, BitDepth::Sixteen];

/// Dots of a case, where the command line names no number.
const DOTS: usize = 16;

/// Bounds beyond this are of no use to anybody, px.
const LARGEST_BOUND_PX: f64 = 0.1;
/// Peaks below this many sigmas after blur need not be found.
const LEAST_PEAK: f64 = 5.0;
/// A dot found farther off is another, px.
const SAME_PX: f64 = 1.0;

/// Diameter, incidence and blur.
#[derive(Clone, Copy)]
struct Shape {
    diameter: f64,
    incidence_deg: f64,
    blur: f64,
}

/// The exact dots of one shape.
struct Sheet {
    shape: Shape,
    side: usize,
    dots: Vec<(ExactDot, Cover)>,
    /// For noise of a hundredth of the amplitude, px.
    bound: f64,
    peak: f64,
}

/// Errors of one case.
#[derive(Clone, Default)]
struct Errors {
    shown: usize,
    /// Errors of the dots found, px, x and y.
    found: Vec<[f64; 2]>,
    /// The sigmas that the detection states.
    sigmas: Vec<f64>,
    bound: f64,
}

impl Errors {
    fn squares(&self, unit: f64) -> f64 {
        self.found
            .iter()
            .flatten()
            .map(|error| (error / unit).powi(2))
            .sum()
    }
}

fn sheet(shape: Shape, count: usize) -> Sheet {
    let across = (count as f64).sqrt().ceil() as usize;
    let pitch = (shape.diameter + 12.0 * shape.blur + 24.0).ceil();
    let mut random =
        ChaCha8Rng::seed_from_u64(shape.diameter as u64 * 1000 + shape.incidence_deg as u64);
    let dots: Vec<(ExactDot, Cover)> = (0..count)
        .map(|slot| {
            let place =
                Vector2::new((slot % across) as f64 + 0.5, (slot / across) as f64 + 0.5) * pitch;
            let centre = place + Vector2::new(random.random::<f64>(), random.random::<f64>());
            let angle = std::f64::consts::PI * random.random::<f64>();
            let dot = ExactDot::seen(
                centre,
                shape.diameter,
                shape.incidence_deg.to_radians(),
                angle,
                shape.blur,
            );
            (dot, dot.cover())
        })
        .collect();
    let peak = dots[0].1.shares.iter().copied().fold(0.0, f64::max);
    Sheet {
        shape,
        side: (across as f64 * pitch) as usize + 1,
        bound: dots[0].0.bound(),
        peak,
        dots,
    }
}

/// Amplitude, noise and background of a case, in grey values of 8 bit.
fn exposure(signal: f64) -> [f64; 3] {
    let amplitude = (7.5 * signal).min(150.0);
    [amplitude, amplitude / signal, 40.0]
}

fn picture(sheet: &Sheet, signal: f64, depth: BitDepth, noise_share: f64) -> GreyImage {
    let gain = f64::from(depth.white()) / 255.0;
    let [amplitude, noise, background] = exposure(signal).map(|grey| grey * gain);
    let mut greys = vec![background; sheet.side * sheet.side];
    for (_, cover) in &sheet.dots {
        for (slot, share) in cover.shares.iter().enumerate() {
            let (column, row) = (
                cover.corner[0] + slot % cover.side,
                cover.corner[1] + slot / cover.side,
            );
            if column < sheet.side && row < sheet.side {
                greys[row * sheet.side + column] += amplitude * share;
            }
        }
    }
    let Shape {
        diameter,
        incidence_deg,
        blur,
    } = sheet.shape;
    let mut random = ChaCha8Rng::seed_from_u64(u64::from(depth.white()));
    // A stream of its own for every case: the same noise in all of them would count once.
    random.set_stream(
        (((diameter * 100.0 + incidence_deg) * 100.0 + 10.0 * blur) * 1000.0 + signal) as u64,
    );
    let samples = greys
        .into_iter()
        .map(|grey| {
            let noisy = grey + noise_share * noise * normal(&mut random);
            noisy.round().clamp(0.0, f64::from(depth.white())) as u16
        })
        .collect();
    GreyImage::new(sheet.side as u32, sheet.side as u32, depth, samples).expect("a full picture")
}

/// Box and Muller (1958).
fn normal(random: &mut ChaCha8Rng) -> f64 {
    let (first, second): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - first).ln()).sqrt() * (std::f64::consts::TAU * second).cos()
}

fn errors(sheet: &Sheet, image: &GreyImage, bound: f64) -> Errors {
    let found = detect(image, &[], &DetectSettings::default());
    let mut errors = Errors {
        shown: sheet.dots.len(),
        bound,
        ..Errors::default()
    };
    for (truth, _) in &sheet.dots {
        let near = found
            .dots
            .iter()
            .find(|dot| (dot.centre_px - truth.centre).norm() < SAME_PX);
        if let Some(dot) = near {
            let error = dot.centre_px - truth.centre;
            errors.found.push([error.x, error.y]);
            errors.sigmas.push(dot.sigma_px);
        }
    }
    errors
}

/// The bound of a case, px, with the noise of rounding.
fn bound_of(sheet: &Sheet, signal: f64, depth: BitDepth) -> f64 {
    let [amplitude, noise, _] = exposure(signal);
    let rounding = 255.0 / f64::from(depth.white()) / 12.0_f64.sqrt();
    sheet.bound * 100.0 * noise.hypot(rounding) / amplitude
}

/// Sums of normalised errors under one heading of a table.
#[derive(Clone, Copy, Default)]
struct Row {
    shown: usize,
    found: usize,
    by_bound: f64,
    by_sigma: f64,
}

impl Row {
    fn add(&mut self, errors: &Errors) {
        self.shown += errors.shown;
        self.found += errors.found.len();
        self.by_bound += errors.squares(errors.bound);
        let both = errors.found.iter().zip(&errors.sigmas);
        self.by_sigma += both
            .map(|(error, sigma)| (error[0].powi(2) + error[1].powi(2)) / sigma.powi(2))
            .sum::<f64>();
    }

    fn root(self, squares: f64) -> f64 {
        (squares / (2 * self.found) as f64).sqrt()
    }
}

/// Errors without noise.
#[derive(Clone, Copy, Default)]
struct Quiet {
    /// The largest mean error of a case, over its dots' places in the grid of pixels, px.
    bias: f64,
    /// The largest error of a dot, px.
    largest: f64,
    shown: usize,
    found: usize,
}

impl Quiet {
    fn add(&mut self, errors: &Errors) {
        let lengths = errors.found.iter().map(|[x, y]| x.hypot(*y));
        self.largest = lengths.fold(self.largest, f64::max);
        let mean = |axis: usize| {
            let sum: f64 = errors.found.iter().map(|error| error[axis]).sum();
            sum / errors.found.len().max(1) as f64
        };
        self.bias = self.bias.max(mean(0).hypot(mean(1)));
        self.shown += errors.shown;
        self.found += errors.found.len();
    }
}

fn print_table(title: &str, rows: &BTreeMap<u64, Row>) {
    println!("\n{title:>24}  shown  found  rms/bound  rms/sigma");
    for (key, row) in rows {
        println!(
            "{key:>24} {:>6} {:>6} {:>10.3} {:>10.3}",
            row.shown,
            row.found,
            row.root(row.by_bound),
            row.root(row.by_sigma)
        );
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with("--"))
        .collect();
    let count = arguments
        .first()
        .and_then(|count| count.parse().ok())
        .unwrap_or(DOTS);
    let shapes: Vec<Shape> = DIAMETERS_PX
        .into_iter()
        .flat_map(|diameter| INCIDENCES_DEG.map(|incidence_deg| (diameter, incidence_deg)))
        .flat_map(|(diameter, incidence_deg)| {
            BLURS_PX.map(|blur| Shape {
                diameter,
                incidence_deg,
                blur,
            })
        })
        .collect();
    let cases: Vec<(Shape, f64, Errors, bool, Errors)> = shapes
        .into_par_iter()
        .flat_map_iter(|shape| {
            let sheet = sheet(shape, count);
            let quiet = errors(&sheet, &picture(&sheet, 200.0, BitDepth::Sixteen, 0.0), 1.0);
            let mut cases = Vec::new();
            for signal in SIGNALS {
                for depth in DEPTHS {
                    let bound = bound_of(&sheet, signal, depth);
                    let counts = sheet.peak * signal >= LEAST_PEAK && bound <= LARGEST_BOUND_PX;
                    let errors = errors(&sheet, &picture(&sheet, signal, depth, 1.0), bound);
                    cases.push((sheet.shape, signal, errors, counts, quiet.clone()));
                }
            }
            cases
        })
        .collect();

    let mut tables: [BTreeMap<u64, Row>; 4] = Default::default();
    let mut others = Row::default();
    let mut cells: BTreeMap<(u64, u64), Row> = BTreeMap::new();
    for (shape, signal, errors, counts, _) in &cases {
        if !counts {
            others.add(errors);
            continue;
        }
        let keys = [
            shape.diameter,
            shape.incidence_deg,
            10.0 * shape.blur,
            *signal,
        ];
        for (table, key) in tables.iter_mut().zip(keys) {
            table.entry(key as u64).or_default().add(errors);
        }
        cells
            .entry((shape.diameter as u64, shape.incidence_deg as u64))
            .or_default()
            .add(errors);
    }
    let titles = [
        "diameter, px",
        "incidence, deg",
        "blur, 0.1 px",
        "amplitude over noise",
    ];
    for (title, table) in titles.iter().zip(&tables) {
        print_table(title, table);
    }
    println!(
        "\nbelow the limits (peak 5 sigma, bound 0.1 px): {} of {} dots found",
        others.found, others.shown
    );

    println!(
        "\ndots of 20 and 30 px: share better than so many px, beside a commercial system's (published)"
    );
    let lengths: Vec<f64> = cases
        .iter()
        .filter(|(shape, _, _, counts, _)| *counts && (20.0..=30.0).contains(&shape.diameter))
        .flat_map(|(_, _, errors, _, _)| &errors.found)
        .map(|error| error[0].hypot(error[1]))
        .collect();
    for (limit, published) in [(0.10, 98), (0.05, 93), (0.02, 39), (0.01, 25)] {
        let better = lengths.iter().filter(|length| **length < limit).count();
        let share = 100.0 * better as f64 / lengths.len() as f64;
        println!("{limit:>8.2} {share:>8.1} % {published:>6} %");
    }

    println!("\nrms over bound by diameter (px) and incidence (deg)");
    println!(
        "{:>8}{}",
        "",
        INCIDENCES_DEG
            .map(|incidence| format!("{incidence:>14}"))
            .concat()
    );
    for diameter in DIAMETERS_PX {
        let row = INCIDENCES_DEG.map(|incidence| {
            let cell = cells.get(&(diameter as u64, incidence as u64));
            cell.map_or_else(
                || format!("{:>14}", "-"),
                |row| {
                    let lost = row.shown - row.found;
                    format!(
                        "{:>14}",
                        format!("{:.3} ({lost} lost)", row.root(row.by_bound))
                    )
                },
            )
        });
        println!("{diameter:>8}{}", row.concat());
    }

    println!("\nnoise-free, 16 bit, px, by diameter and blur (0.1 px), all incidences:");
    println!(
        "{:>8} {:>4} {:>10} {:>14}",
        "diameter", "blur", "bias", "largest error"
    );
    let mut quiet: BTreeMap<(u64, u64), Quiet> = BTreeMap::new();
    for (shape, _, _, _, errors) in &cases {
        let key = (shape.diameter as u64, (10.0 * shape.blur) as u64);
        quiet.entry(key).or_default().add(errors);
    }
    for ((diameter, blur), quiet) in &quiet {
        println!(
            "{diameter:>8} {blur:>4} {:>10.5} {:>14.5} ({} of {})",
            quiet.bias, quiet.largest, quiet.found, quiet.shown
        );
    }
    if let Some(file) = arguments.get(1) {
        let points: Vec<plot::Point> = cases
            .iter()
            .filter(|(_, _, errors, counts, _)| *counts && !errors.found.is_empty())
            .map(|(shape, _, errors, _, _)| plot::Point {
                diameter: shape.diameter,
                bound: errors.bound,
                rms: (errors.squares(1.0) / (2 * errors.found.len()) as f64).sqrt(),
            })
            .collect();
        std::fs::write(file, plot::svg(&points)).expect("the plot can be written");
        println!("\nplot: {file}");
    }
}
