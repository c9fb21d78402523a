//! How likely an accident lies on the surface that the accepted targets show.
//!
//! Targets are glued to surfaces; where rays meet by accident, depth is anything. A point that lies in the plane of the accepted ones
//! round it is therefore the rarer an accident the thinner that plane is beside the depth that the object allows.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use crate::geometry::fit_plane;

/// Accepted points round a place that make a surface.
const NEIGHBOURS: usize = 8;
/// Fewest of them.
const FEWEST: usize = 5;
/// A point belongs to the plane within so many times of how far its neighbours stray from it, and of its own standard error.
const THICK: f64 = 3.0;
/// Least distance from the plane, as a share of the neighbourhood's width, that counts as in it: surfaces bend.
const BEND: f64 = 0.03;

/// Accepted points by place.
pub(super) struct Surface {
    cell_mm: f64,
    cells: BTreeMap<[i64; 3], Vec<Vector3<f64>>>,
    /// Depth that the object allows, mm.
    depth_mm: f64,
}

impl Surface {
    /// `depth_mm`: within what depth an accident may lie.
    pub(super) fn of(points: &[Vector3<f64>], depth_mm: f64) -> Self {
        let min = points
            .iter()
            .fold(Vector3::repeat(f64::INFINITY), |m, p| m.inf(p));
        let max = points
            .iter()
            .fold(Vector3::repeat(f64::NEG_INFINITY), |m, p| m.sup(p));
        let extent = if points.is_empty() {
            1.0
        } else {
            (max - min).norm()
        };
        // On a surface about NEIGHBOURS points lie in nine cells.
        let cell_mm =
            (extent * (NEIGHBOURS as f64 / points.len().max(1) as f64).sqrt() / 2.0).max(1e-6);
        let mut surface = Self {
            cell_mm,
            cells: BTreeMap::new(),
            depth_mm,
        };
        for point in points {
            let cell = surface.cell(point);
            surface.cells.entry(cell).or_default().push(*point);
        }
        surface
    }

    fn cell(&self, point: &Vector3<f64>) -> [i64; 3] {
        std::array::from_fn(|axis| (point[axis] / self.cell_mm).floor() as i64)
    }

    /// The share of accidents that lie as near to the surface as this point, at most 1; 1 where it lies on none.
    pub(super) fn share(&self, point: &Vector3<f64>, covariance: &Matrix3<f64>) -> f64 {
        let home = self.cell(point);
        let mut near: Vec<(f64, Vector3<f64>)> = (0..27)
            .filter_map(|at| {
                let offset = [at % 3, at / 3 % 3, at / 9].map(|o: i64| o - 1);
                let key: [i64; 3] = std::array::from_fn(|axis| home[axis] + offset[axis]);
                self.cells.get(&key)
            })
            .flatten()
            .map(|other| ((other - point).norm(), *other))
            .filter(|(distance, _)| *distance > 1e-9)
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(NEIGHBOURS);
        if near.len() < FEWEST {
            return 1.0;
        }
        let width = near.last().map_or(0.0, |n| n.0);
        let places: Vec<Vector3<f64>> = near.into_iter().map(|n| n.1).collect();
        let Ok(fit) = fit_plane(&places) else {
            return 1.0;
        };
        let normal = fit.plane.normal;
        let sigma = normal.dot(&(covariance * normal)).max(0.0).sqrt();
        let thick = (THICK * fit.rms.hypot(sigma)).max(BEND * width);
        let centre = places.iter().sum::<Vector3<f64>>() / places.len() as f64;
        if (point - centre).dot(&normal).abs() > thick {
            return 1.0;
        }
        (2.0 * thick / self.depth_mm.max(1e-9)).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_on_the_surface_is_a_rarer_accident_than_one_above_it() {
        let points: Vec<Vector3<f64>> = (0..100)
            .map(|k| Vector3::new(f64::from(k % 10) * 20.0, f64::from(k / 10) * 20.0, 0.1))
            .collect();
        let surface = Surface::of(&points, 300.0);
        let sigma = Matrix3::identity() * 0.01;
        let on = surface.share(&Vector3::new(91.0, 87.0, 0.2), &sigma);
        assert!(on < 0.05, "{on}");
        assert_eq!(surface.share(&Vector3::new(91.0, 87.0, 30.0), &sigma), 1.0);
        assert_eq!(
            surface.share(&Vector3::new(900.0, 87.0, 0.0), &sigma),
            1.0,
            "nobody near"
        );
        assert_eq!(
            Surface::of(&[], 300.0).share(&Vector3::zeros(), &sigma),
            1.0
        );
    }
}
