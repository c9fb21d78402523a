//! Detection in one picture: dots, then codes among them.

use std::cmp::Ordering;

use nalgebra::Vector2;
use rayon::prelude::*;

use super::dot::{DotSettings, MeasuredDot, Room, Standing, View, measure_dot};
use super::ellipse::Ellipse;
use super::faint::faint_candidates;
use super::finding::{Candidate, CandidateSettings, Ground, Strength, candidates, settled};
use super::ring::{RingFrame, RingOutcome, read_ring};
use super::rows::ByRows;
use super::{
    CodeReading, Detections, Dot, Dot420Settings, DotIndex, Family, Rejected, read_dot420,
};
use crate::imaging::{GreyImage, LevelSettings, LevelTree, Tiles, noise_level, noise_of_means};
use crate::monitor::{Interrupted, Monitor};

/// How targets are detected.
#[derive(Clone, Debug, PartialEq)]
pub struct DetectSettings {
    /// What is accepted as a dot.
    pub dots: DotSettings,
    /// What is accepted as a six-dot code.
    pub dot420: Dot420Settings,
    /// Ratio of neighbouring grey levels at which the picture is cut: smaller finds dots of less contrast on a bright
    /// background and takes longer. Default 1.2.
    pub level_ratio: f64,
    /// Least height of a target above black as a share of the brightest grey value's. Default 0.02.
    pub least_height: f64,
}

impl Default for DetectSettings {
    fn default() -> Self {
        Self {
            dots: DotSettings::default(),
            dot420: Dot420Settings::default(),
            level_ratio: 1.2,
            least_height: 0.02,
        }
    }
}

/// Detects the light targets of a picture, and reads the codes of the given families.
#[must_use]
pub fn detect(image: &GreyImage, families: &[Family], settings: &DetectSettings) -> Detections {
    // Nobody interrupts this monitor.
    detect_unless_interrupted(image, families, settings, &Monitor::new()).unwrap_or_default()
}

/// As [`detect`], but obeys an interrupt between its parts and from dot to dot.
///
/// # Errors
/// [`Interrupted`]; nothing of the picture is known then.
pub fn detect_unless_interrupted(
    image: &GreyImage,
    families: &[Family],
    settings: &DetectSettings,
    monitor: &Monitor,
) -> Result<Detections, Interrupted> {
    monitor.check()?;
    let tiles = Tiles::of(image, 0.5 * settings.dots.largest_px);
    let noise = noise_level(image);
    let view = View {
        image,
        noise,
        grain: noise_of_means(image).max(noise),
        clipping: image.depth().clipping(tiles.brightest()).map(f64::from),
    };
    let (dots, mut rejected) = find_dots(&view, &tiles, settings, monitor)?;
    let rings = read_rings(&view, &dots, families, monitor)?;
    let read = read_frames(&dots, &rings);
    let kept = without_rings(&dots, &rings, &read);
    let by_rows = by_rows(&dots);
    rejected.retain(|Rejected { place_px, .. }| {
        let mut near = by_rows.near(place_px.y);
        let inside = near.any(|ellipse| ellipse.level(*place_px) < 1.0);
        !inside && !in_a_ring(*place_px, None, &read)
    });
    let mut codes = Vec::new();
    let mut place_of = vec![None; dots.len()];
    for (place, &slot) in kept.iter().enumerate() {
        place_of[slot] = Some(DotIndex(place as u32));
    }
    for (slot, outcome) in rings.iter().enumerate() {
        let Some(place) = place_of[slot] else {
            let dot = &dots[slot];
            if dot.standing == Standing::Tentative
                && !in_a_ring(dot.dot.centre_px, Some(slot), &read)
            {
                rejected.push(unconfirmed(dot));
            }
            continue;
        };
        match outcome {
            RingOutcome::Plain => {}
            RingOutcome::Unreadable(reason) => {
                rejected.push(Rejected {
                    place_px: dots[slot].dot.centre_px,
                    reason: reason.clone(),
                });
            }
            RingOutcome::Read(ring) => codes.push(CodeReading {
                family: Family::Ring(ring.segments),
                id: ring.id,
                dots: vec![place],
                misfit: ring.misfit,
                doubt: ring.doubt.clone(),
                evidence: ring.evidence,
            }),
        }
    }
    let dots: Vec<Dot> = kept
        .into_iter()
        .map(|slot| dots[slot].dot.clone())
        .collect();
    monitor.check()?;
    if families.contains(&Family::Dot420) {
        let mut reading = read_dot420(&dots, &settings.dot420);
        codes.append(&mut reading.codes);
        rejected.append(&mut reading.rejected);
    }
    codes.sort_by(|a, b| (a.family, a.id, &a.dots).cmp(&(b.family, b.id, &b.dots)));
    mark_repeated(&mut codes);
    Ok(Detections {
        width_px: image.width() as u32,
        height_px: image.height() as u32,
        dots,
        codes,
        rejected,
        by_hand: Vec::new(),
        expected: Vec::new(),
    })
}

