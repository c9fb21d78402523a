//! Resection by sample consensus: the pose that most of the correspondences agree on.

use nalgebra::{Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::bodies::poses_of_bodies;
use super::refine::{PoseObservation, RefineSettings, refine_pose, turn_between};
use super::{resect_from_points, three_point_poses};
use crate::camera::Camera;
use crate::geometry::Pose;

/// Settings of [`resect_by_consensus`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConsensusSettings {
    /// A point this near to its predicted place agrees, px: several times the noise, and what a nominal lens is wrong.
    pub tolerance_px: f64,
    /// Points that must agree at least; three always do, so four is the least that says anything.
    pub least_inliers: usize,
    /// Samples at most; 2000 find a sample without outliers among 60 % of them with certainty 1 - 10^-58.
    pub most_samples: usize,
    /// The chance of missing the best pose at which the search may end before that.
    pub miss_probability: f64,
    /// Seed of the samples.
    pub seed: u64,
}

impl Default for ConsensusSettings {
    fn default() -> Self {
        Self {
            tolerance_px: 3.0,
            least_inliers: 4,
            most_samples: 2000,
            miss_probability: 1e-8,
            seed: 1,
        }
    }
}

/// Another pose that the same correspondences support.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OtherPose {
    /// The pose.
    pub pose: Pose,
    /// How many points agree with it.
    pub inliers: usize,
    /// Root mean square residual of those, px per coordinate.
    pub rms_px: f64,
}

/// A pose found by consensus.
#[derive(Clone, Debug, PartialEq)]
pub struct Resection {
    /// The pose, refined on its inliers.
    pub pose: Pose,
    /// Which correspondences agree.
    pub inliers: Vec<bool>,
    /// How many do.
    pub inlier_count: usize,
    /// Root mean square residual of the inliers, px per coordinate.
    pub rms_px: f64,
    /// The best clearly different pose with nearly as many inliers (all but one); `None` where there is none.
    pub alternative: Option<OtherPose>,
}

/// Why no pose was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ResectionError {
    /// Fewer than four correspondences.
    #[error("a resection needs {needed} known points in the image, found {found}")]
    TooFewPoints {
        /// Correspondences given.
        found: usize,
        /// Correspondences needed.
        needed: usize,
    },
    /// No pose agrees with enough of them.
    #[error("no pose agrees with more than {agreeing} of {given} points, {needed} are needed")]
    NoConsensus {
        /// Most that agreed.
        agreeing: usize,
        /// Correspondences given.
        given: usize,
        /// Needed.
        needed: usize,
    },
}

/// A pose under trial; a lower score is better.
#[derive(Clone, Copy)]
struct Trial {
    pose: Pose,
    score: f64,
    inliers: usize,
}

/// The pose that most (image point, object point) correspondences agree on, refined on them.
///
/// Where the pose of least squares ([`resect_from_points`]) has all points agree, that is it. Otherwise triples
/// of points give poses by [`three_point_poses`]; each is scored by the truncated squared residuals of all
/// points (Torr and Zisserman, 2000), and each new best one is refined on its inliers (Chum et al., 2003). Up to some
/// twenty points all triples are tried, otherwise seeded random ones until a better pose is improbable. The same input
/// and seed give the same pose.
///
/// `bodies` are places of observations that are named together, as the dots of a code: the poses that fit several of them are
/// tried first.
///
/// # Errors
/// [`ResectionError`]: too few points, or no pose with enough of them.
pub fn resect_by_consensus(
    camera: &Camera,
    observations: &[PoseObservation],
    bodies: &[Vec<usize>],
    settings: &ConsensusSettings,
) -> Result<Resection, ResectionError> {
    let needed = settings.least_inliers.max(4);
    let given = observations.len();
    if given < needed {
        return Err(ResectionError::TooFewPoints {
            found: given,
            needed,
        });
    }
    let rays: Vec<Vector3<f64>> = observations.iter().map(|o| camera.ray(&o.pixel)).collect();
    let to = observations.iter().map(|o| o.point).sum::<Vector3<f64>>() / given as f64;
    let fitted = resect_from_points(camera, observations);
    let fitted: Vec<Trial> = fitted
        .iter()
        .map(|f| score(camera, &rays, observations, f.pose, settings.tolerance_px))
        .collect();
    if fitted.first().is_some_and(|trial| trial.inliers == given) {
        return conclude(camera, observations, &fitted, settings, needed, &to);
    }
    let mut found = Found {
        camera,
        rays: &rays,
        observations,
        tolerance_px: settings.tolerance_px,
        to,
        best: Vec::new(),
    };
    for pose in poses_of_bodies(camera, observations, bodies, settings.seed) {
        found.offer(pose);
    }
    let mut samples = Samples::new(given, settings);
    while let Some(sample) = samples.next() {
        if let Some(first) = found.best.first() {
            samples.expect(first.inliers as f64 / given as f64);
        }
        let poses = three_point_poses(
            &sample.map(|k| rays[k]),
            &sample.map(|k| observations[k].point),
        );
        for pose in poses {
            found.offer(pose);
        }
    }
    conclude(camera, observations, &found.best, settings, needed, &to)
}

