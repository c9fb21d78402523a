//! The closed-form resection of Hattori et al. (2002, equations 1-12): each coded target gives its own scale under
//! parallel projection, which turns image points into points of space, and a rotation fits them onto the object.

use nalgebra::{Matrix2, Matrix3, Rotation3, Vector2, Vector3};

use crate::geometry::Pose;

/// A coded target in the image and in the object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CodeView {
    /// Ideal image point of the origin dot O, mm.
    pub o: Vector2<f64>,
    /// Ideal image point of the axis dot A, mm.
    pub a: Vector2<f64>,
    /// Ideal image point of the axis dot B, mm.
    pub b: Vector2<f64>,
    /// Object point of O, mm.
    pub object: Vector3<f64>,
}

/// What the rotation rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RotationGround {
    /// Codes in space: all three singular values carry information.
    Spatial,
    /// Three codes, or all codes in one plane: the third singular value is nearly zero, and the determinant alone decides
    /// between the rotation and its reflection.
    Flat,
}

/// The pose of [`resect_by_similarity`].
#[derive(Clone, Debug, PartialEq)]
pub struct SimilarityResection {
    /// The pose, some cm and a degree from the truth: a start for the collinearity refinement.
    pub pose: Pose,
    /// What the rotation rests on.
    pub ground: RotationGround,
    /// Image scale of each code: image distance over object distance.
    pub scales: Vec<f64>,
    /// Discrepancy of each code in object space (equation 7), mm.
    pub discrepancies_mm: Vec<f64>,
    /// Their root mean square, mm.
    pub rms_mm: f64,
}

/// Why the codes give no pose.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SimilarityError {
    /// Fewer than three codes.
    #[error("the closed-form resection needs 3 codes with known places, found {found}")]
    TooFewCodes {
        /// Codes given.
        found: usize,
    },
    /// Dots of a code coincide, so it has no scale.
    #[error("the dots O, A, B of code {index} do not span an image")]
    NoScale {
        /// Index of the code.
        index: usize,
    },
    /// The codes lie on one line (or in one place).
    #[error("the codes lie on one line, so the camera may turn about it")]
    Collinear,
}

/// The pose from three or more coded targets, without approximations (Hattori et al., 2002, equations 1-12).
///
/// `side_mm` is the distance S of O from A and from B (six pitches), `c` the principal distance, mm. The scale of a code
/// is the larger singular value of the map from its plane to the plane across the line of sight: foreshortening shrinks one
/// direction only, so the formula holds for any tilt (equations 3 and 4 hold for one direction of it).
///
/// # Errors
/// [`SimilarityError`].
pub fn resect_by_similarity(
    codes: &[CodeView],
    side_mm: f64,
    c: f64,
) -> Result<SimilarityResection, SimilarityError> {
    if codes.len() < 3 {
        return Err(SimilarityError::TooFewCodes { found: codes.len() });
    }
    let mut scales = Vec::with_capacity(codes.len());
    for (index, code) in codes.iter().enumerate() {
        scales.push(code_scale(code, side_mm, c).ok_or(SimilarityError::NoScale { index })?);
    }
    let in_camera: Vec<Vector3<f64>> = codes
        .iter()
        .zip(&scales)
        .map(|(code, scale)| code.o.push(-c) / *scale)
        .collect();
    let n = codes.len() as f64;
    let object_centre = codes.iter().map(|code| code.object).sum::<Vector3<f64>>() / n;
    let camera_centre = in_camera.iter().sum::<Vector3<f64>>() / n;
    let mut correlation = Matrix3::zeros();
    for (code, seen) in codes.iter().zip(&in_camera) {
        correlation += (seen - camera_centre) * (code.object - object_centre).transpose();
    }
    let (rotation, ground) = best_rotation(&correlation)?;
    let pose = Pose {
        camera_from_world: rotation,
        centre_in_world: object_centre - rotation.inverse() * camera_centre,
    };
    let discrepancies_mm: Vec<f64> = codes
        .iter()
        .zip(&in_camera)
        .map(|(code, seen)| (seen - pose.camera_from_point(&code.object)).norm())
        .collect();
    let squares: f64 = discrepancies_mm.iter().map(|d| d * d).sum();
    Ok(SimilarityResection {
        pose,
        ground,
        scales,
        discrepancies_mm,
        rms_mm: (squares / n).sqrt(),
    })
}

/// The image scale of a code under parallel projection along the line of sight to O (equations 1 and 2 with
/// `tan alpha = x0 / y0`); `None` where its dots coincide.
fn code_scale(code: &CodeView, side_mm: f64, c: f64) -> Option<f64> {
    let radius = code.o.norm();
    let (sin, cos) = code.o.x.atan2(code.o.y).sin_cos();
    let cos_beta = c / radius.hypot(c);
    let across_sight = |p: &Vector2<f64>| {
        let (x, y) = (p.x * cos - p.y * sin, p.x * sin + p.y * cos);
        Vector2::new(x, (radius - y) * cos_beta)
    };
    let map = Matrix2::from_columns(&[across_sight(&code.a), across_sight(&code.b)]) / side_mm;
    // The larger singular value from trace and determinant of the map's square.
    let squares = map.norm_squared();
    let determinant = map.determinant();
    let larger2 = 0.5
        * (squares
            + (squares * squares - 4.0 * determinant * determinant)
                .max(0.0)
                .sqrt());
    (larger2.is_finite() && larger2 > 0.0).then(|| larger2.sqrt())
}

