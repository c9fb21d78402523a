//! Points under construction: extending them by prediction, merging what is one target.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::hypothesis::{Bench, Verdict, overlap};
use super::intersection::{intersect, prediction_misfit};
use super::problem::{IdentificationSettings, Member};
use super::shape::{Disc, ShapeNoise};
use super::sight::Sight;
use crate::monitor::{Interrupted, Monitor};

/// Where no normal is known: largest angle to a view that does see the point, radians.
const SEEN_ANGLE: f64 = 1.0;
/// Critical value of chi-square with 3 degrees of freedom at 1 in 10,000: two positions that are one point.
const CRITICAL_POSITION: f64 = 21.1;

/// Places of points are looked up in cells as wide as so many medians of their uncertainty.
const WIDEST_IN_MEDIANS: f64 = 10.0;

/// A known point or a new target.
#[derive(Clone, Debug)]
pub(super) struct Draft {
    pub(super) known: Option<usize>,
    /// By view.
    pub(super) members: Vec<Member>,
    /// Views in which a known point is labelled already.
    pub(super) seen_in: Vec<usize>,
    pub(super) point: Vector3<f64>,
    pub(super) covariance: Matrix3<f64>,
    pub(super) normal: Option<Vector3<f64>>,
    pub(super) disc: Option<Disc>,
    pub(super) log10_accidents: f64,
    pub(super) rival_rays: usize,
}

impl Draft {
    fn has(&self, view: usize) -> bool {
        self.members.iter().any(|m| m.view == view) || self.seen_in.contains(&view)
    }

    /// Whether the point can be seen from there, as far as its normal or the views that see it tell.
    pub(super) fn may_see(
        &self,
        sight: &Sight,
        sights: &[Sight],
        settings: &IdentificationSettings,
    ) -> bool {
        let towards = sight.centre - self.point;
        if let Some(normal) = self.normal {
            return normal.dot(&towards) > towards.norm() * settings.max_incidence.cos();
        }
        let members = self.members.iter().map(|m| m.view);
        members
            .chain(self.seen_in.iter().copied())
            .filter_map(|view| sights.get(view))
            .any(|other| towards.angle(&(other.centre - self.point)) <= SEEN_ANGLE)
    }
}

/// A dot given to a draft.
#[derive(Clone, Copy, Debug)]
pub(super) struct Draw {
    pub(super) draft: usize,
    pub(super) member: Member,
}

/// A dot near a draft's predicted place.
pub(super) struct Candidate {
    pub(super) draft: usize,
    pub(super) dot: usize,
    /// Squared standardised misfit of its place (chi-square, 2 degrees of freedom).
    pub(super) misfit: f64,
}

/// Free dots that belong to one of the drafts of `range`, and to nothing else, by prediction.
pub(super) fn draw_claims(
    drafts: &[Draft],
    range: std::ops::Range<usize>,
    verdicts: &[Vec<Verdict>],
    free: &[Vec<bool>],
    bench: &Bench,
    monitor: &Monitor,
) -> Result<Vec<Draw>, Interrupted> {
    let settings = bench.settings;
    let by_view: Vec<Vec<Draw>> = (0..bench.sights.len())
        .into_par_iter()
        .map(|view| {
            monitor.check()?;
            let candidates = candidates(bench, drafts, view, free);
            Ok(clear_winners(&candidates, settings.critical_margin)
                .into_iter()
                .filter(|c| range.contains(&c.draft) && c.misfit <= settings.critical_ray)
                .filter(|c| uncontested(&drafts[c.draft], &verdicts[view][c.dot], settings))
                .map(|c| Draw {
                    draft: c.draft,
                    member: Member { view, dot: c.dot },
                })
                .collect())
        })
        .collect::<Result<_, Interrupted>>()?;
    Ok(by_view.into_iter().flatten().collect())
}

