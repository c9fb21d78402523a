//! Sheets of targets as PDF: vectors, true to size.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::Vector2;
use pdf_writer::types::LineCapStyle;
use pdf_writer::{Content, Finish, Name, Pdf, Rect, Ref, Str, TextStr};

use crate::targets::sheet::{PAGE_HEIGHT_MM, PAGE_WIDTH_MM, Page, Shape, Sheet, Tone, on_circle};

const POINTS_PER_MM: f64 = 72.0 / 25.4;
const FONT: Name<'static> = Name(b"F");

/// A sheet as a PDF document, one page after the other.
#[must_use]
pub fn sheet_pdf(sheet: &Sheet) -> Vec<u8> {
    let [catalog, tree, font, about] = [1, 2, 3, 4].map(Ref::new);
    let page_of = |number: usize| Ref::new(5 + 2 * number as i32);
    let content_of = |number: usize| Ref::new(6 + 2 * number as i32);
    let mut pdf = Pdf::new();
    let mut root = pdf.catalog(catalog);
    root.pages(tree);
    // Asks the printing dialog not to fit the page to the paper.
    root.viewer_preferences()
        .pair(Name(b"PrintScaling"), Name(b"None"));
    root.finish();
    pdf.document_info(about).title(TextStr(&sheet.title));
    pdf.pages(tree)
        .media_box(Rect::new(
            0.0,
            0.0,
            (PAGE_WIDTH_MM * POINTS_PER_MM) as f32,
            (PAGE_HEIGHT_MM * POINTS_PER_MM) as f32,
        ))
        .kids((0..sheet.pages.len()).map(page_of))
        .count(sheet.pages.len() as i32)
        .resources()
        .fonts()
        .pair(FONT, font);
    // One of the fonts that every reader has.
    pdf.type1_font(font).base_font(Name(b"Helvetica"));
    for (number, page) in sheet.pages.iter().enumerate() {
        pdf.page(page_of(number))
            .parent(tree)
            .contents(content_of(number));
        pdf.stream(content_of(number), &content(page));
    }
    pdf.finish()
}

fn content(page: &Page) -> Vec<u8> {
    let mut content = Content::new();
    // From here on the units are mm from the top-left corner, y down, as on the page.
    let scale = POINTS_PER_MM as f32;
    let top = (PAGE_HEIGHT_MM * POINTS_PER_MM) as f32;
    content.transform([scale, 0.0, 0.0, -scale, 0.0, top]);
    content.set_line_cap(LineCapStyle::ButtCap);
    for shape in &page.shapes {
        draw(&mut content, shape);
    }
    content.finish().to_vec()
}

fn draw(content: &mut Content, shape: &Shape) {
    /// Where the curves of a circle meet: off its topmost, lowest and outermost places, at which some rasterisers
    /// draw a joint of two curves too far out.
    const JOINTS: [f64; 2] = [0.125 * TAU, 1.125 * TAU];
    match shape {
        Shape::Rectangle { corner, size, tone } => {
            fill_with(content, *tone);
            content.rect(mm(corner.x), mm(corner.y), mm(size.x), mm(size.y));
            content.fill_nonzero();
        }
        Shape::Disc {
            centre,
            radius,
            tone,
        } => {
            fill_with(content, *tone);
            let start = on_circle(*centre, *radius, JOINTS[0]);
            content.move_to(mm(start.x), mm(start.y));
            arc(content, *centre, *radius, JOINTS);
            content.close_path().fill_nonzero();
        }
        Shape::RingSector {
            centre,
            inner,
            outer,
            begin,
            end,
            tone,
        } => {
            fill_with(content, *tone);
            let start = on_circle(*centre, *outer, *begin);
            content.move_to(mm(start.x), mm(start.y));
            arc(content, *centre, *outer, [*begin, *end]);
            let turn = on_circle(*centre, *inner, *end);
            content.line_to(mm(turn.x), mm(turn.y));
            arc(content, *centre, *inner, [*end, *begin]);
            content.close_path().fill_nonzero();
        }
        Shape::Line { from, to, width } => {
            content.set_stroke_gray(grey(Tone::Black));
            content.set_line_width(mm(*width));
            content.move_to(mm(from.x), mm(from.y));
            content.line_to(mm(to.x), mm(to.y)).stroke();
        }
        Shape::Text {
            place,
            size,
            words,
            tone,
        } => {
            fill_with(content, *tone);
            content.begin_text();
            content.set_font(FONT, mm(*size));
            // Letters stand upright although y points down.
            content.set_text_matrix([1.0, 0.0, 0.0, -1.0, mm(place.x), mm(place.y)]);
            content.show(Str(words.as_bytes()));
            content.end_text();
        }
    }
}

