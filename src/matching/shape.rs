//! The circle whose images the ellipses are.
//!
//! A small disc of diameter `d` and normal `n` has the matrix `Q = d^2 (I - n n^T)`; a projection with derivative `J`
//! images it as the ellipse `J Q J^T = R diag(major^2, minor^2) R^T`. That is linear in the six numbers of `Q`, so the
//! ellipses of several views give it by least squares, without the sign ambiguity that a single ellipse has.

use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector3};

use super::problem::{IdentificationSettings, Member};
use super::sight::Sight;

/// `Q` of a target.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disc {
    pub(super) q: Matrix3<f64>,
    /// Unit normal towards the cameras.
    pub(super) normal: Vector3<f64>,
    pub(super) diameter_mm: f64,
}

/// Weight of the assumption that a disc faces the cameras' middle: settles what near views leave open, no more.
const FACING_WEIGHT: f64 = 0.02;

impl Disc {
    /// A disc of known diameter and normal.
    pub(super) fn known(diameter_mm: f64, normal: Vector3<f64>) -> Self {
        Self {
            q: (Matrix3::identity() - normal * normal.transpose()) * (diameter_mm * diameter_mm),
            normal,
            diameter_mm,
        }
    }

    /// The disc at `point` that the members' ellipses agree on best; `None` without two known ellipses.
    pub(super) fn fitted(
        sights: &[Sight],
        members: &[Member],
        point: &Vector3<f64>,
    ) -> Option<Self> {
        let mut normal_matrix = SMatrix::<f64, 6, 6>::zeros();
        let mut right = SVector::<f64, 6>::zeros();
        let mut towards = Vector3::zeros();
        let mut size = 0.0;
        let mut count = 0;
        for member in members {
            let sight = &sights[member.view];
            let Some(axes) = sight.dots[member.dot].squared_axes else {
                continue;
            };
            let scale = sight.pixels_per_mm(point);
            let seen = sight.sighting(point)?;
            let j = seen.by_point / scale;
            let e = axes / (scale * scale);
            for (row, column) in [(0, 0), (0, 1), (1, 1)] {
                let (a, b) = (j.row(row), j.row(column));
                #[rustfmt::skip]
                let line = SVector::<f64, 6>::from([
                    a[0] * b[0], a[1] * b[1], a[2] * b[2],
                    a[0] * b[1] + a[1] * b[0], a[0] * b[2] + a[2] * b[0], a[1] * b[2] + a[2] * b[1],
                ]);
                let weight = if row == column { 1.0 } else { 2.0 };
                normal_matrix += line * line.transpose() * weight;
                right += line * (e[(row, column)] * weight);
            }
            towards += (sight.centre - point).normalize();
            size += e.trace() / 2.0;
            count += 1;
        }
        if count < 2 || towards.norm() < 1e-9 {
            return None;
        }
        let towards = towards.normalize();
        let facing =
            (Matrix3::identity() - towards * towards.transpose()) * (size / f64::from(count));
        let prior = SVector::<f64, 6>::from([
            facing[(0, 0)],
            facing[(1, 1)],
            facing[(2, 2)],
            facing[(0, 1)],
            facing[(0, 2)],
            facing[(1, 2)],
        ]);
        let weight = FACING_WEIGHT * f64::from(count);
        normal_matrix += SMatrix::<f64, 6, 6>::identity() * weight;
        right += prior * weight;
        let s = normal_matrix.cholesky()?.solve(&right);
        let q = Matrix3::new(s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2]);
        let eigen = q.symmetric_eigen();
        let least = eigen.eigenvalues.imin();
        let normal: Vector3<f64> = eigen.eigenvectors.column(least).into_owned();
        let normal = if normal.dot(&towards) < 0.0 {
            -normal
        } else {
            normal
        };
        let squared = (q.trace() - eigen.eigenvalues[least]) / 2.0;
        (squared > 0.0).then(|| Self {
            q,
            normal,
            diameter_mm: squared.sqrt(),
        })
    }

    /// Whether the disc can be seen from `centre` at all.
    pub(super) fn faces(
        &self,
        point: &Vector3<f64>,
        centre: &Vector3<f64>,
        max_incidence: f64,
    ) -> bool {
        self.normal.dot(&(centre - point).normalize()) > max_incidence.cos()
    }

    /// Misfit of a dot's ellipse in units of what is allowed; 0 where its shape is not known.
    pub(super) fn misfit(
        &self,
        sight: &Sight,
        dot: usize,
        point: &Vector3<f64>,
        settings: &IdentificationSettings,
    ) -> f64 {
        let (Some(axes), Some(seen)) = (sight.dots[dot].squared_axes, sight.sighting(point)) else {
            return 0.0;
        };
        let predicted = seen.by_point * self.q * seen.by_point.transpose();
        let squared_size = largest(&axes).max(largest(&predicted)).max(1e-9);
        let allowed = settings.shape_tolerance * squared_size
            + 2.0 * settings.axis_tolerance_px * squared_size.sqrt();
        (axes - predicted).norm() / allowed
    }
}

/// Larger eigenvalue of a symmetric 2x2 matrix.
pub(super) fn largest(m: &Matrix2<f64>) -> f64 {
    let half = m.trace() / 2.0;
    let spread = ((m[(0, 0)] - m[(1, 1)]) / 2.0).hypot(m[(0, 1)]);
    half + spread
}