/// The rotation with the largest `trace(M^T C)` (equations 8-11; the determinant keeps it from being a reflection).
fn best_rotation(
    correlation: &Matrix3<f64>,
) -> Result<(Rotation3<f64>, RotationGround), SimilarityError> {
    if !correlation.iter().all(|x| x.is_finite()) {
        return Err(SimilarityError::Collinear);
    }
    let svd = correlation.svd(true, true);
    let (Some(v), Some(w_t)) = (svd.u, svd.v_t) else {
        return Err(SimilarityError::Collinear);
    };
    let values = svd.singular_values;
    // Errors of 1 % in the scales lift the second value of a line to some 1e-3 of the first; a line within 1e-6 is one.
    if !(values[1] > 1e-6 * values[0]) {
        return Err(SimilarityError::Collinear);
    }
    // Three codes or a plane leave rounding in the third value (times the second's size in noisy flat sets).
    let ground = if values[2] > 1e-9 * values[0] {
        RotationGround::Spatial
    } else {
        RotationGround::Flat
    };
    let sign = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (v * w_t).determinant().signum()));
    Ok((Rotation3::from_matrix_unchecked(v * sign * w_t), ground))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::refine::turn_between;
    use crate::orientation::simulation;
    use rand::RngExt;

    const SIDE: f64 = 30.0;

    /// A code with its origin at `object`, tilted by `turn`, as a pose sees it.
    fn view(pose: &Pose, object: Vector3<f64>, turn: &Vector3<f64>) -> Option<CodeView> {
        let frame = crate::geometry::rotation_from_vector(turn);
        let image = |p: Vector3<f64>| {
            let k = pose.camera_from_point(&p);
            Vector2::new(k.x, k.y) * (-20.0 / k.z)
        };
        // Seen from its front, no flatter than 60 degrees.
        let sight = (pose.centre_in_world - object).normalize();
        let seen = (frame * Vector3::z()).dot(&sight) > 0.5;
        seen.then(|| CodeView {
            o: image(object),
            a: image(object + frame * Vector3::x() * SIDE),
            b: image(object + frame * Vector3::y() * SIDE),
            object,
        })
    }

    fn codes(pose: &Pose, count: usize, flat: f64, seed: u64) -> Vec<CodeView> {
        let mut rng = simulation::random(seed ^ 0xc0de);
        let mut codes = Vec::new();
        while codes.len() < count {
            let mut object = simulation::vector(&mut rng, 250.0);
            object.z *= flat;
            let turn = simulation::vector(&mut rng, 0.8);
            let roll = Vector3::z() * rng.random_range(-3.0..3.0);
            codes.extend(view(pose, object, &if flat == 0.0 { roll } else { turn }));
        }
        codes
    }

    #[test]
    fn the_trial_figures_are_met() {
        let (mut scale_squares, mut count) = (0.0, 0.0);
        let (mut stations, mut turns) = (Vec::new(), Vec::new());
        for seed in 0..500 {
            let pose = simulation::station(seed);
            let codes = codes(&pose, 5, 1.0, seed);
            let found = resect_by_similarity(&codes, SIDE, 20.0).unwrap();
            for (code, scale) in codes.iter().zip(&found.scales) {
                let distance = (code.object - pose.centre_in_world).norm();
                let truth = code.o.push(-20.0).norm() / distance;
                scale_squares += (scale / truth - 1.0).powi(2);
                count += 1.0;
            }
            stations.push((found.pose.centre_in_world - pose.centre_in_world).norm());
            turns.push(turn_between(&found.pose, &pose).to_degrees());
        }
        stations.sort_by(f64::total_cmp);
        turns.sort_by(f64::total_cmp);
        let scale_rms = (scale_squares / count).sqrt();
        // Scale right to about 1 % (what perspective inside a code leaves), station to some cm, direction to a degree.
        assert!(scale_rms < 0.012, "{scale_rms}");
        assert!(stations[250] < 32.0, "{}", stations[250]);
        assert!(turns[250] < 1.6, "{}", turns[250]);
    }

    #[test]
    fn three_codes_and_flat_codes_are_no_reflection() {
        for seed in 0..100 {
            let pose = simulation::station(seed);
            for (count, flat) in [(3, 1.0), (6, 0.0)] {
                let found =
                    resect_by_similarity(&codes(&pose, count, flat, seed), SIDE, 20.0).unwrap();
                assert!((found.pose.camera_from_world.matrix().determinant() - 1.0).abs() < 1e-9);
                assert_eq!(found.ground, RotationGround::Flat);
            }
        }
    }

    #[test]
    fn degenerate_codes_are_errors() {
        let pose = simulation::station(1);
        let mut codes = codes(&pose, 4, 1.0, 1);
        assert_eq!(
            resect_by_similarity(&codes[..2], SIDE, 20.0),
            Err(SimilarityError::TooFewCodes { found: 2 })
        );
        assert_eq!(
            resect_by_similarity(&[codes[0]; 4], SIDE, 20.0),
            Err(SimilarityError::Collinear)
        );
        codes[2].a = codes[2].o;
        codes[2].b = codes[2].o;
        assert_eq!(
            resect_by_similarity(&codes, SIDE, 20.0),
            Err(SimilarityError::NoScale { index: 2 })
        );
        codes[2].a.x = f64::NAN;
        assert_eq!(
            resect_by_similarity(&codes, SIDE, 20.0),
            Err(SimilarityError::NoScale { index: 2 })
        );
    }
}
