//! The entries of the inverse of the reduced normal matrix where its factor has entries (Takahashi, Fagan and Chen, 1973;
//! Erisman and Tinney, 1975): all that a covariance of a point, a station or a camera needs, exact, without the whole inverse.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::dense_front::{complete_inverse, zeros};
use super::factor::FrontFactor;
use super::structure::{Front, Structure};
use crate::monitor::{Interrupted, Monitor};

/// Three columns over the places of a point's frame, and a zero: a row fills a vector register.
pub(super) type PointColumns = Vec<[f64; 4]>;

/// The inverse by blocks: of each its columns from its own rows on, over all rows of its front; block by block, each column by
/// column, so that what two blocks have in common lies together.
pub(super) struct SelectedInverse {
    columns: Vec<Vec<f64>>,
}

impl SelectedInverse {
    /// From the factors of the fronts of `D S D`, with the diagonal of `D`.
    ///
    /// Cost: some two times that of the factorisation.
    ///
    /// # Errors
    /// [`Interrupted`] when the work was asked to stop.
    pub(super) fn of(
        structure: &Structure,
        factors: &[FrontFactor],
        scale: &DVector<f64>,
        monitor: &Monitor,
    ) -> Result<Self, Interrupted> {
        let count = structure.fronts.len();
        // Of every front, all its rows and columns, as long as another one takes from it.
        let mut whole: Vec<Option<DMatrix<f64>>> = vec![None; count];
        let mut waiting: Vec<usize> = structure.fronts.iter().map(|f| f.children.len()).collect();
        let mut columns = vec![Vec::new(); structure.blocks()];
        for level in structure.levels.iter().rev() {
            let found = level.par_iter().map(|&index| {
                let inverse = whole_front(structure, factors, &whole, index, monitor)?;
                let own = own_columns(structure, &inverse, scale, index);
                let is_used = !structure.fronts[index].children.is_empty();
                Ok((own, is_used.then_some(inverse)))
            });
            let found: Vec<_> = found.collect::<Result<_, Interrupted>>()?;
            for (&index, (own, inverse)) in level.iter().zip(found) {
                let front = &structure.fronts[index];
                for (&block, values) in front.blocks.iter().zip(own) {
                    columns[block] = values;
                }
                whole[index] = inverse;
                if let Some(parent) = front.parent {
                    waiting[parent] -= 1;
                    if waiting[parent] == 0 {
                        whole[parent] = None;
                    }
                }
            }
        }
        Ok(Self { columns })
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
            let front = &structure.fronts[structure.front_of[blocks[a]]];
            let later = order[at..].iter().map(|&k| blocks[k]);
            let places = front.places_of(structure, later);
            for (&b, &place) in order[at..].iter().zip(&places) {
                let entries = self.entries(front, blocks[a], places[0], place);
                let height = front.height(place);
                for (k, &value) in entries.iter().enumerate() {
                    let (i, j) = (starts[b] + k % height, starts[a] + k / height);
                    among[(i, j)] = value;
                    among[(j, i)] = value;
                }
            }
        }
        among
    }

    /// The products of the inverse with three columns that have entries at some blocks alone, there; all of the blocks of one must
    /// meet. Neighbours are asked for together: what they share of the inverse is looked at once.
    ///
    /// Cost: of each the square of its blocks, 36 entries of the inverse for each two.
    pub(super) fn times(
        &self,
        structure: &Structure,
        of: Vec<Multiplicand<'_>>,
    ) -> Vec<PointColumns> {
        Arch::new().dispatch(Products {
            inverse: self,
            structure,
            of,
        })
    }

    /// The entries of a block's columns, of which its place in the front is given, with another one's rows.
    fn entries(&self, front: &Front, block: usize, own: usize, place: usize) -> &[f64] {
        let width = front.height(own);
        let [from, to] = [place, place + 1].map(|k| (front.starts[k] - front.starts[own]) * width);
        &self.columns[block][from..to]
    }
}

/// What the inverse is multiplied with: three columns with entries at some blocks, which each have a first place in them.
pub(super) struct Multiplicand<'a> {
    pub(super) blocks: &'a [(usize, usize)],
    pub(super) columns: &'a PointColumns,
}

/// A product under way.
struct Product<'a> {
    /// Blocks and their places in the columns, by position in the order of elimination.
    order: Vec<(usize, usize)>,
    columns: &'a PointColumns,
    product: PointColumns,
    /// How many of the blocks are done.
    done: usize,
    /// Those that are eliminated in the present front.
    in_front: Range<usize>,
    /// Where that front has these and all that follow.
    places: Vec<usize>,
}

/// The products of the inverse with the columns of neighbours.
struct Products<'a> {
    inverse: &'a SelectedInverse,
    structure: &'a Structure,
    of: Vec<Multiplicand<'a>>,
}

impl NullaryFnOnce for Products<'_> {
    type Output = Vec<PointColumns>;

    #[inline(always)]
    fn call(self) -> Vec<PointColumns> {
        let Self {
            inverse, structure, ..
        } = self;
        let position = |of: &(usize, usize)| structure.position[of.0];
        let mut products: Vec<Product<'_>> = Vec::new();
        for Multiplicand { blocks, columns } in self.of {
            let mut order = blocks.to_vec();
            order.sort_unstable_by_key(position);
            products.push(Product {
                order,
                columns,
                product: vec![[0.0; 4]; columns.len()],
                done: 0,
                in_front: 0..0,
                places: Vec::new(),
            });
        }
        let orders = products.iter().flat_map(|product| &product.order);
        let mut blocks: Vec<usize> = orders.map(|(block, _)| *block).collect();
        blocks.sort_unstable_by_key(|&block| structure.position[block]);
        blocks.dedup();
        for block in blocks {
            for product in &mut products {
                let next = product.order.get(product.done);
                if next.is_some_and(|next| next.0 == block) {
                    product.add_columns_of_next(inverse, structure);
                }
            }
        }
        products
            .into_iter()
            .map(|product| product.product)
            .collect()
    }
}

