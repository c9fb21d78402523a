//! A ring code that was read against the picture: does every part of it look as the number says?
//!
//! A cover over two segments can turn a number into another valid one, and parity does not see it. But the code's picture is
//! known once its number is: dark ground, light segments with blurred straight borders. The share of light expected at
//! radius q (in radii of the dot) and direction a is `R(q) A(a, q)` with `R = Phi((q - 2) / b) - Phi((q - 3) / b)` and
//! `A` the same of the borders of the light runs, b the blur across the edge in the same unit. The picture is compared with
//! it cell by cell, a quarter of a segment wide. What a cover leaves behind (a border off the grid or not along a radius, a
//! segment cut at its inner or outer edge, a grey level that is neither the ground's nor the code's) departs. The dark part of
//! a segment is also looked at as a whole, where a slight difference in grey shows.
//!
//! What cannot be told: a cover of the ground's own grey whose borders lie in dark segments, or exactly on the grid.

use std::f64::consts::PI;

use nalgebra::{SMatrix, SVector, Vector2};
use statrs::function::erf::erf;

use super::{DIRECTIONS, Pattern, RingFrame, direction, share};
use crate::targets::dot::{MeasuredDot, View};

/// Bands of radii, in radii of the dot: the gap, the ring in three parts, its outer edge.
const BANDS: [[f64; 2]; 5] = [
    [1.45, 1.7],
    [2.0, 2.35],
    [2.35, 2.65],
    [2.65, 3.0],
    [3.0, 3.25],
];
/// Samples across a band.
const ACROSS: usize = 3;
/// Cells a segment.
const CELLS: usize = 4;
/// Largest error of the frame, px: it shows at the edges.
const FRAME_PX: f64 = 0.3;
/// The same as a share of the dot's radius.
const FRAME_SHARE: f64 = 0.02;
/// Unevenness of what is dark, as a share of the contrast.
const DARK: f64 = 0.04;
/// The same as the mean of a segment's dark parts.
const DARK_SEGMENT: f64 = 0.025;
/// Below this expected share a part counts as dark.
const NEARLY_DARK: f64 = 0.05;
/// Unevenness of what is light: retro-reflective film, print.
const LIGHT: f64 = 0.12;
/// What the model errs by where the ring is narrow: this many times the square of the blur in radii of the dot.
const NARROW: f64 = 0.5;
/// Noise that a cell may show, in standard deviations.
const NOISE_SIGMAS: f64 = 4.0;
/// Variance that sampling between pixels adds to the blur, px^2.
const SAMPLING_PX2: f64 = 0.16;

/// How a ring code compares with the picture that its number says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RingEvidence {
    /// Largest departure of a cell as a multiple of what is tolerated.
    pub(super) departure: f64,
    /// Segments with a cell that departs by more than is tolerated.
    pub(super) departing_segments: u32,
}

/// A sample of the ring.
struct Sample {
    segment: usize,
    cell: usize,
    expected: f64,
    /// Change of the expected share with a shift of a pixel.
    per_px: f64,
    /// Blur across the ring, in radii of the dot.
    blur: f64,
    found: f64,
    place: Vector2<f64>,
}

impl Sample {
    /// The row of a plane's unknowns: mean, slopes by radii of the dot.
    fn row(&self) -> SVector<f64, 3> {
        SVector::<f64, 3>::new(1.0, self.place.x, self.place.y)
    }

    fn above(&self, ground: &SVector<f64, 3>) -> f64 {
        self.found - ground.dot(&self.row())
    }
}

/// Sums over the samples of a cell.
#[derive(Clone, Copy, Default)]
struct Sum {
    /// Found less expected.
    off: f64,
    expected: f64,
    per_px: f64,
    /// Squares of the blur.
    blurs: f64,
    count: f64,
}

impl Sum {
    fn add(&mut self, sample: &Sample, off: f64) {
        self.off += off;
        self.expected += sample.expected;
        self.per_px += sample.per_px;
        self.blurs += sample.blur * sample.blur;
        self.count += 1.0;
    }

    /// The mean that one of the sums makes; 0 in an empty cell.
    fn mean(&self, sum: f64) -> f64 {
        sum / self.count.max(1.0)
    }
}

