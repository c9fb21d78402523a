//! Tiepoint: vision metrology from photographs of coded and plain targets.

pub mod camera;
pub mod geometry;
pub mod monitor;
pub mod network;
pub mod project;
pub mod report;
pub mod targets;
