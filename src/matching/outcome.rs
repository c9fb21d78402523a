//! What a pass found, and why the other dots stay without a label.

use std::collections::BTreeMap;

use nalgebra::Vector2;
use rayon::prelude::*;

use super::drafts::Draft;
use super::identify::Pass;
use super::intersection::{Intersection, intersect, prediction_misfit};
use super::problem::{
    Claim, Identification, KnownCircle, Leftover, LeftoverReason, Member, Pair, Track,
};
use super::sizes::Sizes;
use crate::monitor::Interrupted;

impl Pass<'_> {
    pub(super) fn finish(mut self) -> Result<Identification, Interrupted> {
        let mut result = Identification {
            unexplained_px: self.sights.iter().map(|s| s.extra_px2.sqrt()).collect(),
            ..Identification::default()
        };
        let free = self.free_dots();
        self.monitor.check()?;
        let sizes = self.sizes(free.iter().map(|m| &self.verdicts[m.view][m.dot]));
        let leftover: Vec<Vec<Leftover>> = (0..self.sights.len())
            .into_par_iter()
            .map(|view| {
                self.monitor.check()?;
                let places = Places::of(&self, view);
                let reasons = self.free_dots_of(view).map(|member| Leftover {
                    member,
                    reason: self.reason(&places, &sizes, member),
                });
                Ok(reasons.collect())
            })
            .collect::<Result<_, Interrupted>>()?;
        result.leftover = leftover.into_iter().flatten().collect();
        result.pairs = self.pairs_left()?;
        let mut tracks: Vec<(usize, Track)> = Vec::new();
        for (index, draft) in self.drafts.iter().enumerate() {
            self.monitor.check()?;
            if let Some(known) = draft.known {
                result
                    .claims
                    .extend(draft.members.iter().map(|&member| Claim {
                        known,
                        member,
                        distance_px: self.distance_px(draft, member),
                    }));
            } else {
                tracks.push((index, self.track(draft)));
            }
        }
        result.claims.sort_by_key(|c| (c.member, c.known));
        tracks.sort_by(|a, b| a.1.members.cmp(&b.1.members));
        let track_of_draft = (0..)
            .zip(&tracks)
            .map(|(place, (draft, _))| (*draft, place));
        result.groups = self.groups(&track_of_draft.collect())?;
        result.tracks = tracks.into_iter().map(|(_, track)| track).collect();
        Ok(result)
    }

    /// Pairs of free dots on the surface that the accepted targets show. A dot of which there are many tells nothing.
    fn pairs_left(&self) -> Result<Vec<Pair>, Interrupted> {
        /// Partner views that are asked.
        const PARTNERS: usize = 10;
        /// Most pairs of a dot that are told.
        const MOST: usize = 4;
        let surface = self.surface();
        let bench = self.bench();
        let of_dot = |seed: &Member| {
            self.monitor.check()?;
            let pairs = bench.pairs_on_surface(*seed, &surface, PARTNERS);
            if pairs.len() > MOST {
                Ok(Vec::new())
            } else {
                Ok(pairs)
            }
        };
        let seeds = self.free_dots();
        let found: Vec<Vec<Pair>> = seeds
            .par_iter()
            .map(of_dot)
            .collect::<Result<_, Interrupted>>()?;
        let mut pairs: Vec<Pair> = found.into_iter().flatten().collect();
        for pair in &mut pairs {
            pair.members.sort_unstable();
        }
        pairs.sort_by_key(|pair| pair.members);
        pairs.dedup_by_key(|pair| pair.members);
        Ok(pairs)
    }

    fn distance_px(&self, draft: &Draft, member: Member) -> f64 {
        let sight = &self.sights[member.view];
        sight.sighting(&draft.point).map_or(f64::INFINITY, |seen| {
            (sight.dots[member.dot].place - seen.place).norm()
        })
    }

    fn track(&self, draft: &Draft) -> Track {
        let fit = intersect(&self.sights, &draft.members, &draft.point);
        Track {
            position: draft.point,
            covariance: draft.covariance,
            rms_px: fit.as_ref().map_or(0.0, Intersection::rms_px),
            chi_square: fit.as_ref().map_or(0.0, |f| f.chi_square),
            redundancy: (2 * draft.members.len()).saturating_sub(3),
            members: draft.members.clone(),
            log10_accidents: Some(draft.log10_accidents),
            rival_rays: draft.rival_rays,
            circle: draft.disc.map(|d| KnownCircle {
                diameter_mm: Some(d.diameter_mm),
                normal: d.normal,
            }),
        }
    }

    fn reason(&self, places: &Places, sizes: &Sizes, member: Member) -> LeftoverReason {
        let sight = &self.sights[member.view];
        let near = places
            .near(&sight.dots[member.dot].place)
            .filter_map(|index| {
                let draft = &self.drafts[index];
                let misfit = prediction_misfit(sight, member.dot, &draft.point, &draft.covariance)?;
                (misfit <= self.settings.critical_ray).then(|| self.distance_px(draft, member))
            })
            .min_by(f64::total_cmp);
        if let Some(distance_px) = near {
            return LeftoverReason::Contested { distance_px };
        }
        let verdict = &self.verdicts[member.view][member.dot];
        let rays = verdict.rays();
        let needed = self.settings.min_rays.max(3);
        if verdict.pairs == 0 {
            return LeftoverReason::NoPartner;
        }
        if rays < needed {
            return LeftoverReason::TooFewRays {
                found: rays,
                needed,
            };
        }
        let accidents = verdict
            .best
            .as_ref()
            .map_or(0.0, |best| best.log10_accidents(self.pairs, self.limits));
        if accidents > self.settings.log10_accidents {
            return LeftoverReason::Accidental {
                rays,
                log10_accidents: accidents,
            };
        }
        let disc = verdict.best.as_ref().and_then(|best| best.disc);
        if let Some(disc) = disc.filter(|disc| !sizes.allow(Some(disc.diameter_mm), rays)) {
            return LeftoverReason::OddSize {
                rays,
                diameter_mm: disc.diameter_mm,
            };
        }
        LeftoverReason::Ambiguous {
            rays,
            rival_rays: verdict.rival_rays(),
        }
    }
}

/// Where a view ought to show the drafts that it may see, by cells.
struct Places {
    cells: BTreeMap<(i64, i64), Vec<usize>>,
}

impl Places {
    /// Side of a cell, px: no dot farther than that from a predicted place has anything to do with it.
    const CELL_PX: f64 = 64.0;

    fn of(pass: &Pass, view: usize) -> Self {
        let sight = &pass.sights[view];
        let mut cells: BTreeMap<(i64, i64), Vec<usize>> = BTreeMap::new();
        for (index, draft) in pass.drafts.iter().enumerate() {
            let place = sight.place(&draft.point);
            if let Some(place) = place.filter(|_| draft.may_see(sight, &pass.sights, pass.settings))
            {
                cells.entry(Self::cell(&place)).or_default().push(index);
            }
        }
        Self { cells }
    }

    fn cell(place: &Vector2<f64>) -> (i64, i64) {
        let at = |value: f64| (value / Self::CELL_PX).floor() as i64;
        (at(place.x), at(place.y))
    }

    /// Drafts whose places lie in the cell of a place or in one beside it.
    fn near(&self, place: &Vector2<f64>) -> impl Iterator<Item = usize> {
        let (column, row) = Self::cell(place);
        let cells = (-1..=1).flat_map(move |i| (-1..=1).map(move |j| (column + i, row + j)));
        cells
            .filter_map(|cell| self.cells.get(&cell))
            .flatten()
            .copied()
    }
}
