//! From codes and sizes to pages.

use nalgebra::Vector2;

use super::IdList;
use super::grid::{Grid, MARGIN_MM, capacity, room_mm};
use super::marks::{MarkSize, marks};
use super::shape::{PAGE_HEIGHT_MM, Page, Shape, Sheet, Tone};
use crate::targets::Family;

/// What is to be printed.
#[derive(Clone, Debug, PartialEq)]
pub struct SheetSettings {
    /// Code family.
    pub family: Family,
    /// Numbers of the codes.
    pub ids: IdList,
    /// Pitch of a `dot420` code, mm; ring codes have none. Default 5.
    pub pitch_mm: f64,
    /// Diameter of the dots, mm. Default 5.
    pub dot_mm: f64,
    /// Codes to a page; `None` as many as fit.
    pub per_page: Option<u32>,
    /// Colour of the targets: white, on black, is what detection looks for.
    pub targets: Tone,
}

impl Default for SheetSettings {
    fn default() -> Self {
        Self {
            family: Family::Dot420,
            ids: IdList::default(),
            pitch_mm: 5.0,
            dot_mm: 5.0,
            per_page: None,
            targets: Tone::White,
        }
    }
}

/// A sheet that cannot be printed, in one line.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SheetError {
    /// A number that the family does not have.
    #[error("found code {found}, expected 1 to {largest} in {family}")]
    NoSuchCode {
        /// The number.
        found: u32,
        /// Family asked for.
        family: Family,
        /// Its last number.
        largest: u32,
    },
    /// A length that is none.
    #[error("found a {what} of {found} mm, expected a length above 0")]
    NoLength {
        /// Pitch or dot.
        what: &'static str,
        /// Its size, mm.
        found: f64,
    },
    /// Dots larger than the distance of neighbours.
    #[error(
        "found dots of {dot_mm} mm at a pitch of {pitch_mm} mm, expected less than {} mm: neighbours in a code stand {} pitches apart",
        NEAREST_PITCHES * pitch_mm, NEAREST_PITCHES
    )]
    DotsOverlap {
        /// Diameter, mm.
        dot_mm: f64,
        /// Pitch, mm.
        pitch_mm: f64,
    },
    /// A code larger than the page.
    #[error("found codes of {:.1} x {:.1} mm, expected at most {:.0} x {:.0} mm: the page has no more room", tile.x, tile.y, room.x, room.y)]
    TooLarge {
        /// Size of a tile, mm.
        tile: Vector2<f64>,
        /// Room on a page, mm.
        room: Vector2<f64>,
    },
    /// More codes to a page than fit, or none.
    #[error("found {found} codes to a page, expected 1 to {most} of {:.1} x {:.1} mm", tile.x, tile.y)]
    PerPage {
        /// Number asked for.
        found: u32,
        /// Number that fits.
        most: usize,
        /// Size of a tile, mm.
        tile: Vector2<f64>,
    },
}

/// Two dots of a `dot420` code stand at least this many pitches apart.
const NEAREST_PITCHES: f64 = 2.0;
/// Largest size of the font of the numbers, mm.
const NUMBER_MM: f64 = 4.0;
/// Height of the strip for the number in sizes of the font.
const STRIP: f64 = 1.25;
/// Widest letter of a number in sizes of the font, with the usual sans-serif fonts.
const LETTER: f64 = 0.73;

/// The pages of these codes.
///
/// # Errors
/// [`SheetError`] for numbers and sizes that cannot be printed.
pub fn sheet(settings: &SheetSettings) -> Result<Sheet, SheetError> {
    let family = settings.family;
    let largest = family.code_count();
    let ids = settings
        .ids
        .numbers(largest)
        .map_err(|found| SheetError::NoSuchCode {
            found,
            family,
            largest,
        })?;
    let size = mark_size(settings)?;
    let tile = Tile::new(size, &ids);
    let per_page = per_page(settings, tile.size())?;
    let title = match family {
        Family::Dot420 => format!(
            "{family}, pitch {} mm, dots {} mm",
            size.pitch_mm, size.dot_mm
        ),
        Family::Ring(_) => format!("{family}, dots {} mm", size.dot_mm),
    };
    let count = ids.len().div_ceil(per_page);
    let grid = Grid::new(tile.size(), per_page);
    let pages = ids
        .chunks(per_page)
        .zip(1..)
        .map(|(ids, number)| {
            let mut shapes = Vec::new();
            for (slot, &id) in ids.iter().enumerate() {
                shapes.extend(tile.shapes(id, grid.corner(slot), settings.targets));
                shapes.extend(grid.cut_marks(slot));
            }
            shapes.extend(foot(&format!("{title}, page {number} of {count}")));
            Page { shapes }
        })
        .collect();
    Ok(Sheet { title, pages })
}

