//! What goes into an adjustment: start values, observations, datum, settings.

use std::collections::BTreeSet;

use nalgebra::{Matrix3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::camera::Camera;
use crate::geometry::{Circle, Pose, ThreeTwoOne};

/// What the adjustment may do with one parameter of interior orientation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ParameterState {
    /// Keeps its start value; its variance is zero.
    Fixed,
    /// Estimated from the image observations alone.
    Free,
    /// Estimated, with a value known beforehand as one more observation.
    Weighted {
        /// The known value, in the parameter's unit.
        value: f64,
        /// Its standard deviation, > 0, in the parameter's unit.
        sigma: f64,
    },
}

/// Whose a parameter of interior orientation is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sharing {
    /// The camera's: one value for all of its images.
    #[default]
    Camera,
    /// The image's: each image of the camera has a value for itself (Fraser, 1980; Maas, 1999). Where the parameter is weighted,
    /// the known value is an observation in each image.
    Image,
}

/// A camera with the part its ten parameters take.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraBlock {
    /// Sensor and start values of the interior orientation.
    pub camera: Camera,
    /// In the order of [`crate::camera::INTERIOR_NAMES`].
    pub parameters: [ParameterState; 10],
    /// Whose each of them is; of no effect on one that is fixed.
    pub sharing: [Sharing; 10],
}

/// One picture: its camera and the start value of its pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StationBlock {
    /// Index into [`BundleProblem::cameras`].
    pub camera: usize,
    /// Start value.
    pub pose: Pose,
}

/// A coordinate that is known beforehand (control).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CoordinatePrior {
    /// It has this value, whatever its start: neither an unknown nor an observation; its variance is zero.
    Fixed {
        /// The coordinate, mm.
        value: f64,
    },
    /// The known value is one more observation.
    Weighted {
        /// The known coordinate, mm.
        value: f64,
        /// Its standard deviation, > 0, mm.
        sigma: f64,
    },
}

/// An object point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointBlock {
    /// Start value, mm; with inner constraints also the place that the datum refers to.
    pub position: Vector3<f64>,
    /// Known coordinates x, y, z; `None` where unknown.
    pub prior: [Option<CoordinatePrior>; 3],
    /// Correlation coefficients x-y, x-z, y-z of the weighted ones among them; zeros where they were measured each for itself.
    pub correlations: [f64; 3],
    /// The circle about it, of whose images the centres are measured; `None` for a point that is measured itself. It
    /// moves with the network and is not estimated.
    pub circle: Option<Circle>,
}

impl PointBlock {
    /// A point of unknown coordinates, started at `position` (mm).
    #[must_use]
    pub fn unknown(position: Vector3<f64>) -> Self {
        Self {
            position,
            prior: [None; 3],
            correlations: [0.0; 3],
            circle: None,
        }
    }

    /// A control point whose three coordinates are known to `sigma` (mm).
    #[must_use]
    pub fn control(position: Vector3<f64>, sigma: Vector3<f64>) -> Self {
        let known = |axis: usize| {
            Some(CoordinatePrior::Weighted {
                value: position[axis],
                sigma: sigma[axis],
            })
        };
        Self {
            prior: [known(0), known(1), known(2)],
            ..Self::unknown(position)
        }
    }

    /// A control point that stays where it is.
    #[must_use]
    pub fn fixed(position: Vector3<f64>) -> Self {
        let fixed = |axis: usize| {
            Some(CoordinatePrior::Fixed {
                value: position[axis],
            })
        };
        Self {
            prior: [fixed(0), fixed(1), fixed(2)],
            ..Self::unknown(position)
        }
    }

    pub(super) fn known_coordinates(&self) -> usize {
        self.prior.iter().flatten().count()
    }

    /// Axes and values of the coordinates that are no unknowns.
    pub(super) fn fixed_coordinates(&self) -> impl Iterator<Item = (usize, f64)> {
        let priors = self.prior.iter().enumerate();
        priors.filter_map(|(axis, prior)| match prior {
            Some(CoordinatePrior::Fixed { value }) => Some((axis, *value)),
            _ => None,
        })
    }

    /// Axes, values and standard deviations of the coordinates that are observed.
    pub(super) fn weighted_coordinates(&self) -> impl Iterator<Item = (usize, f64, f64)> {
        let priors = self.prior.iter().enumerate();
        priors.filter_map(|(axis, prior)| match prior {
            Some(CoordinatePrior::Weighted { value, sigma }) => Some((axis, *value, *sigma)),
            _ => None,
        })
    }

    /// The covariance matrix of the weighted coordinates, mm^2, with ones on the diagonal in the place of all others.
    fn prior_covariance(&self) -> Matrix3<f64> {
        let mut sigmas = [None; 3];
        for (axis, _, sigma) in self.weighted_coordinates() {
            sigmas[axis] = Some(sigma);
        }
        Matrix3::from_fn(|i, j| match (sigmas[i], sigmas[j]) {
            (Some(a), Some(_)) if i == j => a * a,
            // x-y, x-z, y-z: one less than the sum of the axes.
            (Some(a), Some(b)) => self.correlations[i + j - 1] * a * b,
            _ => f64::from(u8::from(i == j)),
        })
    }

