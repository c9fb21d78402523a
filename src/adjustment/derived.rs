//! Quantities that follow from coordinates, with their joint covariance, and the error ellipsoid of a point.

use nalgebra::{DMatrix, DVector, Matrix3, RowVector3, Vector3};

use super::{Part, SolvedNetwork};

/// A quantity that follows from the coordinates of points (indices into [`super::BundleProblem::points`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Derived {
    /// The distance between two points, mm.
    Distance {
        /// One end.
        from: usize,
        /// The other end.
        to: usize,
    },
    /// The angle at a point between the directions to two others, rad, 0 to pi.
    Angle {
        /// Its vertex.
        at: usize,
        /// Point on one leg.
        from: usize,
        /// Point on the other leg.
        to: usize,
    },
    /// A distance over another one, without unit: it does not depend on the scale.
    Ratio {
        /// Ends of the one.
        of: [usize; 2],
        /// Ends of the other.
        over: [usize; 2],
    },
}

/// Values and joint covariance of derived quantities.
#[derive(Clone, Debug, PartialEq)]
pub struct DerivedValues {
    /// In the order they were asked for, in their units.
    pub values: DVector<f64>,
    /// Of all of them, a-posteriori.
    pub covariance: DMatrix<f64>,
}

impl DerivedValues {
    /// Standard deviation of one of them.
    #[must_use]
    pub fn sigma(&self, index: usize) -> f64 {
        self.covariance[(index, index)].max(0.0).sqrt()
    }
}

/// A value with its derivatives by points.
struct Linearised {
    value: f64,
    by: Vec<(usize, RowVector3<f64>)>,
}

impl SolvedNetwork {
    /// The quantities with their joint covariance, by propagation of that of their points; `None` where a point takes no
    /// part, or where two points that give a direction coincide.
    ///
    /// Cost: that of [`Self::covariance`] of all their points.
    #[must_use]
    pub fn derived(&self, quantities: &[Derived]) -> Option<DerivedValues> {
        let linearised: Option<Vec<Linearised>> =
            quantities.iter().map(|q| self.linearised(*q)).collect();
        let linearised = linearised?;
        let mut points: Vec<usize> = linearised
            .iter()
            .flat_map(|l| l.by.iter().map(|(point, _)| *point))
            .collect();
        points.sort_unstable();
        points.dedup();
        let parts: Vec<Part> = points.iter().map(|&point| Part::Point(point)).collect();
        let covariance = self.covariance(&parts)?;
        let mut jacobian = DMatrix::<f64>::zeros(linearised.len(), covariance.nrows());
        for (row, quantity) in linearised.iter().enumerate() {
            for (point, by) in &quantity.by {
                let at = 3 * points.partition_point(|p| p < point);
                for axis in 0..3 {
                    jacobian[(row, at + axis)] += by[axis];
                }
            }
        }
        Some(DerivedValues {
            values: DVector::from_iterator(linearised.len(), linearised.iter().map(|l| l.value)),
            covariance: &jacobian * covariance * jacobian.transpose(),
        })
    }

    fn linearised(&self, quantity: Derived) -> Option<Linearised> {
        match quantity {
            Derived::Distance { from, to } => self.distance(from, to),
            Derived::Angle { at, from, to } => self.angle(at, from, to),
            Derived::Ratio { of, over } => {
                let [of, over] = [of, over].map(|[from, to]| self.distance(from, to));
                let (of, over) = (of?, over?);
                let ratio = of.value / over.value;
                let by_of = of.by.iter().map(|(p, by)| (*p, by / over.value));
                let by_over = over.by.iter();
                let by_over = by_over.map(|(p, by)| (*p, -ratio * by / over.value));
                Some(Linearised {
                    value: ratio,
                    by: by_of.chain(by_over).collect(),
                })
            }
        }
    }

    fn distance(&self, from: usize, to: usize) -> Option<Linearised> {
        let difference = self.position(to)? - self.position(from)?;
        let length = difference.norm();
        let direction = (length > 0.0).then(|| (difference / length).transpose())?;
        Some(Linearised {
            value: length,
            by: vec![(from, -direction), (to, direction)],
        })
    }

    fn angle(&self, at: usize, from: usize, to: usize) -> Option<Linearised> {
        let vertex = self.position(at)?;
        let (a, b) = (self.position(from)? - vertex, self.position(to)? - vertex);
        let (sine, cosine) = (a.cross(&b).norm(), a.dot(&b));
        if a.norm() * b.norm() <= 0.0 || sine <= 0.0 {
            return None;
        }
        // An end moves the angle by its part across its leg, within the plane, over the leg's length.
        let across = |leg: &Vector3<f64>, other: &Vector3<f64>| {
            let unit = leg / leg.norm();
            let away = unit * unit.dot(other) - other;
            (away / (away.norm() * leg.norm())).transpose()
        };
        let (by_from, by_to) = (across(&a, &b), across(&b, &a));
        Some(Linearised {
            value: sine.atan2(cosine),
            by: vec![(at, -by_from - by_to), (from, by_from), (to, by_to)],
        })
    }
}

/// The error ellipsoid of a point: the half axes of the standard ellipsoid, the longest first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorEllipsoid {
    /// Half axes, mm: square roots of the eigenvalues of the covariance.
    pub half_axes_mm: [f64; 3],
    /// Their directions as columns.
    pub directions: Matrix3<f64>,
}

impl ErrorEllipsoid {
    /// Of a point's covariance, mm^2.
    #[must_use]
    pub fn of(covariance: &Matrix3<f64>) -> Self {
        let eigen = covariance.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        Self {
            half_axes_mm: order.map(|k| eigen.eigenvalues[k].max(0.0).sqrt()),
            directions: Matrix3::from_columns(
                &order.map(|k| eigen.eigenvectors.column(k).into_owned()),
            ),
        }
    }
}

/// Correlation coefficients of a covariance matrix; zeros in rows without variance.
#[must_use]
pub fn correlations(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(covariance.nrows(), covariance.ncols(), |i, j| {
        let scale = (covariance[(i, i)] * covariance[(j, j)]).sqrt();
        if scale > 0.0 {
            covariance[(i, j)] / scale
        } else {
            0.0
        }
    })
}
