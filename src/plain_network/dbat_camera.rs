//! The camera file of DBAT: as much of its XML as a camera needs.

use super::error::quote;
use super::{ImportError, ImportPlace, NamedText, PlainCamera, PlainParameter};
use crate::adjustment::Sharing;
use crate::camera::LensDirection;

/// The lens model that corrects the measured point; DBAT numbers others that this program does not have.
const CORRECTING_MODEL: &str = "3";

/// Reads a camera.
///
/// Read are `name`, `sensor` (width and height in mm, one of them may be `auto`), `image` (pixels), `aspect`, `focal`,
/// `model` (3), `nK`, `nP`, `cc`, `pp`, `K` and `P`; everything under `calibration_info` is passed over. A `cc` of 0 is
/// not known and `focal` takes its place; a `pp` of 0,0 is not known and the image centre takes its place, otherwise it
/// is in mm from the top-left corner. Free are c, x0, y0, the first `nK` of K, P where `nP` is 2, and the aspect.
///
/// The aspect becomes `B1 = aspect - 1` on the pitch in y. DBAT scales x *before* it computes the distortion, B1 scales
/// beside it: the difference is the aspect times the distortion, in `c4040z.xml`'s published result 0.05 px at a corner.
pub(super) fn read_camera(source: NamedText<'_>) -> Result<PlainCamera, ImportError> {
    let xml = Xml::new(source);
    let unit = xml.text("unit")?;
    if unit != "mm" {
        return Err(xml.wrong("unit", "mm"));
    }
    if xml.text("model")? != CORRECTING_MODEL {
        return Err(xml.wrong("model", "3, which corrects the measured point"));
    }
    if xml.optional("skew")?.is_some_and(|skew| skew != 0.0) {
        return Err(xml.wrong("skew", "0"));
    }
    let [width_px, height_px] = xml.sides()?;
    let aspect = xml.optional("aspect")?.unwrap_or(1.0);
    let (pitch, aspect) = xml.sensor([width_px, height_px], aspect)?;
    let c = match xml.numbers("cc")?.first() {
        Some(&c) if c != 0.0 => c,
        _ => xml.optional("focal")?.unwrap_or(0.0),
    };
    if c <= 0.0 {
        return Err(xml.wrong("focal", "a number greater than 0"));
    }
    let [x0, y0] = match xml.numbers("pp")?[..] {
        [] | [0.0, 0.0] => [0.0; 2],
        [x, y] => [
            x - f64::from(width_px) / 2.0 * pitch,
            f64::from(height_px) / 2.0 * pitch - y,
        ],
        _ => return Err(xml.wrong("pp", "two numbers")),
    };
    let [k1, k2, k3] = xml.coefficients("K")?;
    let [p1, p2] = xml.coefficients("P")?;
    let mut parameters = [PlainParameter::Fixed; 10];
    let radial = xml.count("nK", 3)?;
    let decentring = if xml.count("nP", 2)? == 2 { 2 } else { 0 };
    for index in (0..3 + radial).chain(6..6 + decentring).chain([8]) {
        parameters[index] = PlainParameter::Free;
    }
    Ok(PlainCamera {
        name: xml.text("name")?.to_owned(),
        width_px,
        height_px,
        pixel_pitch_mm: pitch,
        lens: LensDirection::CorrectingAffinityFirst,
        values: [c, x0, y0, k1, k2, k3, p1, p2, aspect - 1.0, 0.0],
        parameters,
        sharing: [Sharing::Camera; 10],
    })
}

/// The elements of a camera file.
struct Xml<'a> {
    source: NamedText<'a>,
    /// Without comments and calibration report, which are blanks here so that places stay.
    text: String,
}

impl<'a> Xml<'a> {
    fn new(source: NamedText<'a>) -> Self {
        let text = without(source.text, "<!--", "-->");
        let text = without(&text, "<calibration_info", "</calibration_info>");
        Self { source, text }
    }

    /// Byte range of the text of the only element of this name.
    fn find(&self, name: &str) -> Result<Option<std::ops::Range<usize>>, ImportError> {
        let (open, close) = (format!("<{name}>"), format!("</{name}>"));
        let Some(start) = self.text.find(&open).map(|at| at + open.len()) else {
            return Ok(None);
        };
        let Some(length) = self.text[start..].find(&close) else {
            let found = format!("<{name}> without {close}");
            return Err(self.error(start - open.len(), found, "both"));
        };
        if let Some(next) = self.text[start + length..].find(&open) {
            let at = start + length + next;
            let expected = "one camera in the file";
            return Err(self.error(at, format!("<{name}> again"), expected));
        }
        Ok(Some(start..start + length))
    }

