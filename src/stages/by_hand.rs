//! Targets named by hand in the role of codes (the paper's hand-labelled MTs).
//!
//! Three points give up to four poses (Grunert, 1841), all of which fit them exactly. What tells them apart is the rest
//! of the picture: from each pose the other known points are looked for among the dots without a name, the surest ones
//! first, and each one found makes the pose surer. The right pose finds many; a wrong one finds what chance offers.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix2, Matrix6, SMatrix, Vector2, Vector3};

use super::resection::{KnownRay, lens_limit};
use crate::camera::Camera;
use crate::geometry::{Pose, skew};
use crate::network::{ImageEntry, ImageId, Network, PointId, Source};
use crate::orientation::from_points::resect_from_points;
use crate::orientation::refine::{Loss, PoseObservation, RefineSettings, refine_pose};
use crate::targets::DotIndex;

/// Labels given by hand that orient an image.
pub(super) const POINTS_BY_HAND: usize = 3;

/// Standard deviation of a predicted place besides that of the pose, px: with a nominal lens, and with a calibrated one.
const LENS_PX: [f64; 2] = [4.0, 0.4];

/// A dot belongs to a predicted place within so many standard deviations.
const GATE_SIGMAS: f64 = 3.0;

/// Places that are known less well than this are not looked at yet, px: too many dots would lie near them.
const WIDEST_GATE_PX: f64 = 20.0;

/// A dot is a place's clear choice where the next one, and the next place, is so many times as far away.
const CLEAR: f64 = 2.0;

/// Rounds of finding and refining; the gates are as narrow as they get after three or four.
const ROUNDS: usize = 8;

/// Fewest dots that confirm a pose, besides those that chance offers.
const DOTS_TO_CONFIRM: usize = 4;

/// A pose must find so many times as many dots as chance offers, and as any other pose.
const TIMES_AS_MANY: f64 = 2.0;

/// Two refined poses are one where their centres differ by less than this share of the distance, and their directions by
/// less than this angle (radians).
const SAME_POSE: f64 = 0.01;

/// A dot farther from its place than so many rms residuals of the others is not named.
const NAMED_WITHIN: f64 = 4.0;

/// A pose with the dots that it names.
#[derive(Clone, Debug)]
pub(super) struct Confirmed {
    pub(super) pose: Pose,
    pub(super) named: Vec<(DotIndex, PointId)>,
}

/// Orients an image from three labels of the operator.
///
/// # Errors
/// The reason in the operator's words.
pub(super) fn resect_from_three(
    network: &Network,
    id: ImageId,
    rays: &[KnownRay; 3],
) -> Result<Confirmed, String> {
    let camera = &network.camera_of(&network.images[&id]).camera;
    let observations = [0, 1, 2].map(|k: usize| rays[k].observation);
    let fitted = resect_from_points(camera, &observations);
    let poses: Vec<Pose> = fitted.iter().map(|f| f.pose).collect();
    if poses.is_empty() {
        return Err(
            "the three points named by hand lie on one line or are no such points: label one more"
                .into(),
        );
    }
    decide(network, id, &poses, rays).ok_or_else(|| match poses.len() {
        1 => "three points leave 1 pose, and no other dots confirm it: label one more".into(),
        count => format!("three points leave {count} poses: label one more"),
    })
}

/// The one of several poses that the dots without a name speak for; `None` where they do not decide.
pub(super) fn decide(
    network: &Network,
    id: ImageId,
    poses: &[Pose],
    given: &[KnownRay],
) -> Option<Confirmed> {
    let scene = Scene::of(network, id, given)?;
    let mut found: Vec<Support> = Vec::new();
    for pose in poses {
        if let Some(support) = scene.grow(pose)
            && !found
                .iter()
                .any(|other| scene.is_same(&other.pose, &support.pose))
        {
            found.push(support);
        }
    }
    // Stable, so equal ones stay in the order of the poses.
    found.sort_by_key(|support| std::cmp::Reverse(support.pairs.len()));
    let best = found.first()?;
    let enough = (DOTS_TO_CONFIRM as f64 + best.by_chance).max(TIMES_AS_MANY * best.by_chance);
    let rival = found.get(1).map_or(0, |other| other.pairs.len());
    let count = best.pairs.len() as f64;
    let clear = count >= enough && count >= TIMES_AS_MANY * rival as f64;
    clear.then(|| scene.confirmed(best))
}

/// A point of the network that no dot of the image is named by.
struct Wanted {
    id: PointId,
    place: Vector3<f64>,
}

/// A dot that may be any of them.
struct Free {
    dot: DotIndex,
    pixel: Vector2<f64>,
    sigma_px: f64,
}

/// What a pose can be tested with.
struct Scene<'a> {
    camera: &'a Camera,
    lens_px: f64,
    given: Vec<PoseObservation>,
    wanted: Vec<Wanted>,
    /// By rows.
    free: Vec<Free>,
    /// Dots per square pixel.
    density: f64,
    middle: Vector3<f64>,
}

