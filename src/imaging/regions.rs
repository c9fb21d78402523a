//! The parts of a picture that rise above their surroundings: all that detection has to look at.
//!
//! The picture is read once, in [`Tiles`]. A tile that does not rise above its ground holds nothing; in a dark picture those
//! are nearly all. Tiles that do, and touch, are one [`Region`]. On a slope or a texture too much rises: that costs
//! time, and hides nothing.
//!
//! Cost: one reading of the pixels, and a running minimum over the tiles; independent of the number of targets.

use std::ops::Range;

use super::GreyImage;
use super::tiles::{TILE, Tile, Tiles};

/// Tiles `first..end` of a row of tiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Span {
    row: usize,
    first: usize,
    end: usize,
}

/// A part of the picture that rises above its surroundings: tiles that touch.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// The least ground of its tiles, grey values.
    pub ground: f64,
    /// The brightest grey value in it.
    pub brightest: u16,
    /// Sorted by rows, then columns; spans of a row do not touch.
    spans: Vec<Span>,
    size: [usize; 2],
}

impl Tiles {
    /// What rises by more than `rise` grey values above the darkest surroundings.
    #[must_use]
    pub fn regions(&self, rise: f64) -> Vec<Region> {
        let rises = |tile: &Tile, ground: u32| {
            let [brightest, mean, ground] =
                [4 * u32::from(tile.brightest), tile.mean_of_four, ground].map(f64::from);
            stands_out([brightest, mean, ground], 4.0 * rise)
        };
        self.joined(&self.risen(rises), |slot| self.ground[slot])
    }

    /// What is too faint for [`Tiles::regions`]: 2 x 2 pixels together rise by more than `rise` grey values above the darkest
    /// tile beside theirs, but no pixel by more than `most`. The tiles round it, and those that it encloses, belong to it, so that
    /// what it holds is not cut.
    #[must_use]
    pub fn faint_regions(&self, rise: f64, most: f64) -> Vec<Region> {
        let (rise, most) = (4.0 * rise, 4.0 * most);
        let beside = self.least_mean_within(1);
        let dim: Vec<bool> = self
            .tiles
            .iter()
            .zip(&self.ground)
            .map(|(tile, &ground)| {
                f64::from(4 * u32::from(tile.brightest)) <= f64::from(ground) + most
            })
            .collect();
        let stands = |slot: usize| {
            let tile = &self.tiles[slot];
            let four = [tile.brightest_four, tile.mean_of_four, beside[slot]].map(f64::from);
            dim[slot] && stands_out(four, rise)
        };
        let mut risen = vec![false; self.tiles.len()];
        for slot in (0..risen.len()).filter(|&slot| stands(slot)) {
            let (row, column) = (slot / self.across, slot % self.across);
            for row in row.saturating_sub(1)..(row + 2).min(risen.len() / self.across) {
                for column in column.saturating_sub(1)..(column + 2).min(self.across) {
                    let slot = row * self.across + column;
                    risen[slot] = dim[slot];
                }
            }
        }
        let covered = |slot: usize| {
            let [mean, ground] = [self.tiles[slot].mean_of_four, self.ground[slot]].map(f64::from);
            dim[slot] && mean > ground + 0.5 * rise
        };
        for row in 0..risen.len() / self.across.max(1) {
            self.enclose(
                &mut risen,
                row * self.across..(row + 1) * self.across,
                covered,
            );
        }
        self.joined(&risen, |slot| self.tiles[slot].mean_of_four)
    }

    /// Takes in the covered tiles of a row between two that rise, as far as a target reaches.
    fn enclose(&self, risen: &mut [bool], row: Range<usize>, covered: impl Fn(usize) -> bool) {
        let mut last = None;
        for slot in row {
            if risen[slot] {
                if let Some(last) = last.filter(|&last| slot - last <= 2 * self.reach) {
                    risen[last..slot].fill(true);
                }
                last = Some(slot);
            } else if !covered(slot) {
                last = None;
            }
        }
    }

    fn risen(&self, rises: impl Fn(&Tile, u32) -> bool) -> Vec<bool> {
        let both = self.tiles.iter().zip(&self.ground);
        both.map(|(tile, &ground)| rises(tile, ground)).collect()
    }

    /// The regions of the risen tiles, each on the least of its tiles' grounds.
    fn joined(&self, risen: &[bool], ground: impl Fn(usize) -> u32) -> Vec<Region> {
        let mut spans: Vec<Span> = Vec::new();
        for (row, risen) in risen.chunks(self.across.max(1)).enumerate() {
            let mut first = 0;
            for tiles in risen.chunk_by(|one, next| one == next) {
                let end = first + tiles.len();
                if tiles[0] {
                    spans.push(Span { row, first, end });
                }
                first = end;
            }
        }
        self.joined_spans(&spans, ground)
    }

