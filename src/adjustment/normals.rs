//! Normal equations with the points eliminated (Schur, 1917; Brown, 1958), their factorisation and inverse.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix3, SMatrix, Vector2, Vector3};
use rayon::prelude::*;

use super::datum::FreeMotions;
use super::equations::{Equations, State};
use super::layout::{Layout, PointFrame};
use super::{AdjustmentError, BundleProblem, ParameterName, ParameterState};

/// A pivot below this part of the unknown's own normal matrix diagonal is rounding: the unknown is not determined.
const PIVOT_FLOOR: f64 = 1e-13;

/// Eigenvalues of the scaled normal matrix below this belong to the null space that an error names.
const NULL_EIGENVALUE: f64 = 1e-11;

/// An unknown is named in a rank defect when it moves at least this part of the one that moves most.
const NAMED_SHARE: f64 = 0.1;

/// An eliminated point: `V^-1`, its right side, and the coupling `Y` (rows as [`PointFrame::index`]).
#[derive(Clone, Debug)]
pub(super) struct PointNormal {
    pub(super) coupling: Vec<Vector3<f64>>,
    pub(super) inverse: Matrix3<f64>,
    pub(super) right_side: Vector3<f64>,
}

/// The reduced normal equations `S dx = g`.
pub(super) struct Normals {
    /// Lower triangle of `S`.
    pub(super) reduced: DMatrix<f64>,
    pub(super) right_side: DVector<f64>,
    /// Diagonal before the points were eliminated: the measure of what rounding is.
    pub(super) unreduced_diagonal: DVector<f64>,
    /// By frame; `None` for kept points.
    pub(super) points: Vec<Option<PointNormal>>,
}

struct ChunkSum {
    reduced: DMatrix<f64>,
    right_side: DVector<f64>,
    diagonal: DVector<f64>,
    points: Vec<Option<PointNormal>>,
    loose: Vec<usize>,
}

/// Whitened derivatives of a ray by the unknowns of its frame, and by its point.
pub(super) struct RayRows {
    pub(super) by_station: SMatrix<f64, 2, 6>,
    pub(super) by_camera: Vec<Vector2<f64>>,
    pub(super) by_point: SMatrix<f64, 2, 3>,
}

impl Normals {
    /// Normal equations with weights per image observation (1/px^2) and the diagonal enlarged by the part `damping`
    /// (Levenberg, 1944; Marquardt, 1963).
    pub(super) fn build(
        problem: &BundleProblem,
        layout: &Layout,
        state: &State,
        equations: &Equations,
        weights: &[f64],
        damping: f64,
    ) -> Result<Self, AdjustmentError> {
        let size = chunk_size(layout);
        let chunks: Vec<ChunkSum> = layout
            .frames
            .par_chunks(size)
            .map(|frames| {
                let mut sum = ChunkSum {
                    reduced: DMatrix::zeros(layout.kept, layout.kept),
                    right_side: DVector::zeros(layout.kept),
                    diagonal: DVector::zeros(layout.kept),
                    points: Vec::with_capacity(frames.len()),
                    loose: Vec::new(),
                };
                for frame in frames {
                    sum.add_point(problem, layout, state, frame, equations, weights, damping);
                }
                sum
            })
            .collect();
        let mut normals = Self {
            reduced: DMatrix::zeros(layout.kept, layout.kept),
            right_side: DVector::zeros(layout.kept),
            unreduced_diagonal: DVector::zeros(layout.kept),
            points: Vec::with_capacity(layout.frames.len()),
        };
        let mut loose = Vec::new();
        for chunk in chunks {
            normals.reduced += chunk.reduced;
            normals.right_side += chunk.right_side;
            normals.unreduced_diagonal += chunk.diagonal;
            normals.points.extend(chunk.points);
            loose.extend(chunk.loose);
        }
        if !loose.is_empty() {
            return Err(AdjustmentError::RankDefect {
                defect: loose.len(),
                loose: loose
                    .into_iter()
                    .map(|index| ParameterName::Point { index })
                    .collect(),
            });
        }
        normals.add_distances(problem, layout, equations);
        normals.add_camera_priors(problem, layout, state);
        for i in 0..layout.kept {
            normals.reduced[(i, i)] += damping * normals.unreduced_diagonal[i];
        }
        Ok(normals)
    }