/// An arc from the current point as cubic curves of at most a quarter turn, each of which leaves the circle by at most
/// 0.03 % of the radius (less than a micrometre on a dot of 5 mm): control points at 4/3 tan(angle/4) radii along the tangents.
fn arc(content: &mut Content, centre: Vector2<f64>, radius: f64, [begin, end]: [f64; 2]) {
    let parts = ((end - begin).abs() / FRAC_PI_2 - 1e-9).ceil().max(1.0);
    let step = (end - begin) / parts;
    let reach = 4.0 / 3.0 * (0.25 * step).tan() * radius;
    let along = |direction: f64| Vector2::new(direction.cos(), direction.sin()) * reach;
    for part in 0..parts as u32 {
        let (from, to) = (
            begin + step * f64::from(part),
            begin + step * f64::from(part + 1),
        );
        let first = on_circle(centre, radius, from) + along(from);
        let end = on_circle(centre, radius, to);
        let second = end - along(to);
        content.cubic_to(
            mm(first.x),
            mm(first.y),
            mm(second.x),
            mm(second.y),
            mm(end.x),
            mm(end.y),
        );
    }
}

fn fill_with(content: &mut Content, tone: Tone) {
    content.set_fill_gray(grey(tone));
}

fn grey(tone: Tone) -> f32 {
    match tone {
        Tone::Black => 0.0,
        Tone::White => 1.0,
    }
}

/// A length to a tenth of a micrometre: a shorter file that says the same.
fn mm(length: f64) -> f32 {
    ((length * 1e4).round() / 1e4) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::targets::sheet::{SheetSettings, sheet};

    #[test]
    fn a_document_has_its_pages_at_their_size() {
        let bytes = sheet_pdf(&sheet(&SheetSettings::default()).unwrap());
        let text = String::from_utf8_lossy(&bytes);
        assert!(text.starts_with("%PDF-") && text.trim_end().ends_with("%%EOF"));
        assert!(text.contains("/Count 2") && text.contains("/PrintScaling /None"));
        assert!(text.contains("/MediaBox [0 0 595.2756 841.8898]"));
        assert!(text.contains("2.8346457 0 0 -2.8346457 0 841.8898 cm"));
        assert!(text.contains("(C32) Tj"));
    }

    /// The curves of an arc keep its radius.
    #[test]
    fn arcs_are_round() {
        let mut content = Content::new();
        arc(&mut content, Vector2::zeros(), 1000.0, [0.3, 2.9]);
        let bytes = content.finish();
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let mut here = on_circle(Vector2::zeros(), 1000.0, 0.3);
        let mut curves = 0;
        for line in text.lines() {
            let n: Vec<f64> = line
                .split(' ')
                .filter_map(|word| word.parse().ok())
                .collect();
            let [a, b, c] = [0, 2, 4].map(|i| Vector2::new(n[i], n[i + 1]));
            for part in 0..=8 {
                let t = f64::from(part) / 8.0;
                let s = 1.0 - t;
                let place = here * s.powi(3)
                    + a * (3.0 * s * s * t)
                    + b * (3.0 * s * t * t)
                    + c * t.powi(3);
                assert!((place.norm() - 1000.0).abs() < 0.3, "{place}");
            }
            here = c;
            curves += 1;
        }
        assert_eq!(curves, 2);
        assert!((here - on_circle(Vector2::zeros(), 1000.0, 2.9)).norm() < 1e-3);
    }
}
