//! The search behind [`super::device`]: triples of dots as three chosen device points give poses, poses predict the rest.

use nalgebra::{Matrix2, Matrix3, Rotation3, Vector2, Vector3};

use crate::geometry::Pose;

/// Triples of dots tried with a base: with N dots and K neighbours of each, N K^2 stays near this number, some 100 ms.
/// The device's dots must be among each other's K nearest: with 250 dots K is 40.
const NEIGHBOUR_BUDGET: f64 = 4.0e5;

/// Least distance between the images of two base points, in search tolerances: nearer ones give no direction.
const LEAST_BASE: f64 = 1.5;

/// Three device points that are looked for first, and the others in their frame.
#[derive(Clone, Debug)]
pub(super) struct Base {
    /// Indices of the three device points; the first is the one nearest to the other two.
    pub(super) points: [usize; 3],
    /// Inverse of the matrix of the second's and third's places in the base's plane, 1/mm.
    inverse: Matrix2<f64>,
    /// The second's and third's places in the base's plane, mm.
    places: [Vector2<f64>; 2],
    /// Indices of the other points, and their places in the base's frame, mm.
    others: Vec<(usize, Vector3<f64>)>,
    /// The frame: axes in rows, so that it takes device directions to the base's frame.
    frame: Matrix3<f64>,
    /// The side the device is seen from, in the base's frame.
    facing: Vector3<f64>,
    /// Area of the triangle seen from the device's front, mm^2.
    front_area: f64,
}

impl Base {
    fn of(device: &[Vector3<f64>], triple: [usize; 3], facing: &Vector3<f64>) -> Option<Self> {
        let longest = |k: usize| {
            let from = device[triple[k]];
            triple
                .iter()
                .map(|&m| (device[m] - from).norm())
                .fold(0.0, f64::max)
        };
        let first = (0..3).min_by(|&a, &b| longest(a).total_cmp(&longest(b)))?;
        let points = [
            triple[first],
            triple[(first + 1) % 3],
            triple[(first + 2) % 3],
        ];
        let [origin, u, v] = points.map(|k| device[k]);
        let (u, v) = (u - origin, v - origin);
        let normal = u.cross(&v);
        if normal.norm() < 0.1 * u.norm() * v.norm() {
            return None;
        }
        let sign = if normal.dot(facing) < 0.0 { -1.0 } else { 1.0 };
        let n = normal.normalize() * sign;
        let x = u.normalize();
        let frame = Matrix3::from_rows(&[x.transpose(), n.cross(&x).transpose(), n.transpose()]);
        let places = [(frame * u).xy(), (frame * v).xy()];
        let others = (0..device.len())
            .filter(|k| !points.contains(k))
            .map(|k| (k, frame * (device[k] - origin)))
            .collect();
        Some(Self {
            points,
            inverse: Matrix2::from_columns(&places).try_inverse()?,
            places,
            others,
            frame,
            facing: frame * facing,
            front_area: 0.5 * normal.dot(facing).abs(),
        })
    }
}

/// Bases such that whichever `missing` points are hidden, one base is whole; the best-conditioned first.
pub(super) fn bases(device: &[Vector3<f64>], facing: &Vector3<f64>, missing: usize) -> Vec<Base> {
    let n = device.len();
    let mut candidates = Vec::new();
    for i in 0..n {
        for j in i + 1..n {
            for k in j + 1..n {
                candidates.extend(Base::of(device, [i, j, k], facing));
            }
        }
    }
    candidates.sort_by(|a, b| b.front_area.total_cmp(&a.front_area));
    let mut uncovered = subsets(n, missing);
    let mut chosen: Vec<Base> = Vec::new();
    while !uncovered.is_empty() {
        let covers =
            |base: &Base, hidden: &[usize]| !hidden.iter().any(|h| base.points.contains(h));
        let gain = |base: &Base| {
            uncovered
                .iter()
                .filter(|hidden| covers(base, hidden))
                .count()
        };
        // The first of the largest gains is the widest triangle, since `max_by_key` would take the last.
        let Some(best) = candidates
            .iter()
            .rev()
            .max_by_key(|base| gain(base))
            .filter(|b| gain(b) > 0)
            .cloned()
        else {
            break;
        };
        uncovered.retain(|hidden| !covers(&best, hidden));
        chosen.push(best);
    }
    chosen
}

