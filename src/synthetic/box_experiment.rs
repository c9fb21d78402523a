//! The experiment of Hattori, Akimoto, Fraser and Imoto (2002): an iron box on a table, 34 stations round it.

use nalgebra::{Vector2, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::noise::{generator, normal};
use super::placing::{Face, TargetSize, check_size, draw_ids, shared_out};
use super::stations::{Framing, NominalCamera, camera_with_errors, outlooks_round};
use super::{
    Experiment, LabelledPoint, Placement, ScaleBar, Scene, SceneError, Surface, default_cross,
};
use crate::targets::Family;

/// Width, depth and height of the box, mm (Hattori et al., 2002, figure 8).
const BOX_MM: [f64; 3] = [600.0, 400.0, 300.0];
/// Nominal length of a scale bar, mm.
const BAR_MM: f64 = 1000.0;
/// Sigma of the true lengths about the nominal one, mm: bars are not made to their calibration's accuracy.
const BAR_SPREAD_MM: f64 = 0.08;
/// Sigma of the published lengths about the true ones, mm.
const BAR_SIGMA_MM: f64 = 0.005;
/// Distance of a bar from the box, mm.
const BAR_GAP_MM: f64 = 75.0;
/// Tilt of the bars' faces away from the box, degrees: seen from their own side and from above.
const BAR_TILT_DEG: f64 = 25.0;
/// Height of the cross's frame above the top of the box, mm.
const CROSS_LIFT_MM: f64 = 6.0;
/// Share of the plain targets that stand close to a code.
const BESIDE_CODES: f64 = 0.45;
/// Elevations (degrees) of the rings of stations and their shares.
const RINGS: [(f64, f64); 3] = [(18.0, 14.0), (34.0, 12.0), (56.0, 6.0)];

/// How much the stations crowd before the box's ends, whose targets are seen most obliquely.
const CROWDING: f64 = 0.11;

/// The reference cross of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CrossPlan {
    /// Its dots in its own frame, mm.
    pub points: Vec<LabelledPoint>,
    /// Diameter of its dots, mm.
    pub dot_mm: f64,
}

impl Default for CrossPlan {
    fn default() -> Self {
        Self {
            points: default_cross(),
            dot_mm: 5.0,
        }
    }
}

/// What the box experiment consists of; the default is the paper's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BoxSettings {
    /// Chooses codes, places, stations, lens errors and lengths.
    pub seed: u64,
    /// Camera stations; the first two are the nadir ones.
    pub stations: usize,
    /// Plain targets on the box.
    pub plain_targets: usize,
    /// `dot420` codes on the box; those of the bars come on top.
    pub codes: usize,
    /// The reference cross on top of the box, if any.
    pub cross: Option<CrossPlan>,
    /// Scale bars of 1 m, at most two: along the front and along the right side of the box.
    pub bars: usize,
    /// Diameter of all dots of codes and plain targets, mm.
    pub dot_mm: f64,
    /// Pitch of the codes, mm.
    pub pitch_mm: f64,
    /// Columns of the pictures.
    pub width_px: u32,
    /// Rows of the pictures.
    pub height_px: u32,
    /// Side of a pixel, mm; for smaller pictures make it larger, so that the camera sees the same field.
    pub pixel_pitch_mm: f64,
    /// Principal distance that the lens is sold with, mm.
    pub principal_distance_mm: f64,
}

impl Default for BoxSettings {
    fn default() -> Self {
        Self {
            seed: 2002,
            stations: 34,
            plain_targets: 144,
            codes: 32,
            cross: Some(CrossPlan::default()),
            bars: 2,
            dot_mm: 5.0,
            pitch_mm: 5.0,
            width_px: 3072,
            height_px: 2048,
            pixel_pitch_mm: 0.009,
            principal_distance_mm: 20.0,
        }
    }
}

