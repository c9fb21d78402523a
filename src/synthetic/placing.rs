//! Seeded places for codes and plain targets on rectangular faces.

use nalgebra::Vector2;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::scene::dot420_places;
use super::{Placement, Scene};

/// Tries at one spacing before the spacing is made smaller.
const TRIES: usize = 300;
/// Factor on the spacing when there is no room.
const SHRINK: f64 = 0.85;
/// Least distance of a dot of one element from a dot of another, pitches: foreign dots come as near as a real job has
/// them, no nearer.
const LEAST_GAP_PITCHES: f64 = 3.0;
/// A plain target put beside a code stands within this of one of its dots, pitches.
const BESIDE_PITCHES: f64 = 3.8;

/// A scene that cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// The faces are full.
    #[error(
        "no room for {what}: {placed} of {asked} placed on a face of {width_mm:.0} x {height_mm:.0} mm; ask for fewer or smaller ones"
    )]
    NoRoom {
        /// Codes or plain targets.
        what: &'static str,
        /// How many found room.
        placed: usize,
        /// How many were asked for.
        asked: usize,
        /// Width of the face.
        width_mm: f64,
        /// Height of the face.
        height_mm: f64,
    },
    /// More codes than the family has.
    #[error("{asked} codes asked for, the family has {available}")]
    TooManyCodes {
        /// How many were asked for.
        asked: usize,
        /// How many there are.
        available: usize,
    },
    /// A size is not a positive number.
    #[error("{what} is {value}, expected a positive number")]
    BadSize {
        /// Which.
        what: &'static str,
        /// What was found.
        value: f64,
    },
    /// The lens and frame cannot hold the object from any distance.
    #[error("no distance up to {farthest_mm:.0} mm brings the object into the frame")]
    NoDistance {
        /// The greatest distance tried.
        farthest_mm: f64,
    },
}

/// Sizes of the targets, mm.
#[derive(Clone, Copy)]
pub(super) struct TargetSize {
    pub(super) pitch: f64,
    pub(super) dot: f64,
}

/// A rectangular face being filled with targets; its placement's origin is its centre.
pub(super) struct Face {
    placement: Placement,
    half: Vector2<f64>,
    size: TargetSize,
    /// Dots already there.
    dots: Vec<Vector2<f64>>,
    plates: Vec<Plate>,
    /// Circles that stay free.
    kept_free: Vec<(Vector2<f64>, f64)>,
}

/// The square carrier of a code, one pitch wider than its dots on all sides, or of a ring code.
struct Plate {
    centre: Vector2<f64>,
    along: Vector2<f64>,
    half: f64,
    dots: Vec<Vector2<f64>>,
}

impl Plate {
    fn contains(&self, place: &Vector2<f64>) -> bool {
        let from = place - self.centre;
        from.dot(&self.along).abs() <= self.half && from.perp(&self.along).abs() <= self.half
    }
}

impl Face {
    pub(super) fn new(placement: Placement, width: f64, height: f64, size: TargetSize) -> Self {
        Self {
            placement,
            half: Vector2::new(width, height) / 2.0,
            size,
            dots: Vec::new(),
            plates: Vec::new(),
            kept_free: Vec::new(),
        }
    }

    pub(super) fn area(&self) -> f64 {
        let free: f64 = self
            .kept_free
            .iter()
            .map(|(_, r)| r * r * std::f64::consts::PI)
            .sum();
        (4.0 * self.half.x * self.half.y - free).max(0.0)
    }

    pub(super) fn keep_free(&mut self, centre: Vector2<f64>, radius: f64) {
        self.kept_free.push((centre, radius));
    }

    /// Places `dot420` codes, as far from each other as there is room, each turned at random.
    pub(super) fn place_dot420(
        &mut self,
        ids: &[u32],
        scene: &mut Scene,
        random: &mut ChaCha8Rng,
    ) -> Result<(), SceneError> {
        let pitch = self.size.pitch;
        let half = 4.0 * pitch + self.size.dot / 2.0;
        for (placed, &id) in ids.iter().enumerate() {
            let plate = self
                .free_plate(half, random)
                .ok_or_else(|| self.no_room("codes", placed, ids.len()))?;
            let across = Vector2::new(-plate.along.y, plate.along.x);
            let origin = plate.centre - (plate.along + across) * (3.0 * pitch);
            let dots: Vec<_> = dot420_places(id)
                .iter()
                .map(|[x, y]| origin + (plate.along * *x + across * *y) * pitch)
                .collect();
            let placement = self
                .placement
                .moved(origin.x, origin.y, 0.0)
                .turned(plate.along.y.atan2(plate.along.x));
            scene.add_dot420(id, &placement, pitch, self.size.dot);
            self.dots.extend(&dots);
            self.plates.push(Plate { dots, ..plate });
        }
        Ok(())
    }

