//! The direct linear transformation: eleven parameters from six or more points.

use nalgebra::{DMatrix, Matrix3, Matrix3x4, Rotation3, SMatrix, Vector2, Vector3};

use super::IdealPoint;
use crate::geometry::Pose;

/// Settings of [`direct_linear_transformation`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DltSettings {
    /// Standard error of an image coordinate, mm: what the equations say below this noise is nothing. The default is a
    /// tenth of a 9 um pixel.
    pub image_sigma_mm: f64,
}

impl Default for DltSettings {
    fn default() -> Self {
        Self {
            image_sigma_mm: 9e-4,
        }
    }
}

/// What the eleven parameters hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DltSolution {
    /// The 3x4 matrix with `[x, y, 1] ~ P [X, Y, Z, 1]`, third row's first three entries of unit length, positive in front.
    pub matrix: Matrix3x4<f64>,
    /// Exterior orientation.
    pub pose: Pose,
    /// Principal distances along x and y, mm (a by-product, to be disregarded: weak for small devices).
    pub principal_distances: [f64; 2],
    /// Principal point x0, y0, mm (a by-product, to be disregarded).
    pub principal_point: [f64; 2],
    /// Root mean square residual of the eleven-parameter fit, mm per coordinate.
    pub rms_mm: f64,
    /// The twelve singular values of the normalised equations, falling; the last is the residual.
    pub singular_values: [f64; 12],
}

/// Why there is no direct linear transformation.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum DltError {
    /// Fewer than six points.
    #[error("the 11-parameter DLT needs 6 points, found {found}")]
    TooFewPoints {
        /// Points given.
        found: usize,
    },
    /// The points do not determine eleven parameters.
    #[error(
        "the points determine {rank} of the DLT's {needed} parameters: at least two must lie off the plane of the others"
    )]
    RankDeficient {
        /// Rank of the equations above the image noise: 8 for a flat set, 10 with one raised point.
        rank: usize,
        /// Eleven.
        needed: usize,
    },
    /// The solution has points on both sides of the camera or is mirrored: the pairs are wrong or the noise too large.
    #[error("the DLT's solution is no camera: {in_front} of {points} points lie in front of it")]
    NoCamera {
        /// Points in front.
        in_front: usize,
        /// Points given.
        points: usize,
    },
}

/// The 11-parameter DLT (Abdel-Aziz and Karara, 1971; normalised after Hartley and Zisserman, 2004, 7.1) and the pose in
/// it. All points count with equal weight.
///
/// # Errors
/// [`DltError`]: fewer than six points; a rank below eleven (a flat set has 8, one raised point makes it 10, for their
/// equations leave free where in its ray's direction the plane's complement goes); or a solution that is no camera.
pub fn direct_linear_transformation(
    points: &[IdealPoint],
    settings: &DltSettings,
) -> Result<DltSolution, DltError> {
    if points.len() < 6 {
        return Err(DltError::TooFewPoints {
            found: points.len(),
        });
    }
    let unusable = DltError::RankDeficient {
        rank: 0,
        needed: 11,
    };
    let frame = Normalisation::of(points).ok_or(unusable)?;
    let (singular_values, null) = null_vector(&design(points, &frame)).ok_or(unusable)?;
    // A perturbation of the image coordinates by sigma changes singular values by about its Frobenius norm, which is
    // sigma sqrt(2 n) times the object points' length of 2 in normalised coordinates; four times that is surely signal.
    let noise =
        settings.image_sigma_mm * frame.image_scale * 2.0 * (2.0 * points.len() as f64).sqrt();
    let threshold = (4.0 * noise / 12_f64.sqrt()).max(1e-10 * singular_values[0]);
    let rank = singular_values
        .iter()
        .filter(|s| **s > threshold)
        .count()
        .min(11);
    if rank < 11 {
        return Err(DltError::RankDeficient { rank, needed: 11 });
    }
    let matrix = frame.denormalised(&null).ok_or(unusable)?;
    decompose(&matrix, points, singular_values)
}

/// Shifts and scales of object and image that bring both to unit size.
struct Normalisation {
    object_centre: Vector3<f64>,
    object_scale: f64,
    image_centre: Vector2<f64>,
    image_scale: f64,
}