fn mark_size(settings: &SheetSettings) -> Result<MarkSize, SheetError> {
    let SheetSettings {
        family,
        pitch_mm,
        dot_mm,
        ..
    } = *settings;
    for (what, found) in [("pitch", pitch_mm), ("dot", dot_mm)] {
        if !(found > 0.0 && found.is_finite()) {
            return Err(SheetError::NoLength { what, found });
        }
    }
    if family == Family::Dot420 && dot_mm >= NEAREST_PITCHES * pitch_mm {
        return Err(SheetError::DotsOverlap { dot_mm, pitch_mm });
    }
    Ok(MarkSize {
        family,
        pitch_mm,
        dot_mm,
    })
}

fn per_page(settings: &SheetSettings, tile: Vector2<f64>) -> Result<usize, SheetError> {
    let [columns, rows] = capacity(tile);
    let most = columns * rows;
    if most == 0 {
        return Err(SheetError::TooLarge {
            tile,
            room: room_mm(),
        });
    }
    match settings.per_page {
        None => Ok(most),
        Some(found) if (1..=most).contains(&(found as usize)) => Ok(found as usize),
        Some(found) => Err(SheetError::PerPage { found, most, tile }),
    }
}

/// What is cut out: the patch of a code, below it the strip with its number.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Tile {
    marks: MarkSize,
    /// Size of the number's font, mm.
    font: f64,
}

impl Tile {
    fn new(marks: MarkSize, ids: &[u32]) -> Self {
        let letters = ids
            .iter()
            .map(|&id| marks.family.code_label(id).len())
            .max()
            .unwrap_or(1);
        let fitting = marks.patch_mm() / (LETTER * letters as f64);
        Self {
            marks,
            font: fitting.min(NUMBER_MM),
        }
    }

    fn size(&self) -> Vector2<f64> {
        let patch = self.marks.patch_mm();
        Vector2::new(patch, patch + STRIP * self.font)
    }

    fn shapes(&self, id: u32, corner: Vector2<f64>, targets: Tone) -> Vec<Shape> {
        let patch = self.marks.patch_mm();
        let strip = Vector2::new(corner.x, corner.y + patch);
        let mut shapes = vec![
            Shape::Rectangle {
                corner,
                size: Vector2::repeat(patch),
                tone: targets.opposite(),
            },
            Shape::Rectangle {
                corner: strip,
                size: Vector2::new(patch, STRIP * self.font),
                tone: targets,
            },
        ];
        let centre = corner + Vector2::repeat(0.5 * patch);
        shapes.extend(marks(self.marks, id, centre, targets));
        shapes.push(Shape::Text {
            place: strip + Vector2::new(0.2, 1.0) * self.font,
            size: self.font,
            words: self.marks.family.code_label(id),
            tone: targets.opposite(),
        });
        shapes
    }
}

