//! The commands of the program without a window: each takes what the arguments said and does it.
//!
//! Deliberately absent: argument parsing (`main.rs`) and measurement (they drive the same session as the window).

mod adjust;
mod codes;
mod demo;
mod detect;
mod export;
mod import;
mod name;
mod overlays;
mod project;
mod run;
mod terminal;

use std::io;
use std::path::Path;

use crate::imaging::LoadError;
use crate::project::files::FileError;
use crate::project::import::ImportingError;
use crate::project::intake::IntakeError;
use crate::project::making::MakingError;
use crate::project::session::{Session, SessionError};
use crate::project::storage::StorageError;
use crate::report::{SameFile, WriteError};

pub use adjust::{AdjustRequest, adjust};
pub use codes::{SheetRequest, codes, codes_sheet};
pub use demo::{DemoCross, DemoRequest, PreparedDemo, demo, prepare_demo};
pub use detect::{DetectRequest, detect};
pub use export::{ExportRequest, compare, export};
pub use import::{ImportRequest, Program, import};
pub use name::{NameRequest, name};
pub use project::{NewRequest, add, exclude, new};
pub use run::{measure, run};
pub use terminal::{monitor_on_terminal, report, report_failure};

/// How results are printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// For people.
    Text,
    /// For programs.
    Json,
}

impl Form {
    /// JSON where it was asked for.
    #[must_use]
    pub fn of_json(json: bool) -> Self {
        if json { Form::Json } else { Form::Text }
    }
}

/// The class of a failure, which decides the exit status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// The work could not be done (1).
    Work,
    /// Arguments or input files are bad (2).
    Input,
    /// There is no window: no display, or a driver or library is missing (3).
    Window,
    /// Interrupted (130).
    Interrupted,
}

/// A command that did not do what it was asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{line}")]
pub struct CommandError {
    /// Its class.
    pub failure: Failure,
    /// What went wrong, in one line.
    pub line: String,
}

impl CommandError {
    /// The work could not be done.
    #[must_use]
    pub fn work(line: impl Into<String>) -> Self {
        Self {
            failure: Failure::Work,
            line: line.into(),
        }
    }

    /// Arguments or input files are bad.
    #[must_use]
    pub fn input(line: impl Into<String>) -> Self {
        Self {
            failure: Failure::Input,
            line: line.into(),
        }
    }

    /// There is no window.
    #[must_use]
    pub fn window(line: impl Into<String>) -> Self {
        Self {
            failure: Failure::Window,
            line: line.into(),
        }
    }

    /// The operator stopped it; the line says what of the work there is.
    #[must_use]
    pub fn interrupted(line: impl Into<String>) -> Self {
        Self {
            failure: Failure::Interrupted,
            line: line.into(),
        }
    }

    /// The operator stopped work on a project, which is saved step by step.
    #[must_use]
    pub fn interrupted_between_steps() -> Self {
        Self::interrupted(
            "interrupted; all finished steps are kept, the same command goes on from there",
        )
    }
}

impl From<FileError> for CommandError {
    fn from(error: FileError) -> Self {
        Self::input(error.to_string())
    }
}

impl From<IntakeError> for CommandError {
    fn from(error: IntakeError) -> Self {
        match error {
            IntakeError::Interrupted(_) => Self::interrupted("interrupted; nothing was changed"),
            other => Self::input(other.to_string()),
        }
    }
}

impl From<MakingError> for CommandError {
    fn from(error: MakingError) -> Self {
        match error {
            MakingError::Exists { .. } => Self::input(error.to_string()),
            MakingError::File(error) => error.into(),
            MakingError::Intake(error) => error.into(),
            MakingError::Storage(error) => error.into(),
        }
    }
}

impl From<ImportingError> for CommandError {
    fn from(error: ImportingError) -> Self {
        match error {
            ImportingError::Storage(error) => error.into(),
            ImportingError::Interrupted(_) => Self::interrupted("interrupted; nothing was made"),
            other => Self::input(other.to_string()),
        }
    }
}

impl From<LoadError> for CommandError {
    fn from(error: LoadError) -> Self {
        Self::input(error.to_string())
    }
}

impl From<SessionError> for CommandError {
    fn from(error: SessionError) -> Self {
        match error {
            SessionError::Storage(error) => error.into(),
            SessionError::Edit(_) => Self::work(error.to_string()),
        }
    }
}

impl From<StorageError> for CommandError {
    fn from(error: StorageError) -> Self {
        let failure = match &error {
            StorageError::Missing { .. }
            | StorageError::Exists { .. }
            | StorageError::NotAProject { .. }
            | StorageError::Newer { .. }
            | StorageError::Damaged { .. } => Failure::Input,
            StorageError::File { source, .. } => failure_of_file(source),
            StorageError::InUse { .. }
            | StorageError::Changed { .. }
            | StorageError::NotStorable { .. }
            | StorageError::ReadOnly { .. }
            | StorageError::Fault { .. }
            | StorageError::Database { .. } => Failure::Work,
        };
        Self {
            failure,
            line: error.to_string(),
        }
    }
}

impl From<SameFile> for CommandError {
    fn from(error: SameFile) -> Self {
        Self::input(error.to_string())
    }
}

impl From<WriteError> for CommandError {
    fn from(error: WriteError) -> Self {
        Self {
            failure: failure_of_file(&error.reason),
            line: error.to_string(),
        }
    }
}

/// A place where no file can be is a bad argument; a full or broken disk is not.
fn failure_of_file(error: &io::Error) -> Failure {
    match error.kind() {
        io::ErrorKind::NotFound
        | io::ErrorKind::PermissionDenied
        | io::ErrorKind::NotADirectory
        | io::ErrorKind::IsADirectory
        | io::ErrorKind::InvalidInput
        | io::ErrorKind::InvalidFilename
        | io::ErrorKind::ReadOnlyFilesystem => Failure::Input,
        _ => Failure::Work,
    }
}

/// What is wrong with a file that is open for reading only, on one line.
fn in_one_line(warnings: &[String]) -> String {
    /// Faults that are told one by one.
    const TOLD: usize = 2;
    let mut line = warnings
        .iter()
        .take(TOLD)
        .map(|w| w.split_whitespace().collect::<Vec<_>>().join(" "))
        .collect::<Vec<_>>()
        .join(": ");
    if warnings.len() > TOLD {
        line.push_str(&format!(" (and {} more faults)", warnings.len() - TOLD));
    }
    line
}

/// Opens a project that is to be changed.
///
/// # Errors
/// Where it cannot be opened, or for reading only: a measurement that could not be saved would be lost.
fn open_to_change(project: &Path) -> Result<Session, CommandError> {
    let session = Session::open(project)?;
    if session.is_writable() {
        return Ok(session);
    }
    Err(CommandError::input(format!(
        "{}: {}; nothing was changed, export and compare give what can be read",
        project.display(),
        in_one_line(session.warnings())
    )))
}
