//! The project: the measurement on disk and its past.
//!
//! Memory holds the truth (an `Arc<Network>`); the project file follows it, one transaction per step or edit
//! ([`storage`]), so nothing is ever unsaved. What was before is kept as old values ([`history`]), never as inverse
//! commands. [`session`] is the one place that changes a document; [`intake`] takes images in, [`files`] reads what a
//! user writes.

pub mod edit;
pub mod files;
pub mod history;
pub mod intake;
mod saver;
pub mod session;
pub mod storage;
