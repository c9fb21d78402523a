//! DBAT (Damped Bundle Adjustment Toolbox; Börlin and Grussenmeyer, 2013): marked points, control points, a camera.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::dbat_camera::read_camera;
use super::rows::{Row, is_comment};
use super::{
    DatumPoints, ImportError, Known, NamedText, PlainDatum, PlainImage, PlainNetwork,
    PlainObservation, PlainPoint, PointRole,
};
use crate::adjustment::ResidualPlane;
use crate::geometry::{OmegaPhiKappa, Pose};

/// Sigma of an image coordinate where the file gives none, px.
pub const DBAT_SIGMA_PX: f64 = 1.0;

/// The texts of a project.
#[derive(Clone, Copy, Debug)]
pub struct DbatTexts<'a> {
    /// Marked points: image, point, x, y in pixels, and a sigma where it is known.
    pub marks: NamedText<'a>,
    /// The camera in XML.
    pub camera: NamedText<'a>,
    /// Control points: point, label, X, Y, Z, and none, one or three sigmas.
    pub control: Option<NamedText<'a>>,
    /// Names of the images: image, path.
    pub images: Option<NamedText<'a>>,
    /// A listing of orientations: number, image, X, Y, Z, omega, phi, kappa, ..., label.
    pub stations: Option<NamedText<'a>>,
}

/// Reads a project with one camera.
///
/// The lens corrects, residuals are formed in the corrected plane. A control point without sigma, or with sigma 0, is
/// fixed. Images and points are named by their numbers; images by the file where `images` or the label of a station
/// names it. Without stations images have no start, and new points have none in any case. The object is in the unit of
/// the control points, whatever that is. The datum is the control points, or inner constraints where there are none.
///
/// # Errors
/// [`ImportError`], one line.
pub fn from_dbat(texts: DbatTexts<'_>) -> Result<PlainNetwork, ImportError> {
    let camera = read_camera(texts.camera)?;
    let mut points = match texts.control {
        Some(control) => read_control(control)?,
        None => Vec::new(),
    };
    let datum = match points.is_empty() {
        true => PlainDatum::InnerConstraints(DatumPoints::All),
        false => PlainDatum::Control,
    };
    let marks = read_marks(texts.marks)?;
    let (numbers, observations) = gather(&marks, &mut points);
    let stations = texts.stations.map_or(Ok(BTreeMap::new()), read_stations)?;
    let files = texts.images.map_or(Ok(BTreeMap::new()), read_files)?;
    let images = numbers
        .into_iter()
        .map(|number| {
            let station = stations.get(number);
            let file = files.get(number).copied();
            let label = station.and_then(|station| station.label);
            PlainImage {
                name: file.or(label).unwrap_or(number).to_owned(),
                camera: 0,
                start: station.map(|station| station.pose),
            }
        })
        .collect();
    let network = PlainNetwork {
        cameras: vec![camera],
        images,
        points,
        observations,
        distances: Vec::new(),
        datum,
        residuals: ResidualPlane::Corrected,
        object: None,
    };
    match network.check() {
        Ok(()) => Ok(network),
        Err(fault) => Err(match (fault.kind(), texts.control) {
            ("camera", _) => texts.camera.fault(fault),
            ("point", Some(control)) => control.fault(fault),
            _ => texts.marks.fault(fault),
        }),
    }
}

/// Numbers of the images in the order of their first marks, and the observations; points seen for the first time are
/// added to those that are known.
fn gather<'a>(
    marks: &[Mark<'a>],
    points: &mut Vec<PlainPoint>,
) -> (Vec<&'a str>, Vec<PlainObservation>) {
    let mut numbers = Vec::new();
    let mut image_of = BTreeMap::new();
    let names = points.iter().map(|point| point.name.clone());
    let mut point_of: BTreeMap<String, usize> = names.zip(0..).collect();
    let mut observations = Vec::with_capacity(marks.len());
    for mark in marks {
        let image = *image_of.entry(mark.image).or_insert_with(|| {
            numbers.push(mark.image);
            numbers.len() - 1
        });
        let point = *point_of.entry(mark.point.to_owned()).or_insert_with(|| {
            points.push(PlainPoint::new(mark.point, None));
            points.len() - 1
        });
        observations.push(PlainObservation {
            image,
            point,
            x_px: mark.at_px[0],
            y_px: mark.at_px[1],
            sigma_px: mark.sigma_px,
        });
    }
    (numbers, observations)
}

struct Mark<'a> {
    image: &'a str,
    point: &'a str,
    at_px: [f64; 2],
    sigma_px: f64,
}

