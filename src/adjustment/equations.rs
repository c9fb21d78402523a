//! Observation equations: residual = computed - measured, with derivatives.

use nalgebra::{Matrix3, RowVector3, SMatrix, Vector2, Vector3};
use rayon::prelude::*;

use super::layout::Layout;
use super::{Adjustment, BundleProblem, ImageObservation, ResidualPlane, Sharing};
use crate::camera::{Camera, Projection};
use crate::geometry::{Circle, Pose, skew};
use crate::monitor::{Interrupted, Monitor};

/// The values of all unknowns (and of what is kept fixed).
#[derive(Clone, Debug)]
pub(super) struct State {
    /// Shared parameters as estimated; those that each image has for itself as they started.
    pub(super) cameras: Vec<Camera>,
    /// By station, its camera where that has parameters for this image alone.
    pub(super) own_cameras: Vec<Option<Camera>>,
    pub(super) poses: Vec<Pose>,
    pub(super) points: Vec<Vector3<f64>>,
    /// The circles of the points, which turn and grow with the network.
    pub(super) circles: Vec<Option<Circle>>,
}

impl State {
    pub(super) fn start(problem: &BundleProblem) -> Self {
        Self {
            cameras: problem.cameras.iter().map(|c| c.camera.clone()).collect(),
            own_cameras: problem
                .stations
                .iter()
                .map(|station| {
                    let block = problem.cameras.get(station.camera)?;
                    let varies = !block.estimated(Sharing::Image).is_empty();
                    varies.then(|| block.camera.clone())
                })
                .collect(),
            poses: problem.stations.iter().map(|s| s.pose).collect(),
            points: problem.points.iter().map(|p| p.position).collect(),
            circles: problem.points.iter().map(|p| p.circle).collect(),
        }
    }

    pub(super) fn of(adjustment: &Adjustment) -> Self {
        Self {
            cameras: adjustment
                .cameras
                .iter()
                .map(|c| c.camera.clone())
                .collect(),
            own_cameras: adjustment
                .stations
                .iter()
                .map(|station| Some(station.interior.as_ref()?.camera.clone()))
                .collect(),
            poses: adjustment.stations.iter().map(|s| s.pose).collect(),
            points: adjustment.points.iter().map(|p| p.position).collect(),
            circles: adjustment.points.iter().map(|p| p.circle).collect(),
        }
    }

    /// The camera as it was in a picture.
    fn camera(&self, problem: &BundleProblem, station: usize) -> &Camera {
        let shared = &self.cameras[problem.stations[station].camera];
        self.own_cameras[station].as_ref().unwrap_or(shared)
    }

    /// Whether every lens is one that can be computed with.
    pub(super) fn has_sound_lenses(&self) -> bool {
        let own = self.own_cameras.iter().flatten();
        self.cameras.iter().chain(own).all(|camera| {
            camera.interior.to_vector().iter().all(|x| x.is_finite())
                && camera.interior.principal_distance > 0.0
        })
    }

    /// Gives fixed coordinates their values.
    pub(super) fn hold_fixed(&mut self, problem: &BundleProblem) {
        for (point, block) in self.points.iter_mut().zip(&problem.points) {
            for (axis, value) in block.fixed_coordinates() {
                point[axis] = value;
            }
        }
    }
}

/// An image observation at the present state, in px: `v` and its derivatives by the station's turn (camera frame, rad)
/// and centre (mm), by the camera's ten parameters, by the point (mm).
///
/// The derivatives are those of the point's own image: the eccentricity, which changes along by a share of `r^2 / D^2`, is
/// constant within a step and taken anew at the next one. So the motions of the whole network stay exactly what the
/// equations do not notice, and a step is judged by the same equations that made it.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayEquation {
    pub(super) residual: Vector2<f64>,
    /// The image of the point less what is measured of it; zero without a circle.
    pub(super) eccentricity: Vector2<f64>,
    pub(super) by_station: SMatrix<f64, 2, 6>,
    pub(super) by_camera: SMatrix<f64, 2, 10>,
    pub(super) by_point: SMatrix<f64, 2, 3>,
}

/// What an image observation is computed from.
pub(super) struct Sight<'a> {
    pub(super) camera: &'a Camera,
    pub(super) pose: &'a Pose,
    pub(super) point: &'a Vector3<f64>,
    pub(super) circle: Option<&'a Circle>,
    pub(super) pixel: &'a Vector2<f64>,
    pub(super) plane: ResidualPlane,
}

impl<'a> Sight<'a> {
    fn of(problem: &'a BundleProblem, state: &'a State, observation: &'a ImageObservation) -> Self {
        Self {
            camera: state.camera(problem, observation.station),
            pose: &state.poses[observation.station],
            point: &state.points[observation.point],
            circle: state.circles[observation.point].as_ref(),
            pixel: &observation.pixel,
            plane: problem.residuals,
        }
    }

