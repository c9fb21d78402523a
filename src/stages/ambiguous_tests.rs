//! Questions that identification leaves, and what an answer brings.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::Vector3;

use super::Stage;
use super::trial::{SIGMA_PX, code_panel_with, measured, run};
use crate::geometry::Pose;
use crate::network::{ImageId, Network, PointId, ReadTarget};
use crate::project::edit::Edit;
use crate::synthetic::{Experiment, Placement, simulate_observations};
use crate::targets::DotIndex;

/// Images that show the row of targets; the first stand in a row themselves.
const THREE: std::ops::RangeInclusive<u32> = 1..=3;

/// A panel with three targets in a row, which three images in a row show: three of their rays meet before and behind the panel as exactly
/// as in each target. What the other images show of them is hidden.
fn repeating_row() -> (Network, Experiment) {
    let mut experiment = code_panel_with(0, 10);
    for place in [-1.0, 0.0, 1.0] {
        let origin = Vector3::new(33.0 * place, 7.0, 0.0);
        let label = format!("W{}", place as i32 + 2);
        experiment
            .scene
            .add_disc(label, Placement::horizontal(origin), 5.0);
    }
    for (station, place) in experiment.stations.iter_mut().zip([-1.0, 0.0, 1.0]) {
        let centre = Vector3::new(180.0 * place, 0.0, 900.0);
        let below = Vector3::new(centre.x, 0.0, 0.0);
        station.pose = Pose::looking_at(centre, below, Vector3::y(), 0.0);
    }
    let mut network = measured(&experiment);
    let names = names(&experiment);
    for (id, labels) in &names {
        if THREE.contains(&id.0) {
            continue;
        }
        let hidden = |slot: usize| labels[slot].starts_with('W');
        let image = network.image_mut(*id);
        let reason = || "hidden in this trial".to_owned();
        let dots = (0..labels.len()).filter(|slot| hidden(*slot));
        let rejected = dots.map(|slot| (DotIndex(slot as u32), reason()));
        image.rejected_dots = Arc::new(rejected.collect());
    }
    (network, experiment)
}

/// What the dots of each image are.
fn names(experiment: &Experiment) -> BTreeMap<ImageId, Vec<String>> {
    let poses = experiment.poses();
    let seen = simulate_observations(&experiment.scene, &experiment.camera, &poses, SIGMA_PX, 1);
    let of_image = |observations: Vec<crate::synthetic::SimulatedObservation>| {
        let labels = observations.into_iter().map(|seen| seen.label);
        labels.collect()
    };
    (1..)
        .map(ImageId)
        .zip(seen.into_iter().map(of_image))
        .collect()
}

/// The discs of each plain target, with the number of its dots.
fn discs_of_targets(
    network: &Network,
    names: &BTreeMap<ImageId, Vec<String>>,
) -> BTreeMap<PointId, (BTreeSet<String>, usize)> {
    let mut discs: BTreeMap<PointId, (BTreeSet<String>, usize)> = BTreeMap::new();
    for (id, image) in network.images.iter() {
        for (dot, label) in image.labels.iter() {
            if matches!(label.point, PointId::Target(_)) {
                let (of, dots) = discs.entry(label.point).or_default();
                of.insert(names[id][dot.slot()].clone());
                *dots += 1;
            }
        }
    }
    discs
}

#[test]
fn an_answer_names_its_dots_and_settles_what_hung_on_it() {
    let (network, experiment) = repeating_row();
    let names = names(&experiment);
    let mut network = run(network, Stage::Identify);
    assert_eq!(discs_of_targets(&network, &names), BTreeMap::new());
    let groups = network.open_groups();
    assert_eq!(groups.len(), 1, "{groups:#?}");
    let group = &groups[0];
    let discs = |reading: &crate::network::Reading| {
        let dots = reading.dots.iter();
        dots.map(|(image, dot)| names[image][dot.slot()].clone())
            .collect::<BTreeSet<String>>()
    };
    let is_right = |reading: &&crate::network::Reading| discs(reading).len() == 1;
    let right = group.readings.iter().find(is_right).expect("the truth");
    assert!(matches!(right.target, ReadTarget::New { .. }));
    assert_eq!(right, &group.readings[0], "the truth lies on the panel");
    assert!(group.odds_against(&group.readings[1]) > 2.0);
    let edit = Edit::TakeReading(Box::new(right.clone()));
    edit.apply(&mut network).expect("an open question");
    assert!(network.open_groups().is_empty());
    let network = run(network, Stage::Adjust);
    let targets = discs_of_targets(&network, &names);
    assert_eq!(
        targets.len(),
        3,
        "the others follow by themselves: {targets:?}"
    );
    for (discs, dots) in targets.values() {
        assert_eq!((discs.len(), *dots), (1, 3), "{targets:?}");
    }
}

#[test]
fn the_questions_are_the_same_however_many_threads_ask() {
    let (network, _) = repeating_row();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().expect("threads");
        pool.install(|| run(network.clone(), Stage::Identify))
    };
    assert_eq!(on(1).ambiguous, on(3).ambiguous);
}
