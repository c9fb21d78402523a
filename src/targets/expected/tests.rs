//! Expected dots against pictures with exact truth.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::super::ellipse::Axes;
use super::super::exact::Shares;
use super::super::rendering::{Canvas, Exposure};
use super::super::{DetectSettings, Dot, detect};
use super::*;
use crate::imaging::{BitDepth, GreyImage};

/// Blur of an edge under a lens of [`Exposure::default`]'s 0.8 px and the pixel's own width, px.
const BLUR_PX: f64 = 0.8505;

fn gauss(rng: &mut ChaCha8Rng) -> f64 {
    // Box and Muller (1958): the tails matter.
    let (u, v): (f64, f64) = (1.0 - rng.random::<f64>(), rng.random());
    (-2.0 * u.ln()).sqrt() * (2.0 * PI * v).cos()
}

/// A dot as it is, semi-axes in px.
#[derive(Clone, Copy)]
pub(super) struct Truth {
    pub(super) centre: Vector2<f64>,
    pub(super) axes: Axes,
    /// Grey values.
    pub(super) contrast: f64,
}

impl Truth {
    pub(super) fn new(
        centre: [f64; 2],
        [major_px, minor_px]: [f64; 2],
        angle: f64,
        contrast: f64,
    ) -> Self {
        Self {
            centre: Vector2::from(centre),
            axes: Axes {
                major: 0.5 * major_px,
                minor: 0.5 * minor_px,
                angle,
            },
            contrast,
        }
    }

    /// A prediction of it with errors of these sigmas: of the centre, px, and of the diameters, as a share.
    pub(super) fn predicted(&self, sigma: f64, share: f64, rng: &mut ChaCha8Rng) -> Expected {
        let shift = Vector2::new(gauss(rng), gauss(rng)) * sigma;
        let mut scaled = |axis: f64| 2.0 * axis * (1.0 + share * gauss(rng));
        let sizes = [scaled(self.axes.major), scaled(self.axes.minor)];
        Expected {
            centre_px: self.centre + shift,
            covariance_px2: Matrix2::identity() * sigma * sigma,
            major_px: sizes[0].max(sizes[1]),
            minor_px: sizes[0].min(sizes[1]),
            angle: self.axes.angle,
            blur_px: Some(BLUR_PX),
            contrast: None,
        }
    }

    /// Exactly as it is, its centre known to this sigma, px.
    fn expected(&self, sigma: f64) -> Expected {
        self.predicted(0.0, 0.0, &mut ChaCha8Rng::seed_from_u64(0))
            .with_sigma(sigma)
    }

    pub(super) fn paint(&self, canvas: &mut Canvas, exposure: &Exposure) {
        let lightness = self.contrast / (exposure.light - exposure.dark);
        canvas.dot_of(self.centre, self.axes, lightness as f32);
    }

    /// Signal to noise of the whole dot.
    fn signal(&self, noise: f64) -> f64 {
        let mut shares = Shares::default();
        let ellipse = Ellipse::from_axes(Vector2::zeros(), self.axes);
        shares.fill(&ellipse, BLUR_PX, [-15.0; 2], [15.0; 2]);
        let places = (-15..=15).flat_map(|row| (-15..=15).map(move |column| [column, row]));
        let squares = places.map(|[x, y]| f64::from(shares.at(x as f32, y as f32)).powi(2));
        self.contrast * squares.sum::<f64>().sqrt() / noise
    }
}

impl Expected {
    fn with_sigma(self, sigma: f64) -> Self {
        Self {
            covariance_px2: Matrix2::identity() * sigma * sigma,
            ..self
        }
    }
}

fn measure(image: &GreyImage, dots: &[Dot], expected: &Expected) -> Result<Dot, NotThere> {
    measure_expected(
        &ExpectedView::new(image, dots),
        expected,
        &ExpectedSettings::default(),
    )
}

/// Dots on a grid of `STEP` px.
pub(super) fn field(side: usize, seed: u64, dot: impl Fn(&mut ChaCha8Rng) -> Truth) -> Vec<Truth> {
    const STEP: f64 = 36.0;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut dots = Vec::new();
    for slot in 0..side * side {
        let mut truth = dot(&mut rng);
        let off = Vector2::new(rng.random::<f64>(), rng.random::<f64>());
        let (column, row) = ((slot % side) as f64, (slot / side) as f64);
        truth.centre = Vector2::new(column + 0.5, row + 0.5) * STEP + off;
        dots.push(truth);
    }
    dots
}

