//! Detection against pictures with exact truth.

use std::f64::consts::PI;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::super::ellipse::Axes;
use super::super::family::ring_table;
use super::super::rendering::{Canvas, Exposure, ObliqueView};
use super::*;
use crate::imaging::BitDepth;

/// Dots on a grid of `step` px with centres off the grid by chance.
fn field(
    columns: usize,
    rows: usize,
    step: f64,
    seed: u64,
    axes: impl Fn(&mut ChaCha8Rng) -> Axes,
) -> (Canvas, Vec<Vector2<f64>>) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut canvas = Canvas::new(
        (columns as f64 * step) as usize,
        (rows as f64 * step) as usize,
    );
    let mut centres = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let off = Vector2::new(rng.random::<f64>(), rng.random::<f64>());
            let centre = Vector2::new(column as f64 + 0.5, row as f64 + 0.5) * step + off;
            canvas.dot(centre, axes(&mut rng));
            centres.push(centre);
        }
    }
    (canvas, centres)
}

struct Accuracy {
    found: usize,
    rms: f64,
    /// Root mean square of error over stated sigma.
    ratio: f64,
}

fn accuracy(detections: &Detections, centres: &[Vector2<f64>]) -> Accuracy {
    let (mut found, mut squares, mut ratios) = (0, 0.0, 0.0);
    for centre in centres {
        let Some(dot) = detections
            .dots
            .iter()
            .find(|dot| (dot.centre_px - centre).norm() < 1.0)
        else {
            continue;
        };
        let square = (dot.centre_px - centre).norm_squared() / 2.0;
        found += 1;
        squares += square;
        ratios += square / dot.sigma_px.powi(2);
    }
    let count = f64::max(found as f64, 1.0);
    Accuracy {
        found,
        rms: (squares / count).sqrt(),
        ratio: (ratios / count).sqrt(),
    }
}

fn round(diameter: f64) -> Axes {
    Axes {
        major: diameter / 2.0,
        minor: diameter / 2.0,
        angle: 0.0,
    }
}

fn found_in(canvas: &Canvas, exposure: &Exposure) -> Detections {
    detect(&canvas.expose(exposure), &[], &DetectSettings::default())
}

#[test]
fn centres_reach_the_bound_of_the_noise_and_know_it() {
    let (canvas, centres) = field(20, 20, 26.0, 1, |_| round(11.0));
    let accuracy = accuracy(&found_in(&canvas, &Exposure::default()), &centres);
    assert_eq!(accuracy.found, 400);
    // The Cramer-Rao bound of such a dot is 0.0066 px with its background's slope unknown; 800 coordinates give 2.5 %.
    assert!(accuracy.rms < 0.0072, "{}", accuracy.rms);
    // 800 coordinates give the ratio to 2.5 %; four times that.
    assert!((accuracy.ratio - 1.0).abs() < 0.1, "{}", accuracy.ratio);
}

#[test]
fn dots_of_every_size_and_tilt_are_found_with_true_sigmas() {
    for (diameter, least_found) in [(4.0, 24), (6.0, 25), (15.0, 25), (30.0, 25), (60.0, 25)] {
        let (canvas, centres) = field(5, 5, diameter * 2.0 + 8.0, 2, |rng| {
            let tilt: f64 = if diameter < 6.0 { 0.8 } else { 1.22 };
            Axes {
                major: diameter / 2.0,
                minor: diameter / 2.0 * (rng.random::<f64>() * tilt).cos(),
                angle: rng.random::<f64>() * PI,
            }
        });
        let detections = found_in(&canvas, &Exposure::default());
        let accuracy = accuracy(&detections, &centres);
        assert!(
            accuracy.found >= least_found,
            "{diameter} px: {}",
            accuracy.found
        );
        assert_eq!(
            detections.dots.len(),
            accuracy.found,
            "{diameter} px: false dots"
        );
        // 50 coordinates give the ratio to 10 %; three times that.
        assert!(
            (0.7..1.3).contains(&accuracy.ratio),
            "{diameter} px: {}",
            accuracy.ratio
        );
    }
}

