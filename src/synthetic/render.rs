//! The picture that a camera with a ring flash takes of a scene.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::background::{BLOCK, Background};
use super::noise::{for_each_normal, generator};
use super::patch::{Blocking, Patch, PlaneView, Shape, draw};
use super::surface::{Occluder, occluders};
use super::truth::{View, outline_of, views};
use super::{Finish, Placement, Scene, TruthDot};
use crate::camera::Camera;
use crate::geometry::Pose;

/// Light, lens and sensor of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RenderSettings {
    /// Grey value of a fully covered pixel of a mark of brightness 1 at normal incidence, of 255; 150 leaves room below
    /// saturation, as a well exposed retro-reflective picture has.
    pub peak_grey: f64,
    /// Sigma of the Gaussian blur of lens and sensor, px; 0.8 is a good lens stopped down.
    pub blur_sigma_px: f64,
    /// Sigma of the pixel noise, grey values; 2 is an 8-bit camera of good light.
    pub noise_sigma_grey: f64,
    /// Factor on the grey values of the surroundings; 0 is a black picture.
    pub background: f64,
    /// Amplitude of the surfaces' faint texture, grey values.
    pub texture_grey: f64,
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self {
            peak_grey: 150.0,
            blur_sigma_px: 0.8,
            noise_sigma_grey: 2.0,
            background: 1.0,
            texture_grey: 1.5,
        }
    }
}

/// A picture with its truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Grey values, row by row.
    pub image: Vec<u8>,
    /// Every dot of the scene, in its order.
    pub truth: Vec<TruthDot>,
}

/// Draws what the camera sees of the scene; `seed` is that of the pixel noise.
#[must_use]
pub fn render(
    scene: &Scene,
    camera: &Camera,
    pose: &Pose,
    settings: &RenderSettings,
    seed: u64,
) -> Rendered {
    let occluders = occluders(&scene.surfaces);
    let views = views(scene, camera, pose, &occluders);
    let easel = Easel {
        camera,
        pose,
        settings,
        occluders: &occluders,
    };
    let patches = easel.patches(scene, &views);
    let width = camera.width_px as usize;
    let mut image = vec![0_u8; width * camera.height_px as usize];
    if width > 0 {
        image
            .par_chunks_mut(width * BLOCK)
            .enumerate()
            .for_each(|(band, pixels)| {
                easel.paint_band(band * BLOCK, pixels, &patches, seed);
            });
    }
    Rendered {
        width_px: camera.width_px,
        height_px: camera.height_px,
        image,
        truth: views.into_iter().map(|view| view.truth).collect(),
    }
}

struct Easel<'a> {
    camera: &'a Camera,
    pose: &'a Pose,
    settings: &'a RenderSettings,
    occluders: &'a [Occluder],
}

impl Easel<'_> {
    /// The drawn marks: dots, then rings.
    fn patches(&self, scene: &Scene, views: &[View]) -> Vec<Patch> {
        let dots: Vec<Option<Patch>> = scene
            .discs
            .par_iter()
            .zip(views)
            .filter(|(_, view)| view.truth.is_seen())
            .map(|(disc, view)| {
                let shape = Shape::Disc(disc.radius);
                self.patch(
                    &shape,
                    &disc.placement,
                    disc.radius,
                    disc.finish,
                    view.truth.is_whole(),
                )
            })
            .collect();
        let rings: Vec<Option<Patch>> = scene
            .rings
            .par_iter()
            .filter(|ring| self.cos_incidence(&ring.placement) > 0.0)
            .map(|ring| {
                let radius = 3.0 * ring.dot_radius;
                let free = self.stands_free(&ring.placement, radius);
                self.patch(
                    &Shape::Ring(ring),
                    &ring.placement,
                    radius,
                    ring.finish,
                    free,
                )
            })
            .collect();
        dots.into_iter().chain(rings).flatten().collect()
    }

    fn patch(
        &self,
        shape: &Shape<'_>,
        placement: &Placement,
        radius: f64,
        finish: Finish,
        free: bool,
    ) -> Option<Patch> {
        let outline = outline_of(placement, radius, self.camera, self.pose)?;
        let blocking = Blocking {
            occluders: self.occluders,
            eye: self.pose.centre_in_world,
            placement: *placement,
        };
        let grey = self.settings.peak_grey * finish.returned(self.cos_incidence(placement));
        let view = PlaneView::new(self.camera, self.pose, placement);
        let blocking = (!free).then_some(&blocking);
        draw(
            shape,
            &view,
            &outline,
            blocking,
            self.settings.blur_sigma_px,
            grey as f32,
        )
    }

    fn cos_incidence(&self, placement: &Placement) -> f64 {
        let to_camera = self.pose.centre_in_world - placement.origin;
        placement.normal().dot(&to_camera) / to_camera.norm()
    }

    /// Whether nothing stands before any of a circle's edge.
    fn stands_free(&self, placement: &Placement, radius: f64) -> bool {
        let eye = &self.pose.centre_in_world;
        (0..64).all(|k| {
            let (sin, cos) = (f64::from(k) / 64.0 * std::f64::consts::TAU).sin_cos();
            let point = placement.point(radius * cos, radius * sin);
            !self.occluders.iter().any(|o| o.hides(&point, eye))
        })
    }

    /// Paints up to [`BLOCK`] rows from `top`: surroundings, marks, noise, 8 bits.
    fn paint_band(&self, top: usize, pixels: &mut [u8], patches: &[Patch], seed: u64) {
        let width = self.camera.width_px as usize;
        let mut light = vec![0.0_f32; pixels.len()];
        let background = Background {
            camera: self.camera,
            pose: self.pose,
            occluders: self.occluders,
            texture: self.settings.texture_grey,
            level: self.settings.background,
        };
        background.fill(top, &mut light);
        for patch in patches {
            lay_over(&mut light, top, width, patch);
        }
        let sigma = self.settings.noise_sigma_grey as f32;
        for (row, (grey, out)) in light
            .chunks(width)
            .zip(pixels.chunks_mut(width))
            .enumerate()
        {
            // A stream for every row, so that bands may be painted in any order.
            let mut noise = generator(seed, (top + row) as u64);
            for_each_normal(&mut noise, width, |column, deviate| {
                // The cast rounds towards zero and clips to 0..=255.
                out[column] = (grey[column] + sigma * deviate + 0.5) as u8;
            });
        }
    }
}

/// Lays the rows of a patch that fall into a band over its light: a mark hides the surroundings by its cover.
fn lay_over(light: &mut [f32], top: usize, width: usize, patch: &Patch) {
    let rows = (light.len() / width) as i64;
    let first = (patch.top - top as i64).max(0);
    let last = (patch.top + patch.height() as i64 - top as i64).min(rows);
    let (left, right) = (
        patch.left.max(0),
        (patch.left + patch.width as i64).min(width as i64),
    );
    if left >= right {
        return;
    }
    for row in first..last {
        let inside = (row + top as i64 - patch.top) as usize * patch.width;
        let from = inside + (left - patch.left) as usize;
        let cover = &patch.cover[from..from + (right - left) as usize];
        let begin = row as usize * width + left as usize;
        for (grey, &share) in light[begin..].iter_mut().zip(cover) {
            *grey += share * (patch.grey - *grey).max(0.0);
        }
    }
}
