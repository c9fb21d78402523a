//! Proposals of a target through one dot: a partner on the epipolar line, then every other view asked.

use nalgebra::{Matrix3, Vector3};

use super::intersection::{Intersection, intersect, meet, prediction_misfit};
use super::limits::Limits;
use super::problem::{IdentificationSettings, Member, Pair};
use super::shape::{Disc, ShapeNoise, largest};
use super::sight::{Sight, Sighting};
use super::surface::Surface;

/// Widest search for a further dot, px: a pair that predicts worse says nothing about a view yet.
const WIDEST_SEARCH_PX: f64 = 40.0;
/// A pair that none of so many views confirms, surest first, is given up.
const VIEWS_TO_CONFIRM: usize = 12;
/// Rays from which a proposal explains its dots so well that no further pairs among them are tried.
const EXPLAINED_RAYS: usize = 5;

/// Rays from which only a few more partner views are asked: a rival to so strong a target shows up soon or never.
const STRONG_RAYS: usize = 8;
/// Those few.
const PARTNERS_OF_STRONG: usize = 4;

/// Partner views asked at most whose picture the ray of a dot crosses, best angle first. A dot that belongs to no target asks all of them in
/// vain, so that without a limit the cost went with the square of the views.
const MOST_CROSSED: usize = 64;

/// A place in a view that was searched for a further dot.
struct Search {
    view: usize,
    seen: Sighting,
    /// Area of the search, px^2.
    area: f64,
}

/// What all proposals share.
pub(super) struct Bench<'a> {
    pub(super) sights: &'a [Sight],
    /// Partner views of each view, best angle first.
    pub(super) partners: &'a [Vec<usize>],
    pub(super) settings: &'a IdentificationSettings,
    pub(super) limits: &'a Limits,
    /// How exact ellipses are.
    pub(super) noise: ShapeNoise,
}

/// A point that several dots propose.
#[derive(Clone, Debug)]
pub(super) struct Hypothesis {
    /// By view; holds the dot it was proposed from.
    pub(super) members: Vec<Member>,
    pub(super) point: Vector3<f64>,
    pub(super) covariance: Matrix3<f64>,
    /// Chi-square over redundancy.
    pub(super) variance_factor: f64,
    pub(super) disc: Option<Disc>,
    /// Expected number of accidental dots in all the searches beyond the pair.
    pub(super) accidental_hits: f64,
}

/// What the search from one dot found.
#[derive(Clone, Debug, Default)]
pub(super) struct Verdict {
    pub(super) best: Option<Hypothesis>,
    /// The best one that is another point, or as good a choice of other dots.
    pub(super) rival: Option<Hypothesis>,
    /// Pairs tried.
    pub(super) pairs: usize,
}

impl Verdict {
    pub(super) fn rays(&self) -> usize {
        self.best.as_ref().map_or(0, |h| h.members.len())
    }

    /// Whether another target through the dot gathers all but as many rays: then the dot waits until either is settled.
    pub(super) fn is_near_tie(&self) -> bool {
        self.rival_rays() >= 3 && self.rival_rays() + 1 >= self.rays()
    }

    pub(super) fn rival_rays(&self) -> usize {
        self.rival.as_ref().map_or(0, |h| h.members.len())
    }
}

impl Hypothesis {
    /// Expected number of accidental intersections as good as this one among `pairs` proposals, log10.
    pub(super) fn log10_accidents(&self, pairs: usize, limits: &Limits) -> f64 {
        let rays = self.members.len();
        let redundancy = (2 * rays).saturating_sub(3).max(1);
        let share = self.variance_factor * redundancy as f64 / limits.whole(redundancy);
        log10_accidents(pairs, rays, self.accidental_hits, share)
    }
}

/// Expected number of accidental intersections of `rays` rays among `pairs` proposals, log10.
///
/// A-contrario reasoning (Desolneux, Moisan and Morel, 2000): dots scattered at the local density fall into the search
/// areas by Poisson's law. Of those that do, the misfit is spread evenly over the volume that the tests allow, so the
/// share of accidents with a chi-square below `fit_share` of the limit is its power `redundancy / 2`.
pub(super) fn log10_accidents(
    pairs: usize,
    rays: usize,
    accidental_hits: f64,
    fit_share: f64,
) -> f64 {
    /// A fit better than this share of the limit is luck in a true target as well.
    const BEST_SHARE: f64 = 0.1;
    /// Rays beyond which a good fit counts no more: then it says more about the ray sigma than about the target.
    const MOST_RAYS: usize = 5;
    let half_redundancy = (2 * rays.clamp(2, MOST_RAYS) - 3) as f64 / 2.0;
    let hits = rays.saturating_sub(2);
    let chance = ln_chance(hits, accidental_hits.max(1e-12)) / std::f64::consts::LN_10;
    (pairs.max(1) as f64).log10()
        + chance
        + half_redundancy * fit_share.clamp(BEST_SHARE, 1.0).log10()
}

