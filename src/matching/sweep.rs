//! The targets that leave no doubt, found first and without asking all of their dots.

use std::collections::{BTreeMap, BTreeSet};

use super::drafts::Draft;
use super::hypothesis::{Hypothesis, Verdict, overlap};
use super::identify::Pass;
use super::problem::Member;
use crate::monitor::{Interrupted, Task};

/// Views whose dots look for targets at once in the sweep; the same whatever the cores.
const SWEPT_VIEWS: usize = 8;
/// Partner views that a dot of the sweep asks.
const SWEEP_PARTNERS: usize = 5;
/// Rays from which the sweep accepts a target without asking its other dots.
const RAYS_OF_SWEEP: usize = 6;
/// Expected number of accidents as good, log10, below which it does.
const ACCIDENTS_OF_SWEEP: f64 = -9.0;
impl Pass<'_> {
    /// Finds the targets that leave no doubt, a few views at a time, and takes their dots away: what follows has to look at the others
    /// only.
    ///
    /// Cost: a search for each target, not for each dot.
    pub(super) fn sweep(&mut self, task: &Task) -> Result<(), Interrupted> {
        let views = self.sights.len();
        // Views that follow each other in the list often show the same part of the object.
        let stride = (1..=views)
            .rev()
            .find(|step| step * 3 <= 2 * views && gcd(*step, views) == 1)
            .unwrap_or(1);
        let order: Vec<usize> = (0..views).map(|k| k * stride % views).collect();
        for views in order.chunks(SWEPT_VIEWS) {
            let seeds: Vec<Member> = views
                .iter()
                .flat_map(|&view| self.free_dots_of(view))
                .collect();
            let found = self.search(&seeds, SWEEP_PARTNERS, task)?;
            let tried = self.pairs + found.iter().map(|v| v.pairs).sum::<usize>();
            self.pairs = tried;
            self.accept_undoubted(&seeds, &found)?;
        }
        Ok(())
    }

    /// Accepts what many rays agree on and nothing competes with.
    fn accept_undoubted(&mut self, seeds: &[Member], found: &[Verdict]) -> Result<(), Interrupted> {
        let mut claims: BTreeMap<Member, Vec<usize>> = BTreeMap::new();
        for (index, verdict) in found.iter().enumerate() {
            for hypothesis in verdict.best.iter().chain(&verdict.rival) {
                if hypothesis.members.len() >= RAYS_OF_SWEEP / 2 {
                    for member in &hypothesis.members {
                        claims.entry(*member).or_default().push(index);
                    }
                }
            }
        }
        let sizes = self.sizes(found.iter());
        let mut order: Vec<(&Member, &Verdict, &Hypothesis)> = seeds
            .iter()
            .zip(found)
            .filter_map(|(seed, verdict)| Some((seed, verdict, verdict.best.as_ref()?)))
            .filter(|(_, verdict, best)| {
                let diameter = best.disc.map(|disc| disc.diameter_mm);
                sizes.allow(diameter, best.members.len())
                    && best.members.len() >= RAYS_OF_SWEEP
                    && 2 * verdict.rival_rays() < best.members.len()
                    && best.log10_accidents(self.pairs, self.limits) <= ACCIDENTS_OF_SWEEP
            })
            .collect();
        order.sort_by(|a, b| {
            let rays = b.2.members.len().cmp(&a.2.members.len());
            rays.then(a.2.variance_factor.total_cmp(&b.2.variance_factor))
                .then(a.0.cmp(b.0))
        });
        let mut touched = BTreeSet::new();
        for (_, verdict, best) in order {
            self.monitor.check()?;
            let is_free = |m: &Member| self.free[m.view][m.dot];
            // Another reading of a dot of it, by any dot of these views, must be the same target or much weaker.
            let competes = |index: &usize| {
                let verdict = &found[*index];
                let mut readings = verdict.best.iter().chain(&verdict.rival);
                readings.any(|other| {
                    let (shared, conflicts) = overlap(&best.members, &other.members);
                    let same = shared >= 2 && 4 * conflicts < shared;
                    shared > 0 && !same && 2 * other.members.len() >= best.members.len()
                })
            };
            let contested = best
                .members
                .iter()
                .filter_map(|m| claims.get(m))
                .flatten()
                .any(competes);
            if contested || !best.members.iter().all(is_free) {
                continue;
            }
            for member in &best.members {
                self.free[member.view][member.dot] = false;
                touched.insert(member.view);
            }
            self.drafts.push(Draft {
                known: None,
                point: best.point,
                covariance: best.covariance,
                seen_in: Vec::new(),
                normal: best.disc.map(|d| d.normal),
                disc: best.disc,
                log10_accidents: best.log10_accidents(self.pairs, self.limits),
                rival_rays: verdict.rival_rays(),
                members: best.members.clone(),
            });
        }
        for view in touched {
            self.sights[view].index_free(&self.free[view]);
        }
        Ok(())
    }
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}
