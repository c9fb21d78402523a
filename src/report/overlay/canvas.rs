//! Lines, ellipses and letters on a colour picture.
//!
//! Places are pixel coordinates (the centre of the first pixel is 0.5, 0.5). What leaves the picture is cut off. Every
//! edge is smoothed by the share of the pixel that it covers, taken from the pixel's distance to it.

use image::{Rgb, RgbImage};
use nalgebra::Vector2;
use noto_sans_mono_bitmap::{
    FontWeight, RasterHeight, RasterizedChar, get_raster, get_raster_width,
};

/// A colour.
pub(super) type Colour = [u8; 3];

const BLACK: Colour = [0, 0, 0];
const WEIGHT: FontWeight = FontWeight::Regular;

/// Height of letters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Letters {
    /// 16 px.
    Small,
    /// 24 px.
    Middle,
    /// 32 px.
    Large,
    /// 64 px: the large ones, every pixel four times.
    Huge,
}

impl Letters {
    fn raster(self) -> RasterHeight {
        match self {
            Letters::Small => RasterHeight::Size16,
            Letters::Middle => RasterHeight::Size24,
            Letters::Large | Letters::Huge => RasterHeight::Size32,
        }
    }

    /// Side of the square that shows one pixel of the font, px.
    fn grain(self) -> usize {
        match self {
            Letters::Small | Letters::Middle | Letters::Large => 1,
            Letters::Huge => 2,
        }
    }

    /// Height of a line, px.
    pub(super) fn height(self) -> usize {
        self.raster().val() * self.grain()
    }

    /// From one letter to the next, px.
    fn advance(self) -> usize {
        get_raster_width(WEIGHT, self.raster()) * self.grain()
    }

    /// Width and height of a text of lines, px.
    pub(super) fn size(self, lines: &[String]) -> [usize; 2] {
        let letters = lines.iter().map(|line| line.chars().count()).max();
        [
            letters.unwrap_or(0) * self.advance(),
            lines.len() * self.height(),
        ]
    }
}

/// An ellipse by its full diameters and the direction of the larger, radians from +x towards +y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Outline {
    pub(super) centre: Vector2<f64>,
    pub(super) major: f64,
    pub(super) minor: f64,
    pub(super) angle: f64,
}

/// A picture to draw on.
pub(super) struct Canvas {
    picture: RgbImage,
}

impl Canvas {
    pub(super) fn new(picture: RgbImage) -> Self {
        Self { picture }
    }

    pub(super) fn into_picture(self) -> RgbImage {
        self.picture
    }

    pub(super) fn size(&self) -> [usize; 2] {
        [
            self.picture.width() as usize,
            self.picture.height() as usize,
        ]
    }

    /// A straight line of this width, px.
    pub(super) fn line(
        &mut self,
        from: Vector2<f64>,
        to: Vector2<f64>,
        width: f64,
        colour: Colour,
    ) {
        let along = to - from;
        let length = along.norm();
        if length < 1e-9 {
            return;
        }
        let direction = along / length;
        let reach = 0.5 * width + 1.0;
        // Column by column where the line is flat, else row by row: a band round the line, not the box round it.
        let main = usize::from(along.y.abs() > along.x.abs());
        let other = 1 - main;
        let band = reach / direction[main].abs();
        let first = (from[main].min(to[main]) - reach).floor();
        let last = (from[main].max(to[main]) + reach).ceil();
        for step in self.pixels(main, first, last) {
            let middle =
                from[other] + (step as f64 + 0.5 - from[main]) * direction[other] / direction[main];
            for across in self.pixels(other, (middle - band).floor(), (middle + band).ceil()) {
                let pixel = if main == 0 {
                    [step, across]
                } else {
                    [across, step]
                };
                let offset = centre_of(pixel) - from;
                let nearest = offset.dot(&direction).clamp(0.0, length);
                let distance = (offset - direction * nearest).norm();
                self.blend(pixel, colour, 0.5 * width + 0.5 - distance);
            }
        }
    }

