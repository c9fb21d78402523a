//! The pixels round a dot that a fit may use.

use nalgebra::Vector2;

use super::columns::Columns;
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
}

/// Interior pixels farther from the edge than this many blurs tell of the amplitude alone and are thinned out.
const CORE_BLURS: f64 = 4.0;
/// About this many of them are kept.
const CORE_PIXELS: f64 = 300.0;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Owner {
    Background,
    Dot,
    Neighbour,
}

/// Fills the columns with the pixels of the dot and of the background round it, without its neighbours; with none where
/// nothing bright lies at the dot's place.
pub(super) fn take_pixels(
    image: &GreyImage,
    profile: &Profile,
    settings: &WindowSettings,
    pixels: &mut Columns,
) {
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
        return;
    }
    let width = columns.len();
    let mut owners = vec![Owner::Background; width * rows.len()];
    for (index, row) in rows.clone().enumerate() {
        let samples = &image.row(row)[columns.clone()];
        for (owner, &grey) in owners[index * width..].iter_mut().zip(samples) {
            if f64::from(grey) > settings.level {
                *owner = Owner::Neighbour;
            }
        }
    }
    let place = |column: usize, row: usize| {
        Vector2::new(
            (columns.start + column) as f64 + 0.5,
            (rows.start + row) as f64 + 0.5,
        ) - settings.origin
    };
    flood_dot(&mut owners, width, |column, row| {
        ellipse.level(place(column, row))
    });
    guard_neighbours(&mut owners, width, settings.guard);

    let Some(axes) = ellipse.axes() else {
        return;
    };
    let core = axes.minor - CORE_BLURS * profile.blur();
    let stride = if core > 0.0 {
        (core / CORE_PIXELS.sqrt() * 2.0).ceil() as usize
    } else {
        1
    };
    let Some(seen) = Nested::of(&ellipse, settings.margin) else {
        return;
    };
    let inner = Nested::of(&ellipse, -CORE_BLURS * profile.blur()).filter(|_| stride > 1);
    for row in 0..rows.len() {
        let samples = &image.row(rows.start + row)[columns.clone()];
        let owners = &owners[row * width..(row + 1) * width];
        let first = place(0, row);
        let Some(reached) = seen.along_row(first.y) else {
            continue;
        };
        let column_at = |x: f64| (x - first.x).ceil().clamp(0.0, width as f64) as usize;
        let mut column = column_at(reached[0]);
        let end = column_at(reached[1]);
        // Stretches between neighbours, and between core pixels that are left out.
        let core = inner.as_ref().and_then(|inner| inner.along_row(first.y));
        let core = core.map_or(width..width, |core| column_at(core[0])..column_at(core[1]));
        let is_out = |column: usize| {
            let kept = row.is_multiple_of(stride) && column.is_multiple_of(stride);
            let thinned = core.contains(&column) && !kept;
            thinned || owners[column] == Owner::Neighbour
        };
        while column < end {
            let begin = column;
            while column < end && !is_out(column) {
                column += 1;
            }
            let start = [(first.x + begin as f64) as f32, first.y as f32];
            pixels.push_row(start, &samples[begin..column]);
            while column < end && is_out(column) {
                column += 1;
            }
        }
    }
}

/// Gives the dot the bright pixels that hang together with those inside its ellipse's inner half.
fn flood_dot(owners: &mut [Owner], width: usize, level: impl Fn(usize, usize) -> f64) {
    const INNER: f64 = 0.7;
    /// The dot's own pixels end here; what hangs together with it farther out is a neighbour that touches it.
    const OUTER: f64 = 1.6;
    let mut stack = Vec::new();
    for (row, owners) in owners.chunks(width).enumerate() {
        for (column, &owner) in owners.iter().enumerate() {
            if owner == Owner::Neighbour && level(column, row) < INNER {
                stack.push(row * width + column);
            }
        }
    }
    for &slot in &stack {
        owners[slot] = Owner::Dot;
    }
    while let Some(slot) = stack.pop() {
        let column = slot % width;
        let neighbours = [
            (column > 0).then(|| slot - 1),
            (column + 1 < width).then_some(slot + 1),
            slot.checked_sub(width),
            (slot + width < owners.len()).then_some(slot + width),
        ];
        for next in neighbours.into_iter().flatten() {
            if owners[next] == Owner::Neighbour && level(next % width, next / width) < OUTER {
                owners[next] = Owner::Dot;
                stack.push(next);
            }
        }
    }
}

/// Gives the neighbours the background within the guard distance, because their blurred edges reach there.
fn guard_neighbours(owners: &mut [Owner], width: usize, guard: f64) {
    let bright: Vec<usize> = (0..owners.len())
        .filter(|&slot| owners[slot] == Owner::Neighbour)
        .collect();
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
}
