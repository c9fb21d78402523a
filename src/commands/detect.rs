//! `detect`: targets and codes of single images, without a project.

use std::path::PathBuf;

use super::terminal::show;
use super::{CommandError, Form};
use crate::imaging::{LoadSettings, load_picture};
use crate::monitor::Monitor;
use crate::project::files::read_cameras;
use crate::report::{DetectReport, detect_line};
use crate::targets::{DetectSettings, Family, detect as detect_targets};

/// What to look for where.
#[derive(Clone, Debug)]
pub struct DetectRequest {
    /// Image files.
    pub images: Vec<PathBuf>,
    /// Camera file: its size must be that of the images.
    pub camera: Option<PathBuf>,
    /// Code families.
    pub families: Vec<Family>,
}

/// Finds targets and codes in single images.
///
/// # Errors
/// [`CommandError`] for an image that cannot be read or has another size than the camera.
pub fn detect(request: &DetectRequest, form: Form, monitor: &Monitor) -> Result<(), CommandError> {
    let cameras = match &request.camera {
        Some(file) => read_cameras(file)?,
        None => Vec::new(),
    };
    let task = monitor.task("detecting targets", request.images.len() as u64);
    let settings = DetectSettings::default();
    let mut reports = Vec::new();
    let mut lines = String::new();
    for path in &request.images {
        task.step().map_err(|_| CommandError::interrupted())?;
        let picture = load_picture(path, &LoadSettings::default())?.image;
        let size = (picture.width() as u32, picture.height() as u32);
        if let Some(camera) = cameras.first()
            && !cameras.iter().any(|c| (c.width_px, c.height_px) == size)
        {
            return Err(CommandError::input(format!(
                "{}: found {} x {} px, expected {} x {} px of camera '{}'",
                path.display(),
                size.0,
                size.1,
                camera.width_px,
                camera.height_px,
                camera.name
            )));
        }
        let detections = detect_targets(&picture, &request.families, &settings);
        let name = path.to_string_lossy();
        match form {
            Form::Json => reports.push(DetectReport::new(&name, &detections)),
            Form::Text => {
                lines.push_str(&detect_line(&name, &detections));
                lines.push('\n');
            }
        }
    }
    match form {
        Form::Json => {
            let json = serde_json::to_string_pretty(&reports)
                .map_err(|e| CommandError::work(format!("result as JSON: {e}")))?;
            show(&json)
        }
        Form::Text => show(&lines),
    }
}
