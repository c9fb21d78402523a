//! What the dots that are left may be: readings that exclude each other, with their likelihoods.
//!
//! A reading says that some dots are one target. Its likelihood is set against that of dots which belong to nothing and lie scattered at
//! their local density `rho` (as target tracking scores its tracks: Blackman and Popoli, 1999, chapter 6). With the ray covariances `R`,
//! the intersection's covariance `C` and `p` targets per cubic millimetre, the integral over all places of the target is
//!
//! `ln L = -(chi2 of rays + chi2 of shape) / 2 - sum ln(2 pi sqrt|R| rho) + 3/2 ln(2 pi) + ln|C| / 2 + ln p`,
//!
//! exactly so where projection is linear about the intersection. For a dot of a point that exists already it is the normal density of its
//! distance from the prediction over `rho`. Rays, shapes and densities are those by which targets are accepted; as in counting
//! accidents, only dots of the same shape count for `rho`, and on the surface of the accepted targets they lie the denser the thinner
//! it is.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::drafts::{Candidate, candidates};
use super::identify::Pass;
use super::intersection::ray_covariance;
use super::problem::Member;
use super::shape::Disc;
use super::surface::Surface;
use crate::monitor::Interrupted;

/// Most readings of a group that are told: who decides has no use for more.
const MOST_READINGS: usize = 9;

/// Dots whose readings exclude each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// The readings, the likeliest first. Every other one excludes it: they share a dot, or say two dots of one view to be one point.
    pub readings: Vec<Reading>,
}

/// One way to read some of the dots that are left: as one target.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Which target.
    pub target: ReadAs,
    /// Its dots, by view.
    pub members: Vec<Member>,
    /// How well the rays agree.
    pub rays: Agreement,
    /// How well the ellipses agree; no freedom where they tell nothing.
    pub shape: Agreement,
    /// Diameter, in the unit of the network, where the ellipses tell it.
    pub diameter_mm: Option<f64>,
    /// Natural logarithm of its likelihood over that of dots which belong to nothing.
    pub log_likelihood: f64,
}

/// The target of a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReadAs {
    /// One that nobody knows yet.
    NewTarget {
        /// Where its rays meet, mm.
        position: Vector3<f64>,
        /// Covariance of the place, mm^2.
        covariance: Matrix3<f64>,
    },
    /// A known point, by its index.
    Known(usize),
    /// A target of this pass, by its index among the tracks.
    Track(usize),
}

/// A square sum of standardised misfits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Agreement {
    /// The sum.
    pub chi_square: f64,
    /// Its degrees of freedom.
    pub freedom: usize,
}

