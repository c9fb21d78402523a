//! Two blocks that never share codes.

use super::tests::{edited_codes, largest_error, outcome};
use super::trial::{code_panel, measured, run, texts};
use crate::network::{FindingKind, ImageId, Network, Outcome, Stage};
use crate::synthetic::Experiment;

/// Of twelve images the first `first` show one half of the codes, the others the other half.
fn two_blocks(first: u32) -> (Network, Experiment) {
    let experiment = code_panel(12);
    let mut network = measured(&experiment);
    let mut codes: Vec<u32> = network.images[&ImageId(1)]
        .detections
        .iter()
        .flat_map(|detections| detections.codes.iter().map(|code| code.id))
        .collect();
    codes.sort_unstable();
    let middle = codes[codes.len() / 2];
    for number in 1..=12 {
        edited_codes(&mut network, ImageId(number), |detections| {
            detections
                .codes
                .retain(|code| (code.id < middle) == (number <= first));
        });
    }
    (network, experiment)
}

#[test]
fn the_larger_block_is_measured_and_the_other_told_with_the_codes_between_them() {
    for first in [8, 5] {
        let (network, experiment) = two_blocks(first);
        let network = run(network, Stage::AdjustCodes);
        let larger = first.max(12 - first) as usize;
        assert_eq!(network.oriented_images().count(), larger);
        assert_eq!(outcome(&network, Stage::Connect), Some(Outcome::Incomplete));
        assert!(largest_error(&network, &experiment) < 0.05);
        let left: Vec<&str> = texts(&network.findings)
            .into_iter()
            .filter(|text| text.contains("a block of its own"))
            .collect();
        assert_eq!(left.len(), 12 - larger, "{left:?}");
        let told = format!("{} images with", 12 - larger);
        assert!(left.iter().all(|text| text.contains(&told)), "{left:?}");
        assert!(left[0].contains("a picture that shows C"), "{left:?}");
        let of_kind = |kind| network.findings.iter().filter(|f| f.kind == kind).count();
        assert_eq!(of_kind(FindingKind::UnconnectedImage), 12 - larger);
    }
}

#[test]
fn excluding_the_larger_block_measures_the_smaller_one() {
    let (network, experiment) = two_blocks(8);
    let mut network = run(network, Stage::AdjustCodes);
    for number in 1..=8 {
        network.image_mut(ImageId(number)).usage = crate::network::ImageUse::Excluded;
    }
    network.inputs += 1;
    let network = run(network, Stage::AdjustCodes);
    assert_eq!(network.oriented_images().count(), 4);
    assert!(largest_error(&network, &experiment) < 0.1);
}
