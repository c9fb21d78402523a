//! Relative orientation of two images with known interior orientation.
//!
//! Two kinds of samples compete: five pairs give essential matrices, four give the homography of a plane with its two
//! poses. Both are scored over all pairs by Sampson's distance in pixels, refined, and checked for points in front of
//! both cameras. On a plane two poses may remain; then the second is told.

use nalgebra::{Matrix3, SMatrix, SVector, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::five_point::{
    RayPair, essential_matrices, essential_of, poses_of_essential, poses_of_homography,
    ray_homography,
};
use super::refine::turn_between;
use crate::camera::Camera;
use crate::geometry::{Pose, Ray, shortest_segment, skew};

/// A point measured in both images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelPair {
    /// Place in the first image, px.
    pub first: Vector2<f64>,
    /// Place in the second image, px.
    pub second: Vector2<f64>,
}

/// Settings of [`relative_orientation`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativeSettings {
    /// A pair whose Sampson distance is below this agrees, px.
    pub tolerance_px: f64,
    /// Pairs that must agree at least; five always do.
    pub least_inliers: usize,
    /// Samples at most of either kind; with 20 % wrong pairs one in three samples of five is right.
    pub most_samples: usize,
    /// Least median angle between the rays of a point, radians: below it the base is not determined.
    pub least_angle: f64,
    /// A second pose is told if its rms (or the tolerance's tenth, if larger) is within this factor of the first's.
    pub ambiguity: f64,
    /// Seed of the samples.
    pub seed: u64,
}

impl Default for RelativeSettings {
    fn default() -> Self {
        Self {
            tolerance_px: 3.0,
            least_inliers: 8,
            most_samples: 400,
            least_angle: 1_f64.to_radians(),
            ambiguity: 1.5,
            seed: 1,
        }
    }
}

/// A relative pose with what speaks for it.
#[derive(Clone, Debug, PartialEq)]
pub struct RelativePose {
    /// Second camera in the frame of the first, whose pose is the identity; base of length 1.
    pub second: Pose,
    /// Which pairs agree and lie in front of both cameras.
    pub inliers: Vec<bool>,
    /// How many do.
    pub inlier_count: usize,
    /// Root mean square Sampson distance of the inliers, px: for pure noise the error of a coordinate.
    pub rms_px: f64,
    /// Median angle between the two rays of an inlier, radians.
    pub median_angle: f64,
}

/// The relative orientation of two images.
#[derive(Clone, Debug, PartialEq)]
pub struct RelativeOrientation {
    /// The best pose.
    pub best: RelativePose,
    /// A clearly different pose that explains the pairs nearly as well: the points lie in a plane (or nearly so), and
    /// something else must decide.
    pub alternative: Option<RelativePose>,
}

/// Why two images have no relative orientation.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum RelativeError {
    /// Too few common points.
    #[error("a relative orientation needs {needed} common points, found {found}")]
    TooFewPairs {
        /// Pairs given.
        found: usize,
        /// Needed.
        needed: usize,
    },
    /// No pose agrees with enough of them.
    #[error(
        "no relative orientation agrees with more than {agreeing} of {given} points, {needed} are needed"
    )]
    NoConsensus {
        /// Most that agreed.
        agreeing: usize,
        /// Pairs given.
        given: usize,
        /// Needed.
        needed: usize,
    },
    /// The rays of a point are nearly parallel in all poses: the images were taken from (nearly) the same place.
    #[error("the images were taken from nearly the same place: the rays meet at {:.2} degrees", median_angle.to_degrees())]
    NoBase {
        /// Median angle, radians.
        median_angle: f64,
    },
}