/// Natural logarithm of the chance of at least so many hits where `rate` are to be expected, by Poisson's law.
fn ln_chance(hits: usize, rate: f64) -> f64 {
    // So many fewer than are to be expected have a chance below 1e-8 (Chernoff, 1952).
    if rate > 2.0 * hits as f64 + 40.0 {
        return 0.0;
    }
    let mut log_term = -rate;
    for i in 1..=hits {
        log_term += (rate / i as f64).ln();
    }
    let (mut sum, mut ratio) = (1.0, 1.0);
    let mut i = hits as f64;
    loop {
        i += 1.0;
        ratio *= rate / i;
        let before = sum;
        sum += ratio;
        // The terms rise as far as the rate; from there on what is lost in rounding stays lost.
        if i > rate && sum == before {
            break;
        }
    }
    (log_term + f64::ln(sum)).min(0.0)
}

/// Whether two proposals are the same target: most of what they share agrees.
fn same_target(a: &Hypothesis, b: &Hypothesis) -> bool {
    let (shared, conflicts) = overlap(&a.members, &b.members);
    shared >= 2 && shared > conflicts && (conflicts == 0 || b.members.len() < a.members.len())
}

/// Dots in common, and views in which two lists name different dots.
pub(super) fn overlap(a: &[Member], b: &[Member]) -> (usize, usize) {
    let (mut shared, mut conflicts) = (0, 0);
    let (mut i, mut j) = (0, 0);
    while i < a.len() && j < b.len() {
        match a[i].view.cmp(&b[j].view) {
            std::cmp::Ordering::Less => i += 1,
            std::cmp::Ordering::Greater => j += 1,
            std::cmp::Ordering::Equal => {
                if a[i].dot == b[j].dot {
                    shared += 1;
                } else {
                    conflicts += 1;
                }
                i += 1;
                j += 1;
            }
        }
    }
    (shared, conflicts)
}

/// More rays first, then the better fit.
fn better(a: &Hypothesis, b: &Hypothesis) -> bool {
    (a.members.len(), -a.variance_factor) > (b.members.len(), -b.variance_factor)
}