    /// The corrections of the points that belong to a solution `kept` of the reduced system, by frame.
    pub(super) fn point_steps(
        &self,
        layout: &Layout,
        kept: &DVector<f64>,
    ) -> Vec<Option<Vector3<f64>>> {
        let frames = layout.frames.iter().zip(&self.points);
        frames
            .map(|(frame, normal)| {
                let normal = normal.as_ref()?;
                let mut right_side = normal.right_side;
                for (y, &i) in normal.coupling.iter().zip(&frame.index) {
                    right_side -= y * kept[i];
                }
                Some(normal.inverse * right_side)
            })
            .collect()
    }

    /// `dx^T N dx` of the undamped step whose reduced part is `kept`: the squared change of all whitened observations.
    pub(super) fn predicted_change(&self, kept: &DVector<f64>) -> f64 {
        let of_points: f64 = self
            .points
            .iter()
            .flatten()
            .map(|p| p.right_side.dot(&(p.inverse * p.right_side)))
            .sum();
        kept.dot(&self.right_side) + of_points
    }

    fn add_distances(&mut self, problem: &BundleProblem, layout: &Layout, equations: &Equations) {
        for (distance, equation) in problem.distances.iter().zip(&equations.distances) {
            let Some(equation) = equation else { continue };
            let weight = distance.sigma_mm.powi(-2);
            let row = distance_row(layout, distance, equation);
            for &(i, a) in &row {
                self.right_side[i] -= weight * a * equation.residual;
                self.unreduced_diagonal[i] += weight * a * a;
                for &(j, b) in row.iter().filter(|(j, _)| *j <= i) {
                    self.reduced[(i, j)] += weight * a * b;
                }
            }
        }
    }

    fn add_camera_priors(&mut self, problem: &BundleProblem, layout: &Layout, state: &State) {
        for (c, block) in problem.cameras.iter().enumerate() {
            let interior = state.cameras[c].interior.to_vector();
            for (k, &parameter) in layout.camera_free[c].iter().enumerate() {
                if let ParameterState::Weighted { value, sigma } = block.parameters[parameter] {
                    let i = layout.camera_start[c] + k;
                    let weight = sigma.powi(-2);
                    self.reduced[(i, i)] += weight;
                    self.unreduced_diagonal[i] += weight;
                    self.right_side[i] -= weight * (interior[parameter] - value);
                }
            }
        }
    }
}

/// The non-zero derivatives of a distance by unknowns of the reduced system.
pub(super) fn distance_row(
    layout: &Layout,
    distance: &super::DistanceObservation,
    equation: &super::equations::DistanceEquation,
) -> Vec<(usize, f64)> {
    let end = |point: usize, sign: f64| {
        let start = match layout.roles[point] {
            super::layout::PointRole::Kept { start } => Some(start),
            _ => None,
        };
        start
            .into_iter()
            .flat_map(move |s| (0..3).map(move |axis| (s + axis, sign * equation.by_to[axis])))
    };
    end(distance.from, -1.0)
        .chain(end(distance.to, 1.0))
        .collect()
}

/// Frames a chunk: it depends on the problem alone, so that sums are the same on any number of threads; few enough
/// chunks that their dense sums fit into memory.
fn chunk_size(layout: &Layout) -> usize {
    const SUMS_BYTES: usize = 128 << 20;
    let bytes = (8 * layout.kept * layout.kept).max(1);
    let chunks = (SUMS_BYTES / bytes).clamp(1, 16);
    layout.frames.len().div_ceil(chunks).max(1)
}

/// The derivatives of a used or predicted ray times the root of `weight`.
pub(super) fn whitened_rows(
    layout: &Layout,
    ray: &super::layout::Ray,
    equation: &super::equations::RayEquation,
    weight: f64,
) -> RayRows {
    let root = weight.sqrt();
    RayRows {
        by_station: equation.by_station * root,
        by_camera: layout.camera_free[ray.camera]
            .iter()
            .map(|&p| equation.by_camera.column(p) * root)
            .collect(),
        by_point: equation.by_point * root,
    }
}

