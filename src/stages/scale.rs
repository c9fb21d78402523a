//! Where the scale of the coordinates comes from, and moving a whole network.

use std::sync::Arc;

use nalgebra::{Matrix6, Vector3};

use crate::geometry::{Pose, Scale, Similarity, fit_similarity};
use crate::network::{
    BarRole, CodeDot, ControlRole, DevicePoint, ImageUse, Network, PointId, ScaleBar, ScaleSource,
    Station,
};
use crate::targets::Family;

/// Length of the first base where nothing gives scale, mm.
const ARBITRARY_BASE_MM: f64 = 1000.0;

/// The scale bars that enter the adjustment: both ends have coordinates.
pub(super) fn control_bars(network: &Network) -> Vec<(&ScaleBar, [PointId; 2])> {
    bars_in_reach(network)
        .into_iter()
        .filter(|(bar, _)| bar.role == BarRole::Control)
        .collect()
}

/// All scale bars whose ends both have coordinates.
pub(super) fn bars_in_reach(network: &Network) -> Vec<(&ScaleBar, [PointId; 2])> {
    let end = |label: &str| {
        network
            .point_of_label(label)
            .ok()
            .filter(|id| network.points.contains_key(id))
    };
    network
        .scale_bars
        .iter()
        .filter_map(|bar| Some((bar, [end(&bar.from)?, end(&bar.to)?])))
        .collect()
}

/// Where the scale comes from: control, else bars, else the cross, else the codes' pitch, else it is arbitrary.
pub(super) fn scale_source(network: &Network) -> ScaleSource {
    if aligning_control(network).len() >= 3 {
        ScaleSource::Control
    } else if !control_bars(network).is_empty() {
        ScaleSource::Bars
    } else if device_pairs(network).len() >= 3 {
        ScaleSource::Cross
    } else if !code_lengths(network).is_empty() {
        ScaleSource::Codes
    } else {
        ScaleSource::Arbitrary
    }
}

/// Gives the network the scale of its source by multiplying all lengths; the adjustment keeps that scale in the mean,
/// or, with bars, improves it.
fn apply_scale(network: &mut Network) {
    let lengths: Vec<Lengths> = match scale_source(network) {
        ScaleSource::Control => pair_lengths(&aligning_control(network)),
        ScaleSource::Bars => control_bars(network)
            .iter()
            .map(|(bar, [from, to])| Lengths {
                known: bar.length_mm,
                present: (network.points[from].position - network.points[to].position).norm(),
            })
            .collect(),
        ScaleSource::Cross => pair_lengths(&device_pairs(network)),
        ScaleSource::Codes => code_lengths(network),
        ScaleSource::Arbitrary => first_base(network).into_iter().collect(),
    };
    // Ratio of sums: long lengths, which are relatively the most exact, weigh most.
    let known: f64 = lengths.iter().map(|l| l.known).sum();
    let present: f64 = lengths.iter().map(|l| l.present).sum();
    if known > 0.0 && present > 0.0 {
        transform(
            network,
            &Similarity {
                scale: known / present,
                ..Similarity::identity()
            },
        );
    }
}

/// Moves the whole network (points, stations, their covariances) by a similarity.
pub(super) fn transform(network: &mut Network, similarity: &Similarity) {
    let rotation = similarity.rotation;
    let spread = similarity.scale * rotation.matrix();
    for point in Arc::make_mut(&mut network.points).values_mut() {
        let point = Arc::make_mut(point);
        point.position = similarity.apply(&point.position);
        point.covariance = point.covariance.map(|q| spread * q * spread.transpose());
    }
    // Excluded images too: one that is used again must not stand in an old frame.
    let ids: Vec<_> = network.images.keys().copied().collect();
    for id in ids {
        if network.images[&id].station.is_none() {
            continue;
        }
        let Some(station) = &mut network.image_mut(id).station else {
            continue;
        };
        let Station { pose, covariance } = station;
        *pose = Pose {
            camera_from_world: pose.camera_from_world * rotation.inverse(),
            centre_in_world: similarity.apply(&pose.centre_in_world),
        };
        // The turn is counted in the camera frame, which does not move.
        *covariance = covariance.map(|q| {
            let mut by_old = Matrix6::identity();
            by_old.fixed_view_mut::<3, 3>(3, 3).copy_from(&spread);
            by_old * q * by_old.transpose()
        });
    }
}

/// Gives the network the scale of its source, and the frame of its control points where three or more have coordinates:
/// weighted control has to find the network near it.
pub(super) fn apply_frame(network: &mut Network) {
    apply_scale(network);
    align_to_control(network);
}

/// Moves the network onto its control points by a best fit where three or more of them have coordinates.
pub(super) fn align_to_control(network: &mut Network) {
    let pairs = aligning_control(network);
    if let Ok(fit) = fit_similarity(&pairs, Scale::Free) {
        transform(network, &fit);
    }
}

/// Pairs (present, known) of the points the network is to be aligned to.
fn aligning_control(network: &Network) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    network
        .control
        .iter()
        .filter(|point| point.role != ControlRole::Check)
        .filter_map(|point| {
            let [x, y, z] = point.coordinates_mm;
            let id = network.point_of_label(&point.label).ok()?;
            Some((network.points.get(&id)?.position, Vector3::new(x?, y?, z?)))
        })
        .collect()
}

/// Pairs (present, known) of the cross.
pub(super) fn device_pairs(network: &Network) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let known = |point: &DevicePoint| Vector3::from(point.position_mm);
    network
        .device
        .iter()
        .enumerate()
        .filter_map(|(index, point)| {
            let found = network.points.get(&PointId::Device(index as u16))?;
            Some((found.position, known(point)))
        })
        .collect()
}

/// A length in the network beside the one it should have, mm.
struct Lengths {
    known: f64,
    present: f64,
}

/// All distances between the points of (present, known) pairs.
fn pair_lengths(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Vec<Lengths> {
    let mut lengths = Vec::new();
    for (index, a) in pairs.iter().enumerate() {
        for b in &pairs[index + 1..] {
            lengths.push(Lengths {
                known: (a.1 - b.1).norm(),
                present: (a.0 - b.0).norm(),
            });
        }
    }
    lengths
}

/// The axes O-A and O-B of all `dot420` codes.
fn code_lengths(network: &Network) -> Vec<Lengths> {
    let axis = 6.0 * network.settings.targets.of(Family::Dot420).pitch_mm;
    let mut lengths = Vec::new();
    for (id, origin) in network.points.iter() {
        let PointId::Code {
            family: Family::Dot420,
            code,
            dot: CodeDot::O,
        } = *id
        else {
            continue;
        };
        for dot in [CodeDot::A, CodeDot::B] {
            let end = PointId::Code {
                family: Family::Dot420,
                code,
                dot,
            };
            if let Some(end) = network.points.get(&end) {
                lengths.push(Lengths {
                    known: axis,
                    present: (end.position - origin.position).norm(),
                });
            }
        }
    }
    lengths
}

/// The distance of the first two images of those in use.
fn first_base(network: &Network) -> Option<Lengths> {
    let mut centres = network.connection_order.iter().filter_map(|id| {
        let image = network.images.get(id)?;
        let station = image.station.as_ref()?;
        (image.usage == ImageUse::Used).then_some(station.pose.centre_in_world)
    });
    Some(Lengths {
        known: ARBITRARY_BASE_MM,
        present: (centres.next()? - centres.next()?).norm(),
    })
}
