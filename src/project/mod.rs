//! The project: the measurement on disk and its past.
//!
//! Memory holds the truth (an `Arc<Network>`); the project file follows it, one transaction per step or edit
//! ([`storage`]), so nothing is ever unsaved. What was before is kept as old values ([`history`]), never as inverse
//! commands.

pub mod history;
pub mod storage;
