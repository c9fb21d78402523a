//! The ten parameters of interior orientation and what they do with an image point.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use serde::{Deserialize, Serialize};

use super::brown::Brown;

/// Names of the ten parameters in the order of [`InteriorOrientation::to_vector`], as they stand in reports.
pub const INTERIOR_NAMES: [&str; 10] = ["c", "x0", "y0", "K1", "K2", "K3", "P1", "P2", "B1", "B2"];

/// Which image point the distortion is a function of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum LensDirection {
    /// Of the measured point: `ideal = measured - (x0, y0) + correction(measured - (x0, y0))`, as photogrammetry has it (Brown, 1971;
    /// Fraser, 1997).
    #[default]
    Correcting,
    /// The same with the affinity first: `B1 xb + B2 yb` is added to `xb` before the radial and decentring correction is taken there, as
    /// DBAT's model 3 has it (Börlin and Grussenmeyer, 2013).
    CorrectingAffinityFirst,
    /// Of the ideal point: `measured = ideal + (x0, y0) + distortion(ideal)`, as AICON has it.
    Displacing {
        /// Radius at which the radial distortion is balanced to zero, mm: `r^2n - R0^2n` stands for `r^2n`; 0 for none.
        balanced_radius_mm: f64,
    },
    /// Of the ideal point with the affinity last: `B1 x + B2 y` of the distorted point is added to its `x`, so that two focal lengths
    /// act as OpenCV and COLMAP have them.
    DisplacingAffinityLast,
}

impl LensDirection {
    /// Ours, and the rule.
    #[must_use]
    #[allow(clippy::trivially_copy_pass_by_ref, reason = "as serde asks")]
    pub fn is_correcting(&self) -> bool {
        *self == Self::Correcting
    }
}

/// Principal distance, principal point and lens distortion, in millimetres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct InteriorOrientation {
    /// Principal distance c > 0, mm.
    pub principal_distance: f64,
    /// Principal point (x0, y0), mm from the image centre, y up.
    pub principal_point: [f64; 2],
    /// Radial distortion K1 mm^-2, K2 mm^-4, K3 mm^-6.
    pub radial: [f64; 3],
    /// Decentring distortion P1, P2, mm^-1.
    pub tangential: [f64; 2],
    /// Affinity B1 and shear B2, without unit.
    pub affinity: [f64; 2],
    /// What the distortion is a function of.
    #[serde(default, skip_serializing_if = "LensDirection::is_correcting")]
    pub direction: LensDirection,
}

/// An image point on both sides of the lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImagePoint {
    /// The ideal image point (x', y'), mm from the principal point.
    pub ideal: Vector2<f64>,
    /// The measured one, mm from the image centre.
    pub measured: Vector2<f64>,
}

/// How the two sides of the lens depend on each other at an image point.
#[derive(Clone, Copy, Debug)]
pub struct Correction {
    /// The ideal image point (x', y'), mm from the principal point.
    pub ideal: Vector2<f64>,
    /// Derivative of the ideal by the measured point, 2x2.
    pub by_measured: Matrix2<f64>,
    /// Derivative of the ideal point by the ten parameters with the measured one held, 2x10; the column of c is zero.
    pub by_interior: SMatrix<f64, 2, 10>,
}

/// The same the other way round.
#[derive(Clone, Copy, Debug)]
pub struct Displacement {
    /// The measured image point, mm from the image centre.
    pub measured: Vector2<f64>,
    /// Derivative of the measured by the ideal point, 2x2.
    pub by_ideal: Matrix2<f64>,
    /// Derivative of the measured point by the ten parameters with the ideal one held, 2x10; the column of c is zero.
    pub by_interior: SMatrix<f64, 2, 10>,
}

/// Newton steps to the other side of a lens at most, and the last one, in mm: image coordinates are some 10 mm, their last bits
/// 1e-15 mm; 1e-13 mm is 1e-11 of a pixel.
const STEPS: usize = 30;
const LAST_STEP_MM: f64 = 1e-13;

impl InteriorOrientation {
    /// A lens without distortion.
    #[must_use]
    pub fn pinhole(principal_distance: f64) -> Self {
        Self {
            principal_distance,
            principal_point: [0.0; 2],
            radial: [0.0; 3],
            tangential: [0.0; 2],
            affinity: [0.0; 2],
            direction: LensDirection::Correcting,
        }
    }

    /// c, x0, y0, K1, K2, K3, P1, P2, B1, B2.
    #[must_use]
    pub fn to_vector(&self) -> SVector<f64, 10> {
        let [x0, y0] = self.principal_point;
        let [k1, k2, k3] = self.radial;
        let [p1, p2] = self.tangential;
        let [b1, b2] = self.affinity;
        SVector::from([self.principal_distance, x0, y0, k1, k2, k3, p1, p2, b1, b2])
    }

