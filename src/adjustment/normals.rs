//! Normal equations with the points eliminated (Schur, 1917; Brown, 1958).
//!
//! First every point is looked at by itself; then the reduced system is summed by block columns, each by one thread and over its
//! points in their order. So a sum has one order on any number of threads, and nothing is summed twice.

use std::ops::Deref;

use nalgebra::{Cholesky, DVector, Matrix3, SMatrix, Vector2, Vector3};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::block_matrix::BlockMatrix;
use super::equations::{Equations, State};
use super::interior::interior_priors;
use super::layout::{Layout, PointFrame, PointRole, Ray};
use super::{AdjustmentError, BundleProblem, ParameterName};

/// A pivot below this part of the unknown's own normal matrix diagonal is rounding: the unknown is not determined.
pub(super) const PIVOT_FLOOR: f64 = 1e-13;

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

/// The columns of a block of the reduced system.
struct BlockColumns<'a> {
    block: usize,
    /// Unknowns of the block.
    width: usize,
    height: usize,
    /// Columns one after the other.
    values: Vec<f64>,
    right_side: Vec<f64>,
    diagonal: Vec<f64>,
    /// Where a row block begins in the column, by block.
    offsets: &'a [usize],
}

/// The equations of an iteration.
#[derive(Clone, Copy)]
struct System<'a> {
    problem: &'a BundleProblem,
    layout: &'a Layout,
    state: &'a State,
    equations: &'a Equations,
    /// Of the image observations, 1/px^2.
    weights: &'a [f64],
    damping: f64,
}

/// Whitened derivatives of a ray by the unknowns of its frame, and by its point.
pub(super) struct RayRows<'a> {
    by_station: SMatrix<f64, 2, 6>,
    by_camera: SMatrix<f64, 2, 10>,
    /// The parameters of the camera that are estimated for the image alone, and for all of its images.
    camera_own: &'a [usize],
    camera_free: &'a [usize],
    /// By point, the axes of its unknown coordinates.
    unknown_axes: &'a [Vec<usize>],
    pub(super) by_point: SMatrix<f64, 2, 3>,
}

/// Derivatives of a ray by all kept unknowns that it touches: place in the frame, derivative of both coordinates.
#[derive(Clone, Copy)]
pub(super) struct KeptRows {
    rows: [(usize, Vector2<f64>); 19],
    count: usize,
}

impl Deref for KeptRows {
    type Target = [(usize, Vector2<f64>)];

