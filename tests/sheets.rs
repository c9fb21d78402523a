//! Printed sheets are read back: what the program draws, rasterised by another program and seen as a camera sees it,
//! has its own numbers at its own places, at its true size.
//!
//! The raster is that of Debian's `pdftoppm`; where it is missing the tests say so in one line and check nothing.

mod common;

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::process::Command;
use std::sync::Once;

use common::Folder;
use nalgebra::Vector2;
use rand::seq::index::sample;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tiepoint::imaging::{BitDepth, GreyImage, LoadSettings, load_picture};
use tiepoint::targets::sheet::{
    PAGE_HEIGHT_MM, PAGE_WIDTH_MM, Page, Shape, SheetSettings, Tone, sheet,
};
use tiepoint::targets::{DetectSettings, Detections, Family, detect};

/// Resolution of the rasters: dots of 5 mm are 14 px wide, as in pictures of a campaign.
const DOTS_PER_INCH: f64 = 72.0;
/// Pages are rasterised so many times finer, and reduced.
const FINER: usize = 4;
const PX_PER_MM: f64 = DOTS_PER_INCH / 25.4;
/// What is seen of the dark table on which a page lies, on each side, px.
const TABLE_PX: usize = 40;

/// Where a place of a page is seen.
fn seen_at(place_mm: &Vector2<f64>) -> Vector2<f64> {
    place_mm * PX_PER_MM + Vector2::repeat(TABLE_PX as f64)
}

/// The codes that a page holds by label, each with the place of its first dot, px.
fn expected(page: &Page) -> BTreeMap<String, Vector2<f64>> {
    let mut codes = BTreeMap::new();
    let mut first_dot = None;
    for shape in &page.shapes {
        match shape {
            Shape::Disc { centre, .. } => {
                first_dot.get_or_insert_with(|| seen_at(centre));
            }
            Shape::Text { words, .. } => {
                // The text at the foot belongs to no code.
                codes.extend(first_dot.take().map(|place| (words.clone(), place)));
            }
            _ => {}
        }
    }
    codes
}

/// Asserts that these codes were read, each once, at their places, and no others.
#[track_caller]
fn assert_read(detections: &Detections, page: &Page) {
    /// The raster of the page is printed at whole pixels: a shift of less than half of one.
    const NEAR_PX: f64 = 0.5;
    let expected = expected(page);
    let mut read = BTreeMap::new();
    for code in &detections.codes {
        let label = code.family.code_label(code.id);
        assert_eq!(code.doubt, None, "{label}");
        let place = detections.dots[code.dots[0].slot()].centre_px;
        let other = read.insert(label.clone(), place);
        assert_eq!(other, None, "{label} is read twice");
    }
    let labels = |codes: &BTreeMap<String, Vector2<f64>>| codes.keys().cloned().collect::<Vec<_>>();
    assert_eq!(labels(&read), labels(&expected));
    for (label, place) in &read {
        let off = (place - expected[label]).norm();
        assert!(off < NEAR_PX, "{label} is {off} px off");
    }
}

/// The means of blocks of pixels: a rasteriser puts edges onto its own pixels, which must be finer than the camera's. Blocks
/// beyond the border are filled up with what is there.
fn reduced(fine: &GreyImage) -> GreyImage {
    let [width, height] = [fine.width(), fine.height()].map(|size| size.div_ceil(FINER));
    let block = |slot: usize| {
        let [columns, rows] = [(slot % width, fine.width()), (slot / width, fine.height())]
            .map(|(block, end)| block * FINER..((block + 1) * FINER).min(end));
        let pixels = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
        let (sum, count) = pixels.fold((0, 0), |(sum, count), (x, y)| {
            (sum + u32::from(fine.row(y)[x]), count + 1)
        });
        ((sum + count / 2) / count) as u16
    };
    let samples = (0..width * height).map(block).collect();
    GreyImage::new(width as u32, height as u32, fine.depth(), samples).expect("all pixels")
}

