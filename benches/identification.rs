//! Random fields of plain targets, identified and held against their truth.
//!
//! - `cargo bench --bench identification -- N [FROM] [paper]`: as tables of observations; with `paper` by the threshold of Hattori et al.
//!   (2002);
//! - `... -- pictures N [FROM]`: in rendered pictures, second looks included;
//! - `... -- plot FILE.svg`: what is missed against spacing and noise;
//! - `... -- growth [N ...]`: cost as the number of images grows (without any 10 to 1000), 5 targets an image;
//! - `... -- interrupt [IMAGES [MOMENTS]]`: how long a pass goes on after it was asked to stop.

#![allow(clippy::print_stdout, reason = "a program whose result is its table")]

#[path = "../tests/identification_trials/mod.rs"]
mod identification_trials;
#[path = "identification/plot.rs"]
mod plot;

use std::sync::Arc;
use std::time::{Duration, Instant};

use identification_trials::picture::Pictured;
use identification_trials::recipe::{Form, Layout, Recipe};
use identification_trials::scene::Scene;
use identification_trials::verdict::{
    NoPictures, Verdict, concluded, concluded_with, identified, oriented,
};
use plot::{Line, svg};
use tiepoint::monitor::Monitor;
use tiepoint::network::{IdentificationRule, Stage};

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| !word.starts_with("--"))
        .collect();
    let numbers: Vec<u64> = words.iter().filter_map(|word| word.parse().ok()).collect();
    let has = |wanted: &str| words.iter().any(|word| word == wanted);
    let count = numbers.first().copied().unwrap_or(20);
    let from = numbers.get(1).copied().unwrap_or(0);
    if has("pictures") {
        pictures(from..from + count);
    } else if has("growth") {
        let sizes = match numbers.is_empty() {
            true => vec![10, 34, 100, 300, 1000],
            false => numbers.iter().map(|n| *n as usize).collect(),
        };
        growth(&sizes);
    } else if has("interrupt") {
        let [images, moments] = [0, 1].map(|at| numbers.get(at).copied().unwrap_or(60) as u32);
        interrupts(images as usize, moments);
    } else if let Some(file) = words.iter().find(|word| word.ends_with(".svg")) {
        let drawn = recall();
        std::fs::write(file, drawn).expect("a file that can be written");
    } else {
        let rule = match has("paper") {
            true => IdentificationRule::Paper,
            false => IdentificationRule::Statistics,
        };
        tables(from..from + count, rule);
    }
}

fn tables(numbers: std::ops::Range<u64>, rule: IdentificationRule) {
    let mut total = Verdict::default();
    let mut seconds = 0.0;
    println!(
        "| scene | form | targets | spacing | noise | images | dots | labelled | missed | rejected | wrong used | wrong rejected | split | s |"
    );
    for number in numbers {
        let mut scene = Scene::numbered(number);
        Arc::make_mut(&mut scene.network.settings).identification = rule;
        let network = oriented(&scene.network);
        let begun = Instant::now();
        let network = identified(&network);
        let took = begun.elapsed().as_secs_f64();
        let v = Verdict::of(&scene, &network);
        let r = &scene.recipe;
        println!(
            "| {number} | {:?} {:?} | {} | {:.1} | {:.3} | {}/{} | {} | {} | {} | {} | {} | {} | {} | {took:.1} | {:?}",
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
            v.reasons
        );
        seconds += took;
        total.add(&v);
    }
    println!(
        "{total:#?} {:.4} % in {seconds:.1} s by {rule:?}",
        100.0 * total.labelled as f64 / total.identifiable.max(1) as f64
    );
}

fn pictures(numbers: std::ops::Range<u64>) {
    println!(
        "| scene | form | targets | images | visible dots | labelled | of these by the second look | wrong used | split | s |"
    );
    let (mut visible, mut labelled, mut second, mut wrong, mut split) = (0, 0, 0, 0, 0);
    for number in numbers {
        let pictured = Pictured::numbered(number);
        let begun = Instant::now();
        let start = pictured.scene.network.clone();
        let network = Stage::ALL.into_iter().fold(start, |network, stage| {
            concluded_with(network, stage, &pictured.pictures)
        });
        let took = begun.elapsed().as_secs_f64();
        let seen = pictured.judge(&network);
        let r = &pictured.scene.recipe;
        println!(
            "| {number} | {:?} {:?} | {} | {}/{} | {} | {} | {} | {} | {} | {took:.1} |",
            r.form,
            r.layout,
            pictured.scene.object.targets.len(),
            network.oriented_images().count(),
            r.stations,
            seen.visible,
            seen.labelled,
            seen.by_second_look,
            seen.wrong_used,
            seen.split
        );
        for missed in &seen.missed {
            println!("    {missed}");
        }
        visible += seen.visible;
        labelled += seen.labelled;
        second += seen.by_second_look;
        wrong += seen.wrong_used;
        split += seen.split;
    }
    println!(
        "{labelled} of {visible} visible dots labelled ({:.4} %), {second} by the second look, {wrong} wrong used, {split} split",
        100.0 * f64::from(labelled as u32) / f64::from(visible.max(1) as u32)
    );
}

