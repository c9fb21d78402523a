//! The frame, the grey values and the blur of a code whose segments are known, from all of its pixels: Gauss-Newton steps.
//!
//! A feature of the picture moves with the frame, so the derivative by a parameter of the frame is the slope of the
//! computed picture against that motion; the one by the blur is the blur times the Laplacian (the heat equation).

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use super::frame::RingFrame;
use super::levels::away;
use super::patch::{Patch, middle};
use super::sketch::{Jet, Sketch};

/// All that the picture of a code depends on but its bits.
#[derive(Clone, Debug)]
pub(super) struct Scene {
    pub(super) frame: RingFrame,
    /// Radius of the dot against that of the frame: 1 but for print and light.
    pub(super) dot_radius: f64,
    /// Standard deviation of the blur, pixels of the patch.
    pub(super) blur: f64,
    /// Ground at the middle of the patch, grey values, and its slopes per pixel.
    pub(super) ground: [f64; 3],
    /// Light above the ground, likewise.
    pub(super) light: [f64; 3],
    /// How light the dot is against the ring.
    pub(super) dot_light: f64,
}

fn plane([level, along_x, along_y]: [f64; 3], away: Vector2<f64>) -> f64 {
    level + along_x * away.x + along_y * away.y
}

/// The computed picture at a pixel.
pub(super) struct Seen {
    pub(super) dot: Jet,
    pub(super) ring: Jet,
    /// Light at the pixel, grey values.
    pub(super) light: f64,
    /// Grey value.
    pub(super) grey: f64,
}

impl Scene {
    /// The picture with segments as light as these shares: calls `see` with column, row, grey value and the computed picture at every pixel of the code; the sketch is of this scene.
    pub(super) fn compare(
        &self,
        patch: &Patch,
        sketch: &Sketch,
        shares: &[f32],
        mut see: impl FnMut(usize, usize, f64, &Seen),
    ) {
        let (dot, ring) = (sketch.dot(), sketch.ring(shares));
        for (column, row, grey) in patch.pixels() {
            let away = away(patch, column, row);
            let light = plane(self.light, away);
            let (dot, ring) = (dot.jet(column, row), ring.jet(column, row));
            let share = ring.value + self.dot_light * dot.value;
            let seen = Seen {
                dot,
                ring,
                light,
                grey: plane(self.ground, away) + light * share,
            };
            see(column, row, grey, &seen);
        }
    }

    /// The scene drawn.
    pub(super) fn sketch(&self, patch: &Patch, segments: u8) -> Option<Sketch> {
        Sketch::new(patch, &self.frame, segments, self.dot_radius, self.blur)
    }
}

pub(super) const UNKNOWNS: usize = 17;

/// By all that a scene depends on.
pub(super) type ByScene = SVector<f64, UNKNOWNS>;

/// A pixel of the code against the computed picture.
pub(super) struct Compared<'a> {
    pub(super) column: usize,
    pub(super) row: usize,
    /// Grey value above the computed one.
    pub(super) off: f64,
    pub(super) seen: &'a Seen,
    /// In radii of the dot, perspective left out.
    pub(super) affine: Vector2<f64>,
    /// Derivative of the grey value.
    pub(super) by: ByScene,
    pub(super) weight: f64,
}

/// The normal equations of a step.
pub(super) struct Equations {
    pub(super) normal: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    pub(super) right: ByScene,
}

/// Unevenness of film and print, as a share of the contrast.
const UNEVEN: f64 = 0.03;

impl Scene {
    /// Variance of a pixel from noise, film and print.
    pub(super) fn variance(&self, patch: &Patch) -> f64 {
        patch.noise.powi(2) + (UNEVEN * self.light[0]).powi(2)
    }

    /// The equations for all that the scene depends on; what departs by more than `sigmas` standard deviations loses its say. `see` sees
    /// every pixel.
    pub(super) fn equations(
        &self,
        patch: &Patch,
        sketch: &Sketch,
        shares: &[f32],
        sigmas: f64,
        mut see: impl FnMut(&Compared),
    ) -> Option<Equations> {
        let variance = self.variance(patch);
        let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut right = ByScene::zeros();
        let back = self.frame.map.try_inverse()?;
        self.compare(patch, sketch, shares, |column, row, grey, seen| {
            let off = grey - seen.grey;
            let affine = back * (middle(column, row) - self.frame.centre);
            let compared = Compared {
                column,
                row,
                off,
                seen,
                affine,
                by: self.by(seen, affine, away(patch, column, row)),
                weight: 1.0 / (variance + off * off / (sigmas * sigmas)),
            };
            let by = &compared.by;
            normal.syger(compared.weight, by, by, 1.0);
            right.axpy(compared.weight * off, by, 1.0);
            see(&compared);
        });
        normal.fill_upper_triangle_with_lower_triangle();
        let mut equations = Equations { normal, right };
        self.hold(patch, &mut equations);
        Some(equations)
    }

