//! The first two images: from the reference cross where one is seen, else from the codes that both images show.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Rotation3, Vector3};
use rayon::prelude::*;

use super::connect::update;
use super::device::{DeviceView, device_views, label_device};
use super::distance_search;
use super::pair::{CommonPair, DOTS_FOR_A_PAIR, common_dots};
use super::resection::intersect_new_points;
use super::scale::apply_frame;
use super::{Halt, StageError};
use crate::geometry::Pose;
use crate::monitor::Monitor;
use crate::network::{
    About, Finding, FindingKind, ImageEntry, ImageId, InteriorSource, Network, Point, PointId,
    Stage, Station,
};
use crate::orientation::relative::RelativePose;

/// Pairs of images that are tried for a relative orientation: those with most common dots.
const PAIRS_TO_ORIENT: usize = 24;

/// Pairs that are built into a network before the stage gives up.
const PAIRS_TO_BUILD: usize = 12;

/// Angle between the rays beyond which more is no gain, radians (35 degrees).
const ANGLE_ENOUGH: f64 = 0.6;

/// Fewest code dots with coordinates that let the third image be connected.
const POINTS_TO_GO_ON: usize = 4;

/// Two oriented images under trial.
#[derive(Clone, Debug)]
struct Start {
    images: [ImageId; 2],
    poses: [Pose; 2],
    score: f64,
}

/// Orients the first pair, with a searched principal distance where none was stated.
pub(super) fn run(network: &mut Network, monitor: &Monitor) -> Result<(), Halt> {
    if distance_search::is_needed(network) {
        distance_search::run(network, monitor)?;
    }
    orient(network, monitor)
}

/// Orients the first pair: candidates in the order of their score, the first one that makes a network.
pub(super) fn orient(network: &mut Network, monitor: &Monitor) -> Result<(), Halt> {
    let with_targets: Vec<(ImageId, &ImageEntry)> = network
        .used_images()
        .filter(|(_, image)| {
            image
                .detections
                .as_ref()
                .is_some_and(|d| !d.dots.is_empty())
        })
        .collect();
    if with_targets.len() < 2 {
        return Err(Halt::Failed(StageError::TooFewImages {
            found: with_targets.len(),
        }));
    }
    let views = device_views(network, monitor)?;
    for view in &views {
        label_device(network, view);
    }
    let mut starts = starts_from_device(network, &views);
    let mut reason = if network.device.is_empty() {
        String::new()
    } else {
        format!("the cross was recognised in {} images; ", views.len())
    };
    match build_best(network, &starts, monitor)? {
        Ok(()) => return Ok(()),
        Err(why) if !starts.is_empty() => reason.push_str(&format!("from the cross: {why}; ")),
        Err(_) => {}
    }
    starts = starts_from_codes(network, monitor)?;
    if starts.is_empty() {
        let most = pairs_by_common_dots(network, 1)
            .first()
            .map_or(0, |pair| pair.dots.len());
        reason.push_str(&format!(
            "the two images with most codes in common share {most} code dots, {DOTS_FOR_A_PAIR} that fit are needed"
        ));
        return Err(Halt::Failed(StageError::NoFirstPair { reason }));
    }
    match build_best(network, &starts, monitor)? {
        Ok(()) => Ok(()),
        Err(why) => {
            reason.push_str(&format!("from the codes: {why}"));
            Err(Halt::Failed(StageError::NoFirstPair { reason }))
        }
    }
}

/// Builds the pairs in order of their score until one gives a network; `Ok(Err(reason))` where none does.
fn build_best(
    network: &mut Network,
    starts: &[Start],
    monitor: &Monitor,
) -> Result<Result<(), String>, Halt> {
    let task = monitor.task(
        "orienting the first pair",
        starts.len().min(PAIRS_TO_BUILD) as u64,
    );
    let mut reason = "no pair to start from".to_owned();
    for start in starts.iter().take(PAIRS_TO_BUILD) {
        task.step()?;
        match build(network, start, monitor) {
            Ok(built) => {
                *network = built;
                return Ok(Ok(()));
            }
            Err(Halt::Interrupted) => return Err(Halt::Interrupted),
            Err(Halt::Failed(error)) => reason = error.to_string(),
        }
    }
    Ok(Err(reason))
}

/// The network of two images: stations, the cross, the codes that both show, adjusted.
fn build(network: &Network, start: &Start, monitor: &Monitor) -> Result<Network, Halt> {
    let mut built = network.clone();
    // An earlier network's stations stand in its frame, which went with its points.
    let ids: Vec<ImageId> = built.images.keys().copied().collect();
    for id in ids {
        let image = &built.images[&id];
        if image.station.is_some() || image.attempt.is_some() {
            let image = built.image_mut(id);
            image.station = None;
            image.attempt = None;
        }
    }
    for (id, pose) in start.images.iter().zip(&start.poses) {
        built.image_mut(*id).station = Some(Station {
            pose: *pose,
            covariance: None,
            with_camera: None,
        });
    }
    built.connection_order = Arc::new(start.images.to_vec());
    built.points = Arc::default();
    built.tentative = Arc::default();
    built.ambiguous = Arc::default();
    built.moved_by = None;
    intersect_new_points(&mut built);
    apply_frame(&mut built);
    let codes = |network: &Network| {
        network
            .points
            .iter()
            .filter(|(id, p)| matches!(id, PointId::Code { .. }) && p.rays >= 2)
            .count()
    };
    if codes(&built) < POINTS_TO_GO_ON {
        let found = codes(&built);
        let reason = format!(
            "the pair gives coordinates to {found} code dots, {POINTS_TO_GO_ON} are needed"
        );
        return Err(Halt::Failed(StageError::NoFirstPair { reason }));
    }
    update(&mut built, monitor)?;
    built.points = Arc::new(still_supported(&built));
    if codes(&built) < POINTS_TO_GO_ON {
        let reason = "most rays of the pair do not meet".to_owned();
        return Err(Halt::Failed(StageError::NoFirstPair { reason }));
    }
    Ok(built)
}

