//! The freedom of the network and how the datum takes it: true null vectors, the S-transformation, the finite move.

use nalgebra::{DMatrix, DVector, Matrix4, Rotation3, SMatrix, Vector3};

use super::equations::State;
use super::error::DatumMotion;
use super::layout::Layout;
use super::{AdjustmentError, BundleProblem, Datum};
use crate::geometry::{Pose, Similarity, skew};

/// Known directions (of unit length) whose squared share in a motion is below this do not hinder it: control within
/// 1e-5 of a line does not fix the turn about that line.
const HINDERED: f64 = 1e-10;

/// Datum points whose normalised constraint matrix has an eigenvalue below this lie on a line (within some 1e-5), or where a motion that
/// is left free does not move them.
const FLAT: f64 = 1e-10;

/// Known coordinates that a finite motion takes less than this part of the network's size from their places have not moved.
const STILL: f64 = 1e-11;

/// The motions of the whole network that no observation notices: `dX = t + (r x (X - c) + s (X - c)) / L`.
pub(super) struct FreeMotions {
    centre: Vector3<f64>,
    length: f64,
    /// 7 x d: each column is one free motion (t, r, s), orthonormal.
    basis: DMatrix<f64>,
    /// Columns before them that are motions of the frame, in which everything takes part.
    rigid: usize,
}

/// A known coordinate with its derivative by the seven motions (t, r, s).
struct KnownCoordinate {
    point: usize,
    axis: usize,
    by_motion: SMatrix<f64, 1, 7>,
}

impl FreeMotions {
    /// Images are blind to all seven; each known coordinate of what is tied to the network and each distance hinders one combination.
    pub(super) fn of(problem: &BundleProblem, layout: &Layout, state: &State) -> Self {
        let (centre, length) = extent(layout, state);
        let mut free = Self {
            centre,
            length,
            basis: DMatrix::identity(7, 7),
            rigid: 0,
        };
        let mut hindered = SMatrix::<f64, 7, 7>::zeros();
        let mut hinder = |row: SMatrix<f64, 1, 7>| {
            let norm = row.norm();
            if norm > 0.0 {
                hindered += row.transpose() * row / (norm * norm);
            }
        };
        for known in free.known_coordinates(problem, layout, state) {
            hinder(known.by_motion);
        }
        if layout.distance_used.contains(&true) {
            // Only the scale changes a distance.
            let mut scale = SMatrix::<f64, 1, 7>::zeros();
            scale[6] = 1.0;
            hinder(scale);
        }
        let eigen = hindered.symmetric_eigen();
        let null: Vec<usize> = (0..7)
            .filter(|&k| eigen.eigenvalues[k].abs() < HINDERED)
            .collect();
        free.basis = DMatrix::from_fn(7, null.len(), |i, k| eigen.eigenvectors[(i, null[k])]);
        free
    }

    /// All known coordinates of points that are tied to the network, by points and axes: one of which no ray is left holds nothing.
    fn known_coordinates(
        &self,
        problem: &BundleProblem,
        layout: &Layout,
        state: &State,
    ) -> Vec<KnownCoordinate> {
        let of_point = |point: usize| {
            let rows = self.candidates(&state.points[point]);
            let known = (0..3).filter(move |&axis| problem.points[point].prior[axis].is_some());
            known.map(move |axis| KnownCoordinate {
                point,
                axis,
                by_motion: rows.row(axis).into_owned(),
            })
        };
        let points = layout.frames.iter().map(|frame| frame.point);
        let tied = points.filter(|&point| layout.tied[point]);
        tied.flat_map(of_point).collect()
    }

    /// The motion that brings known coordinates back to where they were `before`; `None` where they are.
    ///
    /// Single known coordinates leave motions along curves free (a turn, if one coordinate of a point is known), which finite
    /// motions follow at first order only.
    fn back_to_known(
        &self,
        problem: &BundleProblem,
        layout: &Layout,
        state: &State,
        before: &[Vector3<f64>],
    ) -> Option<Similarity> {
        let mut normal = SMatrix::<f64, 7, 7>::zeros();
        let mut right_side = SMatrix::<f64, 7, 1>::zeros();
        let mut farthest = 0.0_f64;
        for known in self.known_coordinates(problem, layout, state) {
            let KnownCoordinate { point, axis, .. } = known;
            let moved = before[point][axis] - state.points[point][axis];
            let by_motion = known.by_motion.transpose();
            normal += by_motion * by_motion.transpose();
            right_side += by_motion * moved;
            farthest = farthest.max(moved.abs());
        }
        if farthest <= STILL * self.length {
            return None;
        }
        if layout.distance_used.contains(&true) {
            normal[(6, 6)] += 1.0;
        }
        let amount = normal.pseudo_inverse(HINDERED).ok()? * right_side;
        let all = Self {
            basis: DMatrix::identity(7, 7),
            ..*self
        };
        Some(all.similarity(&DVector::from_column_slice(amount.as_slice())))
    }

