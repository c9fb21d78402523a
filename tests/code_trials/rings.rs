//! Ring codes in small pictures: clean, covered, among other light, beside each other.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector2;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use tiepoint::targets::{DetectSettings, Family, detect, ring_table};

use super::picture::{Exposure, Shade, developed, still};
use super::plane_view::PlaneView;
use super::{Kind, Tally};

/// Something before the targets, in the picture's pixels.
struct Cover {
    shape: CoverShape,
    grey: f64,
}

enum CoverShape {
    /// Everything farther than `offset` along `normal`.
    Half {
        normal: Vector2<f64>,
        offset: f64,
    },
    /// A strip of this width.
    Strip {
        normal: Vector2<f64>,
        offset: f64,
        width: f64,
    },
    Disc {
        middle: Vector2<f64>,
        radius: f64,
    },
}

impl CoverShape {
    fn hides(&self, px: Vector2<f64>) -> bool {
        match self {
            Self::Half { normal, offset } => normal.dot(&px) > *offset,
            Self::Strip {
                normal,
                offset,
                width,
            } => (0.0..*width).contains(&(normal.dot(&px) - offset)),
            Self::Disc { middle, radius } => (px - middle).norm() < *radius,
        }
    }
}

/// A sector of a ring that is dark or light instead of what it should be: from `start`, `width` segments.
#[derive(Clone, Copy)]
struct Sector {
    start: f64,
    width: f64,
    light: bool,
}

#[derive(Clone)]
struct Ring {
    view: PlaneView,
    segments: u8,
    bits: u32,
    id: u32,
    sector: Option<Sector>,
}

impl Ring {
    fn any(segments: u8, view: PlaneView, random: &mut ChaCha8Rng) -> Self {
        let table = ring_table(segments);
        let index = random.random_range(0..table.len());
        Self {
            view,
            segments,
            bits: table[index],
            id: index as u32 + 1,
            sector: None,
        }
    }

    /// Which part of the target is seen at a pixel, from 1, and whether it is light; `None` on the ground round it.
    fn part(&self, px: Vector2<f64>) -> Option<(u32, bool)> {
        let plane = self.view.plane(px);
        let squared = plane.norm_squared();
        if squared < 1.0 {
            return Some((1, true));
        }
        if !(4.0..9.0).contains(&squared) {
            return None;
        }
        let count = u32::from(self.segments);
        // Clockwise as seen, from the plane's x axis.
        let turn = (-plane.y).atan2(plane.x).rem_euclid(TAU) / TAU * f64::from(count);
        let segment = (turn as u32).min(count - 1);
        if let Some(sector) = &self.sector
            && (turn - sector.start).rem_euclid(f64::from(count)) < sector.width
        {
            return Some((2 + count + segment, sector.light));
        }
        let light = (self.bits >> (count - 1 - segment)) & 1 == 1;
        Some((2 + segment, light))
    }
}

/// Grey values of ground and targets.
#[derive(Clone, Copy)]
struct Light {
    ground: f64,
    target: f64,
}

impl Light {
    fn any(random: &mut ChaCha8Rng) -> Self {
        Self {
            ground: random.random_range(8.0..40.0),
            target: random.random_range(100.0..220.0),
        }
    }
}

struct Scene {
    size: [usize; 2],
    rings: Vec<Ring>,
    /// Light discs: middle and radius, px.
    discs: Vec<(Vector2<f64>, f64)>,
    covers: Vec<Cover>,
    light: Light,
}

impl Scene {
    /// One code in the middle of a picture that holds it with some room.
    fn of_one(segments: u8, incidence_deg: f64, dot_px: f64, random: &mut ChaCha8Rng) -> Self {
        let radius = dot_px / 2.0;
        let side = ((8.0 * radius).ceil() as usize + 8).max(48);
        let view = view_at(
            Vector2::repeat(side as f64 / 2.0),
            radius,
            incidence_deg,
            random,
        );
        Self {
            size: [side; 2],
            rings: vec![Ring::any(segments, view, random)],
            discs: Vec::new(),
            covers: Vec::new(),
            light: Light::any(random),
        }
    }

