//! A symmetric matrix of which the lower triangle of blocks is kept, where it has any.

use nalgebra::{DMatrix, DVector};

use super::structure::Structure;

/// The values of each block column, column by column.
#[derive(Clone)]
pub(super) struct BlockMatrix {
    pub(super) columns: Vec<Vec<f64>>,
}

impl BlockMatrix {
    /// Where an entry of the lower triangle stands: its block column, and the place in it; `None` where there is none.
    fn place(structure: &Structure, row: usize, column: usize) -> Option<(usize, usize)> {
        let [of_row, of_column] = [row, column].map(|unknown| structure.block_of(unknown));
        let block = &structure.columns[of_column];
        let at = block.rows.binary_search(&(of_row as u32)).ok()?;
        let row = block.offsets[at] + row - structure.starts[of_row];
        let height = block.offsets[block.rows.len()];
        Some((
            of_column,
            (column - structure.starts[of_column]) * height + row,
        ))
    }

    /// Adds to an entry of the lower triangle; there must be one.
    pub(super) fn add(&mut self, structure: &Structure, row: usize, column: usize, value: f64) {
        if let Some((block, place)) = Self::place(structure, row.max(column), row.min(column)) {
            self.columns[block][place] += value;
        }
    }

    pub(super) fn diagonal(&self, structure: &Structure) -> DVector<f64> {
        let mut diagonal = Vec::new();
        for (column, values) in structure.columns.iter().zip(&self.columns) {
            let height = column.offsets[column.rows.len()];
            diagonal.extend((0..column.offsets[1]).map(|k| values[k * height + k]));
        }
        DVector::from_vec(diagonal)
    }

    /// The lower triangle of the whole.
    pub(super) fn dense(&self, structure: &Structure) -> DMatrix<f64> {
        let n = structure.starts[structure.blocks()];
        let mut dense = DMatrix::zeros(n, n);
        for (block, (column, values)) in structure.columns.iter().zip(&self.columns).enumerate() {
            let height = column.offsets[column.rows.len()];
            for (j, values) in structure.range(block).zip(values.chunks(height.max(1))) {
                for (&row, &offset) in column.rows.iter().zip(&column.offsets) {
                    for (k, i) in structure.range(row as usize).enumerate() {
                        dense[(i, j)] = values[offset + k];
                    }
                }
            }
        }
        dense
    }
}