    /// Joins spans of neighbouring rows that touch, also by a corner. Regions come in the order of their first spans.
    fn joined_spans(&self, spans: &[Span], ground: impl Fn(usize) -> u32) -> Vec<Region> {
        let mut links: Vec<usize> = (0..spans.len()).collect();
        let mut upper = 0;
        for (lower, span) in spans.iter().enumerate() {
            while spans[upper].row + 1 < span.row
                || (spans[upper].row + 1 == span.row && spans[upper].end < span.first)
            {
                upper += 1;
            }
            let touching = spans[upper..lower]
                .iter()
                .enumerate()
                .take_while(|(_, other)| other.row + 1 == span.row && other.first <= span.end);
            for (place, _) in touching {
                unite(&mut links, upper + place, lower);
            }
        }
        let mut place_of_root = vec![usize::MAX; spans.len()];
        let mut regions: Vec<Region> = Vec::new();
        for (slot, span) in spans.iter().enumerate() {
            let place = &mut place_of_root[root(&mut links, slot)];
            if *place == usize::MAX {
                *place = regions.len();
                regions.push(Region {
                    ground: f64::INFINITY,
                    brightest: 0,
                    spans: Vec::new(),
                    size: self.size,
                });
            }
            let region = &mut regions[*place];
            for slot in span.row * self.across + span.first..span.row * self.across + span.end {
                region.ground = region.ground.min(0.25 * f64::from(ground(slot)));
                region.brightest = region.brightest.max(self.tiles[slot].brightest);
            }
            region.spans.push(*span);
        }
        regions
    }
}

/// Whether something stands out in a tile, or covers much of it; a ground that rises slowly does neither.
fn stands_out([brightest, mean, ground]: [f64; 3], rise: f64) -> bool {
    let stands = brightest > mean + rise || mean > ground + 0.5 * rise;
    brightest > ground + rise && stands
}

fn root(links: &mut [usize], mut slot: usize) -> usize {
    while links[slot] != slot {
        links[slot] = links[links[slot]];
        slot = links[slot];
    }
    slot
}

fn unite(links: &mut [usize], a: usize, b: usize) {
    let (a, b) = (root(links, a), root(links, b));
    links[a.max(b)] = a.min(b);
}

impl Region {
    /// The whole picture.
    #[must_use]
    pub fn whole(image: &GreyImage, ground: f64) -> Self {
        let (width, height) = (image.width(), image.height());
        let rows = if width == 0 { 0 } else { height.div_ceil(TILE) };
        let end = width.div_ceil(TILE);
        Self {
            ground,
            brightest: image.brightest(),
            spans: (0..rows).map(|row| Span { row, first: 0, end }).collect(),
            size: [width, height],
        }
    }

    /// Whether a place of the picture belongs to it, px.
    #[must_use]
    pub fn holds(&self, [x_px, y_px]: [f64; 2]) -> bool {
        let (column, row) = ((x_px / TILE as f64).floor(), (y_px / TILE as f64).floor());
        if column < 0.0 || row < 0.0 {
            return false;
        }
        let (column, row) = (column as usize, row as usize);
        let first = self.spans.partition_point(|span| span.row < row);
        let mut same = self.spans[first..]
            .iter()
            .take_while(|span| span.row == row);
        same.any(|span| (span.first..span.end).contains(&column))
    }

    /// The columns and rows that hold it.
    pub(super) fn bounds(&self) -> [Range<usize>; 2] {
        let ends = |limits: [usize; 2], size: usize| {
            (limits[0] * TILE).min(size)..(limits[1] * TILE).min(size)
        };
        let spans = self.spans.iter();
        let columns = spans.fold([usize::MAX, 0], |[first, end], span| {
            [first.min(span.first), end.max(span.end)]
        });
        let rows = match (self.spans.first(), self.spans.last()) {
            (Some(first), Some(last)) => [first.row, last.row + 1],
            _ => [0; 2],
        };
        [ends(columns, self.size[0]), ends(rows, self.size[1])]
    }

    /// The same in a picture of its bounds alone, whose first tile is this one, with grey values of another scale.
    pub(super) fn moved(&self, [column, row]: [usize; 2], scale: f64) -> Self {
        let [columns, rows] = self.bounds();
        let moved = |span: &Span| Span {
            row: span.row - row,
            first: span.first - column,
            end: span.end - column,
        };
        Self {
            ground: self.ground * scale,
            brightest: (f64::from(self.brightest) * scale).min(f64::from(u16::MAX)) as u16,
            spans: self.spans.iter().map(moved).collect(),
            size: [columns.len(), rows.len()],
        }
    }

