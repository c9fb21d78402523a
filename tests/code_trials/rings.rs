//! Ring codes in small pictures: clean, covered, among other light, beside each other.

use std::f64::consts::TAU;

use nalgebra::Vector2;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use tiepoint::targets::Family;

use super::ring_scene::{Cover, CoverShape, Light, Ring, Scene, Sector, view_at};
use super::{Kind, Tally};

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
    let [start, width] = if whole {
        [start.floor(), width.round()]
    } else {
        [start, width]
    };
    scene.rings[0].sector = Some(Sector::new(segments, start, width, light));
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

/// Plain targets alone: thrown, or standing round one of them as the segments of a code would, each there or not.
fn plain(segments: u8, random: &mut ChaCha8Rng) -> Tally {
    let (mut scene, radius) = of_any(segments, random);
    let view = scene.rings.remove(0).view;
    let middle = view.px(Vector2::zeros());
    let reach = 0.5 * scene.size[0] as f64;
    if random.random_range(0..2) == 0 {
        scene.discs.push((middle, radius));
        let places = random.random_range(6..=24);
        let begin = random.random_range(0.0..TAU);
        let away = random.random_range(2.1..2.9);
        let size = random.random_range(0.3..0.8) * radius;
        for place in 0..places {
            if random.random_range(0..3) > 0 {
                let direction = begin + TAU * f64::from(place) / f64::from(places);
                let seen = view.px(Vector2::new(direction.cos(), direction.sin()) * away);
                scene.discs.push((seen, size));
            }
        }
    } else {
        for _ in 0..random.random_range(3..30) {
            let place = Vector2::from_fn(|_, _| random.random_range(-reach..reach));
            let size = random.random_range(0.5..1.3) * radius;
            let apart = |(other, other_size): &(Vector2<f64>, f64)| {
                (other - middle - place).norm() > 1.1 * (size + other_size)
            };
            if scene.discs.iter().all(apart) {
                scene.discs.push((middle + place, size));
            }
        }
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
    kinds.push(Kind::new(family, "plain", move |r| plain(segments, r)));
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
