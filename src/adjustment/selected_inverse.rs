//! The entries of the inverse of the reduced normal matrix where its factor has entries (Takahashi, Fagan and Chen, 1973;
//! Erisman and Tinney, 1975): all that a covariance of a point, a station or a camera needs, exact, without the whole inverse.

use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve;
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::factor::FrontFactor;
use super::structure::Structure;

/// The inverse by fronts: of each the columns of its own blocks.
pub(super) struct SelectedInverse {
    fronts: Vec<DMatrix<f64>>,
    scale: DVector<f64>,
}

impl SelectedInverse {
    /// From the factors of the fronts of `D S D`, with the diagonal of `D`.
    ///
    /// Cost: some three times that of the factorisation.
    pub(super) fn of(structure: &Structure, factors: &[FrontFactor], scale: &DVector<f64>) -> Self {
        let count = structure.fronts.len();
        // Of every front, all its rows and columns, as long as another one takes from it.
        let mut whole: Vec<Option<DMatrix<f64>>> = vec![None; count];
        let mut waiting: Vec<usize> = structure.fronts.iter().map(|f| f.children.len()).collect();
        let mut fronts = vec![DMatrix::zeros(0, 0); count];
        for level in structure.levels.iter().rev() {
            let found: Vec<DMatrix<f64>> = level
                .par_iter()
                .map(|&index| whole_front(structure, factors, &whole, index))
                .collect();
            for (&index, inverse) in level.iter().zip(found) {
                let front = &structure.fronts[index];
                fronts[index] = inverse.columns(0, front.width()).into_owned();
                if !front.children.is_empty() {
                    whole[index] = Some(inverse);
                }
                if let Some(parent) = front.parent {
                    waiting[parent] -= 1;
                    if waiting[parent] == 0 {
                        whole[parent] = None;
                    }
                }
            }
        }
        Self {
            fronts,
            scale: scale.clone(),
        }
    }

    /// The entries of some blocks with each other; all of them must meet.
    pub(super) fn among(&self, structure: &Structure, blocks: &[usize]) -> DMatrix<f64> {
        let mut starts = vec![0];
        for &block in blocks {
            starts.push(starts[starts.len() - 1] + structure.range(block).len());
        }
        let size = starts[blocks.len()];
        let mut among = DMatrix::zeros(size, size);
        let mut order: Vec<usize> = (0..blocks.len()).collect();
        order.sort_by_key(|&k| structure.position[blocks[k]]);
        for (at, &a) in order.iter().enumerate() {
            let index = structure.front_of[blocks[a]];
            let (front, values) = (&structure.fronts[index], &self.fronts[index]);
            let place_of = |from: usize, block: usize| {
                let position = structure.position[block];
                let rest = front.blocks[from..].iter();
                from + rest
                    .take_while(|b| structure.position[**b] < position)
                    .count()
            };
            // The blocks of a front and those asked for stand in the same order, so that one walk finds them all.
            let mut place = place_of(0, blocks[a]);
            let at_column = front.starts[place];
            let columns = structure.range(blocks[a]);
            for &b in &order[at..] {
                place = place_of(place, blocks[b]);
                let rows = structure.range(blocks[b]);
                let at_row = front.starts[place];
                let row_scale = &self.scale.as_slice()[rows];
                for (j, unknown) in columns.clone().enumerate() {
                    let from = (at_column + j) * values.nrows() + at_row;
                    let entries = &values.as_slice()[from..from + row_scale.len()];
                    let scale = self.scale[unknown];
                    for (i, (entry, row_scale)) in entries.iter().zip(row_scale).enumerate() {
                        let value = entry * (row_scale * scale);
                        among[(starts[b] + i, starts[a] + j)] = value;
                        among[(starts[a] + j, starts[b] + i)] = value;
                    }
                }
            }
        }
        among
    }
}

/// All entries of the inverse in a front, from those of its parent.
fn whole_front(
    structure: &Structure,
    factors: &[FrontFactor],
    whole: &[Option<DMatrix<f64>>],
    index: usize,
) -> DMatrix<f64> {
    let front = &structure.fronts[index];
    let (size, width) = (front.size(), front.width());
    let left = size - width;
    let mut inverse = DMatrix::<f64>::zeros(size, size);
    if let Some(above) = front.parent.and_then(|parent| whole[parent].as_ref()) {
        for (j, &from_j) in front.in_parent.iter().enumerate() {
            let (from, to) = (above.column(from_j), &mut inverse.column_mut(width + j));
            for (i, &from_i) in front.in_parent.iter().enumerate() {
                to[width + i] = from[from_i];
            }
        }
    }
    let (own, below) = own_columns(&factors[index], &inverse, width, left);
    inverse.view_mut((0, 0), (width, width)).copy_from(&own);
    inverse
        .view_mut((width, 0), (left, width))
        .copy_from(&below);
    if !front.children.is_empty() {
        inverse
            .view_mut((0, width), (width, left))
            .copy_from(&below.transpose());
    }
    inverse
}

/// `Z11` and `Z21` of a front from its factor and `Z22`: with `U = L21 L11^-1`, `Z21 = -Z22 U` and
/// `Z11 = (L11 L11^T)^-1 + U^T Z22 U`.
fn own_columns(
    factor: &FrontFactor,
    inverse: &DMatrix<f64>,
    width: usize,
    left: usize,
) -> (DMatrix<f64>, DMatrix<f64>) {
    let lower = view(&factor.columns);
    let (own, below) = lower.split_at_row(width);
    let mut back = DMatrix::<f64>::identity(width, width);
    triangular_solve::solve_lower_triangular_in_place(own, view_mut(&mut back), Par::Seq);
    // (L11 L11^T)^-1 = L11^-T L11^-1.
    let mut first = DMatrix::zeros(width, width);
    let inverse_of_lower = view(&back);
    matmul(
        view_mut(&mut first),
        Accum::Replace,
        inverse_of_lower.transpose(),
        inverse_of_lower,
        1.0,
        Par::Seq,
    );
    if left == 0 {
        return (first, DMatrix::zeros(0, width));
    }
    let mut coupling = DMatrix::<f64>::zeros(left, width);
    matmul(
        view_mut(&mut coupling),
        Accum::Replace,
        below,
        inverse_of_lower,
        1.0,
        Par::Seq,
    );
    let all = view(inverse);
    let rest = all.submatrix(width, width, left, left);
    let mut second = DMatrix::zeros(left, width);
    matmul(
        view_mut(&mut second),
        Accum::Replace,
        rest,
        view(&coupling),
        -1.0,
        Par::Seq,
    );
    matmul(
        view_mut(&mut first),
        Accum::Add,
        view(&coupling).transpose(),
        view(&second),
        -1.0,
        Par::Seq,
    );
    (first, second)
}

pub(super) fn view(matrix: &DMatrix<f64>) -> MatRef<'_, f64> {
    MatRef::from_column_major_slice(matrix.as_slice(), matrix.nrows(), matrix.ncols())
}

pub(super) fn view_mut(matrix: &mut DMatrix<f64>) -> MatMut<'_, f64> {
    let (rows, columns) = matrix.shape();
    MatMut::from_column_major_slice_mut(matrix.as_mut_slice(), rows, columns)
}
