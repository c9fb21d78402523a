//! One reading of a picture in tiles: what each holds, and the ground that it lies on.

use bytemuck::cast;
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::{BitDepth, GreyImage};

/// Side of a tile, px.
pub(super) const TILE: usize = 16;
/// Tiles at the border with fewer columns or rows have the mean of their neighbours.
const NARROW: usize = 6;

/// What the tiles of a picture hold, row by row, and the ground round them.
///
/// The ground of a tile is the least mean of the tiles round it, farther than the largest target reaches, so that a
/// target never is its own ground.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tiles {
    /// Size of the picture, px.
    pub(super) size: [usize; 2],
    /// Tiles in a row.
    pub(super) across: usize,
    /// Farther than the largest target, tiles.
    pub(super) reach: usize,
    /// What each holds.
    pub(super) tiles: Vec<Tile>,
    /// Their grounds, as [`Tile::mean_of_four`].
    pub(super) ground: Vec<u32>,
}

/// What a tile holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tile {
    /// The brightest grey value.
    pub(super) brightest: u16,
    /// The largest sum of 2 x 2 pixels: noise raises it half as far above four times the mean as it raises a pixel.
    pub(super) brightest_four: u32,
    /// Four times the mean grey value.
    pub(super) mean_of_four: u32,
}

impl Tiles {
    /// Reads the picture. Targets reach up to `reach_px` from their centres.
    #[must_use]
    pub fn of(image: &GreyImage, reach_px: f64) -> Self {
        let (width, height) = (image.width(), image.height());
        let down = height.div_ceil(TILE);
        let arch = Arch::new();
        let rows: Vec<Vec<Tile>> = (0..down)
            .into_par_iter()
            .map(|row| match image.depth() {
                BitDepth::Eight => arch.dispatch(TileRow::<true> {
                    image,
                    first: row * TILE,
                }),
                BitDepth::Sixteen => arch.dispatch(TileRow::<false> {
                    image,
                    first: row * TILE,
                }),
            })
            .collect();
        let across = width.div_ceil(TILE);
        let mut tiles = rows.concat();
        // What is left at the borders may be a single pixel, which knows its mean no better than its noise lets it.
        if (1..NARROW).contains(&(width % TILE)) && across > 1 {
            for row in tiles.chunks_mut(across) {
                row[across - 1].mean_of_four = row[across - 2].mean_of_four;
            }
        }
        if (1..NARROW).contains(&(height % TILE)) && down > 1 {
            let (above, last) = tiles.split_at_mut((down - 1) * across);
            for (tile, above) in last.iter_mut().zip(&above[(down - 2) * across..]) {
                tile.mean_of_four = above.mean_of_four;
            }
        }
        let reach = (reach_px / TILE as f64).ceil() as usize + 1;
        let ground = Vec::new();
        let mut tiles = Self {
            size: [width, height],
            across,
            reach,
            tiles,
            ground,
        };
        tiles.ground = tiles.least_mean_within(reach);
        tiles
    }

    /// The brightest grey value of the picture; 0 for an empty one.
    #[must_use]
    pub fn brightest(&self) -> u16 {
        let brightest = self.tiles.iter().map(|tile| tile.brightest);
        brightest.max().unwrap_or(0)
    }

    /// The mean grey value that a twentieth of the tiles does not exceed; 0 for an empty picture.
    #[must_use]
    pub fn dark_level(&self) -> f64 {
        let mut means: Vec<u32> = self.tiles.iter().map(|tile| tile.mean_of_four).collect();
        let place = means.len() / 20;
        match means.is_empty() {
            true => 0.0,
            false => 0.25 * f64::from(*means.select_nth_unstable(place).1),
        }
    }