    fn error(&self, at: usize, found: impl Into<String>, expected: &str) -> ImportError {
        let line = self.text[..at].matches('\n').count() + 1;
        self.source
            .unexpected(ImportPlace::Line(line), found, expected)
    }

    /// An error that repeats an element, or says that it is not there.
    fn wrong(&self, name: &str, expected: &str) -> ImportError {
        match self.find(name) {
            Err(error) => error,
            Ok(None) => {
                let found = format!("no element <{name}>");
                self.source.unexpected(ImportPlace::File, found, expected)
            }
            Ok(Some(range)) => {
                let found = format!("<{name}> {}", quote(&self.text[range.clone()]));
                self.error(range.start, found, expected)
            }
        }
    }

    fn text(&self, name: &str) -> Result<&str, ImportError> {
        match self.find(name)? {
            Some(range) if !self.text[range.clone()].trim().is_empty() => {
                Ok(self.text[range].trim())
            }
            _ => Err(self.wrong(name, "it with its text")),
        }
    }

    /// The numbers of an element; none where it is absent.
    fn numbers(&self, name: &str) -> Result<Vec<f64>, ImportError> {
        let Some(range) = self.find(name)? else {
            return Ok(Vec::new());
        };
        let number = |field: &str| match field.trim().parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(self.wrong(name, "numbers between commas")),
        };
        self.text[range].split(',').map(number).collect()
    }

    fn optional(&self, name: &str) -> Result<Option<f64>, ImportError> {
        match self.numbers(name)?[..] {
            [] => Ok(None),
            [value] => Ok(Some(value)),
            _ => Err(self.wrong(name, "one number")),
        }
    }

    /// Coefficients, as many as there are; the others are zero.
    fn coefficients<const N: usize>(&self, name: &str) -> Result<[f64; N], ImportError> {
        let mut values = [0.0; N];
        for (index, value) in self.numbers(name)?.into_iter().enumerate() {
            match values.get_mut(index) {
                Some(place) => *place = value,
                None if value == 0.0 => {}
                None => return Err(self.wrong(name, &format!("at most {N} numbers"))),
            }
        }
        Ok(values)
    }

    /// How many coefficients are free, at most `most`; all where the file does not say.
    fn count(&self, name: &str, most: usize) -> Result<usize, ImportError> {
        let Some(value) = self.optional(name)? else {
            return Ok(most);
        };
        (0..=most)
            .find(|count| *count as f64 == value)
            .ok_or_else(|| self.wrong(name, &format!("a whole number up to {most}")))
    }

    /// Columns and rows.
    fn sides(&self) -> Result<[u32; 2], ImportError> {
        let sides: Vec<u32> = self
            .text("image")?
            .split(',')
            .filter_map(|side| side.trim().parse().ok())
            .collect();
        match sides[..] {
            [width, height] if width > 0 && height > 0 => Ok([width, height]),
            _ => Err(self.wrong("image", "width,height in pixels")),
        }
    }

    /// Pitch in y, mm, and the ratio of the pitch in x to it.
    fn sensor(&self, sides_px: [u32; 2], aspect: f64) -> Result<(f64, f64), ImportError> {
        let expected = "width,height in mm, greater than 0, one of them may be auto";
        let [width_px, height_px] = sides_px.map(f64::from);
        let mut sides = Vec::new();
        for side in self.text("sensor")?.split(',') {
            sides.push(match side.trim() {
                "auto" => None,
                side => match side.parse::<f64>() {
                    Ok(value) if value.is_finite() && value > 0.0 => Some(value),
                    _ => return Err(self.wrong("sensor", expected)),
                },
            });
        }
        match sides[..] {
            [None, Some(height)] => Ok((height / height_px, aspect)),
            [Some(width), None] => Ok((width / width_px / aspect, aspect)),
            [Some(width), Some(height)] => {
                let pitch = height / height_px;
                Ok((pitch, width / width_px / pitch))
            }
            _ => Err(self.wrong("sensor", expected)),
        }
    }
}

/// The text with everything from `open` to `close` made blank.
fn without(text: &str, open: &str, close: &str) -> String {
    let mut left = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(start) = rest.find(open) {
        let end = rest[start..]
            .find(close)
            .map_or(rest.len(), |length| start + length + close.len());
        left.push_str(&rest[..start]);
        left.extend(rest[start..end].chars().map(|c| match c {
            '\n' => '\n',
            _ => ' ',
        }));
        rest = &rest[end..];
    }
    left.push_str(rest);
    left
}