impl Product<'_> {
    /// Adds what the columns of the next block, and by symmetry its rows, have to do with those that follow.
    #[inline(always)]
    fn add_columns_of_next(&mut self, inverse: &SelectedInverse, structure: &Structure) {
        let at = self.done;
        let (block, column) = self.order[at];
        let front = &structure.fronts[structure.front_of[block]];
        if at >= self.in_front.end {
            let ends_here = |of: &(usize, usize)| front.is_done_with(structure, of.0);
            self.in_front = at..at + self.order[at..].partition_point(ends_here);
            let later = self.order[at..].iter().map(|(block, _)| *block);
            self.places = front.places_of(structure, later);
        }
        let places = &self.places[at - self.in_front.start..];
        for (&(_, row), &place) in self.order[at..].iter().zip(places) {
            let entries = inverse.entries(front, block, places[0], place);
            let height = front.height(place);
            let product = &mut self.product;
            if row == column {
                add_own(product, self.columns, entries, column);
            } else if let (6, Ok(entries)) = (height, entries.try_into()) {
                add_station(product, self.columns, entries, [row, column]);
            } else {
                add_any(product, self.columns, entries, [row, column], height);
            }
        }
        self.done += 1;
    }
}

#[inline(always)]
fn add(to: &mut [f64; 4], factor: f64, row: &[f64; 4]) {
    for k in 0..4 {
        to[k] += factor * row[k];
    }
}

/// A block on the diagonal, of which all entries are there.
#[inline(always)]
fn add_own(product: &mut [[f64; 4]], columns: &[[f64; 4]], entries: &[f64], at: usize) {
    let width = entries.len().isqrt();
    for (j, entries) in entries.chunks(width).enumerate() {
        for (i, entry) in entries.iter().enumerate() {
            add(&mut product[at + i], *entry, &columns[at + j]);
        }
    }
}

/// A block six by six and the same on the other side of the diagonal.
#[inline(always)]
fn add_station(
    product: &mut [[f64; 4]],
    columns: &[[f64; 4]],
    entries: &[f64; 36],
    [row, column]: [usize; 2],
) {
    let (Some(of_column), Some(of_row)) = (
        columns[column..].first_chunk::<6>(),
        columns[row..].first_chunk::<6>(),
    ) else {
        return;
    };
    let mut transposed = [[0.0; 4]; 6];
    for i in 0..6 {
        let mut sum = product[row + i];
        for j in 0..6 {
            let entry = entries[6 * j + i];
            add(&mut sum, entry, &of_column[j]);
            add(&mut transposed[j], entry, &of_row[i]);
        }
        product[row + i] = sum;
    }
    for (sum, more) in product[column..].iter_mut().zip(&transposed) {
        add(sum, 1.0, more);
    }
}

/// Any other block and the same on the other side of the diagonal.
#[inline(always)]
fn add_any(
    product: &mut [[f64; 4]],
    columns: &[[f64; 4]],
    entries: &[f64],
    [row, column]: [usize; 2],
    height: usize,
) {
    for (j, entries) in entries.chunks(height).enumerate() {
        for (i, entry) in entries.iter().enumerate() {
            add(&mut product[row + i], *entry, &columns[column + j]);
            add(&mut product[column + j], *entry, &columns[row + i]);
        }
    }
}

/// All entries of the inverse in a front, from those of its parent.
fn whole_front(
    structure: &Structure,
    factors: &[FrontFactor],
    whole: &[Option<DMatrix<f64>>],
    index: usize,
    monitor: &Monitor,
) -> Result<DMatrix<f64>, Interrupted> {
    let front = &structure.fronts[index];
    let (size, width) = (front.size(), front.width());
    let mut inverse = zeros(size, size);
    if let Some(above) = front.parent.and_then(|parent| whole[parent].as_ref()) {
        for (j, &from_j) in front.in_parent.iter().enumerate() {
            let (from, to) = (above.column(from_j), &mut inverse.column_mut(width + j));
            for (i, &from_i) in front.in_parent.iter().enumerate() {
                to[width + i] = from[from_i];
            }
        }
    }
    complete_inverse(&factors[index].columns, &mut inverse, monitor)?;
    Ok(inverse)
}

/// What [`SelectedInverse`] keeps of a front, by its own blocks, with the scale taken out.
fn own_columns(
    structure: &Structure,
    inverse: &DMatrix<f64>,
    scale: &DVector<f64>,
    index: usize,
) -> Vec<Vec<f64>> {
    let front = &structure.fronts[index];
    let scale_of = |place: usize| &scale.as_slice()[structure.range(front.blocks[place])];
    let columns = (0..front.own).into_par_iter().with_min_len(8).map(|own| {
        let at = front.starts[own];
        let mut values = Vec::with_capacity(front.height(own) * (front.size() - at));
        for place in own..front.blocks.len() {
            let (row, rows) = (front.starts[place], scale_of(place));
            for (j, by_column) in scale_of(own).iter().enumerate() {
                let from = (at + j) * inverse.nrows() + row;
                let entries = inverse.as_slice()[from..from + rows.len()].iter().zip(rows);
                values.extend(entries.map(|(entry, by_row)| entry * (by_row * by_column)));
            }
        }
        values
    });
    columns.collect()
}
