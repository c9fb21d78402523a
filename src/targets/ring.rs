//! Reading segmented ring codes round a centre dot.
//!
//! The dot's ellipse is the affine frame of the code: in its units the ring lies between 2 and 3. Where the ring is
//! light its inner and outer edges are seen, and correct the frame for perspective and for the poor shape of a small
//! dot. Then the ring is unrolled, the changes between light and dark must lie on the grid of the segments, light segments must be as
//! light as the dot, dark ones dark, and the gap between dot and ring dark all round. At last the picture is held against the
//! one that the number says ([`evidence`]): where a segment departs, the reading carries a doubt.

mod evidence;

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use self::evidence::ring_evidence;
use super::CodeEvidence;
use super::dot::{MeasuredDot, View};
use super::family::ring_number;

/// A ring code that was read.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RingReading {
    pub(super) segments: u8,
    pub(super) id: u32,
    /// Root mean square deviation of the segments from light and dark, as a share of the contrast.
    pub(super) misfit: f64,
    pub(super) doubt: Option<String>,
    pub(super) evidence: CodeEvidence,
    /// Where the code lies.
    pub(super) frame: RingFrame,
}

/// What round a dot is not empty but no code.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum RingOutcome {
    /// Nothing like a ring.
    Plain,
    /// Like a ring, but not readable, and why.
    Unreadable(String),
    /// A code.
    Read(RingReading),
}

/// From the plane of a code, in radii of its dot, to the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RingFrame {
    centre: Vector2<f64>,
    map: Matrix2<f64>,
    /// Where the centre of the ring at its middle radius is seen, in radii.
    shift: Vector2<f64>,
}

/// Directions in which the ring is sampled: whole numbers of them for 12, 14 and 20 segments.
const DIRECTIONS: usize = 420;
const MIDDLE: f64 = 2.5;

impl RingFrame {
    fn of_dot(dot: &MeasuredDot) -> Option<Self> {
        let axes = dot.ellipse.axes()?;
        Some(Self {
            centre: dot.ellipse.centre,
            map: axes.frame(),
            shift: Vector2::zeros(),
        })
    }

    fn place(&self, direction: f64, radius: f64) -> Vector2<f64> {
        let (sin, cos) = direction.sin_cos();
        // The image of the centre is not the centre of the image; the shift grows with the square of the radius.
        let bend = (radius / MIDDLE).powi(2);
        self.centre + self.map * (Vector2::new(cos, sin) * radius + self.shift * bend)
    }

    /// Radius of a place of the picture in radii of the dot; the shift is left out.
    pub(super) fn radius_at(&self, place: Vector2<f64>) -> f64 {
        self.map
            .try_inverse()
            .map_or(f64::INFINITY, |back| (back * (place - self.centre)).norm())
    }
}

fn direction(index: usize) -> f64 {
    std::f64::consts::TAU * (index as f64 + 0.5) / DIRECTIONS as f64
}

/// Reads the code round a dot, of one of the given numbers of segments.
pub(super) fn read_ring(view: &View, dot: &MeasuredDot, segments: &[u8]) -> RingOutcome {
    let Some(frame) = RingFrame::of_dot(dot) else {
        return RingOutcome::Plain;
    };
    if segments.is_empty() || !may_be_ring(view, dot, &frame) {
        return RingOutcome::Plain;
    }
    let Some(frame) = refined(view, dot, frame).and_then(|frame| refined(view, dot, frame)) else {
        return RingOutcome::Plain;
    };
    let Some(ring) = unroll(view, dot, &frame) else {
        return RingOutcome::Plain;
    };
    decide(view, dot, &ring, &frame, segments)
}

/// Grey values above the background as a share of the dot's contrast; `None` outside the picture.
fn share(view: &View, dot: &MeasuredDot, place: Vector2<f64>) -> Option<f64> {
    let grey = view.image.sample(place.x, place.y)?;
    Some((grey - dot.dot.background) / dot.dot.contrast)
}

/// A quick look at the middle of the ring: light and dark must both be seen there.
fn may_be_ring(view: &View, dot: &MeasuredDot, frame: &RingFrame) -> bool {
    const STRIDE: usize = 5;
    const LEAST_LIGHT: f64 = 0.02;
    let shares: Vec<f64> = (0..DIRECTIONS)
        .step_by(STRIDE)
        .filter_map(|index| share(view, dot, frame.place(direction(index), MIDDLE)))
        .collect();
    let light = shares.iter().filter(|&&share| share > 0.35).count() as f64;
    let all = (DIRECTIONS / STRIDE) as f64;
    light > LEAST_LIGHT * all && light < 0.98 * all
}

