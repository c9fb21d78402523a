//! The pixels of one dot as columns of numbers, and what a profile says of them.
//!
//! A fit evaluates its profile a handful of times on some hundred pixels; that is nearly all of the cost of measuring.
//! So pixels lie in columns, one for each quantity, and every loop runs along them without a branch, eight pixels at a
//! time in as many instructions as the machine needs for them ([`Lanes`]). `f32` has 24 bits: a distance is right to 1e-5 px for dots of
//! 100 px, a grey value to 1e-7 of white, and sums are taken lane by lane in a fixed order.
//!
//! Cost: pixels x (40 operations + active parameters squared / 2).

use bytemuck::cast_slice;
use pulp::NullaryFnOnce;

use super::exact::Shares;
use super::lanes::{LANES, Lanes, run, sums_of_products};
use super::profile::{AMPLITUDE, BACKGROUND, BLUR, PARAMETERS, Parameters, Profile};

/// From this many blurs off the edge on the profile is flat.
pub(super) const FLAT: f32 = 4.0;

/// Pixels of one dot; place and grey value relative to the window's origin.
#[derive(Clone, Debug, Default)]
pub(super) struct Columns {
    count: usize,
    /// The first pixels: enough to start from.
    coarse: usize,
    /// The first pixels: those that are evaluated.
    used: usize,
    /// The first lanes: on the others the edge has no effect.
    bent: usize,
    x: Vec<f32>,
    y: Vec<f32>,
    grey: Vec<f32>,
    /// What the columns below belong to; they are filled up to whole lanes with pixels that do not count.
    evaluated: Option<(Profile, Option<f64>)>,
    blurs: Vec<Lanes>,
    counts: Vec<Lanes>,
    misfit: Vec<Lanes>,
    by: [Vec<Lanes>; PARAMETERS],
    exact: Shares,
}

impl Columns {
    /// Empties all columns.
    pub(super) fn clear(&mut self) {
        self.truncate(0);
    }

    fn truncate(&mut self, count: usize) {
        self.x.truncate(count);
        self.y.truncate(count);
        self.grey.truncate(count);
        self.count = count;
        self.coarse = self.coarse.min(count);
        self.used = count;
        self.evaluated = None;
    }

    /// Adds pixels side by side, the first at this place; before anything is evaluated.
    pub(super) fn push_row(&mut self, first: [f32; 2], greys: &[u16]) {
        self.x
            .extend((0..greys.len()).map(|step| first[0] + step as f32));
        self.y.extend(std::iter::repeat_n(first[1], greys.len()));
        self.grey.extend(greys.iter().map(|&grey| f32::from(grey)));
        self.count += greys.len();
        self.used = self.count;
    }

    /// Lets the pixels so far be the ones that a first look takes.
    pub(super) fn end_coarse(&mut self) {
        self.coarse = self.count;
    }

    /// Evaluates the pixels of a first look only, as far as they are enough.
    pub(super) fn use_coarse(&mut self) {
        /// For some ten parameters.
        const ENOUGH: usize = 80;
        if self.coarse >= ENOUGH {
            self.used = self.coarse;
            self.evaluated = None;
        }
    }

    /// Evaluates all pixels.
    pub(super) fn use_all(&mut self) {
        if self.used < self.count {
            self.used = self.count;
            self.evaluated = None;
        }
    }

    /// Number of pixels.
    pub(super) fn len(&self) -> usize {
        self.count
    }

    /// Columns of the pixels' centres, px.
    pub(super) fn places(&self) -> [&[f32]; 2] {
        [&self.x, &self.y]
    }

    /// Grey values.
    pub(super) fn greys(&self) -> &[f32] {
        &self.grey
    }

    /// Signed distance from the edge in blurs, positive inside.
    pub(super) fn blurs(&self) -> &[Lanes] {
        &self.blurs
    }

    /// 1 where the pixel counts, 0 where it is clipped and the profile as bright.
    pub(super) fn counts(&self) -> &[Lanes] {
        &self.counts
    }