fn unconfirmed(dot: &MeasuredDot) -> Rejected {
    Rejected {
        place_px: dot.dot.centre_px,
        reason: format!(
            "small and close to other light ({:.1} x {:.1} px): only a code round it would tell it from texture",
            dot.dot.major_px, dot.dot.minor_px
        ),
    }
}

/// Accepted dots by rows and columns, and what was refused.
fn find_dots(
    view: &View,
    tiles: &Tiles,
    settings: &DetectSettings,
    monitor: &Monitor,
) -> Result<(Vec<MeasuredDot>, Vec<Rejected>), Interrupted> {
    let found = settled(propose(view, tiles, settings, monitor)?, view.is_even());
    let mut dots = Vec::new();
    let mut rejected = Vec::new();
    measure(
        view,
        found.places,
        settings,
        monitor,
        &mut dots,
        &mut rejected,
    )?;
    if found.ground == Ground::Plain {
        let shape = candidate_settings(settings);
        let first = level_settings(view, tiles, settings).first;
        let heights = [least_height(tiles, settings), first];
        let mut faint = faint_candidates(view, tiles, heights, &shape, monitor)?;
        let by_rows = by_rows(&dots);
        faint.retain(|place| {
            let [centre, half] = [place.ellipse.centre, place.ellipse.half_extent()];
            let mut near = by_rows.between(centre.y - half.y, centre.y + half.y);
            !near.any(|dot| dot.level(centre) < 1.0 || place.ellipse.level(dot.centre) < 1.0)
        });
        measure(view, faint, settings, monitor, &mut dots, &mut rejected)?;
    }
    dots.sort_by(|a, b| row_by_row(a.dot.centre_px, b.dot.centre_px));
    let mut dots = each_once(dots);
    if found.ground == Ground::Textured {
        rejected.append(&mut drop_grain(&mut dots));
    }
    widen_sigmas(&mut dots);
    Ok((dots, rejected))
}

/// Measures candidates; what is refused goes to the rejected ones.
fn measure(
    view: &View,
    places: Vec<Candidate>,
    settings: &DetectSettings,
    monitor: &Monitor,
    dots: &mut Vec<MeasuredDot>,
    rejected: &mut Vec<Rejected>,
) -> Result<(), Interrupted> {
    let measured: Vec<_> = places
        .into_par_iter()
        .map_init(Room::default, |room, place| {
            monitor.check()?;
            Ok((place, measure_dot(view, &place, &settings.dots, room)))
        })
        .collect::<Result<_, Interrupted>>()?;
    for (place, outcome) in measured {
        match outcome {
            Ok(dot) => dots.push(dot),
            Err(reason) => rejected.push(Rejected {
                place_px: place.ellipse.centre,
                reason,
            }),
        }
    }
    Ok(())
}

fn by_rows(dots: &[MeasuredDot]) -> ByRows<&Ellipse> {
    ByRows::new(dots.iter().map(|dot| {
        let reach = dot.ellipse.half_extent().y;
        (dot.ellipse.centre.y, reach, &dot.ellipse)
    }))
}