/// The best poses of those that were offered.
struct Found<'a> {
    camera: &'a Camera,
    rays: &'a [Vector3<f64>],
    observations: &'a [PoseObservation],
    tolerance_px: f64,
    /// The middle of the points.
    to: Vector3<f64>,
    best: Vec<Trial>,
}

impl Found<'_> {
    fn offer(&mut self, pose: Pose) {
        let (camera, rays, observations) = (self.camera, self.rays, self.observations);
        let trial = score(camera, rays, observations, pose, self.tolerance_px);
        // A pose that only its own three points like need not be polished.
        let promising = self
            .best
            .last()
            .is_none_or(|worst| self.best.len() < 4 || trial.score < worst.score);
        if trial.inliers >= 4 && promising {
            let polished = polish(camera, rays, observations, trial, self.tolerance_px);
            insert_distinct(&mut self.best, polished, &self.to);
        }
    }
}

/// Triples of points: all of them, or random ones until the adaptive limit.
struct Samples {
    points: usize,
    all: Option<std::vec::IntoIter<[usize; 3]>>,
    rng: ChaCha8Rng,
    drawn: usize,
    limit: usize,
    miss_probability: f64,
}

impl Samples {
    fn new(points: usize, settings: &ConsensusSettings) -> Self {
        let triples = points
            .checked_mul(points - 1)
            .and_then(|n| n.checked_mul(points - 2));
        // 1140 triples of 20 points take a few ms.
        let few = triples.is_some_and(|n| n / 6 <= settings.most_samples.min(1140));
        Self {
            points,
            all: few.then(|| all_triples(points).into_iter()),
            rng: ChaCha8Rng::seed_from_u64(settings.seed),
            drawn: 0,
            limit: settings.most_samples,
            miss_probability: settings.miss_probability.clamp(1e-300, 0.5),
        }
    }

    fn next(&mut self) -> Option<[usize; 3]> {
        if let Some(all) = &mut self.all {
            return all.next();
        }
        if self.drawn >= self.limit {
            return None;
        }
        self.drawn += 1;
        let first = self.rng.random_range(0..self.points);
        let mut second = self.rng.random_range(0..self.points - 1);
        second += usize::from(second >= first);
        let mut third = self.rng.random_range(0..self.points - 2);
        let (low, high) = (first.min(second), first.max(second));
        third += usize::from(third >= low);
        third += usize::from(third >= high);
        Some([first, second, third])
    }

    /// Lowers the limit to what the share of inliers makes certain enough (Fischler and Bolles, 1981).
    fn expect(&mut self, share: f64) {
        let good = share.powi(3).min(1.0 - 1e-12);
        let needed = (self.miss_probability.ln() / (1.0 - good).ln()).ceil();
        if needed.is_finite() && needed >= 0.0 {
            self.limit = self.limit.min((needed as usize).max(20));
        }
    }
}

fn all_triples(points: usize) -> Vec<[usize; 3]> {
    let mut triples = Vec::new();
    for i in 0..points {
        for j in i + 1..points {
            for k in j + 1..points {
                triples.push([i, j, k]);
            }
        }
    }
    triples
}

