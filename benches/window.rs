//! What the window asks of a machine, as the table of the README: `cargo bench --bench window [WORD]` (only the parts whose
//! name holds WORD). The window runs as in its tests, on the software renderer unless `WGPU_BACKEND` says otherwise;
//! a frame is given in two parts, what the window computes and what the renderer draws and hands back.
//!
//! Minutes. The pictures are rendered at the first run and kept under `target/`.

#![allow(clippy::print_stdout, reason = "a program whose result is its table")]

#[path = "window/desk.rs"]
mod desk;
#[path = "window/inputs.rs"]
mod inputs;
#[path = "window/missed.rs"]
mod missed;
#[path = "window/parts.rs"]
mod parts;

use std::time::Duration;

/// One line of the table.
struct Row {
    what: String,
    found: String,
    goal: &'static str,
}

impl Row {
    fn new(what: impl Into<String>, found: impl Into<String>, goal: &'static str) -> Self {
        Self {
            what: what.into(),
            found: found.into(),
            goal,
        }
    }
}

/// A part of the table with its name.
type Part = (&'static str, fn(&inputs::Inputs) -> Vec<Row>);

/// Memory first: it is the peak of the process.
const PARTS: [Part; 6] = [
    ("memory", parts::opening_and_memory),
    ("interrupt", parts::interrupts),
    ("detect", parts::frames_while_detecting),
    ("picture", parts::frames_of_a_large_picture),
    ("network", parts::frames_of_a_large_network),
    ("missed", missed::keys_for_missed_targets),
];

fn main() {
    let word = std::env::args()
        .skip(1)
        .find(|a| !a.starts_with('-'))
        .unwrap_or_default();
    let inputs = inputs::Inputs::prepare();
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    println!(
        "{cores} cores, load {}",
        std::fs::read_to_string("/proc/loadavg")
            .unwrap_or_default()
            .trim()
    );
    println!("\n| what | found | goal |\n|---|---|---|");
    for (_, part) in PARTS.iter().filter(|(name, _)| name.contains(&word)) {
        for Row { what, found, goal } in part(&inputs) {
            println!("| {what} | {found} | {goal} |");
        }
    }
    println!(
        "\nload {}",
        std::fs::read_to_string("/proc/loadavg")
            .unwrap_or_default()
            .trim()
    );
}

/// A time in ms.
fn ms(time: Duration) -> String {
    let ms = time.as_secs_f64() * 1000.0;
    if ms < 10.0 {
        format!("{ms:.1} ms")
    } else {
        format!("{ms:.0} ms")
    }
}

/// Median and worst of some times.
fn median_and_worst(mut times: Vec<Duration>) -> String {
    times.sort();
    match (times.get(times.len() / 2), times.last()) {
        (Some(&median), Some(&worst)) => format!("{} (median {})", ms(worst), ms(median)),
        _ => "-".into(),
    }
}
