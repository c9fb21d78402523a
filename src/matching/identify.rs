//! The rounds of identification: propose, agree, accept, extend, take away, and again.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::calibration::{broad_sigmas, measured_extras, measured_shape_scale};
use super::drafts::{Draft, Draw, draw_claims, extend, merged, reduce_to_fit};
use super::hypothesis::{Bench, Hypothesis, Verdict, log10_accidents, overlap};
use super::limits::Limits;
use super::problem::{
    Identification, IdentificationInput, IdentificationSettings, Member, ObjectSpace,
};
use super::shape::{Disc, ShapeNoise};
use super::sight::Sight;
use super::sizes::Sizes;
use super::surface::Surface;
use crate::monitor::{Interrupted, Monitor, Task};

/// Partner views asked in the first round: most targets are found by them, and the crowd is gone for the rest.
const FIRST_PARTNERS: usize = 8;
/// Share of the dots that are taken to belong to no target, at least.
const LEAST_ORPHANS: f64 = 0.1;
/// Dots that one step of progress covers.
const CHUNK: usize = 32;
/// Dots from which the ray sigmas are measured beforehand.
const CALIBRATION_DOTS: usize = 600;
/// Angle between two rays that fixes a point well and keeps the target visible in both, radians.
const BEST_ANGLE: f64 = 0.5;

/// One pass of identification: plain targets that several views agree on, and dots of known points.
///
/// The first pass accepts what is unambiguous; adjust with it and call again with what is left. The result does not depend on the number
/// of threads.
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
    let limits = Limits::new(settings, input.views.len());
    let mut pass = Pass::new(input, settings, &limits, monitor)?;
    pass.calibrate(&task)?;
    // Dots of known points are not to be found as new targets.
    pass.extend_drafts(0..input.known.len())?;
    pass.sweep(&task)?;
    pass.recalibrate()?;
    let mut most_partners = FIRST_PARTNERS;
    for _ in 0..settings.max_rounds {
        let gained = pass.round(most_partners, &task)?;
        if gained == 0 && most_partners == usize::MAX {
            break;
        }
        if gained * 50 < dots {
            most_partners = usize::MAX;
        }
        pass.recalibrate()?;
    }
    pass.finish()
}

/// The state of a pass.
pub(super) struct Pass<'a> {
    pub(super) input: &'a IdentificationInput<'a>,
    pub(super) settings: &'a IdentificationSettings,
    pub(super) monitor: &'a Monitor,
    pub(super) sights: Vec<Sight>,
    pub(super) limits: &'a Limits,
    pub(super) partners: Vec<Vec<usize>>,
    pub(super) noise: ShapeNoise,
    /// Pairs that were tried in all, each a chance for an accident.
    pub(super) pairs: usize,
    /// Share of the readings of the last round that were not accepted.
    pub(super) refused: f64,
    /// Share of the free dots that belong to no target, as far as is known: only they can take part in an accident.
    pub(super) orphans: f64,
    /// Ray sigmas that sigma_S allows, px.
    pub(super) broad: Vec<f64>,
    pub(super) free: Vec<Vec<bool>>,
    /// Known points first, in their order, then the new targets.
    pub(super) drafts: Vec<Draft>,
    /// The last verdict on each dot.
    pub(super) verdicts: Vec<Vec<Verdict>>,
}

impl<'a> Pass<'a> {
    fn new(
        input: &'a IdentificationInput,
        settings: &'a IdentificationSettings,
        limits: &'a Limits,
        monitor: &'a Monitor,
    ) -> Result<Self, Interrupted> {
        let broad = broad_sigmas(input);
        let spaces = spaces_of_views(input);
        let views = input.views.par_iter().zip(&broad).zip(spaces);
        let sights: Vec<Sight> = views
            .map(|((view, &sigma), space)| {
                monitor.check()?;
                Ok(Sight::new(view, sigma, space))
            })
            .collect::<Result<_, _>>()?;
        let drafts = input
            .known
            .iter()
            .enumerate()
            .map(|(index, known)| Draft {
                members: Vec::new(),
                known: Some(index),
                point: known.position,
                covariance: known.covariance,
                seen_in: known.seen_in.clone(),
                normal: known.circle.map(|c| c.normal),
                disc: known.circle.and_then(|circle| {
                    Some(Disc {
                        normal: circle.normal,
                        diameter_mm: circle.diameter_mm?,
                    })
                }),
                log10_accidents: f64::NEG_INFINITY,
                rival_rays: 0,
            })
            .collect();
        Ok(Self {
            input,
            settings,
            monitor,
            partners: partners(input, &sights),
            broad,
            limits,
            noise: match &input.ellipses {
                Some(told) => ShapeNoise::told(told),
                None => ShapeNoise::unknown(settings),
            },
            pairs: 0,
            orphans: 1.0,
            refused: 0.0,
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
        })
    }

