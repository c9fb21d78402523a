//! Least squares on the exact picture of a dot whose ellipse and blur are known beforehand.

use nalgebra::{SMatrix, SVector, Vector2};

use super::super::ellipse::{Axes, Ellipse};
use super::super::exact::Shares;
use super::filter::{Best, template};
use super::patch::{LEAST_PIXELS, Misfit, Patch, Pixel};

/// The ellipse and the blur of an expected dot, as observations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Observed {
    pub(super) axes: Axes,
    /// Standard deviation of the edge's blur, px.
    pub(super) blur: f64,
    /// Standard deviations of the semi-axes, as shares of them: larger, smaller.
    pub(super) axes_sigma: [f64; 2],
    /// Of the direction, radians.
    pub(super) angle_sigma: f64,
    /// Of the blur, as a share.
    pub(super) blur_sigma: f64,
}

impl Observed {
    /// With its centre at the origin.
    pub(super) fn ellipse(&self) -> Ellipse {
        Ellipse::from_axes(Vector2::zeros(), self.axes)
    }
}

/// Centre x, y; logarithms of the semi-axes; direction; logarithm of the blur; ground and its slopes along x, y; logarithm of
/// the blur of the neighbours' tails, from what they were computed with; amplitude and its slopes along x, y.
const PARAMETERS: usize = 13;
const AXES: usize = 2;
const ANGLE: usize = 4;
const BLUR: usize = 5;
const GROUND: usize = 6;
const TAILS: usize = 9;
const AMPLITUDE: usize = 10;
/// Those that are observed.
const KNOWN: [usize; 5] = [AXES, AXES + 1, ANGLE, BLUR, TAILS];
/// Those that change the dot's picture other than in proportion.
const SHAPING: usize = 6;
/// The weight of a parameter that is held at its value: far more than pixels have.
const HELD: f64 = 1e12;

type Parameters = SVector<f64, PARAMETERS>;
type Normal = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// A fit that comes to no rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Lost {
    /// The centre left the pixels for what shines beside them: so far from the predicted centre, px.
    Left(Vector2<f64>),
    Nowhere,
}

/// A fit at rest.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Estimate {
    /// Relative to the predicted centre.
    pub(super) ellipse: Ellipse,
    pub(super) blur: f64,
    pub(super) contrast: f64,
    pub(super) background: f64,
    /// Standard error of the centre, rms over x and y, px.
    pub(super) sigma_px: f64,
    /// Root mean square residual over the dot and its edge, with their redundancy.
    pub(super) residual: f64,
    pub(super) redundancy: f64,
    /// Largest departure of a diameter or the direction from what was observed, in its sigmas.
    pub(super) departure: f64,
    pub(super) misfits: Vec<Misfit>,
}

impl Estimate {
    /// With a sigma so many times larger.
    pub(super) fn widened(self, times: f64) -> Self {
        Self {
            sigma_px: times * self.sigma_px,
            ..self
        }
    }

    /// Full diameters, larger first, px.
    pub(super) fn diameters(&self) -> [f64; 2] {
        let axes = self.ellipse.axes();
        axes.map_or([0.0; 2], |axes| [2.0 * axes.major, 2.0 * axes.minor])
    }
}

/// The observed values of the parameters and the weights of their squared departures, for residuals in grey values.
struct Known {
    values: Parameters,
    weights: Parameters,
}

impl Known {
    fn of(observed: &Observed, patch: &Patch) -> Self {
        let (mut values, mut weights) = (Parameters::zeros(), Parameters::zeros());
        let observations = [
            (AXES, observed.axes.major.ln(), observed.axes_sigma[0]),
            (AXES + 1, observed.axes.minor.ln(), observed.axes_sigma[1]),
            (ANGLE, observed.axes.angle, observed.angle_sigma),
            (BLUR, observed.blur.ln(), observed.blur_sigma),
            (TAILS, 0.0, patch.tails_sigma),
        ];
        for (parameter, value, sigma) in observations {
            values[parameter] = value;
            weights[parameter] = (patch.noise / sigma).powi(2);
        }
        weights.rows_mut(AMPLITUDE + 1, 2).fill(HELD);
        Self { values, weights }
    }

    fn cost(&self, parameters: &Parameters) -> f64 {
        let departures = parameters - self.values;
        departures.component_mul(&departures).dot(&self.weights)
    }
}

