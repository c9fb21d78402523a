//! How well two images are placed to begin a network, or a new one to join it.

use nalgebra::{Vector2, Vector3};

use crate::camera::Camera;
use crate::geometry::{Pose, Ray};

/// Cells per side of the raster on which the share of the image area is counted.
const RASTER: usize = 8;

/// What speaks for a pair of images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairQuality {
    /// Points measured in both.
    pub shared: usize,
    /// Share of the image area that they cover, the smaller of both images, 0..1.
    pub spread: f64,
    /// Median angle between the two rays of a point, radians in [0, pi/2]; `None` without poses or points.
    pub median_angle: Option<f64>,
    /// One number to rank by: larger is better, 0 for a useless pair.
    pub rank: f64,
}

/// The share of the image area that `pixels` cover: cells of an 8 x 8 raster with a point in them or all round between
/// points of their row and of their column.
#[must_use]
pub fn covered_share(camera: &Camera, pixels: &[Vector2<f64>]) -> f64 {
    let mut occupied = [[false; RASTER]; RASTER];
    for pixel in pixels.iter().filter(|p| camera.contains(p)) {
        let cell =
            |x: f64, size: u32| ((x / f64::from(size) * RASTER as f64) as usize).min(RASTER - 1);
        occupied[cell(pixel.y, camera.height_px)][cell(pixel.x, camera.width_px)] = true;
    }
    let between =
        |line: [bool; RASTER], k: usize| line[..=k].contains(&true) && line[k..].contains(&true);
    let mut covered = 0;
    for (row, line) in occupied.iter().enumerate() {
        for column in 0..RASTER {
            let upright = occupied.map(|cells| cells[column]);
            covered += usize::from(between(*line, column) && between(upright, row));
        }
    }
    covered as f64 / (RASTER * RASTER) as f64
}

/// The median angle under which two stations see points (mm), radians in [0, pi/2]; `None` without points.
#[must_use]
pub fn median_intersection_angle(
    first: &Vector3<f64>,
    second: &Vector3<f64>,
    points: &[Vector3<f64>],
) -> Option<f64> {
    let mut angles: Vec<f64> = points
        .iter()
        .map(|p| {
            let angle = Ray::new(*first, &(p - first)).angle(&Ray::new(*second, &(p - second)));
            angle.min(std::f64::consts::PI - angle)
        })
        .filter(|angle| angle.is_finite())
        .collect();
    angles.sort_by(f64::total_cmp);
    angles.get(angles.len() / 2).copied()
}

/// The quality of a pair of images from the points measured in both: `pixels` in the order of the points in either
/// image, the poses in the world of `points` (mm) where they are known already.
///
/// The rank is `n / (n + 6) * sqrt(spread) * sin(angle)`: six points more are worth little once there are some tens, the depth
/// error of an intersection goes with the inverse sine of its angle. Without poses the angle counts as 30 degrees.
#[must_use]
pub fn pair_quality(
    cameras: [&Camera; 2],
    pixels: [&[Vector2<f64>]; 2],
    poses: Option<[&Pose; 2]>,
    points: &[Vector3<f64>],
) -> PairQuality {
    let shared = pixels[0].len().min(pixels[1].len());
    let spread = covered_share(cameras[0], pixels[0]).min(covered_share(cameras[1], pixels[1]));
    let median_angle = poses.and_then(|[first, second]| {
        median_intersection_angle(&first.centre_in_world, &second.centre_in_world, points)
    });
    let strength = median_angle.unwrap_or(30_f64.to_radians()).sin();
    let many = shared as f64 / (shared as f64 + 6.0);
    PairQuality {
        shared,
        spread,
        median_angle,
        rank: many * spread.sqrt() * strength,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::simulation;

    #[test]
    fn a_wide_pair_with_spread_points_ranks_first() {
        let camera = simulation::camera();
        let points: Vec<Vector3<f64>> = [
            [-300.0, -200.0],
            [300.0, -200.0],
            [-300.0, 200.0],
            [300.0, 200.0],
            [0.0, 0.0],
            [100.0, -50.0],
        ]
        .map(|[x, y]| Vector3::new(x, y, 0.0))
        .to_vec();
        let pose = |x: f64| {
            Pose::looking_at(
                Vector3::new(x, 0.0, 1000.0),
                Vector3::zeros(),
                Vector3::y(),
                0.0,
            )
        };
        let quality = |base: f64, count: usize| {
            let poses = [pose(0.0), pose(base)];
            let pixels = poses.map(|p| {
                points[..count]
                    .iter()
                    .filter_map(|x| camera.project(&p.camera_from_point(x)))
                    .collect::<Vec<_>>()
            });
            pair_quality(
                [&camera; 2],
                [&pixels[0], &pixels[1]],
                Some([&poses[0], &poses[1]]),
                &points[..count],
            )
        };
        let wide = quality(800.0, 6);
        let narrow = quality(50.0, 6);
        let few = quality(800.0, 2);
        assert!(wide.rank > narrow.rank && wide.rank > few.rank);
        // 800 mm at 1000 mm: 38.7 degrees for the point in the middle.
        assert!((wide.median_angle.unwrap() - 0.8_f64.atan()).abs() < 0.05);
        assert!(
            wide.spread > 2.0 * few.spread,
            "{} {}",
            wide.spread,
            few.spread
        );
        let none = pair_quality([&camera; 2], [&[], &[]], None, &[]);
        assert_eq!((none.rank, none.median_angle), (0.0, None));
    }
}
