//! The identification rule of Hattori, Akimoto, Fraser and Imoto (2002): a baseline beside [`super::identify`].
//!
//! Rays of views that share codes meet where they pass each other within a threshold ([`super::threshold`]). A target is a group of
//! dots, at most one a view, whose rays meet pairwise at one place. A pass identifies what is not ambiguous and keeps the remainder; the
//! orientations are updated, and passes end when nothing more is identified. Nothing else is looked at: no ellipses, no covariances of
//! stations, no probabilities. Wrong names are left to the adjustment's search for gross errors.
//!
//! What the paper's words leave open is settled so:
//! - Points that exist (codes' dots, targets of earlier passes) take their dots first: a dot whose ray passes one of them within the
//!   threshold, where point and dot have no second choice. They are looked for in views that share codes with one that shows them.
//! - A place on a dot's ray is where the rays of enough other views come within the threshold of it. A dot with two places, or with two
//!   dots of one view at its place, is ambiguous; the other dots of a target do not wait for it.
//! - Dots go together that name each other. Of rays that do not all meet pairwise, or not at their common intersection, the worst waits.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector3;
use rayon::prelude::*;

use super::intersection::{Intersection, intersect};
use super::meeting_places::meeting_places;
use super::problem::{
    Claim, Identification, IdentificationInput, IdentificationSettings, Leftover, LeftoverReason,
    Member, Track,
};
use super::threshold::Rays;
use crate::monitor::{Interrupted, Monitor, Task};

/// Dots that a thread reads at a time.
const CHUNK: usize = 32;

/// One pass of identification by the paper's rule: what its threshold leaves unambiguous.
///
/// Of the settings `min_rays` and `min_angle` count; the image tolerance and what is known of single orientations do not. The result does
/// not depend on the number of threads.
///
/// # Errors
/// [`Interrupted`] when the work was asked to stop.
pub fn identify_by_threshold(
    input: &IdentificationInput,
    settings: &IdentificationSettings,
    monitor: &Monitor,
) -> Result<Identification, Interrupted> {
    let dots: usize = input.views.iter().map(|v| v.dots.len()).sum();
    let task = monitor.task("identifying targets", (input.views.len() + dots) as u64);
    let min_rays = settings.min_rays.max(3);
    let mut rays = Rays::new(input, settings);
    let drawn = draw_all(&rays, &task)?;
    let free = free_dots(input, &drawn);
    for (sight, free) in rays.sights.iter_mut().zip(&free) {
        sight.index_free(free);
    }
    let readings = read_all(&rays, &free, min_rays, &task)?;
    let mut tracks: Vec<Track> = groups(&readings)
        .into_iter()
        .filter_map(|group| target(&rays, &readings, group, min_rays))
        .collect();
    tracks.sort_by(|a, b| a.members.cmp(&b.members));
    Ok(Identification {
        pairs: Vec::new(),
        groups: Vec::new(),
        leftover: leftover(&readings, &drawn, &tracks, min_rays),
        claims: drawn.into_iter().flat_map(|drawn| drawn.claims).collect(),
        unexplained_px: vec![0.0; input.views.len()],
        tracks,
    })
}

/// What known points draw to themselves in one view.
struct Drawn {
    /// By dot.
    claims: Vec<Claim>,
    /// Dots near known points of which they or the points have a second choice, by dot.
    contested: Vec<Leftover>,
}

fn draw_all(rays: &Rays, task: &Task) -> Result<Vec<Drawn>, Interrupted> {
    (0..rays.sights.len())
        .into_par_iter()
        .map(|view| {
            task.step()?;
            Ok(drawn(rays, view))
        })
        .collect()
}

fn drawn(rays: &Rays, view: usize) -> Drawn {
    let sight = &rays.sights[view];
    let mut near: Vec<Claim> = Vec::new();
    for (known, point) in rays.input.known.iter().enumerate() {
        let shown = |other: &usize| rays.are_neighbours(view, *other);
        if point.seen_in.contains(&view) || !point.seen_in.iter().any(shown) {
            continue;
        }
        let Some(place) = sight.place(&point.position) else {
            continue;
        };
        let reach = rays.reach_of_place_px(view, &point.position);
        sight.near(&place, reach, |dot| {
            let member = Member { view, dot };
            let share = rays.share_of_threshold(member, &point.position);
            if share.is_some_and(|share| share <= 1.0) {
                near.push(Claim {
                    known,
                    member,
                    distance_px: (sight.dots[dot].place - place).norm(),
                });
            }
        });
    }
    let (mut of_dot, mut of_point) = (BTreeMap::new(), BTreeMap::new());
    for claim in &near {
        *of_dot.entry(claim.member).or_insert(0) += 1;
        *of_point.entry(claim.known).or_insert(0) += 1;
    }
    near.sort_by(|a, b| {
        let nearer = a.distance_px.total_cmp(&b.distance_px);
        a.member.cmp(&b.member).then(nearer)
    });
    let is_only = |claim: &Claim| of_dot[&claim.member] == 1 && of_point[&claim.known] == 1;
    let (claims, mut contested): (Vec<Claim>, Vec<Claim>) = near.into_iter().partition(is_only);
    contested.dedup_by_key(|claim| claim.member);
    let contested = contested.into_iter().map(|claim| Leftover {
        member: claim.member,
        reason: LeftoverReason::Contested {
            distance_px: claim.distance_px,
        },
    });
    Drawn {
        claims,
        contested: contested.collect(),
    }
}

