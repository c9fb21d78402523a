//! What a page is made of.

use nalgebra::Vector2;

/// Width of a page, mm: A4.
pub const PAGE_WIDTH_MM: f64 = 210.0;
/// Height of a page, mm: A4.
pub const PAGE_HEIGHT_MM: f64 = 297.0;

/// What a shape is filled with; nothing else is printed, because a printer makes dots of every grey.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// Ink.
    Black,
    /// Paper.
    White,
}

impl Tone {
    /// The other one.
    #[must_use]
    pub fn opposite(self) -> Self {
        match self {
            Tone::Black => Tone::White,
            Tone::White => Tone::Black,
        }
    }
}

/// A shape on a page. Places are in mm from the page's top-left corner, x to the right, y down; what comes later in a
/// page covers what comes earlier.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// An upright rectangle.
    Rectangle {
        /// Its top-left corner, mm.
        corner: Vector2<f64>,
        /// Width and height, mm.
        size: Vector2<f64>,
        /// Its filling.
        tone: Tone,
    },
    /// A round dot.
    Disc {
        /// Its centre, mm.
        centre: Vector2<f64>,
        /// Its radius, mm.
        radius: f64,
        /// Its filling.
        tone: Tone,
    },
    /// A part of a ring.
    RingSector {
        /// Centre of the ring, mm.
        centre: Vector2<f64>,
        /// Inner radius, mm.
        inner: f64,
        /// Outer radius, mm.
        outer: f64,
        /// Where it begins, radians clockwise from straight up.
        begin: f64,
        /// Where it ends, radians clockwise from straight up: larger than `begin` by less than a full turn.
        end: f64,
        /// Its filling.
        tone: Tone,
    },
    /// A straight black line.
    Line {
        /// One end, mm.
        from: Vector2<f64>,
        /// The other end, mm.
        to: Vector2<f64>,
        /// Its width, mm.
        width: f64,
    },
    /// A line of text: letters, figures and plain punctuation, none of `<`, `>`, `&` and brackets.
    Text {
        /// Left end of the base line, mm.
        place: Vector2<f64>,
        /// Size of the font, mm; figures are 0.72 of it high.
        size: f64,
        /// What is written.
        words: String,
        /// Its colour.
        tone: Tone,
    },
}

/// A page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Page {
    /// What is drawn, in this order.
    pub shapes: Vec<Shape>,
}

/// Pages of targets.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    /// What it is, in a few words.
    pub title: String,
    /// Its pages, at least one.
    pub pages: Vec<Page>,
}

/// The place of a direction (radians clockwise from straight up) at a radius round a centre.
#[must_use]
pub(crate) fn on_circle(centre: Vector2<f64>, radius: f64, direction: f64) -> Vector2<f64> {
    let (sin, cos) = direction.sin_cos();
    centre + Vector2::new(sin, -cos) * radius
}
