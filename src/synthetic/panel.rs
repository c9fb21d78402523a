//! A flat panel of codes and plain targets, some of them raised.

use nalgebra::Vector3;
use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::noise::generator;
use super::placing::{Face, TargetSize, check_size, draw_ids};
use super::stations::{Framing, NominalCamera, camera_with_errors, outlooks_round};
use super::{Experiment, Placement, Scene, SceneError, Surface};
use crate::targets::Family;

/// Elevations (degrees) of the rings of stations above the panel and their shares.
const RINGS: [(f64, f64); 2] = [(42.0, 1.0), (62.0, 1.0)];
/// Heights of raised targets above the panel, mm.
const RAISED_MM: std::ops::Range<f64> = 20.0..60.0;

/// What the panel consists of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PanelSettings {
    /// Chooses codes, places, heights, stations and lens errors.
    pub seed: u64,
    /// Family of the codes.
    pub family: Family,
    /// Codes; `dot420` codes are not raised.
    pub codes: usize,
    /// How many of the ring codes stand on posts.
    pub raised: usize,
    /// Plain targets.
    pub plain_targets: usize,
    /// Camera stations.
    pub stations: usize,
    /// Width of the panel, mm.
    pub width_mm: f64,
    /// Height of the panel, mm.
    pub height_mm: f64,
    /// Diameter of all dots, mm; a ring code is three times as wide.
    pub dot_mm: f64,
    /// Pitch of `dot420` codes, mm.
    pub pitch_mm: f64,
    /// Columns of the pictures.
    pub width_px: u32,
    /// Rows of the pictures.
    pub height_px: u32,
    /// Side of a pixel, mm.
    pub pixel_pitch_mm: f64,
    /// Principal distance that the lens is sold with, mm.
    pub principal_distance_mm: f64,
}

impl Default for PanelSettings {
    fn default() -> Self {
        Self {
            seed: 14,
            family: Family::Ring(14),
            codes: 24,
            raised: 5,
            plain_targets: 40,
            stations: 10,
            width_mm: 600.0,
            height_mm: 400.0,
            dot_mm: 5.0,
            pitch_mm: 5.0,
            width_px: 3072,
            height_px: 2048,
            pixel_pitch_mm: 0.009,
            principal_distance_mm: 20.0,
        }
    }
}

/// Builds the panel (z = 0, facing up, centred on the origin), camera and stations.
///
/// # Errors
/// [`SceneError`] where the targets find no room, the family has too few codes, or a size is not positive.
pub fn panel(settings: &PanelSettings) -> Result<Experiment, SceneError> {
    for (what, value) in [
        ("width_mm", settings.width_mm),
        ("height_mm", settings.height_mm),
        ("dot_mm", settings.dot_mm),
        ("pitch_mm", settings.pitch_mm),
        ("width_px", f64::from(settings.width_px)),
        ("height_px", f64::from(settings.height_px)),
        ("pixel_pitch_mm", settings.pixel_pitch_mm),
        ("principal_distance_mm", settings.principal_distance_mm),
    ] {
        check_size(what, value)?;
    }
    let mut random = generator(settings.seed, 0);
    let base = Placement::horizontal(Vector3::zeros());
    let (w, h) = (settings.width_mm, settings.height_mm);
    let mut scene = Scene::default();
    scene.surfaces.push(Surface::rectangle(&base, w, h, 14.0));
    let size = TargetSize {
        pitch: settings.pitch_mm,
        dot: settings.dot_mm,
    };
    let mut face = Face::new(base, w, h, size);
    let ids = draw_ids(settings.codes, settings.family.code_count(), &mut random)?;
    match settings.family {
        Family::Dot420 => face.place_dot420(&ids, &mut scene, &mut random)?,
        Family::Ring(segments) => {
            for (index, place) in face
                .ring_places(ids.len(), &mut random)?
                .into_iter()
                .enumerate()
            {
                let mut placed = place;
                if index < settings.raised {
                    placed = place.moved(0.0, 0.0, random.random_range(RAISED_MM));
                    scene
                        .surfaces
                        .push(Surface::plate(&placed, 2.0 * settings.dot_mm, 15.0));
                }
                scene.add_ring(segments, ids[index], placed, settings.dot_mm);
            }
        }
    }
    let places = face.plain_places(
        settings.plain_targets,
        settings.plain_targets / 3,
        &mut random,
    )?;
    for (number, placement) in (1..).zip(places) {
        scene.add_disc(format!("T{number}"), placement, settings.dot_mm);
    }
    let nominal = NominalCamera {
        width_px: settings.width_px,
        height_px: settings.height_px,
        pixel_pitch_mm: settings.pixel_pitch_mm,
        principal_distance_mm: settings.principal_distance_mm,
    };
    let camera = camera_with_errors(&nominal, &mut random);
    let corners =
        [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]].map(|[u, v]| base.point(u * w, v * h));
    let framing = Framing {
        camera: &camera,
        target: Vector3::zeros(),
        always: &corners,
        upright: &[],
        aim_sigma: 0.01 * w,
    };
    let outlooks = outlooks_round(settings.stations, &RINGS, 0.0, &mut random);
    let stations = framing.stations(&outlooks, &mut random)?;
    Ok(Experiment {
        scene,
        camera,
        nominal_principal_distance_mm: settings.principal_distance_mm,
        stations,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panel_of_each_family_shows_its_codes_in_every_picture() {
        for family in Family::ALL {
            let settings = PanelSettings {
                family,
                ..PanelSettings::default()
            };
            let panel = panel(&settings).unwrap();
            let dots = if family == Family::Dot420 { 6 } else { 1 };
            assert_eq!(panel.scene.discs.len(), 24 * dots + 40, "{family}");
            let raised = panel
                .scene
                .discs
                .iter()
                .filter(|d| d.placement.origin.z > 1.0);
            assert_eq!(raised.count(), if dots == 1 { 5 } else { 0 });
            for (image, dots) in panel.truth().images {
                let whole = dots.iter().filter(|dot| dot.is_whole()).count();
                assert!(
                    whole > dots.len() * 9 / 10,
                    "{image}: {whole} of {}",
                    dots.len()
                );
            }
        }
    }
}
