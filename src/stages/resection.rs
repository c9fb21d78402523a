//! Resection of an image from known points, and intersection of new points from oriented images.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

use super::by_hand::{self, Confirmed, resect_from_three, three_by_hand};
use super::chance::{UNLIKELY, dots_under, is_single_code, log_chance};
use super::lens::{IMAGES_FOR_ALL, images_of_cameras};
use crate::camera::Camera;
use crate::geometry::{Pose, Ray, intersect_rays};
use crate::network::{Code, CodeDot, ImageId, Network, Point, PointId, Source};
use crate::orientation::consensus::{ConsensusSettings, resect_by_consensus};
use crate::orientation::refine::{Loss, PoseObservation, RefineSettings, refine_pose};
use crate::orientation::similarity::{CodeView, resect_by_similarity};
use crate::targets::{DotIndex, Family};

/// How near a point must be imaged to its predicted place to agree with a pose, px; the next one is tried when too few
/// points agree: a nominal lens is off by tens of pixels in the corners.
const TOLERANCES_PX: [f64; 4] = [2.0, 5.0, 12.0, 25.0];

/// Share of the known points that must agree with a pose, beside that they are not likely to do so by chance.
const SHARE_TO_AGREE: f64 = 0.4;

/// A dot farther off than so many tolerances does not take part in the refinement.
const FAR_OFF: f64 = 4.0;

/// Refinements without the dots that the one before found far off.
const TRIMMINGS: usize = 3;

/// A code whose dots miss their predicted places by more is a wrong reading, px: with a nominal lens, and with a
/// calibrated one.
const MISFIT_PX: [f64; 2] = [60.0, 10.0];

/// Rays of a new point meet within this, px: with a nominal lens, and with a calibrated one.
const MEETING_PX: [f64; 2] = [25.0, 3.0];

/// Least angle between the rays of a new point, radians (3 degrees): flatter ones tell no depth.
const LEAST_ANGLE: f64 = 0.05;

/// Side of a `dot420` code in pitches.
const SIDE_PITCHES: f64 = 6.0;

/// A labelled dot whose point has coordinates.
#[derive(Clone, Debug)]
pub(super) struct KnownRay {
    pub(super) point: PointId,
    /// Who named it.
    pub(super) source: Source,
    pub(super) observation: PoseObservation,
}

/// The pose of an image.
#[derive(Clone, Debug)]
pub(super) struct FoundPose {
    pub(super) pose: Pose,
    /// Places (among the known rays) of dots that miss it by far.
    pub(super) misfits: Vec<usize>,
    /// Dots without a name that turned out to be known points.
    pub(super) named: Vec<(DotIndex, PointId)>,
}

/// The second of the limits where enough images have calibrated the lenses of all cameras that took part so far.
pub(super) fn lens_limit(network: &Network, limits: [f64; 2]) -> f64 {
    let images = images_of_cameras(network);
    let known = !images.is_empty() && images.values().all(|images| *images >= IMAGES_FOR_ALL);
    limits[usize::from(known)]
}

/// The labelled dots of an image whose points have coordinates.
pub(super) fn known_rays(network: &Network, id: ImageId) -> Vec<KnownRay> {
    let image = &network.images[&id];
    let Some(detections) = &image.detections else {
        return Vec::new();
    };
    image
        .used_labels()
        .filter_map(|(dot, label)| {
            let point = network.points.get(&label.point)?.position;
            let measured = &detections.dots[dot.slot()];
            let observation = PoseObservation {
                pixel: measured.centre_px,
                point,
                sigma_px: measured.sigma_px,
            };
            Some(KnownRay {
                point: label.point,
                source: label.source,
                observation,
            })
        })
        .collect()
}

/// Orients an image from all its known points; where they do not agree on a pose, from those that the operator named.
///
/// # Errors
/// The reason in the operator's words.
pub(super) fn resect(
    network: &Network,
    id: ImageId,
    rays: &[KnownRay],
) -> Result<FoundPose, String> {
    let reason = match resect_from_all(network, id, rays) {
        Ok(found) => return Ok(found),
        Err(reason) => reason,
    };
    if let Some(three) = three_by_hand(rays) {
        let confirmed = resect_from_three(network, id, &three)?;
        return Ok(from_confirmed(network, id, rays, confirmed));
    }
    let by_hand: Vec<KnownRay> = rays
        .iter()
        .filter(|ray| ray.source == Source::Operator)
        .cloned()
        .collect();
    if by_hand.len() < 4 || by_hand.len() == rays.len() {
        return Err(reason);
    }
    let found = resect_from_all(network, id, &by_hand)?;
    let confirmed = Confirmed {
        pose: found.pose,
        named: found.named,
    };
    Ok(from_confirmed(network, id, rays, confirmed))
}

