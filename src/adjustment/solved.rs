//! The solved normal equations of an adjusted network: joint covariances of whatever is asked for, and other datums, without
//! adjusting again.

use nalgebra::{DMatrix, Matrix3, Vector3};
use rayon::prelude::*;

use super::datum::{FreeMotions, apply, move_onto_datum};
use super::equations::{Equations, State};
use super::factor::Factor;
use super::frame::{STransformation, hold, move_adjustment};
use super::layout::{Layout, PointRole};
use super::normals::Normals;
use super::selected_inverse::SelectedInverse;
use super::statistics::{self, Counts};
use super::transformation::{Transformation, add_to_right_side, point_rows, solved};
use super::{Adjustment, AdjustmentError, BundleProblem, Datum, Termination};
use crate::geometry::Similarity;
use crate::monitor::{Interrupted, Monitor};

/// Unknowns that belong together, by their place in the problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// The ten parameters of a camera, in the order of [`crate::camera::INTERIOR_NAMES`]; those that are not estimated for all of
    /// its images do not vary.
    Camera(usize),
    /// The ten parameters of a station's camera; those that the station does not have for itself do not vary.
    Interior(usize),
    /// A station: turn in the camera frame (rad), projection centre (mm).
    Station(usize),
    /// Coordinates of a point (mm).
    Point(usize),
}

impl Part {
    /// How many unknowns it is.
    #[must_use]
    pub fn width(self) -> usize {
        match self {
            Self::Camera(_) | Self::Interior(_) => 10,
            Self::Station(_) => 6,
            Self::Point(_) => 3,
        }
    }
}

/// An adjusted network with its solved normal equations.
pub struct SolvedNetwork {
    pub(super) problem: BundleProblem,
    pub(super) layout: Layout,
    /// Where the equations were solved.
    pub(super) state: State,
    pub(super) equations: Equations,
    pub(super) normals: Normals,
    factor: Factor,
    pub(super) inverse: SelectedInverse,
    pub(super) transformation: Transformation,
    pub(super) counts: Counts,
    /// Of unit weight, a-posteriori.
    pub(super) variance: f64,
    pub(super) iterations: usize,
    pub(super) termination: Termination,
    /// From where the equations were solved into the datum.
    onto_datum: Similarity,
    /// From the datum into the frame by three points.
    into_frame: Option<Similarity>,
}

impl SolvedNetwork {
    /// Solves the equations at a state that lies in the datum already.
    pub(super) fn new(
        problem: BundleProblem,
        layout: Layout,
        state: State,
        iterations: usize,
        termination: Termination,
        monitor: &Monitor,
    ) -> Result<Self, AdjustmentError> {
        let equations = Equations::at(&problem, &layout, &state, monitor)?;
        let used = problem.observations.iter().zip(&layout.used);
        let weights: Vec<f64> = used
            .map(|(o, used)| if *used { o.sigma_px.powi(-2) } else { 0.0 })
            .collect();
        let normals = Normals::build(
            &problem, &layout, &state, &equations, &weights, 0.0, monitor,
        )?;
        let free = FreeMotions::of(&problem, &layout, &state);
        let factor = Factor::new(&normals, &layout, &state, &free, monitor)?;
        let inverse = factor.inverse(&layout.structure, monitor)?;
        let counts = Counts::of(&problem, &layout, &state, free.defect());
        let variance = statistics::variance(&problem, &layout, &state, &equations, &counts);
        monitor.check()?;
        let onto_datum = STransformation::new(free, &problem, &layout, &state)?;
        let transformation =
            Transformation::new(onto_datum, &layout, &state, &normals, &factor, monitor)?;
        let into_frame = frame_motion(&problem, &state.points)?;
        Ok(Self {
            problem,
            layout,
            state,
            equations,
            normals,
            factor,
            inverse,
            transformation,
            counts,
            variance,
            iterations,
            termination,
            onto_datum: Similarity::identity(),
            into_frame,
        })
    }

    /// The equations of an adjustment that was made of this problem.
    ///
    /// # Errors
    /// As the adjustment.
    pub fn of(
        problem: BundleProblem,
        adjustment: &Adjustment,
        monitor: &Monitor,
    ) -> Result<Self, AdjustmentError> {
        let layout = Layout::new(&problem, monitor)?;
        let mut state = State::of(adjustment);
        if let Some(motion) = &adjustment.motion {
            apply(&motion.inverse(), &mut state);
        }
        let (iterations, termination) = (adjustment.iterations, adjustment.termination);
        Self::new(problem, layout, state, iterations, termination, monitor)
    }

