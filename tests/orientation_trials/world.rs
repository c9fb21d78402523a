//! The object of a random measurement: everything that carries dots.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::{Rotation3, Vector2, Vector3};
use rand::RngExt as _;
use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;
use tiepoint::geometry::Circle;
use tiepoint::network::PointId;
use tiepoint::synthetic::default_cross;
use tiepoint::targets::{DOT420_AXES, Family, dot420_table};

use super::recipe::Recipe;

/// Width of the object, mm.
pub(crate) const WIDTH_MM: f64 = 1500.0;
/// Its height as a share of the width.
pub(crate) const HEIGHT: f64 = 0.7;
/// Pitch and dot of the codes in tables of observations, mm.
const PITCH_MM: f64 = 5.0;
/// A wrong code stands for a moved one by so much, mm.
pub(crate) const MOVED_MM: f64 = 120.0;

/// A code in the world.
#[derive(Clone, Debug)]
pub(crate) struct PlacedCode {
    pub(crate) id: u32,
    /// Its middle.
    pub(crate) origin: Vector3<f64>,
    /// Unit vectors of its plane and normal.
    pub(crate) axes: [Vector3<f64>; 3],
}

impl PlacedCode {
    pub(crate) fn dots(&self, family: Family, pitch_mm: f64) -> Vec<Vector3<f64>> {
        match family {
            Family::Ring(_) => vec![self.origin],
            Family::Dot420 => DOT420_AXES
                .iter()
                .chain(&dot420_table()[self.id as usize - 1])
                .map(|[x, y]| {
                    self.origin
                        + (self.axes[0] * f64::from(x - 3) + self.axes[1] * f64::from(y - 3))
                            * pitch_mm
                })
                .collect(),
        }
    }
}

/// Everything that carries dots.
pub(crate) struct World {
    pub(crate) codes: Vec<PlacedCode>,
    /// Pitch of the six-dot codes and diameter of all dots, mm.
    pub(crate) pitch_mm: f64,
    /// The first code's place, and where it stands in the later pictures.
    pub(crate) places: [Vector3<f64>; 2],
    pub(crate) plain: Vec<Vector3<f64>>,
    pub(crate) cross: Vec<(PointId, Vector3<f64>)>,
    /// Numbers that no code of the object has.
    pub(crate) free: Vec<u32>,
}

impl World {
    pub(crate) fn of(recipe: &Recipe, random: &mut ChaCha8Rng) -> Self {
        let mut ids: Vec<u32> = (1..=recipe.family.code_count()).collect();
        ids.shuffle(random);
        let free = ids.split_off(recipe.codes);
        // Nothing overlaps: the nearest of several tries is farthest from all.
        let mut places: Vec<Vector2<f64>> = vec![Vector2::zeros()];
        let mut place = |random: &mut ChaCha8Rng| {
            let tries = (0..12).map(|_| {
                Vector2::new(
                    random.random_range(-0.5..0.5),
                    random.random_range(-0.5..0.5) * HEIGHT,
                ) * WIDTH_MM
            });
            let room = |p: &Vector2<f64>| {
                let away = places.iter().map(|q| (p - q).norm());
                away.fold(f64::INFINITY, f64::min)
            };
            let best = tries
                .max_by(|a, b| room(a).total_cmp(&room(b)))
                .expect("some tries");
            places.push(best);
            best
        };
        // A smooth surface with steps, as a block with parts on it.
        let phases: [f64; 4] = std::array::from_fn(|_| random.random_range(0.0..TAU));
        let height = |p: &Vector2<f64>, step: f64| {
            let waves = (p.x / 260.0 + phases[0]).sin() * (p.y / 190.0 + phases[1]).sin();
            recipe.relief * WIDTH_MM * (0.4 * (1.0 + waves) + 0.2 * step)
        };
        let codes: Vec<PlacedCode> = ids
            .iter()
            .map(|&id| {
                let at = place(random);
                let step = random.random_range(0.0..1.0);
                let lean = if recipe.relief > 0.0 {
                    Vector3::new(
                        random.random_range(-0.35..0.35),
                        random.random_range(-0.35..0.35),
                        0.0,
                    )
                } else {
                    Vector3::zeros()
                };
                let turn = Rotation3::new(lean)
                    * Rotation3::from_axis_angle(&Vector3::z_axis(), random.random_range(0.0..TAU));
                PlacedCode {
                    id,
                    origin: Vector3::new(at.x, at.y, height(&at, step)),
                    axes: [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| turn * axis),
                }
            })
            .collect();
        let plain = (0..recipe.plain_targets)
            .map(|_| {
                let at = place(random);
                let step = random.random_range(0.0..1.0);
                Vector3::new(at.x, at.y, height(&at, step))
            })
            .collect();
        let lift = Vector3::new(0.0, 0.0, recipe.relief * WIDTH_MM * 0.5);
        let cross = if recipe.cross {
            default_cross()
                .iter()
                .enumerate()
                .map(|(k, p)| (PointId::Device(k as u16), Vector3::from(p.point) + lift))
                .collect()
        } else {
            Vec::new()
        };
        let first = codes[0].origin;
        let direction = random.random_range(0.0..TAU);
        let moved = first + Vector3::new(direction.cos(), direction.sin(), 0.0) * MOVED_MM;
        Self {
            codes,
            pitch_mm: PITCH_MM,
            places: [first, moved],
            plain,
            cross,
            free,
        }
    }

    pub(crate) fn codes_moved(&mut self, moved: bool) {
        self.codes[0].origin = self.places[usize::from(moved)];
    }

    pub(crate) fn points(&self, recipe: &Recipe) -> BTreeMap<PointId, Vector3<f64>> {
        let mut points: BTreeMap<PointId, Vector3<f64>> = self.cross.iter().copied().collect();
        for code in &self.codes {
            let names = PointId::of_code(recipe.family, code.id);
            points.extend(
                names
                    .into_iter()
                    .zip(code.dots(recipe.family, self.pitch_mm)),
            );
        }
        points
    }

    /// The edges of the targets: codes as they are placed, the cross level.
    pub(crate) fn circles(&self, recipe: &Recipe) -> BTreeMap<PointId, Circle> {
        let of = |normal| Circle {
            normal,
            radius_mm: 0.5 * self.pitch_mm,
        };
        let cross = self.cross.iter().map(|(id, _)| (*id, of(Vector3::z())));
        let codes = self.codes.iter().flat_map(|code| {
            let names = PointId::of_code(recipe.family, code.id);
            names.into_iter().map(move |name| (name, of(code.axes[2])))
        });
        cross.chain(codes).collect()
    }
}