/// Oblique dots over a dark of 10 and noise of 2 grey values: resolved and faint, then small.
#[test]
fn faint_oblique_dots_are_found_with_true_sigmas() {
    for (light, major, minor, least_found) in [
        (32.0, 10.0, 4.6, 98),
        (50.0, 8.0, 3.6, 99),
        (65.0, 6.5, 3.0, 98),
    ] {
        let (mut canvas, mut centres) = field(10, 10, 24.0, 9, |rng| Axes {
            major: major / 2.0,
            minor: minor / 2.0,
            angle: rng.random::<f64>() * PI,
        });
        // Something far brighter is in the picture too.
        let bright = Vector2::new(120.0, 120.0);
        canvas.paint(bright, 12.0, 0.0, |_| true);
        centres.retain(|centre| (centre - bright).norm() > 20.0);
        canvas.paint(bright, 10.0, (150.0 / light) as f32, |at| {
            (at - bright).norm() < 8.0
        });
        let exposure = Exposure {
            light,
            noise: 2.0,
            ..Exposure::default()
        };
        let detections = found_in(&canvas, &exposure);
        let accuracy = accuracy(&detections, &centres);
        let lost = 100 - least_found;
        assert!(
            accuracy.found + lost >= centres.len(),
            "{light}: {} of {}, refused {:?}",
            accuracy.found,
            centres.len(),
            detections.rejected
        );
        let is_known = |dot: &&Dot| {
            let near = |place: &Vector2<f64>, reach: f64| (dot.centre_px - place).norm() < reach;
            near(&bright, 20.0) || centres.iter().any(|centre| near(centre, 2.0))
        };
        let known = detections.dots.iter().filter(is_known).count();
        assert_eq!(known, detections.dots.len(), "{light}: false dots");
        // 190 coordinates give the ratio to 5 %; four times that.
        assert!(
            (accuracy.ratio - 1.0).abs() < 0.2,
            "{light}: {}",
            accuracy.ratio
        );
    }
}

#[test]
fn axes_are_full_diameters() {
    let mut canvas = Canvas::new(120, 100);
    canvas.dot(
        Vector2::new(60.3, 50.6),
        Axes {
            major: 12.0,
            minor: 5.0,
            angle: 2.0,
        },
    );
    let dots = found_in(&canvas, &Exposure::default()).dots;
    // A tenth of a pixel: the profile is that of a straight edge.
    assert!((dots[0].major_px - 24.0).abs() < 0.1 && (dots[0].minor_px - 10.0).abs() < 0.1);
    assert!((dots[0].angle - 2.0).abs() < 0.01);
    assert!((dots[0].contrast - 140.0).abs() < 2.0 && (dots[0].background - 10.0).abs() < 1.0);
}

#[test]
fn clipped_sloping_and_deep_pictures_keep_their_centres() {
    let (canvas, centres) = field(8, 8, 26.0, 3, |_| round(11.0));
    let clipped = Exposure {
        light: 330.0,
        ..Exposure::default()
    };
    let sloping = Exposure {
        slope: 90.0,
        ..Exposure::default()
    };
    let deep = Exposure {
        dark: 900.0,
        light: 30_000.0,
        noise: 300.0,
        depth: BitDepth::Sixteen,
        ..Exposure::default()
    };
    let soft = Exposure {
        blur: 1.8,
        ..Exposure::default()
    };
    for (name, exposure) in [
        ("clipped", clipped),
        ("sloping", sloping),
        ("deep", deep),
        ("soft", soft),
    ] {
        let accuracy = accuracy(&found_in(&canvas, &exposure), &centres);
        assert_eq!(accuracy.found, 64, "{name}");
        assert!(accuracy.rms < 0.012, "{name} {}", accuracy.rms);
        // 128 coordinates give the ratio to 6 %; four times that.
        assert!(
            (0.76..1.24).contains(&accuracy.ratio),
            "{name} {}",
            accuracy.ratio
        );
    }
}

#[test]
fn near_neighbours_do_not_draw_a_centre() {
    let mut canvas = Canvas::new(400, 60);
    let mut centres = Vec::new();
    for pair in 0..10 {
        let left = Vector2::new(
            20.0 + 38.37 * f64::from(pair),
            30.0 + 0.17 * f64::from(pair),
        );
        // A gap of four pixels between the edges.
        for centre in [left, left + Vector2::new(14.0, 0.0)] {
            canvas.dot(centre, round(10.0));
            centres.push(centre);
        }
    }
    let accuracy = accuracy(&found_in(&canvas, &Exposure::default()), &centres);
    assert_eq!(accuracy.found, 20);
    assert!(accuracy.ratio < 1.4, "{}", accuracy.ratio);
}

