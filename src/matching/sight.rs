//! A view made ready: dots without distortion, their rays, and an index of places.
//!
//! All of matching works in *ideal pixels*: distortion removed, origin at the principal point, y down. Epipolar lines
//! are straight there and projection costs one division.
//!
//! How far a predicted place may be off because of the view's own orientation follows from the covariance of pose and camera, carried
//! to that place: with the derivatives `J` of the prediction by the pose and `D` of the ideal place by the camera, both at one place,
//! `O = [J, -D] C [J, -D]^T`. `D` changes slowly over the picture and is kept on a lattice.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Matrix6x2, SMatrix, Vector2, Vector3};

use super::problem::{ObjectSpace, OrientationPrecision, View, ViewDot};
use super::shape::{MeasuredAxes, largest, matrix_of, root};
use crate::camera::Camera;
use crate::geometry::skew;

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
    /// `R diag(major, minor) R^T` of its ellipse, px; `None` where the shape is not known.
    pub(super) axes: Option<MeasuredAxes>,
}

/// Columns and rows of the lattice of a camera's part in the uncertainty of predictions.
const LATTICE: [usize; 2] = [24, 16];

/// How well a view's orientation is known.
#[derive(Clone, Debug)]
struct Precision {
    /// Covariance of the pose.
    of_pose: SMatrix<f64, 6, 6>,
    /// At each place of the lattice the covariance of pose with the camera's part, `-C D^T`, and that of the camera's part itself,
    /// px^2; by rows.
    of_camera: Vec<(Matrix6x2<f64>, Matrix2<f64>)>,
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
    /// Variance of a ray's coordinate that nothing else explains, px^2.
    pub(super) extra_px2: f64,
    /// Mean and largest variance of a dot's own coordinate, px^2.
    pub(super) dot_px2: [f64; 2],
    precision: Option<Precision>,
    /// Where the targets of this view may lie.
    pub(super) space: ObjectSpace,
    min: Vector2<f64>,
    max: Vector2<f64>,
    index: PlaceIndex,
    free_density: f64,
}

/// A projected point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sighting {
    pub(super) place: Vector2<f64>,
    /// Derivative by the world point, px/mm; that by the projection centre is its negative.
    pub(super) by_point: Matrix2x3<f64>,
    /// Derivative by the turn in the camera frame, px.
    by_turn: Matrix2x3<f64>,
}

/// The image of another view's ray: a straight segment in ideal pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayImage {
    /// Where the ray enters and leaves what counts of it, mm.
    pub(super) ends: [Vector3<f64>; 2],
    /// Their images, px.
    pub(super) places: [Vector2<f64>; 2],
}

