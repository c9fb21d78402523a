//! Where the scale of the coordinates comes from, and moving a whole network.

use std::sync::Arc;

use nalgebra::{Matrix6, Vector3};

use crate::geometry::{Pose, Scale, Similarity, fit_similarity};
use crate::network::{
    BarRole, CodeDot, DevicePoint, Frame, ImageUse, Network, PointId, ScaleBar, ScaleSource,
    Station, length_at_reference,
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
    if network.control_pairs().len() >= 3 {
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
        ScaleSource::Control => pair_lengths(&network.control_pairs()),
        ScaleSource::Bars => control_bars(network)
            .iter()
            .map(|(bar, [from, to])| Lengths {
                known: network.bar_length_mm(bar),
                present: (network.points[from].position - network.points[to].position).norm(),
            })
            .collect(),
        ScaleSource::Cross => at_reference(network, pair_lengths(&device_pairs(network))),
        ScaleSource::Codes => at_reference(network, code_lengths(network)),
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

/// Moves the whole network (points with their circles, stations, all covariances) by a similarity.
pub(super) fn transform(network: &mut Network, similarity: &Similarity) {
    let rotation = similarity.rotation;
    let spread = similarity.scale * rotation.matrix();
    for point in Arc::make_mut(&mut network.points).values_mut() {
        let point = Arc::make_mut(point);
        point.position = similarity.apply(&point.position);
        point.covariance = point.covariance.map(|q| spread * q * spread.transpose());
        point.circle = point.circle.map(|circle| circle.moved(similarity));
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
        let Station {
            pose,
            covariance,
            with_camera,
        } = station;
        *pose = Pose {
            camera_from_world: pose.camera_from_world * rotation.inverse(),
            centre_in_world: similarity.apply(&pose.centre_in_world),
        };
        // The turn is counted in the camera frame, which does not move.
        let mut by_old = Matrix6::identity();
        by_old.fixed_view_mut::<3, 3>(3, 3).copy_from(&spread);
        *covariance = covariance.map(|q| by_old * q * by_old.transpose());
        *with_camera = with_camera.map(|q| by_old * q);
    }
}

/// Gives the network the scale of its source, and the frame of its control points where three or more have coordinates:
/// weighted control has to find the network near it.
pub(super) fn apply_frame(network: &mut Network) {
    apply_scale(network);
    align_to_control(network);
}

/// Moves the network onto its control points by a best fit where three or more of them have coordinates. Where the
/// operator wants the network's own frame, the fit gives its scale alone.
pub(super) fn align_to_control(network: &mut Network) {
    let Ok(fit) = fit_similarity(&network.control_pairs(), Scale::Free) else {
        return;
    };
    if network.frame == Frame::Free && !network.control_holds() {
        let places = || network.points.values().map(|point| point.position);
        let centre = places().sum::<Vector3<f64>>() / places().count().max(1) as f64;
        let scaled = Similarity {
            scale: fit.scale,
            translation: (1.0 - fit.scale) * centre,
            ..Similarity::identity()
        };
        transform(network, &scaled);
    } else {
        transform(network, &fit);
        network.moved_by = None;
    }
}

/// Brings the network back from a frame by three points into its own: there it is adjusted, so that a choice of frame
/// leaves no trace in the digits.
pub(super) fn leave_frame(network: &mut Network) {
    if let Some(motion) = network.moved_by.take() {
        transform(network, &motion.inverse());
    }
}

/// Gives a network that `motion` has just brought into a frame by three points the scale of its control points, which
/// moves nothing out of that frame; remembers how it came there.
pub(super) fn keep_frame(network: &mut Network, motion: Similarity) {
    network.moved_by = Some(motion);
    if let Ok(fit) = fit_similarity(&network.control_pairs(), Scale::Free) {
        let scaled = Similarity {
            scale: fit.scale,
            ..Similarity::identity()
        };
        transform(network, &scaled);
        // Without the frame it would stand on its control points.
        let own = Similarity { scale: 1.0, ..fit };
        network.moved_by = Some(own.inverse());
    }
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

/// Lengths that hold at the photographs as those that the object shows at its reference temperature.
fn at_reference(network: &Network, mut lengths: Vec<Lengths>) -> Vec<Lengths> {
    for length in &mut lengths {
        length.known = length_at_reference(length.known, None, network.object());
    }
    lengths
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{Expansion, Point};

    fn warm(per_k: f64) -> Expansion {
        Expansion {
            per_k,
            temperature_c: 30.0,
            reference_c: 20.0,
        }
    }

    /// Two points 400 mm apart, which are also the ends of a bar.
    fn network() -> Network {
        let places = [(1, 0.0), (2, 400.0)];
        let points = places.map(|(number, x)| {
            let point = Point {
                position: Vector3::new(x, 0.0, 0.0),
                covariance: None,
                rays: 2,
                circle: None,
            };
            (PointId::Target(number), Arc::new(point))
        });
        let bar = ScaleBar {
            name: "steel".into(),
            from: "M1".into(),
            to: "M2".into(),
            length_mm: 1000.0,
            sigma_mm: 0.01,
            role: BarRole::Control,
            expansion: Some(warm(11.5e-6)),
        };
        Network {
            points: Arc::new(points.into()),
            scale_bars: Arc::new(vec![bar]),
            ..Network::default()
        }
    }

    fn length(network: &Network) -> f64 {
        let place = |number| network.points[&PointId::Target(number)].position;
        (place(1) - place(2)).norm()
    }

    #[test]
    fn the_scale_is_that_of_the_warm_bar_at_the_reference_temperature_of_the_object() {
        let mut network = network();
        apply_frame(&mut network);
        assert!((length(&network) - 1000.115).abs() < 1e-9);
        let settings = Arc::make_mut(&mut network.settings);
        settings.targets.object = Some(warm(23e-6));
        apply_frame(&mut network);
        assert!((length(&network) - 1000.115 / 1.00023).abs() < 1e-9);
    }

    #[test]
    fn lengths_without_a_bar_are_brought_to_the_reference_temperature_too() {
        let mut network = network();
        let lengths = vec![Lengths {
            known: 30.0,
            present: 30.0,
        }];
        let settings = Arc::make_mut(&mut network.settings);
        settings.targets.object = Some(warm(23e-6));
        let brought = at_reference(&network, lengths);
        assert!((brought[0].known - 30.0 / 1.00023).abs() < 1e-12);
    }
}