    /// The estimates with their statistics, in the chosen datum and frame.
    ///
    /// # Errors
    /// [`Interrupted`] when the work was asked to stop.
    pub fn adjustment(&self, monitor: &Monitor) -> Result<Adjustment, Interrupted> {
        let mut adjustment = statistics::adjustment(self, monitor)?;
        if self.onto_datum != Similarity::identity() {
            move_adjustment(&mut adjustment, &self.onto_datum);
        }
        if let (Some(motion), Some(frame)) = (&self.into_frame, &self.problem.frame) {
            move_adjustment(&mut adjustment, motion);
            hold(frame, &mut adjustment);
            adjustment.motion = Some(*motion);
        }
        Ok(adjustment)
    }

    /// The same network in the datum of inner constraints over other points (indices into [`BundleProblem::points`]): the
    /// estimates move by a finite similarity, the cofactors by the S-transformation (Baarda, 1973). Nothing is adjusted or
    /// factorised again.
    ///
    /// Cost: seven solves with the factor, and what the statistics of all points cost.
    ///
    /// # Errors
    /// [`AdjustmentError::Interrupted`]; [`AdjustmentError::DatumPoints`] where they do not fix what is free; [`AdjustmentError::FramePoint`] or
    /// [`AdjustmentError::FrameShape`] as in the adjustment.
    pub fn in_datum(
        mut self,
        points: Vec<usize>,
        monitor: &Monitor,
    ) -> Result<Self, AdjustmentError> {
        self.layout.set_datum_points(&points);
        self.problem.datum = Datum::InnerConstraints { points };
        let free = FreeMotions::of(&self.problem, &self.layout, &self.state);
        free.check(&self.problem, &self.layout, &self.state)?;
        let reference: Vec<Vector3<f64>> = self.problem.points.iter().map(|p| p.position).collect();
        let mut moved = self.state.clone();
        self.onto_datum = move_onto_datum(&self.problem, &self.layout, &mut moved, &reference)?;
        self.into_frame = frame_motion(&self.problem, &moved.points)?;
        let onto_datum = STransformation::new(free, &self.problem, &self.layout, &self.state)?;
        self.transformation = Transformation::new(
            onto_datum,
            &self.layout,
            &self.state,
            &self.normals,
            &self.factor,
            monitor,
        )?;
        Ok(self)
    }

    /// Every part that takes part: cameras, stations each with what it has for itself, points.
    #[must_use]
    pub fn parts(&self) -> Vec<Part> {
        let cameras = (0..self.problem.cameras.len()).map(Part::Camera);
        let stations = (0..self.problem.stations.len()).flat_map(|station| {
            let own = self.state.own_cameras[station].is_some();
            std::iter::once(Part::Station(station)).chain(own.then_some(Part::Interior(station)))
        });
        let points = self.layout.frames.iter().map(|f| Part::Point(f.point));
        cameras.chain(stations).chain(points).collect()
    }

    /// The joint covariance matrix of these parts, a-posteriori, in their order and in the datum and frame of
    /// [`Self::adjustment`]; rows of fixed camera parameters are zero. `None` where one of them takes no part.
    ///
    /// Cost: a solve with the factor for each of their unknowns, and the square of their number.
    #[must_use]
    pub fn covariance(&self, of: &[Part]) -> Option<DMatrix<f64>> {
        let mut starts = vec![0];
        for part in of {
            if !self.takes_part(*part) {
                return None;
            }
            starts.push(starts[starts.len() - 1] + part.width());
        }
        let size = starts[of.len()];
        let columns: Vec<DMatrix<f64>> = of
            .par_iter()
            .map(|part| {
                let solution = self.solution_of(*part);
                let mut columns = DMatrix::zeros(size, part.width());
                for (row, &start) in of.iter().zip(&starts) {
                    let among = self.rows_of(*row, *part, &solution);
                    columns.rows_mut(start, row.width()).copy_from(&among);
                }
                columns
            })
            .collect();
        let d = self.transformation.motions.defect();
        let mut cofactor = DMatrix::zeros(size, size);
        let (mut g, mut c) = (DMatrix::zeros(size, d), DMatrix::zeros(size, d));
        let mut by_old = DMatrix::identity(size, size);
        for ((part, &start), columns) in of.iter().zip(&starts).zip(columns) {
            cofactor
                .columns_mut(start, part.width())
                .copy_from(&columns);
            let (of_motions, of_datum) = self.datum_rows(*part);
            g.rows_mut(start, part.width()).copy_from(&of_motions);
            c.rows_mut(start, part.width()).copy_from(&of_datum);
            let place = match part {
                Part::Camera(_) | Part::Interior(_) => None,
                Part::Station(_) => Some(start + 3),
                Part::Point(_) => Some(start),
            };
            if let Some(place) = place {
                by_old
                    .view_mut((place, place), (3, 3))
                    .copy_from(&self.axes());
            }
        }
        let cofactor = self.transformation.apply(&cofactor, &g, &c);
        let covariance = &by_old * cofactor * by_old.transpose() * self.variance;
        Some((&covariance + covariance.transpose()) / 2.0)
    }

