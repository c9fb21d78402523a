//! Circles through the stages: found, settled, moved along.

use nalgebra::Vector3;

use super::circles::{SETTLED_PX, carried, estimated, largest_change};
use super::trial::{code_panel, measured, run};
use crate::geometry::{AxisOrder, ThreeTwoOne};
use crate::monitor::Monitor;
use crate::network::{Frame, Network, Stage};
use crate::project::edit::Edit;

/// Largest difference between the residuals of the adjustment and what the network predicts, px.
fn largest_contradiction(network: &Network) -> f64 {
    let adjustment = network.adjustment.as_ref().unwrap();
    let mut largest = 0.0_f64;
    for row in &adjustment.observations {
        let image = &network.images[&row.image];
        let pose = &image.station.as_ref().unwrap().pose;
        let measured = image.detections.as_ref().unwrap().dots[row.dot.slot()].centre_px;
        let point = &network.points[&row.point];
        let predicted = network
            .camera_of(image)
            .camera
            .image_of_target(pose, &point.position, point.circle.as_ref())
            .unwrap();
        largest = largest.max((predicted - measured - row.residual_px).norm());
    }
    largest
}

fn plane_of_panel(network: &Network) -> Vector3<f64> {
    let points = network.points.values();
    let places: Vec<Vector3<f64>> = points.map(|p| p.position).collect();
    crate::geometry::fit_plane(&places).unwrap().plane.normal
}

#[test]
fn dots_of_codes_have_the_normal_of_their_plane_and_nothing_changes_any_more() {
    let network = run(measured(&code_panel(6)), Stage::AdjustCodes);
    let (carried, again) = (
        carried(&network),
        estimated(&network, &Monitor::new()).expect("nobody interrupts"),
    );
    assert_eq!(carried.len(), network.points.len());
    let change =
        |to| largest_change(&network, &carried, to, &Monitor::new()).expect("nobody interrupts");
    assert!(change(&again) < SETTLED_PX);
    assert!(change(&Default::default()) > 10.0 * SETTLED_PX);
    let plane = plane_of_panel(&network);
    for (id, circle) in &carried {
        assert!(
            circle.normal.dot(&plane).abs() > 0.999,
            "{id}: {}",
            circle.normal
        );
    }
    assert!(largest_contradiction(&network) < 1e-9);
}

#[test]
fn a_frame_by_three_points_turns_the_circles_along() {
    let network = run(measured(&code_panel(6)), Stage::Adjust);
    let mut three = network.points.keys().copied().step_by(9);
    let frame = Frame::ThreeTwoOne(ThreeTwoOne {
        origin: three.next().unwrap(),
        axis: three.next().unwrap(),
        plane: three.next().unwrap(),
        order: AxisOrder::Xz,
    });
    let mut framed = network.clone();
    Edit::Frame(frame).apply(&mut framed).unwrap();
    let framed = run(framed, Stage::Adjust);
    assert!(framed.moved_by.is_some());
    assert!(largest_contradiction(&network) < 1e-9);
    assert!(largest_contradiction(&framed) < 1e-9);
    let turned = plane_of_panel(&framed);
    for point in framed.points.values() {
        assert!(point.circle.unwrap().normal.dot(&turned).abs() > 0.999);
    }
}