/// All pairs of draft and free dot in a view that prediction, side and shape allow, rivals beyond the gate included.
pub(super) fn candidates(
    bench: &Bench,
    drafts: &[Draft],
    view: usize,
    free: &[Vec<bool>],
) -> Vec<Candidate> {
    let (sights, settings) = (bench.sights, bench.settings);
    let sight = &sights[view];
    let critical = settings.critical_ray + settings.critical_margin;
    let mut found = Vec::new();
    for (index, draft) in drafts.iter().enumerate() {
        let Some(place) = sight.place(&draft.point) else {
            continue;
        };
        if draft.has(view) || !draft.may_see(sight, sights, settings) {
            continue;
        }
        let Some(seen) = sight.sighting(&draft.point) else {
            continue;
        };
        let radius = sight.search_radius(&seen, &draft.covariance, critical);
        sight.near(&place, radius, |dot| {
            let shape = draft
                .disc
                .map_or(0.0, |d| d.misfit(sight, dot, &seen, &bench.noise));
            let misfit = prediction_misfit(sight, dot, &draft.point, &draft.covariance);
            if let Some(misfit) = misfit
                && free[view][dot]
                && shape <= settings.critical_shape
                && misfit <= critical
            {
                found.push(Candidate {
                    draft: index,
                    dot,
                    misfit,
                });
            }
        });
    }
    found
}

/// Candidates that are best for their dot and for their draft, both by the margin.
fn clear_winners(candidates: &[Candidate], margin: f64) -> Vec<&Candidate> {
    let mut by_dot: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    let mut by_draft: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    for c in candidates {
        by_dot.entry(c.dot).or_default().push(c.misfit);
        by_draft.entry(c.draft).or_default().push(c.misfit);
    }
    let clear = |misfits: Option<&Vec<f64>>, own: f64| {
        misfits.is_some_and(|all| all.iter().filter(|&&m| m <= own + margin).count() == 1)
    };
    candidates
        .iter()
        .filter(|c| clear(by_dot.get(&c.dot), c.misfit) && clear(by_draft.get(&c.draft), c.misfit))
        .collect()
}

/// Whether the dot's own search found this point, or nothing that could be a target.
fn uncontested(draft: &Draft, verdict: &Verdict, settings: &IdentificationSettings) -> bool {
    let Some(best) = &verdict.best else {
        return true;
    };
    if best.members.len() < settings.min_rays.max(3) {
        return true;
    }
    if overlap(&best.members, &draft.members).0 >= 2 {
        return !verdict.is_near_tie();
    }
    one_point(
        (&best.point, &best.covariance),
        (&draft.point, &draft.covariance),
    )
}

fn one_point(a: (&Vector3<f64>, &Matrix3<f64>), b: (&Vector3<f64>, &Matrix3<f64>)) -> bool {
    let apart = a.0 - b.0;
    (a.1 + b.1)
        .try_inverse()
        .is_some_and(|weight| apart.dot(&(weight * apart)) <= CRITICAL_POSITION)
}

/// Adds the drawn dots and intersects the targets anew; known points stay where they are.
pub(super) fn extend(
    sights: &[Sight],
    noise: &ShapeNoise,
    drafts: &mut [Draft],
    draws: &[Draw],
    monitor: &Monitor,
) -> Result<(), Interrupted> {
    let mut touched = BTreeSet::new();
    for draw in draws {
        drafts[draw.draft].members.push(draw.member);
        touched.insert(draw.draft);
    }
    drafts
        .par_iter_mut()
        .enumerate()
        .try_for_each(|(index, draft)| {
            if touched.contains(&index) {
                monitor.check()?;
                draft.members.sort_unstable();
                refresh(sights, noise, draft);
            }
            Ok(())
        })
}

fn refresh(sights: &[Sight], noise: &ShapeNoise, draft: &mut Draft) {
    if draft.known.is_some() {
        return;
    }
    if let Some(fit) = intersect(sights, &draft.members, &draft.point) {
        draft.point = fit.point;
        draft.covariance = fit.covariance;
    }
    draft.disc = Disc::fitted(sights, &draft.members, &draft.point, noise);
    draft.normal = draft.disc.map(|d| d.normal);
}