/// Builds the box on its table (z = 0, the box's base centred on the origin), camera and stations.
///
/// # Errors
/// [`SceneError`] where the targets find no room, the family has too few codes, or a size is not positive.
pub fn box_experiment(settings: &BoxSettings) -> Result<Experiment, SceneError> {
    for (what, value) in [
        ("dot_mm", settings.dot_mm),
        ("pitch_mm", settings.pitch_mm),
        ("width_px", f64::from(settings.width_px)),
        ("height_px", f64::from(settings.height_px)),
        ("pixel_pitch_mm", settings.pixel_pitch_mm),
        ("principal_distance_mm", settings.principal_distance_mm),
    ] {
        check_size(what, value)?;
    }
    if let Some(cross) = &settings.cross {
        check_size("the cross's dot_mm", cross.dot_mm)?;
    }
    let mut random = generator(settings.seed, 0);
    let bars = settings.bars.min(2);
    let ids = draw_ids(
        settings.codes + 2 * bars,
        Family::Dot420.code_count(),
        &mut random,
    )?;
    let (box_ids, bar_ids) = ids.split_at(settings.codes);
    let mut scene = Scene::default();
    add_surfaces(&mut scene);
    let mut faces = faces(settings);
    if let Some(cross) = &settings.cross {
        stand_cross(cross, &mut scene, &mut faces[0], &mut random);
    }
    fill_faces(settings, box_ids, &mut faces, &mut scene, &mut random)?;
    let on_box = scene.discs.len();
    for (number, ids) in bar_ids.chunks_exact(2).enumerate() {
        add_bar(number, [ids[0], ids[1]], settings, &mut scene, &mut random);
    }
    let nominal = NominalCamera {
        width_px: settings.width_px,
        height_px: settings.height_px,
        pixel_pitch_mm: settings.pixel_pitch_mm,
        principal_distance_mm: settings.principal_distance_mm,
    };
    let camera = camera_with_errors(&nominal, &mut random);
    let [w, d, h] = BOX_MM;
    let corner = |k: usize| {
        Vector3::new(
            w * ((k & 1) as f64 - 0.5),
            d * ((k >> 1 & 1) as f64 - 0.5),
            h * (k >> 2) as f64,
        )
    };
    let corners: Vec<_> = (0..8).map(corner).collect();
    let bar_ends: Vec<_> = scene.discs[on_box..]
        .iter()
        .map(|disc| disc.placement.origin)
        .collect();
    let framing = Framing {
        camera: &camera,
        target: Vector3::new(0.0, 0.0, h / 2.0),
        always: &corners,
        upright: &bar_ends,
        aim_sigma: 12.0,
    };
    let outlooks = outlooks_round(settings.stations, &RINGS, CROWDING, &mut random);
    let stations = framing.stations(&outlooks, &mut random)?;
    Ok(Experiment {
        scene,
        camera,
        nominal_principal_distance_mm: settings.principal_distance_mm,
        stations,
    })
}

/// The centres and axes of the top and the four sides, with their sizes; normals point outwards.
fn box_faces() -> [(Placement, f64, f64); 5] {
    let [w, d, h] = BOX_MM;
    let side = |origin: Vector3<f64>, x: Vector3<f64>| Placement {
        origin,
        x,
        y: Vector3::z(),
    };
    let middle = h / 2.0;
    [
        (Placement::horizontal(Vector3::new(0.0, 0.0, h)), w, d),
        (
            side(Vector3::new(0.0, -d / 2.0, middle), Vector3::x()),
            w,
            h,
        ),
        (
            side(Vector3::new(0.0, d / 2.0, middle), -Vector3::x()),
            w,
            h,
        ),
        (side(Vector3::new(w / 2.0, 0.0, middle), Vector3::y()), d, h),
        (
            side(Vector3::new(-w / 2.0, 0.0, middle), -Vector3::y()),
            d,
            h,
        ),
    ]
}

