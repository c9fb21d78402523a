//! The parts of a picture that rise above their surroundings: all that detection has to look at.
//!
//! The picture is read once, in tiles: the brightest grey value of each, and its mean. The ground of a tile is the least
//! mean of the tiles round it, farther than the largest target reaches, so that a target never is its own ground. A
//! tile whose brightest pixel does not rise above its ground holds nothing; in a dark picture those are nearly all.
//! Tiles that do, and touch, are one [`Region`]. On a slope or a texture too much rises: that costs time, and hides
//! nothing.
//!
//! Cost: one reading of the pixels, and a running minimum over the tiles; independent of the number of targets.

use std::ops::Range;

use rayon::prelude::*;

use super::GreyImage;

/// Side of a tile, px.
const TILE: usize = 16;
/// Rows of a tile that make its mean: 64 pixels are enough to know it to an eighth of the noise.
const MEAN_ROWS: usize = 4;

/// Brightest grey values and means of a picture's tiles, row by row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tiles {
    width: usize,
    height: usize,
    across: usize,
    brightest: Vec<u16>,
    mean: Vec<u16>,
}

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
    /// Reads the picture.
    #[must_use]
    pub fn of(image: &GreyImage) -> Self {
        let (width, height) = (image.width(), image.height());
        let (across, down) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let rows: Vec<(Vec<u16>, Vec<u16>)> = (0..down)
            .into_par_iter()
            .map(|row| tile_row(image, row * TILE..((row + 1) * TILE).min(height)))
            .collect();
        let mut tiles = Self {
            width,
            height,
            across,
            brightest: Vec::with_capacity(across * down),
            mean: Vec::with_capacity(across * down),
        };
        for (brightest, mean) in rows {
            tiles.brightest.extend(brightest);
            tiles.mean.extend(mean);
        }
        tiles
    }

    /// The brightest grey value of the picture; 0 for an empty one.
    #[must_use]
    pub fn brightest(&self) -> u16 {
        self.brightest.iter().copied().max().unwrap_or(0)
    }

    /// The mean grey value that a twentieth of the tiles does not exceed; 0 for an empty picture.
    #[must_use]
    pub fn dark_level(&self) -> u16 {
        let mut means = self.mean.clone();
        let place = means.len() / 20;
        match means.is_empty() {
            true => 0,
            false => *means.select_nth_unstable(place).1,
        }
    }

    /// What rises by more than `rise` grey values above the darkest surroundings within `reach_px`.
    #[must_use]
    pub fn regions(&self, rise: f64, reach_px: f64) -> Vec<Region> {
        let reach = (reach_px / TILE as f64).ceil() as usize + 1;
        let ground = self.least_mean_within(reach);
        let rises = |slot: usize| {
            let [brightest, mean, ground] =
                [self.brightest[slot], self.mean[slot], ground[slot]].map(f64::from);
            // Something stands out in the tile, or covers much of it; a ground that rises slowly does neither.
            let stands = brightest > mean + rise || mean > ground + 0.5 * rise;
            brightest > ground + rise && stands
        };
        let mut spans: Vec<Span> = Vec::new();
        for row in 0..self.mean.len() / self.across.max(1) {
            let mut open: Option<usize> = None;
            for column in 0..=self.across {
                let risen = column < self.across && rises(row * self.across + column);
                match (risen, open) {
                    (true, None) => open = Some(column),
                    (false, Some(first)) => {
                        spans.push(Span {
                            row,
                            first,
                            end: column,
                        });
                        open = None;
                    }
                    _ => {}
                }
            }
        }
        self.joined(&spans, &ground)
    }

    /// Joins spans of neighbouring rows that touch, also by a corner. Regions come in the order of their first spans.
    fn joined(&self, spans: &[Span], ground: &[u16]) -> Vec<Region> {
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
                    size: [self.width, self.height],
                });
            }
            let region = &mut regions[*place];
            let tiles = span.row * self.across + span.first..span.row * self.across + span.end;
            let both = ground[tiles.clone()].iter().zip(&self.brightest[tiles]);
            for (&ground, &brightest) in both {
                region.ground = region.ground.min(f64::from(ground));
                region.brightest = region.brightest.max(brightest);
            }
            region.spans.push(*span);
        }
        regions
    }

    /// For every tile the least mean of those at most `reach` rows and columns away.
    fn least_mean_within(&self, reach: usize) -> Vec<u16> {
        let across = self.across.max(1);
        let mut along_rows = Vec::with_capacity(self.mean.len());
        for row in self.mean.chunks(across) {
            for column in 0..row.len() {
                let near = column.saturating_sub(reach)..(column + reach + 1).min(row.len());
                along_rows.push(row[near].iter().copied().min().unwrap_or(0));
            }
        }
        let down = self.mean.len() / across;
        let mut least = Vec::with_capacity(self.mean.len());
        for row in 0..down {
            let near = row.saturating_sub(reach)..(row + reach + 1).min(down);
            let first = least.len();
            least.extend_from_slice(&along_rows[near.start * across..(near.start + 1) * across]);
            for other in near.skip(1) {
                let others = &along_rows[other * across..(other + 1) * across];
                for (least, other) in least[first..].iter_mut().zip(others) {
                    *least = (*least).min(*other);
                }
            }
        }
        least
    }
}

