//! The image of one mark: its coverage of the pixels, blurred, in a small patch of the picture.
//!
//! Every pixel is cut into cells. At the nodes between them the exact inverse mapping (pixel, ray, plane) gives the
//! signed distance to the mark's edge; in a cell the edge is a straight line, whose exact share of the cell is taken.
//! The cells are convolved with the pixel's square and the Gaussian in one separable kernel, so the picture's centroid
//! is that of the mark's image.

use nalgebra::{Matrix3, Vector2, Vector3};
use statrs::function::erf::erf;

use super::Placement;
use super::scene::Ring;
use super::surface::Occluder;
use crate::camera::Camera;
use crate::geometry::Pose;

/// Gaussian tails are cut here, in sigmas: what is left out is 1e-5 of the dot's light.
const BLUR_REACH_SIGMAS: f64 = 4.4;
/// Images thinner than this are integrated with twice as many cells, px.
const THIN_PX: f64 = 8.0;

/// Pixels to the plane of a mark: a homography behind the lens correction.
pub(super) struct PlaneView<'a> {
    camera: &'a Camera,
    plane_from_ray: Matrix3<f64>,
}

impl<'a> PlaneView<'a> {
    pub(super) fn new(camera: &'a Camera, pose: &Pose, placement: &Placement) -> Self {
        let turn = pose.camera_from_world;
        let (x, y) = (turn * placement.x, turn * placement.y);
        let normal = turn * placement.normal();
        let eye = pose.centre_in_world - placement.origin;
        let height = -placement.normal().dot(&eye);
        // The point is eye + t d with t = height / (n . d); its plane coordinates times n . d are linear in d.
        Self {
            camera,
            plane_from_ray: Matrix3::from_rows(&[
                (normal * eye.dot(&placement.x) + x * height).transpose(),
                (normal * eye.dot(&placement.y) + y * height).transpose(),
                normal.transpose(),
            ]),
        }
    }

    /// Plane coordinates (mm) of a pixel; far away where the ray does not meet the plane in front of the camera.
    pub(super) fn plane_from_pixel(&self, pixel: &Vector2<f64>) -> Vector2<f64> {
        let h = self.plane_from_ray * self.camera.ray(pixel);
        if h.z < -1e-12 {
            Vector2::new(h.x / h.z, h.y / h.z)
        } else {
            Vector2::new(1e9, 1e9)
        }
    }
}

/// The edge of a mark in its plane.
pub(super) enum Shape<'a> {
    /// A disc of this radius, mm.
    Disc(f64),
    /// The light segments of a ring.
    Ring(&'a Ring),
}

impl Shape<'_> {
    /// Signed distance to the edge, mm, negative inside.
    fn signed_distance(&self, point: &Vector2<f64>) -> f64 {
        let r = point.norm();
        match self {
            Shape::Disc(radius) => r - radius,
            Shape::Ring(ring) => {
                let annulus = (2.0 * ring.dot_radius - r).max(r - 3.0 * ring.dot_radius);
                annulus.max(r * light_angle(ring, point))
            }
        }
    }
}

/// Angle from a direction to the nearest border between light and dark segments, radians, negative in the light.
fn light_angle(ring: &Ring, point: &Vector2<f64>) -> f64 {
    let count = u32::from(ring.segments);
    // Clockwise from +y, in segments.
    let turn = point.x.atan2(point.y) / std::f64::consts::TAU;
    let place = turn.rem_euclid(1.0) * f64::from(count);
    let segment = (place as u32).min(count - 1);
    let is_light = |k: u32| (ring.bits >> (count - 1 - k % count)) & 1 == 1;
    let light = is_light(segment);
    let same = |step: u32| {
        (0..count)
            .take_while(|&n| is_light(segment + (n + 1) * step) == light)
            .count()
    };
    let (after, before) = (same(1), same(count - 1));
    if after as u32 >= count {
        return if light { -1.0 } else { 1.0 };
    }
    let within = place - f64::from(segment);
    let nearest = (after as f64 + 1.0 - within).min(before as f64 + within);
    let angle = nearest * std::f64::consts::TAU / f64::from(count);
    if light { -angle } else { angle }
}

/// What may stand before a mark, seen from the camera.
pub(super) struct Blocking<'a> {
    pub(super) occluders: &'a [Occluder],
    pub(super) eye: Vector3<f64>,
    pub(super) placement: Placement,
}

/// A mark's blurred coverage, 0..1, of a rectangle of pixels.
pub(super) struct Patch {
    pub(super) left: i64,
    pub(super) top: i64,
    pub(super) width: usize,
    pub(super) cover: Vec<f32>,
    /// Grey value above black where the cover is 1.
    pub(super) grey: f32,
}

impl Patch {
    pub(super) fn height(&self) -> usize {
        self.cover.len() / self.width
    }
}

