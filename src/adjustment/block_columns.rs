//! The columns of a block of the reduced system, summed over the points that have to do with it.

use nalgebra::{DVector, Matrix3, Vector2, Vector3};
use pulp::NullaryFnOnce;

use super::BundleProblem;
use super::equations::{Equations, State};
use super::layout::{FrameOfBlock, Layout, PointFrame, Ray};
use super::normals::PointNormal;
use super::ray_rows::RayRows;
use super::structure::Structure;

/// Most unknowns of a block: those of a camera.
const WIDEST: usize = 10;

/// The equations of an iteration.
#[derive(Clone, Copy)]
pub(super) struct System<'a> {
    pub(super) problem: &'a BundleProblem,
    pub(super) layout: &'a Layout,
    pub(super) state: &'a State,
    pub(super) equations: &'a Equations,
    /// Of the image observations, 1/px^2.
    pub(super) weights: &'a [f64],
    pub(super) damping: f64,
}

impl System<'_> {
    /// The whitened derivatives and residual of a ray.
    #[inline(always)]
    pub(super) fn rows(&self, frame: &PointFrame, ray: &Ray) -> Option<(RayRows, Vector2<f64>)> {
        let equation = self.equations.rays[ray.observation].as_ref()?;
        let weight = self.weights[ray.observation];
        let rows = RayRows::new(self.layout, frame, ray, equation, weight);
        Some((rows, equation.residual * weight.sqrt()))
    }

    /// Weights and right side of the observed coordinates of a point.
    pub(super) fn priors(&self, frame: &PointFrame) -> (Matrix3<f64>, Vector3<f64>) {
        let block = &self.problem.points[frame.point];
        // The problem was checked.
        let weights = block.weights().unwrap_or_else(Matrix3::zeros);
        let right_side = -(weights * block.off_known(&self.state.points[frame.point]));
        (weights, right_side)
    }
}

/// The columns of a block: its values as in [`super::block_matrix::BlockMatrix`], and what else its unknowns have.
pub(super) struct BlockColumns {
    pub(super) block: usize,
    /// Where each row block begins.
    offsets: Vec<u32>,
    pub(super) values: Vec<f64>,
    pub(super) right_side: DVector<f64>,
    /// Before the points were eliminated.
    pub(super) diagonal: DVector<f64>,
}

impl BlockColumns {
    pub(super) fn zeros(block: usize, structure: &Structure) -> Self {
        let column = &structure.columns[block];
        let width = column.offsets[1];
        let mut offsets = vec![u32::MAX; structure.blocks()];
        for (&row, &offset) in column.rows.iter().zip(&column.offsets) {
            offsets[row as usize] = offset as u32;
        }
        Self {
            block,
            offsets,
            values: vec![0.0; width * column.offsets[column.rows.len()]],
            right_side: DVector::zeros(width),
            diagonal: DVector::zeros(width),
        }
    }

    fn width(&self) -> usize {
        self.right_side.len()
    }

    /// Where the values of a row block begin.
    fn start_of(&self, row: usize) -> usize {
        self.offsets[row] as usize * self.width()
    }

    /// Adds what a sum over other points found.
    pub(super) fn add(&mut self, more: &Self) {
        for (value, more) in self.values.iter_mut().zip(&more.values) {
            *value += more;
        }
        self.right_side += &more.right_side;
        self.diagonal += &more.diagonal;
    }

    /// Adds a point that has to do with the block.
    #[inline(always)]
    fn add_point(&mut self, system: &System<'_>, of: &FrameOfBlock, normal: Option<&PointNormal>) {
        let frame = &system.layout.frames[of.frame];
        let place = frame.blocks[of.at].1;
        for ray in frame.rays[of.rays.clone()].iter().filter(|ray| ray.used) {
            self.add_ray(system, frame, place, ray);
        }
        if frame.own_at == Some(place) {
            let axes = &system.layout.unknown_axes[frame.point];
            let (weights, right) = system.priors(frame);
            for (column, &axis) in axes.iter().enumerate() {
                for (row, &other) in axes.iter().enumerate().skip(column) {
                    self.values[column * axes.len() + row] += weights[(other, axis)];
                }
                self.diagonal[column] += weights[(axis, axis)];
                self.right_side[column] += right[axis];
            }
        }
        if let Some(normal) = normal {
            self.eliminate(frame, of.at, normal);
        }
    }

