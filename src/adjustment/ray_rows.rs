//! The whitened derivatives of a ray, block by block of the unknowns that it touches.

use nalgebra::{SMatrix, Vector2};

use super::equations::RayEquation;
use super::layout::{Layout, PointFrame, Ray};

/// Most unknowns of the reduced system that a ray touches: six of a station, ten of a camera, three of a kept point.
const MOST: usize = 19;

/// Most of them without those of the point.
pub(super) const MOST_OF_STATION: usize = 16;

/// Whitened derivatives of a ray by its point, and by all kept unknowns that it touches.
pub(super) struct RayRows {
    pub(super) by_point: SMatrix<f64, 2, 3>,
    /// Those of x, and of y.
    rows: [[f64; MOST]; 2],
    parts: [RayPart; 4],
}

/// The derivatives by the unknowns of one block: where they begin in the point's frame, and among the rows.
#[derive(Clone, Copy, Default)]
struct RayPart {
    place: usize,
    first: usize,
    end: usize,
}

/// Derivatives of x and of y by the unknowns of a block.
#[derive(Clone, Copy)]
pub(super) struct RowsOfBlock<'a> {
    /// The block's first place in the point's frame.
    pub(super) place: usize,
    pub(super) x: &'a [f64],
    pub(super) y: &'a [f64],
}

impl RowsOfBlock<'_> {
    /// By one unknown after the other.
    #[inline(always)]
    pub(super) fn each(&self) -> impl Iterator<Item = Vector2<f64>> {
        let both = self.x.iter().zip(self.y);
        both.map(|(x, y)| Vector2::new(*x, *y))
    }
}

impl RayRows {
    /// The derivatives of a used or predicted ray times the root of `weight`.
    #[inline(always)]
    pub(super) fn new(
        layout: &Layout,
        frame: &PointFrame,
        ray: &Ray,
        equation: &RayEquation,
        weight: f64,
    ) -> Self {
        let root = weight.sqrt();
        let mut rows = [[0.0; MOST]; 2];
        let mut ends = [6; 4];
        for (axis, rows) in rows.iter_mut().enumerate() {
            for (k, row) in rows[..6].iter_mut().enumerate() {
                *row = equation.by_station[(axis, k)] * root;
            }
        }
        let of_camera = [&layout.camera_own, &layout.camera_free];
        for (parameters, part) in of_camera.into_iter().zip(1..) {
            let parameters = &parameters[ray.camera];
            let first = ends[part - 1];
            for (axis, rows) in rows.iter_mut().enumerate() {
                for (row, &parameter) in rows[first..].iter_mut().zip(parameters) {
                    *row = equation.by_camera[(axis, parameter)] * root;
                }
            }
            ends[part] = first + parameters.len();
        }
        ends[3] = ends[2];
        if frame.own_at.is_some() {
            for &coordinate in &layout.unknown_axes[frame.point] {
                for (axis, rows) in rows.iter_mut().enumerate() {
                    rows[ends[3]] = equation.by_point[(axis, coordinate)] * root;
                }
                ends[3] += 1;
            }
        }
        let own_at = frame.own_at.unwrap_or_default();
        let places = [ray.station_at, ray.own_at, ray.camera_at, own_at];
        let firsts = [0, ends[0], ends[1], ends[2]];
        let parts = std::array::from_fn(|k| RayPart {
            place: places[k],
            first: firsts[k],
            end: ends[k],
        });
        Self {
            by_point: equation.by_point * root,
            rows,
            parts,
        }
    }

    /// Block by block, by rising places in the point's frame.
    #[inline(always)]
    pub(super) fn blocks(&self) -> impl Iterator<Item = RowsOfBlock<'_>> {
        self.blocks_of(&self.parts)
    }

    /// [`Self::blocks`] without the point's own.
    pub(super) fn of_station_and_camera(&self) -> impl Iterator<Item = RowsOfBlock<'_>> {
        self.blocks_of(&self.parts[..3])
    }

    #[inline(always)]
    fn blocks_of<'a>(&'a self, parts: &'a [RayPart]) -> impl Iterator<Item = RowsOfBlock<'a>> {
        let parts = parts.iter().filter(|part| part.end > part.first);
        parts.map(|part| RowsOfBlock {
            place: part.place,
            x: &self.rows[0][part.first..part.end],
            y: &self.rows[1][part.first..part.end],
        })
    }

    /// Those by the station and the camera, in the order of [`Layout::station_blocks`], zeros after them.
    pub(super) fn by_station_and_camera(&self) -> SMatrix<f64, MOST_OF_STATION, 2> {
        let end = self.parts[2].end;
        SMatrix::from_fn(|k, axis| match k < end {
            true => self.rows[axis][k],
            false => 0.0,
        })
    }
}