impl Pass<'_> {
    /// The questions that are left; `track_of_draft` gives the places of new targets among the tracks.
    pub(super) fn groups(
        &mut self,
        track_of_draft: &BTreeMap<usize, usize>,
    ) -> Result<Vec<Group>, Interrupted> {
        self.index_free()?;
        let mut readings = self.new_targets()?;
        readings.extend(self.further_dots(track_of_draft)?);
        // Less likely than chance is no reading.
        readings.retain(|reading| reading.log_likelihood > 0.0);
        readings.sort_by(|a, b| {
            let likelihood = b.log_likelihood.total_cmp(&a.log_likelihood);
            likelihood.then_with(|| a.members.cmp(&b.members))
        });
        Ok(questions(&readings))
    }

    /// Intersections that the searches of the last round proposed.
    fn new_targets(&self) -> Result<Vec<Reading>, Interrupted> {
        let needed = self.settings.min_rays.max(3);
        let bench = self.bench();
        let mut proposed: BTreeMap<Vec<Member>, Vector3<f64>> = BTreeMap::new();
        for dot in self.free_dots() {
            self.monitor.check()?;
            let verdict = &self.verdicts[dot.view][dot.dot];
            for hypothesis in verdict.best.iter().chain(&verdict.rival) {
                let mut members = hypothesis.members.clone();
                members.retain(|m| self.free[m.view][m.dot]);
                if members.len() >= needed {
                    proposed.entry(members).or_insert(hypothesis.point);
                }
            }
        }
        let fitted: Vec<Option<(Vec<Member>, Vector3<f64>)>> = proposed
            .into_par_iter()
            .map(|(mut members, start)| {
                self.monitor.check()?;
                let fit = bench.fitting(&mut members, &start);
                let whole = members.len() >= needed;
                Ok(fit.filter(|_| whole).map(|fit| (members, fit.point)))
            })
            .collect::<Result<_, Interrupted>>()?;
        self.monitor.check()?;
        let surface = self.surface();
        let whole = without_parts(fitted.into_iter().flatten().collect());
        let weighed: Vec<Option<Reading>> = whole
            .par_iter()
            .map(|(members, start)| {
                self.monitor.check()?;
                Ok(self.new_target(members, start, &surface))
            })
            .collect::<Result<_, Interrupted>>()?;
        Ok(weighed.into_iter().flatten().collect())
    }

    fn new_target(
        &self,
        members: &[Member],
        start: &Vector3<f64>,
        surface: &Surface,
    ) -> Option<Reading> {
        let bench = self.bench();
        let mut kept = members.to_vec();
        let fit = bench.fitting(&mut kept, start)?;
        let disc = Disc::fitted(&self.sights, &kept, &fit.point, &self.noise);
        let mut shape = Agreement::default();
        let mut log_scattered = 0.0;
        for member in &kept {
            let sight = &self.sights[member.view];
            let seen = sight.sighting(&fit.point)?;
            if let Some(disc) = &disc
                && sight.dots[member.dot].axes.is_some()
            {
                shape.chi_square += disc.misfit(sight, member.dot, &seen, &self.noise);
                shape.freedom += 3;
            }
            let of_ray = ray_covariance(sight, member.dot, &seen);
            let density = bench.density_alike(member.view, &seen, disc.as_ref());
            log_scattered += log_hits(of_ray.determinant(), density);
        }
        // A disc has a direction and a diameter.
        shape.freedom = shape.freedom.saturating_sub(3);
        let share = surface.share(&fit.point, &fit.covariance);
        let log_targets = self.targets_per_mm3().ln() - share.ln();
        let log_place = 1.5 * std::f64::consts::TAU.ln() + 0.5 * fit.covariance.determinant().ln();
        let log_likelihood =
            log_place + log_targets - log_scattered - (fit.chi_square + shape.chi_square) / 2.0;
        Some(Reading {
            target: ReadAs::NewTarget {
                position: fit.point,
                covariance: fit.covariance,
            },
            rays: Agreement {
                chi_square: fit.chi_square,
                freedom: fit.redundancy(),
            },
            members: kept,
            shape,
            diameter_mm: disc.map(|disc| disc.diameter_mm),
            log_likelihood,
        })
    }

    /// Targets per cubic millimetre of the object, as far as they are known.
    fn targets_per_mm3(&self) -> f64 {
        let size = self.input.space.max - self.input.space.min;
        self.drafts.len().max(1) as f64 / size.product().max(f64::MIN_POSITIVE)
    }

    /// Dots that may belong to points which exist already.
    fn further_dots(
        &self,
        track_of_draft: &BTreeMap<usize, usize>,
    ) -> Result<Vec<Reading>, Interrupted> {
        let of_view = |view: usize| {
            self.monitor.check()?;
            let near = candidates(&self.bench(), &self.drafts, view, &self.free);
            let near = near.iter();
            Ok(near
                .filter(|candidate| candidate.misfit <= self.settings.critical_ray)
                .filter_map(|candidate| self.further_dot(view, candidate, track_of_draft))
                .collect())
        };
        let found: Vec<Vec<Reading>> = (0..self.sights.len())
            .into_par_iter()
            .map(of_view)
            .collect::<Result<_, Interrupted>>()?;
        Ok(found.into_iter().flatten().collect())
    }

    fn further_dot(
        &self,
        view: usize,
        candidate: &Candidate,
        track_of_draft: &BTreeMap<usize, usize>,
    ) -> Option<Reading> {
        let draft = &self.drafts[candidate.draft];
        let sight = &self.sights[view];
        let seen = sight.sighting(&draft.point)?;
        let spread = seen.by_point * draft.covariance * seen.by_point.transpose()
            + ray_covariance(sight, candidate.dot, &seen);
        let shape = draft
            .disc
            .filter(|_| sight.dots[candidate.dot].axes.is_some())
            .map_or(Agreement::default(), |disc| Agreement {
                chi_square: disc.misfit(sight, candidate.dot, &seen, &self.noise),
                freedom: 3,
            });
        let density = self.bench().density_alike(view, &seen, draft.disc.as_ref());
        let log_scattered = log_hits(spread.determinant(), density);
        Some(Reading {
            target: match draft.known {
                Some(known) => ReadAs::Known(known),
                None => ReadAs::Track(*track_of_draft.get(&candidate.draft)?),
            },
            members: vec![Member {
                view,
                dot: candidate.dot,
            }],
            rays: Agreement {
                chi_square: candidate.misfit,
                freedom: 2,
            },
            shape,
            diameter_mm: draft.disc.map(|disc| disc.diameter_mm),
            log_likelihood: -log_scattered - (candidate.misfit + shape.chi_square) / 2.0,
        })
    }
}

