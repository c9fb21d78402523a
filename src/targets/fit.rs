//! Least-squares fit of a dot's profile by Levenberg-Marquardt steps.

use nalgebra::{SMatrix, Vector2};

use super::profile::{BLUR, PARAMETERS, Parameters, Profile, Zone};
use super::window::Pixel;

type Normal = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// Which parameters a fit may move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Freedom {
    /// Even background, even amplitude: for dots of which only a narrow dark rim is seen.
    Rimmed,
    /// Sloping background, even amplitude: for dots of few pixels, where a slope of the amplitude cannot be told from a shift.
    Even,
    /// Sloping background and amplitude: light falls off across the dot.
    Sloping,
}

impl Freedom {
    fn moves(self, parameter: usize) -> bool {
        match self {
            Freedom::Rimmed => !matches!(parameter, 7 | 8 | 10 | 11),
            Freedom::Even => parameter < 10,
            Freedom::Sloping => true,
        }
    }

    fn count(self) -> usize {
        (0..PARAMETERS)
            .filter(|&parameter| self.moves(parameter))
            .count()
    }
}

/// A fitted profile and how well it fits.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fit {
    pub(super) profile: Profile,
    /// Root mean square residual of all pixels, with their redundancy.
    pub(super) residual: f64,
    /// The pixels that were used, without clipped ones.
    pub(super) used: usize,
    freedom: Freedom,
    normal: Normal,
}

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

/// The profile is as narrow as a pixel's own width at least (1/sqrt(12) px), less a little.
const LEAST_BLUR: f64 = 0.27;
const MOST_STEPS: usize = 25;
/// How near to the minimum a fit goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rest {
    /// Near enough to start another fit from.
    Rough,
    /// Far below the noise.
    Fine,
}

impl Rest {
    /// The centre has come to rest when it moves less than this, px.
    fn step(self) -> f64 {
        match self {
            Rest::Rough => 5e-3,
            Rest::Fine => 1e-4,
        }
    }
}

struct Equations {
    normal: Normal,
    right: Parameters,
    cost: f64,
    used: usize,
}

/// Fits the profile to the pixels; `None` where no dot's profile can be fitted. Pixels at or above `clipping` only
/// say that the dot is at least as bright.
pub(super) fn fit(
    pixels: &[Pixel],
    start: Profile,
    freedom: Freedom,
    rest: Rest,
    clipping: Option<f64>,
) -> Option<Fit> {
    let at_rest = rest.step();
    let mut profile = start;
    let mut equations = build(pixels, &profile, freedom, clipping);
    let mut damping = 1e-3;
    let mut steps = 0;
    loop {
        steps += 1;
        if steps > MOST_STEPS {
            return None;
        }
        let step = solve(&equations, damping)?;
        let mut next = profile;
        next.parameters += step;
        next.parameters[BLUR] = next.parameters[BLUR].max(LEAST_BLUR);
        let tried = next
            .ellipse()
            .axes()
            .map(|_| build(pixels, &next, freedom, clipping));
        match tried {
            Some(tried) if tried.cost <= equations.cost => {
                let gain = equations.cost - tried.cost;
                profile = next;
                let small_gain = gain <= 1e-6 * tried.cost;
                equations = tried;
                damping *= 0.1;
                if step[0].hypot(step[1]) < at_rest
                    || (small_gain && step[0].hypot(step[1]) < 10.0 * at_rest)
                {
                    break;
                }
            }
            _ => {
                if step[0].hypot(step[1]) < at_rest {
                    break;
                }
                damping = (damping * 10.0).max(1e-6);
                if damping > 1e8 {
                    return None;
                }
            }
        }
    }
    let redundancy = equations.used as f64 - freedom.count() as f64;
    (redundancy >= 5.0).then(|| Fit {
        profile,
        residual: (equations.cost / redundancy).sqrt(),
        used: equations.used,
        freedom,
        normal: equations.normal,
    })
}

/// Parameters that a pixel of the zone tells of.
fn span(zone: Zone) -> std::ops::Range<usize> {
    match zone {
        Zone::Outside => 6..9,
        Zone::Edge => 0..PARAMETERS,
        Zone::Inside => 6..PARAMETERS,
    }
}

fn is_clipped(grey: f64, model: f64, clipping: Option<f64>) -> bool {
    clipping.is_some_and(|white| grey >= white && model >= white)
}

fn build(
    pixels: &[Pixel],
    profile: &Profile,
    freedom: Freedom,
    clipping: Option<f64>,
) -> Equations {
    let end = if freedom == Freedom::Sloping {
        PARAMETERS
    } else {
        PARAMETERS - 2
    };
    let mut normal = [[0.0; PARAMETERS]; PARAMETERS];
    let mut right = [0.0; PARAMETERS];
    let (mut cost, mut used) = (0.0, 0);
    for pixel in pixels {
        let sample = profile.sample(pixel.place);
        if is_clipped(pixel.grey, sample.value, clipping) {
            continue;
        }
        let misfit = pixel.grey - sample.value;
        cost += misfit * misfit;
        used += 1;
        let span = span(sample.zone);
        for i in span.start..span.end.min(end) {
            let by_i = sample.derivatives[i];
            right[i] += by_i * misfit;
            for (j, sum) in normal[i]
                .iter_mut()
                .enumerate()
                .take(i + 1)
                .skip(span.start)
            {
                *sum += by_i * sample.derivatives[j];
            }
        }
    }
    let normal = Normal::from_fn(|i, j| {
        if !(freedom.moves(i) && freedom.moves(j)) {
            f64::from(u8::from(i == j))
        } else {
            normal[i.max(j)][i.min(j)]
        }
    });
    let right = Parameters::from_fn(|i, _| if freedom.moves(i) { right[i] } else { 0.0 });
    Equations {
        normal,
        right,
        cost,
        used,
    }
}

