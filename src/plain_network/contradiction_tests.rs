//! Known values that contradict the images or each other.

use super::bad_network_fixture::{adjusted, largest_error, sound, with_control};
use super::fixture::places;
use super::*;
use crate::adjustment::RejectionSettings;
use crate::geometry::Scale;

#[test]
fn without_rejection_a_contradiction_is_told_only() {
    for sigma in [Some(0.02), None] {
        let mut network = with_control(sigma);
        let sound = adjusted(&network, None);
        assert_eq!((sound.contradictions, sound.told), (Vec::new(), Vec::new()));
        network.points[14].known[1].as_mut().unwrap().value_mm += 5.0;
        let found = adjusted(&network, None);
        assert_eq!(found.contradictions.len(), 1, "{:#?}", found.told);
        let contradiction = &found.contradictions[0];
        assert_eq!(
            contradiction.value,
            KnownValue::Coordinate { point: 14, axis: 1 }
        );
        assert!((contradiction.off - 5.0).abs() < 0.1 && contradiction.w > 50.0);
        assert!(contradiction.is_used);
        assert!(
            found.told[0].ends_with("used all the same"),
            "{:?}",
            found.told
        );
        assert!(found.adjustment.sigma0 > 3.0);
    }
}

#[test]
fn two_distances_of_one_pair_contradict_each_other() {
    let mut network = sound();
    let mut other = network.distances[0].clone();
    other.name = "other".into();
    other.length_mm += 5.0;
    network.distances.push(other);
    for rejection in [None, Some(RejectionSettings::default())] {
        let found = adjusted(&network, rejection);
        let told = &found.told[0];
        assert!(
            told.starts_with("distance '") && told.contains("or distance '"),
            "{told}"
        );
        assert!(told.contains("'bar'") && told.contains("'other'"), "{told}");
        assert_eq!(found.distances, [0, 1]);
    }
}

#[test]
fn a_known_principal_distance_that_contradicts_the_images_is_left_out() {
    let mut network = sound();
    network.cameras[0].values[0] += 0.5;
    network.cameras[0].parameters[0] = PlainParameter::Weighted { sigma: 0.001 };
    let found = adjusted(&network, Some(RejectionSettings::default()));
    assert!(
        found.told[0].starts_with("c of camera 'A': the known 24.5000 mm is off by 0.5"),
        "{:?}",
        found.told
    );
    let c = found.adjustment.cameras[0]
        .camera
        .interior
        .principal_distance;
    assert!((c - 24.0).abs() < 0.05, "{c}");
    assert_eq!(found.rejected, Vec::new());
}

#[test]
fn control_a_long_way_off_does_not_keep_the_rest_from_being_adjusted() {
    for rejection in [None, Some(RejectionSettings::default())] {
        let mut network = with_control(Some(0.001));
        network.points[14].known[2].as_mut().unwrap().value_mm += 700.0;
        network.points[14].start = None;
        let found = adjusted(&network, rejection);
        let [contradiction] = &found.contradictions[..] else {
            panic!("{:#?}", found.told);
        };
        let value = KnownValue::Coordinate { point: 14, axis: 2 };
        assert_eq!(contradiction.value, value, "{:#?}", found.told);
        assert!(
            (contradiction.off - 700.0).abs() < 10.0,
            "{contradiction:?}"
        );
        assert_eq!(contradiction.is_used, rejection.is_none());
        if !contradiction.is_used {
            let error = largest_error(&found, &places(), Scale::One);
            assert!(error < 0.3, "{error}");
        }
    }
}