    /// Grey value less the profile's, 0 where the pixel does not count.
    pub(super) fn misfits(&self) -> &[Lanes] {
        &self.misfit
    }

    /// Derivatives of the value by the parameters, 0 where the pixel does not count.
    pub(super) fn by(&self, parameter: usize) -> &[Lanes] {
        &self.by[parameter]
    }

    /// Sum of the squared misfits.
    pub(super) fn cost(&self) -> f64 {
        let [[cost]] = sums_of_products([&self.misfit], [&self.misfit]);
        cost
    }

    /// Sum of the derivatives by a parameter times the misfits.
    pub(super) fn pull(&self, parameter: usize) -> f64 {
        let [[pull]] = sums_of_products([&self.by[parameter]], [&self.misfit]);
        pull
    }

    /// Sum of the squared derivatives by a parameter.
    pub(super) fn weight(&self, parameter: usize) -> f64 {
        let by = &self.by[parameter];
        let [[weight]] = sums_of_products([by], [by]);
        weight
    }

    /// For the parameters from `known` on, in their order, [`Self::pull`] and the sums of the derivatives times those by the
    /// parameters up to it: the lower half of the normal equations. Calls `put` with each one's place, its pull and its sums.
    pub(super) fn normal_equations(
        &self,
        parameters: &[usize],
        known: usize,
        mut put: impl FnMut(usize, f64, &[f64]),
    ) {
        /// So many at a time: what is read of a column serves for several sums.
        const OWN: usize = 2;
        const MOST: usize = 5;
        for first in (known..parameters.len()).step_by(OWN) {
            let last = (first + OWN).min(parameters.len());
            let own = std::array::from_fn(|next| parameters[(first + next).min(last - 1)]);
            let mut sums = [[0.0; PARAMETERS + 1]; OWN];
            let mut begin = 0;
            while begin <= last {
                let others = &parameters[begin..last];
                // As few steps as there can be, of much the same size; the misfits come last.
                let left = others.len() + 1;
                begin += match left.div_ceil(left.div_ceil(MOST)) {
                    MOST => self.sums_of::<OWN, MOST>(own, others, &mut sums, begin),
                    4 => self.sums_of::<OWN, 4>(own, others, &mut sums, begin),
                    _ => self.sums_of::<OWN, 3>(own, others, &mut sums, begin),
                };
            }
            for (slot, sums) in (first..last).zip(&sums) {
                put(slot, sums[last], &sums[..=slot]);
            }
        }
    }

    /// Sums of the products of the derivatives by some parameters with those by the first `OTHERS` others, or with the misfits
    /// where there are fewer; puts them from this place on. Returns their number.
    fn sums_of<const OWN: usize, const OTHERS: usize>(
        &self,
        own: [usize; OWN],
        others: &[usize],
        sums: &mut [[f64; PARAMETERS + 1]; OWN],
        begin: usize,
    ) -> usize {
        let of_edge = |parameter: &usize| !(BACKGROUND..AMPLITUDE).contains(parameter);
        let edge_alone = own.iter().all(of_edge)
            || others.len() >= OTHERS && others[..OTHERS].iter().all(of_edge);
        let lanes = match edge_alone {
            true => self.bent,
            false => self.misfit.len(),
        };
        let own = own.map(|parameter| &self.by[parameter][..lanes]);
        let others: [&[Lanes]; OTHERS] = std::array::from_fn(|next| {
            others
                .get(next)
                .map_or(&self.misfit[..], |&parameter| &self.by[parameter])
        });
        for (sums, found) in sums.iter_mut().zip(sums_of_products(own, others)) {
            for (sum, found) in sums[begin..].iter_mut().zip(found) {
                *sum = found;
            }
        }
        OTHERS
    }

    /// Number of pixels that count.
    pub(super) fn counting(&self) -> usize {
        let sum = self
            .counts
            .iter()
            .fold(Lanes::ZERO, |sum, &lane| sum + lane);
        sum.sum() as usize
    }