/// The relative orientation that most pairs agree on, refined on them; up to about half may be wrong.
///
/// # Errors
/// [`RelativeError`].
pub fn relative_orientation(
    cameras: [&Camera; 2],
    pairs: &[PixelPair],
    settings: &RelativeSettings,
) -> Result<RelativeOrientation, RelativeError> {
    let needed = settings.least_inliers.max(6);
    let given = pairs.len();
    if given < needed {
        return Err(RelativeError::TooFewPairs {
            found: given,
            needed,
        });
    }
    let scene = Scene::new(cameras, pairs, settings.tolerance_px);
    let mut candidates: Vec<Scored> = Vec::new();
    let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
    let mut limit = settings.most_samples;
    let mut drawn = 0;
    let mut best_plane: Option<SharedPlane> = None;
    while drawn < limit {
        drawn += 1;
        let sample = sample_of_five(&mut rng, given).map(|k| scene.rays[k]);
        for e in essential_matrices(&sample) {
            let score = scene.score(&e);
            keep(
                &mut candidates,
                Scored {
                    score,
                    e,
                    poses: poses_of_essential(&e),
                },
            );
        }
        // The plane's samples of four are the first of the five.
        let plane = ray_homography(&sample[..4]).and_then(|h| scene.polished_homography(&h));
        if let Some(found) =
            plane.filter(|found| best_plane.is_none_or(|best| found.agreeing > best.agreeing))
        {
            best_plane = Some(found);
        }
        if let Some(best) = candidates.first() {
            // The score is at least the number of outliers.
            let share = (1.0 - best.score / given as f64).clamp(0.05, 0.999);
            let enough = (1e-6_f64.ln() / (1.0 - share.powi(5)).ln()).ceil();
            limit = limit.min((enough as usize).max(30));
        }
    }
    let of_plane = best_plane
        .map(|plane| poses_of_homography(&plane.homography))
        .unwrap_or_default();
    let found: Vec<RelativePose> = of_plane
        .iter()
        .chain(candidates.iter().flat_map(|c| &c.poses))
        .filter_map(|pose| scene.refined(pose).filter(|r| r.inlier_count >= 5))
        .collect();
    choose(found, settings, given, needed)
}

/// Essential matrices that are refined at most.
const MOST_CANDIDATES: usize = 12;

/// A candidate and its truncated cost (number of tolerances squared; 1 for an outlier).
struct Scored {
    score: f64,
    e: Matrix3<f64>,
    poses: Vec<Pose>,
}

/// A homography that many pairs share.
#[derive(Clone, Copy)]
struct SharedPlane {
    homography: Matrix3<f64>,
    agreeing: usize,
}

/// Keeps the best clearly different candidates: copies of one solution must not crowd the other one of a plane out.
fn keep(candidates: &mut Vec<Scored>, candidate: Scored) {
    if !candidate.score.is_finite() || candidate.poses.is_empty() {
        return;
    }
    let same = |c: &Scored| (c.e - candidate.e).norm().min((c.e + candidate.e).norm()) < 0.03;
    if candidates
        .iter()
        .any(|c| c.score <= candidate.score && same(c))
    {
        return;
    }
    candidates.retain(|c| !same(c));
    let place = candidates.partition_point(|c| c.score <= candidate.score);
    candidates.insert(place, candidate);
    candidates.truncate(MOST_CANDIDATES);
}

fn sample_of_five(rng: &mut ChaCha8Rng, given: usize) -> [usize; 5] {
    let mut sample = [usize::MAX; 5];
    for slot in 0..5 {
        loop {
            let k = rng.random_range(0..given);
            if !sample[..slot].contains(&k) {
                sample[slot] = k;
                break;
            }
        }
    }
    sample
}

/// The best of the refined poses, and a rival.
fn choose(
    mut found: Vec<RelativePose>,
    settings: &RelativeSettings,
    given: usize,
    needed: usize,
) -> Result<RelativeOrientation, RelativeError> {
    let floor = 0.1 * settings.tolerance_px;
    // One inlier more weighs as much as a pair at the tolerance.
    let cost = |r: &RelativePose| {
        let n = r.inlier_count as f64;
        given as f64 - n + n * (r.rms_px / settings.tolerance_px).powi(2)
    };
    found.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
    let agreeing = found.iter().map(|r| r.inlier_count).max().unwrap_or(0);
    let Some(first) = found.first().filter(|r| r.inlier_count >= needed) else {
        return Err(RelativeError::NoConsensus {
            agreeing,
            given,
            needed,
        });
    };
    let nearly_as = |best: &RelativePose, r: &RelativePose| {
        r.inlier_count as f64 >= 0.95 * best.inlier_count as f64 - 1.0
            && r.rms_px.max(floor) <= settings.ambiguity * best.rms_px.max(floor)
    };
    // Of the two poses of a plane the false one may have (nearly) no base: a nominal lens can make it the better fit.
    let with_base = |r: &&RelativePose| r.median_angle >= settings.least_angle;
    let Some(best) = found
        .iter()
        .filter(|r| nearly_as(first, r))
        .find(with_base)
        .cloned()
    else {
        return Err(RelativeError::NoBase {
            median_angle: first.median_angle,
        });
    };
    let differs = |r: &RelativePose| {
        turn_between(&r.second, &best.second) > 0.02
            || (r.second.centre_in_world - best.second.centre_in_world).norm() > 0.05
    };
    let alternative = found
        .iter()
        .find(|r| differs(r) && nearly_as(&best, r))
        .cloned();
    Ok(RelativeOrientation { best, alternative })
}

