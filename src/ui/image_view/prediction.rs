//! Where targets should be: points projected into an image, and rays of other images projected as curves.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Matrix6, SMatrix, Vector2, Vector3};

use super::visibility::Directions;
use crate::camera::Camera;
use crate::geometry::{Pose, skew};
use crate::network::{Absence, AbsenceKind, ImageEntry, ImageId, Network, Point, PointId};
use crate::targets::DotIndex;
use crate::ui::action::{Question, Selection};

/// A dot nearer than this to a predicted place is taken for the target, px.
const SAME_PLACE_PX: f64 = 3.0;
/// A point that an image should show and does not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Predicted {
    /// The point.
    pub point: PointId,
    /// Where it should be, px.
    pub place_px: Vector2<f64>,
    /// Whether it should be seen: as the last look at the image has it, before one as its other rays tell.
    pub facing: Facing,
    /// Whether it is turned to the camera, as far as its other rays tell: what is seen flatly is faint.
    pub turned: Facing,
    /// Why it is not there; `None` where nobody has looked, or where it is not to be seen.
    pub absence: Option<AbsenceKind>,
    /// Angle between its normal and the ray to this camera, degrees; `None` where its ellipses do not tell the normal.
    pub incidence_deg: Option<f64>,
    /// Angle between the ray to this camera and the nearest one that saw it, degrees; `None` where nothing saw it.
    pub nearest_deg: Option<f64>,
}

/// Whether a point's face is turned to a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Facing {
    /// It should be seen: the look for missing targets says so; before that, its normal is turned this way, as far as dots are
    /// measured, and other images see it from near this direction.
    Towards,
    /// It is turned away, seen from other sides only, or nothing is known of it.
    Unknown,
}

/// Standard deviation of a predicted place besides those of station and point, px: a circle or a lens that is
/// not known to the last. Without it points known to a micrometre would count as far from any dot.
const FLOOR_PX: f64 = 0.3;

/// How badly a place of an image fits a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Misfit {
    /// Distance from the predicted place, px.
    pub distance_px: f64,
    /// The same in standard deviations of the prediction.
    pub sigmas: f64,
    /// Twice the negative logarithm of the likelihood but for a constant; the smallest comes first. Sigmas alone would
    /// put a point that is hardly known before the one that lies there.
    pub rank: f64,
}

/// How badly a place of an image fits a point of the network; `None` without an orientation.
#[must_use]
pub fn misfit_of(
    network: &Network,
    entry: &ImageEntry,
    point: PointId,
    place_px: Vector2<f64>,
) -> Option<Misfit> {
    Sight::of(network, entry)?.misfit(network.points.get(&point)?, place_px)
}

/// A station with its camera.
#[derive(Clone, Copy)]
pub(super) struct Sight<'a> {
    pub(super) pose: &'a Pose,
    pub(super) camera: &'a Camera,
    covariance: Option<&'a Matrix6<f64>>,
}

impl<'a> Sight<'a> {
    pub(super) fn of(network: &'a Network, entry: &'a ImageEntry) -> Option<Self> {
        let station = entry.station.as_ref()?;
        let camera = &network.cameras.get(&entry.camera)?.camera;
        Some(Self {
            pose: &station.pose,
            camera,
            covariance: station.covariance.as_ref(),
        })
    }

    /// The pixel of a point of the object, inside the picture or not.
    pub(super) fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        self.camera.project(&self.pose.camera_from_point(point))
    }

    /// Where the dot of a target should be measured, inside the picture or not.
    pub(super) fn image_of(&self, target: &Point) -> Option<Vector2<f64>> {
        self.camera
            .image_of_target(self.pose, &target.position, target.circle.as_ref())
    }

    /// How badly a place fits a point; `None` where the point is behind the camera.
    pub(super) fn misfit(&self, point: &Point, place_px: Vector2<f64>) -> Option<Misfit> {
        let in_camera = self.pose.camera_from_point(&point.position);
        let projection = self.camera.project_with_jacobians(&in_camera)?;
        let turned = projection.by_point * self.pose.camera_from_world.matrix();
        let mut spread = Matrix2::identity() * (FLOOR_PX * FLOOR_PX);
        if let Some(covariance) = point.covariance {
            spread += turned * covariance * turned.transpose();
        }
        if let Some(covariance) = self.covariance {
            let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
            let by_turn = -projection.by_point * skew(&in_camera);
            by_pose.fixed_view_mut::<2, 3>(0, 0).copy_from(&by_turn);
            by_pose.fixed_view_mut::<2, 3>(0, 3).copy_from(&-turned);
            spread += by_pose * covariance * by_pose.transpose();
        }
        let apart = self.image_of(point)? - place_px;
        let squared = apart.dot(&(spread.try_inverse()? * apart));
        Some(Misfit {
            distance_px: apart.norm(),
            sigmas: squared.max(0.0).sqrt(),
            rank: squared + spread.determinant().ln(),
        })
    }
}

