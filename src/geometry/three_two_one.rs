//! A coordinate system by three points, the 3-2-1 rule of coordinate metrology: one point holds three coordinates (the
//! origin), one holds two (it lies on an axis), one holds one (it lies in a coordinate plane).

use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};

use super::Similarity;

/// Smallest share of the largest distance between the three points by which the axis point must be away from the
/// origin, and the plane point from the axis: the turn of the frame carries their errors magnified by its inverse.
pub const LEAST_SPREAD: f64 = 1e-3;

/// Which positive axis goes through the second point, and to which positive side of it the third point lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AxisOrder {
    /// X axis; XY plane, y positive.
    #[default]
    Xy,
    /// X axis; ZX plane, z positive.
    Xz,
    /// Y axis; XY plane, x positive.
    Yx,
    /// Y axis; YZ plane, z positive.
    Yz,
    /// Z axis; ZX plane, x positive.
    Zx,
    /// Z axis; YZ plane, y positive.
    Zy,
}

impl AxisOrder {
    /// All orders.
    pub const ALL: [Self; 6] = [Self::Xy, Self::Xz, Self::Yx, Self::Yz, Self::Zx, Self::Zy];

    /// The coordinate (0, 1, 2) that grows from the origin to the axis point.
    #[must_use]
    pub fn axis(self) -> usize {
        match self {
            Self::Xy | Self::Xz => 0,
            Self::Yx | Self::Yz => 1,
            Self::Zx | Self::Zy => 2,
        }
    }

    /// The coordinate that is positive at the plane point.
    #[must_use]
    pub fn side(self) -> usize {
        match self {
            Self::Yx | Self::Zx => 0,
            Self::Xy | Self::Zy => 1,
            Self::Xz | Self::Yz => 2,
        }
    }

    /// The coordinate that is zero at all three points.
    #[must_use]
    pub fn normal(self) -> usize {
        3 - self.axis() - self.side()
    }

    /// X, Y or Z.
    #[must_use]
    pub fn axis_name(self) -> &'static str {
        ["X", "Y", "Z"][self.axis()]
    }

    /// XY, YZ or ZX.
    #[must_use]
    pub fn plane_name(self) -> &'static str {
        ["YZ", "ZX", "XY"][self.normal()]
    }
}

/// A coordinate system by three points, given by whatever stands for a point: an index, a name, a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ThreeTwoOne<P> {
    /// Its three coordinates are zero.
    pub origin: P,
    /// It lies on the positive axis.
    pub axis: P,
    /// It lies in the coordinate plane, on the positive side of the axis.
    pub plane: P,
    /// Which axis and which plane.
    pub order: AxisOrder,
}

impl<P> ThreeTwoOne<P> {
    /// The same system by what `by` gives for each point.
    pub fn map<Q>(&self, mut by: impl FnMut(&P) -> Q) -> ThreeTwoOne<Q> {
        ThreeTwoOne {
            origin: by(&self.origin),
            axis: by(&self.axis),
            plane: by(&self.plane),
            order: self.order,
        }
    }

    /// The three points, each with the coordinates that are zero there.
    #[must_use]
    pub fn held(&self) -> [(&P, Vec<usize>); 3] {
        let order = self.order;
        [
            (&self.origin, vec![0, 1, 2]),
            (&self.axis, vec![order.side(), order.normal()]),
            (&self.plane, vec![order.normal()]),
        ]
    }
}

/// Why three points give no coordinate system.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ThreePointsError {
    /// Axis point and origin are one.
    #[error(
        "the axis point is {found_mm:.4} mm away from the origin, expected more than {expected_mm:.4} mm"
    )]
    AtOrigin {
        /// Their distance, mm.
        found_mm: f64,
        /// Least distance, mm.
        expected_mm: f64,
    },
    /// The three lie on one line.
    #[error(
        "the plane point lies {found_mm:.4} mm off the axis, expected more than {expected_mm:.4} mm"
    )]
    OnLine {
        /// Distance of the plane point from the axis, mm.
        found_mm: f64,
        /// Least distance, mm.
        expected_mm: f64,
    },
}

