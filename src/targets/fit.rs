//! Least-squares fit of a dot's profile by Levenberg-Marquardt steps.

use bytemuck::cast_slice;
use nalgebra::{Cholesky, Const, SMatrix, SVector};

use super::columns::Columns;
use super::profile::{BLUR, PARAMETERS, Parameters, Profile};

/// Normal equations, or their inverse.
pub(super) type Normal = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// The first parameters: those of an even amplitude.
const EVEN: usize = 10;

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
    /// The parameters that it moves.
    fn parameters(self) -> &'static [usize] {
        match self {
            Freedom::Rimmed => &[0, 1, 2, 3, 4, 5, 6, 9],
            Freedom::Even => &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9],
            Freedom::Sloping => &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11],
        }
    }

    fn count(self) -> usize {
        self.parameters().len()
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
    equations: Equations,
    /// Where the equations were made: less than a step at rest away.
    base: Profile,
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
            Rest::Rough => 2e-2,
            Rest::Fine => 1e-4,
        }
    }

    /// All parameters have when the next step gains less than this, in units of a residual's variance: the squared
    /// distance from the minimum in sigmas.
    fn gain(self) -> f64 {
        match self {
            Rest::Rough => 4.0,
            Rest::Fine => 1e-3,
        }
    }

    /// A step that gains more is not taken without a look at where it leads.
    fn blind_gain(self) -> f64 {
        match self {
            Rest::Rough => 10.0,
            Rest::Fine => 5e-2,
        }
    }

    /// Whether a step, after the one before it, ends so near to the minimum; misfits before it have this sum of squares.
    fn is_reached(self, step: StepSize, before: Option<StepSize>, cost: f64) -> bool {
        let next = before.map_or(step, |before| step.next(before));
        next.moved < self.step()
            && next.gain <= self.gain() * cost
            && step.gain <= self.blind_gain() * cost
    }

    fn first_damping(self) -> f64 {
        match self {
            Rest::Rough => 1e-3,
            Rest::Fine => 1e-5,
        }
    }
}

/// What a step does.
#[derive(Clone, Copy)]
struct StepSize {
    /// To the centre, px.
    moved: f64,
    /// To the sum of the squared misfits, times the number of pixels.
    gain: f64,
}

