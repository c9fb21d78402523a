//! The frame of the result: by three points, picked in a view and typed.

use egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable as _;
use nalgebra::Vector3;
use tiepoint::network::{Network, PointId};

use crate::bench::{Begun, Bench, first_image, folder, targets_of};

/// Least difference of coordinates that counts, mm: a million times less than a sigma.
const SAME_MM: f64 = 1e-7;

fn position(network: &Network, point: PointId) -> Vector3<f64> {
    network.points[&point].position
}

#[test]
fn three_points_set_the_frame_of_the_result() {
    let folder = folder("frame", Begun::Measured);
    let mut bench = Bench::open(&folder.at("p.tiepoint"));
    let before = bench.network();
    let targets = targets_of(&before, first_image(&bench));
    let [origin, axis, plane] = [targets[0], targets[1], targets[3]];
    // The origin is picked in the picture, the others are typed.
    let at = bench.zoom_to(origin.image, origin.place_px);
    bench.click_at(at);
    bench.keys(Modifiers::ALT, Key::A);
    bench.click("3-2-1");
    bench.click("Origin from selection");
    for (field, seen) in [("Axis", axis), ("Plane", plane)] {
        bench.click(field);
        bench.write(&before.label(seen.point));
    }
    bench.window.get_by_label("Set frame").scroll_to_me();
    bench.settle();
    bench.click("Set frame");
    bench.rest();

    let after = bench.network();
    assert!(after.adjustment_is_fresh(), "{}", bench.app().message());
    let [origin, axis, plane] = [origin, axis, plane].map(|seen| seen.point);
    let shift = position(&after, origin);
    assert!(shift.norm() < SAME_MM, "{shift} {:?}", after.frame);
    let along = position(&after, axis);
    assert!(along.x > 0.0 && along.yz().norm() < SAME_MM, "{along}");
    let beside = position(&after, plane);
    assert!(beside.y > 0.0 && beside.z.abs() < SAME_MM, "{beside}");
    // The frame moves the points, not their distances; the covariances go with it.
    let distance = |network: &Network| (position(network, axis) - position(network, plane)).norm();
    assert!((distance(&after) - distance(&before)).abs() < 1e-4);
    let variance = after.points[&origin]
        .covariance
        .expect("covariances")
        .trace();
    assert!(
        variance.abs() < SAME_MM,
        "the origin has no sigma of its own"
    );

    let undone = |bench: &mut Bench| {
        for _ in 0..bench.history().len() {
            bench.keys(Modifiers::COMMAND, Key::Z);
        }
    };
    undone(&mut bench);
    assert_eq!(position(&bench.network(), axis), position(&before, axis));
    assert!(bench.window.query_by_label("Automatic").is_some());
}