/// The frame corrected by the ring's edges in the directions in which it is light.
fn refined(view: &View, dot: &MeasuredDot, frame: RingFrame) -> Option<RingFrame> {
    const UNKNOWNS: usize = 5;
    /// Weight of the frame of the dot against one direction of the ring: it decides where few directions are light.
    const TRUST: f64 = 12.0;
    let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::identity() * TRUST;
    // One radius at small, one at large lever: the scale is what a small dot shows worst.
    normal[(0, 0)] = 0.2 * TRUST;
    let mut right = SVector::<f64, UNKNOWNS>::zeros();
    let mut light = 0;
    for index in 0..DIRECTIONS {
        let direction = direction(index);
        let Some(middle) = middle_of_ring(view, dot, &frame, direction) else {
            continue;
        };
        light += 1;
        let (sin, cos) = direction.sin_cos();
        let (sin2, cos2) = (2.0 * direction).sin_cos();
        let row = SVector::<f64, UNKNOWNS>::from([1.0, cos2, sin2, cos, sin]);
        normal += row * row.transpose();
        right += row * (middle / MIDDLE - 1.0);
    }
    if light < DIRECTIONS / 50 {
        return None;
    }
    let by = normal.cholesky()?.solve(&right);
    let stretch = Matrix2::new(1.0 + by[0] + by[1], by[2], by[2], 1.0 + by[0] - by[1]);
    let map = frame.map * stretch;
    let shift = frame.shift + Vector2::new(by[3], by[4]) * MIDDLE;
    let plausible = by[0].abs() < 0.25 && by[1].hypot(by[2]) < 0.25 && shift.norm() < 0.5;
    plausible.then_some(RingFrame {
        map,
        shift,
        ..frame
    })
}

/// Radius half-way between the inner and the outer edge of the ring in a direction; `None` where it is not light or
/// its edges are not seen.
fn middle_of_ring(
    view: &View,
    dot: &MeasuredDot,
    frame: &RingFrame,
    direction: f64,
) -> Option<f64> {
    const STEP: f64 = 0.1;
    const FIRST: f64 = 1.4;
    const COUNT: usize = 25;
    let mut shares = [0.0; COUNT];
    for (index, slot) in shares.iter_mut().enumerate() {
        *slot = share(
            view,
            dot,
            frame.place(direction, FIRST + STEP * index as f64),
        )?;
    }
    let (top, &most) = shares
        .iter()
        .enumerate()
        .skip(7)
        .take(9)
        .max_by(|a, b| a.1.total_cmp(b.1))?;
    if most < 0.35 {
        return None;
    }
    let half = 0.5 * most;
    let radius = |below: usize, above: usize| {
        let part = (half - shares[below]) / (shares[above] - shares[below]);
        FIRST + STEP * (below as f64 + part * (above as f64 - below as f64))
    };
    let inner = (1..=top)
        .rev()
        .find(|&i| shares[i] >= half && shares[i - 1] < half)?;
    let outer = (top..COUNT - 1).find(|&i| shares[i] >= half && shares[i + 1] < half)?;
    let (inner, outer) = (radius(inner - 1, inner), radius(outer + 1, outer));
    let width = outer - inner;
    (0.5..1.6).contains(&width).then_some(0.5 * (inner + outer))
}

/// The ring by direction.
struct Unrolled {
    /// Mean over the middle half of the ring, as a share of the local light level.
    shares: Vec<f64>,
    /// Darkest place between dot and ring, as a share of the dot's contrast.
    gap: Vec<f64>,
    /// Share of the light directions in which the outer edge of the ring is seen.
    edged: f64,
    /// The light level by direction: mean, cosine, sine.
    light: SVector<f64, 3>,
}

fn unroll(view: &View, dot: &MeasuredDot, frame: &RingFrame) -> Option<Unrolled> {
    const ACROSS: [f64; 5] = [2.3, 2.4, 2.5, 2.6, 2.7];
    let mut shares = Vec::with_capacity(DIRECTIONS);
    let mut gap = Vec::with_capacity(DIRECTIONS);
    let (mut lit, mut edged) = (0.0, 0.0);
    for index in 0..DIRECTIONS {
        let direction = direction(index);
        let at = |radius: f64| share(view, dot, frame.place(direction, radius));
        let mut sum = 0.0;
        for radius in ACROSS {
            sum += at(radius)?;
        }
        let mean = sum / ACROSS.len() as f64;
        shares.push(mean);
        gap.push(at(1.4)?.min(at(1.5)?).min(at(1.6)?).min(at(1.7)?));
        if mean > 0.5 {
            lit += 1.0;
            let beyond = at(3.3).unwrap_or(0.0).min(at(3.5).unwrap_or(0.0));
            edged += f64::from(u8::from(beyond < 0.6 * mean));
        }
    }
    let light = even_out(&mut shares)?;
    Some(Unrolled {
        shares,
        gap,
        edged: edged / f64::max(lit, 1.0),
        light,
    })
}

