//! Six-dot codes in rendered pictures, through the whole of detection: what the simulation of dots is held against.

use nalgebra::Vector2;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use tiepoint::targets::{DetectSettings, Detections, Dot, DotIndex, Family, detect};

use super::picture::{Exposure, Shade, picture};
use super::plane_view::PlaneView;
use super::six_dots::{DOT_MM, PITCH_MM, any_code, judge, thrown};
use super::{Kind, Tally};

/// A code, some of its dots hidden, among targets thrown onto the picture.
fn trial(
    random: &mut ChaCha8Rng,
    [incidence_deg, dot_px]: [f64; 2],
    tries: usize,
    hidden: usize,
) -> Tally {
    let (id, places, middle) = any_code(random);
    let px_per_mm = dot_px / DOT_MM;
    let side = (12.0 * PITCH_MM * px_per_mm).ceil() as usize;
    let half_mm = 6.0 * PITCH_MM;
    let others = thrown(&places, middle, half_mm, tries, random);
    let gone = rand::seq::index::sample(random, 6, hidden).into_vec();
    let view = PlaneView::new(
        Vector2::repeat(side as f64 / 2.0),
        px_per_mm,
        [
            0.0,
            incidence_deg.to_radians(),
            random.random_range(0.0..std::f64::consts::PI),
        ],
        random.random_range(600.0..1500.0),
    );
    let standing = places.iter().enumerate().filter(|(k, _)| !gone.contains(k));
    let discs: Vec<Vector2<f64>> = standing
        .map(|(_, place)| place - middle)
        .chain(others.iter().map(|place| place - middle))
        .collect();
    let light = random.random_range(100.0..200.0);
    let shade = |px: Vector2<f64>| {
        let plane = view.plane(px);
        let lit = discs
            .iter()
            .position(|disc| (plane - disc).norm_squared() < DOT_MM * DOT_MM / 4.0);
        Shade {
            part: lit.map_or(0, |disc| disc as u32 + 1),
            grey: if lit.is_some() { light } else { 12.0 },
        }
    };
    let image = picture([side; 2], shade, &Exposure::default(), random);
    let found = detect(&image, &[Family::Dot420], &DetectSettings::default());
    if hidden > 0 {
        return judge(&found.codes, &[]);
    }
    let dots = places
        .iter()
        .map(|place| dot_at(&found, view.px(place - middle)));
    // A code of which a dot was not found is shown, and cannot be read.
    let dots = dots.collect::<Option<Vec<DotIndex>>>().unwrap_or_default();
    judge(&found.codes, &[(id, dots)])
}

fn dot_at(found: &Detections, px: Vector2<f64>) -> Option<DotIndex> {
    let near = |dot: &Dot| (dot.centre_px - px).norm() < dot.minor_px / 2.0;
    found.dots.iter().position(near).map(|k| DotIndex(k as u32))
}

/// The kinds of six-dot codes that are rendered.
pub(crate) fn kinds() -> Vec<Kind> {
    let mut kinds = Vec::new();
    for incidence in [0.0, 40.0, 60.0, 70.0] {
        let name = format!("rendered, clean {incidence:.0} deg 10 px");
        kinds.push(Kind::new(Family::Dot420, name, move |r| {
            trial(r, [incidence, 10.0], 0, 0)
        }));
    }
    kinds.push(Kind::new(Family::Dot420, "rendered, field dense", |r| {
        let view = [r.random_range(0.0..65.0), r.random_range(7.0..14.0)];
        trial(r, view, 60, 0)
    }));
    kinds.push(Kind::new(
        Family::Dot420,
        "rendered, cover in field dense",
        |r| {
            let view = [r.random_range(0.0..65.0), r.random_range(7.0..14.0)];
            trial(r, view, 60, 1)
        },
    ));
    kinds
}