    /// The same kind of lens with these parameters, in the order of [`Self::to_vector`].
    #[must_use]
    pub fn with_values(&self, v: &SVector<f64, 10>) -> Self {
        Self {
            principal_distance: v[0],
            principal_point: [v[1], v[2]],
            radial: [v[3], v[4], v[5]],
            tangential: [v[6], v[7]],
            affinity: [v[8], v[9]],
            direction: self.direction,
        }
    }

    /// The ideal image point of a measured one, mm. With `xb = x - x0`, `rad = K1 r2 + K2 r2^2 + K3 r2^3`, in the correcting direction:
    /// `x' = xb + xb rad + P1 (r2 + 2 xb^2) + 2 P2 xb yb + B1 xb + B2 yb`, `y' = yb + yb rad + P2 (r2 + 2 yb^2) + 2 P1 xb yb`.
    ///
    /// In the displacing direction by Newton's method; where the distortion folds over, the nearest that it comes to.
    #[must_use]
    pub fn ideal_from_measured(&self, measured: &Vector2<f64>) -> Vector2<f64> {
        let from_point = measured - Vector2::from(self.principal_point);
        match self.direction {
            LensDirection::Correcting | LensDirection::CorrectingAffinityFirst => {
                self.brown(&from_point).value
            }
            LensDirection::Displacing { .. } | LensDirection::DisplacingAffinityLast => {
                match self.other_side(&from_point, from_point) {
                    Ok(ideal) | Err(ideal) => ideal,
                }
            }
        }
    }

    /// [`Self::ideal_from_measured`] with its derivatives; `None` where the distortion folds over.
    #[must_use]
    pub fn correction(&self, measured: &Vector2<f64>) -> Option<Correction> {
        let from_point = measured - Vector2::from(self.principal_point);
        match self.direction {
            LensDirection::Correcting | LensDirection::CorrectingAffinityFirst => {
                let brown = self.brown(&from_point);
                let mut by_interior = brown.by_coefficients();
                by_interior
                    .fixed_columns_mut::<2>(1)
                    .copy_from(&-brown.by_point);
                Some(Correction {
                    ideal: brown.value,
                    by_measured: brown.by_point,
                    by_interior,
                })
            }
            LensDirection::Displacing { .. } | LensDirection::DisplacingAffinityLast => {
                let ideal = self.other_side(&from_point, from_point).ok()?;
                let there = self.displacement_by(&self.brown(&ideal));
                let by_measured = there.by_ideal.try_inverse()?;
                Some(Correction {
                    ideal,
                    by_measured,
                    by_interior: -by_measured * there.by_interior,
                })
            }
        }
    }

    /// The measured image point of an ideal one with its derivatives; `None` where the distortion folds over on the way there: such a
    /// point is not imaged by this lens.
    #[must_use]
    pub fn displacement(&self, ideal: &Vector2<f64>) -> Option<Displacement> {
        match self.direction {
            LensDirection::Correcting | LensDirection::CorrectingAffinityFirst => {
                let measured = self.measured_from_ideal(ideal)?;
                let back = self.correction(&measured)?;
                let by_ideal = back.by_measured.try_inverse()?;
                Some(Displacement {
                    measured,
                    by_ideal,
                    by_interior: -by_ideal * back.by_interior,
                })
            }
            LensDirection::Displacing { .. } | LensDirection::DisplacingAffinityLast => {
                let brown = self.brown(ideal);
                brown.is_unfolded().then(|| self.displacement_by(&brown))
            }
        }
    }

    /// The measured image point of an ideal one, mm.
    ///
    /// `None` where the distortion folds over on the way there: such a point is not imaged by this lens.
    #[must_use]
    pub fn measured_from_ideal(&self, ideal: &Vector2<f64>) -> Option<Vector2<f64>> {
        let principal_point = Vector2::from(self.principal_point);
        let from_point = match self.direction {
            LensDirection::Correcting | LensDirection::CorrectingAffinityFirst => {
                self.other_side(ideal, *ideal).ok()?
            }
            LensDirection::Displacing { .. } | LensDirection::DisplacingAffinityLast => {
                let brown = self.brown(ideal);
                brown.is_unfolded().then_some(brown.value)?
            }
        };
        Some(from_point + principal_point)
    }

