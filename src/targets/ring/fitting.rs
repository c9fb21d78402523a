//! From a first idea of where the grid of segments begins to the code that fits the pixels best.

use nalgebra::{SMatrix, SVector, Vector2};

use super::first_look::{MIDDLE, OUTER};
use super::frame::RingFrame;
use super::levels::{Levels, levels};
use super::patch::Patch;
use super::refine::{Scene, step};
use super::sketch::Sketch;

/// A code fitted to the pixels.
pub(super) struct Fitted {
    pub(super) bits: Vec<bool>,
    pub(super) scene: Scene,
    /// The scene drawn.
    pub(super) sketch: Sketch,
    /// The segments' levels as shares of the light.
    pub(super) shares: Vec<f64>,
    /// Their standard deviations from the noise.
    pub(super) sigmas: Vec<f64>,
    /// Root mean square of what the segments' own levels leave, as a share of the light.
    pub(super) rest: f64,
}

impl Fitted {
    pub(super) fn segments(&self) -> u8 {
        self.bits.len() as u8
    }

    /// How far from even the light falls: its change from the middle to the middle of the ring, as a share.
    pub(super) fn slope(&self) -> f64 {
        let [level, along_x, along_y] = self.scene.light;
        let per_radius = self.scene.frame.map.transpose() * Vector2::new(along_x, along_y);
        MIDDLE * per_radius.norm() / level
    }

    /// How far from even the ground is: its change from the middle to the outer edge of the ring, as a share of the light.
    pub(super) fn ground_slope(&self) -> f64 {
        let [_, along_x, along_y] = self.scene.ground;
        let per_radius = self.scene.frame.map.transpose() * Vector2::new(along_x, along_y);
        OUTER * per_radius.norm() / self.scene.light[0]
    }

    /// The bits as a number, the first most significant.
    pub(super) fn pattern(&self) -> u32 {
        self.bits
            .iter()
            .fold(0, |number, &bit| number << 1 | u32::from(bit))
    }
}

/// A frame turned to a grid, and the levels seen in it.
struct Look {
    frame: RingFrame,
    sketch: Sketch,
    levels: Levels,
}

fn look(patch: &Patch, frame: RingFrame, segments: u8) -> Option<Look> {
    let sketch = Sketch::new(patch, &frame, segments, 1.0, patch.blur)?;
    let levels = levels(patch, &sketch, segments)?;
    Some(Look {
        frame,
        sketch,
        levels,
    })
}

/// Fits a code of so many segments; `begins` are the places of its grid to be tried, in segments.
pub(super) fn fitted(
    patch: &Patch,
    frame: &RingFrame,
    segments: u8,
    begins: &[f64],
) -> Option<Fitted> {
    /// What no code leaves unexplained in any grid and in the best one, as a share of its light.
    const LARGEST_REST: f64 = 0.3;
    const LARGEST_REST_OF_BEST: f64 = 0.2;
    /// Light of the dot against the ring's, at least.
    const LEAST_DOT: f64 = 0.4;
    let per_segment = std::f64::consts::TAU / f64::from(segments);
    let local = frame.within(patch.corner, patch.step);
    let mut best: Option<Look> = None;
    for begin in begins {
        let next = look(patch, local.turned(begin * per_segment), segments)?;
        if next.levels.rest > LARGEST_REST * Light::of(&next.levels.segments)?.plane[0] {
            return None;
        }
        if best
            .as_ref()
            .is_none_or(|best| next.levels.rest < best.levels.rest)
        {
            best = Some(next);
        }
    }
    let best = best?;
    let light = Light::of(&best.levels.segments)?.plane[0];
    let like_a_code =
        best.levels.rest < LARGEST_REST_OF_BEST * light && best.levels.dot > LEAST_DOT * light;
    if !like_a_code {
        return None;
    }
    settled(patch, best, segments)
}

