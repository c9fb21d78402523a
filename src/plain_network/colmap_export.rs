//! A network as a COLMAP text model.

use std::collections::BTreeSet;

use nalgebra::{Rotation3, UnitQuaternion};

use super::PlainNetwork;
use super::check::NetworkFault;
use super::colmap::ours_from_colmap;
use super::colmap_lens::camera_line;
use super::error::quote;
use crate::geometry::Pose;

/// The texts of a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ColmapFiles {
    /// `cameras.txt`.
    pub cameras: String,
    /// `images.txt`.
    pub images: String,
    /// `points3D.txt`.
    pub points: String,
}

/// The text model of a network, from its starts; where a network was adjusted, put the result there first.
///
/// Names of cameras and points that are numbers stay so, if all of a kind are; otherwise they are numbered from 1 in
/// their order. Sigmas, known coordinates, distances and the datum have no place in the model and are left out; points
/// are white and have no error (-1).
///
/// # Errors
/// [`NetworkFault`] where [`PlainNetwork::check`] finds one, where an image or point has no start, where the name of an
/// image holds a blank, and where no model of COLMAP has a camera's lens: a correcting one with distortion, an
/// affinity together with distortion, a shear.
pub fn to_colmap(network: &PlainNetwork) -> Result<ColmapFiles, NetworkFault> {
    network.check()?;
    let cameras = numbers(
        network.cameras.iter().map(|c| c.name.as_str()),
        u64::from(u32::MAX) - 1,
    );
    let points = numbers(network.points.iter().map(|p| p.name.as_str()), u64::MAX - 1);
    Ok(ColmapFiles {
        cameras: cameras_text(network, &cameras)?,
        images: images_text(network, &cameras, &points)?,
        points: points_text(network, &points)?,
    })
}

/// The names as numbers if all are different whole ones, else their order from 1.
fn numbers<'a>(names: impl Iterator<Item = &'a str> + Clone, most: u64) -> Vec<u64> {
    let read = |name: &str| name.parse().ok().filter(|number| *number <= most);
    let own: Option<Vec<u64>> = names.clone().map(read).collect();
    match own {
        Some(own) if own.iter().collect::<BTreeSet<_>>().len() == own.len() => own,
        _ => (1..).take(names.count()).collect(),
    }
}

fn cameras_text(network: &PlainNetwork, numbers: &[u64]) -> Result<String, NetworkFault> {
    let mut text = String::from(
        "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n",
    );
    text.push_str(&format!("# Number of cameras: {}\n", numbers.len()));
    for (camera, number) in network.cameras.iter().zip(numbers) {
        text.push_str(&format!("{number} {}\n", camera_line(camera)?));
    }
    Ok(text)
}

fn images_text(
    network: &PlainNetwork,
    cameras: &[u64],
    points: &[u64],
) -> Result<String, NetworkFault> {
    let mut keypoints = vec![Vec::new(); network.images.len()];
    for seen in &network.observations {
        let point = points[seen.point];
        keypoints[seen.image].push(format!("{} {} {point}", seen.x_px, seen.y_px));
    }
    let mut text = String::from(
        "# Image list with two lines of data per image:\n#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n#   POINTS2D[] as (X, Y, POINT3D_ID)\n",
    );
    text.push_str(&format!("# Number of images: {}\n", network.images.len()));
    for (index, image) in network.images.iter().enumerate() {
        let about = || format!("image {}", quote(&image.name));
        let Some(pose) = &image.start else {
            let expected = "where its camera stood";
            return Err(NetworkFault::new(about(), "no start", expected));
        };
        if image.name.contains(char::is_whitespace) {
            let expected = "a name without";
            return Err(NetworkFault::new(about(), "a blank in its name", expected));
        }
        let numbers = pose_numbers(pose).map(|number| number.to_string());
        text.push_str(&format!(
            "{} {} {} {}\n{}\n",
            index + 1,
            numbers.join(" "),
            cameras[image.camera],
            image.name,
            keypoints[index].join(" ")
        ));
    }
    Ok(text)
}

/// qw, qx, qy, qz, tx, ty, tz.
fn pose_numbers(pose: &Pose) -> [f64; 7] {
    let rotation =
        Rotation3::from_matrix_unchecked(ours_from_colmap() * pose.camera_from_world.matrix());
    let q = UnitQuaternion::from_rotation_matrix(&rotation);
    let t = -(rotation * pose.centre_in_world);
    [q.w, q.i, q.j, q.k, t.x, t.y, t.z]
}

fn points_text(network: &PlainNetwork, numbers: &[u64]) -> Result<String, NetworkFault> {
    let mut tracks = vec![String::new(); network.points.len()];
    let mut count = vec![0usize; network.images.len()];
    for seen in &network.observations {
        let keypoint = count[seen.image];
        count[seen.image] += 1;
        tracks[seen.point].push_str(&format!(" {} {keypoint}", seen.image + 1));
    }
    let mut text = String::from(
        "# 3D point list with one line of data per point:\n#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n",
    );
    text.push_str(&format!("# Number of points: {}\n", numbers.len()));
    for ((point, number), track) in network.points.iter().zip(numbers).zip(tracks) {
        let Some([x, y, z]) = point.start else {
            let about = format!("point {}", quote(&point.name));
            return Err(NetworkFault::new(about, "no start", "where it is"));
        };
        text.push_str(&format!("{number} {x} {y} {z} 255 255 255 -1{track}\n"));
    }
    Ok(text)
}