    /// Second derivatives of the ideal point's x' and y' by the measured point at an image point, mm^-1; `None` where the
    /// distortion folds over.
    ///
    /// Those of an inverse: with `m = g(i)` and `J = g'^-1` it is `i_k'' = -sum_l J_kl J^T g_l'' J`.
    #[must_use]
    pub fn curvature(&self, point: &ImagePoint) -> Option<[Matrix2<f64>; 2]> {
        match self.direction {
            LensDirection::Correcting | LensDirection::CorrectingAffinityFirst => {
                let from_point = point.measured - Vector2::from(self.principal_point);
                Some(self.brown(&from_point).curvature())
            }
            LensDirection::Displacing { .. } | LensDirection::DisplacingAffinityLast => {
                let brown = self.brown(&point.ideal);
                let back = brown.by_point.try_inverse()?;
                let bent = brown.curvature().map(|of| back.transpose() * of * back);
                Some(std::array::from_fn(|k| {
                    -(bent[0] * back[(k, 0)] + bent[1] * back[(k, 1)])
                }))
            }
        }
    }

    fn displacement_by(&self, brown: &Brown) -> Displacement {
        let mut by_interior = brown.by_coefficients();
        by_interior
            .fixed_columns_mut::<2>(1)
            .copy_from(&Matrix2::identity());
        Displacement {
            measured: brown.value + Vector2::from(self.principal_point),
            by_ideal: brown.by_point,
            by_interior,
        }
    }

    fn brown(&self, from_point: &Vector2<f64>) -> Brown {
        match self.direction {
            LensDirection::Correcting => Brown::at(self, 0.0, from_point),
            LensDirection::CorrectingAffinityFirst => Brown::after_affinity(self, from_point),
            LensDirection::Displacing { balanced_radius_mm } => {
                Brown::at(self, balanced_radius_mm, from_point)
            }
            LensDirection::DisplacingAffinityLast => Brown::before_affinity(self, from_point),
        }
    }