/// What is missed against spacing and noise; targets in rows and columns, 12 stations.
fn recall() -> String {
    const SPACINGS: [f64; 6] = [2.0, 2.5, 3.0, 4.0, 6.0, 8.0];
    const NOISES: [f64; 5] = [0.02, 0.05, 0.1, 0.2, 0.5];
    const FORMS: [Form; 4] = [Form::Flat, Form::Waves, Form::Cylinder, Form::Steps];
    println!("| noise, px | spacing, diameters | dots | missed | wrong used | split |");
    println!("| --- | --- | --- | --- | --- | --- |");
    let mut lines = Vec::new();
    for noise_px in NOISES {
        let mut points = Vec::new();
        for spacing in SPACINGS {
            let mut total = Verdict::default();
            for (number, form) in FORMS.into_iter().enumerate() {
                let scene = Scene::with(7000 + number as u64, |recipe| Recipe {
                    form,
                    layout: Layout::Grid,
                    targets: 300,
                    spacing,
                    codes: 40,
                    stations: 12,
                    noise_px,
                    false_share: 0.1,
                    clusters: 3,
                    glints: 0.02,
                    shown: [0.9, 1.3],
                    ..recipe
                });
                total.add(&Verdict::of(&scene, &identified(&oriented(&scene.network))));
            }
            println!(
                "| {noise_px} | {spacing} | {} | {} | {} | {} |",
                total.identifiable,
                total.missed(),
                total.wrong_used,
                total.split
            );
            let share = total.missed() as f64 / total.identifiable.max(1) as f64;
            points.push([spacing, share]);
        }
        lines.push(Line { noise_px, points });
    }
    svg(&lines, &SPACINGS)
}

fn large(images: usize) -> Scene {
    // The larger the object, the less of it a picture shows.
    let share = (30.0 / images as f64).sqrt().clamp(0.17, 1.0);
    Scene::with(7, |_| Recipe {
        form: Form::Waves,
        layout: Layout::Grid,
        targets: 5 * images,
        spacing: 5.0,
        codes: (images / 2).clamp(24, 400),
        stations: images,
        noise_px: 0.04,
        missed: 0.1,
        false_share: 0.05,
        clusters: 2,
        glints: 0.0,
        shown: [share, 1.3 * share],
    })
}

fn growth(sizes: &[usize]) {
    println!(
        "| images | targets | oriented | rays | identification, s | us a ray | final adjustment, s | missed | wrong used | split | peak memory, GB |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for &images in sizes {
        let scene = large(images);
        let network = oriented(&scene.network);
        let begun = Instant::now();
        let network = concluded(network, Stage::Identify);
        let identification = begun.elapsed().as_secs_f64();
        let network = concluded(network, Stage::Adjust);
        let adjustment = begun.elapsed().as_secs_f64() - identification;
        let v = Verdict::of(&scene, &network);
        println!(
            "| {images} | {} | {} | {} | {identification:.2} | {:.0} | {adjustment:.2} | {} | {} | {} | {:.2} |",
            scene.object.targets.len(),
            v.oriented,
            v.identifiable,
            1e6 * identification / v.identifiable.max(1) as f64,
            v.missed(),
            v.wrong_used,
            v.split,
            peak_memory_gb()
        );
    }
}

/// Most memory that the program had so far; 0 where the system does not tell.
fn peak_memory_gb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    let kilobytes = line.and_then(|line| line.split_whitespace().nth(1)?.parse::<f64>().ok());
    kilobytes.unwrap_or_default() / 1e6
}

/// How long a pass over so many images goes on after it was asked to stop, at moments spread over it; the longest waits with what was
/// under way.
fn interrupts(images: usize, moments: u32) {
    const SHOWN: usize = 5;
    let scene = large(images);
    let network = oriented(&scene.network);
    let step = Stage::Identify.next(&network).expect("a pass to make");
    let begun = Instant::now();
    let whole = step.run(&network, &NoPictures, &Monitor::new());
    let whole_s = begun.elapsed().as_secs_f64();
    assert!(whole.is_ok(), "a pass that ends");
    let mut waits: Vec<(f64, f64, String)> = Vec::new();
    for k in 0..moments {
        let monitor = Monitor::new();
        let after = whole_s * (f64::from(k) + 0.5) / f64::from(moments);
        let waited = std::thread::scope(|scope| {
            let asked = scope.spawn(|| {
                std::thread::sleep(Duration::from_secs_f64(after));
                let under_way = monitor.progress().title;
                monitor.interrupt();
                (Instant::now(), under_way)
            });
            let ended = step.run(&network, &NoPictures, &monitor);
            let end = Instant::now();
            let (asked, under_way) = asked.join().expect("a thread that asks");
            let wait = end.saturating_duration_since(asked).as_secs_f64();
            ended.is_err().then_some((wait, after, under_way))
        });
        waits.extend(waited);
    }
    waits.sort_by(|a, b| b.0.total_cmp(&a.0));
    println!(
        "a pass of {} dots takes {whole_s:.2} s; stopped at {} moments: median {:.1} ms; the longest:",
        scene.truth.values().map(Vec::len).sum::<usize>(),
        waits.len(),
        1e3 * waits.get(waits.len() / 2).map_or(0.0, |wait| wait.0),
    );
    for (wait, after, under_way) in waits.iter().take(SHOWN) {
        println!("{:.1} ms at {after:.2} s ({under_way})", 1e3 * wait);
    }
}
