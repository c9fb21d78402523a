//! Poses of flat (or nearly flat) point sets with the nominal principal distance.
//!
//! Under nearly parallel projection a small plane and its mirror image in the plane across the line of sight look the
//! same, so there are two poses; which of them is true only reprojection (or another picture) can tell.

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::refine::{IdealFit, IdealPoint, refine_on_ideal_points, turn_between};
use super::three_point_poses;
use crate::geometry::{
    HomographyError, Plane, PlaneError, PlanePair, Pose, fit_homography, fit_plane,
};

/// Two poses are one if they differ by less than this angle, radians (0.06 degrees): refinement ends within 1e-9.
const SAME_POSE: f64 = 1e-3;

/// A pose with its misfit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NominalPose {
    /// The pose.
    pub pose: Pose,
    /// Root mean square residual, mm in the image per coordinate.
    pub rms_mm: f64,
}

/// Why a flat set gives no pose.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PlanePoseError {
    /// Fewer than four points.
    #[error("a pose from a plane needs 4 points, found {found}")]
    TooFewPoints {
        /// Points given.
        found: usize,
    },
    /// The object points are not flat.
    #[error(
        "the points are not flat: they lie {rms_mm:.3} mm rms off their best plane, {spread_mm:.1} mm wide"
    )]
    NotFlat {
        /// Distance from the best plane, mm rms.
        rms_mm: f64,
        /// Smaller spread in the plane, mm rms.
        spread_mm: f64,
    },
    /// The points have no best plane.
    #[error(transparent)]
    Plane(#[from] PlaneError),
    /// The image points have no homography with the plane.
    #[error(transparent)]
    Homography(#[from] HomographyError),
    /// No pose has all points in front of the camera.
    #[error("no pose has all {points} points in front of the camera")]
    NoPose {
        /// Points given.
        points: usize,
    },
}

/// Both poses of a flat point set with principal distance `c` (mm), each refined by collinearity, the one with the
/// smaller residuals first; one only where both lead to the same.
///
/// The first comes from the homography of the plane; the second starts from its reflection in the plane across the line
/// of sight (the second minimum of Schweighofer and Pinz, 2006). Points up to 1 % of their spread off their plane
/// count as flat: the refinement uses their true places.
///
/// # Errors
/// [`PlanePoseError`].
pub fn plane_poses(points: &[IdealPoint], c: f64) -> Result<Vec<NominalPose>, PlanePoseError> {
    if points.len() < 4 {
        return Err(PlanePoseError::TooFewPoints {
            found: points.len(),
        });
    }
    let object: Vec<Vector3<f64>> = points.iter().map(|p| p.point).collect();
    let fit = fit_plane(&object)?;
    if fit.rms > 0.01 * fit.spread[1] {
        return Err(PlanePoseError::NotFlat {
            rms_mm: fit.rms,
            spread_mm: fit.spread[1],
        });
    }
    let starts = homography_poses(points, &fit.plane, c)?;
    let poses = refined_poses(points, c, &starts);
    if poses.is_empty() {
        return Err(PlanePoseError::NoPose {
            points: points.len(),
        });
    }
    Ok(poses)
}

/// All poses of a point set of any shape with nominal principal distance `c` (mm), refined, best first: for reference
/// devices that are flat or have raised dots.
///
/// Starts are both poses of the plane that holds most points, if four do, otherwise the three-point poses of all triples.
///
/// # Errors
/// [`PlanePoseError`].
pub fn poses_with_nominal_camera(
    points: &[IdealPoint],
    c: f64,
) -> Result<Vec<NominalPose>, PlanePoseError> {
    if points.len() < 4 {
        return Err(PlanePoseError::TooFewPoints {
            found: points.len(),
        });
    }
    let mut starts = Vec::new();
    let flat = dominant_plane(points);
    if let Some((plane, members)) = &flat {
        let chosen: Vec<IdealPoint> = members.iter().map(|&k| points[k]).collect();
        if let Ok(found) = homography_poses(&chosen, plane, c) {
            starts.extend(found);
        }
    }
    if starts.is_empty() {
        starts = triple_poses(points, c);
    }
    let mut poses = refined_poses(points, c, &starts);
    if poses.is_empty() {
        poses = refined_poses(points, c, &triple_poses(points, c));
    }
    if poses.is_empty() {
        return Err(PlanePoseError::NoPose {
            points: points.len(),
        });
    }
    Ok(poses)
}

/// The plane through three of the points that holds most of them within 1 % of their extent, if it holds four.
fn dominant_plane(points: &[IdealPoint]) -> Option<(Plane, Vec<usize>)> {
    let mut best: Option<(Plane, Vec<usize>)> = None;
    let n = points.len().min(24);
    let extent = points
        .iter()
        .map(|p| (p.point - points[0].point).norm())
        .fold(0.0, f64::max);
    for i in 0..n {
        for j in i + 1..n {
            for k in j + 1..n {
                let Some(plane) =
                    Plane::through(&points[i].point, &points[j].point, &points[k].point)
                else {
                    continue;
                };
                let members: Vec<usize> = (0..points.len())
                    .filter(|&m| plane.height(&points[m].point).abs() < 0.01 * extent)
                    .collect();
                if members.len() >= 4 && best.as_ref().is_none_or(|b| members.len() > b.1.len()) {
                    best = Some((plane, members));
                }
            }
        }
    }
    best
}

/// The pose of a plane's homography and its reflection, neither refined.
fn homography_poses(
    points: &[IdealPoint],
    plane: &Plane,
    c: f64,
) -> Result<Vec<Pose>, PlanePoseError> {
    let pairs: Vec<PlanePair> = points
        .iter()
        .map(|p| PlanePair {
            source: plane.coordinates(&p.point),
            target: p.ideal,
        })
        .collect();
    let homography = fit_homography(&pairs)?;
    let none = PlanePoseError::NoPose {
        points: points.len(),
    };
    // [x, y, -c] ~ [m1 m2 t] [X, Y, 1], in front where the third coordinate is negative, as it is at the centroid.
    let rays = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -c)) * homography;
    let scale = 2.0 / (rays.column(0).norm() + rays.column(1).norm());
    let translation: Vector3<f64> = rays.column(2) * scale;
    let axes = orthonormalised(&(rays.column(0) * scale), &(rays.column(1) * scale)).ok_or(none)?;
    let first = pose_of_plane(&axes, &translation, plane);
    let centre = points
        .iter()
        .map(|p| first.camera_from_point(&p.point))
        .sum::<Vector3<f64>>();
    let centre = centre / points.len() as f64;
    let sight = centre.normalize();
    // Mirrored across the line of sight, the points' centroid stays where it is.
    let mirror = Matrix3::identity() - 2.0 * sight * sight.transpose();
    let axes = [mirror * axes[0], mirror * axes[1]];
    let translation = centre + mirror * (translation - centre);
    let second = pose_of_plane(&axes, &translation, plane);
    Ok(vec![first, second])
}