fn add_surfaces(scene: &mut Scene) {
    const TABLE_GREY: f64 = 10.0;
    const TABLE_MM: f64 = 2400.0;
    let greys = [18.0, 16.0, 14.0, 17.0, 15.0];
    for ((placement, width, height), grey) in box_faces().into_iter().zip(greys) {
        scene
            .surfaces
            .push(Surface::rectangle(&placement, width, height, grey));
    }
    let table = Placement::horizontal(Vector3::zeros());
    scene
        .surfaces
        .push(Surface::rectangle(&table, TABLE_MM, TABLE_MM, TABLE_GREY));
}

fn faces(settings: &BoxSettings) -> [Face; 5] {
    let size = TargetSize {
        pitch: settings.pitch_mm,
        dot: settings.dot_mm,
    };
    box_faces().map(|(placement, width, height)| Face::new(placement, width, height, size))
}

fn stand_cross(cross: &CrossPlan, scene: &mut Scene, top: &mut Face, random: &mut ChaCha8Rng) {
    let reach = cross
        .points
        .iter()
        .map(|p| p.point[0].hypot(p.point[1]))
        .fold(0.0, f64::max);
    let off = Vector2::new(
        random.random_range(-60.0..60.0),
        random.random_range(-30.0..30.0),
    );
    let frame = box_faces()[0]
        .0
        .moved(off.x, off.y, CROSS_LIFT_MM)
        .turned(random.random_range(0.0..std::f64::consts::TAU));
    scene.add_cross(&cross.points, &frame, cross.dot_mm);
    top.keep_free(off, reach + 3.0 * cross.dot_mm);
}

fn fill_faces(
    settings: &BoxSettings,
    ids: &[u32],
    faces: &mut [Face],
    scene: &mut Scene,
    random: &mut ChaCha8Rng,
) -> Result<(), SceneError> {
    let areas: Vec<f64> = faces.iter().map(Face::area).collect();
    let mut rest = ids;
    for (face, share) in faces.iter_mut().zip(shared_out(ids.len(), &areas)) {
        let (own, others) = rest.split_at(share);
        face.place_dot420(own, scene, random)?;
        rest = others;
    }
    let mut number = 0;
    for (face, share) in faces
        .iter_mut()
        .zip(shared_out(settings.plain_targets, &areas))
    {
        let beside = (BESIDE_CODES * share as f64).round() as usize;
        for placement in face.plain_places(share, beside, random)? {
            number += 1;
            scene.add_disc(format!("T{number}"), placement, settings.dot_mm);
        }
    }
    Ok(())
}

/// Lays a bar on the table, its face tilted away from the box: 0 in front of it (along x), 1 to its right (along y).
fn add_bar(
    number: usize,
    ids: [u32; 2],
    settings: &BoxSettings,
    scene: &mut Scene,
    random: &mut ChaCha8Rng,
) {
    const BAR_GREY: f64 = 19.0;
    let [w, d, _] = BOX_MM;
    let pitch = settings.pitch_mm;
    let width = 6.0 * pitch + 3.0 * settings.dot_mm;
    let (sin, cos) = BAR_TILT_DEG.to_radians().sin_cos();
    // The front bar is pushed to the left so that it ends before the one on the right.
    let (out, along, shift) = if number == 0 {
        (-Vector3::y() * (d / 2.0), Vector3::x(), -140.0)
    } else {
        (Vector3::x() * (w / 2.0), Vector3::y(), 0.0)
    };
    let outwards = out.normalize();
    let placement = Placement {
        origin: out
            + outwards * (BAR_GAP_MM + width / 2.0)
            + along * shift
            + Vector3::z() * (width / 2.0 * sin + 2.0),
        x: along,
        y: Vector3::z() * sin - outwards * cos,
    };
    let length = BAR_MM + BAR_SPREAD_MM * normal(random);
    let known = length + BAR_SIGMA_MM * normal(random);
    // The second code is turned by half a turn, so both O stand at the outer ends, diagonally across the bar.
    let half = ((length / 2.0).powi(2) - (3.0 * pitch).powi(2)).sqrt();
    let ends = [
        placement.moved(-half, -3.0 * pitch, 0.0),
        placement
            .moved(half, 3.0 * pitch, 0.0)
            .turned(std::f64::consts::PI),
    ];
    for (id, end) in ids.iter().zip(&ends) {
        scene.add_dot420(*id, end, pitch, settings.dot_mm);
    }
    let surface = Surface::rectangle(
        &placement,
        2.0 * half + 4.0 * settings.dot_mm,
        width,
        BAR_GREY,
    );
    scene.surfaces.push(surface);
    let label = |id: u32| format!("{}.O", Family::Dot420.code_label(id));
    scene.bars.push(ScaleBar {
        name: format!("bar{}", number + 1),
        from: label(ids[0]),
        to: label(ids[1]),
        true_length_mm: length,
        known_length_mm: known,
        sigma_mm: BAR_SIGMA_MM,
    });
}

