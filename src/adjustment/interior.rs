//! Interior orientation in the adjustment: parameters that all images of a camera share, and those that each image has for itself
//! ("image-variant"; Fraser, 1980; Maas, 1999), as the hold of a lens that gives way under its weight makes them.

use nalgebra::SMatrix;

use super::equations::State;
use super::known::KnownStatistics;
use super::layout::Layout;
use super::selected_inverse::SelectedInverse;
use super::{AdjustedCamera, BundleProblem, CameraBlock, ParameterState, Sharing};
use crate::camera::Camera;

/// A parameter and its place in the reduced system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct InteriorUnknown {
    /// Index into [`crate::camera::INTERIOR_NAMES`].
    pub(super) parameter: usize,
    pub(super) at: usize,
}

/// A known parameter as an observation of an unknown: what is computed less what is known, and its standard deviation.
pub(super) struct InteriorPrior {
    pub(super) at: usize,
    pub(super) residual: f64,
    pub(super) sigma: f64,
}

impl CameraBlock {
    /// Indices of the estimated parameters that are shared so, rising.
    pub(super) fn estimated(&self, sharing: Sharing) -> Vec<usize> {
        (0..10)
            .filter(|&p| self.parameters[p] != ParameterState::Fixed && self.sharing[p] == sharing)
            .collect()
    }
}

impl Layout {
    /// What is estimated of a camera for all of its images.
    pub(super) fn shared_parameters(
        &self,
        camera: usize,
    ) -> impl Iterator<Item = InteriorUnknown> + Clone {
        unknowns(&self.camera_free[camera], self.camera_start[camera])
    }

    /// What is estimated of a station's camera for this image alone.
    pub(super) fn own_parameters(
        &self,
        station: usize,
    ) -> impl Iterator<Item = InteriorUnknown> + Clone {
        let camera = self.camera_of[station];
        unknowns(&self.camera_own[camera], self.own_start[station])
    }
}

fn unknowns(parameters: &[usize], start: usize) -> impl Iterator<Item = InteriorUnknown> + Clone {
    let places = parameters.iter().enumerate();
    places.map(move |(k, &parameter)| InteriorUnknown {
        parameter,
        at: start + k,
    })
}

/// All known parameters: those of the cameras, then those of the stations.
pub(super) fn interior_priors(
    problem: &BundleProblem,
    layout: &Layout,
    state: &State,
) -> Vec<InteriorPrior> {
    let mut priors = Vec::new();
    let mut add = |camera: usize, lens: &Camera, unknown: InteriorUnknown| {
        let InteriorUnknown { parameter, at } = unknown;
        let known = problem.cameras[camera].parameters[parameter];
        if let ParameterState::Weighted { value, sigma } = known {
            priors.push(InteriorPrior {
                at,
                residual: lens.interior.to_vector()[parameter] - value,
                sigma,
            });
        }
    };
    for (camera, lens) in state.cameras.iter().enumerate() {
        for unknown in layout.shared_parameters(camera) {
            add(camera, lens, unknown);
        }
    }
    for (station, lens) in state.own_cameras.iter().enumerate() {
        for unknown in layout.own_parameters(station) {
            if let Some(lens) = lens {
                add(layout.camera_of[station], lens, unknown);
            }
        }
    }
    priors
}

/// A station's camera with the covariance of all its estimated parameters, those that it shares included; `None` where it has no
/// parameter for itself. Known values of the shared ones are tested with their camera.
pub(super) fn own_interior(
    problem: &BundleProblem,
    layout: &Layout,
    state: &State,
    inverse: &SelectedInverse,
    station: usize,
    variance: f64,
) -> Option<AdjustedCamera> {
    let camera = state.own_cameras[station].clone()?;
    let shared = layout.shared_parameters(layout.camera_of[station]);
    let unknowns: Vec<InteriorUnknown> = layout.own_parameters(station).chain(shared).collect();
    let structure = &layout.structure;
    let mut blocks: Vec<usize> = unknowns
        .iter()
        .map(|unknown| structure.block_of(unknown.at))
        .collect();
    blocks.dedup();
    let among = inverse.among(structure, &blocks);
    let mut covariance = SMatrix::<f64, 10, 10>::zeros();
    let mut known = [None; 10];
    let own = layout.own_parameters(station).count();
    for (i, one) in unknowns.iter().enumerate() {
        for (j, other) in unknowns.iter().enumerate() {
            covariance[(one.parameter, other.parameter)] = variance * among[(i, j)];
        }
        let block = &problem.cameras[layout.camera_of[station]];
        if let (true, ParameterState::Weighted { value, sigma }) =
            (i < own, block.parameters[one.parameter])
        {
            let residual = camera.interior.to_vector()[one.parameter] - value;
            known[one.parameter] = Some(KnownStatistics::of(residual, sigma, among[(i, i)]));
        }
    }
    Some(AdjustedCamera {
        camera,
        covariance,
        known,
    })
}
