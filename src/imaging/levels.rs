//! Connected components of a picture at rising grey levels.

use std::ops::RangeInclusive;

use wide::u16x8;

use super::{GreyImage, Region};
use crate::monitor::{Interrupted, Monitor};

/// How a region of a picture is cut into levels, which rise from its ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelSettings {
    /// Height of the first level above the ground, grey values.
    pub first: f64,
    /// Ratio of the heights of neighbouring levels. Targets must be this much brighter than what surrounds them, twice over.
    pub ratio: f64,
    /// Components with fewer pixels are dropped, with all that is above them.
    pub least_area: u32,
    /// Components with more pixels are dropped too, with all that is above them.
    pub largest_area: u32,
}

/// A connected component of the pixels brighter than a level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelNode {
    /// Grey value of the level: all pixels of the component are brighter.
    pub level: f64,
    /// The component of the level below that holds this one.
    pub parent: Option<u32>,
    /// Number of pixels.
    pub area: u32,
    /// Mean column of the pixels' centres, px.
    pub x_px: f64,
    /// Mean row of the pixels' centres, px.
    pub y_px: f64,
    /// Second central moments xx, xy, yy of the pixels' squares, px^2.
    pub moments: [f64; 3],
    /// First and last column.
    pub columns: [u32; 2],
    /// First and last row.
    pub rows: [u32; 2],
}

/// All components of all levels, lower levels first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LevelTree {
    /// The components; a parent stands before its children.
    pub nodes: Vec<LevelNode>,
}

/// Pixels `start..end` of a row, all brighter than the level.
#[derive(Clone, Copy)]
struct Run {
    row: u32,
    start: u32,
    end: u32,
    /// While a level is built: the union-find link; afterwards the node, or `DROPPED`.
    link: u32,
    /// Node of the level below.
    parent: u32,
}

const DROPPED: u32 = u32::MAX;

impl LevelTree {
    /// Cuts a region of the picture, obeying the interrupt from level to level.
    ///
    /// Cost: the region's pixels once, and what is left above each level once more.
    ///
    /// # Errors
    /// [`Interrupted`].
    pub fn new(
        image: &GreyImage,
        region: &Region,
        settings: &LevelSettings,
        monitor: &Monitor,
    ) -> Result<Self, Interrupted> {
        let mut tree = Self::default();
        let brightest = f64::from(region.brightest);
        let areas = settings.least_area..=settings.largest_area;
        let mut height = settings.first.max(1.0);
        let (mut runs, mut above) = (Vec::new(), Vec::new());
        let mut components = Components::default();
        take_runs_of_region(image, region, region.ground + height, &mut runs);
        while !runs.is_empty() {
            let level = region.ground + height;
            join_rows(&mut runs);
            components.sum(&mut runs);
            tree.add_level(&mut runs, level, &areas, &components);
            height *= settings.ratio.max(1.01);
            if region.ground + height >= brightest {
                break;
            }
            monitor.check()?;
            take_runs_inside(image, &runs, region.ground + height, &mut above);
            std::mem::swap(&mut runs, &mut above);
        }
        Ok(tree)
    }

    /// Makes the level's components nodes, and replaces the runs' links by them.
    fn add_level(
        &mut self,
        runs: &mut [Run],
        level: f64,
        areas: &RangeInclusive<u32>,
        components: &Components,
    ) {
        let first = self.nodes.len();
        let kept = |sums: &&Sums| areas.contains(&sums.area);
        let nodes = components.sums.iter().filter(kept);
        self.nodes.extend(nodes.map(|sums| sums.node(level)));
        let mut next = first as u32;
        let mut node_of = Vec::with_capacity(components.sums.len());
        for sums in &components.sums {
            let is_kept = kept(&sums);
            node_of.push(if is_kept { next } else { DROPPED });
            next += u32::from(is_kept);
        }
        for (run, &component) in runs.iter_mut().zip(&components.of_run) {
            run.link = node_of[component as usize];
        }
    }
}

/// The components of a level, in the order of their first runs.
#[derive(Default)]
struct Components {
    sums: Vec<Sums>,
    of_run: Vec<u32>,
}

impl Components {
    /// Sums the runs that are linked.
    fn sum(&mut self, runs: &mut [Run]) {
        self.sums.clear();
        self.of_run.clear();
        for slot in 0..runs.len() {
            // The root is the component's first run.
            let root = root(runs, slot as u32) as usize;
            let component = if root == slot {
                self.sums.push(Sums::new(&runs[slot]));
                self.sums.len() - 1
            } else {
                self.of_run[root] as usize
            };
            self.of_run.push(component as u32);
            self.sums[component].add(&runs[slot]);
        }
    }
}

/// Moments of a component about its first pixel.
struct Sums {
    parent: u32,
    origin: [u32; 2],
    area: u32,
    x: i64,
    y: i64,
    xx: i64,
    xy: i64,
    yy: i64,
    columns: [u32; 2],
    rows: [u32; 2],
}

