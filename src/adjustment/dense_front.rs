//! Dense fronts: their factor and their inverse, panel by panel and tile by tile. Panels and tiles follow from the size of a front
//! alone and every tile is summed by one thread, so that the digits are the same on any number of threads.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor;
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve;
use faer::reborrow::{Reborrow as _, ReborrowMut as _};
use faer::{Accum, MatMut, MatRef, Par, Spec};
use nalgebra::DMatrix;
use rayon::prelude::*;

use crate::monitor::{Interrupted, Monitor};

/// Columns that are eliminated at once.
const PANEL: usize = 256;

/// Rows or columns of a tile.
const TILE: usize = 128;

/// One thread for each tile.
const PAR: Par = Par::Seq;

/// A matrix of zeros in memory that is empty as the system gives it: what is never written to, as most of what lies above a
/// diagonal, is never there.
pub(super) fn zeros(rows: usize, columns: usize) -> DMatrix<f64> {
    DMatrix::from_vec(rows, columns, vec![0.0; rows * columns])
}

/// Why a front was not factorised.
#[derive(Debug)]
pub(super) enum NotEliminated {
    /// The pivot of this column is not positive.
    NotPositive { column: usize },
    /// The work was asked to stop.
    Interrupted(Interrupted),
}

impl From<Interrupted> for NotEliminated {
    fn from(interrupted: Interrupted) -> Self {
        Self::Interrupted(interrupted)
    }
}

/// Replaces the first columns of a lower triangle by those of its Cholesky factor, and `left`, the lower triangle below and right of
/// them, by what is left of it; what lies above the diagonal is not looked at.
///
/// Cost: a third of the cube of the unknowns less that of what is left.
pub(super) fn eliminate(
    columns: &mut DMatrix<f64>,
    left: &mut DMatrix<f64>,
    monitor: &Monitor,
) -> Result<(), NotEliminated> {
    let (size, width) = columns.shape();
    for start in (0..width).step_by(PANEL) {
        monitor.check()?;
        let end = width.min(start + PANEL);
        let (done, rest) = columns.as_mut_slice().split_at_mut(end * size);
        let panel = &mut done[start * size..];
        let panel = MatMut::from_column_major_slice_mut(panel, size, end - start);
        let (_, mut panel) = panel.split_at_row_mut(start);
        let factorised = factorise_panel(panel.rb_mut());
        if let Err(factor::LltError::NonPositivePivot { index }) = factorised {
            let column = start + index;
            return Err(NotEliminated::NotPositive { column });
        }
        let (_, below) = panel.rb().split_at_row(end - start);
        let (_, below_left) = below.split_at_row(width - end);
        rayon::join(
            || take_from(rest, size, end, below, monitor),
            || take_from(left.as_mut_slice(), size - width, 0, below_left, monitor),
        );
    }
    Ok(())
}

/// Takes the product of a panel with itself from the lower triangle of columns of `height` rows, whose diagonal begins at row `first`.
fn take_from(
    columns: &mut [f64],
    height: usize,
    first: usize,
    panel: MatRef<'_, f64>,
    monitor: &Monitor,
) {
    if columns.is_empty() {
        return;
    }
    let tiles = columns.par_chunks_mut(TILE * height).enumerate();
    tiles.for_each(|(tile, columns)| {
        // What is left out then is given up with the whole.
        if monitor.is_interrupted() {
            return;
        }
        let width = columns.len() / height;
        let columns = MatMut::from_column_major_slice_mut(columns, height, width);
        let (_, lower) = columns.split_at_row_mut(first + tile * TILE);
        let (_, rows) = panel.split_at_row(tile * TILE);
        let own = rows.subrows(0, width);
        matmul(lower, Accum::Add, rows, own.transpose(), -1.0, PAR);
    });
}

/// The Cholesky factor of the columns of a lower triangle.
fn factorise_panel(panel: MatMut<'_, f64>) -> Result<(), factor::LltError> {
    let width = panel.ncols();
    let (mut own, below) = panel.split_at_row_mut(width);
    let scratch = factor::cholesky_in_place_scratch::<f64>(width, PAR, Spec::default());
    factor::cholesky_in_place(
        own.rb_mut(),
        factor::LltRegularization::default(),
        PAR,
        MemStack::new(&mut MemBuffer::new(scratch)),
        Spec::default(),
    )?;
    let own = own.rb();
    row_tiles(below, 0, &|_, tile| {
        triangular_solve::solve_lower_triangular_in_place(own, tile.transpose_mut(), PAR);
    });
    Ok(())
}