    /// The rank defect of the network's datum.
    pub(super) fn defect(&self) -> usize {
        self.basis.ncols()
    }

    /// The six rigid motions, whatever the observations notice.
    pub(super) fn rigid(&self) -> Self {
        Self {
            basis: DMatrix::identity(7, 6),
            rigid: 6,
            ..*self
        }
    }

    /// The six rigid motions followed by these.
    pub(super) fn after_rigid(&self) -> Self {
        let mut basis = DMatrix::identity(7, 6 + self.defect());
        basis.columns_mut(6, self.defect()).copy_from(&self.basis);
        Self {
            basis,
            rigid: 6,
            ..*self
        }
    }

    /// Whether the chosen datum takes exactly this freedom.
    pub(super) fn check(
        &self,
        problem: &BundleProblem,
        layout: &Layout,
        state: &State,
    ) -> Result<(), AdjustmentError> {
        let defect = self.defect();
        if defect == 0 {
            return Ok(());
        }
        if problem.datum == Datum::Control {
            let motions = (0..7)
                .filter(|&i| self.basis.row(i).norm() > 1e-3)
                .map(|i| DatumMotion::ALL[i])
                .collect();
            return Err(AdjustmentError::DatumDefect { defect, motions });
        }
        self.constraint_inverse(layout, state).map(|_| ())
    }

    fn candidates(&self, point: &Vector3<f64>) -> SMatrix<f64, 3, 7> {
        let x = (point - self.centre) / self.length;
        let mut rows = SMatrix::<f64, 3, 7>::zeros();
        rows.fixed_columns_mut::<3>(0).fill_with_identity();
        rows.fixed_columns_mut::<3>(3).copy_from(&-skew(&x));
        rows.fixed_columns_mut::<1>(6).copy_from(&x);
        rows
    }

    /// Rows of `G` of a point, 3 x d.
    pub(super) fn point_rows(&self, point: &Vector3<f64>) -> DMatrix<f64> {
        let rows = self.candidates(point) * &self.basis;
        DMatrix::from_column_slice(3, self.defect(), rows.as_slice())
    }

    /// [`Self::point_rows`] of a point of the problem: what nothing ties to the network takes part in motions of the frame alone.
    pub(super) fn rows_of_point(
        &self,
        point: usize,
        layout: &Layout,
        state: &State,
    ) -> DMatrix<f64> {
        let mut rows = self.point_rows(&state.points[point]);
        if !layout.tied[point] {
            let free = self.defect() - self.rigid;
            rows.columns_mut(self.rigid, free).fill(0.0);
        }
        rows
    }

