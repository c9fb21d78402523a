//! A view made ready: dots without distortion, their rays, and an index of places.
//!
//! All of matching works in *ideal pixels*: distortion removed, origin at the principal point, y down. Epipolar lines
//! are straight there and projection costs one division.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Rotation2, Vector2, Vector3};

use super::problem::{View, ViewDot};

/// Side of a cell of the index of places, px: a few dots of a dense field.
const CELL_PX: f64 = 32.0;
/// Cells of the index over which the density of dots is averaged, to either side.
const DENSITY_CELLS: i64 = 2;
/// Side of a view's index in cells at most, so that a wild lens cannot ask for endless memory.
const MOST_CELLS: usize = 1024;

/// A dot in ideal pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct SightedDot {
    pub(super) place: Vector2<f64>,
    pub(super) sigma_px: f64,
    /// Unit direction of its ray in the world.
    pub(super) direction: Vector3<f64>,
    /// `R diag(major^2, minor^2) R^T` of its ellipse; `None` where the shape is not known.
    pub(super) squared_axes: Option<Matrix2<f64>>,
}

/// Free dots by place.
#[derive(Clone, Debug)]
struct PlaceIndex {
    columns: usize,
    rows: usize,
    starts: Vec<u32>,
    dots: Vec<u32>,
}

/// A view made ready.
#[derive(Clone, Debug)]
pub(super) struct Sight {
    pub(super) camera_from_world: Matrix3<f64>,
    pub(super) centre: Vector3<f64>,
    /// Principal distance, px.
    pub(super) focal_px: f64,
    pub(super) dots: Vec<SightedDot>,
    /// Standard error of a ray in this view, px.
    pub(super) sigma_px: f64,
    min: Vector2<f64>,
    max: Vector2<f64>,
    index: PlaceIndex,
    free_density: f64,
}

/// A projected point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sighting {
    pub(super) place: Vector2<f64>,
    /// Derivative by the world point, px/mm.
    pub(super) by_point: Matrix2x3<f64>,
}

impl Sight {
    pub(super) fn new(view: &View, sigma_px: f64) -> Self {
        let dots: Vec<SightedDot> = view.dots.iter().map(|dot| sighted(view, dot)).collect();
        let (min, max) = ideal_frame(view);
        let mut sight = Self {
            camera_from_world: *view.pose.camera_from_world.matrix(),
            centre: view.pose.centre_in_world,
            focal_px: view.camera.interior.principal_distance / view.camera.pixel_pitch_mm,
            dots,
            sigma_px,
            min,
            max,
            index: PlaceIndex {
                columns: 0,
                rows: 0,
                starts: Vec::new(),
                dots: Vec::new(),
            },
            free_density: 0.0,
        };
        sight.index_free(&vec![true; view.dots.len()]);
        sight
    }

    /// Rebuilds the index with those dots that are still free.
    pub(super) fn index_free(&mut self, free: &[bool]) {
        let size = self.max - self.min;
        let columns = ((size.x / CELL_PX).ceil() as usize).clamp(1, MOST_CELLS);
        let rows = ((size.y / CELL_PX).ceil() as usize).clamp(1, MOST_CELLS);
        self.index.columns = columns;
        self.index.rows = rows;
        let mut cells: Vec<(usize, u32)> = Vec::with_capacity(self.dots.len());
        for (slot, dot) in self.dots.iter().enumerate() {
            if free[slot] && dot.place.iter().all(|v| v.is_finite()) {
                let (column, row) = self.cell(&dot.place);
                let column = (column.max(0) as usize).min(columns - 1);
                let row = (row.max(0) as usize).min(rows - 1);
                cells.push((row * columns + column, slot as u32));
            }
        }
        cells.sort_unstable();
        let mut starts = vec![0_u32; rows * columns + 1];
        for (cell, _) in &cells {
            starts[cell + 1] += 1;
        }
        for i in 0..rows * columns {
            starts[i + 1] += starts[i];
        }
        self.free_density = cells.len() as f64 / (size.x * size.y).max(1.0);
        self.index.starts = starts;
        self.index.dots = cells.into_iter().map(|(_, slot)| slot).collect();
    }

