//! A symmetric matrix of which the lower triangle of blocks is kept, where it has any.

use nalgebra::{DMatrix, DVector};

use super::structure::Structure;

/// The values of each block column: its blocks one after the other, each column by column, so that what two blocks of unknowns
/// have to do with each other lies together.
pub(super) struct BlockMatrix {
    pub(super) columns: Vec<Vec<f64>>,
}

impl BlockMatrix {
    /// A block by its block column and which of that column's rows it is.
    pub(super) fn block(&self, structure: &Structure, column: usize, entry: usize) -> &[f64] {
        let of = &structure.columns[column];
        let width = of.offsets[1];
        &self.columns[column][of.offsets[entry] * width..of.offsets[entry + 1] * width]
    }

    /// Where an entry of the lower triangle stands: its block column, and the place in it; `None` where there is none.
    fn place(structure: &Structure, row: usize, column: usize) -> Option<(usize, usize)> {
        let [of_row, of_column] = [row, column].map(|unknown| structure.block_of(unknown));
        let block = &structure.columns[of_column];
        let at = block.rows.binary_search(&(of_row as u32)).ok()?;
        let height = block.offsets[at + 1] - block.offsets[at];
        let [i, j] = [
            row - structure.starts[of_row],
            column - structure.starts[of_column],
        ];
        Some((
            of_column,
            block.offsets[at] * block.offsets[1] + j * height + i,
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
            let width = column.offsets[1];
            diagonal.extend((0..width).map(|k| values[k * width + k]));
        }
        DVector::from_vec(diagonal)
    }

    /// The lower triangle of the whole.
    pub(super) fn dense(&self, structure: &Structure) -> DMatrix<f64> {
        let n = structure.starts[structure.blocks()];
        let mut dense = DMatrix::zeros(n, n);
        for (block, column) in structure.columns.iter().enumerate() {
            for (entry, &row) in column.rows.iter().enumerate() {
                let rows = structure.range(row as usize);
                let values = self
                    .block(structure, block, entry)
                    .chunks(rows.len().max(1));
                for (j, values) in structure.range(block).zip(values) {
                    for (value, i) in values.iter().zip(rows.clone()) {
                        dense[(i, j)] = *value;
                    }
                }
            }
        }
        dense
    }
}
