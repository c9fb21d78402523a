//! The window killed at 50 random moments in stages and edits: `cargo bench --bench kill [KILLS [SEED]]`. Needs Xvfb and
//! xdotool; minutes.

#![allow(clippy::print_stdout, reason = "a program whose result is its table")]

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "../tests/driven/mod.rs"]
mod driven;
#[path = "../tests/driven/killing.rs"]
mod killing;

fn main() -> Result<(), String> {
    let numbers: Vec<u64> = std::env::args()
        .filter_map(|argument| argument.parse().ok())
        .collect();
    let kills = numbers.first().map_or(50, |kills| *kills as usize);
    let seed = numbers.get(1).copied().unwrap_or(2002);
    let screen = driven::Screen::start()?;
    let stages = killing::kill_in_stages(&screen, kills / 2, seed);
    println!("{stages}");
    let edits = killing::kill_in_edits(&screen, kills - kills / 2, seed);
    println!("{edits}");
    match stages.lost + edits.lost {
        0 => Ok(()),
        lost => Err(format!(
            "{lost} steps or edits that were shown as saved are lost"
        )),
    }
}