    /// The outline of an ellipse as a line of this width, px.
    pub(super) fn ellipse(&mut self, outline: &Outline, width: f64, colour: Colour) {
        let (a, b) = (0.5 * outline.major, 0.5 * outline.minor);
        if !(a > 0.0 && b > 0.0) {
            return;
        }
        let (sin, cos) = outline.angle.sin_cos();
        let reach = width + 1.0;
        let half = [(a * cos).hypot(b * sin), (a * sin).hypot(b * cos)];
        let range = |axis: usize| {
            [
                (outline.centre[axis] - half[axis] - reach).floor(),
                (outline.centre[axis] + half[axis] + reach).ceil(),
            ]
        };
        let (columns, rows) = (range(0), range(1));
        for y in self.pixels(1, rows[0], rows[1]) {
            for x in self.pixels(0, columns[0], columns[1]) {
                let offset = centre_of([x, y]) - outline.centre;
                let (u, v) = (
                    cos * offset.x + sin * offset.y,
                    cos * offset.y - sin * offset.x,
                );
                // To first order the distance from F = 1 is (F - 1) / |grad F|, F the radius in the ellipse's units.
                let radius = (u / a).hypot(v / b);
                let slope = (u / (a * a)).hypot(v / (b * b)) / radius.max(1e-9);
                let distance = (radius - 1.0).abs() / slope.max(1e-9);
                self.blend([x, y], colour, 0.5 * width + 0.5 - distance);
            }
        }
    }

    /// A cross of two diagonals that reach this far from their centre, px.
    pub(super) fn cross(&mut self, centre: Vector2<f64>, reach: f64, width: f64, colour: Colour) {
        for diagonal in [Vector2::new(reach, reach), Vector2::new(reach, -reach)] {
            self.line(centre - diagonal, centre + diagonal, width, colour);
        }
    }

    /// Darkens a rectangle, so that what is written there can be read from afar.
    pub(super) fn shade(&mut self, corner: [usize; 2], size: [usize; 2]) {
        const SHADE: f64 = 0.7;
        let [width, height] = self.size();
        for y in corner[1]..(corner[1] + size[1]).min(height) {
            for x in corner[0]..(corner[0] + size[0]).min(width) {
                self.blend([x, y], BLACK, SHADE);
            }
        }
    }

    /// Lines of text with their top-left corner here, each letter with a dark rim.
    pub(super) fn text(
        &mut self,
        corner: [usize; 2],
        lines: &[String],
        letters: Letters,
        colour: Colour,
    ) {
        /// How dark the rim is; fainter at a pixel's corners.
        const RIM: f64 = 0.75;
        let grain = letters.grain();
        let mut inked: Vec<([usize; 2], f64)> = Vec::new();
        for (row, line) in lines.iter().enumerate() {
            for (column, letter) in line.chars().enumerate() {
                // What the font lacks is shown as a question mark.
                let glyph = get_raster(letter, WEIGHT, letters.raster())
                    .or_else(|| get_raster('?', WEIGHT, letters.raster()));
                for (y, greys) in glyph.iter().flat_map(RasterizedChar::rows).enumerate() {
                    for (x, &grey) in greys.iter().enumerate().filter(|(_, grey)| **grey > 0) {
                        let left = corner[0] + column * letters.advance() + x * grain;
                        let top = corner[1] + row * letters.height() + y * grain;
                        for (right, down) in (0..grain * grain).map(|k| (k % grain, k / grain)) {
                            inked.push(([left + right, top + down], f64::from(grey) / 255.0));
                        }
                    }
                }
            }
        }
        for &([x, y], share) in &inked {
            for (right, down) in [(0, 1), (1, 0), (2, 1), (1, 2)] {
                if let (Some(x), Some(y)) = ((x + right).checked_sub(1), (y + down).checked_sub(1))
                {
                    self.blend([x, y], BLACK, RIM * share);
                }
            }
        }
        for (pixel, share) in inked {
            self.blend(pixel, colour, share);
        }
    }

