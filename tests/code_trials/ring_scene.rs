//! What a trial of ring codes shows: codes, and what lies over and beside them; and what detection made of it.

use std::f64::consts::{PI, TAU};

use nalgebra::{SMatrix, SVector, Vector2};
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use tiepoint::targets::{DetectSettings, Family, detect, ring_table};

use super::Tally;
use super::picture::{Exposure, Shade, developed, still};
use super::plane_view::PlaneView;

/// Something before the targets, in the picture's pixels.
pub(super) struct Cover {
    pub(super) shape: CoverShape,
    pub(super) grey: f64,
}

pub(super) enum CoverShape {
    /// Everything farther than `offset` along `normal`.
    Half {
        normal: Vector2<f64>,
        offset: f64,
    },
    /// A strip of this width.
    Strip {
        normal: Vector2<f64>,
        offset: f64,
        width: f64,
    },
    Disc {
        middle: Vector2<f64>,
        radius: f64,
    },
}

impl CoverShape {
    fn hides(&self, px: Vector2<f64>) -> bool {
        match self {
            Self::Half { normal, offset } => normal.dot(&px) > *offset,
            Self::Strip {
                normal,
                offset,
                width,
            } => (0.0..*width).contains(&(normal.dot(&px) - offset)),
            Self::Disc { middle, radius } => (px - middle).norm() < *radius,
        }
    }
}

/// A sector of a ring, less than half of it, that is dark or light instead of what it should be.
#[derive(Clone, Copy)]
pub(super) struct Sector {
    /// Where it starts and ends, in the plane as seen.
    ends: [Vector2<f64>; 2],
    light: bool,
}

impl Sector {
    /// From `start` on, `width` of a ring's segments.
    pub(super) fn new(segments: u8, start: f64, width: f64, light: bool) -> Self {
        let ends = [start, start + width].map(|turn| towards(turn / f64::from(segments)));
        Self { ends, light }
    }

    fn holds(&self, seen: &Vector2<f64>) -> bool {
        self.ends[0].perp(seen) >= 0.0 && self.ends[1].perp(seen) < 0.0
    }
}

/// The direction clockwise as seen from the plane's x axis, by a share of the turn; y down.
fn towards(turn: f64) -> Vector2<f64> {
    let (sin, cos) = (TAU * turn).sin_cos();
    Vector2::new(cos, sin)
}

#[derive(Clone)]
pub(super) struct Ring {
    pub(super) view: PlaneView,
    pub(super) segments: u8,
    pub(super) bits: u32,
    pub(super) id: u32,
    pub(super) sector: Option<Sector>,
    /// Where the segments of the first half of the turn begin, in the plane as seen.
    pub(super) begins: Vec<Vector2<f64>>,
}

impl Ring {
    pub(super) fn any(segments: u8, view: PlaneView, random: &mut ChaCha8Rng) -> Self {
        let table = ring_table(segments);
        let index = random.random_range(0..table.len());
        let begins = 0..segments / 2;
        Self {
            view,
            segments,
            bits: table[index],
            id: index as u32 + 1,
            sector: None,
            begins: begins
                .map(|k| towards(f64::from(k) / f64::from(segments)))
                .collect(),
        }
    }

    /// Which part of the target is seen at a pixel, from 1, and whether it is light; `None` on the ground round it.
    fn part(&self, px: Vector2<f64>) -> Option<(u32, bool)> {
        let plane = self.view.plane(px);
        let squared = plane.norm_squared();
        if squared < 1.0 {
            return Some((1, true));
        }
        if !(4.0..9.0).contains(&squared) {
            return None;
        }
        let count = u32::from(self.segments);
        let seen = Vector2::new(plane.x, -plane.y);
        let segment = self.segment(seen);
        if let Some(sector) = &self.sector
            && sector.holds(&seen)
        {
            return Some((2 + count + segment, sector.light));
        }
        Some((2 + segment, self.is_light(segment)))
    }

