//! Collinearity refinement of a pose.

use nalgebra::{Matrix2x3, Matrix6, SMatrix, Vector2, Vector3, Vector6};

use crate::camera::{Camera, InteriorOrientation};
use crate::geometry::{Pose, skew};

/// An object point and where it was measured in the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseObservation {
    /// Measured place, px.
    pub pixel: Vector2<f64>,
    /// Object point, mm.
    pub point: Vector3<f64>,
    /// Standard error of a pixel coordinate, px.
    pub sigma_px: f64,
}

/// How large residuals count; arguments are in standard errors (length of the residual over sigma).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Loss {
    /// Plain least squares.
    Squares,
    /// Linear beyond the threshold (Huber, 1964): a long way off still pulls, so the start may be poor.
    Huber(f64),
    /// No pull at all beyond the threshold (Tukey's biweight): needs a start within reach.
    Tukey(f64),
}

impl Loss {
    /// The weight factor of a residual of `length` standard errors.
    #[must_use]
    pub fn weight(self, length: f64) -> f64 {
        match self {
            Loss::Squares => 1.0,
            Loss::Huber(k) => {
                if length <= k {
                    1.0
                } else {
                    k / length
                }
            }
            Loss::Tukey(k) => {
                if length < k {
                    (1.0 - (length / k).powi(2)).powi(2)
                } else {
                    0.0
                }
            }
        }
    }

    /// The cost of a residual of `length` standard errors; for small ones half its square.
    fn cost(self, length: f64) -> f64 {
        match self {
            Loss::Squares => 0.5 * length * length,
            Loss::Huber(k) => {
                if length <= k {
                    0.5 * length * length
                } else {
                    k * (length - 0.5 * k)
                }
            }
            Loss::Tukey(k) => {
                let left = (1.0 - (length / k).powi(2)).max(0.0);
                k * k / 6.0 * (1.0 - left.powi(3))
            }
        }
    }
}

/// Settings of [`refine_pose`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefineSettings {
    /// How large residuals count.
    pub loss: Loss,
    /// A residual longer than this many standard errors is called an outlier; 5 rejects one good point in 10^5.
    pub inlier_sigmas: f64,
    /// Iterations at most; from a closed-form start five to eight are needed.
    pub iterations: usize,
}

impl Default for RefineSettings {
    fn default() -> Self {
        Self {
            loss: Loss::Squares,
            inlier_sigmas: 5.0,
            iterations: 50,
        }
    }
}

/// A refined pose.
#[derive(Clone, Debug, PartialEq)]
pub struct RefinedPose {
    /// The pose.
    pub pose: Pose,
    /// A-priori covariance of (turn, centre): radians in the camera frame, mm in the world; times `sigma0^2` it is the
    /// a-posteriori one.
    pub covariance: Matrix6<f64>,
    /// Standard error of unit weight of the inliers; `None` without redundancy.
    pub sigma0: Option<f64>,
    /// Root mean square residual of the inliers, px per coordinate.
    pub rms_px: f64,
    /// Residuals computed - measured, px; `None` where the point is not imaged.
    pub residuals_px: Vec<Option<Vector2<f64>>>,
    /// Which observations are inliers.
    pub inliers: Vec<bool>,
    /// Whether the last step was as small as rounding.
    pub converged: bool,
}

/// Why a pose could not be refined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RefineError {
    /// Fewer than three points.
    #[error("a pose needs 3 points, found {found}")]
    TooFewPoints {
        /// Points given (or left by the robust loss).
        found: usize,
    },
    /// A point is behind the camera at the start, or its lens does not image it.
    #[error("point {index} is not in front of the camera at the approximate pose")]
    NotImaged {
        /// Index of the observation.
        index: usize,
    },
    /// The points do not determine the six unknowns (they lie on one line, or in one place).
    #[error("the points do not determine the pose")]
    Singular,
}

/// An object point and its ideal image point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IdealPoint {
    /// Object point, mm.
    pub point: Vector3<f64>,
    /// Ideal image point (distortion removed), mm.
    pub ideal: Vector2<f64>,
}

/// A pose refined on ideal image points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IdealFit {
    /// The pose.
    pub pose: Pose,
    /// Root mean square residual, mm per coordinate.
    pub rms_mm: f64,
}

/// [`refine_pose`] on ideal image points, all of one weight.
pub fn refine_on_ideal_points(
    points: &[IdealPoint],
    principal_distance: f64,
    start: &Pose,
) -> Result<IdealFit, RefineError> {
    let observe = |p: &IdealPoint| PoseObservation {
        pixel: ideal_pixel(&p.ideal),
        point: p.point,
        sigma_px: 1.0,
    };
    let observations: Vec<PoseObservation> = points.iter().map(observe).collect();
    let camera = ideal_camera(principal_distance);
    let refined = refine_pose(&camera, &observations, start, &RefineSettings::default())?;
    Ok(IdealFit {
        pose: refined.pose,
        rms_mm: refined.rms_px,
    })
}

