//! Edits on the small network of the reports.

use super::*;
use crate::network::{ImageEntry, REJECTED_BY_OPERATOR, Stage};
use crate::report::fixture::network;
use crate::targets::Family;

const IMAGE: ImageId = ImageId(1);

fn point(label: &str) -> PointId {
    label.parse().unwrap()
}

/// The network after edits, each of which counts as a change of inputs.
fn after(edits: &[Edit]) -> Network {
    let mut network = network();
    for edit in edits {
        let inputs = network.inputs;
        edit.apply(&mut network).unwrap();
        assert_eq!(network.inputs, inputs + 1, "{edit:?}");
    }
    network
}

fn refused(edit: &Edit) -> String {
    let mut changed = network();
    let error = edit.apply(&mut changed).unwrap_err();
    assert_eq!(changed, network(), "a refused edit changes nothing");
    error.to_string()
}

fn unnamed(network: &Network) -> DotIndex {
    let image = &network.images[&IMAGE];
    let dots = 0..image.detections.as_ref().unwrap().dots.len() as u32;
    dots.map(DotIndex)
        .find(|dot| !image.labels.contains_key(dot))
        .unwrap()
}

fn bar(name: &str, from: &str, to: &str, length_mm: f64) -> Edit {
    Edit::AddBar {
        name: name.into(),
        from: from.into(),
        to: to.into(),
        length_mm,
        sigma_mm: 0.01,
        role: BarRole::Control,
    }
}

#[test]
fn a_new_number_by_hand_is_given_to_no_other_target() {
    let dot = unnamed(&network());
    let named = after(&[Edit::Label {
        image: IMAGE,
        dot,
        point: point("M900"),
    }]);
    assert_eq!(named.next_target, 900);
    let detected = named.images[&IMAGE].detections.as_ref().unwrap().dots[0].clone();
    let added = after(&[Edit::AddDot {
        image: IMAGE,
        dot: detected,
        point: Some(point("M901")),
    }]);
    assert_eq!(added.next_target, 901);
    let lower = after(&[Edit::Label {
        image: IMAGE,
        dot,
        point: point("M1"),
    }]);
    assert_eq!(lower.next_target, network().next_target.max(1));
}

#[test]
fn a_dot_without_a_name_is_rejected_and_restored() {
    let dot = unnamed(&network());
    let reject = Edit::Reject { image: IMAGE, dot };
    let rejected = after(std::slice::from_ref(&reject));
    assert_eq!(
        rejected.images[&IMAGE]
            .rejected_dots
            .get(&dot)
            .map(String::as_str),
        Some(REJECTED_BY_OPERATOR)
    );
    let restored = after(&[reject.clone(), Edit::Restore { image: IMAGE, dot }]);
    assert!(restored.images[&IMAGE].rejected_dots.is_empty());
    let named = after(&[
        reject,
        Edit::Label {
            image: IMAGE,
            dot,
            point: point("M900"),
        },
    ]);
    assert!(
        named.images[&IMAGE].rejected_dots.is_empty(),
        "a name takes a rejection back"
    );
    assert!(named.images[&IMAGE].labels[&dot].rejected.is_none());
}

#[test]
fn a_rejected_dot_that_loses_its_name_stays_rejected() {
    let dot = *network().images[&IMAGE].labels.keys().next().unwrap();
    let network = after(&[
        Edit::Reject { image: IMAGE, dot },
        Edit::Unlabel { image: IMAGE, dot },
    ]);
    assert!(network.images[&IMAGE].rejected_dots.contains_key(&dot));
}

#[test]
fn a_rejected_dot_whose_name_another_gets_stays_rejected() {
    let dot = *network().images[&IMAGE].labels.keys().next().unwrap();
    let point = network().images[&IMAGE].labels[&dot].point;
    let other = unnamed(&network());
    let label = Edit::Label {
        image: IMAGE,
        dot: other,
        point,
    };
    let network = after(&[Edit::Reject { image: IMAGE, dot }, label]);
    let image = &network.images[&IMAGE];
    assert!(!image.labels.contains_key(&dot));
    assert!(image.rejected_dots.contains_key(&dot));
    assert_eq!(image.labels[&other].point, point);
}

#[test]
fn what_is_accepted_is_the_operators() {
    let dot = *network().images[&IMAGE].labels.keys().next().unwrap();
    let accept = Edit::Accept { image: IMAGE, dot };
    assert!(
        accept.title(&network()).starts_with("accept "),
        "{}",
        accept.title(&network())
    );
    assert_eq!(
        after(&[accept]).images[&IMAGE].labels[&dot].source,
        Source::Operator
    );
    let dot = unnamed(&network());
    assert!(refused(&Edit::Accept { image: IMAGE, dot }).contains("has no label"));
    let network = after(&[Edit::AcceptCode {
        image: IMAGE,
        reading: 0,
    }]);
    let image = &network.images[&IMAGE];
    assert!(image.is_reading_of_operator(0) && !image.set_aside.contains_key(&0));
    assert_eq!(
        refused(&Edit::AcceptCode {
            image: IMAGE,
            reading: 99
        }),
        "img_1.png: found no such code reading any more"
    );
}