    /// Rows of `G` of a station, 6 x d.
    pub(super) fn station_rows(&self, pose: &Pose) -> DMatrix<f64> {
        // Turning the world by r turns the camera the other way: M exp(-[r]) = exp([-M r]) M.
        let mut candidates = SMatrix::<f64, 6, 7>::zeros();
        candidates
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(-pose.camera_from_world.matrix() / self.length));
        candidates
            .fixed_rows_mut::<3>(3)
            .copy_from(&self.candidates(&pose.centre_in_world));
        let rows = candidates * &self.basis;
        DMatrix::from_column_slice(6, self.defect(), rows.as_slice())
    }

    /// Rows of `G` of all unknowns of the reduced system.
    pub(super) fn kept_rows(&self, layout: &Layout, state: &State) -> DMatrix<f64> {
        let mut rows = DMatrix::zeros(layout.kept, self.defect());
        for (s, pose) in state.poses.iter().enumerate() {
            rows.rows_mut(6 * s, 6).copy_from(&self.station_rows(pose));
        }
        for (point, position) in state.points.iter().enumerate() {
            let mut own = layout.kept_coordinates(point).peekable();
            if own.peek().is_some() {
                let of_point = self.point_rows(position);
                for (axis, at) in own {
                    rows.set_row(at, &of_point.row(axis));
                }
            }
        }
        rows
    }

    /// `(G^T E G)^-1` over the datum points.
    fn constraint_inverse(
        &self,
        layout: &Layout,
        state: &State,
    ) -> Result<DMatrix<f64>, AdjustmentError> {
        let mut sum = DMatrix::zeros(self.defect(), self.defect());
        for &p in &layout.datum_points {
            let rows = self.point_rows(&state.points[p]);
            sum += rows.transpose() * rows;
        }
        let eigen = sum.clone().symmetric_eigen();
        let failure = AdjustmentError::DatumPoints {
            found: layout.datum_points.len(),
            defect: self.defect(),
        };
        // The motions are of unit length in the network's size and move each of its points by some 1: beside the number of the datum
        // points is small what moves none of them, also where no other motion is free.
        let size = eigen.eigenvalues.max();
        let size = size.max(layout.datum_points.len() as f64);
        if eigen.eigenvalues.min() <= FLAT * size {
            return Err(failure);
        }
        sum.try_inverse().ok_or(failure)
    }

    /// `H = (G^T E G)^-1 G^T E` by datum point, each d x 3: the S-transformation is `I - G H` (Baarda, 1973).
    pub(super) fn s_transformation(
        &self,
        layout: &Layout,
        state: &State,
    ) -> Result<Vec<DMatrix<f64>>, AdjustmentError> {
        if self.defect() == 0 {
            return Ok(vec![DMatrix::zeros(0, 3); layout.datum_points.len()]);
        }
        let inverse = self.constraint_inverse(layout, state)?;
        Ok(layout
            .datum_points
            .iter()
            .map(|&p| &inverse * self.point_rows(&state.points[p]).transpose())
            .collect())
    }

    /// The finite similarity of a combination of free motions (the exponential of its generator, so that it stays
    /// within what the observations do not notice).
    fn similarity(&self, amount: &DVector<f64>) -> Similarity {
        let motion = &self.basis * amount;
        let turn = Vector3::new(motion[3], motion[4], motion[5]) / self.length;
        let linear = skew(&turn) + nalgebra::Matrix3::identity() * (motion[6] / self.length);
        let shift = Vector3::new(motion[0], motion[1], motion[2]) - linear * self.centre;
        let mut generator = Matrix4::zeros();
        generator.fixed_view_mut::<3, 3>(0, 0).copy_from(&linear);
        generator.fixed_view_mut::<3, 1>(0, 3).copy_from(&shift);
        let finite = generator.exp();
        Similarity {
            scale: (motion[6] / self.length).exp(),
            rotation: Rotation3::new(turn),
            translation: finite.fixed_view::<3, 1>(0, 3).into_owned(),
        }
    }
}

/// Moves the estimates by a finite similarity, which is returned, so that the datum points are neither shifted nor turned nor (if it is
/// free) scaled against `reference`, in the mean; known points that nothing ties to the network stay. The linear `S` would bend the
/// network at second order.
pub(super) fn move_onto_datum(
    problem: &BundleProblem,
    layout: &Layout,
    state: &mut State,
    reference: &[Vector3<f64>],
) -> Result<Similarity, AdjustmentError> {
    /// Iterations of the fit; each gains several digits.
    const ITERATIONS: usize = 50;
    /// The fit ends when its last move was below this part of the network's size: rounding.
    const NEGLIGIBLE: f64 = 1e-14;
    let mut moved = Similarity::identity();
    let before = state.points.clone();
    for _ in 0..ITERATIONS {
        let free = FreeMotions::of(problem, layout, state);
        if free.defect() == 0 || problem.datum == Datum::Control {
            break;
        }
        let h = free.s_transformation(layout, state)?;
        let mut amount = DVector::zeros(free.defect());
        for (h, &p) in h.iter().zip(&layout.datum_points) {
            amount += h * (reference[p] - state.points[p]);
        }
        let motion = free.similarity(&amount);
        apply(&motion, state);
        moved = motion.after(&moved);
        let back = free.back_to_known(problem, layout, state, &before);
        if let Some(back) = &back {
            apply(back, state);
            moved = back.after(&moved);
        }
        if amount.norm() < NEGLIGIBLE * free.length && back.is_none() {
            break;
        }
    }
    for frame in &layout.frames {
        if !layout.tied[frame.point] {
            state.points[frame.point] = before[frame.point];
        }
    }
    state.hold_fixed(problem);
    Ok(moved)
}

pub(super) fn apply(similarity: &Similarity, state: &mut State) {
    for point in &mut state.points {
        *point = similarity.apply(point);
    }
    for circle in state.circles.iter_mut().flatten() {
        *circle = circle.moved(similarity);
    }
    for pose in &mut state.poses {
        pose.centre_in_world = similarity.apply(&pose.centre_in_world);
        pose.camera_from_world *= similarity.rotation.inverse();
        *pose = pose.moved(&Vector3::zeros(), &Vector3::zeros());
    }
}

/// Centre and rms radius of the points that take part.
fn extent(layout: &Layout, state: &State) -> (Vector3<f64>, f64) {
    let n = layout.frames.len().max(1) as f64;
    let points = || layout.frames.iter().map(|f| state.points[f.point]);
    let centre = points().sum::<Vector3<f64>>() / n;
    let square: f64 = points().map(|p| (p - centre).norm_squared()).sum();
    let length = (square / n).sqrt();
    (centre, if length > 0.0 { length } else { 1.0 })
}
