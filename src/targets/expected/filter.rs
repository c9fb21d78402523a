//! The filter matched to an expected dot, and the level that noise does not reach.

use std::f64::consts::PI;

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use statrs::function::erf::erfc;

use super::super::ellipse::Ellipse;
use super::super::exact::Shares;
use super::fit::Observed;
use super::patch::{LEAST_PIXELS, Misfit, Patch, Pixel};
use super::{Expected, ExpectedSettings};

/// Where a dot is sought: the ellipse of a covariance at a chi-square round the predicted centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Search {
    covariance: Matrix2<f64>,
    chi_square: f64,
    /// Share of searches in which noise alone may pass.
    false_alarms: f64,
}

impl Search {
    /// The prediction's ellipse, made smaller where it is larger than what is searched.
    pub(super) fn of(expected: &Expected, settings: &ExpectedSettings) -> Self {
        let mut search = Self {
            covariance: expected.covariance_px2,
            ..Self::at_one_place(settings)
        };
        let reach = search.reach();
        if reach > settings.largest_search_px {
            search.covariance *= (settings.largest_search_px / reach).powi(2);
        }
        search
    }

    /// The predicted centre alone.
    pub(super) fn at_one_place(settings: &ExpectedSettings) -> Self {
        Self {
            covariance: Matrix2::zeros(),
            chi_square: settings.critical_chi_square,
            false_alarms: settings.false_alarms,
        }
    }

    /// Its larger semi-axis, px.
    pub(super) fn reach(&self) -> f64 {
        let largest = self.covariance.symmetric_eigenvalues().max();
        (self.chi_square * largest.max(0.0)).sqrt()
    }

    /// Places of a square grid within it, its centre among them.
    fn places(&self, step: f64) -> Vec<Vector2<f64>> {
        let mut places = vec![Vector2::zeros()];
        let Some(weight) = self.covariance.try_inverse() else {
            return places;
        };
        let steps = (self.reach() / step).floor() as i32;
        for row in -steps..=steps {
            for column in -steps..=steps {
                let place = Vector2::new(f64::from(column), f64::from(row)) * step;
                let is_inside = place.dot(&(weight * place)) <= self.chi_square;
                if is_inside && (row, column) != (0, 0) {
                    places.push(place);
                }
            }
        }
        places
    }

    /// The level, in sigmas, that a Gaussian field whose gradient has the covariance `roughness` (px^-2, for unit variance)
    /// exceeds somewhere in here by the share of false alarms: the expected Euler characteristic of what exceeds it (Worsley,
    /// Marrett, Neelin, Vandal, Friston and Evans, 1996, two dimensions).
    fn level(&self, roughness: &Matrix2<f64>) -> f64 {
        const HIGHEST: f64 = 12.0;
        const HALVINGS: usize = 40;
        // In the metric of the field's roughness the search is an ellipse with these semi-axes.
        let squares = roughness * self.covariance * self.chi_square;
        let (trace, determinant) = (squares.trace(), squares.determinant().max(0.0));
        let root = (0.25 * trace * trace - determinant).max(0.0).sqrt();
        let [a, b] = [0.5 * trace + root, 0.5 * trace - root].map(|square| square.max(0.0).sqrt());
        let area = PI * a * b;
        // Ramanujan (1914).
        let half_perimeter = 0.5 * PI * (3.0 * (a + b) - ((3.0 * a + b) * (a + 3.0 * b)).sqrt());
        let exceeded = |level: f64| {
            let density = (-0.5 * level * level).exp();
            0.5 * erfc(level / 2.0_f64.sqrt())
                + half_perimeter * density / (2.0 * PI)
                + area * level * density / (2.0 * PI).powf(1.5)
        };
        let (mut low, mut high) = (0.0, HIGHEST);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if exceeded(middle) > self.false_alarms {
                low = middle;
            } else {
                high = middle;
            }
        }
        high
    }
}

/// The largest value of the matched filter.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Best {
    /// Where, px from the predicted centre.
    pub(super) shift: Vector2<f64>,
    pub(super) amplitude: f64,
    /// The amplitude's standard deviation under the noise of the place.
    pub(super) amplitude_sigma: f64,
    /// What noise alone does not exceed, in these sigmas.
    pub(super) level: f64,
    /// Ground, its slopes along x and y, the logarithm of the blur of the tails.
    pub(super) nuisance: SVector<f64, NUISANCE>,
    /// Root mean square of what is left.
    pub(super) rms: f64,
    pub(super) misfits: Vec<Misfit>,
}