fn ellipse_of(p: &Parameters) -> Ellipse {
    let axes = Axes {
        major: p[AXES].exp(),
        minor: p[AXES + 1].exp(),
        angle: p[ANGLE],
    };
    Ellipse::from_axes(Vector2::new(p[0], p[1]), axes)
}

/// The dot's picture and what is left of the grey values.
#[derive(Clone)]
struct Misfits {
    shares: Vec<f64>,
    /// 0 where the pixel is clipped and the dot as bright.
    residuals: Vec<f64>,
    counts: Vec<f64>,
    cost: f64,
}

struct Problem<'a> {
    patch: &'a Patch,
    known: Known,
    shares: Shares,
}

impl Problem<'_> {
    fn shares(&mut self, p: &Parameters) -> Vec<f64> {
        template(self.patch, &ellipse_of(p), p[BLUR].exp(), &mut self.shares)
    }

    fn misfits(&mut self, p: &Parameters) -> Misfits {
        let shares = self.shares(p);
        let mut misfits = Misfits {
            residuals: Vec::with_capacity(shares.len()),
            counts: Vec::with_capacity(shares.len()),
            cost: self.known.cost(p),
            shares,
        };
        for (pixel, share) in self.patch.pixels.iter().zip(&misfits.shares) {
            let value = value(pixel, *share, p);
            let is_clipped = value >= pixel.clips_at;
            let residual = if is_clipped { 0.0 } else { pixel.grey - value };
            misfits.counts.push(if is_clipped { 0.0 } else { 1.0 });
            misfits.residuals.push(residual);
            misfits.cost += residual * residual;
        }
        misfits
    }

    /// Derivatives of the dot's picture by what shapes it, as shares of the amplitude.
    fn derivatives(&mut self, p: &Parameters, shares: &[f64]) -> Vec<[f64; SHAPING]> {
        /// Of the centre, px, both ways; of logarithms and the direction, one way.
        const STEP: f64 = 0.05;
        let mut derivatives = vec![[0.0; SHAPING]; shares.len()];
        for parameter in 0..SHAPING {
            let moved = |step: f64| {
                let mut moved = *p;
                moved[parameter] += step;
                moved
            };
            let high = self.shares(&moved(STEP));
            let (low, width) = match parameter < AXES {
                true => (&self.shares(&moved(-STEP))[..], 2.0 * STEP),
                false => (shares, STEP),
            };
            for (slot, row) in derivatives.iter_mut().enumerate() {
                row[parameter] = (high[slot] - low[slot]) / width;
            }
        }
        derivatives
    }
}

fn value(pixel: &Pixel, share: f64, p: &Parameters) -> f64 {
    let ground = plane(p, GROUND, pixel.place) + p[TAILS] * pixel.by_tails;
    ground + plane(p, AMPLITUDE, pixel.place) * share
}

/// A parameter with its slopes behind it, at a place.
fn plane(p: &Parameters, first: usize, place: Vector2<f64>) -> f64 {
    p[first] + p[first + 1] * place.x + p[first + 2] * place.y
}

/// The linear equations at a place.
struct Linear {
    rows: Vec<Parameters>,
    normal: Normal,
}

impl Linear {
    fn of(problem: &mut Problem, p: &Parameters, misfits: &Misfits) -> Self {
        /// Less of the dot's light tells nothing of it.
        const DARK: f64 = 1e-7;
        let derivatives = problem.derivatives(p, &misfits.shares);
        let mut normal = Normal::from_diagonal(&problem.known.weights);
        let mut rows = Vec::with_capacity(derivatives.len());
        for (slot, (pixel, shaping)) in problem.patch.pixels.iter().zip(&derivatives).enumerate() {
            let mut row = Parameters::zeros();
            row[GROUND] = 1.0;
            row[GROUND + 1] = pixel.place.x;
            row[GROUND + 2] = pixel.place.y;
            row[TAILS] = pixel.by_tails;
            let share = misfits.shares[slot];
            let used = match share > DARK {
                true => {
                    let amplitude = plane(p, AMPLITUDE, pixel.place);
                    for (value, &derivative) in row.iter_mut().zip(shaping) {
                        *value = amplitude * derivative;
                    }
                    row[AMPLITUDE] = share;
                    row[AMPLITUDE + 1] = share * pixel.place.x;
                    row[AMPLITUDE + 2] = share * pixel.place.y;
                    0..PARAMETERS
                }
                false => GROUND..AMPLITUDE,
            };
            row *= misfits.counts[slot];
            for i in used.clone() {
                for j in used.start..=i {
                    normal[(i, j)] += row[i] * row[j];
                }
            }
            rows.push(row);
        }
        normal.fill_upper_triangle_with_lower_triangle();
        Self { rows, normal }
    }

