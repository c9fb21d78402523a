//! What can go wrong with a project file, each in one line.

use std::path::{Path, PathBuf};

use rusqlite::ErrorCode;

/// A row that would not come back as it is.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{table} {id} cannot be stored: {reason}")]
pub struct NotStorable {
    /// Table of the row.
    pub table: &'static str,
    /// Its id.
    pub id: String,
    /// What is wrong with it.
    pub reason: String,
}

/// Why a project file could not be opened or written.
#[derive(Debug, thiserror::Error)]
pub enum StorageError {
    /// There is no such file.
    #[error("{}: found no such file, expected a Tiepoint project", file.display())]
    Missing {
        /// The file.
        file: PathBuf,
    },
    /// A new project must not overwrite a file.
    #[error("{}: found a file of this name, expected none: a project is never overwritten", file.display())]
    Exists {
        /// The file.
        file: PathBuf,
    },
    /// The file is something else.
    #[error("{}: not a Tiepoint project: found {found}, expected application id 0x{:08x}", file.display(), super::APPLICATION_ID)]
    NotAProject {
        /// The file.
        file: PathBuf,
        /// What it is instead.
        found: String,
    },
    /// The file has tables that this program does not know.
    #[error("{}: made by a newer version of Tiepoint: found format {found}, expected at most {expected}", file.display())]
    Newer {
        /// The file.
        file: PathBuf,
        /// Its format version.
        found: i32,
        /// The newest known one.
        expected: i32,
    },
    /// Nothing of the file can be read.
    #[error("{}: damaged, nothing could be read: {found}", file.display())]
    Damaged {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        found: String,
    },
    /// Another program writes to it.
    #[error("{} is open in another Tiepoint{}", file.display(), process.map(|id| format!(" (process {id})")).unwrap_or_default())]
    InUse {
        /// The file.
        file: PathBuf,
        /// The other program, where it is known.
        process: Option<u32>,
    },
    /// The file is no longer the one that was opened or saved last.
    #[error("{}: changed by another program since it was opened; nothing was written", file.display())]
    Changed {
        /// The file.
        file: PathBuf,
    },
    /// The network holds what cannot be stored; nothing was written.
    #[error("{}: nothing was written: {source}", file.display())]
    NotStorable {
        /// The file.
        file: PathBuf,
        /// The row.
        source: NotStorable,
    },
    /// The project is open for reading only.
    #[error("{}: open for reading only: changes are not saved, a copy can be", file.display())]
    ReadOnly {
        /// The file.
        file: PathBuf,
    },
    /// Saving ended by a panic; the document in memory stands.
    #[error("a fault of this program while saving: {message}")]
    Fault {
        /// What it said.
        message: String,
    },
    /// The file system refused.
    #[error("{}: could not {action}: {source}", file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// What was tried.
        action: &'static str,
        /// Why it failed.
        source: std::io::Error,
    },
    /// The database refused.
    #[error("{}: could not {action}: {source}", file.display())]
    Database {
        /// The file.
        file: PathBuf,
        /// What was tried.
        action: &'static str,
        /// Why it failed.
        source: rusqlite::Error,
    },
}

impl StorageError {
    /// What an error of SQLite means to the operator.
    pub(super) fn of_database(file: &Path, action: &'static str, source: rusqlite::Error) -> Self {
        let file = file.to_owned();
        match source.sqlite_error_code() {
            Some(ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked) => Self::InUse {
                file,
                process: None,
            },
            Some(ErrorCode::NotADatabase) => Self::NotAProject {
                file,
                found: "a file that is no database, or one whose beginning is damaged".into(),
            },
            Some(ErrorCode::DatabaseCorrupt) => Self::Damaged {
                file,
                found: source.to_string(),
            },
            _ => Self::Database {
                file,
                action,
                source,
            },
        }
    }

    /// An error of the file system.
    pub(super) fn of_file(file: &Path, action: &'static str, source: std::io::Error) -> Self {
        Self::File {
            file: file.to_owned(),
            action,
            source,
        }
    }
}