#[cfg(test)]
mod tests {
    use super::super::{MAX_OBSERVED_INCIDENCE_DEG, Truth, Visibility};
    use super::*;
    use std::collections::BTreeMap;

    fn seeded(seed: u64) -> Experiment {
        let settings = BoxSettings {
            seed,
            ..BoxSettings::default()
        };
        box_experiment(&settings).unwrap()
    }

    /// In how many pictures each dot is whole and bright enough.
    fn rays(truth: &Truth) -> BTreeMap<&str, usize> {
        let mut rays = BTreeMap::new();
        for dot in truth.images.values().flatten() {
            let seen = dot.is_whole() && dot.incidence_deg <= MAX_OBSERVED_INCIDENCE_DEG;
            *rays.entry(dot.label.as_str()).or_default() += usize::from(seen);
        }
        rays
    }

    #[test]
    fn the_box_carries_what_the_paper_names() {
        let experiment = seeded(2002);
        let count = |prefix: char| {
            let labels = experiment.scene.discs.iter().map(|disc| &disc.label);
            labels.filter(|label| label.starts_with(prefix)).count()
        };
        assert_eq!([count('T'), count('C'), count('X')], [144, 6 * (32 + 4), 6]);
        assert_eq!(experiment.stations.len(), 34);
        assert_eq!(experiment.cross_points().len(), 6);
        let truth = experiment.truth();
        assert_eq!(
            truth.points.len(),
            experiment.scene.discs.len(),
            "labels differ"
        );
        for (bar, published) in truth.bars.iter().zip(experiment.bars()) {
            let end = |label: &String| Vector3::from(truth.points[label]);
            let distance = (end(&bar.from) - end(&bar.to)).norm();
            assert!((distance - bar.length_mm).abs() < 1e-9);
            assert!((published.length_mm - bar.length_mm).abs() < 5.0 * BAR_SIGMA_MM);
        }
    }

    #[test]
    fn no_dots_touch_and_many_codes_have_close_neighbours() {
        for seed in [2002, 1] {
            let discs = seeded(seed).scene.discs;
            let mut crowded = BTreeMap::new();
            for (index, a) in discs.iter().enumerate() {
                for b in &discs[..index] {
                    let distance = (a.placement.origin - b.placement.origin).norm();
                    let code = |label: &str| label.split('.').next().unwrap_or("").to_owned();
                    let least = if code(&a.label) == code(&b.label) {
                        10.0
                    } else {
                        15.0
                    };
                    assert!(
                        distance > least - 1e-9,
                        "{} {} {distance}",
                        a.label,
                        b.label
                    );
                    let mixed = a.label.starts_with('T') && b.label.starts_with('C');
                    if mixed && distance < 20.0 {
                        *crowded.entry(code(&b.label)).or_insert(0) += 1;
                    } else if a.label.starts_with('C')
                        && b.label.starts_with('T')
                        && distance < 20.0
                    {
                        *crowded.entry(code(&a.label)).or_insert(0) += 1;
                    }
                }
            }
            assert!(crowded.len() >= 20, "{}", crowded.len());
        }
    }

