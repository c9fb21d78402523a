//! The circle whose images a target's ellipses are.
//!
//! To first order a circle of radius `r` and unit normal `n` is imaged as the ellipse with the matrix
//! `r^2 J (I - n n^T) J^T` of its semi-axes, `J` the derivative of the measured picture by the place (with the local scale
//! and shear of the lens). A measured ellipse `E = R diag(a^2, b^2) R^T` is compared with it in its own axes,
//! `D = diag(1/a, 1/b) R^T (r^2 J (I - n n^T) J^T) R diag(1/a, 1/b) - I`. The fit of an outline whose centre has the
//! standard deviation `sigma` gives radii with deviations of `sqrt(3/2) sigma` along an axis and `sigma` across them (the
//! zeroth and second harmonic of the outline beside its first), so that the three numbers `D11 a / (2 sqrt(3/2) sigma)`,
//! `D22 b / (2 sqrt(3/2) sigma)` and `D12 sqrt(a b) / (2 sigma)` are near to unit variance.
//!
//! One ellipse leaves two normals, mirrored at its ray. All these of all rays are tried, the one with the least sum of
//! absolute misfits is the start (one wrong ellipse does not move it), and Gauss-Newton with falling weights goes on.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, SMatrix, SymmetricEigen, Vector2, Vector3};

use super::median::median;
use crate::camera::Camera;
use crate::geometry::{Circle, Pose};

/// A target's ellipse in one picture.
#[derive(Clone, Copy, Debug)]
pub struct EllipseSight {
    /// Derivative of the picture by the place, in the ellipse's axes and in units of them, mm^-1.
    by_place: Matrix2x3<f64>,
    /// From the target to the camera, unit length.
    towards: Vector3<f64>,
    /// Standard deviations of the entries 11, 22 and 12 of `D`.
    sigmas: Vector3<f64>,
}

/// An ellipse as detection gives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredEllipse {
    /// Larger full diameter, px.
    pub major_px: f64,
    /// Smaller full diameter, px.
    pub minor_px: f64,
    /// Direction of the larger diameter from +x towards +y (down), rad.
    pub angle: f64,
    /// Standard deviation of its centre, px.
    pub sigma_px: f64,
}

/// A circle with the precision of its estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CircleEstimate {
    /// The circle; its normal points to the cameras.
    pub circle: Circle,
    /// Standard deviation of the normal's direction (the larger one), rad. Where its mirror image fits as well it is half
    /// the angle between the two.
    pub sigma_normal: f64,
    /// Standard deviation of the radius, mm.
    pub sigma_radius_mm: f64,
}

/// Misfits beyond this multiple of the robust scale lose weight.
const BEND: f64 = 3.0;

/// Steps of the iteration at most, and the step (rad, and share of the radius) at which it rests.
const STEPS: usize = 30;
const AT_REST: f64 = 1e-8;

/// Starts are taken from so many rays at most, evenly chosen.
const RAYS_FOR_STARTS: usize = 24;

/// The median length of three normal deviates (square root of the median of chi-square with three degrees of freedom).
const MEDIAN_LENGTH: f64 = 1.538;

/// The mirror image of a normal is refused when it fits worse by this, in variances: three sigmas.
const CLEARLY_WORSE: f64 = 9.0;

impl EllipseSight {
    /// `None` where the place is not imaged, or the ellipse has no size.
    #[must_use]
    pub fn new(
        camera: &Camera,
        pose: &Pose,
        place: &Vector3<f64>,
        ellipse: &MeasuredEllipse,
    ) -> Option<Self> {
        let projection = camera.project_with_jacobians(&pose.camera_from_point(place))?;
        let by_place = projection.by_point * pose.camera_from_world.matrix();
        let (a, b) = (ellipse.major_px / 2.0, ellipse.minor_px / 2.0);
        if !(a > 0.0 && b > 0.0 && ellipse.sigma_px > 0.0 && a.is_finite()) {
            return None;
        }
        let (sin, cos) = ellipse.angle.sin_cos();
        let into_axes = Matrix2::new(cos / a, sin / a, -sin / b, cos / b);
        let along = 1.5_f64.sqrt();
        Some(Self {
            by_place: into_axes * by_place,
            towards: (pose.centre_in_world - place).try_normalize(0.0)?,
            sigmas: Vector3::new(along / a, along / b, 1.0 / (a * b).sqrt())
                * (2.0 * ellipse.sigma_px),
        })
    }

