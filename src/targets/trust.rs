//! How far a fitted centre is to be trusted, from the residuals of its own fit.

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

/// Sums over one sector of the edge: what its residuals do to the centre, and what they would do if they were independent.
#[derive(Clone, Copy)]
struct Sector {
    moved: [Lanes; 2],
    squares: [Lanes; 2],
    /// Derivatives weighted as the residuals are: the fit has taken this much out of them.
    taken: [[Lanes; PARAMETERS]; 2],
}

impl Sector {
    const EMPTY: Self = Self {
        moved: [Lanes::ZERO; 2],
        squares: [Lanes::ZERO; 2],
        taken: [[Lanes::ZERO; PARAMETERS]; 2],
    };
}

/// Residuals hang together along the edge where the noise does (resampled, compressed or sharpened pictures), and
/// under shadows, dirt and shapes that are no ellipse. Their effects on the centre are summed in sectors; the ratio to
/// what independent residuals of the same fit would give has the expectation 1, or more where they hang together.
fn dependence(
    sectors: &[Sector; SECTORS],
    parameters: &[usize],
    cofactor: &Normal,
    variance: f64,
) -> f64 {
    let (mut together, mut apart) = (0.0, 0.0);
    for sector in sectors {
        for axis in 0..2 {
            together += sector.moved[axis].sum().powi(2);
            let mut taken = Parameters::zeros();
            for (&parameter, sum) in parameters.iter().zip(&sector.taken[axis]) {
                taken[parameter] = sum.sum();
            }
            apart += sector.squares[axis].sum() - taken.dot(&(cofactor * taken));
        }
    }
    if apart > 0.0 && variance > 0.0 {
        together / (apart * variance)
    } else {
        1.0
    }
}

/// A pixel that the fit takes up wholly says nothing of the noise.
const LEAST_REDUNDANCY: f32 = 0.05;

/// Variance of the centre with the residuals in place of an assumed noise (White, 1980, in the form HC2 of MacKinnon
/// and White, 1985: squared residuals divided by their redundancy): a bright dot is noisier than its background, and a textured
/// background says nothing of the edge. The columns are as the fit left them.
pub(super) fn trust(pixels: &Columns, fit: &Fit) -> Option<Trust> {
    /// The variance from residuals where they act is blended with the one from their mean over the dot and its edge,
    /// which has fewer assumptions against it but three times the scatter.
    const SHARE_BY_PLACE: f64 = 0.3;
    /// Variance of rounding to whole grey values.
    const ROUNDING: f64 = 1.0 / 12.0;
    let cofactor = fit.cofactor()?;
    let parameters = fit.parameters();
    let centre = fit.profile.ellipse().centre;
    let sums = run(Summation {
        pixels,
        parameters,
        cofactor: &cofactor,
        centre: [centre.x, centre.y].map(|place| Lanes::splat(place as f32)),
    });
    let [dot_redundancy, dot_squares] = [sums.redundancy, sums.squares].map(Lanes::sum);
    if dot_redundancy <= 0.0 {
        return None;
    }
    let even = (dot_squares / dot_redundancy).max(ROUNDING);
    let blended: f64 = (0..2)
        .map(|axis| {
            SHARE_BY_PLACE * sums.variance[axis].sum()
                + (1.0 - SHARE_BY_PLACE) * even * cofactor[(axis, axis)]
        })
        .sum();
    let mean = 0.5 * blended;
    Some(Trust {
        sigma_px: mean.sqrt(),
        dependence: dependence(&sums.sectors, parameters, &cofactor, even),
        dot_residual: (dot_squares / dot_redundancy).sqrt(),
        dot_redundancy,
    })
}

/// Sums over the dot and its edge.
struct Sums {
    sectors: [Sector; SECTORS],
    variance: [Lanes; 2],
    redundancy: Lanes,
    squares: Lanes,
}

struct Summation<'a> {
    pixels: &'a Columns,
    /// Those that the fit moved; the centre comes first.
    parameters: &'a [usize],
    cofactor: &'a Normal,
    centre: [Lanes; 2],
}

/// What eight pixels do to the fit.
struct Effect {
    /// Shift of the centre by one grey value of the pixel, along x and y.
    shift: [Lanes; 2],
    /// Share of the pixel's own misfit that the fit takes up.
    whole: Lanes,
}

