//! What stands before the camera: dots, rings, surfaces, bars and the cross, with their labels.

use nalgebra::{Rotation3, Unit, Vector3};
use serde::{Deserialize, Serialize};

use super::Surface;
use crate::targets::{DOT420_AXES, Family, dot420_table, ring_table};

/// A plane with its own axes: where a flat element lies.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Placement {
    /// Origin of the element's frame in the world, mm.
    pub origin: Vector3<f64>,
    /// Unit vector of the frame's x axis.
    pub x: Vector3<f64>,
    /// Unit vector of the frame's y axis, at right angles to x.
    pub y: Vector3<f64>,
}

impl Placement {
    /// Parallel to the world's x and y, facing up.
    #[must_use]
    pub fn horizontal(origin: Vector3<f64>) -> Self {
        Self {
            origin,
            x: Vector3::x(),
            y: Vector3::y(),
        }
    }

    /// The outward normal, on the side the element is seen from.
    #[must_use]
    pub fn normal(&self) -> Vector3<f64> {
        self.x.cross(&self.y)
    }

    /// The world point at (u, v) of the plane, mm.
    #[must_use]
    pub fn point(&self, u: f64, v: f64) -> Vector3<f64> {
        self.origin + self.x * u + self.y * v
    }

    /// The same plane with its origin moved to (u, v) and lifted along the normal, mm.
    #[must_use]
    pub fn moved(&self, u: f64, v: f64, lift: f64) -> Self {
        Self {
            origin: self.point(u, v) + self.normal() * lift,
            ..*self
        }
    }

    /// The same plane with its axes turned counter-clockwise (seen from the front), radians.
    #[must_use]
    pub fn turned(&self, angle: f64) -> Self {
        let turn = Rotation3::from_axis_angle(&Unit::new_normalize(self.normal()), angle);
        Self {
            x: turn * self.x,
            y: turn * self.y,
            ..*self
        }
    }
}

/// How a mark sends light back to a camera with a ring flash.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Finish {
    /// Retro-reflective: bright until some 50 degrees of incidence, quickly dark beyond 60.
    Retro {
        /// Brightness at normal incidence as a share of the picture's peak.
        brightness: f64,
    },
    /// A matt white mark: Lambert's cosine.
    Matt {
        /// Brightness at normal incidence as a share of the picture's peak.
        brightness: f64,
    },
}

impl Default for Finish {
    fn default() -> Self {
        Self::Retro { brightness: 1.0 }
    }
}

impl Finish {
    /// The share of the peak that comes back at an angle of incidence of the given cosine.
    ///
    /// The retro-reflective curve is that of glass-bead film in outline: `cos^1.16` (60 % at 50 degrees) times a
    /// logistic drop about 66 degrees.
    #[must_use]
    pub fn returned(&self, cos_incidence: f64) -> f64 {
        let cos = cos_incidence.clamp(0.0, 1.0);
        match self {
            Self::Retro { brightness } => {
                let drop = 1.0 / (1.0 + ((cos.acos().to_degrees() - 66.0) / 3.0).exp());
                brightness * cos.powf(1.16) * drop
            }
            Self::Matt { brightness } => brightness * cos,
        }
    }
}

/// A round dot: a target, or one dot of a code or of the cross.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Disc {
    /// `T1`, `C17.O`, `R14-57`, `X1`.
    pub label: String,
    /// Centre and plane.
    pub placement: Placement,
    /// Radius, mm.
    pub radius: f64,
    /// How it reflects.
    pub finish: Finish,
}

/// The segmented ring of a ring code; its centre dot is a [`Disc`] of the same label.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ring {
    /// `R14-57`.
    pub label: String,
    /// Centre and plane; the first segment begins at +y and goes on clockwise as seen from the front.
    pub placement: Placement,
    /// Radius of the centre dot, mm; the ring lies between 2 and 3 of it.
    pub dot_radius: f64,
    /// Number of segments.
    pub segments: u8,
    /// Light segments, the first one most significant.
    pub bits: u32,
    /// How it reflects.
    pub finish: Finish,
}

/// A scale bar: its true length and the length its certificate states.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScaleBar {
    /// Name.
    pub name: String,
    /// Label of the first end point.
    pub from: String,
    /// Label of the second end point.
    pub to: String,
    /// Exact distance of the end points, mm.
    pub true_length_mm: f64,
    /// Length as published, with its error, mm.
    pub known_length_mm: f64,
    /// Standard error of the published length, mm.
    pub sigma_mm: f64,
}

/// A labelled point in the frame of its device, mm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LabelledPoint {
    /// Label.
    pub label: String,
    /// Coordinates, mm.
    pub point: [f64; 3],
}

/// The reference cross of six dots, X1 and X6 raised.
#[must_use]
pub fn default_cross() -> Vec<LabelledPoint> {
    let points = [
        [0.0, 0.0, 40.0],
        [100.0, 0.0, 0.0],
        [-100.0, 0.0, 0.0],
        [0.0, 100.0, 0.0],
        [0.0, -100.0, 0.0],
        [50.0, 50.0, 25.0],
    ];
    (1..)
        .zip(points)
        .map(|(number, point)| LabelledPoint {
            label: format!("X{number}"),
            point,
        })
        .collect()
}