    fn shade(&self, px: Vector2<f64>) -> Shade {
        /// More than a ring has parts.
        const PARTS: u32 = 100;
        if let Some(cover) = self.covers.iter().find(|cover| cover.shape.hides(px)) {
            return Shade {
                part: 1,
                grey: cover.grey,
            };
        }
        let grey = |light| {
            if light {
                self.light.target
            } else {
                self.light.ground
            }
        };
        let discs = self.discs.iter();
        let disc = discs
            .zip(2..)
            .find(|((m, r), _)| (px - m).norm_squared() < r * r);
        if let Some((_, part)) = disc {
            return Shade {
                part,
                grey: grey(true),
            };
        }
        let rings = self.rings.iter().zip(1..);
        let seen = rings
            .filter_map(|(ring, k)| ring.part(px).map(|(part, light)| (k * PARTS + part, light)))
            .next();
        let (part, light) = seen.unwrap_or((0, false));
        Shade {
            part,
            grey: grey(light),
        }
    }

    fn trial(&self, random: &mut ChaCha8Rng) -> Tally {
        let exposure = Exposure::default();
        let still = still(self.size, |px| self.shade(px), &exposure);
        let image = developed(self.size, &still, &exposure, random);
        let families = [Family::Ring(self.rings[0].segments)];
        let found = detect(&image, &families, &DetectSettings::default());
        let mut tally = Tally {
            shown: self.rings.len(),
            ..Tally::default()
        };
        for code in &found.codes {
            let centre = found.dots[code.dots[0].slot()].centre_px;
            let here = |ring: &&Ring| ring.view.plane(centre).norm() < 0.5;
            let ring = self.rings.iter().find(here);
            let right = ring.is_some_and(|ring| ring.id == code.id);
            let counter = match (right, &code.doubt) {
                (true, None) => &mut tally.read,
                (true, Some(_)) => &mut tally.doubtful,
                (false, None) if ring.is_some_and(|ring| self.shows(&still, ring, code.id)) => {
                    &mut tally.same_picture
                }
                (false, None) => &mut tally.wrong,
                (false, Some(_)) => &mut tally.wrong_doubtful,
            };
            *counter += 1;
        }
        tally
    }

    /// Whether the picture without noise, within 3.5 radii of the code's dot, is the one of another number at the same place. It
    /// is where the two differ by less than noise tells from nothing (chi-square), or where the means of 3 x 3 pixels differ nowhere
    /// by more than film and print may be uneven and noise strong together: a reader that refused this would refuse real codes.
    fn shows(&self, still: &[f64], ring: &Ring, id: u32) -> bool {
        /// Five standard deviations of the noise, for a reader who knows what to look for.
        const CHI_SQUARE: f64 = 25.0;
        /// Unevenness of what is dark, and of what is at least half light, shares of the contrast.
        const DARK: f64 = 0.05;
        const LIGHT: f64 = 0.12;
        /// Noise of the mean, in standard deviations.
        const SIGMAS: f64 = 5.0;
        let exposure = Exposure::default();
        let [width, height] = self.size;
        let contrast = self.light.target - self.light.ground;
        let pattern = ring_table(ring.segments)[id as usize - 1];
        let n = ring.segments;
        (0..n).any(|turn| {
            let mask = (1_u32 << n) - 1;
            let other = Ring {
                bits: ((pattern << turn) | (pattern >> (n - turn))) & mask,
                sector: None,
                ..ring.clone()
            };
            let alone = Scene {
                rings: vec![other],
                discs: Vec::new(),
                covers: Vec::new(),
                ..*self
            };
            let picture = super::picture::still(self.size, |px| alone.shade(px), &exposure);
            let off = |column: usize, row: usize| {
                let slot = row * width + column;
                let middle = Vector2::new(column as f64 + 0.5, row as f64 + 0.5);
                let near = ring.view.plane(middle).norm() < 3.5;
                if near {
                    still[slot] - picture[slot]
                } else {
                    0.0
                }
            };
            let (mut chi_square, mut even) = (0.0, true);
            for row in 1..height - 1 {
                for column in 1..width - 1 {
                    chi_square += (off(column, row) / exposure.noise).powi(2);
                    let around: f64 = (0..9)
                        .map(|k| off(column + k % 3 - 1, row + k / 3 - 1))
                        .sum();
                    let share = (picture[row * width + column] - self.light.ground) / contrast;
                    let uneven = DARK + (LIGHT - DARK) * (2.0 * share).min(1.0);
                    even &=
                        (around / 9.0).abs() < uneven * contrast + SIGMAS * exposure.noise / 3.0;
                }
            }
            even || chi_square < CHI_SQUARE
        })
    }
}

