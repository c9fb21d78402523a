//! What a blurred elliptic dot gives to each pixel, exactly.
//!
//! The profile of [`super::profile`] takes the edge as straight within the blur, and the pixel's square as a part of it. That
//! is right for large dots; a narrow one, or a lens sharper than the pixels, moves its centre by up to some hundredths of a
//! pixel, the more the farther the centre lies from the pixels' own symmetry. Here the ellipse is cut into chords along the rows.
//! What a chord gives to a pixel is the Gaussian integrated over the chord and over the pixel's square, in closed form; the
//! chords are summed by the midpoint rule over the parameter angle of the ellipse, which for a smooth closed curve converges
//! faster than any power of their number: a spacing of 1.2 sigmas leaves 1e-6.
//!
//! Cost: chords x (pixels of a side x 3 evaluations of the normal law / 8 + pixels / 8).

use nalgebra::Vector2;

use super::columns::normal_law;
use super::ellipse::Ellipse;
use super::lanes::{LANES, Lanes};

/// Spacing of the chords at most, in sigmas.
const SPACING: f64 = 1.2;
/// The ellipse's own shape needs this many.
const LEAST_CHORDS: usize = 16;
/// A pixel's square has this variance, px^2: a part of the profile's blur, not of the lens's.
const VARIANCE_OF_PIXEL: f64 = 1.0 / 12.0;
/// A lens is not sharper, px.
const LEAST_SIGMA: f64 = 0.1;

/// Shares of the amplitude, 0 to 1, in a rectangle of pixels.
#[derive(Clone, Debug, Default)]
pub(super) struct Shares {
    /// Middle of the first pixel.
    first: [f32; 2],
    lanes: usize,
    shares: Vec<Lanes>,
    along_x: Vec<Lanes>,
    along_y: Vec<Lanes>,
}

impl Shares {
    /// Fills the rectangle from `first` to `last` (middles of pixels) for an ellipse and the blur of a profile.
    pub(super) fn fill(&mut self, ellipse: &Ellipse, blur: f64, first: [f32; 2], last: [f32; 2]) {
        let sides = [0, 1].map(|axis| (last[axis] - first[axis]).round() as usize + 1);
        self.first = first;
        self.lanes = sides[0].div_ceil(LANES);
        self.shares.clear();
        self.shares.resize(self.lanes * sides[1], Lanes::ZERO);
        let Some(spread) = ellipse.shape.try_inverse() else {
            return;
        };
        let sigma = (blur * blur - VARIANCE_OF_PIXEL)
            .max(LEAST_SIGMA * LEAST_SIGMA)
            .sqrt();
        let height = spread.m22.sqrt();
        let shear = spread.m12 / spread.m22;
        let width = (spread.determinant() / spread.m22).sqrt();
        let spaced = (std::f64::consts::PI * height / (SPACING * sigma)).ceil() as usize;
        let chords = spaced.max(LEAST_CHORDS);
        let edge = Vector2::new(f64::from(first[0]) - 0.5, f64::from(first[1]) - 0.5);
        for chord in 0..chords {
            let angle = std::f64::consts::PI * ((chord as f64 + 0.5) / chords as f64 - 0.5);
            let (sin, cos) = angle.sin_cos();
            let thickness = height * cos * std::f64::consts::PI / chords as f64;
            let y = ellipse.centre.y + height * sin;
            let middle = ellipse.centre.x + shear * height * sin;
            let ends = [middle - width * cos, middle + width * cos].map(|end| end - edge.x);
            chord_along(&mut self.along_x, self.lanes, ends, sigma);
            point_across(
                &mut self.along_y,
                sides[1].div_ceil(LANES),
                y - edge.y,
                sigma,
                thickness,
            );
            let across: &[f32] = bytemuck::cast_slice(&self.along_y);
            for (row, &by_y) in self.shares.chunks_exact_mut(self.lanes).zip(across) {
                let by_y = Lanes::splat(by_y);
                for (share, &by_x) in row.iter_mut().zip(&self.along_x) {
                    *share += by_y * by_x;
                }
            }
        }
    }

    /// The share of the pixel with this middle.
    pub(super) fn at(&self, x: f32, y: f32) -> f32 {
        // Truncated after half a step, because rounding is a call of its own on most machines.
        let steps = |from: f32, to: f32| (to - from + 0.5) as usize;
        let (column, row) = (steps(self.first[0], x), steps(self.first[1], y));
        let shares: &[f32] = bytemuck::cast_slice(&self.shares);
        shares
            .get(row * self.lanes * LANES + column)
            .copied()
            .unwrap_or(0.0)
    }
}

/// The left edges of eight pixels, from the first pixel's left edge.
#[inline(always)]
fn edges(lane: usize) -> Lanes {
    Lanes(std::array::from_fn(|next| (lane * LANES + next) as f32))
}