fn from_confirmed(
    network: &Network,
    id: ImageId,
    rays: &[KnownRay],
    confirmed: Confirmed,
) -> FoundPose {
    FoundPose {
        misfits: misfits_under(network, id, &confirmed.pose, rays),
        pose: confirmed.pose,
        named: confirmed.named,
    }
}

/// Orients an image: by the closed-form similarity transformation where it shows three known `dot420` codes, else by
/// three points in sample consensus; both refined by collinearity.
fn resect_from_all(network: &Network, id: ImageId, rays: &[KnownRay]) -> Result<FoundPose, String> {
    let camera = &network.camera_of(&network.images[&id]).camera;
    let observations: Vec<PoseObservation> = rays.iter().map(|ray| ray.observation).collect();
    let needed = ((SHARE_TO_AGREE * rays.len() as f64).ceil() as usize).max(4);
    let camera_known = images_of_cameras(network).contains_key(&network.images[&id].camera);
    let misfit_limit = if camera_known {
        lens_limit(network, MISFIT_PX)
    } else {
        MISFIT_PX[0]
    };
    let start = similarity_start(network, camera, rays);
    let mut reason = String::new();
    for tolerance_px in TOLERANCES_PX {
        let refined =
            start.and_then(|pose| refine_within(camera, &observations, &pose, tolerance_px));
        let Confirmed { pose, named } = match refined.filter(|found| found.agreeing >= needed) {
            Some(found) => Confirmed {
                pose: found.pose,
                named: Vec::new(),
            },
            None => match by_consensus(network, id, rays, tolerance_px, needed) {
                Ok(confirmed) => confirmed,
                Err(why) => {
                    reason = why;
                    continue;
                }
            },
        };
        let dots = dots_under(camera, &pose, rays);
        // A single code may be all there is: the image is told to be doubtful at the end.
        if !is_single_code(&dots) && log_chance(&dots, camera, tolerance_px) > UNLIKELY {
            reason = format!(
                "what agrees of its {} known points, within {tolerance_px:.0} px, might do so by chance",
                rays.len()
            );
            continue;
        }
        let limit = misfit_limit.max(3.0 * tolerance_px);
        let misfits = (0..rays.len())
            .filter(|&index| {
                residual_px(camera, &pose, &observations[index]).is_none_or(|r| r > limit)
            })
            .collect();
        return Ok(FoundPose {
            pose,
            misfits,
            named,
        });
    }
    Err(reason)
}

/// The known rays (by their places) that miss the image's orientation by far.
pub(super) fn misfits(network: &Network, id: ImageId, rays: &[KnownRay]) -> Vec<usize> {
    match &network.images[&id].station {
        Some(station) => misfits_under(network, id, &station.pose, rays),
        None => (0..rays.len()).collect(),
    }
}

/// The known rays (by their places) that miss an orientation of their image by far.
pub(super) fn misfits_under(
    network: &Network,
    id: ImageId,
    pose: &Pose,
    rays: &[KnownRay],
) -> Vec<usize> {
    let camera = &network.camera_of(&network.images[&id]).camera;
    let limit = lens_limit(network, MISFIT_PX);
    let misses = |index: &usize| {
        residual_px(camera, pose, &rays[*index].observation).is_none_or(|miss| miss > limit)
    };
    (0..rays.len()).filter(misses).collect()
}

/// The pose that most points agree on; where two do as well, the one that the dots without a name speak for.
fn by_consensus(
    network: &Network,
    id: ImageId,
    rays: &[KnownRay],
    tolerance_px: f64,
    needed: usize,
) -> Result<Confirmed, String> {
    let camera = &network.camera_of(&network.images[&id]).camera;
    let observations: Vec<PoseObservation> = rays.iter().map(|ray| ray.observation).collect();
    let observations = observations.as_slice();
    let settings = ConsensusSettings {
        tolerance_px,
        least_inliers: needed,
        seed: network.settings.seed,
        ..ConsensusSettings::default()
    };
    let mut bodies: BTreeMap<Code, Vec<usize>> = BTreeMap::new();
    for (place, ray) in rays.iter().enumerate() {
        if let Some(code) = ray.point.code() {
            bodies.entry(code).or_default().push(place);
        }
    }
    let bodies: Vec<Vec<usize>> = bodies.into_values().collect();
    let found =
        resect_by_consensus(camera, observations, &bodies, &settings).map_err(|e| e.to_string())?;
    if let Some(other) = &found.alternative
        && other.inliers >= found.inlier_count
        && other.rms_px < 2.0 * found.rms_px
    {
        let poses = [found.pose, other.pose];
        if let Some(confirmed) = by_hand::decide(network, id, &poses, rays) {
            return Ok(confirmed);
        }
        return Err(format!(
            "two poses fit its {} known points equally well ({:.2} px and {:.2} px)",
            observations.len(),
            found.rms_px,
            other.rms_px
        ));
    }
    // What does not agree may be far off, and must not pull.
    let refined = refine_near(camera, observations, &found.pose, tolerance_px);
    let refined = refined.filter(|refined| refined.agreeing >= found.inlier_count);
    Ok(Confirmed {
        pose: refined.map_or(found.pose, |refined| refined.pose),
        named: Vec::new(),
    })
}

