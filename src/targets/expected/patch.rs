//! The pixels round an expected dot that say something of it.

use std::ops::Range;

use nalgebra::{Matrix3, Vector2, Vector3};

use super::super::ellipse::{Ellipse, Nested};
use super::super::exact::Shares;
use super::fit::Observed;
use super::view::{ExpectedView, ellipse_of};

/// Fewer pixels say nothing of the ground and the noise.
pub(super) const LEAST_PIXELS: usize = 30;

/// A pixel that may be used.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pixel {
    /// Middle, px from the predicted centre.
    pub(super) place: Vector2<f64>,
    /// Grey value less the neighbours' tails.
    pub(super) grey: f64,
    /// How the tails change with the logarithm of their blur, grey values.
    pub(super) by_tails: f64,
    /// What it gets of the expected dot's amplitude, the centre as predicted.
    profile: f64,
    /// Grey value from which on the pixel only says that the dot is at least as bright; infinite where it does not clip.
    pub(super) clips_at: f64,
}

/// Pixels round the predicted centre.
#[derive(Clone, Debug)]
pub(super) struct Patch {
    /// The predicted centre in the picture, px.
    pub(super) origin: Vector2<f64>,
    /// Middles of the first and the last pixel of the rectangle that holds all.
    pub(super) corners: [[f32; 2]; 2],
    pub(super) pixels: Vec<Pixel>,
    /// How far a centre may lie from the origin and be measured in here, px.
    pub(super) reach: f64,
    /// Standard deviation of the noise here, grey values: the picture's, or that of the ground where it is more.
    pub(super) noise: f64,
    /// That of the picture.
    pub(super) usual_noise: f64,
    /// Sum of the squared profile over all pixels, the hidden ones too.
    squares: f64,
    /// Share of the ground's pixels that are saturated.
    pub(super) saturated_ground: f64,
    /// Root mean square of the ground, with what is foreign, from a plane, grey values.
    pub(super) ground_rms: f64,
    /// Dots whose light reaches in here, by their place in the slice.
    pub(super) neighbours: Vec<usize>,
    /// Standard deviation of the logarithm of the blur of their tails.
    pub(super) tails_sigma: f64,
}

/// What a pixel of the rectangle is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    /// Too far out.
    Beyond,
    /// A neighbour's or foreign.
    Hidden,
    /// The dot may reach here.
    Own,
    Ground,
}

/// A rectangle of the picture.
struct Frame {
    columns: Range<usize>,
    rows: Range<usize>,
    origin: Vector2<f64>,
}

impl Frame {
    fn place(&self, slot: usize) -> Vector2<f64> {
        let (column, row) = (slot % self.columns.len(), slot / self.columns.len());
        let corner = Vector2::new(self.columns.start as f64, self.rows.start as f64);
        corner + Vector2::new(column as f64 + 0.5, row as f64 + 0.5) - self.origin
    }

    fn len(&self) -> usize {
        self.columns.len() * self.rows.len()
    }

    fn corners(&self) -> [[f32; 2]; 2] {
        if self.len() == 0 {
            return [[0.0; 2]; 2];
        }
        [0, self.len() - 1].map(|slot| {
            let place = self.place(slot);
            [place.x as f32, place.y as f32]
        })
    }

    /// The grey values that a dot of this ellipse and blur gives to each pixel, as shares of its amplitude.
    fn shares(&self, shares: &mut Shares, ellipse: &Ellipse, blur: f64) -> Vec<f64> {
        let [first, last] = self.corners();
        shares.fill(ellipse, blur, first, last);
        let share = |slot| {
            let place = self.place(slot);
            f64::from(shares.at(place.x as f32, place.y as f32))
        };
        (0..self.len()).map(share).collect()
    }
}

/// The light of the neighbours, grey values.
struct Tails {
    light: Vec<f64>,
    by_blur: Vec<f64>,
    neighbours: Vec<usize>,
}

impl Tails {
    fn none(frame: &Frame) -> Self {
        Self {
            light: vec![0.0; frame.len()],
            by_blur: vec![0.0; frame.len()],
            neighbours: Vec::new(),
        }
    }

