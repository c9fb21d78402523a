//! Exact statistics of a converged adjustment: covariances in the chosen datum, redundancy, reliability.

use nalgebra::{
    Const, DMatrix, Dyn, Matrix3, Matrix3x2, Matrix6, OMatrix, SMatrix, Vector2, Vector3,
};
use rayon::prelude::*;

use super::equations::{Equations, State};
use super::interior::{interior_priors, own_interior};
use super::known::{KnownStatistics, known_coordinates};
use super::layout::{Layout, PointFrame};
use super::neighbourhoods::neighbourhoods;
use super::normals::distance_row;
use super::ray_rows::{MOST_OF_STATION, RayRows};
use super::selected_inverse::{Multiplicand, PointColumns, SelectedInverse};
use super::solved::SolvedNetwork;
use super::solver::other_squares;
use super::{
    AdjustedCamera, AdjustedPoint, AdjustedStation, Adjustment, BundleProblem, DistanceStatistics,
    ImageStatistics, ObservationStatus, ParameterState,
};
use crate::monitor::{Interrupted, Monitor};

/// Below this redundancy number an observation is not controlled: its normalised residual would be rounding.
pub(super) const UNCONTROLLED: f64 = 1e-9;

/// Neighbouring points whose statistics are made together.
const POINTS_AT_ONCE: usize = 16;

/// What the statistics of a ray are made of, per unit variance.
#[derive(Clone, Copy)]
struct RayCofactors {
    observation: usize,
    /// `diag(A Q A^T)`, px^2.
    leverage: Vector2<f64>,
    /// `Q A^T`, the rows of the ray's own point, mm px: how the point follows an error of the observation.
    response: Matrix3x2<f64>,
}

/// Cofactors of a point and of its rays.
#[derive(Clone)]
struct PointStatistics {
    cofactor: Matrix3<f64>,
    /// Cofactors of x, y, z in the regularised system: known coordinates are estimable, so that no datum changes theirs.
    regularised: Matrix3<f64>,
    rays: Vec<RayCofactors>,
}

/// All statistics of a solved network, in its datum.
///
/// # Errors
/// [`Interrupted`] when the work was asked to stop.
pub(super) fn adjustment(
    network: &SolvedNetwork,
    monitor: &Monitor,
) -> Result<Adjustment, Interrupted> {
    let SolvedNetwork {
        problem,
        layout,
        state,
        equations,
        variance,
        counts,
        ..
    } = network;
    let stations_of_rays = (0..problem.stations.len()).into_par_iter();
    let stations_of_rays: Vec<StationCofactors> = stations_of_rays
        .map(|station| {
            monitor
                .check()
                .map(|()| StationCofactors::of(network, station))
        })
        .collect::<Result<_, Interrupted>>()?;
    let points = by_point(network, &stations_of_rays, monitor)?;
    let sigma0 = variance.sqrt();
    monitor.check()?;
    let observations = image_statistics(problem, layout, equations, &points);
    monitor.check()?;
    Ok(Adjustment {
        cameras: cameras(problem, layout, state, &network.inverse, *variance),
        stations: stations(network),
        observations,
        distances: distance_statistics(problem, layout, equations, &network.inverse),
        points: adjusted_points(problem, layout, state, &points, *variance),
        sigma0,
        sigma0_px: sigma0 * rms_sigma_px(problem, layout),
        rms_px: rms_px(layout, equations),
        observation_count: counts.observations,
        unknown_count: counts.unknowns,
        datum_defect: counts.defect,
        redundancy: counts.redundancy,
        motion: None,
        iterations: network.iterations,
        termination: network.termination,
    })
}

