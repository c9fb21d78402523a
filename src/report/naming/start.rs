//! The first transformation, on three ways: by labels, by the frame, by geometry.

use nalgebra::Vector3;

use super::assignment::certain_pairs;
use super::constellation::{self, Recognition, recognise};
use super::evidence::{Chance, LEAST_EVIDENCE, principal_lengths};
use super::labels::agreeing;
use super::lists::{Lists, Pair};
use super::{NamingError, Way};
use crate::geometry::Scale;

/// Fewest labels in common that hold a transformation.
const LEAST_LABELS: usize = 3;

/// Pairs that hold a transformation.
pub(super) struct Start {
    pub(super) way: Way,
    pub(super) pairs: Vec<Pair>,
}

/// The pairs that hold the first transformation.
///
/// # Errors
/// [`NamingError`] where labels disagree, or no single pose is beyond doubt.
pub(super) fn start(lists: &Lists<'_>) -> Result<Start, NamingError> {
    let start = |way, pairs| Start { way, pairs };
    if let Some(pairs) = by_labels(lists)? {
        return Ok(start(Way::Labels, pairs));
    }
    if let Some(pairs) = in_one_frame(lists) {
        return Ok(start(Way::Frame, pairs));
    }
    Ok(start(Way::Geometry, by_geometry(lists)?))
}

/// The common labels that agree; `None` where there are fewer than three, or they lie on a line.
fn by_labels(lists: &Lists<'_>) -> Result<Option<Vec<Pair>>, NamingError> {
    let places = lists.places_of(&lists.common);
    if !are_spread(lists, &lists.common) {
        return Ok(None);
    }
    let common = places.len();
    let of = |places: &[_], scale| agreeing(places, scale, lists.within, lists.settings.seed);
    let is_enough = |found: &[usize]| found.len() >= LEAST_LABELS && 2 * found.len() >= common;
    let found = of(&places, lists.settings.scale);
    let pairs: Vec<Pair> = found.iter().map(|&index| lists.common[index]).collect();
    let mirrored: Vec<_> = places.iter().map(|p| (mirrored(&p.0), p.1)).collect();
    let in_mirror = of(&mirrored, lists.settings.scale).len();
    if common > LEAST_LABELS && 2 * in_mirror > common && in_mirror > found.len() {
        return Err(NamingError::Mirrored {
            mirrored: in_mirror,
            points: found.len(),
        });
    }
    if is_enough(&found) && are_spread(lists, &pairs) {
        return Ok(Some(pairs));
    }
    let is_of_other_scale =
        lists.settings.scale == Scale::One && is_enough(&of(&places, Scale::Free));
    Err(NamingError::LabelsDisagree {
        agreeing: found.len(),
        common,
        within_mm: lists.within,
        remedy: match is_of_other_scale {
            true => "with a free scale they agree (--with-scale)",
            false => "a larger distance (--within) takes coarser coordinates",
        },
    })
}

/// Whether there are three places or more that do not lie on a line, by the distance at which places are told apart.
fn are_spread(lists: &Lists<'_>, pairs: &[Pair]) -> bool {
    let places: Vec<_> = pairs
        .iter()
        .map(|pair| lists.known_places[pair.known])
        .collect();
    places.len() >= LEAST_LABELS && principal_lengths(&places)[1] > lists.within
}

/// The pairs that lie together as they are; `None` where they are fewer than half of the shorter list, or no more than
/// chance brings together: the lists stand in different frames then.
fn in_one_frame(lists: &Lists<'_>) -> Option<Vec<Pair>> {
    let pairs = certain_pairs(lists, &lists.places);
    let mut distances: Vec<f64> = lists
        .places_of(&pairs)
        .iter()
        .map(|(place, known)| (place - known).norm())
        .collect();
    distances.sort_by(f64::total_cmp);
    let chance = Chance::of_one_frame(lists.places.len(), &lists.known_places, lists.within);
    let half = lists.places.len().min(lists.known.len()).div_ceil(2);
    let stand = pairs.len() >= half
        && are_spread(lists, &pairs)
        && chance.evidence(&distances) >= LEAST_EVIDENCE;
    stand.then_some(pairs)
}

fn by_geometry(lists: &Lists<'_>) -> Result<Vec<Pair>, NamingError> {
    let of = |points: &[Vector3<f64>]| {
        recognise(&constellation::Lists {
            points,
            known: &lists.known_places,
            scale: lists.settings.scale,
            within: lists.within,
            seed: lists.settings.seed,
        })
    };
    match of(&lists.places) {
        Recognition::Only(pairs) => Ok(pairs
            .into_iter()
            .map(|[point, known]| Pair { known, point })
            .collect()),
        Recognition::Several { poses, points } => Err(NamingError::SeveralPoses { poses, points }),
        Recognition::Rival { points, rival } => Err(NamingError::RivalPose { points, rival }),
        Recognition::Nothing { most } => {
            let reflected: Vec<_> = lists.places.iter().map(mirrored).collect();
            Err(match of(&reflected) {
                Recognition::Nothing { .. } => NamingError::NoPose {
                    common: lists.common.len(),
                    most,
                    within_mm: lists.within,
                },
                Recognition::Only(pairs) => NamingError::Mirrored {
                    mirrored: pairs.len(),
                    points: most,
                },
                Recognition::Several { points, .. } | Recognition::Rival { points, .. } => {
                    NamingError::Mirrored {
                        mirrored: points,
                        points: most,
                    }
                }
            })
        }
    }
}

fn mirrored(place: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(-place.x, place.y, place.z)
}
