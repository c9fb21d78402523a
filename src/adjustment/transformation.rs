//! The S-transformation of cofactors from the regularised system into the datum: `Q = S Q' S^T` (Baarda, 1973).

use nalgebra::{DMatrix, Vector3};
use rayon::prelude::*;

use super::datum::FreeMotions;
use super::equations::State;
use super::factor::Factor;
use super::frame::STransformation;
use super::layout::{Layout, PointFrame};
use super::normals::{Normals, PointNormal};
use crate::monitor::{Interrupted, Monitor};

/// What is needed to bring cofactors from the regularised system into the datum: `Q = S Q' S^T`.
pub(super) struct Transformation {
    /// `G`.
    pub(super) motions: FreeMotions,
    /// `C = Q' H^T`, rows of the reduced system.
    pub(super) kept: DMatrix<f64>,
    /// `C`, 3 x d by frame.
    pub(super) points: Vec<DMatrix<f64>>,
    /// `H C`, d x d.
    inner: DMatrix<f64>,
}

impl Transformation {
    /// Cost: a solve with the factor, and a look at all rays, for each motion.
    pub(super) fn new(
        onto_datum: STransformation,
        layout: &Layout,
        state: &State,
        normals: &Normals,
        factor: &Factor,
        monitor: &Monitor,
    ) -> Result<Self, Interrupted> {
        let STransformation { motions, h } = onto_datum;
        let d = motions.defect();
        let mut h_of_points: Vec<Option<&DMatrix<f64>>> = vec![None; state.points.len()];
        for (p, h) in &h {
            h_of_points[*p] = Some(h);
        }
        let mut right_side = DMatrix::zeros(layout.kept, d);
        for (frame, normal) in layout.frames.iter().zip(&normals.points) {
            monitor.check()?;
            let Some(h) = h_of_points[frame.point] else {
                continue;
            };
            add_to_right_side(&mut right_side, layout, frame, normal.as_ref(), h);
        }
        let kept = solved(layout, factor, &right_side, monitor)?;
        let frames = layout.frames.par_iter().zip(&normals.points);
        let points = frames.with_min_len(64).map(|(frame, normal)| {
            monitor.check()?;
            let h = h_of_points[frame.point];
            Ok(point_rows(layout, frame, normal.as_ref(), h, &kept))
        });
        let points: Vec<DMatrix<f64>> = points.collect::<Result<_, Interrupted>>()?;
        let mut inner = DMatrix::zeros(d, d);
        for (frame, c) in layout.frames.iter().zip(&points) {
            if let Some(h) = h_of_points[frame.point] {
                inner += h * c;
            }
        }
        Ok(Self {
            motions,
            kept,
            points,
            inner,
        })
    }

    /// `Q_ii = Q'_ii - G_i C_i^T - C_i G_i^T + G_i (H C) G_i^T` for the unknowns with rows `g`, `c` (n x d).
    pub(super) fn apply(
        &self,
        cofactor: &DMatrix<f64>,
        g: &DMatrix<f64>,
        c: &DMatrix<f64>,
    ) -> DMatrix<f64> {
        let cross = g * c.transpose();
        cofactor - &cross - cross.transpose() + g * &self.inner * g.transpose()
    }
}

/// `Q' R` over the reduced system for right sides `R`, a column each.
pub(super) fn solved(
    layout: &Layout,
    factor: &Factor,
    right_side: &DMatrix<f64>,
    monitor: &Monitor,
) -> Result<DMatrix<f64>, Interrupted> {
    let columns = (0..right_side.ncols()).into_par_iter().map(|k| {
        let column = right_side.column(k).into_owned();
        factor.solve(&layout.structure, &column, monitor)
    });
    let columns: Vec<_> = columns.collect::<Result<_, Interrupted>>()?;
    let mut kept = DMatrix::zeros(layout.kept, right_side.ncols());
    for (k, column) in columns.iter().enumerate() {
        kept.set_column(k, column);
    }
    Ok(kept)
}

/// Adds what the right side `h^T` (`h` is k x 3) of a point's own equations is in the reduced system.
pub(super) fn add_to_right_side(
    right_side: &mut DMatrix<f64>,
    layout: &Layout,
    frame: &PointFrame,
    normal: Option<&PointNormal>,
    h: &DMatrix<f64>,
) {
    match normal {
        Some(normal) => {
            for (k, row) in h.row_iter().enumerate() {
                let reduced = normal.inverse * Vector3::new(row[0], row[1], row[2]);
                for (y, &i) in normal.coupling.iter().zip(&frame.index) {
                    right_side[(i, k)] -= y.dot(&reduced);
                }
            }
        }
        None => {
            for (axis, at) in layout.kept_coordinates(frame.point) {
                let mut row = right_side.row_mut(at);
                row += h.column(axis).transpose();
            }
        }
    }
}

/// The rows of `Q' R` that belong to a point, from those of the reduced system; `h` as in [`add_to_right_side`] where `R` has
/// rows for this point.
pub(super) fn point_rows(
    layout: &Layout,
    frame: &PointFrame,
    normal: Option<&PointNormal>,
    h: Option<&DMatrix<f64>>,
    kept: &DMatrix<f64>,
) -> DMatrix<f64> {
    let d = kept.ncols();
    match normal {
        Some(normal) => {
            let mut rows = h.map_or_else(|| DMatrix::zeros(3, d), DMatrix::transpose);
            for (k, mut row) in rows.column_iter_mut().enumerate() {
                let mut right_side = Vector3::new(row[0], row[1], row[2]);
                let kept = kept.column(k);
                for (y, &i) in normal.coupling.iter().zip(&frame.index) {
                    right_side -= y * kept[i];
                }
                row.copy_from(&(normal.inverse * right_side));
            }
            rows
        }
        None => {
            let mut rows = DMatrix::zeros(3, d);
            for (axis, at) in layout.kept_coordinates(frame.point) {
                rows.set_row(axis, &kept.row(at));
            }
            rows
        }
    }
}