/// The points that the pair's adjustment kept.
fn still_supported(network: &Network) -> BTreeMap<PointId, Arc<Point>> {
    network
        .points
        .iter()
        .filter(|(_, point)| point.covariance.is_some() && point.rays >= 2)
        .map(|(id, point)| (*id, Arc::clone(point)))
        .collect()
}

/// Cameras whose principal distance nobody stated.
pub(super) fn findings(network: &Network) -> Vec<Finding> {
    network
        .cameras
        .values()
        .filter(|camera| camera.source == InteriorSource::Unknown)
        .map(|camera| Finding {
            stage: Stage::FirstPair,
            kind: FindingKind::Camera,
            about: About::Camera(camera.name.clone()),
            text: format!(
                "camera '{}': no principal distance in a camera file or the images; searched, and started from {:.1} mm",
                camera.name, camera.nominal.interior.principal_distance
            ),
        })
        .collect()
}

/// Pairs of images that show the cross, best first: many common dots, rays at a good angle, the cross near the centres.
fn starts_from_device(network: &Network, views: &[DeviceView]) -> Vec<Start> {
    let mut starts = Vec::new();
    for (index, first) in views.iter().enumerate() {
        for second in &views[index + 1..] {
            let common = common_dots(
                &network.images[&first.image],
                &network.images[&second.image],
            )
            .len();
            for (rank_first, pose_first) in first.poses.iter().enumerate() {
                for (rank_second, pose_second) in second.poses.iter().enumerate() {
                    let to_first = pose_first.centre_in_world.normalize();
                    let to_second = pose_second.centre_in_world.normalize();
                    let angle = to_first
                        .cross(&to_second)
                        .norm()
                        .atan2(to_first.dot(&to_second));
                    let central = (first.centrality + second.centrality) / 2.0;
                    // A second pose of a flat cross is right only where the first one is wrong.
                    let unlikely = 0.25_f64.powi((rank_first + rank_second) as i32);
                    starts.push(Start {
                        images: [first.image, second.image],
                        poses: [*pose_first, *pose_second],
                        score: common as f64 * (angle / ANGLE_ENOUGH).min(1.0) * central * unlikely,
                    });
                }
            }
        }
    }
    sort_by_score(&mut starts);
    starts
}

/// Pairs of images with most codes in common, relatively oriented, best first.
fn starts_from_codes(network: &Network, monitor: &Monitor) -> Result<Vec<Start>, Halt> {
    let mut pairs = pairs_by_common_dots(network, PAIRS_TO_ORIENT);
    pairs.retain(|pair| pair.dots.len() >= DOTS_FOR_A_PAIR);
    let task = monitor.task("orienting pairs of images", pairs.len() as u64);
    let oriented: Vec<Vec<Start>> = pairs
        .par_iter()
        .map(|pair| {
            task.step()?;
            Ok(orient_pair(network, pair))
        })
        .collect::<Result<_, Halt>>()?;
    let mut starts: Vec<Start> = oriented.into_iter().flatten().collect();
    sort_by_score(&mut starts);
    Ok(starts)
}

fn sort_by_score(starts: &mut [Start]) {
    starts.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.images.cmp(&b.images)));
}

/// The pairs of images with most common dots, so many at most, the best first.
///
/// Cost: points times the squared number of images that show each.
fn pairs_by_common_dots(network: &Network, most: usize) -> Vec<CommonPair> {
    let images: Vec<(ImageId, &ImageEntry)> = network.used_images().collect();
    let mut shown_in: BTreeMap<PointId, Vec<usize>> = BTreeMap::new();
    for (index, (_, image)) in images.iter().enumerate() {
        for (_, label) in image.used_labels() {
            let shown = shown_in.entry(label.point).or_default();
            // Two dots of an image may have one name.
            if shown.last() != Some(&index) {
                shown.push(index);
            }
        }
    }
    let mut counts = vec![0_u32; images.len() * images.len()];
    for shown in shown_in.values() {
        for (place, &first) in shown.iter().enumerate() {
            for &second in &shown[place + 1..] {
                counts[first * images.len() + second] += 1;
            }
        }
    }
    let mut pairs: Vec<(u32, [usize; 2])> = (0..)
        .zip(counts)
        .filter(|(_, count)| *count > 0)
        .map(|(slot, count)| (count, [slot / images.len(), slot % images.len()]))
        .collect();
    pairs.sort_by_key(|(count, pair)| (std::cmp::Reverse(*count), pair.map(|i| images[i].0)));
    pairs.truncate(most);
    let pair =
        |(_, pair): (u32, [usize; 2])| CommonPair::of(network, pair.map(|index| images[index].0));
    pairs.into_iter().map(pair).collect()
}

/// The relative orientations of a pair; on flat scenes there may be two, of which the network decides.
fn orient_pair(network: &Network, pair: &CommonPair) -> Vec<Start> {
    let start = |pose: RelativePose| Start {
        images: pair.images,
        poses: [
            Pose {
                camera_from_world: Rotation3::identity(),
                centre_in_world: Vector3::zeros(),
            },
            pose.second,
        ],
        score: pose.inlier_count as f64 * (pose.median_angle / ANGLE_ENOUGH).min(1.0)
            / (1.0 + pose.rms_px),
    };
    pair.oriented(network)
        .into_iter()
        .flat_map(|found| std::iter::once(found.best).chain(found.alternative))
        .map(start)
        .collect()
}