impl Sums {
    fn new(run: &Run) -> Self {
        Self {
            parent: run.parent,
            origin: [run.start, run.row],
            area: 0,
            x: 0,
            y: 0,
            xx: 0,
            xy: 0,
            yy: 0,
            columns: [run.start, run.end - 1],
            rows: [run.row, run.row],
        }
    }

    fn add(&mut self, run: &Run) {
        let count = i64::from(run.end - run.start);
        let first = i64::from(run.start) - i64::from(self.origin[0]);
        let row = i64::from(run.row) - i64::from(self.origin[1]);
        // Sums over first..first + count of 1, x, x^2 in closed form.
        let steps = count * (count - 1) / 2;
        let squares = (count - 1) * count * (2 * count - 1) / 6;
        let x = count * first + steps;
        self.area += run.end - run.start;
        self.x += x;
        self.y += count * row;
        self.xx += count * first * first + 2 * first * steps + squares;
        self.xy += x * row;
        self.yy += count * row * row;
        self.columns = [
            self.columns[0].min(run.start),
            self.columns[1].max(run.end - 1),
        ];
        self.rows = [self.rows[0].min(run.row), self.rows[1].max(run.row)];
    }

    fn node(&self, level: f64) -> LevelNode {
        let area = f64::from(self.area);
        let (x, y) = (self.x as f64 / area, self.y as f64 / area);
        let square = 1.0 / 12.0;
        LevelNode {
            level,
            parent: (self.parent != DROPPED).then_some(self.parent),
            area: self.area,
            x_px: f64::from(self.origin[0]) + 0.5 + x,
            y_px: f64::from(self.origin[1]) + 0.5 + y,
            moments: [
                self.xx as f64 / area - x * x + square,
                self.xy as f64 / area - x * y,
                self.yy as f64 / area - y * y + square,
            ],
            columns: self.columns,
            rows: self.rows,
        }
    }
}

/// The least whole grey value that is brighter than a level; `None` where no sample can be.
fn least_above(level: f64) -> Option<u16> {
    let least = level.floor() + 1.0;
    (least <= f64::from(u16::MAX)).then_some(least.max(0.0) as u16)
}

fn take_runs_of_region(image: &GreyImage, region: &Region, level: f64, runs: &mut Vec<Run>) {
    runs.clear();
    let Some(least) = least_above(level) else {
        return;
    };
    // First all pixels, without a decision that would have to wait for them one by one: they come from far.
    let mut bits = Vec::new();
    region.pieces().for_each(|[row, first, end]| {
        bits.extend(bright(&image.row(row)[first..end], least));
    });
    let mut rest = &bits[..];
    region.pieces().for_each(|[row, first, end]| {
        let (bits, further) = rest.split_at((end - first).div_ceil(EIGHT));
        rest = further;
        let mut scan = Scan::new(row as u32, DROPPED, first as u32);
        for &bits in bits {
            scan.pixels(bits, runs);
        }
        scan.close(end as u32, runs);
    });
}

fn take_runs_inside(image: &GreyImage, below: &[Run], level: f64, runs: &mut Vec<Run>) {
    runs.clear();
    let Some(least) = least_above(level) else {
        return;
    };
    for run in below.iter().filter(|run| run.link != DROPPED) {
        let samples = &image.row(run.row as usize)[run.start as usize..run.end as usize];
        let mut scan = Scan::new(run.row, run.link, run.start);
        for bits in bright(samples, least) {
            scan.pixels(bits, runs);
        }
        scan.close(run.end, runs);
    }
}

/// Pixels that go together through the scan.
const EIGHT: usize = 8;

/// Which of eight pixels each are at least this bright, the first in the lowest bit.
fn bright(samples: &[u16], least: u16) -> impl Iterator<Item = u8> {
    let (eights, rest) = samples.as_chunks::<EIGHT>();
    let least = u16x8::splat(least);
    let bits = move |eight: [u16; EIGHT]| u16x8::new(eight).simd_ge(least).to_bitmask() as u8;
    let last = (!rest.is_empty()).then(|| {
        let mut eight = [0; EIGHT];
        eight[..rest.len()].copy_from_slice(rest);
        bits(eight) & ((1 << rest.len()) - 1)
    });
    eights.iter().map(move |&eight| bits(eight)).chain(last)
}

/// Finds the runs along a row.
struct Scan {
    row: u32,
    parent: u32,
    column: u32,
    open: Option<u32>,
}

impl Scan {
    fn new(row: u32, parent: u32, column: u32) -> Self {
        Self {
            row,
            parent,
            column,
            open: None,
        }
    }

    /// Goes on by eight pixels, of which these are bright.
    fn pixels(&mut self, bright: u8, runs: &mut Vec<Run>) {
        // A bit where a pixel differs from the one before.
        let mut turns = bright ^ (bright << 1 | u8::from(self.open.is_some()));
        while turns != 0 {
            let column = self.column + turns.trailing_zeros();
            match self.open {
                None => self.open = Some(column),
                Some(_) => self.close(column, runs),
            }
            turns &= turns - 1;
        }
        self.column += EIGHT as u32;
    }

