//! Images that show too few known points for a resection, oriented to a single oriented image.
//!
//! The codes that an image shares with one other have no coordinates yet where nobody else shows them. They tell its orientation
//! relative to that image up to the length of the base, which follows from the few known points that both show. Without any the
//! image hangs in the network by nothing that has a length, and no adjustment can hold it.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Rotation3, Vector3};

use super::chance::{UNLIKELY, log_chance_of_pair};
use super::code_shape;
use super::pair::{CommonPair, DOTS_FOR_A_PAIR};
use super::resection::{FoundPose, KnownRay, misfits_under};
use crate::geometry::{Pose, Ray, intersect_rays};
use crate::network::{Code, ImageEntry, ImageId, Network, PointId};
use crate::orientation::relative::{PixelPair, RelativePose};

/// Fewest codes, besides the number of dots, that an image must share with another one.
const CODES_FOR_A_PAIR: usize = 3;

/// Oriented images to which an image is oriented at most: those with which it shares most dots.
const PARTNERS: usize = 3;

/// Fewest known points that tell the length of the base.
const POINTS_FOR_THE_BASE: usize = 3;

/// Fewest known points that decide between two relative orientations, as for a resection.
const POINTS_TO_DECIDE: usize = 4;

/// Of two relative orientations one is right where the other fits worse by this factor.
const CLEARLY: f64 = 2.0;

/// The oriented images with which an image shares enough, those with most common dots first.
///
/// Cost: labels of all oriented images.
pub(super) fn partners(network: &Network, image: &ImageEntry) -> Vec<ImageId> {
    let shown: BTreeSet<PointId> = image.used_labels().map(|(_, label)| label.point).collect();
    let mut partners: Vec<(usize, ImageId)> = network
        .oriented_images()
        .filter_map(|(id, other, _)| {
            let points = other.used_labels().map(|(_, label)| label.point);
            let common: Vec<PointId> = points.filter(|point| shown.contains(point)).collect();
            let codes: BTreeSet<Code> = common.iter().filter_map(|point| point.code()).collect();
            let known = common
                .iter()
                .filter(|point| network.points.contains_key(point))
                .count();
            (common.len() >= DOTS_FOR_A_PAIR
                && codes.len() >= CODES_FOR_A_PAIR
                && known >= POINTS_FOR_THE_BASE)
                .then_some((common.len(), id))
        })
        .collect();
    partners.sort_by_key(|(common, id)| (std::cmp::Reverse(*common), *id));
    partners.truncate(PARTNERS);
    partners.into_iter().map(|(_, id)| id).collect()
}

/// The pose of an image by its orientation to one of the oriented images; `None` where none tells it without ambiguity.
pub(super) fn orient(network: &Network, id: ImageId, rays: &[KnownRay]) -> Option<FoundPose> {
    let partners = partners(network, &network.images[&id]);
    let pose = partners
        .iter()
        .find_map(|&partner| Model::of(network, [partner, id])?.pose(network, rays))?;
    Some(FoundPose {
        misfits: misfits_under(network, id, &pose, rays),
        pose,
        named: Vec::new(),
    })
}

/// A pair of images with the points that both show.
struct Model {
    pair: CommonPair,
    points: Vec<PointId>,
    pixels: Vec<PixelPair>,
    relative: Vec<RelativePose>,
}

impl Model {
    /// `None` where the pair has no relative orientation but by chance.
    fn of(network: &Network, images: [ImageId; 2]) -> Option<Self> {
        let pair = CommonPair::of(network, images);
        let found = pair.oriented(network)?;
        let image = &network.images[&images[0]];
        let camera = &network.camera_of(image).camera;
        let largest = 3.0 * found.best.rms_px;
        let agreeing = found.best.inlier_count;
        if log_chance_of_pair(pair.dots.len(), agreeing, camera, 2.0 * largest) > UNLIKELY {
            return None;
        }
        Some(Self {
            points: pair
                .dots
                .iter()
                .map(|[dot, _]| image.labels[dot].point)
                .collect(),
            pixels: pair.pixels(network)?,
            relative: std::iter::once(found.best)
                .chain(found.alternative)
                .collect(),
            pair,
        })
    }