/// The two orthonormal vectors nearest to a pair.
fn orthonormalised(a: &Vector3<f64>, b: &Vector3<f64>) -> Option<[Vector3<f64>; 2]> {
    let sum = (a.normalize() + b.normalize()).normalize();
    let difference = (a.normalize() - b.normalize()).normalize();
    let axes = [
        (sum + difference).normalize(),
        (sum - difference).normalize(),
    ];
    axes.iter().flatten().all(|x| x.is_finite()).then_some(axes)
}

/// The pose of a camera that sees the plane's axes as `axes` and its centre at `translation`.
fn pose_of_plane(axes: &[Vector3<f64>; 2], translation: &Vector3<f64>, plane: &Plane) -> Pose {
    let seen = Matrix3::from_columns(&[axes[0], axes[1], axes[0].cross(&axes[1])]);
    let object = Matrix3::from_columns(&[plane.axes[0], plane.axes[1], plane.normal]);
    let rotation = Rotation3::from_matrix_unchecked(seen * object.transpose());
    Pose {
        camera_from_world: rotation,
        centre_in_world: plane.centre - rotation.inverse() * translation,
    }
}

fn triple_poses(points: &[IdealPoint], c: f64) -> Vec<Pose> {
    let n = points.len().min(8);
    let mut poses = Vec::new();
    for i in 0..n {
        for j in i + 1..n {
            for k in j + 1..n {
                let triple = [points[i], points[j], points[k]];
                poses.extend(three_point_poses(
                    &triple.map(|p| p.ideal.push(-c)),
                    &triple.map(|p| p.point),
                ));
            }
        }
    }
    poses
}