/// The statistics of all points, by frame.
fn by_point(
    network: &SolvedNetwork,
    stations: &[StationCofactors],
    monitor: &Monitor,
) -> Result<Vec<PointStatistics>, Interrupted> {
    let frames = &network.layout.frames;
    let places = frames.iter().map(|frame| network.state.points[frame.point]);
    let groups = neighbourhoods(&places.collect::<Vec<_>>(), POINTS_AT_ONCE);
    let found = groups.par_iter().with_max_len(1).map(|group| {
        monitor.check()?;
        let cofactors = cofactors_of(network, group).into_iter();
        let statistics = group.iter().zip(cofactors).map(|(&at, cofactors)| {
            let frame = &frames[at];
            (
                at,
                point_statistics(network, stations, frame, at, &cofactors),
            )
        });
        Ok(statistics.collect())
    });
    let found: Vec<Vec<(usize, PointStatistics)>> = found.collect::<Result<_, Interrupted>>()?;
    let mut found = found.concat();
    found.sort_by_key(|(at, _)| *at);
    Ok(found
        .into_iter()
        .map(|(_, statistics)| statistics)
        .collect())
}

/// The variance of unit weight, a-posteriori.
pub(super) fn variance(
    problem: &BundleProblem,
    layout: &Layout,
    state: &State,
    equations: &Equations,
    counts: &Counts,
) -> f64 {
    let squares = image_squares(problem, layout, equations) + other_squares(problem, layout, state);
    // Without redundancy nothing tests the a-priori sigmas: they are believed.
    if counts.redundancy > 0 {
        squares / counts.redundancy as f64
    } else {
        1.0
    }
}

/// How many of what.
pub(super) struct Counts {
    observations: usize,
    unknowns: usize,
    defect: usize,
    redundancy: usize,
}

