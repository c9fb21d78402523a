//! What became of a random measurement.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use tiepoint::geometry::{Scale, Similarity, fit_similarity};
use tiepoint::imaging::GreyImage;
use tiepoint::monitor::Monitor;
use tiepoint::network::{
    About, Finding, FindingKind, ImageEntry, ImageId, Network, Point, PointId, Stage, Station,
};
use tiepoint::stages::{Advance, Halt, Pictures};

use super::bound::Known;
use super::scene::Scene;

/// A station is right within so many predicted standard deviations and within this distance.
const SIGMAS: f64 = 5.0;
const LARGEST_MM: f64 = 20.0;

/// Pictures that nobody may ask for.
struct NoPictures;

impl Pictures for NoPictures {
    fn load(&self, image: &ImageEntry, _monitor: &Monitor) -> Result<GreyImage, String> {
        Err(format!("{}: a trial has no pictures", image.file.path))
    }
}

/// The stages from the first pair to the adjustment of the codes, as a session runs them.
pub(crate) fn oriented(network: &Network) -> Network {
    let stages = [Stage::FirstPair, Stage::Connect, Stage::AdjustCodes];
    stages.into_iter().fold(network.clone(), concluded)
}

/// All steps of a stage, and its conclusion.
pub(crate) fn concluded(mut network: Network, stage: Stage) -> Network {
    while let Some(step) = stage.next(&network) {
        match step.run(&network, &NoPictures, &Monitor::new()) {
            Ok(Advance { network: after, .. }) => network = after,
            Err(Halt::Failed(error)) => return stage.conclude(&network, Some(&error)),
            Err(Halt::Interrupted) => unreachable!("nobody interrupts"),
        }
    }
    stage.conclude(&network, None)
}

/// How the images of a measurement fared.
#[derive(Clone, Debug, Default)]
pub(crate) struct Verdict {
    pub(crate) images: usize,
    pub(crate) required: usize,
    /// Oriented, and right.
    pub(crate) right: usize,
    /// Required, but not oriented right.
    pub(crate) missed: Vec<ImageId>,
    /// Oriented wrongly and not told: how far off, mm, and in predicted standard deviations.
    pub(crate) wrong: Vec<(ImageId, f64, f64)>,
    /// Oriented wrongly, but told to be doubtful.
    pub(crate) doubted: Vec<ImageId>,
    /// Within the predicted standard deviations, which are large, and told to be doubtful.
    pub(crate) weak: Vec<ImageId>,
    /// Those of them that are required.
    pub(crate) weak_required: Vec<ImageId>,
    /// Left out without a reason.
    pub(crate) silent: Vec<ImageId>,
}

impl Verdict {
    pub(crate) fn of(scene: &Scene, network: &Network) -> Self {
        let required = scene.required();
        let mut verdict = Self {
            images: scene.poses.len(),
            required: required.len(),
            ..Self::default()
        };
        let fit = fit(scene, network);
        for (id, pose) in &scene.poses {
            let image = &network.images[id];
            let Some(station) = &image.station else {
                if !has_reason(network, *id) {
                    verdict.silent.push(*id);
                }
                if required.contains(id) {
                    verdict.missed.push(*id);
                }
                continue;
            };
            let off = fit.as_ref().map_or(f64::INFINITY, |fit| {
                (fit.apply(&station.pose.centre_in_world) - pose.centre_in_world).norm()
            });
            let sigma = station.covariance.as_ref().map_or(0.0, |covariance| {
                let centre: Matrix3<f64> = covariance.fixed_view::<3, 3>(3, 3).into_owned();
                let scale = fit.as_ref().map_or(1.0, |fit| fit.scale);
                scale * centre.symmetric_eigenvalues().max().sqrt()
            });
            if off <= LARGEST_MM && off <= SIGMAS * sigma {
                verdict.right += 1;
                continue;
            }
            if off <= SIGMAS * sigma && is_doubted(network, *id) {
                verdict.weak.push(*id);
                if required.contains(id) {
                    verdict.weak_required.push(*id);
                }
                continue;
            }
            if required.contains(id) {
                verdict.missed.push(*id);
            }
            if is_doubted(network, *id) {
                verdict.doubted.push(*id);
            } else {
                verdict.wrong.push((*id, off, off / sigma));
            }
        }
        verdict
    }

    pub(crate) fn holds(&self) -> bool {
        self.missed.is_empty() && self.wrong.is_empty() && self.silent.is_empty()
    }
}

