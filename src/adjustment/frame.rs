//! The frame of the result: the S-transformation of all cofactors onto the datum and on into the coordinate system of
//! three points, and the finite motion of the estimates.

use nalgebra::{DMatrix, Matrix3, Matrix6, Vector3};

use super::datum::FreeMotions;
use super::equations::State;
use super::layout::Layout;
use super::{Adjustment, AdjustmentError, BundleProblem};
use crate::geometry::{Similarity, ThreeTwoOne};

/// `S = I - G H`.
pub(super) struct STransformation {
    /// `G`: the motions that no observation notices; with a frame by three points the six rigid motions before them.
    pub(super) motions: FreeMotions,
    /// `H` by point that it reads, a row a motion, in the order of the points.
    pub(super) h: Vec<(usize, DMatrix<f64>)>,
}

impl STransformation {
    /// Onto the datum points, `H = (G^T E G)^-1 G^T E`, and with a frame by three points from there by the rigid motions
    /// `G_r` with `H_r = (B^T G_r)^-1 B^T`, where `B` holds the six functionals of the frame:
    /// `(I - G_r H_r)(I - G H) = I - [G_r, G] [H_r (I - G H); H]`.
    ///
    /// # Errors
    /// Datum points or frame points that do not determine what they are to hold.
    pub(super) fn new(
        free: FreeMotions,
        problem: &BundleProblem,
        layout: &Layout,
        state: &State,
    ) -> Result<Self, AdjustmentError> {
        let onto_datum = free.s_transformation(layout, state)?;
        let onto_datum: Vec<_> = layout
            .datum_points
            .iter()
            .copied()
            .zip(onto_datum)
            .collect();
        let Some(frame) = &problem.frame else {
            return Ok(Self {
                motions: free,
                h: onto_datum,
            });
        };
        let into_frame = rigid_part(frame, &free, layout, state)?;
        let d = free.defect();
        // H_r G: how far the frame's functionals are moved by the free motions.
        let mut moved = DMatrix::zeros(6, d);
        for (p, h) in &into_frame {
            moved += h * free.rows_of_point(*p, layout, state);
        }
        let mut points: Vec<usize> = onto_datum
            .iter()
            .chain(&into_frame)
            .map(|(p, _)| *p)
            .collect();
        points.sort_unstable();
        points.dedup();
        let of = |list: &[(usize, DMatrix<f64>)], point: usize| {
            let place = list.binary_search_by_key(&point, |(p, _)| *p).ok()?;
            Some(list[place].1.clone())
        };
        let h = points
            .into_iter()
            .map(|p| {
                let mut rows = DMatrix::zeros(6 + d, 3);
                if let Some(h) = of(&into_frame, p) {
                    rows.rows_mut(0, 6).copy_from(&h);
                }
                if let Some(h) = of(&onto_datum, p).filter(|_| d > 0) {
                    let mut rigid = rows.rows_mut(0, 6);
                    rigid -= &moved * &h;
                    rows.rows_mut(6, d).copy_from(&h);
                }
                (p, rows)
            })
            .collect();
        Ok(Self {
            motions: free.after_rigid(),
            h,
        })
    }
}

/// `H_r = (B^T G_r)^-1 B^T` of the six rigid motions, 6 x 3 by frame point, in the order of the points. The functionals
/// are the held coordinates along the directions of the frame.
fn rigid_part(
    frame: &ThreeTwoOne<usize>,
    free: &FreeMotions,
    layout: &Layout,
    state: &State,
) -> Result<Vec<(usize, DMatrix<f64>)>, AdjustmentError> {
    for (&point, _) in frame.held() {
        if !layout.takes_part(point) {
            return Err(AdjustmentError::FramePoint { point });
        }
    }
    let motion = frame.map(|p| state.points[*p]).motion()?;
    let directions = motion.rotation.matrix();
    let functionals: Vec<(usize, DMatrix<f64>)> = frame
        .held()
        .into_iter()
        .map(|(p, axes)| {
            let rows = DMatrix::from_fn(axes.len(), 3, |i, k| directions[(axes[i], k)]);
            (*p, rows)
        })
        .collect();
    let rigid = free.rigid();
    let mut system = DMatrix::zeros(6, 6);
    let mut at = 0;
    for (p, b) in &functionals {
        let rows = b * rigid.point_rows(&state.points[*p]);
        system.rows_mut(at, b.nrows()).copy_from(&rows);
        at += b.nrows();
    }
    // The motion exists, so the three points are spread and the system is regular.
    let inverse = system
        .try_inverse()
        .ok_or(AdjustmentError::FramePoint { point: frame.plane })?;
    let mut at = 0;
    let mut h = Vec::new();
    for (p, b) in functionals {
        h.push((p, inverse.columns(at, b.nrows()) * &b));
        at += b.nrows();
    }
    h.sort_by_key(|(p, _)| *p);
    Ok(h)
}

/// Moves estimates and covariances, which are those of the new place's datum already.
pub(super) fn move_adjustment(adjustment: &mut Adjustment, motion: &Similarity) {
    let by_old = motion.scale * motion.rotation.matrix();
    for point in &mut adjustment.points {
        point.position = motion.apply(&point.position);
        point.circle = point.circle.map(|circle| circle.moved(motion));
        point.covariance = point.covariance.map(|q| turned(&by_old, &q));
    }
    for station in &mut adjustment.stations {
        move_station(motion, &mut station.pose);
        // The turn is counted in the camera frame, which does not move.
        let mut of_station = Matrix6::identity();
        of_station.fixed_view_mut::<3, 3>(3, 3).copy_from(&by_old);
        let covariance = of_station * station.covariance * of_station.transpose();
        station.covariance = (covariance + covariance.transpose()) / 2.0;
        station.with_camera = of_station * station.with_camera;
    }
    for observation in &mut adjustment.observations {
        observation.influence_mm_per_px *= motion.scale;
    }
}

/// What the frame holds is zero; what stands there is rounding.
pub(super) fn hold(frame: &ThreeTwoOne<usize>, adjustment: &mut Adjustment) {
    for (p, axes) in frame.held() {
        let point = &mut adjustment.points[*p];
        for axis in axes {
            point.position[axis] = 0.0;
            if let Some(covariance) = &mut point.covariance {
                covariance.row_mut(axis).fill(0.0);
                covariance.column_mut(axis).fill(0.0);
            }
        }
    }
}

fn turned(rotation: &Matrix3<f64>, covariance: &Matrix3<f64>) -> Matrix3<f64> {
    let turned = rotation * covariance * rotation.transpose();
    (turned + turned.transpose()) / 2.0
}

fn move_station(motion: &Similarity, pose: &mut crate::geometry::Pose) {
    pose.centre_in_world = motion.apply(&pose.centre_in_world);
    pose.camera_from_world *= motion.rotation.inverse();
    *pose = pose.moved(&Vector3::zeros(), &Vector3::zeros());
}
