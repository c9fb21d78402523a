//! Connecting images in waves: resection, intersection of new points, bundle update.
//!
//! While a network is small, every image bends it: one is connected at a time, and the update tests every dot. Later a wave takes
//! in half as many images as there are, each by itself, and the update that follows only keeps gross errors from bending
//! anything; so there are some twenty updates for a thousand images.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;

use super::bundle::{Bundle, DatumPoints, known_points, restore_rejected};
use super::by_hand::{POINTS_BY_HAND, give_names};
use super::by_pair;
use super::lens::LensFreedom;
use super::new_camera::{self, is_first_of_camera};
use super::resection::{FoundPose, KnownRay, intersect_new_points, known_rays, misfits, resect};
use super::scale::apply_frame;
use super::set_aside::{OFF_ITS_PLACE, codes_set_aside, set_code_aside};
use super::what_holds::{adjust_what_holds, settle_what_holds};
use super::{Halt, adjust};
use crate::adjustment::BundleSettings;
use crate::monitor::Monitor;
use crate::network::{
    About, Attempt, Code, Finding, FindingKind, ImageEntry, ImageId, Network, PointId, Source,
    Stage, Station,
};

/// Fewest known points that orient an image: three give up to four poses, the fourth decides. Three that the operator
/// named do ([`super::by_hand`]).
const POINTS_TO_CONNECT: usize = 4;

/// Convergence of an update, in standard deviations of the observations: the next update moves everything further.
const UPDATE_CONVERGENCE: f64 = 1e-2;

/// Oriented images from which more than one is connected at a time.
const IMAGES_FOR_WAVES: usize = 12;

/// Images of a wave, as a share of the oriented ones.
const WAVE_SHARE: f64 = 0.5;

/// An image waits for the next wave where it gains less than this share of what the best one does.
const SHARE_OF_GAIN: f64 = 0.1;

/// The images that come next: those that gain most, of those not tried with as many known points before; then those that were, as
/// long as others are connected meanwhile: the points are known better now, and the lens too.
///
/// Cost: labelled dots of all images that are not connected yet.
pub(super) fn next(network: &Network) -> Option<Vec<ImageId>> {
    wave(network, candidates(network)).or_else(|| by_one(network, |_| true))
}

/// Those of them that were tried before on the same inputs: after the connection has ended, an adjustment or a pass of
/// identification may have made known what they need.
pub(super) fn again(network: &Network) -> Option<Vec<ImageId>> {
    let tried = |id: ImageId| {
        let attempt = network.images[&id].attempt.as_ref();
        attempt.is_some_and(|attempt| attempt.basis == network.inputs)
    };
    let mut candidates = candidates(network);
    candidates.retain(|candidate| tried(candidate.id));
    wave(network, candidates).or_else(|| by_one(network, tried))
}

/// An image that shows too few known points, but shares codes enough with one oriented image. Such a one comes next only where no
/// image can be connected by what several show.
///
/// Cost: labels of all oriented images for each one that waits.
fn by_one(network: &Network, which: impl Fn(ImageId) -> bool) -> Option<Vec<ImageId>> {
    let image = waiting(network)
        .filter(|(id, _)| which(*id))
        .find(|(_, image)| {
            let known = known_points(network, image);
            !is_enough(network, image, known)
                && Turn::of(network, image, known).is_some()
                && !by_pair::partners(network, image).is_empty()
        });
    image.map(|(id, _)| vec![id])
}

/// Images with targets that are not oriented.
fn waiting(network: &Network) -> impl Iterator<Item = (ImageId, &ImageEntry)> {
    network
        .used_images()
        .filter(|(_, image)| image.station.is_none() && image.detections.is_some())
}

fn candidates(network: &Network) -> Vec<Candidate> {
    waiting(network)
        .filter_map(|(id, image)| {
            let prospect = Prospect::of(network, image);
            let turn = Turn::of(network, image, prospect.known)?;
            is_enough(network, image, prospect.known).then_some(Candidate {
                turn,
                gain: prospect.gain(),
                id,
            })
        })
        .collect()
}

