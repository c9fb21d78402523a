//! A picture with what detection found in it drawn over it, for an operator who wants to see why.
//!
//! The picture is brightened first: photographs of retro-reflective targets are black but for those. Accepted dots have
//! their ellipse, codes their label and the axes O-A and O-B, doubtful codes another colour and their doubt, and every
//! refused place a cross with its reason. Texts stand where nothing else is; where there is no room a refusal has the
//! letter under which the legend lists its kind. What was found decides the work, never its square: room is kept in
//! a grid of cells.

mod brightness;
mod canvas;
mod legend;
mod reasons;
mod room;

use image::{ImageBuffer, Rgb, RgbImage};
use nalgebra::Vector2;

use crate::imaging::GreyImage;
use crate::targets::{CodeReading, Detections, Dot, Family};
use brightness::display_greys;
use canvas::{Canvas, Colour, Letters, Outline};
use legend::draw_legend;
use reasons::{ReasonKind, reason_kinds, wrapped};
use room::Room;

mod colours {
    //! One colour for one thing, in the legend as in the picture.

    use super::Colour;

    pub(super) const CODE: Colour = [60, 230, 90];
    pub(super) const DOUBT: Colour = [255, 160, 0];
    pub(super) const PLAIN: Colour = [0, 205, 255];
    pub(super) const REFUSED: Colour = [255, 60, 60];
    pub(super) const REFUSED_TEXT: Colour = [255, 150, 140];
}

/// Sizes of what is drawn, by the size of the picture: it is looked at as a whole first.
#[derive(Clone, Copy, Debug)]
struct Style {
    /// Labels of codes and the legend.
    labels: Letters,
    /// Reasons and the names of axes.
    notes: Letters,
    /// Width of lines, px.
    line: f64,
}

impl Style {
    fn of_picture(width: usize) -> Self {
        let (labels, notes, line) = match width {
            0..1600 => (Letters::Small, Letters::Small, 1.2),
            1600..2600 => (Letters::Middle, Letters::Small, 1.6),
            2600..5000 => (Letters::Large, Letters::Small, 2.0),
            _ => (Letters::Huge, Letters::Middle, 3.0),
        };
        Self {
            labels,
            notes,
            line,
        }
    }
}

/// The picture of these detections, of the same size, with all that was found and refused.
#[must_use]
pub fn overlay(image: &GreyImage, detections: &Detections) -> RgbImage {
    let mut canvas = Canvas::new(brightened(image));
    let mut room = Room::new(canvas.size());
    let style = Style::of_picture(image.width());
    draw_dots(&mut canvas, &mut room, detections, style);
    for code in &detections.codes {
        draw_frame(&mut canvas, &mut room, code, detections, style);
    }
    let reach = 2.5 * style.line;
    let mut drawn = room.clone();
    for refused in &detections.rejected {
        canvas.cross(refused.place_px, reach, style.line, colours::REFUSED);
        drawn.take_round(refused.place_px, reach);
    }
    let (kinds, kind_of) = reason_kinds(&detections.rejected);
    draw_legend(
        &mut canvas,
        &mut room,
        &drawn,
        detections,
        &kinds,
        style.labels,
    );
    // Labels of codes stand where they belong, over crosses where they must; reasons keep off both.
    for code in &detections.codes {
        write_label(&mut canvas, &mut room, code, detections, style);
    }
    for refused in &detections.rejected {
        room.take_round(refused.place_px, reach);
    }
    let kinds = kind_of.iter().map(|&kind| &kinds[kind]);
    for (refused, kind) in detections.rejected.iter().zip(kinds) {
        let place = refused.place_px;
        write_reason(&mut canvas, &mut room, place, &refused.reason, kind, style);
    }
    canvas.into_picture()
}

fn brightened(image: &GreyImage) -> RgbImage {
    let shown = display_greys(image);
    let bytes: Vec<u8> = image
        .samples()
        .iter()
        .flat_map(|&grey| [shown.get(usize::from(grey)).copied().unwrap_or(u8::MAX); 3])
        .collect();
    let (width, height) = (image.width() as u32, image.height() as u32);
    // The samples fill the picture, so there are as many bytes as are needed.
    ImageBuffer::<Rgb<u8>, Vec<u8>>::from_raw(width, height, bytes).unwrap_or_default()
}

/// The colour of a code and of its dots.
fn colour_of(code: &CodeReading) -> Colour {
    match code.doubt {
        None => colours::CODE,
        Some(_) => colours::DOUBT,
    }
}

fn outline(dot: &Dot) -> Outline {
    Outline {
        centre: dot.centre_px,
        major: dot.major_px,
        minor: dot.minor_px,
        angle: dot.angle,
    }
}