/// Candidates, region by region.
fn propose(
    view: &View,
    tiles: &Tiles,
    settings: &DetectSettings,
    monitor: &Monitor,
) -> Result<Vec<(Candidate, Strength)>, Interrupted> {
    /// What stays this much below the first level may be left out, as a share of its height: means of tiles are noisy.
    const LEFT_OUT: f64 = 0.8;
    monitor.check()?;
    let levels = level_settings(view, tiles, settings);
    let shape = candidate_settings(settings);
    let (width, height) = (view.image.width(), view.image.height());
    let regions = tiles.regions(LEFT_OUT * levels.first);
    let found: Vec<_> = regions
        .par_iter()
        .map(|region| {
            let tree = LevelTree::new(view.image, region, &levels, monitor)?;
            Ok(candidates(&tree, width, height, &shape))
        })
        .collect::<Result<_, Interrupted>>()?;
    Ok(found.into_iter().flatten().collect())
}

/// Enlarges the sigmas where residuals hang together: in the whole picture because its noise does, as the median of its
/// dots tells, or on a single dot far beyond chance.
fn widen_sigmas(dots: &mut [MeasuredDot]) {
    /// Of fewer dots the median says nothing.
    const LEAST_DOTS: usize = 16;
    /// Some ten independent sums: chance exceeds this once in a thousand dots.
    const CHANCE: f64 = 3.0;
    let mut all: Vec<f64> = dots.iter().map(|measured| measured.dependence).collect();
    all.sort_by(f64::total_cmp);
    let common = if all.len() < LEAST_DOTS {
        1.0
    } else {
        all[all.len() / 2].max(1.0)
    };
    for MeasuredDot {
        dot, dependence, ..
    } in dots
    {
        let own = if *dependence > CHANCE * common {
            *dependence
        } else {
            common
        };
        dot.sigma_px *= own.sqrt();
    }
}

/// On a textured ground small dots much fainter than the picture's targets are its grain.
fn drop_grain(dots: &mut Vec<MeasuredDot>) -> Vec<Rejected> {
    /// Product of the diameters below which a dot may be grain, px^2.
    const GRAIN: f64 = 20.0;
    /// Grain has less than this share of the contrast of the targets.
    const FAINT: f64 = 0.25;
    /// The same for dots that a code must confirm.
    const FAINT_TENTATIVE: f64 = 0.5;
    let mut contrasts: Vec<f64> = dots.iter().map(|measured| measured.dot.contrast).collect();
    contrasts.sort_by(f64::total_cmp);
    // The brighter dots are targets even where grain is much.
    let Some(&bright) = contrasts.get(contrasts.len() * 9 / 10) else {
        return Vec::new();
    };
    let mut rejected = Vec::new();
    dots.retain(|MeasuredDot { dot, standing, .. }| {
        let least = match standing {
            Standing::Tentative => FAINT_TENTATIVE,
            Standing::Firm if dot.major_px * dot.minor_px < GRAIN => FAINT,
            Standing::Firm => 0.0,
        };
        let kept = dot.contrast >= least * bright;
        if !kept {
            rejected.push(Rejected {
                place_px: dot.centre_px,
                reason: format!(
                    "as small and faint as the grain of the surface: {:.0} grey values where targets have {bright:.0}",
                    dot.contrast
                ),
            });
        }
        kept
    });
    rejected
}

fn row_by_row(a: Vector2<f64>, b: Vector2<f64>) -> Ordering {
    a.y.total_cmp(&b.y).then(a.x.total_cmp(&b.x))
}

/// Of dots that lie in one another only the one that fits best stays: one target may keep its shape over two
/// separate stretches of levels. The dots are sorted by rows.
fn each_once(dots: Vec<MeasuredDot>) -> Vec<MeasuredDot> {
    let mut dropped = vec![false; dots.len()];
    for (first, dot) in dots.iter().enumerate() {
        for (second, other) in dots.iter().enumerate().skip(first + 1) {
            let reach = dot.dot.major_px.max(other.dot.major_px);
            if other.dot.centre_px.y - dot.dot.centre_px.y > reach {
                break;
            }
            let nested = dot.ellipse.level(other.dot.centre_px) < 1.0
                || other.ellipse.level(dot.dot.centre_px) < 1.0;
            if nested && !dropped[first] && !dropped[second] {
                let worse = if other.misfit < dot.misfit {
                    first
                } else {
                    second
                };
                dropped[worse] = true;
            }
        }
    }
    dots.into_iter()
        .zip(dropped)
        .filter(|(_, dropped)| !dropped)
        .map(|(dot, _)| dot)
        .collect()
}