    /// Misfits of the exact picture of a profile's dot instead of the profile's own, and the sum of their squares;
    /// derivatives stay as they are.
    pub(super) fn take_exact_misfits(&mut self, profile: &Profile) -> f64 {
        self.evaluated = None;
        let range = |column: &[f32]| {
            let places = column[..self.count].iter();
            places.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], &place| {
                [low.min(place), high.max(place)]
            })
        };
        let (x, y) = (range(&self.x), range(&self.y));
        let (first, last) = ([x[0], y[0]], [x[1], y[1]]);
        self.exact
            .fill(&profile.ellipse(), profile.blur(), first, last);
        let p = Coefficients::of(profile).p;
        let (xs, ys) = (self.x.as_chunks().0, self.y.as_chunks().0);
        let greys = self.grey.as_chunks().0;
        for (lane, misfit) in self.misfit.iter_mut().enumerate() {
            let shares = Lanes(std::array::from_fn(|next| {
                self.exact.at(xs[lane][next], ys[lane][next])
            }));
            let (x, y) = (Lanes(xs[lane]), Lanes(ys[lane]));
            let background = p[6] + p[7] * x + p[8] * y;
            let amplitude = p[9] + p[10] * x + p[11] * y;
            let grey = Lanes(greys[lane]);
            *misfit = self.counts[lane] * (grey - background - amplitude * shares);
        }
        self.cost()
    }

    /// What a small step of the parameters leaves of the misfits.
    pub(super) fn take_step(&mut self, step: &Parameters) {
        self.evaluated = None;
        for (by, step) in self.by.iter().zip(step) {
            let step = Lanes::splat(*step as f32);
            for (misfit, &by) in self.misfit.iter_mut().zip(by) {
                *misfit -= step * by;
            }
        }
    }

    /// Keeps the pixels for whose distance from the edge, in blurs, and misfit `keep` holds, in their order: mostly all.
    pub(super) fn retain(&mut self, keep: impl Fn(f32, f32) -> bool) {
        let [blurs, misfits] =
            [&self.blurs, &self.misfit].map(|column| cast_slice::<_, f32>(column));
        let both = blurs.iter().zip(misfits).take(self.count);
        let first = both
            .clone()
            .position(|(&blurs, &misfit)| !keep(blurs, misfit));
        let mut kept = first.unwrap_or(self.count);
        for (slot, (&blurs, &misfit)) in both.enumerate().skip(kept) {
            if keep(blurs, misfit) {
                self.x[kept] = self.x[slot];
                self.y[kept] = self.y[slot];
                self.grey[kept] = self.grey[slot];
                kept += 1;
            }
        }
        if kept < self.count {
            self.truncate(kept);
        }
    }

    /// Evaluates a profile: distance, derivatives and misfit of every pixel. Pixels at or above `clipping` do not count
    /// where the profile is as bright.
    pub(super) fn evaluate(&mut self, profile: &Profile, clipping: Option<f64>) {
        if self.evaluated == Some((*profile, clipping)) {
            return;
        }
        self.evaluated = Some((*profile, clipping));
        let lanes = self.used.div_ceil(LANES);
        for column in [&mut self.x, &mut self.y, &mut self.grey] {
            column.resize(self.count.next_multiple_of(LANES), 0.0);
        }
        let filled =
            self.by
                .iter_mut()
                .chain([&mut self.blurs, &mut self.counts, &mut self.misfit]);
        for column in filled {
            column.resize(lanes, Lanes::ZERO);
        }
        let white = clipping.map_or(f32::INFINITY, |white| white as f32);
        let p = Coefficients::of(profile);
        run(Evaluation {
            columns: self,
            p,
            white,
        });
    }

    #[inline(always)]
    fn fill(&mut self, p: &Coefficients, white: f32) {
        let (xs, ys) = (self.x.as_chunks().0, self.y.as_chunks().0);
        let greys = self.grey.as_chunks().0;
        let lanes = self.counts.len();
        self.bent = 0;
        for lane in 0..lanes {
            let (x, y) = (Lanes(xs[lane]), Lanes(ys[lane]));
            let grey = Lanes(greys[lane]);
            let at = p.sample(x, y);
            let dimmer = |grey: f32, value: f32| {
                let clipped = grey >= white && value >= white;
                if clipped { 0.0 } else { 1.0 }
            };
            let mut counts = grey.zip(at.value, dimmer);
            if lane + 1 == lanes {
                counts *= within(self.used - lane * LANES);
            }
            if !at.is_flat {
                self.bent = lane + 1;
            }
            self.blurs[lane] = at.blurs;
            self.counts[lane] = counts;
            self.misfit[lane] = counts * (grey - at.value);
            for (by, derivative) in self.by.iter_mut().zip(at.by_edge) {
                by[lane] = counts * derivative;
            }
            let share = counts * at.share;
            self.by[BACKGROUND][lane] = counts;
            self.by[BACKGROUND + 1][lane] = counts * x;
            self.by[BACKGROUND + 2][lane] = counts * y;
            self.by[AMPLITUDE][lane] = share;
            self.by[AMPLITUDE + 1][lane] = share * x;
            self.by[AMPLITUDE + 2][lane] = share * y;
        }
    }
}