/// Divides by the light level, a plane fitted to what is light: shadows and flash fall off across a code. Returns it.
fn even_out(shares: &mut [f64]) -> Option<SVector<f64, 3>> {
    let mut plane = SVector::<f64, 3>::new(brightest_share(shares)?, 0.0, 0.0);
    let row = |index: usize| {
        let (sin, cos) = direction(index).sin_cos();
        SVector::<f64, 3>::new(1.0, cos, sin)
    };
    for _ in 0..3 {
        let mut normal = SMatrix::<f64, 3, 3>::identity();
        // The slope is held near zero unless the light parts show it.
        normal[(0, 0)] = 1e-6;
        normal[(1, 1)] = 15.0;
        normal[(2, 2)] = 15.0;
        let mut right = SVector::<f64, 3>::zeros();
        for (index, &share) in shares.iter().enumerate() {
            let row = row(index);
            // The rims of light parts are blurred: only what is nearly as light as expected counts.
            if share > 0.65 * row.dot(&plane) {
                normal += row * row.transpose();
                right += row * share;
            }
        }
        plane = normal.cholesky()?.solve(&right);
    }
    for (index, share) in shares.iter_mut().enumerate() {
        *share /= row(index).dot(&plane).max(0.25 * plane[0]);
    }
    Some(plane)
}

impl Unrolled {
    /// Lightness of the ring against the dot.
    fn level(&self) -> f64 {
        self.light[0]
    }

    /// How far from even the light falls: the largest slope of the light level across the ring.
    fn slope(&self) -> f64 {
        self.light[1].hypot(self.light[2]) / self.light[0]
    }
}

fn brightest_share(shares: &[f64]) -> Option<f64> {
    let mut sorted = shares.to_vec();
    sorted.sort_by(f64::total_cmp);
    let top = *sorted.get(shares.len() - shares.len() / 14)?;
    (top > 0.3).then_some(top)
}

/// A pattern found on the grid of one number of segments.
struct Pattern {
    segments: u8,
    bits: u32,
    /// Where the first segment begins, in segments.
    grid: f64,
    /// Root mean square and largest distance of the changes from the grid, in segments.
    edge_rms: f64,
    edge_largest: f64,
    /// Root mean square deviation of the segments from light and dark.
    misfit: f64,
    /// Least distance of a segment from the limit between light and dark.
    margin: f64,
}

fn decide(
    view: &View,
    dot: &MeasuredDot,
    ring: &Unrolled,
    frame: &RingFrame,
    segments: &[u8],
) -> RingOutcome {
    /// Changes between light and dark lie this near to the grid, in segments.
    const LARGEST_EDGE_RMS: f64 = 0.16;
    const LARGEST_EDGE: f64 = 0.34;
    let changes = changes(&ring.shares);
    let mut patterns: Vec<Pattern> = segments
        .iter()
        .filter_map(|&n| pattern(&ring.shares, &changes, n))
        .collect();
    patterns.retain(|p| p.edge_rms < LARGEST_EDGE_RMS && p.edge_largest < LARGEST_EDGE);
    patterns.sort_by(|a, b| {
        a.edge_rms
            .total_cmp(&b.edge_rms)
            .then(a.segments.cmp(&b.segments))
    });
    let Some(best) = patterns.first() else {
        return RingOutcome::Plain;
    };
    if let Some(reason) = not_a_ring(dot, ring) {
        return RingOutcome::Unreadable(reason);
    }
    let Some(id) = ring_number(best.bits, best.segments) else {
        return RingOutcome::Unreadable(format!(
            "ring pattern {:0width$b} is no ring{} code: partly covered?",
            best.bits,
            best.segments,
            width = best.segments as usize
        ));
    };
    let rival = patterns[1..].iter().find(|p| {
        p.edge_rms < 1.7 * best.edge_rms + 0.02 && ring_number(p.bits, p.segments).is_some()
    });
    let Some(found) = ring_evidence(view, dot, frame, best, &ring.light) else {
        return RingOutcome::Unreadable(
            "its ring is cut off or too faint to be compared with its number".into(),
        );
    };
    let evidence = CodeEvidence {
        fit: found.departure,
        margin: Some(2.0 * best.margin),
        departing_segments: found.departing_segments,
        ..CodeEvidence::default()
    };
    RingOutcome::Read(RingReading {
        segments: best.segments,
        id,
        misfit: best.misfit,
        doubt: doubt(ring, best, rival, &evidence),
        evidence,
        frame: *frame,
    })
}

