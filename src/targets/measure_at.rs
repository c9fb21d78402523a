//! Measuring one dot where the operator points, with the estimator of [`super::detect`] and easier conditions.

use nalgebra::Vector2;

use super::Dot;
use super::dot::{DotSettings, MeasuredDot, Room, SmallestDot, View, measure_dot};
use super::ellipse::Ellipse;
use super::finding::{Candidate, CandidateSettings, Kind, candidates, settled};
use crate::imaging::{
    BitDepth, GreyImage, LevelSettings, LevelTree, Region, noise_level, noise_of_means,
};
use crate::monitor::Monitor;

/// How a dot is measured where somebody points.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasureAtSettings {
    /// What is accepted as a dot: easier than in detection, because somebody says that a target is there.
    pub dots: DotSettings,
    /// The dot's edge or centre lies within this distance of the place, px: a hand's uncertainty. Default 6.
    pub reach_px: f64,
    /// Ratio of neighbouring grey levels at which the surroundings are cut. Default 1.1, finer than in detection.
    pub level_ratio: f64,
}

impl Default for MeasureAtSettings {
    fn default() -> Self {
        // The operator's word that a target is there.
        let by_hand = SmallestDot {
            smallest_px: 2.5,
            smallest_minor_px: 2.0,
            largest_blur: 0.7,
        };
        Self {
            dots: DotSettings {
                least_axes_ratio: 0.12,
                least_contrast_to_noise: 4.0,
                largest_misfit: 0.15,
                largest_sigma_px: 1.0,
                even: by_hand,
                textured: by_hand,
                ..DotSettings::default()
            },
            reach_px: 6.0,
            level_ratio: 1.1,
        }
    }
}

/// Half sides of the cut-outs that are searched, px: small dots first, because most are.
const HALF_SIDES_PX: [usize; 2] = [48, 224];

/// Measures the light dot at a place of the picture (px). The sigma is that of the fit, as in detection.
///
/// # Errors
/// Why there is no dot to measure, in the operator's words.
pub fn measure_at(
    image: &GreyImage,
    place_px: Vector2<f64>,
    settings: &MeasureAtSettings,
) -> Result<Dot, String> {
    let mut refused = "nothing round and light is there".to_owned();
    for half_side in HALF_SIDES_PX {
        let Some(cut) = CutOut::new(image, place_px, half_side) else {
            return Err("the place lies outside the picture".into());
        };
        match cut.measure(place_px - cut.corner, settings) {
            Ok(mut dot) => {
                dot.centre_px += cut.corner;
                return Ok(dot);
            }
            Err(Some(reason)) => refused = reason,
            Err(None) => {}
        }
    }
    Err(refused)
}

/// A piece of the picture with its upper left corner, px.
struct CutOut {
    picture: GreyImage,
    corner: Vector2<f64>,
}

impl CutOut {
    fn new(image: &GreyImage, place: Vector2<f64>, half_side: usize) -> Option<Self> {
        let inside = place.x >= 0.0
            && place.y >= 0.0
            && place.x < image.width() as f64
            && place.y < image.height() as f64;
        if !inside {
            return None;
        }
        let (column, row) = (place.x as usize, place.y as usize);
        let columns = column.saturating_sub(half_side)..(column + half_side + 1).min(image.width());
        let rows = row.saturating_sub(half_side)..(row + half_side + 1).min(image.height());
        let samples = rows
            .clone()
            .flat_map(|row| image.row(row)[columns.clone()].iter().copied())
            .collect();
        let size = (columns.len() as u32, rows.len() as u32);
        Some(Self {
            picture: GreyImage::new(size.0, size.1, image.depth(), samples).ok()?,
            corner: Vector2::new(columns.start as f64, rows.start as f64),
        })
    }

    /// The best dot near the place; an error holds the reason why the nearest candidate is none, if there is one.
    fn measure(
        &self,
        place: Vector2<f64>,
        settings: &MeasureAtSettings,
    ) -> Result<Dot, Option<String>> {
        let view = View {
            image: &self.picture,
            noise: noise_level(&self.picture),
            grain: noise_of_means(&self.picture),
            clipping: self.picture.clipping().map(f64::from),
        };
        let mut refused = None;
        for places in [
            self.components(&view, place, settings),
            self.supposed(&view, place),
        ] {
            let mut best: Option<MeasuredDot> = None;
            for candidate in places {
                match measure_dot(&view, &candidate, &settings.dots, &mut Room::default()) {
                    Ok(dot) if is_near(&dot.ellipse, place, settings.reach_px) => {
                        if best.as_ref().is_none_or(|known| dot.misfit < known.misfit) {
                            best = Some(dot);
                        }
                    }
                    Ok(_) => {}
                    Err(reason) => refused = refused.or(Some(reason)),
                }
            }
            if let Some(best) = best {
                return Ok(best.dot);
            }
        }
        Err(refused)
    }

