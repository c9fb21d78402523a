//! The dim surroundings: which surface each pixel shows, a gentle gradient and the faint texture of its finish.
//!
//! Rays are cast at the corners of blocks. Where all four meet the same surface its smooth shade is interpolated;
//! blocks that an edge crosses are cast pixel by pixel.

use nalgebra::Vector2;

use super::surface::Occluder;
use crate::camera::Camera;
use crate::geometry::Pose;

/// Side of a block, px.
pub(super) const BLOCK: usize = 8;
/// Grey value where the ray meets nothing.
const FAR_GREY: f64 = 8.0;
/// Size of the texture's coarser cells on the surface, mm.
const TEXTURE_MM: f64 = 25.0;
/// How much darker the corners of the picture are than its centre.
const CORNER_LOSS: f64 = 0.25;

/// The surroundings of one picture.
pub(super) struct Background<'a> {
    pub(super) camera: &'a Camera,
    pub(super) pose: &'a Pose,
    pub(super) occluders: &'a [Occluder],
    /// Amplitude of the texture, grey values.
    pub(super) texture: f64,
    /// Factor on all grey values.
    pub(super) level: f64,
}

#[derive(Clone, Copy, PartialEq)]
struct Shade {
    surface: Option<usize>,
    grey: f64,
}

impl Background<'_> {
    /// Writes the grey values of the rows from `top` (a multiple of [`BLOCK`]) into `rows`.
    pub(super) fn fill(&self, top: usize, rows: &mut [f32]) {
        let width = self.camera.width_px as usize;
        let blocks = width.div_ceil(BLOCK);
        let corners = |row: usize| -> Vec<Shade> {
            (0..=blocks)
                .map(|b| self.shade((b * BLOCK) as f64, row as f64))
                .collect()
        };
        let (above, below) = (corners(top), corners(top + BLOCK));
        for (row, line) in rows.chunks_mut(width).enumerate() {
            for (block, pixels) in line.chunks_mut(BLOCK).enumerate() {
                let corner = [
                    above[block],
                    above[block + 1],
                    below[block],
                    below[block + 1],
                ];
                let uniform = corner.iter().all(|c| c.surface == corner[0].surface);
                for (column, grey) in pixels.iter_mut().enumerate() {
                    *grey = if uniform {
                        interpolated(&corner, column, row)
                    } else {
                        let x = (block * BLOCK + column) as f64 + 0.5;
                        self.shade(x, (top + row) as f64 + 0.5).grey as f32
                    };
                }
            }
        }
    }

    fn shade(&self, column: f64, row: f64) -> Shade {
        let pixel = Vector2::new(column, row);
        let direction = self.pose.world_from_direction(&self.camera.ray(&pixel));
        let eye = &self.pose.centre_in_world;
        let mut nearest: Option<(f64, usize)> = None;
        for (index, occluder) in self.occluders.iter().enumerate() {
            if let Some(t) = occluder.meets(eye, &direction)
                && nearest.is_none_or(|(found, _)| t < found)
            {
                nearest = Some((t, index));
            }
        }
        let half = Vector2::new(
            f64::from(self.camera.width_px),
            f64::from(self.camera.height_px),
        ) / 2.0;
        let fall = 1.0 - CORNER_LOSS * (pixel - half).norm_squared() / half.norm_squared();
        let grey = match nearest {
            None => FAR_GREY * fall,
            Some((t, index)) => {
                let surface = &self.occluders[index];
                let cos = surface.normal.dot(&direction).abs() / direction.norm();
                let from_corner = direction * t + eye - surface.origin;
                let across = surface.normal.cross(&surface.along);
                let place = Vector2::new(from_corner.dot(&surface.along), from_corner.dot(&across))
                    / TEXTURE_MM;
                let texture = 0.7 * lattice_noise(index as u64, place)
                    + 0.3 * lattice_noise(index as u64, place * 3.7);
                surface.grey * (0.6 + 0.4 * cos) * fall + self.texture * texture
            }
        };
        Shade {
            surface: nearest.map(|(_, index)| index),
            grey: grey.max(0.0) * self.level,
        }
    }
}

fn interpolated(corner: &[Shade; 4], column: usize, row: usize) -> f32 {
    let (x, y) = (
        (column as f64 + 0.5) / BLOCK as f64,
        (row as f64 + 0.5) / BLOCK as f64,
    );
    let upper = corner[0].grey + (corner[1].grey - corner[0].grey) * x;
    let lower = corner[2].grey + (corner[3].grey - corner[2].grey) * x;
    (upper + (lower - upper) * y) as f32
}

/// Smooth noise in -1..1 (value noise: random values on a unit lattice, eased between them).
fn lattice_noise(kind: u64, place: Vector2<f64>) -> f64 {
    let cell = place.map(f64::floor);
    let ease = (place - cell).map(|t| t * t * (3.0 - 2.0 * t));
    let value = |dx: f64, dy: f64| {
        let (x, y) = ((cell.x + dx) as i64 as u64, (cell.y + dy) as i64 as u64);
        let mixed = mix(kind ^ mix(x ^ mix(y)));
        (mixed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    let upper = value(0.0, 0.0) + (value(1.0, 0.0) - value(0.0, 0.0)) * ease.x;
    let lower = value(0.0, 1.0) + (value(1.0, 1.0) - value(0.0, 1.0)) * ease.x;
    upper + (lower - upper) * ease.y
}

/// A number that looks random for each number (the finaliser of SplitMix64: Steele, Lea and Flood, 2014).
fn mix(number: u64) -> u64 {
    let z = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
