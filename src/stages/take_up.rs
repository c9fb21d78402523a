//! Codes that were set aside are looked at again where stations and lenses are known better.
//!
//! While a network grows, its lens is held near nominal values, and an image may be oriented wrongly until more is known. A code
//! that lay far from its place then may lie on it now.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::code_shape::CodeShapes;
use super::resection::{intersect_new_points, lens_limit};
use super::set_aside::{readings_aside, take_reading_up};
use crate::network::{Code, ImageId, Network, PointId};
use crate::targets::{DotIndex, Family};

/// A reading is taken up where all of its dots lie so near to their places, px: with a nominal lens, and with a calibrated one. The
/// adjustment tests them then one by one.
const ON_ITS_PLACE_PX: [f64; 2] = [10.0, 3.0];

/// A reading that was set aside.
struct Aside {
    image: ImageId,
    place: usize,
    code: Code,
    dots: Vec<(DotIndex, PointId)>,
}

/// Gives the names back to the readings whose dots lie where the network has the code; a code without coordinates gets them from
/// these readings, where they agree and have its shape. Whether there were any.
pub(super) fn take_up_codes(network: &mut Network) -> bool {
    let aside = all_aside(network);
    if aside.is_empty() {
        return false;
    }
    let trial = with_lost_codes(network, &aside);
    let limit = lens_limit(network, ON_ITS_PLACE_PX);
    let lies = |reading: &Aside| {
        let image = &network.images[&reading.image];
        let (Some(station), Some(detections)) = (&image.station, &image.detections) else {
            return false;
        };
        let camera = &network.camera_of(image).camera;
        reading.dots.iter().all(|(dot, point)| {
            let place = trial
                .points
                .get(point)
                .and_then(|point| camera.project(&station.pose.camera_from_point(&point.position)));
            let centre = detections.dots[dot.slot()].centre_px;
            place.is_some_and(|place| (place - centre).norm() < limit)
        })
    };
    let on_their_places: Vec<&Aside> = aside.iter().filter(|reading| lies(reading)).collect();
    for reading in &on_their_places {
        take_reading_up(network.image_mut(reading.image), reading.place);
    }
    intersect_new_points(network);
    !on_their_places.is_empty()
}

fn all_aside(network: &Network) -> Vec<Aside> {
    let mut aside = Vec::new();
    for (id, image, _) in network.oriented_images() {
        for place in readings_aside(image) {
            let Some(detections) = &image.detections else {
                continue;
            };
            let reading = &detections.codes[place];
            let points = PointId::of_code(reading.family, reading.id);
            aside.push(Aside {
                image: id,
                place,
                code: (reading.family, reading.id),
                dots: reading.dots.iter().copied().zip(points).collect(),
            });
        }
    }
    aside
}

/// The network with coordinates also of the codes that have none, as far as the readings that were set aside give them.
fn with_lost_codes(network: &Network, aside: &[Aside]) -> Network {
    let known: BTreeSet<Code> = network.points.keys().filter_map(|id| id.code()).collect();
    let mut lost = BTreeSet::new();
    let mut trial = network.clone();
    for reading in aside
        .iter()
        .filter(|reading| !known.contains(&reading.code))
    {
        take_reading_up(trial.image_mut(reading.image), reading.place);
        lost.insert(reading.code);
    }
    intersect_new_points(&mut trial);
    let shapes = CodeShapes::of(network);
    let refused = |point: &PointId| match point.code() {
        Some((Family::Dot420, code)) if lost.contains(&(Family::Dot420, code)) => {
            !shapes.fits_as_well(&trial, code)
        }
        _ => false,
    };
    let refused: Vec<PointId> = trial
        .points
        .keys()
        .filter(|id| refused(id))
        .copied()
        .collect();
    let points = Arc::make_mut(&mut trial.points);
    for point in refused {
        points.remove(&point);
    }
    trial
}
