//! Damaged files and pictures of anything, for as long as is given: `cargo bench --bench fuzz -- MINUTES [FIRST_CASE]`.
#![allow(clippy::print_stdout, reason = "a program whose result is a line")]

#[path = "../tests/fuzzing/mod.rs"]
mod fuzzing;

use std::process::ExitCode;
use std::time::{Duration, Instant};

use fuzzing::{Survived, survive};

fn main() -> ExitCode {
    let numbers: Vec<u64> = std::env::args()
        .filter_map(|argument| argument.parse().ok())
        .collect();
    let minutes = numbers.first().copied().unwrap_or(1);
    let first = numbers.get(1).copied().unwrap_or(0);
    let folder = std::env::temp_dir().join(format!("tiepoint-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    let begun = Instant::now();
    let mut survived = Survived::default();
    let mut case = first;
    let mut status = ExitCode::SUCCESS;
    while begun.elapsed() < Duration::from_secs(60 * minutes) {
        if let Err(why) = survive(case, &folder, &mut survived) {
            println!("{why}");
            status = ExitCode::FAILURE;
        }
        case += 1;
    }
    std::fs::remove_dir_all(&folder).expect("the folder just made");
    let memory = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let most = memory
        .lines()
        .find(|line| line.starts_with("VmHWM"))
        .unwrap_or("VmHWM: not told here");
    println!("cases {first} to {}: {survived:?}; {most}", case - 1);
    status
}
