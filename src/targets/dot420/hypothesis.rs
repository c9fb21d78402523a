//! Every choice of six dots that might be a code: O, A, B by the metric of the outlines, the rest by the grid.

use std::sync::OnceLock;

use nalgebra::{Matrix2, Vector2};

use super::Dot420Settings;
use super::neighbours::Neighbourhood;
use super::outline::{Agreement, Outline, agreement, distance_bounds};
use super::plane::{GridDot, Plane};
use crate::targets::{DOT420_AXES, Dot, dot420_positions, dot420_table};

/// Length of OA and OB, pitches.
const AXIS_PITCHES: f64 = 6.0;
/// How far from O a dot of the code can stand, pitches: position (5, 4), and some perspective.
const REACH_PITCHES: f64 = 6.8;
/// How far a code dot may lie from its position by the affine map of O, A, B, pitches: a change of depth by a sixth
/// across the code moves the middle that far.
const AFFINE_TOLERANCE: f64 = 0.35;
/// Wider tolerance of outlines (share of the semi-axes) while the map is only affine.
const AFFINE_OUTLINE_SHARE: f64 = 0.06;
/// Dots of one code do not differ more in area than by this factor: more than the sizes' tolerance and perspective.
const AREA_RATIO: f64 = 3.0;
/// A dot's own sigma counts up to this many pitches: a poorer centre must not make room for a foreign dot.
const LARGEST_SIGMA_PITCHES: f64 = 0.02;

/// Planes that miss the grid by more than this multiple of the largest misfit allowed are not fitted again by the camera.
const WORTH_A_CAMERA: f64 = 1.5;

/// Six dots as a code, with the plane that fits them.
#[derive(Clone, Debug)]
pub(super) struct Hypothesis {
    /// Slots of O, A, B, 1, 2, 3.
    pub(super) slots: [usize; 6],
    /// Their places on the grid, pitches.
    pub(super) grid: [[i32; 2]; 6],
    /// Number of the code.
    pub(super) id: u32,
    /// The fitted plane.
    pub(super) plane: Plane,
}

/// The dots with what the search needs of them.
pub(super) struct Field<'a> {
    pub(super) dots: &'a [Dot],
    /// Outline of each dot; `None` for those that cannot be a code's dot.
    pub(super) outlines: Vec<Option<Outline>>,
    pub(super) index: Neighbourhood,
    pub(super) settings: &'a Dot420Settings,
}

struct Neighbour {
    slot: usize,
    step_px: Vector2<f64>,
    outline: Outline,
}

impl<'a> Field<'a> {
    pub(super) fn new(dots: &'a [Dot], settings: &'a Dot420Settings) -> Self {
        let usable = |dot: &Dot| dot.centre_px.iter().all(|v| v.is_finite()) && dot.sigma_px >= 0.0;
        let outlines: Vec<Option<Outline>> = dots
            .iter()
            .map(|dot| Outline::new(dot).filter(|_| usable(dot)))
            .collect();
        let mut sizes: Vec<f64> = outlines
            .iter()
            .flatten()
            .map(|o| o.largest_px_per_pitch(settings))
            .collect();
        sizes.sort_by(f64::total_cmp);
        let middle = sizes.get(sizes.len() / 2).copied().unwrap_or(1.0);
        Self {
            dots,
            outlines,
            index: Neighbourhood::new(dots, REACH_PITCHES / 2.0 * middle),
            settings,
        }
    }

    /// All hypotheses whose origin is this dot, with a plane that could be fitted.
    pub(super) fn hypotheses(&self, origin: usize) -> Vec<Hypothesis> {
        let Some(outline) = self.outlines[origin] else {
            return Vec::new();
        };
        let neighbours = self.neighbours(origin, &outline);
        let ends: Vec<&Neighbour> = neighbours
            .iter()
            .filter(|n| {
                distance_bounds([&outline, &n.outline], n.step_px, self.settings)
                    .is_some_and(|[low, high]| low <= AXIS_PITCHES && AXIS_PITCHES <= high)
            })
            .collect();
        let mut found = Vec::new();
        for a in &ends {
            for b in &ends {
                // Counter-clockwise with y up is a negative turn with y down; this also settles which end is A.
                if a.step_px.perp(&b.step_px) >= 0.0 {
                    continue;
                }
                let px_from_pitches = Matrix2::from_columns(&[a.step_px, b.step_px]) / AXIS_PITCHES;
                let axes = [outline, a.outline, b.outline];
                let maps = [px_from_pitches; 3];
                if agreement(&axes, &maps, AFFINE_OUTLINE_SHARE, self.settings) == Agreement::Agree
                {
                    self.extend(
                        origin,
                        [a.slot, b.slot],
                        px_from_pitches,
                        &neighbours,
                        &mut found,
                    );
                }
            }
        }
        found
    }

    fn neighbours(&self, origin: usize, outline: &Outline) -> Vec<Neighbour> {
        let reach_px = REACH_PITCHES * outline.largest_px_per_pitch(self.settings);
        let centre = self.dots[origin].centre_px;
        self.index
            .within(self.dots, centre, reach_px)
            .into_iter()
            .filter(|&slot| slot != origin)
            .filter_map(|slot| {
                let other = self.outlines[slot]?;
                let alike = (other.log_area() - outline.log_area()).abs() < AREA_RATIO.ln();
                alike.then(|| Neighbour {
                    slot,
                    step_px: self.dots[slot].centre_px - centre,
                    outline: other,
                })
            })
            .collect()
    }

