//! The picture of a ring code, computed: what its dot and each of its segments give to the pixels.
//!
//! The code is drawn on nodes half a pixel apart, every edge softened as if blurred by [`SOFT`], and the drawing is blurred by
//! the rest. Edges softened so little are straight and stand by themselves, so the drawing is right to some 1e-3 of the contrast
//! wherever dot, ring and segments run into one another under the blur.

use nalgebra::Vector2;
use pulp::NullaryFnOnce;

use super::frame::RingFrame;
use super::patch::Patch;
use super::pen::{Borders, Pen, Strokes};
use crate::targets::lanes::{LANES, Lanes, run};

/// Standard deviation of the softened edges, pixels.
const SOFT: f64 = 0.35;
/// Nodes a pixel.
const NODES: f64 = 2.0;

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

    fn height(&self) -> usize {
        self.rows[1].saturating_sub(self.rows[0])
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
    stride: usize,
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
        run(Drawing {
            pen: &pen,
            centre: frame.centre,
            sketch: &mut sketch,
        });
        Some(sketch)
    }

    /// Takes neighbouring nodes of a row from the pen.
    #[inline(always)]
    fn take(&mut self, row: usize, begin: usize, strokes: &Strokes) {
        let last = self.segments.len() - 1;
        let borders = Borders::near(strokes, self.segments.len(), self.half_width);
        let end = self.columns.min(begin + LANES);
        let nodes = &mut self.nodes[row * self.columns..][begin..end];
        for ((lane, column), node) in (begin..end).enumerate().zip(nodes) {
            node.dot = strokes.dot.0[lane];
            if node.dot > 0.0 {
                self.dot.add(column, row);
            }
            if strokes.ring.0[lane] > 0.0 {
                let segment = borders.segment.0[lane] as usize;
                let neighbour = match (borders.within.0[lane] < 0.5, segment) {
                    (true, 0) => last,
                    (true, segment) => segment - 1,
                    (false, segment) if segment == last => 0,
                    (false, segment) => segment + 1,
                };
                node.ring = strokes.ring.0[lane];
                node.mix = borders.mix.0[lane];
                node.line = borders.line.0[lane];
                node.segment = segment as u8;
                node.neighbour = neighbour as u8;
                self.segments[segment].add(column, row);
                if node.mix > 0.0 {
                    self.segments[neighbour].add(column, row);
                }
            }
        }
    }

    /// What the dot gives.
    pub(super) fn dot(&self) -> Blurred {
        self.blurred(self.dot, |node| node.dot)
    }

    /// What the dot gives at the middles of pixels.
    pub(super) fn dot_at_middles(&self) -> Middles {
        self.at_middles(self.dot, |node| node.dot)
    }

    /// What one segment gives where it is light.
    pub(super) fn segment(&self, segment: usize) -> Middles {
        let own = segment as u8;
        self.at_middles(self.segments[segment], |node| {
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
        let share = |segment: u8| light[usize::from(segment)];
        self.blurred(self.all(), |node| {
            if node.ring > 0.0 {
                let own = share(node.segment);
                node.ring * (own + node.mix * (share(node.neighbour) - own))
            } else {
                0.0
            }
        })
    }

    /// What lines along all borders between segments give, per pixel of their width.
    pub(super) fn lines(&self) -> Middles {
        self.at_middles(self.all(), |node| node.line)
    }

    /// All nodes.
    fn all(&self) -> Span {
        Span {
            columns: [0, self.columns],
            rows: [0, self.rows],
        }
    }

    fn blurred(&self, drawn: Span, value: impl Fn(&Node) -> f32) -> Blurred {
        let reach = self.kernel.len() - 1;
        let span = drawn.wider(reach, self.columns, self.rows);
        let stride = padded(span.columns);
        // A row with room for the kernel on either side.
        let mut line = vec![0.0_f32; stride + 2 * reach];
        let first = reach + drawn.columns[0].saturating_sub(span.columns[0]);
        let taps: Vec<Tap> = self.taps().collect();
        let mut across = vec![0.0_f32; stride * drawn.height()];
        for (out, nodes) in across.chunks_mut(stride.max(1)).zip(self.nodes_of(drawn)) {
            for (slot, node) in line[first..].iter_mut().zip(nodes) {
                *slot = value(node);
            }
            weighted_sum(out, &line, &taps);
        }
        Blurred {
            values: self.blurred_along_columns(&across, drawn, stride, span.rows, 1),
            span,
            stride,
        }
    }

    /// The same at the middles of pixels only, which are the odd nodes: a quarter of the sums.
    fn at_middles(&self, drawn: Span, value: impl Fn(&Node) -> f32) -> Middles {
        let reach = self.kernel.len() - 1;
        let span = drawn.wider(reach, self.columns, self.rows);
        let [columns, rows] = [span.columns, span.rows].map(|[first, end]| [first / 2, end / 2]);
        let stride = padded(columns);
        // Every other node of a row, then the others, both from the first one that the sum of the first pixel takes.
        let begin = 2 * columns[0] + 1;
        let half = stride + reach + 1;
        let place = |node: usize| node / 2 + node % 2 * half;
        let mut line = vec![0.0_f32; 2 * half];
        let of_half = |(at, weight): Tap| (place(at), weight);
        let taps: Vec<Tap> = self.taps().map(of_half).collect();
        let mut across = vec![0.0_f32; stride * drawn.height()];
        for (out, nodes) in across.chunks_mut(stride.max(1)).zip(self.nodes_of(drawn)) {
            for (node, column) in nodes.iter().zip(drawn.columns[0]..) {
                if let Some(from_begin) = (column + reach).checked_sub(begin) {
                    line[place(from_begin)] = value(node);
                }
            }
            weighted_sum(out, &line, &taps);
        }
        let middles = [2 * rows[0] + 1, 2 * rows[1]];
        Middles {
            values: self.blurred_along_columns(&across, drawn, stride, middles, 2),
            columns,
            rows,
            stride,
        }
    }

    /// The blur along columns of the rows that are drawn, as they are blurred along themselves: at every `step`-th of `rows`.
    fn blurred_along_columns(
        &self,
        across: &[f32],
        drawn: Span,
        stride: usize,
        [first, end]: [usize; 2],
        step: usize,
    ) -> Vec<f32> {
        let reach = self.kernel.len() - 1;
        let rows = (first..end).step_by(step);
        let mut values = vec![0.0_f32; stride * rows.len()];
        let mut taps: Vec<Tap> = Vec::with_capacity(2 * reach + 1);
        for (row, out) in rows.zip(values.chunks_mut(stride.max(1))) {
            taps.clear();
            taps.extend(self.taps().filter_map(|(tap, weight)| {
                // The source of a tap is row + tap - reach.
                let source = (row + tap).checked_sub(reach + drawn.rows[0])?;
                (source < drawn.height()).then_some((source * stride, weight))
            }));
            weighted_sum(out, across, &taps);
        }
        values
    }

    /// The nodes of a part, row by row.
    fn nodes_of(&self, part: Span) -> impl Iterator<Item = &[Node]> {
        let rows = part.rows[0]..part.rows[1];
        rows.map(move |row| &self.nodes[row * self.columns..][part.columns[0]..part.columns[1]])
    }

    fn taps(&self) -> impl Iterator<Item = Tap> {
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

/// All nodes of a sketch, to be drawn.
struct Drawing<'a> {
    pen: &'a Pen,
    centre: Vector2<f64>,
    sketch: &'a mut Sketch,
}

impl NullaryFnOnce for Drawing<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self {
            pen,
            centre,
            sketch,
        } = self;
        let columns = sketch.columns;
        let mut steps = Lanes::ZERO;
        for (lane, step) in steps.0.iter_mut().enumerate() {
            *step = lane as f32 / NODES as f32;
        }
        for row in 0..sketch.rows {
            let y = row as f64 / NODES - centre.y;
            let Some(ends) = pen.along_row(y) else {
                continue;
            };
            let [first, end] = ends.map(|x| ((x + centre.x) * NODES).clamp(0.0, columns as f64));
            for begin in (first as usize..(end.ceil() as usize).min(columns)).step_by(LANES) {
                let x = begin as f64 / NODES - centre.x;
                let xs = Lanes::splat(x as f32) + steps;
                if let Some(strokes) = pen.strokes(xs, y as f32) {
                    sketch.take(row, begin, &strokes);
                }
            }
        }
    }
}

