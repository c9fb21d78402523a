//! Identification by either rule, on a panel of codes with plain targets between them.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::trial::{NoPictures, SIGMA_PX, code_panel_with, measured, run};
use super::{Halt, Stage};
use crate::monitor::Monitor;
use crate::network::{IdentificationRule, Network, Outcome, PointId};
use crate::synthetic::{Experiment, simulate_observations};

/// A panel where rays of different targets come as near to each other as the paper's threshold.
fn crowded_panel() -> Experiment {
    code_panel_with(150, 10)
}

fn with_rule(mut network: Network, rule: IdentificationRule) -> Network {
    Arc::make_mut(&mut network.settings).identification = rule;
    network
}

/// Named dots of plain targets; every target must be one disc.
fn named(network: &Network, experiment: &Experiment) -> usize {
    let poses = experiment.poses();
    let seen = simulate_observations(&experiment.scene, &experiment.camera, &poses, SIGMA_PX, 1);
    let mut discs: BTreeMap<PointId, BTreeSet<&str>> = BTreeMap::new();
    let mut named = 0;
    for (image, seen) in network.images.values().zip(&seen) {
        for (dot, label) in image.labels.iter() {
            if matches!(label.point, PointId::Target(_)) && label.rejected.is_none() {
                let disc = seen[dot.slot()].label.as_str();
                discs.entry(label.point).or_default().insert(disc);
                named += 1;
            }
        }
    }
    let mixed: Vec<_> = discs.iter().filter(|(_, discs)| discs.len() > 1).collect();
    assert!(mixed.is_empty(), "{mixed:?}");
    named
}

#[test]
fn the_setting_decides_which_rule_names_and_the_passes_of_both_end() {
    let experiment = crowded_panel();
    let oriented = run(measured(&experiment), Stage::AdjustCodes);
    let by = |rule| run(with_rule(oriented.clone(), rule), Stage::Identify);
    let statistics = by(IdentificationRule::Statistics);
    let paper = by(IdentificationRule::Paper);
    for network in [&statistics, &paper] {
        assert!(Stage::Identify.next(network).is_none());
        let conclusion = &network.conclusions[&Stage::Identify];
        assert_eq!(conclusion.outcome, Outcome::Done, "{:?}", network.findings);
        assert!(!network.passes.is_empty());
    }
    // Ten images show nearly all of the 150 targets.
    for network in [&statistics, &paper] {
        let named = named(network, &experiment);
        assert!(named > 1_300, "{named} dots are named");
    }
    assert_ne!(statistics.images, paper.images, "one rule made both");
}

#[test]
fn the_threshold_answers_an_interrupt() {
    let experiment = crowded_panel();
    let oriented = run(measured(&experiment), Stage::AdjustCodes);
    let network = with_rule(oriented, IdentificationRule::Paper);
    let step = Stage::Identify.next(&network).unwrap();
    for calls in [0, 5, 200] {
        let monitor = Monitor::interrupting_after(calls);
        let end = step.run(&network, &NoPictures, &monitor);
        assert!(matches!(end, Err(Halt::Interrupted)), "after {calls} steps");
    }
}
