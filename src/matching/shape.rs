//! The circle whose images the ellipses are.
//!
//! A small disc of diameter `d` and normal `n` has the matrix `Q = d^2 (I - n n^T)`; a projection with derivative `J`
//! images it as the ellipse `J Q J^T = R diag(major^2, minor^2) R^T`. That is linear in the six numbers of `Q`, so the
//! ellipses of several views give a start by least squares, without the sign ambiguity that a single ellipse has; a few steps of
//! Gauss and Newton then find the disc whose images they are.
//!
//! Ellipses are compared by the root of that matrix: its elements are lengths, px, which are measured equally well.

use nalgebra::{Matrix2, Matrix3, Rotation2, SMatrix, SVector, Vector2, Vector3};

use super::ellipses::EllipsePrecision;
use super::problem::{IdentificationSettings, Member};
use super::sight::{Sight, Sighting};

/// A circular target.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disc {
    /// Unit normal towards the cameras.
    pub(super) normal: Vector3<f64>,
    pub(super) diameter_mm: f64,
}

/// The ellipse of a dot.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeasuredAxes {
    /// The root of its matrix, px.
    pub(super) root: Matrix2<f64>,
    /// Standard deviation of the dot's centre, px.
    pub(super) centre_px: f64,
}

/// How exact ellipses are.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShapeNoise {
    /// Standard deviation of a diameter, px, besides what grows with it.
    axis_px: f64,
    /// As a share of the diameter.
    share: f64,
    /// As a multiple of the standard deviation of the dot's centre.
    by_centre: f64,
    /// How much larger all are in truth.
    pub(super) scale: f64,
}

impl ShapeNoise {
    /// Before anything is measured: blur and thresholds may differ from dot to dot.
    const UNKNOWN: f64 = 4.0;

    pub(super) fn unknown(settings: &IdentificationSettings) -> Self {
        Self {
            axis_px: settings.axis_sigma_px,
            share: settings.axis_share,
            by_centre: 0.0,
            scale: Self::UNKNOWN,
        }
    }

    /// As the dots that have names tell it.
    pub(super) fn told(precision: &EllipsePrecision) -> Self {
        Self {
            axis_px: precision.axis_px,
            share: precision.share,
            by_centre: precision.by_centre,
            scale: 1.0,
        }
    }

    fn variance(&self, dot: &MeasuredAxes) -> f64 {
        let size = dot.root.trace() / 2.0;
        let by_centre = (self.by_centre * dot.centre_px).powi(2);
        let own = self.axis_px * self.axis_px + (self.share * size).powi(2);
        self.scale * self.scale * (own + by_centre)
    }

    /// Squared standardised difference of a measured ellipse's root from a predicted one.
    pub(super) fn misfit(&self, measured: &MeasuredAxes, predicted: &Matrix2<f64>) -> f64 {
        (measured.root - predicted).norm_squared() / self.variance(measured)
    }
}

/// Weight of the assumption that a disc faces the cameras' middle: settles what near views leave open, no more.
const FACING_WEIGHT: f64 = 0.02;
/// Steps of Gauss and Newton from the linear start.
const STEPS: usize = 3;

/// A measured ellipse with the projection that made it.
struct Imaged {
    /// Derivative of the place by the world point, px/mm.
    by_point: nalgebra::Matrix2x3<f64>,
    axes: Matrix2<f64>,
    weight: f64,
}

impl Disc {
    /// The disc at `point` that the members' ellipses agree on best; `None` without two known ellipses.
    pub(super) fn fitted(
        sights: &[Sight],
        members: &[Member],
        point: &Vector3<f64>,
        noise: &ShapeNoise,
    ) -> Option<Self> {
        let mut imaged = Vec::with_capacity(members.len());
        let mut towards = Vector3::zeros();
        for member in members {
            let sight = &sights[member.view];
            let Some(axes) = sight.dots[member.dot].axes else {
                continue;
            };
            imaged.push(Imaged {
                by_point: sight.sighting(point)?.by_point,
                axes: axes.root,
                weight: 1.0 / noise.variance(&axes),
            });
            towards += (sight.centre - point).normalize();
        }
        if imaged.len() < 2 {
            return None;
        }
        let towards = towards.try_normalize(1e-9)?;
        let mut disc = linear(&imaged, &towards)?;
        for _ in 0..STEPS {
            disc.step(&imaged, &towards)?;
        }
        Some(disc)
    }

    /// Root of the matrix of its image.
    pub(super) fn image(&self, by_point: &nalgebra::Matrix2x3<f64>) -> Matrix2<f64> {
        let along = by_point * self.normal;
        let shape = by_point * by_point.transpose() - along * along.transpose();
        root(&shape) * self.diameter_mm
    }

