//! Sheets of targets as SVG.

use std::fmt::Write;

use nalgebra::Vector2;

use crate::targets::sheet::{PAGE_HEIGHT_MM, PAGE_WIDTH_MM, Shape, Sheet, Tone, on_circle};

/// A sheet as an SVG document in which one unit is a millimetre. SVG has no pages: they lie one below the other.
#[must_use]
pub fn sheet_svg(sheet: &Sheet) -> String {
    let height = PAGE_HEIGHT_MM * sheet.pages.len() as f64;
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{PAGE_WIDTH_MM}mm\" height=\"{height}mm\" \
         viewBox=\"0 0 {PAGE_WIDTH_MM} {height}\" font-family=\"Helvetica, Arial, sans-serif\">\n\
         <title>{}</title>\n<rect width=\"{PAGE_WIDTH_MM}\" height=\"{height}\" fill=\"white\"/>\n",
        sheet.title
    );
    for (number, page) in sheet.pages.iter().enumerate() {
        let top = PAGE_HEIGHT_MM * number as f64;
        text.push_str(&format!("<g transform=\"translate(0 {top})\">\n"));
        for shape in &page.shapes {
            // A String takes all that is written.
            let _ = writeln!(text, "{}", element(shape));
        }
        text.push_str("</g>\n");
    }
    text.push_str("</svg>\n");
    text
}

fn element(shape: &Shape) -> String {
    match shape {
        Shape::Rectangle { corner, size, tone } => format!(
            "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"{}\"/>",
            mm(corner.x),
            mm(corner.y),
            mm(size.x),
            mm(size.y),
            colour(*tone)
        ),
        Shape::Disc {
            centre,
            radius,
            tone,
        } => format!(
            "<circle cx=\"{}\" cy=\"{}\" r=\"{}\" fill=\"{}\"/>",
            mm(centre.x),
            mm(centre.y),
            mm(*radius),
            colour(*tone)
        ),
        Shape::RingSector {
            centre,
            inner,
            outer,
            begin,
            end,
            tone,
        } => {
            let at = |radius: f64, direction: f64| place(on_circle(*centre, radius, direction));
            // The arc of more than half a turn, clockwise outside, back inside.
            let large = u8::from(end - begin > std::f64::consts::PI);
            format!(
                "<path d=\"M{} A{o} {o} 0 {large} 1 {} L{} A{i} {i} 0 {large} 0 {} Z\" fill=\"{}\"/>",
                at(*outer, *begin),
                at(*outer, *end),
                at(*inner, *end),
                at(*inner, *begin),
                colour(*tone),
                o = mm(*outer),
                i = mm(*inner),
            )
        }
        Shape::Line { from, to, width } => format!(
            "<path d=\"M{} L{}\" stroke=\"black\" stroke-width=\"{}\"/>",
            place(*from),
            place(*to),
            mm(*width)
        ),
        Shape::Text {
            place,
            size,
            words,
            tone,
        } => format!(
            "<text x=\"{}\" y=\"{}\" font-size=\"{}\" fill=\"{}\">{words}</text>",
            mm(place.x),
            mm(place.y),
            mm(*size),
            colour(*tone)
        ),
    }
}

fn colour(tone: Tone) -> &'static str {
    match tone {
        Tone::Black => "black",
        Tone::White => "white",
    }
}

fn place(place: Vector2<f64>) -> String {
    format!("{} {}", mm(place.x), mm(place.y))
}

/// A length to a tenth of a micrometre.
fn mm(length: f64) -> f64 {
    // Adding zero makes a negative zero positive.
    (length * 1e4).round() / 1e4 + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::targets::sheet::{SheetSettings, sheet};

    #[test]
    fn a_ring_code_is_a_disc_and_its_runs() {
        let settings = SheetSettings {
            family: "ring14".parse().unwrap(),
            ids: "1".parse().unwrap(),
            ..SheetSettings::default()
        };
        let text = sheet_svg(&sheet(&settings).unwrap());
        assert!(text.starts_with(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"210mm\" height=\"297mm\" viewBox=\"0 0 210 297\""
        ));
        // No. 1 is 00000010000001: two single segments, opposite each other.
        assert_eq!(text.matches("<circle").count(), 1);
        assert_eq!(text.matches("A7.5 7.5 0 0 1 ").count(), 2);
        assert_eq!(text.matches("A5 5 0 0 0 ").count(), 2);
        assert!(text.contains(">R14-1</text>") && text.ends_with("</g>\n</svg>\n"));
    }

    #[test]
    fn pages_lie_one_below_the_other() {
        let text = sheet_svg(&sheet(&SheetSettings::default()).unwrap());
        assert!(text.contains("height=\"594mm\"") && text.contains("translate(0 297)"));
        assert_eq!(text.matches("<circle").count(), 6 * 32);
    }
}
