//! Damaged picture files and pictures of anything: what a reader and detection must survive.

use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::{Duration, Instant};

use image::{DynamicImage, GrayImage, ImageBuffer, ImageFormat};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tiepoint::imaging::{BitDepth, GreyImage, LoadSettings, load_picture};
use tiepoint::targets::{DetectSettings, Family, detect};

const FORMATS: [ImageFormat; 5] = [
    ImageFormat::Png,
    ImageFormat::Jpeg,
    ImageFormat::Tiff,
    ImageFormat::Bmp,
    ImageFormat::Pnm,
];

/// Damaged headers may tell of any size; nobody's memory is to be filled by a test.
const SMALL: LoadSettings = LoadSettings {
    largest_side_px: 4000,
    largest_megapixels: 4,
};

/// What came of some cases.
#[derive(Clone, Debug, Default)]
pub(crate) struct Survived {
    /// Files that were still pictures.
    pub(crate) read: usize,
    /// Files that were refused in a line.
    pub(crate) refused: usize,
    /// Pictures in which targets were looked for.
    pub(crate) detected: usize,
    /// Dots found in them.
    pub(crate) dots: usize,
    /// The longest case.
    pub(crate) slowest: Duration,
}

/// Tries a case; the reason where it panics.
pub(crate) fn survive(case: u64, folder: &Path, survived: &mut Survived) -> Result<(), String> {
    let begun = Instant::now();
    let mut random = ChaCha8Rng::seed_from_u64(case);
    let tried = catch_unwind(AssertUnwindSafe(|| match case % 3 {
        0 => looked_at(&anything(&mut random), survived),
        _ => damaged_file(&mut random, folder, survived),
    }));
    survived.slowest = survived.slowest.max(begun.elapsed());
    tried.map_err(|_| format!("case {case} panics"))
}

fn looked_at(picture: &GreyImage, survived: &mut Survived) {
    let families = [
        Family::Dot420,
        Family::Ring(12),
        Family::Ring(14),
        Family::Ring(20),
    ];
    let found = detect(picture, &families, &DetectSettings::default());
    survived.detected += 1;
    survived.dots += found.dots.len();
    for dot in &found.dots {
        let inside = dot.centre_px.x >= 0.0
            && dot.centre_px.y >= 0.0
            && dot.centre_px.x <= picture.width() as f64
            && dot.centre_px.y <= picture.height() as f64;
        assert!(
            inside && dot.sigma_px.is_finite() && dot.sigma_px > 0.0,
            "{dot:?}"
        );
    }
}

fn damaged_file(random: &mut ChaCha8Rng, folder: &Path, survived: &mut Survived) {
    let picture = anything(random);
    let (width, height) = (picture.width() as u32, picture.height() as u32);
    let format = FORMATS[random.random_range(0..FORMATS.len())];
    let eight = |grey: u16| {
        (grey
            >> if picture.depth() == BitDepth::Sixteen {
                8
            } else {
                0
            }) as u8
    };
    let grey = GrayImage::from_raw(
        width,
        height,
        picture.samples().iter().map(|&grey| eight(grey)).collect(),
    );
    let mut whole = DynamicImage::ImageLuma8(grey.expect("a full picture"));
    if random.random_bool(0.3) {
        whole = DynamicImage::ImageRgb8(whole.to_rgb8());
    } else if random.random_bool(0.3) && matches!(format, ImageFormat::Png | ImageFormat::Tiff) {
        let sixteen = ImageBuffer::from_raw(width, height, picture.samples().to_vec());
        whole = DynamicImage::ImageLuma16(sixteen.expect("a full picture"));
    }
    let mut bytes = Cursor::new(Vec::new());
    whole
        .write_to(&mut bytes, format)
        .expect("the picture is encoded");
    let mut bytes = bytes.into_inner();
    damage(random, &mut bytes);
    let file = folder.join("damaged");
    std::fs::write(&file, &bytes).expect("a file in the folder");
    match load_picture(&file, &SMALL) {
        Ok(picture) => {
            survived.read += 1;
            looked_at(&picture.image, survived);
        }
        Err(why) => {
            survived.refused += 1;
            let line = why.to_string();
            assert!(!line.contains('\n') && line.contains("expected"), "{line}");
        }
    }
}

fn damage(random: &mut ChaCha8Rng, bytes: &mut Vec<u8>) {
    for _ in 0..random.random_range(0..6) {
        if bytes.is_empty() {
            return;
        }
        // Headers are short and tell most.
        let reach = if random.random_bool(0.5) {
            bytes.len().min(80)
        } else {
            bytes.len()
        };
        let place = random.random_range(0..reach);
        match random.random_range(0..5) {
            0 => bytes[place] = random.random(),
            1 => bytes[place] ^= 1 << random.random_range(0..8),
            2 => bytes.truncate(place),
            3 => {
                let end = (place + random.random_range(1..40)).min(bytes.len());
                let copied = bytes[place..end].to_vec();
                bytes.splice(place..place, copied);
            }
            _ => {
                let end = (place + 4).min(bytes.len());
                bytes[place..end].fill([0x00, 0x7f, 0xff][random.random_range(0..3)]);
            }
        }
    }
}

/// A picture of anything: noise, slopes, blocks, lines, discs, all of it black or white.
fn anything(random: &mut ChaCha8Rng) -> GreyImage {
    let (width, height) = (
        random.random_range(1..260_usize),
        random.random_range(1..200_usize),
    );
    let depth = if random.random_bool(0.7) {
        BitDepth::Eight
    } else {
        BitDepth::Sixteen
    };
    let white = f64::from(depth.white());
    let noise = white * [0.0, 0.002, 0.02, 0.3][random.random_range(0..4)];
    let slope = white * [0.0, 0.001, 0.01][random.random_range(0..3)];
    // Every other picture is dark with light marks, so that there is something to find.
    let dark = random.random_bool(0.5);
    let ground = white * random.random::<f64>() * if dark { 0.15 } else { 1.0 };
    let marks: Vec<[f64; 6]> = (0..random.random_range(0..24))
        .map(|_| std::array::from_fn(|_| random.random::<f64>()))
        .collect();
    let mut samples = Vec::with_capacity(width * height);
    for row in 0..height {
        for column in 0..width {
            let (x, y) = (column as f64, row as f64);
            let mut grey = ground + slope * x;
            for [left, top, size, light, kind, aspect] in &marks {
                let (dx, dy) = (x - left * width as f64, y - top * height as f64);
                let (radius, aspect) = (1.0 + 30.0 * size * size, 0.1 + 0.9 * aspect);
                let inside = match (kind * 4.0) as u32 {
                    0 | 1 => (radius - dx.hypot(dy / aspect)) * aspect,
                    2 => (radius - dx.abs()).min(radius * aspect - dy.abs()),
                    _ => 1.0 + radius / 10.0 - (dx + aspect * dy).abs(),
                };
                let light = if dark { 0.4 + 0.6 * light } else { *light };
                // Edges run over a pixel and a half, as a lens leaves them.
                grey += (white * light - grey) * (inside / 1.5 + 0.5).clamp(0.0, 1.0);
            }
            grey += noise * (random.random::<f64>() - 0.5);
            samples.push(grey.round().clamp(0.0, white) as u16);
        }
    }
    GreyImage::new(width as u32, height as u32, depth, samples).expect("a full picture")
}
