//! A step of the iteration: the corrections of all unknowns, and where they lead.

use nalgebra::{DVector, Vector3};

use super::equations::State;
use super::layout::Layout;
use super::normals::Normals;

/// Corrections of all unknowns.
pub(super) struct Step {
    /// Of those that are not eliminated.
    pub(super) kept: DVector<f64>,
    /// Of the eliminated points, by frame.
    pub(super) points: Vec<Option<Vector3<f64>>>,
}

impl Step {
    /// The solution of reduced normal equations with what follows from it for the points.
    pub(super) fn of(kept: DVector<f64>, normals: &Normals, layout: &Layout) -> Self {
        let points = normals.point_steps(layout, &kept);
        Self { kept, points }
    }

    /// This part of the way along the parabola that sets out along this step and ends where `bent` leads.
    pub(super) fn bent_towards(&self, bent: &Self, part: f64) -> Self {
        let (straight, square) = (part - part * part, part * part);
        let points = self.points.iter().zip(&bent.points);
        Self {
            kept: &self.kept * straight + &bent.kept * square,
            points: points
                .map(|(own, bent)| Some((*own)? * straight + (*bent)? * square))
                .collect(),
        }
    }

    /// The state this part of the step away from another.
    pub(super) fn from(&self, start: &State, layout: &Layout, part: f64) -> State {
        let kept = &self.kept * part;
        let mut state = start.clone();
        for (s, pose) in state.poses.iter_mut().enumerate() {
            let at = 6 * s;
            *pose = pose.moved(
                &Vector3::new(kept[at], kept[at + 1], kept[at + 2]),
                &Vector3::new(kept[at + 3], kept[at + 4], kept[at + 5]),
            );
        }
        for (c, camera) in state.cameras.iter_mut().enumerate() {
            let mut interior = camera.interior.to_vector();
            for unknown in layout.shared_parameters(c) {
                interior[unknown.parameter] += kept[unknown.at];
            }
            camera.interior = camera.interior.with_values(&interior);
        }
        for (s, camera) in state.own_cameras.iter_mut().enumerate() {
            let Some(camera) = camera else { continue };
            let mut interior = camera.interior.to_vector();
            let shared = layout.shared_parameters(layout.camera_of[s]);
            for unknown in layout.own_parameters(s).chain(shared) {
                interior[unknown.parameter] += kept[unknown.at];
            }
            camera.interior = camera.interior.with_values(&interior);
        }
        for (p, point) in state.points.iter_mut().enumerate() {
            for (axis, at) in layout.kept_coordinates(p) {
                point[axis] += kept[at];
            }
        }
        for (frame, step) in layout.frames.iter().zip(&self.points) {
            if let Some(step) = step {
                state.points[frame.point] += step * part;
            }
        }
        state
    }
}