fn wave(network: &Network, mut candidates: Vec<Candidate>) -> Option<Vec<ImageId>> {
    candidates.sort_by(|a, b| {
        let by_gain = b.gain.total_cmp(&a.gain);
        a.turn.cmp(&b.turn).then(by_gain).then(a.id.cmp(&b.id))
    });
    let first = candidates.first()?;
    let (turn, least) = (first.turn, SHARE_OF_GAIN * first.gain);
    let most = match network.oriented_images().count() {
        0..IMAGES_FOR_WAVES => 1,
        oriented => (WAVE_SHARE * oriented as f64) as usize,
    };
    // The principal distance of a camera of which nothing is known is told by its first image.
    let is_alone = |candidate: &Candidate| is_first_of_camera(network, candidate.id);
    if is_alone(first) {
        return Some(vec![first.id]);
    }
    let wave = candidates.iter().take(most);
    let wave = wave.take_while(|c| c.turn == turn && c.gain >= least);
    let wave = wave.filter(|candidate| !is_alone(candidate));
    Some(wave.map(|candidate| candidate.id).collect())
}

/// An image that may come next.
struct Candidate {
    turn: Turn,
    gain: f64,
    id: ImageId,
}

/// The known points that an image shows.
#[derive(Default)]
struct Prospect {
    known: usize,
    sum: Vector2<f64>,
    squares: Matrix2<f64>,
}

impl Prospect {
    fn of(network: &Network, image: &ImageEntry) -> Self {
        let mut prospect = Self::default();
        let Some(detections) = &image.detections else {
            return prospect;
        };
        for (dot, label) in image.used_labels() {
            if network.points.contains_key(&label.point) {
                let place = detections.dots[dot.slot()].centre_px;
                prospect.known += 1;
                prospect.sum += place;
                prospect.squares += place * place.transpose();
            }
        }
        prospect
    }

    /// What a resection from them can be expected to know: the sum of their squared distances, px^2, from the line on which they
    /// come nearest to lying. The weight of the least certain direction grows with it, for the number of points and for
    /// how far they spread.
    fn gain(&self) -> f64 {
        let count = (self.known as f64).max(1.0);
        let scatter = self.squares - self.sum * self.sum.transpose() / count;
        scatter.symmetric_eigenvalues().min().max(0.0)
    }
}

/// Whether an image is tried with what is known now for the first time.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Turn {
    New,
    Again,
}

impl Turn {
    /// `None` where the image was tried with all that is known now.
    fn of(network: &Network, image: &ImageEntry, known: usize) -> Option<Self> {
        let tried = image.attempt.as_ref().filter(|a| a.basis == network.inputs);
        match tried {
            Some(attempt) if known <= attempt.known_points => {
                let oriented = network.oriented_images().count();
                (oriented > attempt.oriented || network.knowledge() > attempt.knowledge)
                    .then_some(Turn::Again)
            }
            _ => Some(Turn::New),
        }
    }
}

/// Whether an image with so many known points can be oriented.
fn is_enough(network: &Network, image: &ImageEntry, known: usize) -> bool {
    let by_hand = image.used_labels().filter(|(_, label)| {
        label.source == Source::Operator && network.points.contains_key(&label.point)
    });
    known >= POINTS_TO_CONNECT || by_hand.count() >= POINTS_BY_HAND
}

/// Connects these images, or records why they cannot be connected now. An interrupt leaves the network as it was, so that the waves
/// and with them the digits are the same as without; what is lost is the work of one wave.
pub(super) fn run(
    mut network: Network,
    ids: &[ImageId],
    monitor: &Monitor,
) -> Result<Network, Halt> {
    let task = monitor.task(
        format!("connecting {}", named(&network, ids)),
        ids.len() as u64,
    );
    let before = network.clone();
    let resected: Vec<Resected> = ids
        .par_iter()
        .map(|&id| {
            task.step()?;
            Resected::of(&before, id, monitor)
        })
        .collect::<Result<_, Halt>>()?;
    let mut open = BTreeSet::new();
    let mut connected = false;
    for resected in &resected {
        connected |= resected.enter(&mut network, &mut open);
    }
    if !connected {
        return Ok(network);
    }
    intersect_new_points(&mut network);
    settle_minority(&mut network, &open);
    match (update(&mut network, monitor), ids) {
        (Ok(()), _) => Ok(network),
        (Err(Halt::Interrupted), _) => Err(Halt::Interrupted),
        // The others were adjusted without it before: it is this image that they cannot be adjusted with.
        (Err(Halt::Failed(error)), [_]) => {
            let mut network = before;
            resected[0].refuse(&mut network, error.to_string());
            Ok(network)
        }
        // One of several: they are tried one by one.
        (Err(Halt::Failed(_)), _) => run(before, &ids[..1], monitor),
    }
}

