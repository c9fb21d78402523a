//! Places that may be dots: components that keep an elliptic shape over several levels.

use std::f64::consts::PI;

use nalgebra::Vector2;

use super::ellipse::Ellipse;
use crate::imaging::{LevelNode, LevelTree};

/// A place that may be a dot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    /// From the moments of the component half-way up.
    pub(super) ellipse: Ellipse,
    /// Grey value of that component's level: separates the dot from its neighbours.
    pub(super) level: f64,
    /// Grey value of the highest level at which it was seen.
    pub(super) peak: f64,
    /// How far its shape alone tells it from texture.
    pub(super) kind: Kind,
    /// Whether the component touches the picture's border.
    pub(super) at_border: bool,
}

/// How far a candidate's shape alone tells it from texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Its outline has pixels enough to show an ellipse.
    Resolved,
    /// A few pixels that stand alone on a dark ground.
    Speck,
    /// A few pixels on something brighter: texture makes such bumps everywhere.
    Bump,
}

/// What a picture's small elliptic components are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ground {
    /// They are few: a dark ground on which even a faint speck is something.
    Plain,
    /// They are more than all other candidates: the grain of a surface.
    Textured,
}

/// The candidates of a picture.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Candidates {
    pub(super) places: Vec<Candidate>,
    pub(super) ground: Ground,
}

/// What a component must look like to be a candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CandidateSettings {
    /// Least number of levels over which the shape is kept.
    pub(super) least_levels: u32,
    /// The same for components that stand alone and are large enough that noise does not make them.
    pub(super) least_levels_alone: u32,
    /// The same for specks on a textured ground.
    pub(super) least_levels_speck: u32,
    /// The same for bumps on a textured ground.
    pub(super) least_levels_bump: u32,
    /// From this number of levels on a bump counts as a speck.
    pub(super) firm_levels_bump: u32,
    /// Least area of the component half-way up, px.
    pub(super) least_area: f64,
    /// Largest area that is looked at, px.
    pub(super) largest_area: f64,
}

/// A component fills at least this share of the ellipse of its moments (a rectangle fills 0.955, a quarter ring 0.75).
const LEAST_FILL: f64 = 0.88;
/// The same for components of few pixels, whose outline is ragged.
const LEAST_FILL_SMALL: f64 = 0.82;
/// Components below this area count as small, px.
const SMALL_AREA: u32 = 40;
/// Components below this area, half-way up, are specks or bumps: no outline is seen, px.
const SPECK_AREA: u32 = 16;
/// From this area on noise makes no component of several levels, px.
const BEYOND_NOISE_AREA: u32 = 20;
/// A component stands alone if what holds it at the first level is at most this many times as large.
const ALONE: u32 = 4;
/// Axes ratio below which no circle is seen.
const LEAST_AXES_RATIO: f64 = 0.15;
/// From one level to the next a dot loses at most this share of its area; a chain that loses more has changed its object.
const LARGEST_LOSS: f64 = 0.65;

/// The candidates of one region, in the order of their components.
pub(super) fn candidates(
    tree: &LevelTree,
    width: usize,
    height: usize,
    settings: &CandidateSettings,
) -> Vec<(Candidate, Strength)> {
    let nodes = &tree.nodes;
    let elliptic: Vec<bool> = nodes.iter().map(is_elliptic).collect();
    let largest_child = largest_children(nodes);
    let ground_area = ground_areas(nodes);
    let mut chain_of = vec![None; nodes.len()];
    let mut chains: Vec<Vec<u32>> = Vec::new();
    for (slot, node) in nodes.iter().enumerate() {
        if f64::from(node.area) > settings.largest_area {
            continue;
        }
        let continued = node.parent.filter(|&parent| {
            let keeps = f64::from(node.area)
                >= (1.0 - LARGEST_LOSS) * f64::from(nodes[parent as usize].area);
            keeps && largest_child[parent as usize] == Some(slot as u32)
        });
        let known = continued.and_then(|parent| chain_of[parent as usize]);
        if elliptic[slot] {
            let chain = known.unwrap_or_else(|| {
                chains.push(Vec::new());
                chains.len() - 1
            });
            chain_of[slot] = Some(chain);
            chains[chain].push(slot as u32);
        } else if node.area >= SPECK_AREA
            && continued.is_some_and(|parent| elliptic[parent as usize])
        {
            // Noise frays the outline of a faint dot on one level or another: the chain goes on above it.
            chain_of[slot] = known;
        }
    }
    chains
        .iter()
        .filter_map(|chain| candidate(nodes, &ground_area, chain, width, height, settings))
        .collect()
}

