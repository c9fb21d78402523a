//! The reduced system made regular by the datum, its factorisation and inverse, and what is loose where it is singular.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::{factor, inverse};
use faer::{MatMut, MatRef, Par, Spec};
use nalgebra::{DMatrix, DVector, Vector3};

use super::AdjustmentError;
use super::datum::FreeMotions;
use super::equations::State;
use super::layout::Layout;
use super::normals::{Normals, PIVOT_FLOOR};

/// Eigenvalues of the scaled normal matrix below this belong to the null space that an error names.
const NULL_EIGENVALUE: f64 = 1e-11;

/// An unknown is named in a rank defect when it moves at least this part of the one that moves most.
const NAMED_SHARE: f64 = 0.1;

/// One thread, so that the sums have one order.
const PAR: Par = Par::Seq;

/// The factorised reduced system, made regular by the rows `B` of the datum matrix: `D (S) D + B B^T = L L^T` with unit
/// diagonal `D S D` and orthonormal columns of `B`, so that neither spoils the digits of the other.
///
/// Cost: a third of the cube of the reduced unknowns; the inverse three times as much.
pub(super) struct Factor {
    scale: DVector<f64>,
    /// `L`, below and on the diagonal.
    lower: DMatrix<f64>,
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
        let lower = cholesky(matrix).filter(|l| {
            (0..n).all(|i| l[(i, i)] * l[(i, i)] * diagonal[i] > PIVOT_FLOOR * unreduced[i])
        });
        let Some(lower) = lower else {
            return Err(rank_defect(normals, layout, state, free));
        };
        Ok(Self { scale, lower })
    }

    pub(super) fn solve(&self, right_side: &DVector<f64>) -> DVector<f64> {
        let mut solution = right_side.component_mul(&self.scale);
        // The diagonal of `L` is positive, so that neither fails.
        self.lower.solve_lower_triangular_mut(&mut solution);
        self.lower.tr_solve_lower_triangular_mut(&mut solution);
        solution.component_mul(&self.scale)
    }

    /// The inverse of the regularised reduced matrix, both triangles.
    pub(super) fn inverse(&self) -> DMatrix<f64> {
        let n = self.lower.nrows();
        let mut inverse = DMatrix::zeros(n, n);
        let l = MatRef::from_column_major_slice(self.lower.as_slice(), n, n);
        let out = MatMut::from_column_major_slice_mut(inverse.as_mut_slice(), n, n);
        let mut memory = MemBuffer::new(inverse::inverse_scratch::<f64>(n, PAR));
        inverse::inverse(out, l, PAR, MemStack::new(&mut memory));
        for j in 0..n {
            for i in j..n {
                inverse[(i, j)] *= self.scale[i] * self.scale[j];
            }
        }
        inverse.fill_upper_triangle_with_lower_triangle();
        inverse
    }
}

/// The lower triangle of a positive definite matrix replaced by its Cholesky factor; `None` where it is not.
fn cholesky(mut matrix: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = matrix.nrows();
    let mut memory = MemBuffer::new(factor::cholesky_in_place_scratch::<f64>(
        n,
        PAR,
        Spec::default(),
    ));
    factor::cholesky_in_place(
        MatMut::from_column_major_slice_mut(matrix.as_mut_slice(), n, n),
        factor::LltRegularization::default(),
        PAR,
        MemStack::new(&mut memory),
        Spec::default(),
    )
    .ok()?;
    Some(matrix)
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