    fn deref(&self) -> &Self::Target {
        &self.rows[..self.count]
    }
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
        let system = System {
            problem,
            layout,
            state,
            equations,
            weights,
            damping,
        };
        let frames = layout.frames.par_iter().with_min_len(16);
        let looked: Vec<Looked> = frames.map(|frame| system.look_at(frame)).collect();
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
        // The longest sums first, those of the cameras.
        let mut order: Vec<usize> = (0..structure.blocks()).collect();
        order.sort_by_key(|&block| std::cmp::Reverse(layout.frames_of_block[block].len()));
        let mut columns: Vec<_> = order
            .par_iter()
            .map_init(
                || vec![usize::MAX; structure.blocks()],
                |offsets, &block| {
                    let column = &structure.columns[block];
                    for (&row, &offset) in column.rows.iter().zip(&column.offsets) {
                        offsets[row as usize] = offset;
                    }
                    let (width, height) = (column.offsets[1], column.offsets[column.rows.len()]);
                    let mut sums = BlockColumns {
                        block,
                        width,
                        height,
                        values: vec![0.0; width * height],
                        right_side: vec![0.0; width],
                        diagonal: vec![0.0; width],
                        offsets,
                    };
                    let mut row_of_place = Vec::new();
                    for &(frame, place) in &layout.frames_of_block[block] {
                        let normal = points[frame].as_ref();
                        let frame = &layout.frames[frame];
                        sums.add_point(&system, frame, place, normal, &mut row_of_place);
                    }
                    let BlockColumns {
                        values,
                        right_side,
                        diagonal,
                        ..
                    } = sums;
                    (block, values, right_side, diagonal)
                },
            )
            .collect();
        columns.sort_by_key(|(block, ..)| *block);
        let mut normals = Self {
            reduced: BlockMatrix {
                columns: Vec::with_capacity(columns.len()),
            },
            right_side: DVector::zeros(layout.kept),
            unreduced_diagonal: DVector::zeros(layout.kept),
            points,
        };
        for (block, values, right_side, diagonal) in columns {
            let at = structure.starts[block];
            normals.reduced.columns.push(values);
            normals.right_side.as_mut_slice()[at..][..right_side.len()]
                .copy_from_slice(&right_side);
            normals.unreduced_diagonal.as_mut_slice()[at..][..diagonal.len()]
                .copy_from_slice(&diagonal);
        }
        normals.add_distances(problem, layout, equations);
        normals.add_interior_priors(problem, layout, state);
        for i in 0..layout.kept {
            let more = damping * normals.unreduced_diagonal[i];
            normals.reduced.add(structure, i, i, more);
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

/// The derivatives of a used or predicted ray times the root of `weight`.
pub(super) fn whitened_rows<'a>(
    layout: &'a Layout,
    ray: &Ray,
    equation: &super::equations::RayEquation,
    weight: f64,
) -> RayRows<'a> {
    let root = weight.sqrt();
    RayRows {
        by_station: equation.by_station * root,
        by_camera: equation.by_camera * root,
        camera_own: &layout.camera_own[ray.camera],
        camera_free: &layout.camera_free[ray.camera],
        unknown_axes: &layout.unknown_axes,
        by_point: equation.by_point * root,
    }
}

impl RayRows<'_> {
    /// Those of all kept unknowns of this ray, by rising places.
    pub(super) fn kept(&self, ray: &Ray, frame: &PointFrame) -> KeptRows {
        let mut kept = KeptRows {
            rows: [(0, Vector2::zeros()); 19],
            count: 0,
        };
        let mut push = |place: usize, by: Vector2<f64>| {
            kept.rows[kept.count] = (place, by);
            kept.count += 1;
        };
        for k in 0..6 {
            push(ray.station_at + k, self.by_station.column(k).into_owned());
        }
        let own = (ray.own_at, self.camera_own);
        for (at, parameters) in [own, (ray.camera_at, self.camera_free)] {
            for (k, &parameter) in parameters.iter().enumerate() {
                push(at + k, self.by_camera.column(parameter).into_owned());
            }
        }
        if let Some(own) = frame.own_at {
            for (k, &axis) in self.unknown_axes[frame.point].iter().enumerate() {
                push(own + k, self.by_point.column(axis).into_owned());
            }
        }
        kept
    }
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
            let Some((rows, residual)) = self.rows(ray) else {
                continue;
            };
            let by_point = rows.by_point.transpose();
            for &(a, by_a) in rows.kept(ray, frame).iter() {
                coupling.add(a, &(by_point * by_a));
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

    /// The whitened derivatives and residual of a ray.
    fn rows(&self, ray: &Ray) -> Option<(RayRows<'_>, Vector2<f64>)> {
        let equation = self.equations.rays[ray.observation].as_ref()?;
        let weight = self.weights[ray.observation];
        let rows = whitened_rows(self.layout, ray, equation, weight);
        Some((rows, equation.residual * weight.sqrt()))
    }

    /// Weights and right side of the observed coordinates of a point.
    fn priors(&self, frame: &PointFrame) -> (Matrix3<f64>, Vector3<f64>) {
        let block = &self.problem.points[frame.point];
        // The problem was checked.
        let weights = block.weights().unwrap_or_else(Matrix3::zeros);
        let right_side = -(weights * block.off_known(&self.state.points[frame.point]));
        (weights, right_side)
    }
}