/// Compares the picture with the pattern; `light` is the light level by direction: mean, cosine, sine. `None` where the
/// code reaches beyond the picture.
pub(super) fn ring_evidence(
    view: &View,
    dot: &MeasuredDot,
    frame: &RingFrame,
    pattern: &Pattern,
    light: &SVector<f64, 3>,
) -> Option<RingEvidence> {
    let samples = sampled(view, dot, frame, pattern, light)?;
    let ground = ground(&samples)?;
    let level = level(&samples, &ground)?;
    let segments = usize::from(pattern.segments);
    let cells = CELLS * BANDS.len();
    let mut sums = vec![Sum::default(); segments * cells];
    let mut dark = vec![Sum::default(); segments];
    for sample in &samples {
        let off = sample.above(&ground) / level - sample.expected;
        sums[sample.segment * cells + sample.cell].add(sample, off);
        if sample.expected < NEARLY_DARK {
            dark[sample.segment].add(sample, off);
        }
    }
    let radius_px = frame.map.determinant().abs().sqrt();
    let frame_px = FRAME_PX + FRAME_SHARE * radius_px;
    let noise = NOISE_SIGMAS * view.noise / (dot.dot.contrast * light[0] * level);
    let noise_of = |pixels: f64| noise / pixels.max(1.0).sqrt();
    let pixels_per_sample = pixels_per_sample(radius_px);
    let mut evidence = RingEvidence {
        departure: 0.0,
        departing_segments: 0,
    };
    for (cells_of_segment, dark) in sums.chunks(cells).zip(&dark) {
        let tolerated = DARK_SEGMENT
            + NARROW * dark.mean(dark.blurs)
            + noise_of(dark.count * pixels_per_sample);
        let mut largest = dark.mean(dark.off).abs() / tolerated;
        for (cell, sum) in cells_of_segment.iter().enumerate() {
            let [low, high] = BANDS[cell / CELLS];
            let area = (high * high - low * low) * PI / (segments * CELLS) as f64;
            let tolerated = DARK
                + (LIGHT - DARK) * sum.mean(sum.expected)
                + frame_px * sum.mean(sum.per_px)
                + NARROW * sum.mean(sum.blurs)
                + noise_of(area * radius_px * radius_px);
            largest = largest.max(sum.mean(sum.off).abs() / tolerated);
        }
        evidence.departure = evidence.departure.max(largest);
        evidence.departing_segments += u32::from(largest > 1.0);
    }
    Some(evidence)
}

/// How many pixels a sample stands for, on the average of the bands.
fn pixels_per_sample(radius_px: f64) -> f64 {
    let area: f64 = BANDS
        .iter()
        .map(|[low, high]| high * high - low * low)
        .sum();
    let samples = (DIRECTIONS / 2 * BANDS.len() * ACROSS) as f64;
    PI * area * radius_px * radius_px / samples
}

/// The samples of all bands, their light divided by the light level.
fn sampled(
    view: &View,
    dot: &MeasuredDot,
    frame: &RingFrame,
    pattern: &Pattern,
    light: &SVector<f64, 3>,
) -> Option<Vec<Sample>> {
    let back = frame.map.try_inverse()?.transpose();
    let blur_px = (dot.blur * dot.blur + SAMPLING_PX2).sqrt();
    let n = f64::from(pattern.segments);
    let borders = Borders::of(pattern);
    let mut samples = Vec::with_capacity(DIRECTIONS / 2 * BANDS.len() * ACROSS);
    for index in (0..DIRECTIONS).step_by(2) {
        let direction = direction(index);
        let (sin, cos) = direction.sin_cos();
        let level = light
            .dot(&SVector::<f64, 3>::new(1.0, cos, sin))
            .max(0.25 * light[0]);
        // A shift of a pixel across an edge with this normal, in radii of the dot.
        let radial = (back * Vector2::new(cos, sin)).norm();
        let tangential = (back * Vector2::new(-sin, cos)).norm();
        let turn = (direction / std::f64::consts::TAU * n - pattern.grid).rem_euclid(n);
        let segment = (turn as usize).min(usize::from(pattern.segments) - 1);
        let quarter = (((turn - segment as f64) * CELLS as f64) as usize).min(CELLS - 1);
        for (band, [low, high]) in BANDS.iter().enumerate() {
            for k in 0..ACROSS {
                let radius = low + (high - low) * (k as f64 + 0.5) / ACROSS as f64;
                let place = Vector2::new(cos, sin) * radius;
                let found = share(view, dot, frame.place(direction, radius))? / level;
                let b = blur_px * radial;
                let across = below((radius - 2.0) / b) - below((radius - 3.0) / b);
                let per_segment = radius * std::f64::consts::TAU / n;
                let along = borders.light(turn, per_segment / (blur_px * tangential));
                let both = |share: f64| 1.6 * share * (1.0 - share) / blur_px;
                samples.push(Sample {
                    segment,
                    cell: band * CELLS + quarter,
                    expected: across * along,
                    blur: b,
                    per_px: (both(across) * along).max(both(along) * across),
                    found,
                    place,
                });
            }
        }
    }
    Some(samples)
}