impl StepSize {
    /// What the step after this one will do: they shrink at least as they did since the one before, because this one is damped less.
    fn next(self, before: Self) -> Self {
        let shrunk = |now: f64, before: f64| now * (now / before).min(1.0);
        Self {
            moved: shrunk(self.moved, before.moved),
            gain: shrunk(self.gain, before.gain),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Equations {
    /// Whether slopes of the amplitude move.
    slopes: bool,
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
    let (mut profile, mut base) = (start, start);
    let mut equations = build(pixels, &profile, freedom, clipping);
    let mut damping = rest.first_damping();
    let mut steps = 0;
    let mut before = None;
    loop {
        let step = solve(&equations, damping)?;
        let size = StepSize {
            moved: step[0].hypot(step[1]),
            gain: step.dot(&equations.right) * equations.used as f64,
        };
        let next = stepped(&profile, &step);
        let is_ellipse = next.ellipse().axes().is_some();
        if is_ellipse && rest.is_reached(size, before, equations.cost) {
            // Too small to be worth another look at the pixels, and right all the same.
            profile = next;
            break;
        }
        steps += 1;
        if steps > MOST_STEPS {
            return None;
        }
        let moved = size.moved;
        let tried = is_ellipse.then(|| build(pixels, &next, freedom, clipping));
        match tried {
            Some(tried) if tried.cost <= equations.cost => {
                // What the sums cannot tell apart, or the least blur holds back, is at rest too.
                let small_gain = equations.cost - tried.cost <= 1e-6 * tried.cost;
                (profile, base) = (next, next);
                equations = tried;
                damping *= 0.1;
                before = Some(size);
                if small_gain && moved < 10.0 * rest.step() {
                    break;
                }
            }
            _ => {
                if moved < rest.step() {
                    break;
                }
                before = None;
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
        equations,
        base,
    })
}

/// The profile after a step.
fn stepped(profile: &Profile, step: &Parameters) -> Profile {
    let mut next = *profile;
    next.parameters += step;
    next.parameters[BLUR] = next.parameters[BLUR].max(LEAST_BLUR);
    next
}

fn build(
    pixels: &mut Columns,
    profile: &Profile,
    freedom: Freedom,
    clipping: Option<f64>,
) -> Equations {
    pixels.evaluate(profile, clipping);
    let mut equations = Equations {
        slopes: freedom == Freedom::Sloping,
        normal: Normal::identity(),
        right: Parameters::zeros(),
        cost: pixels.cost(),
        used: pixels.counting(),
    };
    equations.take(pixels, freedom, 0);
    equations
}

impl Equations {
    /// Takes in the sums over the pixels for the parameters of a fit from `known` on.
    fn take(&mut self, pixels: &Columns, freedom: Freedom, known: usize) {
        let parameters = freedom.parameters();
        pixels.normal_equations(parameters, known, |slot, pull, sums| {
            let i = parameters[slot];
            self.right[i] = pull;
            for (&j, &sum) in parameters.iter().zip(sums) {
                self.normal[(i, j)] = sum;
                self.normal[(j, i)] = sum;
            }
        });
    }
}

/// The step of the damped equations.
fn solve(equations: &Equations, damping: f64) -> Option<Parameters> {
    let step = match equations.slopes {
        true => step_of_first::<PARAMETERS>(equations, damping),
        false => step_of_first::<EVEN>(equations, damping),
    }?;
    step.iter().all(|value| value.is_finite()).then_some(step)
}

fn step_of_first<const FIRST: usize>(equations: &Equations, damping: f64) -> Option<Parameters> {
    let (factor, scale) = factored::<FIRST>(&equations.normal, damping)?;
    let mut scaled = scale;
    for (scaled, right) in scaled.iter_mut().zip(&equations.right) {
        *scaled *= right;
    }
    factor.solve_mut(&mut scaled);
    let mut step = Parameters::zeros();
    for (step, (scaled, scale)) in step.iter_mut().zip(scaled.iter().zip(&scale)) {
        *step = scaled * scale;
    }
    Some(step)
}

fn cofactor_of_first<const FIRST: usize>(normal: &Normal) -> Option<Normal> {
    let (factor, scale) = factored::<FIRST>(normal, 0.0)?;
    let inverse = factor.inverse();
    let mut cofactor = Normal::zeros();
    for i in 0..FIRST {
        for j in 0..FIRST {
            cofactor[(i, j)] = inverse[(i, j)] * scale[i] * scale[j];
        }
    }
    Some(cofactor)
}

/// The equations of the first parameters, scaled to unit diagonal and damped, as a factor, and the scale.
fn factored<const FIRST: usize>(normal: &Normal, damping: f64) -> Option<Factored<FIRST>> {
    let mut scale = SVector::<f64, FIRST>::zeros();
    for (slot, scale) in scale.iter_mut().enumerate() {
        let value = Some(normal[(slot, slot)]).filter(|&value| value > 0.0)?;
        *scale = value.sqrt().recip();
    }
    let mut scaled =
        SMatrix::<f64, FIRST, FIRST>::from_fn(|i, j| normal[(i, j)] * scale[i] * scale[j]);
    for slot in 0..FIRST {
        scaled[(slot, slot)] += damping;
    }
    Some((scaled.cholesky()?, scale))
}

type Factored<const FIRST: usize> = (Cholesky<f64, Const<FIRST>>, SVector<f64, FIRST>);

/// Whether an amplitude that slopes explains more than noise would let it, to first order from an even one at rest (a
/// score test): the gain of the next step with two more parameters, as a value of F.
pub(super) fn slope_to_expect(pixels: &mut Columns, even: &Fit, clipping: Option<f64>) -> f64 {
    even.fill(pixels, clipping);
    let mut sloping = Equations {
        slopes: true,
        ..even.equations
    };
    sloping.take(pixels, Freedom::Sloping, EVEN);
    // What is left to gain by the other parameters alone: next to nothing, but so may be the rest.
    let held = Equations {
        slopes: false,
        ..sloping
    };
    let gain = |equations: &Equations| {
        solve(equations, 0.0).map_or(0.0, |step| step.dot(&equations.right))
    };
    let (whole, held) = (gain(&sloping), gain(&held));
    let freedom = sloping.used as f64 - Freedom::Sloping.count() as f64;
    0.5 * (whole - held) * freedom / (sloping.cost - whole).max(f64::MIN_POSITIVE)
}

/// Drops background pixels that the fit cannot explain: text, scratches, faint neighbours. Pixels of the dot and its
/// edge stay, because a dot that does not fit must be seen not to fit.
pub(super) fn drop_foreign(pixels: &mut Columns, fit: &Fit, noise: f64, clipping: Option<f64>) {
    const LARGEST: f64 = 4.0;
    /// The background begins here, blurs off the edge.
    const OFF_EDGE: f32 = -2.5;
    pixels.evaluate(&fit.profile, clipping);
    let [blurs, misfits] = [pixels.blurs(), pixels.misfits()].map(cast_slice::<_, f32>);
    let both = blurs.iter().zip(misfits);
    let far = both
        .take(pixels.len())
        .filter(|&(&blurs, _)| blurs < OFF_EDGE);
    let mut sizes = Vec::with_capacity(pixels.len());
    sizes.extend(far.map(|(_, misfit)| misfit.abs()));
    if sizes.is_empty() {
        return;
    }
    let half = sizes.len() / 2;
    let (_, &mut median, _) = sizes.select_nth_unstable_by(half, f32::total_cmp);
    let limit = (LARGEST * (1.4826 * f64::from(median)).max(noise)) as f32;
    pixels.retain(|blurs, misfit| blurs >= OFF_EDGE || misfit.abs() <= limit);
}

/// Moves a fit at rest to where the exact picture of the dot fits best.
///
/// The misfits are those of the exact picture, the derivatives those of the profile (a defect correction: Stetter, 1978): where
/// the steps end, the exact picture fits, and the derivatives' small errors cost no accuracy. A step that makes the misfit larger
/// is not taken.
pub(super) fn correct(pixels: &mut Columns, fit: &mut Fit) {
    /// Steps beyond which nothing is gained.
    const MOST_CORRECTIONS: usize = 12;
    /// After a step below this none is worth another picture, px: they shrink twentyfold.
    const SMALL: f64 = 2e-4;
    let mut cost = pixels.take_exact_misfits(&fit.profile);
    for _ in 0..MOST_CORRECTIONS {
        let mut right = Parameters::zeros();
        for &parameter in fit.freedom.parameters() {
            right[parameter] = pixels.pull(parameter);
        }
        let equations = Equations {
            right,
            cost,
            ..fit.equations
        };
        let Some(step) = solve(&equations, 0.0) else {
            return;
        };
        let next = stepped(&fit.profile, &step);
        if step[0].hypot(step[1]) < SMALL {
            fit.profile = next;
            pixels.take_step(&step);
            return;
        }
        let tried = next
            .ellipse()
            .axes()
            .map(|_| pixels.take_exact_misfits(&next));
        match tried {
            Some(tried) if tried <= cost => {
                fit.profile = next;
                cost = tried;
            }
            _ => {
                pixels.take_exact_misfits(&fit.profile);
                return;
            }
        }
    }
}

impl Fit {
    /// Puts derivatives and misfits of the fit into the columns.
    pub(super) fn fill(&self, pixels: &mut Columns, clipping: Option<f64>) {
        pixels.evaluate(&self.base, clipping);
    }

    /// The parameters that it moved.
    pub(super) fn parameters(&self) -> &'static [usize] {
        self.freedom.parameters()
    }

    /// Inverse of the normal equations, zero for parameters that were held.
    pub(super) fn cofactor(&self) -> Option<Normal> {
        let normal = &self.equations.normal;
        let inverse = match self.equations.slopes {
            true => cofactor_of_first::<PARAMETERS>(normal),
            false => cofactor_of_first::<EVEN>(normal),
        }?;
        let mut cofactor = Normal::zeros();
        for &i in self.parameters() {
            for &j in self.parameters() {
                cofactor[(i, j)] = inverse[(i, j)];
            }
        }
        Some(cofactor)
    }
}