/// All subsets of `size` (0, 1 or 2) of `n` things.
fn subsets(n: usize, size: usize) -> Vec<Vec<usize>> {
    match size {
        0 => vec![Vec::new()],
        1 => (0..n).map(|k| vec![k]).collect(),
        _ => (0..n)
            .flat_map(|j| (0..j).map(move |k| vec![k, j]))
            .collect(),
    }
}

/// Dots by place.
pub(super) struct DotGrid {
    low: Vector2<f64>,
    cell: f64,
    columns: usize,
    rows: usize,
    starts: Vec<usize>,
    members: Vec<usize>,
    places: Vec<Vector2<f64>>,
}

impl DotGrid {
    pub(super) fn new(places: &[Vector2<f64>], cell: f64) -> Self {
        let mut low = Vector2::repeat(f64::INFINITY);
        let mut high = Vector2::repeat(f64::NEG_INFINITY);
        for place in places {
            low = low.inf(place);
            high = high.sup(place);
        }
        // A cell no smaller than 1/500 of the picture keeps the table small whatever the input.
        let cell = cell.max((high - low).amax() / 500.0).max(1e-9);
        let columns = ((high.x - low.x) / cell) as usize + 1;
        let rows = ((high.y - low.y) / cell) as usize + 1;
        let slot = |p: &Vector2<f64>| {
            let column = ((p.x - low.x) / cell) as usize;
            let row = ((p.y - low.y) / cell) as usize;
            row.min(rows - 1) * columns + column.min(columns - 1)
        };
        let mut members: Vec<usize> = (0..places.len()).collect();
        members.sort_by_key(|&k| (slot(&places[k]), k));
        let mut starts = vec![0; columns * rows + 1];
        for place in places {
            starts[slot(place) + 1] += 1;
        }
        for k in 1..starts.len() {
            starts[k] += starts[k - 1];
        }
        Self {
            low,
            cell,
            columns,
            rows,
            starts,
            members,
            places: places.to_vec(),
        }
    }

    /// The dot nearest to a place within `radius`, other than `taken`, and its distance.
    pub(super) fn nearest(
        &self,
        place: &Vector2<f64>,
        radius: f64,
        taken: &[Option<usize>],
    ) -> Option<(usize, f64)> {
        let from = (place - self.low - Vector2::repeat(radius)) / self.cell;
        let to = (place - self.low + Vector2::repeat(radius)) / self.cell;
        if !(to.x >= 0.0
            && to.y >= 0.0
            && from.x <= self.columns as f64
            && from.y <= self.rows as f64)
        {
            return None;
        }
        let columns = from.x.max(0.0) as usize..=(to.x as usize).min(self.columns - 1);
        let mut best: Option<(usize, f64)> = None;
        for row in from.y.max(0.0) as usize..=(to.y as usize).min(self.rows - 1) {
            for column in columns.clone() {
                let slot = row * self.columns + column;
                for &dot in &self.members[self.starts[slot]..self.starts[slot + 1]] {
                    let distance = (self.places[dot] - place).norm();
                    let nearer = distance <= best.map_or(radius, |b| b.1);
                    if nearer && !taken.contains(&Some(dot)) {
                        best = Some((dot, distance));
                    }
                }
            }
        }
        best
    }
}

/// What the search may look for.
pub(super) struct Limits {
    /// Principal distance, mm.
    pub(super) c: f64,
    /// A dot this near to a predicted place is the device's, mm in the image.
    pub(super) tolerance: f64,
    /// Least cosine of the angle between the device's front and the line of sight.
    pub(super) least_cosine: f64,
    /// Device points that may be missing.
    pub(super) missing: usize,
    /// Nearest and farthest distance of each dot if it is the device's, mm.
    pub(super) ranges: Vec<[f64; 2]>,
}

/// A pose proposed by a base, with the dots it predicted.
#[derive(Clone, Debug)]
pub(super) struct Proposal {
    /// Device index -> dot index.
    pub(super) dots: Vec<Option<usize>>,
    pub(super) found: usize,
    /// Sum of squared misses, mm^2.
    pub(super) misfit: f64,
    pub(super) pose: Pose,
}

