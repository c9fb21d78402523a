//! Measuring one dot: centre, true sigma, ellipse, contrast.

use nalgebra::Vector2;

use super::Dot;
use super::columns::Columns;
use super::ellipse::{Axes, Ellipse, Nested};
use super::finding::{Candidate, Kind};
use super::fit::{Fit, Freedom, Rest, correct, drop_foreign, fit, slope_to_expect};
use super::profile::{AMPLITUDE, Profile};
use super::trust::{Trust, trust};
use super::window::{Company, WindowSettings, take_pixels};
use crate::imaging::GreyImage;

/// What is accepted as the image of a round target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DotSettings {
    /// What the smallest dots must be like on an even ground, whose noise is that of independent pixels.
    pub even: SmallestDot,
    /// The same on a textured ground, where glints and grain are of that size.
    pub textured: SmallestDot,
    /// Largest larger diameter, px. Default 150.
    pub largest_px: f64,
    /// Least ratio of the diameters: the cosine of the incidence angle. Default 0.2 (78 degrees).
    pub least_axes_ratio: f64,
    /// Least contrast as a multiple of the noise. Default 4.
    pub least_contrast_to_noise: f64,
    /// Least signal to noise of the whole dot, that of a filter matched to it: contrast times the root of the sum of its squared
    /// shares of the pixels, over the noise. Default 8: noise alone reaches it once in 10^15 places.
    pub least_signal_to_noise: f64,
    /// Largest root mean square misfit of the dot and its edge beyond the noise, as a share of the contrast:
    /// rejects what is partly covered or not elliptic. Default 0.06.
    pub largest_misfit: f64,
    /// Largest standard deviation of the centre, px: what is worse is of no use, and often no dot. Default 0.25.
    pub largest_sigma_px: f64,
}

/// What the smallest dots must be like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmallestDot {
    /// Smallest larger diameter, px: below it a dot is not told from a glint. Default 3.5 on a texture, else 2.5.
    pub smallest_px: f64,
    /// Smallest smaller diameter, px: below it the shape is the pixels' and the lens's. Default 2 on a texture, else 0.7.
    pub smallest_minor_px: f64,
    /// Largest standard deviation of the edge's blur as a share of the geometric mean diameter. Default 0.5 on a texture, else 1.
    pub largest_blur: f64,
}

impl Default for DotSettings {
    fn default() -> Self {
        Self {
            even: SmallestDot {
                smallest_px: 2.5,
                smallest_minor_px: 0.7,
                largest_blur: 1.0,
            },
            textured: SmallestDot {
                smallest_px: 3.5,
                smallest_minor_px: 2.0,
                largest_blur: 0.5,
            },
            largest_px: 150.0,
            least_axes_ratio: 0.2,
            least_contrast_to_noise: 4.0,
            least_signal_to_noise: 8.0,
            largest_misfit: 0.06,
            largest_sigma_px: 0.25,
        }
    }
}

/// The picture and what is known of its grey values.
#[derive(Clone, Copy, Debug)]
pub(super) struct View<'a> {
    pub(super) image: &'a GreyImage,
    /// Standard deviation of the noise, grey values.
    pub(super) noise: f64,
    /// The same as the means of 2 x 2 pixels tell it: more on a textured surface.
    pub(super) grain: f64,
    /// Grey value at which the picture clips.
    pub(super) clipping: Option<f64>,
}

impl View<'_> {
    /// Whether the noise is that of pixels which do not hang together: no texture lies under it.
    pub(super) fn is_even(&self) -> bool {
        /// Edges of dots that stand close make it 1.25 at most, texture more than twice this.
        const EVEN: f64 = 1.4;
        self.grain < EVEN * self.noise
    }
}

/// An accepted dot with what its fit knows beyond [`Dot`].
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MeasuredDot {
    pub(super) dot: Dot,
    pub(super) ellipse: Ellipse,
    /// Standard deviation of the edge's blur, px.
    pub(super) blur: f64,
    /// Misfit beyond the noise as a share of the contrast.
    pub(super) misfit: f64,
    /// How many times larger the variance of the centre is than that of `dot`, which takes residuals as independent.
    pub(super) dependence: f64,
    /// Whether the dot alone is enough.
    pub(super) standing: Standing,
}

