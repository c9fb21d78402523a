//! Normal equations with the points eliminated (Schur, 1917; Brown, 1958).
//!
//! First every point is looked at by itself; then the reduced system is summed by block columns, each by one thread and over its
//! points in their order. So a sum has one order on any number of threads, and nothing is summed twice.

use nalgebra::{Cholesky, DVector, Matrix3, Vector3};
use pulp::Arch;
use rayon::prelude::*;

use super::block_columns::{BlockColumns, ColumnSum, System};
use super::block_matrix::BlockMatrix;
use super::equations::{Equations, State};
use super::interior::interior_priors;
use super::layout::{FrameOfBlock, Layout, PointFrame, PointRole};
use super::neighbourhoods::neighbourhoods;
use super::{AdjustmentError, BundleProblem, ParameterName};
use crate::monitor::{Interrupted, Monitor};

/// A pivot below this part of the unknown's own normal matrix diagonal is rounding: the unknown is not determined.
pub(super) const PIVOT_FLOOR: f64 = 1e-13;

/// Points of a camera over which a sum is made at once.
const FRAMES_AT_ONCE: usize = 256;

/// Most stations whose columns are summed together, and into how many groups all are parted at least.
const STATIONS_AT_ONCE: usize = 8;
const LEAST_GROUPS: usize = 32;

/// The coupling `Y` of an eliminated point, coordinate by coordinate; places as in [`PointFrame::index`].
#[derive(Clone, Debug)]
pub(super) struct Coupling([Vec<f64>; 3]);

/// An eliminated point: `V^-1` (zero in rows and columns of fixed coordinates), its right side, and its coupling.
#[derive(Clone, Debug)]
pub(super) struct PointNormal {
    pub(super) coupling: Coupling,
    pub(super) inverse: Matrix3<f64>,
    pub(super) right_side: Vector3<f64>,
}

impl Coupling {
    pub(super) fn axes(&self) -> [&[f64]; 3] {
        self.0.each_ref().map(Vec::as_slice)
    }

    fn zeros(places: usize) -> Self {
        Self(std::array::from_fn(|_| vec![0.0; places]))
    }

    fn add(&mut self, place: usize, by: &Vector3<f64>) {
        for (row, value) in self.0.iter_mut().zip(by.iter()) {
            row[place] += value;
        }
    }

    pub(super) fn at(&self, place: usize) -> Vector3<f64> {
        Vector3::new(self.0[0][place], self.0[1][place], self.0[2][place])
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = Vector3<f64>> {
        (0..self.0[0].len()).map(|place| self.at(place))
    }
}

/// The reduced normal equations `S dx = g`.
pub(super) struct Normals {
    /// `S`.
    pub(super) reduced: BlockMatrix,
    pub(super) right_side: DVector<f64>,
    /// Diagonal before the points were eliminated: the measure of what rounding is.
    pub(super) unreduced_diagonal: DVector<f64>,
    /// By frame; `None` for kept points and for fixed ones.
    pub(super) points: Vec<Option<PointNormal>>,
}

/// What a point is by itself.
enum Looked {
    /// Nothing of it is eliminated.
    Whole,
    Eliminated(PointNormal),
    /// Its rays do not intersect.
    Loose,
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
        monitor: &Monitor,
    ) -> Result<Self, AdjustmentError> {
        let system = System {
            problem,
            layout,
            state,
            equations,
            weights,
            damping,
        };
        let frames = layout.frames.par_iter().with_min_len(16);
        let looked = frames.map(|frame| {
            monitor.check()?;
            Ok(system.look_at(frame))
        });
        let looked: Vec<Looked> = looked.collect::<Result<_, Interrupted>>()?;
        monitor.check()?;
        let mut loose = Vec::new();
        let mut points = Vec::with_capacity(looked.len());
        for (frame, looked) in layout.frames.iter().zip(looked) {
            points.push(match looked {
                Looked::Whole => None,
                Looked::Eliminated(normal) => Some(normal),
                Looked::Loose => {
                    loose.push(ParameterName::Point { index: frame.point });
                    None
                }
            });
        }
        if !loose.is_empty() {
            return Err(AdjustmentError::RankDefect {
                defect: loose.len(),
                loose,
            });
        }
        let structure = &layout.structure;
        let mut normals = Self {
            reduced: BlockMatrix {
                columns: vec![Vec::new(); structure.blocks()],
            },
            right_side: DVector::zeros(layout.kept),
            unreduced_diagonal: DVector::zeros(layout.kept),
            points,
        };
        for sum in sums(&system, &normals.points, monitor)? {
            let unknowns = structure.range(sum.block);
            let right_side = &mut normals.right_side.as_mut_slice()[unknowns.clone()];
            right_side.copy_from_slice(sum.right_side.as_slice());
            let diagonal = &mut normals.unreduced_diagonal.as_mut_slice()[unknowns];
            diagonal.copy_from_slice(sum.diagonal.as_slice());
            normals.reduced.columns[sum.block] = sum.values;
        }
        monitor.check()?;
        normals.add_distances(problem, layout, equations);
        normals.add_interior_priors(problem, layout, state);
        for i in 0..layout.kept {
            let more = damping * normals.unreduced_diagonal[i];
            normals.reduced.add(structure, i, i, more);
        }
        Ok(normals)
    }