    #[test]
    fn every_station_sees_codes_and_every_target_is_seen_often() {
        for seed in [2002, 1] {
            let truth = seeded(seed).truth();
            let rays = rays(&truth);
            for (label, &count) in &rays {
                let least = if label.starts_with('X') { 8 } else { 4 };
                assert!(count >= least, "seed {seed}: {label} in {count} pictures");
            }
            for (image, dots) in &truth.images {
                let mut whole = BTreeMap::<&str, usize>::new();
                for dot in dots
                    .iter()
                    .filter(|dot| dot.is_whole() && dot.incidence_deg <= MAX_OBSERVED_INCIDENCE_DEG)
                {
                    if let Some((code, _)) = dot.label.split_once('.') {
                        *whole.entry(code).or_default() += 1;
                    }
                }
                let codes = whole.values().filter(|&&dots| dots == 6).count();
                assert!(codes >= 4, "seed {seed}: {image} shows {codes} codes");
            }
        }
    }

    #[test]
    fn a_face_turned_away_or_behind_the_box_is_not_seen() {
        let experiment = seeded(2002);
        let truth = experiment.truth();
        for station in &experiment.stations {
            for (dot, disc) in truth.images[&station.image]
                .iter()
                .zip(&experiment.scene.discs)
            {
                let place = disc.placement.origin;
                let eye = station.pose.centre_in_world;
                let on_side = disc.label.starts_with('T') && (place.z - BOX_MM[2]).abs() > 1e-9;
                if on_side && disc.placement.normal().dot(&(eye - place)) < 0.0 {
                    assert_eq!(dot.visibility, Visibility::FacingAway, "{}", dot.label);
                }
            }
        }
        let hidden = truth.images.values().flatten();
        let hidden = hidden.filter(|dot| dot.visibility == Visibility::Hidden);
        assert!(
            hidden.clone().count() > 0,
            "the box hides bar ends from stations behind it"
        );
        // Nothing stands before a face of the box that is turned to the camera but the plates of the cross.
        let mut side = hidden.filter(|dot| dot.label.starts_with('T'));
        assert!(side.all(|dot| truth.points[&dot.label][2] > BOX_MM[2] - 1e-9));
    }

    #[test]
    fn seeds_choose_everything_and_repeat_it() {
        assert_eq!(seeded(5), seeded(5));
        let (one, other) = (seeded(5), seeded(6));
        assert_ne!(one.stations, other.stations);
        assert_ne!(one.camera, other.camera);
        assert_ne!(one.scene.bars, other.scene.bars);
    }

    #[test]
    fn small_scenes_can_be_made_and_impossible_ones_are_refused() {
        let small = BoxSettings {
            stations: 5,
            plain_targets: 20,
            codes: 10,
            cross: None,
            bars: 0,
            dot_mm: 8.0,
            pitch_mm: 8.0,
            width_px: 1024,
            height_px: 683,
            pixel_pitch_mm: 0.027,
            ..BoxSettings::default()
        };
        let experiment = box_experiment(&small).unwrap();
        assert_eq!(experiment.scene.discs.len(), 80);
        let full = BoxSettings {
            plain_targets: 5000,
            ..small.clone()
        };
        assert!(matches!(
            box_experiment(&full),
            Err(SceneError::NoRoom { .. })
        ));
        let flat = BoxSettings {
            dot_mm: 0.0,
            ..small
        };
        assert!(matches!(
            box_experiment(&flat),
            Err(SceneError::BadSize { .. })
        ));
    }

    #[test]
    fn truth_survives_writing_and_reading() {
        let settings = BoxSettings {
            stations: 2,
            ..BoxSettings::default()
        };
        let truth = box_experiment(&settings).unwrap().truth();
        let text = serde_json::to_string(&truth).unwrap();
        assert_eq!(serde_json::from_str::<Truth>(&text).unwrap(), truth);
    }
}