/// Everything that is photographed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// All dots, labels unique.
    pub discs: Vec<Disc>,
    /// Rings of the ring codes.
    pub rings: Vec<Ring>,
    /// Opaque surfaces.
    pub surfaces: Vec<Surface>,
    /// Scale bars.
    pub bars: Vec<ScaleBar>,
    /// The reference cross in its own frame, empty without one.
    pub cross: Vec<LabelledPoint>,
}

impl Scene {
    /// Adds a dot with the default finish.
    pub fn add_disc(&mut self, label: impl Into<String>, placement: Placement, diameter: f64) {
        self.discs.push(Disc {
            label: label.into(),
            placement,
            radius: diameter / 2.0,
            finish: Finish::default(),
        });
    }

    /// Adds the six dots of `dot420` code `id`: O at the placement's origin, A on its x and B on its y axis; lengths in
    /// mm. Adds nothing where the family has no such number.
    pub fn add_dot420(&mut self, id: u32, placement: &Placement, pitch: f64, dot_diameter: f64) {
        let places = dot420_places(id);
        for (name, [x, y]) in ["O", "A", "B", "1", "2", "3"].into_iter().zip(places) {
            let placed = placement.moved(x * pitch, y * pitch, 0.0);
            self.add_disc(
                format!("{}.{name}", Family::Dot420.code_label(id)),
                placed,
                dot_diameter,
            );
        }
    }

    /// Adds ring code `id` of `segments` segments: centre dot and ring. Adds nothing where the family has no such
    /// number.
    pub fn add_ring(&mut self, segments: u8, id: u32, placement: Placement, dot_diameter: f64) {
        let Some(&bits) = (id as usize)
            .checked_sub(1)
            .and_then(|index| ring_table(segments).get(index))
        else {
            return;
        };
        let label = Family::Ring(segments).code_label(id);
        self.add_disc(label.clone(), placement, dot_diameter);
        self.rings.push(Ring {
            label,
            placement,
            dot_radius: dot_diameter / 2.0,
            segments,
            bits,
            finish: Finish::default(),
        });
    }

    /// Adds the reference cross: dots of `dot_diameter` mm facing along +z of the cross frame, each on a small opaque
    /// plate.
    pub fn add_cross(&mut self, points: &[LabelledPoint], frame: &Placement, dot_diameter: f64) {
        for LabelledPoint { label, point } in points {
            let placed = frame.moved(point[0], point[1], point[2]);
            self.surfaces
                .push(Surface::plate(&placed, 1.2 * dot_diameter, CROSS_GREY));
            self.add_disc(label.clone(), placed, dot_diameter);
        }
        self.cross = points.to_vec();
    }

    /// The dot with this label.
    #[must_use]
    pub fn disc(&self, label: &str) -> Option<&Disc> {
        self.discs.iter().find(|disc| disc.label == label)
    }
}

/// Grey value of the plates that carry the dots of the cross.
const CROSS_GREY: f64 = 15.0;

/// The dots O, A, B, 1, 2, 3 of a `dot420` code in pitches; empty where the family has no such number.
pub(super) fn dot420_places(id: u32) -> Vec<[f64; 2]> {
    let code = (id as usize)
        .checked_sub(1)
        .and_then(|index| dot420_table().get(index));
    let code = code.map_or(&[][..], |code| &code[..]);
    let axes = if code.is_empty() {
        &[][..]
    } else {
        &DOT420_AXES[..]
    };
    axes.iter().chain(code).map(|p| p.map(f64::from)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_turns_counter_clockwise_from_a_to_b_as_seen_from_the_front() {
        let mut scene = Scene::default();
        let placement = Placement::horizontal(Vector3::new(1.0, 2.0, 3.0)).turned(0.7);
        scene.add_dot420(17, &placement, 5.0, 5.0);
        assert_eq!(scene.discs.len(), 6);
        let place = |name: &str| scene.disc(name).unwrap().placement.origin;
        let (a, b) = (
            place("C17.A") - place("C17.O"),
            place("C17.B") - place("C17.O"),
        );
        assert!((a.norm() - 30.0).abs() < 1e-12 && (b.norm() - 30.0).abs() < 1e-12);
        assert!((a.cross(&b) - Vector3::z() * 900.0).norm() < 1e-9);
    }

    #[test]
    fn a_number_that_no_family_has_adds_nothing() {
        let mut scene = Scene::default();
        let placement = Placement::horizontal(Vector3::zeros());
        scene.add_dot420(0, &placement, 5.0, 5.0);
        scene.add_dot420(421, &placement, 5.0, 5.0);
        scene.add_ring(14, 517, placement, 5.0);
        scene.add_ring(13, 1, placement, 5.0);
        assert_eq!(scene, Scene::default());
    }

    #[test]
    fn retro_reflection_falls_slowly_to_fifty_degrees_and_steeply_after_sixty() {
        let at = |degrees: f64| Finish::default().returned(degrees.to_radians().cos());
        assert!((at(0.0) - 1.0).abs() < 1e-6);
        assert!((at(50.0) - 0.6).abs() < 0.01);
        assert!(at(60.0) > 0.35 && at(70.0) < 0.1 && at(80.0) < 0.005);
    }
}