    /// For every tile the least [`Tile::mean_of_four`] of those at most `reach` rows and columns away.
    pub(super) fn least_mean_within(&self, reach: usize) -> Vec<u32> {
        let across = self.across.max(1);
        let means: Vec<u32> = self.tiles.iter().map(|tile| tile.mean_of_four).collect();
        let mut along_rows = means.clone();
        let rows = along_rows.chunks_mut(across).zip(means.chunks(across));
        for (least, row) in rows {
            for off in 1..=reach.min(across - 1) {
                lower_to(&mut least[off..], row);
                lower_to(least, &row[off..]);
            }
        }
        let mut least = along_rows.clone();
        for off in 1..=reach.min((means.len() / across).saturating_sub(1)) {
            lower_to(&mut least[off * across..], &along_rows);
            lower_to(&mut least, &along_rows[off * across..]);
        }
        least
    }
}

/// The tiles of the rows of a picture from this one on. The loop runs with the widest instructions that the machine has.
struct TileRow<'a, const EIGHT_BITS: bool> {
    image: &'a GreyImage,
    first: usize,
}

impl<const EIGHT_BITS: bool> NullaryFnOnce for TileRow<'_, EIGHT_BITS> {
    type Output = Vec<Tile>;

    #[inline(always)]
    fn call(self) -> Vec<Tile> {
        let Self { image, first } = self;
        let rows = first..(first + TILE).min(image.height());
        let whole = image.width() / TILE;
        let rest = image.width() % TILE;
        let mut sums = vec![Sums::default(); image.width().div_ceil(TILE)];
        for row in rows.clone().step_by(2) {
            // A last row without a second one is its own.
            let pair = [row, (row + 1).min(rows.end - 1)].map(|row| image.row(row));
            let [upper, lower] = pair.map(|row| row.as_chunks().0);
            for ((sums, upper), lower) in sums.iter_mut().zip(upper).zip(lower) {
                sums.add_rows::<EIGHT_BITS>(upper, lower);
            }
            if rest > 0 {
                // What is left at the right border is filled up with its last column.
                let [upper, lower] = pair.map(|row| {
                    let samples = &row[whole * TILE..];
                    std::array::from_fn(|column| samples[column.min(rest - 1)])
                });
                sums[whole].add_rows::<EIGHT_BITS>(&upper, &lower);
            }
        }
        let pairs = rows.len().div_ceil(2);
        sums.iter().map(|sums| sums.tile(pairs)).collect()
    }
}

/// What a tile holds, column by column, and by two columns.
#[derive(Clone, Copy, Default)]
struct Sums {
    brightest: [u16; TILE],
    brightest_four: [i32; TILE / 2],
    all: [u32; TILE / 2],
}

// Sums of four are at most 2^18, and there are 128 of them: checks for overflow would take longer than the sums.
impl Sums {
    #[inline(always)]
    fn add_rows<const EIGHT_BITS: bool>(&mut self, upper: &[u16; TILE], lower: &[u16; TILE]) {
        if EIGHT_BITS {
            self.add_of_eight_bits(upper, lower);
        } else {
            self.add(upper, lower);
        }
    }

    /// Two rows of a picture of 8 bit: sums of four have no more than 16 bits either, which go twice as fast.
    #[inline(always)]
    fn add_of_eight_bits(&mut self, upper: &[u16; TILE], lower: &[u16; TILE]) {
        let mut both = [0; TILE];
        for column in 0..TILE {
            let (upper, lower) = (upper[column], lower[column]);
            self.brightest[column] = self.brightest[column].max(upper.max(lower));
            both[column] = upper.wrapping_add(lower);
        }
        let fours = cast::<_, [u32; TILE / 2]>(both).map(sum_of_two);
        for (all, four) in self.all.iter_mut().zip(fours) {
            *all = all.wrapping_add(four);
        }
        let halves: [i16; TILE] = cast(fours);
        let mut known: [i16; TILE] = cast(self.brightest_four);
        for (known, half) in known.iter_mut().zip(halves) {
            *known = (*known).max(half);
        }
        self.brightest_four = cast(known);
    }