    /// Adds every three dots inside the parallelogram that make a code with these axes.
    fn extend(
        &self,
        origin: usize,
        ends: [usize; 2],
        px_from_pitches: Matrix2<f64>,
        neighbours: &[Neighbour],
        found: &mut Vec<Hypothesis>,
    ) {
        let Some(pitches_from_px) = px_from_pitches.try_inverse() else {
            return;
        };
        let inside: Vec<(usize, usize)> = neighbours
            .iter()
            .filter(|n| !ends.contains(&n.slot))
            .filter_map(|n| Some((position_at(pitches_from_px * n.step_px)?, n.slot)))
            .collect();
        let positions = dot420_positions();
        let scale = px_from_pitches.determinant().abs().sqrt();
        for (i, &first) in inside.iter().enumerate() {
            for (j, &second) in inside.iter().enumerate().skip(i + 1) {
                for &third in &inside[j + 1..] {
                    let mut three = [first, second, third];
                    three.sort_unstable();
                    let Some(id) = number_at(three.map(|(position, _)| position)) else {
                        continue;
                    };
                    let [p, q, r] = three.map(|(position, _)| positions[position]);
                    let [o, a, b] = DOT420_AXES;
                    let grid = [o, a, b, p, q, r];
                    let slots = [origin, ends[0], ends[1], three[0].1, three[1].1, three[2].1];
                    let plane = self.plane(&self.grid_dots(slots, grid, scale));
                    found.extend(plane.map(|plane| Hypothesis {
                        slots,
                        grid,
                        id,
                        plane,
                    }));
                }
            }
        }
    }

    /// The plane of six dots, by the camera where one is given and they are near enough to a code.
    fn plane(&self, dots: &[GridDot; 6]) -> Option<Plane> {
        let plane = Plane::fit(dots)?;
        let near = plane.standardised < WORTH_A_CAMERA * self.settings.refused_misfit;
        let camera = self.settings.camera.as_ref().filter(|_| near);
        let by_camera = camera.and_then(|camera| plane.with_camera(dots, camera));
        Some(by_camera.unwrap_or(plane))
    }

    /// The six dots at their places, as the fit sees them.
    pub(super) fn grid_dots_of(&self, reading: &Hypothesis) -> [GridDot; 6] {
        let [o, a, b, ..] = reading.slots.map(|slot| self.dots[slot].centre_px);
        let axes = Matrix2::from_columns(&[a - o, b - o]) / AXIS_PITCHES;
        self.grid_dots(reading.slots, reading.grid, axes.determinant().abs().sqrt())
    }

    fn grid_dots(&self, slots: [usize; 6], grid: [[i32; 2]; 6], px_per_pitch: f64) -> [GridDot; 6] {
        let model =
            (self.settings.grid_sigma_pitches * px_per_pitch).hypot(self.settings.centre_sigma_px);
        std::array::from_fn(|place| {
            let dot = &self.dots[slots[place]];
            GridDot {
                grid: grid[place],
                centre_px: dot.centre_px,
                sigma_px: dot
                    .sigma_px
                    .min(LARGEST_SIGMA_PITCHES * px_per_pitch)
                    .hypot(model),
                log_area: (dot.major_px * dot.minor_px).ln(),
                minor_px: dot.minor_px,
            }
        })
    }
}

/// The position (index into the 21) that a place in pitches belongs to.
fn position_at(place: Vector2<f64>) -> Option<usize> {
    let nearest = place.map(f64::round);
    if (place - nearest).norm() > AFFINE_TOLERANCE || nearest.amax() > 5.0 || nearest.min() < 1.0 {
        return None;
    }
    let wanted = [nearest.x as i32, nearest.y as i32];
    dot420_positions().iter().position(|p| *p == wanted)
}

/// The number of the code with these positions in rising order.
pub(super) fn number_at(positions: [usize; 3]) -> Option<u32> {
    static NUMBERS: OnceLock<Vec<u32>> = OnceLock::new();
    let slot = |p: [usize; 3]| (p[0] * 21 + p[1]) * 21 + p[2];
    let numbers = NUMBERS.get_or_init(|| {
        let places = dot420_positions();
        let mut numbers = vec![0; 21 * 21 * 21];
        for (index, code) in dot420_table().iter().enumerate() {
            let at = code.map(|place| places.iter().position(|p| *p == place).unwrap_or(0));
            numbers[slot(at)] = index as u32 + 1;
        }
        numbers
    });
    Some(numbers[slot(positions)]).filter(|&id| id != 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::targets::dot420_number;

    #[test]
    fn the_quick_table_says_what_the_family_says() {
        let places = dot420_positions();
        for i in 0..21 {
            for j in i..21 {
                for k in j..21 {
                    let slow = dot420_number([places[i], places[j], places[k]]);
                    assert_eq!(number_at([i, j, k]), slow, "{i} {j} {k}");
                }
            }
        }
    }

    #[test]
    fn only_the_21_positions_take_dots() {
        assert_eq!(position_at(Vector2::new(2.2, 0.9)), Some(0));
        assert_eq!(position_at(Vector2::new(1.0, 1.0)), None, "a corner");
        assert_eq!(position_at(Vector2::new(3.0, 0.1)), None, "the axis");
        assert_eq!(position_at(Vector2::new(2.5, 2.5)), None, "between");
        assert_eq!(position_at(Vector2::new(f64::NAN, 2.0)), None);
    }
}
