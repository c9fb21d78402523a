//! Small pictures with exact truth, for the tests of this folder.

use nalgebra::{Matrix3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::ellipse::{Axes, Ellipse};
use crate::imaging::{BitDepth, GreyImage};

/// Samples a pixel side.
const FINE: usize = 5;

/// Light on a dark ground, sampled finer than the pixels.
pub(super) struct Canvas {
    width: usize,
    height: usize,
    fine: Vec<f32>,
}

/// How a canvas becomes a picture.
#[derive(Clone, Copy)]
pub(super) struct Exposure {
    /// Standard deviation of the lens's blur, px.
    pub(super) blur: f64,
    pub(super) dark: f64,
    pub(super) light: f64,
    /// Rise of the background over the picture's width.
    pub(super) slope: f64,
    pub(super) noise: f64,
    pub(super) depth: BitDepth,
    pub(super) seed: u64,
}

impl Default for Exposure {
    fn default() -> Self {
        Self {
            blur: 0.8,
            dark: 10.0,
            light: 150.0,
            slope: 0.0,
            noise: 2.0,
            depth: BitDepth::Eight,
            seed: 7,
        }
    }
}

impl Canvas {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            fine: vec![0.0; width * height * FINE * FINE],
        }
    }

    /// Makes `lightness` where `inside` holds, within `reach` px of a place.
    pub(super) fn paint(
        &mut self,
        place: Vector2<f64>,
        reach: f64,
        lightness: f32,
        inside: impl Fn(Vector2<f64>) -> bool,
    ) {
        self.cover(
            place,
            reach,
            lightness,
            |at| if inside(at) { 1.0 } else { 0.0 },
        );
    }

    /// Makes `lightness` to the share that is covered, within `reach` px of a place.
    fn cover(
        &mut self,
        place: Vector2<f64>,
        reach: f64,
        lightness: f32,
        covered: impl Fn(Vector2<f64>) -> f64,
    ) {
        let fine = FINE as f64;
        let range = |middle: f64, count: usize| {
            let first = ((middle - reach) * fine).floor().max(0.0) as usize;
            first..(((middle + reach) * fine).ceil().max(0.0) as usize).min(count)
        };
        for row in range(place.y, self.height * FINE) {
            for column in range(place.x, self.width * FINE) {
                let at = Vector2::new((column as f64 + 0.5) / fine, (row as f64 + 0.5) / fine);
                let share = covered(at) as f32;
                let value = &mut self.fine[row * self.width * FINE + column];
                *value += share * (lightness - *value);
            }
        }
    }

    pub(super) fn dot(&mut self, centre: Vector2<f64>, axes: Axes) {
        self.dot_of(centre, axes, 1.0);
    }

    /// A dot of this lightness.
    pub(super) fn dot_of(&mut self, centre: Vector2<f64>, axes: Axes, lightness: f32) {
        let ellipse = Ellipse::from_axes(centre, axes);
        self.cover(centre, axes.major + 1.0, lightness, |at| {
            let level = ellipse.level(at);
            let gradient = (ellipse.shape * (at - centre)).norm() / level.max(1e-9);
            (0.5 + FINE as f64 * (1.0 - level) / gradient.max(1e-9)).clamp(0.0, 1.0)
        });
    }

    pub(super) fn expose(&self, exposure: &Exposure) -> GreyImage {
        let blurred = self.blurred(exposure.blur * FINE as f64);
        let mut rng = ChaCha8Rng::seed_from_u64(exposure.seed);
        let white = f64::from(exposure.depth.white());
        let mut samples = Vec::with_capacity(self.width * self.height);
        for row in 0..self.height {
            for column in 0..self.width {
                let mut sum = 0.0;
                for fine_row in row * FINE..(row + 1) * FINE {
                    let first = fine_row * self.width * FINE + column * FINE;
                    sum += blurred[first..first + FINE]
                        .iter()
                        .map(|&v| f64::from(v))
                        .sum::<f64>();
                }
                let share = sum / (FINE * FINE) as f64;
                let gauss = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
                let ground = exposure.slope * column as f64 / self.width as f64;
                let grey = exposure.dark
                    + ground
                    + (exposure.light - exposure.dark) * share
                    + exposure.noise * gauss;
                samples.push(grey.round().clamp(0.0, white) as u16);
            }
        }
        GreyImage::new(
            self.width as u32,
            self.height as u32,
            exposure.depth,
            samples,
        )
        .unwrap()
    }

    fn blurred(&self, sigma: f64) -> Vec<f32> {
        let reach = (4.0 * sigma).ceil() as isize;
        let mut kernel: Vec<f32> = (-reach..=reach)
            .map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp() as f32)
            .collect();
        let sum: f32 = kernel.iter().sum();
        kernel.iter_mut().for_each(|weight| *weight /= sum);
        let (width, height) = (self.width * FINE, self.height * FINE);
        let mut across = vec![0.0_f32; width * height];
        for row in 0..height {
            let line = &self.fine[row * width..(row + 1) * width];
            if line.iter().all(|&value| value == 0.0) {
                continue;
            }
            for column in 0..width {
                let value: f32 = (-reach..=reach)
                    .zip(&kernel)
                    .map(|(k, weight)| {
                        weight * line[(column as isize + k).clamp(0, width as isize - 1) as usize]
                    })
                    .sum();
                across[row * width + column] = value;
            }
        }
        let mut down = vec![0.0_f32; width * height];
        for row in 0..height {
            for (k, weight) in (-reach..=reach).zip(&kernel) {
                let from = (row as isize + k).clamp(0, height as isize - 1) as usize;
                let source = &across[from * width..(from + 1) * width];
                for (to, value) in down[row * width..(row + 1) * width].iter_mut().zip(source) {
                    *to += weight * value;
                }
            }
        }
        down
    }
}

