//! Images that show what only one other shows, and codes that are looked at again.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::set_aside::{OF_OTHER_SHAPE, OFF_ITS_PLACE, set_code_aside};
use super::take_up::take_up_codes;
use super::tests::{edited_codes, largest_error};
use super::trial::{code_panel, measured, run, texts};
use crate::network::{ImageEntry, ImageId, Label, Network, Stage};
use crate::synthetic::Experiment;
use crate::targets::Family;

/// Five images of a panel; the last one shows four codes that beside it only the first shows, and so many dots of another code.
fn hanging_on_one(known_dots: usize) -> (Network, Experiment) {
    let experiment = code_panel(5);
    let mut network = measured(&experiment);
    let codes_of = |network: &Network, id| -> BTreeSet<u32> {
        let detections = network.images[&ImageId(id)].detections.iter();
        detections
            .flat_map(|d| d.codes.iter().map(|code| code.id))
            .collect()
    };
    let in_both = &codes_of(&network, 1) & &codes_of(&network, 5);
    let mut in_both = in_both.into_iter();
    let shared: BTreeSet<u32> = in_both.by_ref().take(4).collect();
    let known = in_both.next().expect("five common codes");
    for number in 2..=5 {
        edited_codes(&mut network, ImageId(number), |detections| {
            detections.codes.retain(|code| {
                if number < 5 {
                    !shared.contains(&code.id)
                } else {
                    shared.contains(&code.id) || code.id == known
                }
            });
        });
    }
    let mut dots = 0;
    Arc::make_mut(&mut network.image_mut(ImageId(5)).labels).retain(|_, label| {
        let is_known = label.point.code() == Some((Family::Dot420, known));
        dots += usize::from(is_known);
        !is_known || dots <= known_dots
    });
    (network, experiment)
}

#[test]
fn an_image_is_connected_to_the_one_with_which_it_shares_codes() {
    let (network, experiment) = hanging_on_one(3);
    let network = run(network, Stage::AdjustCodes);
    assert_eq!(network.connection_order.last(), Some(&ImageId(5)));
    assert_eq!(network.oriented_images().count(), 5);
    assert_eq!(network.points.len(), 6 * 12);
    // Five images hardly calibrate a lens, and four codes have two rays: as exact as the adjustment says.
    let variances = network
        .points
        .values()
        .filter_map(|p| Some(p.covariance?.trace()));
    let largest_sigma = variances.fold(0.0, f64::max).sqrt();
    let error = largest_error(&network, &experiment);
    assert!(error < 3.0 * largest_sigma, "{error} {largest_sigma}");
    assert!(largest_sigma < 1.0, "{largest_sigma}");
}

#[test]
fn without_known_points_nothing_tells_how_far_away_it_is() {
    let (network, _) = hanging_on_one(2);
    let network = run(network, Stage::AdjustCodes);
    assert_eq!(network.oriented_images().count(), 4);
    let told = texts(&network.findings);
    let is_told = told
        .iter()
        .any(|text| text.contains("it shows 2 known points"));
    assert!(is_told, "{told:?}");
}

#[test]
fn a_code_set_aside_under_a_wrong_lens_is_taken_up_where_it_has_its_shape() {
    let mut network = run(measured(&code_panel(5)), Stage::AdjustCodes);
    let mut codes = network.points.keys().filter_map(|point| point.code());
    let (first, last) = (codes.next().unwrap().1, codes.next_back().unwrap().1);
    let points = network.points.len();
    let images = Arc::clone(&network.images);
    for (id, code) in images.keys().flat_map(|id| [(*id, first), (*id, last)]) {
        let image = network.image_mut(id);
        set_code_aside(image, Family::Dot420, code, OF_OTHER_SHAPE);
        // Two dots of the last code are read as each other.
        let detections = Arc::make_mut(image.detections.as_mut().unwrap());
        for reading in &mut detections.codes {
            if (reading.id, code) == (last, last) {
                reading.dots.swap(3, 4);
            }
        }
    }
    Arc::make_mut(&mut network.points).retain(|point, _| {
        let code = point.code();
        code != Some((Family::Dot420, first)) && code != Some((Family::Dot420, last))
    });
    assert!(take_up_codes(&mut network));
    assert!(!take_up_codes(&mut network));
    assert_eq!(network.points.len(), points - 6);
    for (id, image) in images.iter() {
        let labels = |image: &ImageEntry, code| {
            let of_code = |label: &&Label| label.point.code() == Some((Family::Dot420, code));
            image.labels.values().filter(of_code).count()
        };
        let now = &network.images[id];
        assert_eq!(labels(now, first), labels(image, first));
        assert_eq!(labels(now, last), 0);
        assert_eq!(now.set_aside.len(), labels(image, last) / 6);
    }
}

#[test]
fn a_reading_far_from_its_place_stays_aside() {
    let mut network = run(measured(&code_panel(5)), Stage::AdjustCodes);
    let image = network.image_mut(ImageId(2));
    let reading = image.detections.as_ref().unwrap().codes[0].clone();
    set_code_aside(image, reading.family, reading.id, OFF_ITS_PLACE);
    let mut moved = network.clone();
    let detections = Arc::make_mut(moved.image_mut(ImageId(2)).detections.as_mut().unwrap());
    detections.dots[reading.dots[5].slot()].centre_px.x += 15.0;
    assert!(!take_up_codes(&mut moved));
    assert!(take_up_codes(&mut network));
}