struct Evaluation<'a> {
    columns: &'a mut Columns,
    p: Coefficients,
    white: f32,
}

impl NullaryFnOnce for Evaluation<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.columns.fill(&self.p, self.white);
    }
}

/// 1 in the first lanes, 0 in the others.
fn within(count: usize) -> Lanes {
    Lanes(std::array::from_fn(
        |lane| if lane < count { 1.0 } else { 0.0 },
    ))
}

/// The parameters of a profile as the loop needs them.
#[derive(Clone, Copy)]
struct Coefficients {
    p: [Lanes; PARAMETERS],
    inverse_blur: Lanes,
}

/// What the profile says of eight pixels.
struct At {
    value: Lanes,
    blurs: Lanes,
    share: Lanes,
    /// Whether all of them lie so far out that the edge has no effect.
    is_flat: bool,
    /// Derivatives by centre, shape and blur.
    by_edge: [Lanes; 6],
}

impl Coefficients {
    fn of(profile: &Profile) -> Self {
        Self {
            p: std::array::from_fn(|slot| Lanes::splat(profile.parameters[slot] as f32)),
            inverse_blur: Lanes::splat((1.0 / profile.blur()) as f32),
        }
    }

    /// Value and derivatives of [`Profile::value`].
    ///
    /// With `u` the place from the centre, `M` the shape, `q^2 = u^T M u` and `G = |M u|` the distance is
    /// `d = (q - q^2) / G`, its derivatives those of `q^2` times `(1 - 2 q) / (2 q G)` and those of `G^2` times
    /// `-d / (2 G^2)`. The curvature, a small correction, is held fixed.
    #[inline(always)]
    fn sample(&self, x: Lanes, y: Lanes) -> At {
        let p = &self.p;
        let (half, two) = (Lanes::splat(0.5), Lanes::splat(2.0));
        let (dx, dy) = (x - p[0], y - p[1]);
        // The centre itself has no direction and would divide by nothing: any place beside it says the same.
        let off_centre = |square: f32, dx: f32| if square < 1e-8 { 1e-3 } else { dx };
        let dx = (dx * dx + dy * dy).zip(dx, off_centre);
        let (gx, gy) = (p[2] * dx + p[3] * dy, p[3] * dx + p[4] * dy);
        let square = dx * gx + dy * gy;
        let gradient_square = gx * gx + gy * gy;
        let level = square.sqrt();
        let per_gradient = Lanes::ONE / gradient_square.sqrt();
        let per_square = per_gradient * per_gradient;
        let distance = (level - square) * per_gradient;
        let across = gy * gy * p[2] - two * gx * gy * p[3] + gx * gx * p[4];
        let bend = half * p[BLUR] * (level * across * per_square * per_gradient);
        let unbent = distance * self.inverse_blur;
        let blurs = unbent - bend;
        let background = p[6] + p[7] * x + p[8] * y;
        let amplitude = p[9] + p[10] * x + p[11] * y;
        // Stretches of pixels far from the edge are what most windows consist of.
        if blurs.0.iter().all(|&blurs| blurs <= -FLAT) {
            return At {
                value: background,
                blurs,
                share: Lanes::ZERO,
                is_flat: true,
                by_edge: [Lanes::ZERO; 6],
            };
        }
        let (density, share) = normal_law(blurs);
        let by_distance = amplitude * density * self.inverse_blur;
        let by_square = by_distance * (half - level) * per_gradient / level;
        // Twice the derivative by G^2.
        let by_gradient = -by_distance * distance * per_square;
        let (hx, hy) = (p[2] * gx + p[3] * gy, p[3] * gx + p[4] * gy);
        At {
            value: background + amplitude * share,
            blurs,
            share,
            is_flat: false,
            by_edge: [
                -(two * by_square * gx + by_gradient * hx),
                -(two * by_square * gy + by_gradient * hy),
                by_square * dx * dx + by_gradient * gx * dx,
                two * by_square * dx * dy + by_gradient * (gx * dy + gy * dx),
                by_square * dy * dy + by_gradient * gy * dy,
                -by_distance * (unbent + bend),
            ],
        }
    }
}