    fn step(&self, known: &Known, p: &Parameters, misfits: &Misfits) -> Option<Parameters> {
        let mut right = (known.values - p).component_mul(&known.weights);
        for (row, residual) in self.rows.iter().zip(&misfits.residuals) {
            right += row * *residual;
        }
        let step = self.cofactor()? * right;
        step.iter().all(|value| value.is_finite()).then_some(step)
    }

    /// The inverse, by equations of unit diagonal.
    fn cofactor(&self) -> Option<Normal> {
        let scale = self.normal.diagonal().map(|value| value.sqrt().recip());
        let scaling = Normal::from_diagonal(&scale);
        let inverse = (scaling * self.normal * scaling).cholesky()?.inverse();
        Some(scaling * inverse * scaling)
    }
}

/// Fits the dot from the best place of the search.
pub(super) fn estimate(patch: &Patch, observed: &Observed, best: &Best) -> Result<Estimate, Lost> {
    /// A slope of the amplitude is told from a shift when the smaller semi-axis is this many blurs, as in detection.
    const CORE_FOR_SLOPE: f64 = 5.0;
    /// Two more parameters must explain this much more than noise would (F test), as in detection.
    const LEAST_F: f64 = 10.0;
    if patch.pixels.len() < LEAST_PIXELS {
        return Err(Lost::Nowhere);
    }
    let mut problem = Problem {
        patch,
        known: Known::of(observed, patch),
        shares: Shares::default(),
    };
    let mut start = problem.known.values;
    start[0] = best.shift.x;
    start[1] = best.shift.y;
    for (slot, &value) in best.nuisance.iter().enumerate() {
        start[GROUND + slot] = value;
    }
    start[AMPLITUDE] = best.amplitude;
    let even = problem.minimum(start)?;
    let held = problem.known.weights;
    problem.known.weights.rows_mut(AMPLITUDE + 1, 2).fill(0.0);
    let is_large = observed.axes.minor >= CORE_FOR_SLOPE * observed.blur;
    let sloping = is_large
        .then(|| problem.minimum(even.p))
        .and_then(Result::ok);
    let freedom = (patch.pixels.len() - PARAMETERS) as f64;
    let is_real = |sloping: &Minimum| {
        let (before, after) = (even.misfits.cost, sloping.misfits.cost);
        0.5 * (before - after) * freedom > LEAST_F * after
    };
    let minimum = match sloping.filter(is_real) {
        Some(sloping) => sloping,
        None => {
            problem.known.weights = held;
            even
        }
    };
    minimum.estimate(&mut problem).ok_or(Lost::Nowhere)
}

/// Where the squared misfits are least.
struct Minimum {
    p: Parameters,
    misfits: Misfits,
}

impl Problem<'_> {
    fn minimum(&mut self, start: Parameters) -> Result<Minimum, Lost> {
        const MOST_STEPS: usize = 15;
        /// The centre has come to rest, px.
        const REST: f64 = 1e-4;
        /// The equations hold as far from where they were made, px or as a share.
        const SAME: f64 = 0.05;
        let mut p = start;
        let mut misfits = self.misfits(&p);
        let mut linear = Linear::of(self, &p, &misfits);
        let mut made_at = p;
        for _ in 0..MOST_STEPS {
            let step = linear.step(&self.known, &p, &misfits);
            let step = step.ok_or(Lost::Nowhere)?;
            let Some((next, tried)) = stepped(self, &p, &step, misfits.cost) else {
                break;
            };
            let moved = (next - p).xy().norm();
            (p, misfits) = (next, tried);
            if p.xy().norm() > self.patch.reach {
                return Err(Lost::Left(p.xy()));
            }
            if moved < REST {
                break;
            }
            if (p - made_at).rows(0, ANGLE).amax() > SAME {
                linear = Linear::of(self, &p, &misfits);
                made_at = p;
            }
        }
        match p[AMPLITUDE] > 0.0 {
            true => Ok(Minimum { p, misfits }),
            false => Err(Lost::Nowhere),
        }
    }
}