impl Effect {
    /// From the derivatives; of the symmetric cofactor the upper half is enough.
    #[inline(always)]
    fn of(derivatives: &[Lanes], cofactor: &[[f32; PARAMETERS]; PARAMETERS]) -> Self {
        let mut shift = [Lanes::ZERO; 2];
        let mut whole = Lanes::ZERO;
        for (parameter, (row, &own)) in cofactor.iter().zip(derivatives).enumerate() {
            let mut later = Lanes::ZERO;
            let terms = row.iter().zip(derivatives).skip(parameter + 1);
            for (&factor, &derivative) in terms {
                later += Lanes::splat(factor) * derivative;
            }
            let diagonal = Lanes::splat(row[parameter]) * own;
            whole += own * (diagonal + later + later);
            if let Some(shift) = shift.get_mut(parameter) {
                *shift = diagonal + later;
            }
        }
        shift[1] += Lanes::splat(cofactor[1][0]) * derivatives[0];
        Self { shift, whole }
    }
}

/// The sectors in which directions from the centre lie: octants.
#[inline(always)]
fn sectors_of(x: Lanes, y: Lanes) -> [u32; LANES] {
    let mut sectors = [0; LANES];
    for (sector, (x, y)) in sectors.iter_mut().zip(x.0.into_iter().zip(y.0)) {
        *sector = u32::from(y < 0.0) << 2 | u32::from(x < 0.0) << 1 | u32::from(x.abs() < y.abs());
    }
    sectors
}

impl NullaryFnOnce for Summation<'_> {
    type Output = Sums;

    #[inline(always)]
    fn call(self) -> Sums {
        let mut sums = Sums {
            sectors: [Sector::EMPTY; SECTORS],
            variance: [Lanes::ZERO; 2],
            redundancy: Lanes::ZERO,
            squares: Lanes::ZERO,
        };
        let mut cofactor = [[0.0; PARAMETERS]; PARAMETERS];
        for (row, &i) in cofactor.iter_mut().zip(self.parameters) {
            for (factor, &j) in row.iter_mut().zip(self.parameters) {
                *factor = self.cofactor[(i, j)] as f32;
            }
        }
        let mut columns = [&[][..]; PARAMETERS];
        for (column, &parameter) in columns.iter_mut().zip(self.parameters) {
            *column = self.pixels.by(parameter);
        }
        let columns = &columns[..self.parameters.len()];
        let [xs, ys] = self.pixels.places().map(|places| places.as_chunks().0);
        let (blurs, counts) = (self.pixels.blurs(), self.pixels.counts());
        let misfits = self.pixels.misfits();
        for lane in 0..misfits.len() {
            let edge = |blurs: f32, counts: f32| if blurs < -FLAT { 0.0 } else { counts };
            let near = blurs[lane].zip(counts[lane], edge);
            if near == Lanes::ZERO {
                continue;
            }
            let mut derivatives = [Lanes::ZERO; PARAMETERS];
            for (derivative, column) in derivatives.iter_mut().zip(columns) {
                *derivative = column[lane];
            }
            let derivatives = &derivatives[..columns.len()];
            let Effect { shift, whole } = Effect::of(derivatives, &cofactor);
            let shift = [near * shift[0], near * shift[1]];
            let misfit = misfits[lane];
            let square = near * misfit * misfit;
            let redundancy =
                (Lanes::ONE - whole).map(|redundancy| redundancy.max(LEAST_REDUNDANCY));
            sums.redundancy += near * redundancy;
            sums.squares += square;
            let variance = square / redundancy;
            for (sum, &shift) in sums.variance.iter_mut().zip(&shift) {
                *sum += shift * shift * variance;
            }
            let [x, y] = [xs[lane], ys[lane]].map(Lanes);
            let sectors = sectors_of(x - self.centre[0], y - self.centre[1]);
            let mut present = 0;
            for (&sector, &near) in sectors.iter().zip(&near.0) {
                present |= u32::from(near != 0.0).wrapping_shl(sector);
            }
            // A stretch of a row goes through few of them.
            while present != 0 {
                let sector = present.trailing_zeros();
                present &= present - 1;
                let mut own = Lanes::ZERO;
                for (own, &other) in own.0.iter_mut().zip(&sectors) {
                    *own = if other == sector { 1.0 } else { 0.0 };
                }
                let together = &mut sums.sectors[sector as usize];
                for axis in 0..2 {
                    let shift = own * shift[axis];
                    together.moved[axis] += shift * misfit;
                    together.squares[axis] += shift * shift;
                    for (sum, &derivative) in together.taken[axis].iter_mut().zip(derivatives) {
                        *sum += shift * derivative;
                    }
                }
            }
        }
        sums
    }
}
