//! Brown's polynomial: a point with its radial, decentring and affine distortion, in either direction of a lens.

use nalgebra::{Matrix2, SMatrix, Vector2};

use super::InteriorOrientation;

/// The polynomial at a point `(u, v)`, mm from the principal point, with its derivatives:
/// `u + u rad + P1 (s + 2 u^2) + 2 P2 u v + B1 u + B2 v`, `v + v rad + P2 (s + 2 v^2) + 2 P1 u v`, where `s = u^2 + v^2` and
/// `rad = K1 (s - S) + K2 (s^2 - S^2) + K3 (s^3 - S^3)` with the square `S` of the balanced radius.
pub(super) struct Brown {
    u: f64,
    v: f64,
    radial: [f64; 3],
    tangential: [f64; 2],
    squares: f64,
    balance: f64,
    affinity: Affinity,
    /// The distorted point.
    pub(super) value: Vector2<f64>,
    /// Its derivative by the point.
    pub(super) by_point: Matrix2<f64>,
}

/// Where the affinity acts.
enum Affinity {
    /// With the rest.
    Beside,
    /// On the point before the rest, with the point as it was.
    Before(Matrix2<f64>, Vector2<f64>),
    /// On what the rest gives, with that.
    After(Matrix2<f64>, Vector2<f64>),
}

fn affinity([b1, b2]: [f64; 2]) -> Matrix2<f64> {
    Matrix2::new(1.0 + b1, b2, 0.0, 1.0)
}

impl Brown {
    pub(super) fn at(
        lens: &InteriorOrientation,
        balanced_radius: f64,
        point: &Vector2<f64>,
    ) -> Self {
        let (u, v) = (point.x, point.y);
        let radial @ [k1, k2, k3] = lens.radial;
        let tangential @ [p1, p2] = lens.tangential;
        let [b1, b2] = lens.affinity;
        let s = u * u + v * v;
        let balance = balanced_radius * balanced_radius;
        let at = |s: f64| s * (k1 + s * (k2 + s * k3));
        let rad = at(s) - at(balance);
        let slope = k1 + s * (2.0 * k2 + s * 3.0 * k3);
        let cross = 2.0 * u * v * slope + 2.0 * p1 * v + 2.0 * p2 * u;
        Self {
            u,
            v,
            radial,
            tangential,
            squares: s,
            balance,
            affinity: Affinity::Beside,
            value: Vector2::new(
                u + u * rad + p1 * (s + 2.0 * u * u) + 2.0 * p2 * u * v + b1 * u + b2 * v,
                v + v * rad + p2 * (s + 2.0 * v * v) + 2.0 * p1 * u * v,
            ),
            by_point: Matrix2::new(
                1.0 + rad + 2.0 * u * u * slope + 6.0 * p1 * u + 2.0 * p2 * v + b1,
                cross + b2,
                cross,
                1.0 + rad + 2.0 * v * v * slope + 6.0 * p2 * v + 2.0 * p1 * u,
            ),
        }
    }

    /// The affinity applied first, the rest of the polynomial at the place that it gives.
    pub(super) fn after_affinity(lens: &InteriorOrientation, point: &Vector2<f64>) -> Self {
        let affinity = affinity(lens.affinity);
        let there = Self::at(&without_affinity(lens), 0.0, &(affinity * point));
        Self {
            by_point: there.by_point * affinity,
            affinity: Affinity::Before(affinity, *point),
            ..there
        }
    }

    /// The affinity applied to what the rest of the polynomial gives.
    pub(super) fn before_affinity(lens: &InteriorOrientation, point: &Vector2<f64>) -> Self {
        let affinity = affinity(lens.affinity);
        let there = Self::at(&without_affinity(lens), 0.0, point);
        Self {
            value: affinity * there.value,
            by_point: affinity * there.by_point,
            affinity: Affinity::After(affinity, there.value),
            ..there
        }
    }

    /// Whether the distortion folds over neither here nor, as far as it is radial, on the way here from the principal point.
    pub(super) fn is_unfolded(&self) -> bool {
        self.by_point.determinant() > 0.0 && self.radius_rises()
    }

