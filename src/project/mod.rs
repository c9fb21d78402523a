//! The project: what the operator keeps.

pub mod files;
