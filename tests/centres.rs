//! Centres of dots against the exact picture: the short form of `cargo bench --bench centres`.

#[path = "../benches/centres/exact.rs"]
mod exact;

use exact::ExactDot;
use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tiepoint::imaging::{BitDepth, GreyImage};
use tiepoint::targets::{DetectSettings, Dot, detect};

const SIDE: usize = 400;
const AMPLITUDE: f64 = 150.0;

/// Diameter (px), incidence (deg), blur (px).
const SHAPES: [[f64; 3]; 8] = [
    [8.0, 0.0, 0.8],
    [8.0, 60.0, 0.8],
    [12.0, 40.0, 0.5],
    [12.0, 60.0, 1.2],
    [20.0, 20.0, 0.8],
    [20.0, 60.0, 1.2],
    [50.0, 0.0, 0.8],
    [50.0, 50.0, 1.2],
];

/// Nine dots of one shape anywhere within their pixels, drawn exactly; noise in grey values of 8 bit.
fn picture(shape: [f64; 3], depth: BitDepth, noise: f64) -> (Vec<ExactDot>, GreyImage) {
    let [diameter, incidence, blur] = shape;
    let mut random = ChaCha8Rng::seed_from_u64((diameter + 100.0 * incidence + 10.0 * blur) as u64);
    let gain = f64::from(depth.white()) / 255.0;
    let mut greys = vec![30.0 * gain; SIDE * SIDE];
    let mut dots = Vec::new();
    for slot in 0..9 {
        let place = Vector2::new((slot % 3) as f64, (slot / 3) as f64) * 130.0;
        let within = Vector2::new(random.random::<f64>(), random.random::<f64>());
        let turn = std::f64::consts::PI * random.random::<f64>();
        let centre = place + Vector2::new(65.0, 65.0) + within;
        let dot = ExactDot::seen(centre, diameter, incidence.to_radians(), turn, blur);
        let cover = dot.cover();
        for (slot, share) in cover.shares.iter().enumerate() {
            let column = cover.corner[0] + slot % cover.side;
            let row = cover.corner[1] + slot / cover.side;
            greys[row * SIDE + column] += gain * AMPLITUDE * share;
        }
        dots.push(dot);
    }
    let samples = greys
        .into_iter()
        .map(|grey| {
            // The sum of twelve even numbers is as good as a normal one here.
            let normal = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            (grey + gain * noise * normal)
                .round()
                .clamp(0.0, f64::from(depth.white())) as u16
        })
        .collect();
    let image = GreyImage::new(SIDE as u32, SIDE as u32, depth, samples).expect("a full picture");
    (dots, image)
}

fn found(dots: &[ExactDot], image: &GreyImage) -> Vec<(Dot, Vector2<f64>)> {
    let detections = detect(image, &[], &DetectSettings::default());
    assert_eq!(
        detections.dots.len(),
        dots.len(),
        "all dots and nothing else"
    );
    let near = |dot: &ExactDot| {
        let mut all = detections.dots.iter();
        all.find(|found| (found.centre_px - dot.centre).norm() < 1.0)
            .cloned()
    };
    dots.iter()
        .map(|dot| {
            let found = near(dot).expect("a dot near its place");
            let error = found.centre_px - dot.centre;
            (found, error)
        })
        .collect()
}

#[test]
fn centres_come_near_to_what_noise_allows_and_sigmas_say_so() {
    const NOISE: f64 = 2.0;
    let (mut by_bound, mut by_sigma, mut count) = (0.0, 0.0, 0.0);
    for shape in SHAPES {
        let (dots, image) = picture(shape, BitDepth::Eight, NOISE);
        let noise = NOISE.hypot(1.0 / 12.0_f64.sqrt());
        let bound = dots[0].bound() * 100.0 * noise / AMPLITUDE;
        for (dot, error) in found(&dots, &image) {
            by_bound += error.norm_squared() / bound.powi(2);
            by_sigma += error.norm_squared() / dot.sigma_px.powi(2);
            count += 2.0;
        }
    }
    // A ratio of 144 errors is known to 6 %: three times that beyond 1.07, which the long form finds.
    let (by_bound, by_sigma) = ((by_bound / count).sqrt(), (by_sigma / count).sqrt());
    assert!(
        (0.85..1.27).contains(&by_bound),
        "rms over bound {by_bound}"
    );
    assert!((0.8..1.2).contains(&by_sigma), "rms over sigma {by_sigma}");
}

#[test]
fn without_noise_centres_are_right_to_a_thousandth_of_a_pixel() {
    for shape in SHAPES {
        let (dots, image) = picture(shape, BitDepth::Sixteen, 0.0);
        for (_, error) in found(&dots, &image) {
            assert!(error.norm() < 1e-3, "{shape:?}: {error:?}");
        }
    }
}