    /// The same with its frame turned by a share of the turn.
    fn turned(&self, turn: f64) -> Self {
        let (sin, cos) = (TAU * turn).sin_cos();
        let by = SVector::<f64, 8>::from([cos - 1.0, -sin, 0.0, sin, cos - 1.0, 0.0, 0.0, 0.0]);
        Self {
            view: self.view.moved(&by),
            ..self.clone()
        }
    }

    fn is_light(&self, segment: u32) -> bool {
        (self.bits >> (u32::from(self.segments) - 1 - segment)) & 1 == 1
    }

    /// The segment in a direction, clockwise as seen from the plane's x axis: the borders that it has passed are counted.
    fn segment(&self, seen: Vector2<f64>) -> u32 {
        let second = seen.y < 0.0 || (seen.y == 0.0 && seen.x < 0.0);
        let turned = if second { -seen } else { seen };
        let passed = self.begins[1..]
            .iter()
            .filter(|begin| begin.perp(&turned) >= 0.0)
            .count() as u32;
        passed + u32::from(second) * u32::from(self.segments) / 2
    }
}

/// Grey values of ground and targets.
#[derive(Clone, Copy)]
pub(super) struct Light {
    pub(super) ground: f64,
    pub(super) target: f64,
}

impl Light {
    pub(super) fn any(random: &mut ChaCha8Rng) -> Self {
        Self {
            ground: random.random_range(8.0..40.0),
            target: random.random_range(100.0..220.0),
        }
    }
}

pub(super) struct Scene {
    pub(super) size: [usize; 2],
    /// Of the family that is read.
    pub(super) segments: u8,
    pub(super) rings: Vec<Ring>,
    /// Light discs: middle and radius, px.
    pub(super) discs: Vec<(Vector2<f64>, f64)>,
    pub(super) covers: Vec<Cover>,
    pub(super) light: Light,
}

impl Scene {
    /// One code in the middle of a picture that holds it with some room.
    pub(super) fn of_one(
        segments: u8,
        incidence_deg: f64,
        dot_px: f64,
        random: &mut ChaCha8Rng,
    ) -> Self {
        let radius = dot_px / 2.0;
        let side = ((8.0 * radius).ceil() as usize + 8).max(48);
        let view = view_at(
            Vector2::repeat(side as f64 / 2.0),
            radius,
            incidence_deg,
            random,
        );
        Self {
            size: [side; 2],
            segments,
            rings: vec![Ring::any(segments, view, random)],
            discs: Vec::new(),
            covers: Vec::new(),
            light: Light::any(random),
        }
    }

    fn shade(&self, px: Vector2<f64>) -> Shade {
        /// More than a ring has parts.
        const PARTS: u32 = 100;
        if let Some(cover) = self.covers.iter().find(|cover| cover.shape.hides(px)) {
            return Shade {
                part: 1,
                grey: cover.grey,
            };
        }
        let grey = |light| {
            if light {
                self.light.target
            } else {
                self.light.ground
            }
        };
        let discs = self.discs.iter();
        let disc = discs
            .zip(2..)
            .find(|((m, r), _)| (px - m).norm_squared() < r * r);
        if let Some((_, part)) = disc {
            return Shade {
                part,
                grey: grey(true),
            };
        }
        let rings = self.rings.iter().zip(1..);
        let seen = rings
            .filter_map(|(ring, k)| ring.part(px).map(|(part, light)| (k * PARTS + part, light)))
            .next();
        let (part, light) = seen.unwrap_or((0, false));
        Shade {
            part,
            grey: grey(light),
        }
    }

    pub(super) fn trial(&self, random: &mut ChaCha8Rng) -> Tally {
        let exposure = Exposure::default();
        let still = still(self.size, |px| self.shade(px), &exposure);
        let image = developed(self.size, &still, &exposure, random);
        let families = [Family::Ring(self.segments)];
        let found = detect(&image, &families, &DetectSettings::default());
        let mut tally = Tally {
            shown: self.rings.len(),
            ..Tally::default()
        };
        for code in &found.codes {
            let centre = found.dots[code.dots[0].slot()].centre_px;
            let here = |ring: &&Ring| ring.view.plane(centre).norm() < 0.5;
            let ring = self.rings.iter().find(here);
            let right = ring.is_some_and(|ring| ring.id == code.id);
            let counter = match (right, &code.doubt) {
                (true, None) => &mut tally.read,
                (true, Some(_)) => &mut tally.doubtful,
                (false, None) if ring.is_some_and(|ring| self.shows(&still, ring, code.id)) => {
                    &mut tally.same_picture
                }
                (false, None) => &mut tally.wrong,
                (false, Some(_)) => &mut tally.wrong_doubtful,
            };
            *counter += 1;
        }
        tally
    }

