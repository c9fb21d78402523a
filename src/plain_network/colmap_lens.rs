//! COLMAP's camera models and the displacing lens, both ways.
//!
//! COLMAP distorts the normalised ideal point `u = X/Z`, `v = Y/Z` (z forward, y down) with `r2 = u^2 + v^2`,
//! `du = u (k1 r2 + k2 r2^2 + k3 r2^3) + 2 p1 u v + p2 (r2 + 2 u^2)`,
//! `dv = v (k1 r2 + k2 r2^2 + k3 r2^3) + 2 p2 u v + p1 (r2 + 2 v^2)`, then scales to pixels by fx and fy
//! (`src/colmap/sensor/models.h`). With `px = c u`, `py = -c v` this is [`LensDirection::DisplacingAffinityLast`] with
//! `K1 = k1 / c^2`, `K2 = k2 / c^4`, `K3 = k3 / c^6`, `P1 = p2 / c`, `P2 = -p1 / c`.
//!
//! fx scales the distortion too: a lens whose affinity acts beside its distortion is off by `(fx / fy - 1) fy du` pixels, and COLMAP has
//! no shear. Either is refused where it is larger than a stated share of a pixel at the corners of the image.

use super::check::NetworkFault;
use super::error::quote;
use super::rows::Row;
use super::{ImportError, PlainCamera, PlainParameter};
use crate::adjustment::Sharing;
use crate::camera::LensDirection;

/// Side of a pixel that is assumed, mm; COLMAP knows pixels only, and every millimetre in the image scales with this.
pub const COLMAP_PITCH_MM: f64 = 0.005;

/// Largest misfit of a camera that is written, px; the other program takes it as it stands.
const LARGEST_MISFIT_WRITTEN_PX: f64 = 0.001;

/// Where the parameters of a model go: fx, fy, cx, cy, k1, k2, p1, p2, k3.
struct Model {
    name: &'static str,
    parameters: &'static [&'static str],
}

const MODELS: [Model; 6] = [
    Model {
        name: "SIMPLE_PINHOLE",
        parameters: &["f", "cx", "cy"],
    },
    Model {
        name: "PINHOLE",
        parameters: &["fx", "fy", "cx", "cy"],
    },
    Model {
        name: "SIMPLE_RADIAL",
        parameters: &["f", "cx", "cy", "k1"],
    },
    Model {
        name: "RADIAL",
        parameters: &["f", "cx", "cy", "k1", "k2"],
    },
    Model {
        name: "OPENCV",
        parameters: &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"],
    },
    Model {
        name: "FULL_OPENCV",
        parameters: &[
            "fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6",
        ],
    },
];

/// The parameters of a camera in COLMAP's terms; those that its model lacks are `None`.
#[derive(Clone, Copy, Debug, Default)]
struct Terms {
    f: Option<f64>,
    fx: Option<f64>,
    fy: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    k: [Option<f64>; 3],
    p: [Option<f64>; 2],
}

/// Reads a camera: number, model, width, height, parameters. Every parameter that the model has is free.
pub(super) fn read_camera(row: &Row<'_>) -> Result<PlainCamera, ImportError> {
    row.at_least(&["camera", "model", "width", "height"])?;
    let model = row.text(1, "model")?;
    let Some(model) = MODELS.iter().find(|known| known.name == model) else {
        let names = MODELS.map(|model| model.name).join(", ");
        return Err(row.wrong(1, "model", format!("one of {names}")));
    };
    let sides = [row.side(2, "width")?, row.side(3, "height")?];
    if row.fields.len() != 4 + model.parameters.len() {
        let found = format!("{} parameters of {}", row.fields.len() - 4, model.name);
        let expected = format!(
            "{} ({})",
            model.parameters.len(),
            model.parameters.join(", ")
        );
        return Err(row.unexpected(found, expected));
    }
    let mut terms = Terms::default();
    for (index, &name) in model.parameters.iter().enumerate() {
        let index = index + 4;
        let value = row.number(index, name)?;
        if name.starts_with('f') && value <= 0.0 {
            return Err(row.wrong(index, name, "a number greater than 0"));
        }
        match terms.place(name) {
            Some(place) => *place = Some(value),
            None if value == 0.0 => {}
            None => {
                let expected = "0: a distortion without denominator";
                return Err(row.wrong(index, name, expected));
            }
        }
    }
    Ok(terms.camera(row.text(0, "camera")?, sides))
}

impl Terms {
    /// Where a parameter goes; `None` for the denominators.
    fn place(&mut self, name: &str) -> Option<&mut Option<f64>> {
        Some(match name {
            "f" => &mut self.f,
            "fx" => &mut self.fx,
            "fy" => &mut self.fy,
            "cx" => &mut self.cx,
            "cy" => &mut self.cy,
            "k1" => &mut self.k[0],
            "k2" => &mut self.k[1],
            "k3" => &mut self.k[2],
            "p1" => &mut self.p[0],
            "p2" => &mut self.p[1],
            _ => return None,
        })
    }