struct RefinedWithin {
    pose: Pose,
    agreeing: usize,
}

/// The robustly refined pose and how many points agree with it, from a start that all points must mend.
fn refine_within(
    camera: &Camera,
    observations: &[PoseObservation],
    start: &Pose,
    tolerance_px: f64,
) -> Option<RefinedWithin> {
    let all = alike(observations, tolerance_px);
    let pose = refine_pose(camera, &all, start, &robust()).ok()?.pose;
    // Bounded weights still let a code read wrongly pull; without the dots that are far off nothing pulls.
    refine_near(camera, observations, &pose, tolerance_px)
}

/// The same from a start that tells which points are far off.
fn refine_near(
    camera: &Camera,
    observations: &[PoseObservation],
    start: &Pose,
    tolerance_px: f64,
) -> Option<RefinedWithin> {
    let all = alike(observations, tolerance_px);
    let mut pose = *start;
    for _ in 0..TRIMMINGS {
        let near: Vec<PoseObservation> = all
            .iter()
            .filter(|o| residual_px(camera, &pose, o).is_some_and(|r| r < FAR_OFF * tolerance_px))
            .copied()
            .collect();
        pose = refine_pose(camera, &near, &pose, &robust()).ok()?.pose;
        if near.len() == all.len() {
            break;
        }
    }
    let agreeing = observations
        .iter()
        .filter(|o| residual_px(camera, &pose, o).is_some_and(|r| r < tolerance_px))
        .count();
    Some(RefinedWithin { pose, agreeing })
}

/// The observations with one standard deviation: what separates dots from their places is the lens, not their own noise.
fn alike(observations: &[PoseObservation], tolerance_px: f64) -> Vec<PoseObservation> {
    let sigma_px = tolerance_px / 3.0;
    let alike = observations
        .iter()
        .map(|o| PoseObservation { sigma_px, ..*o });
    alike.collect()
}

fn robust() -> RefineSettings {
    RefineSettings {
        loss: Loss::Huber(1.5),
        ..RefineSettings::default()
    }
}

fn residual_px(camera: &Camera, pose: &Pose, observation: &PoseObservation) -> Option<f64> {
    let predicted = camera.project(&pose.camera_from_point(&observation.point))?;
    Some((predicted - observation.pixel).norm())
}

/// The pose by equations 1-12 of the paper from all codes whose O, A, B are known; `None` with fewer than three.
fn similarity_start(network: &Network, camera: &Camera, rays: &[KnownRay]) -> Option<Pose> {
    let ideal: BTreeMap<PointId, Vector2<f64>> = rays
        .iter()
        .map(|ray| (ray.point, camera.ideal_from_pixel(&ray.observation.pixel)))
        .collect();
    let side_of = |code: u32| {
        let place = |dot| {
            let id = PointId::Code {
                family: Family::Dot420,
                code,
                dot,
            };
            network.points.get(&id).map(|p| p.position)
        };
        Some((place(CodeDot::A)? - place(CodeDot::O)?).norm())
    };
    let mut views = Vec::new();
    let mut sides = Vec::new();
    for ray in rays {
        let PointId::Code {
            family: Family::Dot420,
            code,
            dot: CodeDot::O,
        } = ray.point
        else {
            continue;
        };
        let image_of = |dot| {
            ideal
                .get(&PointId::Code {
                    family: Family::Dot420,
                    code,
                    dot,
                })
                .copied()
        };
        if let (Some(o), Some(a), Some(b)) = (
            image_of(CodeDot::O),
            image_of(CodeDot::A),
            image_of(CodeDot::B),
        ) {
            views.push(CodeView {
                o,
                a,
                b,
                object: ray.observation.point,
            });
            sides.extend(side_of(code));
        }
    }
    // The network's unit may not be the millimetre yet: its own codes tell how long a side is in it.
    let pitch = network.settings.targets.of(Family::Dot420).pitch_mm;
    sides.sort_by(f64::total_cmp);
    let side = sides
        .get(sides.len() / 2)
        .copied()
        .unwrap_or(SIDE_PITCHES * pitch);
    resect_by_similarity(&views, side, camera.interior.principal_distance)
        .ok()
        .map(|found| found.pose)
}