impl RayRows {
    /// Pairs of (place in the frame, derivative of both coordinates) of all kept unknowns of this ray.
    pub(super) fn kept(
        &self,
        ray: &super::layout::Ray,
        own_at: Option<usize>,
    ) -> Vec<(usize, Vector2<f64>)> {
        let mut rows = Vec::with_capacity(9 + self.by_camera.len());
        rows.extend((0..6).map(|k| (ray.station_at + k, self.by_station.column(k).into_owned())));
        rows.extend(
            self.by_camera
                .iter()
                .enumerate()
                .map(|(k, a)| (ray.camera_at + k, *a)),
        );
        if let Some(own) = own_at {
            rows.extend((0..3).map(|k| (own + k, self.by_point.column(k).into_owned())));
        }
        rows
    }
}

impl ChunkSum {
    #[allow(
        clippy::too_many_arguments,
        reason = "one state of the solver, read only"
    )]
    fn add_point(
        &mut self,
        problem: &BundleProblem,
        layout: &Layout,
        state: &State,
        frame: &PointFrame,
        equations: &Equations,
        weights: &[f64],
        damping: f64,
    ) {
        let mut coupling = vec![Vector3::zeros(); frame.index.len()];
        let n = layout.kept;
        let mut own = Matrix3::zeros();
        let mut own_right = Vector3::zeros();
        for ray in frame.rays.iter().filter(|r| r.used) {
            let Some(equation) = &equations.rays[ray.observation] else {
                continue;
            };
            let weight = weights[ray.observation];
            let rows = whitened_rows(layout, ray, equation, weight);
            let residual = equation.residual * weight.sqrt();
            let kept = rows.kept(ray, frame.own_at);
            for (k, &(a, by_a)) in kept.iter().enumerate() {
                let i = frame.index[a];
                self.right_side[i] -= by_a.dot(&residual);
                self.diagonal[i] += by_a.norm_squared();
                let column = &mut self.reduced.as_mut_slice()[n * i..n * (i + 1)];
                // Places rise within a ray, so that what follows lies below the diagonal.
                for &(b, by_b) in &kept[k..] {
                    column[frame.index[b]] += by_a.dot(&by_b);
                }
                coupling[a] += rows.by_point.transpose() * by_a;
            }
            own += rows.by_point.transpose() * rows.by_point;
            own_right -= rows.by_point.transpose() * residual;
        }
        let position = state.points[frame.point];
        for axis in 0..3 {
            if let Some(prior) = problem.points[frame.point].prior[axis] {
                let weight = prior.sigma.powi(-2);
                let right = -weight * (position[axis] - prior.value);
                if let Some(at) = frame.own_at {
                    let i = frame.index[at + axis];
                    self.reduced[(i, i)] += weight;
                    self.diagonal[i] += weight;
                    self.right_side[i] += right;
                } else {
                    own[(axis, axis)] += weight;
                    own_right[axis] += right;
                }
            }
        }
        if frame.own_at.is_some() {
            self.points.push(None);
            return;
        }
        for axis in 0..3 {
            own[(axis, axis)] *= 1.0 + damping;
        }
        match inverse_of_point(&own) {
            Some(inverse) => {
                let normal = PointNormal {
                    coupling,
                    inverse,
                    right_side: own_right,
                };
                self.eliminate(frame, &normal);
                self.points.push(Some(normal));
            }
            None => {
                self.loose.push(frame.point);
                self.points.push(None);
            }
        }
    }

    fn eliminate(&mut self, frame: &PointFrame, normal: &PointNormal) {
        let q = frame.index.len();
        let coupling: [Vec<f64>; 3] =
            std::array::from_fn(|k| normal.coupling.iter().map(|y| y[k]).collect());
        let n = self.reduced.nrows();
        let matrix = self.reduced.as_mut_slice();
        let mut products = vec![0.0; q];
        for (b, y) in normal.coupling.iter().enumerate() {
            let j = frame.index[b];
            let z = normal.inverse * y;
            self.right_side[j] -= z.dot(&normal.right_side);
            let [x0, x1, x2] = [&coupling[0][b..], &coupling[1][b..], &coupling[2][b..]];
            let products = &mut products[b..];
            for (((p, x0), x1), x2) in products.iter_mut().zip(x0).zip(x1).zip(x2) {
                *p = x0 * z.x + x1 * z.y + x2 * z.z;
            }
            let column = &mut matrix[n * j..n * (j + 1)];
            for (p, &i) in products.iter().zip(&frame.index[b..]) {
                column[i] -= p;
            }
        }
    }
}