impl BlockColumns<'_> {
    /// Adds a point in whose frame the block begins at `place`.
    fn add_point(
        &mut self,
        system: &System<'_>,
        frame: &PointFrame,
        place: usize,
        normal: Option<&PointNormal>,
        row_of_place: &mut Vec<usize>,
    ) {
        row_of_place.clear();
        row_of_place.resize(frame.index.len(), usize::MAX);
        let structure = &system.layout.structure;
        for &(block, first) in frame
            .blocks
            .iter()
            .filter(|(block, _)| *block >= self.block)
        {
            for (k, row) in row_of_place[first..][..structure.range(block).len()]
                .iter_mut()
                .enumerate()
            {
                *row = self.offsets[block] + k;
            }
        }
        let rays = frame.rays_of(place, self.width);
        for ray in rays.iter().filter(|ray| ray.used) {
            self.add_ray(system, frame, place, ray, row_of_place);
        }
        if frame.own_at == Some(place) {
            let axes = &system.layout.unknown_axes[frame.point];
            let (weights, right) = system.priors(frame);
            for (column, &axis) in axes.iter().enumerate() {
                for (row, &other) in axes.iter().enumerate().skip(column) {
                    self.values[column * self.height + row] += weights[(other, axis)];
                }
                self.diagonal[column] += weights[(axis, axis)];
                self.right_side[column] += right[axis];
            }
        }
        if let Some(normal) = normal {
            let elimination = Elimination {
                columns: self,
                frame,
                normal,
                place,
                row_of_place,
            };
            Arch::new().dispatch(elimination);
        }
    }

    fn add_ray(
        &mut self,
        system: &System<'_>,
        frame: &PointFrame,
        place: usize,
        ray: &Ray,
        row_of_place: &[usize],
    ) {
        let Some((rows, residual)) = system.rows(ray) else {
            return;
        };
        let kept = rows.kept(ray, frame);
        for (k, &(a, by_a)) in kept.iter().enumerate() {
            if !(place..place + self.width).contains(&a) {
                continue;
            }
            let column = a - place;
            self.right_side[column] -= by_a.dot(&residual);
            self.diagonal[column] += by_a.norm_squared();
            let values = &mut self.values[column * self.height..][..self.height];
            // Places rise within a ray, so that what follows lies below the diagonal.
            for &(b, by_b) in &kept[k..] {
                values[row_of_place[b]] += by_a.dot(&by_b);
            }
        }
    }
}

/// Takes an eliminated point out of the columns of a block.
///
/// Cost: the squared number of the point's rays, summed over all blocks.
struct Elimination<'a, 'p> {
    columns: &'a mut BlockColumns<'p>,
    frame: &'a PointFrame,
    normal: &'a PointNormal,
    /// First place of the block in the point's frame.
    place: usize,
    row_of_place: &'a [usize],
}

impl NullaryFnOnce for Elimination<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let stations = self.frame.stations;
        let Coupling(rows) = &self.normal.coupling;
        let first = (self.place / 6).min(stations);
        let blocks = rows
            .each_ref()
            .map(|row| &row.as_chunks::<6>().0[first..stations]);
        let starts = self.row_of_place.iter().step_by(6).skip(first);
        for column in 0..self.columns.width {
            let at = self.place + column;
            let by = self.normal.inverse * self.normal.coupling.at(at);
            self.columns.right_side[column] -= by.dot(&self.normal.right_side);
            let height = self.columns.height;
            let values = &mut self.columns.values[column * height..][..height];
            let [x, y, z] = blocks;
            // All of the station's own block: what lies above the diagonal is not looked at.
            for (((&start, x), y), z) in starts.clone().zip(x).zip(y).zip(z) {
                if let Some(below) = values[start..].first_chunk_mut::<6>() {
                    for k in 0..6 {
                        below[k] -= x[k] * by.x + y[k] * by.y + z[k] * by.z;
                    }
                }
            }
            for place in (6 * stations).max(at)..self.row_of_place.len() {
                values[self.row_of_place[place]] -= by.dot(&self.normal.coupling.at(place));
            }
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
