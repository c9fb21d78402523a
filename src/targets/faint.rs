//! Places that may be faint dots: those whose single pixels hardly rise above the noise, but whose area does.
//!
//! A peak of 5 sigmas is chance somewhere in a picture of 10^7 pixels, and a component above that level is too ragged to show an
//! ellipse. The binomial of 3 x 3 pixels leaves 0.375 of the noise and most of a dot of 4 px: its components are round from
//! 1.7 sigmas on. Whether it is a dot is for the fit to say: of all its pixels together, by
//! [`super::DotSettings::least_signal_to_noise`].
//!
//! Cost: the pixels of some tiles round each such place.

use nalgebra::Vector2;
use rayon::prelude::*;

use super::dot::View;
use super::ellipse::{Axes, Ellipse};
use super::finding::{Candidate, CandidateSettings, Kind, candidates};
use crate::imaging::{LevelSettings, LevelTree, Region, Smoothed, Tiles};
use crate::monitor::{Interrupted, Monitor};

/// Means of 2 x 2 pixels rise this many sigmas of a pixel's noise where it is looked at: 4.6 of their own. Chance does
/// it in one tile of a thousand.
const RISE: f64 = 2.3;
/// What has pixels this many sigmas above the ground is no faint dot.
const MOST: f64 = 20.0;
/// Height of the first level above the ground in sigmas of a pixel's noise: 4.5 of the smoothed noise.
const FIRST: f64 = 1.7;
/// Ratio of neighbouring levels: from a first level to a peak of 3 sigmas there are four.
const RATIO: f64 = 1.15;
/// Least sum of a component's pixels over its noise: far below what a dot needs, and spares fits of most of what chance makes.
const LEAST_SIGNAL_TO_NOISE: f64 = 5.0;
/// A dot's own pixels are not brighter than its smoothed peak by more than this many sigmas.
const NOISE_ABOVE_PEAK: f64 = 4.0;
/// The region must hold a candidate's surroundings so far from its outline, px.
const HELD: f64 = 2.0;

/// Where the first level is not lower than this share of that of the picture's own grey levels, nothing is gained.
const LOWER: f64 = 0.8;

/// Candidates of a picture that are too faint for its own grey levels, which begin `above_noise` grey values above the ground, in
/// the smoothed ones; targets are at least `least_height` grey values high.
///
/// # Errors
/// [`Interrupted`].
pub(super) fn faint_candidates(
    view: &View,
    tiles: &Tiles,
    [least_height, above_noise]: [f64; 2],
    shape: &CandidateSettings,
    monitor: &Monitor,
) -> Result<Vec<Candidate>, Interrupted> {
    monitor.check()?;
    let first = (FIRST * view.grain).max(least_height);
    if first > LOWER * above_noise {
        return Ok(Vec::new());
    }
    let rise = (RISE * view.grain).max(least_height);
    let regions = tiles.faint_regions(rise, MOST * view.noise);
    let found: Vec<_> = regions
        .par_iter()
        .map(|region| in_region(view, region, first, shape, monitor))
        .collect::<Result<_, Interrupted>>()?;
    Ok(found.into_iter().flatten().collect())
}

fn in_region(
    view: &View,
    region: &Region,
    first: f64,
    shape: &CandidateSettings,
    monitor: &Monitor,
) -> Result<Vec<Candidate>, Interrupted> {
    let smoothed = Smoothed::of(view.image, region);
    let levels = LevelSettings {
        first: smoothed.scale * first,
        ratio: RATIO,
        least_area: 4,
        largest_area: (0.5 * shape.largest_area) as u32,
    };
    let tree = LevelTree::new(&smoothed.image, &smoothed.region, &levels, monitor)?;
    let (width, height) = (smoothed.image.width(), smoothed.image.height());
    let found = candidates(&tree, width, height, shape);
    let corner = Vector2::new(smoothed.corner[0] as f64, smoothed.corner[1] as f64);
    let whole = found.into_iter().filter_map(|(place, _)| {
        let height = place.level / smoothed.scale - region.ground;
        let axes = place.ellipse.axes()?;
        let area = std::f64::consts::PI * axes.major * axes.minor;
        let beyond_chance = height * area.sqrt() >= LEAST_SIGNAL_TO_NOISE * view.noise;
        let ellipse = Ellipse {
            centre: place.ellipse.centre + corner,
            ..place.ellipse
        };
        let kind = match place.kind {
            Kind::Bump => Kind::Speck,
            kind => kind,
        };
        let place = Candidate {
            ellipse,
            level: place.peak / smoothed.scale + NOISE_ABOVE_PEAK * view.noise,
            kind,
            ..place
        };
        (beyond_chance && !is_cut(region, &ellipse)).then_some(place)
    });
    Ok(whole.collect())
}