#[test]
fn what_is_cut_or_covered_is_refused_with_a_reason() {
    let mut canvas = Canvas::new(160, 60);
    canvas.dot(Vector2::new(2.0, 30.0), round(14.0));
    canvas.dot(Vector2::new(60.0, 30.0), round(14.0));
    // Something dark covers the right third of the second dot.
    canvas.paint(Vector2::new(67.0, 30.0), 5.0, 0.0, |_| true);
    canvas.dot(Vector2::new(120.0, 30.0), round(14.0));
    let detections = found_in(&canvas, &Exposure::default());
    assert_eq!(detections.dots.len(), 1, "{:?}", detections.dots);
    let reason_near = |x: f64| {
        detections
            .rejected
            .iter()
            .find(|r| (r.place_px.x - x).abs() < 8.0)
            .map(|r| r.reason.clone())
    };
    assert!(reason_near(2.0).unwrap().contains("border"));
    assert!(reason_near(60.0).unwrap().contains("covered"));
}

#[test]
fn an_empty_or_noisy_picture_holds_no_targets() {
    for noise in [0.0, 3.0] {
        let exposure = Exposure {
            noise,
            ..Exposure::default()
        };
        let detections = found_in(&Canvas::new(300, 200), &exposure);
        assert!(detections.dots.is_empty());
    }
    let tiny = GreyImage::new(1, 1, BitDepth::Eight, vec![255]).unwrap();
    assert!(
        detect(&tiny, &Family::ALL, &DetectSettings::default())
            .dots
            .is_empty()
    );
}

struct RingScore {
    shown: usize,
    right: usize,
    wrong: usize,
}

/// Shows codes of a family at random turns and tilts up to `tilt`, with dots of `radius` px.
fn ring_score(segments: u8, radius: f64, tilt: f64, seed: u64) -> RingScore {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let step = (8.5 * radius).max(30.0);
    let (columns, rows) = (6, 4);
    let mut canvas = Canvas::new(
        (step * f64::from(columns)) as usize,
        (step * f64::from(rows)) as usize,
    );
    let table = ring_table(segments);
    // A code is shown once.
    let ids = rand::seq::index::sample(&mut rng, table.len(), (columns * rows) as usize).into_vec();
    let mut shown = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let id = ids[(row * columns + column) as usize];
            let off = Vector2::new(rng.random::<f64>(), rng.random::<f64>());
            let centre = Vector2::new(f64::from(column) + 0.5, f64::from(row) + 0.5) * step + off;
            let turn = rng.random::<f64>() * 2.0 * PI;
            let along = rng.random::<f64>() * PI;
            let view = ObliqueView::new(
                centre,
                radius,
                turn,
                tilt * rng.random::<f64>().sqrt(),
                along,
                200.0,
            );
            view.paint_ring(&mut canvas, table[id], segments, 3.6 * radius + 2.0);
            shown.push((view.dot_centre(), id as u32 + 1));
        }
    }
    let detections = detect(
        &canvas.expose(&Exposure::default()),
        &[Family::Ring(segments)],
        &DetectSettings::default(),
    );
    let mut score = RingScore {
        shown: shown.len(),
        right: 0,
        wrong: 0,
    };
    for code in &detections.codes {
        let centre = detections.dots[code.dots[0].slot()].centre_px;
        let true_one = shown
            .iter()
            .any(|(place, id)| (place - centre).norm() < 0.5 && *id == code.id);
        match (&code.doubt, true_one) {
            (Some(_), _) => {}
            (None, true) => score.right += 1,
            (None, false) => score.wrong += 1,
        }
    }
    score
}

#[test]
fn ring_codes_are_read_right_or_not_at_all() {
    let near_all = [
        (12, 8.0, 65.0),
        (14, 8.0, 65.0),
        (20, 10.0, 65.0),
        (14, 5.0, 50.0),
        (12, 3.0, 40.0),
        (14, 3.0, 40.0),
        (20, 5.0, 40.0),
    ];
    for (segments, radius, tilt) in near_all {
        let score = ring_score(segments, radius, f64::to_radians(tilt), 11);
        assert_eq!(score.wrong, 0, "ring{segments} radius {radius}");
        // One of 24 may meet an unlucky turn.
        assert!(
            score.right + 1 >= score.shown,
            "ring{segments} radius {radius}: {}",
            score.right
        );
    }
}

#[test]
fn the_same_digits_come_from_any_number_of_threads() {
    let (canvas, _) = field(6, 6, 26.0, 5, |_| round(11.0));
    let image = canvas.expose(&Exposure::default());
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| detect(&image, &Family::ALL, &DetectSettings::default()))
    };
    assert_eq!(with(1), with(3));
}
