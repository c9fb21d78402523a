//! A ring code that was read against the picture: does every part of it look as the number says?
//!
//! A cover over two segments can turn a number into another valid one, and parity does not see it. But the code's picture is
//! known once its number is ([`super::sketch`]), and what a cover leaves behind departs from it: a border off the grid or not
//! along a radius, a segment cut at its inner or outer edge, a grey level that is neither the ground's nor the code's.
//! Three things are looked at:
//! - the difference in the mean of three by three pixels, the size of the blur: it may be as large as film and print are uneven
//!   and the noise is strong;
//! - the borders: how far along the ring each one between light and dark is from the grid, and how wide a line lies on the others, by
//!   least squares over their pixels: once in the scene as it fits best, and once with the scene left free, for a scene gives way to
//!   a border that is off, the more the fewer borders there are. Print may make all light segments wider or narrower alike. In the same
//!   way how far each border leans from the radius that it should lie on: of two covers that hide whole segments but for a wedge neither
//!   shifts a border by much. And whether all borders together are round, as where plain targets stand so close that they run together;
//! - the levels of whole segments, alone and of neighbours together, which show slighter differences in grey.
//!
//! What cannot be told: a cover of the ground's own grey whose borders lie in dark segments or on the grid leaves the picture of
//! another number.

use std::f64::consts::TAU;

use nalgebra::{Cholesky, Const, Vector2};

use super::first_look::{MIDDLE, OUTER};
use super::fitting::{Fitted, shown};
use super::patch::Patch;
use super::refine::{ByScene, Compared, Equations, UNKNOWNS};

/// Largest error of the frame, pixels of the patch: it shows at the edges.
const FRAME_PX: f64 = 0.12;
/// How far the border of two segments may be from where it should be, and how wide a line on it, pixels of the patch.
const BORDER_PX: f64 = 0.12;
/// How far a border may be from where the rest, left free to give way to it, has it.
const FREE_BORDER_PX: f64 = 0.26;
/// What a border's ends may be off as it leans, as a multiple of what the whole of it may: half as much is known of them. True codes of all
/// sizes and incidences reach 1.0 times that, those in photographs half of it.
const LEANING: f64 = 2.0;
/// By how much round ends of light parts lie back at the ring's edges, in radii of the dot: half of what they do where plain targets stand
/// in a row as wide as the ring. True codes: 0.025 at most in a thousand photographed ones, more than this in five of 58,000 computed ones.
const ROUND: f64 = 0.04;
/// How much wider light segments may be on either side, radians at the ring's middle: standard deviation.
const GROWTH: f64 = 0.006;
/// Unevenness of what is dark, as a share of the contrast.
const DARK: f64 = 0.05;
/// The same as the level of a whole dark segment.
const DARK_SEGMENT: f64 = 0.03;
/// How far the level of a whole light segment may be from the others'.
const LIGHT_SEGMENT: f64 = 0.25;
/// Unevenness of what is light within a segment: retro-reflective film, print.
const LIGHT: f64 = 0.12;
/// Unevenness of single pixels.
const UNEVEN: f64 = 0.02;
/// Noise that may be seen, in standard deviations.
const NOISE_SIGMAS: f64 = 5.0;

/// How a ring code compares with the picture that its number says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RingEvidence {
    /// Largest departure as a multiple of what is tolerated.
    pub(super) departure: f64,
    /// Segments with a part that departs by more than is tolerated.
    pub(super) departing_segments: u32,
    /// How round the ends of all light parts together are, as a multiple of what is tolerated; below 0 they are hollow.
    pub(super) roundness: f64,
    /// Root mean square difference over the code, as a share of the contrast.
    pub(super) misfit: f64,
}

/// Difference of a pixel.
#[derive(Clone, Copy, Default)]
struct Off {
    off: f64,
    tolerated: f64,
    count: f64,
    segment: usize,
}