    /// Whether the picture without noise is the one of another number: in the same frame and light, or in those that fit it best, for
    /// a reader does not know them before.
    fn shows(&self, still: &[f64], ring: &Ring, id: u32) -> bool {
        let pattern = ring_table(ring.segments)[id as usize - 1];
        let n = ring.segments;
        let seen = self.bits_seen(still, ring);
        let nearest = (0..n)
            .map(|turn| ((pattern << turn) | (pattern >> (n - turn))) & ((1_u32 << n) - 1))
            .min_by_key(|bits| (bits ^ seen).count_ones());
        nearest.is_some_and(|bits| {
            let other = Ring {
                bits,
                sector: None,
                ..ring.clone()
            };
            let same = self.apart(still, ring, &self.alone(&other));
            // Least squares find no frame that is turned by more than the blur: from all that the grid may have.
            let fitted = |turn: f64| {
                let turned = other.turned(turn / f64::from(n));
                self.apart(still, ring, &self.fitted(still, &turned))
            };
            let turns = [0.0, 0.12, -0.12, 0.25, -0.25, 0.37, -0.37, 0.5, -0.5];
            same.is_little() || turns.into_iter().any(|turn| fitted(turn).is_little())
        })
    }

    /// Which segments of a ring are light in their middle.
    fn bits_seen(&self, still: &[f64], ring: &Ring) -> u32 {
        let [width, height] = self.size;
        let half = 0.5 * (self.light.ground + self.light.target);
        (0..ring.segments).fold(0, |bits, segment| {
            let middle = towards((f64::from(segment) + 0.5) / f64::from(ring.segments)) * 2.5;
            let px = ring.view.px(Vector2::new(middle.x, -middle.y));
            let (column, row) = (px.x.max(0.0) as usize, px.y.max(0.0) as usize);
            let grey = still[row.min(height - 1) * width + column.min(width - 1)];
            bits << 1 | u32::from(grey > half)
        })
    }

    /// The picture without noise of one ring alone.
    fn alone(&self, ring: &Ring) -> Vec<f64> {
        let alone = Scene {
            rings: vec![ring.clone()],
            discs: Vec::new(),
            covers: Vec::new(),
            ..*self
        };
        super::picture::still(self.size, |px| alone.shade(px), &Exposure::default())
    }

    /// The pixels within 3.5 radii of a code's dot.
    fn near(&self, ring: &Ring) -> Vec<bool> {
        let [width, height] = self.size;
        let middle =
            |slot: usize| Vector2::new((slot % width) as f64 + 0.5, (slot / width) as f64 + 0.5);
        (0..width * height)
            .map(|slot| ring.view.plane(middle(slot)).norm() < 3.5)
            .collect()
    }

    /// How a picture differs near a code from another.
    fn apart(&self, still: &[f64], ring: &Ring, picture: &[f64]) -> Apart {
        /// Unevenness of what is dark, and of what is at least half light, shares of the contrast.
        const DARK: f64 = 0.05;
        const LIGHT: f64 = 0.12;
        /// Noise of the mean, in standard deviations.
        const SIGMAS: f64 = 5.0;
        let noise = Exposure::default().noise;
        let [width, height] = self.size;
        let contrast = self.light.target - self.light.ground;
        let offs: Vec<f64> = (still.iter().zip(picture).zip(self.near(ring)))
            .map(|((still, picture), near)| if near { still - picture } else { 0.0 })
            .collect();
        let mut apart = Apart::default();
        for row in 1..height - 1 {
            for column in 1..width - 1 {
                let slot = row * width + column;
                apart.chi_square += (offs[slot] / noise).powi(2);
                let around: f64 = (0..9)
                    .map(|k| offs[(row + k / 3 - 1) * width + column + k % 3 - 1])
                    .sum();
                let share = (picture[slot] - self.light.ground) / contrast;
                let uneven = DARK + (LIGHT - DARK) * (2.0 * share).min(1.0);
                let tolerated = uneven * contrast + SIGMAS * noise / 3.0;
                apart.uneven = apart.uneven.max((around / 9.0).abs() / tolerated);
            }
        }
        apart
    }