/// What is left of the candidates of all regions of a picture, when the picture tells texture from targets; `even` where its
/// noise is that of pixels which do not hang together.
pub(super) fn settled(found: Vec<(Candidate, Strength)>, even: bool) -> Candidates {
    let weak = found
        .iter()
        .filter(|(_, strength)| *strength == Strength::Weak)
        .count();
    let ground = if 2 * weak > found.len() && !even {
        Ground::Textured
    } else {
        Ground::Plain
    };
    let places = found
        .into_iter()
        .filter(|(_, strength)| ground == Ground::Plain || *strength == Strength::Clear)
        .map(|(place, _)| match (ground, place.kind) {
            // Without texture a bump is a dot near another.
            (Ground::Plain, Kind::Bump) => Candidate {
                kind: Kind::Speck,
                ..place
            },
            _ => place,
        })
        .collect();
    Candidates { places, ground }
}

/// Whether a candidate would stand on a textured ground too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Strength {
    /// It would.
    Clear,
    /// Only on a plain ground.
    Weak,
}

/// Area of what holds each component at the first level.
fn ground_areas(nodes: &[LevelNode]) -> Vec<u32> {
    let mut areas: Vec<u32> = Vec::with_capacity(nodes.len());
    for node in nodes {
        areas.push(
            node.parent
                .map_or(node.area, |parent| areas[parent as usize]),
        );
    }
    areas
}

fn largest_children(nodes: &[LevelNode]) -> Vec<Option<u32>> {
    let mut largest: Vec<Option<u32>> = vec![None; nodes.len()];
    for (slot, node) in nodes.iter().enumerate() {
        if let Some(parent) = node.parent {
            let known = &mut largest[parent as usize];
            if known.is_none_or(|other| nodes[other as usize].area < node.area) {
                *known = Some(slot as u32);
            }
        }
    }
    largest
}

fn is_elliptic(node: &LevelNode) -> bool {
    let [xx, xy, yy] = node.moments;
    let spread = xx * yy - xy * xy;
    if spread <= 0.0 {
        return false;
    }
    let fill = f64::from(node.area) / (4.0 * PI * spread.sqrt());
    let half_trace = 0.5 * (xx + yy);
    let root = (half_trace * half_trace - spread).max(0.0).sqrt();
    let axes_ratio = ((half_trace - root) / (half_trace + root)).max(0.0).sqrt();
    let least = if node.area < SMALL_AREA {
        LEAST_FILL_SMALL
    } else {
        LEAST_FILL
    };
    fill >= least && axes_ratio >= LEAST_AXES_RATIO
}

fn candidate(
    nodes: &[LevelNode],
    ground_area: &[u32],
    chain: &[u32],
    width: usize,
    height: usize,
    settings: &CandidateSettings,
) -> Option<(Candidate, Strength)> {
    let first = &nodes[*chain.first()? as usize];
    let last = &nodes[*chain.last()? as usize];
    let half = 0.5 * (first.level + last.level);
    let &middle = chain.iter().min_by(|&&a, &&b| {
        let off = |slot: u32| (nodes[slot as usize].level - half).abs();
        off(a).total_cmp(&off(b))
    })?;
    let alone = ground_area[middle as usize] <= ALONE * nodes[middle as usize].area;
    let middle = &nodes[middle as usize];
    let levels = chain.len() as u32;
    let kind = match (middle.area < SPECK_AREA, alone) {
        (false, _) => Kind::Resolved,
        (true, true) => Kind::Speck,
        (true, false) if levels >= settings.firm_levels_bump => Kind::Speck,
        (true, false) => Kind::Bump,
    };
    let least_levels = if alone && middle.area >= BEYOND_NOISE_AREA {
        settings.least_levels_alone
    } else {
        settings.least_levels
    };
    if levels < least_levels || f64::from(middle.area) < settings.least_area {
        return None;
    }
    let clear_levels = match kind {
        Kind::Resolved => least_levels,
        Kind::Speck => settings.least_levels_speck,
        Kind::Bump => settings.least_levels_bump,
    };
    let strength = if levels >= clear_levels {
        Strength::Clear
    } else {
        Strength::Weak
    };
    let at_border = middle.columns[0] == 0
        || middle.rows[0] == 0
        || middle.columns[1] as usize + 1 == width
        || middle.rows[1] as usize + 1 == height;
    let place = Candidate {
        ellipse: Ellipse::from_moments(Vector2::new(middle.x_px, middle.y_px), middle.moments)?,
        level: middle.level,
        peak: last.level,
        kind,
        at_border,
    };
    Some((place, strength))
}