impl Normalisation {
    fn of(points: &[IdealPoint]) -> Option<Self> {
        let n = points.len() as f64;
        let object_centre = points.iter().map(|p| p.point).sum::<Vector3<f64>>() / n;
        let image_centre = points.iter().map(|p| p.ideal).sum::<Vector2<f64>>() / n;
        let object = points
            .iter()
            .map(|p| (p.point - object_centre).norm_squared())
            .sum::<f64>()
            / n;
        let image = points
            .iter()
            .map(|p| (p.ideal - image_centre).norm_squared())
            .sum::<f64>()
            / n;
        let (object_scale, image_scale) = ((3.0 / object).sqrt(), (2.0 / image).sqrt());
        (object_scale.is_finite() && image_scale.is_finite()).then_some(Self {
            object_centre,
            object_scale,
            image_centre,
            image_scale,
        })
    }

    fn denormalised(&self, matrix: &Matrix3x4<f64>) -> Option<Matrix3x4<f64>> {
        let s = self.image_scale;
        let (cx, cy) = (self.image_centre.x, self.image_centre.y);
        let image = Matrix3::new(s, 0.0, -s * cx, 0.0, s, -s * cy, 0.0, 0.0, 1.0).try_inverse()?;
        let mut object = SMatrix::<f64, 4, 4>::identity() * self.object_scale;
        object[(3, 3)] = 1.0;
        for k in 0..3 {
            object[(k, 3)] = -self.object_scale * self.object_centre[k];
        }
        Some(image * matrix * object)
    }
}

fn design(points: &[IdealPoint], frame: &Normalisation) -> DMatrix<f64> {
    let mut design = DMatrix::zeros(2 * points.len(), 12);
    for (row, p) in points.iter().enumerate() {
        let object = ((p.point - frame.object_centre) * frame.object_scale).push(1.0);
        let image = (p.ideal - frame.image_centre) * frame.image_scale;
        for k in 0..4 {
            design[(2 * row, k)] = object[k];
            design[(2 * row, 8 + k)] = -image.x * object[k];
            design[(2 * row + 1, 4 + k)] = object[k];
            design[(2 * row + 1, 8 + k)] = -image.y * object[k];
        }
    }
    design
}

/// The singular values, falling, and the vector of the smallest as a 3x4 matrix.
fn null_vector(design: &DMatrix<f64>) -> Option<([f64; 12], Matrix3x4<f64>)> {
    let svd = design.clone().try_svd(false, true, f64::EPSILON, 1000)?;
    let v_t = svd.v_t?;
    let mut values = [0.0; 12];
    for (value, found) in values.iter_mut().zip(svd.singular_values.iter()) {
        *value = *found;
    }
    let null = Matrix3x4::from_row_iterator(v_t.row(11).iter().copied());
    (values[0].is_finite() && null.norm() > 0.5).then_some((values, null))
}