/// All proposals of a base, and how many poses were tried.
pub(super) fn propose(
    device: &[Vector3<f64>],
    base: &Base,
    places: &[Vector2<f64>],
    grid: &DotGrid,
    limits: &Limits,
) -> (Vec<Proposal>, usize) {
    let mut proposals = Vec::new();
    let mut tried = 0;
    let n = places.len();
    let neighbours = ((NEIGHBOUR_BUDGET / n as f64).sqrt() as usize).clamp(24, 200);
    // How far the base's plane may be turned away when the device itself is seen at the largest angle.
    let lean = base.facing.z.clamp(-1.0, 1.0).acos();
    let least_base_cosine = (limits.least_cosine.acos() + lean)
        .min(std::f64::consts::PI)
        .cos();
    for first in 0..n {
        let view = View::towards(&places[first], limits.c);
        let near = nearest_dots(first, places, neighbours);
        let seen: Vec<Vector2<f64>> = near.iter().map(|&k| view.tangential(&places[k])).collect();
        let least = LEAST_BASE * limits.tolerance / limits.c;
        let scales = limits.ranges[first].map(|range| 1.0 / range);
        for (j, second) in near.iter().enumerate() {
            if seen[j].norm() < least {
                continue;
            }
            for (k, third) in near.iter().enumerate() {
                if k == j {
                    continue;
                }
                let map = Matrix2::from_columns(&[seen[j], seen[k]]) * base.inverse;
                let Some(()) = plausible(&map, &scales, least_base_cosine) else {
                    continue;
                };
                for sign in [1.0, -1.0] {
                    let Some(flat) = Tilted::from_map(&map, sign) else {
                        continue;
                    };
                    // Parallel projection misjudges tilts by some degrees and distances by some per cent.
                    if !flat.within(
                        base,
                        0.8 * limits.least_cosine,
                        &[1.3 * scales[0], 0.7 * scales[1]],
                    ) {
                        continue;
                    }
                    let Some(tilted) = flat.in_perspective(base, &[seen[j], seen[k]], sign) else {
                        continue;
                    };
                    if !tilted.within(base, limits.least_cosine, &scales) {
                        continue;
                    }
                    tried += 1;
                    let base_dots = [first, *second, *third];
                    proposals.extend(predict(
                        device, base, &view, &tilted, base_dots, grid, limits,
                    ));
                }
            }
        }
    }
    (proposals, tried)
}

/// Whether an affine map can be a plane seen within the limits, before any root is drawn.
fn plausible(map: &Matrix2<f64>, scales: &[f64; 2], least_cosine: f64) -> Option<()> {
    let squares = map.norm_squared();
    let determinant = map.determinant();
    // The larger singular value squared lies between half the sum of squares and the sum; perspective may add 30 %.
    let in_range = squares > 0.5 * scales[1] * scales[1] && squares < 4.0 * scales[0] * scales[0];
    // With s >= t the singular values, t / s >= r means s t / (s^2 + t^2) >= r / (1 + r^2).
    let r = 0.8 * least_cosine;
    let front = if least_cosine > 0.0 {
        determinant * (1.0 + r * r) >= r * squares
    } else {
        true
    };
    (in_range && front).then_some(())
}

/// The camera turned towards a dot, so that the device near it is seen nearly in parallel projection.
struct View {
    /// From the camera frame to the turned one.
    turn: Matrix3<f64>,
    c: f64,
}

impl View {
    fn towards(place: &Vector2<f64>, c: f64) -> Self {
        let backwards = -Vector3::new(place.x, place.y, -c).normalize();
        let x = Vector3::y().cross(&backwards).normalize();
        let y = backwards.cross(&x);
        Self {
            turn: Matrix3::from_rows(&[x.transpose(), y.transpose(), backwards.transpose()]),
            c,
        }
    }

    fn tangential(&self, place: &Vector2<f64>) -> Vector2<f64> {
        let ray = self.turn * Vector3::new(place.x, place.y, -self.c);
        -ray.xy() / ray.z
    }

    /// The image point of a point of the turned frame; `None` behind the camera.
    fn image(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let k = self.turn.tr_mul(point);
        (k.z < 0.0).then(|| k.xy() * (-self.c / k.z))
    }
}

