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
    /// Grey values over which the component keeps its shape.
    pub(super) contrast: f64,
    /// Whether it is one of the small bumps that bright texture is full of.
    pub(super) is_bump: bool,
    /// Whether the component touches the picture's border.
    pub(super) at_border: bool,
}

/// What a component must look like to be a candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CandidateSettings {
    /// Least number of levels over which the shape is kept.
    pub(super) least_levels: u32,
    /// The same for components of few pixels that stand alone above the noise.
    pub(super) least_levels_small: u32,
    /// The same for components of few pixels that stand on something bright: texture makes small bumps everywhere.
    pub(super) least_levels_bump: u32,
    /// From this number of levels on a bump counts as a dot by itself.
    pub(super) firm_levels_bump: u32,
    /// Least area of the component half-way up, px.
    pub(super) least_area: f64,
    /// Largest area, px.
    pub(super) largest_area: f64,
}

/// A component fills at least this share of the ellipse of its moments (a rectangle fills 0.955, a quarter ring 0.75).
const LEAST_FILL: f64 = 0.88;
/// The same for components of few pixels, whose outline is ragged.
const LEAST_FILL_SMALL: f64 = 0.82;
/// Components below this area count as small, px.
const SMALL_AREA: u32 = 40;
/// Axes ratio below which no circle is seen.
const LEAST_AXES_RATIO: f64 = 0.15;
/// From one level to the next a dot loses at most this share of its area; a chain that loses more has changed its object.
const LARGEST_LOSS: f64 = 0.65;

/// All candidates, in the order of their components.
pub(super) fn candidates(
    tree: &LevelTree,
    width: usize,
    height: usize,
    settings: &CandidateSettings,
) -> Vec<Candidate> {
    let nodes = &tree.nodes;
    let elliptic: Vec<bool> = nodes.iter().map(is_elliptic).collect();
    let largest_child = largest_children(nodes);
    let mut chain_of = vec![None; nodes.len()];
    let mut chains: Vec<Vec<u32>> = Vec::new();
    for slot in 0..nodes.len() {
        if !elliptic[slot] || f64::from(nodes[slot].area) > 4.0 * settings.largest_area {
            continue;
        }
        let continued = nodes[slot].parent.filter(|&parent| {
            let keeps = f64::from(nodes[slot].area)
                >= (1.0 - LARGEST_LOSS) * f64::from(nodes[parent as usize].area);
            elliptic[parent as usize]
                && keeps
                && largest_child[parent as usize] == Some(slot as u32)
        });
        let chain = continued
            .and_then(|parent| chain_of[parent as usize])
            .unwrap_or_else(|| {
                chains.push(Vec::new());
                chains.len() - 1
            });
        chain_of[slot] = Some(chain);
        chains[chain].push(slot as u32);
    }
    chains
        .iter()
        .filter_map(|chain| candidate(nodes, chain, width, height, settings))
        .collect()
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
    chain: &[u32],
    width: usize,
    height: usize,
    settings: &CandidateSettings,
) -> Option<Candidate> {
    let first = &nodes[*chain.first()? as usize];
    let last = &nodes[*chain.last()? as usize];
    let half = 0.5 * (first.level + last.level);
    let middle = chain
        .iter()
        .map(|&slot| &nodes[slot as usize])
        .min_by(|a, b| (a.level - half).abs().total_cmp(&(b.level - half).abs()))?;
    let small = middle.area < SMALL_AREA;
    let least_levels = match (small, first.parent) {
        (false, _) => settings.least_levels,
        (true, None) => settings.least_levels_small,
        (true, Some(_)) => settings.least_levels_bump,
    };
    if (chain.len() as u32) < least_levels {
        return None;
    }
    let area = f64::from(middle.area);
    if area < settings.least_area || area > settings.largest_area {
        return None;
    }
    let at_border = middle.columns[0] == 0
        || middle.rows[0] == 0
        || middle.columns[1] as usize + 1 == width
        || middle.rows[1] as usize + 1 == height;
    Some(Candidate {
        ellipse: Ellipse::from_moments(Vector2::new(middle.x_px, middle.y_px), middle.moments)?,
        level: middle.level,
        contrast: last.level - first.level,
        is_bump: small
            && first.parent.is_some()
            && (chain.len() as u32) < settings.firm_levels_bump,
        at_border,
    })
}