    /// The corrections of the points that belong to a solution `kept` of the reduced system, by frame.
    ///
    /// Cost: the rays.
    pub(super) fn point_steps(
        &self,
        layout: &Layout,
        kept: &DVector<f64>,
    ) -> Vec<Option<Vector3<f64>>> {
        let frames = layout.frames.par_iter().zip(&self.points);
        frames
            .with_min_len(64)
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
                    self.reduced.add(&layout.structure, i, j, weight * a * b);
                }
            }
        }
    }

    fn add_interior_priors(&mut self, problem: &BundleProblem, layout: &Layout, state: &State) {
        for prior in interior_priors(problem, layout, state) {
            let i = prior.at;
            let weight = prior.sigma.powi(-2);
            self.reduced.add(&layout.structure, i, i, weight);
            self.unreduced_diagonal[i] += weight;
            self.right_side[i] -= weight * prior.residual;
        }
    }
}

/// Blocks of which one thread sums the columns, over these points.
struct Part<'a> {
    blocks: Vec<(usize, &'a [FrameOfBlock])>,
}

/// Who sums what: neighbouring stations together, as they see the same points; a camera, which has to do with all points, in parts
/// that follow from the network alone.
fn parts<'a>(layout: &'a Layout, state: &State) -> Vec<Part<'a>> {
    let stations = layout.camera_of.len();
    let centres: Vec<Vector3<f64>> = state.poses.iter().map(|p| p.centre_in_world).collect();
    let at_once = (stations / LEAST_GROUPS).clamp(1, STATIONS_AT_ONCE);
    let of_block = |block: usize| (block, layout.frames_of_block[block].as_slice());
    let groups = neighbourhoods(&centres, at_once).into_iter();
    let mut parts: Vec<Part<'a>> = groups
        .map(|group| Part {
            blocks: group.into_iter().map(of_block).collect(),
        })
        .collect();
    for block in stations..layout.structure.blocks() {
        let frames = layout.frames_of_block[block].chunks(FRAMES_AT_ONCE);
        parts.extend(frames.map(|frames| Part {
            blocks: vec![(block, frames)],
        }));
    }
    parts
}