/// The pages of a PDF as pictures; `None` where there is no `pdftoppm`.
fn rasters(folder: &Folder, pdf: &str) -> Option<Vec<GreyImage>> {
    let resolution = (DOTS_PER_INCH * FINER as f64).to_string();
    let raster = Command::new("pdftoppm")
        .args(["-r", &resolution, "-gray", pdf, "page"])
        .current_dir(folder.path())
        .status();
    match raster {
        Ok(status) => assert!(status.success(), "pdftoppm {pdf}: {status}"),
        Err(error) => {
            // Straight to the terminal, once: what a passing test prints is kept back.
            static SAID: Once = Once::new();
            SAID.call_once(|| {
                let line = format!(
                    "tests/sheets.rs read no sheet: pdftoppm (Debian package poppler-utils): {error}\n"
                );
                io::stderr().write_all(line.as_bytes()).expect("a terminal");
            });
            return None;
        }
    }
    let pages = folder
        .names()
        .into_iter()
        .filter(|n| n.starts_with("page-"));
    Some(
        pages
            .map(|name| {
                let fine = load_picture(&folder.at(&name), &LoadSettings::default());
                reduced(&fine.unwrap_or_else(|e| panic!("{e}")).image)
            })
            .collect(),
    )
}

/// A raster as a camera sees the print on a dark table: black is not 0, white does not clip, edges are blurred, and
/// there is noise.
fn seen(raster: &GreyImage, seed: u64) -> GreyImage {
    const BLACK: f64 = 20.0;
    const WHITE: f64 = 190.0;
    /// Standard deviation of the sum of four numbers that are even in 0..1.
    const FOUR_EVEN: f64 = 0.577;
    const NOISE: f64 = 1.5;
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let [width, height] = [raster.width(), raster.height()].map(|size| size + 2 * TABLE_PX);
    let share = |x: usize, y: usize| {
        let on_page =
            (TABLE_PX..width - TABLE_PX).contains(&x) && (TABLE_PX..height - TABLE_PX).contains(&y);
        match on_page {
            true => f64::from(raster.at(x - TABLE_PX, y - TABLE_PX)) / 255.0,
            false => 0.0,
        }
    };
    let mut samples = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            // The binomial 1 2 1 both ways: a blur of 0.7 px. The table fills what lies beyond the picture.
            let across =
                |y: usize| share(x.wrapping_sub(1), y) + 2.0 * share(x, y) + share(x + 1, y);
            let blurred = (across(y.wrapping_sub(1)) + 2.0 * across(y) + across(y + 1)) / 16.0;
            let even: f64 = (0..4).map(|_| generator.random::<f64>() - 0.5).sum();
            let grey = BLACK + (WHITE - BLACK) * blurred + NOISE * even / FOUR_EVEN;
            samples.push(grey.round() as u16);
        }
    }
    GreyImage::new(width as u32, height as u32, BitDepth::Eight, samples).expect("all pixels")
}

/// The command that makes a sheet.
fn as_arguments(file: &str, settings: &SheetSettings) -> Vec<String> {
    let mut arguments: Vec<String> = [
        ("--sheet", file.to_owned()),
        ("--family", settings.family.to_string()),
        ("--ids", settings.ids.to_string()),
        ("--pitch-mm", settings.pitch_mm.to_string()),
        ("--dot-mm", settings.dot_mm.to_string()),
    ]
    .into_iter()
    .flat_map(|(option, value)| [option.to_owned(), value])
    .collect();
    arguments.insert(0, "codes".to_owned());
    arguments.extend(
        settings
            .per_page
            .iter()
            .map(|count| format!("--per-page={count}")),
    );
    if settings.targets == Tone::Black {
        arguments.push("--invert".to_owned());
    }
    arguments
}