fn nearest_dots(first: usize, places: &[Vector2<f64>], count: usize) -> Vec<usize> {
    let mut order: Vec<(f64, usize)> = places
        .iter()
        .enumerate()
        .filter(|(k, _)| *k != first)
        .map(|(k, p)| ((p - places[first]).norm_squared(), k))
        .collect();
    if order.len() > count {
        order.select_nth_unstable_by(count, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        order.truncate(count);
    }
    let mut dots: Vec<usize> = order.into_iter().map(|(_, k)| k).collect();
    dots.sort_unstable();
    dots
}

/// A base's pose in the turned camera frame.
struct Tilted {
    rotation: Matrix3<f64>,
    /// One over the distance, 1/mm.
    scale: f64,
}

impl Tilted {
    /// Whether the device is seen from its front, within the limits of tilt and distance.
    fn within(&self, base: &Base, least_cosine: f64, scales: &[f64; 2]) -> bool {
        let front = (self.rotation.row(2) * base.facing)[0];
        front >= least_cosine && self.scale <= scales[0] && self.scale >= scales[1]
    }

    /// Two rounds of POSIT (DeMenthon and Davis, 1995; for planes Oberkampf et al., 1996) from parallel projection.
    fn in_perspective(mut self, base: &Base, seen: &[Vector2<f64>; 2], sign: f64) -> Option<Self> {
        for _ in 0..2 {
            let lifted = [0, 1].map(|k: usize| {
                let towards = self.rotation[(2, 0)] * base.places[k].x
                    + self.rotation[(2, 1)] * base.places[k].y;
                seen[k] * (1.0 - self.scale * towards)
            });
            self = Self::from_map(&(Matrix2::from_columns(&lifted) * base.inverse), sign)?;
        }
        Some(self)
    }

    /// Scaled orthography: two tilts, by the `sign` of the first axis's depth.
    fn from_map(map: &Matrix2<f64>, sign: f64) -> Option<Self> {
        let (p, q) = (map.column(0), map.column(1));
        let squares = p.norm_squared() + q.norm_squared();
        let determinant = map.determinant();
        let scale2 = 0.5
            * (squares
                + (squares * squares - 4.0 * determinant * determinant)
                    .max(0.0)
                    .sqrt());
        if !(scale2 > 0.0) {
            return None;
        }
        let scale = scale2.sqrt();
        let dot = p.dot(&q);
        let a = (1.0 - p.norm_squared() / scale2).max(0.0).sqrt() * sign;
        let b = (1.0 - q.norm_squared() / scale2).max(0.0).sqrt()
            * if dot > 0.0 { -sign } else { sign };
        let x = Vector3::new(p.x / scale, p.y / scale, a);
        let y = Vector3::new(q.x / scale, q.y / scale, b);
        Some(Self {
            rotation: Matrix3::from_columns(&[x, y, x.cross(&y)]),
            scale,
        })
    }
}

/// Predicts the other points and takes the dots found there; `None` where too many are missing.
fn predict(
    device: &[Vector3<f64>],
    base: &Base,
    view: &View,
    tilted: &Tilted,
    base_dots: [usize; 3],
    grid: &DotGrid,
    limits: &Limits,
) -> Option<Proposal> {
    let distance = 1.0 / tilted.scale;
    let mut taken = [None; 16];
    for (slot, dot) in taken.iter_mut().zip(base_dots) {
        *slot = Some(dot);
    }
    let mut found = 3;
    let mut missing = 0;
    let mut misfit = 0.0;
    let mut chosen = [None; 16];
    for (slot, (_, place)) in base.others.iter().enumerate() {
        let point = tilted.rotation * place - Vector3::z() * distance;
        let hit = view
            .image(&point)
            .and_then(|image| grid.nearest(&image, limits.tolerance, &taken[..found]));
        if let Some((dot, miss)) = hit {
            chosen[slot] = Some(dot);
            taken[found] = Some(dot);
            found += 1;
            misfit += miss * miss;
        } else {
            missing += 1;
            if missing > limits.missing {
                return None;
            }
        }
    }
    let mut dots = vec![None; device.len()];
    for (point, dot) in base.points.iter().zip(base_dots) {
        dots[*point] = Some(dot);
    }
    for ((point, _), dot) in base.others.iter().zip(chosen) {
        dots[*point] = dot;
    }
    // k = turn^T (R frame (X - X_first) - distance z).
    let rotation = orthonormal(&(view.turn.transpose() * tilted.rotation * base.frame));
    let back = view.turn.transpose() * Vector3::z() * distance;
    let pose = Pose {
        camera_from_world: rotation,
        centre_in_world: device[base.points[0]] + rotation.inverse() * back,
    };
    Some(Proposal {
        dots,
        found,
        misfit,
        pose,
    })
}

/// The rotation next to a matrix that is one but for rounding and POSIT's remainder.
fn orthonormal(matrix: &Matrix3<f64>) -> Rotation3<f64> {
    let x = matrix.column(0).normalize();
    let y = matrix.column(1);
    let y = (y - x * x.dot(&y)).normalize();
    Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]))
}