impl ThreeTwoOne<Vector3<f64>> {
    /// The motion (scale 1) into the coordinate system.
    ///
    /// # Errors
    /// [`ThreePointsError`] where the points are not spread by [`LEAST_SPREAD`].
    pub fn motion(&self) -> Result<Similarity, ThreePointsError> {
        let along = self.axis - self.origin;
        let aside = self.plane - self.origin;
        let size = along
            .norm()
            .max(aside.norm())
            .max((self.plane - self.axis).norm());
        let expected_mm = LEAST_SPREAD * size;
        let found_mm = along.norm();
        if !(found_mm > expected_mm) {
            return Err(ThreePointsError::AtOrigin {
                found_mm,
                expected_mm,
            });
        }
        let along = along / found_mm;
        let across = aside - along * along.dot(&aside);
        let found_mm = across.norm();
        if !(found_mm > expected_mm) {
            return Err(ThreePointsError::OnLine {
                found_mm,
                expected_mm,
            });
        }
        // Once more against the axis: the first difference lost digits where the plane point lies far along it.
        let across = across / found_mm;
        let across = (across - along * along.dot(&across)).normalize();
        let order = self.order;
        // x, y, z follow each other in a circle: the third direction completes them to a right-handed system.
        let sign = if (order.axis() + 1) % 3 == order.side() {
            1.0
        } else {
            -1.0
        };
        let mut directions = Matrix3::zeros();
        directions.set_row(order.axis(), &along.transpose());
        directions.set_row(order.side(), &across.transpose());
        directions.set_row(order.normal(), &(sign * along.cross(&across)).transpose());
        let rotation = Rotation3::from_matrix_unchecked(directions);
        Ok(Similarity {
            scale: 1.0,
            rotation,
            translation: -(rotation * self.origin),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(range: f64) -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-range..range).prop_map(Vector3::from)
    }

    proptest! {
        #[test]
        fn the_three_points_lie_where_the_rule_says(
            origin in vector(500.0),
            axis in vector(500.0),
            plane in vector(500.0),
            order in prop::sample::select(AxisOrder::ALL.to_vec()),
        ) {
            let points = ThreeTwoOne { origin, axis, plane, order };
            if let Ok(motion) = points.motion() {
                prop_assert!((motion.rotation.matrix().determinant() - 1.0).abs() < 1e-12);
                let moved = points.map(|p| motion.apply(p));
                for (point, zero) in moved.held() {
                    for axis in zero {
                        prop_assert!(point[axis].abs() < 1e-9, "{}", point[axis]);
                    }
                }
                prop_assert!(moved.axis[order.axis()] > 0.0);
                prop_assert!(moved.plane[order.side()] > 0.0);
                let back = motion.inverse();
                prop_assert!((back.apply(&moved.plane) - plane).norm() < 1e-9);
            }
        }
    }

    #[test]
    fn orders_are_what_their_names_say() {
        for order in AxisOrder::ALL {
            let name = format!("{order:?}").to_uppercase();
            assert!(name.starts_with(order.axis_name()));
            let mut sorted: Vec<char> = order.plane_name().chars().collect();
            let mut of_name: Vec<char> = name.chars().collect();
            sorted.sort_unstable();
            of_name.sort_unstable();
            assert_eq!(sorted, of_name);
        }
    }

    #[test]
    fn points_on_a_line_or_in_one_place_are_refused() {
        let at = |x: f64, y: f64| Vector3::new(x, y, 0.0);
        let points = |axis, plane| ThreeTwoOne {
            origin: at(0.0, 0.0),
            axis,
            plane,
            order: AxisOrder::Xy,
        };
        assert_eq!(
            points(at(1000.0, 0.0), at(500.0, 0.5)).motion(),
            Err(ThreePointsError::OnLine {
                found_mm: 0.5,
                expected_mm: 1.0
            })
        );
        assert!(points(at(1000.0, 0.0), at(500.0, 2.0)).motion().is_ok());
        assert_eq!(
            points(at(0.0, 0.0), at(500.0, 0.0)).motion(),
            Err(ThreePointsError::AtOrigin {
                found_mm: 0.0,
                expected_mm: 0.5
            })
        );
        assert!(points(at(0.0, 0.0), at(0.0, 0.0)).motion().is_err());
        assert!(points(at(f64::NAN, 0.0), at(1.0, 1.0)).motion().is_err());
    }
}
