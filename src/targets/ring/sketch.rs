//! The picture of a ring code, computed: what its dot and each of its segments give to the pixels.
//!
//! The code is drawn on nodes half a pixel apart, every edge softened as if blurred by [`SOFT`], and the drawing is blurred by
//! the rest. Edges softened so little are straight and stand by themselves, so the drawing is right to some 1e-3 of the contrast
//! wherever dot, ring and segments run into one another under the blur.

use std::f64::consts::TAU;

use nalgebra::Vector2;
use wide::f32x4;

use super::first_look::OUTER;
use super::frame::RingFrame;
use super::patch::Patch;

/// Standard deviation of the softened edges, pixels.
const SOFT: f64 = 0.35;
/// Nodes a pixel.
const NODES: f64 = 2.0;

/// Inner edge of the ring, in radii of the dot.
const INNER: f64 = 2.0;

/// What the drawing shows at a node.
#[derive(Clone, Copy, Default)]
struct Node {
    /// Share of the dot, of the ring.
    dot: f32,
    ring: f32,
    /// Of the ring's share so much belongs to the neighbour.
    mix: f32,
    /// A line along the nearest border, softened as the edges are, per pixel of its width.
    line: f32,
    segment: u8,
    neighbour: u8,
}

/// A rectangle of nodes, the ends excluded.
#[derive(Clone, Copy, Debug)]
struct Span {
    columns: [usize; 2],
    rows: [usize; 2],
}

impl Span {
    const NOTHING: Self = Self {
        columns: [usize::MAX, 0],
        rows: [usize::MAX, 0],
    };

    fn add(&mut self, column: usize, row: usize) {
        self.columns = [self.columns[0].min(column), self.columns[1].max(column + 1)];
        self.rows = [self.rows[0].min(row), self.rows[1].max(row + 1)];
    }

    /// Wider by `reach` on every side, within the nodes.
    fn wider(&self, reach: usize, columns: usize, rows: usize) -> Self {
        let wider = |[first, end]: [usize; 2], most: usize| {
            [first.saturating_sub(reach), (end + reach).min(most)]
        };
        Self {
            columns: wider(self.columns, columns),
            rows: wider(self.rows, rows),
        }
    }
}

/// A code drawn in a frame.
pub(super) struct Sketch {
    columns: usize,
    rows: usize,
    nodes: Vec<Node>,
    dot: Span,
    segments: Vec<Span>,
    /// Half the width of a soft edge, pixels.
    half_width: f32,
    /// Half of the kernel of the remaining blur, from its middle.
    kernel: Vec<f32>,
}

/// A blurred picture on the nodes.
pub(super) struct Blurred {
    span: Span,
    values: Vec<f32>,
}

impl Sketch {
    /// Draws a code of so many segments whose first one begins in the frame's first direction. `dot_radius` is 1 but for the
    /// print, `blur` in pixels of the patch.
    pub(super) fn new(
        patch: &Patch,
        frame: &RingFrame,
        segments: u8,
        dot_radius: f64,
        blur: f64,
    ) -> Option<Self> {
        let soft = SOFT.min(0.7 * blur);
        let pen = Pen::new(frame, 5.0_f64.sqrt() * soft, dot_radius)?;
        let (columns, rows) = (2 * patch.columns + 1, 2 * patch.rows + 1);
        let mut sketch = Self {
            columns,
            rows,
            nodes: vec![Node::default(); columns * rows],
            dot: Span::NOTHING,
            segments: vec![Span::NOTHING; usize::from(segments)],
            half_width: pen.half_width as f32,
            kernel: kernel((blur * blur - soft * soft).sqrt() * NODES),
        };
        for row in 0..rows {
            let y = row as f64 / NODES - frame.centre.y;
            let Some(ends) = pen.along_row(y) else {
                continue;
            };
            let [first, end] =
                ends.map(|x| ((x + frame.centre.x) * NODES).clamp(0.0, columns as f64));
            for begin in (first as usize..(end.ceil() as usize).min(columns)).step_by(LANES) {
                let x = begin as f64 / NODES - frame.centre.x;
                if let Some(strokes) = pen.strokes(x as f32, y as f32) {
                    sketch.take(row, begin, &strokes);
                }
            }
        }
        Some(sketch)
    }

