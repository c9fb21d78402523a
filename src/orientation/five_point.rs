//! Essential matrices from five pairs of rays, and the relative poses in an essential matrix.

use nalgebra::{DMatrix, Matrix3, Rotation3, SMatrix, Vector3};

use crate::geometry::{Pose, real_roots, skew};

/// Roots of the tenth-degree polynomial beyond this size stand for a matrix at infinity of the null space's chart.
const LARGEST_ROOT: f64 = 1e4;

/// Places of the products of `[x, y, z, 1]` among the ten monomials of degree two:
/// `x2, xy, xz, x, y2, yz, y, z2, z, 1`.
const QUADRATIC: [[usize; 4]; 4] = [[0, 1, 2, 3], [1, 4, 5, 6], [2, 5, 7, 8], [3, 6, 8, 9]];

/// Exponents (x, y, z) of the twenty monomials in the order of Nister (2004):
/// `x3 y3 x2y xy2 x2z x2 y2z y2 xyz xy | xz2 xz x yz2 yz y z3 z2 z 1`.
const CUBIC: [[usize; 3]; 20] = [
    [3, 0, 0],
    [0, 3, 0],
    [2, 1, 0],
    [1, 2, 0],
    [2, 0, 1],
    [2, 0, 0],
    [0, 2, 1],
    [0, 2, 0],
    [1, 1, 1],
    [1, 1, 0],
    [1, 0, 2],
    [1, 0, 1],
    [1, 0, 0],
    [0, 1, 2],
    [0, 1, 1],
    [0, 1, 0],
    [0, 0, 3],
    [0, 0, 2],
    [0, 0, 1],
    [0, 0, 0],
];

/// Exponents of the ten quadratic monomials of [`QUADRATIC`], and of the four linear ones.
const QUADRATIC_POWERS: [[usize; 3]; 10] = [
    [2, 0, 0],
    [1, 1, 0],
    [1, 0, 1],
    [1, 0, 0],
    [0, 2, 0],
    [0, 1, 1],
    [0, 1, 0],
    [0, 0, 2],
    [0, 0, 1],
    [0, 0, 0],
];
const LINEAR_POWERS: [[usize; 3]; 4] = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]];

type Linear = [f64; 4];
type Quadratic = [f64; 10];
type Cubic = [f64; 20];

/// A pair of rays in the two camera frames (any length), of one object point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RayPair {
    /// Ray in the first camera's frame.
    pub(super) first: Vector3<f64>,
    /// Ray in the second camera's frame.
    pub(super) second: Vector3<f64>,
}

/// The up to ten essential matrices (`second^T E first = 0`, unit Frobenius norm) of five pairs of rays (Nister, 2004).
#[must_use]
pub(super) fn essential_matrices(pairs: &[RayPair; 5]) -> Vec<Matrix3<f64>> {
    let Some(basis) = null_space(pairs) else {
        return Vec::new();
    };
    let Some(rows) = reduced_constraints(&basis) else {
        return Vec::new();
    };
    // Rows 4 to 9 begin with x2z, x2, y2z, y2, xyz, xy; row - z (next row) leaves polynomials in z times x, y and 1.
    let b = [4, 6, 8].map(|row| polynomial_row(&rows, row));
    let minor =
        |i: usize, j: usize| subtract(&multiply(&b[0][i], &b[1][j]), &multiply(&b[0][j], &b[1][i]));
    let mut determinant = multiply(&minor(1, 2), &b[2][0]);
    determinant = subtract(&determinant, &multiply(&minor(0, 2), &b[2][1]));
    let last: Vec<f64> = multiply(&minor(0, 1), &b[2][2])
        .iter()
        .map(|a| -a)
        .collect();
    determinant = subtract(&determinant, &last);
    let mut matrices = Vec::new();
    for z in real_roots(&determinant, -LARGEST_ROOT, LARGEST_ROOT) {
        let at = b
            .each_ref()
            .map(|row| Vector3::from_fn(|k, _| evaluate(&row[k], z)));
        // [x, y, 1] is perpendicular to all three rows: the longest cross product is the most exact.
        let candidates = [
            at[0].cross(&at[1]),
            at[0].cross(&at[2]),
            at[1].cross(&at[2]),
        ];
        let Some(null) = candidates
            .iter()
            .max_by(|a, b| a.norm().total_cmp(&b.norm()))
        else {
            continue;
        };
        if null.z.abs() <= 1e-12 * null.norm() {
            continue;
        }
        let (x, y) = (null.x / null.z, null.y / null.z);
        let e = basis[0] * x + basis[1] * y + basis[2] * z + basis[3];
        if e.norm().is_finite() && e.norm() > 0.0 {
            matrices.push(e / e.norm());
        }
    }
    matrices
}

