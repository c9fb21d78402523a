//! The transformation by the geometry of the points alone, as a star tracker recognises a part of the sky: triangles of
//! known places are looked for among the points, each one found is a pose, and the pose is judged by all other points.
//!
//! It must be the only one: every other pose that brings together half as many points, as near, is a rival, and a list
//! with a rival says nothing. That is so for a regular grid, and for a part that repeats itself.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::evidence::{Chance, LEAST_EVIDENCE};
use super::places::{Near, Places};
use super::triangles::{Distances, Search, Triangle};
use crate::geometry::{Scale, Similarity, fit_similarity};

/// Triangles that are looked for: where 30 % of the list are common points, all of them miss with a probability of 4 %,
/// at 50 % of 1e-7.
const TRIANGLES: usize = 120;
/// Further ones among the points of the best pose: a rival with half of them escapes with a probability of 1e-4.
const CHECK_TRIANGLES: usize = 70;
/// Draws for one triangle, of which the highest is taken: poses by flat ones are weak.
const DRAWS: usize = 12;
/// Points among which triangles are looked for, at most; with a free scale the work grows with a higher power.
const MOST_POINTS: usize = 2000;
const MOST_POINTS_OF_FREE_SCALE: usize = 500;
/// Poses that are tried, at most, by the triangles of one look.
const MOST_TRIALS: usize = 4_000_000;
/// Points that a pose is judged by at first.
const FIRST_LOOK: usize = 16;
/// Of these so many must lie near a known place; by chance one does seldom.
const LEAST_AT_FIRST_LOOK: usize = 2;
/// Points of a second look, and how many of the poses by one triangle are foremost then.
const SECOND_LOOK: usize = 64;
const FOREMOST_AT_SECOND_LOOK: usize = 1000;
/// Foremost poses by one triangle that are refined: more than a cube has.
const FOREMOST: usize = 64;
/// Points that a triangle brings together by itself.
const GIVEN: usize = 3;
/// Rounds in which a pose is fitted to what it brings together.
const ROUNDS: usize = 4;
/// Median distances within which all right pairs lie: 4.6 standard deviations of a coordinate.
const MEDIANS: f64 = 3.0;
/// Share of the place distance below which nearer says nothing more: lists are rounded.
const FINEST_SHARE: f64 = 1e-3;

/// What to recognise in what.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lists<'a> {
    /// Points in their own frame, mm.
    pub(super) points: &'a [Vector3<f64>],
    /// Known places, mm.
    pub(super) known: &'a [Vector3<f64>],
    /// Whether the scale is part of the pose.
    pub(super) scale: Scale,
    /// Within what distance a point is at a known place, mm.
    pub(super) within: f64,
    /// Seed of the choice of triangles.
    pub(super) seed: u64,
}

/// What was recognised.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Recognition {
    /// The only pose: pairs of a point and a known place, by the place.
    Only(Vec<[usize; 2]>),
    /// Several poses bring together as many points.
    Several {
        /// How many poses.
        poses: usize,
        /// Points that the best one brings together.
        points: usize,
    },
    /// Another pose brings together half as many points or more.
    Rival {
        /// Points that the best one brings together.
        points: usize,
        /// Points of the other one.
        rival: usize,
    },
    /// None brings together more than chance does.
    Nothing {
        /// The most points that one brought together.
        most: usize,
    },
}

/// A pose and what it brings together.
#[derive(Clone, Debug)]
struct Pose {
    fit: Similarity,
    pairs: Vec<[usize; 2]>,
    /// Distances of the pairs, sorted, mm.
    distances: Vec<f64>,
    evidence: f64,
}

impl Pose {
    /// Pairs within a distance, mm, beyond those that any triangle has.
    fn telling_within(&self, distance: f64) -> usize {
        let near = self.distances.partition_point(|d| *d <= distance);
        near.saturating_sub(GIVEN)
    }

    /// The distance within which all its right pairs lie, mm.
    fn fineness(&self, within: f64) -> f64 {
        let median = self.distances[self.distances.len() / 2];
        (MEDIANS * median).clamp(FINEST_SHARE * within, within)
    }
}

/// Recognises a list among points.
///
/// Cost: some hundred triangles, each with the square of the number of points times the share of distances within the
/// place distance; with a free scale times the number of points once more.
pub(super) fn recognise(lists: &Lists<'_>) -> Recognition {
    let mut search = Recogniser::new(lists);
    let all: Vec<usize> = (0..lists.known.len()).collect();
    search.look_for(TRIANGLES, &all);
    if let Some(best) = search.best() {
        let of_best: Vec<usize> = best.pairs.iter().map(|pair| pair[1]).collect();
        search.look_for(CHECK_TRIANGLES, &of_best);
    }
    search.verdict()
}

