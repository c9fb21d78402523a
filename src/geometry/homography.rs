//! The homography between two planes.

use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, SVector, Vector2, Vector3};

/// Singular values below this part of the largest are taken as zero: the coordinates are normalised.
const RANK_TOLERANCE: f64 = 1e-9;

/// A pair of corresponding points of two planes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanePair {
    /// Point of the source plane.
    pub source: Vector2<f64>,
    /// Point of the target plane.
    pub target: Vector2<f64>,
}

/// Why no homography could be fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HomographyError {
    /// Fewer than four pairs.
    #[error("a homography needs 4 pairs of points, found {found}")]
    TooFewPairs {
        /// Pairs given.
        found: usize,
    },
    /// Three of four points lie on a line, or points coincide: the homography is not determined.
    #[error(
        "the points do not determine a homography: rank {rank} of 8 (too many lie on one line)"
    )]
    Degenerate {
        /// Rank of the design matrix.
        rank: usize,
    },
}

/// The homography `[target, 1] ~ H [source, 1]` with the least sum of squared distances in the target plane: the
/// normalised direct linear transformation (Hartley and Zisserman, 2004, algorithm 4.2), then Gauss-Newton.
/// It is scaled to unit Frobenius norm, with positive third coordinate at the sources' centroid.
///
/// # Errors
/// [`HomographyError`] with fewer than four pairs or degenerate points.
pub fn fit_homography(pairs: &[PlanePair]) -> Result<Matrix3<f64>, HomographyError> {
    if pairs.len() < 4 {
        return Err(HomographyError::TooFewPairs { found: pairs.len() });
    }
    let unusable = HomographyError::Degenerate { rank: 0 };
    let (sources, targets): (Vec<_>, Vec<_>) = pairs.iter().map(|p| (p.source, p.target)).unzip();
    let source_norm = normalisation(&sources).ok_or(unusable)?;
    let target_norm = normalisation(&targets).ok_or(unusable)?;
    let normalised: Vec<PlanePair> = pairs
        .iter()
        .map(|p| PlanePair {
            source: apply_homography(&source_norm, &p.source),
            target: apply_homography(&target_norm, &p.target),
        })
        .collect();
    let h = refine(linear_homography(&normalised)?, &normalised);
    let back = target_norm.try_inverse().ok_or(unusable)?;
    let h = back * h * source_norm;
    let centre = sources.iter().sum::<Vector2<f64>>() / pairs.len() as f64;
    let front = (h * centre.push(1.0)).z;
    Ok(h * (if front < 0.0 { -1.0 } else { 1.0 } / h.norm()))
}

/// The image of a point under a homography; not finite on its horizon.
#[must_use]
pub fn apply_homography(homography: &Matrix3<f64>, point: &Vector2<f64>) -> Vector2<f64> {
    let image = homography * Vector3::new(point.x, point.y, 1.0);
    Vector2::new(image.x / image.z, image.y / image.z)
}

/// The similarity that moves the centroid to the origin and scales the mean square distance to 2; `None` for a single
/// place or coordinates that are no numbers.
fn normalisation(points: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    let n = points.len() as f64;
    let centre = points.iter().sum::<Vector2<f64>>() / n;
    let mean = points
        .iter()
        .map(|p| (p - centre).norm_squared())
        .sum::<f64>()
        / n;
    let scale = (2.0 / mean).sqrt();
    (scale.is_finite() && centre.norm().is_finite()).then(|| {
        Matrix3::new(
            scale,
            0.0,
            -scale * centre.x,
            0.0,
            scale,
            -scale * centre.y,
            0.0,
            0.0,
            1.0,
        )
    })
}

/// The algebraic solution: the right singular vector of the smallest singular value.
fn linear_homography(pairs: &[PlanePair]) -> Result<Matrix3<f64>, HomographyError> {
    // At least nine rows, so that the decomposition returns all nine right vectors.
    let mut design = DMatrix::zeros((2 * pairs.len()).max(9), 9);
    for (row, pair) in pairs.iter().enumerate() {
        let (p, q) = (pair.source.push(1.0), pair.target);
        for k in 0..3 {
            design[(2 * row, k)] = p[k];
            design[(2 * row, 6 + k)] = -q.x * p[k];
            design[(2 * row + 1, 3 + k)] = p[k];
            design[(2 * row + 1, 6 + k)] = -q.y * p[k];
        }
    }
    let svd = design.svd(false, true);
    let largest = svd.singular_values[0];
    let rank = svd
        .singular_values
        .iter()
        .filter(|s| **s > RANK_TOLERANCE * largest)
        .count();
    match svd.v_t {
        Some(v_t) if rank >= 8 => {
            let h = Matrix3::from_iterator(v_t.row(8).iter().copied()).transpose();
            // A singular matrix maps the plane to a line: three of the points lie on one line in one picture only.
            if h.determinant().abs() > RANK_TOLERANCE * h.norm().powi(3) {
                Ok(h)
            } else {
                Err(HomographyError::Degenerate { rank: 7 })
            }
        }
        _ => Err(HomographyError::Degenerate { rank }),
    }
}