fn read_rings(
    view: &View,
    dots: &[MeasuredDot],
    families: &[Family],
    monitor: &Monitor,
) -> Result<Vec<RingOutcome>, Interrupted> {
    let mut segments: Vec<u8> = families
        .iter()
        .filter_map(|family| match family {
            Family::Ring(segments) => Some(*segments),
            Family::Dot420 => None,
        })
        .collect();
    segments.sort_unstable();
    segments.dedup();
    dots.par_iter()
        .map(|dot| {
            monitor.check()?;
            Ok(read_ring(view, dot, &segments))
        })
        .collect()
}

/// The codes that were read, each with the slot of its dot.
fn read_frames<'a>(
    dots: &[MeasuredDot],
    rings: &'a [RingOutcome],
) -> ByRows<(usize, &'a RingFrame)> {
    let read = rings.iter().zip(dots).enumerate();
    ByRows::new(read.filter_map(|(slot, (outcome, dot))| match outcome {
        RingOutcome::Read(ring) => {
            // The frame of a ring is refined, by less than a quarter of its size.
            let reach = 1.25 * RING.end * dot.ellipse.half_extent().y;
            Some((dot.dot.centre_px.y, reach, (slot, &ring.frame)))
        }
        _ => None,
    }))
}

/// The dots without those that are segments of a ring that was read, and without those that no code confirmed.
fn without_rings(
    dots: &[MeasuredDot],
    rings: &[RingOutcome],
    read: &ByRows<(usize, &RingFrame)>,
) -> Vec<usize> {
    (0..dots.len())
        .filter(|&slot| {
            let confirmed = match &rings[slot] {
                RingOutcome::Read(ring) => ring.doubt.is_none(),
                _ => false,
            };
            let stands = dots[slot].standing == Standing::Firm || confirmed;
            stands && !in_a_ring(dots[slot].dot.centre_px, Some(slot), read)
        })
        .collect()
}

/// Segments have their centres between the ring's edges, in radii of the dot.
const RING: std::ops::Range<f64> = 1.5..3.2;

/// Whether a place, that of the dot `own` or of none, lies in the ring of another dot.
fn in_a_ring(place: Vector2<f64>, own: Option<usize>, read: &ByRows<(usize, &RingFrame)>) -> bool {
    read.near(place.y)
        .any(|(slot, frame)| own != Some(*slot) && RING.contains(&frame.radius_at(place)))
}

/// A code exists once: where it is read twice in a picture, either may be wrong.
fn mark_repeated(codes: &mut [CodeReading]) {
    for slot in 1..codes.len() {
        let same =
            (codes[slot].family, codes[slot].id) == (codes[slot - 1].family, codes[slot - 1].id);
        if same {
            for code in &mut codes[slot - 1..=slot] {
                code.doubt
                    .get_or_insert_with(|| "read twice in this picture".into());
            }
        }
    }
}

/// Least height of a target, grey values.
fn least_height(tiles: &Tiles, settings: &DetectSettings) -> f64 {
    let contrast = f64::from(tiles.brightest()) - tiles.dark_level();
    settings.least_height * contrast
}

fn level_settings(view: &View, tiles: &Tiles, settings: &DetectSettings) -> LevelSettings {
    LevelSettings {
        first: (5.0 * view.noise)
            .max(least_height(tiles, settings))
            .max(1.0),
        ratio: settings.level_ratio,
        least_area: 4,
        // On a flash hot spot or a bright surface there are targets too.
        largest_area: u32::MAX,
    }
}

fn candidate_settings(settings: &DetectSettings) -> CandidateSettings {
    let area = |diameter: f64| std::f64::consts::FRAC_PI_4 * diameter * diameter;
    CandidateSettings {
        least_levels: 3,
        least_levels_alone: 2,
        least_levels_speck: 5,
        least_levels_bump: 7,
        firm_levels_bump: 9,
        least_area: (settings.dots.least_axes_ratio * area(settings.dots.even.smallest_px))
            .max(5.0),
        // What is larger is shown to be refused, within reason.
        largest_area: 4.0 * area(settings.dots.largest_px),
    }
}

#[cfg(test)]
#[path = "detect_tests.rs"]
mod tests;