/// Ground, its slopes along x and y, blur of the neighbours' tails.
pub(super) const NUISANCE: usize = 4;

fn nuisance_of(pixel: &Pixel) -> SVector<f64, NUISANCE> {
    SVector::from([1.0, pixel.place.x, pixel.place.y, pixel.by_tails])
}

/// The picture without what the nuisance parameters explain.
struct Projection<'a> {
    patch: &'a Patch,
    inverse: SMatrix<f64, NUISANCE, NUISANCE>,
    /// What they explain of the grey values.
    greys: SVector<f64, NUISANCE>,
    cost: f64,
}

impl<'a> Projection<'a> {
    fn of(patch: &'a Patch) -> Option<Self> {
        let mut normal = SMatrix::<f64, NUISANCE, NUISANCE>::zeros();
        // The tails' blur is observed too: nought, with its sigma.
        normal[(3, 3)] = (patch.noise / patch.tails_sigma).powi(2);
        for pixel in &patch.pixels {
            let row = nuisance_of(pixel);
            normal += row * row.transpose();
        }
        let inverse = normal.cholesky()?.inverse();
        let greys: Vec<f64> = patch.pixels.iter().map(|pixel| pixel.grey).collect();
        let mut own = Self {
            patch,
            inverse,
            greys: SVector::zeros(),
            cost: 0.0,
        };
        let sums = own.sums(&greys);
        own.greys = inverse * sums;
        // Against the mean, because squares of large numbers lose digits.
        let misfit =
            |(pixel, grey): (&Pixel, &f64)| (grey - own.greys.dot(&nuisance_of(pixel))).powi(2);
        own.cost = patch.pixels.iter().zip(&greys).map(misfit).sum();
        Some(own)
    }

    /// Sums of the products of a template with the nuisance.
    fn sums(&self, template: &[f64]) -> SVector<f64, NUISANCE> {
        let pairs = self.patch.pixels.iter().zip(template);
        pairs.fold(SVector::zeros(), |sum, (pixel, &value)| {
            sum + nuisance_of(pixel) * value
        })
    }

    /// Product of two templates, without their nuisance.
    fn product(&self, a: &[f64], b: &[f64]) -> f64 {
        let plain: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
        plain - self.sums(a).dot(&(self.inverse * self.sums(b)))
    }

    /// Product of a template with what the nuisance leaves of the grey values.
    fn pull(&self, template: &[f64]) -> f64 {
        let pairs = self.patch.pixels.iter().zip(template);
        let left = |pixel: &Pixel| pixel.grey - self.greys.dot(&nuisance_of(pixel));
        pairs.map(|(pixel, value)| value * left(pixel)).sum()
    }
}

/// The largest value of the filter in a search; `None` where the pixels tell nothing.
pub(super) fn best_place(patch: &Patch, observed: &Observed, search: &Search) -> Option<Best> {
    if patch.pixels.len() < LEAST_PIXELS {
        return None;
    }
    let projection = Projection::of(patch)?;
    let mut shares = Shares::default();
    let template_at = |shift: Vector2<f64>, shares: &mut Shares| {
        let ellipse = Ellipse {
            centre: shift,
            ..observed.ellipse()
        };
        template(patch, &ellipse, observed.blur, shares)
    };
    let mut best: Option<(f64, Vector2<f64>, f64, f64)> = None;
    for shift in search.places(step(observed)) {
        let template = template_at(shift, &mut shares);
        let weight = projection.product(&template, &template);
        if weight <= 0.0 {
            continue;
        }
        let pull = projection.pull(&template);
        let value = pull / weight.sqrt();
        if best.is_none_or(|(most, ..)| value > most) {
            best = Some((value, shift, pull, weight));
        }
    }
    let (value, shift, pull, weight) = best?;
    let amplitude = pull / weight;
    let template = template_at(shift, &mut shares);
    let nuisance = projection.greys - projection.inverse * projection.sums(&template) * amplitude;
    let redundancy = (patch.pixels.len() - NUISANCE - 1) as f64;
    let rms = ((projection.cost - value * value).max(0.0) / redundancy).sqrt();
    let roughness = roughness(&projection, &mut |shift| template_at(shift, &mut shares))?;
    let misfit = |(pixel, &share): (&Pixel, &f64)| Misfit {
        share,
        residual: pixel.grey - nuisance.dot(&nuisance_of(pixel)) - amplitude * share,
    };
    Some(Best {
        misfits: patch.pixels.iter().zip(&template).map(misfit).collect(),
        shift,
        amplitude,
        amplitude_sigma: rms.max(patch.noise) / weight.sqrt(),
        level: search.level(&roughness),
        nuisance,
        rms,
    })
}

