//! Tiepoint: vision metrology from photographs of coded and plain targets.

pub mod adjustment;
pub mod camera;
pub mod geometry;
pub mod matching;
pub mod imaging;
pub mod monitor;
pub mod network;
pub mod synthetic;
pub mod project;
pub mod orientation;
pub mod targets;
