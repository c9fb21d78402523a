//! How far a fitted centre is to be trusted, from the residuals of its own fit.

use bytemuck::{cast_slice, cast_slice_mut};
use pulp::NullaryFnOnce;

use super::columns::{Columns, FLAT};
use super::fit::{Fit, Normal};
use super::lanes::{LANES, Lanes, run};
use super::profile::{PARAMETERS, Parameters};

/// How far a fit is to be trusted.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Trust {
    /// Standard error of the centre, rms over x and y, px: from the residuals where the centre takes its information.
    pub(super) sigma_px: f64,
    /// Root mean square residual over the dot and its edge, with their redundancy.
    pub(super) dot_residual: f64,
    /// That redundancy.
    pub(super) dot_redundancy: f64,
    /// How many times larger the variance of the centre is than independent residuals would make it.
    pub(super) dependence: f64,
}

/// Sectors of the edge within which residuals may hang together.
const SECTORS: usize = 8;

/// Lanes that hold a number for every parameter.
const PADDED: usize = PARAMETERS.div_ceil(LANES);

/// Sums over one sector of the edge: what its residuals do to the centre, and what they would do if they were independent.
#[derive(Clone, Copy)]
struct Sector {
    moved: [f64; 2],
    squares: [f64; 2],
    /// Derivatives weighted as the residuals are: the fit has taken this much out of them.
    taken: [[Lanes; PADDED]; 2],
}

impl Sector {
    fn empty() -> Self {
        Self {
            moved: [0.0; 2],
            squares: [0.0; 2],
            taken: [[Lanes::ZERO; PADDED]; 2],
        }
    }
}

/// Residuals hang together along the edge where the noise does (resampled, compressed or sharpened pictures), and
/// under shadows, dirt and shapes that are no ellipse. Their effects on the centre are summed in sectors; the ratio to
/// what independent residuals of the same fit would give has the expectation 1, or more where they hang together.
fn dependence(sectors: &[Sector; SECTORS], cofactor: &Normal, variance: f64) -> f64 {
    let (mut together, mut apart) = (0.0, 0.0);
    for sector in sectors {
        for axis in 0..2 {
            together += sector.moved[axis].powi(2);
            let taken: &[f32] = cast_slice(&sector.taken[axis]);
            let taken = Parameters::from_fn(|parameter, _| f64::from(taken[parameter]));
            apart += sector.squares[axis] - taken.dot(&(cofactor * taken));
        }
    }
    if apart > 0.0 && variance > 0.0 {
        together / (apart * variance)
    } else {
        1.0
    }
}

/// The sector in which a direction from the centre lies: octants.
fn sector(x: f32, y: f32) -> usize {
    usize::from(y < 0.0) * 4 + usize::from(x < 0.0) * 2 + usize::from(x.abs() < y.abs())
}

/// A pixel that the fit takes up wholly says nothing of the noise.
const LEAST_REDUNDANCY: f64 = 0.05;