    /// Takes neighbouring nodes of a row from the pen.
    fn take(&mut self, row: usize, begin: usize, strokes: &Strokes) {
        let segments = self.segments.len() as f32;
        for lane in 0..LANES.min(self.columns - begin) {
            let column = begin + lane;
            let mut node = Node {
                dot: strokes.dot[lane],
                ring: strokes.ring[lane],
                ..Node::default()
            };
            if node.dot > 0.0 {
                self.dot.add(column, row);
            }
            if node.ring > 0.0 {
                let turn = strokes.turn[lane] * segments;
                let turn = if turn < 0.0 { turn + segments } else { turn };
                let segment = (turn as usize).min(self.segments.len() - 1);
                let within = turn - segment as f32;
                let (step, border) = if within < 0.5 {
                    (self.segments.len() - 1, within)
                } else {
                    (1, 1.0 - within)
                };
                let neighbour = (segment + step) % self.segments.len();
                let distance = border / segments * strokes.per_turn[lane];
                node.mix = soft(f32x4::splat(-distance)).to_array()[0];
                node.line =
                    node.ring * 0.75 * (1.0 - distance * distance).max(0.0) / self.half_width;
                node.segment = segment as u8;
                node.neighbour = neighbour as u8;
                self.segments[segment].add(column, row);
                if node.mix > 0.0 {
                    self.segments[neighbour].add(column, row);
                }
            }
            self.nodes[row * self.columns + column] = node;
        }
    }

    /// What the dot gives.
    pub(super) fn dot(&self) -> Blurred {
        self.blurred(self.dot, |node| node.dot)
    }

    /// What one segment gives where it is light.
    pub(super) fn segment(&self, segment: usize) -> Blurred {
        let own = segment as u8;
        self.blurred(self.segments[segment], |node| {
            if node.segment == own {
                node.ring * (1.0 - node.mix)
            } else if node.neighbour == own {
                node.ring * node.mix
            } else {
                0.0
            }
        })
    }

    /// What the whole ring gives, its segments light to these shares.
    pub(super) fn ring(&self, light: &[f32]) -> Blurred {
        let all = Span {
            columns: [0, self.columns],
            rows: [0, self.rows],
        };
        let share = |segment: u8| light[usize::from(segment)];
        self.blurred(all, |node| {
            if node.ring > 0.0 {
                let own = share(node.segment);
                node.ring * (own + node.mix * (share(node.neighbour) - own))
            } else {
                0.0
            }
        })
    }

    /// What lines along all borders between segments give, per pixel of their width.
    pub(super) fn lines(&self) -> Blurred {
        let all = Span {
            columns: [0, self.columns],
            rows: [0, self.rows],
        };
        self.blurred(all, |node| node.line)
    }