/// Grid of the search, px: the filter's value falls by a few per cent at most between two places.
fn step(observed: &Observed) -> f64 {
    const FINEST: f64 = 0.5;
    const COARSEST: f64 = 2.0;
    (0.2 * observed.axes.minor).clamp(FINEST, COARSEST)
}

/// Covariance of the gradient of the filter's value under noise of unit variance, at the predicted centre.
fn roughness(
    projection: &Projection,
    template_at: &mut dyn FnMut(Vector2<f64>) -> Vec<f64>,
) -> Option<Matrix2<f64>> {
    const STEP: f64 = 0.1;
    let template = template_at(Vector2::zeros());
    let weight = projection.product(&template, &template);
    if weight <= 0.0 {
        return None;
    }
    let mut derivatives = Vec::with_capacity(2);
    for axis in [Vector2::x(), Vector2::y()] {
        let [low, high] = [-STEP, STEP].map(|step| template_at(axis * step));
        let derivative: Vec<f64> = low
            .iter()
            .zip(&high)
            .map(|(l, h)| (h - l) / (2.0 * STEP))
            .collect();
        derivatives.push(derivative);
    }
    let along = [0, 1].map(|axis| projection.product(&derivatives[axis], &template));
    Some(Matrix2::from_fn(|i, j| {
        let product = projection.product(&derivatives[i], &derivatives[j]);
        (product - along[i] * along[j] / weight) / weight
    }))
}

/// The shares of a dot's amplitude that the pixels of a patch get.
pub(super) fn template(
    patch: &Patch,
    ellipse: &Ellipse,
    blur: f64,
    shares: &mut Shares,
) -> Vec<f64> {
    /// Beyond this many blurs a dot gives nothing.
    const DARK_BLURS: f64 = 5.0;
    let half = ellipse.half_extent().add_scalar(DARK_BLURS * blur);
    let [first, last] = patch.corners;
    let [mut low, mut high] = [first, last];
    for axis in 0..2 {
        // Whole pixels from the first, because the picture's rectangle begins in the middle of one.
        let from_first = ellipse.centre[axis] - f64::from(first[axis]);
        let begin = (from_first - half[axis]).floor().max(0.0) as f32;
        let end = (from_first + half[axis]).ceil().max(0.0) as f32;
        low[axis] = (first[axis] + begin).min(last[axis]);
        high[axis] = (first[axis] + end).min(last[axis]);
    }
    shares.fill(ellipse, blur, low, high);
    let share = |pixel: &Pixel| {
        let [x, y] = [pixel.place.x as f32, pixel.place.y as f32];
        let is_within =
            x > low[0] - 0.5 && x < high[0] + 0.5 && y > low[1] - 0.5 && y < high[1] + 0.5;
        match is_within {
            true => f64::from(shares.at(x, y)),
            false => 0.0,
        }
    };
    patch.pixels.iter().map(share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_grows_with_the_search_and_is_that_of_one_place_without() {
        let settings = ExpectedSettings::default();
        let alone = Search::at_one_place(&settings);
        // The normal law exceeds 3.719 once in 10^4.
        assert!((alone.level(&Matrix2::identity()) - 3.719).abs() < 1e-3);
        let wider = |sigma: f64| Search {
            covariance: Matrix2::identity() * sigma * sigma,
            ..alone
        };
        let levels = [0.1, 0.5, 1.0].map(|sigma| wider(sigma).level(&Matrix2::identity()));
        assert!(levels[0] > 3.719 && levels[1] > levels[0] + 0.2 && levels[2] > levels[1] + 0.1);
    }

    #[test]
    fn a_search_holds_its_centre_and_no_place_beyond_its_ellipse() {
        let settings = ExpectedSettings::default();
        let search = Search {
            covariance: Matrix2::new(0.25, 0.0, 0.0, 0.01),
            ..Search::at_one_place(&settings)
        };
        let places = search.places(0.5);
        assert_eq!(places[0], Vector2::zeros());
        assert_eq!(places.len(), 9);
        assert!(
            places
                .iter()
                .all(|place| place.y == 0.0 && place.x.abs() <= 2.0)
        );
    }
}
