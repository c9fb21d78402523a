//! The circles of round targets, from what the network knows.
//!
//! The dots of a six-dot code lie in the plane through its own adjusted dots. Any other dot has the normal on which its
//! ellipses agree, over all its rays; where they leave it loose, that of the plane of its neighbours, if that is flat. The
//! radius is what the ellipses say under that normal, and the nominal one only where none says anything. A target of which
//! nothing of this can be had carries no circle, and its dots are taken as images of its centre.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::adjustment::{EllipseSight, MeasuredEllipse, estimate_circle, estimate_radius};
use crate::camera::EllipseImage;
use crate::geometry::{Circle, fit_plane};
use crate::matching::{EllipsePair, EllipsePrecision};
use crate::monitor::{Interrupted, Monitor};
use crate::network::{ImageEntry, ImageId, Network, PointId, Station};
use crate::targets::Family;

/// Eccentricities that change by less than this, px, are settled: a hundredth of what the best dots' sigmas are.
pub(super) const SETTLED_PX: f64 = 1e-4;

/// A normal whose standard deviation is larger, rad (10 degrees), is not used: from there on it leaves a good part of the
/// eccentricity, or adds as much.
const LOOSEST_NORMAL: f64 = 0.17;

/// Dots of a code (or neighbours) that make a plane.
const DOTS_OF_PLANE: usize = 4;

/// Points lie in a plane when their rms distance from it is less than this share of their spread along it.
const FLAT: f64 = 0.02;

/// The smaller spread of points along a plane is at least this share of the larger: a strip may turn about its length.
const BROAD: f64 = 0.2;

/// The plane of neighbours is that of so many nearest points.
const NEIGHBOURS: usize = 6;

/// The circles of points by point; those that have none are left out.
pub(super) type Circles = BTreeMap<PointId, Circle>;

/// The circles of all points that two or more oriented images show.
///
/// # Errors
/// [`Interrupted`] when the work was asked to stop.
pub(super) fn estimated(network: &Network, monitor: &Monitor) -> Result<Circles, Interrupted> {
    let sights = sights_of_points(network, monitor)?;
    let planes = planes_of_codes(network);
    let points: Vec<(PointId, Vec<EllipseSight>)> =
        sights.into_iter().filter(|(_, s)| s.len() > 1).collect();
    let circle = |(id, sights): &(PointId, Vec<EllipseSight>)| {
        let normal = match planes.get(id) {
            Some(normal) => *normal,
            None => {
                let agreed =
                    estimate_circle(sights).filter(|found| found.sigma_normal <= LOOSEST_NORMAL);
                match agreed {
                    Some(found) => return Some((*id, found.circle)),
                    None => normal_of_neighbours(network, *id)?,
                }
            }
        };
        let radius_mm =
            estimate_radius(sights, &normal).unwrap_or_else(|| nominal_radius(network, *id));
        Some((*id, Circle { normal, radius_mm }))
    };
    let circles: Vec<Option<(PointId, Circle)>> = points
        .par_iter()
        .map(|point| {
            monitor.check()?;
            Ok(circle(point))
        })
        .collect::<Result<_, Interrupted>>()?;
    Ok(circles.into_iter().flatten().collect())
}

/// The circles that the points carry.
pub(super) fn carried(network: &Network) -> Circles {
    let points = network.points.iter();
    points
        .filter_map(|(id, point)| Some((*id, point.circle?)))
        .collect()
}

/// Gives the points these circles and no others.
pub(super) fn carry(network: &mut Network, circles: &Circles) {
    for (id, point) in Arc::make_mut(&mut network.points) {
        let circle = circles.get(id).copied();
        if point.circle != circle {
            Arc::make_mut(point).circle = circle;
        }
    }
}

/// The largest change of an eccentricity, px, over all used dots.
pub(super) fn largest_change(
    network: &Network,
    before: &Circles,
    after: &Circles,
    monitor: &Monitor,
) -> Result<f64, Interrupted> {
    let of_image = |(_, image, station): &(ImageId, &ImageEntry, &Station)| {
        monitor.check()?;
        let camera = &network.camera_of(image).camera;
        let mut largest = 0.0_f64;
        for (_, label) in image.used_labels() {
            let Some(point) = network.points.get(&label.point) else {
                continue;
            };
            let eccentricity = |circles: &Circles| {
                let circle = circles.get(&label.point)?;
                camera.eccentricity(&station.pose, &point.position, circle)
            };
            let change =
                eccentricity(before).unwrap_or_default() - eccentricity(after).unwrap_or_default();
            largest = largest.max(change.norm());
        }
        Ok(largest)
    };
    let images: Vec<_> = network.oriented_images().collect();
    let of_images = images.par_iter().map(of_image);
    of_images.try_reduce(|| 0.0, |a, b| Ok(a.max(b)))
}

/// The largest eccentricity of a used dot, px; 0 where no circle is known.
pub(super) fn largest_eccentricity(
    network: &Network,
    monitor: &Monitor,
) -> Result<f64, Interrupted> {
    largest_change(network, &carried(network), &Circles::new(), monitor)
}

