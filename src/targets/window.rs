//! The pixels round a dot that a fit may use.

use std::ops::Range;

use nalgebra::Vector2;

use super::columns::{Columns, FLAT};
use super::ellipse::Nested;
use super::profile::Profile;
use crate::imaging::GreyImage;

/// What to take from the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WindowSettings {
    /// Where the profile's coordinates have their origin, px.
    pub(super) origin: Vector2<f64>,
    /// Grey value that separates the dot and its neighbours from the background.
    pub(super) level: f64,
    /// Background is taken up to this distance from the edge, px.
    pub(super) margin: f64,
    /// Pixels up to this distance from a neighbour are left out, px.
    pub(super) guard: f64,
    /// Standard deviation of the noise, grey values.
    pub(super) noise: f64,
}

/// Interior pixels farther from the edge than this many blurs tell of the amplitude alone and are thinned out.
const CORE_BLURS: f64 = 4.0;
/// About this many of them are kept.
const CORE_PIXELS: f64 = 300.0;
/// The edge may be so many times more blurred than the profile says.
const MORE_BLUR: f64 = 1.2;
/// Where half a dot's height is fewer sigmas of the noise, a bright pixel that stands alone on the slope of its blur is noise.
const NOISE_SIGMAS: f64 = 12.0;

/// Bright pixels on this level of the ellipse are the dot's.
const INNER: f64 = 0.7;
/// The dot's own pixels end here; what hangs together with it farther out is a neighbour that touches it.
const OUTER: f64 = 1.6;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Owner {
    Background,
    Dot,
    Neighbour,
}

/// Whether anything bright was seen beside the dot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Company {
    Alone,
    Neighbours,
}

/// Fills the columns with the pixels of the dot and of the background round it, without its neighbours; with none where
/// nothing bright lies at the dot's place. Every second row
/// of the dot and its edge comes first, for a first look; pixels on which the edge has no effect, as far as the profile can tell,
/// come last.
pub(super) fn take_pixels<'a>(
    image: &'a GreyImage,
    profile: &Profile,
    settings: &WindowSettings,
    pixels: &mut Columns,
) -> Company {
    pixels.clear();
    let ellipse = profile.ellipse();
    let centre = settings.origin + ellipse.centre;
    let half = ellipse
        .half_extent()
        .add_scalar(settings.margin + settings.guard + 1.0);
    let first = |value: f64| value.floor().max(0.0) as usize;
    let columns = first(centre.x - half.x)..(first(centre.x + half.x) + 1).min(image.width());
    let rows = first(centre.y - half.y)..(first(centre.y + half.y) + 1).min(image.height());
    if columns.is_empty() || rows.is_empty() {
        return Company::Alone;
    }
    let width = columns.len();
    // The least whole grey value that is brighter than the level, as far as there is one.
    let least = (settings.level.floor() + 1.0).clamp(0.0, f64::from(u16::MAX)) as u16;
    let mut owners = Vec::with_capacity(width * rows.len());
    for row in rows.clone() {
        let samples = image.row(row)[columns.clone()].iter();
        owners.extend(samples.map(|&grey| match grey >= least {
            true => Owner::Neighbour,
            false => Owner::Background,
        }));
    }
    let place = |column: usize, row: usize| {
        Vector2::new(
            (columns.start + column) as f64 + 0.5,
            (rows.start + row) as f64 + 0.5,
        ) - settings.origin
    };
    let columns_within = |nested: &Nested, row: usize| {
        let first = place(0, row);
        // The first column at or beyond a place; without a call for rounding.
        let column_at = |x: f64| {
            let columns = (x - first.x).clamp(0.0, width as f64);
            let whole = columns as usize;
            whole + usize::from((whole as f64) < columns)
        };
        let reached = nested.along_row(first.y);
        reached.map_or(0..0, |[enters, leaves]| {
            column_at(enters)..column_at(leaves)
        })
    };
    let within = |level: f64| {
        let nested = Nested::at_level(&ellipse, level);
        move |row: usize| columns_within(&nested, row)
    };
    flood_dot(&mut owners, width, within(INNER), within(OUTER));
    let company = if owners.contains(&Owner::Neighbour) {
        let greys = rows
            .clone()
            .flat_map(|row| &image.row(row)[columns.clone()]);
        drop_noise(&mut owners, width, greys, settings);
        guard_neighbours(&mut owners, width, settings.guard)
    } else {
        Company::Alone
    };
    let Some(axes) = ellipse.axes() else {
        return company;
    };
    let core = axes.minor - CORE_BLURS * profile.blur();
    let stride = if core > 0.0 {
        (core / CORE_PIXELS.sqrt() * 2.0).ceil() as usize
    } else {
        1
    };
    let Some(seen) = Nested::of(&ellipse, settings.margin) else {
        return company;
    };
    let edge = Nested::of(&ellipse, f64::from(FLAT) * MORE_BLUR * profile.blur());
    let (mut between, mut far) = (Vec::new(), Vec::new());
    let inner = Nested::of(&ellipse, -CORE_BLURS * profile.blur()).filter(|_| stride > 1);
    for row in 0..rows.len() {
        let samples = &image.row(rows.start + row)[columns.clone()];
        let owners = &owners[row * width..(row + 1) * width];
        let seen = columns_within(&seen, row);
        let edge = edge.as_ref().map_or(0..0, |edge| columns_within(edge, row));
        let core = inner
            .as_ref()
            .map_or(0..0, |inner| columns_within(inner, row));
        let is_out = |column: usize| {
            let kept = || row.is_multiple_of(stride) && column.is_multiple_of(stride);
            owners[column] == Owner::Neighbour || core.contains(&column) && !kept()
        };
        let first = place(0, row);
        // Stretches between neighbours, and between core pixels that are left out.
        let stretches = |part: Range<usize>, take: &mut dyn FnMut([f32; 2], &'a [u16])| {
            let mut column = part.start;
            if company == Company::Alone && core.is_empty() && !part.is_empty() {
                let start = [(first.x + column as f64) as f32, first.y as f32];
                take(start, &samples[part]);
                return;
            }
            while column < part.end {
                let begin = column;
                while column < part.end && !is_out(column) {
                    column += 1;
                }
                let start = [(first.x + begin as f64) as f32, first.y as f32];
                take(start, &samples[begin..column]);
                while column < part.end && is_out(column) {
                    column += 1;
                }
            }
        };
        let [from, to] = [edge.start, edge.end].map(|column| column.clamp(seen.start, seen.end));
        stretches(from..to, &mut |start, greys| match row % 2 {
            0 => pixels.push_row(start, greys),
            _ => between.push((start, greys)),
        });
        for part in [seen.start..from, to..seen.end] {
            stretches(part, &mut |start, greys| far.push((start, greys)));
        }
    }
    pixels.end_coarse();
    for (start, greys) in between.into_iter().chain(far) {
        pixels.push_row(start, greys);
    }
    company
}