impl Bench<'_> {
    /// The best intersection through `seed` and its rival, from pairs with the first `most_partners` partner views.
    pub(super) fn search(&self, seed: Member, most_partners: usize) -> Verdict {
        let mut pairs = 0;
        let mut found: Vec<Hypothesis> = Vec::new();
        let partners = &self.partners[seed.view];
        let mut crossed = 0;
        for (asked, &view) in partners.iter().take(most_partners).enumerate() {
            let strong = found
                .first()
                .is_some_and(|h| h.members.len() >= STRONG_RAYS);
            if strong && asked >= PARTNERS_OF_STRONG || crossed == MOST_CROSSED {
                break;
            }
            let Some(candidates) = self.epipolar_candidates(seed, view) else {
                continue;
            };
            crossed += 1;
            for dot in candidates {
                let partner = Member { view, dot };
                let explained = found.iter().any(|h| {
                    h.members.len() >= EXPLAINED_RAYS && h.members.binary_search(&partner).is_ok()
                });
                if explained {
                    continue;
                }
                let Some(point) = self.pair_point(seed, partner) else {
                    continue;
                };
                pairs += 1;
                if let Some(hypothesis) = self.grow(seed, partner, &point) {
                    keep_best(&mut found, hypothesis);
                }
            }
        }
        let mut found = found.into_iter();
        Verdict {
            best: found.next(),
            rival: found.next(),
            pairs,
        }
    }

    /// Pairs with dots of the first `most_partners` partner views that meet on the surface of the accepted targets.
    pub(super) fn pairs_on_surface(
        &self,
        seed: Member,
        surface: &Surface,
        most_partners: usize,
    ) -> Vec<Pair> {
        let mut pairs = Vec::new();
        for &view in self.partners[seed.view].iter().take(most_partners) {
            for dot in self.epipolar_candidates(seed, view).into_iter().flatten() {
                let members = [seed, Member { view, dot }];
                let met = self.pair_point(members[0], members[1]);
                let met = met.and_then(|point| intersect(self.sights, &members, &point));
                let Some(fit) = met.filter(|fit| fit.chi_square <= self.limits.whole(1)) else {
                    continue;
                };
                let share = surface.share(&fit.point, &fit.covariance);
                if share < 1.0 {
                    pairs.push(Pair {
                        members,
                        position: fit.point,
                        covariance: fit.covariance,
                    });
                }
            }
        }
        pairs
    }

    /// Free dots of `view` near the epipolar line of `seed`, within the object's depth; `None` where that lies outside the picture.
    ///
    /// The width of the band is the threshold `Th = sqrt(2) max(sigma_S, 3 sigma_xy D / c)` of two rays, in pixels, with
    /// the ray sigma of both views in the place of sigma_S and its critical value in the place of 3.
    fn epipolar_candidates(&self, seed: Member, view: usize) -> Option<Vec<usize>> {
        let (a, b) = (&self.sights[seed.view], &self.sights[view]);
        let line = b.image_of_ray(a, seed.dot)?;
        let middle = (line.ends[0] + line.ends[1]) / 2.0;
        let scale = b.pixels_per_mm(&middle) / a.pixels_per_mm(&middle);
        // Both stations and both measurements, in pixels of the other view.
        let seed_sigma = a.dots[seed.dot].sigma_px;
        let spread = |sight: &Sight, dot_px2: f64| {
            let seen = sight.sighting(&middle);
            seen.map_or(0.0, |seen| largest(&sight.uncertainty(&seen))) + dot_px2
        };
        let variance = spread(a, seed_sigma * seed_sigma) * scale * scale + spread(b, b.dot_px2[1]);
        let band = (self.settings.critical_ray * variance).sqrt();
        b.along(&line.places[0], &line.places[1], band)
    }

    /// Where a pair of dots meets, if depth, angle and shapes allow it.
    fn pair_point(&self, a: Member, b: Member) -> Option<Vector3<f64>> {
        let (sight_a, sight_b) = (&self.sights[a.view], &self.sights[b.view]);
        let (dot_a, dot_b) = (&sight_a.dots[a.dot], &sight_b.dots[b.dot]);
        let point = meet(
            (&sight_a.centre, &dot_a.direction),
            (&sight_b.centre, &dot_b.direction),
            self.settings.min_angle,
        )?;
        if !sight_a.space.holds(&point) || !sight_b.space.holds(&point) {
            return None;
        }
        let pair = [a, b];
        let Some(disc) = Disc::fitted(self.sights, &pair, &point, &self.noise) else {
            return Some(point);
        };
        let fits = pair.iter().all(|m| {
            let sight = &self.sights[m.view];
            sight.sighting(&point).is_some_and(|seen| {
                disc.misfit(sight, m.dot, &seen, &self.noise) <= self.settings.critical_shape
            })
        });
        fits.then_some(point)
    }

    /// Asks every partner view of the seed for a further ray; surest views first, the point improving on the way.
    fn grow(&self, seed: Member, partner: Member, start: &Vector3<f64>) -> Option<Hypothesis> {
        let mut members = vec![seed, partner];
        let pair = intersect(self.sights, &members, start)?;
        let views = &self.partners[seed.view];
        let mut order: Vec<(f64, usize)> = Vec::with_capacity(views.len());
        for &view in views {
            if view == partner.view || self.sights[view].place(&pair.point).is_none() {
                continue;
            }
            let seen = self.sights[view].sighting(&pair.point)?;
            order.push((
                largest(&(seen.by_point * pair.covariance * seen.by_point.transpose())),
                view,
            ));
        }
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let (mut point, mut covariance) = (pair.point, pair.covariance);
        let mut searches = Vec::new();
        for (_, view) in order {
            if searches.len() == VIEWS_TO_CONFIRM && members.len() == 2 {
                break;
            }
            let sight = &self.sights[view];
            let seen = sight.sighting(&point)?;
            let spread =
                seen.by_point * covariance * seen.by_point.transpose() + sight.spread(&seen);
            let radius = sight.search_radius(&seen, &covariance, self.settings.critical_ray);
            if radius > WIDEST_SEARCH_PX {
                continue;
            }
            let area = std::f64::consts::PI
                * self.settings.critical_ray
                * spread.determinant().max(0.0).sqrt();
            searches.push(Search { view, seen, area });
            let Some(hit) = self.nearest(view, &point, &covariance, radius) else {
                continue;
            };
            // One step of sequential least squares (Kalman, 1960).
            let gain = covariance * seen.by_point.transpose() * spread.try_inverse()?;
            point += gain * (sight.dots[hit].place - seen.place);
            covariance -= gain * seen.by_point * covariance;
            covariance = (covariance + covariance.transpose()) / 2.0;
            members.push(Member { view, dot: hit });
        }
        members.sort_unstable();
        if members.len() == 2 {
            return Some(Hypothesis {
                variance_factor: pair.chi_square,
                members,
                point: pair.point,
                covariance: pair.covariance,
                disc: None,
                accidental_hits: 0.0,
            });
        }
        let mut hypothesis = self.settle(seed, members, &point)?;
        hypothesis.accidental_hits = self.accidental_hits(&searches, hypothesis.disc.as_ref());
        Some(hypothesis)
    }

    /// How many dots of the target's shape the searches must be expected to find by chance.
    fn accidental_hits(&self, searches: &[Search], disc: Option<&Disc>) -> f64 {
        let hits = searches
            .iter()
            .map(|search| search.area * self.density_alike(search.view, &search.seen, disc));
        hits.sum()
    }

    /// Free dots per square pixel round a target's place that have its shape.
    pub(super) fn density_alike(&self, view: usize, seen: &Sighting, disc: Option<&Disc>) -> f64 {
        let image = disc.map(|disc| disc.image(&seen.by_point));
        self.sights[view].density(&seen.place, |dot| {
            let (Some(image), Some(axes)) = (&image, &dot.axes) else {
                return true;
            };
            self.noise.misfit(axes, image) <= self.settings.critical_shape
        })
    }

    /// The free dot nearest (by its standardised distance) to where the point is predicted.
    fn nearest(
        &self,
        view: usize,
        point: &Vector3<f64>,
        covariance: &Matrix3<f64>,
        radius: f64,
    ) -> Option<usize> {
        let sight = &self.sights[view];
        let mut best: Option<(f64, usize)> = None;
        sight.near(&sight.sighting(point)?.place, radius, |dot| {
            let Some(misfit) = prediction_misfit(sight, dot, point, covariance) else {
                return;
            };
            let nearer = best.is_none_or(|b| (misfit, dot) < b);
            if misfit <= self.settings.critical_ray && nearer {
                best = Some((misfit, dot));
            }
        });
        best.map(|b| b.1)
    }

    /// Intersects, drops what does not fit, asks all views once more from the settled point and fits again.
    fn settle(
        &self,
        seed: Member,
        mut members: Vec<Member>,
        start: &Vector3<f64>,
    ) -> Option<Hypothesis> {
        let fit = self.fitting(&mut members, start)?;
        if members.len() >= 3 {
            let asked = self.asked_again(seed, &fit);
            if asked.len() >= 3 {
                members = asked;
            }
        }
        let mut fit = self.fitting(&mut members, &fit.point)?;
        let disc = self.shaped(&mut members, &mut fit)?;
        if members.binary_search(&seed).is_err() {
            return None;
        }
        Some(Hypothesis {
            variance_factor: fit.chi_square / fit.redundancy().max(1) as f64,
            members,
            point: fit.point,
            covariance: fit.covariance,
            disc,
            accidental_hits: 0.0,
        })
    }

    /// The one dot in each view that lies where the settled point is predicted; none where two compete.
    fn asked_again(&self, seed: Member, fit: &Intersection) -> Vec<Member> {
        let mut members = Vec::new();
        let own = std::iter::once(&seed.view);
        for &view in self.partners[seed.view].iter().chain(own) {
            let sight = &self.sights[view];
            let Some(place) = sight.place(&fit.point) else {
                continue;
            };
            let Some(seen) = sight.sighting(&fit.point) else {
                continue;
            };
            let critical = self.settings.critical_ray + self.settings.critical_margin;
            let mut hits: Vec<(f64, usize)> = Vec::new();
            let radius = sight.search_radius(&seen, &fit.covariance, critical);
            sight.near(&place, radius, |dot| {
                if let Some(misfit) = prediction_misfit(sight, dot, &fit.point, &fit.covariance) {
                    hits.push((misfit, dot));
                }
            });
            hits.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let Some(&(misfit, dot)) = hits.first() else {
                continue;
            };
            let alone = hits
                .get(1)
                .is_none_or(|h| h.0 > misfit + self.settings.critical_margin);
            if misfit <= self.settings.critical_ray && alone {
                members.push(Member { view, dot });
            }
        }
        members.sort_unstable();
        members
    }

    /// Intersects and drops the worst ray until every ray and the whole pass their tests.
    pub(super) fn fitting(
        &self,
        members: &mut Vec<Member>,
        start: &Vector3<f64>,
    ) -> Option<Intersection> {
        loop {
            let fit = intersect(self.sights, members, start)?;
            if members.len() == 2 {
                return Some(fit);
            }
            let limit = self.limits.whole(fit.redundancy());
            let (worst, misfit) = fit.worst()?;
            if misfit <= self.settings.critical_ray && fit.chi_square <= limit {
                return Some(fit);
            }
            members.remove(worst);
        }
    }

    /// Fits the disc, drops dots whose ellipse or side contradicts it; `None` where fewer than two rays stay.
    fn shaped(&self, members: &mut Vec<Member>, fit: &mut Intersection) -> Option<Option<Disc>> {
        loop {
            let Some(disc) = Disc::fitted(self.sights, members, &fit.point, &self.noise) else {
                return Some(None);
            };
            if members.len() < 3 {
                return Some(Some(disc));
            }
            let misfits = members
                .iter()
                .map(|m| self.shape_misfit(&disc, &fit.point, *m));
            let worst = misfits.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
            if worst.1 <= self.settings.critical_shape {
                return Some(Some(disc));
            }
            members.remove(worst.0);
            *fit = self.fitting(members, &fit.point)?;
        }
    }

    /// Misfit of a dot's ellipse; infinite where the disc cannot be seen from there.
    fn shape_misfit(&self, disc: &Disc, point: &Vector3<f64>, member: Member) -> f64 {
        let sight = &self.sights[member.view];
        let seen = sight.sighting(point);
        let facing = disc.faces(point, &sight.centre, self.settings.max_incidence);
        seen.filter(|_| facing).map_or(f64::INFINITY, |seen| {
            disc.misfit(sight, member.dot, &seen, &self.noise)
        })
    }
}