    /// The point whose distorted place is `distorted`, by Newton's method; the last one where it does not come there, or only beyond a
    /// fold.
    fn other_side(
        &self,
        distorted: &Vector2<f64>,
        start: Vector2<f64>,
    ) -> Result<Vector2<f64>, Vector2<f64>> {
        let mut at = start;
        for _ in 0..STEPS {
            let brown = self.brown(&at);
            if brown.by_point.determinant() <= 0.0 {
                return Err(at);
            }
            let Some(inverse) = brown.by_point.try_inverse() else {
                return Err(at);
            };
            let step = inverse * (distorted - brown.value);
            at += step;
            if step.norm() < LAST_STEP_MM * (1.0 + at.norm()) {
                return if brown.is_unfolded() { Ok(at) } else { Err(at) };
            }
        }
        Err(at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lens(direction: LensDirection) -> InteriorOrientation {
        InteriorOrientation {
            principal_distance: 20.0,
            principal_point: [0.1, -0.05],
            radial: [1.5e-4, -4e-7, 2e-10],
            tangential: [1e-5, -2e-5],
            affinity: [1e-4, -5e-5],
            direction,
        }
    }

    fn any_direction() -> impl Strategy<Value = LensDirection> {
        prop_oneof![
            Just(LensDirection::Correcting),
            Just(LensDirection::CorrectingAffinityFirst),
            Just(LensDirection::DisplacingAffinityLast),
            (0.0..15.0)
                .prop_map(|balanced_radius_mm| LensDirection::Displacing { balanced_radius_mm }),
        ]
    }

    /// Steps that move an image point by some 1e-4 mm whatever the parameter's unit.
    const STEPS: [f64; 10] = [1e-4, 1e-4, 1e-4, 1e-7, 1e-9, 1e-11, 1e-6, 1e-6, 1e-5, 1e-5];

    fn stepped(lens: &InteriorOrientation, parameter: usize, by: f64) -> InteriorOrientation {
        let mut values = lens.to_vector();
        values[parameter] += by;
        lens.with_values(&values)
    }

    proptest! {
        #[test]
        fn both_sides_of_a_lens_agree(direction in any_direction(), x in -13.0..13.0, y in -9.0..9.0) {
            let (lens, measured) = (lens(direction), Vector2::new(x, y));
            let back = lens.measured_from_ideal(&lens.ideal_from_measured(&measured)).unwrap();
            prop_assert!((back - measured).norm() < 1e-11);
        }

        #[test]
        fn derivatives_agree_with_differences(direction in any_direction(), x in -13.0..13.0, y in -9.0..9.0) {
            let (lens, measured) = (lens(direction), Vector2::new(x, y));
            let correction = lens.correction(&measured).unwrap();
            let displacement = lens.displacement(&correction.ideal).unwrap();
            let point = ImagePoint { ideal: correction.ideal, measured };
            prop_assert!((displacement.measured - measured).norm() < 1e-11);
            let h = 1e-5;
            for axis in 0..2 {
                let mut step = Vector2::zeros();
                step[axis] = h;
                let ideal = (lens.ideal_from_measured(&(measured + step)) - lens.ideal_from_measured(&(measured - step))) / (2.0 * h);
                prop_assert!((ideal - correction.by_measured.column(axis)).norm() < 1e-8);
                let there = [step, -step].map(|step| lens.measured_from_ideal(&(correction.ideal + step)).unwrap());
                prop_assert!(((there[0] - there[1]) / (2.0 * h) - displacement.by_ideal.column(axis)).norm() < 1e-8);
                let slopes = [step, -step].map(|step| lens.correction(&(measured + step)).unwrap().by_measured);
                let bent = (slopes[0] - slopes[1]) / (2.0 * h);
                for (row, curvature) in lens.curvature(&point).unwrap().iter().enumerate() {
                    prop_assert!((bent.row(row).transpose() - curvature.column(axis)).norm() < 1e-8);
                }
            }
            for (parameter, h) in STEPS.into_iter().enumerate() {
                let sides = [h, -h].map(|h| stepped(&lens, parameter, h));
                let ideal = sides.map(|lens| lens.ideal_from_measured(&measured));
                let there = sides.map(|lens| lens.measured_from_ideal(&correction.ideal).unwrap());
                for (ends, derivative) in [(ideal, correction.by_interior), (there, displacement.by_interior)] {
                    let derivative = derivative.column(parameter);
                    // K3 steps move a corner by 2 um, where the other side bends; the last Newton step is below 1e-13 of 16 mm.
                    prop_assert!(((ends[0] - ends[1]) / (2.0 * h) - derivative).norm() < 1e-5 * (1.0 + derivative.norm()) + 2e-12 / h, "{parameter}");
                }
            }
        }
    }

    #[test]
    fn a_displacing_lens_is_the_one_of_the_published_formula() {
        let lens = InteriorOrientation {
            principal_distance: 28.0,
            principal_point: [0.02, 0.05],
            radial: [-1.1e-4, 1.5e-7, 0.0],
            tangential: [6e-6, -9e-6],
            affinity: [-7e-5, -3e-5],
            direction: LensDirection::Displacing {
                balanced_radius_mm: 13.488,
            },
        };
        let (px, py, r0) = (7.0_f64, -5.0_f64, 13.488_f64);
        let r2 = px * px + py * py;
        let f = -1.1e-4 * (r2 - r0 * r0) + 1.5e-7 * (r2 * r2 - r0.powi(4));
        let x = px + 0.02 + px * f + 6e-6 * (r2 + 2.0 * px * px) + 2.0 * -9e-6 * px * py
            - 7e-5 * px
            - 3e-5 * py;
        let y = py + 0.05 + py * f - 9e-6 * (r2 + 2.0 * py * py) + 2.0 * 6e-6 * px * py;
        let measured = lens.measured_from_ideal(&Vector2::new(px, py)).unwrap();
        assert!((measured - Vector2::new(x, y)).norm() < 1e-14);
    }

    #[test]
    fn a_point_beyond_the_fold_is_not_imaged() {
        let mut folding = InteriorOrientation::pinhole(20.0);
        folding.radial[0] = -2e-3;
        assert_eq!(folding.measured_from_ideal(&Vector2::new(40.0, 0.0)), None);
        // It rises again beyond 19.3 mm: a radius of 29.5 mm there is taken to this place, past two folds.
        folding.radial = [-4e-3, 5e-6, 0.0];
        let beyond = Vector2::new(29.5, 0.0);
        let ideal = folding.ideal_from_measured(&beyond);
        assert!((ideal.x - 38.5).abs() < 0.1, "{ideal}");
        assert_eq!(folding.measured_from_ideal(&ideal), None);
    }

    #[test]
    fn a_displacing_lens_images_nothing_beyond_its_fold() {
        let cases = [
            // r - 0.002 r^3 turns back at 12.9 mm and is mirrored from 22.4 mm on.
            ([-2e-3, 0.0, 0.0], 12.0, true),
            ([-2e-3, 0.0, 0.0], 40.0, false),
            // The radius turns back at some 5 mm, and once more before 8 mm.
            ([-2e-2, 1.5e-4, 0.0], 4.0, true),
            ([-2e-2, 1.5e-4, 0.0], 10.0, false),
            ([-2e-2, 0.0, 1.5e-6], 10.0, false),
        ];
        let displacing = LensDirection::Displacing {
            balanced_radius_mm: 0.0,
        };
        for direction in [displacing, LensDirection::DisplacingAffinityLast] {
            for (radial, x, is_imaged) in cases {
                let lens = InteriorOrientation {
                    radial,
                    direction,
                    ..InteriorOrientation::pinhole(20.0)
                };
                let ideal = Vector2::new(x, 0.0);
                // At the place itself nothing is to be seen of it.
                assert!(lens.brown(&ideal).by_point.determinant() > 0.0);
                assert_eq!(lens.measured_from_ideal(&ideal).is_some(), is_imaged);
                assert_eq!(lens.displacement(&ideal).is_some(), is_imaged);
            }
        }
    }
}