    /// The three numbers of a symmetric matrix over their standard deviations.
    fn whitened(&self, d: &Matrix2<f64>) -> Vector3<f64> {
        Vector3::new(d[(0, 0)], d[(1, 1)], d[(0, 1)]).component_div(&self.sigmas)
    }

    /// The image of the disc with this normal and radius 1.
    fn image(&self, normal: &Vector3<f64>) -> Matrix2<f64> {
        let seen = self.by_place * normal;
        self.by_place * self.by_place.transpose() - seen * seen.transpose()
    }

    fn misfit(&self, normal: &Vector3<f64>, radius: f64) -> Vector3<f64> {
        self.whitened(&(self.image(normal) * (radius * radius) - Matrix2::identity()))
    }

    /// The two circles that this ellipse alone allows: within the plane across the ray `J = B U^T`, so that
    /// `B^-1 E B^-T = r^2 (I - m m^T)` with `m = U^T n`.
    fn alone(&self) -> Option<[Circle; 2]> {
        let side = self.towards.iamin();
        let first = self
            .towards
            .cross(&Vector3::ith(side, 1.0))
            .try_normalize(0.0)?;
        let across = SMatrix::<f64, 3, 2>::from_columns(&[first, self.towards.cross(&first)]);
        let back = (self.by_place * across).try_inverse()?;
        let eigen = SymmetricEigen::new(back * back.transpose());
        let (least, most) = (eigen.eigenvalues.imin(), eigen.eigenvalues.imax());
        let cos_squared = (eigen.eigenvalues[least] / eigen.eigenvalues[most]).clamp(0.0, 1.0);
        let tilt: Vector3<f64> =
            across * eigen.eigenvectors.column(least) * (1.0 - cos_squared).sqrt();
        let radius_mm = eigen.eigenvalues[most].sqrt();
        let circle = |side: f64| Circle {
            normal: tilt * side + self.towards * cos_squared.sqrt(),
            radius_mm,
        };
        radius_mm.is_finite().then(|| [circle(1.0), circle(-1.0)])
    }
}

/// The circle on which the ellipses agree; `None` for fewer than two, or where they leave it loose.
#[must_use]
pub fn estimate_circle(sights: &[EllipseSight]) -> Option<CircleEstimate> {
    if sights.len() < 2 {
        return None;
    }
    let stride = sights.len().div_ceil(RAYS_FOR_STARTS);
    let start = sights
        .iter()
        .step_by(stride)
        .filter_map(EllipseSight::alone)
        .flatten()
        .map(|circle| (sum_of_misfits(sights, &circle), circle))
        .min_by(|a, b| a.0.total_cmp(&b.0))?
        .1;
    let scale = robust_scale(sights, &start);
    let best = iterate(sights, start, scale)?;
    // The middle of the rays is the axis at which a normal and its mirror image look most alike.
    let middle = sights
        .iter()
        .map(|s| s.towards)
        .sum::<Vector3<f64>>()
        .try_normalize(0.0)?;
    let mirrored = Circle {
        normal: middle * (2.0 * middle.dot(&best.circle.normal)) - best.circle.normal,
        ..best.circle
    };
    let other = iterate(sights, mirrored, scale)
        .filter(|other| other.cost - best.cost < CLEARLY_WORSE)
        .map(|other| {
            let cosine = other.circle.normal.dot(&best.circle.normal).abs().min(1.0);
            cosine.acos() / 2.0
        });
    let covariance = best.normal_matrix.try_inverse()? * (scale * scale);
    let of_normal = covariance.fixed_view::<2, 2>(0, 0).into_owned();
    let sigma_normal = SymmetricEigen::new(of_normal).eigenvalues.max().sqrt();
    let side = best.circle.normal.dot(&middle).signum();
    Some(CircleEstimate {
        circle: Circle {
            normal: best.circle.normal * side,
            ..best.circle
        },
        sigma_normal: sigma_normal.max(other.unwrap_or(0.0)),
        sigma_radius_mm: best.circle.radius_mm * covariance[(2, 2)].sqrt(),
    })
}