/// The angle between two poses' directions, radians: from the chord, since the arc cosine of the trace loses half of the
/// digits of small angles and is no number where rounding lifts the trace above 3.
#[must_use]
pub(super) fn turn_between(a: &Pose, b: &Pose) -> f64 {
    let chord = (a.camera_from_world.matrix() - b.camera_from_world.matrix()).norm();
    2.0 * (chord / 8_f64.sqrt()).min(1.0).asin()
}

/// A camera whose pixels are ideal image coordinates in mm, y down: lets solvers that have nothing but a principal
/// distance share the code for real cameras.
#[must_use]
fn ideal_camera(principal_distance: f64) -> Camera {
    Camera {
        width_px: 0,
        height_px: 0,
        pixel_pitch_mm: 1.0,
        interior: InteriorOrientation::pinhole(principal_distance),
    }
}

/// The pixel of [`ideal_camera`] for an ideal image point.
#[must_use]
fn ideal_pixel(ideal: &Vector2<f64>) -> Vector2<f64> {
    Vector2::new(ideal.x, -ideal.y)
}

/// The residual and its derivative by (turn, centre).
fn residual(
    camera: &Camera,
    pose: &Pose,
    observation: &PoseObservation,
) -> Option<(Vector2<f64>, SMatrix<f64, 2, 6>)> {
    let k = pose.camera_from_point(&observation.point);
    let projection = camera.project_with_jacobians(&k)?;
    // M -> exp([w]) M moves k by w x k = -[k] w; moving the centre by d moves k by -M d.
    let by_turn: Matrix2x3<f64> = -projection.by_point * skew(&k);
    let by_centre: Matrix2x3<f64> = -projection.by_point * pose.camera_from_world.matrix();
    let mut jacobian = SMatrix::<f64, 2, 6>::zeros();
    jacobian.fixed_view_mut::<2, 3>(0, 0).copy_from(&by_turn);
    jacobian.fixed_view_mut::<2, 3>(0, 3).copy_from(&by_centre);
    Some((projection.pixel - observation.pixel, jacobian))
}

/// The pose that minimises the (robust) weighted residuals of `observations`: Gauss-Newton, damped after Levenberg and
/// Marquardt where a step would not lower the cost.
///
/// # Errors
/// [`RefineError`]: too few points, a point behind the camera at the start (under a robust loss such points are
/// outliers instead), or points that do not determine a pose.
pub fn refine_pose(
    camera: &Camera,
    observations: &[PoseObservation],
    start: &Pose,
    settings: &RefineSettings,
) -> Result<RefinedPose, RefineError> {
    if observations.len() < 3 {
        return Err(RefineError::TooFewPoints {
            found: observations.len(),
        });
    }
    let mut pose = *start;
    let mut cost = cost(camera, observations, &pose, settings.loss)?;
    let mut damping = 0.0;
    let mut converged = false;
    for _ in 0..settings.iterations {
        let (normal, right) = normal_equations(camera, observations, &pose, settings.loss);
        let Some(step) = damped_step(&normal, &right, damping) else {
            return Err(RefineError::Singular);
        };
        let turn = step.fixed_rows::<3>(0).into_owned();
        let shift = step.fixed_rows::<3>(3).into_owned();
        let moved = pose.moved(&turn, &shift);
        let now = self::cost(camera, observations, &moved, settings.loss).unwrap_or(f64::INFINITY);
        let distance = object_distance(&pose, observations);
        // Below 1e-12 rad a step is rounding.
        let tiny = turn.norm() + shift.norm() / distance < 1e-12;
        if now <= cost {
            let flat = cost - now <= 1e-15 * cost;
            (pose, cost) = (moved, now);
            damping = if damping < 1e-6 { 0.0 } else { damping * 0.1 };
            if tiny || flat {
                converged = true;
                break;
            }
        } else if tiny {
            converged = true;
            break;
        } else {
            damping = (damping * 10.0_f64).max(1e-4);
            if damping > 1e10 {
                break;
            }
        }
    }
    summarise(camera, observations, pose, settings, converged)
}

/// Mean distance of the points from the camera, mm: the scale on which a shift is small.
fn object_distance(pose: &Pose, observations: &[PoseObservation]) -> f64 {
    let sum: f64 = observations
        .iter()
        .map(|o| (o.point - pose.centre_in_world).norm())
        .sum();
    (sum / observations.len() as f64).max(f64::MIN_POSITIVE)
}