/// A pose with the dots that it explains.
struct Support {
    pose: Pose,
    /// Places among the free dots and the wanted points.
    pairs: Vec<(usize, usize)>,
    /// Pairs that a pose from nowhere would find with gates of this size.
    by_chance: f64,
}

/// A wanted point in the picture.
struct Predicted {
    wanted: usize,
    pixel: Vector2<f64>,
    gate_px: f64,
}

impl<'a> Scene<'a> {
    fn of(network: &'a Network, id: ImageId, given: &[KnownRay]) -> Option<Self> {
        let image = &network.images[&id];
        let detections = image.detections.as_ref()?;
        let camera = &network.camera_of(image).camera;
        let named: BTreeSet<PointId> = image.labels.values().map(|label| label.point).collect();
        let wanted: Vec<Wanted> = network
            .points
            .iter()
            .filter(|(id, _)| !named.contains(id))
            .map(|(id, point)| Wanted {
                id: *id,
                place: point.position,
            })
            .collect();
        let dots = (0..).map(DotIndex).zip(&detections.dots);
        let mut free: Vec<Free> = dots
            .filter(|(dot, _)| is_without_name(image, *dot))
            .map(|(dot, measured)| Free {
                dot,
                pixel: measured.centre_px,
                sigma_px: measured.sigma_px,
            })
            .collect();
        free.sort_by(|a, b| a.pixel.y.total_cmp(&b.pixel.y));
        let lens_px = lens_limit(network, LENS_PX);
        let observations: Vec<PoseObservation> = given.iter().map(|ray| ray.observation).collect();
        let middle =
            observations.iter().map(|o| o.point).sum::<Vector3<f64>>() / given.len().max(1) as f64;
        Some(Self {
            camera,
            lens_px,
            density: density(&free),
            given: observations,
            wanted,
            free,
            middle,
        })
    }

    /// Finds and refines in turn.
    fn grow(&self, start: &Pose) -> Option<Support> {
        let mut support = Support {
            pose: *start,
            pairs: Vec::new(),
            by_chance: 0.0,
        };
        for _ in 0..ROUNDS {
            let observations = self.observations(&support.pairs);
            let settings = RefineSettings {
                loss: Loss::Huber(2.0),
                ..RefineSettings::default()
            };
            let refined = refine_pose(self.camera, &observations, &support.pose, &settings).ok()?;
            let predicted = self.predicted(&refined.pose, &refined.covariance);
            let pairs = self.clear_pairs(&predicted);
            let settled = pairs == support.pairs;
            let areas = predicted
                .iter()
                .map(|p| std::f64::consts::PI * p.gate_px * p.gate_px);
            support = Support {
                pose: refined.pose,
                pairs,
                by_chance: areas.sum::<f64>() * self.density,
            };
            if settled {
                break;
            }
        }
        Some(support)
    }

    /// The given points and those found, each as uncertain as its dot and the lens.
    fn observations(&self, pairs: &[(usize, usize)]) -> Vec<PoseObservation> {
        let found = pairs.iter().map(|&(free, wanted)| PoseObservation {
            pixel: self.free[free].pixel,
            point: self.wanted[wanted].place,
            sigma_px: self.free[free].sigma_px,
        });
        let all = self.given.iter().copied().chain(found);
        all.map(|o| PoseObservation {
            sigma_px: o.sigma_px.hypot(self.lens_px),
            ..o
        })
        .collect()
    }

    /// The wanted points in the picture whose places are known well enough, by rows.
    fn predicted(&self, pose: &Pose, covariance: &Matrix6<f64>) -> Vec<Predicted> {
        let mut predicted = Vec::new();
        for (wanted, point) in self.wanted.iter().enumerate() {
            let in_camera = pose.camera_from_point(&point.place);
            let Some(projection) = self.camera.project_with_jacobians(&in_camera) else {
                continue;
            };
            if !self.camera.contains(&projection.pixel) {
                continue;
            }
            let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
            by_pose
                .fixed_view_mut::<2, 3>(0, 0)
                .copy_from(&(-projection.by_point * skew(&in_camera)));
            by_pose
                .fixed_view_mut::<2, 3>(0, 3)
                .copy_from(&(-projection.by_point * pose.camera_from_world.matrix()));
            let spread: Matrix2<f64> = by_pose * covariance * by_pose.transpose();
            // The larger axis of the ellipse is at most the root of the trace.
            let gate_px = GATE_SIGMAS * (spread.trace() + self.lens_px * self.lens_px).sqrt();
            if gate_px <= WIDEST_GATE_PX.max(GATE_SIGMAS * self.lens_px) {
                predicted.push(Predicted {
                    wanted,
                    pixel: projection.pixel,
                    gate_px,
                });
            }
        }
        predicted.sort_by(|a, b| a.pixel.y.total_cmp(&b.pixel.y));
        predicted
    }