/// Gives coordinates to the points that two or more oriented images show and that have none.
///
/// Cost: rays of all oriented images, and of each new point its rays times the pairs that are tried.
pub(super) fn intersect_new_points(network: &mut Network) {
    let mut sights: BTreeMap<PointId, Vec<Sight>> = BTreeMap::new();
    for (_, image, station) in network.oriented_images() {
        let Some(detections) = &image.detections else {
            continue;
        };
        let camera = &network.camera_of(image).camera;
        for (dot, label) in image.used_labels() {
            if !network.points.contains_key(&label.point) {
                sights.entry(label.point).or_default().push(Sight::of(
                    camera,
                    &station.pose,
                    &detections.dots[DotIndex::slot(dot)].centre_px,
                ));
            }
        }
    }
    let limit_px = lens_limit(network, MEETING_PX);
    let sights: Vec<(PointId, Vec<Sight>)> = sights.into_iter().collect();
    let found = sights.par_iter().filter_map(|(id, sights)| {
        let point = Point {
            position: meet(sights, limit_px)?,
            covariance: None,
            rays: sights.len() as u32,
            circle: None,
        };
        Some((*id, Arc::new(point)))
    });
    let found: Vec<(PointId, Arc<Point>)> = found.collect();
    Arc::make_mut(&mut network.points).extend(found);
}

/// A ray with how far from it, in pixels, a point may lie.
struct Sight {
    ray: Ray,
    /// Pixels per radian at the ray.
    px_per_radian: f64,
}

impl Sight {
    fn of(camera: &Camera, pose: &Pose, pixel: &Vector2<f64>) -> Self {
        let direction = camera.ray(pixel);
        Self {
            ray: Ray::new(pose.centre_in_world, &pose.world_from_direction(&direction)),
            px_per_radian: direction.norm() / camera.pixel_pitch_mm,
        }
    }

    /// How far a point is imaged from the ray, px; infinite behind the camera.
    fn miss_px(&self, point: &Vector3<f64>) -> f64 {
        let range = self.ray.range(point);
        if range > 0.0 {
            self.ray.distance(point) / range * self.px_per_radian
        } else {
            f64::INFINITY
        }
    }
}

/// The rays that pass a place.
struct Meeting {
    rays: Vec<Ray>,
    /// Sum of their squared misses, px^2.
    misses: f64,
}

impl Meeting {
    fn of(sights: &[Sight], place: &Vector3<f64>, limit_px: f64) -> Self {
        let passing = sights
            .iter()
            .map(|sight| (sight.ray, sight.miss_px(place)))
            .filter(|(_, miss)| *miss < limit_px);
        Self {
            misses: passing.clone().map(|(_, miss)| miss * miss).sum(),
            rays: passing.map(|(ray, _)| ray).collect(),
        }
    }

    /// More rays, or as many that pass nearer: two rays of different targets may meet by accident.
    fn is_better(&self, other: &Self) -> bool {
        let rays = self.rays.len().cmp(&other.rays.len());
        rays.then(other.misses.total_cmp(&self.misses)).is_gt()
    }
}

/// The intersection that most rays agree on: more than half of them, at least two, not nearly parallel.
fn meet(sights: &[Sight], limit_px: f64) -> Option<Vector3<f64>> {
    /// Rays of which all pairs are tried, evenly among all: more than half of the rays are right.
    const PAIRED: usize = 16;
    let step = sights.len().div_ceil(PAIRED).max(1);
    let paired: Vec<&Sight> = sights.iter().step_by(step).collect();
    let mut best: Option<Meeting> = None;
    for (index, first) in paired.iter().enumerate() {
        for second in &paired[index + 1..] {
            let angle = first.ray.angle(&second.ray);
            if !(LEAST_ANGLE..=std::f64::consts::PI - LEAST_ANGLE).contains(&angle) {
                continue;
            }
            let Ok(pair) = intersect_rays(&[first.ray, second.ray]) else {
                continue;
            };
            let both = first.miss_px(&pair.point).max(second.miss_px(&pair.point));
            let meeting = Meeting::of(sights, &pair.point, limit_px);
            if both < limit_px && best.as_ref().is_none_or(|b| meeting.is_better(b)) {
                best = Some(meeting);
            }
        }
    }
    let rays = best?.rays;
    (2 * rays.len() > sights.len())
        .then(|| intersect_rays(&rays).ok())
        .flatten()
        .map(|found| found.point)
}