#[test]
fn a_renumbered_code_counts_by_its_new_number_and_can_be_set_aside() {
    let reading = network().images[&IMAGE].detections.as_ref().unwrap().codes[0].clone();
    let renumber = Edit::Renumber {
        image: IMAGE,
        reading: 0,
        id: 77,
    };
    let renumbered = after(std::slice::from_ref(&renumber));
    assert_eq!(
        renumbered.images[&IMAGE].code_of_reading(0),
        Some((reading.family, 77))
    );
    let aside = after(&[
        renumber,
        Edit::SetAside {
            image: IMAGE,
            reading: 0,
        },
    ]);
    let code = (reading.family, 77);
    assert!(
        aside.images[&IMAGE]
            .labels
            .values()
            .all(|label| label.point.code() != Some(code))
    );
}

#[test]
fn a_bar_is_added_once_and_removed() {
    let points: Vec<String> = network()
        .points
        .keys()
        .map(|id| network().label(*id))
        .collect();
    let (from, to) = (&points[0], &points[1]);
    let count = network().scale_bars.len();
    let add = bar("steel", from, to, 500.0);
    assert_eq!(
        add.title(&network()),
        format!("add scale bar 'steel' from {from} to {to}")
    );
    let added = after(std::slice::from_ref(&add));
    assert_eq!(added.scale_bars.len(), count + 1);
    assert!(
        Stage::Detect.next(&added).is_none(),
        "no picture is looked at again"
    );
    let removed = after(&[
        add,
        Edit::RemoveBar {
            name: "steel".into(),
        },
    ]);
    assert_eq!(removed.scale_bars, network().scale_bars);
    assert_eq!(
        refused(&Edit::RemoveBar {
            name: "steel".into()
        }),
        "found no bar 'steel' any more"
    );
    assert!(refused(&bar("steel", from, from, 1.0)).starts_with("both ends of bar 'steel' are"));
    assert!(refused(&bar("steel", from, "M999", 1.0)).contains("found no point 'M999'"));
    assert!(refused(&bar("steel", from, "?", 1.0)).contains("found no point '?'"));
    assert!(refused(&bar(" ", from, to, 1.0)).contains("without a name"));
    for length in [0.0, -1.0, f64::NAN] {
        assert!(refused(&bar("steel", from, to, length)).contains("expected a number above 0"));
    }
}

#[test]
fn a_control_point_is_set_changed_and_removed() {
    let label = network().label(*network().points.keys().next().unwrap());
    let set = |x: Option<f64>| Edit::SetControl {
        label: label.clone(),
        coordinates_mm: [x, None, None],
        sigmas_mm: [Some(0.02), None, None],
        role: ControlRole::Weighted,
    };
    let twice = after(&[set(Some(1.0)), set(Some(2.0))]);
    let of_point: Vec<_> = twice.control.iter().filter(|c| c.label == label).collect();
    assert_eq!(of_point.len(), 1);
    assert_eq!(of_point[0].coordinates_mm[0], Some(2.0));
    let removed = after(&[
        set(Some(1.0)),
        Edit::RemoveControl {
            label: label.clone(),
        },
    ]);
    assert!(removed.control.iter().all(|c| c.label != label));
    assert!(refused(&set(None)).contains("found no coordinate"));
    let gone = Edit::RemoveControl {
        label: "M999".into(),
    };
    assert_eq!(refused(&gone), "M999 has no known coordinates any more");
}

#[test]
fn other_codes_have_all_images_detected_again_and_other_limits_do_not() {
    let mut settings = network().settings.as_ref().clone();
    settings.critical_w += 1.0;
    let limits = after(&[Edit::Settings(Box::new(settings.clone()))]);
    assert_eq!(limits.images, network().images);
    assert_eq!(limits.points, network().points);

    settings.families = vec![Family::Ring(14)];
    let codes = after(&[Edit::Settings(Box::new(settings.clone()))]);
    let found = |(_, image): (ImageId, &ImageEntry)| image.detections.is_some();
    assert!(network().used_images().any(found));
    assert!(!codes.used_images().any(found));
    assert!(codes.points.is_empty() && codes.findings.is_empty() && codes.adjustment.is_none());
    assert_eq!(codes.images.len(), network().images.len());
    assert_eq!(codes.next_target, network().next_target);
    assert!(Stage::Detect.next(&codes).is_some());
}