/// Variance of the centre with the residuals in place of an assumed noise (White, 1980, in the form HC2 of MacKinnon
/// and White, 1985: squared residuals divided by their redundancy): a bright dot is noisier than its background, and a textured
/// background says nothing of the edge. The columns are as the fit left them.
pub(super) fn trust(pixels: &Columns, fit: &Fit, leverage: &mut Leverage) -> Option<Trust> {
    /// The variance from residuals where they act is blended with the one from their mean over the dot and its edge,
    /// which has fewer assumptions against it but three times the scatter.
    const SHARE_BY_PLACE: f64 = 0.3;
    /// Variance of rounding to whole grey values.
    const ROUNDING: f64 = 1.0 / 12.0;
    let cofactor = fit.cofactor()?;
    leverage.fill(pixels, fit, &cofactor);
    let Leverage {
        projected, whole, ..
    } = leverage;
    let centre = fit.profile.ellipse().centre;
    let (centre_x, centre_y) = (centre.x as f32, centre.y as f32);
    let mut sectors = [Sector::empty(); SECTORS];
    let mut variance = [0.0; 2];
    let (mut dot_redundancy, mut dot_squares) = (0.0, 0.0);
    let [xs, ys] = pixels.places();
    let [blurs, counts, misfits]: [&[f32]; 3] =
        [pixels.blurs(), pixels.counts(), pixels.misfits()].map(cast_slice);
    let [shift_x, shift_y, whole]: [&[f32]; 3] =
        [&projected[0], &projected[1], &*whole].map(|column| cast_slice(column));
    let by: [&[f32]; PARAMETERS] =
        std::array::from_fn(|parameter| cast_slice(pixels.by(parameter)));
    for slot in 0..pixels.len() {
        if blurs[slot] < -FLAT || counts[slot] == 0.0 {
            continue;
        }
        let misfit = f64::from(misfits[slot]);
        let square = misfit * misfit;
        let redundancy = (1.0 - f64::from(whole[slot])).max(LEAST_REDUNDANCY);
        dot_redundancy += redundancy;
        dot_squares += square;
        let together = &mut sectors[sector(xs[slot] - centre_x, ys[slot] - centre_y)];
        let mut derivatives = [Lanes::ZERO; PADDED];
        for (derivative, by) in cast_slice_mut(&mut derivatives).iter_mut().zip(&by) {
            *derivative = by[slot];
        }
        for (axis, shift) in [shift_x[slot], shift_y[slot]].into_iter().enumerate() {
            let weight = f64::from(shift);
            together.moved[axis] += weight * misfit;
            together.squares[axis] += weight * weight;
            for (taken, &derivatives) in together.taken[axis].iter_mut().zip(&derivatives) {
                *taken += Lanes::splat(shift) * derivatives;
            }
            variance[axis] += weight * weight * square / redundancy;
        }
    }
    if dot_redundancy <= 0.0 {
        return None;
    }
    let even = (dot_squares / dot_redundancy).max(ROUNDING);
    let blended: f64 = (0..2)
        .map(|axis| {
            SHARE_BY_PLACE * variance[axis] + (1.0 - SHARE_BY_PLACE) * even * cofactor[(axis, axis)]
        })
        .sum();
    let mean = 0.5 * blended;
    Some(Trust {
        sigma_px: mean.sqrt(),
        dependence: dependence(&sectors, &cofactor, even),
        dot_residual: (dot_squares / dot_redundancy).sqrt(),
        dot_redundancy,
    })
}

/// What each pixel does to the fit; kept from dot to dot, so that its columns are room to work in.
#[derive(Clone, Debug, Default)]
pub(super) struct Leverage {
    /// Shift of the centre by one grey value of the pixel, along x and y.
    projected: [Vec<Lanes>; 2],
    /// Share of the pixel's own misfit that the fit takes up.
    whole: Vec<Lanes>,
    row: Vec<Lanes>,
}

impl Leverage {
    fn fill(&mut self, pixels: &Columns, fit: &Fit, cofactor: &Normal) {
        let Self {
            projected,
            whole,
            row,
        } = self;
        let lanes = pixels.by(0).len();
        whole.clear();
        whole.resize(lanes, Lanes::ZERO);
        row.resize(lanes, Lanes::ZERO);
        for &i in fit.parameters() {
            let mut terms = [(0.0, &[][..]); PARAMETERS];
            let count = fit.parameters().len();
            for (term, &j) in terms.iter_mut().zip(fit.parameters()) {
                *term = (cofactor[(i, j)] as f32, pixels.by(j));
            }
            run(Combination {
                terms: &terms[..count],
                sum: row,
                own: pixels.by(i),
                whole,
            });
            if let Some(axis) = projected.get_mut(i) {
                axis.clone_from(row);
            }
        }
    }
}

/// Sums multiples of columns, and adds the sum times a parameter's own column.
struct Combination<'a> {
    terms: &'a [(f32, &'a [Lanes])],
    sum: &'a mut [Lanes],
    own: &'a [Lanes],
    whole: &'a mut [Lanes],
}

impl NullaryFnOnce for Combination<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let sums = self
            .sum
            .iter_mut()
            .zip(self.own)
            .zip(self.whole)
            .enumerate();
        for (lane, ((sum, &own), whole)) in sums {
            let mut total = Lanes::ZERO;
            for &(factor, column) in self.terms {
                total += Lanes::splat(factor) * column[lane];
            }
            *sum = total;
            *whole += own * total;
        }
    }
}