fn picture(side: usize, dots: &[Truth], exposure: &Exposure) -> GreyImage {
    let mut canvas = Canvas::new(side * 36, side * 36);
    for dot in dots {
        dot.paint(&mut canvas, exposure);
    }
    canvas.expose(exposure)
}

/// Of 4 to 12 px, seen under up to 78 degrees, 2 to 5 times as bright as a noise of 2.
pub(super) fn weak(rng: &mut ChaCha8Rng) -> Truth {
    let major = 4.0 + 8.0 * rng.random::<f64>();
    let cosine = (78.0_f64.to_radians() * rng.random::<f64>()).cos();
    let (angle, signal) = (PI * rng.random::<f64>(), 2.0 + 3.0 * rng.random::<f64>());
    Truth::new([0.0; 2], [major, major * cosine], angle, 2.0 * signal)
}

#[test]
fn weak_dots_are_measured_with_true_sigmas() {
    /// Dots with so much signal to noise are well above the level of some 4.
    const CLEAR: f64 = 8.0;
    let (mut squares, mut count) = (0.0, 0.0);
    let (mut clear, mut missed) = (0, Vec::new());
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for seed in 0..2 {
        let dots = field(16, seed, weak);
        let exposure = Exposure {
            seed,
            ..Exposure::default()
        };
        let image = picture(16, &dots, &exposure);
        let view = ExpectedView::new(&image, &[]);
        for dot in &dots {
            let expected = dot.predicted(0.2, 0.02, &mut rng);
            let found = measure_expected(&view, &expected, &ExpectedSettings::default());
            let is_clear = dot.signal(2.0) >= CLEAR;
            clear += u32::from(is_clear);
            match found {
                Ok(found) => {
                    let error = found.centre_px - dot.centre;
                    squares += error.norm_squared() / found.sigma_px.powi(2);
                    count += 2.0;
                }
                Err(reason) if is_clear => missed.push(reason.to_string()),
                Err(_) => {}
            }
        }
    }
    let ratio = (squares / count).sqrt();
    // 800 coordinates give the ratio to 2.5 %; four times that.
    assert!((ratio - 1.0).abs() < 0.1, "{ratio}");
    assert!(clear > 300 && missed.len() <= 3, "{clear}: {missed:?}");
}

#[test]
fn centres_have_no_bias_without_noise() {
    let exposure = Exposure {
        noise: 0.0,
        depth: BitDepth::Sixteen,
        dark: 1000.0,
        light: 21_000.0,
        ..Exposure::default()
    };
    let dots = field(8, 3, |rng| Truth {
        contrast: 20_000.0,
        ..weak(rng)
    });
    let image = picture(8, &dots, &exposure);
    let view = ExpectedView::new(&image, &[]);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut worst = 0.0_f64;
    for dot in &dots {
        for share in [0.0, 0.02] {
            let expected = dot.predicted(0.1, share, &mut rng);
            let found = measure_expected(&view, &expected, &ExpectedSettings::default());
            let found = found.unwrap_or_else(|reason| panic!("{expected:?}: {reason}"));
            worst = worst.max((found.centre_px - dot.centre).amax());
        }
    }
    assert!(worst < 0.003, "{worst}");
}

/// Tries at places of a picture of noise on a ground that rises by `slope` grey values a pixel: how many pass.
fn false_alarms(tries: usize, noise: f64, slope: f64, seed: u64) -> usize {
    const APART: usize = 14;
    let side = (tries as f64).sqrt().ceil() as usize * APART + 40;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let grey = |slot: usize, rng: &mut ChaCha8Rng| {
        let ground = 40.0 + (slope * (slot % side) as f64) % 150.0;
        (ground + noise * gauss(rng)).round().clamp(0.0, 255.0) as u16
    };
    let samples = (0..side * side).map(|slot| grey(slot, &mut rng)).collect();
    let image = GreyImage::new(side as u32, side as u32, BitDepth::Eight, samples).unwrap();
    let view = ExpectedView::new(&image, &[]);
    let mut passed = 0;
    for slot in 0..tries {
        let row_length = (side - 40) / APART;
        let place = [slot % row_length, slot / row_length].map(|step| (step * APART + 20) as f64);
        let mut dot = weak(&mut rng);
        dot.centre = Vector2::from(place) + Vector2::new(rng.random(), rng.random());
        let sigma = 0.02 + 0.48 * rng.random::<f64>();
        let found = measure_expected(&view, &dot.expected(sigma), &ExpectedSettings::default());
        passed += usize::from(found.is_ok());
    }
    passed
}