/// Whether the region ends so near that the component may go on beyond it.
fn is_cut(region: &Region, ellipse: &Ellipse) -> bool {
    const DIRECTIONS: u32 = 16;
    let Some(axes) = ellipse.axes() else {
        return true;
    };
    let wider = Axes {
        major: axes.major + HELD,
        minor: axes.minor + HELD,
        ..axes
    };
    let frame = wider.frame();
    (0..DIRECTIONS).any(|direction| {
        let angle = std::f64::consts::TAU * f64::from(direction) / f64::from(DIRECTIONS);
        let place = ellipse.centre + frame * Vector2::new(angle.cos(), angle.sin());
        !region.holds([place.x, place.y])
    })
}

#[cfg(test)]
mod tests {
    use super::super::rendering::{Canvas, Exposure};
    use super::super::{DetectSettings, Detections, detect};
    use super::*;

    const NOISE: f64 = 3.0;

    fn found_in(canvas: &Canvas, light: f64, blur: f64, seed: u64) -> Detections {
        let exposure = Exposure {
            dark: 20.0,
            light: 20.0 + light,
            noise: NOISE,
            blur,
            seed,
            ..Exposure::default()
        };
        detect(&canvas.expose(&exposure), &[], &DetectSettings::default())
    }

    /// Diameters (px), light over noise and blur (px) such that the peak stands 5 to 6 sigmas above the noise.
    const FAINT: [[f64; 4]; 5] = [
        [4.0, 4.0, 8.0, 1.0],
        [6.0, 6.0, 6.0, 1.0],
        [8.0, 4.0, 7.0, 0.8],
        [20.0, 10.0, 5.0, 0.8],
        [60.0, 60.0, 5.0, 1.5],
    ];

    #[test]
    fn dots_whose_peak_hardly_rises_above_the_noise_are_found_and_nothing_else() {
        for [major, minor, signal, blur] in FAINT {
            let pitch = major + 30.0;
            let side = (4.0 * pitch) as usize;
            let mut canvas = Canvas::new(side, side);
            let mut centres = Vec::new();
            for slot in 0..16 {
                let place = Vector2::new(f64::from(slot % 4), f64::from(slot / 4));
                let off = Vector2::new(f64::from(slot) * 0.37, f64::from(slot) * 0.61);
                let centre = place.add_scalar(0.5) * pitch + off.map(f64::fract);
                let axes = Axes {
                    major: major / 2.0,
                    minor: minor / 2.0,
                    angle: 0.2 * f64::from(slot),
                };
                canvas.dot(centre, axes);
                centres.push(centre);
            }
            let found = found_in(&canvas, signal * NOISE, blur, 5).dots;
            let near = |centre: &&Vector2<f64>| {
                let mut distances = found.iter().map(|dot| (dot.centre_px - **centre).norm());
                distances.any(|distance| distance < 1.0)
            };
            assert_eq!(centres.iter().filter(near).count(), 16, "{major} px");
            assert_eq!(found.len(), 16, "{major} px: false dots");
        }
    }

    #[test]
    fn noise_alone_makes_no_faint_dots() {
        let canvas = Canvas::new(600, 400);
        for seed in 0..10 {
            assert!(found_in(&canvas, 0.0, 0.8, seed).dots.is_empty(), "{seed}");
        }
    }
}
