//! Bundle adjustment: least squares over pictures, points, distances and known values, with exact statistics.
//!
//! The observation equation of an image point is the collinearity condition in the *measured* image (Brown, 1971 with
//! the corrections inverted): `pixel + v = project(M (X - X0); interior)`, so that residuals are what the measurement
//! erred by. Where the circle of a target is known, `project` gives the centre of the circle's image
//! ([`crate::camera::Camera::image_of_target`]), which is what is measured. Distances (`|X_to - X_from|`), known coordinates and known camera parameters are weighted observations;
//! coordinates and parameters that are fixed are constants, neither observed nor unknown.
//!
//! - **Normal equations.** Points are eliminated 3 x 3 at a time (Brown, 1958), which leaves a dense system of six
//!   unknowns a station, the camera parameters and the ends of distances; Cholesky factors it, scaled to unit diagonal.
//!   Interior parameters that change from image to image (Fraser, 1980; Maas, 1999) are unknowns of their station beside those six.
//! - **Iteration.** Gauss-Newton; damping after Levenberg (1944) and Marquardt (1963) only while the cost would rise,
//!   and convergence is judged on an undamped step only: its size in units of the observations' sigmas. A rise of the
//!   cost is never convergence.
//! - **Datum.** Pictures alone leave seven motions of the network free, six when distances fix the scale, fewer with
//!   known coordinates. `G` holds exactly the motions that no observation notices. The reduced system is made regular
//!   by the kept rows of `G`, which changes no residual; afterwards the estimates are moved by a finite similarity and
//!   the cofactors by the S-transformation `S = I - G (G^T E G)^-1 G^T E` (Baarda, 1973; Teunissen, 1985) to the
//!   inner constraints of the datum points (Meissl, 1969; Fraser, 1982): exact, and as cheap as seven more solves.
//! - **Frame.** Three points may give the coordinate system of the result (3-2-1): six functionals `B` of their
//!   coordinates take the place of the inner constraints, `S = I - G (B^T G)^-1 B^T` with the six rigid motions as `G`,
//!   and the estimates move by the finite motion. The scale stays as the datum has it.
//! - **Circles.** The circle of a target is what its ellipses agree on ([`estimate_circle`]); it is estimated between
//!   adjustments and kept in them, where it moves with the network.
//! - **Reliability.** Redundancy numbers and normalised residuals after Baarda (1968), tau after Pope (1976), smallest
//!   detectable errors and what they do to coordinates; gross errors are found by iterated data snooping with a robust start
//!   and restoration ([`adjust_with_rejection`]), wrong weights by variance components ([`adjust_with_components`]).
//! - **Afterwards.** [`SolvedNetwork`] keeps the solved equations: joint covariances of whatever is asked for, derived
//!   quantities, and other datums, without adjusting again.
//!
//! Invariant: results do not depend on the number of threads. Chunks follow from the problem alone and sums run in
//! their order.

mod block_columns;
mod block_matrix;
mod circle;
mod components;
mod datum;
mod dense_front;
mod derived;
mod equations;
mod error;
mod factor;
mod frame;
mod interior;
mod known;
mod layout;
mod median;
mod neighbourhoods;
mod normals;
mod problem;
mod ray_rows;
mod rejection;
mod rejection_settings;
mod result;
mod runaways;
mod selected_inverse;
mod settling;
mod significance;
mod solved;
mod solver;
mod statistics;
mod step;
mod structure;
mod transformation;

#[cfg(test)]
mod circle_tests;
#[cfg(test)]
mod dense;
#[cfg(test)]
mod fixed_tests;
#[cfg(test)]
mod frame_tests;
#[cfg(test)]
mod interior_tests;
#[cfg(test)]
mod simulation;
#[cfg(test)]
mod solved_tests;
#[cfg(test)]
mod tests;

pub use circle::{CircleEstimate, EllipseSight, MeasuredEllipse, estimate_circle, estimate_radius};
pub use components::{
    ComponentAdjustment, ObservationGroups, VarianceComponent, adjust_with_components,
    variance_components,
};
pub use derived::{Derived, DerivedValues, ErrorEllipsoid, correlations};
pub use error::{AdjustmentError, DatumMotion, ParameterName, ProblemPart, StationComponent};
pub use known::KnownStatistics;
pub use problem::{
    BundleProblem, BundleSettings, CameraBlock, CoordinatePrior, Datum, DistanceObservation,
    ImageObservation, ParameterState, PointBlock, ResidualPlane, RobustStart, Sharing,
    StationBlock,
};
pub use rejection::{
    RejectedObservation, RejectionReason, RobustAdjustment, adjust_with_rejection,
};
pub use rejection_settings::{OutlierTest, RejectionSettings};
pub use result::{
    AdjustedCamera, AdjustedPoint, AdjustedStation, Adjustment, DistanceStatistics,
    ImageStatistics, ObservationStatus,
};
pub use settling::{Settled, SettledPoint, settle};
pub use significance::{
    Sigma0Test, Sigma0Verdict, TestPower, VarianceOfUnitWeight, ellipsoid_factor, normal_critical,
    normal_level, student_critical, tau_critical,
};
pub use solved::{Part, SolvedNetwork};
pub use solver::{BundleSolver, Iteration, Phase, Termination, TerminationKind};

use crate::monitor::Monitor;

/// Adjusts to convergence.
///
/// # Errors
/// As [`BundleSolver`]; [`AdjustmentError::Interrupted`] when the work was asked to stop.
pub fn adjust(
    problem: BundleProblem,
    settings: BundleSettings,
    monitor: &Monitor,
) -> Result<Adjustment, AdjustmentError> {
    let task = monitor.task("Adjusting", 0);
    let mut solver = BundleSolver::new(problem, settings, monitor)?;
    loop {
        task.step()?;
        if solver.iterate(monitor)?.termination.is_some() {
            break;
        }
    }
    solver.finish(monitor)
}
