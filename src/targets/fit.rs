//! Least-squares fit of a dot's profile by Levenberg-Marquardt steps.

use nalgebra::SMatrix;

use super::columns::Columns;
use super::profile::{BLUR, PARAMETERS, Parameters, Profile};

/// Normal equations, or their inverse.
pub(super) type Normal = SMatrix<f64, PARAMETERS, PARAMETERS>;

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

    /// The parameters that it moves.
    fn parameters(self) -> impl Iterator<Item = usize> + Clone {
        (0..PARAMETERS).filter(move |&parameter| self.moves(parameter))
    }

    fn count(self) -> usize {
        self.parameters().count()
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
    /// The centre has come to rest when its next step is less than this, px.
    fn step(self) -> f64 {
        match self {
            Rest::Rough => 5e-3,
            Rest::Fine => 1e-4,
        }
    }

    /// All parameters have when the next step gains less than this, in units of a residual's variance: the squared
    /// distance from the minimum in sigmas.
    fn gain(self) -> f64 {
        match self {
            Rest::Rough => 1.0,
            Rest::Fine => 1e-3,
        }
    }

    fn first_damping(self) -> f64 {
        match self {
            Rest::Rough => 1e-3,
            Rest::Fine => 1e-5,
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
    pixels: &mut Columns,
    start: Profile,
    freedom: Freedom,
    rest: Rest,
    clipping: Option<f64>,
) -> Option<Fit> {
    let mut profile = start;
    let mut equations = build(pixels, &profile, freedom, clipping);
    let mut damping = rest.first_damping();
    let mut steps = 0;
    loop {
        let step = solve(&equations, damping)?;
        let moved = step[0].hypot(step[1]);
        let gain = step.dot(&equations.right) * equations.used as f64;
        if moved < rest.step() && gain <= rest.gain() * equations.cost {
            break;
        }
        steps += 1;
        if steps > MOST_STEPS {
            return None;
        }
        let mut next = profile;
        next.parameters += step;
        next.parameters[BLUR] = next.parameters[BLUR].max(LEAST_BLUR);
        let tried = next
            .ellipse()
            .axes()
            .map(|_| build(pixels, &next, freedom, clipping));
        match tried {
            Some(tried) if tried.cost <= equations.cost => {
                // What the sums cannot tell apart, or the least blur holds back, is at rest too.
                let small_gain = equations.cost - tried.cost <= 1e-6 * tried.cost;
                profile = next;
                equations = tried;
                damping *= 0.1;
                if small_gain && moved < 10.0 * rest.step() {
                    break;
                }
            }
            _ => {
                if moved < rest.step() {
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

fn build(
    pixels: &mut Columns,
    profile: &Profile,
    freedom: Freedom,
    clipping: Option<f64>,
) -> Equations {
    pixels.evaluate(profile, clipping);
    let mut normal = Normal::identity();
    let mut right = Parameters::zeros();
    for i in freedom.parameters() {
        let (pull, products) = pixels.products(i);
        right[i] = pull;
        for j in freedom.parameters().take_while(|&j| j <= i) {
            normal[(i, j)] = products[j];
            normal[(j, i)] = products[j];
        }
    }
    Equations {
        normal,
        right,
        cost: pixels.cost(),
        used: pixels.counting(),
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

/// Whether an amplitude that slopes explains more than noise would let it, to first order from an even one at rest (a
/// score test): the gain of the next step with two more parameters, as a value of F.
pub(super) fn slope_to_expect(pixels: &mut Columns, even: &Fit, clipping: Option<f64>) -> f64 {
    let equations = build(pixels, &even.profile, Freedom::Sloping, clipping);
    let gain = solve(&equations, 0.0).map_or(0.0, |step| step.dot(&equations.right));
    let freedom = equations.used as f64 - Freedom::Sloping.count() as f64;
    0.5 * gain * freedom / (equations.cost - gain).max(f64::MIN_POSITIVE)
}

/// Drops background pixels that the fit cannot explain: text, scratches, faint neighbours. Pixels of the dot and its
/// edge stay, because a dot that does not fit must be seen not to fit.
pub(super) fn drop_foreign(pixels: &mut Columns, fit: &Fit, noise: f64, clipping: Option<f64>) {
    const LARGEST: f64 = 4.0;
    /// The background begins here, blurs off the edge.
    const OFF_EDGE: f32 = -2.5;
    pixels.evaluate(&fit.profile, clipping);
    let both = pixels.blurs().iter().zip(pixels.misfits());
    let mut sizes: Vec<f32> = both
        .take(pixels.len())
        .filter(|&(&blurs, _)| blurs < OFF_EDGE)
        .map(|(_, misfit)| misfit.abs())
        .collect();
    if sizes.is_empty() {
        return;
    }
    let half = sizes.len() / 2;
    let (_, &mut median, _) = sizes.select_nth_unstable_by(half, f32::total_cmp);
    let limit = (LARGEST * (1.4826 * f64::from(median)).max(noise)) as f32;
    pixels.retain(|pixels, slot| {
        pixels.blurs()[slot] >= OFF_EDGE || pixels.misfits()[slot].abs() <= limit
    });
}

impl Fit {
    /// The parameters that it moved.
    pub(super) fn parameters(&self) -> impl Iterator<Item = usize> + Clone + use<> {
        self.freedom.parameters()
    }

    /// Inverse of the normal equations, zero for parameters that were held.
    pub(super) fn cofactor(&self) -> Option<Normal> {
        let scale = unit_scale(&self.normal)?;
        let scaled = Normal::from_fn(|i, j| self.normal[(i, j)] * scale[i] * scale[j]);
        let inverse = scaled.cholesky()?.inverse();
        Some(Normal::from_fn(|i, j| {
            if self.freedom.moves(i) && self.freedom.moves(j) {
                inverse[(i, j)] * scale[i] * scale[j]
            } else {
                0.0
            }
        }))
    }
}