    #[inline(always)]
    fn add_ray(&mut self, system: &System<'_>, frame: &PointFrame, place: usize, ray: &Ray) {
        let Some((rows, residual)) = system.rows(frame, ray) else {
            return;
        };
        // Places rise within a ray, so that what follows the block's own lies below it.
        let mut blocks = rows.blocks().skip_while(|block| block.place < place);
        let Some(own) = blocks.next().filter(|block| block.place == place) else {
            // A ray of another camera.
            return;
        };
        for (column, by) in own.each().enumerate() {
            self.right_side[column] -= by.dot(&residual);
            self.diagonal[column] += by.norm_squared();
        }
        for below in std::iter::once(own).chain(blocks) {
            let from = self.start_of(frame.block_at(below.place));
            let entries = self.values[from..].chunks_mut(below.x.len());
            for (entries, by) in entries.zip(own.each()) {
                for ((entry, x), y) in entries.iter_mut().zip(below.x).zip(below.y) {
                    *entry += by.x * x + by.y * y;
                }
            }
        }
    }

    /// Takes out an eliminated point, of whose frame the block has this number.
    ///
    /// Cost: 36 entries for each station of the point that follows.
    #[inline(always)]
    fn eliminate(&mut self, frame: &PointFrame, own_at: usize, normal: &PointNormal) {
        let width = self.width();
        let blocks = &frame.blocks[own_at..];
        let first = blocks[0].1;
        let mut by = [[0.0; WIDEST]; 3];
        for (column, right_side) in self.right_side.iter_mut().enumerate() {
            let reduced = normal.inverse * normal.coupling.at(first + column);
            *right_side -= reduced.dot(&normal.right_side);
            for (row, value) in by.iter_mut().zip(reduced.iter()) {
                row[column] = *value;
            }
        }
        // All of the block's own entries: what lies above the diagonal is not looked at.
        let stations = match width {
            6 => frame.stations.saturating_sub(own_at),
            _ => 0,
        };
        let axes = normal.coupling.axes();
        let [x, y, z] = axes.map(|row| &row[first..].as_chunks::<6>().0[..stations]);
        let by_station = by.map(|row| std::array::from_fn(|k| row[k / 6]));
        for (((&(block, _), x), y), z) in blocks.iter().zip(x).zip(y).zip(z) {
            let entries = self.values[6 * self.offsets[block] as usize..].first_chunk_mut();
            if let Some(entries) = entries {
                subtract_station(entries, [*x, *y, *z], &by_station);
            }
        }
        for (at, &(block, _)) in blocks.iter().enumerate().skip(stations) {
            let places = frame.places(own_at + at);
            let [x, y, z] = axes.map(|row| &row[places.clone()]);
            let from = self.start_of(block);
            let entries = self.values[from..].chunks_mut(places.len());
            for (column, entries) in entries.take(width).enumerate() {
                let [bx, by, bz] = by.map(|row| row[column]);
                for (((entry, x), y), z) in entries.iter_mut().zip(x).zip(y).zip(z) {
                    *entry -= x * bx + y * by + z * bz;
                }
            }
        }
    }
}

/// `entries - Y^T B`, six by six, of which `by` has every entry six times: two columns are one run of twelve numbers, which fill vector
/// registers.
#[inline(always)]
fn subtract_station(entries: &mut [f64; 36], coupling: [[f64; 6]; 3], by: &[[f64; 36]; 3]) {
    let [x, y, z]: [[f64; 12]; 3] = coupling.map(|row| std::array::from_fn(|k| row[k % 6]));
    for (pair, entries) in entries.as_chunks_mut::<12>().0.iter_mut().enumerate() {
        let mut own = *entries;
        for (k, value) in own.iter_mut().enumerate() {
            let at = 12 * pair + k;
            *value -= x[k] * by[0][at] + y[k] * by[1][at] + z[k] * by[2][at];
        }
        *entries = own;
    }
}

/// The sum of some blocks' columns over points that have to do with them.
pub(super) struct ColumnSum<'a> {
    pub(super) system: &'a System<'a>,
    pub(super) columns: Vec<BlockColumns>,
    /// The points, and with which of the columns they have to do.
    pub(super) visits: &'a [(&'a FrameOfBlock, usize)],
    pub(super) points: &'a [Option<PointNormal>],
}

impl NullaryFnOnce for ColumnSum<'_> {
    type Output = Vec<BlockColumns>;

    #[inline(always)]
    fn call(self) -> Vec<BlockColumns> {
        let mut columns = self.columns;
        for &(of, column) in self.visits {
            let normal = self.points[of.frame].as_ref();
            columns[column].add_point(self.system, of, normal);
        }
        columns
    }
}
