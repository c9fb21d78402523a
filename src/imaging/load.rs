//! Pictures from files: the only place of this folder that touches the disk.

use std::fmt;
use std::io::{self, BufRead, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use exif::{In, Tag, Value};
use image::error::{ImageError, LimitErrorKind};
use image::{DynamicImage, ImageFormat, ImageReader, Limits};
use serde::{Deserialize, Serialize};

use super::{BitDepth, GreyImage};
use crate::monitor::Monitor;

/// What a picture file may demand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadSettings {
    /// Largest number of columns or rows, px: larger is no camera picture but a damaged header. Default 65,000.
    pub largest_side_px: u32,
    /// Largest number of pixels, in millions: guards the memory. Default 400.
    pub largest_megapixels: u32,
}

impl Default for LoadSettings {
    fn default() -> Self {
        Self {
            largest_side_px: 65_000,
            largest_megapixels: 400,
        }
    }
}

/// What a picture's file says of the camera; each field is `None` where the file does not say it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PictureMeta {
    /// Maker of the camera.
    pub maker: Option<String>,
    /// Model of the camera.
    pub model: Option<String>,
    /// Model of the lens.
    pub lens: Option<String>,
    /// Nominal focal length, mm.
    pub focal_length_mm: Option<f64>,
    /// Focal length that would give the same field on 36 mm x 24 mm film, mm.
    pub focal_length_35mm: Option<f64>,
    /// Pixel pitch from the resolution of the focal plane, mm.
    pub pixel_pitch_mm: Option<f64>,
    /// Orientation tag 1 to 8: how a viewer turns the picture for display. Coordinates are never turned.
    pub orientation: Option<u8>,
    /// Columns of the picture when it was taken, px; others where it was reduced later.
    pub taken_width_px: Option<u32>,
}

/// A picture and what its file says of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// The grey values.
    pub image: GreyImage,
    /// What the file says of the camera.
    pub meta: PictureMeta,
}

/// A file that gives no picture.
#[derive(Debug)]
pub struct LoadError {
    /// The file.
    pub file: PathBuf,
    /// What was found there.
    pub found: String,
    /// What was expected.
    pub expected: String,
}

impl fmt::Display for LoadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            file,
            found,
            expected,
        } = self;
        write!(f, "{}: found {found}, expected {expected}", file.display())
    }
}

impl std::error::Error for LoadError {}

const KNOWN_FORMATS: &str = "a TIFF, PNG, JPEG, BMP or PGM picture";

/// Reads a picture: grey values of 8 or 16 bits; colours become luminance (ITU-R BT.709 weights).
///
/// # Errors
/// [`LoadError`] where the file cannot be read, is no picture, is damaged or incomplete, or is too large.
pub fn load_picture(file: &Path, settings: &LoadSettings) -> Result<Picture, LoadError> {
    load_picture_until(file, settings, &Monitor::new())
}

/// As [`load_picture`], until the monitor is interrupted: then some error comes, and the monitor tells that it means
/// nothing.
///
/// # Errors
/// [`LoadError`].
pub fn load_picture_until(
    file: &Path,
    settings: &LoadSettings,
    monitor: &Monitor,
) -> Result<Picture, LoadError> {
    let bytes = read_file(file)?;
    decode(file, &bytes, settings, monitor)
}

/// A file in memory that breaks off when the monitor is interrupted, so that a decoder stops.
struct Stoppable<'a> {
    bytes: Cursor<&'a [u8]>,
    monitor: &'a Monitor,
}

/// Bytes that a decoder gets at once: a fraction of a millisecond of decoding.
const PORTION: usize = 16 * 1024;

impl Stoppable<'_> {
    fn check(&self) -> io::Result<()> {
        // Not of the kind `Interrupted`: that one means "try again".
        self.monitor.check().map_err(io::Error::other)
    }
}

impl Read for Stoppable<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.check()?;
        let length = buffer.len().min(PORTION);
        self.bytes.read(&mut buffer[..length])
    }
}

impl BufRead for Stoppable<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.check()?;
        let portion = self.bytes.fill_buf()?;
        Ok(&portion[..portion.len().min(PORTION)])
    }

    fn consume(&mut self, amount: usize) {
        self.bytes.consume(amount);
    }
}

impl Seek for Stoppable<'_> {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.bytes.seek(position)
    }
}