/// Distance of a point's prediction from its ideal image point, px; infinite behind the camera.
fn miss_px(camera: &Camera, ray: &Vector3<f64>, pose: &Pose, point: &Vector3<f64>) -> f64 {
    let k = pose.camera_from_point(point);
    if !(k.z < 0.0) {
        return f64::INFINITY;
    }
    let scale = ray.z / k.z;
    Vector2::new(k.x * scale - ray.x, k.y * scale - ray.y).norm() / camera.pixel_pitch_mm
}

fn score(
    camera: &Camera,
    rays: &[Vector3<f64>],
    observations: &[PoseObservation],
    pose: Pose,
    tolerance_px: f64,
) -> Trial {
    let mut trial = Trial {
        pose,
        score: 0.0,
        inliers: 0,
    };
    for (ray, observation) in rays.iter().zip(observations) {
        let miss = miss_px(camera, ray, &pose, &observation.point);
        if miss <= tolerance_px {
            trial.inliers += 1;
            trial.score += (miss / tolerance_px).powi(2);
        } else {
            trial.score += 1.0;
        }
    }
    trial
}

/// Refines a pose on its inliers as long as its score falls.
fn polish(
    camera: &Camera,
    rays: &[Vector3<f64>],
    observations: &[PoseObservation],
    mut trial: Trial,
    tolerance_px: f64,
) -> Trial {
    let settings = RefineSettings {
        iterations: 8,
        ..RefineSettings::default()
    };
    for _ in 0..4 {
        let inliers: Vec<PoseObservation> = rays
            .iter()
            .zip(observations)
            .filter(|(ray, o)| miss_px(camera, ray, &trial.pose, &o.point) <= tolerance_px)
            .map(|(_, o)| *o)
            .collect();
        let Ok(refined) = refine_pose(camera, &inliers, &trial.pose, &settings) else {
            break;
        };
        let next = score(camera, rays, observations, refined.pose, tolerance_px);
        if !(next.score < trial.score) {
            break;
        }
        let settled = trial.score - next.score < 1e-9;
        trial = next;
        if settled {
            break;
        }
    }
    trial
}

/// Whether two poses are the same solution: centres within 2 % of the distance and directions within 2 degrees.
fn same_solution(a: &Pose, b: &Pose, to: &Vector3<f64>) -> bool {
    let distance = (a.centre_in_world - to).norm();
    let turn = turn_between(a, b);
    (a.centre_in_world - b.centre_in_world).norm() < 0.02 * distance && turn < 0.035
}

/// Keeps the four best clearly different poses, the best first.
fn insert_distinct(best: &mut Vec<Trial>, trial: Trial, to: &Vector3<f64>) {
    if let Some(slot) = best
        .iter()
        .position(|b| same_solution(&b.pose, &trial.pose, to))
    {
        if trial.score < best[slot].score {
            best[slot] = trial;
        }
    } else {
        best.push(trial);
    }
    best.sort_by(|a, b| a.score.total_cmp(&b.score));
    best.truncate(4);
}

fn conclude(
    camera: &Camera,
    observations: &[PoseObservation],
    best: &[Trial],
    settings: &ConsensusSettings,
    needed: usize,
    to: &Vector3<f64>,
) -> Result<Resection, ResectionError> {
    let finished: Vec<Resection> = best
        .iter()
        .filter_map(|trial| finish(camera, observations, &trial.pose, settings.tolerance_px))
        .collect();
    let agreeing = finished.iter().map(|r| r.inlier_count).max().unwrap_or(3);
    let mut order: Vec<usize> = (0..finished.len()).collect();
    order.sort_by(|&a, &b| {
        let (a, b) = (&finished[a], &finished[b]);
        b.inlier_count
            .cmp(&a.inlier_count)
            .then(a.rms_px.total_cmp(&b.rms_px))
    });
    let Some(first) = order
        .first()
        .map(|&k| &finished[k])
        .filter(|r| r.inlier_count >= needed)
    else {
        return Err(ResectionError::NoConsensus {
            agreeing,
            given: observations.len(),
            needed,
        });
    };
    let rival = order.iter().skip(1).map(|&k| &finished[k]).find(|r| {
        r.inlier_count + 1 >= first.inlier_count
            && r.inlier_count >= 4
            && !same_solution(&first.pose, &r.pose, to)
    });
    Ok(Resection {
        alternative: rival.map(|r| OtherPose {
            pose: r.pose,
            inliers: r.inlier_count,
            rms_px: r.rms_px,
        }),
        ..first.clone()
    })
}