/// How far the stations are from the truth after the best fit, mm.
pub(crate) fn station_errors(scene: &Scene, network: &Network) -> BTreeMap<ImageId, f64> {
    let Some(fit) = fit(scene, network) else {
        return BTreeMap::new();
    };
    let error = |(id, _, station): (ImageId, &ImageEntry, &Station)| {
        let off = fit.apply(&station.pose.centre_in_world) - scene.poses[&id].centre_in_world;
        (id, off.norm())
    };
    network.oriented_images().map(error).collect()
}

/// The images that the best estimate from their observations orients no better than a verdict allows.
pub(crate) fn beyond_observations(scene: &Scene, known: Known) -> BTreeSet<ImageId> {
    let at_best = scene.at_best(known);
    let errors = at_best.map(|network| station_errors(scene, &network));
    let right = |id: &ImageId| {
        let error = errors.as_ref().and_then(|errors| errors.get(id));
        error.is_some_and(|error| *error <= LARGEST_MM)
    };
    scene
        .required()
        .into_iter()
        .filter(|id| !right(id))
        .collect()
}

fn about(network: &Network, id: ImageId) -> impl Iterator<Item = &Finding> {
    let findings = network.findings.iter();
    findings.filter(move |finding| finding.about == About::Image(id))
}

/// Whether something says why an image is not oriented: of itself, or of the whole measurement.
fn has_reason(network: &Network, id: ImageId) -> bool {
    let whole = network
        .findings
        .iter()
        .any(|f| f.kind == FindingKind::StageFailed);
    whole || about(network, id).any(|f| f.kind == FindingKind::UnconnectedImage)
}

/// Whether the operator is told that an orientation is doubtful, by its own finding or one on the whole network.
fn is_doubted(network: &Network, id: ImageId) -> bool {
    let of_all = |f: &Finding| {
        f.kind == FindingKind::StageFailed
            || f.about == About::Project && f.text.contains("orientation is doubtful")
    };
    network.findings.iter().any(of_all)
        || about(network, id).any(|f| f.text.contains("orientation is doubtful"))
}

/// The best fit of the network onto the truth: the one under which most stations and points are right. It begins from all of
/// them, from the cross, and from the stations, for points of codes that were read wrongly may be as many as the others.
fn fit(scene: &Scene, network: &Network) -> Option<Similarity> {
    let point =
        |(id, point): (&PointId, &Arc<Point>)| Some((point.position, *scene.points.get(id)?));
    let points: Vec<Pair> = network.points.iter().filter_map(point).collect();
    let of_cross = network.points.iter();
    let of_cross = of_cross.filter(|(id, _)| matches!(id, PointId::Device(_)));
    let cross: Vec<Pair> = of_cross.filter_map(point).collect();
    let stations = network.oriented_images().map(|(id, _, station)| {
        let truth = scene.poses[&id].centre_in_world;
        (station.pose.centre_in_world, truth)
    });
    let stations: Vec<Pair> = stations.collect();
    let all = [points, stations.clone()].concat();
    let right = |fit: &Similarity| {
        let off = |pair: &&Pair| (fit.apply(&pair.0) - pair.1).norm() <= LARGEST_MM;
        all.iter().filter(off).count()
    };
    let starts = [all.clone(), cross, stations];
    let fits = starts.iter().filter_map(|start| fit_from(start, &all));
    // Of equal ones the first.
    fits.reduce(|best, other| {
        if right(&other) > right(&best) {
            other
        } else {
            best
        }
    })
}

/// A place in the network and in truth.
type Pair = (Vector3<f64>, Vector3<f64>);

/// The fit over what agrees, from a fit over some.
fn fit_from(start: &[Pair], all: &[Pair]) -> Option<Similarity> {
    let mut best = fit_similarity(start, Scale::Free).ok()?;
    let mut used = start.len();
    for _ in 0..20 {
        let off = |pair: &Pair| (best.apply(&pair.0) - pair.1).norm();
        let mut sorted: Vec<f64> = all.iter().map(off).collect();
        sorted.sort_by(f64::total_cmp);
        let limit = 3.0 * sorted[sorted.len() / 2] + 1e-6;
        let kept: Vec<Pair> = all
            .iter()
            .filter(|pair| off(pair) <= limit)
            .copied()
            .collect();
        let same = kept.len() == used;
        used = kept.len();
        best = fit_similarity(&kept, Scale::Free).ok()?;
        if same {
            break;
        }
    }
    Some(best)
}
