//! Flat, straight and one-place networks: what their shape does to the result, in one line each.

use nalgebra::{Matrix3, Vector3};

/// Points within this share of their extent of a plane, and stations of a line, lie in it.
pub(super) const FLAT_SHARE: f64 = 1e-3;

/// Stations and points this much nearer to one place or line than they are extended leave motions undetermined.
const DEGENERATE_SHARE: f64 = 1e-6;

/// How a set of places is extended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Extent {
    pub(super) count: usize,
    centre: Vector3<f64>,
    /// From the first to the last along the direction in which they spread most, mm.
    pub(super) length: f64,
    /// Largest distance from the line in that direction, mm.
    pub(super) from_line: f64,
    /// Largest distance from the best plane, mm.
    from_plane: f64,
}

/// What the points and stations of a network are shaped like.
pub(super) struct Shape {
    points: Extent,
    stations: Extent,
}

impl Extent {
    /// `None` without places.
    pub(super) fn of(places: &[Vector3<f64>]) -> Option<Self> {
        let count = places.len();
        if count == 0 {
            return None;
        }
        let centre = places.iter().sum::<Vector3<f64>>() / count as f64;
        let moments: Matrix3<f64> = places
            .iter()
            .map(|place| (place - centre) * (place - centre).transpose())
            .sum();
        let eigen = moments.symmetric_eigen();
        let along = eigen
            .eigenvectors
            .column(eigen.eigenvalues.imax())
            .into_owned();
        let normal = eigen
            .eigenvectors
            .column(eigen.eigenvalues.imin())
            .into_owned();
        let largest = |of: &dyn Fn(Vector3<f64>) -> f64| {
            let values = places.iter().map(|place| of(place - centre));
            values.fold(f64::NEG_INFINITY, f64::max)
        };
        let last = largest(&|v| v.dot(&along));
        let first = -largest(&|v| -v.dot(&along));
        Some(Self {
            count,
            centre,
            length: last - first,
            from_line: largest(&|v| (v - along * v.dot(&along)).norm()),
            from_plane: largest(&|v| v.dot(&normal).abs()),
        })
    }
}

impl Shape {
    /// `None` where there are no points or no stations.
    pub(super) fn of(points: &[Vector3<f64>], stations: &[Vector3<f64>]) -> Option<Self> {
        Some(Self {
            points: Extent::of(points)?,
            stations: Extent::of(stations)?,
        })
    }

    /// What should be known of a shape that can be adjusted.
    pub(super) fn told(&self, c: PrincipalDistance) -> Vec<String> {
        let Self { points, stations } = self;
        let mut told = Vec::new();
        if points.count > 3 && points.from_plane <= FLAT_SHARE * points.length {
            let consequence = match c {
                PrincipalDistance::Estimated => {
                    "only images tilted against it tell the principal distance from the distance of the camera"
                }
                PrincipalDistance::Held => {
                    "an error of the principal distance would hardly show in the residuals"
                }
            };
            told.push(format!(
                "all {} points lie in a plane (within {:.3} mm, {:.0} mm wide): {consequence}",
                points.count, points.from_plane, points.length
            ));
        }
        if stations.count > 2 && stations.from_line <= FLAT_SHARE * stations.length {
            told.push(format!(
                "all {} images were taken from one line (within {:.3} mm, {:.0} mm long): the rays of a point lie in one plane through it, so that points near the line are uncertain",
                stations.count, stations.from_line, stations.length
            ));
        }
        told
    }
}

/// Why nothing can be adjusted, where the shape alone forbids it; points are those whose places are known.
pub(super) fn hopeless_shape(points: &[Vector3<f64>], stations: &[Vector3<f64>]) -> Option<String> {
    let points = Extent::of(points);
    let stations = Extent::of(stations).filter(|stations| stations.count > 1)?;
    let to_stations = |points: Extent| (points.centre - stations.centre).norm();
    let away = points.map_or(stations.centre.norm(), to_stations);
    if stations.length <= DEGENERATE_SHARE * away {
        return Some(format!(
            "all {} images were taken from one place (within {:.3} mm): found no base, so that the rays of a point do not meet",
            stations.count, stations.length
        ));
    }
    let points = points.filter(|points| points.count > 2)?;
    (points.from_line <= DEGENERATE_SHARE * points.length).then(|| {
        format!(
            "all {} points lie on a line (within {:.3} mm, {:.0} mm long): every image may turn about it, so that no pose can be found",
            points.count, points.from_line, points.length
        )
    })
}

/// What an adjustment does with the principal distances of its cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PrincipalDistance {
    /// One of them is estimated.
    Estimated,
    /// All keep their values.
    Held,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat() -> Vec<Vector3<f64>> {
        (0..12)
            .map(|k| {
                let (x, y) = (f64::from(k % 4) * 100.0, f64::from(k / 4) * 80.0);
                Vector3::new(x, y, 0.3 * x - 0.2 * y + 50.0)
            })
            .collect()
    }

    fn line() -> Vec<Vector3<f64>> {
        (0..5)
            .map(|k| {
                Vector3::new(200.0, -100.0, 900.0) + Vector3::new(3.0, 4.0, 0.0) * f64::from(k * k)
            })
            .collect()
    }

    #[test]
    fn distances_are_those_from_line_and_plane() {
        let mut places = flat();
        let normal = Vector3::new(-0.3, 0.2, 1.0).normalize();
        assert!(Extent::of(&places).unwrap().from_plane < 1e-9);
        for (k, place) in places.iter_mut().enumerate() {
            *place += normal * if (k + k / 4) % 2 == 0 { 0.4 } else { -0.4 };
        }
        let extent = Extent::of(&places).unwrap();
        assert!((extent.from_plane - 0.4).abs() < 0.1, "{extent:?}");
        let extent = Extent::of(&line()).unwrap();
        assert!(extent.from_line < 1e-9 && (extent.length - 80.0).abs() < 1e-9);
    }

    #[test]
    fn a_shape_is_told_with_its_figures() {
        let shape = Shape::of(&flat(), &line()).unwrap();
        assert_eq!(hopeless_shape(&flat(), &line()), None);
        let told = shape.told(PrincipalDistance::Held);
        assert_eq!(told.len(), 2);
        assert!(told[0].starts_with("all 12 points lie in a plane (within 0.000 mm, "));
        assert!(
            told[1]
                .starts_with("all 5 images were taken from one line (within 0.000 mm, 80 mm long)")
        );
        let mut tall = flat();
        tall[5].z += 30.0;
        let mut aside = line();
        aside[2].z += 1.0;
        let shape = Shape::of(&tall, &aside).unwrap();
        assert_eq!(
            shape.told(PrincipalDistance::Estimated),
            Vec::<String>::new()
        );
        let one_place = hopeless_shape(&tall, &[aside[0]; 4]).unwrap();
        assert!(one_place.starts_with("all 4 images were taken from one place"));
        let one_line = hopeless_shape(&line(), &flat()).unwrap();
        assert!(one_line.starts_with("all 5 points lie on a line"));
    }
}