/// Gives the dot the bright pixels that hang together with those within `inner`, as far as `outer`: columns of a row.
fn flood_dot(
    owners: &mut [Owner],
    width: usize,
    inner: impl Fn(usize) -> Range<usize>,
    outer: impl Fn(usize) -> Range<usize>,
) {
    let height = owners.len() / width;
    let mut stack = Vec::with_capacity(owners.len());
    let (mut core, mut reach) = (Vec::with_capacity(height), Vec::with_capacity(height));
    for (row, owners) in owners.chunks(width).enumerate() {
        let bright = owners.contains(&Owner::Neighbour);
        core.push(if bright { inner(row) } else { 0..0 });
        reach.push(if bright { outer(row) } else { 0..0 });
    }
    for (row, owners) in owners.chunks_mut(width).enumerate() {
        let own = core[row].clone();
        let [above, below] = [row.wrapping_sub(1), row + 1]
            .map(|row| core.get(row).map_or([0; 2], |core| [core.start, core.end]));
        // Whatever lies beside these is within `inner` too.
        let enclosed = (own.start + 1).max(above[0]).max(below[0])
            ..own.end.saturating_sub(1).min(above[1]).min(below[1]);
        for (owner, column) in owners[own.clone()].iter_mut().zip(own) {
            if *owner == Owner::Neighbour {
                *owner = Owner::Dot;
                if !enclosed.contains(&column) {
                    stack.push((row, column));
                }
            }
        }
    }
    while let Some((row, column)) = stack.pop() {
        let neighbours = [
            (row, column.wrapping_sub(1)),
            (row, column + 1),
            (row.wrapping_sub(1), column),
            (row + 1, column),
        ];
        for (row, column) in neighbours {
            let reached = reach
                .get(row)
                .is_some_and(|columns| columns.contains(&column));
            if reached && owners[row * width + column] == Owner::Neighbour {
                owners[row * width + column] = Owner::Dot;
                stack.push((row, column));
            }
        }
    }
}