/// Keeps the best proposal and the best rival to it.
fn keep_best(found: &mut Vec<Hypothesis>, hypothesis: Hypothesis) {
    if hypothesis.members.len() < 3 && !found.is_empty() {
        return;
    }
    let place = found
        .iter()
        .position(|h| better(&hypothesis, h))
        .unwrap_or(found.len());
    found.insert(place, hypothesis);
    let best = found.remove(0);
    found.retain(|h| !same_target(&best, h));
    found.truncate(2);
    found.insert(0, best);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accidents_follow_poisson() {
        // At least one hit at rate 0.01 has probability 1 - exp(-0.01); ten pairs make ten chances.
        let expected = (10.0 * (1.0 - f64::exp(-0.01))).log10();
        assert!((log10_accidents(10, 3, 0.01, 1.0) - expected).abs() < 1e-9);
        assert!(
            log10_accidents(10, 4, 0.01, 1.0) < expected - 2.0,
            "a further ray is another coincidence"
        );
        assert!(
            log10_accidents(10, 3, 0.01, 0.2) < expected,
            "accidents rarely fit well"
        );
        assert!(
            log10_accidents(1, 2, 0.01, 1.0).abs() < 1e-9,
            "two rays are nothing but a pair"
        );
    }

    #[test]
    fn as_many_hits_as_are_to_be_expected_are_no_coincidence() {
        for (rays, rate) in [(3, 200.0), (102, 180.0), (30, 1e9)] {
            let accidents = log10_accidents(1, rays, rate, 1.0);
            assert!(accidents.abs() < 1e-6, "{rays} {rate}: {accidents}");
        }
    }

    #[test]
    fn overlap_counts_shared_dots_and_views_in_conflict() {
        let list = |dots: &[[usize; 2]]| -> Vec<Member> {
            dots.iter()
                .map(|&[view, dot]| Member { view, dot })
                .collect()
        };
        let a = list(&[[0, 1], [2, 5], [3, 0]]);
        let b = list(&[[0, 1], [1, 4], [2, 6]]);
        assert_eq!(overlap(&a, &b), (1, 1));
    }
}