/// What a dot counts for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Standing {
    /// A target by itself.
    Firm,
    /// So small, and so near to other light, that only a code round it tells it from texture.
    Tentative,
}

/// How much background is seen round a dot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Surroundings {
    /// A few pixels at least.
    Open,
    /// A narrow dark rim before something brighter: a target in a flash hot spot.
    Rim,
}

/// The same for a dot with a rim.
const RIM_MARGIN: f64 = 1.6;
/// Pixels this near to what is beyond the rim are left out, px: direct neighbours only.
const RIM_GUARD: f64 = 1.0;
/// First guess of the blur, px: that of a sharp lens on whole pixels.
const FIRST_BLUR: f64 = 0.8;
/// With a blur larger than this pixels of the edge may have been taken for the core's, and more background is needed.
const SAME_BLUR: f64 = 1.2 * FIRST_BLUR;
/// The window reaches at least this far from the edge, px: with less background its slope cannot be told from a shift.
const LEAST_MARGIN: f64 = 5.0;
/// The window reaches no farther than this from the edge, px.
const LARGEST_MARGIN: f64 = 15.0;
/// Least number of background pixels that must be seen.
const LEAST_FREE_PIXELS: usize = 12;
/// The same for dots of a small ring code, whose neighbours stand a few pixels off: what is left between must suffice.
const SMALL_RIM_MARGIN: f64 = 2.5;
/// The guard of small dots, px.
const SMALL_RIM_GUARD: f64 = 1.5;
/// Dots below this product of the diameters are small in this sense, px^2.
const SMALL: f64 = 80.0;

/// How far round a dot pixels are taken.
struct Reach {
    /// Beyond its edge, px.
    margin: f64,
    /// Not nearer to a neighbour, px.
    guard: f64,
}

impl Reach {
    /// For an edge of this blur; a large dot needs more background, else its slope is not told from a shift.
    fn of(blur: f64, candidate: &Candidate) -> Self {
        let axes = candidate.ellipse.axes();
        let radius = axes.map_or(0.0, |axes| (axes.major * axes.minor).sqrt());
        Self {
            margin: (5.0 * blur + 1.0)
                .max(0.6 * radius)
                .clamp(LEAST_MARGIN, LARGEST_MARGIN),
            guard: (2.2 * blur + 0.7).clamp(2.0, 6.0),
        }
    }

    /// Before the blur is known: far enough for all blurs that need no second look.
    fn first(candidate: &Candidate) -> Self {
        Self {
            margin: Self::of(SAME_BLUR, candidate).margin,
            ..Self::of(FIRST_BLUR, candidate)
        }
    }
}

/// Room to measure one dot after the other in.
#[derive(Clone, Debug, Default)]
pub(super) struct Room {
    pixels: Columns,
}

/// Measures a candidate.
///
/// # Errors
/// The reason why it is no target, in the operator's words.
pub(super) fn measure_dot(
    view: &View,
    candidate: &Candidate,
    settings: &DotSettings,
    room: &mut Room,
) -> Result<MeasuredDot, String> {
    if candidate.at_border {
        return Err("cut off at the picture's border".into());
    }
    if let Some(axes) = candidate.ellipse.axes()
        && 2.0 * axes.major > 1.2 * settings.largest_px
    {
        return Err(format!("too large: {:.0} px", 2.0 * axes.major));
    }
    let firm_if = |firm: bool| {
        if firm {
            Standing::Firm
        } else {
            Standing::Tentative
        }
    };
    let open = measure_in(view, candidate, Surroundings::Open, settings, room);
    if let Ok(dot) = open {
        let standing = firm_if(candidate.kind != Kind::Bump);
        return Ok(MeasuredDot { standing, ..dot });
    }
    if !is_rimmed(view, candidate) {
        return open;
    }
    match measure_in(view, candidate, Surroundings::Rim, settings, room) {
        Ok(dot) => {
            let standing = firm_if(candidate.kind != Kind::Bump && !is_small(candidate));
            Ok(MeasuredDot { standing, ..dot })
        }
        Err(_) => open,
    }
}

