//! The grey values of a blurred elliptic dot, and their derivatives.

use nalgebra::{Matrix2, SVector, Vector2};

use super::ellipse::Ellipse;

/// Number of parameters of a [`Profile`].
pub(super) const PARAMETERS: usize = 12;

/// Parameters in the order of the derivatives: centre x, y; shape xx, xy, yy; blur; background and its slopes along
/// x, y; amplitude and its slopes along x, y.
pub(super) type Parameters = SVector<f64, PARAMETERS>;

/// Place of the blur in [`Parameters`].
pub(super) const BLUR: usize = 5;
/// Place of the background at the origin.
pub(super) const BACKGROUND: usize = 6;
/// Place of the amplitude at the origin.
pub(super) const AMPLITUDE: usize = 9;

/// From this many blurs off the edge on the profile is flat.
const FLAT: f64 = 4.0;

/// `I(p) = background(p) + amplitude(p) Phi((d(p) - blur^2 k(p) / 2) / blur)` with the signed distance `d` from the
/// ellipse, positive inside, to first order of its implicit equation (Sampson, 1982), and the curvature `k` of the
/// ellipse in the direction of `p`: a blurred convex edge retreats by half the curvature times the blur's variance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Profile {
    pub(super) parameters: Parameters,
}

/// Where a pixel lies, which tells which derivatives vanish.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Zone {
    Outside,
    Edge,
    Inside,
}

/// Value and derivatives at one place.
pub(super) struct Sample {
    pub(super) value: f64,
    pub(super) derivatives: Parameters,
    pub(super) zone: Zone,
}

/// A place as seen from the ellipse.
struct Offset {
    dx: f64,
    dy: f64,
    gx: f64,
    gy: f64,
    /// 1 on the ellipse, growing linearly from its centre.
    level: f64,
    /// Length of (gx, gy): half the gradient of the squared level.
    gradient: f64,
    distance: f64,
}

impl Profile {
    pub(super) fn new(ellipse: &Ellipse, blur: f64, background: f64, amplitude: f64) -> Self {
        let mut parameters = Parameters::zeros();
        parameters[0] = ellipse.centre.x;
        parameters[1] = ellipse.centre.y;
        parameters[2] = ellipse.shape[(0, 0)];
        parameters[3] = ellipse.shape[(0, 1)];
        parameters[4] = ellipse.shape[(1, 1)];
        parameters[BLUR] = blur;
        parameters[BACKGROUND] = background;
        parameters[AMPLITUDE] = amplitude;
        Self { parameters }
    }

    pub(super) fn ellipse(&self) -> Ellipse {
        let p = &self.parameters;
        Ellipse {
            centre: Vector2::new(p[0], p[1]),
            shape: Matrix2::new(p[2], p[3], p[3], p[4]),
        }
    }

    pub(super) fn blur(&self) -> f64 {
        self.parameters[BLUR]
    }

    /// Background at the dot's centre.
    pub(super) fn background(&self) -> f64 {
        let p = &self.parameters;
        p[6] + p[7] * p[0] + p[8] * p[1]
    }

    /// Amplitude at the dot's centre.
    pub(super) fn amplitude(&self) -> f64 {
        let p = &self.parameters;
        p[9] + p[10] * p[0] + p[11] * p[1]
    }

    /// Signed distance from the edge, px, positive inside.
    pub(super) fn distance(&self, place: Vector2<f64>) -> f64 {
        self.offset(place).distance
    }

    fn offset(&self, place: Vector2<f64>) -> Offset {
        let p = &self.parameters;
        let (dx, dy) = (place.x - p[0], place.y - p[1]);
        let (gx, gy) = (p[2] * dx + p[3] * dy, p[3] * dx + p[4] * dy);
        let level = (dx * gx + dy * gy).max(0.0).sqrt();
        let gradient = (gx * gx + gy * gy).sqrt();
        let distance = if gradient > 0.0 {
            (level - level * level) / gradient
        } else {
            // The centre itself: as far inside as the mean radius.
            (p[2] * p[4] - p[3] * p[3])
                .max(f64::MIN_POSITIVE)
                .powf(-0.25)
        };
        Offset {
            dx,
            dy,
            gx,
            gy,
            level,
            gradient,
            distance,
        }
    }

    /// Curvature of the ellipse where the ray from its centre through a place meets it, px^-1.
    fn curvature(&self, at: &Offset) -> f64 {
        if at.gradient <= 0.0 {
            return 0.0;
        }
        let p = &self.parameters;
        let across = at.gy * at.gy * p[2] - 2.0 * at.gx * at.gy * p[3] + at.gx * at.gx * p[4];
        at.level * across / (at.gradient * at.gradient * at.gradient)
    }

    pub(super) fn value(&self, place: Vector2<f64>) -> f64 {
        self.value_with(place, self.curvature(&self.offset(place)))
    }

    fn value_with(&self, place: Vector2<f64>, curvature: f64) -> f64 {
        let p = &self.parameters;
        let background = p[6] + p[7] * place.x + p[8] * place.y;
        let amplitude = p[9] + p[10] * place.x + p[11] * place.y;
        let blurs = self.distance(place) / p[BLUR] - 0.5 * p[BLUR] * curvature;
        background + amplitude * NormalLaw::at(blurs).below
    }

