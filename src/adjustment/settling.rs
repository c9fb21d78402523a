//! A network between two of its growths: estimates that gross errors do not bend, without statistics.

use nalgebra::Vector3;

use super::datum::move_onto_datum;
use super::layout::Layout;
use super::rejection::Snooping;
use super::{AdjustmentError, BundleProblem, BundleSettings, RejectionSettings};
use crate::camera::Camera;
use crate::geometry::{Circle, Pose};
use crate::monitor::Monitor;

/// A point of a settled network.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SettledPoint {
    /// Where it is.
    pub position: Vector3<f64>,
    /// Observations that hold it.
    pub rays: usize,
    /// Its circle, moved along.
    pub circle: Option<Circle>,
}

/// The estimates of all unknowns in the datum, without their precision.
#[derive(Clone, Debug, PartialEq)]
pub struct Settled {
    /// By index of the camera.
    pub cameras: Vec<Camera>,
    /// By index of the station, its camera where that has parameters for this image alone.
    pub own_cameras: Vec<Option<Camera>>,
    /// By index of the station.
    pub poses: Vec<Pose>,
    /// By index of the point; `None` for those that were left with too few rays or whose rays do not meet.
    pub points: Vec<Option<SettledPoint>>,
}

/// The robust start of [`super::adjust_with_rejection`] by itself: residuals beyond two robust standard deviations weigh less
/// (Huber, 1964), and those far beyond do not count.
///
/// Cost: that of some iterations; what [`super::adjust_with_rejection`] needs besides, the inverse of the reduced system and a
/// look at every pair of a point's rays, in each of its passes, is most of its own cost.
///
/// # Errors
/// As [`super::adjust`].
pub fn settle(
    problem: &BundleProblem,
    bundle: BundleSettings,
    settings: &RejectionSettings,
    monitor: &Monitor,
) -> Result<Settled, AdjustmentError> {
    let task = monitor.task("Adjusting", 0);
    let mut snooping = Snooping::new(problem, bundle, settings);
    snooping.start_robustly(&task)?;
    let layout = Layout::new(&snooping.problem, monitor)?;
    let start: Vec<Vector3<f64>> = problem.points.iter().map(|p| p.position).collect();
    move_onto_datum(&snooping.problem, &layout, &mut snooping.state, &start)?;
    let rays = snooping.rays_of_points();
    let state = snooping.state;
    let point = |index: usize| {
        let takes_part = layout.takes_part(index) && !snooping.dropped.contains(&index);
        takes_part.then(|| SettledPoint {
            position: state.points[index],
            rays: rays[index],
            circle: state.circles[index],
        })
    };
    Ok(Settled {
        points: (0..state.points.len()).map(point).collect(),
        cameras: state.cameras,
        own_cameras: state.own_cameras,
        poses: state.poses,
    })
}
