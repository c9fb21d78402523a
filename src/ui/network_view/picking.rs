//! What is under the pointer, by projecting everything: 22,000 places take a fraction of a millisecond.

use egui::Pos2;
use egui::Rect;
use glam::DVec3;

use super::camera::OrbitCamera;
use super::camera::Projected;
use super::options::DisplayOptions;
use super::scene::Scene;
use crate::network::ImageId;
use crate::network::PointId;

/// Farthest from the pointer, screen points.
pub const PICK_RADIUS: f32 = 8.0;
/// Within so much more than the nearest, screen points, what is nearer to the eye is meant.
const SAME_PLACE: f32 = 1.5;

/// Something that can be clicked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// A point.
    Point(PointId),
    /// The centre of a station.
    Station(ImageId),
}

/// What is under the pointer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Picked {
    pub(super) target: Target,
    pub(super) place: DVec3,
    pub(super) seen: Projected,
}

/// The point or station nearest to the pointer, at most [`PICK_RADIUS`] away.
pub(super) fn pick(
    scene: &Scene,
    options: &DisplayOptions,
    camera: &OrbitCamera,
    canvas: Rect,
    pointer: Pos2,
) -> Option<Picked> {
    let projector = camera.projector(canvas);
    let points = scene
        .points
        .iter()
        .map(|point| (Target::Point(point.id), point.position));
    let shown = if options.stations.is_shown() {
        scene.stations.as_slice()
    } else {
        &[]
    };
    let stations = shown
        .iter()
        .map(|station| (Target::Station(station.id), station.centre));
    let near: Vec<(f32, Picked)> = points
        .chain(stations)
        .filter_map(|(target, place)| {
            let seen = projector.project(place)?;
            let distance = seen.position.distance(pointer);
            (distance <= PICK_RADIUS).then_some((
                distance,
                Picked {
                    target,
                    place,
                    seen,
                },
            ))
        })
        .collect();
    let nearest = near
        .iter()
        .map(|(distance, _)| *distance)
        .fold(f32::INFINITY, f32::min);
    near.into_iter()
        .filter(|(distance, _)| *distance <= nearest + SAME_PLACE)
        .map(|(_, picked)| picked)
        .min_by(|a, b| a.seen.depth.total_cmp(&b.seen.depth))
}