    /// Value and derivatives; the curvature, a small correction, is held fixed.
    pub(super) fn sample(&self, place: Vector2<f64>) -> Sample {
        let p = &self.parameters;
        let mut derivatives = Parameters::zeros();
        derivatives[6] = 1.0;
        derivatives[7] = place.x;
        derivatives[8] = place.y;
        let background = p[6] + p[7] * place.x + p[8] * place.y;
        let amplitude = p[9] + p[10] * place.x + p[11] * place.y;
        let at = self.offset(place);
        let distance = at.distance;
        let curvature = if distance.abs() > FLAT * p[BLUR] {
            0.0
        } else {
            self.curvature(&at)
        };
        let blurs = distance / p[BLUR] - 0.5 * p[BLUR] * curvature;
        if blurs < -FLAT {
            return Sample {
                value: background,
                derivatives,
                zone: Zone::Outside,
            };
        }
        let law = NormalLaw::at(blurs);
        let share = law.below;
        derivatives[9] = share;
        derivatives[10] = share * place.x;
        derivatives[11] = share * place.y;
        let value = background + amplitude * share;
        if blurs > FLAT {
            return Sample {
                value,
                derivatives,
                zone: Zone::Inside,
            };
        }
        let by_distance = amplitude * law.density / p[BLUR];
        self.derive_distance(&at, by_distance, &mut derivatives);
        derivatives[BLUR] = -by_distance * (distance / p[BLUR] + 0.5 * p[BLUR] * curvature);
        Sample {
            value,
            derivatives,
            zone: Zone::Edge,
        }
    }

    /// Derivatives of `d = (q - q^2) / G` with `q^2 = u^T M u` and `G = |M u|`, times `factor`.
    fn derive_distance(&self, at: &Offset, factor: f64, derivatives: &mut Parameters) {
        let p = &self.parameters;
        let &Offset {
            dx,
            dy,
            gx,
            gy,
            level,
            gradient,
            distance,
        } = at;
        if gradient <= 0.0 || level <= 0.0 {
            return;
        }
        let by_square = factor * (1.0 - 2.0 * level) / (2.0 * level * gradient);
        let by_gradient_square = -factor * distance / (2.0 * gradient * gradient);
        let (hx, hy) = (p[2] * gx + p[3] * gy, p[3] * gx + p[4] * gy);
        derivatives[0] = -2.0 * (by_square * gx + by_gradient_square * hx);
        derivatives[1] = -2.0 * (by_square * gy + by_gradient_square * hy);
        derivatives[2] = by_square * dx * dx + by_gradient_square * 2.0 * gx * dx;
        derivatives[3] = by_square * 2.0 * dx * dy + by_gradient_square * 2.0 * (gx * dy + gy * dx);
        derivatives[4] = by_square * dy * dy + by_gradient_square * 2.0 * gy * dy;
    }
}

/// The standard normal law at one place.
struct NormalLaw {
    density: f64,
    /// The share of the law below the place.
    below: f64,
}

impl NormalLaw {
    /// Rational approximation of Hart (1968, no. 5666) as given by West (2005): right to 1e-15 where |x| < 7.
    fn at(x: f64) -> Self {
        const ROOT_OF_TURN: f64 = 2.506_628_274_631_000_5;
        const ABOVE: [f64; 7] = [
            0.035_262_496_599_891_1,
            0.700_383_064_443_688,
            6.373_962_203_531_65,
            33.912_866_078_383,
            112.079_291_497_871,
            221.213_596_169_931,
            220.206_867_912_376,
        ];
        const BELOW: [f64; 8] = [
            0.088_388_347_648_318_4,
            1.755_667_163_182_64,
            16.064_177_579_207,
            86.780_732_202_946_1,
            296.564_248_779_674,
            637.333_633_378_831,
            793.826_512_519_948,
            440.413_735_824_752,
        ];
        let size = x.abs();
        let power = (-0.5 * x * x).exp();
        let horner = |terms: &[f64]| terms.iter().fold(0.0, |sum, term| sum * size + term);
        let tail = if size > 7.0 {
            0.0
        } else {
            power * horner(&ABOVE) / horner(&BELOW)
        };
        Self {
            density: power / ROOT_OF_TURN,
            below: if x > 0.0 { 1.0 - tail } else { tail },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::ellipse::Axes;
    use super::*;

    #[test]
    fn the_normal_law_has_its_tabled_values() {
        for (x, below) in [
            (-3.0, 0.001_349_898_031_630_094_5),
            (-1.0, 0.158_655_253_931_457_05),
            (0.0, 0.5),
            (1.96, 0.975_002_104_851_779_5),
            (4.0, 0.999_968_328_758_166_9),
        ] {
            assert!((NormalLaw::at(x).below - below).abs() < 1e-14, "{x}");
        }
        assert!((NormalLaw::at(0.5).density - 0.352_065_326_764_299_5).abs() < 1e-14);
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let axes = Axes {
            major: 5.0,
            minor: 2.5,
            angle: 0.7,
        };
        let mut profile = Profile::new(
            &Ellipse::from_axes(Vector2::new(0.3, -0.2), axes),
            0.9,
            20.0,
            130.0,
        );
        profile.parameters[7] = 0.4;
        profile.parameters[11] = -2.0;
        for place in [
            Vector2::new(2.4, 1.1),
            Vector2::new(-4.0, -4.0),
            Vector2::new(0.8, -0.3),
            Vector2::new(0.5, 3.6),
        ] {
            let analytic = profile.sample(place);
            let curvature = profile.curvature(&profile.offset(place));
            assert!((analytic.value - profile.value(place)).abs() < 1e-9);
            for slot in 0..PARAMETERS {
                let step = 1e-6;
                let at = |sign: f64| {
                    let mut moved = profile;
                    moved.parameters[slot] += sign * step;
                    moved.value_with(place, curvature)
                };
                let difference = (at(1.0) - at(-1.0)) / (2.0 * step);
                let scale = 1.0 + difference.abs();
                assert!(
                    (analytic.derivatives[slot] - difference).abs() < 1e-5 * scale,
                    "parameter {slot}"
                );
            }
        }
    }
}