/// All pairs as rays with unit depth axis: `[x/c, y/c, -1]`.
struct Scene {
    rays: Vec<RayPair>,
    /// Pixels per unit of the rays' coordinates in either image.
    scale: [f64; 2],
    tolerance_px: f64,
}

impl Scene {
    fn new(cameras: [&Camera; 2], pairs: &[PixelPair], tolerance_px: f64) -> Self {
        let unit = |camera: &Camera, pixel: &Vector2<f64>| {
            camera.ray(pixel) / camera.interior.principal_distance
        };
        Self {
            rays: pairs
                .iter()
                .map(|p| RayPair {
                    first: unit(cameras[0], &p.first),
                    second: unit(cameras[1], &p.second),
                })
                .collect(),
            scale: cameras.map(|c| c.interior.principal_distance / c.pixel_pitch_mm),
            tolerance_px,
        }
    }

    /// Sampson's distance (px) with the epipolar misclosure and the gradient's length.
    fn sampson(&self, e: &Matrix3<f64>, pair: &RayPair) -> f64 {
        let along = e * pair.first;
        let back = e.tr_mul(&pair.second);
        let gradient2 = along.xy().norm_squared() / self.scale[1].powi(2)
            + back.xy().norm_squared() / self.scale[0].powi(2);
        pair.second.dot(&along) / gradient2.sqrt()
    }

    fn score(&self, e: &Matrix3<f64>) -> f64 {
        let cost = |pair: &RayPair| (self.sampson(e, pair) / self.tolerance_px).powi(2).min(1.0);
        self.rays.iter().map(cost).sum()
    }

    /// A sample's homography over all pairs that it agrees with; `None` where that is only the sample.
    fn polished_homography(&self, h: &Matrix3<f64>) -> Option<SharedPlane> {
        let mut shared = SharedPlane {
            homography: *h,
            agreeing: 0,
        };
        for _ in 0..2 {
            let agreeing: Vec<RayPair> = self
                .rays
                .iter()
                .filter(|pair| {
                    let image = shared.homography * pair.first;
                    let miss = image.xy() / -image.z - pair.second.xy();
                    miss.norm() * self.scale[1] <= 2.0 * self.tolerance_px
                })
                .copied()
                .collect();
            if agreeing.len() < 6 {
                return None;
            }
            shared = SharedPlane {
                homography: ray_homography(&agreeing)?,
                agreeing: agreeing.len(),
            };
        }
        Some(shared)
    }

    /// Whether a pair's rays meet in front of both cameras, and at which angle.
    fn meets(&self, pose: &Pose, pair: &RayPair) -> Option<f64> {
        let first = Ray::new(Vector3::zeros(), &pair.first);
        let second = Ray::new(
            pose.centre_in_world,
            &pose.world_from_direction(&pair.second),
        );
        let segment = shortest_segment(&first, &second)?;
        segment
            .ranges
            .iter()
            .all(|r| *r > 0.0)
            .then_some(segment.angle)
    }

    /// A pose refined on its inliers (pairs within the tolerance that meet in front).
    fn refined(&self, start: &Pose) -> Option<RelativePose> {
        let mut pose = *start;
        let mut inliers = self.inliers(&pose, self.tolerance_px);
        // The two poses with a wrong sign of the base have no pair in front.
        if inliers.iter().filter(|used| **used).count() < 5 {
            return None;
        }
        for _ in 0..6 {
            pose = self.adjusted(pose, &inliers)?;
            let now = self.inliers(&pose, self.tightened(&pose, &inliers));
            if now == inliers {
                break;
            }
            inliers = now;
        }
        let e = essential_of(&pose);
        let (mut squares, mut count) = (0.0, 0_usize);
        let mut angles = Vec::new();
        for (pair, _) in self.rays.iter().zip(&inliers).filter(|(_, used)| **used) {
            squares += self.sampson(&e, pair).powi(2);
            count += 1;
            angles.extend(self.meets(&pose, pair));
        }
        angles.sort_by(f64::total_cmp);
        Some(RelativePose {
            second: pose,
            inliers,
            inlier_count: count,
            rms_px: (squares / count.max(1) as f64).sqrt(),
            median_angle: *angles.get(angles.len() / 2)?,
        })
    }

