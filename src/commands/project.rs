//! `new`, `add`, `exclude`: what a project consists of.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::terminal::show;
use super::{CommandError, open_to_change};
use crate::network::Network;
use crate::project::files::{read_bars, read_cameras, read_control, read_cross, read_targets};
use crate::project::intake::{add_cameras, add_images, exclude_images};
use crate::project::session::{Session, folder_of};
use crate::targets::Family;

/// What a new project is made of.
#[derive(Clone, Debug)]
pub struct NewRequest {
    /// Project file to make.
    pub project: PathBuf,
    /// Image files, or folders of images.
    pub images: Vec<PathBuf>,
    /// Camera files.
    pub cameras: Vec<PathBuf>,
    /// Sizes of the targets.
    pub targets: Option<PathBuf>,
    /// Points of the reference cross.
    pub cross: Option<PathBuf>,
    /// Scale bars.
    pub bars: Option<PathBuf>,
    /// Points with known coordinates.
    pub control: Option<PathBuf>,
    /// Code families.
    pub families: Vec<Family>,
}

/// Makes a project; nothing is written where any of the files is bad.
///
/// # Errors
/// [`CommandError`] for a bad file, an existing project, a picture given twice or of another size than the cameras.
pub fn new(request: &NewRequest) -> Result<(), CommandError> {
    let project = &request.project;
    // Before any picture is looked at; `Session::create` would see it too.
    if fs::symlink_metadata(project).is_ok() {
        return Err(CommandError::input(format!(
            "{}: found an existing file, expected the name of a new project",
            project.display()
        )));
    }
    let mut network = Network::default();
    let settings = Arc::make_mut(&mut network.settings);
    settings.families = request.families.clone();
    settings.families.sort_unstable();
    settings.families.dedup();
    if let Some(targets) = &request.targets {
        settings.targets = read_targets(targets)?;
    }
    if let Some(cross) = &request.cross {
        network.device = Arc::new(read_cross(cross)?);
    }
    if let Some(bars) = &request.bars {
        network.scale_bars = Arc::new(read_bars(bars, &network.device)?);
    }
    if let Some(control) = &request.control {
        network.control = Arc::new(read_control(control, &network.device)?);
    }
    for camera in &request.cameras {
        add_cameras(&mut network, &read_cameras(camera)?);
    }
    let count = add_images(&mut network, &folder_of(project), &request.images)?;
    Session::create(project, network)?;
    show(&format!("{}: {count} images", project.display()))
}

/// Adds images to a project.
///
/// # Errors
/// [`CommandError`]; the project is unchanged then.
pub fn add(project: &Path, images: &[PathBuf]) -> Result<(), CommandError> {
    let mut session = open_to_change(project)?;
    let folder = folder_of(project);
    let count = session.edit("add images", |network| -> Result<usize, CommandError> {
        Ok(add_images(network, &folder, images)?)
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