/// Four matrices that span those with `second^T E first = 0` for all pairs.
fn null_space(pairs: &[RayPair; 5]) -> Option<[Matrix3<f64>; 4]> {
    let mut design = SMatrix::<f64, 9, 9>::zeros();
    for (row, pair) in pairs.iter().enumerate() {
        let (p, q) = (pair.first.normalize(), pair.second.normalize());
        for k in 0..9 {
            design[(row, k)] = q[k / 3] * p[k % 3];
        }
    }
    if !design.iter().all(|x| x.is_finite()) {
        return None;
    }
    let svd = design.try_svd(false, true, f64::EPSILON, 500)?;
    let v_t = svd.v_t?;
    // Two pairs alike leave a larger null space.
    if !(svd.singular_values[4] > 1e-9 * svd.singular_values[0]) {
        return None;
    }
    Some([5, 6, 7, 8].map(|row| Matrix3::from_fn(|i, j| v_t[(row, 3 * i + j)])))
}

/// The ten cubic constraints `det E = 0`, `2 E E^T E - tr(E E^T) E = 0`, reduced to the identity in the first ten
/// monomials.
fn reduced_constraints(basis: &[Matrix3<f64>; 4]) -> Option<SMatrix<f64, 10, 10>> {
    let entry = |i: usize, j: usize| -> Linear { [0, 1, 2, 3].map(|k: usize| basis[k][(i, j)]) };
    let mut constraints: Vec<Cubic> = Vec::with_capacity(10);
    let mut determinant = [0.0; 20];
    for k in 0..3 {
        let (j, l) = ((k + 1) % 3, (k + 2) % 3);
        let mut minor = [0.0; 10];
        add_product(&mut minor, &entry(1, j), &entry(2, l), 1.0);
        add_product(&mut minor, &entry(1, l), &entry(2, j), -1.0);
        add_cubic(&mut determinant, &minor, &entry(0, k), 1.0);
    }
    constraints.push(determinant);
    let mut square = [[[0.0; 10]; 3]; 3];
    for (i, row) in square.iter_mut().enumerate() {
        for (j, cell) in row.iter_mut().enumerate() {
            for k in 0..3 {
                add_product(cell, &entry(i, k), &entry(j, k), 1.0);
            }
        }
    }
    let trace: Quadratic =
        std::array::from_fn(|m| square[0][0][m] + square[1][1][m] + square[2][2][m]);
    for (i, row) in square.iter().enumerate() {
        for j in 0..3 {
            let mut constraint = [0.0; 20];
            for (k, cell) in row.iter().enumerate() {
                add_cubic(&mut constraint, cell, &entry(k, j), 2.0);
            }
            add_cubic(&mut constraint, &trace, &entry(i, j), -1.0);
            constraints.push(constraint);
        }
    }
    let left = SMatrix::<f64, 10, 10>::from_fn(|i, j| constraints[i][j]);
    let right = SMatrix::<f64, 10, 10>::from_fn(|i, j| constraints[i][10 + j]);
    let solution = left.full_piv_lu().solve(&right)?;
    solution.iter().all(|x| x.is_finite()).then_some(solution)
}

fn add_product(sum: &mut Quadratic, a: &Linear, b: &Linear, factor: f64) {
    for i in 0..4 {
        for j in 0..4 {
            sum[QUADRATIC[i][j]] += factor * a[i] * b[j];
        }
    }
}