/// A line of known length to check the printer, and what the sheet is.
fn foot(words: &str) -> Vec<Shape> {
    const LENGTH_MM: f64 = 100.0;
    const STEP_MM: f64 = 10.0;
    const WIDTH_MM: f64 = 0.2;
    const FONT_MM: f64 = 3.2;
    let left = Vector2::new(MARGIN_MM, PAGE_HEIGHT_MM - MARGIN_MM - 3.0);
    let line = |from, to| Shape::Line {
        from,
        to,
        width: WIDTH_MM,
    };
    let mut shapes = vec![line(left, left + Vector2::new(LENGTH_MM, 0.0))];
    for step in 0..=(LENGTH_MM / STEP_MM) as u32 {
        let x = f64::from(step) * STEP_MM;
        let is_end = x == 0.0 || x == LENGTH_MM;
        let up = if is_end { 3.0 } else { 1.5 };
        let foot = left + Vector2::new(x, 0.0);
        shapes.push(line(foot, foot - Vector2::new(0.0, up)));
    }
    let beside = left + Vector2::new(LENGTH_MM + 4.0, 0.0);
    for (words, down) in [
        ("100 mm: measure this line, print without scaling", -2.0),
        (words, 2.5),
    ] {
        shapes.push(Shape::Text {
            place: beside + Vector2::new(0.0, down),
            size: FONT_MM,
            words: words.to_owned(),
            tone: Tone::Black,
        });
    }
    shapes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::targets::sheet::shape::PAGE_WIDTH_MM;

    fn settings(family: &str, ids: &str) -> SheetSettings {
        SheetSettings {
            family: family.parse().unwrap(),
            ids: ids.parse().unwrap(),
            ..SheetSettings::default()
        }
    }

    fn texts(page: &Page) -> Vec<&str> {
        let words = page.shapes.iter().filter_map(|shape| match shape {
            Shape::Text { words, .. } => Some(words.as_str()),
            _ => None,
        });
        words.collect()
    }

    #[test]
    fn codes_are_shared_out_among_pages() {
        let sheet = sheet(&settings("dot420", "1-20,33")).unwrap();
        assert_eq!(sheet.pages.len(), 2, "twenty of the usual size fill a page");
        assert_eq!(texts(&sheet.pages[0])[19], "C20");
        assert_eq!(
            texts(&sheet.pages[1]),
            [
                "C33",
                "100 mm: measure this line, print without scaling",
                "dot420, pitch 5 mm, dots 5 mm, page 2 of 2"
            ]
        );
        let few = SheetSettings {
            per_page: Some(3),
            ..settings("ring14", "1-7")
        };
        assert_eq!(super::sheet(&few).unwrap().pages.len(), 3);
    }

    #[test]
    fn nothing_leaves_the_page() {
        let inside = |place: &Vector2<f64>, by: f64| {
            place.x >= by
                && place.y >= by
                && place.x <= PAGE_WIDTH_MM - by
                && place.y <= PAGE_HEIGHT_MM - by
        };
        for (family, dot_mm) in [
            ("dot420", 5.0),
            ("ring20", 5.0),
            ("ring20", 0.8),
            ("ring12", 38.0),
        ] {
            let settings = SheetSettings {
                dot_mm,
                ..settings(family, "1-147")
            };
            for shape in sheet(&settings)
                .unwrap()
                .pages
                .iter()
                .flat_map(|p| &p.shapes)
            {
                let fits = match shape {
                    Shape::Rectangle { corner, size, .. } => {
                        inside(corner, 5.0) && inside(&(corner + size), 5.0)
                    }
                    Shape::Disc { centre, radius, .. } => inside(centre, 5.0 + radius),
                    Shape::RingSector { centre, outer, .. } => inside(centre, 5.0 + outer),
                    Shape::Line { from, to, .. } => inside(from, 5.0) && inside(to, 5.0),
                    Shape::Text {
                        place, size, words, ..
                    } => {
                        let end = place + Vector2::new(0.5 * size * words.len() as f64, -*size);
                        inside(place, 5.0) && inside(&end, 5.0)
                    }
                };
                assert!(fits, "{shape:?}");
            }
        }
    }

    #[test]
    fn what_cannot_be_printed_is_said_in_a_line() {
        let base = || settings("dot420", "1");
        let said = |settings: SheetSettings| sheet(&settings).unwrap_err().to_string();
        assert_eq!(
            said(settings("ring12", "100-148")),
            "found code 148, expected 1 to 147 in ring12"
        );
        assert_eq!(
            said(SheetSettings {
                dot_mm: 10.0,
                ..base()
            }),
            "found dots of 10 mm at a pitch of 5 mm, expected less than 10 mm: neighbours in a code stand 2 pitches apart"
        );
        assert_eq!(
            said(SheetSettings {
                pitch_mm: f64::NAN,
                ..base()
            }),
            "found a pitch of NaN mm, expected a length above 0"
        );
        assert_eq!(
            said(SheetSettings {
                pitch_mm: 30.0,
                ..base()
            }),
            "found codes of 245.0 x 250.0 mm, expected at most 194 x 271 mm: the page has no more room"
        );
        assert_eq!(
            said(SheetSettings {
                per_page: Some(21),
                ..base()
            }),
            "found 21 codes to a page, expected 1 to 20 of 45.0 x 50.0 mm"
        );
        assert_eq!(
            said(SheetSettings {
                per_page: Some(0),
                ..base()
            }),
            "found 0 codes to a page, expected 1 to 20 of 45.0 x 50.0 mm"
        );
    }
}