    /// Components that keep their shape, near the place, nearest first.
    fn components(
        &self,
        view: &View,
        place: Vector2<f64>,
        settings: &MeasureAtSettings,
    ) -> Vec<Candidate> {
        let levels = LevelSettings {
            first: (4.0 * view.noise).max(1.0),
            ratio: settings.level_ratio,
            least_area: 4,
            largest_area: u32::MAX,
        };
        let surroundings = Region::whole(&self.picture, percentile(&self.picture, 0.05));
        // Nobody interrupts this monitor.
        let tree = LevelTree::new(&self.picture, &surroundings, &levels, &Monitor::new())
            .unwrap_or_default();
        let largest = settings.dots.largest_px;
        let conditions = CandidateSettings {
            least_levels: 2,
            least_levels_alone: 2,
            least_levels_speck: 2,
            least_levels_bump: 2,
            firm_levels_bump: 2,
            least_area: 4.0,
            largest_area: std::f64::consts::FRAC_PI_4 * largest * largest,
        };
        let (width, height) = (self.picture.width(), self.picture.height());
        let found = candidates(&tree, width, height, &conditions);
        let mut near: Vec<Candidate> = settled(found, false)
            .places
            .into_iter()
            .filter(|candidate| is_near(&candidate.ellipse, place, settings.reach_px))
            .collect();
        let distance = |candidate: &Candidate| (candidate.ellipse.centre - place).norm();
        near.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        near
    }

    /// Round dots of several sizes at the place itself: for targets that hang together with other light.
    fn supposed(&self, view: &View, place: Vector2<f64>) -> Vec<Candidate> {
        const DIAMETERS_PX: [f64; 6] = [4.0, 6.0, 9.0, 14.0, 21.0, 32.0];
        /// Least height above the surroundings, as a multiple of the noise.
        const LEAST_HEIGHT: f64 = 4.0;
        let mut found = Vec::new();
        for diameter in DIAMETERS_PX {
            let Some(surroundings) = self.ring_grey(place, diameter) else {
                continue;
            };
            let Some(top) = self.picture.sample(place.x, place.y) else {
                continue;
            };
            let quarter = (diameter / 4.0).powi(2);
            let ellipse = Ellipse::from_moments(place, [quarter, 0.0, quarter]);
            if let Some(ellipse) =
                ellipse.filter(|_| top > surroundings + LEAST_HEIGHT * view.noise)
            {
                found.push(Candidate {
                    peak: top,
                    ellipse,
                    level: 0.5 * (top + surroundings),
                    kind: Kind::Speck,
                    at_border: false,
                });
            }
        }
        found
    }

    /// Median grey value on a circle of one and a half times the diameter.
    fn ring_grey(&self, place: Vector2<f64>, diameter: f64) -> Option<f64> {
        const DIRECTIONS: u32 = 24;
        let radius = 0.75 * diameter + 1.0;
        let mut greys: Vec<f64> = (0..DIRECTIONS)
            .filter_map(|index| {
                let angle = std::f64::consts::TAU * f64::from(index) / f64::from(DIRECTIONS);
                let (sin, cos) = angle.sin_cos();
                self.picture
                    .sample(place.x + radius * cos, place.y + radius * sin)
            })
            .collect();
        greys.sort_by(f64::total_cmp);
        greys.get(greys.len() / 2).copied()
    }
}

fn is_near(ellipse: &Ellipse, place: Vector2<f64>, reach: f64) -> bool {
    ellipse.level(place) <= 1.0 || (ellipse.centre - place).norm() <= reach
}

/// The grey value that a share of the pixels does not exceed.
fn percentile(image: &GreyImage, share: f64) -> f64 {
    let mut greys = image.samples().to_vec();
    if greys.is_empty() {
        return 0.0;
    }
    let place = ((greys.len() - 1) as f64 * share) as usize;
    let (_, &mut grey, _) = greys.select_nth_unstable(place);
    f64::from(grey)
}

