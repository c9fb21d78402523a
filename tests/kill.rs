//! A killed window loses nothing that it showed as saved; few kills here, many by `cargo bench --bench kill`.
#![allow(clippy::print_stderr, reason = "a test that does not run says so")]

mod common;
mod driven;
#[path = "driven/killing.rs"]
mod killing;

use driven::Screen;

/// The screen; what is tested cannot be without it, and a user who builds without X should not fail for that.
fn screen() -> Option<Screen> {
    Screen::start()
        .map_err(|why| eprintln!("tests/kill.rs did not run: {why}"))
        .ok()
}

#[test]
fn what_was_finished_before_a_kill_is_kept_and_the_digits_are_those_of_an_undisturbed_run() {
    let Some(screen) = screen() else { return };
    let killed = killing::kill_in_stages(&screen, 3, 1);
    assert_eq!((killed.in_stages, killed.lost), (3, 0), "{killed:?}");
    assert!(killed.measured > 0, "{killed:?}");
}

#[test]
fn edits_that_were_shown_as_saved_are_kept() {
    let Some(screen) = screen() else { return };
    let killed = killing::kill_in_edits(&screen, 2, 1);
    assert_eq!((killed.in_edits, killed.lost), (2, 0), "{killed:?}");
    assert!(killed.said > 0, "{killed:?}");
}