/// Targets that the image ought to show and does not, as the last look at it has them; and points that are projected into it, are
/// labelled nowhere in it and have no dot near their place. Whether they should be seen is for [`Predicted::facing`] to say.
#[must_use]
pub fn missed_targets(network: &Network, entry: &ImageEntry) -> Vec<Predicted> {
    let places = places_without_dot(network, entry);
    let points: Vec<PointId> = places.iter().map(|(point, _)| *point).collect();
    with_facing(
        network,
        entry,
        places,
        &Directions::of_points(network, &points),
    )
}

/// As [`missed_targets`], with the sides that points are seen from known beforehand.
#[must_use]
pub fn missed_with(
    network: &Network,
    entry: &ImageEntry,
    directions: &Directions,
) -> Vec<Predicted> {
    let places = places_without_dot(network, entry);
    with_facing(network, entry, places, directions)
}

fn with_facing(
    network: &Network,
    entry: &ImageEntry,
    places: Vec<(PointId, Vector2<f64>)>,
    directions: &Directions,
) -> Vec<Predicted> {
    let Some(sight) = Sight::of(network, entry) else {
        return Vec::new();
    };
    let looked = has_been_looked_at(entry);
    let absent = absent(entry);
    let predicted = |(point, place_px): (PointId, Vector2<f64>)| {
        let towards = sight.pose.centre_in_world - network.points.get(&point)?.position;
        let aspect = directions.aspect(point, &towards);
        let absence = absent.get(&point);
        let turned = aspect.map_or(Facing::Unknown, |aspect| aspect.facing);
        Some(Predicted {
            point,
            place_px,
            facing: match (looked, absence) {
                (true, Some(_)) => Facing::Towards,
                (true, None) => Facing::Unknown,
                (false, _) => turned,
            },
            turned,
            absence: absence.map(|absence| absence.kind),
            incidence_deg: aspect.and_then(|aspect| aspect.incidence_deg),
            nearest_deg: aspect.map(|aspect| aspect.nearest_deg),
        })
    };
    places.into_iter().filter_map(predicted).collect()
}

/// Whether the image was looked at for the targets that it ought to show.
fn has_been_looked_at(entry: &ImageEntry) -> bool {
    let look = entry.look.as_ref();
    look.is_some_and(|look| look.unreadable.is_none())
}

/// What the last look missed; nothing where there was none.
fn absent(entry: &ImageEntry) -> BTreeMap<PointId, &Absence> {
    let looked = has_been_looked_at(entry);
    entry.absent().filter(|_| looked).collect()
}

/// What the last look missed, at its places; and points within the picture without a label in it and without a dot near; in the order
/// of their names. None of which the operator says that it is not there.
fn places_without_dot(network: &Network, entry: &ImageEntry) -> Vec<(PointId, Vector2<f64>)> {
    let Some(sight) = Sight::of(network, entry) else {
        return Vec::new();
    };
    let mut rows: Vec<Vector2<f64>> = entry
        .detections
        .iter()
        .flat_map(|d| &d.dots)
        .map(|dot| dot.centre_px)
        .collect();
    rows.sort_by(|a, b| a.y.total_cmp(&b.y));
    let mut labelled: Vec<PointId> = entry.labels.values().map(|label| label.point).collect();
    labelled.sort_unstable();
    let absent = absent(entry);
    let mut places = Vec::new();
    for (id, point) in network.points.iter() {
        if labelled.binary_search(id).is_ok() || entry.not_there.contains(id) {
            continue;
        }
        if let Some(absence) = absent.get(id) {
            places.push((*id, absence.place_px));
            continue;
        }
        if let Some(place_px) = sight.image_of(point)
            && sight.camera.contains(&place_px)
            && !has_near(&rows, place_px)
        {
            places.push((*id, place_px));
        }
    }
    places
}