    fn blurred(&self, drawn: Span, value: impl Fn(&Node) -> f32) -> Blurred {
        if drawn.rows[0] >= drawn.rows[1] {
            return Blurred {
                span: Span {
                    columns: [0; 2],
                    rows: [0; 2],
                },
                values: Vec::new(),
            };
        }
        let reach = self.kernel.len() - 1;
        let span = drawn.wider(reach, self.columns, self.rows);
        let width = span.columns[1] - span.columns[0];
        let height = span.rows[1] - span.rows[0];
        // Every row has room for the kernel on either side.
        let mut line = vec![0.0_f32; width + 2 * reach];
        let mut across = vec![0.0_f32; width * height];
        for row in drawn.rows[0]..drawn.rows[1] {
            line.fill(0.0);
            let nodes = &self.nodes[row * self.columns..][drawn.columns[0]..drawn.columns[1]];
            let first = reach + drawn.columns[0] - span.columns[0];
            for (slot, node) in line[first..].iter_mut().zip(nodes) {
                *slot = value(node);
            }
            let out = &mut across[(row - span.rows[0]) * width..][..width];
            for (tap, weight) in self.taps() {
                for (out, &value) in out.iter_mut().zip(&line[tap..]) {
                    *out += weight * value;
                }
            }
        }
        let mut values = vec![0.0_f32; width * height];
        let drawn_rows = [drawn.rows[0] - span.rows[0], drawn.rows[1] - span.rows[0]];
        for (row, out) in values.chunks_mut(width).enumerate() {
            for (tap, weight) in self.taps() {
                // The source of a tap is row + tap - reach.
                let source = (row + tap).wrapping_sub(reach);
                if (drawn_rows[0]..drawn_rows[1]).contains(&source) {
                    for (out, &value) in out.iter_mut().zip(&across[source * width..]) {
                        *out += weight * value;
                    }
                }
            }
        }
        Blurred { span, values }
    }

    fn taps(&self) -> impl Iterator<Item = (usize, f32)> {
        let half = self.kernel.len() - 1;
        (0..=2 * half).map(move |tap| (tap, self.kernel[tap.abs_diff(half)]))
    }
}

/// Half of a normalised Gaussian kernel of this standard deviation in nodes, from its middle.
fn kernel(sigma: f64) -> Vec<f32> {
    const REACH: f64 = 3.2;
    let half = (REACH * sigma).ceil() as usize;
    let weights: Vec<f64> = (0..=half)
        .map(|tap| (-0.5 * (tap as f64 / sigma).powi(2)).exp())
        .collect();
    let sum = 2.0 * weights.iter().sum::<f64>() - weights[0];
    weights.iter().map(|weight| (weight / sum) as f32).collect()
}

/// Nodes drawn at once.
const LANES: usize = 4;

/// What draws the nodes.
struct Pen {
    /// From the picture to the plane before the perspective, its columns.
    back: [Vector2<f64>; 2],
    tilt: Vector2<f64>,
    /// Half the width of a soft edge, pixels.
    half_width: f64,
    dot_radius: f64,
    /// Nothing is drawn beyond this radius, perspective left out.
    reach: f64,
}

/// Neighbouring nodes as drawn.
struct Strokes {
    dot: [f32; LANES],
    ring: [f32; LANES],
    /// Direction as a share of the turn, -0.5 to 0.5.
    turn: [f32; LANES],
    /// Half widths of a soft edge to a full turn.
    per_turn: [f32; LANES],
}

impl Pen {
    fn new(frame: &RingFrame, half_width: f64, dot_radius: f64) -> Option<Self> {
        let back = frame.map.try_inverse()?;
        let tilt = frame.tilt.norm();
        let reach = OUTER + half_width * back.norm() * (1.0 + 4.0 * tilt);
        Some(Self {
            back: [back.column(0).into(), back.column(1).into()],
            tilt: frame.tilt,
            half_width,
            dot_radius,
            reach: reach / (1.0 - tilt * reach).max(0.2),
        })
    }

    /// Between which places from the centre a row at `y` from the centre is drawn.
    fn along_row(&self, y: f64) -> Option<[f64; 2]> {
        let [by_x, by_y] = &self.back;
        let (a, b) = (by_x.norm_squared(), by_x.dot(by_y) * y);
        let c = by_y.norm_squared() * y * y - self.reach * self.reach;
        let root = (b * b - a * c).sqrt();
        (root >= 0.0).then(|| [(-b - root) / a, (root - b) / a])
    }