/// A plane target seen obliquely from near: places in the target's plane (y up, units of the dot's radius) to pixels.
#[derive(Clone, Copy)]
pub(super) struct ObliqueView {
    homography: Matrix3<f64>,
}

impl ObliqueView {
    /// `radius` px where the target is seen at scale, tilted by `tilt` about a line in the direction `along`, after a
    /// turn by `turn` (counter-clockwise as seen), from `distance` radii away.
    pub(super) fn new(
        centre: Vector2<f64>,
        radius: f64,
        turn: f64,
        tilt: f64,
        along: f64,
        distance: f64,
    ) -> Self {
        let z_turn = |angle: f64| nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), angle);
        let tilt = nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), tilt);
        let rotation = (z_turn(along) * tilt * z_turn(turn - along)).into_inner();
        let mut pose = rotation;
        pose.set_column(2, &Vector3::new(0.0, 0.0, -distance));
        // Rows of the picture run downwards, the camera looks along -z.
        let scale = radius * distance;
        let to_pixels = Matrix3::new(-scale, 0.0, centre.x, 0.0, scale, centre.y, 0.0, 0.0, 1.0);
        Self {
            homography: to_pixels * pose,
        }
    }

    /// The centre of the image of the unit circle.
    pub(super) fn dot_centre(&self) -> Vector2<f64> {
        // The circle's conic moved to the picture; its centre is the pole of the line at infinity.
        let back = self.homography.try_inverse().unwrap();
        let conic = back.transpose() * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0)) * back;
        let pole = conic.try_inverse().unwrap() * Vector3::z();
        pole.xy() / pole.z
    }

    /// Paints a ring code: its dot and its segments, the first of the `bits` (most significant) beginning at the
    /// plane's x axis, clockwise as seen.
    pub(super) fn paint_ring(&self, canvas: &mut Canvas, bits: u32, segments: u8, reach: f64) {
        let back = self.homography.try_inverse().unwrap();
        let n = f64::from(segments);
        canvas.paint(self.dot_centre(), reach, 1.0, |at| {
            let plane = back * at.push(1.0);
            let plane = plane.xy() / plane.z;
            let radius = plane.norm();
            let clockwise = (-plane.y).atan2(plane.x).rem_euclid(std::f64::consts::TAU);
            let segment = (clockwise / std::f64::consts::TAU * n) as u32;
            let light =
                (bits >> (u32::from(segments) - 1 - segment.min(u32::from(segments) - 1))) & 1 == 1;
            radius < 1.0 || ((2.0..3.0).contains(&radius) && light)
        });
    }
}