    /// Two rows of any picture.
    #[inline(always)]
    fn add(&mut self, upper: &[u16; TILE], lower: &[u16; TILE]) {
        for column in 0..TILE {
            let brighter = upper[column].max(lower[column]);
            self.brightest[column] = self.brightest[column].max(brighter);
        }
        let [upper, lower] = [*upper, *lower].map(cast::<_, [u32; TILE / 2]>);
        for slot in 0..TILE / 2 {
            let four = sum_of_two(upper[slot]).wrapping_add(sum_of_two(lower[slot]));
            self.all[slot] = self.all[slot].wrapping_add(four);
            self.brightest_four[slot] = self.brightest_four[slot].max(four as i32);
        }
    }

    fn tile(&self, pairs: usize) -> Tile {
        let fours = (pairs * TILE / 2) as u32;
        let largest = self.brightest_four.iter().copied().max().unwrap_or(0);
        Tile {
            brightest: self.brightest.iter().copied().max().unwrap_or(0),
            brightest_four: largest.unsigned_abs(),
            mean_of_four: self.all.iter().sum::<u32>() / fours.max(1),
        }
    }
}

/// Two neighbours of a row lie in one number of 32 bits; which is first does not matter to their sum.
fn sum_of_two(both: u32) -> u32 {
    (both & 0xffff).wrapping_add(both >> 16)
}

/// Takes the lesser of both, as far as both reach.
fn lower_to(known: &mut [u32], others: &[u32]) {
    for (known, &other) in known.iter_mut().zip(others) {
        *known = (*known).min(other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_empty_picture_has_no_tiles() {
        let image = GreyImage::new(0, 0, BitDepth::Eight, Vec::new()).unwrap();
        let tiles = Tiles::of(&image, 75.0);
        assert_eq!((tiles.brightest(), tiles.dark_level()), (0, 0.0));
    }

    proptest! {
        #[test]
        fn tiles_hold_what_their_pixels_say(
            width in 1_usize..40,
            height in 1_usize..40,
            greys in proptest::collection::vec(any::<u16>(), 40 * 40),
            depth in proptest::sample::select(vec![BitDepth::Eight, BitDepth::Sixteen]),
        ) {
            let samples = greys[..width * height].iter().map(|grey| grey & depth.white()).collect();
            let image = GreyImage::new(width as u32, height as u32, depth, samples).unwrap();
            let tiles = Tiles::of(&image, 0.0);
            prop_assert_eq!(tiles.brightest(), image.brightest());
            for (slot, tile) in tiles.tiles.iter().enumerate() {
                let (left, top) = (slot % tiles.across * TILE, slot / tiles.across * TILE);
                let at = |x: usize, y: usize| u32::from(image.row(y.min(height - 1))[x.min(width - 1)]);
                let fours = (top..(top + TILE).min(height)).step_by(2).flat_map(|y| {
                    (left..left + TILE).step_by(2).map(move |x| [x, y])
                });
                let fours: Vec<u32> =
                    fours.map(|[x, y]| at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1)).collect();
                prop_assert_eq!(Some(tile.brightest_four), fours.iter().copied().max());
                let mean = fours.iter().map(|&four| u64::from(four)).sum::<u64>() / fours.len() as u64;
                let is_narrow = |from: usize, size: usize| from > 0 && size - from < NARROW;
                if !is_narrow(left, width) && !is_narrow(top, height) {
                    prop_assert_eq!(u64::from(tile.mean_of_four), mean);
                }
            }
        }

        #[test]
        fn the_ground_is_the_least_mean_near(
            across in 1_usize..9,
            down in 1_usize..9,
            means in proptest::collection::vec(0_u32..1000, 81),
            reach in 0_usize..5,
        ) {
            let tile = |&mean| Tile { brightest: 0, brightest_four: 0, mean_of_four: mean };
            let tiles = Tiles {
                size: [across * TILE, down * TILE],
                across,
                reach,
                tiles: means[..across * down].iter().map(tile).collect(),
                ground: Vec::new(),
            };
            for (slot, least) in tiles.least_mean_within(reach).into_iter().enumerate() {
                let near = (0..across * down).filter(|other| {
                    (other % across).abs_diff(slot % across) <= reach
                        && (other / across).abs_diff(slot / across) <= reach
                });
                prop_assert_eq!(near.map(|other| means[other]).min(), Some(least));
            }
        }
    }
}
