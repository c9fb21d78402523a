//! The reduced system made regular by the datum, its factorisation and inverse, and what is loose where it is singular.

use nalgebra::{DMatrix, DVector, Vector3};
use rayon::prelude::*;

use super::AdjustmentError;
use super::block_matrix::BlockMatrix;
use super::datum::FreeMotions;
use super::dense_front::{NotEliminated, eliminate, zeros};
use super::equations::State;
use super::layout::Layout;
use super::normals::{Normals, PIVOT_FLOOR};
use super::selected_inverse::SelectedInverse;
use super::structure::{Front, Structure};
use crate::monitor::{Interrupted, Monitor};

/// Eigenvalues of the scaled normal matrix below this belong to the null space that an error names.
const NULL_EIGENVALUE: f64 = 1e-11;

/// An unknown is named in a rank defect when it moves at least this part of the one that moves most.
const NAMED_SHARE: f64 = 0.1;

/// Reduced systems up to so many unknowns are looked into for what is loose.
const UNKNOWNS_TO_LOOK_INTO: usize = 3000;

/// The factorised reduced system, made regular by rows `B` of the datum matrix: `D (S) D + B B^T = L L^T` with unit
/// diagonal `D S D`, and `B` the rows of some stations that are far from each other, so that neither spoils the digits of
/// the other nor fills what is empty.
///
/// Cost: of every front, a third of the cube of its unknowns less that of what is left ([`super::structure`]).
pub(super) struct Factor {
    scale: DVector<f64>,
    fronts: Vec<FrontFactor>,
}

/// The columns of the factor that belong to a front's own blocks, over all of its rows.
pub(super) struct FrontFactor {
    pub(super) columns: DMatrix<f64>,
}

impl Factor {
    pub(super) fn new(
        normals: &Normals,
        layout: &Layout,
        state: &State,
        free: &FreeMotions,
        monitor: &Monitor,
    ) -> Result<Self, AdjustmentError> {
        let structure = &layout.structure;
        let diagonal = normals.reduced.diagonal(structure);
        let unreduced = &normals.unreduced_diagonal;
        let sound = |i: usize, pivot: f64| pivot * diagonal[i] > PIVOT_FLOOR * unreduced[i];
        let n = diagonal.len();
        if let Some(loose) = (0..n).find(|&i| !sound(i, 1.0)) {
            return Err(rank_defect(normals, layout, state, free, loose));
        }
        let scale = diagonal.map(|d| 1.0 / d.sqrt());
        let matrix = Regular {
            reduced: &normals.reduced,
            scale: &scale,
            datum: DatumRows::of(structure, &scale, &free.kept_rows(layout, state)),
        };
        let fronts = factorise(structure, &matrix, sound, monitor).map_err(|why| match why {
            NotFactorised::Loose(unknown) => rank_defect(normals, layout, state, free, unknown),
            NotFactorised::Interrupted(interrupted) => interrupted.into(),
        })?;
        Ok(Self { scale, fronts })
    }

    /// The solution for one right side; `structure` is that of the layout it was made with.
    ///
    /// Cost: the entries of the factor, twice.
    ///
    /// # Errors
    /// [`Interrupted`] when the work was asked to stop.
    pub(super) fn solve(
        &self,
        structure: &Structure,
        right_side: &DVector<f64>,
        monitor: &Monitor,
    ) -> Result<DVector<f64>, Interrupted> {
        /// Columns of a front between two looks at the monitor.
        const COLUMNS: usize = 256;
        let mut solution = right_side.component_mul(&self.scale);
        let rows = |front: &Front| -> Vec<usize> {
            let blocks = front.blocks.iter();
            blocks.flat_map(|&block| structure.range(block)).collect()
        };
        let gathered = |solution: &DVector<f64>, rows: &[usize]| -> Vec<f64> {
            rows.iter().map(|&row| solution[row]).collect()
        };
        for (front, factor) in structure.fronts.iter().zip(&self.fronts) {
            let rows = rows(front);
            let mut own = gathered(&solution, &rows);
            for (j, column) in factor.columns.column_iter().enumerate() {
                if j % COLUMNS == 0 {
                    monitor.check()?;
                }
                own[j] /= column[j];
                let value = own[j];
                let below = column.as_slice()[j + 1..].iter();
                for (to, entry) in own[j + 1..].iter_mut().zip(below) {
                    *to -= entry * value;
                }
            }
            for (&row, value) in rows.iter().zip(own) {
                solution[row] = value;
            }
        }
        for (front, factor) in structure.fronts.iter().zip(&self.fronts).rev() {
            let rows = rows(front);
            let mut own = gathered(&solution, &rows);
            for (j, column) in factor.columns.column_iter().enumerate().rev() {
                if j % COLUMNS == 0 {
                    monitor.check()?;
                }
                let below = column.as_slice()[j + 1..].iter().zip(&own[j + 1..]);
                let below: f64 = below.map(|(entry, value)| entry * value).sum();
                own[j] = (own[j] - below) / column[j];
            }
            for (&row, value) in rows[..front.width()].iter().zip(own) {
                solution[row] = value;
            }
        }
        Ok(solution.component_mul(&self.scale))
    }