/// Reads what the file says of the camera, without the grey values; nothing where it says nothing.
///
/// # Errors
/// [`LoadError`] where the file cannot be read.
pub fn read_meta(file: &Path) -> Result<PictureMeta, LoadError> {
    Ok(meta_of(&read_file(file)?))
}

/// Reads the size of a picture, columns and rows, from its header.
///
/// # Errors
/// [`LoadError`] where the file cannot be read or is no picture.
pub fn read_size(file: &Path) -> Result<(u32, u32), LoadError> {
    let bytes = read_file(file)?;
    let format = format_of(file, &bytes)?;
    ImageReader::with_format(Cursor::new(bytes.as_slice()), format)
        .into_dimensions()
        .map_err(|error| explained(file, format, &error, &LoadSettings::default()))
}

fn refused(file: &Path, found: impl Into<String>, expected: impl Into<String>) -> LoadError {
    LoadError {
        file: file.to_owned(),
        found: found.into(),
        expected: expected.into(),
    }
}

fn read_file(file: &Path) -> Result<Vec<u8>, LoadError> {
    if file.is_dir() {
        return Err(refused(file, "a folder", KNOWN_FORMATS));
    }
    std::fs::read(file).map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => refused(file, "no such file", KNOWN_FORMATS),
        _ => refused(file, format!("an unreadable file ({error})"), KNOWN_FORMATS),
    })
}

fn format_of(file: &Path, bytes: &[u8]) -> Result<ImageFormat, LoadError> {
    if bytes.is_empty() {
        return Err(refused(file, "an empty file", KNOWN_FORMATS));
    }
    image::guess_format(bytes)
        .map_err(|_| refused(file, "a file that is no picture", KNOWN_FORMATS))
}

fn decode(
    file: &Path,
    bytes: &[u8],
    settings: &LoadSettings,
    monitor: &Monitor,
) -> Result<Picture, LoadError> {
    let format = format_of(file, bytes)?;
    if format == ImageFormat::Jpeg && !jpeg_is_complete(bytes) {
        return Err(refused(
            file,
            "a JPEG picture that breaks off",
            "a complete file",
        ));
    }
    let mut reader = ImageReader::with_format(
        Stoppable {
            bytes: Cursor::new(bytes),
            monitor,
        },
        format,
    );
    let mut limits = Limits::default();
    limits.max_image_width = Some(settings.largest_side_px);
    limits.max_image_height = Some(settings.largest_side_px);
    // Colour pictures of 16 bits take 8 bytes a pixel.
    limits.max_alloc = Some(u64::from(settings.largest_megapixels) * 8_000_000);
    reader.limits(limits);
    let decoded = reader
        .decode()
        .map_err(|error| explained(file, format, &error, settings))?;
    let pixels = u64::from(decoded.width()) * u64::from(decoded.height());
    if pixels == 0 {
        return Err(refused(
            file,
            "a picture without pixels",
            "at least one pixel",
        ));
    }
    if pixels > u64::from(settings.largest_megapixels) * 1_000_000 {
        return Err(too_large(
            file,
            &format!("{} x {} px", decoded.width(), decoded.height()),
            settings,
        ));
    }
    let image = grey_of(file, decoded)?;
    Ok(Picture {
        image,
        meta: meta_of(bytes),
    })
}

fn too_large(file: &Path, found: &str, settings: &LoadSettings) -> LoadError {
    refused(
        file,
        format!("a picture of {found}"),
        format!(
            "at most {} px a side and {} million pixels",
            settings.largest_side_px, settings.largest_megapixels
        ),
    )
}

fn explained(
    file: &Path,
    format: ImageFormat,
    error: &ImageError,
    settings: &LoadSettings,
) -> LoadError {
    let name = format.extensions_str().first().copied().unwrap_or("?");
    let name = name.to_uppercase();
    match error {
        ImageError::Limits(limit) => match limit.kind() {
            LimitErrorKind::DimensionError | LimitErrorKind::InsufficientMemory => {
                too_large(file, "a greater size", settings)
            }
            _ => refused(file, format!("a {name} picture ({error})"), KNOWN_FORMATS),
        },
        ImageError::Unsupported(what) => refused(
            file,
            format!("an unsupported kind of {name} picture ({what})"),
            KNOWN_FORMATS,
        ),
        other => refused(
            file,
            format!(
                "a damaged or incomplete {name} picture ({})",
                one_line(other)
            ),
            "a complete file",
        ),
    }
}

fn one_line(error: &ImageError) -> String {
    error
        .to_string()
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
}

