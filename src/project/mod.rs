//! The project: the measurement on disk and its past.
//!
//! Memory holds the truth (an `Arc<Network>`); the project file follows it, one transaction per step or edit
//! ([`storage`]), so nothing is ever unsaved. What was before is kept as old values ([`history`]), never as inverse
//! commands. [`session`] is the one place that changes a document; [`intake`] takes images in, [`files`] reads what a
//! user writes, [`making`] makes a project of them, [`import`] of another program's files, [`proposal`] says what can be made of dropped files, [`whereabouts`]
//! finds pictures that were moved, [`recent`] remembers what was open.

pub mod edit;
pub mod files;
pub mod history;
pub mod import;
pub mod intake;
pub mod making;
pub mod proposal;
pub mod recent;
#[cfg(test)]
mod sample_folder;
mod saver;
pub mod session;
pub mod storage;
pub mod whereabouts;