fn has_near(rows: &[Vector2<f64>], place: Vector2<f64>) -> bool {
    let first = rows.partition_point(|dot| dot.y < place.y - SAME_PLACE_PX);
    rows[first..]
        .iter()
        .take_while(|dot| dot.y <= place.y + SAME_PLACE_PX)
        .any(|dot| (dot - place).norm() <= SAME_PLACE_PX)
}

/// The images of the rays of what is selected in other images: of the dots of the reading in hand, of a dot, or of all dots of a point;
/// curves, bent by the lens.
pub(super) fn epipolar_lines(
    network: &Network,
    image: ImageId,
    selection: &Selection,
) -> Vec<Vec<Vector2<f64>>> {
    /// Lines of so many other images are drawn at most.
    const MOST_LINES: usize = 12;
    let Some(sight) = network
        .images
        .get(&image)
        .and_then(|entry| Sight::of(network, entry))
    else {
        return Vec::new();
    };
    let mut dots: Vec<(ImageId, DotIndex)> = Vec::new();
    let reading = selection.question.as_ref().and_then(Question::reading);
    match (reading, selection.dot, selection.point) {
        (Some(reading), ..) => {
            let others = reading.dots.iter().filter(|(other, _)| *other != image);
            dots.extend(others);
        }
        (None, Some((other, dot)), _) if other != image => dots.push((other, dot)),
        (None, _, Some(point)) => {
            for (other, entry, _) in network.oriented_images().filter(|(id, ..)| *id != image) {
                let label = entry.used_labels().find(|(_, label)| label.point == point);
                dots.extend(label.map(|(dot, _)| (other, dot)));
            }
        }
        _ => {}
    }
    dots.truncate(MOST_LINES);
    dots.into_iter()
        .filter_map(|(other, dot)| {
            let entry = network.images.get(&other)?;
            let place = entry.detections.as_ref()?.dots.get(dot.slot())?.centre_px;
            let from = Sight::of(network, entry)?;
            let depths = depths_from(network, from.pose)?;
            Some(image_of_ray(&from, place, depths, &sight))
        })
        .flatten()
        .collect()
}

/// Nearest and farthest distance of the points from a station, with room on both sides, mm.
fn depths_from(network: &Network, pose: &Pose) -> Option<[f64; 2]> {
    let distances = network
        .points
        .values()
        .map(|p| (p.position - pose.centre_in_world).norm());
    let (near, far) = distances.fold((f64::INFINITY, 0.0_f64), |(near, far), d| {
        (near.min(d), far.max(d))
    });
    (near.is_finite() && far > 0.0).then_some([0.4 * near, 2.5 * far])
}

/// The ray of a place, sampled at even steps of the inverse distance; cut where it leaves the picture.
fn image_of_ray(
    from: &Sight<'_>,
    place: Vector2<f64>,
    [near, far]: [f64; 2],
    into: &Sight<'_>,
) -> Vec<Vec<Vector2<f64>>> {
    const STEPS: u32 = 96;
    let direction = from
        .pose
        .world_from_direction(&from.camera.ray(&place))
        .normalize();
    let mut pieces = vec![Vec::new()];
    for step in 0..=STEPS {
        let share = f64::from(step) / f64::from(STEPS);
        let depth = 1.0 / ((1.0 - share) / near.max(1e-9) + share / far);
        let pixel = into.project(&(from.pose.centre_in_world + direction * depth));
        match pixel.filter(|pixel| into.camera.contains(pixel)) {
            Some(pixel) => pieces
                .last_mut()
                .into_iter()
                .for_each(|piece| piece.push(pixel)),
            None if pieces.last().is_some_and(|piece| !piece.is_empty()) => pieces.push(Vec::new()),
            None => {}
        }
    }
    pieces.retain(|piece| piece.len() > 1);
    pieces
}
