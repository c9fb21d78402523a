//! Triangles of one list that are congruent, or similar, to one of another: distances do not change with the frame.

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::geometry::{Scale, Similarity};

/// How many of the three distances' errors the third corner of a similar triangle may be off: its own and, through the
/// scale, that of the longest side.
const SIMILAR_SHARE: f64 = 2.0;

/// A triangle of known places; its longest side is from the first to the second corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Triangle {
    /// Corners, by their places in the list.
    pub(super) corners: [usize; 3],
    /// From the first to the second, from the first to the third, from the second to the third corner, mm.
    sides: [f64; 3],
}

impl Triangle {
    /// The triangle of three places; `None` where it is no higher than `least`, mm.
    pub(super) fn of(places: &[Vector3<f64>], corners: [usize; 3], least: f64) -> Option<Self> {
        let side = |a: usize, b: usize| (places[a] - places[b]).norm();
        let [a, b, c] = corners;
        let orders = [[a, b, c], [b, c, a], [c, a, b]];
        let [a, b, c] = orders
            .into_iter()
            .max_by(|x, y| side(x[0], x[1]).total_cmp(&side(y[0], y[1])))?;
        let triangle = Self {
            corners: [a, b, c],
            sides: [side(a, b), side(a, c), side(b, c)],
        };
        (triangle.height(places) > least).then_some(triangle)
    }

    /// Height over the longest side, mm; 0 where the places coincide.
    pub(super) fn height(&self, places: &[Vector3<f64>]) -> f64 {
        let [a, b, c] = self.corners.map(|corner| places[corner]);
        let double_area = (b - a).cross(&(c - a)).norm();
        if self.sides[0] > 0.0 {
            double_area / self.sides[0]
        } else {
            0.0
        }
    }
}

/// The distances among points, sorted, so that the ends of sides of a given length are found at once.
pub(super) struct Distances {
    /// For every point its distance to the others and which they are, nearest first.
    from: Vec<Vec<(f64, usize)>>,
    places: Vec<Vector3<f64>>,
}

impl Distances {
    pub(super) fn new(places: Vec<Vector3<f64>>) -> Self {
        let from = |own: usize| {
            let others = (0..places.len()).filter(|other| *other != own);
            let mut sorted: Vec<(f64, usize)> = others
                .map(|other| ((places[other] - places[own]).norm(), other))
                .collect();
            sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            sorted
        };
        Self {
            from: (0..places.len()).map(from).collect(),
            places,
        }
    }

    /// Calls `found` with every pose that lays three of the points on the corners of a triangle, all sides within
    /// `tolerance`, mm; ends where it says so.
    pub(super) fn poses_on(
        &self,
        known: &[Vector3<f64>],
        triangle: &Triangle,
        scale: Scale,
        tolerance: f64,
        found: &mut dyn FnMut(Similarity) -> Search,
    ) {
        let corners = triangle.corners.map(|corner| known[corner]);
        for first in 0..self.places.len() {
            let seconds = match scale {
                Scale::One => self.at(first, triangle.sides[0], tolerance),
                Scale::Free => &self.from[first],
            };
            for &(length, second) in seconds {
                let (scale, tolerance) = match scale {
                    Scale::One => (1.0, tolerance),
                    Scale::Free => (triangle.sides[0] / length, SIMILAR_SHARE * tolerance),
                };
                if !scale.is_finite() {
                    continue;
                }
                let [_, side, opposite] = triangle.sides.map(|side| side / scale);
                for &(_, third) in self.at(first, side, tolerance / scale) {
                    let length = (self.places[third] - self.places[second]).norm();
                    if third == second || (length - opposite).abs() > tolerance / scale {
                        continue;
                    }
                    let points = [first, second, third].map(|index| self.places[index]);
                    if let Some(pose) = pose_of(&points, &corners, scale)
                        && found(pose) == Search::Over
                    {
                        return;
                    }
                }
            }
        }
    }

    /// The points whose distance from one is `length`, mm, but for `tolerance`.
    fn at(&self, from: usize, length: f64, tolerance: f64) -> &[(f64, usize)] {
        let sorted = &self.from[from];
        let start = sorted.partition_point(|near| near.0 < length - tolerance);
        let count = sorted[start..].partition_point(|near| near.0 <= length + tolerance);
        &sorted[start..start + count]
    }
}

/// Whether to look further.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Search {
    /// There may be more.
    GoesOn,
    /// It is enough.
    Over,
}

/// The pose that lays three points on three places: first sides and planes alike, centres of gravity together.
fn pose_of(
    points: &[Vector3<f64>; 3],
    places: &[Vector3<f64>; 3],
    scale: f64,
) -> Option<Similarity> {
    let rotation = axes(places)? * axes(points)?.transpose();
    let centre = |corners: &[Vector3<f64>; 3]| corners.iter().sum::<Vector3<f64>>() / 3.0;
    Some(Similarity {
        scale,
        rotation: Rotation3::from_matrix_unchecked(rotation),
        translation: centre(places) - scale * (rotation * centre(points)),
    })
}

/// A right-handed frame along the first side of a triangle and normal to it.
fn axes([a, b, c]: &[Vector3<f64>; 3]) -> Option<Matrix3<f64>> {
    let along = (b - a).try_normalize(0.0)?;
    let normal = along.cross(&(c - a)).try_normalize(0.0)?;
    Some(Matrix3::from_columns(&[
        along,
        normal.cross(&along),
        normal,
    ]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_is_found_among_points_in_another_frame_and_scale() {
        let places: Vec<Vector3<f64>> = (0..12)
            .map(f64::from)
            .map(|i| {
                Vector3::new(
                    (i * i * 37.3) % 101.0,
                    (i * i * i * 71.7) % 93.0,
                    i.sin() * 50.0,
                )
            })
            .collect();
        let triangle = Triangle::of(&places, [2, 5, 9], 1.0).unwrap();
        for (scale, size) in [(Scale::One, 1.0), (Scale::Free, 1.7)] {
            let truth = Similarity {
                scale: size,
                rotation: Rotation3::from_euler_angles(0.4, -1.1, 2.5),
                translation: Vector3::new(300.0, -20.0, 77.0),
            };
            let back = truth.inverse();
            let points = places.iter().map(|place| back.apply(place)).collect();
            let mut right = 0;
            let mut count = 0;
            Distances::new(points).poses_on(&places, &triangle, scale, 0.01, &mut |pose| {
                let probe = Vector3::new(1.0, 2.0, 3.0);
                count += 1;
                right += usize::from((pose.apply(&probe) - truth.apply(&probe)).norm() < 1e-9);
                Search::GoesOn
            });
            assert_eq!((right, count), (1, 1));
        }
        assert!(Triangle::of(&places, [2, 2, 9], 1.0).is_none());
    }
}