    /// The picture of a code in the frame and light in which it comes nearest to another, by least squares from its own on.
    fn fitted(&self, still: &[f64], ring: &Ring) -> Vec<f64> {
        /// Motions by which derivatives are taken: the samples of the picture make smaller ones coarse.
        const STEP: f64 = 0.02;
        const ROUNDS: usize = 5;
        let near = self.near(ring);
        let picture = |by: &Motion| -> Vec<f64> {
            let mut picture = self.alone(&Ring {
                view: ring.view.moved(&by.fixed_rows::<8>(0).into_owned()),
                ..ring.clone()
            });
            let contrast = self.light.target - self.light.ground;
            for grey in &mut picture {
                *grey += by[8] * contrast + by[9] * (*grey - self.light.ground);
            }
            picture
        };
        let offs = |picture: &[f64]| -> Vec<f64> {
            let pixels = still.iter().zip(picture).zip(&near);
            let offs = pixels.filter(|(_, near)| **near);
            offs.map(|((still, picture), _)| still - picture).collect()
        };
        let slopes: [Vec<f64>; MOTIONS] = std::array::from_fn(|k| {
            let step = Motion::ith(k, STEP);
            let (ahead, behind) = (offs(&picture(&step)), offs(&picture(&-step)));
            let pairs = behind.iter().zip(&ahead);
            pairs.map(|(b, a)| (b - a) / (2.0 * STEP)).collect()
        });
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut by = Motion::zeros();
        let mut best = picture(&by);
        let normal =
            SMatrix::<f64, MOTIONS, MOTIONS>::from_fn(|i, j| product(&slopes[i], &slopes[j]));
        let Some(factor) = normal.cholesky() else {
            return best;
        };
        let mut left = offs(&best);
        for _ in 0..ROUNDS {
            let right = Motion::from_fn(|i, _| product(&slopes[i], &left));
            by += factor.solve(&right);
            let next = picture(&by);
            let next_left = offs(&next);
            if product(&next_left, &next_left) >= product(&left, &left) {
                break;
            }
            (best, left) = (next, next_left);
        }
        best
    }
}

/// What a reader does not know before of a code's picture: its frame, see [`PlaneView::moved`], ground and light.
const MOTIONS: usize = 10;
type Motion = SVector<f64, MOTIONS>;

/// How a picture without noise differs from another.
#[derive(Clone, Copy, Default)]
struct Apart {
    /// Against the noise.
    chi_square: f64,
    /// Largest difference of the means of 3 x 3 pixels, as a multiple of how far film and print may be uneven and noise strong together.
    uneven: f64,
}

impl Apart {
    /// Less than noise tells from nothing, or nowhere more than what is uneven: a reader that refused this would refuse real codes.
    fn is_little(&self) -> bool {
        /// Five standard deviations of the noise, for a reader who knows what to look for.
        const CHI_SQUARE: f64 = 25.0;
        self.uneven < 1.0 || self.chi_square < CHI_SQUARE
    }
}

pub(super) fn view_at(
    middle: Vector2<f64>,
    radius: f64,
    incidence_deg: f64,
    random: &mut ChaCha8Rng,
) -> PlaneView {
    let off = Vector2::new(random.random_range(0.0..1.0), random.random_range(0.0..1.0));
    let angles = [
        random.random_range(0.0..TAU),
        incidence_deg.to_radians(),
        random.random_range(0.0..PI),
    ];
    PlaneView::new(
        middle + off,
        radius,
        angles,
        random.random_range(120.0..400.0),
    )
}