    fn of_neighbours(view: &ExpectedView, frame: &Frame) -> Self {
        /// Beyond this many blurs a dot gives less than 10^-5 of its light.
        const DARK_BLURS: f64 = 4.5;
        /// Difference of the logarithm of the blur.
        const STEP: f64 = 0.1;
        let mut tails = Self::none(frame);
        let mut shares = Shares::default();
        let blur = view.blur.px;
        let half = 0.5 * frame.rows.len() as f64 + DARK_BLURS * blur;
        let [first, last] = frame.corners();
        for neighbour in view.near(frame.origin.y, half + 1.0) {
            let dot = &view.dots[neighbour];
            let ellipse = ellipse_of(dot, frame.origin);
            let reach = ellipse.half_extent().add_scalar(DARK_BLURS * blur);
            let meets = (0..2).all(|axis| {
                ellipse.centre[axis] + reach[axis] > f64::from(first[axis])
                    && ellipse.centre[axis] - reach[axis] < f64::from(last[axis])
            });
            if !meets {
                continue;
            }
            tails.neighbours.push(neighbour);
            let light = frame.shares(&mut shares, &ellipse, blur);
            let wider = frame.shares(&mut shares, &ellipse, blur * STEP.exp());
            for slot in 0..frame.len() {
                tails.light[slot] += dot.contrast * light[slot];
                tails.by_blur[slot] += dot.contrast * (wider[slot] - light[slot]) / STEP;
            }
        }
        tails
    }
}

impl Patch {
    /// The pixels round a predicted centre, for a search so far from it, px.
    pub(super) fn take(
        view: &ExpectedView,
        centre: Vector2<f64>,
        observed: &Observed,
        reach: f64,
    ) -> Self {
        let frame = frame(view, centre, observed, reach);
        let tails = Tails::of_neighbours(view, &frame);
        Self::with_tails(view, &frame, tails, observed, reach)
    }

    /// The same with all neighbours left to be found foreign.
    pub(super) fn without_neighbours(
        view: &ExpectedView,
        centre: Vector2<f64>,
        observed: &Observed,
        reach: f64,
    ) -> Self {
        let frame = frame(view, centre, observed, reach);
        let tails = Tails::none(&frame);
        Self::with_tails(view, &frame, tails, observed, reach)
    }

    fn with_tails(
        view: &ExpectedView,
        frame: &Frame,
        tails: Tails,
        observed: &Observed,
        reach: f64,
    ) -> Self {
        let image = view.view.image;
        let noise = view.noise();
        let greys: Vec<f64> = frame
            .rows
            .clone()
            .flat_map(|row| &image.row(row)[frame.columns.clone()])
            .map(|&grey| f64::from(grey))
            .collect();
        let less_tails: Vec<f64> = greys.iter().zip(&tails.light).map(|(g, t)| g - t).collect();
        let mut roles = roles(frame, &tails, observed, reach, noise);
        let white = view.view.clipping.unwrap_or(f64::INFINITY);
        let saturated = |slot: usize| greys[slot] >= white;
        let dark = || (0..frame.len()).filter(|&slot| roles[slot] == Role::Ground);
        let count = dark().count().max(1) as f64;
        let saturated_ground = dark().filter(|&slot| saturated(slot)).count() as f64 / count;
        let ground = hide_foreign(frame, &less_tails, &mut roles, noise);
        let profile = frame.shares(&mut Shares::default(), &observed.ellipse(), observed.blur);
        let is_open = |slot: &usize| matches!(roles[*slot], Role::Own | Role::Ground);
        let pixel = |slot: usize| Pixel {
            place: frame.place(slot),
            grey: less_tails[slot],
            by_tails: tails.by_blur[slot],
            profile: profile[slot],
            clips_at: match saturated(slot) {
                true => less_tails[slot],
                false => f64::INFINITY,
            },
        };
        Self {
            origin: frame.origin,
            corners: frame.corners(),
            pixels: (0..frame.len()).filter(is_open).map(pixel).collect(),
            reach: reach + SPARE,
            noise: noise.max(ground.kept_rms),
            usual_noise: noise,
            squares: profile.iter().map(|share| share * share).sum(),
            saturated_ground,
            ground_rms: ground.rms,
            neighbours: tails.neighbours,
            tails_sigma: view.blur.sigma.max(LEAST_TAILS_SIGMA),
        }
    }

