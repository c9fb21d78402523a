//! `detect`: targets and codes of single images, without a project.

use std::path::{Path, PathBuf};

use super::overlays::OverlayFolder;
use super::terminal::show;
use super::{CommandError, Form};
use crate::camera::{Camera, InteriorOrientation};
use crate::imaging::{GreyImage, LoadSettings, load_picture};
use crate::monitor::Monitor;
use crate::project::files::read_cameras;
use crate::report::{CameraFile, DetectReport, detect_line};
use crate::targets::{DetectSettings, Family, NominalCamera, detect as detect_targets};

/// What to look for where.
#[derive(Clone, Debug)]
pub struct DetectRequest {
    /// Image files.
    pub images: Vec<PathBuf>,
    /// Camera file: its size must be that of the images.
    pub camera: Option<PathBuf>,
    /// Code families.
    pub families: Vec<Family>,
    /// Folder for a picture of each image with what was found drawn over it; `None` for none.
    pub overlay: Option<PathBuf>,
}

/// Finds targets and codes in single images; those that cannot be read are left out and told at the end.
///
/// # Errors
/// [`CommandError`] for an image that cannot be read or has another size than the camera, and for overlays that cannot
/// be written.
pub fn detect(request: &DetectRequest, form: Form, monitor: &Monitor) -> Result<(), CommandError> {
    let cameras = match &request.camera {
        Some(file) => read_cameras(file)?,
        None => Vec::new(),
    };
    let mut overlays = match &request.overlay {
        Some(folder) => Some(OverlayFolder::new(folder, &request.images)?),
        None => None,
    };
    let task = monitor.task("detecting targets", request.images.len() as u64);
    let mut reports = Vec::new();
    let mut lines = String::new();
    let mut refused: Vec<String> = Vec::new();
    let mut done = 0;
    let mut interrupted = false;
    for path in &request.images {
        let picture = match checked_picture(path, &cameras) {
            Ok(picture) => picture,
            Err(line) => {
                refused.push(line);
                continue;
            }
        };
        if task.step().is_err() {
            interrupted = true;
            break;
        }
        let settings = settings_for(&picture, &cameras);
        let detections = detect_targets(&picture, &request.families, &settings);
        if let Some(overlays) = &mut overlays {
            overlays.write(path, &picture, &detections)?;
        }
        done += 1;
        let name = path.to_string_lossy();
        match form {
            Form::Json => reports.push(DetectReport::new(&name, &detections)),
            Form::Text => {
                lines.push_str(&detect_line(&name, &detections));
                lines.push('\n');
            }
        }
    }
    if done > 0 {
        match form {
            Form::Json => {
                let json = serde_json::to_string_pretty(&reports)
                    .map_err(|e| CommandError::work(format!("result as JSON: {e}")))?;
                show(&json)?;
            }
            Form::Text => show(&lines)?,
        }
    }
    if interrupted {
        return Err(CommandError::interrupted(format!(
            "interrupted after {} of {} images; what was found in them is printed",
            done + refused.len(),
            request.images.len()
        )));
    }
    match refused.as_slice() {
        [] => Ok(()),
        [line] => Err(CommandError::input(line)),
        [line, more @ ..] => Err(CommandError::input(format!(
            "{line} (and {} more images like that)",
            more.len()
        ))),
    }
}

/// The settings that what is known of the camera asks for.
fn settings_for(picture: &GreyImage, cameras: &[CameraFile]) -> DetectSettings {
    /// How far principal distances may be wrong, as a share: files are copied from one camera to another.
    const SHARE: f64 = 0.1;
    let size = (picture.width() as u32, picture.height() as u32);
    let mut fitting = cameras.iter().filter(|c| (c.width_px, c.height_px) == size);
    let nominal = fitting.next().and_then(|camera| {
        let (pitch, distance) = (camera.pixel_pitch_mm?, camera.principal_distance_mm?);
        let camera = Camera {
            width_px: camera.width_px,
            height_px: camera.height_px,
            pixel_pitch_mm: pitch,
            interior: InteriorOrientation {
                principal_point: camera.principal_point,
                ..InteriorOrientation::pinhole(distance)
            },
        };
        Some(NominalCamera::of(&camera, SHARE))
    });
    let mut settings = DetectSettings::default();
    settings.dot420.camera = nominal;
    settings
}

/// A picture that has the size of one of the cameras, where there are any; else the line that says what is wrong.
fn checked_picture(path: &Path, cameras: &[CameraFile]) -> Result<GreyImage, String> {
    let picture = load_picture(path, &LoadSettings::default())
        .map_err(|e| e.to_string())?
        .image;
    let size = (picture.width() as u32, picture.height() as u32);
    match cameras.first() {
        Some(camera) if !cameras.iter().any(|c| (c.width_px, c.height_px) == size) => Err(format!(
            "{}: found {} x {} px, expected {} x {} px of camera '{}'",
            path.display(),
            size.0,
            size.1,
            camera.width_px,
            camera.height_px,
            camera.name
        )),
        _ => Ok(picture),
    }
}