/// Whether something as bright as the dot begins a few pixels off its edge on much of its outline.
fn is_rimmed(view: &View, candidate: &Candidate) -> bool {
    const DIRECTIONS: u32 = 32;
    /// Where it is looked for off the edge, px.
    const RIM_BEYOND: f64 = 4.0;
    const LEAST_SHARE: f64 = 0.4;
    /// A code has at least two of its twenty segments light.
    const LEAST_SHARE_SMALL: f64 = 0.06;
    let Some(axes) = candidate.ellipse.axes() else {
        return false;
    };
    let (wider, least_share) = if is_small(candidate) {
        (
            Axes {
                major: 2.4 * axes.major,
                minor: 2.4 * axes.minor,
                ..axes
            },
            LEAST_SHARE_SMALL,
        )
    } else {
        let reach = |axis: f64| axis + RIM_BEYOND;
        (
            Axes {
                major: reach(axes.major),
                minor: reach(axes.minor),
                ..axes
            },
            LEAST_SHARE,
        )
    };
    let frame = wider.frame();
    let bright = (0..DIRECTIONS).filter(|&index| {
        let (sin, cos) =
            (std::f64::consts::TAU * f64::from(index) / f64::from(DIRECTIONS)).sin_cos();
        let place = candidate.ellipse.centre + frame * Vector2::new(cos, sin);
        view.image
            .sample(place.x, place.y)
            .is_some_and(|grey| grey > candidate.level)
    });
    bright.count() as f64 >= least_share * f64::from(DIRECTIONS)
}

fn is_small(candidate: &Candidate) -> bool {
    candidate
        .ellipse
        .axes()
        .is_some_and(|axes| 4.0 * axes.major * axes.minor < SMALL)
}

fn measure_in(
    view: &View,
    candidate: &Candidate,
    surroundings: Surroundings,
    settings: &DotSettings,
    room: &mut Room,
) -> Result<MeasuredDot, String> {
    let unfitted = "no ellipse can be fitted";
    let Room { pixels } = room;
    let origin = candidate.ellipse.centre;
    let (first, company) = first_fit(view, candidate, surroundings, pixels).ok_or(unfitted)?;
    plausible(candidate, &first)?;
    let second = match surroundings {
        Surroundings::Open if !hopeless(&first, view.noise) => {
            second_fit(view, candidate, &first, company, pixels).ok_or(unfitted)?
        }
        _ => first,
    };
    plausible(candidate, &second)?;
    let mut second = second;
    pixels.use_all();
    second.fill(pixels, view.clipping);
    if is_bent(&second) {
        correct(pixels, &mut second);
    }
    let trust = trust(pixels, &second).ok_or(unfitted)?;
    judged(view, origin, &second, pixels, &trust, settings)
}

/// Whether the profile, which takes the edge as straight within its blur and the pixel as a part of it, moves the centre by
/// more than some 3e-4 px: the dot is narrow, or the lens sharper than the pixels.
fn is_bent(fit: &Fit) -> bool {
    /// A smaller semi-axis of so many blurs is straight.
    const STRAIGHT_BLURS: f64 = 3.5;
    /// From this blur on the pixel's square is as good as a Gaussian, px.
    const SMOOTH: f64 = 0.76;
    /// With this smaller semi-axis a sharp edge too goes through pixels enough, px.
    const LARGE: f64 = 16.0;
    let blur = fit.profile.blur();
    let axes = fit.profile.ellipse().axes();
    axes.is_some_and(|axes| {
        axes.minor < STRAIGHT_BLURS * blur || blur < SMOOTH && axes.minor < LARGE
    })
}

/// A misfit so large, beyond the noise, that no second fit can mend it.
fn hopeless(first: &Fit, noise: f64) -> bool {
    const HOPELESS: f64 = 0.2;
    /// The residual of few pixels is larger than their noise by chance, by less than this factor.
    const NOISE: f64 = 1.5;
    first.residual > (HOPELESS * first.profile.amplitude()).hypot(NOISE * noise)
}