    /// Columns (axis 0) or rows (axis 1) from one to the other, cut off at the picture's edges.
    fn pixels(&self, axis: usize, first: f64, last: f64) -> std::ops::Range<usize> {
        // A cast of what is below zero or no number gives zero.
        let end = (last + 1.0) as usize;
        (first as usize)..end.min(self.size()[axis])
    }

    /// Mixes a colour into a pixel by the share that it covers of it; nothing outside the picture.
    fn blend(&mut self, [x, y]: [usize; 2], colour: Colour, share: f64) {
        let share = share.clamp(0.0, 1.0);
        if share == 0.0 {
            return;
        }
        if let Some(Rgb(shown)) = self.picture.get_pixel_mut_checked(x as u32, y as u32) {
            for (shown, new) in shown.iter_mut().zip(colour) {
                let mixed = f64::from(*shown) * (1.0 - share) + f64::from(new) * share;
                *shown = mixed.round() as u8;
            }
        }
    }
}

fn centre_of([x, y]: [usize; 2]) -> Vector2<f64> {
    Vector2::new(x as f64 + 0.5, y as f64 + 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHITE: Colour = [255; 3];

    fn black(width: u32, height: u32) -> Canvas {
        Canvas::new(RgbImage::new(width, height))
    }

    fn light(canvas: &Canvas) -> f64 {
        let sum: f64 = canvas.picture.pixels().map(|p| f64::from(p.0[0])).sum();
        sum / 255.0
    }

    #[test]
    fn a_line_has_the_light_of_its_area() {
        for (to, width) in [
            ([45.0, 10.0], 2.0),
            ([12.0, 48.0], 1.5),
            ([40.0, 40.0], 3.0),
        ] {
            let mut canvas = black(60, 60);
            let (from, to) = (Vector2::new(10.0, 8.0), Vector2::from(to));
            canvas.line(from, to, width, WHITE);
            let area = (to - from).norm() * width;
            assert!(
                (light(&canvas) / area - 1.0).abs() < 0.12,
                "{}",
                light(&canvas)
            );
        }
    }

    #[test]
    fn an_ellipse_is_drawn_where_it_is() {
        let mut canvas = black(60, 60);
        let outline = Outline {
            centre: Vector2::new(30.0, 28.0),
            major: 40.0,
            minor: 20.0,
            angle: std::f64::consts::FRAC_PI_2,
        };
        canvas.ellipse(&outline, 2.0, WHITE);
        let at = |x: u32, y: u32| canvas.picture.get_pixel(x, y).0[0];
        assert_eq!([at(29, 8), at(29, 47), at(20, 27), at(39, 27)], [255; 4]);
        assert_eq!([at(29, 27), at(29, 3), at(15, 27), at(45, 27)], [0; 4]);
        // The circumference by Ramanujan's first formula.
        let around = std::f64::consts::PI * (3.0 * 30.0 - (70.0_f64 * 50.0).sqrt());
        assert!((light(&canvas) / (2.0 * around) - 1.0).abs() < 0.05);
    }

    #[test]
    fn what_leaves_the_picture_is_cut_off() {
        let mut canvas = black(8, 8);
        let outside = Vector2::new(-5.0, 1e9);
        canvas.line(outside, Vector2::new(20.0, 3.0), 1.0, WHITE);
        canvas.line(Vector2::new(f64::NAN, 0.0), outside, 1.0, WHITE);
        let outline = Outline {
            centre: outside,
            major: 3.0,
            minor: 2.0,
            angle: 0.0,
        };
        canvas.ellipse(&outline, 1.0, WHITE);
        canvas.cross(Vector2::new(0.0, 0.0), 4.0, 1.0, WHITE);
        canvas.text([5, 5], &["outside \u{394}".into()], Letters::Large, WHITE);
        canvas.shade([6, 6], [9, 9]);
        assert!(canvas.picture.get_pixel(0, 0).0[0] > 200);
    }
}
