//! Exact statistics of a converged adjustment: covariances in the chosen datum, redundancy, reliability.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, SMatrix, Vector2};
use rayon::prelude::*;

use super::datum::FreeMotions;
use super::equations::{Equations, State};
use super::factor::Factor;
use super::frame::STransformation;
use super::interior::{interior_priors, own_interior};
use super::layout::{Layout, PointFrame};
use super::normals::{Normals, distance_row, whitened_rows};
use super::selected_inverse::SelectedInverse;
use super::solver::other_squares;
use super::{
    AdjustedCamera, AdjustedPoint, AdjustedStation, Adjustment, AdjustmentError, BundleProblem,
    DistanceStatistics, ImageStatistics, ObservationStatus, Termination, TerminationKind,
};

/// Below this redundancy number an observation is not controlled: its normalised residual would be rounding.
const UNCONTROLLED: f64 = 1e-9;

/// What is needed to bring cofactors from the regularised system into the datum: `Q = S Q' S^T`.
struct Transformation {
    /// `G`.
    motions: FreeMotions,
    /// `C = Q' H^T`, rows of the reduced system.
    kept: DMatrix<f64>,
    /// `C`, 3 x d by frame.
    points: Vec<DMatrix<f64>>,
    /// `H C`, d x d.
    inner: DMatrix<f64>,
}

/// Cofactors of a point and `diag(A Q A^T)` of its rays, px^2 per unit variance.
struct PointStatistics {
    cofactor: Matrix3<f64>,
    leverages: Vec<(usize, Vector2<f64>)>,
}

pub(super) fn adjustment(
    problem: &BundleProblem,
    layout: &Layout,
    state: &State,
    equations: &Equations,
) -> Result<Adjustment, AdjustmentError> {
    let weights: Vec<f64> = problem
        .observations
        .iter()
        .zip(&layout.used)
        .map(|(o, used)| if *used { o.sigma_px.powi(-2) } else { 0.0 })
        .collect();
    let normals = Normals::build(problem, layout, state, equations, &weights, 0.0)?;
    let free = FreeMotions::of(problem, layout, state);
    let factor = Factor::new(&normals, layout, state, &free)?;
    let inverse = factor.inverse();
    let counts = Counts::of(problem, layout, state, free.defect());
    let onto_datum = STransformation::new(free, problem, layout, state)?;
    let transformation = Transformation::new(onto_datum, layout, state, &normals, &factor);

    let squares = image_squares(problem, layout, equations) + other_squares(problem, layout, state);
    // Without redundancy nothing tests the a-priori sigmas: they are believed.
    let sigma0 = if counts.redundancy > 0 {
        (squares / counts.redundancy as f64).sqrt()
    } else {
        1.0
    };
    let points: Vec<PointStatistics> = layout
        .frames
        .par_iter()
        .enumerate()
        .with_min_len(8)
        .map(|(f, frame)| {
            point_statistics(
                layout,
                state,
                equations,
                &normals,
                &inverse,
                &transformation,
                f,
                frame,
            )
        })
        .collect();
    let variance = sigma0 * sigma0;
    Ok(Adjustment {
        cameras: cameras(layout, state, &inverse, variance),
        stations: stations(problem, layout, state, &inverse, &transformation, variance),
        observations: image_statistics(problem, layout, equations, &points),
        distances: distance_statistics(problem, layout, equations, &inverse),
        points: adjusted_points(problem, layout, state, &points, variance),
        sigma0,
        sigma0_px: sigma0 * rms_sigma_px(problem, layout),
        rms_px: rms_px(layout, equations),
        observation_count: counts.observations,
        unknown_count: counts.unknowns,
        datum_defect: counts.defect,
        redundancy: counts.redundancy,
        motion: None,
        iterations: 0,
        termination: Termination {
            kind: TerminationKind::Converged,
            value: 0.0,
            threshold: 0.0,
        },
    })
}

/// The median; the mean of the middle two for an even number; `None` without values.
pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    match n {
        0 => None,
        _ if n % 2 == 1 => Some(values[n / 2]),
        _ => Some((values[n / 2 - 1] + values[n / 2]) / 2.0),
    }
}

struct Counts {
    observations: usize,
    unknowns: usize,
    defect: usize,
    redundancy: usize,
}