/// Which segment a pixel lies in, and which border it is next to: the one with the same number begins a segment.
#[derive(Clone, Copy, Default)]
struct Place {
    segment: usize,
    border: usize,
}

impl Place {
    fn of(affine: &Vector2<f64>, segments: usize) -> Self {
        let turn = (affine.y.atan2(affine.x) / TAU).rem_euclid(1.0) * segments as f64;
        Self {
            segment: (turn as usize).min(segments - 1),
            border: turn.round() as usize % segments,
        }
    }
}

/// How far the border between a light and a dark segment is from where it should be, or how wide a line of the other kind lies
/// between two that are alike: by least squares together with all that the scene depends on, which gives way to a border that
/// is off and would hide a part of it.
#[derive(Clone, Copy)]
struct Border {
    product: f64,
    square: f64,
    scene: ByScene,
}

impl Border {
    fn nothing() -> Self {
        Self {
            product: 0.0,
            square: 0.0,
            scene: ByScene::zeros(),
        }
    }

    fn add(&mut self, pixel: &Compared, by: f64) {
        self.product += pixel.weight * pixel.off * by;
        self.square += pixel.weight * by * by;
        self.scene.axpy(pixel.weight * by, &pixel.by, 1.0);
    }

    /// Adds a border that moves with this one by `share`, 1 or -1.
    fn join(&mut self, other: &Self, share: f64) {
        self.product += share * other.product;
        self.square += other.square;
        self.scene.axpy(share, &other.scene, 1.0);
    }

    /// Radians, or pixels of a line's width.
    fn shift(&self) -> f64 {
        self.product / self.square.max(f64::MIN_POSITIVE)
    }

    /// Its standard deviation as the weights say.
    fn sigma(&self) -> f64 {
        self.square.max(f64::MIN_POSITIVE).sqrt().recip()
    }
}

/// How far a border between a light and a dark segment is from straight along the radius: by what its outer end is forward and its
/// inner one behind as it leans, by what both ends are forward and its middle behind as it is round.
#[derive(Clone, Copy)]
struct Bent {
    ends: Border,
    /// Its product with the shift of the whole border.
    with_shift: f64,
}

impl Bent {
    fn nothing() -> Self {
        Self {
            ends: Border::nothing(),
            with_shift: 0.0,
        }
    }

    /// `by` is the derivative by the shift of the border, `share` how much of it this pixel's place takes part in.
    fn add(&mut self, pixel: &Compared, by: f64, share: f64) {
        self.ends.add(pixel, share * by);
        self.with_shift += pixel.weight * share * by * by;
    }

    /// Adds one that bends with this one by `share`, 1 or -1.
    fn join(&mut self, other: &Self, share: f64) {
        self.ends.join(&other.ends, share);
        self.with_shift += other.with_shift;
    }
}

/// What gives way to a border that is off.
struct Rest {
    factor: Cholesky<f64, Const<UNKNOWNS>>,
    right: ByScene,
    growth: Border,
    /// What the scene does as light segments grow.
    scene: ByScene,
    /// The noise as a share of what the weights say.
    noise: f64,
}

impl Rest {
    /// `None` where the scene is not determined.
    fn of(equations: &Equations, borders: &[Border], bits: &[bool], noise: f64) -> Option<Self> {
        let mut growth = Border::nothing();
        for (index, border) in borders.iter().enumerate() {
            if bits[index] != bits[(index + bits.len() - 1) % bits.len()] {
                growth.join(border, outward(bits[index]));
            }
        }
        let factor = equations.normal.cholesky()?;
        Some(Self {
            scene: factor.solve(&growth.scene),
            factor,
            right: equations.right,
            growth,
            noise,
        })
    }

    /// The border with the rest left free to give way to it; `with_growth` is its product with the growth.
    fn freed(&self, border: &Border, with_growth: f64) -> Border {
        let scene = self.factor.solve(&border.scene);
        let growth = GROWTH.powi(-2) + self.growth.square - self.growth.scene.dot(&self.scene);
        let with_growth = with_growth - scene.dot(&self.growth.scene);
        let by_growth = with_growth / growth;
        let grown = self.growth.product - self.right.dot(&self.scene);
        Border {
            product: border.product - self.right.dot(&scene) - grown * by_growth,
            square: border.square - border.scene.dot(&scene) - with_growth * by_growth,
            ..*border
        }
    }