    /// The second image's pose in the network.
    fn pose(&self, network: &Network, rays: &[KnownRay]) -> Option<Pose> {
        let placed: Vec<Placed> = self
            .relative
            .iter()
            .filter_map(|relative| self.placed(network, relative))
            .collect();
        match &placed[..] {
            // The other one cannot be placed.
            [one] if self.relative.len() == 1 => Some(one.pose),
            [first, second] => decided(network, self.pair.images[1], [first, second], rays),
            _ => None,
        }
    }

    /// The pair in the network's frame and unit, by one of its relative orientations.
    fn placed(&self, network: &Network, relative: &RelativePose) -> Option<Placed> {
        let [first, second] = self.pair.images.map(|id| &network.images[&id]);
        let base = &first.station.as_ref()?.pose;
        let origin = Pose {
            camera_from_world: Rotation3::identity(),
            centre_in_world: Vector3::zeros(),
        };
        let cameras = [first, second].map(|image| &network.camera_of(image).camera);
        let ray = |of: usize, pose: &Pose, pixel| {
            let direction = cameras[of].ray(pixel);
            Ray::new(pose.centre_in_world, &pose.world_from_direction(&direction))
        };
        let places: BTreeMap<PointId, Vector3<f64>> = (self.points.iter().zip(&self.pixels))
            .zip(&relative.inliers)
            .filter(|(_, agrees)| **agrees)
            .filter_map(|((point, pixels), _)| {
                let rays = [
                    ray(0, &origin, &pixels.first),
                    ray(1, &relative.second, &pixels.second),
                ];
                Some((*point, intersect_rays(&rays).ok()?.point))
            })
            .collect();
        let scale = length_of_base(network, base, &places)?;
        let centre = base.world_from_direction(&relative.second.centre_in_world);
        Some(Placed {
            pose: Pose {
                camera_from_world: relative.second.camera_from_world * base.camera_from_world,
                centre_in_world: base.centre_in_world + centre * scale,
            },
            misfit_pitches: median(code_shape::misfits(&places)),
        })
    }
}

/// A pose that a relative orientation gives.
struct Placed {
    pose: Pose,
    /// How far the pair's codes are from their shape; `None` where it shows no codes of several dots.
    misfit_pitches: Option<f64>,
}

/// The pose of two that known points, or the shapes of the codes, clearly speak for.
fn decided(
    network: &Network,
    id: ImageId,
    placed: [&Placed; 2],
    rays: &[KnownRay],
) -> Option<Pose> {
    let camera = &network.camera_of(&network.images[&id]).camera;
    let misses = |placed: &Placed| {
        let miss = |ray: &KnownRay| {
            let seen = &ray.observation;
            let place = camera.project(&placed.pose.camera_from_point(&seen.point));
            place.map_or(f64::INFINITY, |place| (place - seen.pixel).norm())
        };
        median(rays.iter().map(miss))
    };
    let of_both = if rays.len() >= POINTS_TO_DECIDE {
        placed.map(misses)
    } else {
        placed.map(|placed| placed.misfit_pitches)
    };
    let [Some(first), Some(second)] = of_both else {
        return None;
    };
    if CLEARLY * first < second {
        Some(placed[0].pose)
    } else if CLEARLY * second < first {
        Some(placed[1].pose)
    } else {
        None
    }
}

/// How long the base is, by the distances of known points from the first station.
fn length_of_base(
    network: &Network,
    base: &Pose,
    places: &BTreeMap<PointId, Vector3<f64>>,
) -> Option<f64> {
    let lengths = places.iter().filter_map(|(id, place)| {
        let known = network.points.get(id)?.position;
        Some((known - base.centre_in_world).norm() / place.norm())
    });
    let lengths: Vec<f64> = lengths.collect();
    (lengths.len() >= POINTS_FOR_THE_BASE)
        .then(|| median(lengths.into_iter()))
        .flatten()
}

fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}