/// Completes the inverse in a front, of which `inverse` has the rows and columns that are left of it: with `U = L21 L11^-1` of a
/// panel, `Z21 = -Z22 U` and `Z11 = (L11 L11^T)^-1 + U^T Z22 U`, the last panel first.
///
/// Cost: twice that of the factor.
///
/// # Errors
/// [`Interrupted`] when the work was asked to stop.
pub(super) fn complete_inverse(
    factor: &DMatrix<f64>,
    inverse: &mut DMatrix<f64>,
    monitor: &Monitor,
) -> Result<(), Interrupted> {
    let (size, width) = factor.shape();
    let starts: Vec<usize> = (0..width).step_by(PANEL).collect();
    for start in starts.into_iter().rev() {
        let end = width.min(start + PANEL);
        let lower = view(factor).submatrix(start, start, size - start, end - start);
        let (own, below) = lower.split_at_row(end - start);
        let rest = view(inverse).submatrix(end, end, size - end, size - end);
        let (first, second) = panel_inverse(own, below, rest, monitor);
        monitor.check()?;
        inverse
            .view_mut((start, start), first.shape())
            .copy_from(&first);
        inverse
            .view_mut((end, start), second.shape())
            .copy_from(&second);
        let right = inverse.as_mut_slice()[end * size..].par_chunks_mut(size);
        let right = right.enumerate().with_min_len(TILE);
        right.for_each(|(row, column)| {
            for (value, from) in column[start..end].iter_mut().zip(second.row(row).iter()) {
                *value = *from;
            }
        });
    }
    Ok(())
}

/// `Z11` and `Z21` of a panel from its factor and `Z22`; parts are left out where the work was asked to stop.
fn panel_inverse(
    own: MatRef<'_, f64>,
    below: MatRef<'_, f64>,
    rest: MatRef<'_, f64>,
    monitor: &Monitor,
) -> (DMatrix<f64>, DMatrix<f64>) {
    let (left, width) = (below.nrows(), own.ncols());
    let mut back = DMatrix::<f64>::identity(width, width);
    triangular_solve::solve_lower_triangular_in_place(own, view_mut(&mut back), PAR);
    let inverse_of_lower = view(&back);
    // (L11 L11^T)^-1 = L11^-T L11^-1.
    let mut first = DMatrix::zeros(width, width);
    let transposed = inverse_of_lower.transpose();
    matmul(
        view_mut(&mut first),
        Accum::Replace,
        transposed,
        inverse_of_lower,
        1.0,
        PAR,
    );
    let mut coupling = DMatrix::<f64>::zeros(left, width);
    row_tiles(view_mut(&mut coupling), 0, &|row, tile| {
        let rows = below.subrows(row, tile.nrows());
        matmul(tile, Accum::Replace, rows, inverse_of_lower, 1.0, PAR);
    });
    let mut second = DMatrix::zeros(left, width);
    row_tiles(view_mut(&mut second), 0, &|row, tile| {
        if monitor.is_interrupted() {
            return;
        }
        let rows = rest.subrows(row, tile.nrows());
        matmul(tile, Accum::Replace, rows, view(&coupling), -1.0, PAR);
    });
    let tiles = first
        .as_mut_slice()
        .par_chunks_mut(TILE * width)
        .enumerate();
    tiles.for_each(|(tile, columns)| {
        let tile_width = columns.len() / width;
        let columns = MatMut::from_column_major_slice_mut(columns, width, tile_width);
        let of_tile = view(&second).subcols(tile * TILE, tile_width);
        matmul(
            columns,
            Accum::Add,
            view(&coupling).transpose(),
            of_tile,
            -1.0,
            PAR,
        );
    });
    (first, second)
}

