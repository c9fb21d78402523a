//! The frame of the result through the stages: set, taken back, refused, gone on with.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::trial::{code_panel, measured, run, texts};
use crate::geometry::{AxisOrder, ThreeTwoOne};
use crate::network::{
    ControlPoint, ControlRole, FindingKind, Frame, ImageId, ImageUse, Network, PointId, Stage,
};
use crate::project::edit::Edit;
use crate::project::history::{History, HistorySettings};
use crate::synthetic::Experiment;

/// Distances and coordinates that are to be the same: a new adjustment of a converged network moves them by less, mm.
const SAME_MM: f64 = 1e-7;

fn edited(network: &Network, edit: &Edit) -> Network {
    let mut network = network.clone();
    edit.apply(&mut network).unwrap();
    network
}

fn framed(network: &Network, frame: Frame) -> Network {
    run(edited(network, &Edit::Frame(frame)), Stage::Adjust)
}

/// Three dots of different codes, well spread.
fn three(network: &Network) -> ThreeTwoOne<PointId> {
    let origins: Vec<PointId> = network
        .points
        .keys()
        .copied()
        .filter(|id| id.to_string().ends_with(".O"))
        .collect();
    let place = |id: &PointId| network.points[id].position;
    let origin = origins[0];
    let far = |from: &dyn Fn(&PointId) -> f64| {
        let farther = |a: &&PointId, b: &&PointId| from(a).total_cmp(&from(b));
        *origins.iter().max_by(farther).unwrap()
    };
    let axis = far(&|id| (place(id) - place(&origin)).norm());
    let along = (place(&axis) - place(&origin)).normalize();
    let plane = far(&|id| (place(id) - place(&origin)).cross(&along).norm());
    ThreeTwoOne {
        origin,
        axis,
        plane,
        order: AxisOrder::Xy,
    }
}

fn adjusted(stations: usize) -> (Network, Experiment) {
    let experiment = code_panel(stations);
    (run(measured(&experiment), Stage::Adjust), experiment)
}

fn same_distances(a: &Network, b: &Network) {
    let places =
        |n: &Network| -> Vec<Vector3<f64>> { n.points.values().map(|p| p.position).collect() };
    let (a, b) = (places(a), places(b));
    assert_eq!(a.len(), b.len());
    for i in 1..a.len() {
        let difference = (a[i] - a[i - 1]).norm() - (b[i] - b[i - 1]).norm();
        assert!(difference.abs() < SAME_MM, "{difference:e}");
    }
}

fn same_places(a: &Network, b: &Network) {
    for (id, point) in a.points.iter() {
        let other = &b.points[id];
        let difference = (point.position - other.position).norm();
        assert!(difference < SAME_MM, "{id}: {difference:e}");
        let (q, p) = (point.covariance.unwrap(), other.covariance.unwrap());
        assert!((q - p).amax() < 1e-6 * q.amax(), "{id}");
    }
    for (id, _, station) in a.oriented_images() {
        let other = b.images[&id].station.as_ref().unwrap();
        let apart = station.pose.centre_in_world - other.pose.centre_in_world;
        assert!(apart.norm() < 100.0 * SAME_MM);
    }
}

fn stands_in(network: &Network, frame: &ThreeTwoOne<PointId>) {
    let point = |id: PointId| &network.points[&id];
    assert_eq!(point(frame.origin).position, Vector3::zeros());
    assert_eq!(point(frame.origin).covariance, Some(Matrix3::zeros()));
    let axis = point(frame.axis).position;
    assert!(axis.x > 0.0 && (axis.y, axis.z) == (0.0, 0.0), "{axis}");
    let plane = point(frame.plane).position;
    assert!(plane.y > 0.0 && plane.z == 0.0, "{plane}");
    assert!(network.adjustment_is_fresh());
    let adjustment = network.adjustment.as_ref().unwrap();
    assert_eq!(adjustment.frame.refused, None);
    assert!(adjustment.datum.starts_with("3-2-1: origin C"));
}