    /// Places for ring codes, as far from each other as there is room, each turned at random.
    pub(super) fn ring_places(
        &mut self,
        count: usize,
        random: &mut ChaCha8Rng,
    ) -> Result<Vec<Placement>, SceneError> {
        (0..count)
            .map(|placed| {
                // The ring ends at 1.5 dot diameters; a dot's width stays dark round it.
                let plate = self
                    .free_plate(2.5 * self.size.dot, random)
                    .ok_or_else(|| self.no_room("codes", placed, count))?;
                let (centre, along) = (plate.centre, plate.along);
                self.dots.push(centre);
                self.plates.push(Plate {
                    dots: vec![centre],
                    ..plate
                });
                Ok(self
                    .placement
                    .moved(centre.x, centre.y, 0.0)
                    .turned(along.y.atan2(along.x)))
            })
            .collect()
    }

    /// Places of plain targets: `beside` of them close to a dot of a code, the others as far from each other as there
    /// is room.
    pub(super) fn plain_places(
        &mut self,
        count: usize,
        beside: usize,
        random: &mut ChaCha8Rng,
    ) -> Result<Vec<Placement>, SceneError> {
        (0..count)
            .map(|placed| {
                let close = if placed < beside {
                    self.place_beside_code(placed, random)
                } else {
                    None
                };
                let place = close
                    .or_else(|| self.free_place(random))
                    .ok_or_else(|| self.no_room("plain targets", placed, count))?;
                self.dots.push(place);
                Ok(self.placement.moved(place.x, place.y, 0.0))
            })
            .collect()
    }

    fn no_room(&self, what: &'static str, placed: usize, asked: usize) -> SceneError {
        SceneError::NoRoom {
            what,
            placed,
            asked,
            width_mm: 2.0 * self.half.x,
            height_mm: 2.0 * self.half.y,
        }
    }

    fn random_place(&self, margin: f64, random: &mut ChaCha8Rng) -> Option<Vector2<f64>> {
        let room = self.half.map(|h| h - margin);
        (room.min() > 0.0).then(|| {
            Vector2::new(
                random.random_range(-room.x..room.x),
                random.random_range(-room.y..room.y),
            )
        })
    }

    /// A square for a code of half-width `half` that touches no other and no dot.
    fn free_plate(&self, half: f64, random: &mut ChaCha8Rng) -> Option<Plate> {
        let mut spacing = 6.0 * half;
        // Two squares whose centres are a diagonal apart cannot touch.
        let touching = 2.0 * half * std::f64::consts::SQRT_2;
        while spacing > touching * SHRINK {
            let apart = spacing.max(touching);
            for _ in 0..TRIES {
                let centre = self.random_place(half * std::f64::consts::SQRT_2, random)?;
                let free = self
                    .plates
                    .iter()
                    .all(|plate| (plate.centre - centre).norm() >= apart)
                    && self
                        .kept_free
                        .iter()
                        .all(|(at, r)| (at - centre).norm() >= r + 1.42 * half);
                if free {
                    let (sin, cos) = random.random_range(0.0..std::f64::consts::TAU).sin_cos();
                    return Some(Plate {
                        centre,
                        along: Vector2::new(cos, sin),
                        half,
                        dots: Vec::new(),
                    });
                }
            }
            spacing *= SHRINK;
        }
        None
    }

    fn is_free(&self, place: &Vector2<f64>, spacing: f64) -> bool {
        let margin = 2.0 * self.size.dot;
        place.abs().x <= self.half.x - margin
            && place.abs().y <= self.half.y - margin
            && self.dots.iter().all(|dot| (dot - place).norm() >= spacing)
            && !self.plates.iter().any(|plate| plate.contains(place))
            && self
                .kept_free
                .iter()
                .all(|(at, r)| (at - place).norm() >= *r)
    }