    /// `None` where the camera does not image the point or its circle.
    fn equation(&self) -> Option<RayEquation> {
        let in_camera = self.pose.camera_from_point(self.point);
        // Less what is measured, in the plane of the residuals.
        let projection = match self.plane {
            ResidualPlane::Measured => {
                let projection = self.camera.project_with_jacobians(&in_camera)?;
                Projection {
                    pixel: projection.pixel - self.pixel,
                    ..projection
                }
            }
            ResidualPlane::Corrected => self.camera.corrected_difference(&in_camera, self.pixel)?,
        };
        let eccentricity = match self.circle {
            None => Vector2::zeros(),
            Some(_) => projection.pixel - self.residual()?,
        };
        // k = M (X - X0) and exp([w]) k = k + w x k, so dk/dw = -[k]x, dk/dX0 = -M, dk/dX = M.
        let m: &Matrix3<f64> = self.pose.camera_from_world.matrix();
        let by_point = projection.by_point * m;
        let mut by_station = SMatrix::<f64, 2, 6>::zeros();
        by_station
            .fixed_columns_mut::<3>(0)
            .copy_from(&(-projection.by_point * skew(&in_camera)));
        by_station.fixed_columns_mut::<3>(3).copy_from(&-by_point);
        Some(RayEquation {
            residual: projection.pixel - eccentricity,
            eccentricity,
            by_station,
            by_camera: projection.by_interior,
            by_point,
        })
    }

    /// The residual alone.
    fn residual(&self) -> Option<Vector2<f64>> {
        let image = self
            .camera
            .image_of_target(self.pose, self.point, self.circle)?;
        Some(match self.plane {
            ResidualPlane::Measured => image - self.pixel,
            ResidualPlane::Corrected => {
                let [image, measured] =
                    [&image, self.pixel].map(|px| self.camera.ideal_from_pixel(px));
                let off = (image - measured) / self.camera.pixel_pitch_mm;
                Vector2::new(off.x, -off.y)
            }
        })
    }
}

/// A distance at the present state: residual (mm) and derivative by the far end; that by the near end is its negative.
#[derive(Clone, Copy, Debug)]
pub(super) struct DistanceEquation {
    pub(super) residual: f64,
    pub(super) by_to: RowVector3<f64>,
}

pub(super) fn distance_equation(
    from: &Vector3<f64>,
    to: &Vector3<f64>,
    length_mm: f64,
) -> DistanceEquation {
    let difference = to - from;
    let length = difference.norm();
    DistanceEquation {
        residual: length - length_mm,
        by_to: if length > 0.0 {
            (difference / length).transpose()
        } else {
            RowVector3::zeros()
        },
    }
}

/// All equations at one state, by index of the observation; `None` for what is not imaged or does not take part.
#[derive(Clone)]
pub(super) struct Equations {
    pub(super) rays: Vec<Option<RayEquation>>,
    pub(super) distances: Vec<Option<DistanceEquation>>,
}

impl Equations {
    pub(super) fn at(
        problem: &BundleProblem,
        layout: &Layout,
        state: &State,
        monitor: &Monitor,
    ) -> Result<Self, Interrupted> {
        let rays = problem
            .observations
            .par_iter()
            .with_min_len(64)
            .map(|o| {
                let wanted = layout.takes_part(o.point) && !monitor.is_interrupted();
                wanted.then(|| Sight::of(problem, state, o).equation())?
            })
            .collect();
        monitor.check()?;
        let distances = problem
            .distances
            .iter()
            .enumerate()
            .map(|(i, d)| {
                layout.distance_used[i].then(|| {
                    distance_equation(&state.points[d.from], &state.points[d.to], d.length_mm)
                })
            })
            .collect();
        Ok(Self { rays, distances })
    }
}

/// Image residuals (px) at a state near to that of `equations`, whose eccentricities they keep, by index of the
/// observation.
pub(super) fn trial_residuals(
    problem: &BundleProblem,
    layout: &Layout,
    state: &State,
    equations: &Equations,
) -> Vec<Option<Vector2<f64>>> {
    problem
        .observations
        .par_iter()
        .zip(&equations.rays)
        .with_min_len(64)
        .map(|(o, equation)| {
            let eccentricity = equation.as_ref()?.eccentricity;
            let sight = Sight {
                circle: None,
                ..Sight::of(problem, state, o)
            };
            let takes_part = layout.takes_part(o.point);
            takes_part.then(|| Some(sight.residual()? - eccentricity))?
        })
        .collect()
}