    pub(super) fn bench(&self) -> Bench<'_> {
        Bench {
            sights: &self.sights,
            partners: &self.partners,
            settings: self.settings,
            limits: self.limits,
            noise: self.noise,
        }
    }

    /// Rebuilds the indices of the views with the dots that are still free.
    pub(super) fn index_free(&mut self) -> Result<(), Interrupted> {
        let views = self.sights.par_iter_mut().zip(&self.free);
        views.try_for_each(|(sight, free)| {
            self.monitor.check()?;
            sight.index_free(free);
            Ok(())
        })
    }

    pub(super) fn free_dots(&self) -> Vec<Member> {
        (0..self.free.len())
            .flat_map(|view| self.free_dots_of(view))
            .collect()
    }

    pub(super) fn free_dots_of(&self, view: usize) -> impl Iterator<Item = Member> {
        let free = self.free[view].iter().enumerate();
        free.filter_map(move |(dot, is_free)| is_free.then_some(Member { view, dot }))
    }

    pub(super) fn search(
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
                    let accidents = best.log10_accidents(v.pairs * all.len(), self.limits);
                    (rays >= 4 && accidents < self.settings.log10_accidents)
                        .then_some((&best.members[..], best.point))
                })
                .collect();
            self.take_sigmas(&strong)?;
        }
        Ok(())
    }

    fn recalibrate(&mut self) -> Result<(), Interrupted> {
        let drafts = std::mem::take(&mut self.drafts);
        let strong: Vec<(&[Member], Vector3<f64>)> = drafts
            .iter()
            .filter(|d| d.known.is_none() && d.members.len() >= 4)
            .map(|d| (&d.members[..], d.point))
            .collect();
        self.take_sigmas(&strong)?;
        self.drafts = drafts;
        Ok(())
    }

    fn take_sigmas(&mut self, strong: &[(&[Member], Vector3<f64>)]) -> Result<(), Interrupted> {
        if self.input.ellipses.is_none()
            && let Some(scale) =
                measured_shape_scale(&self.sights, strong, &self.noise, self.monitor)?
        {
            self.noise.scale = scale;
        }
        let floor = self.input.image_tolerance_px;
        let extras = measured_extras(&self.sights, strong, floor, &self.broad, self.monitor)?;
        for (sight, extra) in self.sights.iter_mut().zip(extras.into_iter().flatten()) {
            sight.extra_px2 = extra;
        }
        Ok(())
    }

    /// One round; the number of dots that it labelled.
    fn round(&mut self, most_partners: usize, task: &Task) -> Result<usize, Interrupted> {
        self.index_free()?;
        let before = self.free_dots().len();
        // What is known takes its dots first: they have not to be searched for.
        let all = self.drafts.len();
        self.extend_drafts(0..all)?;
        self.index_free()?;
        let seeds = self.free_dots();
        let found = self.search(&seeds, most_partners, task)?;
        self.monitor.check()?;
        // Dots that took part in a target are no chance for another one.
        self.pairs = found.iter().map(|v| v.pairs).sum();
        let readable = found.iter().filter(|v| v.rays() >= 3).count();
        let alone = 1.0 - readable as f64 / seeds.len().max(1) as f64;
        // Where few readings of the round before were accepted, most of those that are left are accidents.
        self.orphans = alone.max(self.refused).max(LEAST_ORPHANS);
        let free_before_accepting = seeds.len();
        for (seed, verdict) in seeds.iter().zip(found) {
            self.verdicts[seed.view][seed.dot] = verdict;
        }
        let known = self.input.known.len();
        self.accept(&seeds)?;
        let accepted = free_before_accepting - self.free_dots().len();
        self.refused = 1.0 - accepted as f64 / readable.max(1) as f64;
        self.extend_drafts(known..self.drafts.len())?;
        let drafts = std::mem::take(&mut self.drafts);
        self.drafts = merged(&self.bench(), drafts, self.monitor)?;
        self.drop_misfits()?;
        Ok(before.saturating_sub(self.free_dots().len()))
    }

    /// Gives free dots to existing points by prediction.
    fn extend_drafts(&mut self, range: std::ops::Range<usize>) -> Result<(), Interrupted> {
        let draws: Vec<Draw> = draw_claims(
            &self.drafts,
            range,
            &self.verdicts,
            &self.free,
            &self.bench(),
            self.monitor,
        )?;
        for draw in &draws {
            self.free[draw.member.view][draw.member.dot] = false;
        }
        extend(
            &self.sights,
            &self.noise,
            &mut self.drafts,
            &draws,
            self.monitor,
        )
    }

    /// Accepts the intersections on which their dots agree, best first.
    fn accept(&mut self, seeds: &[Member]) -> Result<(), Interrupted> {
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
        self.monitor.check()?;
        let surface = self.surface();
        let sizes = self.sizes(seeds.iter().map(|m| &self.verdicts[m.view][m.dot]));
        let mut accepted = Vec::new();
        let mut free = self.free.clone();
        self.monitor.check()?;
        for (seed, hypothesis) in order {
            self.monitor.check()?;
            let diameter = hypothesis.disc.map(|disc| disc.diameter_mm);
            if !sizes.allow(diameter, hypothesis.members.len()) {
                continue;
            }
            if let Some(draft) = self.agreed(seed, hypothesis, &free, &surface) {
                for member in &draft.members {
                    free[member.view][member.dot] = false;
                }
                accepted.push(draft);
            }
        }
        self.free = free;
        self.drafts.extend(accepted);
        Ok(())
    }

    /// Sizes of the targets so far and of these readings.
    pub(super) fn sizes<'v>(&self, readings: impl Iterator<Item = &'v Verdict>) -> Sizes {
        let accepted = self.drafts.iter().filter_map(|draft| draft.disc);
        let read = readings
            .filter(|verdict| verdict.rays() >= 3)
            .filter_map(|verdict| verdict.best.as_ref()?.disc);
        Sizes::of(accepted.chain(read).map(|disc| disc.diameter_mm))
    }

    /// The surface on which the accepted targets and the known points lie.
    pub(super) fn surface(&self) -> Surface {
        let points: Vec<Vector3<f64>> = self.drafts.iter().map(|d| d.point).collect();
        let size = self.input.space.max - self.input.space.min;
        Surface::of(&points, size.min())
    }

    /// The part of a hypothesis whose dots call it their own best, if that part stands all tests.
    fn agreed(
        &self,
        seed: Member,
        hypothesis: &Hypothesis,
        free: &[Vec<bool>],
        surface: &Surface,
    ) -> Option<Draft> {
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
        let share = fit.chi_square / self.limits.whole(fit.redundancy());
        let hits = hypothesis.accidental_hits;
        let on_surface = surface.share(&fit.point, &fit.covariance);
        // All of its dots must be orphans.
        let accidents = log10_accidents(self.pairs, members.len(), hits, share)
            + members.len() as f64 * self.orphans.log10()
            + on_surface.log10();
        let rival_rays = members
            .iter()
            .map(|m| self.verdicts[m.view][m.dot].rival_rays())
            .max()?;
        if accidents > self.settings.log10_accidents || rival_rays >= members.len() {
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
            let accidents = rival.log10_accidents(self.pairs, self.limits);
            rays >= 4 && rays * 2 >= best.members.len() && accidents < self.settings.log10_accidents
        });
        same && !contested && !verdict.is_near_tie()
    }

    /// Frees dots that no longer fit their target, and all dots of targets left with too few rays.
    fn drop_misfits(&mut self) -> Result<(), Interrupted> {
        let known = self.input.known.len();
        let new_ones = self.drafts.split_off(known);
        let bench = self.bench();
        let reduced: Vec<(Draft, Vec<Member>)> = new_ones
            .into_par_iter()
            .map(|mut draft| {
                self.monitor.check()?;
                let dropped = reduce_to_fit(&bench, &mut draft);
                Ok((draft, dropped))
            })
            .collect::<Result<_, Interrupted>>()?;
        for (draft, mut dropped) in reduced {
            let stays = draft.members.len() >= self.settings.min_rays.max(3);
            if !stays {
                dropped.extend(&draft.members);
            }
            for member in dropped {
                self.free[member.view][member.dot] = true;
            }
            if stays {
                self.drafts.push(draft);
            }
        }
        Ok(())
    }
}

/// Partner views of each view, those of a good angle at the object first.
fn partners(input: &IdentificationInput, sights: &[Sight]) -> Vec<Vec<usize>> {
    (0..sights.len())
        .map(|view| {
            let centre = sights[view].space.centre();
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

/// Where the targets of each view may lie: about the known points that it shows.
pub(super) fn spaces_of_views(input: &IdentificationInput) -> Vec<ObjectSpace> {
    /// Fewest known points that tell it.
    const FEWEST: usize = 6;
    /// By how much of their diagonal their box is widened on all sides.
    const MARGIN: f64 = 0.7;
    let mut shown: Vec<Vec<&Vector3<f64>>> = vec![Vec::new(); input.views.len()];
    for known in input.known {
        for &view in &known.seen_in {
            if let Some(points) = shown.get_mut(view) {
                points.push(&known.position);
            }
        }
    }
    let space = |points: Vec<&Vector3<f64>>| {
        let own = ObjectSpace::around(points.iter().copied(), MARGIN);
        let told = own.filter(|_| points.len() >= FEWEST);
        told.map_or(input.space, |own| own.common(&input.space))
    };
    shown.into_iter().map(space).collect()
}