/// Drops the rays of a target that fail its tests; gives them back.
pub(super) fn reduce_to_fit(bench: &Bench, draft: &mut Draft) -> Vec<Member> {
    let before = draft.members.clone();
    match bench.fitting(&mut draft.members, &draft.point) {
        Some(_) => refresh(bench.sights, &bench.noise, draft),
        None => draft.members.clear(),
    }
    before
        .into_iter()
        .filter(|m| draft.members.binary_search(m).is_err())
        .collect()
}

/// Joins drafts that are one target: no view in common, one position, and a common intersection that stands the test.
///
/// A new target that is a known point becomes claims of it.
///
/// Cost: by an index of places, about that of the drafts.
pub(super) fn merged(
    bench: &Bench,
    drafts: Vec<Draft>,
    monitor: &Monitor,
) -> Result<Vec<Draft>, Interrupted> {
    let reach = |draft: &Draft| {
        let variance = draft.covariance.trace().max(0.0);
        (CRITICAL_POSITION * variance).sqrt()
    };
    // Some points that are hardly known must not make the cells so large that they hold everything.
    let mut reaches: Vec<f64> = drafts.iter().map(reach).collect();
    reaches.sort_by(f64::total_cmp);
    let median = reaches.get(reaches.len() / 2).copied().unwrap_or_default();
    let largest = reaches.last().copied().unwrap_or_default();
    let widest = largest.min(WIDEST_IN_MEDIANS * median).max(1e-6);
    let cell = |point: &Vector3<f64>| -> [i64; 3] {
        std::array::from_fn(|axis| (point[axis] / (2.0 * widest)).floor() as i64)
    };
    let mut kept: Vec<Draft> = Vec::with_capacity(drafts.len());
    let mut places: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
    for draft in drafts {
        monitor.check()?;
        let home = cell(&draft.point);
        let mut fitting = Vec::new();
        if draft.known.is_none() {
            for offset in 0..27 {
                let near = [offset % 3, offset / 3 % 3, offset / 9].map(|o| o - 1);
                let key: [i64; 3] = std::array::from_fn(|axis| home[axis] + near[axis]);
                for &i in places.get(&key).into_iter().flatten() {
                    fitting.extend(joint_misfit(bench, &kept[i], &draft).map(|m| (m, i)));
                }
            }
            fitting.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        }
        let Some(&(_, partner)) = fitting.first() else {
            places.entry(home).or_default().push(kept.len());
            kept.push(draft);
            continue;
        };
        let other = &mut kept[partner];
        other.members.extend(draft.members);
        other.members.sort_unstable();
        other.log10_accidents = other.log10_accidents.min(draft.log10_accidents);
        other.rival_rays = other.rival_rays.max(draft.rival_rays);
        refresh(bench.sights, &bench.noise, other);
    }
    Ok(kept)
}

/// How badly two drafts fit as one target; `None` where they cannot be one.
fn joint_misfit(bench: &Bench, a: &Draft, b: &Draft) -> Option<f64> {
    let (sights, settings) = (bench.sights, bench.settings);
    if b.members.iter().any(|m| a.has(m.view))
        || !one_point((&a.point, &a.covariance), (&b.point, &b.covariance))
    {
        return None;
    }
    if a.known.is_some() {
        let worst = b
            .members
            .iter()
            .map(|m| prediction_misfit(&sights[m.view], m.dot, &a.point, &a.covariance))
            .try_fold(0.0, |worst: f64, misfit| Some(worst.max(misfit?)))?;
        return (worst <= settings.critical_ray).then_some(worst);
    }
    let mut members: Vec<Member> = a.members.iter().chain(&b.members).copied().collect();
    members.sort_unstable();
    let fit = intersect(sights, &members, &a.point)?;
    let limit = bench.limits.whole(fit.redundancy());
    let (_, worst) = fit.worst()?;
    (fit.chi_square <= limit && worst <= settings.critical_ray).then_some(worst)
}