fn view_at(
    middle: Vector2<f64>,
    radius: f64,
    incidence_deg: f64,
    random: &mut ChaCha8Rng,
) -> PlaneView {
    let off = Vector2::new(random.random_range(0.0..1.0), random.random_range(0.0..1.0));
    let angles = [
        random.random_range(0.0..TAU),
        incidence_deg.to_radians(),
        random.random_range(0.0..PI),
    ];
    PlaneView::new(
        middle + off,
        radius,
        angles,
        random.random_range(120.0..400.0),
    )
}

/// A code at an incidence up to 60 degrees, its dot 9 to 16 px across; larger by half for twenty segments.
fn of_any(segments: u8, random: &mut ChaCha8Rng) -> (Scene, f64) {
    let incidence = random.random_range(0.0..60.0);
    let finer = if segments == 20 { 1.5 } else { 1.0 };
    let dot_px = random.random_range(9.0..16.0) * finer;
    (
        Scene::of_one(segments, incidence, dot_px, random),
        dot_px / 2.0,
    )
}

/// A hand, a cable, a tape before part of the ring, never before the dot.
fn covered(
    segments: u8,
    grey: impl Fn(Light, &mut ChaCha8Rng) -> f64,
    random: &mut ChaCha8Rng,
) -> Tally {
    let (mut scene, radius) = of_any(segments, random);
    let middle = scene.rings[0].view.px(Vector2::zeros());
    let direction = random.random_range(0.0..TAU);
    let normal = Vector2::new(direction.cos(), direction.sin());
    let reach = random.random_range(1.2..2.9) * radius;
    let shape = match random.random_range(0..3) {
        0 => CoverShape::Half {
            normal,
            offset: normal.dot(&middle) + reach,
        },
        1 => CoverShape::Strip {
            normal,
            offset: normal.dot(&middle) + reach,
            width: random.random_range(0.5..2.5) * radius,
        },
        _ => {
            let size = random.random_range(0.7..3.0) * radius;
            CoverShape::Disc {
                middle: middle + normal * (reach + size),
                radius: size,
            }
        }
    };
    let grey = grey(scene.light, random);
    scene.covers.push(Cover { shape, grey });
    scene.trial(random)
}

/// A sector of the ring alone is dark or light instead of what it should be.
fn sector(segments: u8, width: [f64; 2], whole: bool, random: &mut ChaCha8Rng) -> Tally {
    let (mut scene, _) = of_any(segments, random);
    let start = random.random_range(0.0..f64::from(segments));
    let width = random.random_range(width[0]..=width[1]);
    let light = random.random_range(0..2) == 0;
    scene.rings[0].sector = Some(Sector {
        start: if whole { start.floor() } else { start },
        width: if whole { width.round() } else { width },
        light,
    });
    scene.trial(random)
}