fn cost(
    camera: &Camera,
    observations: &[PoseObservation],
    pose: &Pose,
    loss: Loss,
) -> Result<f64, RefineError> {
    let mut sum = 0.0;
    for (index, observation) in observations.iter().enumerate() {
        let k = pose.camera_from_point(&observation.point);
        match (camera.project(&k), loss) {
            (Some(pixel), _) => {
                sum += loss.cost((pixel - observation.pixel).norm() / observation.sigma_px);
            }
            (None, Loss::Squares) => return Err(RefineError::NotImaged { index }),
            // As bad as a residual far outside of any picture.
            (None, _) => sum += loss.cost(1e5 / observation.sigma_px),
        }
    }
    if sum.is_finite() {
        Ok(sum)
    } else {
        Err(RefineError::Singular)
    }
}

fn normal_equations(
    camera: &Camera,
    observations: &[PoseObservation],
    pose: &Pose,
    loss: Loss,
) -> (Matrix6<f64>, Vector6<f64>) {
    let mut normal = Matrix6::zeros();
    let mut right = Vector6::zeros();
    for observation in observations {
        let Some((v, jacobian)) = residual(camera, pose, observation) else {
            continue;
        };
        let sigma = observation.sigma_px;
        let weight = loss.weight(v.norm() / sigma) / (sigma * sigma);
        normal += weight * jacobian.transpose() * jacobian;
        right -= weight * jacobian.transpose() * v;
    }
    (normal, right)
}

/// Solves `(N + damping diag N) x = r` in units in which the diagonal of N is one (radians and mm differ by 10^6).
fn damped_step(normal: &Matrix6<f64>, right: &Vector6<f64>, damping: f64) -> Option<Vector6<f64>> {
    let (scaled, scale) = unit_diagonal(normal)?;
    let damped = scaled + Matrix6::identity() * damping;
    let step = damped.cholesky()?.solve(&right.component_mul(&scale));
    let step = step.component_mul(&scale);
    step.iter().all(|x| x.is_finite()).then_some(step)
}

fn unit_diagonal(normal: &Matrix6<f64>) -> Option<(Matrix6<f64>, Vector6<f64>)> {
    let diagonal = normal.diagonal();
    if !diagonal.iter().all(|d| *d > 0.0 && d.is_finite()) {
        return None;
    }
    let scale = diagonal.map(|d| 1.0 / d.sqrt());
    let scaling = Matrix6::from_diagonal(&scale);
    Some((scaling * normal * scaling, scale))
}

/// The covariance `N^-1`; `None` where N has no inverse worth its name.
fn covariance(normal: &Matrix6<f64>) -> Option<Matrix6<f64>> {
    let (scaled, scale) = unit_diagonal(normal)?;
    let inverse = scaled.cholesky()?.inverse();
    // The largest entry is about the condition number: beyond 1e13 the inverse is rounding.
    if !(inverse.amax() < 1e13) {
        return None;
    }
    let scaling = Matrix6::from_diagonal(&scale);
    Some(scaling * inverse * scaling)
}