impl Counts {
    pub(super) fn of(
        problem: &BundleProblem,
        layout: &Layout,
        state: &State,
        defect: usize,
    ) -> Self {
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

/// Cost: of each ray the square of its sixteen unknowns.
fn point_statistics(
    network: &SolvedNetwork,
    stations: &[StationCofactors],
    frame: &PointFrame,
    at: usize,
    cofactors: &PointCofactors,
) -> PointStatistics {
    let SolvedNetwork {
        problem,
        layout,
        state,
        equations,
        transformation,
        ..
    } = network;
    let PointCofactors { cross, own } = cofactors;
    let regularised = *own;
    let g = transformation
        .motions
        .rows_of_point(frame.point, layout, state);
    let c = &transformation.points[at];
    let rays = frame.rays.iter().filter_map(|ray| {
        let equation = equations.rays[ray.observation].as_ref()?;
        let rows = RayRows::new(layout, frame, ray, equation, 1.0);
        let station = &stations[problem.observations[ray.observation].station];
        let by_station = rows.by_station_and_camera();
        let of_station = station.cofactor * by_station;
        let mut moved = &station.moved * by_station;
        // Q' A^T of the point, and C^T A^T.
        let mut response = Matrix3x2::zeros();
        for block in rows.of_station_and_camera() {
            for (by, cross) in block.each().zip(&cross[block.place..]) {
                response += Vector3::new(cross[0], cross[1], cross[2]) * by.transpose();
            }
        }
        let b = &rows.by_point;
        let mut leverage = Vector2::zeros();
        for k in 0..2 {
            let own = b.row(k) * (2.0 * response.column(k) + regularised * b.row(k).transpose());
            leverage[k] = by_station.column(k).dot(&of_station.column(k)) + own[0];
        }
        response += regularised * b.transpose();
        moved += c.transpose() * b.transpose();
        Some(RayCofactors {
            observation: ray.observation,
            leverage,
            response: response - (&g * moved).fixed_view::<3, 2>(0, 0),
        })
    });
    let rays = rays.collect();
    let own = DMatrix::from_fn(3, 3, |i, j| regularised[(i, j)]);
    let cofactor = transformation.apply(&own, &g, c);
    let cofactor: Matrix3<f64> = cofactor.fixed_view::<3, 3>(0, 0).into_owned();
    PointStatistics {
        cofactor: (cofactor + cofactor.transpose()) / 2.0,
        regularised,
        rays,
    }
}

/// Cofactors in the regularised system: of the kept unknowns with a point, by their places in its frame, and of the point itself.
struct PointCofactors {
    cross: PointColumns,
    own: Matrix3<f64>,
}

/// Cofactors of neighbouring points, given by their frames: with `R = V^-1 Y` of an eliminated one `-Q R^T` and `V^-1 + R Q R^T`
/// (block inverse); those of a kept one stand in the inverse.
///
/// Cost: that of [`SelectedInverse::times`].
fn cofactors_of(network: &SolvedNetwork, group: &[usize]) -> Vec<PointCofactors> {
    let (layout, points) = (&network.layout, &network.normals.points);
    let columns_of = |&at: &usize| {
        let frame = &layout.frames[at];
        let mut columns = vec![[0.0; 4]; frame.index.len()];
        if let Some(normal) = &points[at] {
            for (row, y) in columns.iter_mut().zip(normal.coupling.iter()) {
                let reduced = -(normal.inverse * y);
                row[..3].copy_from_slice(reduced.as_slice());
            }
        } else {
            for (k, axis) in own_places(layout, frame) {
                columns[k][axis] = 1.0;
            }
        }
        columns
    };
    let columns: Vec<PointColumns> = group.iter().map(columns_of).collect();
    let multiplicands = group
        .iter()
        .zip(&columns)
        .map(|(&at, columns)| Multiplicand {
            blocks: &layout.frames[at].blocks,
            columns,
        });
    let products = network
        .inverse
        .times(&layout.structure, multiplicands.collect());
    let all = group.iter().zip(&columns).zip(products);
    all.map(|((&at, columns), cross)| {
        let vector = |row: &[f64; 4]| Vector3::new(row[0], row[1], row[2]);
        let mut own = Matrix3::zeros();
        if let Some(normal) = &points[at] {
            own = normal.inverse;
            for (row, cross) in columns.iter().zip(&cross) {
                own += vector(row) * vector(cross).transpose();
            }
        } else {
            for (k, axis) in own_places(layout, &layout.frames[at]) {
                own.set_row(axis, &vector(&cross[k]).transpose());
            }
        }
        PointCofactors { cross, own }
    })
    .collect()
}

/// Places in the frame of a kept point of its own unknowns, and their axes; none of any other point.
fn own_places(layout: &Layout, frame: &PointFrame) -> impl Iterator<Item = (usize, usize)> {
    let axes = layout.unknown_axes[frame.point].iter().copied();
    let start = frame.own_at.into_iter();
    start.flat_map(move |start| {
        axes.clone()
            .enumerate()
            .map(move |(k, axis)| (start + k, axis))
    })
}

/// Cofactors of what all rays of a station have in common: its own unknowns and those of its camera.
struct StationCofactors {
    /// Of these unknowns, in the order of [`Layout::station_blocks`], zeros after them.
    cofactor: SMatrix<f64, MOST_OF_STATION, MOST_OF_STATION>,
    /// Rows of `C` of these unknowns, transposed.
    moved: OMatrix<f64, Dyn, Const<MOST_OF_STATION>>,
}

impl StationCofactors {
    fn of(network: &SolvedNetwork, station: usize) -> Self {
        let structure = &network.layout.structure;
        let blocks = network.layout.station_blocks(station);
        let among = network.inverse.among(structure, &blocks);
        let mut cofactor = SMatrix::<f64, MOST_OF_STATION, MOST_OF_STATION>::zeros();
        cofactor.view_mut((0, 0), among.shape()).copy_from(&among);
        let kept = &network.transformation.kept;
        let mut moved = OMatrix::<f64, Dyn, Const<MOST_OF_STATION>>::zeros(kept.ncols());
        let unknowns = blocks.iter().flat_map(|&block| structure.range(block));
        for (k, unknown) in unknowns.enumerate() {
            moved.set_column(k, &kept.row(unknown).transpose());
        }
        Self { cofactor, moved }
    }
}

fn cameras(
    problem: &BundleProblem,
    layout: &Layout,
    state: &State,
    inverse: &SelectedInverse,
    variance: f64,
) -> Vec<AdjustedCamera> {
    let camera = |c: usize| {
        let mut covariance = SMatrix::<f64, 10, 10>::zeros();
        let mut known = [None; 10];
        let free = &layout.camera_free[c];
        if !free.is_empty() {
            let block = layout.structure.block_of(layout.camera_start[c]);
            let own = inverse.among(&layout.structure, &[block]);
            for (i, &a) in free.iter().enumerate() {
                for (j, &b) in free.iter().enumerate() {
                    covariance[(a, b)] = variance * own[(i, j)];
                }
                if let ParameterState::Weighted { value, sigma } = problem.cameras[c].parameters[a]
                {
                    let residual = state.cameras[c].interior.to_vector()[a] - value;
                    known[a] = Some(KnownStatistics::of(residual, sigma, own[(i, i)]));
                }
            }
        }
        AdjustedCamera {
            camera: state.cameras[c].clone(),
            covariance,
            known,
        }
    };
    (0..state.cameras.len()).map(camera).collect()
}

fn stations(network: &SolvedNetwork) -> Vec<AdjustedStation> {
    let SolvedNetwork {
        problem,
        layout,
        state,
        transformation,
        variance,
        ..
    } = network;
    (0..state.poses.len())
        .map(|s| {
            let cofactor = transformation.apply(
                &network.inverse.among(&layout.structure, &[s]),
                &transformation.motions.station_rows(&state.poses[s]),
                &transformation.kept.rows(6 * s, 6).into_owned(),
            );
            let cofactor: Matrix6<f64> = cofactor.fixed_view::<6, 6>(0, 0).into_owned();
            AdjustedStation {
                with_camera: with_camera(network, s) * *variance,
                camera: problem.stations[s].camera,
                pose: state.poses[s],
                covariance: (cofactor + cofactor.transpose()) * (*variance / 2.0),
                interior: own_interior(problem, layout, state, &network.inverse, s, *variance),
            }
        })
        .collect()
}

/// Cofactors of a station with the parameters that its camera has for all of its images: `Q' - G C^T`, as no motion of the network
/// changes a camera.
fn with_camera(network: &SolvedNetwork, station: usize) -> SMatrix<f64, 6, 10> {
    let SolvedNetwork {
        layout,
        transformation,
        ..
    } = network;
    let mut cofactors = SMatrix::<f64, 6, 10>::zeros();
    let shared: Vec<_> = layout
        .shared_parameters(layout.camera_of[station])
        .collect();
    let Some(first) = shared.first() else {
        return cofactors;
    };
    let structure = &layout.structure;
    let among = network
        .inverse
        .among(structure, &[station, structure.block_of(first.at)]);
    let g = transformation
        .motions
        .station_rows(&network.state.poses[station]);
    for (k, unknown) in shared.iter().enumerate() {
        let moved = &g * transformation.kept.row(unknown.at).transpose();
        for i in 0..6 {
            cofactors[(i, unknown.parameter)] = among[(i, 6 + k)] - moved[i];
        }
    }
    cofactors
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
            known: [None; 3],
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
        let block = &problem.points[frame.point];
        let off = block.off_known(&state.points[frame.point]);
        point.known = known_coordinates(block, &off, &statistics.regularised);
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
    let mut cofactors = vec![None; problem.observations.len()];
    for ray in points.iter().flat_map(|p| &p.rays) {
        cofactors[ray.observation] = Some(*ray);
    }
    let statistics = |i: usize| {
        let sigma = problem.observations[i].sigma_px;
        let status = if layout.used[i] {
            ObservationStatus::Used
        } else {
            ObservationStatus::Rejected
        };
        let (Some(equation), Some(cofactors)) = (&equations.rays[i], cofactors[i]) else {
            return ImageStatistics {
                status,
                residual_px: None,
                redundancy: Vector2::zeros(),
                normalised: None,
                influence_mm_per_px: Vector2::zeros(),
            };
        };
        let share: Vector2<f64> = cofactors.leverage / (sigma * sigma);
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
            influence_mm_per_px: match status {
                ObservationStatus::Used => {
                    Vector2::new(
                        cofactors.response.column(0).norm(),
                        cofactors.response.column(1).norm(),
                    ) / (sigma * sigma)
                }
                ObservationStatus::Rejected => Vector2::zeros(),
            },
        }
    };
    let all = 0..problem.observations.len();
    all.into_par_iter().map(statistics).collect()
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
