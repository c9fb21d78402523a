//! Plain targets that stand where a code's segments would.
//!
//! A segment two or three blurs wide looks much like a disc, and a code with few segments gives way in frame and perspective to where
//! discs stand. So a code all of whose light parts are about as long as wide is fitted once more with a disc in the place of each:
//! the picture says which of the two it is.

use std::f64::consts::{PI, TAU};

use nalgebra::{DMatrix, DVector, Vector2};

use super::first_look::MIDDLE;
use super::fitting::{Fitted, shown};
use super::frame::RingFrame;
use super::patch::{Patch, middle};
use super::sketch::{Jet, Sketch};

/// Unknowns of a disc: place along columns and rows, radius, light.
const UNKNOWNS: usize = 4;

/// A plain target beside the dot.
#[derive(Clone, Copy, Debug)]
struct Disc {
    /// Place, pixels of the patch.
    centre: Vector2<f64>,
    /// In radii of the dot.
    radius: f64,
    /// As a share of the light there.
    light: f64,
}

/// A pixel without the ring.
struct Pixel {
    column: usize,
    row: usize,
    /// Grey value above ground and dot.
    grey: f64,
    light: f64,
}

/// What discs in place of the light parts leave unexplained against what the code leaves, sums of squares; `None` where a part is
/// too long for a disc, or discs do not fit at all. `dot` is the frame of the dot alone.
///
/// Cost: a drawing a disc and step, pixels times the square of the discs.
pub(super) fn discs_against_code(patch: &Patch, dot: &RingFrame, fitted: &Fitted) -> Option<f64> {
    const STEPS: usize = 8;
    /// Motion after which no step is needed, pixels.
    const RESTS: f64 = 0.02;
    let mut discs = first_discs(fitted)?;
    let mut pixels = Vec::new();
    let mut of_code = 0.0;
    let shares = shown(&fitted.shares);
    let scene = &fitted.scene;
    scene.compare(patch, &fitted.sketch, &shares, |column, row, grey, seen| {
        let off = grey - seen.grey;
        of_code += off * off;
        pixels.push(Pixel {
            column,
            row,
            grey: off + seen.light * seen.ring.value,
            light: seen.light,
        });
    });
    let mut least = f64::INFINITY;
    for _ in 0..STEPS {
        let (rest, by) = step(patch, dot, scene.blur, &pixels, &discs)?;
        least = least.min(rest);
        let mut moved = 0.0_f64;
        for (disc, by) in discs.iter_mut().zip(by.as_slice().chunks(UNKNOWNS)) {
            disc.centre += Vector2::new(by[0], by[1]);
            disc.radius += by[2];
            disc.light += by[3];
            let radius = dot.map.norm() * by[2];
            moved = moved.max(by[0].hypot(by[1])).max(radius.abs());
            if !((0.2..1.6).contains(&disc.radius) && (0.3..3.0).contains(&disc.light)) {
                return None;
            }
        }
        if moved < RESTS {
            break;
        }
    }
    Some(least / of_code)
}

/// Discs as large as the light parts, where they are.
fn first_discs(fitted: &Fitted) -> Option<Vec<Disc>> {
    /// A part this much longer than wide is no disc.
    const LONGEST: f64 = 1.8;
    let bits = &fitted.bits;
    let count = bits.len();
    let per_segment = TAU / count as f64;
    let scene = &fitted.scene;
    let begins = (0..count).filter(|&at| bits[at] && !bits[(at + count - 1) % count]);
    begins
        .map(|begin| {
            let length = (0..count).take_while(|k| bits[(begin + k) % count]).count();
            let angle = length as f64 * per_segment;
            let share: f64 = (0..length)
                .map(|k| fitted.shares[(begin + k) % count])
                .sum();
            let towards = begin as f64 * per_segment + 0.5 * angle;
            (MIDDLE * angle < LONGEST).then(|| Disc {
                centre: scene.frame.place(towards, MIDDLE),
                radius: (MIDDLE * angle / PI).sqrt(),
                light: share / length as f64,
            })
        })
        .collect()
}

/// The sum of squares that the discs leave, and the step to better ones.
fn step(
    patch: &Patch,
    dot: &RingFrame,
    blur: f64,
    pixels: &[Pixel],
    discs: &[Disc],
) -> Option<(f64, DVector<f64>)> {
    let drawn: Vec<_> = discs
        .iter()
        .map(|disc| {
            let frame = RingFrame {
                centre: disc.centre,
                map: dot.map * disc.radius,
                tilt: Vector2::zeros(),
            };
            Some(Sketch::new(patch, &frame, 2, 1.0, blur)?.dot())
        })
        .collect::<Option<_>>()?;
    let unknowns = UNKNOWNS * discs.len();
    let mut normal = DMatrix::<f64>::zeros(unknowns, unknowns);
    let mut right = DVector::<f64>::zeros(unknowns);
    let mut squares = 0.0;
    let mut by = DVector::<f64>::zeros(unknowns);
    for pixel in pixels {
        let mut off = pixel.grey;
        for ((disc, drawn), by) in discs
            .iter()
            .zip(&drawn)
            .zip(by.as_mut_slice().chunks_mut(UNKNOWNS))
        {
            let jet: Jet = drawn.jet(pixel.column, pixel.row);
            let away = middle(pixel.column, pixel.row) - disc.centre;
            let light = disc.light * pixel.light;
            off -= light * jet.value;
            by[0] = -light * jet.slope.x;
            by[1] = -light * jet.slope.y;
            // With radius and blur the whole picture would grow; the blur stays.
            by[2] = -light * (jet.slope.dot(&away) + blur * blur * jet.laplacian) / disc.radius;
            by[3] = pixel.light * jet.value;
        }
        squares += off * off;
        normal.syger(1.0, &by, &by, 1.0);
        right.axpy(off, &by, 1.0);
    }
    normal.fill_upper_triangle_with_lower_triangle();
    Some((squares, normal.cholesky()?.solve(&right)))
}
