//! `export` and `compare`: what a project gives to others.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::terminal::show;
use super::{CommandError, Form, in_one_line};
use crate::geometry::Scale;
use crate::network::Network;
use crate::project::files::read_reference;
use crate::project::storage::Store;
use crate::report::{
    CompareSettings, NoFigures, check_apart, compare as compare_points, export_cameras,
    export_missing, export_observations, export_points, export_stations, write_file,
};

/// Which tables to write where.
#[derive(Clone, Debug)]
pub struct ExportRequest {
    /// Project file.
    pub project: PathBuf,
    /// Adjusted points.
    pub points: Option<PathBuf>,
    /// Every detected target.
    pub observations: Option<PathBuf>,
    /// Targets that images ought to show and do not.
    pub missing: Option<PathBuf>,
    /// Oriented images.
    pub stations: Option<PathBuf>,
    /// Cameras.
    pub cameras: Option<PathBuf>,
}

/// A project as far as it can be read.
struct Reading {
    network: Arc<Network>,
    /// What is to be told after the work on a damaged file, which gave what is left of it.
    damage: Result<(), CommandError>,
}

fn read_project(project: &Path) -> Result<Reading, CommandError> {
    let opened = Store::open_read_only(project)?;
    let damage = match opened.warnings.as_slice() {
        [] => Ok(()),
        warnings => Err(CommandError::work(format!(
            "{}: damaged: {}; the results hold what could be read",
            project.display(),
            in_one_line(warnings)
        ))),
    };
    Ok(Reading {
        network: opened.network,
        damage,
    })
}

/// Writes tables of a project.
///
/// # Errors
/// [`CommandError`] where the project cannot be read, its adjustment is older than its inputs, or a file cannot be written.
pub fn export(request: &ExportRequest) -> Result<(), CommandError> {
    let tables = [
        ("--points", &request.points),
        ("--observations", &request.observations),
        ("--missing", &request.missing),
        ("--stations", &request.stations),
        ("--cameras", &request.cameras),
    ];
    let asked: Vec<(&str, &Path)> = tables
        .iter()
        .filter_map(|(option, path)| Some((*option, path.as_deref()?)))
        .collect();
    if asked.is_empty() {
        return Err(CommandError::input(
            "export: found no table to write, expected --points, --observations, --missing, --stations or --cameras",
        ));
    }
    check_apart(&[("the project", &request.project)], &asked)?;
    let Reading { network, damage } = read_project(&request.project)?;
    let work = |e: NoFigures| match &damage {
        Ok(()) => CommandError::work(format!("{}: {e}", request.project.display())),
        Err(damage) => damage.clone(),
    };
    if let Some(path) = &request.points {
        write_file(path, export_points(&network).map_err(work)?.as_bytes())?;
    }
    if let Some(path) = &request.observations {
        write_file(
            path,
            export_observations(&network).map_err(work)?.as_bytes(),
        )?;
    }
    if let Some(path) = &request.missing {
        write_file(path, export_missing(&network).as_bytes())?;
    }
    if let Some(path) = &request.stations {
        write_file(path, export_stations(&network).map_err(work)?.as_bytes())?;
    }
    if let Some(path) = &request.cameras {
        write_file(path, export_cameras(&network).map_err(work)?.as_bytes())?;
    }
    damage
}

/// Compares a project's coordinates with known ones.
///
/// # Errors
/// [`CommandError`] where a file is bad or fewer than three points are common.
pub fn compare(
    project: &Path,
    reference: &Path,
    scale: Scale,
    form: Form,
) -> Result<(), CommandError> {
    let reference = read_reference(reference)?;
    let Reading { network, damage } = read_project(project)?;
    let settings = CompareSettings {
        scale,
        ..CompareSettings::default()
    };
    let comparison =
        compare_points(&network, &reference, &settings).map_err(|e| match &damage {
            Ok(()) => CommandError::work(format!("{}: {e}", project.display())),
            Err(damage) => damage.clone(),
        })?;
    match form {
        Form::Json => {
            let json = serde_json::to_string_pretty(&comparison)
                .map_err(|e| CommandError::work(format!("result as JSON: {e}")))?;
            show(&json)?;
        }
        Form::Text => show(&comparison.text())?,
    }
    damage
}