/// Bits and frame in turn until the bits stay.
fn settled(patch: &Patch, first: Look, segments: u8) -> Option<Fitted> {
    const ROUNDS: usize = 3;
    /// Steps a round at most, and a motion, in pixels, after which none is needed.
    const STEPS: usize = 8;
    const RESTS: f64 = 0.1;
    let Look {
        frame,
        mut sketch,
        mut levels,
    } = first;
    let mut light = Light::of(&levels.segments)?;
    let mut shares = light.shares(&levels.segments);
    let mut scene = Scene {
        frame,
        dot_radius: 1.0,
        blur: patch.blur,
        ground: levels.ground,
        light: light.over_pixels(&frame)?,
        dot_light: levels.dot / light.plane[0],
    };
    for _ in 0..ROUNDS {
        // What a frame that is not yet right makes of the levels would hold it where it is.
        let even = |share: &f64| f32::from(u8::from(is_light(share)));
        let even: Vec<f32> = shares.iter().map(even).collect();
        for _ in 0..STEPS {
            let step = step(patch, &sketch, &even, &scene)?;
            scene = step.scene;
            sketch = scene.sketch(patch, segments)?;
            if step.moved < RESTS {
                break;
            }
        }
        levels = self::levels(patch, &sketch, segments)?;
        light = Light::of(&levels.segments)?;
        let before = std::mem::replace(&mut shares, light.shares(&levels.segments));
        if before.iter().map(is_light).eq(shares.iter().map(is_light)) {
            break;
        }
    }
    // Now they are the film's.
    scene = step(patch, &sketch, &shown(&shares), &scene)?.scene;
    sketch = scene.sketch(patch, segments)?;
    levels = self::levels(patch, &sketch, segments)?;
    light = Light::of(&levels.segments)?;
    shares = light.shares(&levels.segments);
    Some(Fitted {
        sigmas: light.shares(&levels.sigmas),
        rest: levels.rest / light.plane[0],
        bits: shares.iter().map(is_light).collect(),
        shares,
        scene,
        sketch,
    })
}

fn is_light(share: &f64) -> bool {
    *share > 0.5
}

/// What a code shows whose film is uneven: light segments as light as they are, dark ones dark.
pub(super) fn shown(shares: &[f64]) -> Vec<f32> {
    let shown = |share: &f64| if is_light(share) { *share as f32 } else { 0.0 };
    shares.iter().map(shown).collect()
}

/// The light on the ring: mean, and slopes along the cosine and sine of the direction, grey values.
struct Light {
    plane: SVector<f64, 3>,
    segments: f64,
}

impl Light {
    /// A plane through the levels of what is light; `None` where nothing is.
    fn of(levels: &[f64]) -> Option<Self> {
        /// Weight of an even light against one segment.
        const EVEN: f64 = 1.0;
        let mut sorted = levels.to_vec();
        sorted.sort_by(f64::total_cmp);
        // Every code has two light segments.
        let second = *sorted.get(sorted.len().checked_sub(2)?)?;
        let mut light = Self {
            plane: SVector::<f64, 3>::new(second, 0.0, 0.0),
            segments: levels.len() as f64,
        };
        for _ in 0..3 {
            let mut normal = SMatrix::<f64, 3, 3>::identity() * EVEN;
            normal[(0, 0)] = 1e-6;
            let mut right = SVector::<f64, 3>::zeros();
            for (segment, &level) in levels.iter().enumerate() {
                let row = light.row(segment);
                if level > 0.65 * row.dot(&light.plane) {
                    normal += row * row.transpose();
                    right += row * level;
                }
            }
            light.plane = normal.cholesky()?.solve(&right);
        }
        (light.plane[0] > 0.0).then_some(light)
    }

    fn row(&self, segment: usize) -> SVector<f64, 3> {
        let (sin, cos) = (std::f64::consts::TAU * (segment as f64 + 0.5) / self.segments).sin_cos();
        SVector::<f64, 3>::new(1.0, cos, sin)
    }

    /// A level of a segment as a share of the light there.
    fn share(&self, segment: usize, level: f64) -> f64 {
        level / self.row(segment).dot(&self.plane).max(0.25 * self.plane[0])
    }

    fn shares(&self, levels: &[f64]) -> Vec<f64> {
        let levels = levels.iter().enumerate();
        levels
            .map(|(segment, &level)| self.share(segment, level))
            .collect()
    }

    /// Level and slopes per pixel.
    fn over_pixels(&self, frame: &RingFrame) -> Option<[f64; 3]> {
        let across = Vector2::new(self.plane[1], self.plane[2]) / MIDDLE;
        let slopes = frame.map.try_inverse()?.transpose() * across;
        Some([self.plane[0], slopes.x, slopes.y])
    }
}