/// The parameters after as much of a step as makes the misfit no larger; `None` where none does.
fn stepped(
    problem: &mut Problem,
    p: &Parameters,
    step: &Parameters,
    cost: f64,
) -> Option<(Parameters, Misfits)> {
    const HALVINGS: usize = 6;
    /// The centre does not move farther at once, px; nor any logarithm or direction.
    const LONGEST: [f64; 2] = [1.0, 0.3];
    let longest = step.rows(AXES, SHAPING - AXES).amax() / LONGEST[1];
    let mut factor = (step.xy().norm() / LONGEST[0])
        .max(longest)
        .max(1.0)
        .recip();
    for _ in 0..HALVINGS {
        let next = p + step * factor;
        let tried = problem.misfits(&next);
        if tried.cost <= cost {
            return Some((next, tried));
        }
        factor *= 0.5;
    }
    None
}

impl Minimum {
    /// The estimate with what its residuals say of it (as in [`super::super::trust`]).
    fn estimate(self, problem: &mut Problem) -> Option<Estimate> {
        /// The dot and its edge: shares of the amplitude above this, or a derivative by the centre that counts.
        const NEAR: f64 = 1e-4;
        let Self { p, misfits } = self;
        let linear = Linear::of(problem, &p, &misfits);
        let cofactor = linear.cofactor()?;
        let mut sums = Sums::default();
        for (slot, row) in linear.rows.iter().enumerate() {
            if misfits.counts[slot] == 0.0 || misfits.shares[slot] < NEAR {
                continue;
            }
            sums.take(row, misfits.residuals[slot], &cofactor);
        }
        let departures = (p - problem.known.values).abs();
        let sigmas =
            |parameter: usize| problem.patch.noise / problem.known.weights[parameter].sqrt();
        let pairs = misfits.shares.iter().zip(&misfits.residuals);
        // Not the blur: out of focus a dot is still a dot.
        let departure = (AXES..=ANGLE)
            .map(|parameter| departures[parameter] / sigmas(parameter))
            .fold(0.0, f64::max);
        Some(Estimate {
            ellipse: ellipse_of(&p),
            blur: p[BLUR].exp(),
            contrast: plane(&p, AMPLITUDE, p.xy()),
            background: plane(&p, GROUND, p.xy()),
            sigma_px: sums.sigma(problem, &cofactor),
            residual: (sums.squares / sums.redundancy.max(1.0)).sqrt(),
            redundancy: sums.redundancy,
            departure,
            misfits: pairs
                .map(|(&share, &residual)| Misfit { share, residual })
                .collect(),
        })
    }
}

/// Sums over the dot and its edge.
#[derive(Default)]
struct Sums {
    squares: f64,
    redundancy: f64,
    /// Variance of the centre along x and y by the residuals where they act.
    by_place: [f64; 2],
}

impl Sums {
    fn take(&mut self, row: &Parameters, residual: f64, cofactor: &Normal) {
        /// A pixel that the fit takes up wholly says nothing of the noise.
        const LEAST_REDUNDANCY: f64 = 0.05;
        let effect = cofactor * row;
        let redundancy = (1.0 - row.dot(&effect)).max(LEAST_REDUNDANCY);
        self.squares += residual * residual;
        self.redundancy += redundancy;
        for axis in 0..2 {
            self.by_place[axis] += (effect[axis] * residual).powi(2) / redundancy;
        }
    }

    /// Residuals where they act (HC2: MacKinnon and White, 1985), blended with their mean over the dot and its edge and, worth
    /// some pixels, the noise of the place; what the ellipse, the blur and the tails are uncertain by comes on top.
    fn sigma(&self, problem: &Problem, cofactor: &Normal) -> f64 {
        const SHARE_BY_PLACE: f64 = 0.3;
        const NOISE_PIXELS: f64 = 20.0;
        let noise = problem.patch.noise.powi(2);
        let even = (self.squares + NOISE_PIXELS * noise) / (self.redundancy + NOISE_PIXELS);
        let variance = |axis: usize| {
            let by_known: f64 = KNOWN
                .iter()
                .map(|&known| cofactor[(axis, known)].powi(2) * problem.known.weights[known])
                .sum();
            let by_pixels = cofactor[(axis, axis)] - by_known;
            SHARE_BY_PLACE * self.by_place[axis]
                + (1.0 - SHARE_BY_PLACE) * even * by_pixels
                + noise * by_known
        };
        (0.5 * (variance(0) + variance(1))).sqrt()
    }
}