#[test]
fn setting_the_frame_opens_the_final_adjustment_alone() {
    let (free, _) = adjusted(8);
    let frame = three(&free);
    let edit = Edit::Frame(Frame::ThreeTwoOne(frame));
    let labels = [frame.origin, frame.axis, frame.plane].map(|p| p.to_string());
    assert_eq!(
        edit.title(&free),
        format!("set the frame by {}", labels.join(", "))
    );
    let open = edited(&free, &edit);
    let next: Vec<Stage> = Stage::ALL
        .into_iter()
        .filter(|s| s.next(&open).is_some())
        .collect();
    assert_eq!(next, [Stage::Adjust]);
    assert!(!open.adjustment_is_fresh());
    assert!(crate::report::export_points(&open).is_err());
    let moved = run(open, Stage::Adjust);
    stands_in(&moved, &frame);
    same_distances(&free, &moved);
    assert!(Arc::ptr_eq(&moved.passes, &free.passes));
    let sigma0 = |n: &Network| n.adjustment.as_ref().unwrap().sigma0;
    assert!((sigma0(&free) - sigma0(&moved)).abs() < 1e-9);
    assert_eq!(texts(&moved.findings), [""; 0]);
    let csv = crate::report::export_points(&moved).unwrap();
    let row = format!(
        "{},code,0.000000,0.000000,0.000000,0.00000000,0.00000000,0.00000000",
        labels[0]
    );
    assert!(csv.contains(&row), "{csv}");
    assert!(Stage::ALL.iter().all(|s| s.next(&moved).is_none()));
}

#[test]
fn there_and_back_gives_the_same_digits() {
    let (free, _) = adjusted(8);
    let frame = Frame::ThreeTwoOne(three(&free));
    // Once more in its own frame: the first adjustment started further away.
    let own = framed(&free, Frame::Free);
    let back = framed(&framed(&own, frame), Frame::Free);
    same_places(&own, &back);
    assert_eq!(back.moved_by, None);
    let taken_back = edited(
        &edited(&own, &Edit::Frame(frame)),
        &Edit::Frame(Frame::Free),
    );
    assert!(
        taken_back.adjustment_is_fresh(),
        "nothing was adjusted in between"
    );
    assert!(Stage::Adjust.next(&taken_back).is_none());
}

#[test]
fn points_that_give_no_frame_leave_it_and_are_told() {
    let (free, _) = adjusted(8);
    let frame = three(&free);
    let missing = ThreeTwoOne {
        plane: PointId::Target(77),
        ..frame
    };
    let code = frame.origin.code().unwrap().1;
    let on_a_line = ThreeTwoOne {
        axis: format!("C{code}.A").parse().unwrap(),
        plane: frame.origin,
        ..frame
    };
    for (asked, expected) in [
        (missing, "found no coordinates of M77"),
        (on_a_line, "twice"),
    ] {
        let kept = framed(&free, Frame::ThreeTwoOne(asked));
        assert!(kept.adjustment_is_fresh());
        same_distances(&free, &kept);
        assert!(kept.moved_by.is_none());
        let told = kept.findings.iter().find(|f| f.kind == FindingKind::Frame);
        let text = &told.unwrap().text;
        assert!(text.contains(expected), "{text}");
        let mended = framed(&kept, Frame::ThreeTwoOne(frame));
        stands_in(&mended, &frame);
        assert_eq!(texts(&mended.findings), [""; 0], "it is no longer true");
    }
}

#[test]
fn a_point_that_lost_its_rays_gives_no_frame() {
    let (free, _) = adjusted(8);
    let frame = three(&free);
    let mut thin = free.clone();
    for number in 2..=8 {
        let labels = Arc::make_mut(&mut thin.image_mut(ImageId(number)).labels);
        for label in labels.values_mut().filter(|l| l.point == frame.plane) {
            label.rejected = Some(crate::network::REJECTED_BY_OPERATOR.into());
            label.source = crate::network::Source::Operator;
        }
    }
    thin.inputs += 1;
    let kept = framed(&thin, Frame::ThreeTwoOne(frame));
    let told = texts(&kept.findings).join("\n");
    let expected = format!("{} takes no part in the adjustment", frame.plane);
    assert!(told.contains(&expected), "{told}");
    assert!(kept.adjustment_is_fresh());
}

