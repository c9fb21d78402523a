//! `camera.toml`: the size of the image, the sensor, and what is known of the lens.

use std::path::Path;

use super::error::{read_with, without_mark};
use super::keys::{Document, Keys};
use super::{CameraFile, FileError};
use crate::camera::LensDirection;
use crate::report::direction_name;

const KEYS: [&str; 16] = [
    "name",
    "width_px",
    "height_px",
    "pixel_pitch_mm",
    "principal_distance_mm",
    "principal_point_mm",
    "radial",
    "tangential",
    "affinity",
    "lens",
    "balanced_radius_mm",
    "sigma_principal_distance_mm",
    "sigma_principal_point_mm",
    "sigma_radial",
    "sigma_tangential",
    "sigma_affinity",
];

/// Largest side of an image, pixels; larger ones do not fit into memory.
const LARGEST_SIDE_PX: u32 = 100_000;
/// Pixel pitches from a tenth of a micrometre to a millimetre; a pitch given in micrometres lies above.
const PITCH_MM: std::ops::RangeInclusive<f64> = 1e-4..=1.0;
/// Principal distances from endoscopes to the longest telephoto lenses, mm; one given in metres lies below.
const PRINCIPAL_DISTANCE_MM: std::ops::RangeInclusive<f64> = 0.1..=10_000.0;
/// Range of the radial correction at the image corner, as a share of the corner's distance from the centre: at -1 the
/// corner lands on the centre; even a fisheye lens of 150 degrees stays below 3.
const RADIAL_SHARE: std::ops::RangeInclusive<f64> = -0.95..=3.0;
/// Largest decentring correction at the image corner, as a share of its distance; real lenses stay below 0.01.
const TANGENTIAL_SHARE: f64 = 0.5;
/// Largest affinity and shear; real sensors stay below 0.01.
const LARGEST_AFFINITY: f64 = 0.5;
/// Radii of balance, mm: from none to the corner of the largest sensors.
const BALANCED_RADIUS_MM: std::ops::RangeInclusive<f64> = 0.0..=1000.0;
/// Half a diagonal that stands for the smallest sensors where the pitch is not given, mm.
const SMALLEST_RADIUS_MM: f64 = 1.0;

/// Reads a camera file: one camera, or several in tables `[[camera]]`.
///
/// # Errors
/// [`FileError`], one line.
pub fn read_cameras(path: &Path) -> Result<Vec<CameraFile>, FileError> {
    read_with(path, parse_cameras)
}

/// The cameras of a camera file's text; `file` is its name in messages.
///
/// # Errors
/// [`FileError`], one line.
pub fn parse_cameras(file: &str, text: &str) -> Result<Vec<CameraFile>, FileError> {
    let text = without_mark(text);
    let document = Document { file, text };
    let table = document.parse()?;
    let keys = document.keys(&table);
    match keys.get("camera") {
        None => Ok(vec![camera(keys)?]),
        Some(cameras) => {
            keys.refuse_others(&["camera"])?;
            cameras.tables()?.into_iter().map(camera).collect()
        }
    }
}

fn camera(keys: Keys<'_>) -> Result<CameraFile, FileError> {
    keys.refuse_others(&KEYS)?;
    let side = 1..=LARGEST_SIDE_PX;
    let mut camera = CameraFile {
        name: keys.required("name")?.text()?.to_owned(),
        width_px: keys.required("width_px")?.count(side.clone())?,
        height_px: keys.required("height_px")?.count(side)?,
        pixel_pitch_mm: None,
        principal_distance_mm: None,
        principal_point: [0.0; 2],
        radial: [0.0; 3],
        tangential: [0.0; 2],
        affinity: [0.0; 2],
        direction: direction(keys)?,
        known_sigmas: [None; 10],
    };
    if let Some(value) = keys.get("pixel_pitch_mm") {
        camera.pixel_pitch_mm = Some(value.within(PITCH_MM, "mm")?);
    }
    if let Some(value) = keys.get("principal_distance_mm") {
        camera.principal_distance_mm = Some(value.within(PRINCIPAL_DISTANCE_MM, "mm")?);
    }
    read_lens(keys, &mut camera)?;
    read_sigmas(keys, &mut camera)?;
    Ok(camera)
}