impl Sight {
    /// The view made ready; where its precision is not told, a ray's coordinate has the standard error `broad_px`.
    pub(super) fn new(view: &View, broad_px: f64, space: ObjectSpace) -> Self {
        let dots: Vec<SightedDot> = view.dots.iter().map(|dot| sighted(view, dot)).collect();
        let (min, max) = ideal_frame(view);
        let variances: Vec<f64> = dots.iter().map(|dot| dot.sigma_px * dot.sigma_px).collect();
        let mean = variances.iter().sum::<f64>() / dots.len().max(1) as f64;
        let most = variances.iter().copied().fold(0.0, f64::max);
        let precision = view.precision.as_ref();
        let precision = precision.map(|known| Precision::of(known, &view.camera, &min, &max));
        let mut sight = Self {
            camera_from_world: *view.pose.camera_from_world.matrix(),
            centre: view.pose.centre_in_world,
            focal_px: view.camera.interior.principal_distance / view.camera.pixel_pitch_mm,
            dots,
            extra_px2: if precision.is_some() {
                0.0
            } else {
                broad_px * broad_px
            },
            dot_px2: [mean, most],
            precision,
            space,
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
            by_turn: -by_camera * skew(&k),
        })
    }

    /// Covariance of a prediction by the view's orientation, and by what nothing explains, px^2.
    pub(super) fn uncertainty(&self, seen: &Sighting) -> Matrix2<f64> {
        let extra = Matrix2::identity() * self.extra_px2;
        let Some(precision) = &self.precision else {
            return extra;
        };
        let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
        by_pose
            .fixed_view_mut::<2, 3>(0, 0)
            .copy_from(&seen.by_turn);
        by_pose
            .fixed_view_mut::<2, 3>(0, 3)
            .copy_from(&-seen.by_point);
        let share = (seen.place - self.min).component_div(&(self.max - self.min));
        let cell =
            |share: f64, count: usize| ((share * count as f64).max(0.0) as usize).min(count - 1);
        let at = cell(share.y, LATTICE[1]) * LATTICE[0] + cell(share.x, LATTICE[0]);
        let (with_pose, own) = &precision.of_camera[at];
        let cross = by_pose * with_pose;
        by_pose * precision.of_pose * by_pose.transpose() + cross + cross.transpose() + own + extra
    }

    /// Within what distance of its prediction a dot of a point is to be looked for, px, where its squared standardised misfit may reach
    /// `critical`; the dot may be the least exact of the view.
    pub(super) fn search_radius(
        &self,
        seen: &Sighting,
        covariance: &Matrix3<f64>,
        critical: f64,
    ) -> f64 {
        let [mean, most] = self.dot_px2;
        let spread = seen.by_point * covariance * seen.by_point.transpose() + self.spread(seen);
        (critical * (largest(&spread) + most - mean)).sqrt()
    }

    /// Covariance of how far a dot of mean precision lies from a prediction, but for the point's own, px^2.
    pub(super) fn spread(&self, seen: &Sighting) -> Matrix2<f64> {
        self.uncertainty(seen) + Matrix2::identity() * self.dot_px2[0]
    }

    /// Whether the view's precision is told.
    pub(super) fn is_precise(&self) -> bool {
        self.precision.is_some()
    }

    /// Pixels per millimetre across the ray at a world point.
    pub(super) fn pixels_per_mm(&self, point: &Vector3<f64>) -> f64 {
        self.focal_px / (point - self.centre).norm().max(1e-9)
    }

    /// Pixels per millimetre across the ray at a world point, in the direction in which the picture's plane stretches it most.
    pub(super) fn most_pixels_per_mm(&self, point: &Vector3<f64>) -> f64 {
        let away = self.camera_from_world * (point - self.centre);
        self.focal_px * away.norm() / (away.z * away.z).max(1e-9)
    }

    /// The epipolar line of a dot of another view, as far as its ray runs through the object and before this camera.
    pub(super) fn image_of_ray(&self, other: &Self, dot: usize) -> Option<RayImage> {
        /// Shortest depth before a camera as a share of the far end of the ray: nearer, lines run off to infinity.
        const NEAREST: f64 = 0.02;
        let direction = other.dots[dot].direction;
        let [mut near, mut far] = other.space.stretch(&other.centre, &direction)?;
        let k0 = -(self.camera_from_world * (other.centre - self.centre)).z;
        let slope = -(self.camera_from_world * direction).z;
        let least = NEAREST * far;
        // Depth k0 + t slope before this camera must be at least `least`.
        if slope.abs() < 1e-12 {
            if k0 < least {
                return None;
            }
        } else if slope > 0.0 {
            near = near.max((least - k0) / slope);
        } else {
            far = far.min((least - k0) / slope);
        }
        if near >= far {
            return None;
        }
        let ends = [near, far].map(|t| other.centre + direction * t);
        let places = [
            self.sighting(&ends[0])?.place,
            self.sighting(&ends[1])?.place,
        ];
        Some(RayImage { ends, places })
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

    /// Free dots within `band` px of the straight segment from `a` to `b`, ascending; `None` where it lies outside the frame.
    pub(super) fn along(
        &self,
        a: &Vector2<f64>,
        b: &Vector2<f64>,
        band: f64,
    ) -> Option<Vec<usize>> {
        let (a, b) = self.clipped(a, b, band)?;
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
        Some(found)
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

    /// Free dots per square pixel round a place of which `alike` holds; never below a part of the mean of the whole view.
    pub(super) fn density(&self, place: &Vector2<f64>, alike: impl Fn(&SightedDot) -> bool) -> f64 {
        /// Dots of any shape are so many times as frequent as those of one shape, at most.
        const SHARE_ALIKE: f64 = 0.05;
        let (column, row) = self.cell(place);
        let mut count = 0;
        for r in row - DENSITY_CELLS..=row + DENSITY_CELLS {
            let dots = self.row(r, column - DENSITY_CELLS, column + DENSITY_CELLS);
            count += dots
                .iter()
                .filter(|dot| alike(&self.dots[**dot as usize]))
                .count();
        }
        // Cells that the picture has: beyond its border there are no dots. A place beyond it is given the nearest cell.
        let inside = |at: i64, cells: usize| {
            let last = (at + DENSITY_CELLS).min(cells as i64 - 1);
            (last - (at - DENSITY_CELLS).max(0) + 1).max(1)
        };
        let cells = inside(column, self.index.columns) * inside(row, self.index.rows);
        let area = cells as f64 * (CELL_PX * CELL_PX);
        (count as f64 / area).max(SHARE_ALIKE * self.free_density)
    }
}

impl Precision {
    fn of(
        known: &OrientationPrecision,
        camera: &Camera,
        min: &Vector2<f64>,
        max: &Vector2<f64>,
    ) -> Self {
        let of_all = &known.0;
        let of_pose = of_all.fixed_view::<6, 6>(0, 0).into_owned();
        let with_camera = of_all.fixed_view::<6, 10>(0, 6).into_owned();
        let own = of_all.fixed_view::<10, 10>(6, 6).into_owned();
        let [columns, rows] = LATTICE;
        let of_camera = (0..columns * rows)
            .map(|at| {
                let share = Vector2::new(
                    ((at % columns) as f64 + 0.5) / columns as f64,
                    ((at / columns) as f64 + 0.5) / rows as f64,
                );
                let place = min + share.component_mul(&(max - min));
                let by_camera = -by_interior(camera, &place, &own);
                (
                    with_camera * by_camera.transpose(),
                    by_camera * own * by_camera.transpose(),
                )
            })
            .collect();
        Self { of_pose, of_camera }
    }
}

/// Derivative of a measured dot's ideal place, less that of the prediction of the same ray, by the ten parameters, px.
fn by_interior(
    camera: &Camera,
    place: &Vector2<f64>,
    covariance: &SMatrix<f64, 10, 10>,
) -> SMatrix<f64, 2, 10> {
    let interior = &camera.interior;
    let pitch = camera.pixel_pitch_mm;
    let mut by = SMatrix::<f64, 2, 10>::zeros();
    let ideal = Vector2::new(place.x, -place.y) * pitch;
    let Some(measured) = interior.measured_from_ideal(&ideal) else {
        return by;
    };
    let values = interior.to_vector();
    for k in 0..10 {
        // A step as long as the parameter's own standard deviation: the derivative is wanted over that range.
        let step = covariance[(k, k)].max(0.0).sqrt();
        if step <= 0.0 {
            continue;
        }
        let off = |by: f64| {
            let mut values = values;
            values[k] += by;
            let changed = interior.with_values(&values);
            let ray = ideal * (changed.principal_distance / interior.principal_distance);
            changed.ideal_from_measured(&measured) - ray
        };
        let change = (off(step) - off(-step)) / (2.0 * step * pitch);
        by.set_column(k, &Vector2::new(change.x, -change.y));
    }
    by
}

fn sighted(view: &View, dot: &ViewDot) -> SightedDot {
    let pitch = view.camera.pixel_pitch_mm;
    let interior = &view.camera.interior;
    let measured = view.camera.image_from_pixel(&dot.pixel);
    let ideal = interior.ideal_from_measured(&measured);
    let ray = Vector3::new(ideal.x, ideal.y, -interior.principal_distance);
    let known = dot.major_px > 0.0 && dot.minor_px > 0.0 && dot.angle.is_finite();
    let correction = interior.correction(&measured).filter(|_| known);
    let axes = correction.map(|correction| {
        let downward = Matrix2::new(1.0, 0.0, 0.0, -1.0);
        let stretch = downward * correction.by_measured * downward;
        let turned = matrix_of(dot.major_px, dot.minor_px, dot.angle);
        MeasuredAxes {
            root: root(&(stretch * turned * stretch.transpose())),
            centre_px: dot.sigma_px,
        }
    });
    let focal_px = interior.principal_distance / pitch;
    SightedDot {
        place: Vector2::new(ideal.x, -ideal.y) / pitch,
        sigma_px: dot.sigma_px.hypot(eccentricity_px(dot, focal_px)),
        direction: view.pose.world_from_direction(&ray).normalize(),
        axes,
    }
}

/// How far the centre of a dot's image is from the image of its centre, about: `r^2 sin cos / f` of the half diameter `r` and the
/// incidence (Heikkilae, 1997). Identification takes the one for the other.
fn eccentricity_px(dot: &ViewDot, focal_px: f64) -> f64 {
    if dot.major_px <= 0.0 {
        return 0.0;
    }
    let cos = (dot.minor_px / dot.major_px).clamp(0.0, 1.0);
    let sin = (1.0 - cos * cos).sqrt();
    (dot.major_px / 2.0).powi(2) * sin * cos / focal_px
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::InteriorOrientation;
    use crate::geometry::Pose;

    #[test]
    fn a_lattice_of_dots_is_as_dense_at_the_border_as_in_the_middle() {
        let dot = |index: usize| {
            let place = Vector2::new((index % 80) as f64, (index / 80) as f64);
            ViewDot {
                pixel: place * 8.0 + Vector2::repeat(4.0),
                sigma_px: 0.05,
                major_px: 0.0,
                minor_px: 0.0,
                angle: 0.0,
            }
        };
        let centre = Vector3::new(0.0, 0.0, 1000.0);
        let view = View {
            camera: Camera {
                width_px: 640,
                height_px: 480,
                // A power of two: places are exact.
                pixel_pitch_mm: 0.007_812_5,
                interior: InteriorOrientation::pinhole(10.0),
            },
            pose: Pose::looking_at(centre, Vector3::zeros(), Vector3::y(), 0.0),
            precision: None,
            dots: (0..80 * 60).map(dot).collect(),
        };
        let space = ObjectSpace {
            min: Vector3::repeat(-500.0),
            max: Vector3::repeat(500.0),
        };
        let sight = Sight::new(&view, 1.0, space);
        for (x, y) in [(0.0, 0.0), (-316.0, -236.0), (316.0, 0.0)] {
            let density = sight.density(&Vector2::new(x, y), |_| true);
            assert_eq!(density, 1.0 / 64.0, "{x} {y}");
        }
    }
}