/// Light discs of about the dot's size beside and over the ring.
fn cluttered(segments: u8, random: &mut ChaCha8Rng) -> Tally {
    let (mut scene, radius) = of_any(segments, random);
    let middle = scene.rings[0].view.px(Vector2::zeros());
    for _ in 0..random.random_range(1..=5) {
        let direction = random.random_range(0.0..TAU);
        let size = random.random_range(0.4..1.3) * radius;
        let away = size + random.random_range(1.2..3.5) * radius;
        scene.discs.push((
            middle + Vector2::new(direction.cos(), direction.sin()) * away,
            size,
        ));
    }
    scene.trial(random)
}

/// Two codes whose rings nearly touch.
fn side_by_side(segments: u8, random: &mut ChaCha8Rng) -> Tally {
    let incidence = random.random_range(0.0..60.0);
    let radius = random.random_range(4.5..7.0) * if segments == 20 { 1.5 } else { 1.0 };
    let mut scene = Scene::of_one(segments, incidence, 2.0 * radius, random);
    let [width, height] = scene.size;
    let step = random.random_range(6.3..7.5) * radius;
    scene.size = [width + step.ceil() as usize, height];
    let middle = Vector2::new(width as f64 / 2.0 + step, height as f64 / 2.0);
    let tilt = random.random_range(0.0..60.0);
    let view = view_at(middle, radius, tilt, random);
    let second = Ring::any(segments, view, random);
    if second.id != scene.rings[0].id {
        scene.rings.push(second);
    }
    scene.trial(random)
}

/// A code where the lens changes the scale by up to 4 % across it.
fn under_distortion(segments: u8, random: &mut ChaCha8Rng) -> Tally {
    let (mut scene, radius) = of_any(segments, random);
    let direction = random.random_range(0.0..TAU);
    let bend = Vector2::new(direction.cos(), direction.sin())
        * (random.random_range(0.0..0.04) / (6.0 * radius));
    let ring = scene.rings.remove(0);
    scene.rings.push(Ring {
        view: ring.view.bent(bend),
        ..ring
    });
    scene.trial(random)
}

/// The kinds of a ring family.
pub(crate) fn kinds(segments: u8) -> Vec<Kind> {
    let family = Family::Ring(segments);
    let mut kinds = Vec::new();
    let sizes = if segments == 20 {
        [10.0, 12.0, 14.0, 20.0]
    } else {
        [8.0, 10.0, 12.0, 14.0]
    };
    for dot_px in sizes {
        for incidence in [0.0, 20.0, 40.0, 60.0, 70.0] {
            let name = format!("clean {incidence:.0} deg {dot_px:.0} px");
            kinds.push(Kind::new(family, name, move |random| {
                Scene::of_one(segments, incidence, dot_px, random).trial(random)
            }));
        }
    }
    kinds.push(Kind::new(family, "lens", move |r| {
        under_distortion(segments, r)
    }));
    kinds.push(Kind::new(family, "clutter", move |r| {
        cluttered(segments, r)
    }));
    kinds.push(Kind::new(family, "side by side", move |r| {
        side_by_side(segments, r)
    }));
    kinds.push(Kind::new(family, "one segment changed", move |r| {
        sector(segments, [1.0, 1.0], true, r)
    }));
    kinds.push(Kind::new(family, "part of a ring changed", move |r| {
        sector(segments, [0.3, 4.0], false, r)
    }));
    kinds.push(Kind::new(family, "cover, its own grey", move |r| {
        covered(
            segments,
            |light, r| light.ground + signed(r, 8.0..60.0, light.ground),
            r,
        )
    }));
    kinds.push(Kind::new(family, "cover, light", move |r| {
        covered(
            segments,
            |light, r| light.target * r.random_range(0.3..1.0),
            r,
        )
    }));
    kinds.push(Kind::new(family, "cover, the ground's grey", move |r| {
        covered(segments, |light, _| light.ground, r)
    }));
    kinds
}

/// A difference within `range`, downward half of the time where that leaves a grey value.
fn signed(random: &mut ChaCha8Rng, range: std::ops::Range<f64>, above: f64) -> f64 {
    let size = random.random_range(range);
    if size < above && random.random_range(0..2) == 0 {
        -size
    } else {
        size
    }
}