/// What a chord gives to the columns: the integral over the column's width of the blurred chord.
fn chord_along(columns: &mut Vec<Lanes>, lanes: usize, ends: [f64; 2], sigma: f64) {
    let per_sigma = Lanes::splat((1.0 / sigma) as f32);
    let scale = Lanes::splat(sigma as f32);
    let [left, right] = ends.map(|end| Lanes::splat(end as f32));
    // The integral of the normal law: place times law plus density.
    let integral = |place: Lanes| {
        let (density, below) = normal_law(place);
        place * below + density
    };
    let until = |edge: Lanes| {
        scale * (integral((edge - left) * per_sigma) - integral((edge - right) * per_sigma))
    };
    differences(columns, lanes, until);
}

/// What a place on the y axis gives to the rows, times a thickness.
fn point_across(rows: &mut Vec<Lanes>, lanes: usize, y: f64, sigma: f64, thickness: f64) {
    let per_sigma = Lanes::splat((1.0 / sigma) as f32);
    let (y, thickness) = (Lanes::splat(y as f32), Lanes::splat(thickness as f32));
    differences(rows, lanes, |edge| {
        thickness * normal_law((edge - y) * per_sigma).1
    });
}

/// For every pixel the difference of a function between its two edges.
fn differences(pixels: &mut Vec<Lanes>, lanes: usize, until: impl Fn(Lanes) -> Lanes) {
    pixels.clear();
    let mut low = until(edges(0));
    for lane in 0..lanes {
        let next = until(edges(lane + 1));
        let high = Lanes(std::array::from_fn(|own| match own + 1 {
            LANES => next.0[0],
            following => low.0[following],
        }));
        pixels.push(high - low);
        low = next;
    }
}

#[cfg(test)]
mod tests {
    use super::super::ellipse::Axes;
    use super::*;

    /// The same by brute force: samples of the ellipse, blurred and integrated one by one.
    fn sampled(ellipse: &Ellipse, sigma: f64, pixel: Vector2<f64>) -> f64 {
        use statrs::function::erf::erf;
        const FINE: usize = 400;
        let half = ellipse.half_extent();
        let law = |place: f64| 0.5 * erf(place / (sigma * 2.0_f64.sqrt()));
        let share = |from: f64| law(from + 0.5) - law(from - 0.5);
        let mut sum = 0.0;
        for row in 0..FINE {
            for column in 0..FINE {
                let at = |step: usize| (step as f64 + 0.5) / FINE as f64 * 2.0 - 1.0;
                let place = ellipse.centre + Vector2::new(at(column) * half.x, at(row) * half.y);
                if ellipse.level(place) <= 1.0 {
                    sum += share(pixel.x - place.x) * share(pixel.y - place.y);
                }
            }
        }
        sum * 4.0 * half.x * half.y / (FINE * FINE) as f64
    }

    #[test]
    fn shares_are_those_of_brute_force() {
        /// The outline goes through the samples as it happens: a row of them more or less.
        const LEFT_BY_SAMPLES: f64 = 1e-3;
        for (major, minor, blur) in [(4.0, 1.4, 0.58), (2.5, 2.5, 0.85), (6.0, 3.0, 2.0)] {
            let axes = Axes {
                major,
                minor,
                angle: 0.5,
            };
            let ellipse = Ellipse::from_axes(Vector2::new(0.23, -0.41), axes);
            let mut shares = Shares::default();
            shares.fill(&ellipse, blur, [-11.0, -10.0], [11.0, 10.0]);
            let sigma = (blur * blur - VARIANCE_OF_PIXEL).sqrt();
            for pixel in [
                [0.0, 0.0],
                [2.0, 1.0],
                [-3.0, -2.0],
                [4.0, 3.0],
                [1.0, -2.0],
                [11.0, 10.0],
            ] {
                let found = f64::from(shares.at(pixel[0], pixel[1]));
                let expected = sampled(
                    &ellipse,
                    sigma,
                    Vector2::new(pixel[0].into(), pixel[1].into()),
                );
                assert!(
                    (found - expected).abs() < LEFT_BY_SAMPLES,
                    "{axes:?} {pixel:?}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn all_light_arrives() {
        let axes = Axes {
            major: 5.0,
            minor: 2.0,
            angle: 1.1,
        };
        let ellipse = Ellipse::from_axes(Vector2::new(0.4, 0.1), axes);
        let mut shares = Shares::default();
        shares.fill(&ellipse, 1.0, [-12.0, -12.0], [12.0, 12.0]);
        let total: f32 = (-12..=12)
            .flat_map(|row| (-12..=12).map(move |column| (column as f32, row as f32)))
            .map(|(x, y)| shares.at(x, y))
            .sum();
        assert!((f64::from(total) - std::f64::consts::PI * 10.0).abs() < 2e-3);
    }
}