/// Logarithm of how many scattered dots the area `2 pi sqrt|covariance|` holds, the area of a normal distribution over its peak.
fn log_hits(determinant: f64, density: f64) -> f64 {
    (std::f64::consts::TAU * determinant.max(0.0).sqrt() * density).ln()
}

/// Those that are not part of another one.
fn without_parts(
    proposed: BTreeMap<Vec<Member>, Vector3<f64>>,
) -> Vec<(Vec<Member>, Vector3<f64>)> {
    let mut through: BTreeMap<Member, Vec<&Vec<Member>>> = BTreeMap::new();
    for members in proposed.keys() {
        for member in members {
            through.entry(*member).or_default().push(members);
        }
    }
    let is_part = |members: &Vec<Member>| {
        let rivals = members.first().and_then(|first| through.get(first));
        rivals.into_iter().flatten().any(|other| {
            other.len() > members.len() && members.iter().all(|m| other.binary_search(m).is_ok())
        })
    };
    let parts: BTreeSet<Vec<Member>> = proposed.keys().filter(|m| is_part(m)).cloned().collect();
    proposed
        .into_iter()
        .filter(|(members, _)| !parts.contains(members))
        .collect()
}

/// What only one reading can claim.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Claimed {
    Dot(Member),
    /// The one dot of a known point in a view.
    KnownIn(usize, usize),
    /// The one dot of a new target in a view.
    TrackIn(usize, usize),
}

fn claimed(reading: &Reading) -> impl Iterator<Item = Claimed> {
    let members = reading.members.iter();
    members.flat_map(|member| {
        let of_point = match reading.target {
            ReadAs::NewTarget { .. } => None,
            ReadAs::Known(point) => Some(Claimed::KnownIn(point, member.view)),
            ReadAs::Track(track) => Some(Claimed::TrackIn(track, member.view)),
        };
        [Some(Claimed::Dot(*member)), of_point]
            .into_iter()
            .flatten()
    })
}

/// Readings (the likeliest first) as questions: each time the likeliest one that is not asked about yet, against all that exclude it.
/// What else hangs on the answer is asked when it is given; the question that settles most dots comes first.
fn questions(readings: &[Reading]) -> Vec<Group> {
    let mut claims: BTreeMap<Claimed, Vec<usize>> = BTreeMap::new();
    for (place, reading) in readings.iter().enumerate() {
        for claim in claimed(reading) {
            claims.entry(claim).or_default().push(place);
        }
    }
    let mut asked = vec![false; readings.len()];
    let mut groups = Vec::new();
    for (place, reading) in readings.iter().enumerate() {
        let against: BTreeSet<usize> = claimed(reading)
            .filter_map(|claim| claims.get(&claim))
            .flatten()
            .copied()
            .filter(|other| !asked[*other])
            .collect();
        if asked[place] || against.len() < 2 {
            continue;
        }
        for other in &against {
            asked[*other] = true;
        }
        let told = against.into_iter().take(MOST_READINGS);
        groups.push(Group {
            readings: told.map(|other| readings[other].clone()).collect(),
        });
    }
    // Stable: among equals the likelier one stays first.
    groups.sort_by_key(|group| std::cmp::Reverse(group.settles()));
    groups
}

impl Group {
    /// Dots that its readings claim.
    fn settles(&self) -> usize {
        let members = self.readings.iter().flat_map(|reading| &reading.members);
        members.collect::<BTreeSet<_>>().len()
    }
}

#[cfg(test)]
#[path = "readings_tests.rs"]
mod tests;