    /// The inverse of the regularised reduced matrix where the factor has entries.
    ///
    /// # Errors
    /// [`Interrupted`] when the work was asked to stop.
    pub(super) fn inverse(
        &self,
        structure: &Structure,
        monitor: &Monitor,
    ) -> Result<SelectedInverse, Interrupted> {
        SelectedInverse::of(structure, &self.fronts, &self.scale, monitor)
    }
}

/// The matrix that is factorised, `D S D + B B^T` with the diagonal of `D`, as its entries are asked for.
struct Regular<'a> {
    reduced: &'a BlockMatrix,
    scale: &'a DVector<f64>,
    datum: Option<DatumRows>,
}

/// `B`: the orthonormalised rows of `D^-1 null_vectors` of the datum's stations, as long as those of all would be.
struct DatumRows {
    /// The unknowns of its rows, rising.
    unknowns: Vec<usize>,
    basis: DMatrix<f64>,
    longer: f64,
}

impl DatumRows {
    /// `None` where nothing is free.
    fn of(
        structure: &Structure,
        scale: &DVector<f64>,
        null_vectors: &DMatrix<f64>,
    ) -> Option<Self> {
        let motions = null_vectors.ncols();
        if motions == 0 {
            return None;
        }
        let datum = structure.datum.iter();
        let unknowns: Vec<usize> = datum.flat_map(|&block| structure.range(block)).collect();
        let scaled = DMatrix::from_fn(unknowns.len(), motions, |i, k| {
            null_vectors[(unknowns[i], k)] / scale[unknowns[i]]
        });
        Some(Self {
            longer: scale.len() as f64 / unknowns.len() as f64,
            basis: scaled.qr().q(),
            unknowns,
        })
    }

    /// What it adds to an entry.
    fn entry(&self, row: usize, column: usize) -> Option<f64> {
        let [a, b] = [row, column].map(|unknown| self.unknowns.binary_search(&unknown).ok());
        let (a, b) = (a?, b?);
        let products = (0..self.basis.ncols()).map(|k| self.basis[(a, k)] * self.basis[(b, k)]);
        Some(self.longer * products.sum::<f64>())
    }
}

impl Regular<'_> {
    /// Adds the entries of the lower triangle that belong to a front, those of its own blocks, to its columns.
    fn assemble(&self, structure: &Structure, front: &Front, columns: &mut DMatrix<f64>) {
        let place = |block: usize| {
            let position = structure.position[block];
            let (own, below) = front.blocks.split_at(front.own);
            let among =
                |part: &[usize]| part.binary_search_by_key(&position, |&b| structure.position[b]);
            let at = among(own)
                .ok()
                .or_else(|| Some(among(below).ok()? + own.len()))?;
            Some(front.starts[at])
        };
        let is_datum = |block: usize| structure.datum.binary_search(&block).is_ok();
        for &(column, entry) in &front.entries {
            let row = structure.columns[column].rows[entry] as usize;
            let (Some(at_row), Some(at_column)) = (place(row), place(column)) else {
                continue;
            };
            let datum = self.datum.as_ref();
            let datum = datum.filter(|_| is_datum(row) && is_datum(column));
            let rows = structure.range(row);
            let values = self.reduced.block(structure, column, entry);
            let values = values.chunks(rows.len().max(1));
            for ((q, j), values) in (at_column..).zip(structure.range(column)).zip(values) {
                for ((p, i), value) in (at_row..).zip(rows.clone()).zip(values) {
                    // A block on the diagonal has its upper triangle unset.
                    if i >= j {
                        let mut value = value * (self.scale[i] * self.scale[j]);
                        if let Some(more) = datum.and_then(|datum| datum.entry(i, j)) {
                            value += more;
                        }
                        columns[(p.max(q), p.min(q))] = value;
                    }
                }
            }
        }
    }
}

/// Why a matrix was not factorised.
#[derive(Debug)]
enum NotFactorised {
    /// The pivot of this unknown is not sound.
    Loose(usize),
    /// The work was asked to stop.
    Interrupted(Interrupted),
}

/// A front that was factorised, and what is left for its parent.
struct Eliminated {
    factor: FrontFactor,
    left: Option<DMatrix<f64>>,
}