impl Counts {
    fn of(problem: &BundleProblem, layout: &Layout, state: &State, defect: usize) -> Self {
        let images = 2 * layout.used.iter().filter(|u| **u).count();
        let distances = layout.distance_used.iter().filter(|u| **u).count();
        let coordinates: usize = layout
            .frames
            .iter()
            .map(|f| problem.points[f.point].weighted_coordinates().count())
            .sum();
        let interior = interior_priors(problem, layout, state).len();
        let observations = images + distances + coordinates + interior;
        let unknowns = layout.unknowns();
        Self {
            observations,
            unknowns,
            defect,
            redundancy: (observations + defect).saturating_sub(unknowns),
        }
    }
}

impl Transformation {
    fn new(
        onto_datum: STransformation,
        layout: &Layout,
        state: &State,
        normals: &Normals,
        factor: &Factor,
    ) -> Self {
        let STransformation { motions, h } = onto_datum;
        let d = motions.defect();
        let mut h_of_points: Vec<Option<&DMatrix<f64>>> = vec![None; state.points.len()];
        for (p, h) in &h {
            h_of_points[*p] = Some(h);
        }
        let mut right_side = DMatrix::zeros(layout.kept, d);
        for (frame, normal) in layout.frames.iter().zip(&normals.points) {
            let Some(h) = h_of_points[frame.point] else {
                continue;
            };
            match normal {
                Some(normal) => {
                    let reduced = normal.inverse * h.transpose();
                    for (y, &i) in normal.coupling.iter().zip(&frame.index) {
                        let change = y.transpose() * &reduced;
                        for k in 0..d {
                            right_side[(i, k)] -= change[k];
                        }
                    }
                }
                None => {
                    for (axis, at) in layout.kept_coordinates(frame.point) {
                        let mut row = right_side.row_mut(at);
                        row += h.column(axis).transpose();
                    }
                }
            }
        }
        let mut kept = DMatrix::zeros(layout.kept, d);
        for k in 0..d {
            let column: DVector<f64> = right_side.column(k).into_owned();
            kept.set_column(k, &factor.solve(&column));
        }
        let mut inner = DMatrix::zeros(d, d);
        let mut points = Vec::with_capacity(layout.frames.len());
        for (frame, normal) in layout.frames.iter().zip(&normals.points) {
            let c = point_rows_of_c(
                layout,
                frame,
                normal.as_ref(),
                h_of_points[frame.point],
                &kept,
            );
            if let Some(h) = h_of_points[frame.point] {
                inner += h * &c;
            }
            points.push(c);
        }
        Self {
            motions,
            kept,
            points,
            inner,
        }
    }

    /// `Q_ii = Q'_ii - G_i C_i^T - C_i G_i^T + G_i (H C) G_i^T` for the unknowns with rows `g`, `c` (n x d).
    fn apply(&self, cofactor: &DMatrix<f64>, g: &DMatrix<f64>, c: &DMatrix<f64>) -> DMatrix<f64> {
        let cross = g * c.transpose();
        cofactor - &cross - cross.transpose() + g * &self.inner * g.transpose()
    }
}

fn point_rows_of_c(
    layout: &Layout,
    frame: &PointFrame,
    normal: Option<&super::normals::PointNormal>,
    h: Option<&DMatrix<f64>>,
    kept: &DMatrix<f64>,
) -> DMatrix<f64> {
    let d = kept.ncols();
    match normal {
        Some(normal) => {
            let mut right_side = h.map_or_else(|| DMatrix::zeros(3, d), DMatrix::transpose);
            for (y, &i) in normal.coupling.iter().zip(&frame.index) {
                right_side -= y * kept.row(i);
            }
            let rows = normal.inverse * right_side;
            DMatrix::from_column_slice(3, d, rows.as_slice())
        }
        None => {
            let mut rows = DMatrix::zeros(3, d);
            for (axis, at) in layout.kept_coordinates(frame.point) {
                rows.set_row(axis, &kept.row(at));
            }
            rows
        }
    }
}