/// Image residuals (px) at a state, by index of the observation.
pub(super) fn image_residuals(
    problem: &BundleProblem,
    layout: &Layout,
    state: &State,
) -> Vec<Option<Vector2<f64>>> {
    problem
        .observations
        .par_iter()
        .with_min_len(64)
        .map(|o| {
            let takes_part = layout.takes_part(o.point);
            takes_part.then(|| Sight::of(problem, state, o).residual())?
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::LensDirection;
    use crate::camera::fixture::wide_angle_camera;
    use nalgebra::SVector;
    use proptest::prelude::*;

    fn vector(range: f64) -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-range..range).prop_map(Vector3::from)
    }

    proptest! {
        #[test]
        fn derivatives_of_a_ray_agree_with_differences(displacing in any::<bool>(), corrected in any::<bool>(), point in vector(150.0), aside in vector(300.0), roll in -3.0..3.0) {
            let mut camera = wide_angle_camera();
            if displacing {
                camera.interior.direction = LensDirection::Displacing { balanced_radius_mm: 9.0 };
            }
            let plane = if corrected { ResidualPlane::Corrected } else { ResidualPlane::Measured };
            let pose = Pose::looking_at(Vector3::new(200.0, -300.0, 1000.0) + aside, Vector3::zeros(), Vector3::y(), roll);
            let pixel = Vector2::new(1000.0, 900.0);
            let at = |camera: &Camera, pose: &Pose, point: &Vector3<f64>| Sight { camera, pose, point, circle: None, pixel: &pixel, plane }.residual().unwrap();
            let equation = Sight { camera: &camera, pose: &pose, point: &point, circle: None, pixel: &pixel, plane }.equation().unwrap();
            prop_assert!((equation.residual - at(&camera, &pose, &point)).norm() < 1e-12);
            for axis in 0..3 {
                let step = |h: f64| { let mut s = Vector3::zeros(); s[axis] = h; s };
                // Central differences: steps give some 0.1 px, curvature and rounding stay below 1e-6 of the largest derivative.
                let (h, turn) = (1e-2, 1e-5);
                let by_turn = (at(&camera, &pose.moved(&step(turn), &Vector3::zeros()), &point) - at(&camera, &pose.moved(&step(-turn), &Vector3::zeros()), &point)) / (2.0 * turn);
                prop_assert!((by_turn - equation.by_station.column(axis)).norm() < 1e-6 * equation.by_station.norm());
                let by_shift = (at(&camera, &pose.moved(&Vector3::zeros(), &step(h)), &point) - at(&camera, &pose.moved(&Vector3::zeros(), &step(-h)), &point)) / (2.0 * h);
                prop_assert!((by_shift - equation.by_station.column(3 + axis)).norm() < 1e-6 * equation.by_point.norm());
                let by_point = (at(&camera, &pose, &(point + step(h))) - at(&camera, &pose, &(point - step(h)))) / (2.0 * h);
                prop_assert!((by_point - equation.by_point.column(axis)).norm() < 1e-6 * equation.by_point.norm());
            }
            for parameter in 0..10 {
                let h = [1e-4, 1e-4, 1e-4, 1e-7, 1e-9, 1e-11, 1e-6, 1e-6, 1e-5, 1e-5][parameter];
                let moved = |h: f64| {
                    let mut step = SVector::<f64, 10>::zeros();
                    step[parameter] = h;
                    let mut camera = camera.clone();
                    camera.interior = camera.interior.with_values(&(camera.interior.to_vector() + step));
                    at(&camera, &pose, &point)
                };
                let column = equation.by_camera.column(parameter);
                // Rounding: pixel coordinates of some 1000 px carry 1e-12 px.
                prop_assert!(((moved(h) - moved(-h)) / (2.0 * h) - column).norm() < 1e-5 * (1.0 + column.norm()) + 2e-12 / h);
            }
        }

        #[test]
        fn derivatives_of_a_distance_agree_with_differences(from in vector(100.0), to in vector(100.0)) {
            prop_assume!((to - from).norm() > 1.0);
            let equation = distance_equation(&from, &to, 50.0);
            let h = 1e-4;
            for axis in 0..3 {
                let mut step = Vector3::zeros();
                step[axis] = h;
                let by_to = (distance_equation(&from, &(to + step), 50.0).residual - distance_equation(&from, &(to - step), 50.0).residual) / (2.0 * h);
                let by_from = (distance_equation(&(from + step), &to, 50.0).residual - distance_equation(&(from - step), &to, 50.0).residual) / (2.0 * h);
                prop_assert!((by_to - equation.by_to[axis]).abs() < 1e-7 && (by_from + equation.by_to[axis]).abs() < 1e-7);
            }
        }
    }
}
