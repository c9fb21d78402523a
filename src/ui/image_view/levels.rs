//! Grey values of a tile and of its mip levels, as the graphics card takes them.

use crate::imaging::{BitDepth, GreyImage};

/// Side of a tile's texture, px.
pub(super) const SIDE: usize = 512;
/// Pixels of the neighbours round a tile, so that filtering sees no seam down to the second mip level.
pub(super) const APRON: usize = 2;
/// Pixels from one tile to the next.
pub(super) const STEP: usize = SIDE - 2 * APRON;

/// One mip level: a square or rectangle of grey values.
pub(super) struct Level {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) grey: Vec<u16>,
}

impl Level {
    /// A tile with its apron; beyond the picture its border goes on.
    pub(super) fn of_tile(picture: &GreyImage, [column, row]: [usize; 2]) -> Self {
        let source = |tile: usize, offset: usize, side: usize| {
            (tile * STEP + offset)
                .saturating_sub(APRON)
                .min(side.saturating_sub(1))
        };
        let mut grey = Vec::with_capacity(SIDE * SIDE);
        let first = (column * STEP).saturating_sub(APRON);
        for y in 0..SIDE {
            let samples = picture.row(source(row, y, picture.height()));
            let begins = grey.len();
            if column == 0 {
                grey.extend([samples[0]; APRON]);
            }
            let missing = SIDE - (grey.len() - begins);
            let run = &samples[first..(first + missing).min(samples.len())];
            grey.extend_from_slice(run);
            let last = samples[samples.len() - 1];
            grey.resize(begins + SIDE, last);
        }
        Self {
            width: SIDE,
            height: SIDE,
            grey,
        }
    }

    /// Every so many pixels of the whole picture.
    pub(super) fn overview(picture: &GreyImage) -> Self {
        let longer = picture.width().max(picture.height()).max(1);
        let side = |length: usize| (length * SIDE / longer.max(SIDE)).max(1);
        let (width, height) = (side(picture.width()), side(picture.height()));
        let grey = (0..height)
            .flat_map(|y| {
                let row = picture.row((2 * y + 1) * picture.height() / (2 * height));
                (0..width).map(move |x| row[(2 * x + 1) * row.len() / (2 * width)])
            })
            .collect();
        Self {
            width,
            height,
            grey,
        }
    }

    /// Half as wide and high, by means of four.
    pub(super) fn halved(&self) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let mut grey = Vec::with_capacity(width * height);
        for row in 0..height {
            let upper = &self.grey[2 * row * self.width..][..self.width];
            let lower = &self.grey[(2 * row + 1) * self.width..][..self.width];
            let pairs = upper.chunks_exact(2).zip(lower.chunks_exact(2));
            grey.extend(pairs.map(|(u, l)| {
                let sum: u32 = u.iter().chain(l).map(|&grey| u32::from(grey)).sum();
                ((sum + 2) / 4) as u16
            }));
        }
        Self {
            width,
            height,
            grey,
        }
    }

    pub(super) fn bytes(&self, depth: BitDepth) -> Vec<u8> {
        match depth {
            BitDepth::Eight => self.grey.iter().map(|&grey| grey.min(255) as u8).collect(),
            BitDepth::Sixteen => self
                .grey
                .iter()
                .flat_map(|grey| grey.to_be_bytes())
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: u32, height: u32) -> GreyImage {
        let samples = (0..height).flat_map(|y| (0..width).map(move |x| ((x + 3 * y) % 251) as u16));
        GreyImage::new(width, height, BitDepth::Eight, samples.collect()).unwrap()
    }

    #[test]
    fn tiles_overlap_and_go_on_beyond_the_border() {
        let picture = picture(700, 300);
        let (first, second) = (
            Level::of_tile(&picture, [0, 0]),
            Level::of_tile(&picture, [1, 0]),
        );
        let at = |level: &Level, x: usize, y: usize| f32::from(level.grey[y * SIDE + x]);
        assert_eq!(at(&first, 0, 0), picture.at(0, 0));
        assert_eq!(at(&first, APRON + 17, APRON + 5), picture.at(17, 5));
        assert_eq!(at(&second, 0, APRON + 5), picture.at(STEP - APRON, 5));
        assert_eq!(at(&second, SIDE - 1, SIDE - 1), picture.at(699, 299));
    }

    #[test]
    fn a_mip_level_keeps_the_mean() {
        let level = Level {
            width: 4,
            height: 2,
            grey: vec![0, 10, 20, 30, 2, 12, 22, 32],
        };
        assert_eq!(level.halved().grey, [6, 26]);
    }
}