/// The radius (mm) on which the ellipses agree where the normal is known: the median of what their larger axes say;
/// `None` without ellipses.
#[must_use]
pub fn estimate_radius(sights: &[EllipseSight], normal: &Vector3<f64>) -> Option<f64> {
    let radii = sights
        .iter()
        .map(|s| s.image(normal)[(0, 0)].powf(-0.5))
        .filter(|r| r.is_finite());
    median(radii.collect())
}

fn sum_of_misfits(sights: &[EllipseSight], circle: &Circle) -> f64 {
    let misfits = sights.iter();
    misfits
        .map(|s| s.misfit(&circle.normal, circle.radius_mm).norm())
        .sum()
}

/// The standard deviation of the misfits as one wrong ellipse cannot spoil it, at least the a-priori one.
fn robust_scale(sights: &[EllipseSight], circle: &Circle) -> f64 {
    let lengths = sights.iter();
    let lengths = lengths.map(|s| s.misfit(&circle.normal, circle.radius_mm).norm());
    (median(lengths.collect()).unwrap_or(0.0) / MEDIAN_LENGTH).max(1.0)
}

/// Where the iteration came to rest.
struct Rest {
    circle: Circle,
    /// Sum of the weighted squares in units of the scale.
    cost: f64,
    /// Of two turns of the normal and the logarithm of the radius.
    normal_matrix: Matrix3<f64>,
}

/// Gauss-Newton; weights fall with the square of the misfit beyond [`BEND`].
fn iterate(sights: &[EllipseSight], start: Circle, scale: f64) -> Option<Rest> {
    let mut circle = start;
    for _ in 0..STEPS {
        let turns = turns_of(&circle.normal)?;
        let (mut matrix, mut right, mut cost) = (Matrix3::zeros(), Vector3::zeros(), 0.0);
        for sight in sights {
            let squared = circle.radius_mm * circle.radius_mm;
            let misfit = sight.misfit(&circle.normal, circle.radius_mm);
            let length = misfit.norm() / scale;
            let weight = if length > BEND {
                (BEND / length).powi(2)
            } else {
                1.0
            };
            let seen: Vector2<f64> = sight.by_place * circle.normal;
            let by_turn = |turn: &Vector3<f64>| {
                let change = sight.by_place * turn;
                let product = change * seen.transpose();
                sight.whitened(&((product + product.transpose()) * -squared))
            };
            let by_radius = sight.whitened(&(sight.image(&circle.normal) * (2.0 * squared)));
            let rows = Matrix3::from_columns(&[by_turn(&turns[0]), by_turn(&turns[1]), by_radius]);
            matrix += rows.transpose() * rows * weight;
            right -= rows.transpose() * misfit * weight;
            cost += weight * length * length;
        }
        let step = matrix.cholesky()?.solve(&right);
        // A normal seen squarely from everywhere is loose at first order; it must not jump over the horizon.
        let step = step * (0.3 / step.norm()).min(1.0);
        circle = Circle {
            normal: (circle.normal + turns[0] * step[0] + turns[1] * step[1]).try_normalize(0.0)?,
            radius_mm: circle.radius_mm * step[2].exp(),
        };
        if step.norm() < AT_REST {
            return Some(Rest {
                circle,
                cost,
                normal_matrix: matrix,
            });
        }
    }
    None
}

/// Two directions across a normal.
fn turns_of(normal: &Vector3<f64>) -> Option<[Vector3<f64>; 2]> {
    let first = normal
        .cross(&Vector3::ith(normal.iamin(), 1.0))
        .try_normalize(0.0)?;
    Some([first, normal.cross(&first)])
}