#[test]
fn noise_alone_passes_once_in_ten_thousand_tries_at_most() {
    // A rate of 10^-4 gives 0.6 of 6,000, and 5 or more once in 2,000 runs.
    let passed = [(3.0, 0.0), (2.0, 0.3), (0.7, 0.05)]
        .into_iter()
        .enumerate()
        .map(|(seed, (noise, slope))| false_alarms(2000, noise, slope, seed as u64));
    let passed: Vec<usize> = passed.collect();
    assert!(passed.iter().sum::<usize>() < 5, "{passed:?}");
}

#[test]
fn the_filter_of_noise_exceeds_its_level_as_often_as_it_is_said_to() {
    const SIDE: usize = 1000;
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut grey = || (60.0 + 3.0 * gauss(&mut rng)).round() as u16;
    let samples = (0..SIDE * SIDE).map(|_| grey()).collect();
    let image = GreyImage::new(SIDE as u32, SIDE as u32, BitDepth::Eight, samples).unwrap();
    let view = ExpectedView::new(&image, &[]);
    let settings = ExpectedSettings {
        false_alarms: 0.02,
        ..ExpectedSettings::default()
    };
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    for sigma in [0.02, 0.5] {
        let (mut tries, mut passed) = (0.0, 0.0);
        for slot in 0..60 * 60 {
            let mut dot = weak(&mut rng);
            dot.centre = Vector2::new((slot % 60) as f64, (slot / 60) as f64) * 16.0;
            dot.centre += Vector2::new(20.3, 20.7);
            let expected = dot.expected(sigma);
            let observed = observed(&view, &expected, &settings).unwrap();
            let search = Search::of(&expected, &settings);
            let patch = Patch::take(&view, dot.centre, &observed, search.reach());
            let best = best_place(&patch, &observed, &search).unwrap();
            tries += 1.0;
            passed += f64::from(u8::from(best.amplitude > best.level * best.amplitude_sigma));
        }
        // 72 are expected, or fewer: the larger of two estimates is taken for the noise.
        let rate = passed / tries;
        assert!((0.01..0.026).contains(&rate), "{sigma} px: {rate}");
    }
}

#[test]
fn what_is_not_there_is_told_with_the_right_reason() {
    let exposure = Exposure::default();
    let there = Truth::new([60.3, 50.7], [8.0, 6.0], 0.3, 60.0);
    let mut canvas = Canvas::new(120, 100);
    there.paint(&mut canvas, &exposure);
    // A saturated patch, and a dot of which the border leaves a half.
    canvas.paint(Vector2::new(100.0, 80.0), 30.0, 5.0, |at| {
        (at - Vector2::new(100.0, 80.0)).norm() < 18.0
    });
    let cut = Truth::new([2.0, 30.0], [8.0, 6.0], 0.3, 60.0);
    cut.paint(&mut canvas, &exposure);
    let image = canvas.expose(&exposure);
    let at = |x: f64, y: f64| {
        let expected = Truth {
            centre: Vector2::new(x, y),
            ..there
        };
        Expected {
            contrast: Some(60.0),
            ..expected.expected(0.1)
        }
    };
    let refused = |expected: &Expected| match measure(&image, &[], expected) {
        Ok(dot) => panic!("{dot:?}"),
        Err(reason) => reason,
    };
    assert!(measure(&image, &[], &at(60.2, 50.8)).is_ok());
    let outside = refused(&at(-3.0, 50.0));
    assert!(matches!(outside, NotThere::Outside { beyond_px } if (beyond_px - 3.0).abs() < 1e-9));
    assert_eq!(refused(&at(2.0, 30.0)), NotThere::CutOffAtBorder);
    assert!(matches!(refused(&at(30.0, 70.0)), NotThere::Covered { .. }));
    let unknown = Expected {
        contrast: None,
        ..at(30.0, 70.0)
    };
    assert!(matches!(refused(&unknown), NotThere::TooWeak { .. }));
    assert!(matches!(
        refused(&at(100.0, 80.0)),
        NotThere::Saturated { .. }
    ));
    assert!(
        matches!(refused(&at(61.3, 50.7)), NotThere::Elsewhere { distance_px, .. } if (distance_px - 1.0).abs() < 0.05)
    );
    let narrow = Expected {
        minor_px: 3.0,
        ..at(60.3, 50.7)
    };
    let narrow = refused(&narrow);
    assert!(
        matches!(
            narrow,
            NotThere::OtherShape { .. } | NotThere::NotRound { .. }
        ),
        "{narrow}"
    );
    let nowhere = Expected {
        centre_px: Vector2::new(f64::NAN, 1.0),
        ..at(1.0, 1.0)
    };
    assert_eq!(refused(&nowhere), NotThere::Unpredicted);
    // A measured dot that lies outside, as of another picture, is no neighbour and tells nothing.
    let stray = Dot {
        centre_px: Vector2::new(-500.0, 9e9),
        ..measure(&image, &[], &at(60.2, 50.8)).unwrap()
    };
    assert!(measure(&image, &[stray], &at(60.2, 50.8)).is_ok());
}