/// Dots that no known point draws: one near a known point belongs to that group, if to any.
fn free_dots(input: &IdentificationInput, drawn: &[Drawn]) -> Vec<Vec<bool>> {
    let of_view = input.views.iter().zip(drawn).map(|(view, drawn)| {
        let mut free = vec![true; view.dots.len()];
        let claimed = drawn.claims.iter().map(|claim| claim.member);
        for member in claimed.chain(drawn.contested.iter().map(|left| left.member)) {
            free[member.dot] = false;
        }
        free
    });
    of_view.collect()
}

/// What meets the ray of a dot.
#[derive(Clone, Debug, PartialEq)]
enum Reading {
    /// No ray of a neighbouring view.
    Nothing,
    /// Rays of too few views at one place.
    TooFew {
        /// The most at one place, its own counted.
        rays: usize,
    },
    /// Rays of enough views, but not one of each at one place.
    Ambiguous {
        /// Rays of the place with most views.
        rays: usize,
        /// Those of the second, or of the same where dots of one view compete for it.
        rival_rays: usize,
    },
    /// One ray of each of enough views at one place.
    Clear {
        /// The place on the ray, mm.
        place: Vector3<f64>,
        /// All dots there, by view, with its own.
        members: Vec<Member>,
    },
}

impl Reading {
    fn members(&self) -> &[Member] {
        match self {
            Self::Clear { members, .. } => members,
            _ => &[],
        }
    }

    fn rays(&self) -> usize {
        match self {
            Self::Nothing => 1,
            Self::TooFew { rays } | Self::Ambiguous { rays, .. } => *rays,
            Self::Clear { members, .. } => members.len(),
        }
    }
}

type Readings = BTreeMap<Member, Reading>;

fn read_all(
    rays: &Rays,
    free: &[Vec<bool>],
    min_rays: usize,
    task: &Task,
) -> Result<Readings, Interrupted> {
    let seeds: Vec<Member> = free
        .iter()
        .enumerate()
        .flat_map(|(view, free)| {
            let dots = (0..free.len()).filter(|&dot| free[dot]);
            dots.map(move |dot| Member { view, dot })
        })
        .collect();
    let chunks: Vec<Vec<(Member, Reading)>> = seeds
        .par_chunks(CHUNK)
        .map(|chunk| {
            let read = chunk.iter().map(|&seed| {
                task.step()?;
                Ok((seed, reading(rays, seed, min_rays)))
            });
            read.collect()
        })
        .collect::<Result<_, Interrupted>>()?;
    Ok(chunks.into_iter().flatten().collect())
}

fn reading(rays: &Rays, seed: Member, min_rays: usize) -> Reading {
    let mut stretches = Vec::new();
    for &view in &rays.neighbours[seed.view] {
        for dot in rays.candidates(seed, view) {
            stretches.extend(rays.stretch(seed, Member { view, dot }));
        }
    }
    if stretches.is_empty() {
        return Reading::Nothing;
    }
    let mut places = meeting_places(&stretches, min_rays - 1);
    places.sort_by(|a, b| b.views.cmp(&a.views).then(a.along.total_cmp(&b.along)));
    let Some(best) = places.first() else {
        let views = meeting_places(&stretches, 1).into_iter().map(|p| p.views);
        return Reading::TooFew {
            rays: 1 + views.max().unwrap_or_default(),
        };
    };
    let competes = best.members.len() > best.views;
    let rival = places
        .get(1)
        .or(Some(best).filter(|_| competes))
        .map(|place| 1 + place.views);
    if let Some(rival_rays) = rival {
        return Reading::Ambiguous {
            rays: 1 + best.views,
            rival_rays,
        };
    }
    let sight = &rays.sights[seed.view];
    let mut members = best.members.clone();
    members.push(seed);
    members.sort_unstable();
    Reading::Clear {
        place: sight.centre + sight.dots[seed.dot].direction * best.along,
        members,
    }
}

