//! What the stages compute: points, passes of identification, the adjustment.

use nalgebra::{Matrix3, SMatrix, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::{CameraId, FrameResult, ImageId, PointId, Stage};
use crate::geometry::Circle;
use crate::targets::DotIndex;

/// A point with its coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Coordinates, mm.
    pub position: Vector3<f64>,
    /// A-posteriori covariance, mm^2; `None` before an adjustment.
    pub covariance: Option<Matrix3<f64>>,
    /// Rays used.
    pub rays: u32,
    /// The edge of its round target; `None` where it is not known. Projects without circles are read as such.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub circle: Option<Circle>,
}

/// One pass of identification.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IdentificationPass {
    /// Dots at that time that were measured where a target must be.
    #[serde(default)]
    pub expected_dots: u32,
    /// [`super::Network::inputs`] at that time.
    pub basis: u64,
    /// Dots that got a name in this pass.
    pub labelled: u32,
    /// Dots without a name after it.
    pub remaining: u32,
    /// New points.
    pub points: u32,
    /// Rms standard error of the station coordinates before it, mm.
    pub sigma_station_mm: f64,
}

/// Two dots that may show a target, which a third image must confirm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tentative {
    /// Where their rays meet, mm.
    pub position: Vector3<f64>,
    /// Covariance of the place, mm^2.
    pub covariance: Matrix3<f64>,
    /// The dots.
    pub dots: [(ImageId, DotIndex); 2],
}

/// Whether an observation takes part in the adjustment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Standing {
    /// It takes part.
    Used,
    /// The test rejected it.
    Rejected,
}

/// One image observation after the adjustment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AdjustedObservation {
    /// The image.
    pub image: ImageId,
    /// The dot.
    pub dot: DotIndex,
    /// The point.
    pub point: PointId,
    /// Residual computed - measured, px, y down.
    pub residual_px: Vector2<f64>,
    /// Redundancy numbers r_x + r_y, 0..2; 0 where not used.
    pub redundancy: f64,
    /// The larger |w| of x and y.
    pub test: f64,
    /// Whether it was used.
    pub standing: Standing,
}

/// A camera after the adjustment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraResult {
    /// The camera.
    pub camera: CameraId,
    /// A-posteriori covariance of the ten parameters; rows of fixed parameters are zero.
    pub covariance: SMatrix<f64, 10, 10>,
}

/// A scale bar after the adjustment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BarResult {
    /// Name of the bar.
    pub name: String,
    /// Adjusted length minus the one that the bar should have ([`super::Network::bar_length_mm`]), mm.
    pub difference_mm: f64,
    /// Normalised residual; `None` for a check bar.
    pub test: Option<f64>,
}

/// How exact a group of observations is by its own residuals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ComponentResult {
    /// What is grouped, in words.
    pub group: String,
    /// Root of the variance component: residuals over what the a-priori sigmas let expect.
    pub factor: f64,
    /// Its standard deviation.
    pub sigma: f64,
    /// Sum of redundancy numbers.
    pub redundancy: f64,
}

/// Where the scale of the coordinates comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ScaleSource {
    /// Points with known coordinates.
    Control,
    /// Scale bars.
    Bars,
    /// The reference cross.
    Cross,
    /// The pitch of the codes.
    Codes,
    /// Nothing: the first base counts 1000 mm.
    Arbitrary,
}

impl std::fmt::Display for ScaleSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            ScaleSource::Control => "control",
            ScaleSource::Bars => "bars",
            ScaleSource::Cross => "cross",
            ScaleSource::Codes => "codes",
            ScaleSource::Arbitrary => "arbitrary",
        })
    }
}

/// The outcome of an adjustment; points and stations carry their own precision.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AdjustmentResult {
    /// Which stage made it.
    pub stage: Stage,
    /// [`super::Network::inputs`] at that time.
    pub basis: u64,
    /// A-posteriori standard deviation of unit weight, without unit.
    pub sigma0: f64,
    /// sigma0 times the rms a-priori sigma of the image observations, px.
    pub sigma0_px: f64,
    /// Rms residual per coordinate, px.
    pub rms_px: f64,
    /// Rms standard error of station coordinates, mm (sigma_S).
    pub sigma_station_mm: f64,
    /// Degrees of freedom.
    pub redundancy: i64,
    /// The datum in words.
    pub datum: String,
    /// The frame that was asked for, and whether the result has it.
    #[serde(default)]
    pub frame: FrameResult,
    /// Where the scale comes from.
    pub scale_from: ScaleSource,
    /// Cameras.
    pub cameras: Vec<CameraResult>,
    /// Scale bars.
    pub bars: Vec<BarResult>,
    /// Groups of observations; none in older projects.
    #[serde(default)]
    pub components: Vec<ComponentResult>,
    /// Image observations, by image and dot.
    pub observations: Vec<AdjustedObservation>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_older_projects_carry_no_circle() {
        let older = r#"{"position":[1.0,2.0,3.0],"covariance":null,"rays":4}"#;
        let mut point: Point = serde_json::from_str(older).unwrap();
        assert_eq!((point.circle, point.rays), (None, 4));
        assert_eq!(serde_json::to_string(&point).unwrap(), older);
        point.circle = Some(Circle {
            normal: Vector3::new(0.1, 0.7, 1.0 / 3.0),
            radius_mm: 2.5,
        });
        let json = serde_json::to_string(&point).unwrap();
        assert_eq!(serde_json::from_str::<Point>(&json).unwrap(), point);
    }
}
