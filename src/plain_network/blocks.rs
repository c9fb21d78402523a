//! Blocks: images that hang together by common points. Known points place a block, so that several may be adjusted.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::PlainNetwork;
use super::usable::{Usable, listed};
use crate::geometry::fit_plane;

/// Images that hang together, with the points that they see.
#[derive(Default)]
struct Block {
    images: Vec<usize>,
    points: Vec<usize>,
    rays: usize,
    /// Points of which all coordinates are known.
    known: usize,
    /// Whether they fix position, attitude and scale.
    is_placed: bool,
}

impl Usable {
    /// Of blocks that share no point, all that known points place stay, or the one with most rays where that is more.
    pub(super) fn keep_what_hangs_together(&mut self, network: &PlainNetwork) {
        let blocks = self.blocks(network);
        let placed = || blocks.iter().filter(|block| block.is_placed);
        let rays_of_placed: usize = placed().map(|block| block.rays).sum();
        let largest = (0..blocks.len())
            .filter(|&k| !blocks[k].is_placed)
            .max_by_key(|&k| (blocks[k].rays, std::cmp::Reverse(k)))
            .filter(|&k| blocks[k].rays > rays_of_placed);
        let stays = |k: usize| largest.map_or(blocks[k].is_placed, |largest| largest == k);
        if largest.is_some() {
            self.leave_out_unseen(network);
        }
        for block in (0..blocks.len()).filter(|&k| !stays(k)).map(|k| &blocks[k]) {
            for &image in &block.images {
                self.images[image] = false;
            }
            for &point in &block.points {
                self.points[point] = false;
            }
            let known = match largest {
                None => format!(
                    " and {} known points, expected 3 or more that do not lie on a line",
                    block.known
                ),
                Some(_) => String::new(),
            };
            let names: Vec<&str> = block
                .images
                .iter()
                .map(|&image| network.images[image].name.as_str())
                .collect();
            self.told.push(format!(
                "{}: found no point in common with the other images{known}, left out: a block of its own of {} images and {} points",
                listed("image", &names),
                block.images.len(),
                block.points.len()
            ));
        }
    }

    /// Known points without rays do not place a block, and their coordinates must not be taken for a datum.
    fn leave_out_unseen(&mut self, network: &PlainNetwork) {
        let mut rays = vec![0; self.points.len()];
        for (_, seen) in self.seen(network) {
            rays[seen.point] += 1;
        }
        for (index, point) in network.points.iter().enumerate() {
            if self.points[index] && rays[index] == 0 {
                self.points[index] = false;
                let name = &point.name;
                self.told.push(format!(
                    "point '{name}': found known coordinates but no rays: left out"
                ));
            }
        }
    }

    /// The blocks, in the order of their first images.
    fn blocks(&self, network: &PlainNetwork) -> Vec<Block> {
        let images = self.images.len();
        let mut parent: Vec<usize> = (0..images + self.points.len()).collect();
        for (_, seen) in self.seen(network) {
            join(&mut parent, seen.image, images + seen.point);
        }
        let mut blocks: BTreeMap<usize, Block> = BTreeMap::new();
        for image in (0..images).filter(|&image| self.images[image]) {
            let block = blocks.entry(root(&mut parent, image)).or_default();
            block.images.push(image);
        }
        for (_, seen) in self.seen(network) {
            if let Some(block) = blocks.get_mut(&root(&mut parent, seen.image)) {
                block.rays += 1;
            }
        }
        for point in (0..self.points.len()).filter(|&point| self.points[point]) {
            if let Some(block) = blocks.get_mut(&root(&mut parent, images + point)) {
                block.points.push(point);
            }
        }
        let mut blocks: Vec<Block> = blocks.into_values().collect();
        for block in &mut blocks {
            let known = block.points.iter();
            let known = known.filter(|&&point| self.is_known(network, point));
            let places: Vec<Vector3<f64>> = known
                .filter_map(|&point| {
                    let [x, y, z] = network.points[point].known;
                    Some(Vector3::new(x?.value_mm, y?.value_mm, z?.value_mm))
                })
                .collect();
            block.known = places.len();
            // A fit fails for fewer than three points and for those on a line.
            block.is_placed = fit_plane(&places).is_ok();
        }
        blocks
    }
}

fn root(parent: &mut [usize], mut at: usize) -> usize {
    while parent[at] != at {
        parent[at] = parent[parent[at]];
        at = parent[at];
    }
    at
}

fn join(parent: &mut [usize], one: usize, other: usize) {
    let (one, other) = (root(parent, one), root(parent, other));
    parent[one.max(other)] = one.min(other);
}
