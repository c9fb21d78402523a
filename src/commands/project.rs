//! `new`, `add`, `exclude`: what a project consists of.

use std::path::{Path, PathBuf};

use super::terminal::show;
use super::{CommandError, open_to_change};
use crate::monitor::Monitor;
use crate::project::intake::{add_images, exclude_images};
use crate::project::making::make;
use crate::project::session::folder_of;

pub use crate::project::making::ProjectPlan as NewRequest;

/// Makes a project; nothing is written where any of the files is bad.
///
/// # Errors
/// [`CommandError`] for a bad file, an existing project, a picture given twice or of another size than the cameras.
pub fn new(request: &NewRequest, monitor: &Monitor) -> Result<(), CommandError> {
    let count = make(request, monitor)?.network().images.len();
    show(&format!("{}: {count} images", request.project.display()))
}

/// Adds images to a project.
///
/// # Errors
/// [`CommandError`]; the project is unchanged then.
pub fn add(project: &Path, images: &[PathBuf], monitor: &Monitor) -> Result<(), CommandError> {
    let mut session = open_to_change(project)?;
    let folder = folder_of(project);
    let count = session.edit("add images", |network| -> Result<usize, CommandError> {
        Ok(add_images(network, &folder, images, monitor)?)
    })?;
    session.flush()?;
    show(&format!("{}: {count} images added", project.display()))
}

/// Excludes images from a project.
///
/// # Errors
/// [`CommandError`]; the project is unchanged then.
pub fn exclude(project: &Path, images: &[PathBuf]) -> Result<(), CommandError> {
    let mut session = open_to_change(project)?;
    let folder = folder_of(project);
    let count = session.edit("exclude images", |network| -> Result<usize, CommandError> {
        Ok(exclude_images(network, &folder, images)?)
    })?;
    session.flush()?;
    show(&format!("{}: {count} images excluded", project.display()))
}