    /// Its pieces of rows, sorted by row and column: row, first column, end column.
    pub(super) fn pieces(&self) -> impl Iterator<Item = [usize; 3]> + '_ {
        let [width, height] = self.size;
        self.spans
            .chunk_by(|one, next| one.row == next.row)
            .flat_map(move |spans| {
                let rows = spans[0].row * TILE..((spans[0].row + 1) * TILE).min(height);
                rows.flat_map(move |row| {
                    spans
                        .iter()
                        .map(move |span| [row, span.first * TILE, (span.end * TILE).min(width)])
                })
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::BitDepth;
    use proptest::prelude::*;

    fn picture(width: usize, height: usize, grey: impl Fn(usize, usize) -> u16) -> GreyImage {
        let samples = (0..width * height)
            .map(|slot| grey(slot % width, slot / width))
            .collect();
        GreyImage::new(width as u32, height as u32, BitDepth::Eight, samples).unwrap()
    }

    fn pixels(region: &Region) -> usize {
        region.pieces().map(|[_, first, end]| end - first).sum()
    }

    #[test]
    fn what_touches_by_a_corner_is_one_region_and_the_rest_is_left_out() {
        let bright = [(3, 3), (20, 20), (90, 10), (99, 69)];
        let image = picture(
            100,
            70,
            |x, y| if bright.contains(&(x, y)) { 90 } else { 10 },
        );
        let regions = Tiles::of(&image, 30.0).regions(20.0);
        let sizes: Vec<usize> = regions.iter().map(pixels).collect();
        assert_eq!(
            sizes,
            [2 * 256, 256, 4 * 6],
            "the last is a corner of the picture"
        );
        assert!(
            regions
                .iter()
                .all(|region| (region.ground, region.brightest) == (10.0, 90))
        );
    }

    #[test]
    fn a_target_larger_than_a_tile_is_not_its_own_ground() {
        let inside = |x: usize, y: usize| x.abs_diff(150).pow(2) + y.abs_diff(150).pow(2) < 75 * 75;
        let image = picture(300, 300, |x, y| if inside(x, y) { 120 } else { 10 });
        let regions = Tiles::of(&image, 75.0).regions(20.0);
        assert_eq!(regions.len(), 1);
        let held = |x: usize, y: usize| {
            regions[0]
                .pieces()
                .any(|[row, first, end]| row == y && (first..end).contains(&x))
        };
        assert!(
            (0..300 * 300)
                .all(|slot| !inside(slot % 300, slot / 300) || held(slot % 300, slot / 300))
        );
    }

    #[test]
    fn an_empty_picture_has_no_regions() {
        let image = GreyImage::new(0, 0, BitDepth::Eight, Vec::new()).unwrap();
        let tiles = Tiles::of(&image, 75.0);
        assert!(tiles.regions(5.0).is_empty() && tiles.faint_regions(2.0, 5.0).is_empty());
        assert_eq!(pixels(&Region::whole(&image, 0.0)), 0);
    }

    #[test]
    fn a_faint_spot_and_what_is_round_it_is_one_region_and_bright_ones_are_left_out() {
        let faint = |x: usize, y: usize| (40..42).contains(&x) && (30..32).contains(&y);
        let image = picture(160, 90, |x, y| match (x, y) {
            _ if faint(x, y) => 16,
            (130, 50) => 90,
            _ => 10,
        });
        let tiles = Tiles::of(&image, 30.0);
        let regions = tiles.faint_regions(4.0, 30.0);
        assert_eq!(regions.len(), 1);
        assert_eq!((regions[0].ground, regions[0].brightest), (10.0, 16));
        assert_eq!(pixels(&regions[0]), 9 * 256);
        assert!(regions[0].holds([16.0, 0.0]) && !regions[0].holds([15.9, 5.0]));
        assert!(regions[0].holds([63.9, 47.9]) && !regions[0].holds([64.0, 40.0]));
        assert!(!regions[0].holds([-1.0, 20.0]));
        assert!(tiles.faint_regions(7.0, 30.0).is_empty());
    }

    #[test]
    fn what_a_faint_target_covers_wholly_belongs_to_it() {
        let inside = |x: usize, y: usize| x.abs_diff(150).pow(2) + y.abs_diff(150).pow(2) < 75 * 75;
        let image = picture(300, 300, |x, y| if inside(x, y) { 16 } else { 10 });
        let regions = Tiles::of(&image, 75.0).faint_regions(4.0, 30.0);
        assert_eq!(regions.len(), 1);
        let centres = (0..300 * 300).map(|slot| [slot % 300, slot / 300]);
        let mut covered = centres.filter(|&[x, y]| inside(x, y));
        assert!(covered.all(|[x, y]| regions[0].holds([x as f64 + 0.5, y as f64 + 0.5])));
    }

    proptest! {
        #[test]
        fn all_that_rises_above_its_surroundings_lies_in_just_one_region(
            spots in proptest::collection::vec((0_usize..130, 0_usize..75, 0_u16..90), 0..12),
        ) {
            let image = picture(130, 75, |x, y| {
                20 + spots.iter().filter(|spot| (spot.0, spot.1) == (x, y)).map(|spot| spot.2).max().unwrap_or(0)
            });
            let regions = Tiles::of(&image, 20.0).regions(30.0);
            let mut held = vec![0; 130 * 75];
            for [row, first, end] in regions.iter().flat_map(Region::pieces) {
                for held in &mut held[row * 130 + first..row * 130 + end] {
                    *held += 1;
                }
            }
            for (held, &grey) in held.iter().zip(image.samples()) {
                prop_assert!(*held <= 1);
                // 30 above the ground of 20, and above a mean that spots raise by 15 before it stands out itself; means are whole.
                prop_assert!(grey <= 66 || *held == 1);
            }
        }
    }
}
