//! The rounds of identification: propose, agree, accept, extend, take away, and again.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::calibration::{broad_sigmas, measured_shape_limit, measured_sigmas};
use super::drafts::{Draft, Draw, draw_claims, extend, merged, reduce_to_fit};
use super::hypothesis::{Bench, Hypothesis, Verdict, fit_share, log10_accidents, overlap};
use super::intersection::{Intersection, chi_square_limit, intersect, prediction_misfit};
use super::problem::{
    Claim, Identification, IdentificationInput, IdentificationSettings, KnownCircle, Leftover,
    LeftoverReason, Member, Track,
};
use super::shape::Disc;
use super::sight::Sight;
use crate::monitor::{Interrupted, Monitor, Task};

/// Partner views asked in the first round: most targets are found by them, and the crowd is gone for the rest.
const FIRST_PARTNERS: usize = 8;
/// Dots that one step of progress covers.
const CHUNK: usize = 32;
/// Dots from which the ray sigmas are measured beforehand.
const CALIBRATION_DOTS: usize = 600;
/// Rays up to which a target must fit especially well to be accepted.
const FEW_RAYS: usize = 5;
/// Angle between two rays that fixes a point well and keeps the target visible in both, radians.
const BEST_ANGLE: f64 = 0.5;

/// One pass of identification: plain targets that several views agree on, and dots of known points.
///
/// The first pass (`station_sigma_mm` large) accepts what is unambiguous; adjust with it and call again with what is
/// left. The result does not depend on the number of threads.
///
/// # Errors
/// [`Interrupted`] when the work was asked to stop.
pub fn identify(
    input: &IdentificationInput,
    settings: &IdentificationSettings,
    monitor: &Monitor,
) -> Result<Identification, Interrupted> {
    let dots: usize = input.views.iter().map(|v| v.dots.len()).sum();
    let task = monitor.task("identifying targets", dots as u64);
    let mut pass = Pass::new(input, settings);
    pass.calibrate(&task)?;
    let mut most_partners = FIRST_PARTNERS;
    for _ in 0..settings.max_rounds {
        let gained = pass.round(most_partners, &task)?;
        if gained == 0 && most_partners == usize::MAX {
            break;
        }
        if gained * 50 < dots {
            most_partners = usize::MAX;
        }
        pass.recalibrate();
    }
    Ok(pass.finish())
}

/// The state of a pass.
struct Pass<'a> {
    input: &'a IdentificationInput<'a>,
    settings: &'a IdentificationSettings,
    sights: Vec<Sight>,
    partners: Vec<Vec<usize>>,
    /// Largest accepted misfit of an ellipse, in units of what the settings allow.
    shape_limit: f64,
    /// Ray sigmas that sigma_S allows, px.
    broad: Vec<f64>,
    free: Vec<Vec<bool>>,
    /// Known points first, in their order, then the new targets.
    drafts: Vec<Draft>,
    /// The last verdict on each dot.
    verdicts: Vec<Vec<Verdict>>,
}

impl<'a> Pass<'a> {
    fn new(input: &'a IdentificationInput, settings: &'a IdentificationSettings) -> Self {
        let broad = broad_sigmas(input);
        let sights: Vec<Sight> = input
            .views
            .iter()
            .zip(&broad)
            .map(|(view, &sigma)| Sight::new(view, sigma))
            .collect();
        let drafts = input
            .known
            .iter()
            .enumerate()
            .map(|(index, known)| Draft {
                members: Vec::new(),
                known: Some(index),
                point: known.position,
                covariance: Matrix3::identity() * known.sigma_mm.powi(2),
                seen_in: known.seen_in.clone(),
                normal: known.circle.map(|c| c.normal),
                disc: known
                    .circle
                    .and_then(|c| c.diameter_mm.map(|d| Disc::known(d, c.normal))),
                log10_accidents: f64::NEG_INFINITY,
                rival_rays: 0,
            })
            .collect();
        Self {
            input,
            settings,
            partners: partners(input, &sights),
            broad,
            shape_limit: 1.0,
            free: input
                .views
                .iter()
                .map(|v| vec![true; v.dots.len()])
                .collect(),
            verdicts: input
                .views
                .iter()
                .map(|v| vec![Verdict::default(); v.dots.len()])
                .collect(),
            sights,
            drafts,
        }
    }

