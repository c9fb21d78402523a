//! Opaque flat surfaces and what they hide.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::Placement;

/// Surfaces hide only what lies farther behind them than this share of the viewing distance: 0.1 um at 1 m, above
/// rounding, so that a dot is not hidden by the surface it is glued to.
const CONTACT: f64 = 1e-7;

/// An opaque planar convex polygon, hiding from both sides.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Surface {
    /// Corners in order round the polygon (either sense), mm; at least three, planar, convex.
    pub corners: Vec<Vector3<f64>>,
    /// Grey value of the surface in a picture, seen from the front in the image centre.
    pub grey: f64,
}

impl Surface {
    /// The rectangle of `width` x `height` mm about the origin of `placement`.
    #[must_use]
    pub fn rectangle(placement: &Placement, width: f64, height: f64, grey: f64) -> Self {
        let (w, h) = (width / 2.0, height / 2.0);
        let corners = [[-w, -h], [w, -h], [w, h], [-w, h]];
        Self {
            corners: corners.map(|[u, v]| placement.point(u, v)).to_vec(),
            grey,
        }
    }

    /// A regular twelve-sided plate about the origin of `placement`, its corners at `radius` mm.
    #[must_use]
    pub fn plate(placement: &Placement, radius: f64, grey: f64) -> Self {
        let corner = |k: u32| {
            let (s, c) = (f64::from(k) * std::f64::consts::TAU / 12.0).sin_cos();
            placement.point(radius * c, radius * s)
        };
        Self {
            corners: (0..12).map(corner).collect(),
            grey,
        }
    }
}

/// A surface prepared for ray casting.
#[derive(Clone, Debug)]
pub(super) struct Occluder {
    pub(super) origin: Vector3<f64>,
    pub(super) normal: Vector3<f64>,
    pub(super) along: Vector3<f64>,
    /// Inward normals of the edges with their offsets: inside where `n . p >= offset` for all.
    edges: Vec<(Vector3<f64>, f64)>,
    pub(super) grey: f64,
}

/// The surfaces that have an area, prepared; order kept.
pub(super) fn occluders(surfaces: &[Surface]) -> Vec<Occluder> {
    surfaces.iter().filter_map(Occluder::new).collect()
}

impl Occluder {
    fn new(surface: &Surface) -> Option<Self> {
        let corners = &surface.corners;
        let origin = *corners.first()?;
        let area = corners
            .windows(2)
            .map(|pair| (pair[0] - origin).cross(&(pair[1] - origin)))
            .fold(Vector3::zeros(), |sum, part| sum + part);
        let normal = area.try_normalize(1e-12)?;
        let edges = (0..corners.len())
            .map(|k| {
                let (from, to) = (corners[k], corners[(k + 1) % corners.len()]);
                let inward = normal.cross(&(to - from));
                (inward, inward.dot(&from))
            })
            .collect();
        let along = (corners.get(1)? - origin).try_normalize(1e-12)?;
        Some(Self {
            origin,
            normal,
            along,
            edges,
            grey: surface.grey,
        })
    }

    /// Where the ray `eye + t direction` meets the surface, as `t > 0`.
    pub(super) fn meets(&self, eye: &Vector3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let slope = self.normal.dot(direction);
        if slope.abs() < 1e-12 * direction.norm() {
            return None;
        }
        let t = self.normal.dot(&(self.origin - eye)) / slope;
        if t <= 0.0 {
            return None;
        }
        let point = eye + direction * t;
        self.edges
            .iter()
            .all(|(inward, offset)| inward.dot(&point) >= *offset)
            .then_some(t)
    }

    /// Whether the surface stands between `eye` and `point`.
    pub(super) fn hides(&self, point: &Vector3<f64>, eye: &Vector3<f64>) -> bool {
        self.meets(eye, &(point - eye))
            .is_some_and(|t| t < 1.0 - CONTACT)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_hides_what_is_behind_it_and_not_what_lies_on_it() {
        let placement = Placement::horizontal(Vector3::zeros());
        let surface = Surface::rectangle(&placement, 100.0, 60.0, 10.0);
        let wall = Occluder::new(&surface).unwrap();
        let eye = Vector3::new(300.0, 0.0, 400.0);
        assert!(wall.hides(&Vector3::new(-10.0, 0.0, -5.0), &eye));
        assert!(
            !wall.hides(&Vector3::new(10.0, 20.0, 0.0), &eye),
            "on the surface"
        );
        assert!(
            !wall.hides(&Vector3::new(10.0, 20.0, 5.0), &eye),
            "in front of it"
        );
        assert!(
            !wall.hides(&Vector3::new(-100.0, 0.0, -5.0), &eye),
            "beside it"
        );
        let mut turned = surface;
        turned.corners.reverse();
        let wall = Occluder::new(&turned).unwrap();
        assert!(
            wall.hides(&Vector3::new(-10.0, 0.0, -5.0), &eye),
            "either sense of the corners"
        );
    }
}