#[test]
fn half_a_dot_is_no_dot() {
    let exposure = Exposure::default();
    let dot = Truth::new([40.3, 40.7], [12.0, 12.0], 0.0, 120.0);
    let mut canvas = Canvas::new(80, 80);
    dot.paint(&mut canvas, &exposure);
    canvas.paint(dot.centre, 12.0, 0.0, |at| at.x > dot.centre.x + 1.5);
    let found = measure(&canvas.expose(&exposure), &[], &dot.expected(0.3));
    assert!(found.is_err(), "{found:?}");
}

#[test]
fn a_dot_on_uneven_ground_is_not_taken_for_seen() {
    let exposure = Exposure::default();
    let mut canvas = Canvas::new(80, 80);
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for _ in 0..500 {
        let place = Vector2::new(rng.random::<f64>(), rng.random::<f64>()) * 40.0;
        canvas.paint(place, 3.0, rng.random::<f32>(), |at| {
            (at - place).norm() < 2.0
        });
    }
    let dot = Truth::new([20.0, 20.0], [6.0, 4.0], 0.0, 10.0);
    let found = measure(&canvas.expose(&exposure), &[], &dot.expected(0.1));
    assert!(matches!(found, Err(NotThere::Uneven { .. })), "{found:?}");
}

#[test]
fn a_target_in_a_hot_spot_with_a_narrow_rim_is_not_measured_wrongly() {
    let exposure = Exposure {
        light: 110.0,
        ..Exposure::default()
    };
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut canvas = Canvas::new(80, 80);
    for _ in 0..3000 {
        let place = Vector2::new(rng.random::<f64>(), rng.random::<f64>()) * 80.0;
        let light = 0.6 + rng.random::<f32>();
        canvas.paint(place, 3.0, light, |at| (at - place).norm() < 2.0);
    }
    let dot = Truth::new([40.3, 40.7], [16.0, 16.0], 0.0, 100.0);
    canvas.paint(dot.centre, 12.0, 0.1, |at| (at - dot.centre).norm() < 9.5);
    dot.paint(&mut canvas, &exposure);
    match measure(&canvas.expose(&exposure), &[], &dot.expected(0.3)) {
        Ok(found) => {
            let off = (found.centre_px - dot.centre).norm();
            assert!(off < 4.0 * found.sigma_px && off < 0.03, "{found:?}");
        }
        Err(reason) => assert!(!matches!(reason, NotThere::Covered { .. }), "{reason}"),
    }
}