fn draw_dots(canvas: &mut Canvas, room: &mut Room, detections: &Detections, style: Style) {
    let mut colours = vec![colours::PLAIN; detections.dots.len()];
    for code in &detections.codes {
        for dot in &code.dots {
            if let Some(colour) = colours.get_mut(dot.slot()) {
                *colour = colour_of(code);
            }
        }
    }
    for (dot, colour) in detections.dots.iter().zip(colours) {
        canvas.ellipse(&outline(dot), style.line, colour);
        room.take_round(dot.centre_px, 0.5 * dot.major_px + 2.0);
    }
}

/// The axes of a six-dot code from edge to edge, or the outer edge of a ring code.
fn draw_frame(
    canvas: &mut Canvas,
    room: &mut Room,
    code: &CodeReading,
    detections: &Detections,
    style: Style,
) {
    /// Outer radius of a ring in radii of its dot.
    const RING: f64 = 3.0;
    let dots: Vec<&Dot> = code
        .dots
        .iter()
        .filter_map(|dot| detections.dots.get(dot.slot()))
        .collect();
    match (code.family, dots.as_slice()) {
        (Family::Dot420, [o, a, b, ..]) => {
            for end in [a, b] {
                let along = end.centre_px - o.centre_px;
                let Some(direction) = along.try_normalize(1e-9) else {
                    continue;
                };
                let from = o.centre_px + direction * 0.5 * o.major_px;
                let to = end.centre_px - direction * 0.5 * end.major_px;
                canvas.line(from, to, style.line, colour_of(code));
                room.take_along(from, to);
            }
        }
        (Family::Ring(_), [dot, ..]) => {
            let ring = Outline {
                major: RING * dot.major_px,
                minor: RING * dot.minor_px,
                ..outline(dot)
            };
            canvas.ellipse(&ring, style.line, colour_of(code));
            room.take_round(dot.centre_px, 0.5 * ring.major);
        }
        (Family::Dot420, _) | (Family::Ring(_), []) => {}
    }
}

/// The label of a code beside its first dot, its doubt, and the names of the axes' dots.
fn write_label(
    canvas: &mut Canvas,
    room: &mut Room,
    code: &CodeReading,
    detections: &Detections,
    style: Style,
) {
    const LETTERS_A_LINE: usize = 24;
    let colour = colour_of(code);
    let dot = |slot: usize| detections.dots.get(code.dots.get(slot)?.slot());
    let Some(first) = dot(0) else {
        return;
    };
    let clear = |dot: &Dot| 0.5 * dot.major_px + 4.0;
    let around = match code.family {
        Family::Dot420 => clear(first),
        Family::Ring(_) => 1.5 * first.major_px + 4.0,
    };
    let label = code.family.code_label(code.id);
    let label = match code.doubt {
        None => vec![label],
        Some(_) => vec![format!("{label}?")],
    };
    let found = [style.labels, style.notes].into_iter().find_map(|letters| {
        let size = letters.size(&label);
        let corner = room.beside(first.centre_px, around, size)?;
        Some((letters, corner))
    });
    // A label is written in any case: it is what the picture is looked at for. Further away it would seem another's.
    let (letters, corner) = found.unwrap_or_else(|| {
        let down = -0.5 * style.notes.height() as f64;
        let corner = first.centre_px + Vector2::new(around, down);
        (style.notes, [corner.x as usize, corner.y as usize])
    });
    canvas.shade(corner, letters.size(&label));
    canvas.text(corner, &label, letters, colour);
    if let Some(doubt) = &code.doubt {
        let lines = wrapped(doubt, LETTERS_A_LINE);
        let size = style.notes.size(&lines);
        if let Some(corner) = room.near(first.centre_px, around, size) {
            canvas.text(corner, &lines, style.notes, colour);
            lead(canvas, first.centre_px, around, corner, size, colour);
        }
    }
    if code.family == Family::Dot420 {
        for (slot, name) in ["O", "A", "B"].into_iter().enumerate() {
            let name = [name.to_owned()];
            let Some(dot) = dot(slot) else { continue };
            if let Some(corner) = room.beside(dot.centre_px, clear(dot), style.notes.size(&name)) {
                canvas.text(corner, &name, style.notes, colour);
            }
        }
    }
}

/// A thin line to a doubt that does not stand beside its code.
fn lead(
    canvas: &mut Canvas,
    place: Vector2<f64>,
    clear: f64,
    corner: [usize; 2],
    size: [usize; 2],
    colour: Colour,
) {
    let nearest = |axis: usize| {
        let (first, length) = (corner[axis] as f64, size[axis] as f64);
        place[axis].clamp(first, first + length)
    };
    let to = Vector2::new(nearest(0), nearest(1));
    let along = to - place;
    if along.norm() > 1.5 * clear + 2.0 {
        canvas.line(place + along.normalize() * clear, to, 1.0, colour);
    }
}

