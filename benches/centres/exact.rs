//! The exact picture of a blurred elliptic dot, by a way of its own: nothing here is shared with the program's renderer.
//!
//! The ellipse is cut into chords along x; what a chord gives to a pixel is exact (the Gaussian integrated over the chord
//! and over the pixel's square), and the chords are summed by the midpoint rule over the parameter angle, which
//! converges faster than any power for a closed smooth curve.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use statrs::function::erf::erf;

/// An elliptic dot: `(p - centre)^T spread^-1 (p - centre) <= 1`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExactDot {
    /// Centre, px.
    pub(crate) centre: Vector2<f64>,
    /// Semi-axes squared, as a matrix, px^2.
    pub(crate) spread: Matrix2<f64>,
    /// Sigma of the blur, px.
    pub(crate) blur: f64,
}

/// Share of the dot's amplitude in each pixel of a square, row by row.
pub(crate) struct Cover {
    /// Column and row of its first pixel.
    pub(crate) corner: [usize; 2],
    /// Pixels a side.
    pub(crate) side: usize,
    /// Shares, 0 to 1.
    pub(crate) shares: Vec<f64>,
}

impl ExactDot {
    /// A circle of this diameter seen at an incidence, its shorter axis turned by an angle (rad).
    pub(crate) fn seen(
        centre: Vector2<f64>,
        diameter: f64,
        incidence: f64,
        angle: f64,
        blur: f64,
    ) -> Self {
        let (sin, cos) = angle.sin_cos();
        let turn = Matrix2::new(cos, -sin, sin, cos);
        let (long, short) = (0.5 * diameter, 0.5 * diameter * incidence.cos());
        let axes = Matrix2::new(short * short, 0.0, 0.0, long * long);
        Self {
            centre,
            spread: turn * axes * turn.transpose(),
            blur,
        }
    }

    /// Half the side of the square that holds it and the background round it, px.
    fn half_side(&self) -> usize {
        let reach = self.spread.m11.max(self.spread.m22).sqrt() + 5.0 * self.blur + 6.0;
        reach.ceil() as usize
    }

    /// Its cover.
    pub(crate) fn cover(&self) -> Cover {
        let half = self.half_side();
        let corner = [self.centre.x, self.centre.y].map(|middle| middle as usize - half);
        self.cover_of(corner, 2 * half + 1)
    }

    fn cover_of(&self, corner: [usize; 2], side: usize) -> Cover {
        let height = self.spread.m22.sqrt();
        let shear = self.spread.m12 / self.spread.m22;
        let width = (self.spread.determinant() / self.spread.m22).sqrt();
        let chords = ((10.0 * height / self.blur) as usize).max(60);
        let mut shares = vec![0.0; side * side];
        let (mut along_x, mut along_y) = (vec![0.0; side], vec![0.0; side]);
        for chord in 0..chords {
            let angle = std::f64::consts::PI * ((chord as f64 + 0.5) / chords as f64 - 0.5);
            let (sin, cos) = angle.sin_cos();
            let y = self.centre.y + height * sin;
            let thickness = height * cos * std::f64::consts::PI / chords as f64;
            let middle = self.centre.x + shear * height * sin;
            let ends = [middle - width * cos, middle + width * cos];
            let below = |edge: usize| below((edge as f64 - y) / self.blur);
            let left_of = |edge: usize| {
                let moment = |end: f64| first_integral((edge as f64 - end) / self.blur);
                self.blur * (moment(ends[0]) - moment(ends[1]))
            };
            difference(&mut along_y, corner[1], below);
            difference(&mut along_x, corner[0], left_of);
            for (row, by_y) in shares.chunks_mut(side).zip(&along_y) {
                for (share, by_x) in row.iter_mut().zip(&along_x) {
                    *share += thickness * by_y * by_x;
                }
            }
        }
        Cover {
            corner,
            side,
            shares,
        }
    }

    /// The Cramer-Rao bound of the centre, rms over x and y, px, for a noise of one hundredth of the amplitude: centre,
    /// shape, blur, amplitude, background and its slopes are all unknown.
    pub(crate) fn bound(&self) -> f64 {
        const STEP: f64 = 1e-4;
        let Cover {
            corner,
            side,
            shares,
        } = self.cover();
        let derivative = |change: &dyn Fn(&mut ExactDot, f64)| -> Vec<f64> {
            let at = |sign: f64| {
                let mut moved = *self;
                change(&mut moved, sign * STEP);
                moved.cover_of(corner, side).shares
            };
            at(1.0)
                .iter()
                .zip(at(-1.0))
                .map(|(high, low)| (high - low) / (2.0 * STEP))
                .collect()
        };
        let by: [Vec<f64>; 6] = [
            derivative(&|dot, by| dot.centre.x += by),
            derivative(&|dot, by| dot.centre.y += by),
            derivative(&|dot, by| dot.spread.m11 += by),
            derivative(&|dot, by| {
                dot.spread.m12 += by;
                dot.spread.m21 += by;
            }),
            derivative(&|dot, by| dot.spread.m22 += by),
            derivative(&|dot, by| dot.blur += by),
        ];
        let mut information = SMatrix::<f64, 10, 10>::zeros();
        for slot in 0..shares.len() {
            let (x, y) = (
                (slot % side) as f64 - 0.5 * side as f64,
                (slot / side) as f64 - 0.5 * side as f64,
            );
            let row = SVector::<f64, 10>::from_fn(|i, _| match i {
                0..6 => by[i][slot],
                6 => shares[slot],
                7 => 1.0,
                8 => x,
                _ => y,
            });
            information += row * row.transpose();
        }
        let covariance = information.try_inverse().expect("all parameters are seen");
        0.01 * (0.5 * (covariance[(0, 0)] + covariance[(1, 1)])).sqrt()
    }
}

/// Sets each entry to the difference of a function between the pixel's two edges.
fn difference(entries: &mut [f64], first: usize, at: impl Fn(usize) -> f64) {
    let mut low = at(first);
    for (place, entry) in entries.iter_mut().enumerate() {
        let high = at(first + place + 1);
        *entry = high - low;
        low = high;
    }
}

/// The standard normal law below a place.
fn below(place: f64) -> f64 {
    0.5 * (1.0 + erf(place / 2.0_f64.sqrt()))
}

/// Its integral from minus infinity.
fn first_integral(place: f64) -> f64 {
    place * below(place) + (-0.5 * place * place).exp() / std::f64::consts::TAU.sqrt()
}