#[allow(clippy::too_many_arguments, reason = "the solved system, read only")]
fn point_statistics(
    layout: &Layout,
    state: &State,
    equations: &Equations,
    normals: &Normals,
    inverse: &SelectedInverse,
    transformation: &Transformation,
    at: usize,
    frame: &PointFrame,
) -> PointStatistics {
    let q = frame.index.len();
    let blocks: Vec<usize> = frame.blocks.iter().map(|block| block.0).collect();
    let local = inverse.among(&layout.structure, &blocks);
    // Cofactors of the kept unknowns with the point, and of the point itself (block inverse).
    let (cross, own) = match (&normals.points[at], frame.own_at) {
        (Some(normal), _) => {
            let reduced =
                DMatrix::from_fn(q, 3, |i, k| (normal.inverse * normal.coupling.at(i))[k]);
            let cross = -(&local * &reduced);
            let own = normal.inverse - (reduced.transpose() * &cross).fixed_view::<3, 3>(0, 0);
            (cross, own)
        }
        (None, Some(start)) => {
            let mut own = Matrix3::zeros();
            let axes = &layout.unknown_axes[frame.point];
            for (i, &row) in axes.iter().enumerate() {
                for (j, &column) in axes.iter().enumerate() {
                    own[(row, column)] = local[(start + i, start + j)];
                }
            }
            (DMatrix::zeros(q, 3), own)
        }
        (None, None) => (DMatrix::zeros(q, 3), Matrix3::zeros()),
    };
    let leverages = frame
        .rays
        .iter()
        .filter_map(|ray| {
            let equation = equations.rays[ray.observation].as_ref()?;
            let rows = whitened_rows(layout, ray, equation, 1.0);
            let kept = rows.kept(ray, frame);
            let mut variance = Vector2::zeros();
            for &(i, a) in kept.iter() {
                for &(j, b) in kept.iter() {
                    variance += a.component_mul(&b) * local[(i, j)];
                }
            }
            if frame.own_at.is_none() {
                let b = &rows.by_point;
                for &(i, a) in kept.iter() {
                    let c = cross.row(i);
                    for axis in 0..2 {
                        variance[axis] += 2.0
                            * a[axis]
                            * (c[0] * b[(axis, 0)] + c[1] * b[(axis, 1)] + c[2] * b[(axis, 2)]);
                    }
                }
                variance += (b * own * b.transpose()).diagonal();
            }
            Some((ray.observation, variance))
        })
        .collect();
    let g = transformation
        .motions
        .point_rows(&state.points[frame.point]);
    let own = DMatrix::from_fn(3, 3, |i, j| own[(i, j)]);
    let cofactor = transformation.apply(&own, &g, &transformation.points[at]);
    let cofactor: Matrix3<f64> = cofactor.fixed_view::<3, 3>(0, 0).into_owned();
    PointStatistics {
        cofactor: (cofactor + cofactor.transpose()) / 2.0,
        leverages,
    }
}

fn cameras(
    layout: &Layout,
    state: &State,
    inverse: &SelectedInverse,
    variance: f64,
) -> Vec<AdjustedCamera> {
    let camera = |c: usize| {
        let mut covariance = SMatrix::<f64, 10, 10>::zeros();
        let free = &layout.camera_free[c];
        if !free.is_empty() {
            let block = layout.structure.block_of(layout.camera_start[c]);
            let own = inverse.among(&layout.structure, &[block]);
            for (i, &a) in free.iter().enumerate() {
                for (j, &b) in free.iter().enumerate() {
                    covariance[(a, b)] = variance * own[(i, j)];
                }
            }
        }
        AdjustedCamera {
            camera: state.cameras[c].clone(),
            covariance,
        }
    };
    (0..state.cameras.len()).map(camera).collect()
}

fn stations(
    problem: &BundleProblem,
    layout: &Layout,
    state: &State,
    inverse: &SelectedInverse,
    transformation: &Transformation,
    variance: f64,
) -> Vec<AdjustedStation> {
    let rows = transformation.motions.kept_rows(layout, state);
    (0..state.poses.len())
        .map(|s| {
            let at = 6 * s;
            let cofactor = transformation.apply(
                &inverse.among(&layout.structure, &[s]),
                &rows.rows(at, 6).into_owned(),
                &transformation.kept.rows(at, 6).into_owned(),
            );
            let cofactor: Matrix6<f64> = cofactor.fixed_view::<6, 6>(0, 0).into_owned();
            AdjustedStation {
                camera: problem.stations[s].camera,
                pose: state.poses[s],
                covariance: (cofactor + cofactor.transpose()) * (variance / 2.0),
                interior: own_interior(layout, state, inverse, s, variance),
            }
        })
        .collect()
}

fn adjusted_points(
    problem: &BundleProblem,
    layout: &Layout,
    state: &State,
    statistics: &[PointStatistics],
    variance: f64,
) -> Vec<AdjustedPoint> {
    let mut points: Vec<AdjustedPoint> = state
        .points
        .iter()
        .zip(&state.circles)
        .map(|(position, circle)| AdjustedPoint {
            position: *position,
            covariance: None,
            circle: *circle,
            rays: 0,
        })
        .collect();
    for (frame, statistics) in layout.frames.iter().zip(statistics) {
        let point = &mut points[frame.point];
        let mut covariance = statistics.cofactor * variance;
        // The free motions leave fixed coordinates alone up to rounding; a frame by three points moves them as well.
        if problem.frame.is_none() {
            for (axis, _) in problem.points[frame.point].fixed_coordinates() {
                covariance.row_mut(axis).fill(0.0);
                covariance.column_mut(axis).fill(0.0);
            }
        }
        point.covariance = Some(covariance);
        point.rays = frame.rays.iter().filter(|r| r.used).count();
    }
    points
}

