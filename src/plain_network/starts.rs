//! Where an adjustment may start: poses by resection, coordinates by intersection, in turn from what is given.

use nalgebra::{Rotation3, Vector2, Vector3};

use super::usable::Usable;
use super::{PlainNetwork, PointRole};
use crate::camera::Camera;
use crate::geometry::{Pose, Ray, intersect_rays};
use crate::orientation::consensus::{ConsensusSettings, resect_by_consensus};
use crate::orientation::refine::PoseObservation;
use crate::orientation::relative::{PixelPair, RelativeSettings, relative_orientation};

/// How near a point must be imaged to its place to agree with a pose, px; the next one is tried where too few agree: the lens is a
/// nominal one.
const TOLERANCES_PX: [f64; 4] = [2.0, 5.0, 12.0, 25.0];

/// Share of the known points of an image that must agree with its pose.
const SHARE_TO_AGREE: f64 = 0.6;

/// Least angle between two rays of a point, radians (1 degree).
const LEAST_ANGLE: f64 = 0.0175;

/// Pairs of images that are tried where nothing is known: those with most points in common.
const PAIRS: usize = 12;

/// Seed of the samples.
const SEED: u64 = 1;

/// What is known of places and poses; `None` is still to be found.
#[derive(Clone, Debug)]
pub(super) struct Starts {
    pub(super) poses: Vec<Option<Pose>>,
    pub(super) positions: Vec<Option<Vector3<f64>>>,
}

/// The rays of a network by image and by point.
struct Rays<'a> {
    network: &'a PlainNetwork,
    cameras: Vec<Camera>,
    /// Observations of each image and of each point, by index.
    of_image: Vec<Vec<usize>>,
    of_point: Vec<Vec<usize>>,
}

impl Rays<'_> {
    fn pixel(&self, observation: usize) -> Vector2<f64> {
        let seen = &self.network.observations[observation];
        Vector2::new(seen.x_px, seen.y_px)
    }

    fn camera(&self, image: usize) -> &Camera {
        &self.cameras[self.network.images[image].camera]
    }

    fn ray(&self, observation: usize, pose: &Pose) -> Ray {
        let camera = self.camera(self.network.observations[observation].image);
        let direction = camera.ray(&self.pixel(observation));
        Ray::new(pose.centre_in_world, &pose.world_from_direction(&direction))
    }
}

impl Starts {
    /// Starts of all that takes part, from those that the network gives and from known coordinates.
    pub(super) fn find(network: &PlainNetwork, usable: &Usable) -> Self {
        let images = &usable.images;
        let given = network.images.iter().zip(&usable.image_starts);
        let mut starts = Self {
            poses: given
                .map(|(image, &believed)| image.start.filter(|_| believed))
                .collect(),
            positions: (0..network.points.len())
                .map(|point| place(network, usable, point))
                .collect(),
        };
        let mut of_image = vec![Vec::new(); network.images.len()];
        let mut of_point = vec![Vec::new(); network.points.len()];
        for (index, seen) in usable.seen(network) {
            of_image[seen.image].push(index);
            of_point[seen.point].push(index);
        }
        let rays = Rays {
            network,
            cameras: network
                .cameras
                .iter()
                .map(super::PlainCamera::camera)
                .collect(),
            of_image,
            of_point,
        };
        starts.intersect(&rays);
        let is_open = (0..images.len()).any(|i| images[i] && starts.poses[i].is_none());
        if is_open && !starts.resect(&rays) && starts.poses.iter().all(Option::is_none) {
            starts.orient_pair(&rays);
        }
        starts.complete(&rays);
        starts
    }

    /// Coordinates and poses in turn, until nothing more is found.
    fn complete(&mut self, rays: &Rays) {
        self.intersect(rays);
        while self.resect(rays) {
            self.intersect(rays);
        }
    }

    /// Poses of images that have none, by their points with coordinates; whether there was one.
    fn resect(&mut self, rays: &Rays) -> bool {
        let mut found = false;
        for image in 0..self.poses.len() {
            if self.poses[image].is_none() && !rays.of_image[image].is_empty() {
                self.poses[image] = self.resected(rays, image);
                found |= self.poses[image].is_some();
            }
        }
        found
    }

    fn resected(&self, rays: &Rays, image: usize) -> Option<Pose> {
        let known: Vec<PoseObservation> = rays.of_image[image]
            .iter()
            .filter_map(|&index| {
                let seen = &rays.network.observations[index];
                Some(PoseObservation {
                    pixel: rays.pixel(index),
                    point: self.positions[seen.point]?,
                    sigma_px: seen.sigma_px,
                })
            })
            .collect();
        let least_inliers = ((SHARE_TO_AGREE * known.len() as f64).ceil() as usize).max(4);
        TOLERANCES_PX.iter().find_map(|&tolerance_px| {
            let settings = ConsensusSettings {
                tolerance_px,
                least_inliers,
                seed: SEED,
                ..ConsensusSettings::default()
            };
            let found = resect_by_consensus(rays.camera(image), &known, &[], &settings).ok()?;
            Some(found.pose)
        })
    }

