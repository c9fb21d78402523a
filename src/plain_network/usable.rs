//! What of a network can be adjusted, and why the rest cannot.

use std::collections::BTreeMap;

use super::{PlainNetwork, PlainPoint, PointRole};

/// Fewest points that a pose needs.
const POINTS_OF_AN_IMAGE: usize = 3;

/// Names that are told of many; more do not help anybody.
const NAMES: usize = 6;

/// Images and points that take part, and one line for everything that does not.
pub(super) struct Usable {
    pub(super) images: Vec<bool>,
    pub(super) points: Vec<bool>,
    pub(super) told: Vec<String>,
}

impl Usable {
    pub(super) fn of(network: &PlainNetwork) -> Self {
        let mut usable = Self {
            images: vec![true; network.images.len()],
            points: vec![true; network.points.len()],
            told: Vec::new(),
        };
        for (index, camera) in network.cameras.iter().enumerate() {
            if !network.images.iter().any(|image| image.camera == index) {
                usable
                    .told
                    .push(format!("camera '{}': found no image of it", camera.name));
            }
        }
        usable.settle(network);
        usable.keep_largest_block(network);
        usable.settle(network);
        usable
    }

    /// Leaves out what has too few rays until nothing more falls away.
    pub(super) fn settle(&mut self, network: &PlainNetwork) {
        loop {
            let mut of_image = vec![0; self.images.len()];
            let mut of_point = vec![0; self.points.len()];
            for seen in &network.observations {
                if self.images[seen.image] && self.points[seen.point] {
                    of_image[seen.image] += 1;
                    of_point[seen.point] += 1;
                }
            }
            let mut changed = false;
            for (index, point) in network.points.iter().enumerate() {
                let needed = if point.is_known() { 0 } else { 2 };
                if self.points[index] && of_point[index] < needed {
                    self.points[index] = false;
                    changed = true;
                    self.told.push(format!(
                        "point '{}': found {} rays, expected 2 or more: left out",
                        point.name, of_point[index]
                    ));
                }
            }
            for (index, image) in network.images.iter().enumerate() {
                if self.images[index] && of_image[index] < POINTS_OF_AN_IMAGE {
                    self.images[index] = false;
                    changed = true;
                    self.told.push(format!(
                        "image '{}': found {} points, expected {POINTS_OF_AN_IMAGE} or more: left out",
                        image.name, of_image[index]
                    ));
                }
            }
            if !changed {
                return;
            }
        }
    }

    /// Of blocks that share no point, nor hang together by known coordinates, the one with most rays stays.
    fn keep_largest_block(&mut self, network: &PlainNetwork) {
        let images = self.images.len();
        // Images, then points, then one for all that is known.
        let known = images + self.points.len();
        let mut parent: Vec<usize> = (0..=known).collect();
        let mut rays: BTreeMap<usize, usize> = BTreeMap::new();
        let taking_part =
            |seen: &&super::PlainObservation| self.images[seen.image] && self.points[seen.point];
        for seen in network.observations.iter().filter(taking_part) {
            join(&mut parent, seen.image, images + seen.point);
            if network.points[seen.point].is_known() {
                join(&mut parent, images + seen.point, known);
            }
        }
        for seen in network.observations.iter().filter(taking_part) {
            *rays.entry(root(&mut parent, seen.image)).or_default() += 1;
        }
        let Some((&largest, _)) = rays
            .iter()
            .max_by_key(|(block, rays)| (**rays, std::cmp::Reverse(**block)))
        else {
            return;
        };
        let mut blocks: BTreeMap<usize, Vec<&str>> = BTreeMap::new();
        for (index, image) in network.images.iter().enumerate() {
            let block = root(&mut parent, index);
            if self.images[index] && block != largest {
                blocks.entry(block).or_default().push(&image.name);
                self.images[index] = false;
            }
        }
        for index in 0..self.points.len() {
            let in_block = root(&mut parent, images + index) == largest;
            self.points[index] &= in_block || network.points[index].is_known();
        }
        for names in blocks.values() {
            self.told.push(format!(
                "{}: found no point in common with the other images, left out: a block of its own",
                listed("image", names)
            ));
        }
    }
}

impl PlainPoint {
    /// Whether all three coordinates are known and used.
    pub(super) fn is_known(&self) -> bool {
        self.role == PointRole::Control && self.known.iter().all(Option::is_some)
    }
}

/// Things by their names, the first few of many.
pub(super) fn listed(kind: &str, names: &[&str]) -> String {
    let shown: Vec<String> = names
        .iter()
        .take(NAMES)
        .map(|name| format!("'{name}'"))
        .collect();
    let more = names.len().saturating_sub(NAMES);
    let plural = if names.len() == 1 { "" } else { "s" };
    let rest = if more > 0 {
        format!(" and {more} more")
    } else {
        String::new()
    };
    format!("{kind}{plural} {}{rest}", shown.join(", "))
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