/// Draws a mark whose image lies within `outline`; `None` where the picture does not contain any of it.
pub(super) fn draw(
    shape: &Shape<'_>,
    view: &PlaneView<'_>,
    outline: &[Vector2<f64>],
    blocking: Option<&Blocking<'_>>,
    blur_sigma_px: f64,
    grey: f32,
) -> Option<Patch> {
    let area = PixelRectangle::around(outline, view.camera, blur_sigma_px)?;
    let thin = area.width.min(area.height) as f64 - 2.0 < THIN_PX;
    let cells = if thin || blocking.is_some() { 8 } else { 4 };
    let mut cover = cell_cover(shape, view, &area, cells);
    if let Some(blocking) = blocking {
        hide(&mut cover, blocking, view, &area, cells);
    }
    let kernel = Kernel::new(blur_sigma_px, cells);
    let pad = kernel.reach as i64;
    Some(Patch {
        left: area.left - pad,
        top: area.top - pad,
        width: area.width + 2 * kernel.reach,
        cover: kernel.blur(&cover, area.width, area.height),
        grey,
    })
}

struct PixelRectangle {
    left: i64,
    top: i64,
    width: usize,
    height: usize,
}

impl PixelRectangle {
    /// The pixels round an outline, one to spare, no farther beyond the frame than blur brings light back.
    fn around(outline: &[Vector2<f64>], camera: &Camera, blur_sigma_px: f64) -> Option<Self> {
        let first = outline.first()?;
        let (low, high) = outline
            .iter()
            .fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p)));
        let beyond = (blur_sigma_px * BLUR_REACH_SIGMAS).ceil() + 2.0;
        let right = f64::from(camera.width_px) + beyond;
        let bottom = f64::from(camera.height_px) + beyond;
        let left = (low.x.floor() - 1.0).max(-beyond) as i64;
        let top = (low.y.floor() - 1.0).max(-beyond) as i64;
        let width = (high.x.ceil() + 1.0).min(right) as i64 - left;
        let height = (high.y.ceil() + 1.0).min(bottom) as i64 - top;
        (width > 0 && height > 0).then_some(Self {
            left,
            top,
            width: width as usize,
            height: height as usize,
        })
    }

    fn pixel(&self, column: f64, row: f64) -> Vector2<f64> {
        Vector2::new(self.left as f64 + column, self.top as f64 + row)
    }
}

/// Share of every cell that the mark covers, rows of `width * cells`.
fn cell_cover(
    shape: &Shape<'_>,
    view: &PlaneView<'_>,
    area: &PixelRectangle,
    cells: usize,
) -> Vec<f64> {
    let (columns, rows) = (area.width * cells, area.height * cells);
    let step = 1.0 / cells as f64;
    let node_row = |row: usize| -> Vec<f64> {
        (0..=columns)
            .map(|column| {
                let pixel = area.pixel(column as f64 * step, row as f64 * step);
                shape.signed_distance(&view.plane_from_pixel(&pixel))
            })
            .collect()
    };
    let mut cover = Vec::with_capacity(columns * rows);
    let mut above = node_row(0);
    for row in 0..rows {
        let below = node_row(row + 1);
        cover.extend(
            (0..columns).map(|c| share_inside([above[c], above[c + 1], below[c], below[c + 1]])),
        );
        above = below;
    }
    cover
}

/// The share of a unit cell on the negative side of the straight line that fits the signed distances at its corners
/// (top left, top right, bottom left, bottom right; any unit).
fn share_inside(corners: [f64; 4]) -> f64 {
    let [a, b, c, d] = corners;
    if a.min(b).min(c).min(d) >= 0.0 {
        return 0.0;
    }
    if a.max(b).max(c).max(d) <= 0.0 {
        return 1.0;
    }
    let gradient = Vector2::new((b + d - a - c) / 2.0, (c + d - a - b) / 2.0);
    let slope = gradient.norm();
    let mean = (a + b + c + d) / 4.0;
    if slope <= f64::MIN_POSITIVE {
        return if mean < 0.0 { 1.0 } else { 0.0 };
    }
    let normal = gradient.abs() / slope;
    let (long, short) = (normal.max(), normal.min());
    let sum = long + short;
    // Distance of the line from the corner deepest inside.
    let depth = (sum / 2.0 - mean / slope).clamp(0.0, sum);
    if depth < short {
        depth * depth / (2.0 * long * short)
    } else if depth < long {
        (depth - short / 2.0) / long
    } else if depth < sum {
        1.0 - (sum - depth).powi(2) / (2.0 * long * short)
    } else {
        1.0
    }
}

/// Takes away the cells that something else stands before.
fn hide(
    cover: &mut [f64],
    blocking: &Blocking<'_>,
    view: &PlaneView<'_>,
    area: &PixelRectangle,
    cells: usize,
) {
    let columns = area.width * cells;
    for (index, share) in cover
        .iter_mut()
        .enumerate()
        .filter(|(_, share)| **share > 0.0)
    {
        let centre = |k: usize| (k as f64 + 0.5) / cells as f64;
        let pixel = area.pixel(centre(index % columns), centre(index / columns));
        let plane = view.plane_from_pixel(&pixel);
        let point = blocking.placement.point(plane.x, plane.y);
        if blocking
            .occluders
            .iter()
            .any(|o| o.hides(&point, &blocking.eye))
        {
            *share = 0.0;
        }
    }
}

