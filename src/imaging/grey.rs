//! Grey values of one picture.

/// Range of the grey values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BitDepth {
    /// 0 to 255.
    Eight,
    /// 0 to 65535.
    Sixteen,
}

impl BitDepth {
    /// The largest grey value.
    #[must_use]
    pub fn white(self) -> u16 {
        match self {
            BitDepth::Eight => u16::from(u8::MAX),
            BitDepth::Sixteen => u16::MAX,
        }
    }

    /// The grey value at or above which a picture with this brightest one clips; `None` where it does not.
    #[must_use]
    pub fn clipping(self, brightest: u16) -> Option<u16> {
        /// A picture whose brightest pixel stays below this share of white is not clipped.
        const CLIPPED_SHARE: f32 = 0.98;
        (f32::from(brightest) >= CLIPPED_SHARE * f32::from(self.white())).then_some(brightest)
    }
}

/// Samples that do not fill the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("found {found} samples, expected {width} x {height} = {expected}")]
pub struct WrongSampleCount {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples given.
    pub found: usize,
    /// Samples needed.
    pub expected: usize,
}

/// A grey picture, row by row. The centre of the first pixel is at (0.5, 0.5).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GreyImage {
    width: usize,
    height: usize,
    depth: BitDepth,
    samples: Vec<u16>,
}

impl GreyImage {
    /// A picture of `width` columns and `height` rows from its samples, row by row.
    ///
    /// # Errors
    /// [`WrongSampleCount`] where the samples do not fill the picture.
    pub fn new(
        width: u32,
        height: u32,
        depth: BitDepth,
        samples: Vec<u16>,
    ) -> Result<Self, WrongSampleCount> {
        let expected = width as usize * height as usize;
        if samples.len() != expected {
            return Err(WrongSampleCount {
                width,
                height,
                found: samples.len(),
                expected,
            });
        }
        Ok(Self {
            width: width as usize,
            height: height as usize,
            depth,
            samples,
        })
    }

    /// A picture from as many samples as it has pixels.
    pub(super) fn of_size([width, height]: [usize; 2], depth: BitDepth, samples: Vec<u16>) -> Self {
        debug_assert_eq!(samples.len(), width * height, "a full picture");
        Self {
            width,
            height,
            depth,
            samples,
        }
    }

    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Range of the grey values.
    #[must_use]
    pub fn depth(&self) -> BitDepth {
        self.depth
    }

    /// All samples, row by row.
    #[must_use]
    pub fn samples(&self) -> &[u16] {
        &self.samples
    }

    /// The samples of one row.
    #[must_use]
    pub fn row(&self, row: usize) -> &[u16] {
        &self.samples[row * self.width..(row + 1) * self.width]
    }

    /// The grey value of a pixel.
    #[must_use]
    pub fn at(&self, column: usize, row: usize) -> f32 {
        f32::from(self.samples[row * self.width + column])
    }

    /// The largest grey value of the picture; 0 for an empty one.
    #[must_use]
    pub fn brightest(&self) -> u16 {
        self.samples.iter().copied().max().unwrap_or(0)
    }

    /// The grey value at or above which the sensor (or the conversion) clips; `None` where nothing is clipped.
    #[must_use]
    pub fn clipping(&self) -> Option<u16> {
        self.depth.clipping(self.brightest())
    }

    /// The grey value between the pixels at a place in px, bilinear; `None` outside the outermost pixel centres.
    #[must_use]
    pub fn sample(&self, x_px: f64, y_px: f64) -> Option<f64> {
        let (x, y) = (x_px - 0.5, y_px - 0.5);
        if !(x >= 0.0 && y >= 0.0) {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        if column + 1 >= self.width || row + 1 >= self.height {
            return None;
        }
        let (u, v) = (x - column as f64, y - row as f64);
        let first = row * self.width + column;
        let grey = |slot: usize| f64::from(self.samples[slot]);
        let upper = grey(first) * (1.0 - u) + grey(first + 1) * u;
        let lower = grey(first + self.width) * (1.0 - u) + grey(first + self.width + 1) * u;
        Some(upper * (1.0 - v) + lower * v)
    }

    /// The picture with light and dark exchanged.
    #[must_use]
    pub fn inverted(&self) -> Self {
        let white = self.depth.white();
        Self {
            samples: self
                .samples
                .iter()
                .map(|&grey| white.saturating_sub(grey))
                .collect(),
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_pixel_has_its_centre_at_one_half() {
        let image = GreyImage::new(2, 2, BitDepth::Eight, vec![10, 20, 30, 40]).unwrap();
        assert_eq!(image.sample(0.5, 0.5), Some(10.0));
        assert_eq!(image.sample(1.0, 1.0), Some(25.0));
        assert_eq!(image.sample(0.4, 1.0), None);
        assert_eq!(image.sample(f64::NAN, 1.0), None);
    }

    #[test]
    fn samples_must_fill_the_picture() {
        let error = GreyImage::new(3, 2, BitDepth::Eight, vec![0; 5]).unwrap_err();
        assert_eq!((error.found, error.expected), (5, 6));
    }
}
