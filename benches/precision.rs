//! Whether the sigmas that are printed are the errors that are made: `cargo bench --bench precision -- [NETWORKS [PLANTED [FROM]]]`
//! adjusts so many random networks of known truth from this number on, each again with so many planted errors, and prints
//! the table that stands in the README.

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a program for the terminal"
)]

#[path = "../tests/precision_trials/mod.rs"]
mod precision_trials;

use precision_trials::outcome::Outcome;
use precision_trials::scene::Scene;
use precision_trials::tally::Tally;
use rayon::prelude::*;

fn main() {
    let numbers: Vec<u64> = std::env::args()
        .skip(1)
        .filter_map(|a| a.parse().ok())
        .collect();
    let given = |place: usize, default: u64| numbers.get(place).copied().unwrap_or(default);
    let (networks, planted, from) = (given(0, 500), given(1, 20), given(2, 0));
    let outcomes: Vec<Result<Outcome, String>> = (from..from + networks)
        .into_par_iter()
        .map(|number| {
            let scene = Scene::numbered(number);
            Outcome::of(&scene, number, planted as usize).map_err(|e| format!("{number}: {e}"))
        })
        .collect();
    let (good, refused): (Vec<_>, Vec<_>) = outcomes.into_iter().partition(Result::is_ok);
    for line in refused.into_iter().filter_map(Result::err) {
        eprintln!("not adjusted: {line}");
    }
    let good: Vec<Outcome> = good.into_iter().flatten().collect();
    println!("{}", Tally::of(&good).table());
}