    fn cell(&self, place: &Vector2<f64>) -> (i64, i64) {
        (
            ((place.x - self.min.x) / CELL_PX).floor() as i64,
            ((place.y - self.min.y) / CELL_PX).floor() as i64,
        )
    }

    /// Where a world point is imaged; `None` behind the camera or outside the frame.
    pub(super) fn place(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let k = self.camera_from_world * (point - self.centre);
        if k.z >= 0.0 {
            return None;
        }
        let place = Vector2::new(-k.x, k.y) * (self.focal_px / k.z);
        self.frame_contains(&place).then_some(place)
    }

    /// [`Self::place`] with its derivative, also outside the frame.
    pub(super) fn sighting(&self, point: &Vector3<f64>) -> Option<Sighting> {
        let k = self.camera_from_world * (point - self.centre);
        if k.z >= 0.0 {
            return None;
        }
        let f = self.focal_px / k.z;
        let by_camera = Matrix2x3::new(-f, 0.0, f * k.x / k.z, 0.0, f, -f * k.y / k.z);
        Some(Sighting {
            place: Vector2::new(-k.x, k.y) * f,
            by_point: by_camera * self.camera_from_world,
        })
    }

    /// Pixels per millimetre across the ray at a world point.
    pub(super) fn pixels_per_mm(&self, point: &Vector3<f64>) -> f64 {
        self.focal_px / (point - self.centre).norm().max(1e-9)
    }

    pub(super) fn frame_contains(&self, place: &Vector2<f64>) -> bool {
        place.x >= self.min.x
            && place.y >= self.min.y
            && place.x <= self.max.x
            && place.y <= self.max.y
    }

    fn row(&self, row: i64, first: i64, last: i64) -> &[u32] {
        if row < 0 || row >= self.index.rows as i64 || last < 0 {
            return &[];
        }
        let columns = self.index.columns as i64;
        let first = first.clamp(0, columns - 1);
        let last = last.clamp(0, columns - 1);
        if first > last {
            return &[];
        }
        let base = row * columns;
        let from = self.index.starts[(base + first) as usize] as usize;
        let to = self.index.starts[(base + last + 1) as usize] as usize;
        &self.index.dots[from..to]
    }

    /// Calls `found` for every free dot within `radius` px of `place`.
    pub(super) fn near(&self, place: &Vector2<f64>, radius: f64, mut found: impl FnMut(usize)) {
        let reach = Vector2::repeat(radius);
        let (first_column, first_row) = self.cell(&(place - reach));
        let (last_column, last_row) = self.cell(&(place + reach));
        for row in first_row.max(0)..=last_row.min(self.index.rows as i64 - 1) {
            for &dot in self.row(row, first_column, last_column) {
                if (self.dots[dot as usize].place - place).norm_squared() <= radius * radius {
                    found(dot as usize);
                }
            }
        }
    }

    /// Free dots within `band` px of the straight segment from `a` to `b`, ascending.
    pub(super) fn along(&self, a: &Vector2<f64>, b: &Vector2<f64>, band: f64) -> Vec<usize> {
        let Some((a, b)) = self.clipped(a, b, band) else {
            return Vec::new();
        };
        let way = b - a;
        let length = way.norm();
        let unit = if length > 1e-9 {
            way / length
        } else {
            Vector2::x()
        };
        let (low, high) = if a.y <= b.y { (a, b) } else { (b, a) };
        let (_, first_row) = self.cell(&(low - Vector2::repeat(band)));
        let (_, last_row) = self.cell(&(high + Vector2::repeat(band)));
        let mut found = Vec::new();
        for row in first_row.max(0)..=last_row.min(self.index.rows as i64 - 1) {
            // The stretch of the segment whose band can touch this row of cells.
            let top = self.min.y + row as f64 * CELL_PX - band;
            let bottom = top + CELL_PX + 2.0 * band;
            let at = |y: f64| {
                let rise = high.y - low.y;
                if rise < 1e-9 {
                    return None;
                }
                Some(low.x + (high.x - low.x) * ((y - low.y) / rise).clamp(0.0, 1.0))
            };
            let (x0, x1) = match (at(top), at(bottom)) {
                (Some(x0), Some(x1)) => (x0.min(x1), x0.max(x1)),
                _ => (a.x.min(b.x), a.x.max(b.x)),
            };
            let first = ((x0 - band - self.min.x) / CELL_PX).floor() as i64;
            let last = ((x1 + band - self.min.x) / CELL_PX).floor() as i64;
            for &dot in self.row(row, first, last) {
                let offset = self.dots[dot as usize].place - a;
                let along = offset.dot(&unit).clamp(0.0, length);
                if (offset - unit * along).norm_squared() <= band * band {
                    found.push(dot as usize);
                }
            }
        }
        found.sort_unstable();
        found
    }