    /// How far a border is off against what is tolerated, the rest as fitted and the rest free; `with_growth` is its product with
    /// the growth, `px` pixels are one of its units.
    fn departure(&self, border: &Border, with_growth: f64, px: f64) -> f64 {
        /// Nothing more is known of a border that the rest explains but for this share.
        const LEAST: f64 = 1e-6;
        let free = self.freed(border, with_growth);
        let departure = |border: &Border, tolerated: f64| {
            let (shift, sigma) = (border.shift(), self.noise * border.sigma());
            px * shift.abs() / f64::hypot(tolerated, NOISE_SIGMAS * px * sigma)
        };
        let fitted = Border {
            product: free.product,
            ..*border
        };
        let fitted = departure(&fitted, BORDER_PX);
        if free.square <= LEAST * border.square {
            return fitted;
        }
        fitted.max(departure(&free, FREE_BORDER_PX))
    }

    /// How round the ends of the light parts are, as a multiple of what is tolerated.
    fn roundness(&self, ends: &Bent) -> f64 {
        /// Standard deviations of the noise.
        const SIGMAS: f64 = 3.0;
        let free = self.freed(&ends.ends, ends.with_shift);
        // Radians at the ring's middle; round ends lie back at its edges.
        let (round, sigma) = (-MIDDLE * free.shift(), MIDDLE * self.noise * free.sigma());
        round / ROUND.max(SIGMAS * sigma)
    }
}

/// Which way a border moves as the light segment beside it grows; `light` says what it begins.
fn outward(light: bool) -> f64 {
    if light { -1.0 } else { 1.0 }
}

/// Compares the picture with the fitted code.
pub(super) fn ring_evidence(patch: &Patch, fitted: &Fitted) -> Option<RingEvidence> {
    let scene = &fitted.scene;
    let segments = fitted.bits.len();
    let mut offs = vec![Off::default(); patch.columns * patch.rows];
    let (mut squares, mut count) = (0.0, 0.0);
    let lines = fitted.sketch.lines();
    let mut cracks = vec![Border::nothing(); segments];
    let mut borders = vec![Border::nothing(); segments];
    let mut leans = vec![Bent::nothing(); segments];
    let mut bulges = vec![Bent::nothing(); segments];
    let shown = shown(&fitted.shares);
    let equations = scene.equations(patch, &fitted.sketch, &shown, f64::INFINITY, |pixel| {
        let seen = pixel.seen;
        let light = seen.light.max(0.25 * scene.light[0]);
        let share = seen.ring.value + seen.dot.value;
        let slope = (seen.ring.slope + scene.dot_light * seen.dot.slope).norm();
        let off = pixel.off / light;
        let place = Place::of(&pixel.affine, segments);
        offs[pixel.row * patch.columns + pixel.column] = Off {
            off,
            tolerated: (DARK + (LIGHT - DARK) * (2.0 * share).min(1.0)).max(FRAME_PX * slope),
            count: 1.0,
            segment: place.segment,
        };
        // The picture as a border goes forward by a radian.
        let turned = scene.frame.map * Vector2::new(-pixel.affine.y, pixel.affine.x);
        let by = -seen.light * seen.ring.slope.dot(&turned);
        borders[place.border].add(pixel, by);
        let radius = pixel.affine.norm() / (1.0 - scene.frame.tilt.dot(&pixel.affine));
        let lever = ((radius - MIDDLE) / (OUTER - MIDDLE)).clamp(-1.0, 1.0);
        leans[place.border].add(pixel, by, lever);
        // Less its mean, so that a border that is off is not round.
        bulges[place.border].add(pixel, by, lever * lever - 1.0 / 3.0);
        let line = lines.value(pixel.column, pixel.row);
        cracks[place.border].add(pixel, seen.light * line);
        squares += off * off;
        count += 1.0;
    })?;
    let mut departures = of_levels(patch, fitted);
    let of_weights = patch.noise / scene.variance(patch).sqrt();
    let rest = Rest::of(&equations, &borders, &fitted.bits, of_weights)?;
    let mut ends = Bent::nothing();
    for index in 0..segments {
        let behind = (index + segments - 1) % segments;
        let light = fitted.bits[index];
        let departure = if light == fitted.bits[behind] {
            rest.departure(&cracks[index], 0.0, 1.0)
        } else {
            let (sin, cos) = (TAU * index as f64 / segments as f64).sin_cos();
            let px = MIDDLE * (scene.frame.map * Vector2::new(-sin, cos)).norm();
            let (border, lean) = (&borders[index], &leans[index]);
            let growth = outward(light);
            ends.join(&bulges[index], growth);
            let leaning = rest.departure(&lean.ends, growth * lean.with_shift, px) / LEANING;
            leaning.max(rest.departure(border, growth * border.square, px))
        };
        departures[index] = departures[index].max(departure);
    }
    let noise = NOISE_SIGMAS * patch.noise / scene.light[0];
    for (column, row, _) in patch.pixels() {
        let sum = around(&offs, patch, column, row);
        let departure = sum.off.abs() / sum.tolerated.hypot(noise * sum.count.sqrt());
        let largest = &mut departures[offs[row * patch.columns + column].segment];
        *largest = largest.max(departure);
    }
    Some(RingEvidence {
        departure: departures.iter().copied().fold(0.0, f64::max),
        departing_segments: departures.iter().filter(|&&d| d > 1.0).count() as u32,
        roundness: rest.roundness(&ends),
        misfit: (squares / f64::max(count, 1.0)).sqrt(),
    })
}

