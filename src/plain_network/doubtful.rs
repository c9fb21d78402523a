//! Image points that cannot be used as they stand: numbers that are none, and several of one point in one image.

use std::collections::BTreeMap;

use super::PlainNetwork;
use super::usable::NAMES;

/// Two measurements of one point in one image agree where neither coordinate differs by more than this multiple of its
/// standard deviation (6e-5 two-sided, as for gross errors).
const AGREEING_SIGMAS: f64 = 4.0;

/// Which observations can be used, by the network's list; one line for each that cannot.
pub(super) fn usable_observations(network: &PlainNetwork, told: &mut Vec<String>) -> Vec<bool> {
    let mut usable = vec![true; network.observations.len()];
    leave_out_no_numbers(network, &mut usable, told);
    leave_out_doubles(network, &mut usable, told);
    usable
}

fn leave_out_no_numbers(network: &PlainNetwork, usable: &mut [bool], told: &mut Vec<String>) {
    let mut lines = Vec::new();
    for (index, seen) in network.observations.iter().enumerate() {
        if let Err(fault) = network.check_observation(index, seen) {
            usable[index] = false;
            lines.push(format!("{fault}: left out"));
        }
    }
    tell(lines, told);
}

fn leave_out_doubles(network: &PlainNetwork, usable: &mut [bool], told: &mut Vec<String>) {
    let mut places: BTreeMap<[usize; 2], Vec<usize>> = BTreeMap::new();
    for (index, seen) in network.observations.iter().enumerate() {
        if usable[index] {
            let place = places.entry([seen.image, seen.point]).or_default();
            place.push(index);
        }
    }
    let mut lines = Vec::new();
    for ([image, point], list) in places.iter().filter(|(_, list)| list.len() > 1) {
        let apart = list.iter().map(|&k| distance(network, list[0], k));
        let apart = apart.fold(0.0, f64::max);
        let agree = list.iter().all(|&k| agree(network, list[0], k));
        for &index in &list[usize::from(agree)..] {
            usable[index] = false;
        }
        lines.push(format!(
            "point '{}' in image '{}': found {} observations, {apart:.3} px apart, expected one: {}",
            network.points[*point].name,
            network.images[*image].name,
            list.len(),
            if agree { "the first is used" } else { "all are left out" }
        ));
    }
    tell(lines, told);
}

fn distance(network: &PlainNetwork, one: usize, other: usize) -> f64 {
    let [one, other] = [one, other].map(|k| &network.observations[k]);
    (one.x_px - other.x_px).hypot(one.y_px - other.y_px)
}

fn agree(network: &PlainNetwork, one: usize, other: usize) -> bool {
    let [one, other] = [one, other].map(|k| &network.observations[k]);
    let limit = AGREEING_SIGMAS * one.sigma_px.hypot(other.sigma_px);
    (one.x_px - other.x_px).abs() <= limit && (one.y_px - other.y_px).abs() <= limit
}

/// The first few of many lines, and how many more there are.
fn tell(lines: Vec<String>, told: &mut Vec<String>) {
    let more = lines.len().saturating_sub(NAMES);
    told.extend(lines.into_iter().take(NAMES));
    if more > 0 {
        told.push(format!("and {more} more image points such as the last one"));
    }
}