    /// The part of a segment inside the frame widened by `band` (Liang and Barsky, 1984).
    fn clipped(
        &self,
        a: &Vector2<f64>,
        b: &Vector2<f64>,
        band: f64,
    ) -> Option<(Vector2<f64>, Vector2<f64>)> {
        let way = b - a;
        let (mut from, mut to) = (0.0_f64, 1.0_f64);
        for axis in 0..2 {
            let (least, most) = (self.min[axis] - band, self.max[axis] + band);
            if way[axis].abs() < 1e-12 {
                if a[axis] < least || a[axis] > most {
                    return None;
                }
                continue;
            }
            let (t0, t1) = ((least - a[axis]) / way[axis], (most - a[axis]) / way[axis]);
            from = from.max(t0.min(t1));
            to = to.min(t0.max(t1));
        }
        (from <= to).then(|| (a + way * from, a + way * to))
    }

    /// Free dots per square pixel round a place; never below the mean of the whole view.
    pub(super) fn density(&self, place: &Vector2<f64>) -> f64 {
        let (column, row) = self.cell(place);
        let mut count = 0;
        for r in row - DENSITY_CELLS..=row + DENSITY_CELLS {
            count += self
                .row(r, column - DENSITY_CELLS, column + DENSITY_CELLS)
                .len();
        }
        let side = (2 * DENSITY_CELLS + 1) as f64 * CELL_PX;
        (count as f64 / (side * side)).max(self.free_density)
    }
}

fn sighted(view: &View, dot: &ViewDot) -> SightedDot {
    let pitch = view.camera.pixel_pitch_mm;
    let interior = &view.camera.interior;
    let measured = view.camera.image_from_pixel(&dot.pixel);
    let ideal = interior.ideal_from_measured(&measured);
    let ray = Vector3::new(ideal.x, ideal.y, -interior.principal_distance);
    let known = dot.major_px > 0.0 && dot.minor_px > 0.0 && dot.angle.is_finite();
    let correction = interior.correction(&measured).filter(|_| known);
    let squared_axes = correction.map(|correction| {
        let turn = Rotation2::new(dot.angle);
        let axes = Matrix2::from_diagonal(&Vector2::new(
            dot.major_px * dot.major_px,
            dot.minor_px * dot.minor_px,
        ));
        let downward = Matrix2::new(1.0, 0.0, 0.0, -1.0);
        let stretch = downward * correction.by_measured * downward;
        let turned = turn.matrix() * axes * turn.matrix().transpose();
        stretch * turned * stretch.transpose()
    });
    SightedDot {
        place: Vector2::new(ideal.x, -ideal.y) / pitch,
        sigma_px: dot.sigma_px,
        direction: view.pose.world_from_direction(&ray).normalize(),
        squared_axes,
    }
}

/// The upright box of ideal pixels that the frame's border covers.
fn ideal_frame(view: &View) -> (Vector2<f64>, Vector2<f64>) {
    /// Places along each side: the extremes of a smooth distortion are met closely enough.
    const PLACES: u32 = 8;
    let camera = &view.camera;
    let size = Vector2::new(f64::from(camera.width_px), f64::from(camera.height_px));
    let mut min = Vector2::repeat(f64::INFINITY);
    let mut max = -min;
    for step in 0..=PLACES {
        let share = f64::from(step) / f64::from(PLACES);
        for place in [[share, 0.0], [share, 1.0], [0.0, share], [1.0, share]] {
            let pixel = size.component_mul(&Vector2::from(place));
            let ideal = camera.ideal_from_pixel(&pixel) / camera.pixel_pitch_mm;
            let ideal = Vector2::new(ideal.x, -ideal.y);
            min = min.inf(&ideal);
            max = max.sup(&ideal);
        }
    }
    (min, max)
}