/// Brightest grey values and means of the tiles in some rows of the picture.
fn tile_row(image: &GreyImage, rows: Range<usize>) -> (Vec<u16>, Vec<u16>) {
    let whole = image.width() / TILE;
    let rest = image.width() % TILE;
    let tiles = (0..whole).map(|tile| {
        let row = |row| image.row(row)[tile * TILE..].first_chunk();
        tile_of(rows.clone().filter_map(row))
    });
    // What is left at the right border is filled up with its last column.
    let last = (rest > 0).then(|| {
        let row = |row| {
            let samples = &image.row(row)[whole * TILE..];
            std::array::from_fn(|column| samples[column.min(rest - 1)])
        };
        let filled: Vec<[u16; TILE]> = rows.clone().map(row).collect();
        tile_of(filled.iter())
    });
    tiles.chain(last).unzip()
}

/// Brightest grey value and mean of a tile's rows.
fn tile_of<'a>(rows: impl Iterator<Item = &'a [u16; TILE]>) -> (u16, u16) {
    let mut brightest = [0_u16; TILE];
    let mut sums = [0_u32; TILE];
    let mut summed = 0;
    for (place, row) in rows.enumerate() {
        for (known, &grey) in brightest.iter_mut().zip(row) {
            *known = (*known).max(grey);
        }
        if place % (TILE / MEAN_ROWS) == 0 {
            summed += TILE as u32;
            for (sum, &grey) in sums.iter_mut().zip(row) {
                *sum += u32::from(grey);
            }
        }
    }
    let sum: u32 = sums.iter().sum();
    let brightest = brightest.into_iter().max().unwrap_or(0);
    (brightest, (sum / summed.max(1)) as u16)
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
        let regions = Tiles::of(&image).regions(20.0, 30.0);
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
        let regions = Tiles::of(&image).regions(20.0, 75.0);
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
        let tiles = Tiles::of(&image);
        assert_eq!((tiles.brightest(), tiles.dark_level()), (0, 0));
        assert!(tiles.regions(5.0, 75.0).is_empty());
        assert_eq!(pixels(&Region::whole(&image, 0.0)), 0);
    }

    proptest! {
        #[test]
        fn all_that_rises_above_its_surroundings_lies_in_just_one_region(
            spots in proptest::collection::vec((0_usize..130, 0_usize..75, 0_u16..90), 0..12),
        ) {
            let image = picture(130, 75, |x, y| {
                20 + spots.iter().filter(|spot| (spot.0, spot.1) == (x, y)).map(|spot| spot.2).max().unwrap_or(0)
            });
            let regions = Tiles::of(&image).regions(30.0, 20.0);
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