/// A JPEG picture ends with the marker FF D9; decoders fill what is missing with grey and say nothing. What some cameras write behind
/// the picture (a film, another picture) is not looked at (ITU-T T.81, B.1.1).
fn jpeg_is_complete(bytes: &[u8]) -> bool {
    let mut at = 0;
    let mut in_scan = false;
    while let Some(&[first, marker]) = bytes.get(at..at + 2) {
        match (first, marker) {
            (0xff, 0xd9) => return in_scan,
            // Fill bytes before a marker, and markers that stand alone.
            (0xff, 0xff) => at += 1,
            (0xff, 0x00 | 0x01 | 0xd0..=0xd8) => at += 2,
            (0xff, _) => {
                let Some(&[high, low]) = bytes.get(at + 2..at + 4) else {
                    return false;
                };
                in_scan |= marker == 0xda;
                at += 2 + usize::from(u16::from_be_bytes([high, low])).max(2);
            }
            _ => at += 1,
        }
    }
    false
}

fn grey_of(file: &Path, decoded: DynamicImage) -> Result<GreyImage, LoadError> {
    let (width, height) = (decoded.width(), decoded.height());
    let (depth, samples) = match decoded {
        DynamicImage::ImageLuma8(_)
        | DynamicImage::ImageLumaA8(_)
        | DynamicImage::ImageRgb8(_)
        | DynamicImage::ImageRgba8(_) => {
            let grey = decoded.into_luma8().into_raw();
            (
                BitDepth::Eight,
                grey.into_iter().map(u16::from).collect::<Vec<_>>(),
            )
        }
        DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_)
        | DynamicImage::ImageRgb16(_)
        | DynamicImage::ImageRgba16(_) => (BitDepth::Sixteen, decoded.into_luma16().into_raw()),
        _ => {
            return Err(refused(
                file,
                "a picture of floating-point samples",
                "8 or 16 bits a sample",
            ));
        }
    };
    GreyImage::new(width, height, depth, samples)
        .map_err(|error| refused(file, error.to_string(), "a complete file"))
}