/// The columns of all blocks, with their points. Every sum runs over the points in their order.
///
/// Cost: of each point the square of its stations, 36 entries for each two.
fn sums(
    system: &System<'_>,
    points: &[Option<PointNormal>],
    monitor: &Monitor,
) -> Result<Vec<BlockColumns>, Interrupted> {
    let structure = &system.layout.structure;
    let parts = parts(system.layout, system.state);
    let found = parts.par_iter().with_max_len(1).map(|part| {
        monitor.check()?;
        let mut visits: Vec<(&FrameOfBlock, usize)> = Vec::new();
        for (column, (_, frames)) in part.blocks.iter().enumerate() {
            visits.extend(frames.iter().map(|of| (of, column)));
        }
        visits.sort_by_key(|(of, _)| of.frame);
        let column = |&(block, _): &(usize, _)| BlockColumns::zeros(block, structure);
        Ok(Arch::new().dispatch(ColumnSum {
            system,
            columns: part.blocks.iter().map(column).collect(),
            visits: &visits,
            points,
        }))
    });
    let found: Vec<Vec<BlockColumns>> = found.collect::<Result<_, Interrupted>>()?;
    monitor.check()?;
    let mut sums: Vec<Option<BlockColumns>> = Vec::new();
    sums.resize_with(structure.blocks(), || None);
    for sum in found.into_iter().flatten() {
        match &mut sums[sum.block] {
            Some(before) => before.add(&sum),
            none => *none = Some(sum),
        }
    }
    let sums = sums.into_iter().enumerate();
    Ok(sums
        .map(|(block, sum)| sum.unwrap_or_else(|| BlockColumns::zeros(block, structure)))
        .collect())
}

/// The non-zero derivatives of a distance by unknowns of the reduced system.
pub(super) fn distance_row(
    layout: &Layout,
    distance: &super::DistanceObservation,
    equation: &super::equations::DistanceEquation,
) -> Vec<(usize, f64)> {
    let end = |point: usize, sign: f64| {
        let own = layout.kept_coordinates(point);
        own.map(move |(axis, at)| (at, sign * equation.by_to[axis]))
    };
    end(distance.from, -1.0)
        .chain(end(distance.to, 1.0))
        .collect()
}

impl System<'_> {
    /// The normal equations of a point by itself.
    fn look_at(&self, frame: &PointFrame) -> Looked {
        if self.layout.roles[frame.point] != PointRole::Eliminated {
            return Looked::Whole;
        }
        let mut coupling = Coupling::zeros(frame.index.len());
        let mut own = Matrix3::zeros();
        let mut right_side = Vector3::zeros();
        for ray in frame.rays.iter().filter(|r| r.used) {
            let Some((rows, residual)) = self.rows(frame, ray) else {
                continue;
            };
            let by_point = rows.by_point.transpose();
            for block in rows.blocks() {
                for (k, by) in block.each().enumerate() {
                    coupling.add(block.place + k, &(by_point * by));
                }
            }
            own += by_point * rows.by_point;
            right_side -= by_point * residual;
        }
        let (weights, right) = self.priors(frame);
        own += weights;
        right_side += right;
        for axis in 0..3 {
            own[(axis, axis)] *= 1.0 + self.damping;
        }
        match inverse_of_point(&own, &self.layout.unknown_axes[frame.point]) {
            Some(inverse) => Looked::Eliminated(PointNormal {
                coupling,
                inverse,
                right_side,
            }),
            None => Looked::Loose,
        }
    }
}

/// The inverse of a point's normal matrix of its unknown coordinates, zero in the rows and columns of the fixed ones; `None`
/// where its rays do not intersect.
fn inverse_of_point(own: &Matrix3<f64>, unknown_axes: &[usize]) -> Option<Matrix3<f64>> {
    if unknown_axes.len() == 3 {
        return inverse_of_whole(own);
    }
    // With the identity in the place of the fixed coordinates the inverse of the others is that of their own matrix.
    let mut bordered = Matrix3::identity();
    for &i in unknown_axes {
        for &j in unknown_axes {
            bordered[(i, j)] = own[(i, j)];
        }
    }
    let whole = inverse_of_whole(&bordered)?;
    let mut inverse = Matrix3::zeros();
    for &i in unknown_axes {
        for &j in unknown_axes {
            inverse[(i, j)] = whole[(i, j)];
        }
    }
    Some(inverse)
}

fn inverse_of_whole(own: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let cholesky = Cholesky::new(*own)?;
    let l = cholesky.l_dirty();
    let regular = (0..3).all(|k| l[(k, k)] * l[(k, k)] > 0.1 * PIVOT_FLOOR * own[(k, k)]);
    let inverse = regular.then(|| cholesky.inverse())?;
    Some((inverse + inverse.transpose()) / 2.0)
}