/// A centre that the operator set by eye, where [`measure_at`] finds nothing to fit: the size is that of the
/// neighbours, the sigma is a hand's.
#[must_use]
pub fn centre_by_hand(image: &GreyImage, place_px: Vector2<f64>, neighbours: &[Dot]) -> Dot {
    /// What an eye and a hand reach on a magnified picture, px.
    const SIGMA_PX: f64 = 0.5;
    /// Diameter where no neighbour tells one, px.
    const DIAMETER_PX: f64 = 6.0;
    /// So many of the nearest dots tell the size.
    const NEIGHBOURS: usize = 8;
    let mut near: Vec<&Dot> = neighbours.iter().collect();
    near.sort_by(|a, b| {
        let distance = |dot: &Dot| (dot.centre_px - place_px).norm_squared();
        distance(a).total_cmp(&distance(b))
    });
    near.truncate(NEIGHBOURS);
    let median = |of: fn(&Dot) -> f64| {
        let mut sizes: Vec<f64> = near.iter().map(|dot| of(dot)).collect();
        sizes.sort_by(f64::total_cmp);
        sizes.get(sizes.len() / 2).copied().unwrap_or(DIAMETER_PX)
    };
    let (major_px, minor_px) = (median(|dot| dot.major_px), median(|dot| dot.minor_px));
    let background = CutOut::new(image, place_px, 12).map_or(0.0, |c| percentile(&c.picture, 0.3));
    let white = match image.depth() {
        BitDepth::Eight => 255.0,
        BitDepth::Sixteen => 65535.0,
    };
    let grey = image.sample(place_px.x, place_px.y).unwrap_or(background);
    Dot {
        centre_px: place_px,
        sigma_px: SIGMA_PX,
        major_px: major_px.max(minor_px),
        minor_px: minor_px.min(major_px),
        angle: 0.0,
        contrast: (grey - background).clamp(0.0, white),
        background,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A dark picture with light round dots (centre, diameter, height) whose edges run over a pixel.
    fn picture(dots: &[(f64, f64, f64, f64)]) -> GreyImage {
        let (width, height) = (200, 160);
        let mut samples = Vec::new();
        for row in 0..height {
            for column in 0..width {
                let mut grey = 20.0 + f64::from((column * 7 + row * 13) % 5) * 0.6;
                for &(x, y, diameter, amplitude) in dots {
                    let distance = (f64::from(column) + 0.5 - x).hypot(f64::from(row) + 0.5 - y);
                    grey += amplitude / (1.0 + ((distance - diameter / 2.0) / 0.45).exp());
                }
                samples.push(grey.round() as u16);
            }
        }
        GreyImage::new(width as u32, height as u32, BitDepth::Eight, samples).unwrap()
    }

    #[test]
    fn a_dot_is_measured_where_somebody_points_roughly() {
        let image = picture(&[(80.3, 60.7, 9.0, 120.0), (101.0, 60.0, 9.0, 120.0)]);
        let settings = MeasureAtSettings::default();
        let dot = measure_at(&image, Vector2::new(82.5, 58.9), &settings).unwrap();
        // The profile's edge is no Gaussian's, so a twentieth of a pixel is asked, not a hundredth.
        assert!(
            (dot.centre_px - Vector2::new(80.3, 60.7)).norm() < 0.05,
            "{dot:?}"
        );
        assert!(
            (dot.major_px - 9.0).abs() < 0.7 && dot.sigma_px < 0.1,
            "{dot:?}"
        );
    }

    #[test]
    fn a_faint_dot_is_measured_that_detection_would_not_propose() {
        let image = picture(&[(140.6, 90.2, 7.0, 12.0)]);
        let dot = measure_at(
            &image,
            Vector2::new(140.0, 91.0),
            &MeasureAtSettings::default(),
        );
        let dot = dot.unwrap();
        assert!(
            (dot.centre_px - Vector2::new(140.6, 90.2)).norm() < 0.3,
            "{dot:?}"
        );
    }

    #[test]
    fn nothing_is_measured_where_nothing_is() {
        let image = picture(&[(80.3, 60.7, 9.0, 120.0)]);
        let settings = MeasureAtSettings::default();
        assert!(measure_at(&image, Vector2::new(30.0, 130.0), &settings).is_err());
        assert!(measure_at(&image, Vector2::new(-1.0, 20.0), &settings).is_err());
        assert!(measure_at(&image, Vector2::new(f64::NAN, 20.0), &settings).is_err());
    }

    #[test]
    fn a_centre_by_hand_has_its_neighbours_size_and_a_hands_sigma() {
        let image = picture(&[(80.3, 60.7, 9.0, 120.0)]);
        let neighbour = measure_at(
            &image,
            Vector2::new(80.0, 60.0),
            &MeasureAtSettings::default(),
        );
        let neighbour = neighbour.unwrap();
        let dot = centre_by_hand(
            &image,
            Vector2::new(30.0, 30.0),
            std::slice::from_ref(&neighbour),
        );
        assert_eq!((dot.sigma_px, dot.major_px), (0.5, neighbour.major_px));
    }
}
