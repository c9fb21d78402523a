//! What the graphics card draws: one record for each point, line and ellipsoid, relative to the scene's origin, mm.

use bytemuck::Pod;
use bytemuck::Zeroable;
use egui::Color32;

/// Shape of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Marker {
    /// A measured dot.
    Disc = 0,
    /// A dot of the reference cross.
    Diamond = 1,
    /// A point with known coordinates.
    Triangle = 2,
    /// Round the selected point.
    Ring = 3,
}

/// A point that keeps its size on screen.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct PointInstance {
    pub(super) position: [f32; 3],
    /// Diameter, screen points.
    pub(super) size: f32,
    pub(super) colour: [u8; 4],
    pub(super) rim: [u8; 4],
    /// A [`Marker`].
    pub(super) marker: u32,
}

/// A line that keeps its width on screen.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct LineInstance {
    pub(super) from: [f32; 3],
    /// Width, screen points.
    pub(super) width: f32,
    pub(super) to: [f32; 3],
    /// When it began to fade in, s.
    pub(super) birth: f32,
    pub(super) colour: [u8; 4],
}

/// The unit sphere taken to an ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct EllipsoidInstance {
    pub(super) centre: [f32; 3],
    /// Columns of the 3x3 matrix, mm.
    pub(super) columns: [[f32; 3]; 3],
    pub(super) colour: [u8; 4],
}

/// What is drawn together; never changed once it is made.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Layer {
    pub(super) points: Vec<PointInstance>,
    pub(super) lines: Vec<LineInstance>,
    pub(super) ellipsoids: Vec<EllipsoidInstance>,
}

/// Straight (not premultiplied) bytes, as the shaders expect them.
pub(super) fn bytes(colour: Color32) -> [u8; 4] {
    colour.to_srgba_unmultiplied()
}

/// The colour, seen through.
pub(super) fn faint(colour: Color32, opacity: f32) -> [u8; 4] {
    let [r, g, b, _] = bytes(colour);
    [r, g, b, (opacity * 255.0).round() as u8]
}

/// A sphere of radius 1 with its centre at 0: corners and triangles.
pub(super) struct Sphere {
    pub(super) corners: Vec<[f32; 3]>,
    pub(super) triangles: Vec<u16>,
}

impl Sphere {
    /// Rings of constant latitude; `rings` of them between the poles, twice as many corners and two in each.
    pub(super) fn new(rings: u16) -> Self {
        let around = 2 * (rings + 1);
        let mut corners = vec![[0.0, 0.0, 1.0]];
        for ring in 1..=rings {
            let (sine, cosine) =
                (std::f32::consts::PI * f32::from(ring) / f32::from(rings + 1)).sin_cos();
            corners.extend((0..around).map(|step| {
                let (y, x) =
                    (std::f32::consts::TAU * f32::from(step) / f32::from(around)).sin_cos();
                [sine * x, sine * y, cosine]
            }));
        }
        corners.push([0.0, 0.0, -1.0]);
        let last = 1 + rings * around;
        let corner = |ring: u16, step: u16| 1 + ring * around + step % around;
        let mut triangles = Vec::new();
        for step in 0..around {
            triangles.extend([0, corner(0, step), corner(0, step + 1)]);
            for ring in 1..rings {
                let [a, b] = [corner(ring - 1, step), corner(ring - 1, step + 1)];
                let [c, d] = [corner(ring, step), corner(ring, step + 1)];
                triangles.extend([a, c, b, b, c, d]);
            }
            triangles.extend([last, corner(rings - 1, step + 1), corner(rings - 1, step)]);
        }
        Self { corners, triangles }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn a_sphere_is_closed_and_looks_outward() {
        let sphere = Sphere::new(5);
        let mut volume = 0.0;
        for triangle in sphere.triangles.chunks(3) {
            let [a, b, c] = [0, 1, 2].map(|i| Vec3::from(sphere.corners[usize::from(triangle[i])]));
            assert!((b - a).cross(c - a).dot(a + b + c) > 0.0);
            volume += a.cross(b).dot(c) / 6.0;
        }
        // A polyhedron with 72 corners has most of the volume of the ball.
        assert!(volume > 3.6 && volume < 4.1888, "{volume}");
    }
}