    /// Where a point lies in the datum and the frame; `None` where it takes no part.
    #[must_use]
    pub fn position(&self, point: usize) -> Option<Vector3<f64>> {
        let position = self.state.points.get(point)?;
        self.takes_part(Part::Point(point)).then(|| {
            let position = self.onto_datum.apply(position);
            self.into_frame.map_or(position, |f| f.apply(&position))
        })
    }

    /// How coordinates differences where the equations were solved become those of the result.
    fn axes(&self) -> Matrix3<f64> {
        let motion = match &self.into_frame {
            Some(frame) => frame.after(&self.onto_datum),
            None => self.onto_datum,
        };
        motion.scale * motion.rotation.matrix()
    }

    fn takes_part(&self, part: Part) -> bool {
        match part {
            Part::Camera(index) => index < self.problem.cameras.len(),
            Part::Station(index) | Part::Interior(index) => index < self.problem.stations.len(),
            Part::Point(index) => {
                index < self.problem.points.len() && self.layout.takes_part(index)
            }
        }
    }

    /// The place of a point's frame.
    fn frame_of(&self, point: usize) -> Option<usize> {
        let frames = &self.layout.frames;
        frames.binary_search_by_key(&point, |f| f.point).ok()
    }

    /// Each unknown of the part with its place in the reduced system.
    fn kept_places(&self, part: Part) -> Vec<(usize, usize)> {
        match part {
            Part::Camera(index) => {
                let shared = self.layout.shared_parameters(index);
                shared.map(|own| (own.parameter, own.at)).collect()
            }
            Part::Interior(index) => {
                let own = self.layout.own_parameters(index);
                own.map(|own| (own.parameter, own.at)).collect()
            }
            Part::Station(index) => (0..6).map(|k| (k, 6 * index + k)).collect(),
            Part::Point(index) => self.layout.kept_coordinates(index).collect(),
        }
    }

    /// The columns of a part in the inverse of the regularised system, over the reduced system.
    fn solution_of(&self, part: Part) -> DMatrix<f64> {
        let mut right_side = DMatrix::zeros(self.layout.kept, part.width());
        for (k, place) in self.kept_places(part) {
            right_side[(place, k)] = 1.0;
        }
        if let (Part::Point(point), true) = (part, self.is_eliminated(part))
            && let Some(at) = self.frame_of(point)
        {
            let (frame, normal) = (&self.layout.frames[at], self.normals.points[at].as_ref());
            let unit = DMatrix::identity(3, 3);
            add_to_right_side(&mut right_side, &self.layout, frame, normal, &unit);
        }
        solved(&self.layout, &self.factor, &right_side, &Monitor::new()).expect("nobody interrupts")
    }

    fn is_eliminated(&self, part: Part) -> bool {
        matches!(part, Part::Point(p) if self.layout.roles[p] == PointRole::Eliminated)
    }

    /// The rows of a part in the columns of another one.
    fn rows_of(&self, part: Part, column: Part, solution: &DMatrix<f64>) -> DMatrix<f64> {
        if let (Part::Point(point), true) = (part, self.is_eliminated(part))
            && let Some(at) = self.frame_of(point)
        {
            let (frame, normal) = (&self.layout.frames[at], self.normals.points[at].as_ref());
            let unit = DMatrix::identity(3, 3);
            let own = (part == column).then_some(&unit);
            return point_rows(&self.layout, frame, normal, own, solution);
        }
        let mut rows = DMatrix::zeros(part.width(), solution.ncols());
        for (k, place) in self.kept_places(part) {
            rows.row_mut(k).copy_from(&solution.row(place));
        }
        rows
    }

    /// The rows of a part in `G` and in `C`.
    fn datum_rows(&self, part: Part) -> (DMatrix<f64>, DMatrix<f64>) {
        let motions = &self.transformation.motions;
        let g = match part {
            Part::Camera(_) | Part::Interior(_) => DMatrix::zeros(10, motions.defect()),
            Part::Station(index) => motions.station_rows(&self.state.poses[index]),
            Part::Point(index) => motions.rows_of_point(index, &self.layout, &self.state),
        };
        let of_point = match part {
            Part::Point(point) => self.frame_of(point),
            Part::Camera(_) | Part::Interior(_) | Part::Station(_) => None,
        };
        let c = match of_point {
            Some(at) => self.transformation.points[at].clone(),
            None => {
                let mut rows = DMatrix::zeros(part.width(), motions.defect());
                for (k, place) in self.kept_places(part) {
                    rows.row_mut(k)
                        .copy_from(&self.transformation.kept.row(place));
                }
                rows
            }
        };
        (g, c)
    }
}

fn frame_motion(
    problem: &BundleProblem,
    points: &[Vector3<f64>],
) -> Result<Option<Similarity>, AdjustmentError> {
    let frame = problem.frame.as_ref();
    let motion = frame.map(|frame| frame.map(|p| points[*p]).motion());
    Ok(motion.transpose()?)
}