#[test]
fn the_stages_go_on_in_the_moved_frame() {
    let (free, _) = adjusted(9);
    let frame = three(&free);
    let moved = framed(&free, Frame::ThreeTwoOne(frame));
    let use_image = |usage| Edit::UseImage {
        image: ImageId(5),
        usage,
    };
    let without = run(
        edited(&moved, &use_image(ImageUse::Excluded)),
        Stage::Adjust,
    );
    assert_eq!(without.oriented_images().count(), 8);
    stands_in(&without, &frame);
    // What is not adjusted moved along.
    let centre = |n: &Network| {
        n.images[&ImageId(5)]
            .station
            .as_ref()
            .unwrap()
            .pose
            .centre_in_world
    };
    assert!((centre(&without) - centre(&moved)).norm() < 1.0);
    let mut lost = without.clone();
    lost.image_mut(ImageId(5)).station = None;
    let again = run(edited(&lost, &use_image(ImageUse::Used)), Stage::Adjust);
    assert_eq!(again.oriented_images().count(), 9, "it was connected anew");
    stands_in(&again, &frame);
    for (id, point) in again.points.iter() {
        assert!((point.position - moved.points[id].position).norm() < 1e-3);
    }
}

/// Control points near the true places of four dots.
fn with_control(experiment: &Experiment, role: ControlRole) -> Network {
    let free = run(measured(experiment), Stage::Adjust);
    let frame = three(&free);
    let mut network = measured(experiment);
    let labels = [frame.origin, frame.axis, frame.plane].map(|p| p.to_string());
    let control = labels.map(|label| {
        let truth = experiment.scene.disc(&label).unwrap().placement.origin;
        let known = 1.0003 * truth + Vector3::new(500.0, -200.0, 30.0);
        ControlPoint {
            label,
            coordinates_mm: [Some(known.x), Some(known.y), Some(known.z)],
            sigmas_mm: [Some(0.05); 3],
            role,
        }
    });
    network.control = Arc::new(control.into());
    run(network, Stage::Adjust)
}

#[test]
fn on_control_every_frame_has_the_same_scale() {
    let experiment = code_panel(8);
    let on_control = with_control(&experiment, ControlRole::Align);
    let frame = three(&on_control);
    let on_control = framed(&on_control, Frame::Control);
    let moved = framed(&on_control, Frame::ThreeTwoOne(frame));
    stands_in(&moved, &frame);
    same_distances(&on_control, &moved);
    same_places(&on_control, &framed(&moved, Frame::Control));
    let free = framed(&moved, Frame::Free);
    same_distances(&on_control, &free);
    assert_eq!(texts(&free.findings), [""; 0]);
}

#[test]
fn known_coordinates_hold_the_shape_and_not_the_frame() {
    let experiment = code_panel(8);
    let on_control = with_control(&experiment, ControlRole::Weighted);
    let frame = three(&on_control);
    let moved = framed(&on_control, Frame::ThreeTwoOne(frame));
    stands_in(&moved, &frame);
    same_distances(&on_control, &moved);
    same_places(&on_control, &framed(&moved, Frame::Control));
    let free = framed(&moved, Frame::Free);
    assert!(texts(&free.findings)[0].contains("weighted or fixed control points"));
    same_places(&on_control, &free);
}

#[test]
fn an_undo_brings_the_adjustment_back_and_a_lost_one_is_made_again() {
    let (first, _) = adjusted(8);
    let free = framed(&first, Frame::Free);
    let frame = three(&free);
    let open = edited(&free, &Edit::Frame(Frame::ThreeTwoOne(frame)));
    let moved = run(open.clone(), Stage::Adjust);
    let mut history = History::new(Arc::new(free.clone()), HistorySettings::default());
    history.push("set the frame", Arc::new(open));
    history.push("adjust", Arc::new(moved));
    history.undo();
    let older = history.undo().unwrap().network;
    assert_eq!(*older, free);
    assert!(older.adjustment_is_fresh());
    assert!(Stage::Adjust.next(&older).is_none());
    // As of a file of which it could not be read.
    let mut damaged = older.as_ref().clone();
    damaged.adjustment = None;
    assert!(Stage::Adjust.next(&damaged).is_some());
    let again = run(damaged, Stage::Adjust);
    assert!(again.adjustment_is_fresh());
    same_places(&free, &again);
    history.redo();
    stands_in(&history.redo().unwrap().network, &frame);
}