/// What the distortion is a function of; ours where nothing is said.
fn direction(keys: Keys<'_>) -> Result<LensDirection, FileError> {
    let balanced = keys.get("balanced_radius_mm");
    let displacing = LensDirection::Displacing {
        balanced_radius_mm: match balanced {
            Some(radius) => radius.within(BALANCED_RADIUS_MM, "mm")?,
            None => 0.0,
        },
    };
    let known = [
        LensDirection::Correcting,
        LensDirection::CorrectingAffinityFirst,
        displacing,
        LensDirection::DisplacingAffinityLast,
    ];
    let found = match keys.get("lens") {
        None => LensDirection::Correcting,
        Some(lens) => {
            let text = lens.text()?;
            let named = known
                .iter()
                .find(|direction| direction_name(**direction) == text);
            let names = known.map(direction_name).join(", ");
            *named.ok_or_else(|| lens.expected(format!("one of {names}")))?
        }
    };
    match balanced {
        Some(radius) if found != displacing => {
            Err(radius.unexpected("balanced_radius_mm", "it with lens = \"displacing\" alone"))
        }
        _ => Ok(found),
    }
}

fn read_lens(keys: Keys<'_>, camera: &mut CameraFile) -> Result<(), FileError> {
    let pitch = camera.pixel_pitch_mm;
    let half = [camera.width_px, camera.height_px].map(|side| f64::from(side) / 2.0);
    let radius = pitch.map_or(SMALLEST_RADIUS_MM, |p| p * half[0].hypot(half[1]));
    if let Some(value) = keys.get("principal_point_mm") {
        camera.principal_point = value.numbers()?;
        if let Some(pitch) = pitch {
            let limits = half.map(|h| h * pitch);
            let inside = |axis: usize| camera.principal_point[axis].abs() < limits[axis];
            if !(inside(0) && inside(1)) {
                return Err(value.expected(format!(
                    "[x0, y0] in mm from the image centre, inside the image (+-{:.3}, +-{:.3})",
                    limits[0], limits[1]
                )));
            }
        }
    }
    if let Some(value) = keys.get("radial") {
        camera.radial = value.numbers()?;
        let r2 = radius * radius;
        let [k1, k2, k3] = camera.radial;
        let share = r2 * (k1 + r2 * (k2 + r2 * k3));
        if !RADIAL_SHARE.contains(&share) {
            return Err(value.expected(format!(
                "K1 mm^-2, K2 mm^-4, K3 mm^-6 of a lens (these correct a point {radius:.1} mm from the centre by {share:.1} times that)"
            )));
        }
    }
    if let Some(value) = keys.get("tangential") {
        camera.tangential = value.numbers()?;
        let most = TANGENTIAL_SHARE / radius;
        if camera.tangential.iter().any(|p| p.abs() > most) {
            return Err(value.expected(format!("P1, P2 of a lens in mm^-1, at most {most:.3}")));
        }
    }
    if let Some(value) = keys.get("affinity") {
        camera.affinity = value.numbers()?;
        if camera.affinity.iter().any(|b| b.abs() > LARGEST_AFFINITY) {
            return Err(value.expected(format!("B1, B2 of a sensor, at most {LARGEST_AFFINITY}")));
        }
    }
    Ok(())
}

