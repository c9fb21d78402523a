//! A project from the files of another program: what it measured counts as measured here.
//!
//! `sources` finds and reads the program's files, `pictures` the picture files beside them, `names` gives its points
//! their ids, `document` makes the network of it all. What a project has otherwise than the file is a finding
//! ([`crate::network::FindingKind::Import`]); nothing is changed in silence.

mod document;
mod names;
mod pictures;
mod sources;

use std::fmt;
use std::fs;
use std::path::PathBuf;
use std::str::FromStr;

use super::files::FileError;
use super::session::{Session, folder_of};
use super::storage::StorageError;
use crate::monitor::{Interrupted, Monitor};
use crate::plain_network::ImportError;

/// A program whose networks are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// AICON bundle files (`.ior`, `.eor`, `.obc`, `.phc`, `.scale`).
    Aicon,
    /// Tables of the Damped Bundle Adjustment Toolbox with its camera in XML.
    Dbat,
    /// A COLMAP text model (`cameras.txt`, `images.txt`, `points3D.txt`).
    Colmap,
}

impl Program {
    /// All of them.
    pub const ALL: [Program; 3] = [Program::Aicon, Program::Dbat, Program::Colmap];
}

impl fmt::Display for Program {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Program::Aicon => "aicon",
            Program::Dbat => "dbat",
            Program::Colmap => "colmap",
        })
    }
}

/// A name that is no program whose networks are read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("found '{0}', expected aicon, dbat or colmap")]
pub struct UnknownProgram(String);

impl FromStr for Program {
    type Err = UnknownProgram;

    fn from_str(s: &str) -> Result<Self, Self::Err> {
        Program::ALL
            .into_iter()
            .find(|program| program.to_string() == s)
            .ok_or_else(|| UnknownProgram(s.into()))
    }
}

/// What is imported, and into which project.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImportPlan {
    /// The program that wrote the files.
    pub program: Program,
    /// The folder of its files.
    pub folder: PathBuf,
    /// Project file to make.
    pub project: PathBuf,
}

/// Why nothing was imported, in one line.
#[derive(Debug, thiserror::Error)]
pub enum ImportingError {
    /// A project never overwrites a file.
    #[error("{}: found an existing file, expected the name of a new project", project.display())]
    Exists {
        /// The project file.
        project: PathBuf,
    },
    /// The folder does not hold what it should.
    #[error("{}: found {found}, expected {expected}", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// A file cannot be read as text.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file does not hold the network that it should.
    #[error(transparent)]
    Network(#[from] ImportError),
    /// Two names of the file are one label here.
    #[error(
        "points '{first}' and '{second}': found two names of {label}, expected one of each point"
    )]
    OneLabel {
        /// One of the names.
        first: String,
        /// The other.
        second: String,
        /// The label that both are.
        label: String,
    },
    /// The project file cannot be written.
    #[error(transparent)]
    Storage(#[from] StorageError),
    /// The operator stopped it.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

/// Makes a project of another program's network; nothing is written where any of its files is bad.
///
/// Reads every picture beside the files once, to know it again.
///
/// # Errors
/// [`ImportingError`].
pub fn import(plan: &ImportPlan, monitor: &Monitor) -> Result<Session, ImportingError> {
    // Before any file is read; `Session::create` would see it too.
    if fs::symlink_metadata(&plan.project).is_ok() {
        return Err(ImportingError::Exists {
            project: plan.project.clone(),
        });
    }
    let source = sources::read(plan.program, &plan.folder)?;
    let folder = folder_of(&plan.project);
    let pictures = pictures::beside(&source.network, &plan.folder, &folder, monitor)?;
    let network = document::document(&source, &pictures)?;
    Ok(Session::create(&plan.project, network)?)
}

#[cfg(test)]
mod tests;
