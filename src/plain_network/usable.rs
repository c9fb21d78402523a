//! What of a network can be adjusted, and why the rest cannot.

use super::contradictions::Contradiction;
use super::doubtful::usable_observations;
use super::{PlainDatum, PlainNetwork, PlainObservation, PointRole};

/// Fewest points that a pose needs.
const POINTS_OF_AN_IMAGE: usize = 3;

/// Names that are told of many; more do not help anybody.
pub(super) const NAMES: usize = 6;

/// What takes part, and one line for everything that does not. Lists are in the order of the network's.
pub(super) struct Usable {
    pub(super) images: Vec<bool>,
    pub(super) points: Vec<bool>,
    pub(super) observations: Vec<bool>,
    pub(super) distances: Vec<bool>,
    /// Known coordinates that are believed; of a control point they enter the adjustment.
    pub(super) known: Vec<[bool; 3]>,
    /// Known camera parameters that are believed; of a weighted parameter they enter the adjustment.
    pub(super) known_parameters: Vec<[bool; 10]>,
    /// Camera parameters that are held at their values though they are free.
    pub(super) held: Vec<[bool; 10]>,
    /// Given starts of images and of points that are believed.
    pub(super) image_starts: Vec<bool>,
    pub(super) point_starts: Vec<bool>,
    pub(super) datum: PlainDatum,
    /// Known values that contradict everything else, as far as they were found.
    pub(super) contradictions: Vec<Contradiction>,
    pub(super) told: Vec<String>,
}

impl Usable {
    pub(super) fn of(network: &PlainNetwork) -> Self {
        let mut told = Vec::new();
        for (index, camera) in network.cameras.iter().enumerate() {
            if !network.images.iter().any(|image| image.camera == index) {
                told.push(format!("camera '{}': found no image of it", camera.name));
            }
        }
        let (images, points) = (network.images.len(), network.points.len());
        let mut usable = Self {
            images: vec![true; images],
            points: vec![true; points],
            observations: usable_observations(network, &mut told),
            distances: vec![true; network.distances.len()],
            known: vec![[true; 3]; points],
            known_parameters: vec![[true; 10]; network.cameras.len()],
            held: vec![[false; 10]; network.cameras.len()],
            image_starts: vec![true; images],
            point_starts: vec![true; points],
            datum: network.datum.clone(),
            contradictions: Vec::new(),
            told,
        };
        usable.settle(network);
        usable
    }

    /// Leaves out what has too few rays or hangs together with nothing, until nothing more falls away.
    pub(super) fn settle(&mut self, network: &PlainNetwork) {
        self.leave_out_thin(network);
        self.keep_what_hangs_together(network);
        self.leave_out_thin(network);
    }

    pub(super) fn is_seen(&self, seen: &PlainObservation, index: usize) -> bool {
        self.observations[index] && self.images[seen.image] && self.points[seen.point]
    }

    /// The observations that take part, with their places in the network's list.
    pub(super) fn seen<'a>(
        &'a self,
        network: &'a PlainNetwork,
    ) -> impl Iterator<Item = (usize, &'a PlainObservation)> {
        let all = network.observations.iter().enumerate();
        all.filter(|(index, seen)| self.is_seen(seen, *index))
    }

    /// Whether all three coordinates of a point are known and used.
    pub(super) fn is_known(&self, network: &PlainNetwork, point: usize) -> bool {
        let of_point = &network.points[point];
        let believed = self.known[point];
        of_point.role == PointRole::Control
            && (0..3).all(|axis| believed[axis] && of_point.known[axis].is_some())
    }

    fn leave_out_thin(&mut self, network: &PlainNetwork) {
        loop {
            let mut of_image = vec![0; self.images.len()];
            let mut of_point = vec![0; self.points.len()];
            for (_, seen) in self.seen(network) {
                of_image[seen.image] += 1;
                of_point[seen.point] += 1;
            }
            let mut changed = false;
            for (index, point) in network.points.iter().enumerate() {
                let needed = if self.is_known(network, index) { 0 } else { 2 };
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