/// Does something to each tile of rows, given the tile's first row.
fn row_tiles(
    matrix: MatMut<'_, f64>,
    first: usize,
    deed: &(impl Fn(usize, MatMut<'_, f64>) + Sync),
) {
    let rows = matrix.nrows();
    if rows <= TILE {
        if rows > 0 {
            deed(first, matrix);
        }
        return;
    }
    let half = (rows / 2).next_multiple_of(TILE);
    let (above, below) = matrix.split_at_row_mut(half);
    rayon::join(
        || row_tiles(above, first, deed),
        || row_tiles(below, first + half, deed),
    );
}

fn view(matrix: &DMatrix<f64>) -> MatRef<'_, f64> {
    MatRef::from_column_major_slice(matrix.as_slice(), matrix.nrows(), matrix.ncols())
}

fn view_mut(matrix: &mut DMatrix<f64>) -> MatMut<'_, f64> {
    let (rows, columns) = matrix.shape();
    MatMut::from_column_major_slice_mut(matrix.as_mut_slice(), rows, columns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    fn positive(size: usize, seed: u64) -> DMatrix<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let any = DMatrix::from_fn(size, size, |_, _| random.random_range(-1.0..1.0));
        &any * any.transpose() + DMatrix::identity(size, size) * size as f64
    }

    /// The factor's columns, and what is left.
    fn eliminated(whole: &DMatrix<f64>, width: usize) -> (DMatrix<f64>, DMatrix<f64>) {
        let rest = whole.nrows() - width;
        let mut columns = whole.columns(0, width).into_owned();
        let mut left = whole.view((width, width), (rest, rest)).into_owned();
        eliminate(&mut columns, &mut left, &Monitor::new()).expect("a positive matrix");
        (columns, left)
    }

    /// One tile, some panels, and widths that end within either.
    const SHAPES: [(usize, usize); 6] = [
        (1, 1),
        (40, 6),
        (300, 300),
        (700, 6),
        (700, 515),
        (420, 256),
    ];

    #[test]
    fn factor_and_rest_are_those_of_the_whole() {
        for (size, width) in SHAPES {
            let whole = positive(size, size as u64);
            let (columns, below) = eliminated(&whole, width);
            let factor = columns.lower_triangle();
            let left = size - width;
            let mut rest = DMatrix::zeros(size, size);
            let below = below.lower_triangle();
            rest.view_mut((width, width), (left, left))
                .copy_from(&below);
            let off = (&factor * factor.transpose() + rest - whole).lower_triangle();
            assert!(
                off.amax() < 1e-11 * size as f64,
                "{size} {width}: {}",
                off.amax()
            );
        }
    }

    #[test]
    fn the_inverse_is_that_of_the_whole() {
        for (size, width) in SHAPES {
            let whole = positive(size, 7 + size as u64);
            let (columns, _) = eliminated(&whole, width);
            let wanted = whole.try_inverse().expect("a regular matrix");
            let mut inverse = DMatrix::zeros(size, size);
            let left = size - width;
            let known = wanted.view((width, width), (left, left));
            inverse
                .view_mut((width, width), (left, left))
                .copy_from(&known);
            complete_inverse(&columns, &mut inverse, &Monitor::new()).expect("nobody interrupts");
            let off = (inverse - wanted).amax();
            assert!(off < 1e-13, "{size} {width}: {off}");
        }
    }

    #[test]
    fn one_and_more_threads_give_the_same_bits() {
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let pool = pool.build().expect("a pool of threads");
            pool.install(|| {
                let (columns, left) = eliminated(&positive(900, 3), 700);
                let mut inverse = DMatrix::identity(900, 900);
                complete_inverse(&columns, &mut inverse, &Monitor::new())
                    .expect("nobody interrupts");
                (left, inverse)
            })
        };
        let one = with(1);
        assert!([2, 5].into_iter().all(|threads| with(threads) == one));
    }

    #[test]
    fn what_is_not_positive_is_refused() {
        let mut values = positive(300, 5);
        values[(280, 280)] = -1.0;
        let nothing = &mut DMatrix::zeros(0, 0);
        let refused = eliminate(&mut values, nothing, &Monitor::new());
        let Err(NotEliminated::NotPositive { column }) = refused else {
            panic!("not seen");
        };
        assert_eq!(column, 280);
    }

    #[test]
    fn a_front_is_given_up_where_the_work_is_to_stop() {
        let monitor = Monitor::new();
        monitor.interrupt();
        let mut values = positive(600, 3);
        let stopped = eliminate(&mut values, &mut DMatrix::zeros(0, 0), &monitor);
        assert!(matches!(stopped, Err(NotEliminated::Interrupted(_))));
        let mut inverse = DMatrix::zeros(600, 600);
        let stopped = complete_inverse(&values, &mut inverse, &monitor);
        assert_eq!(stopped, Err(Interrupted));
    }
}