fn image_statistics(
    problem: &BundleProblem,
    layout: &Layout,
    equations: &Equations,
    points: &[PointStatistics],
) -> Vec<ImageStatistics> {
    let mut leverages = vec![None; problem.observations.len()];
    for (observation, variance) in points.iter().flat_map(|p| &p.leverages) {
        leverages[*observation] = Some(*variance);
    }
    let statistics = |i: usize| {
        let sigma = problem.observations[i].sigma_px;
        let status = if layout.used[i] {
            ObservationStatus::Used
        } else {
            ObservationStatus::Rejected
        };
        let (Some(equation), Some(leverage)) = (&equations.rays[i], leverages[i]) else {
            return ImageStatistics {
                status,
                residual_px: None,
                redundancy: Vector2::zeros(),
                normalised: None,
            };
        };
        let share: Vector2<f64> = leverage / (sigma * sigma);
        let residual = equation.residual;
        let (redundancy, factor) = match status {
            ObservationStatus::Used => {
                let r = share.map(|s| (1.0 - s).clamp(0.0, 1.0));
                (r, r)
            }
            // A predicted residual has the variance of the measurement and of the prediction.
            ObservationStatus::Rejected => (Vector2::zeros(), share.map(|s| 1.0 + s)),
        };
        let normalised = residual.zip_map(&factor, |v, f| {
            if f > UNCONTROLLED {
                v / (sigma * f.sqrt())
            } else {
                0.0
            }
        });
        ImageStatistics {
            status,
            residual_px: Some(residual),
            redundancy,
            normalised: Some(normalised),
        }
    };
    (0..problem.observations.len()).map(statistics).collect()
}

fn distance_statistics(
    problem: &BundleProblem,
    layout: &Layout,
    equations: &Equations,
    inverse: &SelectedInverse,
) -> Vec<Option<DistanceStatistics>> {
    let statistics = |(distance, equation): (&super::DistanceObservation, &Option<_>)| {
        let equation: &super::equations::DistanceEquation = equation.as_ref()?;
        let row = distance_row(layout, distance, equation);
        let structure = &layout.structure;
        let mut blocks: Vec<usize> = row.iter().map(|(i, _)| structure.block_of(*i)).collect();
        blocks.dedup();
        let among = inverse.among(structure, &blocks);
        let mut leverage = 0.0;
        for (i, (_, a)) in row.iter().enumerate() {
            for (j, (_, b)) in row.iter().enumerate() {
                leverage += a * b * among[(i, j)];
            }
        }
        let redundancy = (1.0 - leverage / distance.sigma_mm.powi(2)).clamp(0.0, 1.0);
        Some(DistanceStatistics {
            residual_mm: equation.residual,
            redundancy,
            normalised: if redundancy > UNCONTROLLED {
                equation.residual / (distance.sigma_mm * redundancy.sqrt())
            } else {
                0.0
            },
        })
    };
    problem
        .distances
        .iter()
        .zip(&equations.distances)
        .map(statistics)
        .collect()
}

fn image_squares(problem: &BundleProblem, layout: &Layout, equations: &Equations) -> f64 {
    let rays = problem.observations.iter().zip(&equations.rays);
    rays.zip(&layout.used)
        .filter(|r| *r.1)
        .filter_map(|((o, e), _)| Some(e.as_ref()?.residual.norm_squared() * o.sigma_px.powi(-2)))
        .sum()
}

fn rms_sigma_px(problem: &BundleProblem, layout: &Layout) -> f64 {
    let used = problem.observations.iter().zip(&layout.used);
    let squares: Vec<f64> = used
        .filter(|o| *o.1)
        .map(|o| o.0.sigma_px.powi(2))
        .collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

fn rms_px(layout: &Layout, equations: &Equations) -> f64 {
    let rays = equations.rays.iter().zip(&layout.used);
    let squares: Vec<f64> = rays
        .filter(|r| *r.1)
        .filter_map(|r| Some(r.0.as_ref()?.residual.norm_squared()))
        .collect();
    (squares.iter().sum::<f64>() / (2 * squares.len()).max(1) as f64).sqrt()
}