    /// Coordinates of points that have none, where two or more rays meet.
    fn intersect(&mut self, rays: &Rays) {
        for point in 0..self.positions.len() {
            if self.positions[point].is_some() {
                continue;
            }
            let meeting: Vec<Ray> = rays.of_point[point]
                .iter()
                .filter_map(|&index| {
                    let pose = self.poses[rays.network.observations[index].image].as_ref()?;
                    Some(rays.ray(index, pose))
                })
                .collect();
            let angle = |(k, ray): (usize, &Ray)| {
                meeting[k + 1..]
                    .iter()
                    .map(|other| ray.angle(other))
                    .fold(0.0, f64::max)
            };
            let widest = meeting.iter().enumerate().map(angle).fold(0.0, f64::max);
            if widest > LEAST_ANGLE {
                self.positions[point] = intersect_rays(&meeting).ok().map(|found| found.point);
            }
        }
    }

    /// The relative orientation of two images, the base of length 1 beginning at the origin, where nothing at all is known: of
    /// flat points it may have two solutions, and of those and of the next pairs the one with which all rays agree best is taken.
    fn orient_pair(&mut self, rays: &Rays) {
        let mut best: Option<(f64, Self)> = None;
        for (images, pixels) in pairs(rays) {
            let cameras = images.map(|image| rays.camera(image));
            let found = TOLERANCES_PX.iter().find_map(|&tolerance_px| {
                let settings = RelativeSettings {
                    tolerance_px,
                    seed: SEED,
                    ..RelativeSettings::default()
                };
                let found = relative_orientation(cameras, &pixels, &settings).ok()?;
                let agreeing = found.best.inlier_count as f64;
                (agreeing >= SHARE_TO_AGREE * pixels.len() as f64).then_some(found)
            });
            let Some(found) = found else { continue };
            for second in [Some(found.best), found.alternative].into_iter().flatten() {
                let mut trial = self.clone();
                trial.poses[images[0]] = Some(Pose {
                    camera_from_world: Rotation3::identity(),
                    centre_in_world: Vector3::zeros(),
                });
                trial.poses[images[1]] = Some(second.second);
                trial.complete(rays);
                let misfit = trial.misfit(rays);
                if best.as_ref().is_none_or(|(least, _)| misfit < *least) {
                    best = Some((misfit, trial));
                }
            }
            if best
                .as_ref()
                .is_some_and(|(_, trial)| trial.is_complete(rays))
            {
                break;
            }
        }
        if let Some((_, trial)) = best {
            *self = trial;
        }
    }

    fn is_complete(&self, rays: &Rays) -> bool {
        let mut images = rays.of_image.iter().zip(&self.poses);
        images.all(|(seen, pose)| seen.is_empty() || pose.is_some())
    }

    /// Mean distance of the image points from where the starts put them, px; one that is farther away than the largest tolerance,
    /// or has no start, counts as that.
    fn misfit(&self, rays: &Rays) -> f64 {
        let largest = TOLERANCES_PX[TOLERANCES_PX.len() - 1];
        let distance = |&index: &usize| {
            let seen = &rays.network.observations[index];
            let pose = self.poses[seen.image].as_ref()?;
            let place = pose.camera_from_point(self.positions[seen.point].as_ref()?);
            let pixel = rays.camera(seen.image).project(&place)?;
            Some((pixel - rays.pixel(index)).norm().min(largest))
        };
        let all = rays.of_image.iter().flatten();
        let sum: f64 = all.map(|index| distance(index).unwrap_or(largest)).sum();
        let count: usize = rays.of_image.iter().map(Vec::len).sum();
        sum / count.max(1) as f64
    }
}

/// Where a point is by its known coordinates, else by its start.
fn place(network: &PlainNetwork, usable: &Usable, point: usize) -> Option<Vector3<f64>> {
    let of_point = &network.points[point];
    let start = of_point.start.filter(|_| usable.point_starts[point]);
    let coordinate = |axis: usize| {
        let believed = usable.known[point][axis] && of_point.role == PointRole::Control;
        let known = of_point.known[axis].filter(|_| believed);
        known
            .map(|known| known.value_mm)
            .or_else(|| Some(start.as_ref()?[axis]))
    };
    Some(Vector3::new(coordinate(0)?, coordinate(1)?, coordinate(2)?))
}

/// The pairs of images with most points in common, the best first.
fn pairs(rays: &Rays) -> Vec<([usize; 2], Vec<PixelPair>)> {
    let mut common = std::collections::BTreeMap::<[usize; 2], Vec<PixelPair>>::new();
    for of_point in &rays.of_point {
        for (k, &one) in of_point.iter().enumerate() {
            for &other in &of_point[k + 1..] {
                let images = [one, other].map(|index| rays.network.observations[index].image);
                common.entry(images).or_default().push(PixelPair {
                    first: rays.pixel(one),
                    second: rays.pixel(other),
                });
            }
        }
    }
    let mut pairs: Vec<_> = common.into_iter().collect();
    pairs.sort_by_key(|(images, pixels)| (std::cmp::Reverse(pixels.len()), *images));
    pairs.truncate(PAIRS);
    pairs
}