/// The factors of all fronts; an unknown whose pivot is not sound where there is one.
///
/// Fronts of one level have nothing to do with each other; each is summed in one order on any number of threads.
fn factorise(
    structure: &Structure,
    matrix: &Regular<'_>,
    sound: impl Fn(usize, f64) -> bool + Sync,
    monitor: &Monitor,
) -> Result<Vec<FrontFactor>, NotFactorised> {
    let mut done: Vec<Option<Eliminated>> = Vec::new();
    done.resize_with(structure.fronts.len(), || None);
    for level in &structure.levels {
        let level: Vec<(usize, Eliminated)> = level
            .par_iter()
            .map(|&index| {
                let front = eliminated(structure, matrix, &done, index, &sound, monitor)?;
                Ok((index, front))
            })
            .collect::<Result<_, NotFactorised>>()?;
        for (index, front) in level {
            for &child in &structure.fronts[index].children {
                if let Some(child) = &mut done[child] {
                    child.left = None;
                }
            }
            done[index] = Some(front);
        }
    }
    Ok(done
        .into_iter()
        .flatten()
        .map(|front| front.factor)
        .collect())
}

fn eliminated(
    structure: &Structure,
    matrix: &Regular<'_>,
    done: &[Option<Eliminated>],
    index: usize,
    sound: impl Fn(usize, f64) -> bool,
    monitor: &Monitor,
) -> Result<Eliminated, NotFactorised> {
    let front = &structure.fronts[index];
    let (size, width) = (front.size(), front.width());
    let mut columns = zeros(size, width);
    let mut left = zeros(size - width, size - width);
    matrix.assemble(structure, front, &mut columns);
    for &child in &front.children {
        if let Some(more) = done[child].as_ref().and_then(|child| child.left.as_ref()) {
            let rows = &structure.fronts[child].in_parent;
            let own = rows.partition_point(|&row| row < width);
            add_rows(&mut columns, 0, more, 0, &rows[..own], rows);
            add_rows(&mut left, width, more, own, &rows[own..], rows);
        }
    }
    let unknowns: Vec<usize> = front.blocks[..front.own]
        .iter()
        .flat_map(|&block| structure.range(block))
        .collect();
    eliminate(&mut columns, &mut left, monitor).map_err(|why| match why {
        NotEliminated::NotPositive { column } => NotFactorised::Loose(unknowns[column]),
        NotEliminated::Interrupted(interrupted) => NotFactorised::Interrupted(interrupted),
    })?;
    if let Some(j) = (0..width).find(|&j| !sound(unknowns[j], columns[(j, j)].powi(2))) {
        return Err(NotFactorised::Loose(unknowns[j]));
    }
    Ok(Eliminated {
        factor: FrontFactor { columns },
        left: (size > width).then_some(left),
    })
}

/// Adds the columns from `first_from` on of what is left of a child to those `targets` of a front; `to` holds the rows and columns
/// from `first_to` on, and all rows of the child, which rise, are `rows` of the front.
fn add_rows(
    to: &mut DMatrix<f64>,
    first_to: usize,
    from: &DMatrix<f64>,
    first_from: usize,
    targets: &[usize],
    rows: &[usize],
) {
    for (j, target) in (first_from..).zip(targets) {
        let (from, to) = (from.column(j), &mut to.column_mut(target - first_to));
        let (from, to) = (from.as_slice(), to.as_mut_slice());
        for (value, row) in from[j..].iter().zip(&rows[j..]) {
            to[row - first_to] += value;
        }
    }
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

/// Names what the observations leave loose, from the null space of the reduced system; of a large one, the unknown whose pivot failed.
fn rank_defect(
    normals: &Normals,
    layout: &Layout,
    state: &State,
    free: &FreeMotions,
    failed: usize,
) -> AdjustmentError {
    if layout.kept > UNKNOWNS_TO_LOOK_INTO {
        return AdjustmentError::RankDefect {
            defect: 1,
            loose: vec![layout.name(failed)],
        };
    }
    let scale = normals
        .unreduced_diagonal
        .map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 1.0 });
    let datum = free.kept_rows(layout, state);
    let mut matrix = regularised(&normals.reduced.dense(&layout.structure), &scale, &datum);
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
        match normal {
            Some(normal) => {
                for (y, &i) in normal.coupling.iter().zip(&frame.index) {
                    shift -= normal.inverse * y * motion[i];
                }
            }
            None => {
                for (axis, own) in layout.kept_coordinates(frame.point) {
                    shift[axis] = motion[own];
                }
            }
        }
        amount += &h[at] * shift;
    }
    motion - datum * amount
}

#[cfg(test)]
#[path = "factor_tests.rs"]
mod tests;
