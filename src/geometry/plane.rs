//! The best plane of points.

use nalgebra::{Matrix3, Vector2, Vector3};

/// A plane with axes of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// A point of the plane: the centroid of what it was fitted to, mm.
    pub centre: Vector3<f64>,
    /// Unit vectors in the plane; `axes[0] x axes[1] = normal`.
    pub axes: [Vector3<f64>; 2],
    /// Unit normal.
    pub normal: Vector3<f64>,
}

impl Plane {
    /// The plane through three points, counter-clockwise as seen from the side of its normal; `None` on a line.
    #[must_use]
    pub fn through(a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>) -> Option<Self> {
        let (u, v) = (b - a, c - a);
        let normal = u.cross(&v);
        // The sine of the angle at `a`; below it the rounding of the points turns the plane by more than 1e-4 rad.
        let on_a_line = 1e-9 * u.norm() * v.norm();
        if !(normal.norm() > on_a_line) {
            return None;
        }
        let (normal, first) = (normal.normalize(), u.normalize());
        Some(Self {
            centre: (a + b + c) / 3.0,
            axes: [first, normal.cross(&first)],
            normal,
        })
    }

    /// Signed distance of a point, mm, positive on the side of the normal.
    #[must_use]
    pub fn height(&self, point: &Vector3<f64>) -> f64 {
        (point - self.centre).dot(&self.normal)
    }

    /// Coordinates of a point's foot along the axes, mm.
    #[must_use]
    pub fn coordinates(&self, point: &Vector3<f64>) -> Vector2<f64> {
        let from_centre = point - self.centre;
        Vector2::new(
            from_centre.dot(&self.axes[0]),
            from_centre.dot(&self.axes[1]),
        )
    }
}

/// A fitted plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneFit {
    /// The plane; its first axis is the direction in which the points spread most.
    pub plane: Plane,
    /// Root mean square distance of the points from it, mm.
    pub rms: f64,
    /// Root mean square spread along the two axes, mm.
    pub spread: [f64; 2],
}

/// Why no plane could be fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlaneError {
    /// Fewer than three points.
    #[error("a plane needs 3 points, found {found}")]
    TooFewPoints {
        /// Points given.
        found: usize,
    },
    /// The points lie on one line (or a coordinate is not a number).
    #[error("the points lie on one line, so the plane may turn about it")]
    Collinear,
}

/// The plane with the least sum of squared perpendicular distances (principal axes of the points).
///
/// # Errors
/// [`PlaneError`] with fewer than three points or points on one line.
pub fn fit_plane(points: &[Vector3<f64>]) -> Result<PlaneFit, PlaneError> {
    if points.len() < 3 {
        return Err(PlaneError::TooFewPoints {
            found: points.len(),
        });
    }
    if !points.iter().flatten().all(|x| x.is_finite()) {
        return Err(PlaneError::Collinear);
    }
    let n = points.len() as f64;
    let centre = points.iter().sum::<Vector3<f64>>() / n;
    let mut moments = Matrix3::zeros();
    for point in points {
        moments += (point - centre) * (point - centre).transpose() / n;
    }
    let eigen = moments.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let spread = order.map(|k| eigen.eigenvalues[k].max(0.0).sqrt());
    // Moments are squares: a spread of 1e-7 of the largest is their rounding.
    if !(spread[1] > 1e-7 * spread[0]) {
        return Err(PlaneError::Collinear);
    }
    let axis = |k: usize| eigen.eigenvectors.column(order[k]).into_owned();
    let axes = [axis(0), axis(1)];
    let plane = Plane {
        centre,
        axes,
        normal: axes[0].cross(&axes[1]),
    };
    // From the distances themselves, since the root of the smallest eigenvalue is only good to 1e-8 of the largest.
    let squares: f64 = points.iter().map(|p| plane.height(p).powi(2)).sum();
    Ok(PlaneFit {
        plane,
        rms: (squares / n).sqrt(),
        spread: [spread[0], spread[1]],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_plane_of_flat_points_is_found(turn in prop::array::uniform3(-1.5..1.5), shift in prop::array::uniform3(-900.0..900.0)) {
            let rotation = super::super::rotation_from_vector(&Vector3::from(turn));
            let flat = [[0.0, 0.0], [90.0, 5.0], [10.0, 60.0], [70.0, 80.0], [-30.0, 20.0]];
            let points = flat.map(|[x, y]| rotation * Vector3::new(x, y, 0.0) + Vector3::from(shift));
            let fit = fit_plane(&points).unwrap();
            prop_assert!(fit.rms < 1e-9);
            prop_assert!((fit.plane.normal.dot(&(rotation * Vector3::z())).abs() - 1.0).abs() < 1e-12);
            let back = fit.plane.coordinates(&points[1]) - fit.plane.coordinates(&points[0]);
            prop_assert!((back.norm() - (points[1] - points[0]).norm()).abs() < 1e-9);
        }
    }

    #[test]
    fn heights_above_the_plane_are_its_rms() {
        let points = [
            [1.0, 0.0, 0.1],
            [-1.0, 0.0, 0.1],
            [0.0, 1.0, -0.1],
            [0.0, -1.0, -0.1],
        ];
        let fit = fit_plane(&points.map(Vector3::from)).unwrap();
        assert!((fit.rms - 0.1).abs() < 1e-12);
    }

    #[test]
    fn lines_and_too_few_points_are_refused() {
        let line: Vec<_> = (0..4)
            .map(|i| Vector3::new(1.0, 2.0, 3.0) * f64::from(i))
            .collect();
        assert_eq!(fit_plane(&line), Err(PlaneError::Collinear));
        assert_eq!(
            fit_plane(&line[..2]),
            Err(PlaneError::TooFewPoints { found: 2 })
        );
        assert_eq!(Plane::through(&line[0], &line[1], &line[2]), None);
    }
}