fn first_fit(
    view: &View,
    candidate: &Candidate,
    surroundings: Surroundings,
    pixels: &mut Columns,
) -> Option<(Fit, Company)> {
    let origin = candidate.ellipse.centre;
    let ellipse = Ellipse {
        centre: Vector2::zeros(),
        ..candidate.ellipse
    };
    let guess = Profile::new(&ellipse, FIRST_BLUR, 0.0, 1.0);
    let (margin, guard, off_edge, freedom) = match surroundings {
        Surroundings::Open => {
            let Reach { margin, guard } = Reach::first(candidate);
            (margin, guard, -1.5, Freedom::Even)
        }
        Surroundings::Rim if is_small(candidate) => {
            (SMALL_RIM_MARGIN, SMALL_RIM_GUARD, -1.0, Freedom::Rimmed)
        }
        Surroundings::Rim => (RIM_MARGIN, RIM_GUARD, -0.8, Freedom::Rimmed),
    };
    let window = WindowSettings {
        origin,
        level: candidate.level,
        margin,
        guard,
        noise: view.noise,
    };
    let company = take_pixels(view.image, &guess, &window, pixels);
    let (background, amplitude) = first_grey_values(pixels, &guess, off_edge)?;
    let start = Profile::new(&ellipse, FIRST_BLUR, background, amplitude);
    let rest = match surroundings {
        Surroundings::Open => {
            pixels.use_coarse();
            Rest::Rough
        }
        Surroundings::Rim => Rest::Fine,
    };
    let first = fit(pixels, start, freedom, rest, view.clipping)?;
    Some((first, company))
}

/// Background and amplitude from the pixels off the edge; `None` where too few of either are seen.
fn first_grey_values(pixels: &Columns, guess: &Profile, off_edge: f64) -> Option<(f64, f64)> {
    let ellipse = guess.ellipse();
    let dark = Nested::of(&ellipse, -off_edge)?;
    let bright = Nested::at_level(&ellipse, 0.75);
    let room = || Vec::with_capacity(pixels.len());
    let (mut outside, mut inside) = (room(), room());
    let [xs, ys] = pixels.places();
    let all = xs.iter().zip(ys).zip(pixels.greys());
    for ((&x, &y), &grey) in all.take(pixels.len()) {
        let place = Vector2::new(f64::from(x), f64::from(y));
        if !dark.holds(place) {
            outside.push(grey);
        } else if bright.holds(place) {
            inside.push(grey);
        }
    }
    if outside.len() < LEAST_FREE_PIXELS || inside.is_empty() {
        return None;
    }
    let at = |greys: &mut [f32], place: usize| {
        f64::from(*greys.select_nth_unstable_by(place, f32::total_cmp).1)
    };
    let (half, most) = (outside.len() / 2, inside.len() * 3 / 4);
    let (background, top) = (at(&mut outside, half), at(&mut inside, most));
    (top > background).then_some((background, top - background))
}

fn second_fit(
    view: &View,
    candidate: &Candidate,
    first: &Fit,
    company: Company,
    pixels: &mut Columns,
) -> Option<Fit> {
    /// A slope of the amplitude is told from a shift when the dot's smaller radius is this many blurs.
    const CORE_FOR_SLOPE: f64 = 5.0;
    /// A guard wrong by less, px, is good enough.
    const SAME_GUARD: f64 = 0.3;
    let blur = first.profile.blur();
    let Reach { margin, guard } = Reach::of(blur, candidate);
    let taken = Reach::first(candidate).guard;
    let guarded = company == Company::Alone || (guard - taken).abs() <= SAME_GUARD;
    if blur > SAME_BLUR || !guarded {
        let window = WindowSettings {
            origin: candidate.ellipse.centre,
            level: candidate.level,
            margin,
            guard,
            noise: view.noise,
        };
        take_pixels(view.image, &first.profile, &window, pixels);
    }
    pixels.use_all();
    drop_foreign(pixels, first, view.noise, view.clipping);
    let minor = first.profile.ellipse().axes()?.minor;
    let even = fit(
        pixels,
        first.profile,
        Freedom::Even,
        Rest::Fine,
        view.clipping,
    )?;
    if minor < CORE_FOR_SLOPE * even.profile.blur()
        || slope_to_expect(pixels, &even, view.clipping) < LEAST_F
    {
        return Some(even);
    }
    match fit(
        pixels,
        even.profile,
        Freedom::Sloping,
        Rest::Fine,
        view.clipping,
    ) {
        Some(sloping) if slope_is_real(&even, &sloping) => Some(sloping),
        _ => Some(even),
    }
}

/// Two more parameters must explain this much more than noise would (F test, far beyond its one per mille point).
const LEAST_F: f64 = 10.0;

