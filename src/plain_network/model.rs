//! What a network of rays consists of; entries refer to each other by index.

use nalgebra::Vector2;

use crate::adjustment::{ResidualPlane, Sharing};
use crate::camera::LensDirection;
use crate::geometry::Pose;
use crate::network::{BarRole, Expansion, length_at_reference};

/// A network of rays: what was measured, what is known, and where an adjustment may start.
#[derive(Clone, Debug, PartialEq)]
pub struct PlainNetwork {
    /// Cameras.
    pub cameras: Vec<PlainCamera>,
    /// Images; each names its camera.
    pub images: Vec<PlainImage>,
    /// Points in the object.
    pub points: Vec<PlainPoint>,
    /// Image points, each with its own weight.
    pub observations: Vec<PlainObservation>,
    /// Known distances between points.
    pub distances: Vec<PlainDistance>,
    /// What the coordinates refer to.
    pub datum: PlainDatum,
    /// Where residuals are formed.
    pub residuals: ResidualPlane,
    /// What warmth does to the object: coordinates are those at its reference temperature.
    pub object: Option<Expansion>,
}

/// A sensor with its lens.
#[derive(Clone, Debug, PartialEq)]
pub struct PlainCamera {
    /// Its name, the only one of this name.
    pub name: String,
    /// Columns of the image.
    pub width_px: u32,
    /// Rows of the image.
    pub height_px: u32,
    /// Side of a pixel, mm.
    pub pixel_pitch_mm: f64,
    /// Which way the lens parameters work.
    pub lens: LensDirection,
    /// c, x0, y0 (mm), K1 (mm^-2), K2 (mm^-4), K3 (mm^-6), P1, P2 (mm^-1), B1, B2 (no unit), in the order of
    /// [`crate::camera::INTERIOR_NAMES`]; starting values of those that are not fixed.
    pub values: [f64; 10],
    /// What an adjustment may do with each value.
    pub parameters: [PlainParameter; 10],
    /// Whose each value is: that of all images of the camera, or a start (and, weighted, an observation) for each image's own.
    pub sharing: [Sharing; 10],
}

/// What an adjustment may do with a camera parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlainParameter {
    /// It keeps its value.
    Fixed,
    /// It is estimated; the value is only a start.
    Free,
    /// It is estimated, and the value is an observation of it.
    Weighted {
        /// Standard deviation of the value, in the unit of the parameter.
        sigma: f64,
    },
}

/// An image.
#[derive(Clone, Debug, PartialEq)]
pub struct PlainImage {
    /// Its name, the only one of this name.
    pub name: String,
    /// Index of its camera.
    pub camera: usize,
    /// Where the camera stood, as far as it is known; a start, not an observation.
    pub start: Option<Pose>,
}

/// A point in the object.
#[derive(Clone, Debug, PartialEq)]
pub struct PlainPoint {
    /// Its name, the only one of this name.
    pub name: String,
    /// Where it is about, mm; a start, not an observation.
    pub start: Option<[f64; 3]>,
    /// Known coordinates, each for itself.
    pub known: [Option<Known>; 3],
    /// Correlation coefficients x-y, x-z, y-z of those with a standard deviation.
    pub correlations: [f64; 3],
    /// What the known coordinates are for.
    pub role: PointRole,
}

/// A known coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    /// The coordinate, mm.
    pub value_mm: f64,
    /// Its standard deviation, mm; `None`: it is fixed.
    pub sigma_mm: Option<f64>,
}

/// What a point is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointRole {
    /// Its known coordinates enter the adjustment.
    Control,
    /// Its known coordinates are only compared with the result.
    Check,
    /// Nothing is known of it.
    New,
}

/// A measured image point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlainObservation {
    /// Index of the image.
    pub image: usize,
    /// Index of the point.
    pub point: usize,
    /// Column, px from the left edge; the first pixel's centre is 0.5.
    pub x_px: f64,
    /// Row, px from the upper edge, downward.
    pub y_px: f64,
    /// Standard deviation of each of the two, px.
    pub sigma_px: f64,
}

/// A known distance between two points.
#[derive(Clone, Debug, PartialEq)]
pub struct PlainDistance {
    /// Its name, the only one of this name.
    pub name: String,
    /// Index of the point at one end.
    pub from: usize,
    /// Index of the point at the other end.
    pub to: usize,
    /// The distance, mm; that of a bar with an expansion is the calibrated one.
    pub length_mm: f64,
    /// Its standard deviation, mm.
    pub sigma_mm: f64,
    /// Whether it enters the adjustment or only checks it.
    pub role: BarRole,
    /// What warmth did to the bar that it was taken from.
    pub expansion: Option<Expansion>,
}

/// What coordinates and their standard errors refer to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PlainDatum {
    /// Inner constraints on these points for whatever motions nothing else fixes (Meissl, 1969).
    InnerConstraints(DatumPoints),
    /// The control points.
    Control,
}

/// The points that a datum of inner constraints rests on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DatumPoints {
    /// All points.
    All,
    /// The points of these indices.
    Listed(Vec<usize>),
}

impl PlainNetwork {
    /// The length that a distance should have between the coordinates of its ends, mm ([`length_at_reference`]).
    #[must_use]
    pub fn length_mm(&self, distance: &PlainDistance) -> f64 {
        length_at_reference(
            distance.length_mm,
            distance.expansion.as_ref(),
            self.object.as_ref(),
        )
    }
}

impl PlainCamera {
    /// Image coordinates (mm, y up, origin at the image centre) of a pixel.
    #[must_use]
    pub fn image_from_pixel(&self, pixel: &Vector2<f64>) -> Vector2<f64> {
        self.camera().image_from_pixel(pixel)
    }

    /// The pixel of image coordinates (mm).
    #[must_use]
    pub fn pixel_from_image(&self, image: &Vector2<f64>) -> Vector2<f64> {
        self.camera().pixel_from_image(image)
    }
}

impl PlainPoint {
    /// A point of which nothing is known.
    #[must_use]
    pub fn new(name: impl Into<String>, start: Option<[f64; 3]>) -> Self {
        Self {
            name: name.into(),
            start,
            known: [None; 3],
            correlations: [0.0; 3],
            role: PointRole::New,
        }
    }
}