struct Recogniser<'a> {
    lists: &'a Lists<'a>,
    random: ChaCha8Rng,
    known: Places<'a>,
    distances: Distances,
    /// The points in the order in which they judge a pose.
    judges: Vec<usize>,
    /// Places by which poses are told apart, in the frame of the points.
    probes: Vec<Vector3<f64>>,
    chance: Chance,
    poses: Vec<Pose>,
}

impl<'a> Recogniser<'a> {
    fn new(lists: &'a Lists<'a>) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(lists.seed);
        let judges = shuffled(lists.points.len(), &mut random);
        let most = match lists.scale {
            Scale::One => MOST_POINTS,
            Scale::Free => MOST_POINTS_OF_FREE_SCALE,
        };
        let corners = judges.iter().take(most).map(|&index| lists.points[index]);
        Self {
            known: Places::new(lists.known),
            distances: Distances::new(corners.collect()),
            probes: outermost(lists.points),
            chance: Chance::of_triangles(lists.points.len(), lists.known, lists.within),
            poses: Vec::new(),
            judges,
            random,
            lists,
        }
    }

    /// Looks for so many triangles of these known places, until it is sure that there are several poses.
    fn look_for(&mut self, triangles: usize, among: &[usize]) {
        let mut trials = 0;
        for _ in 0..triangles {
            let Some(triangle) = self.draw(among) else {
                continue;
            };
            let mut raw = Vec::new();
            let tolerance = 2.0 * self.tolerance();
            let (known, scale) = (self.lists.known, self.lists.scale);
            self.distances
                .poses_on(known, &triangle, scale, tolerance, &mut |pose| {
                    trials += 1;
                    if self.near(&pose, FIRST_LOOK, tolerance) >= LEAST_AT_FIRST_LOOK {
                        raw.push(pose);
                    }
                    match trials < MOST_TRIALS {
                        true => Search::GoesOn,
                        false => Search::Over,
                    }
                });
            let raw = self.foremost(raw, SECOND_LOOK, FOREMOST_AT_SECOND_LOOK);
            for pose in self.foremost(raw, self.judges.len(), FOREMOST) {
                self.take(&pose);
            }
            if trials >= MOST_TRIALS || self.is_ambiguous() {
                return;
            }
        }
    }

    /// Within what distance a point must be at a known place for a pose to matter, mm: where the best pose brings a good
    /// part of the points together, rivals must bring them as near.
    fn tolerance(&self) -> f64 {
        let quarter = self.lists.points.len().min(self.lists.known.len()) / 4;
        let within = self.lists.within;
        self.best()
            .filter(|best| best.evidence >= LEAST_EVIDENCE && best.pairs.len() >= quarter)
            .map_or(within, |best| best.fineness(within))
    }

    /// The poses that bring most of the first points near known places, in their order among equals.
    fn foremost(&self, poses: Vec<Similarity>, points: usize, count: usize) -> Vec<Similarity> {
        if poses.len() <= count {
            return poses;
        }
        let near = |pose| (self.near(&pose, points, 2.0 * self.lists.within), pose);
        let mut ranked: Vec<(usize, Similarity)> = poses.into_iter().map(near).collect();
        ranked.sort_by_key(|(near, _)| std::cmp::Reverse(*near));
        ranked.truncate(count);
        ranked.into_iter().map(|(_, pose)| pose).collect()
    }

    /// The highest of some random triangles.
    fn draw(&mut self, among: &[usize]) -> Option<Triangle> {
        let (places, within) = (self.lists.known, self.lists.within);
        let mut best: Option<Triangle> = None;
        for _ in 0..DRAWS {
            let corners = std::array::from_fn(|_| among[self.random.random_range(0..among.len())]);
            let least = best.map_or(2.0 * within, |triangle| triangle.height(places));
            best = Triangle::of(places, corners, least).or(best);
        }
        best
    }

    /// How many of the first points lie near a known place.
    fn near(&self, pose: &Similarity, points: usize, limit: f64) -> usize {
        let judges = self.judges.iter().take(points);
        let is_near = |index: &&usize| {
            let place = pose.apply(&self.lists.points[**index]);
            self.known.nearest(&place, limit).is_some()
        };
        judges.filter(is_near).count()
    }

    /// Keeps a pose that is new and no worse than half of the best.
    fn take(&mut self, raw: &Similarity) {
        let near = 4.0 * self.lists.within;
        if self
            .poses
            .iter()
            .any(|other| self.are_same(&other.fit, raw, near))
        {
            return;
        }
        let Some(pose) = self.refined(raw) else {
            return;
        };
        let within = self.lists.within;
        let most = self.most();
        let own = pose.telling_within(within);
        if 2 * own < most {
            return;
        }
        let same =
            (self.poses.iter()).position(|other| self.are_same(&other.fit, &pose.fit, within));
        match same {
            Some(place) if self.poses[place].evidence < pose.evidence => self.poses[place] = pose,
            Some(_) => {}
            None => self.poses.push(pose),
        }
        if own > most {
            self.poses
                .retain(|other| 2 * other.telling_within(within) >= own);
        }
    }

    /// Most points beyond its triangle that a pose brings together.
    fn most(&self) -> usize {
        let telling = |pose: &Pose| pose.telling_within(self.lists.within);
        self.poses.iter().map(telling).max().unwrap_or_default()
    }

    fn are_same(&self, one: &Similarity, other: &Similarity, within: f64) -> bool {
        self.probes
            .iter()
            .all(|probe| (one.apply(probe) - other.apply(probe)).norm() <= within)
    }

    /// A pose fitted to all that it brings together.
    fn refined(&self, raw: &Similarity) -> Option<Pose> {
        let lists = self.lists;
        let mut fit = *raw;
        let mut pairs = self.brought_together(&fit, 2.0 * lists.within);
        for _ in 0..ROUNDS {
            let places: Vec<_> = pairs
                .iter()
                .map(|&[point, known]| (lists.points[point], lists.known[known]))
                .collect();
            fit = fit_similarity(&places, lists.scale).ok()?;
            pairs = self.brought_together(&fit, lists.within);
        }
        let distance = |&[point, known]: &[usize; 2]| {
            (fit.apply(&lists.points[point]) - lists.known[known]).norm()
        };
        let mut distances: Vec<f64> = pairs.iter().map(distance).collect();
        distances.sort_by(f64::total_cmp);
        (distances.len() > GIVEN).then(|| Pose {
            fit,
            evidence: self.chance.evidence(&distances),
            pairs,
            distances,
        })
    }

    /// Every known place with the nearest of the points that it is the nearest one for.
    fn brought_together(&self, fit: &Similarity, limit: f64) -> Vec<[usize; 2]> {
        let mut of_known: Vec<Option<Near>> = vec![None; self.lists.known.len()];
        for (index, point) in self.lists.points.iter().enumerate() {
            let Some(near) = self.known.nearest(&fit.apply(point), limit) else {
                continue;
            };
            let taken = &mut of_known[near.index];
            if taken.is_none_or(|other| near.distance < other.distance) {
                *taken = Some(Near { index, ..near });
            }
        }
        let pair = |(known, near): (usize, &Option<Near>)| Some([(*near)?.index, known]);
        of_known.iter().enumerate().filter_map(pair).collect()
    }

    /// The pose that chance explains least.
    fn best(&self) -> Option<&Pose> {
        let rank = |a: &&Pose, b: &&Pose| {
            let nearer = b.distances.len().cmp(&a.distances.len());
            b.evidence.total_cmp(&a.evidence).then(nearer)
        };
        self.poses.iter().min_by(rank)
    }

    /// Points beyond the triangle of the best pose, then of the others, as near as those of the best.
    fn standing(&self) -> Option<(usize, Vec<usize>)> {
        let best = self.best()?;
        let distance = best.fineness(self.lists.within);
        let others = self.poses.iter().filter(|pose| !std::ptr::eq(*pose, best));
        let of_others = others.map(|pose| pose.telling_within(distance)).collect();
        Some((best.telling_within(distance), of_others))
    }

    /// Whether no pose can be found any more that is twice as good as all others.
    fn is_ambiguous(&self) -> bool {
        let half = self.lists.points.len().min(self.lists.known.len()) / 2;
        self.standing().is_some_and(|(best, others)| {
            best >= half && others.iter().any(|other| 2 * other >= best)
        })
    }

    fn verdict(&self) -> Recognition {
        let most = |pose: Option<&Pose>| pose.map_or(0, |pose| pose.pairs.len());
        let best = self.best().filter(|best| best.evidence >= LEAST_EVIDENCE);
        let (Some(best), Some((own, others))) = (best, self.standing()) else {
            let most = most(self.poses.iter().max_by_key(|pose| pose.pairs.len()));
            return Recognition::Nothing { most };
        };
        // The noise of a point or two at the limit makes no difference of poses.
        let equals = others.iter().filter(|other| 50 * **other >= 49 * own);
        let poses = equals.count() + 1;
        let points = own + GIVEN;
        match others.iter().max() {
            _ if poses > 1 => Recognition::Several { poses, points },
            Some(rival) if 2 * rival >= own => Recognition::Rival {
                points,
                rival: rival + GIVEN,
            },
            _ => Recognition::Only(best.pairs.clone()),
        }
    }
}

fn shuffled(count: usize, random: &mut ChaCha8Rng) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    for last in (1..count).rev() {
        order.swap(last, random.random_range(0..=last));
    }
    order
}

/// The points that lie farthest out along each axis.
fn outermost(points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let ends = (0..3).flat_map(|axis| {
        let along = move |a: &&Vector3<f64>, b: &&Vector3<f64>| a[axis].total_cmp(&b[axis]);
        [points.iter().min_by(along), points.iter().max_by(along)]
    });
    ends.flatten().copied().collect()
}

#[cfg(test)]
#[path = "constellation_tests.rs"]
mod tests;