/// The inverse of a point's normal matrix; `None` where its rays do not intersect.
fn inverse_of_point(own: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let cholesky = Cholesky::new(*own)?;
    let l = cholesky.l_dirty();
    let regular = (0..3).all(|k| l[(k, k)] * l[(k, k)] > 0.1 * PIVOT_FLOOR * own[(k, k)]);
    let inverse = regular.then(|| cholesky.inverse())?;
    Some((inverse + inverse.transpose()) / 2.0)
}

/// The factorised reduced system, made regular by the rows `B` of the datum matrix: `D (S) D + B B^T = L L^T` with unit
/// diagonal `D S D` and orthonormal columns of `B`, so that neither spoils the digits of the other.
pub(super) struct Factor {
    scale: DVector<f64>,
    cholesky: Cholesky<f64, Dyn>,
}

impl Factor {
    pub(super) fn new(
        normals: &Normals,
        layout: &Layout,
        state: &State,
        free: &FreeMotions,
    ) -> Result<Self, AdjustmentError> {
        let null_vectors = free.kept_rows(layout, state);
        let diagonal = normals.reduced.diagonal();
        let unreduced = &normals.unreduced_diagonal;
        let n = diagonal.len();
        let determined = (0..n).all(|i| diagonal[i] > PIVOT_FLOOR * unreduced[i]);
        if !determined {
            return Err(rank_defect(normals, layout, state, free));
        }
        let scale = diagonal.map(|d| 1.0 / d.sqrt());
        let matrix = regularised(&normals.reduced, &scale, &null_vectors);
        let Some(cholesky) = Cholesky::new(matrix) else {
            return Err(rank_defect(normals, layout, state, free));
        };
        let l = cholesky.l_dirty();
        let regular =
            (0..n).all(|i| l[(i, i)] * l[(i, i)] * diagonal[i] > PIVOT_FLOOR * unreduced[i]);
        if !regular {
            return Err(rank_defect(normals, layout, state, free));
        }
        Ok(Self { scale, cholesky })
    }

    pub(super) fn solve(&self, right_side: &DVector<f64>) -> DVector<f64> {
        self.cholesky
            .solve(&right_side.component_mul(&self.scale))
            .component_mul(&self.scale)
    }

    /// The inverse of the regularised reduced matrix, both triangles.
    pub(super) fn inverse(&self) -> DMatrix<f64> {
        let l = self.cholesky.l_dirty();
        let n = l.nrows();
        // Column j of L^-1 is zero above row j.
        let columns: Vec<Vec<f64>> = (0..n)
            .into_par_iter()
            .map(|j| {
                let mut x = vec![0.0; n - j];
                x[0] = 1.0;
                for k in j..n {
                    let column = l.column(k);
                    let value = x[k - j] / column[k];
                    x[k - j] = value;
                    let below = &column.as_slice()[k + 1..];
                    for (x, l) in x[k - j + 1..].iter_mut().zip(below) {
                        *x -= value * l;
                    }
                }
                x
            })
            .collect();
        let lower: Vec<Vec<f64>> = (0..n)
            .into_par_iter()
            .map(|j| {
                (j..n)
                    .map(|i| dot(&columns[i], &columns[j][i - j..]) * self.scale[i] * self.scale[j])
                    .collect()
            })
            .collect();
        let mut inverse = DMatrix::zeros(n, n);
        for (j, column) in lower.iter().enumerate() {
            for (k, &value) in column.iter().enumerate() {
                inverse[(j + k, j)] = value;
                inverse[(j, j + k)] = value;
            }
        }
        inverse
    }
}

