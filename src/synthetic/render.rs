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

#[cfg(test)]
mod tests {
    use super::super::{Disc, PanelSettings, Surface, Visibility, panel, truth_dots};
    use super::*;
    use crate::camera::{InteriorOrientation, LensDirection};
    use nalgebra::{Vector2, Vector3};
    use proptest::prelude::*;

    fn clean() -> RenderSettings {
        RenderSettings {
            noise_sigma_grey: 0.0,
            background: 0.0,
            ..RenderSettings::default()
        }
    }

    fn camera() -> Camera {
        Camera {
            width_px: 3072,
            height_px: 2048,
            pixel_pitch_mm: 0.009,
            interior: InteriorOrientation {
                principal_distance: 20.0,
                principal_point: [0.1, -0.05],
                radial: [2.5e-4, -4e-7, 2e-10],
                tangential: [4e-5, -6e-5],
                affinity: [5e-4, -2e-4],
                direction: LensDirection::Correcting,
            },
        }
    }

    /// Centroid of the light in a patch, px.
    fn centroid(patch: &Patch) -> Vector2<f64> {
        let (mut sum, mut moment) = (0.0, Vector2::zeros());
        for (index, &cover) in patch.cover.iter().enumerate() {
            let place = Vector2::new(
                (patch.left + (index % patch.width) as i64) as f64 + 0.5,
                (patch.top + (index / patch.width) as i64) as f64 + 0.5,
            );
            sum += f64::from(cover);
            moment += place * f64::from(cover);
        }
        moment / sum
    }

    fn drawn(disc: &Disc, surfaces: &[Surface], camera: &Camera, pose: &Pose) -> Vec<Patch> {
        let scene = Scene {
            discs: vec![disc.clone()],
            surfaces: surfaces.to_vec(),
            ..Scene::default()
        };
        let occluders = occluders(&scene.surfaces);
        let views = views(&scene, camera, pose, &occluders);
        let settings = clean();
        let easel = Easel {
            camera,
            pose,
            settings: &settings,
            occluders: &occluders,
        };
        easel.patches(&scene, &views)
    }