fn add_cubic(sum: &mut Cubic, a: &Quadratic, b: &Linear, factor: f64) {
    for (i, p) in QUADRATIC_POWERS.iter().enumerate() {
        for (j, q) in LINEAR_POWERS.iter().enumerate() {
            sum[cubic_slot([p[0] + q[0], p[1] + q[1], p[2] + q[2]])] += factor * a[i] * b[j];
        }
    }
}

fn cubic_slot(powers: [usize; 3]) -> usize {
    CUBIC.iter().position(|p| *p == powers).unwrap_or(19)
}

/// Row `row` minus z times the next, as polynomials in z (lowest first) that multiply x, y and 1.
fn polynomial_row(rows: &SMatrix<f64, 10, 10>, row: usize) -> [Vec<f64>; 3] {
    let (upper, lower) = (rows.row(row), rows.row(row + 1));
    // Columns: xz2 xz x | yz2 yz y | z3 z2 z 1.
    let part = |first: usize, count: usize| -> Vec<f64> {
        let mut polynomial = vec![0.0; count + 1];
        for k in 0..count {
            let power = count - 1 - k;
            polynomial[power] += upper[first + k];
            polynomial[power + 1] -= lower[first + k];
        }
        polynomial
    };
    [part(0, 3), part(3, 3), part(6, 4)]
}

fn multiply(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut product = vec![0.0; a.len() + b.len() - 1];
    for (i, x) in a.iter().enumerate() {
        for (j, y) in b.iter().enumerate() {
            product[i + j] += x * y;
        }
    }
    product
}

fn subtract(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut difference = vec![0.0; a.len().max(b.len())];
    for (k, x) in a.iter().enumerate() {
        difference[k] += x;
    }
    for (k, x) in b.iter().enumerate() {
        difference[k] -= x;
    }
    difference
}

fn evaluate(polynomial: &[f64], x: f64) -> f64 {
    polynomial.iter().rev().fold(0.0, |sum, a| sum * x + a)
}

/// The four relative poses of an essential matrix, base of length 1 (Hartley and Zisserman, 2004, 9.6.2).
pub(super) fn poses_of_essential(e: &Matrix3<f64>) -> Vec<Pose> {
    let Some(svd) = e.try_svd(true, true, f64::EPSILON, 500) else {
        return Vec::new();
    };
    let (Some(mut u), Some(mut v_t)) = (svd.u, svd.v_t) else {
        return Vec::new();
    };
    if u.determinant() < 0.0 {
        u.column_mut(2).neg_mut();
    }
    if v_t.determinant() < 0.0 {
        v_t.row_mut(2).neg_mut();
    }
    let w = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let base = v_t.row(2).transpose();
    let mut poses = Vec::with_capacity(4);
    for turn in [w, w.transpose()] {
        let rotation = Rotation3::from_matrix_unchecked(u * turn * v_t);
        for sign in [1.0, -1.0] {
            poses.push(Pose {
                camera_from_world: rotation,
                centre_in_world: base * sign,
            });
        }
    }
    poses
}

/// The essential matrix `E = M [b]` of a relative pose.
pub(super) fn essential_of(pose: &Pose) -> Matrix3<f64> {
    pose.camera_from_world.matrix() * skew(&pose.centre_in_world)
}