/// Whether the amplitude slopes: what two more parameters explain.
fn slope_is_real(even: &Fit, sloping: &Fit) -> bool {
    let freedom = sloping.used as f64 - 12.0;
    let before = even.residual.powi(2) * (freedom + 2.0);
    let after = sloping.residual.powi(2) * freedom;
    (before - after) / 2.0 > LEAST_F * after / freedom
}

/// Stops fits that left their candidate.
fn plausible(candidate: &Candidate, fit: &Fit) -> Result<(), String> {
    let ellipse = fit.profile.ellipse();
    let (Some(found), Some(expected)) = (ellipse.axes(), candidate.ellipse.axes()) else {
        return Err("no ellipse can be fitted".into());
    };
    let areas = (found.major * found.minor) / (expected.major * expected.minor);
    let moved = candidate
        .ellipse
        .level(candidate.ellipse.centre + ellipse.centre);
    if !(0.4..2.5).contains(&areas) || moved > 0.5 || fit.profile.amplitude() <= 0.0 {
        return Err("its outline is no ellipse".into());
    }
    Ok(())
}

fn judged(
    view: &View,
    origin: Vector2<f64>,
    fit: &Fit,
    pixels: &Columns,
    trust: &Trust,
    settings: &DotSettings,
) -> Result<MeasuredDot, String> {
    let profile = &fit.profile;
    let local = profile.ellipse();
    let ellipse = Ellipse {
        centre: origin + local.centre,
        ..local
    };
    let axes = ellipse.axes().ok_or("no ellipse can be fitted")?;
    let contrast = profile.amplitude();
    // Residuals that chance alone gives (two standard deviations of their variance) are no misfit: it matters to faint dots.
    let by_chance = 1.0 + 2.0 * (2.0 / trust.dot_redundancy.max(1.0)).sqrt();
    let misfit = (trust.dot_residual.powi(2) - by_chance * view.noise.powi(2))
        .max(0.0)
        .sqrt()
        / contrast;
    let (major_px, minor_px) = (2.0 * axes.major, 2.0 * axes.minor);
    let reach = ellipse.half_extent().add_scalar(1.5 * profile.blur());
    let (low, high) = (ellipse.centre - reach, ellipse.centre + reach);
    if low.x < 0.0
        || low.y < 0.0
        || high.x > view.image.width() as f64
        || high.y > view.image.height() as f64
    {
        return Err("cut off at the picture's border".into());
    }
    let smallest = match view.is_even() {
        true => &settings.even,
        false => &settings.textured,
    };
    if major_px < smallest.smallest_px {
        return Err(format!("too small: {major_px:.1} px"));
    }
    if minor_px < smallest.smallest_minor_px {
        return Err(format!("too narrow: {major_px:.1} x {minor_px:.1} px"));
    }
    if major_px > settings.largest_px {
        return Err(format!("too large: {major_px:.0} px"));
    }
    if minor_px < settings.least_axes_ratio * major_px {
        return Err(format!(
            "seen too obliquely: {major_px:.1} x {minor_px:.1} px"
        ));
    }
    let signal = contrast * pixels.weight(AMPLITUDE).sqrt() / view.noise;
    if contrast < settings.least_contrast_to_noise * view.noise {
        return Err(format!(
            "too faint: {contrast:.1} grey values over noise of {:.1}",
            view.noise
        ));
    }
    if signal < settings.least_signal_to_noise {
        return Err(format!(
            "too faint: all its pixels together {signal:.1} times the noise"
        ));
    }
    if profile.blur() > smallest.largest_blur * (major_px * minor_px).sqrt() {
        return Err(format!("blurred: edge of {:.1} px", profile.blur()));
    }
    if trust.sigma_px > settings.largest_sigma_px {
        return Err(format!("too uncertain: {:.1} px", trust.sigma_px));
    }
    if misfit > settings.largest_misfit {
        return Err(format!(
            "partly covered or not round: misfit {:.0} % of its contrast",
            100.0 * misfit
        ));
    }
    Ok(MeasuredDot {
        dot: Dot {
            centre_px: ellipse.centre,
            sigma_px: trust.sigma_px,
            major_px,
            minor_px,
            angle: axes.angle,
            contrast,
            background: profile.background(),
        },
        ellipse,
        blur: profile.blur(),
        misfit,
        dependence: trust.dependence,
        standing: Standing::Firm,
    })
}