    fn bench(&self) -> Bench<'_> {
        Bench {
            sights: &self.sights,
            partners: &self.partners,
            space: self.input.space,
            settings: self.settings,
            shape_limit: self.shape_limit,
        }
    }

    fn free_dots(&self) -> Vec<Member> {
        let mut dots = Vec::new();
        for (view, free) in self.free.iter().enumerate() {
            dots.extend(
                free.iter()
                    .enumerate()
                    .filter(|(_, is_free)| **is_free)
                    .map(|(dot, _)| Member { view, dot }),
            );
        }
        dots
    }

    fn search(
        &self,
        seeds: &[Member],
        most_partners: usize,
        task: &Task,
    ) -> Result<Vec<Verdict>, Interrupted> {
        let bench = self.bench();
        let chunks: Vec<Vec<Verdict>> = seeds
            .par_chunks(CHUNK)
            .map(|chunk| {
                chunk
                    .iter()
                    .map(|&seed| {
                        task.step()?;
                        Ok(bench.search(seed, most_partners))
                    })
                    .collect()
            })
            .collect::<Result<_, Interrupted>>()?;
        Ok(chunks.into_iter().flatten().collect())
    }

    /// Measures how far rays really miss each other from a sample of strong intersections; sigma_S only bounds it.
    fn calibrate(&mut self, task: &Task) -> Result<(), Interrupted> {
        let all = self.free_dots();
        let sample: Vec<Member> = all
            .iter()
            .step_by(all.len().div_ceil(CALIBRATION_DOTS).max(1))
            .copied()
            .collect();
        for _ in 0..2 {
            let verdicts = self.search(&sample, FIRST_PARTNERS, task)?;
            let strong: Vec<(&[Member], Vector3<f64>)> = verdicts
                .iter()
                .filter_map(|v| {
                    let best = v.best.as_ref()?;
                    let rays = best.members.len();
                    let accidents = best.log10_accidents(v.pairs, self.settings);
                    (rays >= 4 && accidents < self.settings.accidents_allowed(rays))
                        .then_some((&best.members[..], best.point))
                })
                .collect();
            self.take_sigmas(&strong);
        }
        Ok(())
    }

    fn recalibrate(&mut self) {
        let drafts = std::mem::take(&mut self.drafts);
        let strong: Vec<(&[Member], Vector3<f64>)> = drafts
            .iter()
            .filter(|d| d.known.is_none() && d.members.len() >= 4)
            .map(|d| (&d.members[..], d.point))
            .collect();
        self.take_sigmas(&strong);
        self.drafts = drafts;
    }

    fn take_sigmas(&mut self, strong: &[(&[Member], Vector3<f64>)]) {
        if let Some(limit) = measured_shape_limit(&self.sights, strong, self.settings) {
            self.shape_limit = limit;
        }
        let floor = self.input.image_tolerance_px;
        if let Some(sigmas) = measured_sigmas(&self.sights, strong, floor, &self.broad) {
            for (sight, sigma) in self.sights.iter_mut().zip(sigmas) {
                sight.sigma_px = sigma;
            }
        }
    }

    /// One round; the number of dots that it labelled.
    fn round(&mut self, most_partners: usize, task: &Task) -> Result<usize, Interrupted> {
        for (sight, free) in self.sights.iter_mut().zip(&self.free) {
            sight.index_free(free);
        }
        let seeds = self.free_dots();
        let found = self.search(&seeds, most_partners, task)?;
        for (seed, verdict) in seeds.iter().zip(found) {
            self.verdicts[seed.view][seed.dot] = verdict;
        }
        let before = seeds.len();
        let known = self.input.known.len();
        self.extend_drafts(0..known);
        self.accept(&seeds);
        self.extend_drafts(known..self.drafts.len());
        self.drafts = merged(
            &self.sights,
            std::mem::take(&mut self.drafts),
            self.settings,
        );
        self.drop_misfits();
        Ok(before.saturating_sub(self.free_dots().len()))
    }

    /// Gives free dots to existing points by prediction.
    fn extend_drafts(&mut self, range: std::ops::Range<usize>) {
        let draws: Vec<Draw> = draw_claims(
            &self.drafts,
            range,
            &self.verdicts,
            &self.free,
            &self.bench(),
        );
        for draw in &draws {
            self.free[draw.member.view][draw.member.dot] = false;
        }
        extend(&self.sights, &mut self.drafts, &draws);
    }

    /// Accepts the intersections on which their dots agree, best first.
    fn accept(&mut self, seeds: &[Member]) {
        let mut order: Vec<(Member, &Hypothesis)> = seeds
            .iter()
            .filter_map(|&seed| {
                let best = self.verdicts[seed.view][seed.dot].best.as_ref()?;
                (best.members.len() >= self.settings.min_rays.max(3)).then_some((seed, best))
            })
            .collect();
        order.sort_by(|a, b| {
            let rays = b.1.members.len().cmp(&a.1.members.len());
            rays.then(a.1.variance_factor.total_cmp(&b.1.variance_factor))
                .then(a.0.cmp(&b.0))
        });
        let mut accepted = Vec::new();
        let mut free = self.free.clone();
        for (seed, hypothesis) in order {
            if let Some(draft) = self.agreed(seed, hypothesis, &free) {
                for member in &draft.members {
                    free[member.view][member.dot] = false;
                }
                accepted.push(draft);
            }
        }
        self.free = free;
        self.drafts.extend(accepted);
    }

    /// The part of a hypothesis whose dots call it their own best, if that part stands all tests.
    fn agreed(&self, seed: Member, hypothesis: &Hypothesis, free: &[Vec<bool>]) -> Option<Draft> {
        if !free[seed.view][seed.dot] {
            return None;
        }
        let all = hypothesis.members.len();
        let mut members: Vec<Member> = hypothesis
            .members
            .iter()
            .copied()
            .filter(|m| free[m.view][m.dot] && self.agrees(*m, hypothesis))
            .collect();
        // A point that most of its dots refuse is no point.
        if members.len() < self.settings.min_rays.max(3) || members.len() * 5 < all * 3 {
            return None;
        }
        let fit = self.bench().fitting(&mut members, &hypothesis.point)?;
        if members.len() < self.settings.min_rays.max(3) {
            return None;
        }
        let limit = chi_square_limit(fit.redundancy(), self.settings.critical_deviate_few);
        if members.len() <= FEW_RAYS && fit.chi_square > limit {
            return None;
        }
        let pairs = self.verdicts[seed.view][seed.dot].pairs;
        let share = fit_share(
            members.len(),
            fit.chi_square / fit.redundancy().max(1) as f64,
            self.settings,
        );
        let accidents = log10_accidents(pairs, members.len(), hypothesis.accidental_hits, share);
        let rival_rays = members
            .iter()
            .map(|m| self.verdicts[m.view][m.dot].rival_rays())
            .max()?;
        if accidents > self.settings.accidents_allowed(members.len()) || rival_rays >= members.len()
        {
            return None;
        }
        Some(Draft {
            known: None,
            point: fit.point,
            covariance: fit.covariance,
            seen_in: Vec::new(),
            normal: hypothesis.disc.map(|d| d.normal),
            disc: hypothesis.disc,
            log10_accidents: accidents,
            rival_rays,
            members,
        })
    }

    /// Whether a dot's own best intersection is this one, with no strong other target through the dot.
    fn agrees(&self, member: Member, hypothesis: &Hypothesis) -> bool {
        let verdict = &self.verdicts[member.view][member.dot];
        let Some(best) = &verdict.best else {
            return false;
        };
        let (shared, conflicts) = overlap(&best.members, &hypothesis.members);
        let smaller = best.members.len().min(hypothesis.members.len());
        let same = shared >= 2 && shared * 2 >= smaller && shared > conflicts;
        let contested = verdict.rival.as_ref().is_some_and(|rival| {
            let rays = rival.members.len();
            let accidents = rival.log10_accidents(verdict.pairs, self.settings);
            rays >= 4
                && rays * 2 >= best.members.len()
                && accidents < self.settings.accidents_allowed(rays)
        });
        same && !contested && !verdict.is_near_tie()
    }

    /// Frees dots that no longer fit their target, and all dots of targets left with too few rays.
    fn drop_misfits(&mut self) {
        let known = self.input.known.len();
        let drafts = std::mem::take(&mut self.drafts);
        for (index, mut draft) in drafts.into_iter().enumerate() {
            if index >= known {
                let dropped = reduce_to_fit(&self.bench(), &mut draft);
                for member in dropped {
                    self.free[member.view][member.dot] = true;
                }
                if draft.members.len() < self.settings.min_rays.max(3) {
                    for member in &draft.members {
                        self.free[member.view][member.dot] = true;
                    }
                    continue;
                }
            }
            self.drafts.push(draft);
        }
    }

    fn finish(self) -> Identification {
        let mut result = Identification {
            ray_sigma_px: self.sights.iter().map(|s| s.sigma_px).collect(),
            ..Identification::default()
        };
        result.leftover = self
            .free_dots()
            .into_iter()
            .map(|member| Leftover {
                member,
                reason: self.reason(member),
            })
            .collect();
        for draft in &self.drafts {
            if let Some(known) = draft.known {
                result
                    .claims
                    .extend(draft.members.iter().map(|&member| Claim {
                        known,
                        member,
                        distance_px: self.distance_px(draft, member),
                    }));
            } else {
                result.tracks.push(self.track(draft));
            }
        }
        result.claims.sort_by_key(|c| (c.member, c.known));
        result.tracks.sort_by(|a, b| a.members.cmp(&b.members));
        result
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
            sigma_mm: (draft.covariance.trace() / 3.0).max(0.0).sqrt(),
            rms_px: fit.as_ref().map_or(0.0, Intersection::rms_px),
            chi_square: fit.as_ref().map_or(0.0, |f| f.chi_square),
            redundancy: (2 * draft.members.len()).saturating_sub(3),
            members: draft.members.clone(),
            log10_accidents: draft.log10_accidents,
            rival_rays: draft.rival_rays,
            circle: draft.disc.map(|d| KnownCircle {
                diameter_mm: Some(d.diameter_mm),
                normal: d.normal,
            }),
        }
    }

    fn reason(&self, member: Member) -> LeftoverReason {
        let sight = &self.sights[member.view];
        let near = self
            .drafts
            .iter()
            .filter(|d| d.may_see(sight, &self.sights, self.settings))
            .filter(|d| {
                prediction_misfit(sight, member.dot, &d.point, &d.covariance)
                    .is_some_and(|m| m <= self.settings.critical_ray)
            })
            .map(|d| self.distance_px(d, member))
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
        let accidents = verdict.best.as_ref().map_or(0.0, |best| {
            best.log10_accidents(verdict.pairs, self.settings)
        });
        if accidents > self.settings.accidents_allowed(rays) {
            return LeftoverReason::Accidental {
                rays,
                log10_accidents: accidents,
            };
        }
        LeftoverReason::Ambiguous {
            rays,
            rival_rays: verdict.rival_rays(),
        }
    }
}

/// Partner views of each view, those of a good angle at the object first.
fn partners(input: &IdentificationInput, sights: &[Sight]) -> Vec<Vec<usize>> {
    let centre = input.space.centre();
    (0..sights.len())
        .map(|view| {
            let towards = |v: usize| sights[v].centre - centre;
            let mut ranked: Vec<(f64, usize)> = input
                .neighbours
                .get(view)
                .into_iter()
                .flatten()
                .filter(|&&other| other != view && other < sights.len())
                .map(|&other| {
                    let angle = towards(view).angle(&towards(other));
                    ((angle - BEST_ANGLE).abs(), other)
                })
                .collect();
            ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            ranked.dedup_by_key(|r| r.1);
            ranked.into_iter().map(|r| r.1).collect()
        })
        .collect()
}
