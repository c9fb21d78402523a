//! A network adjusted, and held against its truth.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};
use tiepoint::adjustment::{
    Adjustment, AdjustmentError, BundleProblem, BundleSettings, ObservationStatus, adjust,
    normal_critical,
};
use tiepoint::geometry::{Scale, fit_similarity};
use tiepoint::monitor::Monitor;

use super::scene::Scene;

/// Levels at which the w-test is tried.
pub(crate) const LEVELS: [f64; 3] = [0.05, 0.01, 0.001];

/// Level of the test that is to find planted errors.
pub(crate) const LEVEL_OF_PLANTED: f64 = 0.001;

/// Size of a planted error in standard deviations of the observation.
const PLANTED: f64 = 5.0;

/// The squared error of a point in its own standard deviations.
#[derive(Clone, Copy)]
pub(crate) struct PointError {
    /// With the a-priori variance of unit weight: chi-square of 3 degrees of freedom.
    pub(crate) a_priori: f64,
    /// With that of the adjustment: 3 F(3, r).
    pub(crate) a_posteriori: f64,
}

/// An error that was put into one coordinate of an observation.
#[derive(Clone, Copy)]
pub(crate) struct Planted {
    /// The probability with which its redundancy number says that the test finds it.
    pub(crate) power: f64,
    /// Whether the test did.
    pub(crate) found: bool,
}

/// What one network showed.
pub(crate) struct Outcome {
    /// Of all its points.
    pub(crate) points: Vec<PointError>,
    /// Squared errors of the estimated lens parameters in their a-priori standard deviations.
    pub(crate) lens: Vec<f64>,
    /// Degrees of freedom.
    pub(crate) redundancy: usize,
    /// Share of networks that have a smaller sigma0.
    pub(crate) sigma0_share: f64,
    /// Coordinates of observations that are controlled.
    pub(crate) tested: usize,
    /// How many of these each of [`LEVELS`] rejects, before any rejection.
    pub(crate) rejected: [usize; 3],
    /// Errors of five standard deviations, one at a time.
    pub(crate) planted: Vec<Planted>,
}

impl Outcome {
    /// Adjusts a network, and again with each of so many planted errors.
    pub(crate) fn of(scene: &Scene, number: u64, planted: usize) -> Result<Self, AdjustmentError> {
        let adjustment = solve(&scene.problem)?;
        let critical = LEVELS.map(normal_critical);
        let (mut tested, mut rejected) = (0, [0; 3]);
        let mut controlled = Vec::new();
        for (index, observation) in adjustment.observations.iter().enumerate() {
            let Some(w) = observation.normalised else {
                continue;
            };
            for axis in 0..2 {
                if observation.redundancy[axis] > 1e-6 {
                    tested += 1;
                    controlled.push((index, axis));
                    for (count, critical) in rejected.iter_mut().zip(critical) {
                        *count += usize::from(w[axis].abs() > critical);
                    }
                }
            }
        }
        let chi_square = adjustment.sigma0.powi(2) * adjustment.redundancy as f64;
        let distribution = ChiSquared::new(adjustment.redundancy as f64).expect("redundancy");
        Ok(Self {
            points: points(scene, &adjustment),
            lens: lens(scene, &adjustment),
            redundancy: adjustment.redundancy,
            sigma0_share: distribution.cdf(chi_square),
            tested,
            rejected,
            planted: plant(scene, &adjustment, &controlled, number, planted)?,
        })
    }
}

fn solve(problem: &BundleProblem) -> Result<Adjustment, AdjustmentError> {
    adjust(problem.clone(), BundleSettings::default(), &Monitor::new())
}

/// The errors of all points, with the truth fitted onto the datum points alone by the motions that nothing observes.
fn points(scene: &Scene, adjustment: &Adjustment) -> Vec<PointError> {
    let takes_part = |p: &usize| adjustment.points[*p].covariance.is_some();
    let onto = |truth: &Vector3<f64>| -> Vector3<f64> {
        let scale = match adjustment.datum_defect {
            0 => return *truth,
            6 => Scale::One,
            _ => Scale::Free,
        };
        let datum = scene.datum_points().iter().copied().filter(takes_part);
        let pairs: Vec<_> = datum
            .map(|p| (scene.points[p], adjustment.points[p].position))
            .collect();
        fit_similarity(&pairs, scale).expect("a datum").apply(truth)
    };
    let variance = adjustment.sigma0.powi(2);
    let points = scene.points.iter().zip(&adjustment.points);
    points
        .filter_map(|(truth, point)| {
            let inverse = point.covariance?.try_inverse().expect("a regular datum");
            let error = point.position - onto(truth);
            let square = error.dot(&(inverse * error));
            Some(PointError {
                a_priori: square * variance,
                a_posteriori: square,
            })
        })
        .collect()
}

fn lens(scene: &Scene, adjustment: &Adjustment) -> Vec<f64> {
    let camera = &adjustment.cameras[0];
    let error = camera.camera.interior.to_vector() - scene.interior;
    let variance = adjustment.sigma0.powi(2);
    (0..10)
        .filter(|&p| camera.covariance[(p, p)] > 0.0)
        .map(|p| error[p].powi(2) * variance / camera.covariance[(p, p)])
        .collect()
}

fn plant(
    scene: &Scene,
    adjustment: &Adjustment,
    controlled: &[(usize, usize)],
    number: u64,
    count: usize,
) -> Result<Vec<Planted>, AdjustmentError> {
    let mut chance = ChaCha8Rng::seed_from_u64(number);
    chance.set_stream(1);
    let mut start = scene.problem.clone();
    for (block, station) in start.stations.iter_mut().zip(&adjustment.stations) {
        block.pose = station.pose;
    }
    for (block, point) in start.points.iter_mut().zip(&adjustment.points) {
        block.position = point.position;
    }
    for (block, camera) in start.cameras.iter_mut().zip(&adjustment.cameras) {
        block.camera = camera.camera.clone();
    }
    let critical = normal_critical(LEVEL_OF_PLANTED);
    let normal = Normal::standard();
    (0..count)
        .map(|_| {
            let (index, axis) = controlled[chance.random_range(0..controlled.len())];
            let mut problem = start.clone();
            let observation = &mut problem.observations[index];
            let sign = if chance.random::<bool>() { 1.0 } else { -1.0 };
            observation.pixel[axis] += sign * PLANTED * observation.sigma_px;
            let after = solve(&problem)?.observations[index];
            assert_eq!(after.status, ObservationStatus::Used);
            let shift = PLANTED * adjustment.observations[index].redundancy[axis].sqrt();
            Ok(Planted {
                power: normal.cdf(shift - critical) + normal.cdf(-shift - critical),
                found: after.normalised.expect("a used one")[axis].abs() > critical,
            })
        })
        .collect()
}
