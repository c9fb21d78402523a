//! Lenses with realistic errors and stations round an object.

use nalgebra::{Rotation3, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::noise::normal;
use super::{SceneError, Station};
use crate::camera::{Camera, InteriorOrientation, LensDirection};
use crate::geometry::Pose;

/// Frame and lens as their makers state them.
#[derive(Clone, Copy)]
pub(super) struct NominalCamera {
    pub(super) width_px: u32,
    pub(super) height_px: u32,
    pub(super) pixel_pitch_mm: f64,
    pub(super) principal_distance_mm: f64,
}

/// Half the diagonal of the 3072 x 2048 sensor of 9 um that the distortion below belongs to, mm.
const REFERENCE_HALF_DIAGONAL_MM: f64 = 16.6;

/// A camera of that kind with the errors of a good wide-angle lens: some 50 px of distortion in the corners of the
/// frame, a principal point off by some 0.15 mm. Scaled to the frame's size.
pub(super) fn camera_with_errors(nominal: &NominalCamera, random: &mut ChaCha8Rng) -> Camera {
    let pitch = nominal.pixel_pitch_mm;
    let diagonal = f64::from(nominal.width_px).hypot(f64::from(nominal.height_px)) * pitch;
    let size = diagonal / 2.0 / REFERENCE_HALF_DIAGONAL_MM;
    let mut about =
        |value: f64, spread: f64| value * (1.0 + spread * random.random_range(-1.0..1.0));
    let interior = InteriorOrientation {
        principal_distance: nominal.principal_distance_mm * about(1.006, 0.002),
        principal_point: [about(0.13, 0.3) * size, about(-0.11, 0.3) * size],
        radial: [
            about(1.1e-4, 0.15) / size.powi(2),
            about(-1.6e-7, 0.2) / size.powi(4),
            about(1.2e-10, 0.2) / size.powi(6),
        ],
        tangential: [about(1.2e-5, 0.4) / size, about(-0.8e-5, 0.4) / size],
        affinity: [about(1.2e-4, 0.4), about(-0.6e-4, 0.4)],
        direction: LensDirection::Correcting,
    };
    Camera {
        width_px: nominal.width_px,
        height_px: nominal.height_px,
        pixel_pitch_mm: pitch,
        interior,
    }
}

/// Where a station looks from: directions in degrees, the distance follows from the frame.
#[derive(Clone, Copy)]
pub(super) struct Outlook {
    pub(super) azimuth_deg: f64,
    pub(super) elevation_deg: f64,
    /// Quarter turns of the camera, counter-clockwise.
    pub(super) quarter_turns: u32,
}

/// `count` outlooks: two steep ones from opposite sides (when there are at least four), the others in rings of rising
/// elevation, each with jitter and with rolls that go round in quarter turns. `crowding` (0 to 0.4, 0: even) draws
/// them together towards +x and -x, where a long object's faces stand farthest out and are seen most obliquely.
pub(super) fn outlooks_round(
    count: usize,
    rings: &[(f64, f64)],
    crowding: f64,
    random: &mut ChaCha8Rng,
) -> Vec<Outlook> {
    let nadirs = if count >= 4 { 2 } else { 0 };
    let mut outlooks: Vec<Outlook> = (0..nadirs)
        .map(|k| Outlook {
            azimuth_deg: 180.0 * f64::from(k) + random.random_range(-20.0..20.0),
            elevation_deg: random.random_range(80.0..84.0),
            quarter_turns: k,
        })
        .collect();
    let weights: Vec<f64> = rings.iter().map(|(_, weight)| *weight).collect();
    let shares = super::placing::shared_out(count - nadirs as usize, &weights);
    let turn = random.random_range(0.0..360.0);
    for (ring, (&(elevation, _), &share)) in rings.iter().zip(&shares).enumerate() {
        for k in 0..share {
            let step = 360.0 / share as f64;
            let even = turn
                + step * (k as f64 + 0.37 * ring as f64)
                + random.random_range(-0.15..0.15) * step;
            let crowded = even.to_radians() - crowding * (2.0 * even.to_radians()).sin();
            outlooks.push(Outlook {
                azimuth_deg: crowded.to_degrees(),
                elevation_deg: elevation + random.random_range(-4.0..4.0),
                quarter_turns: (k + ring) as u32 % 4,
            });
        }
    }
    outlooks
}

/// The stations that fill the frame with the object.
pub(super) struct Framing<'a> {
    pub(super) camera: &'a Camera,
    /// What the cameras look at, mm.
    pub(super) target: Vector3<f64>,
    /// Points that have to lie in the frame at every station.
    pub(super) always: &'a [Vector3<f64>],
    /// Points that have to lie in the frame where the camera is held upright.
    pub(super) upright: &'a [Vector3<f64>],
    /// Sigma by which each camera misses its target, mm.
    pub(super) aim_sigma: f64,
}

impl Framing<'_> {
    pub(super) fn stations(
        &self,
        outlooks: &[Outlook],
        random: &mut ChaCha8Rng,
    ) -> Result<Vec<Station>, SceneError> {
        outlooks
            .iter()
            .enumerate()
            .map(|(index, outlook)| {
                Ok(Station {
                    image: format!("image{:02}.png", index + 1),
                    pose: self.pose(outlook, random)?,
                })
            })
            .collect()
    }

    /// The nearest pose from which all wanted points lie in the frame, a few per cent to spare.
    fn pose(&self, outlook: &Outlook, random: &mut ChaCha8Rng) -> Result<Pose, SceneError> {
        const NEAREST_MM: f64 = 50.0;
        const FARTHEST_MM: f64 = 100_000.0;
        let miss = Vector3::new(normal(random), normal(random), normal(random)) * self.aim_sigma;
        let spare = random.random_range(1.02..1.08);
        let roll =
            f64::from(outlook.quarter_turns) * std::f64::consts::FRAC_PI_2 + 0.04 * normal(random);
        let turn = Rotation3::from_euler_angles(
            0.0,
            -outlook.elevation_deg.to_radians(),
            outlook.azimuth_deg.to_radians(),
        );
        let target = self.target + miss;
        let up = if outlook.elevation_deg > 75.0 {
            Vector3::y()
        } else {
            Vector3::z()
        };
        let at = |distance: f64| {
            Pose::looking_at(target + turn * Vector3::x() * distance, target, up, roll)
        };
        let wanted = |pose: &Pose| {
            let upright = if outlook.quarter_turns.is_multiple_of(2) {
                self.upright
            } else {
                &[]
            };
            self.always
                .iter()
                .chain(upright)
                .all(|point| self.frames(pose, point))
        };
        let (mut near, mut far) = (NEAREST_MM, FARTHEST_MM);
        if !wanted(&at(far)) {
            return Err(SceneError::NoDistance { farthest_mm: far });
        }
        while far - near > 0.5 {
            let middle = (near * far).sqrt();
            if wanted(&at(middle)) {
                far = middle;
            } else {
                near = middle;
            }
        }
        Ok(at(far * spare))
    }

    fn frames(&self, pose: &Pose, point: &Vector3<f64>) -> bool {
        self.camera
            .project(&pose.camera_from_point(point))
            .is_some_and(|pixel| self.camera.contains(&pixel))
    }
}