/// Clear dots that name each other, directly or through others; by view.
fn groups(readings: &Readings) -> Vec<Vec<Member>> {
    let named_by = |from: Member| readings.get(&from).map_or(&[][..], Reading::members);
    let mut grouped: BTreeSet<Member> = BTreeSet::new();
    let mut groups = Vec::new();
    for (&first, reading) in readings {
        if reading.members().is_empty() || !grouped.insert(first) {
            continue;
        }
        let mut group = vec![first];
        let mut asked = 0;
        while let Some(&from) = group.get(asked) {
            for &other in named_by(from) {
                let names_back = named_by(other).binary_search(&from).is_ok();
                if names_back && grouped.insert(other) {
                    group.push(other);
                }
            }
            asked += 1;
        }
        group.sort_unstable();
        groups.push(group);
    }
    groups
}

/// The target of a group, without the rays that miss the others or the common place; `None` where too few remain or two are of one view.
fn target(
    rays: &Rays,
    readings: &Readings,
    mut group: Vec<Member>,
    min_rays: usize,
) -> Option<Track> {
    let Reading::Clear { place, .. } = readings.get(group.first()?)? else {
        return None;
    };
    if group.windows(2).any(|pair| pair[0].view == pair[1].view) {
        return None;
    }
    while let Some(worst) = most_missed(rays, &group) {
        group.remove(worst);
    }
    while group.len() >= min_rays {
        let fit = intersect(&rays.sights, &group, place)?;
        let shares = group
            .iter()
            .map(|&ray| rays.share_of_threshold(ray, &fit.point))
            .collect::<Option<Vec<f64>>>()?;
        let (worst, share) = shares
            .into_iter()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(&b.1))?;
        if share <= 1.0 {
            return rays
                .input
                .space
                .holds(&fit.point)
                .then(|| track(group, &fit));
        }
        group.remove(worst);
    }
    None
}

/// The ray of a group that misses most of the others; `None` where all meet pairwise.
fn most_missed(rays: &Rays, group: &[Member]) -> Option<usize> {
    let misses = |a: Member| {
        let missed = group.iter().filter(|&&b| {
            a.view != b.view
                && rays.are_neighbours(a.view, b.view)
                && rays.share_of_two(a, b).is_some_and(|share| share > 1.0)
        });
        missed.count()
    };
    let counts = group.iter().map(|&ray| misses(ray)).enumerate();
    let (worst, count) = counts.max_by_key(|(_, count)| *count)?;
    (count > 0).then_some(worst)
}

fn track(members: Vec<Member>, fit: &Intersection) -> Track {
    Track {
        position: fit.point,
        covariance: fit.covariance,
        rms_px: fit.rms_px(),
        chi_square: fit.chi_square,
        redundancy: fit.redundancy(),
        members,
        log10_accidents: None,
        rival_rays: 0,
        circle: None,
    }
}

/// All dots without a name, with the reason, by dot.
fn leftover(
    readings: &Readings,
    drawn: &[Drawn],
    tracks: &[Track],
    min_rays: usize,
) -> Vec<Leftover> {
    let named: BTreeSet<Member> = tracks.iter().flat_map(|t| t.members.clone()).collect();
    let unnamed = readings.iter().filter(|(dot, _)| !named.contains(dot));
    let mut left: Vec<Leftover> = unnamed
        .map(|(&member, reading)| Leftover {
            member,
            reason: reason(readings, reading, min_rays),
        })
        .collect();
    left.extend(drawn.iter().flat_map(|drawn| drawn.contested.clone()));
    left.sort_by_key(|left| left.member);
    left
}

fn reason(readings: &Readings, reading: &Reading, min_rays: usize) -> LeftoverReason {
    match reading {
        Reading::Nothing => LeftoverReason::NoPartner,
        Reading::TooFew { rays } => LeftoverReason::TooFewRays {
            found: *rays,
            needed: min_rays,
        },
        Reading::Ambiguous { rays, rival_rays } => LeftoverReason::Ambiguous {
            rays: *rays,
            rival_rays: *rival_rays,
        },
        // Clear by itself, but the others at its place have another reading, or miss it.
        Reading::Clear { members, .. } => {
            let others = members.iter().filter_map(|member| readings.get(member));
            LeftoverReason::Ambiguous {
                rays: members.len(),
                rival_rays: others.map(Reading::rays).max().unwrap_or_default(),
            }
        }
    }
}