/// `P = K' [M | -M X0]` with an upper triangular `K' = [[cx, s, -x0], [0, cy, -y0], [0, 0, -1]]` (photogrammetric signs).
fn decompose(
    matrix: &Matrix3x4<f64>,
    points: &[IdealPoint],
    singular_values: [f64; 12],
) -> Result<DltSolution, DltError> {
    let length = matrix.fixed_view::<1, 3>(2, 0).norm();
    let in_front = points
        .iter()
        .filter(|p| (matrix * p.point.push(1.0)).z > 0.0)
        .count();
    // The sign of P is free: the points decide it.
    let (sign, in_front) = if 2 * in_front >= points.len() {
        (1.0, in_front)
    } else {
        (-1.0, points.len() - in_front)
    };
    let no_camera = DltError::NoCamera {
        in_front,
        points: points.len(),
    };
    let matrix = matrix * (sign / length);
    let left: Matrix3<f64> = matrix.fixed_view::<3, 3>(0, 0).into_owned();
    // Positive depth w = -z / c fixes M's third row, and the determinant is negative for a camera that is no mirror.
    if in_front < points.len() || !(left.determinant() < 0.0) {
        return Err(no_camera);
    }
    let centre = -(left.try_inverse().ok_or(no_camera)? * matrix.column(3));
    let m3: Vector3<f64> = -left.row(2).transpose();
    let (p1, p2) = (left.row(0).transpose(), left.row(1).transpose());
    let y0 = p2.dot(&-m3);
    let second = p2 + y0 * m3;
    let m2 = second.normalize();
    let x0 = p1.dot(&-m3);
    let first = p1 + x0 * m3;
    let m1 = m2.cross(&m3);
    let rotation = Matrix3::from_rows(&[m1.transpose(), m2.transpose(), m3.transpose()]);
    let squares: f64 = points
        .iter()
        .map(|p| {
            let image = matrix * p.point.push(1.0);
            (Vector2::new(image.x / image.z, image.y / image.z) - p.ideal).norm_squared()
        })
        .sum();
    Ok(DltSolution {
        matrix,
        pose: Pose {
            camera_from_world: Rotation3::from_matrix_unchecked(rotation),
            centre_in_world: centre,
        },
        principal_distances: [first.dot(&m1), second.norm()],
        principal_point: [x0, y0],
        rms_mm: (squares / (2 * points.len()) as f64).sqrt(),
        singular_values,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::simulation::{self, Noise};

    fn ideal_points(points: &[[f64; 3]], pose: &Pose, noise: Noise, seed: u64) -> Vec<IdealPoint> {
        simulation::ideal_points(points, pose, noise, seed)
    }

    #[test]
    fn exact_points_give_the_exact_pose_and_interior() {
        for seed in 0..50 {
            let pose = simulation::station(seed);
            let points = ideal_points(&simulation::REFERENCE_CROSS, &pose, Noise(0.0), seed);
            let found = direct_linear_transformation(&points, &DltSettings::default()).unwrap();
            // The cross is small and six points are weak: rounding of 1e-15 grows by 10^5.
            assert!((found.pose.centre_in_world - pose.centre_in_world).norm() < 1e-6);
            let turn = found.pose.camera_from_world.matrix() - pose.camera_from_world.matrix();
            assert!(turn.norm() < 1e-9);
            assert!((found.principal_distances[0] - 20.0).abs() < 1e-7);
            assert!(found.principal_point[0].abs() + found.principal_point[1].abs() < 1e-7);
        }
    }

    #[test]
    fn the_rank_of_flat_sets_is_eight_and_of_one_raised_point_ten() {
        let mut flat = simulation::REFERENCE_CROSS;
        flat[0][2] = 0.0;
        flat[5][2] = 0.0;
        let mut one_raised = flat;
        one_raised[5][2] = 25.0;
        for seed in 0..50 {
            let pose = simulation::station(seed);
            for noise in [0.0, 0.05] {
                for (set, expected) in [(flat, 8), (one_raised, 10)] {
                    let points = ideal_points(&set, &pose, Noise(noise), seed);
                    let found = direct_linear_transformation(&points, &DltSettings::default());
                    assert_eq!(
                        found,
                        Err(DltError::RankDeficient {
                            rank: expected,
                            needed: 11
                        }),
                        "{seed} {noise}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_noisy_cross_gives_the_station_to_some_cm() {
        let mut errors = Vec::new();
        for seed in 0..200 {
            let pose = simulation::station(seed);
            let points = ideal_points(&simulation::REFERENCE_CROSS, &pose, Noise(0.05), seed);
            let found = direct_linear_transformation(&points, &DltSettings::default()).unwrap();
            errors.push((found.pose.centre_in_world - pose.centre_in_world).norm());
        }
        errors.sort_by(f64::total_cmp);
        // 8 to 20 mm at 1 m for noise of this size.
        assert!(errors[100] < 30.0, "{}", errors[100]);
    }

    #[test]
    fn mirrored_and_degenerate_points_are_errors() {
        let pose = simulation::station(4);
        let mut points = ideal_points(&simulation::REFERENCE_CROSS, &pose, Noise(0.0), 4);
        let settings = DltSettings::default();
        assert_eq!(
            direct_linear_transformation(&points[..5], &settings),
            Err(DltError::TooFewPoints { found: 5 })
        );
        assert!(direct_linear_transformation(&[points[0]; 7], &settings).is_err());
        for p in &mut points {
            p.point.z = -p.point.z;
        }
        assert!(matches!(
            direct_linear_transformation(&points, &settings),
            Err(DltError::NoCamera { .. } | DltError::RankDeficient { .. })
        ));
        points[0].ideal.x = f64::NAN;
        assert!(direct_linear_transformation(&points, &settings).is_err());
    }
}