/// The last refinement, with the full lens, on inliers that no longer change.
fn finish(
    camera: &Camera,
    observations: &[PoseObservation],
    start: &Pose,
    tolerance_px: f64,
) -> Option<Resection> {
    let mut pose = *start;
    let mut inliers: Vec<bool> = Vec::new();
    let mut rms_px = 0.0;
    for _ in 0..5 {
        let now: Vec<bool> = observations
            .iter()
            .map(|o| {
                let pixel = camera.project(&pose.camera_from_point(&o.point));
                pixel.is_some_and(|p| (p - o.pixel).norm() <= tolerance_px)
            })
            .collect();
        if now == inliers {
            break;
        }
        inliers = now;
        let chosen: Vec<PoseObservation> = observations
            .iter()
            .zip(&inliers)
            .filter(|(_, used)| **used)
            .map(|(o, _)| *o)
            .collect();
        let refined = refine_pose(camera, &chosen, &pose, &RefineSettings::default()).ok()?;
        (pose, rms_px) = (refined.pose, refined.rms_px);
    }
    let inlier_count = inliers.iter().filter(|used| **used).count();
    Some(Resection {
        pose,
        inliers,
        inlier_count,
        rms_px,
        alternative: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::simulation::{self, Noise, Scene};

    /// A scene in which the first `wrong` points carry other points' image places.
    fn spoiled(count: usize, wrong: usize, seed: u64) -> Scene {
        let camera = simulation::camera();
        let mut scene = simulation::scene(&camera, count, Noise(0.1), seed);
        let mut rng = simulation::random(seed + 77);
        for observation in &mut scene.observations[..wrong] {
            observation.pixel =
                Vector2::new(rng.random_range(0.0..3072.0), rng.random_range(0.0..2048.0));
        }
        scene
    }

    #[test]
    fn half_of_the_points_may_be_wrong() {
        let camera = simulation::camera();
        for (count, wrong) in [(5, 0), (6, 1), (10, 4), (20, 10), (60, 30)] {
            for seed in 0..15 {
                let scene = spoiled(count, wrong, seed);
                let found = resect_by_consensus(
                    &camera,
                    &scene.observations,
                    &[],
                    &ConsensusSettings::default(),
                )
                .unwrap();
                let expected: Vec<bool> = (0..count).map(|k| k >= wrong).collect();
                assert_eq!(found.inliers, expected, "{count} {wrong} {seed}");
                // 0.1 px at 1 m are 5 um in the object; six unknowns from few points are some hundred times weaker.
                assert!((found.pose.centre_in_world - scene.pose.centre_in_world).norm() < 10.0);
                assert!(found.rms_px < 0.3);
            }
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_digits() {
        let camera = simulation::distorted_camera();
        let scene = simulation::scene(&camera, 40, Noise(0.2), 3);
        let run = || {
            resect_by_consensus(
                &camera,
                &scene.observations,
                &[],
                &ConsensusSettings::default(),
            )
            .unwrap()
        };
        assert_eq!(run(), run());
        assert_eq!(run().inlier_count, 40);
    }

    #[test]
    fn chance_and_degenerate_points_give_errors() {
        let camera = simulation::camera();
        let settings = ConsensusSettings {
            least_inliers: 6,
            ..ConsensusSettings::default()
        };
        let scene = spoiled(12, 12, 5);
        assert!(matches!(
            resect_by_consensus(&camera, &scene.observations, &[], &settings),
            Err(ResectionError::NoConsensus { given: 12, .. })
        ));
        let few = resect_by_consensus(&camera, &scene.observations[..3], &[], &settings);
        assert_eq!(
            few,
            Err(ResectionError::TooFewPoints {
                found: 3,
                needed: 6
            })
        );
        let same = vec![scene.observations[0]; 8];
        assert!(resect_by_consensus(&camera, &same, &[], &settings).is_err());
        let mut line = scene.observations.clone();
        for (k, o) in line.iter_mut().enumerate() {
            o.point = Vector3::x() * k as f64;
        }
        assert!(resect_by_consensus(&camera, &line, &[], &settings).is_err());
    }
}