/// A reason beside its cross, or the letter of its kind where only that has room.
fn write_reason(
    canvas: &mut Canvas,
    room: &mut Room,
    place: Vector2<f64>,
    reason: &str,
    kind: &ReasonKind,
    style: Style,
) {
    const LETTERS_A_LINE: usize = 22;
    let clear = 3.0 * style.line + 2.0;
    for lines in [
        wrapped(reason, LETTERS_A_LINE),
        vec![kind.letter.to_string()],
    ] {
        if let Some(corner) = room.beside(place, clear, style.notes.size(&lines)) {
            canvas.text(corner, &lines, style.notes, colours::REFUSED_TEXT);
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::BitDepth;
    use crate::targets::{CodeEvidence, DotIndex, Rejected};

    fn dot(x: f64, y: f64) -> Dot {
        Dot {
            centre_px: Vector2::new(x, y),
            sigma_px: 0.02,
            major_px: 12.0,
            minor_px: 10.0,
            angle: 0.0,
            contrast: 100.0,
            background: 20.0,
        }
    }

    fn picture(width: u32, height: u32) -> GreyImage {
        let samples = vec![5; (width * height) as usize];
        GreyImage::new(width, height, BitDepth::Eight, samples).unwrap()
    }

    /// How many pixels have a colour, nearly.
    fn count(picture: &RgbImage, colour: Colour) -> usize {
        let near = |pixel: &&Rgb<u8>| {
            let mut channels = pixel.0.iter().zip(colour);
            channels.all(|(&shown, asked)| shown.abs_diff(asked) < 12)
        };
        picture.pixels().filter(near).count()
    }

    #[test]
    fn everything_found_is_drawn_in_its_colour() {
        let code = |id, first: u32, doubt: Option<&str>| CodeReading {
            evidence: CodeEvidence::default(),
            family: Family::Dot420,
            id,
            dots: (first..first + 6).map(DotIndex).collect(),
            misfit: 0.1,
            doubt: doubt.map(Into::into),
        };
        let six = |x: f64| {
            let places = [
                (0., 0.),
                (120., 0.),
                (0., -120.),
                (40., -20.),
                (80., -20.),
                (60., -80.),
            ];
            places.map(|(right, down)| dot(x + right, 300.0 + down))
        };
        let detections = Detections {
            width_px: 900,
            height_px: 600,
            dots: [&six(100.0)[..], &six(500.0), &[dot(450.0, 500.0)]].concat(),
            codes: vec![code(17, 0, None), code(18, 6, Some("read twice"))],
            rejected: vec![Rejected {
                place_px: Vector2::new(300.0, 450.0),
                reason: "no ellipse can be fitted".into(),
            }],
            by_hand: Vec::new(),
            expected: Vec::new(),
        };
        let image = picture(900, 600);
        let drawn = overlay(&image, &detections);
        assert_eq!(drawn.dimensions(), (900, 600));
        for colour in [
            colours::CODE,
            colours::DOUBT,
            colours::PLAIN,
            colours::REFUSED,
        ] {
            assert!(count(&drawn, colour) > 15, "{colour:?}");
        }
        let bare = overlay(&image, &Detections::default());
        // The axis O-A half-way, and the edge of the plain dot; far from everything the picture is as it was.
        for (x, y, changed) in [(160, 299, true), (444, 500, true), (820, 520, false)] {
            assert_eq!(
                drawn.get_pixel(x, y) != bare.get_pixel(x, y),
                changed,
                "{x} {y}"
            );
        }
    }

    #[test]
    fn a_crowd_of_refusals_and_a_tiny_picture_are_drawn() {
        let places = (0..20_000).map(|k| Rejected {
            place_px: Vector2::new(f64::from(k % 200) * 2.0, f64::from(k / 200) * 3.0),
            reason: format!("too small: {k} px"),
        });
        let mut detections = Detections {
            rejected: places.collect(),
            dots: vec![dot(-3.0, 4.0)],
            codes: vec![CodeReading {
                evidence: CodeEvidence::default(),
                family: Family::Ring(14),
                id: 1,
                dots: vec![DotIndex(0), DotIndex(7)],
                misfit: 0.0,
                doubt: None,
            }],
            ..Detections::default()
        };
        assert!(count(&overlay(&picture(400, 300), &detections), colours::REFUSED) > 1000);
        detections.dots[0].major_px = f64::NAN;
        assert_eq!(overlay(&picture(3, 2), &detections).dimensions(), (3, 2));
    }
}