/// The step of the damped equations, scaled to unit diagonal.
fn solve(equations: &Equations, damping: f64) -> Option<Parameters> {
    let scale = unit_scale(&equations.normal)?;
    let mut scaled = Normal::from_fn(|i, j| equations.normal[(i, j)] * scale[i] * scale[j]);
    for i in 0..PARAMETERS {
        scaled[(i, i)] += damping;
    }
    let right = equations.right.component_mul(&scale);
    let step = scaled.cholesky()?.solve(&right).component_mul(&scale);
    step.iter().all(|value| value.is_finite()).then_some(step)
}

fn unit_scale(normal: &Normal) -> Option<Parameters> {
    let diagonal = normal.diagonal();
    diagonal
        .iter()
        .all(|&value| value > 0.0)
        .then(|| diagonal.map(|value| value.sqrt().recip()))
}

/// Sectors of the edge within which residuals may hang together.
const SECTORS: usize = 8;

/// Sums over one sector of the edge: what its residuals do to the centre, and what they would do if they were independent.
#[derive(Clone, Copy)]
struct Sector {
    moved: [f64; 2],
    squares: [f64; 2],
    /// Derivatives weighted as the residuals are: the fit has taken this much out of them.
    taken: [Parameters; 2],
}

impl Sector {
    fn empty() -> Self {
        Self {
            moved: [0.0; 2],
            squares: [0.0; 2],
            taken: [Parameters::zeros(); 2],
        }
    }

    fn add(&mut self, axis: usize, weight: f64, misfit: f64, derivatives: &Parameters) {
        self.moved[axis] += weight * misfit;
        self.squares[axis] += weight * weight;
        self.taken[axis] += derivatives * weight;
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
            let taken = &sector.taken[axis];
            apart += sector.squares[axis] - taken.dot(&(cofactor * taken));
        }
    }
    if apart > 0.0 && variance > 0.0 {
        together / (apart * variance)
    } else {
        1.0
    }
}

/// The sector in which a direction from the centre lies.
fn sector(from_centre: Vector2<f64>) -> usize {
    let turn = from_centre.y.atan2(from_centre.x) / std::f64::consts::TAU + 0.5;
    ((turn * SECTORS as f64) as usize).min(SECTORS - 1)
}

/// Variance of the centre with the residuals in place of an assumed noise (White, 1980, in the form HC2 of MacKinnon
/// and White, 1985: squared residuals divided by their redundancy): a bright dot is noisier than its background, and a textured
/// background says nothing of the edge.
pub(super) fn trust(pixels: &[Pixel], fit: &Fit, clipping: Option<f64>) -> Option<Trust> {
    /// The variance from residuals where they act is blended with the one from their mean over the dot and its edge,
    /// which has fewer assumptions against it but three times the scatter.
    const SHARE_BY_PLACE: f64 = 0.3;
    /// Variance of rounding to whole grey values.
    const ROUNDING: f64 = 1.0 / 12.0;
    let cofactor = cofactor(fit)?;
    let centre = fit.profile.ellipse().centre;
    let mut variance = [0.0; 2];
    let mut sectors = [Sector::empty(); SECTORS];
    let (mut dot_redundancy, mut dot_squares) = (0.0, 0.0);
    for pixel in pixels {
        let sample = fit.profile.sample(pixel.place);
        if sample.zone == Zone::Outside || is_clipped(pixel.grey, sample.value, clipping) {
            continue;
        }
        let misfit = pixel.grey - sample.value;
        let square = misfit * misfit;
        let projected = cofactor * sample.derivatives;
        let redundancy = (1.0 - projected.dot(&sample.derivatives)).max(0.05);
        dot_redundancy += redundancy;
        dot_squares += square;
        let together = &mut sectors[sector(pixel.place - centre)];
        for axis in 0..2 {
            together.add(axis, projected[axis], misfit, &sample.derivatives);
            variance[axis] += projected[axis].powi(2) * square / redundancy;
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

/// Inverse of the normal equations, zero for parameters that were held.
fn cofactor(fit: &Fit) -> Option<Normal> {
    let scale = unit_scale(&fit.normal)?;
    let scaled = Normal::from_fn(|i, j| fit.normal[(i, j)] * scale[i] * scale[j]);
    let inverse = scaled.cholesky()?.inverse();
    Some(Normal::from_fn(|i, j| {
        if fit.freedom.moves(i) && fit.freedom.moves(j) {
            inverse[(i, j)] * scale[i] * scale[j]
        } else {
            0.0
        }
    }))
}

/// Drops background pixels that the fit cannot explain: text, scratches, faint neighbours. Pixels of the dot and its
/// edge stay, because a dot that does not fit must be seen not to fit.
pub(super) fn drop_foreign(pixels: &mut Vec<Pixel>, fit: &Fit, noise: f64) {
    const LARGEST: f64 = 4.0;
    let profile = &fit.profile;
    let off_edge = |place: Vector2<f64>| profile.distance(place) < -2.5 * profile.blur();
    let mut sizes: Vec<f64> = pixels
        .iter()
        .filter(|pixel| off_edge(pixel.place))
        .map(|pixel| (pixel.grey - profile.value(pixel.place)).abs())
        .collect();
    if sizes.is_empty() {
        return;
    }
    let half = sizes.len() / 2;
    let (_, &mut median, _) = sizes.select_nth_unstable_by(half, f64::total_cmp);
    let limit = LARGEST * (1.4826 * median).max(noise);
    pixels.retain(|pixel| {
        !off_edge(pixel.place) || (pixel.grey - profile.value(pixel.place)).abs() <= limit
    });
}