    /// Dots and places that are each other's clear choice.
    fn clear_pairs(&self, predicted: &[Predicted]) -> Vec<(usize, usize)> {
        let places: Vec<Vector2<f64>> = predicted.iter().map(|p| p.pixel).collect();
        let dots: Vec<Vector2<f64>> = self.free.iter().map(|f| f.pixel).collect();
        let mut pairs: Vec<(usize, usize)> = predicted
            .iter()
            .enumerate()
            .filter_map(|(place, p)| {
                let dot = clear_choice(&dots, &p.pixel, p.gate_px)?;
                let back = clear_choice(&places, &self.free[dot].pixel, p.gate_px)?;
                (back == place).then_some((dot, p.wanted))
            })
            .collect();
        pairs.sort_unstable();
        pairs
    }

    fn is_same(&self, a: &Pose, b: &Pose) -> bool {
        let distance = (a.centre_in_world - self.middle).norm();
        let apart = (a.centre_in_world - b.centre_in_world).norm();
        let turn =
            (a.camera_from_world.matrix() - b.camera_from_world.matrix()).norm() / 2_f64.sqrt();
        apart < SAME_POSE * distance && turn < SAME_POSE
    }

    fn confirmed(&self, support: &Support) -> Confirmed {
        let miss = |&(free, wanted): &(usize, usize)| {
            let in_camera = support.pose.camera_from_point(&self.wanted[wanted].place);
            let pixel = self.camera.project(&in_camera);
            pixel.map_or(f64::INFINITY, |pixel| {
                (pixel - self.free[free].pixel).norm()
            })
        };
        let mut misses: Vec<f64> = support.pairs.iter().map(miss).collect();
        misses.sort_by(f64::total_cmp);
        let typical = misses.get(misses.len() / 2).copied().unwrap_or(0.0);
        let named = support
            .pairs
            .iter()
            .filter(|pair| miss(pair) <= NAMED_WITHIN * typical);
        Confirmed {
            pose: support.pose,
            named: named
                .map(|&(free, wanted)| (self.free[free].dot, self.wanted[wanted].id))
                .collect(),
        }
    }
}

/// The three labels of an image that the operator gave, where there are just three.
pub(super) fn three_by_hand(rays: &[KnownRay]) -> Option<[KnownRay; 3]> {
    let by_hand: Vec<KnownRay> = rays
        .iter()
        .filter(|ray| ray.source == Source::Operator)
        .cloned()
        .collect();
    by_hand.try_into().ok()
}

fn is_without_name(image: &ImageEntry, dot: DotIndex) -> bool {
    !image.labels.contains_key(&dot) && !image.rejected_dots.contains_key(&dot)
}

/// Dots per square pixel of the part of the picture where there are any.
fn density(free: &[Free]) -> f64 {
    let bounds = free
        .iter()
        .fold(None, |bounds: Option<(Vector2<f64>, Vector2<f64>)>, dot| {
            let (low, high) = bounds.unwrap_or((dot.pixel, dot.pixel));
            Some((low.inf(&dot.pixel), high.sup(&dot.pixel)))
        });
    let area = bounds.map_or(0.0, |(low, high)| (high - low).product());
    if area > 0.0 {
        free.len() as f64 / area
    } else {
        0.0
    }
}

/// The nearest of several places (by rows) within a distance, where no other is nearly as near.
fn clear_choice(places: &[Vector2<f64>], to: &Vector2<f64>, within: f64) -> Option<usize> {
    let reach = CLEAR * within;
    let from = places.partition_point(|place| place.y < to.y - reach);
    let mut near: Vec<(f64, usize)> = (from..places.len())
        .take_while(|&index| places[index].y <= to.y + reach)
        .map(|index| ((places[index] - to).norm(), index))
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    let &(nearest, index) = near.first().filter(|(distance, _)| *distance <= within)?;
    // Half a pixel: nearer ones differ by what the lens leaves open.
    let clear = near
        .get(1)
        .is_none_or(|(second, _)| *second > CLEAR * nearest.max(0.5));
    clear.then_some(index)
}

/// Names that were found while orienting; dots and points that have one already keep it.
pub(super) fn give_names(image: &mut ImageEntry, named: &[(DotIndex, PointId)]) {
    use crate::network::Label;
    let taken: BTreeMap<PointId, DotIndex> = image
        .labels
        .iter()
        .map(|(dot, label)| (label.point, *dot))
        .collect();
    let labels = std::sync::Arc::make_mut(&mut image.labels);
    for &(dot, point) in named {
        if !taken.contains_key(&point) {
            labels.entry(dot).or_insert(Label {
                point,
                source: Source::Automatic,
                rejected: None,
            });
        }
    }
}