/// The up to two relative poses (and their opposites) of a plane's homography `second ~ H first` between rays
/// (Faugeras and Lustman, 1988, in the form of Ma et al., 2004, 5.3.3), base of length 1; empty for a pure rotation.
pub(super) fn poses_of_homography(h: &Matrix3<f64>) -> Vec<Pose> {
    let Some(svd) = h.try_svd(true, true, f64::EPSILON, 500) else {
        return Vec::new();
    };
    let Some(v_t) = svd.v_t else {
        return Vec::new();
    };
    let middle = svd.singular_values[1];
    let h = h * (if h.determinant() < 0.0 { -1.0 } else { 1.0 } / middle);
    let [a, _, c] = [0, 1, 2].map(|k: usize| (svd.singular_values[k] / middle).powi(2));
    let mut v = v_t.transpose();
    if v.determinant() < 0.0 {
        v.neg_mut();
    }
    // Without a base H is a rotation, whose singular values are all one.
    if !(a - c > 1e-6) {
        return Vec::new();
    }
    let (v1, v2, v3): (Vector3<f64>, Vector3<f64>, Vector3<f64>) = (
        v.column(0).into_owned(),
        v.column(1).into_owned(),
        v.column(2).into_owned(),
    );
    let along = |sign: f64| {
        (v1 * (1.0 - c).max(0.0).sqrt() + v3 * (sign * (a - 1.0).max(0.0).sqrt())) / (a - c).sqrt()
    };
    let mut poses = Vec::with_capacity(4);
    for u in [along(1.0), along(-1.0)] {
        let from = Matrix3::from_columns(&[v2, u, v2.cross(&u)]);
        let (hv, hu) = (h * v2, h * u);
        let to = Matrix3::from_columns(&[hv, hu, hv.cross(&hu)]);
        let rotation = to * from.transpose();
        let normal = v2.cross(&u);
        // H = R + t n^T with t = -R b.
        let base = -(rotation.transpose() * ((h - rotation) * normal));
        let length = base.norm();
        if !(length > 1e-9) {
            continue;
        }
        for sign in [1.0, -1.0] {
            poses.push(Pose {
                camera_from_world: Rotation3::from_matrix_unchecked(rotation),
                centre_in_world: base * (sign / length),
            });
        }
    }
    poses
}

/// The homography of four or more pairs of rays, linear; `None` where it is not determined.
pub(super) fn ray_homography(pairs: &[RayPair]) -> Option<Matrix3<f64>> {
    let mut design = DMatrix::zeros((3 * pairs.len()).max(9), 9);
    for (row, pair) in pairs.iter().enumerate() {
        let (p, q) = (pair.first.normalize(), skew(&pair.second.normalize()));
        for i in 0..3 {
            for k in 0..9 {
                design[(3 * row + i, k)] = q[(i, k / 3)] * p[k % 3];
            }
        }
    }
    if !design.iter().all(|x: &f64| x.is_finite()) {
        return None;
    }
    let svd = design.try_svd(false, true, f64::EPSILON, 500)?;
    let determined = svd.singular_values[7] > 1e-9 * svd.singular_values[0];
    let v_t = svd.v_t.filter(|_| determined)?;
    Some(Matrix3::from_fn(|i, j| v_t[(8, 3 * i + j)]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::relative::tests::{flat_points, pairs_of, stereo};
    use crate::orientation::simulation;

    #[test]
    fn the_true_essential_matrix_is_among_those_of_five_exact_pairs() {
        let mut misses = 0;
        for seed in 0..300 {
            let pose = stereo(seed);
            let mut rng = simulation::random(seed);
            let points: Vec<Vector3<f64>> = (0..5)
                .map(|_| simulation::vector(&mut rng, 0.3) - Vector3::z() * 2.0)
                .collect();
            let pairs = pairs_of(&pose, &points);
            let five = [0, 1, 2, 3, 4].map(|k: usize| pairs[k]);
            let truth = essential_of(&pose).normalize();
            let error = essential_matrices(&five)
                .iter()
                .map(|e| (e - truth).norm().min((e + truth).norm()))
                .fold(f64::INFINITY, f64::min);
            misses += usize::from(error > 1e-6);
        }
        // A double root now and then is lost to rounding.
        assert!(misses <= 3, "{misses}");
    }

    #[test]
    fn both_decompositions_hold_the_true_pose() {
        for seed in 0..100 {
            let pose = stereo(seed);
            let near = |poses: &[Pose]| {
                poses
                    .iter()
                    .map(|p| {
                        (p.centre_in_world - pose.centre_in_world).norm()
                            + (p.camera_from_world.matrix() - pose.camera_from_world.matrix())
                                .norm()
                    })
                    .fold(f64::INFINITY, f64::min)
            };
            assert!(near(&poses_of_essential(&essential_of(&pose))) < 1e-9);
            let h = ray_homography(&pairs_of(&pose, &flat_points(12, seed))).unwrap();
            assert!(near(&poses_of_homography(&h)) < 1e-6, "{seed}");
        }
    }
}