fn meta_of(bytes: &[u8]) -> PictureMeta {
    let Ok(exif) = exif::Reader::new().read_from_container(&mut Cursor::new(bytes)) else {
        return PictureMeta::default();
    };
    let text = |tag| match &exif.get_field(tag, In::PRIMARY)?.value {
        Value::Ascii(lines) => {
            let text = String::from_utf8_lossy(lines.first()?);
            let text = text.trim_matches(|c: char| c == '\0' || c.is_whitespace());
            (!text.is_empty()).then(|| text.to_owned())
        }
        _ => None,
    };
    let positive = |tag| {
        let value = &exif.get_field(tag, In::PRIMARY)?.value;
        let number = match value {
            Value::Rational(numbers) => numbers.first()?.to_f64(),
            _ => f64::from(value.get_uint(0)?),
        };
        (number.is_finite() && number > 0.0).then_some(number)
    };
    let whole = |tag| exif.get_field(tag, In::PRIMARY)?.value.get_uint(0);
    let unit_mm = match whole(Tag::FocalPlaneResolutionUnit) {
        Some(3) => 10.0,
        Some(4) => 1.0,
        _ => 25.4,
    };
    PictureMeta {
        maker: text(Tag::Make),
        model: text(Tag::Model),
        lens: text(Tag::LensModel),
        focal_length_mm: positive(Tag::FocalLength),
        focal_length_35mm: positive(Tag::FocalLengthIn35mmFilm),
        pixel_pitch_mm: positive(Tag::FocalPlaneXResolution).map(|per_unit| unit_mm / per_unit),
        orientation: whole(Tag::Orientation)
            .filter(|tag| (1..=8).contains(tag))
            .map(|tag| tag as u8),
        taken_width_px: whole(Tag::PixelXDimension),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayImage, ImageBuffer, Luma, RgbImage};

    fn encoded(picture: &DynamicImage, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    fn decoded(bytes: &[u8]) -> Result<Picture, LoadError> {
        decode(
            Path::new("a.tif"),
            bytes,
            &LoadSettings::default(),
            &Monitor::new(),
        )
    }

    fn slope() -> DynamicImage {
        GrayImage::from_fn(40, 30, |x, y| Luma([(x * 3 + y) as u8])).into()
    }

    #[test]
    fn grey_values_come_back_from_every_format_without_loss() {
        for format in [
            ImageFormat::Tiff,
            ImageFormat::Png,
            ImageFormat::Bmp,
            ImageFormat::Pnm,
        ] {
            let image = decoded(&encoded(&slope(), format)).unwrap().image;
            assert_eq!((image.width(), image.height()), (40, 30));
            assert_eq!(
                (image.depth(), image.at(39, 29)),
                (BitDepth::Eight, 146.0),
                "{format:?}"
            );
        }
    }

    #[test]
    fn sixteen_bits_stay_sixteen() {
        let picture: ImageBuffer<Luma<u16>, Vec<u16>> =
            ImageBuffer::from_fn(5, 4, |x, _| Luma([x as u16 * 1001]));
        let image = decoded(&encoded(&picture.into(), ImageFormat::Png))
            .unwrap()
            .image;
        assert_eq!((image.depth(), image.at(4, 0)), (BitDepth::Sixteen, 4004.0));
    }

    #[test]
    fn colours_become_luminance() {
        let picture = RgbImage::from_fn(8, 8, |_, _| image::Rgb([0, 200, 0]));
        let image = decoded(&encoded(&picture.into(), ImageFormat::Png))
            .unwrap()
            .image;
        assert!((image.at(3, 3) - 0.7152 * 200.0).abs() <= 1.0);
    }

    #[test]
    fn a_file_that_breaks_off_is_refused_in_one_line() {
        for format in [
            ImageFormat::Tiff,
            ImageFormat::Png,
            ImageFormat::Jpeg,
            ImageFormat::Bmp,
            ImageFormat::Pnm,
        ] {
            let bytes = encoded(&slope(), format);
            let error = decoded(&bytes[..bytes.len() * 2 / 3])
                .unwrap_err()
                .to_string();
            assert!(
                error.starts_with("a.tif: found") && !error.contains('\n'),
                "{error}"
            );
        }
    }

    #[test]
    fn what_is_no_picture_is_said_to_be_none() {
        let error = decoded(b"label,x_mm,y_mm\n").unwrap_err().to_string();
        assert_eq!(
            error,
            "a.tif: found a file that is no picture, expected a TIFF, PNG, JPEG, BMP or PGM picture"
        );
        assert!(
            decoded(b"")
                .unwrap_err()
                .to_string()
                .contains("an empty file")
        );
    }

    #[test]
    fn a_picture_beyond_the_limits_is_refused() {
        let settings = LoadSettings {
            largest_side_px: 20,
            ..LoadSettings::default()
        };
        for format in [
            ImageFormat::Tiff,
            ImageFormat::Png,
            ImageFormat::Jpeg,
            ImageFormat::Bmp,
            ImageFormat::Pnm,
        ] {
            let bytes = encoded(&slope(), format);
            let error = decode(Path::new("a"), &bytes, &settings, &Monitor::new())
                .unwrap_err()
                .to_string();
            assert!(error.contains("at most 20 px a side"), "{format:?} {error}");
        }
    }

    #[test]
    fn what_stands_behind_a_jpeg_picture_is_not_its_affair() {
        let jpeg = encoded(&slope(), ImageFormat::Jpeg);
        let mut with_film = jpeg.clone();
        // A scan that begins in what is no picture.
        with_film.extend([0, 1, 0xff, 0xda, 7, 7]);
        assert!(decoded(&with_film).is_ok());
        let broken = decoded(&jpeg[..jpeg.len() - 2]).unwrap_err().to_string();
        assert!(broken.contains("expected a complete file"), "{broken}");
    }

    #[test]
    fn the_orientation_tag_is_read_and_turns_nothing() {
        // A little-endian EXIF block with one entry: orientation (0x0112), short, 6.
        let exif: [u8; 32] = [
            b'E', b'x', b'i', b'f', 0, 0, b'I', b'I', 42, 0, 8, 0, 0, 0, 1, 0, 0x12, 1, 3, 0, 1, 0,
            0, 0, 6, 0, 0, 0, 0, 0, 0, 0,
        ];
        let jpeg = encoded(&slope(), ImageFormat::Jpeg);
        let mut bytes = jpeg[..2].to_vec();
        bytes.extend([0xff, 0xe1, 0, exif.len() as u8 + 2]);
        bytes.extend(exif);
        bytes.extend(&jpeg[2..]);
        let picture = decoded(&bytes).unwrap();
        assert_eq!(picture.meta.orientation, Some(6));
        assert_eq!((picture.image.width(), picture.image.height()), (40, 30));
    }
}