    fn close(&mut self, end: u32, runs: &mut Vec<Run>) {
        if let Some(start) = self.open.take() {
            runs.push(Run {
                row: self.row,
                start,
                end,
                link: runs.len() as u32,
                parent: self.parent,
            });
        }
    }
}

/// Unites the runs of neighbouring rows that share a column; the runs are sorted by row and column.
fn join_rows(runs: &mut [Run]) {
    let mut upper = 0;
    for lower in 0..runs.len() {
        let Run {
            row, start, end, ..
        } = runs[lower];
        while runs[upper].row + 1 < row || (runs[upper].row + 1 == row && runs[upper].end <= start)
        {
            upper += 1;
        }
        let mut other = upper;
        while runs[other].row + 1 == row && runs[other].start < end {
            unite(runs, other as u32, lower as u32);
            other += 1;
        }
    }
}

fn root(runs: &mut [Run], mut slot: u32) -> u32 {
    while runs[slot as usize].link != slot {
        let link = runs[slot as usize].link;
        runs[slot as usize].link = runs[link as usize].link;
        slot = link;
    }
    slot
}

fn unite(runs: &mut [Run], a: u32, b: u32) {
    let (a, b) = (root(runs, a), root(runs, b));
    // The earlier run is the root, so the order of the components is that of their first pixels.
    let (first, second) = (a.min(b), a.max(b));
    runs[second as usize].link = first;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::BitDepth;
    use proptest::prelude::*;

    fn picture(rows: &[&str]) -> GreyImage {
        let samples = rows
            .iter()
            .flat_map(|row| row.bytes().map(|b| u16::from(b - b'0') * 10))
            .collect();
        GreyImage::new(
            rows[0].len() as u32,
            rows.len() as u32,
            BitDepth::Eight,
            samples,
        )
        .unwrap()
    }

    fn cut(image: &GreyImage, first: f64, ratio: f64) -> Vec<LevelNode> {
        let settings = LevelSettings {
            first,
            ratio,
            least_area: 1,
            largest_area: u32::MAX,
        };
        let whole = Region::whole(image, 0.0);
        let tree = LevelTree::new(image, &whole, &settings, &Monitor::new());
        tree.expect("nobody interrupts").nodes
    }

    #[test]
    fn a_u_is_one_component_and_its_tips_are_two_above() {
        let nodes = cut(
            &picture(&["0000000", "0900090", "0300030", "0333330", "0000000"]),
            20.0,
            2.5,
        );
        let areas: Vec<_> = nodes.iter().map(|n| (n.area, n.parent)).collect();
        assert_eq!(areas, [(9, None), (1, Some(0)), (1, Some(0))]);
        assert_eq!((nodes[1].x_px, nodes[1].y_px), (1.5, 1.5));
        assert_eq!((nodes[0].columns, nodes[0].rows), ([1, 5], [1, 3]));
    }

    #[test]
    fn diagonal_neighbours_are_apart() {
        let nodes = cut(&picture(&["0050", "0500"]), 20.0, 10.0);
        assert_eq!(nodes.len(), 2);
    }

    #[test]
    fn moments_are_those_of_the_pixels_squares() {
        let nodes = cut(&picture(&["00000", "09999", "09999"]), 20.0, 10.0);
        let expected = [16.0 / 12.0, 0.0, 4.0 / 12.0];
        for (found, expected) in nodes[0].moments.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12);
        }
    }

    proptest! {
        #[test]
        fn components_are_those_of_a_flood_fill(samples in proptest::collection::vec(0_u16..4, 12 * 9)) {
            let image = GreyImage::new(12, 9, BitDepth::Eight, samples).unwrap();
            let nodes = cut(&image, 1.0, 2.0);
            for level in [1_u16, 2] {
                let mut found: Vec<u32> =
                    nodes.iter().filter(|n| n.level == f64::from(level)).map(|n| n.area).collect();
                let mut expected = flooded_areas(&image, level);
                found.sort_unstable();
                expected.sort_unstable();
                prop_assert_eq!(found, expected);
            }
        }
    }

    fn flooded_areas(image: &GreyImage, level: u16) -> Vec<u32> {
        let mut seen = vec![false; image.samples().len()];
        let mut areas = Vec::new();
        for seed in 0..seen.len() {
            let mut stack = vec![seed];
            let mut area = 0;
            while let Some(slot) = stack.pop() {
                if seen[slot] || image.samples()[slot] <= level {
                    continue;
                }
                seen[slot] = true;
                area += 1;
                let (x, y) = (slot % image.width(), slot / image.width());
                if x > 0 {
                    stack.push(slot - 1);
                }
                if x + 1 < image.width() {
                    stack.push(slot + 1);
                }
                if y > 0 {
                    stack.push(slot - image.width());
                }
                if y + 1 < image.height() {
                    stack.push(slot + image.width());
                }
            }
            if area > 0 {
                areas.push(area);
            }
        }
        areas
    }
}