/// The scalar product in eight interleaved sums: their order is fixed, and the processor can do them side by side.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    const LANES: usize = 8;
    let mut sums = [0.0; LANES];
    let (a_chunks, b_chunks) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest = a_chunks.remainder().iter().zip(b_chunks.remainder());
    let rest: f64 = rest.map(|(a, b)| a * b).sum();
    for (a, b) in a_chunks.zip(b_chunks) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// `D S D + B B^T`, lower triangle, with `B` the orthonormalised `D^-1 null_vectors`.
fn regularised(
    reduced: &DMatrix<f64>,
    scale: &DVector<f64>,
    null_vectors: &DMatrix<f64>,
) -> DMatrix<f64> {
    let n = reduced.nrows();
    let mut matrix = DMatrix::zeros(n, n);
    for j in 0..n {
        for i in j..n {
            matrix[(i, j)] = reduced[(i, j)] * scale[i] * scale[j];
        }
    }
    if null_vectors.ncols() > 0 {
        let scaled = DMatrix::from_fn(n, null_vectors.ncols(), |i, k| {
            null_vectors[(i, k)] / scale[i]
        });
        let basis = scaled.qr().q();
        for k in 0..basis.ncols() {
            let b = basis.column(k);
            for j in 0..n {
                for i in j..n {
                    matrix[(i, j)] += b[i] * b[j];
                }
            }
        }
    }
    matrix
}

/// Names what the observations leave loose, from the null space of the reduced system.
fn rank_defect(
    normals: &Normals,
    layout: &Layout,
    state: &State,
    free: &FreeMotions,
) -> AdjustmentError {
    let scale = normals
        .unreduced_diagonal
        .map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 1.0 });
    let datum = free.kept_rows(layout, state);
    let mut matrix = regularised(&normals.reduced, &scale, &datum);
    matrix.fill_upper_triangle_with_lower_triangle();
    let eigen = matrix.symmetric_eigen();
    let smallest = eigen.eigenvalues.min();
    let floor = (NULL_EIGENVALUE * eigen.eigenvalues.max()).max(smallest);
    let mut shares = vec![0.0; layout.kept];
    let mut defect = 0;
    for k in (0..layout.kept).filter(|&k| eigen.eigenvalues[k] <= floor) {
        defect += 1;
        let motion = eigen.eigenvectors.column(k).component_mul(&scale);
        let motion = in_datum(normals, layout, state, free, &datum, motion);
        for (share, value) in shares.iter_mut().zip(motion.component_div(&scale).iter()) {
            *share += value * value;
        }
    }
    let largest = shares.iter().copied().fold(0.0, f64::max);
    let mut order: Vec<usize> = (0..layout.kept)
        .filter(|&i| shares[i] >= NAMED_SHARE * NAMED_SHARE * largest)
        .collect();
    order.sort_by(|a, b| shares[*b].total_cmp(&shares[*a]).then(a.cmp(b)));
    let mut loose = Vec::new();
    for i in order {
        let name = layout.name(i);
        if !loose.contains(&name) {
            loose.push(name);
        }
    }
    AdjustmentError::RankDefect { defect, loose }
}

/// A motion of the reduced system as it looks when the datum points stay where they are in the mean.
fn in_datum(
    normals: &Normals,
    layout: &Layout,
    state: &State,
    free: &FreeMotions,
    datum: &DMatrix<f64>,
    motion: DVector<f64>,
) -> DVector<f64> {
    let Ok(h) = free.s_transformation(layout, state) else {
        return motion;
    };
    let mut amount = DVector::zeros(free.defect());
    for (frame, normal) in layout.frames.iter().zip(&normals.points) {
        let Ok(at) = layout.datum_points.binary_search(&frame.point) else {
            continue;
        };
        let mut shift = Vector3::zeros();
        match (normal, frame.own_at) {
            (Some(normal), _) => {
                for (y, &i) in normal.coupling.iter().zip(&frame.index) {
                    shift -= normal.inverse * y * motion[i];
                }
            }
            (None, Some(own)) => {
                shift = Vector3::from_fn(|k, _| motion[frame.index[own + k]]);
            }
            (None, None) => {}
        }
        amount += &h[at] * shift;
    }
    motion - datum * amount
}