    /// Draws the nodes from `x`, `y` from the centre on along the row; `None` where nothing is seen.
    fn strokes(&self, x: f32, y: f32) -> Option<Strokes> {
        let all = |value: f64| f32x4::splat(value as f32);
        let one = f32x4::ONE;
        let [by_x, by_y] = &self.back;
        let xs = f32x4::splat(x) + f32x4::from([0.0, 1.0, 2.0, 3.0]) * all(1.0 / NODES);
        let ys = f32x4::splat(y);
        let affine = [
            all(by_x.x) * xs + all(by_y.x) * ys,
            all(by_x.y) * xs + all(by_y.y) * ys,
        ];
        let (tilt_x, tilt_y) = (all(self.tilt.x), all(self.tilt.y));
        let scale = one / (one - tilt_x * affine[0] - tilt_y * affine[1]).max(all(0.1));
        let plane = affine.map(|value| value * scale);
        let radius = (plane[0] * plane[0] + plane[1] * plane[1])
            .sqrt()
            .max(all(1e-6));
        let outward = plane.map(|value| value / radius);
        // Derivative of the plane by the picture: scale (I + plane tilt^T) back; softness of an edge with this normal.
        let softness = |along_x: f32x4, along_y: f32x4| {
            let by = [by_x, by_y].map(|by| all(by.x) * along_x + all(by.y) * along_y);
            (by[0] * by[0] + by[1] * by[1]).sqrt() * scale * all(self.half_width)
        };
        let across = softness(outward[0] + tilt_x * radius, outward[1] + tilt_y * radius);
        let sharpness = one / across;
        let dot = soft((all(self.dot_radius) - radius) * sharpness);
        let ring =
            soft((radius - all(INNER)) * sharpness) * soft((all(OUTER) - radius) * sharpness);
        let (dot, ring) = (dot.to_array(), ring.to_array());
        let drawn = |shares: &[f32; LANES]| shares.iter().any(|&share| share > 0.0);
        if !drawn(&ring) {
            return drawn(&dot).then_some(Strokes {
                dot,
                ring,
                turn: [0.0; LANES],
                per_turn: [0.0; LANES],
            });
        }
        let along = softness(-outward[1], outward[0]);
        let turn = plane[1].atan2(plane[0]) * all(1.0 / TAU);
        Some(Strokes {
            dot,
            ring,
            turn: turn.to_array(),
            per_turn: (radius * all(TAU) / along).to_array(),
        })
    }
}

/// A soft step, half-way at 0, complete at 1: the integral of a parabola whose variance is 1/5.
fn soft(t: f32x4) -> f32x4 {
    let t = t.fast_max(f32x4::splat(-1.0)).fast_min(f32x4::ONE);
    f32x4::splat(0.5) + t * (f32x4::splat(0.75) - f32x4::splat(0.25) * t * t)
}

impl Blurred {
    fn node(&self, x: usize, y: usize) -> f64 {
        let [left, right] = self.span.columns;
        let [top, bottom] = self.span.rows;
        if (left..right).contains(&x) && (top..bottom).contains(&y) {
            f64::from(self.values[(y - top) * (right - left) + x - left])
        } else {
            0.0
        }
    }

    /// Value at the middle of a pixel.
    pub(super) fn value(&self, column: usize, row: usize) -> f64 {
        self.node(2 * column + 1, 2 * row + 1)
    }

    /// Value, derivatives along columns and rows, and Laplacian at the middle of a pixel, per pixel.
    pub(super) fn jet(&self, column: usize, row: usize) -> Jet {
        let (x, y) = (2 * column + 1, 2 * row + 1);
        let value = self.node(x, y);
        let (left, right) = (self.node(x - 1, y), self.node(x + 1, y));
        let (up, down) = (self.node(x, y - 1), self.node(x, y + 1));
        Jet {
            value,
            slope: Vector2::new(right - left, down - up),
            laplacian: 4.0 * (left + right + up + down - 4.0 * value),
        }
    }
}

/// A picture near a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jet {
    pub(super) value: f64,
    pub(super) slope: Vector2<f64>,
    pub(super) laplacian: f64,
}
