//! Whether two rays meet, by the threshold of Hattori, Akimoto, Fraser and Imoto (2002): `Th = sqrt(2) max(sigma_S, 3 sigma_xy D / c)`.
//!
//! The paper has `Th = sqrt(2) sigma_S` "for each two rays". Once the stations are known well, true rays miss each other by what the
//! image measurement leaves (`sigma_xy`, at the distance `D` with the principal distance `c`), which is bounded at three sigmas. Of two
//! rays of different error the root of the sum of squares takes the place of `sqrt(2)` times one.

use std::f64::consts::SQRT_2;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::calibration::broad_sigmas;
use super::identify::spaces_of_views;
use super::intersection::passing;
use super::meeting_places::Stretch;
use super::problem::{IdentificationInput, IdentificationSettings, Member, View};
use super::sight::Sight;

/// Standard errors of an image point that the threshold allows.
const SIGMAS: f64 = 3.0;
/// Widest band about an epipolar line that is looked through, px: where stations are known so badly, nothing is unambiguous anyway.
const WIDEST_BAND_PX: f64 = 40.0;

/// The rays of all dots, with how well they are known by sigma_S and the image measurement alone.
pub(super) struct Rays<'a> {
    pub(super) input: &'a IdentificationInput<'a>,
    pub(super) sights: Vec<Sight>,
    /// For each view the others that it is compared with, ascending.
    pub(super) neighbours: Vec<Vec<usize>>,
    min_angle: f64,
}

impl<'a> Rays<'a> {
    pub(super) fn new(
        input: &'a IdentificationInput<'a>,
        settings: &IdentificationSettings,
    ) -> Self {
        let spaces = spaces_of_views(input);
        let broad = broad_sigmas(input);
        let views = input.views.par_iter().zip(&broad).zip(spaces);
        let sights = views.map(|((view, &broad_px), space)| {
            // One number stands for all stations.
            let alike = View {
                precision: None,
                ..view.clone()
            };
            Sight::new(&alike, broad_px, space)
        });
        let count = input.views.len();
        let neighbours = (0..count).map(|view| {
            let told = input.neighbours.get(view).into_iter().flatten();
            let mut others: Vec<usize> = told
                .copied()
                .filter(|&other| other != view && other < count)
                .collect();
            others.sort_unstable();
            others.dedup();
            others
        });
        Self {
            input,
            sights: sights.collect(),
            neighbours: neighbours.collect(),
            min_angle: settings.min_angle,
        }
    }

    pub(super) fn are_neighbours(&self, a: usize, b: usize) -> bool {
        self.neighbours[a].binary_search(&b).is_ok()
    }

    /// `max(sigma_S, 3 sigma_xy D / c)` of a ray at a place, mm.
    fn error_mm(&self, view: usize, sigma_px: f64, place: &Vector3<f64>) -> f64 {
        let sight = &self.sights[view];
        let distance = (place - sight.centre).norm();
        (SIGMAS * sigma_px * distance / sight.focal_px).max(self.input.station_sigma_mm)
    }

    fn error_of(&self, dot: Member, place: &Vector3<f64>) -> f64 {
        let sigma_px = self.input.views[dot.view].dots[dot.dot].sigma_px;
        self.error_mm(dot.view, sigma_px, place)
    }

    /// The threshold of two rays that meet at a place, mm.
    pub(super) fn threshold_mm(&self, a: Member, b: Member, place: &Vector3<f64>) -> f64 {
        self.error_of(a, place).hypot(self.error_of(b, place))
    }

    /// How far a ray passes a place as a share of the threshold; more than 1 misses it. `None` behind the camera.
    pub(super) fn share_of_threshold(&self, ray: Member, place: &Vector3<f64>) -> Option<f64> {
        let sight = &self.sights[ray.view];
        let direction = &sight.dots[ray.dot].direction;
        let away = place - sight.centre;
        let along = away.dot(direction);
        let apart = (away - direction * along).norm();
        (along > 0.0).then(|| apart / (SQRT_2 * self.error_of(ray, place)))
    }

    /// How far two rays pass each other as a share of the threshold; `None` where they are too flat to tell, or meet behind a camera.
    pub(super) fn share_of_two(&self, a: Member, b: Member) -> Option<f64> {
        let (sight_a, sight_b) = (&self.sights[a.view], &self.sights[b.view]);
        let (to_a, to_b) = (
            &sight_a.dots[a.dot].direction,
            &sight_b.dots[b.dot].direction,
        );
        let found = passing(
            (&sight_a.centre, to_a),
            (&sight_b.centre, to_b),
            self.min_angle,
        )?;
        let on_a = sight_a.centre + to_a * found.along[0];
        let on_b = sight_b.centre + to_b * found.along[1];
        Some((on_a - on_b).norm() / self.threshold_mm(a, b, &((on_a + on_b) / 2.0)))
    }

    /// The part of the ray of `seed` that the ray of `other` passes within the threshold; `None` where it passes none inside the object.
    pub(super) fn stretch(&self, seed: Member, other: Member) -> Option<Stretch> {
        let (a, b) = (&self.sights[seed.view], &self.sights[other.view]);
        let (to_a, to_b) = (&a.dots[seed.dot].direction, &b.dots[other.dot].direction);
        let found = passing((&a.centre, to_a), (&b.centre, to_b), self.min_angle)?;
        let (on_a, on_b) = (
            a.centre + to_a * found.along[0],
            b.centre + to_b * found.along[1],
        );
        let middle = (on_a + on_b) / 2.0;
        if !a.space.holds(&middle) || !b.space.holds(&middle) {
            return None;
        }
        let apart = (on_a - on_b).norm();
        let threshold = self.threshold_mm(seed, other, &middle);
        (apart <= threshold).then(|| {
            let half = (threshold * threshold - apart * apart).sqrt() / found.sine;
            Stretch {
                from: found.along[0] - half,
                to: found.along[0] + half,
                member: other,
            }
        })
    }

    /// Free dots of `view` that may meet the ray of `seed`: those along its epipolar line.
    pub(super) fn candidates(&self, seed: Member, view: usize) -> Vec<usize> {
        let sight = &self.sights[view];
        let Some(line) = sight.image_of_ray(&self.sights[seed.view], seed.dot) else {
            return Vec::new();
        };
        let [near, far] = line.ends;
        let band = [near, (near + far) / 2.0, far].map(|place| {
            let own = self.error_of(seed, &place);
            self.reach_px(view, &place, |error| error.hypot(own))
        });
        let band = band.into_iter().fold(0.0, f64::max);
        let dots = sight.along(&line.places[0], &line.places[1], band.min(WIDEST_BAND_PX));
        dots.unwrap_or_default()
    }

    /// How far from a place's image a dot may lie whose ray passes the place within the threshold, px.
    pub(super) fn reach_of_place_px(&self, view: usize, place: &Vector3<f64>) -> f64 {
        let reach = self.reach_px(view, place, |error| SQRT_2 * error);
        reach.min(WIDEST_BAND_PX)
    }

    fn reach_px(&self, view: usize, place: &Vector3<f64>, threshold: impl Fn(f64) -> f64) -> f64 {
        let sight = &self.sights[view];
        let error = self.error_mm(view, sight.dot_px2[1].sqrt(), place);
        threshold(error) * sight.most_pixels_per_mm(place)
    }
}