/// The pixel's square convolved with the Gaussian, sampled at the cells round a pixel.
struct Kernel {
    weights: Vec<f64>,
    reach: usize,
    cells: usize,
}

impl Kernel {
    fn new(sigma: f64, cells: usize) -> Self {
        let reach = (sigma * BLUR_REACH_SIGMAS + 0.5).ceil() as usize;
        let below = |u: f64| {
            if sigma > 0.0 {
                0.5 * (1.0 + erf(u / (sigma * std::f64::consts::SQRT_2)))
            } else {
                f64::from(u8::from(u > 0.0))
            }
        };
        let weights: Vec<f64> = (0..(2 * reach + 1) * cells)
            .map(|k| {
                // Offset of the cell's centre from the pixel's centre; the cells are symmetric about it.
                let offset = (k as f64 + 0.5) / cells as f64 - reach as f64 - 0.5;
                below(offset + 0.5) - below(offset - 0.5)
            })
            .collect();
        let total: f64 = weights.iter().sum();
        Self {
            weights: weights.iter().map(|w| w / total).collect(),
            reach,
            cells,
        }
    }

    /// Pixels from cells: rows first, then columns; the result is `reach` pixels wider on all sides.
    fn blur(&self, cover: &[f64], width: usize, height: usize) -> Vec<f32> {
        let wide = width + 2 * self.reach;
        let high = height + 2 * self.reach;
        let columns = width * self.cells;
        let mut across = vec![0.0; height * self.cells * wide];
        for (row, out) in cover.chunks(columns).zip(across.chunks_mut(wide)) {
            for (pixel, value) in out.iter_mut().enumerate() {
                *value = self.weigh(pixel, width, |cell| row[cell]);
            }
        }
        let mut blurred = Vec::with_capacity(wide * high);
        for pixel in 0..high {
            blurred.extend((0..wide).map(|column| {
                self.weigh(pixel, height, |cell| across[cell * wide + column]) as f32
            }));
        }
        blurred
    }

    /// The weighted sum of the cells round output pixel `pixel` (counted from `reach` before the first) of `count`.
    fn weigh(&self, pixel: usize, count: usize, cell: impl Fn(usize) -> f64) -> f64 {
        let first = pixel.saturating_sub(2 * self.reach);
        let last = (pixel + 1).min(count);
        let offset = (first + 2 * self.reach - pixel) * self.cells;
        let range = first * self.cells..last * self.cells;
        range
            .enumerate()
            .map(|(k, index)| self.weights[offset + k] * cell(index))
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::InteriorOrientation;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_share_of_a_cell_is_that_of_fine_sampling(angle in 0.0..std::f64::consts::TAU, distance in -0.8..0.8) {
            let (sin, cos): (f64, f64) = f64::sin_cos(angle);
            let at = |x: f64, y: f64| (x - 0.5) * cos + (y - 0.5) * sin + distance;
            let share = share_inside([at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)]);
            let fine = 200;
            let count = (0..fine * fine)
                .filter(|k| at((f64::from(k % fine) + 0.5) / f64::from(fine), (f64::from(k / fine) + 0.5) / f64::from(fine)) < 0.0)
                .count();
            // A line crosses some 300 of the 40,000 sample squares.
            prop_assert!((share - count as f64 / f64::from(fine * fine)).abs() < 4e-3);
        }
    }

    #[test]
    fn a_pixel_and_its_place_on_the_plane_are_imaged_onto_each_other() {
        let camera = Camera {
            width_px: 3072,
            height_px: 2048,
            pixel_pitch_mm: 0.009,
            interior: InteriorOrientation {
                radial: [1.5e-4, -4e-7, 2e-10],
                principal_point: [0.1, -0.1],
                ..InteriorOrientation::pinhole(20.0)
            },
        };
        let pose = Pose::looking_at(
            Vector3::new(400.0, -300.0, 900.0),
            Vector3::zeros(),
            Vector3::z(),
            0.4,
        );
        let placement = Placement::horizontal(Vector3::new(30.0, 20.0, 10.0)).turned(0.3);
        let view = PlaneView::new(&camera, &pose, &placement);
        for pixel in [Vector2::new(100.0, 200.0), Vector2::new(2900.5, 1800.2)] {
            let plane = view.plane_from_pixel(&pixel);
            let point = pose.camera_from_point(&placement.point(plane.x, plane.y));
            assert!((camera.project(&point).unwrap() - pixel).norm() < 1e-9);
        }
    }

    #[test]
    fn ring_bits_are_read_clockwise_from_the_top_most_significant_first() {
        let ring = Ring {
            label: String::new(),
            placement: Placement::horizontal(Vector3::zeros()),
            dot_radius: 1.0,
            segments: 14,
            bits: 0b10_1000_0000_0001,
            finish: super::super::Finish::default(),
        };
        for segment in 0..14_u32 {
            let angle = (f64::from(segment) + 0.5) / 14.0 * std::f64::consts::TAU;
            let inside = Vector2::new(angle.sin(), angle.cos()) * 2.5;
            let light = Shape::Ring(&ring).signed_distance(&inside) < 0.0;
            assert_eq!(light, [0, 2, 13].contains(&segment), "segment {segment}");
        }
    }
}