/// Gauss-Newton over the eight entries other than the largest, as long as the distances shrink.
fn refine(start: Matrix3<f64>, pairs: &[PlanePair]) -> Matrix3<f64> {
    let fixed = start
        .transpose()
        .iter()
        .enumerate()
        .fold(0, |best, (k, value)| {
            if value.abs() > start[(best / 3, best % 3)].abs() {
                k
            } else {
                best
            }
        });
    let cost = |h: &Matrix3<f64>| -> f64 {
        pairs
            .iter()
            .map(|p| (apply_homography(h, &p.source) - p.target).norm_squared())
            .sum()
    };
    let (mut h, mut least) = (start, cost(&start));
    for _ in 0..10 {
        let mut normal = SMatrix::<f64, 8, 8>::zeros();
        let mut right = SVector::<f64, 8>::zeros();
        for pair in pairs {
            let p = pair.source.push(1.0);
            let image = h * p;
            let place = Vector2::new(image.x / image.z, image.y / image.z);
            for axis in 0..2 {
                let residual = place[axis] - pair.target[axis];
                let mut row = SVector::<f64, 8>::zeros();
                for k in (0..9).filter(|&k| k != fixed) {
                    let slot = if k > fixed { k - 1 } else { k };
                    row[slot] = if k / 3 == axis {
                        p[k % 3] / image.z
                    } else if k / 3 == 2 {
                        -place[axis] * p[k % 3] / image.z
                    } else {
                        0.0
                    };
                }
                normal += row * row.transpose();
                right -= row * residual;
            }
        }
        let Some(factor) = normal.cholesky() else {
            break;
        };
        let step: DVector<f64> = DVector::from_column_slice(factor.solve(&right).as_slice());
        let mut moved = h;
        for k in (0..9).filter(|&k| k != fixed) {
            moved[(k / 3, k % 3)] += step[if k > fixed { k - 1 } else { k }];
        }
        let now = cost(&moved);
        if !(now < least) {
            break;
        }
        let settled = least - now <= 1e-14 * least;
        (h, least) = (moved, now);
        if settled {
            break;
        }
    }
    h
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pairs(h: &Matrix3<f64>, sources: &[[f64; 2]]) -> Vec<PlanePair> {
        let pair = |s: &[f64; 2]| PlanePair {
            source: Vector2::from(*s),
            target: apply_homography(h, &Vector2::from(*s)),
        };
        sources.iter().map(pair).collect()
    }

    const SQUARE: [[f64; 2]; 6] = [
        [0.0, 0.0],
        [100.0, 0.0],
        [100.0, 80.0],
        [0.0, 90.0],
        [40.0, 30.0],
        [20.0, 70.0],
    ];

    proptest! {
        #[test]
        fn an_exact_homography_is_found_again(
            a in prop::array::uniform4(-0.3..0.3), b in prop::array::uniform2(-50.0..50.0), g in prop::array::uniform2(-2e-3..2e-3),
        ) {
            let h = Matrix3::new(1.0 + a[0], a[1], b[0], a[2], 1.0 + a[3], b[1], g[0], g[1], 1.0);
            for count in 4..=6 {
                let found = fit_homography(&pairs(&h, &SQUARE[..count])).unwrap();
                prop_assert!((found - h / h.norm()).norm() < 1e-9);
            }
        }
    }

    #[test]
    fn points_on_a_line_are_refused() {
        let h = Matrix3::identity();
        let line = [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0], [4.0, 4.0]];
        assert!(matches!(
            fit_homography(&pairs(&h, &line)),
            Err(HomographyError::Degenerate { .. })
        ));
        let three = [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 5.0]];
        assert!(matches!(
            fit_homography(&pairs(&h, &three)),
            Err(HomographyError::Degenerate { .. })
        ));
        let place = [[1.0, 1.0]; 5];
        assert!(fit_homography(&pairs(&h, &place)).is_err());
        assert_eq!(
            fit_homography(&[]),
            Err(HomographyError::TooFewPairs { found: 0 })
        );
    }
}