/// Room for a row, so that it is a whole number of lanes.
fn padded([first, end]: [usize; 2]) -> usize {
    end.saturating_sub(first).next_multiple_of(LANES)
}

/// Where a summand begins, and its weight.
type Tap = (usize, f32);

/// Sets a row of whole lanes to the weighted sum of others, which all lie in one list.
fn weighted_sum(out: &mut [f32], values: &[f32], taps: &[Tap]) {
    run(WeightedSum { out, values, taps });
}

struct WeightedSum<'a> {
    out: &'a mut [f32],
    values: &'a [f32],
    taps: &'a [Tap],
}

impl NullaryFnOnce for WeightedSum<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (chunk, out) in self.out.chunks_exact_mut(LANES).enumerate() {
            let mut sums = Lanes::ZERO;
            for &(at, weight) in self.taps {
                let mut values = Lanes::ZERO;
                values
                    .0
                    .copy_from_slice(&self.values[at + chunk * LANES..][..LANES]);
                sums += Lanes::splat(weight) * values;
            }
            out.copy_from_slice(&sums.0);
        }
    }
}

impl Blurred {
    fn node(&self, x: usize, y: usize) -> f64 {
        let [left, right] = self.span.columns;
        let [top, bottom] = self.span.rows;
        if (left..right).contains(&x) && (top..bottom).contains(&y) {
            f64::from(self.values[(y - top) * self.stride + x - left])
        } else {
            0.0
        }
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

/// A blurred picture at the middles of a rectangle of pixels, the ends excluded; beyond them it is 0.
#[derive(Default)]
pub(super) struct Middles {
    columns: [usize; 2],
    rows: [usize; 2],
    stride: usize,
    values: Vec<f32>,
}

impl Middles {
    /// Its values in a row of pixels, from the first column on; none where it is 0.
    pub(super) fn row(&self, row: usize) -> (usize, &[f32]) {
        let [left, right] = self.columns;
        if (self.rows[0]..self.rows[1]).contains(&row) {
            let begin = (row - self.rows[0]) * self.stride;
            (left, &self.values[begin..begin + right - left])
        } else {
            (left, &[])
        }
    }

    /// Value at the middle of a pixel.
    pub(super) fn value(&self, column: usize, row: usize) -> f64 {
        let (left, values) = self.row(row);
        let place = column.checked_sub(left);
        place
            .and_then(|place| values.get(place))
            .map_or(0.0, |&value| f64::from(value))
    }
}

/// A picture near a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jet {
    pub(super) value: f64,
    pub(super) slope: Vector2<f64>,
    pub(super) laplacian: f64,
}