    fn disc(x: f64, y: f64, tilt: f64, turn: f64) -> Disc {
        let (sin, cos) = f64::sin_cos(tilt);
        let flat = Placement {
            origin: Vector3::new(x, y, 0.0),
            x: Vector3::new(cos, 0.0, -sin),
            y: Vector3::y(),
        };
        let upright = Placement {
            x: nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), turn) * flat.x,
            y: nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), turn) * flat.y,
            ..flat
        };
        Disc {
            label: "T1".into(),
            placement: upright,
            radius: 2.5,
            finish: Finish::default(),
        }
    }

    fn above() -> Pose {
        Pose::looking_at(
            Vector3::new(0.0, 0.0, 1000.0),
            Vector3::zeros(),
            Vector3::y(),
            0.3,
        )
    }

    proptest! {
        #[test]
        fn a_drawn_dot_has_the_true_centre_wherever_it_is_and_however_oblique(
            x in -450.0..450.0, y in -250.0..250.0, tilt in -1.1..1.1, turn in 0.0..std::f64::consts::TAU,
        ) {
            let disc = disc(x, y, tilt, turn);
            let scene = Scene { discs: vec![disc.clone()], ..Scene::default() };
            let truth = truth_dots(&scene, &camera(), &above()).remove(0);
            prop_assume!(truth.is_whole() && truth.incidence_deg < 72.0);
            let patch = drawn(&disc, &[], &camera(), &above()).remove(0);
            // The true centre comes from the projected edge, the drawn one from pixels traced back to the plane.
            let miss = (centroid(&patch) - truth.centre_of_image_px.unwrap()).norm();
            // Straight edges in the cells and 64 points on the edge leave some 1e-4 px.
            prop_assert!(miss < 5e-4, "{miss}");
            let light: f64 = patch.cover.iter().map(|&cover| f64::from(cover)).sum();
            let area = std::f64::consts::PI * truth.major_px * truth.minor_px / 4.0;
            prop_assert!((light / area - 1.0).abs() < 2e-3, "{light} {area}");
        }

        #[test]
        fn a_partly_hidden_dot_keeps_its_visible_share_of_light(edge in -2.3..2.3, turn in 0.0..std::f64::consts::TAU) {
            let disc = disc(60.0, -40.0, 0.0, 0.0);
            let eye = above().centre_in_world;
            // A screen half-way to the camera whose edge, seen from there, cuts the dot `edge` mm off its centre.
            let (sin, cos) = f64::sin_cos(turn);
            let beyond = Placement {
                x: Vector3::new(cos, sin, 0.0),
                y: Vector3::new(-sin, cos, 0.0),
                ..Placement::horizontal((disc.placement.origin + eye) / 2.0)
            };
            let screen = Surface::rectangle(&beyond.moved(50.0 + edge / 2.0, 0.0, 0.0), 100.0, 100.0, 10.0);
            let whole: f32 = drawn(&disc, &[], &camera(), &above())[0].cover.iter().sum();
            let part: f32 = drawn(&disc, std::slice::from_ref(&screen), &camera(), &above())[0].cover.iter().sum();
            let scene = Scene { discs: vec![disc], surfaces: vec![screen], ..Scene::default() };
            let truth = truth_dots(&scene, &camera(), &above()).remove(0);
            let Visibility::Part(share) = truth.visibility else {
                return Err(TestCaseError::fail(format!("{:?}", truth.visibility)));
            };
            let s = edge / 2.5;
            let exact = 1.0 - (f64::acos(s) - s * f64::sqrt(1.0 - s * s)) / std::f64::consts::PI;
            // 768 sample points tell the share, cells of an eighth of a pixel the light.
            prop_assert!((share - exact).abs() < 0.02, "{share} {exact}");
            prop_assert!((f64::from(part / whole) - exact).abs() < 0.02, "{} {exact}", part / whole);
        }
    }

    #[test]
    fn a_picture_without_noise_has_its_dots_at_the_true_centres() {
        let settings = PanelSettings {
            codes: 0,
            plain_targets: 30,
            stations: 4,
            dot_mm: 9.0,
            width_px: 1500,
            height_px: 1000,
            pixel_pitch_mm: 0.018,
            ..PanelSettings::default()
        };
        let panel = panel(&settings).unwrap();
        let picture = render(
            &panel.scene,
            &panel.camera,
            &panel.stations[3].pose,
            &clean(),
            1,
        );
        let (mut squares, mut count) = (0.0, 0);
        for dot in picture.truth.iter().filter(|dot| dot.is_whole()) {
            let centre = dot.centre_of_image_px.unwrap();
            let reach = dot.major_px / 2.0 + 6.0;
            assert!(dot.near_px.unwrap() > 12.0, "isolated");
            let (mut sum, mut moment) = (0.0, Vector2::zeros());
            for row in (centre.y - reach) as usize..(centre.y + reach) as usize {
                for column in (centre.x - reach) as usize..(centre.x + reach) as usize {
                    let grey = f64::from(picture.image[row * 1500 + column]);
                    sum += grey;
                    moment += Vector2::new(column as f64 + 0.5, row as f64 + 0.5) * grey;
                }
            }
            squares += (moment / sum - centre).norm_squared();
            count += 2;
        }
        assert!(count >= 50);
        // Rounding to 8 bits moves a centroid by some 0.001 px.
        let rms = f64::sqrt(squares / f64::from(count));
        assert!(rms < 0.0015, "{rms}");
    }

    #[test]
    fn the_same_picture_is_drawn_by_any_number_of_threads() {
        let settings = PanelSettings {
            codes: 8,
            raised: 3,
            plain_targets: 10,
            width_px: 500,
            height_px: 333,
            pixel_pitch_mm: 0.05,
            ..PanelSettings::default()
        };
        let panel = panel(&settings).unwrap();
        let picture = |threads: usize, seed: u64| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            let pose = &panel.stations[1].pose;
            pool.install(|| {
                render(
                    &panel.scene,
                    &panel.camera,
                    pose,
                    &RenderSettings::default(),
                    seed,
                )
            })
        };
        assert_eq!(picture(1, 7), picture(2, 7));
        assert_ne!(
            picture(1, 7).image,
            picture(1, 8).image,
            "noise follows the seed"
        );
    }

    #[test]
    fn a_covered_pixel_has_the_peak_and_the_surroundings_are_dim() {
        let disc = Disc {
            radius: 20.0,
            ..disc(0.0, 0.0, 0.0, 0.0)
        };
        let table = Surface::rectangle(
            &Placement::horizontal(Vector3::zeros()),
            3000.0,
            3000.0,
            15.0,
        );
        let scene = Scene {
            discs: vec![disc],
            surfaces: vec![table],
            ..Scene::default()
        };
        let picture = render(&scene, &camera(), &above(), &RenderSettings::default(), 3);
        let mean = |left: usize, top: usize| {
            let pixels =
                (0..400).map(|k| f64::from(picture.image[(top + k / 20) * 3072 + left + k % 20]));
            pixels.sum::<f64>() / 400.0
        };
        let centre = picture.truth[0].centre_of_image_px.unwrap();
        // The noise of a mean of 400 pixels is 0.1 grey values.
        assert!((mean(centre.x as usize - 10, centre.y as usize - 10) - 150.0).abs() < 0.5);
        let around = mean(300, 300);
        assert!((6.0..20.0).contains(&around), "{around}");
    }
}