    /// Five times the inliers' standard deviation as their median tells it, within the tolerance: a wrong pair that
    /// happens to lie near its epipolar line bends the pose, but not the median.
    fn tightened(&self, pose: &Pose, inliers: &[bool]) -> f64 {
        let e = essential_of(pose);
        let used = self.rays.iter().zip(inliers).filter(|(_, used)| **used);
        let mut misses: Vec<f64> = used.map(|(pair, _)| self.sampson(&e, pair).abs()).collect();
        misses.sort_by(f64::total_cmp);
        let median = misses
            .get(misses.len() / 2)
            .copied()
            .unwrap_or(self.tolerance_px);
        (5.0 * 1.4826 * median).clamp(0.1 * self.tolerance_px, self.tolerance_px)
    }

    fn inliers(&self, pose: &Pose, tolerance_px: f64) -> Vec<bool> {
        let e = essential_of(pose);
        let agrees = |pair: &RayPair| {
            self.sampson(&e, pair).abs() <= tolerance_px && self.meets(pose, pair).is_some()
        };
        self.rays.iter().map(agrees).collect()
    }

    /// Gauss-Newton over three turns and two directions of the base, minimising Sampson's distances.
    fn adjusted(&self, mut pose: Pose, inliers: &[bool]) -> Option<Pose> {
        let chosen: Vec<&RayPair> = self
            .rays
            .iter()
            .zip(inliers)
            .filter(|(_, used)| **used)
            .map(|(p, _)| p)
            .collect();
        if chosen.len() < 5 {
            return None;
        }
        let cost = |pose: &Pose| -> f64 {
            let e = essential_of(pose);
            chosen
                .iter()
                .map(|pair| self.sampson(&e, pair).powi(2))
                .sum()
        };
        let mut least = cost(&pose);
        let mut damping = 0.0;
        for _ in 0..30 {
            let axes = directions_across(&pose.centre_in_world);
            let (normal, right) = self.normal_equations(&pose, &axes, &chosen);
            let mut damped = normal;
            for k in 0..5 {
                damped[(k, k)] += damping * normal[(k, k)] + 1e-12 * normal.trace();
            }
            let step = damped.cholesky()?.solve(&right);
            let turn = Vector3::new(step[0], step[1], step[2]);
            let base = pose.centre_in_world + axes[0] * step[3] + axes[1] * step[4];
            let mut moved = pose.moved(&turn, &Vector3::zeros());
            moved.centre_in_world = base.normalize();
            let now = cost(&moved);
            if now <= least {
                let settled = step.norm() < 1e-12;
                (pose, least) = (moved, now);
                damping *= 0.1;
                if settled {
                    break;
                }
            } else {
                damping = (damping * 10.0_f64).max(1e-4);
                if damping > 1e8 || step.norm() < 1e-12 {
                    break;
                }
            }
        }
        least.is_finite().then_some(pose)
    }

    fn normal_equations(
        &self,
        pose: &Pose,
        axes: &[Vector3<f64>; 2],
        chosen: &[&RayPair],
    ) -> (SMatrix<f64, 5, 5>, SVector<f64, 5>) {
        let m = pose.camera_from_world.matrix();
        let e = essential_of(pose);
        let unit = |k: usize| Vector3::ith(k, 1.0);
        let changes: [Matrix3<f64>; 5] = [
            skew(&unit(0)) * e,
            skew(&unit(1)) * e,
            skew(&unit(2)) * e,
            m * skew(&axes[0]),
            m * skew(&axes[1]),
        ];
        let mut normal = SMatrix::<f64, 5, 5>::zeros();
        let mut right = SVector::<f64, 5>::zeros();
        for pair in chosen {
            let (along, back) = (e * pair.first, e.tr_mul(&pair.second));
            let (w1, w2) = (self.scale[1].powi(-2), self.scale[0].powi(-2));
            let gradient2 = w1 * along.xy().norm_squared() + w2 * back.xy().norm_squared();
            let misclosure = pair.second.dot(&along);
            let gradient = gradient2.sqrt();
            let row = SVector::<f64, 5>::from_fn(|k, _| {
                let (da, db) = (changes[k] * pair.first, changes[k].tr_mul(&pair.second));
                let half = w1 * along.xy().dot(&da.xy()) + w2 * back.xy().dot(&db.xy());
                pair.second.dot(&da) / gradient - misclosure * half / (gradient2 * gradient)
            });
            normal += row * row.transpose();
            right -= row * (misclosure / gradient);
        }
        (normal, right)
    }
}

/// Two unit vectors across `v` and each other.
fn directions_across(v: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let first = v.cross(&Vector3::ith(v.iamin(), 1.0)).normalize();
    [first, v.normalize().cross(&first)]
}

#[cfg(test)]
#[path = "relative_tests.rs"]
pub(super) mod tests;
