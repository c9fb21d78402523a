//! Connected components of a picture at rising grey levels.

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
        let mut height = settings.first.max(1.0);
        let mut runs = runs_of_region(image, region, region.ground + height);
        while !runs.is_empty() {
            let level = region.ground + height;
            join_rows(&mut runs);
            tree.add_level(&mut runs, level, settings.least_area);
            height *= settings.ratio.max(1.01);
            if region.ground + height >= brightest {
                break;
            }
            monitor.check()?;
            runs = runs_inside(image, &runs, region.ground + height);
        }
        Ok(tree)
    }

    /// Sums every component of the level and replaces the runs' links by their nodes.
    fn add_level(&mut self, runs: &mut [Run], level: f64, least_area: u32) {
        let mut sums: Vec<Sums> = Vec::new();
        let mut sum_of_root = vec![DROPPED; runs.len()];
        for slot in 0..runs.len() {
            let root = root(runs, slot as u32);
            let known = &mut sum_of_root[root as usize];
            if *known == DROPPED {
                *known = sums.len() as u32;
                sums.push(Sums::new(&runs[slot]));
            }
            sums[*known as usize].add(&runs[slot]);
        }
        let nodes: Vec<u32> = sums
            .iter()
            .map(|sum| {
                if sum.area < least_area {
                    return DROPPED;
                }
                self.nodes.push(sum.node(level));
                self.nodes.len() as u32 - 1
            })
            .collect();
        // Roots first keep their links: every run is asked for its root before any link is overwritten.
        let owners: Vec<u32> = (0..runs.len())
            .map(|slot| nodes[sum_of_root[root(runs, slot as u32) as usize] as usize])
            .collect();
        for (run, owner) in runs.iter_mut().zip(owners) {
            run.link = owner;
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

fn runs_of_region(image: &GreyImage, region: &Region, level: f64) -> Vec<Run> {
    /// Pixels that are looked at together, so that dark stretches cost next to nothing.
    const STRETCH: usize = 64;
    let mut runs = Vec::new();
    let Some(least) = least_above(level) else {
        return runs;
    };
    for [row, first, end] in region.pieces() {
        let mut scan = Scan::new(row as u32, DROPPED, least);
        let mut column = first;
        for stretch in image.row(row)[first..end].chunks(STRETCH) {
            let bright = stretch
                .iter()
                .fold(0_u16, |any, &grey| any | u16::from(grey >= least));
            if bright != 0 || scan.open.is_some() {
                scan.pixels(stretch, column as u32, &mut runs);
            }
            column += stretch.len();
        }
        scan.close(end as u32, &mut runs);
    }
    runs
}

fn runs_inside(image: &GreyImage, below: &[Run], level: f64) -> Vec<Run> {
    let mut runs = Vec::new();
    let Some(least) = least_above(level) else {
        return runs;
    };
    for run in below.iter().filter(|run| run.link != DROPPED) {
        let samples = &image.row(run.row as usize)[run.start as usize..run.end as usize];
        let mut scan = Scan::new(run.row, run.link, least);
        scan.pixels(samples, run.start, &mut runs);
        scan.close(run.end, &mut runs);
    }
    runs
}

/// Finds the runs along a row.
struct Scan {
    row: u32,
    parent: u32,
    least: u16,
    open: Option<u32>,
}

impl Scan {
    fn new(row: u32, parent: u32, least: u16) -> Self {
        Self {
            row,
            parent,
            least,
            open: None,
        }
    }

    fn pixels(&mut self, samples: &[u16], first_column: u32, runs: &mut Vec<Run>) {
        for (column, &grey) in (first_column..).zip(samples) {
            match (grey >= self.least, self.open) {
                (true, None) => self.open = Some(column),
                (false, Some(_)) => self.close(column, runs),
                _ => {}
            }
        }
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