    /// Whether the derivative of the distorted radius by the radius, `1 - rad(S) + 3 K1 s + 5 K2 s^2 + 7 K3 s^3`, is positive all the way
    /// from the principal point; then the distorted radius, its integral, is positive too.
    fn radius_rises(&self) -> bool {
        let (s, balance) = (self.squares, self.balance);
        let [k1, k2, k3] = self.radial;
        let first = 1.0 - balance * (k1 + balance * (k2 + balance * k3));
        let (a, b, c) = (3.0 * k1, 5.0 * k2, 7.0 * k3);
        // A bound from the falling terms alone: most lenses are far from folding over.
        if first + s * (a.min(0.0) + s * (b.min(0.0) + s * c.min(0.0))) > 0.0 {
            return true;
        }
        // It is least at an end or where its derivative `a + 2 b s + 3 c s^2` rises through zero; that is no number, or beyond the ends,
        // where it does so nowhere.
        let root = (b * b - 3.0 * a * c).sqrt();
        let lowest = if b > 0.0 {
            -a / (b + root)
        } else {
            (root - b) / (3.0 * c)
        };
        let between = if lowest > 0.0 && lowest < s {
            lowest
        } else {
            s
        };
        let rises = |s: f64| first + s * (a + s * (b + s * c)) > 0.0;
        rises(0.0) && rises(between) && rises(s)
    }

    /// Derivative by K1, K2, K3, P1, P2, B1, B2 in the columns 3 to 9 of the ten parameters; the others are zero.
    pub(super) fn by_coefficients(&self) -> SMatrix<f64, 2, 10> {
        let Self { u, v, .. } = *self;
        let (s, b) = (self.squares, self.balance);
        let radial = [s - b, s * s - b * b, s * s * s - b * b * b];
        let [k1, k2, k3] = radial;
        #[rustfmt::skip]
        let mut rows = SMatrix::<f64, 2, 10>::from_row_slice(&[
            0.0, 0.0, 0.0, u * k1, u * k2, u * k3, s + 2.0 * u * u, 2.0 * u * v, u, v,
            0.0, 0.0, 0.0, v * k1, v * k2, v * k3, 2.0 * u * v, s + 2.0 * v * v, 0.0, 0.0,
        ]);
        match &self.affinity {
            Affinity::Beside => {}
            Affinity::Before(affinity, point) => {
                if let Some(back) = affinity.try_inverse() {
                    // By the place that the affinity gives.
                    let along = self.by_point * back.column(0);
                    rows.set_column(8, &(along * point.x));
                    rows.set_column(9, &(along * point.y));
                }
            }
            Affinity::After(affinity, distorted) => {
                rows = affinity * rows;
                rows.set_column(8, &Vector2::new(distorted.x, 0.0));
                rows.set_column(9, &Vector2::new(distorted.y, 0.0));
            }
        }
        rows
    }

    /// Second derivatives of both coordinates by the point, mm^-1.
    ///
    /// With `h = K1 s + K2 s^2 + K3 s^3` and `h'`, `h''` by `s`: `d2(u h)/du2 = 6 u h' + 4 u^3 h''`,
    /// `d2(u h)/du dv = 2 v h' + 4 u^2 v h''`, `d2(u h)/dv2 = 2 u h' + 4 u v^2 h''`; v likewise.
    pub(super) fn curvature(&self) -> [Matrix2<f64>; 2] {
        let Self { u, v, .. } = *self;
        let [k1, k2, k3] = self.radial;
        let [p1, p2] = self.tangential;
        let s = self.squares;
        let first = k1 + s * (2.0 * k2 + s * 3.0 * k3);
        let second = 2.0 * k2 + s * 6.0 * k3;
        let along = |u: f64| 6.0 * u * first + 4.0 * u * u * u * second;
        let mixed = |u: f64, v: f64| 2.0 * v * first + 4.0 * u * u * v * second;
        let across = |u: f64, v: f64| 2.0 * u * first + 4.0 * u * v * v * second;
        let of_u = mixed(u, v) + 2.0 * p2;
        let of_v = mixed(v, u) + 2.0 * p1;
        let bent = [
            Matrix2::new(along(u) + 6.0 * p1, of_u, of_u, across(u, v) + 2.0 * p1),
            Matrix2::new(across(v, u) + 2.0 * p2, of_v, of_v, along(v) + 6.0 * p2),
        ];
        match &self.affinity {
            Affinity::Beside => bent,
            Affinity::Before(affinity, _) => bent.map(|of| affinity.transpose() * of * affinity),
            Affinity::After(affinity, _) => {
                std::array::from_fn(|k| bent[0] * affinity[(k, 0)] + bent[1] * affinity[(k, 1)])
            }
        }
    }
}

fn without_affinity(lens: &InteriorOrientation) -> InteriorOrientation {
    InteriorOrientation {
        affinity: [0.0; 2],
        ..*lens
    }
}
