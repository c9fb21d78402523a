//! What the queue offers on the small network of the reports.

use super::*;
use crate::ui::panels::fixture::network;
use std::sync::Arc;

fn with_dot(network: &mut Network, slot: usize, change: impl FnOnce(&mut Dot)) {
    let image = network.image_mut(ImageId(1));
    let detections = Arc::make_mut(image.detections.as_mut().unwrap());
    change(&mut detections.dots[slot]);
}

fn of_kind(network: &Network, kind: ReviewKind) -> Vec<ReviewItem> {
    let mut items = review_items(network);
    items.retain(|i| i.kind == kind);
    items
}

#[test]
fn a_rejected_observation_can_be_restored_or_stay_rejected() {
    let items = of_kind(&network(), ReviewKind::RejectedObservation);
    let (image, dot) = (ImageId(1), DotIndex(1));
    assert_eq!(items.len(), 1);
    assert_eq!(items[0].accept, Some(Edit::Restore { image, dot }));
    assert_eq!(items[0].reject, Edit::Reject { image, dot });
    let expected = "img_1.png: M1 is rejected: residual 3 px; |w| = 9.0, residual 3.00 px";
    assert_eq!(items[0].evidence, expected);
    let mut decided = network();
    items[0]
        .accept
        .clone()
        .unwrap()
        .apply(&mut decided)
        .unwrap();
    assert!(of_kind(&decided, ReviewKind::RejectedObservation).is_empty());
}

#[test]
fn a_doubtful_code_leaves_the_queue_by_either_decision() {
    let before = of_kind(&network(), ReviewKind::DoubtfulCode);
    assert_eq!(before.len(), 1, "the reading that is set aside");
    for edit in [before[0].accept.clone(), Some(before[0].reject.clone())] {
        let mut network = network();
        edit.unwrap().apply(&mut network).unwrap();
        assert!(of_kind(&network, ReviewKind::DoubtfulCode).is_empty());
    }
}

#[test]
fn a_doubt_of_detection_is_over_when_the_network_bears_the_reading_out() {
    let seen_by = |rays: u32| {
        let mut network = network();
        let point: PointId = "R14-5".parse().unwrap();
        let image = network.image_mut(ImageId(1));
        image.set_aside = Arc::default();
        let label = crate::network::Label {
            point,
            source: crate::network::Source::Automatic,
            rejected: None,
        };
        Arc::make_mut(&mut image.labels).insert(DotIndex(5), label);
        let detections = Arc::make_mut(image.detections.as_mut().unwrap());
        detections.codes[0].doubt = Some("a plain target may complete it".into());
        let known = crate::network::Point {
            position: nalgebra::Vector3::zeros(),
            covariance: None,
            rays,
            circle: None,
        };
        Arc::make_mut(&mut network.points).insert(point, Arc::new(known));
        of_kind(&network, ReviewKind::DoubtfulCode).len()
    };
    assert_eq!((seen_by(2), seen_by(3)), (1, 0));
}

#[test]
fn a_dot_near_a_missing_target_is_offered_its_name() {
    let mut network = network();
    let image = network.images[&ImageId(1)].clone();
    let point: PointId = "C300.B".parse().unwrap();
    let station = image.station.as_ref().unwrap();
    let camera = &network.camera_of(&image).camera;
    // Straight ahead of the camera, so that it is in the picture.
    let ahead = station
        .pose
        .world_from_direction(&nalgebra::Vector3::new(0.0, 0.0, -1000.0));
    let position = station.pose.centre_in_world + ahead;
    let place = camera
        .project(&station.pose.camera_from_point(&position))
        .unwrap();
    let missing = crate::network::Point {
        position,
        covariance: None,
        rays: 2,
        circle: None,
    };
    Arc::make_mut(&mut network.points).insert(point, Arc::new(missing));
    assert!(of_kind(&network, ReviewKind::UnnamedDot).is_empty());
    with_dot(&mut network, 4, |dot| {
        dot.centre_px = place + Vector2::new(0.6, 0.8);
    });
    let items = of_kind(&network, ReviewKind::UnnamedDot);
    let (image, dot) = (ImageId(1), DotIndex(4));
    assert_eq!(items.len(), 1);
    assert_eq!(items[0].accept, Some(Edit::Label { image, dot, point }));
    let evidence = &items[0].evidence;
    assert!(evidence.contains("1.00 px ("), "{evidence}");
    assert!(
        evidence.contains("sigma) from where C300.B should be"),
        "{evidence}"
    );
    assert!(items[0].evidence.contains("two points are as near"));
}

#[test]
fn high_residuals_and_oblique_dots_come_last() {
    let mut network = network();
    with_dot(&mut network, 3, |dot| dot.minor_px = 0.2 * dot.major_px);
    let mut adjustment = network.adjustment.as_deref().unwrap().clone();
    adjustment.observations[0].test = 3.4;
    network.adjustment = Some(Arc::new(adjustment));
    let kinds: Vec<ReviewKind> = review_items(&network).iter().map(|i| i.kind).collect();
    assert!(kinds.is_sorted());
    assert_eq!(
        kinds[kinds.len() - 2..],
        [ReviewKind::HighResidual, ReviewKind::ObliqueDot]
    );
}
