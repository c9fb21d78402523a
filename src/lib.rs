//! Tiepoint: vision metrology from photographs of coded and plain targets.

pub mod camera;
pub mod geometry;
pub mod monitor;
pub mod orientation;
pub mod targets;
