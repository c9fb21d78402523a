//! Which point lies at which known place: nearest places, both ways, with a margin, repeated until nothing changes.

use std::collections::BTreeSet;

use nalgebra::Vector3;

use super::NamingError;
use super::lists::{Lists, Pair};
use super::places::{Near, Places};
use super::reach::Reach;
use crate::geometry::{Similarity, fit_similarity};

/// How many times as far as the nearest the second nearest must be, besides beyond the distance: a pair that lies badly
/// between two is none.
const MARGIN: f64 = 2.0;
/// Rounds of fitting and assigning; what is not still after them is given no name.
const MOST_ROUNDS: usize = 30;

/// What lies at a known place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Verdict {
    /// One point, beyond doubt.
    Certain(Near),
    /// A point, but another one, or another place, is too near to tell.
    Ambiguous {
        /// The nearest point.
        point: Near,
        /// What cannot be told from it or from the place.
        rival: RivalPlace,
    },
    /// A point, but the fit is not known well enough there.
    OutOfReach(Near),
    /// Nothing; the nearest point is beyond the distance.
    Nothing(Option<Near>),
}

/// What makes a pair ambiguous.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum RivalPlace {
    /// Another point at the known place.
    Point(Near),
    /// Another known place at the point.
    Known(Near),
}

/// Which point lies where.
pub(super) struct Assignment {
    pub(super) fit: Similarity,
    /// The points in the frame of the reference, mm.
    pub(super) moved: Vec<Vector3<f64>>,
    /// The pairs that the fit rests on, by the known place.
    pub(super) pairs: Vec<Pair>,
    /// What lies at each known place.
    pub(super) verdicts: Vec<Verdict>,
}

/// Fits and assigns until nothing changes.
///
/// # Errors
/// [`NamingError::Lost`] where too few pairs are left.
pub(super) fn settle(lists: &Lists<'_>, start: &[Pair]) -> Result<Assignment, NamingError> {
    let mut assignment = assigned(lists, start.to_vec())?;
    for _ in 0..MOST_ROUNDS {
        let pairs = pairs_of(lists, &assignment.verdicts, &assignment.moved);
        if pairs == assignment.pairs {
            return Ok(assignment);
        }
        assignment = assigned(lists, pairs)?;
    }
    // It goes back and forth: what the last two rounds do not have in common is doubtful.
    let before: BTreeSet<Pair> = assignment.pairs.iter().copied().collect();
    for (known, verdict) in assignment.verdicts.iter_mut().enumerate() {
        if let Verdict::Certain(near) = *verdict {
            let point = near.index;
            if !before.contains(&Pair { known, point }) {
                *verdict = Verdict::OutOfReach(near);
            }
        }
    }
    Ok(assignment)
}

/// What lies where after the fit by these pairs.
fn assigned(lists: &Lists<'_>, pairs: Vec<Pair>) -> Result<Assignment, NamingError> {
    let scale = lists.settings.scale;
    let places = lists.places_of(&pairs);
    let lost = || NamingError::Lost { pairs: pairs.len() };
    let fit = fit_similarity(&places, scale).map_err(|_| lost())?;
    let fitted: Vec<_> = places.iter().map(|p| (fit.apply(&p.0), p.1)).collect();
    let reach = Reach::of(&fitted, scale).ok_or_else(lost)?;
    let moved: Vec<_> = lists.places.iter().map(|place| fit.apply(place)).collect();
    let mut verdicts = verdicts(lists, &moved);
    for verdict in &mut verdicts {
        if let Verdict::Certain(near) = *verdict
            && reach.at(&moved[near.index]) > lists.within
        {
            *verdict = Verdict::OutOfReach(near);
        }
    }
    Ok(Assignment {
        fit,
        moved,
        pairs,
        verdicts,
    })
}

/// The pairs of places that are beyond doubt where points are at these places.
pub(super) fn certain_pairs(lists: &Lists<'_>, moved: &[Vector3<f64>]) -> Vec<Pair> {
    pairs_of(lists, &verdicts(lists, moved), moved)
}

/// The pairs that belong together by their labels and lie within the distance, and those that do by their places.
fn pairs_of(lists: &Lists<'_>, verdicts: &[Verdict], moved: &[Vector3<f64>]) -> Vec<Pair> {
    let tied: Vec<Pair> = lists.tied().copied().collect();
    let points: BTreeSet<usize> = tied.iter().map(|pair| pair.point).collect();
    let known: BTreeSet<usize> = tied.iter().map(|pair| pair.known).collect();
    let is_near =
        |pair: &Pair| (moved[pair.point] - lists.known_places[pair.known]).norm() <= lists.within;
    let by_place = verdicts.iter().enumerate().filter_map(|(own, verdict)| {
        let Verdict::Certain(near) = verdict else {
            return None;
        };
        let is_free = !known.contains(&own) && !points.contains(&near.index);
        is_free.then_some(Pair {
            known: own,
            point: near.index,
        })
    });
    let mut pairs: Vec<Pair> = by_place.collect();
    pairs.extend(tied.iter().filter(|pair| is_near(pair)));
    pairs.sort_unstable();
    pairs
}

/// What lies at each known place where points are at these places.
fn verdicts(lists: &Lists<'_>, moved: &[Vector3<f64>]) -> Vec<Verdict> {
    let (points, known) = (Places::new(moved), Places::new(&lists.known_places));
    let verdict = |(own, place): (usize, &Vector3<f64>)| {
        let [nearest, second] = points.two_nearest(place);
        let Some(point) = nearest.filter(|near| near.distance <= lists.within) else {
            return Verdict::Nothing(nearest);
        };
        let others = known.two_nearest(&moved[point.index]);
        let other = others.into_iter().flatten().find(|near| near.index != own);
        let is_rival =
            |near: &Near| near.distance <= lists.within || near.distance < MARGIN * point.distance;
        let rivals = [
            second.filter(is_rival).map(RivalPlace::Point),
            other.filter(is_rival).map(RivalPlace::Known),
        ];
        match rivals.into_iter().flatten().next() {
            Some(rival) => Verdict::Ambiguous { point, rival },
            None => Verdict::Certain(point),
        }
    };
    lists.known_places.iter().enumerate().map(verdict).collect()
}