    /// The weight matrix of the known coordinates, mm^-2, with zeros for those that are no observations; `None` where the
    /// correlations cannot be.
    pub(super) fn weights(&self) -> Option<Matrix3<f64>> {
        let mut weights = Matrix3::zeros();
        if self.correlations == [0.0; 3] {
            for (axis, _, sigma) in self.weighted_coordinates() {
                weights[(axis, axis)] = sigma.powi(-2);
            }
            return Some(weights);
        }
        let inverse = self.prior_covariance().cholesky()?.inverse();
        for (i, ..) in self.weighted_coordinates() {
            for (j, ..) in self.weighted_coordinates() {
                weights[(i, j)] = inverse[(i, j)];
            }
        }
        Some(weights)
    }

    /// Computed less known coordinates at a position, mm; zeros for those that are no observations.
    pub(super) fn off_known(&self, position: &Vector3<f64>) -> Vector3<f64> {
        let mut off = Vector3::zeros();
        for (axis, value, _) in self.weighted_coordinates() {
            off[axis] = position[axis] - value;
        }
        off
    }

    /// Axes of the coordinates that are unknowns.
    pub(super) fn unknown_axes(&self) -> Vec<usize> {
        let fixed: Vec<usize> = self.fixed_coordinates().map(|(axis, _)| axis).collect();
        (0..3).filter(|axis| !fixed.contains(axis)).collect()
    }
}

/// A measured image point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageObservation {
    /// Index into [`BundleProblem::stations`].
    pub station: usize,
    /// Index into [`BundleProblem::points`].
    pub point: usize,
    /// Measured pixel coordinates, y down.
    pub pixel: Vector2<f64>,
    /// A-priori standard deviation of either coordinate, > 0, px.
    pub sigma_px: f64,
}

/// A measured distance between two object points, such as a scale bar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceObservation {
    /// Index into [`BundleProblem::points`].
    pub from: usize,
    /// Index into [`BundleProblem::points`].
    pub to: usize,
    /// Measured length, mm.
    pub length_mm: f64,
    /// A-priori standard deviation, > 0, mm.
    pub sigma_mm: f64,
}

/// Where image residuals are formed: computed minus measured, px.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ResidualPlane {
    /// In the picture as it was measured, where the errors of measurement are.
    #[default]
    Measured,
    /// Between the point's ideal image and the corrected measurement, as DBAT has it.
    Corrected,
}

/// What fixes position, attitude and scale of the network.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Datum {
    /// Inner constraints over these points: against their start coordinates they are, in the mean, neither shifted nor
    /// turned nor (where no distance or known coordinate fixes the scale) scaled, and the sum of their variances is
    /// least. Points that do not take part in the adjustment, and known ones without rays and distances, are passed over.
    InnerConstraints {
        /// Indices into [`BundleProblem::points`].
        points: Vec<usize>,
    },
    /// Known coordinates fix everything; a freedom they leave is an error.
    Control,
}

/// Everything a bundle adjustment works on.
#[derive(Clone, Debug, PartialEq)]
pub struct BundleProblem {
    /// The cameras.
    pub cameras: Vec<CameraBlock>,
    /// The pictures.
    pub stations: Vec<StationBlock>,
    /// The object points; one without any used observation and known coordinate does not take part.
    pub points: Vec<PointBlock>,
    /// The measured image points.
    pub observations: Vec<ImageObservation>,
    /// The measured distances; one with an end that does not take part is left out too.
    pub distances: Vec<DistanceObservation>,
    /// Where the residuals of the image observations are formed.
    pub residuals: ResidualPlane,
    /// What fixes the frame.
    pub datum: Datum,
    /// The coordinate system of the result by three points (indices into [`BundleProblem::points`]); `None` leaves it
    /// where the datum puts it. It changes no residual, no scale and no distance: coordinates and covariances are those
    /// that the three points as minimum constraints would give.
    pub frame: Option<ThreeTwoOne<usize>>,
    /// Indices of image observations that take no part; their residuals are predicted only.
    pub rejected: BTreeSet<usize>,
}

impl BundleProblem {
    /// By image observation, whether it takes part.
    ///
    /// Cost: the observations.
    pub(super) fn used(&self) -> Vec<bool> {
        let mut used = vec![true; self.observations.len()];
        for &index in &self.rejected {
            if let Some(used) = used.get_mut(index) {
                *used = false;
            }
        }
        used
    }
}

/// Whether gross errors are expected at the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RobustStart {
    /// Least squares from the first iteration on.
    Off,
    /// Weights after Huber (1964) in the first iterations, least squares after them.
    Huber {
        /// Residuals beyond this multiple of the robust scale (1.4826 median) get less weight; without unit.
        threshold: f64,
        /// At most so many iterations.
        iterations: usize,
    },
}

/// How the normal equations are iterated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BundleSettings {
    /// Converged when an undamped step changes the computed observations by less than this, rms, in units of their
    /// standard deviations. Default 1e-6: far below what any sigma prints, far above rounding (1e-10).
    pub convergence: f64,
    /// At most so many iterations; default 200: good starts need 4 to 8, an image that hangs on a single code a hundred.
    pub iterations: usize,
    /// Default off; [`super::RejectionSettings`] has its own.
    pub robust_start: RobustStart,
}

impl Default for BundleSettings {
    fn default() -> Self {
        Self {
            convergence: 1e-6,
            iterations: 200,
            robust_start: RobustStart::Off,
        }
    }
}