/// Departures of the levels of whole segments, each alone and in the mean with neighbours of its kind: a cover lies over several, and
/// their mean is surer than each.
///
/// Cost: segments times the longest run of alike ones.
fn of_levels(patch: &Patch, fitted: &Fitted) -> Vec<f64> {
    // What is uneven round a narrow segment is taken for its level as noise is.
    let uneven = f64::hypot(
        1.0,
        UNEVEN * fitted.scene.light[0] / patch.noise.max(f64::MIN_POSITIVE),
    );
    let segments = fitted.bits.len();
    let mut departures = vec![0.0_f64; segments];
    for first in 0..segments {
        let light = fitted.bits[first];
        let (level, even) = if light {
            (1.0, LIGHT_SEGMENT)
        } else {
            (0.0, DARK_SEGMENT)
        };
        let (mut off, mut variance) = (0.0, 0.0);
        let run = (0..segments).map(|k| (first + k) % segments);
        let alike = run.take_while(|&at| fitted.bits[at] == light);
        for (at, count) in alike.zip(1..) {
            off += fitted.shares[at] - level;
            variance += fitted.sigmas[at].powi(2);
            let tolerated = f64::hypot(
                f64::from(count) * even,
                NOISE_SIGMAS * uneven * variance.sqrt(),
            );
            let departure = off.abs() / tolerated;
            for k in 0..count as usize {
                let of_run = &mut departures[(first + k) % segments];
                *of_run = of_run.max(departure);
            }
        }
    }
    departures
}

/// The sums over a pixel and its neighbours.
fn around(offs: &[Off], patch: &Patch, column: usize, row: usize) -> Off {
    let mut sum = Off::default();
    for line in row.saturating_sub(1)..(row + 2).min(patch.rows) {
        for place in column.saturating_sub(1)..(column + 2).min(patch.columns) {
            let off = &offs[line * patch.columns + place];
            sum.off += off.off;
            sum.tolerated += off.tolerated;
            sum.count += off.count;
        }
    }
    sum
}