/// Images in the operator's words.
pub(super) fn named(network: &Network, ids: &[ImageId]) -> String {
    match ids {
        [id] => network
            .images
            .get(id)
            .map_or_else(|| "an image".into(), |image| image.file.path.clone()),
        _ => format!("{} images", ids.len()),
    }
}

/// An image's resection from the points known before.
struct Resected {
    id: ImageId,
    rays: Vec<KnownRay>,
    found: Result<FoundPose, String>,
    /// What the resection found for a camera of which nothing was known, mm.
    distance: Option<f64>,
}

impl Resected {
    fn of(network: &Network, id: ImageId, monitor: &Monitor) -> Result<Self, Halt> {
        let rays = known_rays(network, id);
        if is_first_of_camera(network, id)
            && let Some((distance, found)) = new_camera::orient(network, id, &rays, monitor)?
        {
            return Ok(Self {
                id,
                rays,
                found: Ok(found),
                distance: Some(distance),
            });
        }
        let found = if rays.len() < POINTS_BY_HAND {
            Err(too_few(rays.len()))
        } else {
            resect(network, id, &rays)
        };
        Ok(Self {
            id,
            found: found.or_else(|reason| by_pair::orient(network, id, &rays).ok_or(reason)),
            rays,
            distance: None,
        })
    }

    /// Puts the image into the network, or the reason why it is not; codes of which it is open where they are come on the list.
    fn enter(&self, network: &mut Network, open: &mut BTreeSet<Code>) -> bool {
        match &self.found {
            Err(reason) => {
                self.refuse(network, reason.clone());
                false
            }
            Ok(found) => {
                if let Some(distance) = self.distance {
                    new_camera::set_distance(network, self.id, distance);
                }
                settle_misfits(network, self.id, &self.rays, &found.misfits, open);
                let image = network.image_mut(self.id);
                image.station = Some(Station {
                    pose: found.pose,
                    covariance: None,
                    with_camera: None,
                });
                image.attempt = None;
                give_names(image, &found.named);
                Arc::make_mut(&mut network.connection_order).push(self.id);
                true
            }
        }
    }

    fn refuse(&self, network: &mut Network, reason: String) {
        let attempt = Attempt {
            basis: network.inputs,
            known_points: self.rays.len(),
            oriented: network.oriented_images().count(),
            knowledge: network.knowledge(),
            reason,
        };
        network.image_mut(self.id).attempt = Some(attempt);
    }
}

/// A bundle update of all that is connected: the lens held near its nominal values, gross errors left out for this time. The
/// dots of a small network are tested one by one, and its stations have standard deviations.
pub(super) fn update(network: &mut Network, monitor: &Monitor) -> Result<(), Halt> {
    restore_rejected(network);
    apply_frame(network);
    let held = |network: &Network| {
        Bundle::assemble(network, LensFreedom::Provisional, DatumPoints::All, monitor)
    };
    if held(network)?.is_empty() {
        return Ok(());
    }
    let settings = BundleSettings {
        convergence: UPDATE_CONVERGENCE,
        ..BundleSettings::default()
    };
    let is_small = network.oriented_images().count() <= IMAGES_FOR_WAVES;
    let bundle = if is_small {
        let (bundle, robust) =
            adjust_what_holds(network, held, settings, 0.0, monitor).map_err(adjust::halt)?;
        bundle.write_back(network, &robust.adjustment);
        // What took no part stands where the network was before, and is intersected anew.
        Arc::make_mut(&mut network.points).retain(|_, point| point.covariance.is_some());
        bundle
    } else {
        let (bundle, settled) =
            settle_what_holds(network, held, settings, monitor).map_err(adjust::halt)?;
        bundle.write_back_settled(network, &settled);
        bundle
    };
    if !bundle.stands_on_control() {
        apply_frame(network);
    }
    Ok(())
}

