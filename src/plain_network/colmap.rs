//! COLMAP text models (Schönberger and Frahm, 2016): `cameras.txt`, `images.txt`, `points3D.txt`.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

pub use super::colmap_lens::COLMAP_PITCH_MM;
use super::colmap_lens::read_camera;
use super::rows::is_comment;
use super::{
    DatumPoints, ImportError, ImportPlace, NamedText, PlainDatum, PlainImage, PlainNetwork,
    PlainObservation, PlainPoint,
};
use crate::adjustment::ResidualPlane;
use crate::geometry::Pose;

/// Sigma of every image coordinate, px: COLMAP weights all keypoints alike and gives them no sigma.
pub const COLMAP_SIGMA_PX: f64 = 1.0;

/// The texts of a model.
#[derive(Clone, Copy, Debug)]
pub struct ColmapTexts<'a> {
    /// `cameras.txt`.
    pub cameras: NamedText<'a>,
    /// `images.txt`.
    pub images: NamedText<'a>,
    /// `points3D.txt`.
    pub points: NamedText<'a>,
}

/// Off from 1 at which a quaternion counts as damaged: COLMAP prints 17 digits, older scripts six.
const NORM_TOLERANCE: f64 = 1e-3;

/// Half a turn about x: our camera looks along -z with y up, COLMAP's along z with y down.
pub(super) fn ours_from_colmap() -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0))
}

/// Reads a text model.
///
/// Cameras and points are named by their numbers, images by their names. Keypoints without a point are passed over, and
/// so are colours, errors, tracks (the images hold the same observations), rigs and frames. The unit of the object is
/// arbitrary, as the model's is, the pitch [`COLMAP_PITCH_MM`]; the datum is inner constraints on all points.
/// Refused are lens models other than `SIMPLE_PINHOLE`, `PINHOLE`, `SIMPLE_RADIAL`, `RADIAL`, `OPENCV` and
/// `FULL_OPENCV` without denominator, fx and fy too different to share a distortion, and two keypoints of one point in an image.
///
/// # Errors
/// [`ImportError`], one line.
pub fn from_colmap(texts: ColmapTexts<'_>) -> Result<PlainNetwork, ImportError> {
    let mut cameras = Vec::new();
    for row in texts.cameras.words() {
        cameras.push(read_camera(&row)?);
    }
    let camera_of = cameras.iter().enumerate();
    let camera_of: BTreeMap<&str, usize> = camera_of.map(|(k, c)| (c.name.as_str(), k)).collect();
    let mut points = Vec::new();
    for row in texts.points.words() {
        row.at_least(&["point", "X", "Y", "Z"])?;
        let at = row.numbers(1, ["X", "Y", "Z"])?;
        points.push(PlainPoint::new(row.text(0, "point")?, Some(at)));
    }
    let point_of = points.iter().enumerate();
    let point_of: BTreeMap<&str, usize> = point_of.map(|(k, p)| (p.name.as_str(), k)).collect();
    let (images, observations) = read_images(texts.images, &camera_of, &point_of)?;
    let network = PlainNetwork {
        cameras,
        images,
        points,
        observations,
        distances: Vec::new(),
        datum: PlainDatum::InnerConstraints(DatumPoints::All),
        residuals: ResidualPlane::Measured,
        object: None,
    };
    match network.check() {
        Ok(()) => Ok(network),
        Err(fault) => Err(match fault.kind() {
            "camera" => texts.cameras.fault(fault),
            "point" => texts.points.fault(fault),
            _ => texts.images.fault(fault),
        }),
    }
}

/// Two lines an image, of which the second may be blank: number, quaternion, translation, camera, name / keypoints.
fn read_images(
    source: NamedText<'_>,
    cameras: &BTreeMap<&str, usize>,
    points: &BTreeMap<&str, usize>,
) -> Result<(Vec<PlainImage>, Vec<PlainObservation>), ImportError> {
    let mut images = Vec::new();
    let mut observations = Vec::new();
    let mut lines = source.all_lines().filter(|(_, line)| !is_comment(line));
    while let Some((line, content)) = lines.next() {
        if content.trim().is_empty() {
            continue;
        }
        images.push(read_image(source, line, content, cameras)?);
        let Some((line, content)) = lines.next() else {
            let found = "the end of the text";
            return Err(source.unexpected(ImportPlace::Line(line), found, "a line of keypoints"));
        };
        read_keypoints(
            source,
            (line, content),
            images.len() - 1,
            points,
            &mut observations,
        )?;
    }
    Ok((images, observations))
}

fn read_image(
    source: NamedText<'_>,
    line: usize,
    content: &str,
    cameras: &BTreeMap<&str, usize>,
) -> Result<PlainImage, ImportError> {
    let row = source.words_of(line, content);
    row.at_least(&[
        "image", "qw", "qx", "qy", "qz", "tx", "ty", "tz", "camera", "name",
    ])?;
    let [qw, qx, qy, qz] = row.numbers(1, ["qw", "qx", "qy", "qz"])?;
    let quaternion = Quaternion::new(qw, qx, qy, qz);
    if (quaternion.norm() - 1.0).abs() > NORM_TOLERANCE {
        let found = format!("a quaternion of length {:.4}", quaternion.norm());
        return Err(row.unexpected(found, "1"));
    }
    let rotation = UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix();
    let translation = Vector3::from(row.numbers(5, ["tx", "ty", "tz"])?);
    let camera = cameras.get(row.text(8, "camera")?).copied();
    Ok(PlainImage {
        // A name may hold blanks.
        name: row.fields[9..].join(" "),
        camera: camera.ok_or_else(|| row.wrong(8, "camera", "a camera of cameras.txt"))?,
        start: Some(Pose {
            camera_from_world: Rotation3::from_matrix_unchecked(
                ours_from_colmap() * rotation.matrix(),
            ),
            centre_in_world: -(rotation.inverse() * translation),
        }),
    })
}

fn read_keypoints(
    source: NamedText<'_>,
    (line, content): (usize, &str),
    image: usize,
    points: &BTreeMap<&str, usize>,
    observations: &mut Vec<PlainObservation>,
) -> Result<(), ImportError> {
    let row = source.words_of(line, content);
    if !row.fields.len().is_multiple_of(3) {
        let found = format!("{} fields", row.fields.len());
        return Err(row.unexpected(found, "three a keypoint (x, y, point)"));
    }
    for first in (0..row.fields.len()).step_by(3) {
        let name = row.text(first + 2, "point")?;
        // -1, which older versions print as the largest number of 64 bits.
        if name == "-1" || name == "18446744073709551615" {
            continue;
        }
        let Some(&point) = points.get(name) else {
            return Err(row.wrong(first + 2, "point", "a point of points3D.txt or -1"));
        };
        let [x_px, y_px] = row.numbers(first, ["x", "y"])?;
        observations.push(PlainObservation {
            image,
            point,
            x_px,
            y_px,
            sigma_px: COLMAP_SIGMA_PX,
        });
    }
    Ok(())
}

#[cfg(test)]
#[path = "colmap_tests.rs"]
mod tests;
