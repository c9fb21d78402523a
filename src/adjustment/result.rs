//! What comes out of an adjustment.

use nalgebra::{Matrix3, Matrix6, SMatrix, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::{KnownStatistics, Termination};
use crate::camera::Camera;
use crate::geometry::{Circle, Pose, Similarity};

/// A camera with its estimated interior orientation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AdjustedCamera {
    /// Sensor and interior orientation; of parameters that each image has for itself the start values.
    pub camera: Camera,
    /// 10 x 10 in the order of [`crate::camera::INTERIOR_NAMES`], a-posteriori; zeros for parameters that are fixed or
    /// that each image has for itself. It does not depend on the datum.
    pub covariance: SMatrix<f64, 10, 10>,
    /// Of the weighted parameters.
    pub known: [Option<KnownStatistics>; 10],
}

/// A station with its estimated pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AdjustedStation {
    /// Index of its camera.
    pub camera: usize,
    /// Pose.
    pub pose: Pose,
    /// 6 x 6, a-posteriori: turn in the camera frame (rad), projection centre (mm); see [`Pose::moved`].
    pub covariance: Matrix6<f64>,
    /// 6 x 10, a-posteriori: of the same with the ten parameters that its camera has for all of its images.
    pub with_camera: SMatrix<f64, 6, 10>,
    /// Its camera in this image, with the covariance of all estimated parameters, shared ones included; `None` where the
    /// camera has none for each image.
    pub interior: Option<AdjustedCamera>,
}

/// An object point with its estimated coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AdjustedPoint {
    /// Coordinates, mm; for a point that did not take part its start value (moved with the datum).
    pub position: Vector3<f64>,
    /// 3 x 3, mm^2, a-posteriori, zero for fixed coordinates; `None` for a point that did not take part.
    pub covariance: Option<Matrix3<f64>>,
    /// The circle about it as the problem gave it, moved with the datum and the frame.
    pub circle: Option<Circle>,
    /// Of the known coordinates x, y, z.
    pub known: [Option<KnownStatistics>; 3],
    /// Used image observations.
    pub rays: usize,
}

impl AdjustedPoint {
    /// Standard deviations of x, y, z, mm, a-posteriori.
    #[must_use]
    pub fn sigma_mm(&self) -> Option<Vector3<f64>> {
        Some(self.covariance?.diagonal().map(|v| v.max(0.0).sqrt()))
    }
}

/// Whether an observation took part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ObservationStatus {
    /// It did.
    Used,
    /// It did not; its residual is that of a prediction.
    Rejected,
}

/// Residual and reliability of an image observation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageStatistics {
    /// Whether it took part.
    pub status: ObservationStatus,
    /// Computed minus measured, px, y down; `None` where nothing can be computed (the point did not take part, or is
    /// not imaged).
    pub residual_px: Option<Vector2<f64>>,
    /// Redundancy numbers `r = 1 - diag(A Q A^T P)` of x and y, 0 to 1; zeros for a rejected observation.
    pub redundancy: Vector2<f64>,
    /// Normalised residuals `w = v / (sigma sqrt(r))` with the a-priori sigma (Baarda, 1968); for a rejected
    /// observation `v / (sigma sqrt(1 + diag(A Q A^T P)))`; 0 where nothing controls the coordinate.
    pub normalised: Option<Vector2<f64>>,
    /// How far the observation's own point moves for an error of one pixel in x and in y, mm, in this adjustment's datum;
    /// zeros for a rejected observation.
    pub influence_mm_per_px: Vector2<f64>,
}

impl ImageStatistics {
    /// The larger `|w|` of x and y.
    #[must_use]
    pub fn test(&self) -> Option<f64> {
        Some(self.normalised?.amax())
    }
}

/// Residual and reliability of a distance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DistanceStatistics {
    /// Computed minus measured, mm.
    pub residual_mm: f64,
    /// Redundancy number, 0 to 1.
    pub redundancy: f64,
    /// `v / (sigma sqrt(r))`, a-priori sigma; 0 where nothing controls it.
    pub normalised: f64,
}

/// A converged adjustment. All lists are in the order of the problem's.
///
/// **All covariances are a-posteriori**: cofactors times `sigma0^2`; divide by `sigma0^2` for a-priori ones. Normalised
/// residuals use the a-priori sigmas; divided by `sigma0` they are Pope's (1976) tau.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Adjustment {
    /// Cameras.
    pub cameras: Vec<AdjustedCamera>,
    /// Stations.
    pub stations: Vec<AdjustedStation>,
    /// Points.
    pub points: Vec<AdjustedPoint>,
    /// Image observations.
    pub observations: Vec<ImageStatistics>,
    /// Distances; `None` for one of which an end did not take part.
    pub distances: Vec<Option<DistanceStatistics>>,
    /// A-posteriori standard deviation of unit weight, without unit; 1 without redundancy.
    pub sigma0: f64,
    /// `sigma0` times the rms a-priori sigma of the used image observations, px.
    pub sigma0_px: f64,
    /// Rms residual per coordinate of the used image observations, px.
    pub rms_px: f64,
    /// Observed numbers: two an image point, one a distance, weighted coordinate and weighted camera parameter.
    pub observation_count: usize,
    /// Unknowns; fixed coordinates and fixed camera parameters are none.
    pub unknown_count: usize,
    /// The motion from the datum's place into the frame by three points; `None` where none was asked for.
    pub motion: Option<Similarity>,
    /// Motions of the network that the datum takes (conditions).
    pub datum_defect: usize,
    /// Observations - unknowns + datum defect.
    pub redundancy: usize,
    /// Iterations.
    pub iterations: usize,
    /// How they ended.
    pub termination: Termination,
}

impl Adjustment {
    /// Rms standard deviation of all station coordinates, mm, a-posteriori, in this adjustment's datum.
    #[must_use]
    pub fn sigma_station_mm(&self) -> f64 {
        let variances: f64 = self
            .stations
            .iter()
            .map(|s| s.covariance.fixed_view::<3, 3>(3, 3).trace())
            .sum();
        (variances / (3 * self.stations.len()).max(1) as f64).sqrt()
    }
}
