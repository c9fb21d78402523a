//! Tiepoint: vision metrology from photographs of coded and plain targets.

pub mod adjustment;
pub mod camera;
pub mod commands;
pub mod geometry;
pub mod imaging;
pub mod matching;
pub mod monitor;
pub mod network;
pub mod orientation;
pub mod project;
pub mod report;
pub mod stages;
pub mod synthetic;
pub mod targets;