    /// Derivative of the computed grey value at a pixel.
    fn by(&self, seen: &Seen, affine: Vector2<f64>, away: Vector2<f64>) -> ByScene {
        let frame = &self.frame;
        let scale = 1.0 / (1.0 - frame.tilt.dot(&affine));
        let at = affine * scale;
        // What the frame's parameters move is map q / (1 + tilt q); 1 / (1 + tilt q) = 1 / scale.
        let shrunk = at / scale;
        let slope = -seen.light * (seen.ring.slope + self.dot_light * seen.dot.slope);
        let tilted = -(frame.map * at).dot(&slope) / (scale * scale);
        let share = seen.ring.value + self.dot_light * seen.dot.value;
        let spread = seen.ring.laplacian + self.dot_light * seen.dot.laplacian;
        ByScene::from([
            slope.x,
            slope.y,
            slope.x * shrunk.x,
            slope.x * shrunk.y,
            slope.y * shrunk.x,
            slope.y * shrunk.y,
            tilted * at.x,
            tilted * at.y,
            -seen.light * self.dot_light * seen.dot.slope.dot(&(frame.map * shrunk)),
            seen.light * self.blur * spread,
            1.0,
            away.x,
            away.y,
            share,
            share * away.x,
            share * away.y,
            seen.light * seen.dot.value,
        ])
    }

    /// Adds what is known before.
    fn hold(&self, patch: &Patch, equations: &mut Equations) {
        /// Standard deviations of the perspective per radius, dot's radius, blur as a share of itself, slope of the light across the code,
        /// light of the dot.
        const TILT: f64 = 0.02;
        const DOT_RADIUS: f64 = 0.03;
        const BLUR: f64 = 0.3;
        const SLOPE: f64 = 0.3;
        const DOT_LIGHT: f64 = 0.3;
        let mut hold = |unknown: usize, from: f64, sigma: f64| {
            let weight = sigma.powi(-2);
            equations.normal[(unknown, unknown)] += weight;
            equations.right[unknown] -= weight * from;
        };
        let reach = 0.5 * (patch.columns.max(patch.rows) as f64);
        let sloping = SLOPE * self.light[0] / reach;
        hold(6, self.frame.tilt.x, TILT);
        hold(7, self.frame.tilt.y, TILT);
        hold(8, self.dot_radius - 1.0, DOT_RADIUS);
        hold(9, self.blur - patch.blur, BLUR * patch.blur);
        hold(11, self.ground[1], sloping);
        hold(12, self.ground[2], sloping);
        hold(14, self.light[1], sloping);
        hold(15, self.light[2], sloping);
        hold(16, self.dot_light - 1.0, DOT_LIGHT);
    }
}

/// A scene and how far the last step moved the ring in it, pixels.
pub(super) struct Step {
    pub(super) scene: Scene,
    pub(super) moved: f64,
}

/// One step; `None` where it cannot be made or leads astray.
pub(super) fn step(patch: &Patch, sketch: &Sketch, shares: &[f32], scene: &Scene) -> Option<Step> {
    const SIGMAS: f64 = 3.0;
    let equations = scene.equations(patch, sketch, shares, SIGMAS, |_| ())?;
    let frame = &scene.frame;
    let by = equations.normal.cholesky()?.solve(&equations.right);
    let next = Scene {
        frame: RingFrame {
            centre: frame.centre + Vector2::new(by[0], by[1]),
            map: frame.map + Matrix2::new(by[2], by[3], by[4], by[5]),
            tilt: frame.tilt + Vector2::new(by[6], by[7]),
        },
        dot_radius: scene.dot_radius + by[8],
        blur: scene.blur + by[9],
        ground: std::array::from_fn(|k| scene.ground[k] + by[10 + k]),
        light: std::array::from_fn(|k| scene.light[k] + by[13 + k]),
        dot_light: scene.dot_light + by[16],
    };
    // At the ring's outer edge the map acts over three radii of the dot, the perspective over the square of that.
    let turned = 3.0 * by.fixed_rows::<4>(2).norm();
    let tilted = 9.0 * by.fixed_rows::<2>(6).norm() * frame.map.norm();
    let moved = by.fixed_rows::<2>(0).norm() + turned + tilted;
    next.is_plausible(patch)
        .then_some(Step { scene: next, moved })
}

impl Scene {
    /// How far perspective, print and blur had to be stretched to make the picture a code's, as a multiple of what happens.
    pub(super) fn strain(&self, patch: &Patch) -> f64 {
        self.strains(patch).into_iter().fold(0.0, f64::max)
    }

    /// The same of all of them and the light of the dot together: each may well be at its end, but not all at once.
    pub(super) fn strain_together(&self, patch: &Patch) -> f64 {
        /// Light of the dot against the ring's, its logarithm.
        const DOT_LIGHT: f64 = 0.3;
        let light = self.dot_light.ln() / DOT_LIGHT;
        let strains = self.strains(patch).into_iter().chain([light]);
        strains.map(|strain| strain * strain).sum::<f64>().sqrt()
    }

    fn strains(&self, patch: &Patch) -> [f64; 3] {
        /// A code of 120 radii away at 70 degrees has 0.008, a lens adds as much.
        const TILT: f64 = 0.03;
        const DOT_RADIUS: f64 = 0.06;
        const BLUR: f64 = 0.3;
        [
            self.frame.tilt.norm() / TILT,
            (self.dot_radius - 1.0).abs() / DOT_RADIUS,
            (self.blur / patch.blur).ln().abs() / BLUR,
        ]
    }

    fn is_plausible(&self, patch: &Patch) -> bool {
        self.frame.tilt.norm() < 0.15
            && (0.8..1.25).contains(&self.dot_radius)
            && (0.4..2.0).contains(&(self.blur / patch.blur))
            && self.light[0] > 0.0
            && self.frame.map.determinant() > 0.0
    }
}