/// Density of the standard normal law and the share of it below a place; flat beyond [`FLAT`].
///
/// Abramowitz and Stegun (1964), 26.2.17: right to 7.5e-8.
#[inline(always)]
pub(super) fn normal_law(place: Lanes) -> (Lanes, Lanes) {
    const TERMS: [f32; 5] = [
        1.330_274_4,
        -1.821_255_9,
        1.781_477_9,
        -0.356_563_78,
        0.319_381_53,
    ];
    let size = place.map(f32::abs);
    let inside = size.map(|size| if size < FLAT { size } else { FLAT });
    let octaves = inside * inside * Lanes::splat(-0.5 * std::f32::consts::LOG2_E);
    let density = exp2(octaves) * Lanes::splat(0.398_942_3);
    let k = Lanes::ONE / (Lanes::ONE + Lanes::splat(0.231_641_9) * inside);
    let terms = TERMS
        .iter()
        .fold(Lanes::ZERO, |sum, &term| (sum + Lanes::splat(term)) * k);
    let edge = |size: f32, value: f32| if size < FLAT { value } else { 0.0 };
    let (density, tail) = (size.zip(density, edge), size.zip(density * terms, edge));
    let below = |place: f32, tail: f32| if place > 0.0 { 1.0 - tail } else { tail };
    (density, place.zip(tail, below))
}

