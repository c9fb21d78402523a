//! `camera.toml`, as it is read and written.

use std::fmt::Write;

use crate::camera::{InteriorOrientation, LensDirection};

/// What a camera file says.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraFile {
    /// Name of the camera.
    pub name: String,
    /// Columns of its images.
    pub width_px: u32,
    /// Rows of its images.
    pub height_px: u32,
    /// Side of a pixel, mm; `None`: from EXIF or searched.
    pub pixel_pitch_mm: Option<f64>,
    /// Principal distance, mm; `None`: from EXIF or searched.
    pub principal_distance_mm: Option<f64>,
    /// Principal point, mm.
    pub principal_point: [f64; 2],
    /// K1, K2, K3.
    pub radial: [f64; 3],
    /// P1, P2, mm^-1.
    pub tangential: [f64; 2],
    /// B1, B2.
    pub affinity: [f64; 2],
    /// What the distortion is a function of.
    pub direction: LensDirection,
    /// Standard deviations of known parameters in the order of [`crate::camera::INTERIOR_NAMES`]; `None`: no such knowledge.
    pub known_sigmas: [Option<f64>; 10],
}

impl CameraFile {
    /// The lens; where the principal distance is not given it is the diagonal of the image (or 1 mm without a pitch), a
    /// start for a search.
    #[must_use]
    pub fn interior(&self) -> InteriorOrientation {
        let diagonal = self
            .pixel_pitch_mm
            .map(|pitch| pitch * f64::from(self.width_px).hypot(f64::from(self.height_px)));
        InteriorOrientation {
            principal_distance: self.principal_distance_mm.or(diagonal).unwrap_or(1.0),
            principal_point: self.principal_point,
            radial: self.radial,
            tangential: self.tangential,
            affinity: self.affinity,
            direction: self.direction,
        }
    }
}

/// The text of a camera file: the keys alone for one camera, tables `[[camera]]` for several.
#[must_use]
pub fn cameras_toml(cameras: &[CameraFile]) -> String {
    let mut text = String::new();
    for (index, camera) in cameras.iter().enumerate() {
        if cameras.len() > 1 {
            text.push_str(if index == 0 {
                "[[camera]]\n"
            } else {
                "\n[[camera]]\n"
            });
        }
        write_camera(&mut text, camera);
    }
    text
}

fn write_camera(text: &mut String, camera: &CameraFile) {
    let name = toml::Value::String(camera.name.clone());
    // Writing to a String cannot fail.
    let _ = write!(
        text,
        "name = {name}\nwidth_px = {}\nheight_px = {}\n",
        camera.width_px, camera.height_px
    );
    if let Some(pitch) = camera.pixel_pitch_mm {
        let _ = writeln!(text, "pixel_pitch_mm = {pitch:?}");
    }
    let sigmas = &camera.known_sigmas;
    if let Some(distance) = camera.principal_distance_mm {
        let _ = writeln!(text, "principal_distance_mm = {distance:?}");
        if let Some(sigma) = sigmas[0] {
            let _ = writeln!(text, "sigma_principal_distance_mm = {sigma:?}");
        }
    }
    write_group(
        text,
        "principal_point_mm",
        &camera.principal_point,
        &sigmas[1..3],
    );
    write_group(text, "radial", &camera.radial, &sigmas[3..6]);
    write_group(text, "tangential", &camera.tangential, &sigmas[6..8]);
    write_group(text, "affinity", &camera.affinity, &sigmas[8..10]);
    write_direction(text, camera.direction);
}

/// The direction of the lens where it is not ours.
fn write_direction(text: &mut String, direction: LensDirection) {
    let name = direction_name(direction);
    if !direction.is_correcting() {
        let _ = writeln!(text, "lens = \"{name}\"");
    }
    if let LensDirection::Displacing { balanced_radius_mm } = direction {
        let _ = writeln!(text, "balanced_radius_mm = {balanced_radius_mm:?}");
    }
}

/// The name of a lens's direction in camera files.
#[must_use]
pub fn direction_name(direction: LensDirection) -> &'static str {
    match direction {
        LensDirection::Correcting => "correcting",
        LensDirection::CorrectingAffinityFirst => "correcting_affinity_first",
        LensDirection::Displacing { .. } => "displacing",
        LensDirection::DisplacingAffinityLast => "displacing_affinity_last",
    }
}

/// A key with its values, and their sigmas where there are any; an infinite one stands for no knowledge.
fn write_group(text: &mut String, key: &str, values: &[f64], sigmas: &[Option<f64>]) {
    let _ = writeln!(text, "{key} = {values:?}");
    if sigmas.iter().any(Option::is_some) {
        let sigmas: Vec<f64> = sigmas.iter().map(|s| s.unwrap_or(f64::INFINITY)).collect();
        let _ = writeln!(text, "sigma_{key} = {sigmas:?}");
    }
}