#[test]
fn light_that_falls_off_across_a_dot_moves_its_centre_no_more_than_in_detection() {
    let exposure = Exposure {
        noise: 1.0,
        ..Exposure::default()
    };
    let dot = Truth::new([40.3, 40.7], [16.0, 15.0], 0.4, 140.0);
    let mut canvas = Canvas::new(80, 80);
    dot.paint(&mut canvas, &exposure);
    let even = canvas.expose(&exposure);
    let shaded = even.samples().iter().enumerate().map(|(slot, &grey)| {
        let fallen = 1.0 - 0.012 * ((slot % 80) as f64 + 0.5 - dot.centre.x);
        (f64::from(grey) * fallen).round() as u16
    });
    let image = GreyImage::new(80, 80, BitDepth::Eight, shaded.collect()).unwrap();
    let detected = detect(&image, &[], &DetectSettings::default()).dots;
    let found = measure(&image, &[], &dot.expected(0.1)).unwrap();
    assert!(
        (found.centre_px - detected[0].centre_px).norm() < 0.01,
        "{found:?}"
    );
    assert!(
        (found.centre_px - dot.centre).norm() < 4.0 * found.sigma_px,
        "{found:?}"
    );
}

#[test]
fn a_dot_that_detection_measures_gets_the_same_centre() {
    let exposure = Exposure::default();
    let dots = field(8, 6, |rng| {
        let major = 6.0 + 12.0 * rng.random::<f64>();
        let cosine = (60.0_f64.to_radians() * rng.random::<f64>()).cos();
        Truth::new(
            [0.0; 2],
            [major, major * cosine],
            PI * rng.random::<f64>(),
            120.0,
        )
    });
    let image = picture(8, &dots, &exposure);
    let detected = detect(&image, &[], &DetectSettings::default()).dots;
    assert_eq!(detected.len(), dots.len());
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut squares, mut sigmas, mut ratios) = (0.0, 0.0, 0.0);
    for dot in &dots {
        let distance = |other: &&Dot| (other.centre_px - dot.centre).norm();
        let other = detected
            .iter()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let other = other.unwrap();
        // All others are known, this one is not.
        let rest: Vec<Dot> = detected
            .iter()
            .filter(|&dot| dot != other)
            .cloned()
            .collect();
        let mut expected = dot.predicted(0.05, 0.01, &mut rng);
        expected.blur_px = None;
        let found = measure(&image, &rest, &expected).unwrap();
        squares += (found.centre_px - other.centre_px).norm_squared() / 2.0;
        sigmas += other.sigma_px.powi(2);
        ratios += (found.sigma_px / other.sigma_px).ln();
        assert!(
            (found.contrast / other.contrast - 1.0).abs() < 0.15,
            "{found:?} {other:?}"
        );
    }
    let (apart, ratio) = (
        (squares / sigmas).sqrt(),
        (ratios / dots.len() as f64).exp(),
    );
    assert!(apart < 0.3, "{apart}");
    assert!((0.85..1.1).contains(&ratio), "{ratio}");
}

#[test]
fn a_dot_on_the_slope_of_its_window_and_clipped_keeps_its_centre() {
    let dots = field(6, 9, |rng| {
        Truth::new([0.0; 2], [9.0, 7.0], PI * rng.random::<f64>(), 320.0)
    });
    let exposure = Exposure {
        slope: 60.0,
        ..Exposure::default()
    };
    let image = picture(6, &dots, &exposure);
    let view = ExpectedView::new(&image, &[]);
    let mut squares = 0.0;
    for dot in &dots {
        let found = measure_expected(&view, &dot.expected(0.1), &ExpectedSettings::default());
        let found = found.unwrap_or_else(|reason| panic!("{reason}"));
        squares += 0.5 * (found.centre_px - dot.centre).norm_squared() / found.sigma_px.powi(2);
    }
    let ratio = (squares / dots.len() as f64).sqrt();
    // 72 coordinates give the ratio to 8 %; four times that.
    assert!((ratio - 1.0).abs() < 0.35, "{ratio}");
}

#[test]
fn reasons_are_short_lines_in_the_operators_words() {
    let reason = NotThere::TooWeak {
        contrast: 3.12,
        needed: 5.2,
    };
    assert_eq!(
        reason.to_string(),
        "too weak: 3.1 grey values above its surroundings, 5.2 needed"
    );
    let reason = NotThere::Covered {
        contrast: -0.4,
        expected: 60.0,
    };
    assert_eq!(
        reason.to_string(),
        "covered: no lighter than its surroundings where 60.0 are expected"
    );
}