/// Image, point, x, y, and nothing, sxy, or sx and sy if they are equal.
fn read_marks(source: NamedText<'_>) -> Result<Vec<Mark<'_>>, ImportError> {
    fn read<'a>(row: &Row<'a>) -> Result<Mark<'a>, ImportError> {
        row.at_least(&["image", "point", "x", "y"])?;
        let sigma_px = match row.fields.len() {
            4 => DBAT_SIGMA_PX,
            _ => row.positive(4, "sxy")?,
        };
        if row.fields.len() > 5 && row.positive(5, "sy")? != sigma_px {
            return Err(row.wrong(5, "sy", "the same sigma as in x"));
        }
        Ok(Mark {
            image: row.text(0, "image")?,
            point: row.text(1, "point")?,
            at_px: row.numbers(2, ["x", "y"])?,
            sigma_px,
        })
    }
    source.commas().map(|row| read(&row)).collect()
}

/// Point, label, X, Y, Z, and nothing, sxyz, sxy and sz, or sx, sy and sz.
fn read_control(source: NamedText<'_>) -> Result<Vec<PlainPoint>, ImportError> {
    let read = |row: Row<'_>| {
        row.at_least(&["point", "label", "X", "Y", "Z"])?;
        let at = row.numbers(2, ["X", "Y", "Z"])?;
        let sigmas = match row.fields.len() {
            5 => [None; 3],
            6 => [sigma(&row, 5, "sxyz")?; 3],
            7 => {
                let plane = sigma(&row, 5, "sxy")?;
                [plane, plane, sigma(&row, 6, "sz")?]
            }
            _ => [
                sigma(&row, 5, "sx")?,
                sigma(&row, 6, "sy")?,
                sigma(&row, 7, "sz")?,
            ],
        };
        let known = |axis: usize| {
            Some(Known {
                value_mm: at[axis],
                sigma_mm: sigmas[axis],
            })
        };
        Ok(PlainPoint {
            name: row.text(0, "point")?.to_owned(),
            start: Some(at),
            known: [0, 1, 2].map(known),
            correlations: [0.0; 3],
            role: PointRole::Control,
        })
    };
    source.commas().map(read).collect()
}

/// A sigma; `None` for 0, which fixes the coordinate.
fn sigma(row: &Row<'_>, index: usize, name: &'static str) -> Result<Option<f64>, ImportError> {
    let value = row.number(index, name)?;
    if value < 0.0 {
        return Err(row.wrong(index, name, "0 or more"));
    }
    Ok(Some(value).filter(|value| *value > 0.0))
}

/// File names, without folders, by image number.
fn read_files(source: NamedText<'_>) -> Result<BTreeMap<&str, &str>, ImportError> {
    let mut files = BTreeMap::new();
    for row in source.commas() {
        let path = row.text(1, "path")?;
        let file = path.rsplit(['/', '\\']).next().unwrap_or(path);
        if files.insert(row.text(0, "image")?, file).is_some() {
            return Err(row.wrong(0, "image", "each image once"));
        }
    }
    Ok(files)
}

#[derive(Clone, Copy)]
struct Station<'a> {
    pose: Pose,
    label: Option<&'a str>,
}

/// Stations by image number.
///
/// The listings say "Unit: degrees" but DBAT 0.9.2 converts its columns of sigmas only: the angles stand in radians,
/// as its report of the same run shows. A listing with an angle beyond a full turn of radians is in degrees.
fn read_stations(source: NamedText<'_>) -> Result<BTreeMap<&str, Station<'_>>, ImportError> {
    let mut rows = Vec::new();
    for row in source.commas() {
        row.at_least(&["number", "image", "X", "Y", "Z", "omega", "phi", "kappa"])?;
        let angles = row.numbers(5, ["omega", "phi", "kappa"])?;
        rows.push((row, angles));
    }
    let full_turn = std::f64::consts::TAU;
    let in_degrees = rows
        .iter()
        .any(|(_, angles)| angles.iter().any(|a| a.abs() > full_turn));
    let mut stations = BTreeMap::new();
    for (row, angles) in rows {
        let [omega, phi, kappa] = match in_degrees {
            true => angles.map(f64::to_radians),
            false => angles,
        };
        let label = row.fields.last().copied();
        let is_number = |text: &str| text.is_empty() || text.parse::<f64>().is_ok();
        let station = Station {
            pose: Pose {
                camera_from_world: OmegaPhiKappa { omega, phi, kappa }.rotation(),
                centre_in_world: Vector3::from(row.numbers(2, ["X", "Y", "Z"])?),
            },
            label: label.filter(|text| !is_number(text) && !is_comment(text)),
        };
        let image = row.text(1, "image")?;
        if stations.insert(image, station).is_some() {
            return Err(row.wrong(1, "image", "each image once"));
        }
    }
    Ok(stations)
}

#[cfg(test)]
#[path = "dbat_tests.rs"]
mod tests;