fn not_a_ring(dot: &MeasuredDot, ring: &Unrolled) -> Option<String> {
    let (darkest, lightest) = (0.5, 1.8);
    // Half-way between the blurred edges of dot and ring, half a small radius from each, it is not quite dark.
    let blurs = 0.25 * dot.dot.minor_px / dot.blur.max(0.1);
    let unavoidable = 2.0 * (-0.7 * blurs * blurs).exp() * 0.5;
    let light_gaps = ring
        .gap
        .iter()
        .filter(|&&gap| gap > 0.3 + unavoidable)
        .count();
    if light_gaps * 20 > DIRECTIONS {
        return Some("no dark gap between dot and ring".into());
    }
    if !(darkest..lightest).contains(&ring.level()) {
        return Some(format!(
            "ring is {:.0} % as light as its dot",
            100.0 * ring.level()
        ));
    }
    if ring.edged < 0.6 {
        return Some("the ring has no outer edge".into());
    }
    None
}

fn doubt(
    ring: &Unrolled,
    best: &Pattern,
    rival: Option<&Pattern>,
    evidence: &CodeEvidence,
) -> Option<String> {
    /// A segment must be this clearly light or dark.
    const LEAST_MARGIN: f64 = 0.18;
    /// Largest misfit of a reading that nothing speaks against.
    const LARGEST_MISFIT: f64 = 0.13;
    const LARGEST_SLOPE: f64 = 0.7;
    if let Some(rival) = rival {
        return Some(format!("reads as ring{} as well", rival.segments));
    }
    if best.margin < LEAST_MARGIN {
        return Some("a segment is neither light nor dark: partly covered?".into());
    }
    if best.misfit > LARGEST_MISFIT {
        return Some("its segments are not equally light".into());
    }
    if evidence.departing_segments > 0 {
        return Some(format!(
            "{} of its {} segments depart from its number in grey level or edge: partly covered?",
            evidence.departing_segments, best.segments
        ));
    }
    if ring.slope() > LARGEST_SLOPE {
        return Some("the light falls off across the ring".into());
    }
    None
}

/// A change between light and dark.
struct Change {
    /// Place, as a share of the full turn.
    turn: f64,
}

fn changes(shares: &[f64]) -> Vec<Change> {
    let count = shares.len();
    (0..count)
        .filter_map(|index| {
            let (here, next) = (shares[index], shares[(index + 1) % count]);
            ((here > 0.5) != (next > 0.5)).then(|| {
                let part = (0.5 - here) / (next - here);
                Change {
                    turn: (index as f64 + 0.5 + part) / count as f64,
                }
            })
        })
        .collect()
}

fn pattern(shares: &[f64], changes: &[Change], segments: u8) -> Option<Pattern> {
    let n = f64::from(segments);
    if changes.is_empty() || changes.len() > segments as usize {
        return None;
    }
    let phases = changes
        .iter()
        .map(|change| std::f64::consts::TAU * n * change.turn);
    let sum = phases.fold(Vector2::zeros(), |sum: Vector2<f64>, phase| {
        sum + Vector2::new(phase.cos(), phase.sin())
    });
    let grid = sum.y.atan2(sum.x) / std::f64::consts::TAU;
    let off = |change: &Change| {
        let segment = change.turn * n - grid;
        (segment - segment.round()).abs()
    };
    let squares: f64 = changes.iter().map(|change| off(change).powi(2)).sum();
    let edge_largest = changes.iter().map(off).fold(0.0, f64::max);
    let (mut bits, mut deviation, mut margin) = (0_u32, 0.0, f64::INFINITY);
    for segment in 0..segments {
        let share = segment_share(shares, (grid + f64::from(segment)) / n, n);
        let light = share > 0.5;
        bits = (bits << 1) | u32::from(light);
        deviation += (share - f64::from(u8::from(light))).powi(2);
        margin = f64::min(margin, (share - 0.5).abs());
    }
    Some(Pattern {
        segments,
        bits,
        grid,
        edge_rms: (squares / changes.len() as f64).sqrt(),
        edge_largest,
        misfit: (deviation / n).sqrt(),
        margin,
    })
}

/// Mean over the middle half of a segment that begins at `start` (share of the turn).
fn segment_share(shares: &[f64], start: f64, segments: f64) -> f64 {
    const SAMPLES: usize = 9;
    let count = shares.len();
    let sum: f64 = (0..SAMPLES)
        .map(|k| {
            let part = 0.25 + 0.5 * k as f64 / (SAMPLES - 1) as f64;
            let turn = (start + part / segments).rem_euclid(1.0);
            shares[((turn * count as f64) as usize).min(count - 1)]
        })
        .sum();
    sum / SAMPLES as f64
}