fn read_sigmas(keys: Keys<'_>, camera: &mut CameraFile) -> Result<(), FileError> {
    let sigmas = &mut camera.known_sigmas;
    for (key, sigma_key) in [
        ("principal_distance_mm", "sigma_principal_distance_mm"),
        ("principal_point_mm", "sigma_principal_point_mm"),
        ("radial", "sigma_radial"),
        ("tangential", "sigma_tangential"),
        ("affinity", "sigma_affinity"),
    ] {
        let Some(value) = keys.get(sigma_key) else {
            continue;
        };
        if keys.get(key).is_none() {
            return Err(value.unexpected(
                format!("{sigma_key} without {key}"),
                "the known value with its sigma",
            ));
        }
        match key {
            "principal_distance_mm" => sigmas[0] = value.sigma()?,
            "principal_point_mm" => sigmas[1..3].copy_from_slice(&value.sigmas::<2>()?),
            "radial" => sigmas[3..6].copy_from_slice(&value.sigmas::<3>()?),
            "tangential" => sigmas[6..8].copy_from_slice(&value.sigmas::<2>()?),
            _ => sigmas[8..10].copy_from_slice(&value.sigmas::<2>()?),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::cameras_toml;

    const HEAD: &str = "name = 'a'\nwidth_px = 3000\nheight_px = 2000\n";

    #[test]
    fn a_camera_is_read_as_it_is_written() {
        let full = CameraFile {
            name: "D1x \"left\", 20 mm".into(),
            width_px: 3008,
            height_px: 1960,
            pixel_pitch_mm: Some(0.00787),
            principal_distance_mm: Some(20.0),
            principal_point: [0.1, -0.05],
            radial: [1.5e-4, -4e-7, 2e-10],
            tangential: [1e-5, -2e-5],
            affinity: [1e-4, -5e-5],
            direction: LensDirection::Displacing {
                balanced_radius_mm: 13.488,
            },
            known_sigmas: std::array::from_fn(|i| (i != 5).then_some(1e-3 / (i + 1) as f64)),
        };
        let bare = CameraFile {
            pixel_pitch_mm: None,
            principal_distance_mm: None,
            direction: Default::default(),
            known_sigmas: [None; 10],
            ..full.clone()
        };
        for cameras in [vec![full.clone()], vec![bare.clone()], vec![full, bare]] {
            let text = cameras_toml(&cameras);
            assert_eq!(parse_cameras("c.toml", &text), Ok(cameras), "{text}");
        }
    }

    #[test]
    fn the_least_camera_has_no_lens() {
        let text = format!("\u{feff}{}", HEAD.replace('\n', "\r\n\r\n"));
        let cameras = parse_cameras("c.toml", &text).unwrap();
        assert_eq!(cameras.len(), 1);
        assert_eq!(cameras[0].width_px, 3000);
        assert_eq!(cameras[0].principal_distance_mm, None);
        assert_eq!(cameras[0].interior().radial, [0.0; 3]);
    }

    #[test]
    fn whole_numbers_and_infinite_sigmas_are_numbers() {
        let text = format!(
            "{HEAD}pixel_pitch_mm = 1\nprincipal_distance_mm = 20\nsigma_principal_distance_mm = inf\n"
        );
        let camera = &parse_cameras("c.toml", &text).unwrap()[0];
        assert_eq!(camera.principal_distance_mm, Some(20.0));
        assert_eq!(camera.known_sigmas[0], None);
    }

    #[test]
    fn bad_files_are_answered_in_one_line() {
        let keys = "name, width_px, height_px, pixel_pitch_mm, principal_distance_mm, principal_point_mm, radial, tangential, affinity, \
             lens, balanced_radius_mm, sigma_principal_distance_mm, sigma_principal_point_mm, sigma_radial, sigma_tangential, sigma_affinity";
        let unknown =
            format!("c.toml, line 4, column 1: found the key 'pitch_mm', expected one of {keys}");
        for (text, line) in [
            ("", "c.toml: found no key name, expected it"),
            (
                "name = 'a'\nwidth_px = 10\n",
                "c.toml: found no key height_px, expected it",
            ),
            (
                "[[camera]]\nname = 'a'\n",
                "c.toml, line 1, column 1: found no key width_px, expected it",
            ),
            (
                "name = 3",
                "c.toml, line 1, column 8: found 'name = 3', expected a text in quotation marks",
            ),
            (
                "name = 'a'\nwidth_px = 0",
                "c.toml, line 2, column 12: found 'width_px = 0', expected a whole number from 1 to 100000",
            ),
            (
                "name = 'a'\nwidth_px = 10.5",
                "c.toml, line 2, column 12: found 'width_px = 10.5', expected a whole number from 1 to 100000",
            ),
            (
                "name = 'a'\nwidth_px = -10",
                "c.toml, line 2, column 12: found 'width_px = -10', expected a whole number from 1 to 100000",
            ),
            ("@pitch_mm = 0.01", &unknown),
            (
                "@lens = 'wide'",
                "c.toml, line 4, column 8: found 'lens = 'wide'', expected one of correcting, correcting_affinity_first, displacing, displacing_affinity_last",
            ),
            (
                "@balanced_radius_mm = 8",
                "c.toml, line 4, column 22: found balanced_radius_mm, expected it with lens = \"displacing\" alone",
            ),
            (
                "@pixel_pitch_mm = 5.5",
                "c.toml, line 4, column 18: found 'pixel_pitch_mm = 5.5', expected a number from 0.0001 to 1 (mm)",
            ),
            (
                "@pixel_pitch_mm = -0.01",
                "c.toml, line 4, column 18: found 'pixel_pitch_mm = -0.01', expected a number from 0.0001 to 1 (mm)",
            ),
            (
                "@pixel_pitch_mm = nan",
                "c.toml, line 4, column 18: found 'pixel_pitch_mm = nan', expected a number from 0.0001 to 1 (mm)",
            ),
            (
                "@pixel_pitch_mm = '0.01'",
                "c.toml, line 4, column 18: found 'pixel_pitch_mm = '0.01'', expected a number from 0.0001 to 1 (mm)",
            ),
            (
                "@principal_distance_mm = 0",
                "c.toml, line 4, column 25: found 'principal_distance_mm = 0', expected a number from 0.1 to 10000 (mm)",
            ),
            (
                "@pixel_pitch_mm = 0.01\nprincipal_point_mm = [20, 0]",
                "c.toml, line 5, column 22: found 'principal_point_mm = [20, 0]', expected [x0, y0] in mm from the image centre, inside the image (+-15.000, +-10.000)",
            ),
            (
                "@radial = [0, 0]",
                "c.toml, line 4, column 10: found 'radial = [0, 0]', expected 3 numbers in brackets",
            ),
            (
                "@radial = [0, 0, inf]",
                "c.toml, line 4, column 10: found 'radial = [0, 0, inf]', expected 3 numbers in brackets",
            ),
            (
                "@pixel_pitch_mm = 0.01\nradial = [-0.1, 0, 0]",
                "c.toml, line 5, column 10: found 'radial = [-0.1, 0, 0]', expected K1 mm^-2, K2 mm^-4, K3 mm^-6 of a lens (these correct a point 18.0 mm from the centre by -32.5 times that)",
            ),
            (
                "@tangential = [2, 0]",
                "c.toml, line 4, column 14: found 'tangential = [2, 0]', expected P1, P2 of a lens in mm^-1, at most 0.500",
            ),
            (
                "@affinity = [1, 0]",
                "c.toml, line 4, column 12: found 'affinity = [1, 0]', expected B1, B2 of a sensor, at most 0.5",
            ),
            (
                "@sigma_radial = [1, 1, 1]",
                "c.toml, line 4, column 16: found sigma_radial without radial, expected the known value with its sigma",
            ),
            (
                "@affinity = [0, 0]\nsigma_affinity = [0, 1]",
                "c.toml, line 5, column 18: found 'sigma_affinity = [0, 1]', expected 2 numbers greater than 0 in brackets",
            ),
            (
                "@principal_distance_mm = 20\nsigma_principal_distance_mm = -1",
                "c.toml, line 5, column 31: found 'sigma_principal_distance_mm = -1', expected a number greater than 0",
            ),
        ] {
            let text = text.replace('@', HEAD);
            let error = parse_cameras("c.toml", &text).unwrap_err();
            assert_eq!(error.to_string(), line, "{text}");
        }
    }

    #[test]
    fn what_is_not_toml_is_placed() {
        for text in [
            "name = ",
            "name 'a'",
            "name = 'a'\nname = 'b'",
            "label,x_mm\n",
        ] {
            let line = parse_cameras("c.toml", text).unwrap_err().to_string();
            assert!(
                line.starts_with("c.toml, line ") && line.contains("expected TOML ("),
                "{line}"
            );
            assert_eq!(line.lines().count(), 1);
        }
    }
}
