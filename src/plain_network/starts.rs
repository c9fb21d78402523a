//! Where an adjustment may start: poses by resection, coordinates by intersection, in turn from what is given.

use nalgebra::{Rotation3, Vector2, Vector3};

use super::PlainNetwork;
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
    /// Starts of all that `used` names (images, points), from those that the network gives and from known coordinates.
    pub(super) fn find(network: &PlainNetwork, used: [&[bool]; 2]) -> Self {
        let [images, points] = used;
        let mut starts = Self {
            poses: network.images.iter().map(|image| image.start).collect(),
            positions: network
                .points
                .iter()
                .map(super::PlainPoint::place)
                .collect(),
        };
        let mut of_image = vec![Vec::new(); network.images.len()];
        let mut of_point = vec![Vec::new(); network.points.len()];
        for (index, seen) in network.observations.iter().enumerate() {
            if images[seen.image] && points[seen.point] {
                of_image[seen.image].push(index);
                of_point[seen.point].push(index);
            }
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
        let is_open =
            |starts: &Self| (0..images.len()).any(|i| images[i] && starts.poses[i].is_none());
        if is_open(&starts) && !starts.resect(&rays) && starts.poses.iter().all(Option::is_none) {
            starts.orient_pair(&rays);
        }
        starts.intersect(&rays);
        while is_open(&starts) && starts.resect(&rays) {
            starts.intersect(&rays);
        }
        starts
    }

    /// Poses of images that have none, by their points with coordinates; whether there was one.
    fn resect(&mut self, rays: &Rays) -> bool {
        let mut found = false;
        for image in 0..self.poses.len() {
            if self.poses[image].is_none() {
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

    /// The relative orientation of two images, the base of length 1 beginning at the origin, where nothing at all is known.
    fn orient_pair(&mut self, rays: &Rays) {
        for (images, pixels) in pairs(rays) {
            let cameras = images.map(|image| rays.camera(image));
            let found = TOLERANCES_PX.iter().find_map(|&tolerance_px| {
                let settings = RelativeSettings {
                    tolerance_px,
                    seed: SEED,
                    ..RelativeSettings::default()
                };
                let found = relative_orientation(cameras, &pixels, &settings).ok()?.best;
                (found.inlier_count as f64 >= SHARE_TO_AGREE * pixels.len() as f64).then_some(found)
            });
            if let Some(found) = found {
                let first = Pose {
                    camera_from_world: Rotation3::identity(),
                    centre_in_world: Vector3::zeros(),
                };
                self.poses[images[0]] = Some(first);
                self.poses[images[1]] = Some(found.second);
                return;
            }
        }
    }
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
