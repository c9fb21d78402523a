//! A camera of the measurement.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::camera::Camera;

/// A camera of the measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct CameraId(pub u32);

/// Where the principal distance that the work starts from was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InteriorSource {
    /// In the camera file.
    CameraFile,
    /// In the EXIF data of the images.
    Exif,
    /// Nowhere: it has to be searched.
    Unknown,
}

impl fmt::Display for InteriorSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            InteriorSource::CameraFile => "camera file",
            InteriorSource::Exif => "EXIF",
            InteriorSource::Unknown => "search",
        })
    }
}

/// What self-calibration may do with a parameter of the lens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LensParameter {
    /// It is let go as far as the images tell it.
    #[default]
    Automatic,
    /// It is free whatever the images tell, as another program had it.
    Free,
    /// It keeps its nominal value.
    Held,
}

impl LensParameter {
    /// All ten as the images tell them: how every camera was before there was a choice.
    fn are_automatic(parameters: &[Self; 10]) -> bool {
        *parameters == [Self::Automatic; 10]
    }
}

/// What of its scale a camera file states, in millimetres; EXIF data fill in the rest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StatedScale {
    /// The pixel pitch.
    pub pitch: bool,
    /// The principal distance.
    pub distance: bool,
}

impl StatedScale {
    fn is_nothing(&self) -> bool {
        *self == Self::default()
    }
}

/// A camera with its start and its present values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraEntry {
    /// Name, as given or from EXIF.
    pub name: String,
    /// As given by the operator or EXIF: the start of all estimates.
    pub nominal: Camera,
    /// Present estimate.
    pub camera: Camera,
    /// Standard deviations of known parameters in the order of `INTERIOR_NAMES`; `None`: no such knowledge.
    pub known_sigmas: [Option<f64>; 10],
    /// What self-calibration may do with the parameters, in the order of `INTERIOR_NAMES`.
    #[serde(default, skip_serializing_if = "LensParameter::are_automatic")]
    pub parameters: [LensParameter; 10],
    /// What of its scale its file states.
    #[serde(default, skip_serializing_if = "StatedScale::is_nothing")]
    pub stated: StatedScale,
    /// Where the principal distance comes from.
    pub source: InteriorSource,
    /// Camera model in the EXIF data of its images.
    pub exif_model: Option<String>,
}
