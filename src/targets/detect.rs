//! Detection in one picture: dots, then codes among them.

use rayon::prelude::*;

use super::dot::{DotSettings, MeasuredDot, View, measure_dot};
use super::finding::{Candidate, CandidateSettings, candidates};
use super::{Detections, Family, Rejected};
use crate::imaging::{GreyImage, LevelSettings, LevelTree, noise_level};

/// How targets are detected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectSettings {
    /// What is accepted as a dot.
    pub dots: DotSettings,
    /// Ratio of neighbouring grey levels at which the picture is cut: smaller finds dots of less contrast on a bright
    /// background and takes longer. Default 1.2.
    pub level_ratio: f64,
    /// Least height of a target above black as a share of the brightest grey value's. Default 0.02.
    pub least_height: f64,
}

impl Default for DetectSettings {
    fn default() -> Self {
        Self {
            dots: DotSettings::default(),
            level_ratio: 1.2,
            least_height: 0.02,
        }
    }
}

/// Detects the light targets of a picture, and reads the codes of the given families.
#[must_use]
pub fn detect(image: &GreyImage, families: &[Family], settings: &DetectSettings) -> Detections {
    let view = View {
        image,
        noise: noise_level(image),
        clipping: image.clipping().map(f64::from),
    };
    let _ = families;
    let tree = LevelTree::new(image, &level_settings(&view, settings));
    let places = candidates(&tree, image.width(), image.height(), &candidate_settings(settings));
    let measured: Vec<(Candidate, Result<MeasuredDot, String>)> = places
        .into_par_iter()
        .map(|place| (place, measure_dot(&view, &place, &settings.dots)))
        .collect();
    let mut dots = Vec::new();
    let mut rejected = Vec::new();
    for (place, outcome) in measured {
        match outcome {
            Ok(dot) => dots.push(dot),
            Err(reason) => rejected.push(Rejected { place_px: place.ellipse.centre, reason }),
        }
    }
    dots.sort_by(|a, b| {
        (a.dot.centre_px.y, a.dot.centre_px.x)
            .partial_cmp(&(b.dot.centre_px.y, b.dot.centre_px.x))
            .unwrap_or(std::cmp::Ordering::Equal)
    });
    Detections {
        width_px: image.width() as u32,
        height_px: image.height() as u32,
        dots: dots.into_iter().map(|measured| measured.dot).collect(),
        codes: Vec::new(),
        rejected,
    }
}

fn level_settings(view: &View, settings: &DetectSettings) -> LevelSettings {
    let black = dark_level(view.image);
    let brightest = f64::from(view.image.brightest());
    LevelSettings {
        black,
        first: (5.0 * view.noise).max(settings.least_height * (brightest - black)).max(1.0),
        ratio: settings.level_ratio,
        least_area: 4,
    }
}

/// The grey value that a twentieth of the picture does not exceed.
fn dark_level(image: &GreyImage) -> f64 {
    const STRIDE: usize = 61;
    let mut greys: Vec<u16> = image.samples().iter().copied().step_by(STRIDE).collect();
    if greys.is_empty() {
        return 0.0;
    }
    let place = greys.len() / 20;
    let (_, &mut grey, _) = greys.select_nth_unstable(place);
    f64::from(grey)
}

fn candidate_settings(settings: &DetectSettings) -> CandidateSettings {
    let area = |diameter: f64| std::f64::consts::FRAC_PI_4 * diameter * diameter;
    CandidateSettings {
        least_levels: 3,
        least_area: (settings.dots.least_axes_ratio * area(settings.dots.smallest_px)).max(5.0),
        largest_area: area(settings.dots.largest_px),
    }
}
