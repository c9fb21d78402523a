//! Codes under hard conditions against truth: `cargo bench --bench codes -- N [FAMILY] [KIND] [FROM]` (N trials, numbered from
//! FROM or 0, of every kind of the families and kinds whose names begin with these words; without N a thousand).

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a program whose result is its table"
)]

#[path = "../tests/code_trials/mod.rs"]
mod code_trials;

use std::time::Instant;

use code_trials::kinds;

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| !word.starts_with("--"))
        .collect();
    let count: u64 = words.first().map_or(1000, |word| {
        word.parse().expect("the number of trials comes first")
    });
    let from: u64 = words
        .get(3)
        .map_or(0, |word| word.parse().expect("FROM is a number"));
    let wanted =
        |place: usize, name: &str| words.get(place).is_none_or(|word| name.starts_with(word));
    println!(
        "| family | kind | trials | read | doubtful | not read | wrong, without a doubt | 95 % bound | its picture is the other number's | wrong, with a doubt | us a trial |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for kind in kinds() {
        let family = kind.family.to_string();
        if !(wanted(1, &family) && wanted(2, &kind.name)) {
            continue;
        }
        let begun = Instant::now();
        let (tally, bad) = kind.run(from..from + count);
        let share = |part: usize| match tally.shown {
            0 => "-".to_owned(),
            shown => format!("{:.3} %", 100.0 * part as f64 / shown as f64),
        };
        println!(
            "| {family} | {} | {} | {} | {} | {} | {} | {:.1e} | {} | {} | {:.0} |",
            kind.name,
            tally.trials,
            share(tally.read),
            share(tally.doubtful),
            share(tally.not_read()),
            tally.wrong,
            tally.wrong_bound(),
            tally.same_picture,
            tally.wrong_doubtful,
            1e6 * begun.elapsed().as_secs_f64() / tally.trials.max(1) as f64
        );
        if !bad.is_empty() {
            eprintln!("{family}, {}: wrong in trials {bad:?}", kind.name);
        }
    }
}