    /// The sum of the squared profile over the pixels as a share of that over all.
    pub(super) fn own_share(&self) -> f64 {
        let own = self.pixels.iter().map(|pixel| pixel.profile.powi(2));
        own.sum::<f64>() / self.squares.max(f64::MIN_POSITIVE)
    }

    /// Leaves out what shines beside the dot and is not explained by it: a neighbour that nobody measured. `misfits` are those of a
    /// dot of this contrast and blur; what is brighter by the share `tolerated` of the contrast is foreign.
    pub(super) fn hide_unexplained(
        &mut self,
        misfits: &[Misfit],
        contrast: f64,
        blur: f64,
        tolerated: f64,
    ) -> Foreign {
        /// Brighter by so many sigmas.
        const FOREIGN: f64 = 5.0;
        /// Pixels with more of the dot's light stay, because a dot that does not fit must be seen not to fit.
        const INSIDE: f64 = 0.4;
        /// With this share of the dot's light a foreign pixel touches it.
        const TOUCHING: f64 = 0.2;
        /// What is foreign has an edge of its own, in blurs, besides the pixel next to it.
        const EDGE_BLURS: f64 = 1.5;
        let limit = (FOREIGN * self.noise).max(tolerated * contrast);
        let is_foreign = |misfit: &Misfit| misfit.share < INSIDE && misfit.residual > limit;
        let pairs = self.pixels.iter().zip(misfits);
        let (mut foreign, mut most) = (Vec::new(), 0.0_f64);
        for (pixel, misfit) in pairs.filter(|(_, misfit)| is_foreign(misfit)) {
            foreign.push(pixel.place);
            most = most.max(misfit.share);
        }
        if foreign.is_empty() {
            return Foreign::None;
        }
        if most >= TOUCHING {
            return Foreign::Touching;
        }
        let guard = 1.0 + EDGE_BLURS * blur;
        let is_near = |place: Vector2<f64>| {
            let mut distances = foreign.iter().map(|other| (other - place).norm());
            distances.any(|distance| distance < guard)
        };
        self.pixels.retain(|pixel| !is_near(pixel.place));
        Foreign::Beside
    }
}

/// Light that neither the dot nor a measured neighbour explains.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Foreign {
    None,
    /// Off the dot: it is left out.
    Beside,
    /// On the dot's edge: it stays, because what is left of the dot would be measured wrongly.
    Touching,
}

/// What a dot gives to a pixel, as a share of its amplitude, and what it and the ground leave of the grey value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Misfit {
    pub(super) share: f64,
    pub(super) residual: f64,
}

/// However well the blur is known, the tails hold what the neighbour's outline and glow are wrong by.
const LEAST_TAILS_SIGMA: f64 = 0.15;
/// A fit may leave the search by so much, px.
const SPARE: f64 = 1.5;

/// So much ground is taken round the dot, px, by its blur and its mean radius, as in detection.
fn margin(observed: &Observed) -> f64 {
    let radius = (observed.axes.major * observed.axes.minor).sqrt();
    let wanted = (5.0 * observed.blur + 1.0).max(0.6 * radius);
    wanted.clamp(5.0, 15.0)
}

/// The part of the picture that may say something of the dot.
fn frame(view: &ExpectedView, origin: Vector2<f64>, observed: &Observed, reach: f64) -> Frame {
    let half = observed.ellipse().half_extent();
    let half = half.add_scalar(margin(observed) + reach);
    let (low, high) = (origin - half, origin + half);
    let range = |axis: usize, size: usize| {
        let first = low[axis].floor().max(0.0) as usize;
        first.min(size)..(high[axis].ceil().max(0.0) as usize).min(size)
    };
    Frame {
        columns: range(0, view.view.image.width()),
        rows: range(1, view.view.image.height()),
        origin,
    }
}