/// The runs of a pattern.
struct Borders {
    bits: Vec<bool>,
}

impl Borders {
    fn of(pattern: &Pattern) -> Self {
        let bit = |k: u8| (pattern.bits >> (pattern.segments - 1 - k)) & 1 == 1;
        Self {
            bits: (0..pattern.segments).map(bit).collect(),
        }
    }

    /// The expected share of light at a place (in segments), where a segment is `sharpness` blurs wide.
    fn light(&self, turn: f64, sharpness: f64) -> f64 {
        let count = self.bits.len();
        let segment = (turn as usize).min(count - 1);
        let here = self.bits[segment];
        let same = |step: usize| {
            (1..count)
                .take_while(|n| self.bits[(segment + n * step) % count] == here)
                .count() as f64
        };
        let within = turn - segment as f64;
        let ahead = (same(1) + 1.0 - within) * sharpness;
        let behind = (same(count - 1) + within) * sharpness;
        // From either side of the run comes the other kind of light.
        let other = below(-ahead) + below(-behind);
        if here { 1.0 - other } else { other }
    }
}

fn below(z: f64) -> f64 {
    0.5 * (1.0 + erf(z * std::f64::consts::FRAC_1_SQRT_2))
}

/// The light above the ground where the code is wholly light: the median of what the lighter samples say, because a narrow
/// ring never is wholly light in the picture.
fn level(samples: &[Sample], ground: &SVector<f64, 3>) -> Option<f64> {
    let lighter = samples.iter().filter(|s| s.expected > 0.6);
    let mut levels: Vec<f64> = lighter.map(|s| s.above(ground) / s.expected).collect();
    levels.sort_by(f64::total_cmp);
    levels
        .get(levels.len() / 2)
        .copied()
        .filter(|&level| level > 0.1)
}

/// The ground as a plane (mean, slopes by radii of the dot) through the samples where the code is dark; what departs from
/// the others loses its say.
fn ground(samples: &[Sample]) -> Option<SVector<f64, 3>> {
    const ALL_DARK: f64 = 0.02;
    const STEPS: usize = 4;
    let dark: Vec<&Sample> = samples.iter().filter(|s| s.expected < ALL_DARK).collect();
    let mut found: Vec<f64> = dark.iter().map(|s| s.found).collect();
    found.sort_by(f64::total_cmp);
    let mut plane = SVector::<f64, 3>::new(*found.get(found.len() / 2)?, 0.0, 0.0);
    for _ in 0..STEPS {
        let mut sizes: Vec<f64> = dark.iter().map(|s| s.above(&plane).abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let scale = (1.5 * sizes[sizes.len() / 2]).max(1e-4);
        let mut normal = SMatrix::<f64, 3, 3>::identity();
        normal[(0, 0)] = 1e-6;
        let mut right = SVector::<f64, 3>::zeros();
        for sample in &dark {
            let weight = (1.0 + (sample.above(&plane) / (2.0 * scale)).powi(2)).powi(-2);
            let row = sample.row();
            normal += row * row.transpose() * weight;
            right += row * (sample.found * weight);
        }
        plane = normal.cholesky()?.solve(&right);
    }
    Some(plane)
}