fn summarise(
    camera: &Camera,
    observations: &[PoseObservation],
    pose: Pose,
    settings: &RefineSettings,
    converged: bool,
) -> Result<RefinedPose, RefineError> {
    let (normal, _) = normal_equations(camera, observations, &pose, settings.loss);
    let covariance = covariance(&normal).ok_or(RefineError::Singular)?;
    let residuals_px: Vec<Option<Vector2<f64>>> = observations
        .iter()
        .map(|o| Some(camera.project(&pose.camera_from_point(&o.point))? - o.pixel))
        .collect();
    let mut inliers = Vec::with_capacity(observations.len());
    let (mut squares, mut weighted, mut count) = (0.0, 0.0, 0_usize);
    for (v, observation) in residuals_px.iter().zip(observations) {
        let length = v.map_or(f64::INFINITY, |v| v.norm() / observation.sigma_px);
        let inlier = length <= settings.inlier_sigmas;
        inliers.push(inlier);
        if let (true, Some(v)) = (inlier || settings.loss == Loss::Squares, v) {
            squares += v.norm_squared();
            weighted += length * length;
            count += 1;
        }
    }
    if count < 3 {
        return Err(RefineError::TooFewPoints { found: count });
    }
    let redundancy = 2 * count - 6;
    Ok(RefinedPose {
        pose,
        covariance,
        sigma0: (redundancy > 0).then(|| (weighted / redundancy as f64).sqrt()),
        rms_px: (squares / (2 * count) as f64).sqrt(),
        residuals_px,
        inliers,
        converged,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::simulation::{self, Noise};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_jacobian_agrees_with_differences(turn in prop::array::uniform3(-0.3..0.3), x in prop::array::uniform3(-200.0..200.0)) {
            let camera = simulation::distorted_camera();
            let pose = simulation::station(1).moved(&Vector3::from(turn), &Vector3::zeros());
            let observation = PoseObservation { pixel: Vector2::zeros(), point: Vector3::from(x), sigma_px: 1.0 };
            let Some((_, jacobian)) = residual(&camera, &pose, &observation) else { return Ok(()) };
            for axis in 0..6 {
                let h = if axis < 3 { 1e-6 } else { 1e-3 };
                let mut step = Vector6::zeros();
                step[axis] = h;
                let moved = |s: Vector6<f64>| {
                    let pose = pose.moved(&s.fixed_rows::<3>(0).into_owned(), &s.fixed_rows::<3>(3).into_owned());
                    residual(&camera, &pose, &observation).unwrap().0
                };
                let difference = (moved(step) - moved(-step)) / (2.0 * h);
                // Differences of 1000 px with 1e-12 px of rounding over steps of 1e-6 rad.
                prop_assert!((difference - jacobian.column(axis)).norm() < 1e-5 * (1.0 + jacobian.column(axis).norm()));
            }
        }
    }

    #[test]
    fn exact_points_give_the_exact_pose() {
        let camera = simulation::distorted_camera();
        for seed in 0..20 {
            let scene = simulation::scene(&camera, 12, Noise(0.0), seed);
            let start = scene.pose.moved(
                &Vector3::new(0.1, -0.08, 0.2),
                &Vector3::new(60.0, -40.0, 80.0),
            );
            let found = refine_pose(
                &camera,
                &scene.observations,
                &start,
                &RefineSettings::default(),
            )
            .unwrap();
            assert!(found.converged);
            // Rounding of 1e-12 px at 10 um per px and some ten times worse geometry.
            assert!((found.pose.centre_in_world - scene.pose.centre_in_world).norm() < 1e-8);
            assert!(found.rms_px < 1e-9);
        }
    }

    #[test]
    fn errors_are_as_large_as_the_covariance_says() {
        let camera = simulation::camera();
        let mut sum = 0.0;
        let trials = 300;
        for seed in 0..trials {
            let scene = simulation::scene(&camera, 10, Noise(0.1), seed);
            let found = refine_pose(
                &camera,
                &scene.observations,
                &scene.pose,
                &RefineSettings::default(),
            )
            .unwrap();
            let turn = (scene.pose.camera_from_world * found.pose.camera_from_world.inverse())
                .scaled_axis();
            let shift = scene.pose.centre_in_world - found.pose.centre_in_world;
            let error = Vector6::from_iterator(turn.iter().chain(shift.iter()).copied());
            sum += error.dot(&(found.covariance.try_inverse().unwrap() * error));
        }
        // Chi-square with 6 x 300 degrees of freedom: mean 6, standard error 0.2.
        let mean = sum / trials as f64;
        assert!((mean - 6.0).abs() < 0.8, "{mean}");
    }

    #[test]
    fn a_robust_loss_finds_the_outliers() {
        let camera = simulation::camera();
        for seed in 0..20 {
            let mut scene = simulation::scene(&camera, 14, Noise(0.1), seed);
            for wrong in [2, 9, 11] {
                scene.observations[wrong].pixel += Vector2::new(60.0, -30.0 * wrong as f64);
            }
            let start = scene.pose.moved(
                &Vector3::new(0.01, 0.0, 0.01),
                &Vector3::new(5.0, 5.0, -5.0),
            );
            let huber = RefineSettings {
                loss: Loss::Huber(2.0),
                ..RefineSettings::default()
            };
            let near = refine_pose(&camera, &scene.observations, &start, &huber)
                .unwrap()
                .pose;
            let tukey = RefineSettings {
                loss: Loss::Tukey(8.0),
                ..RefineSettings::default()
            };
            let found = refine_pose(&camera, &scene.observations, &near, &tukey).unwrap();
            let outliers: Vec<usize> = (0..14).filter(|&i| !found.inliers[i]).collect();
            assert_eq!(outliers, [2, 9, 11]);
        }
    }

    #[test]
    fn degenerate_inputs_are_errors() {
        let camera = simulation::camera();
        let scene = simulation::scene(&camera, 6, Noise(0.0), 1);
        let settings = RefineSettings::default();
        let refine = |observations: &[PoseObservation]| {
            refine_pose(&camera, observations, &scene.pose, &settings)
        };
        assert_eq!(
            refine(&scene.observations[..2]),
            Err(RefineError::TooFewPoints { found: 2 })
        );
        assert_eq!(
            refine(&[scene.observations[0]; 5]),
            Err(RefineError::Singular)
        );
        let mut behind = scene.observations.clone();
        behind[4].point = scene.pose.centre_in_world * 2.0;
        assert_eq!(refine(&behind), Err(RefineError::NotImaged { index: 4 }));
        let mut nan = scene.observations.clone();
        nan[0].pixel.x = f64::NAN;
        assert!(refine(&nan).is_err());
    }
}