/// Makes a sheet by the program, and reads every page of it.
fn read_back(settings: &SheetSettings) {
    let folder = Folder::new("sheet");
    let arguments = as_arguments("s.pdf", settings);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    folder.run(&arguments).done();
    let Some(rasters) = rasters(&folder, "s.pdf") else {
        return;
    };
    let sheet = sheet(settings).unwrap();
    assert_eq!(rasters.len(), sheet.pages.len());
    let mut codes = 0;
    for ((raster, page), seed) in rasters.iter().zip(&sheet.pages).zip(1..) {
        let size = [raster.width(), raster.height()];
        let expected = [PAGE_WIDTH_MM, PAGE_HEIGHT_MM].map(|mm| (mm * PX_PER_MM).ceil() as usize);
        assert_eq!(size, expected);
        let picture = match settings.targets {
            Tone::White => seen(raster, seed),
            // A negative of the page, on the same table.
            Tone::Black => seen(&raster.inverted(), seed),
        };
        let detections = detect(&picture, &[settings.family], &DetectSettings::default());
        assert_read(&detections, page);
        codes += detections.codes.len();
        if settings.family == Family::Dot420 {
            assert_true_to_size(&detections, settings.pitch_mm);
        }
    }
    let asked = settings.ids.numbers(settings.family.code_count());
    assert_eq!(codes, asked.unwrap().len());
}

/// O, A and B of every code stand six pitches apart.
#[track_caller]
fn assert_true_to_size(detections: &Detections, pitch_mm: f64) {
    /// The rules of the trade ask 0.1 % of a print.
    const LARGEST_SHARE: f64 = 1e-3;
    for code in &detections.codes {
        let [o, a, b] = [0, 1, 2].map(|slot| detections.dots[code.dots[slot].slot()].centre_px);
        for axis in [a - o, b - o] {
            let share = axis.norm() / (6.0 * pitch_mm * PX_PER_MM) - 1.0;
            assert!(share.abs() < LARGEST_SHARE, "C{}: {share}", code.id);
        }
    }
}

fn whole(family: Family) -> SheetSettings {
    SheetSettings {
        family,
        ids: format!("1-{}", family.code_count()).parse().unwrap(),
        ..SheetSettings::default()
    }
}

#[test]
fn every_six_dot_code_is_read_from_its_sheet() {
    read_back(&whole(Family::Dot420));
}

#[test]
fn every_ring_code_of_twelve_segments_is_read_from_its_sheet() {
    read_back(&whole(Family::Ring(12)));
}

#[test]
fn every_ring_code_of_fourteen_segments_is_read_from_its_sheet() {
    read_back(&whole(Family::Ring(14)));
}

#[test]
fn five_hundred_ring_codes_of_twenty_segments_are_read_from_their_sheet() {
    let family = Family::Ring(20);
    let mut generator = ChaCha8Rng::seed_from_u64(20);
    let ids: Vec<String> = sample(&mut generator, family.code_count() as usize, 500)
        .into_iter()
        .map(|slot| (slot + 1).to_string())
        .collect();
    let settings = SheetSettings {
        ids: ids.join(",").parse().unwrap(),
        ..whole(family)
    };
    read_back(&settings);
}

#[test]
fn black_targets_on_white_are_read_in_the_negative() {
    for family in [Family::Dot420, Family::Ring(14)] {
        read_back(&SheetSettings {
            family,
            ids: "7-20,100-140".parse().unwrap(),
            targets: Tone::Black,
            ..SheetSettings::default()
        });
    }
}

#[test]
fn targets_of_another_size_are_read_from_their_sheet() {
    read_back(&SheetSettings {
        ids: "1,60,200,420".parse().unwrap(),
        pitch_mm: 9.0,
        dot_mm: 8.0,
        per_page: Some(3),
        ..SheetSettings::default()
    });
}