fn roles(frame: &Frame, tails: &Tails, observed: &Observed, reach: f64, noise: f64) -> Vec<Role> {
    /// More light of neighbours than this, in sigmas of the noise, is not computed well enough to be subtracted.
    const TAIL: f64 = 2.0;
    /// The dot's light ends here, blurs off its edge.
    const EDGE_BLURS: f64 = 2.5;
    let ellipse = observed.ellipse();
    let seen = Nested::of(&ellipse, margin(observed) + reach);
    let own = Nested::of(&ellipse, EDGE_BLURS * observed.blur + reach);
    let holds = |nested: &Option<Nested>, place| nested.is_some_and(|nested| nested.holds(place));
    let role = |slot: usize| {
        let place = frame.place(slot);
        match holds(&seen, place) {
            false => Role::Beyond,
            true if tails.light[slot] > TAIL * noise => Role::Hidden,
            true if holds(&own, place) => Role::Own,
            true => Role::Ground,
        }
    };
    (0..frame.len()).map(role).collect()
}

/// How far the ground is from a plane, root mean square, grey values.
struct Ground {
    rms: f64,
    /// The same without what is foreign.
    kept_rms: f64,
}

/// Hides what is foreign to the ground: text, scratches, glints, neighbours that nobody measured, with what lies beside them.
fn hide_foreign(frame: &Frame, greys: &[f64], roles: &mut [Role], noise: f64) -> Ground {
    /// Departures from the plane that are foreign, in robust sigmas.
    const FOREIGN: f64 = 4.0;
    /// What departs by more has an edge of its own.
    const BRIGHT: f64 = 8.0;
    /// That far from it pixels are hidden too, px.
    const GUARD: isize = 1;
    const PASSES: usize = 3;
    let ground: Vec<usize> = (0..frame.len())
        .filter(|&slot| roles[slot] == Role::Ground)
        .collect();
    let mut kept = ground.clone();
    let mut plane = Vector3::new(median(kept.iter().map(|&slot| greys[slot])), 0.0, 0.0);
    let mut scale = noise;
    let departure = |plane: &Vector3<f64>, slot: usize| {
        let place = frame.place(slot);
        (greys[slot] - plane.dot(&Vector3::new(1.0, place.x, place.y))).abs()
    };
    for pass in 0..PASSES {
        if pass > 0 {
            plane = plane_through(frame, greys, &kept).unwrap_or(plane);
        }
        scale = noise.max(1.4826 * median(kept.iter().map(|&slot| departure(&plane, slot))));
        kept = ground.clone();
        kept.retain(|&slot| departure(&plane, slot) <= FOREIGN * scale);
    }
    let root_mean_square = |slots: &[usize]| {
        let squares: f64 = slots
            .iter()
            .map(|&slot| departure(&plane, slot).powi(2))
            .sum();
        (squares / slots.len().saturating_sub(3).max(1) as f64).sqrt()
    };
    let roughness = Ground {
        rms: root_mean_square(&ground),
        kept_rms: root_mean_square(&kept),
    };
    for &slot in &ground {
        let departure = departure(&plane, slot);
        if departure > FOREIGN * scale {
            roles[slot] = Role::Hidden;
        }
        if departure > BRIGHT * scale {
            hide_round(frame, roles, slot, GUARD);
        }
    }
    roughness
}

fn hide_round(frame: &Frame, roles: &mut [Role], slot: usize, guard: isize) {
    let (width, height) = (frame.columns.len() as isize, frame.rows.len() as isize);
    let (column, row) = (slot as isize % width, slot as isize / width);
    for row in (row - guard).max(0)..=(row + guard).min(height - 1) {
        for column in (column - guard).max(0)..=(column + guard).min(width - 1) {
            let role = &mut roles[(row * width + column) as usize];
            if *role != Role::Beyond {
                *role = Role::Hidden;
            }
        }
    }
}

/// The plane `a + b x + c y` of least squares through pixels.
fn plane_through(frame: &Frame, greys: &[f64], slots: &[usize]) -> Option<Vector3<f64>> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for &slot in slots {
        let place = frame.place(slot);
        let row = Vector3::new(1.0, place.x, place.y);
        normal += row * row.transpose();
        right += row * greys[slot];
    }
    normal.cholesky().map(|factor| factor.solve(&right))
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    if values.is_empty() {
        return 0.0;
    }
    let half = values.len() / 2;
    *values.select_nth_unstable_by(half, f64::total_cmp).1
}