/// 2^x for -100 < x <= 0, right to 1e-7: the whole part through the bits, the rest by the exponential's series.
#[inline(always)]
fn exp2(x: Lanes) -> Lanes {
    /// Adding this leaves the whole part in the lowest bits.
    const WHOLE: f32 = 12_582_912.0;
    /// Bits of the mantissa, and what the exponent counts from.
    const MANTISSA: u32 = 23;
    const BIAS: u32 = 127;
    const SERIES: [f32; 6] = [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0];
    let shifted = x + Lanes::splat(WHOLE);
    let rest = (x - (shifted - Lanes::splat(WHOLE))) * Lanes::splat(std::f32::consts::LN_2);
    let series = SERIES
        .iter()
        .fold(Lanes::ZERO, |sum, &term| (sum + Lanes::splat(term)) * rest);
    let power = |shifted: f32| f32::from_bits(shifted.to_bits().wrapping_add(BIAS) << MANTISSA);
    shifted.map(power) * (series + Lanes::ONE)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;
    use statrs::function::erf::erfc;

    use super::super::ellipse::{Axes, Ellipse};
    use super::*;

    fn normal(place: f32) -> (f32, f32) {
        let (density, share) = normal_law(Lanes::splat(place));
        (density.0[0], share.0[0])
    }

    #[test]
    fn the_normal_law_has_its_tabled_values() {
        for (place, below) in [
            (-3.0_f32, 0.001_349_898_f64),
            (-1.0, 0.158_655_254),
            (0.0, 0.5),
            (1.96, 0.975_002_105),
            (5.0, 1.0),
        ] {
            let (_, share) = normal(place);
            assert!((f64::from(share) - below).abs() < 2e-7, "{place}: {share}");
        }
        assert!((normal(0.5).0 - 0.352_065_33).abs() < 1e-7);
        assert_eq!(normal(f32::INFINITY), (0.0, 1.0));
        assert_eq!(normal(f32::NEG_INFINITY), (0.0, 0.0));
    }

    /// Curvature of the ellipse where the ray from its centre through a place meets it.
    fn curvature(profile: &Profile, place: Vector2<f64>) -> f64 {
        let Ellipse { centre, shape } = profile.ellipse();
        let normal = shape * (place - centre);
        let along = Vector2::new(-normal.y, normal.x);
        let level = (place - centre).dot(&normal).sqrt();
        level * along.dot(&(shape * along)) / normal.norm().powi(3).max(1e-12)
    }

    fn value(profile: &Profile, place: Vector2<f64>, curvature: f64) -> f64 {
        let p = &profile.parameters;
        let blurs = profile.distance(place) / p[BLUR] - 0.5 * p[BLUR] * curvature;
        let share = 0.5 * erfc(-blurs / 2.0_f64.sqrt());
        let background = p[6] + p[7] * place.x + p[8] * place.y;
        background + (p[9] + p[10] * place.x + p[11] * place.y) * share
    }

    #[test]
    fn columns_say_what_the_profile_says() {
        let axes = Axes {
            major: 5.0,
            minor: 2.5,
            angle: 0.7,
        };
        let ellipse = Ellipse::from_axes(Vector2::new(0.3, -0.2), axes);
        let mut profile = Profile::new(&ellipse, 0.9, 20.0, 130.0);
        profile.parameters[7] = 0.4;
        profile.parameters[11] = -2.0;
        let mut columns = Columns::default();
        let places = [
            [2.4, 1.1],
            [-4.0, -4.0],
            [0.8, -0.3],
            [0.5, 3.6],
            [0.301, -0.2],
            [0.3, -0.2],
        ];
        for place in places {
            columns.push_row(place, &[50]);
        }
        columns.evaluate(&profile, None);
        let of = |column: &[Lanes], slot: usize| f64::from(cast_slice::<_, f32>(column)[slot]);
        for slot in 0..places.len() {
            // What the columns say of the centre they say of the place beside it.
            let beside = if slot == 5 { 4 } else { slot };
            let place = Vector2::new(columns.x[beside], columns.y[beside]).map(f64::from);
            let curvature = curvature(&profile, place);
            let expected = value(&profile, place, curvature);
            let found = 50.0 - of(&columns.misfit, slot);
            // At the centre itself the distance has no direction: it is flat there, which is right to Phi(2.8).
            let tolerance = if slot == 4 { 0.003 * 130.0 } else { 1e-3 };
            assert!(
                (found - expected).abs() < tolerance,
                "{slot}: {found} {expected}"
            );
            for parameter in 0..PARAMETERS {
                let step = 1e-6;
                let at = |sign: f64| {
                    let mut moved = profile;
                    moved.parameters[parameter] += sign * step;
                    value(&moved, place, curvature)
                };
                let expected = (at(1.0) - at(-1.0)) / (2.0 * step);
                let found = of(&columns.by[parameter], slot);
                // A thousandth of a pixel from the centre, digits are lost in differences.
                let tolerance = if slot < 4 { 3e-4 } else { 3e-3 };
                assert!(
                    (found - expected).abs() < tolerance * (1.0 + expected.abs()),
                    "{slot} {parameter}: {found} {expected}"
                );
            }
        }
        assert_eq!(columns.counting(), places.len());
    }
}