/// Codes most of whose dots miss the resection by far. Where three or more images agree on the code, its reading is
/// wrong here and its names are taken away. Where only two do, either may be wrong: the code loses its coordinates and
/// is returned, to be intersected anew with this image as judge.
fn settle_misfits(
    network: &mut Network,
    id: ImageId,
    rays: &[KnownRay],
    misfits: &[usize],
    open: &mut BTreeSet<Code>,
) {
    for code in mostly_missing(rays, misfits) {
        let (family, number) = code;
        let agreeing = PointId::of_code(family, number)
            .iter()
            .filter_map(|point| Some(network.points.get(point)?.rays))
            .max();
        if open.contains(&code) {
            continue;
        }
        if agreeing.is_some_and(|rays| rays <= 2) {
            Arc::make_mut(&mut network.points).retain(|point, _| point.code() != Some(code));
            open.insert(code);
        } else {
            set_code_aside(network.image_mut(id), family, number, OFF_ITS_PLACE);
        }
    }
}

/// Takes the names of these codes away in the images that the new intersections contradict.
fn settle_minority(network: &mut Network, open: &BTreeSet<Code>) {
    if open.is_empty() {
        return;
    }
    let ids: Vec<ImageId> = network.oriented_images().map(|(id, ..)| id).collect();
    for id in ids {
        let rays = known_rays(network, id);
        let misfits = misfits(network, id, &rays);
        for code in mostly_missing(&rays, &misfits) {
            if open.contains(&code) {
                set_code_aside(network.image_mut(id), code.0, code.1, OFF_ITS_PLACE);
            }
        }
    }
}

/// Codes more than half of whose dots are among the misfits.
fn mostly_missing(rays: &[KnownRay], misfits: &[usize]) -> Vec<Code> {
    let mut missed: BTreeMap<Code, usize> = BTreeMap::new();
    for code in misfits.iter().filter_map(|&index| rays[index].point.code()) {
        *missed.entry(code).or_default() += 1;
    }
    let of_code = |code: Code| {
        rays.iter()
            .filter(move |ray| ray.point.code() == Some(code))
    };
    missed
        .into_iter()
        .filter(|(code, missed)| 2 * missed > of_code(*code).count())
        .map(|(code, _)| code)
        .collect()
}

/// Why an image with so many known points is not tried.
fn too_few(known: usize) -> String {
    format!(
        "it shows {known} known points, {POINTS_TO_CONNECT} are needed, or {POINTS_BY_HAND} that you label"
    )
}

/// Forgets what was told of images that are connected meanwhile.
pub(super) fn settle_findings(network: &mut Network) {
    let images = Arc::clone(&network.images);
    let is_connected = |finding: &Finding| match finding.about {
        About::Image(id) if finding.kind == FindingKind::UnconnectedImage => {
            images.get(&id).is_some_and(|image| image.station.is_some())
        }
        _ => false,
    };
    if network.findings.iter().any(is_connected) {
        Arc::make_mut(&mut network.findings).retain(|finding| !is_connected(finding));
    }
}

/// The images that could not be connected and the readings set aside, each with its reason.
pub(super) fn findings(network: &Network) -> Vec<Finding> {
    let unconnected = network
        .used_images()
        .filter(|(_, image)| image.station.is_none() && image.unreadable.is_none())
        .map(|(id, image)| {
            let reason = image.attempt.as_ref().map_or_else(
                || too_few(known_points(network, image)),
                |attempt| attempt.reason.clone(),
            );
            Finding {
                stage: Stage::Connect,
                kind: FindingKind::UnconnectedImage,
                about: About::Image(id),
                text: format!("{}: not connected: {reason}", image.file.path),
            }
        });
    unconnected
        .chain(codes_set_aside(network, Stage::Connect, OFF_ITS_PLACE))
        .collect()
}