/// How exact the ellipses of the plain targets are, from those that carry a circle; `None` before there are enough. Dots of codes do
/// not tell: they may be printed where targets are glued.
pub(super) fn ellipse_precision(network: &Network) -> Option<EllipsePrecision> {
    let of_image = |(_, image, station): &(ImageId, &ImageEntry, &Station)| {
        let mut pairs = Vec::new();
        let Some(detections) = &image.detections else {
            return pairs;
        };
        let camera = &network.camera_of(image).camera;
        for (dot, label) in image.used_labels() {
            if !matches!(label.point, PointId::Target(_)) {
                continue;
            }
            let point = network.points.get(&label.point);
            let expected = point.and_then(|point| {
                let circle = point.circle.as_ref()?;
                camera.ellipse_of_target(&station.pose, &point.position, circle)
            });
            if let (Some(point), Some(expected)) = (point, expected) {
                let dot = &detections.dots[dot.slot()];
                let measured = EllipseImage {
                    major_px: dot.major_px,
                    minor_px: dot.minor_px,
                    angle: dot.angle,
                };
                pairs.push(EllipsePair {
                    measured,
                    centre_px: dot.sigma_px,
                    expected,
                    rays: point.rays as usize,
                });
            }
        }
        pairs
    };
    let images: Vec<_> = network.oriented_images().collect();
    let pairs: Vec<Vec<EllipsePair>> = images.par_iter().map(of_image).collect();
    EllipsePrecision::measured(&pairs.concat())
}

/// The ellipses of every point with coordinates, in the order of the images.
fn sights_of_points(
    network: &Network,
    monitor: &Monitor,
) -> Result<BTreeMap<PointId, Vec<EllipseSight>>, Interrupted> {
    let mut sights: BTreeMap<PointId, Vec<EllipseSight>> = BTreeMap::new();
    for (_, image, station) in network.oriented_images() {
        monitor.check()?;
        let Some(detections) = &image.detections else {
            continue;
        };
        let camera = &network.camera_of(image).camera;
        for (dot, label) in image.used_labels() {
            let Some(point) = network.points.get(&label.point) else {
                continue;
            };
            let dot = &detections.dots[dot.slot()];
            let ellipse = MeasuredEllipse {
                major_px: dot.major_px,
                minor_px: dot.minor_px,
                angle: dot.angle,
                sigma_px: dot.sigma_px,
            };
            let sight = EllipseSight::new(camera, &station.pose, &point.position, &ellipse);
            sights.entry(label.point).or_default().extend(sight);
        }
    }
    Ok(sights)
}

/// The normal of every dot of a six-dot code, where the code's dots lie in a plane.
fn planes_of_codes(network: &Network) -> BTreeMap<PointId, Vector3<f64>> {
    let mut codes: BTreeMap<u32, Vec<PointId>> = BTreeMap::new();
    for id in network.points.keys() {
        if let Some((Family::Dot420, code)) = id.code() {
            codes.entry(code).or_default().push(*id);
        }
    }
    let mut normals = BTreeMap::new();
    for dots in codes.into_values() {
        let places: Vec<Vector3<f64>> = dots.iter().map(|d| network.points[d].position).collect();
        if let Some(normal) = normal_of(&places) {
            normals.extend(dots.into_iter().map(|dot| (dot, normal)));
        }
    }
    normals
}

fn normal_of_neighbours(network: &Network, id: PointId) -> Option<Vector3<f64>> {
    let here = network.points.get(&id)?.position;
    let mut near: Vec<(f64, Vector3<f64>)> = network
        .points
        .values()
        .map(|point| ((point.position - here).norm(), point.position))
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    // The first one is the point itself.
    near.truncate(NEIGHBOURS + 1);
    normal_of(&near.into_iter().map(|(_, place)| place).collect::<Vec<_>>())
}

/// The normal of points that lie in a plane; `None` where they do not, or are too few.
fn normal_of(places: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    if places.len() < DOTS_OF_PLANE {
        return None;
    }
    let fit = fit_plane(places).ok()?;
    let [long, short] = fit.spread;
    (fit.rms < FLAT * short && short > BROAD * long).then_some(fit.plane.normal)
}

/// The radius that the user states for targets of this kind, mm; the cross has plain targets.
fn nominal_radius(network: &Network, id: PointId) -> f64 {
    let sizes = &network.settings.targets;
    match id.code() {
        Some((family, _)) => sizes.of(family).dot_mm / 2.0,
        None => sizes.plain_dot_mm / 2.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(columns: u8, rows: u8, height: impl Fn(f64, f64) -> f64) -> Vec<Vector3<f64>> {
        let cells = (0..columns).flat_map(|x| (0..rows).map(move |y| (f64::from(x), f64::from(y))));
        cells
            .map(|(x, y)| Vector3::new(20.0 * x, 20.0 * y, height(x, y)))
            .collect()
    }

    #[test]
    fn only_flat_and_broad_neighbourhoods_tell_a_normal() {
        let normal = normal_of(&grid(3, 3, |x, _| 5.0 * x)).unwrap();
        let slope = Vector3::new(-0.25, 0.0, 1.0).normalize();
        assert!(normal.dot(&slope).abs() > 1.0 - 1e-12);
        assert_eq!(normal_of(&grid(3, 3, |x, y| 5.0 * x * y)), None, "bent");
        assert_eq!(normal_of(&grid(9, 1, |_, _| 0.0)), None, "a line");
        assert_eq!(normal_of(&grid(3, 1, |_, _| 0.0)), None, "too few");
    }
}
