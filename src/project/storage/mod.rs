//! A project is one SQLite file.
//!
//! Every table holds rows `id -> JSON` with a SHA-256 of table, id and JSON, so that one pair of functions writes and
//! reads them all, any tool can look at them, and a digit that flipped on the disk is noticed (SQLite itself would not).
//!
//! | table | id | row |
//! | --- | --- | --- |
//! | `document` | name | everything there is once: settings, device, bars, control, conclusions, findings, adjustment ... |
//! | `cameras` | camera | `CameraEntry` |
//! | `images` | image | `ImageEntry` without detections and names of dots |
//! | `detections` | image | `Detections` |
//! | `marks` | image | names of dots, readings set aside, why dots have no name |
//! | `points` | label | `Point` |
//! | `journal` | sequence | when, what, settings, outcome, sigma0 (plain columns) |
//!
//! * **One writer.** A lock file beside the project (`FILE-lock`) is held by the operating system and falls with the
//!   process that holds it, however that ends. It cannot be the project file itself: POSIX drops all of a process's locks on
//!   a file when any handle of it is closed, SQLite's own among them. Readers need no lock.
//! * **One transaction per save**, `journal_mode=WAL`, `synchronous=FULL`: after a crash or a power cut the file holds the
//!   last save that returned. When the last writer closes, the mode goes back to `DELETE`: the project at rest is one file.
//! * **Only what changed**: a row is written where its `Arc` is no longer the one saved last.
//! * **What is written can be read**: each row is read back from its JSON before anything is written; JSON has no number
//!   that is not finite and would keep silent about it.
//! * **Damage** leaves what can still be read, for reading only.

mod copy;
mod error;
mod journal;
mod lock;
mod reading;
mod repair;
mod rows;
mod store;
#[cfg(test)]
mod tests;

pub use copy::{rebased, save_as};
pub use error::{NotStorable, StorageError};
pub use journal::{JournalEntry, JournalLine, utc_text};
pub use store::{Opened, Saved, Store};

/// "TIEP": the application id in the header of a project file.
pub const APPLICATION_ID: i32 = 0x5449_4550;

/// Version of the tables that this program reads and writes.
pub const FORMAT_VERSION: i32 = 1;