/// The distinct poses that refinement from the starts ends at, best first.
fn refined_poses(points: &[IdealPoint], c: f64, starts: &[Pose]) -> Vec<NominalPose> {
    let mut poses: Vec<NominalPose> = Vec::new();
    for start in starts {
        let Ok(IdealFit { pose, rms_mm }) = refine_on_ideal_points(points, c, start) else {
            continue;
        };
        let known = poses
            .iter()
            .any(|p| turn_between(&p.pose, &pose) < SAME_POSE);
        if !known {
            poses.push(NominalPose { pose, rms_mm });
        }
    }
    poses.sort_by(|a, b| a.rms_mm.total_cmp(&b.rms_mm));
    poses
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::simulation::{self, Noise};
    use nalgebra::Vector2;

    const FLAT: [[f64; 3]; 5] = [
        [100.0, 0.0, 0.0],
        [-100.0, 0.0, 0.0],
        [0.0, 100.0, 0.0],
        [0.0, -100.0, 0.0],
        [50.0, 50.0, 0.0],
    ];

    #[test]
    fn the_true_pose_of_an_exact_plane_comes_first() {
        for seed in 0..100 {
            let pose = simulation::station(seed);
            let points = simulation::ideal_points(&FLAT, &pose, Noise(0.0), seed);
            for count in 4..=5 {
                let found = plane_poses(&points[..count], 20.0).unwrap();
                assert!(found.len() <= 2);
                assert!(
                    (found[0].pose.centre_in_world - pose.centre_in_world).norm() < 1e-6,
                    "{seed}"
                );
                assert!(found[0].rms_mm < 1e-12);
            }
        }
    }

    #[test]
    fn with_noise_the_true_pose_is_one_of_the_two() {
        let mut second = 0;
        for seed in 0..200 {
            let pose = simulation::station(seed);
            // A small plane far off: 60 mm at 1 m, where the tilt's sign hangs on the noise.
            let small = FLAT.map(|p| p.map(|x| 0.3 * x));
            let points = simulation::ideal_points(&small, &pose, Noise(0.1), seed);
            let found = plane_poses(&points, 20.0).unwrap();
            let turn = |p: &NominalPose| turn_between(&p.pose, &pose);
            let nearest = found.iter().map(turn).fold(f64::INFINITY, f64::min);
            // 0.1 px of 350 px: 0.02 degrees, but near a frontal view the tilt is the root of that.
            assert!(nearest < 0.2, "{seed}: {nearest}");
            second += usize::from(found.len() == 2);
        }
        assert!(second > 120, "{second}");
    }

    #[test]
    fn raised_dots_decide_the_tilt() {
        let mut one_raised = FLAT.to_vec();
        one_raised.push([0.0, 0.0, 40.0]);
        for set in [one_raised, simulation::REFERENCE_CROSS.to_vec()] {
            let mut undecided = 0;
            for seed in 0..100 {
                let pose = simulation::station(seed);
                let points = simulation::ideal_points(&set, &pose, Noise(0.1), seed);
                let found = poses_with_nominal_camera(&points, 20.0).unwrap();
                assert!(
                    (found[0].pose.centre_in_world - pose.centre_in_world).norm() < 15.0,
                    "{seed}"
                );
                undecided += usize::from(
                    found
                        .get(1)
                        .is_some_and(|p| p.rms_mm < 3.0 * found[0].rms_mm),
                );
            }
            // Seldom the raised dot lies where both poses put it.
            assert!(undecided <= 5, "{undecided}");
        }
    }

    #[test]
    fn degenerate_sets_are_errors() {
        let pose = simulation::station(2);
        let points = simulation::ideal_points(&simulation::REFERENCE_CROSS, &pose, Noise(0.0), 2);
        assert!(matches!(
            plane_poses(&points, 20.0),
            Err(PlanePoseError::NotFlat { .. })
        ));
        assert!(matches!(
            plane_poses(&points[..3], 20.0),
            Err(PlanePoseError::TooFewPoints { found: 3 })
        ));
        assert!(plane_poses(&[points[0]; 5], 20.0).is_err());
        assert!(poses_with_nominal_camera(&[points[0]; 5], 20.0).is_err());
        let mut wrong = points.clone();
        wrong[0].ideal = Vector2::new(f64::NAN, 0.0);
        assert!(poses_with_nominal_camera(&wrong, 20.0).is_err());
    }
}