/// The same shapes as in the PDF: what lies where, as text.
#[test]
fn an_svg_holds_the_dots_at_their_places() {
    let folder = Folder::new("svg");
    let settings = SheetSettings {
        ids: "17".parse().unwrap(),
        ..SheetSettings::default()
    };
    folder
        .run(&["codes", "--sheet", "S.SVG", "--ids", "17"])
        .done();
    let text = folder.text("S.SVG");
    assert!(text.contains("width=\"210mm\" height=\"297mm\" viewBox=\"0 0 210 297\""));
    let attribute = |line: &str, name: &str| -> f64 {
        let (_, rest) = line.split_once(&format!(" {name}=\"")).unwrap();
        rest.split('"').next().unwrap().parse().unwrap()
    };
    let circles: Vec<[f64; 3]> = text
        .lines()
        .filter(|line| line.starts_with("<circle"))
        .map(|line| ["cx", "cy", "r"].map(|name| attribute(line, name)))
        .collect();
    assert_eq!(circles.len(), 6);
    // O, A, B: the pitch is 5 mm, A to the right of O, B above it.
    let [o, a, b] = [circles[0], circles[1], circles[2]];
    assert_eq!([a[0] - o[0], a[1] - o[1], a[2]], [30.0, 0.0, 2.5]);
    assert_eq!([b[0] - o[0], b[1] - o[1], b[2]], [0.0, -30.0, 2.5]);
    let page = &sheet(&settings).unwrap().pages[0];
    let discs = page.shapes.iter().filter_map(|shape| match shape {
        Shape::Disc { centre, radius, .. } => Some([centre.x, centre.y, *radius]),
        _ => None,
    });
    assert!(discs.eq(circles), "{text}");
    assert!(text.contains(">C17</text>") && text.contains(">100 mm: "));
}

#[test]
fn what_cannot_be_printed_is_refused_in_a_line() {
    let folder = Folder::new("refused");
    folder.write("file", "");
    for (arguments, words) in [
        ("--sheet s.txt", &["s.txt", ".txt", ".pdf or .svg"][..]),
        ("--sheet s", &["no ending", ".pdf or .svg"]),
        ("", &["--table", "--sheet"]),
        ("--sheet s.pdf --table t.csv", &["--table", "--sheet"]),
        ("--sheet s.pdf --ids 421", &["421", "1 to 420", "dot420"]),
        ("--sheet s.pdf --ids 0-3", &["code 0", "1 to 420"]),
        ("--sheet s.pdf --ids 1-", &["--ids", "'1-'", "1-32,40"]),
        ("--sheet s.pdf --ids 5-4", &["--ids", "'5-4'"]),
        ("--sheet s.pdf --family ring13", &["ring13", "ring14"]),
        (
            "--sheet s.pdf --dot-mm 10",
            &["10 mm", "pitch of 5 mm", "less than 10 mm"],
        ),
        ("--sheet s.pdf --dot-mm 0", &["dot of 0 mm"]),
        ("--sheet s.pdf --pitch-mm -5", &["pitch of -5 mm"]),
        ("--sheet s.pdf --pitch-mm nan", &["pitch of NaN mm"]),
        ("--sheet s.pdf --pitch-mm five", &["--pitch-mm", "five"]),
        (
            "--sheet s.pdf --pitch-mm 50 --dot-mm 5",
            &["405.0 x", "194 x 271 mm"],
        ),
        ("--sheet s.pdf --per-page 21", &["21 codes", "1 to 20"]),
        ("--sheet s.pdf --per-page 0", &["0 codes", "1 to 20"]),
        ("--sheet file/s.pdf", &["file/s.pdf", "cannot be written"]),
        ("--table t.csv --invert", &["--table", "--invert"]),
    ] {
        let all: Vec<&str> = ["codes"]
            .into_iter()
            .chain(arguments.split_whitespace())
            .collect();
        folder.run(&all).refused(2, words);
    }
    assert_eq!(folder.names(), ["file"]);
}