    /// One step of Gauss and Newton: the normal turns about two axes across it, the diameter grows.
    fn step(&mut self, imaged: &[Imaged], towards: &Vector3<f64>) -> Option<()> {
        /// Difference for the derivatives, radians and share of the diameter.
        const DIFFERENCE: f64 = 1e-4;
        let across = if self.normal.x.abs() < 0.7 {
            Vector3::x()
        } else {
            Vector3::y()
        };
        let u = self.normal.cross(&across).normalize();
        let v = self.normal.cross(&u);
        let moved = |by: &Vector3<f64>| Self {
            normal: (self.normal + u * by.x + v * by.y).normalize(),
            diameter_mm: self.diameter_mm * by.z.exp(),
        };
        let mut normal_matrix = Matrix3::zeros();
        let mut right = Vector3::zeros();
        let variants: [Self; 3] = std::array::from_fn(|k| {
            let mut by = Vector3::zeros();
            by[k] = DIFFERENCE;
            moved(&by)
        });
        for one in imaged {
            let here = self.image(&one.by_point);
            let off = elements(&(one.axes - here));
            let by = variants.map(|d| elements(&((d.image(&one.by_point) - here) / DIFFERENCE)));
            for i in 0..3 {
                right[i] += one.weight * by[i].dot(&off);
                for j in 0..3 {
                    normal_matrix[(i, j)] += one.weight * by[i].dot(&by[j]);
                }
            }
        }
        // Where the ellipses leave the tilt open it is the cameras' middle.
        let slack = FACING_WEIGHT * imaged.len() as f64 / FACING_ANGLE.powi(2);
        for (k, axis) in [u, v].iter().enumerate() {
            normal_matrix[(k, k)] += slack;
            right[k] += slack * towards.dot(axis);
        }
        let mut step = normal_matrix.cholesky()?.solve(&right);
        let largest: f64 = step.amax();
        if !largest.is_finite() {
            return None;
        }
        if largest > LARGEST_STEP {
            step *= LARGEST_STEP / largest;
        }
        let next = moved(&step);
        if next.normal.dot(towards) <= 0.0 {
            return Some(());
        }
        *self = next;
        Some(())
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

    /// Squared standardised misfit of a dot's ellipse (chi-square, 3 degrees of freedom); 0 where its shape is not known.
    pub(super) fn misfit(
        &self,
        sight: &Sight,
        dot: usize,
        seen: &Sighting,
        noise: &ShapeNoise,
    ) -> f64 {
        sight.dots[dot]
            .axes
            .map_or(0.0, |axes| noise.misfit(&axes, &self.image(&seen.by_point)))
    }
}

/// Standard deviation of the assumption that a disc faces the cameras, radians.
const FACING_ANGLE: f64 = 1.0;
/// Longest step, radians and share of the diameter.
const LARGEST_STEP: f64 = 0.3;

/// The disc by linear least squares over the six numbers of `Q`.
fn linear(imaged: &[Imaged], towards: &Vector3<f64>) -> Option<Disc> {
    let mut normal_matrix = SMatrix::<f64, 6, 6>::zeros();
    let mut right = SVector::<f64, 6>::zeros();
    let mut size = 0.0;
    for one in imaged {
        let scale = (one.by_point.norm_squared() / 2.0).sqrt();
        let j = one.by_point / scale;
        let e = one.axes * one.axes / (scale * scale);
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
        size += e.trace() / 2.0;
    }
    let count = imaged.len() as f64;
    let facing = (Matrix3::identity() - towards * towards.transpose()) * (size / count);
    let prior = SVector::<f64, 6>::from([
        facing[(0, 0)],
        facing[(1, 1)],
        facing[(2, 2)],
        facing[(0, 1)],
        facing[(0, 2)],
        facing[(1, 2)],
    ]);
    let weight = FACING_WEIGHT * count;
    normal_matrix += SMatrix::<f64, 6, 6>::identity() * weight;
    right += prior * weight;
    let s = normal_matrix.cholesky()?.solve(&right);
    let q = Matrix3::new(s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2]);
    let eigen = q.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let normal: Vector3<f64> = eigen.eigenvectors.column(least).into_owned();
    let normal = if normal.dot(towards) < 0.0 {
        -normal
    } else {
        normal
    };
    let squared = (q.trace() - eigen.eigenvalues[least]) / 2.0;
    (squared > 0.0).then(|| Disc {
        normal,
        diameter_mm: squared.sqrt(),
    })
}

/// The elements of a symmetric matrix as a vector of the same norm.
fn elements(m: &Matrix2<f64>) -> Vector3<f64> {
    Vector3::new(m[(0, 0)], m[(1, 1)], std::f64::consts::SQRT_2 * m[(0, 1)])
}

/// The matrix of an ellipse: its eigenvalues are the squares of the full diameters, the larger one in the direction `angle` (radians).
pub(super) fn matrix_of(major_px: f64, minor_px: f64, angle: f64) -> Matrix2<f64> {
    let turn = Rotation2::new(angle);
    let squares = Vector2::new(major_px * major_px, minor_px * minor_px);
    turn.matrix() * Matrix2::from_diagonal(&squares) * turn.matrix().transpose()
}

/// The root of a symmetric matrix without negative eigenvalues.
pub(super) fn root(m: &Matrix2<f64>) -> Matrix2<f64> {
    let product = m.determinant().max(0.0).sqrt();
    let sum = (m.trace().max(0.0) + 2.0 * product).sqrt();
    if sum > 1e-12 {
        (m + Matrix2::identity() * product) / sum
    } else {
        Matrix2::zeros()
    }
}

/// Larger eigenvalue of a symmetric 2x2 matrix.
pub(super) fn largest(m: &Matrix2<f64>) -> f64 {
    let half = m.trace() / 2.0;
    let spread = ((m[(0, 0)] - m[(1, 1)]) / 2.0).hypot(m[(0, 1)]);
    half + spread
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_root_squared_is_the_matrix() {
        let m = Matrix2::new(5.0, 1.5, 1.5, 2.0);
        let r = root(&m);
        assert!((r * r - m).norm() < 1e-12);
        assert_eq!(root(&Matrix2::zeros()), Matrix2::zeros());
    }
}