/// Gives bright pixels that stand alone back to the background where they may be noise; `greys` are those of the owners. What is
/// brighter than noise makes it may be the tip of a neighbour.
fn drop_noise<'a>(
    owners: &mut [Owner],
    width: usize,
    greys: impl Iterator<Item = &'a u16>,
    settings: &WindowSettings,
) {
    let lone = lone(owners, width);
    if lone.is_empty() {
        return;
    }
    let dark = greys
        .zip(owners.iter())
        .filter(|(_, owner)| **owner == Owner::Background);
    let (sum, count) = dark.fold((0.0, 0.0), |(sum, count), (&grey, _)| {
        (sum + f64::from(grey), count + 1.0)
    });
    if settings.level - sum / f64::max(count, 1.0) < NOISE_SIGMAS * settings.noise {
        for slot in lone {
            owners[slot] = Owner::Background;
        }
    }
}

/// Bright pixels beside which no other is.
fn lone(owners: &[Owner], width: usize) -> Vec<usize> {
    let is_lone = |slot: usize| {
        let column = slot % width;
        let beside = [
            slot.checked_sub(1).filter(|_| column > 0),
            Some(slot + 1).filter(|_| column + 1 < width),
            slot.checked_sub(width),
            Some(slot + width),
        ];
        let mut bright = beside
            .into_iter()
            .flatten()
            .filter_map(|slot| owners.get(slot));
        bright.all(|&owner| owner == Owner::Background)
    };
    let bright = (0..owners.len()).filter(|&slot| owners[slot] == Owner::Neighbour);
    bright.filter(|&slot| is_lone(slot)).collect()
}

/// Gives the neighbours the background within the guard distance, because their blurred edges reach there.
fn guard_neighbours(owners: &mut [Owner], width: usize, guard: f64) -> Company {
    let bright: Vec<usize> = (0..owners.len())
        .filter(|&slot| owners[slot] == Owner::Neighbour)
        .collect();
    if bright.is_empty() {
        return Company::Alone;
    }
    let height = owners.len() / width;
    let reach = guard.ceil() as isize;
    for slot in bright {
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let row = (slot / width) as isize + dy;
                let column = (slot % width) as isize + dx;
                let inside =
                    row >= 0 && column >= 0 && (row as usize) < height && (column as usize) < width;
                if !inside || (dx * dx + dy * dy) as f64 > guard * guard {
                    continue;
                }
                let owner = &mut owners[row as usize * width + column as usize];
                if *owner == Owner::Background {
                    *owner = Owner::Neighbour;
                }
            }
        }
    }
    Company::Neighbours
}

#[cfg(test)]
mod tests {
    use super::super::ellipse::{Axes, Ellipse};
    use super::*;
    use crate::imaging::BitDepth;

    /// A dot of 6 px in the middle of 40 x 40 px, and these pixels as bright as it.
    fn company(bright: &[[usize; 2]], noise: f64) -> Company {
        let middle = Vector2::new(20.0, 20.0);
        let mut samples = vec![10_u16; 40 * 40];
        for (slot, sample) in samples.iter_mut().enumerate() {
            let place = Vector2::new((slot % 40) as f64 + 0.5, (slot / 40) as f64 + 0.5);
            if (place - middle).norm() < 3.0 || bright.contains(&[slot % 40, slot / 40]) {
                *sample = 100;
            }
        }
        let image = GreyImage::new(40, 40, BitDepth::Eight, samples).expect("a full picture");
        let axes = Axes {
            major: 3.0,
            minor: 3.0,
            angle: 0.0,
        };
        let ellipse = Ellipse::from_axes(Vector2::zeros(), axes);
        let settings = WindowSettings {
            origin: middle,
            level: 50.0,
            margin: 5.0,
            guard: 2.5,
            noise,
        };
        let profile = Profile::new(&ellipse, 0.8, 0.0, 1.0);
        take_pixels(&image, &profile, &settings, &mut Columns::default())
    }

    #[test]
    fn a_bright_pixel_that_stands_alone_is_noise_and_two_are_a_neighbour() {
        let (noise, little) = (10.0, 1.0);
        assert_eq!(company(&[], noise), Company::Alone);
        assert_eq!(company(&[[27, 20], [12, 14]], noise), Company::Alone);
        assert_eq!(company(&[[27, 20], [27, 21]], noise), Company::Neighbours);
        assert_eq!(company(&[[27, 20]], little), Company::Neighbours);
    }
}