    fn camera(&self, name: &str, [width_px, height_px]: [u32; 2]) -> PlainCamera {
        let pitch = COLMAP_PITCH_MM;
        let fy = self.f.or(self.fy).unwrap_or(1.0);
        let fx = self.fx.unwrap_or(fy);
        let c = fy * pitch;
        let c2 = c * c;
        let zero = |value: Option<f64>| value.unwrap_or(0.0);
        let free = |there: bool| match there {
            true => PlainParameter::Free,
            false => PlainParameter::Fixed,
        };
        PlainCamera {
            name: name.to_owned(),
            width_px,
            height_px,
            pixel_pitch_mm: pitch,
            lens: LensDirection::DisplacingAffinityLast,
            values: [
                c,
                (zero(self.cx) - f64::from(width_px) / 2.0) * pitch,
                (f64::from(height_px) / 2.0 - zero(self.cy)) * pitch,
                zero(self.k[0]) / c2,
                zero(self.k[1]) / (c2 * c2),
                zero(self.k[2]) / (c2 * c2 * c2),
                zero(self.p[1]) / c,
                -zero(self.p[0]) / c,
                fx / fy - 1.0,
                0.0,
            ],
            parameters: [
                free(true),
                free(true),
                free(true),
                free(self.k[0].is_some()),
                free(self.k[1].is_some()),
                free(self.k[2].is_some()),
                free(self.p[1].is_some()),
                free(self.p[0].is_some()),
                free(self.fx.is_some()),
                free(false),
            ],
            sharing: [Sharing::Camera; 10],
        }
    }
}

/// What COLMAP's models leave out of a camera with an affinity, px, at the corner where it is largest.
fn misfit_px(camera: &PlainCamera) -> f64 {
    let [_, x0, y0, k1, k2, k3, p1, p2, b1, b2] = camera.values;
    let half = [camera.width_px, camera.height_px]
        .map(|side| f64::from(side) / 2.0 * camera.pixel_pitch_mm);
    let mut largest = 0.0_f64;
    for (sx, sy) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
        let (x, y) = (sx * half[0] - x0, sy * half[1] - y0);
        let r2 = x * x + y * y;
        let radial = r2 * (k1 + r2 * (k2 + r2 * k3));
        let distortion = x * radial + p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y;
        let by_b1 = match camera.lens {
            LensDirection::DisplacingAffinityLast => 0.0,
            _ => b1 * distortion,
        };
        largest = largest.max(by_b1.abs() + (b2 * y).abs());
    }
    largest / camera.pixel_pitch_mm
}

/// The model, size and parameters of a camera as a line of `cameras.txt` has them after the number.
///
/// The balance of the radial distortion goes into the focal length: `px (1 - g) + px (K1 r2 + ...)` with
/// `g = K1 R0^2 + K2 R0^4 + K3 R0^6`.
///
/// # Errors
/// [`NetworkFault`] where no model of COLMAP has this lens: a correcting one with distortion, a shear, an affinity
/// together with distortion beyond a thousandth of a pixel.
pub(super) fn camera_line(camera: &PlainCamera) -> Result<String, NetworkFault> {
    let about = format!("camera {}", quote(&camera.name));
    let [c, x0, y0, k1, k2, k3, p1, p2, b1, b2] = camera.values;
    let distorts = [k1, k2, k3, p1, p2].iter().any(|value| *value != 0.0);
    let r0 = match camera.lens {
        LensDirection::Displacing { balanced_radius_mm } => balanced_radius_mm,
        LensDirection::DisplacingAffinityLast => 0.0,
        LensDirection::Correcting | LensDirection::CorrectingAffinityFirst
            if distorts || b1 != 0.0 || b2 != 0.0 =>
        {
            let found = "a distortion that corrects the measured point";
            let expected = "one that displaces the ideal point, or none";
            return Err(NetworkFault::new(about, found, expected));
        }
        LensDirection::Correcting | LensDirection::CorrectingAffinityFirst => 0.0,
    };
    let misfit = misfit_px(camera);
    if misfit > LARGEST_MISFIT_WRITTEN_PX {
        let found = format!("B1 and B2 that COLMAP lacks, {misfit:.3} px at a corner");
        let expected = format!("less than {LARGEST_MISFIT_WRITTEN_PX} px");
        return Err(NetworkFault::new(about, found, expected));
    }
    let r02 = r0 * r0;
    let scale = 1.0 - r02 * (k1 + r02 * (k2 + r02 * k3));
    let pitch = camera.pixel_pitch_mm;
    let fx = c * (scale + b1) / pitch;
    let fy = c * scale / pitch;
    let cx = x0 / pitch + f64::from(camera.width_px) / 2.0;
    let cy = f64::from(camera.height_px) / 2.0 - y0 / pitch;
    let c2 = c * c;
    let mut parameters = vec![fx, fy, cx, cy];
    let mut name = "PINHOLE";
    if distorts {
        name = "OPENCV";
        let radial = [k1 * c2 / scale, k2 * c2 * c2 / scale];
        parameters.extend(radial);
        parameters.extend([-p2 * c / scale, p1 * c / scale]);
    }
    if k3 != 0.0 {
        name = "FULL_OPENCV";
        parameters.extend([k3 * c2 * c2 * c2 / scale, 0.0, 0.0, 0.0]);
    }
    let parameters: Vec<String> = parameters.iter().map(f64::to_string).collect();
    Ok(format!(
        "{name} {} {} {}",
        camera.width_px,
        camera.height_px,
        parameters.join(" ")
    ))
}
