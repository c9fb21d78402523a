//! The window as the operator uses it: found by labels, driven by keys, clicks and places in the picture, drawn by the
//! software renderer without a screen.

mod common;

#[path = "window/bench.rs"]
mod bench;
#[path = "window/files.rs"]
mod files;
#[path = "window/frame.rs"]
mod frame;
#[path = "window/looking.rs"]
mod looking;
#[path = "window/mending.rs"]
mod mending;
#[path = "window/pictures.rs"]
mod pictures;
#[path = "window/reopening.rs"]
mod reopening;
#[path = "window/running.rs"]
mod running;
#[path = "window/walking.rs"]
mod walking;