    /// No closer than this to any dot of another element, mm.
    fn least_gap(&self) -> f64 {
        (LEAST_GAP_PITCHES * self.size.pitch).max(2.0 * self.size.dot)
    }

    fn place_beside_code(&self, turn: usize, random: &mut ChaCha8Rng) -> Option<Vector2<f64>> {
        let least = self.least_gap();
        let most = least * BESIDE_PITCHES / LEAST_GAP_PITCHES;
        let plate = self.plates.get(turn % self.plates.len().max(1))?;
        (0..TRIES)
            .map(|_| {
                let dot = plate.dots[random.random_range(0..plate.dots.len())];
                let (sin, cos) = random.random_range(0.0..std::f64::consts::TAU).sin_cos();
                dot + Vector2::new(cos, sin) * random.random_range(least..most)
            })
            .find(|place| self.is_free(place, least))
    }

    fn free_place(&self, random: &mut ChaCha8Rng) -> Option<Vector2<f64>> {
        let least = self.least_gap();
        let mut spacing = 4.0 * least;
        while spacing > least * SHRINK {
            for _ in 0..TRIES {
                let place = self.random_place(2.0 * self.size.dot, random)?;
                if self.is_free(&place, spacing.max(least)) {
                    return Some(place);
                }
            }
            spacing *= SHRINK;
        }
        None
    }
}

/// `count` different numbers of 1..=`available`, in random order.
pub(super) fn draw_ids(
    count: usize,
    available: u32,
    random: &mut ChaCha8Rng,
) -> Result<Vec<u32>, SceneError> {
    if count > available as usize {
        return Err(SceneError::TooManyCodes {
            asked: count,
            available: available as usize,
        });
    }
    let mut ids: Vec<u32> = (1..=available).collect();
    for k in 0..count {
        let other = random.random_range(k..ids.len());
        ids.swap(k, other);
    }
    ids.truncate(count);
    Ok(ids)
}

/// Shares out `count` things in proportion to `weights` (largest remainders, Hamilton).
pub(super) fn shared_out(count: usize, weights: &[f64]) -> Vec<usize> {
    let total: f64 = weights.iter().sum();
    let exact: Vec<f64> = weights.iter().map(|w| count as f64 * w / total).collect();
    let mut shares: Vec<usize> = exact.iter().map(|e| e.floor() as usize).collect();
    let mut order: Vec<usize> = (0..weights.len()).collect();
    order.sort_by(|&a, &b| exact[b].fract().total_cmp(&exact[a].fract()));
    let left = count.saturating_sub(shares.iter().sum());
    for &index in order.iter().cycle().take(left) {
        shares[index] += 1;
    }
    shares
}

/// Refuses a size that is not positive and finite.
pub(super) fn check_size(what: &'static str, value: f64) -> Result<(), SceneError> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(SceneError::BadSize { what, value })
    }
}

#[cfg(test)]
mod tests {
    use super::super::noise::generator;
    use super::*;

    #[test]
    fn shares_add_up_and_follow_the_weights() {
        assert_eq!(shared_out(10, &[1.0, 1.0, 2.0]), [3, 2, 5]);
        assert_eq!(
            shared_out(144, &[24.0, 18.0, 18.0, 12.0, 12.0])
                .iter()
                .sum::<usize>(),
            144
        );
    }

    #[test]
    fn drawn_numbers_differ_and_are_of_the_family() {
        let mut ids = draw_ids(420, 420, &mut generator(3, 0)).unwrap();
        ids.sort_unstable();
        assert_eq!(ids, (1..=420).collect::<Vec<_>>());
        assert!(draw_ids(421, 420, &mut generator(3, 0)).is_err());
    }

    #[test]
    fn a_full_face_is_an_error() {
        let placement = Placement::horizontal(nalgebra::Vector3::zeros());
        let mut face = Face::new(
            placement,
            100.0,
            100.0,
            TargetSize {
                pitch: 5.0,
                dot: 5.0,
            },
        );
        let full = face.plain_places(100, 0, &mut generator(1, 0));
        assert!(
            matches!(full, Err(SceneError::NoRoom { asked: 100, .. })),
            "{full:?}"
        );
    }
}
