//! Six-dot codes as measured dots: places and ellipses with noise, no picture.

use nalgebra::{Matrix2, Rotation2, Vector2, Vector3};
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use tiepoint::camera::{Camera, InteriorOrientation, LensDirection};
use tiepoint::geometry::Pose;
use tiepoint::targets::{
    CodeReading, DOT420_AXES, Dot, Dot420Settings, DotIndex, Family, NominalCamera, dot420_table,
    read_dot420,
};

use super::{Kind, Tally, normal};

pub(crate) const PITCH_MM: f64 = 5.0;
pub(crate) const DOT_MM: f64 = 5.0;
/// Foreign dots keep this distance from the dots of a code.
const GUARD_PITCHES: f64 = 3.0;

/// How the picture is taken and how well its dots are measured.
#[derive(Clone, Copy)]
pub(crate) struct View {
    pub(crate) incidence: f64,
    pub(crate) azimuth: f64,
    pub(crate) roll: f64,
    /// Diameter of a dot seen from the front, px.
    pub(crate) dot_px: f64,
    /// The radial distortion as a multiple of that of [`camera`].
    pub(crate) lens: f64,
    /// Where the scene's middle is seen, as a share of the picture's half width and half height from its centre.
    pub(crate) aside: [f64; 2],
}

impl View {
    pub(crate) fn random(random: &mut ChaCha8Rng, incidence_deg: f64, dot_px: f64) -> Self {
        Self {
            incidence: incidence_deg.to_radians(),
            azimuth: random.random_range(0.0..std::f64::consts::TAU),
            roll: random.random_range(0.0..std::f64::consts::TAU),
            dot_px,
            lens: 1.0,
            aside: [
                random.random_range(-0.6..0.6),
                random.random_range(-0.6..0.6),
            ],
        }
    }

    /// At incidences up to 70 degrees, with dots of 5 to 25 px.
    pub(crate) fn any(random: &mut ChaCha8Rng) -> Self {
        let incidence = random.random_range(0.0..70.0);
        let dot_px = random.random_range(5.0..25.0);
        Self::random(random, incidence, dot_px)
    }
}

/// A wide-angle camera of six megapixels whose lens errs by 20 px and more in the corners.
pub(crate) fn camera(lens: f64) -> Camera {
    Camera {
        width_px: 3072,
        height_px: 2048,
        pixel_pitch_mm: 0.009,
        interior: InteriorOrientation {
            principal_distance: 20.0,
            principal_point: [0.1, -0.05],
            radial: [1.5e-4 * lens, -4e-7 * lens, 2e-10 * lens],
            tangential: [1e-5, -2e-5],
            affinity: [1e-4, -5e-5],
            direction: LensDirection::Correcting,
        },
    }
}

/// What a user knows of that camera: a principal distance that is 8 % off, and the size of the picture.
fn settings() -> Dot420Settings {
    Dot420Settings {
        camera: Some(NominalCamera {
            principal_distance_px: 2400.0,
            principal_point_px: [1536.0, 1024.0],
            principal_distance_share: 0.1,
        }),
        ..Dot420Settings::default()
    }
}

/// A pose that sees `middle` (mm on the plane z = 0) at the wanted place.
pub(crate) fn pose(middle: Vector2<f64>, view: &View) -> Pose {
    let camera = camera(view.lens);
    let c_px = camera.interior.principal_distance / camera.pixel_pitch_mm;
    let distance = DOT_MM * c_px / view.dot_px;
    let (st, ct) = view.incidence.sin_cos();
    let (sa, ca) = view.azimuth.sin_cos();
    let target = Vector3::new(middle.x, middle.y, 0.0);
    let centre = target + Vector3::new(st * ca, st * sa, ct) * distance;
    // The camera aims past the target, which keeps the incidence and moves the image off the axis.
    let toward = (target - centre) / distance;
    let side = toward.cross(&Vector3::new(0.3, 1.0, 0.1)).normalize();
    let half = Vector2::new(
        f64::from(camera.width_px) / 2.0,
        f64::from(camera.height_px) / 2.0,
    ) / c_px;
    let off = side * (view.aside[0] * half.x) + side.cross(&toward) * (view.aside[1] * half.y);
    Pose::looking_at(
        centre,
        centre + (toward + off) * distance,
        Vector3::new(0.3, 1.0, 0.1),
        view.roll,
    )
}

/// Places on the plane (mm) of a code's six dots (number from 1), its O at `origin`, turned by `turn`.
pub(crate) fn code_places(id: u32, origin: Vector2<f64>, turn: f64) -> Vec<Vector2<f64>> {
    let rotation = Rotation2::new(turn);
    DOT420_AXES
        .iter()
        .chain(&dot420_table()[id as usize - 1])
        .map(|&[x, y]| origin + rotation * Vector2::new(f64::from(x), f64::from(y)) * PITCH_MM)
        .collect()
}

/// A disc on the plane: a target, or something like one.
#[derive(Clone, Copy)]
pub(crate) struct Disc {
    pub(crate) place: Vector2<f64>,
    pub(crate) diameter_mm: f64,
}

impl Disc {
    pub(crate) fn target(place: Vector2<f64>) -> Self {
        Self {
            place,
            diameter_mm: DOT_MM,
        }
    }
}

/// The image of a disc as detection measures it: the area moments of its outline, with noise; `None` outside the picture.
///
/// A centre is good to 0.03 px where the smaller diameter is 7 px, as its square root; diameters to 2 % and 0.05 px.
fn measured(camera: &Camera, pose: &Pose, disc: &Disc, random: &mut ChaCha8Rng) -> Option<Dot> {
    const CORNERS: usize = 20;
    let corner = |k: usize| {
        let (s, c) = (std::f64::consts::TAU * k as f64 / CORNERS as f64).sin_cos();
        let rim = disc.place + Vector2::new(c, s) * (disc.diameter_mm / 2.0);
        let pixel = camera.project(&pose.camera_from_point(&Vector3::new(rim.x, rim.y, 0.0)))?;
        camera.contains(&pixel).then_some(pixel)
    };
    let rim: Vec<Vector2<f64>> = (0..CORNERS).map(corner).collect::<Option<_>>()?;
    let base = rim[0];
    let (mut area, mut first, mut second) = (0.0, Vector2::zeros(), Matrix2::zeros());
    for k in 0..CORNERS {
        let (p, q) = (rim[k] - base, rim[(k + 1) % CORNERS] - base);
        let w = p.perp(&q) / 2.0;
        let both = p + q;
        area += w;
        first += both * (w / 3.0);
        second += (p * p.transpose() + q * q.transpose() + both * both.transpose()) * (w / 12.0);
    }
    let middle: Vector2<f64> = first / area;
    let moments: Matrix2<f64> = second / area - middle * middle.transpose();
    // Eigenvalues of the moments are a quarter of the squared semi-axes.
    let half_trace = moments.trace() / 2.0;
    let spread = (half_trace * half_trace - moments.determinant())
        .max(0.0)
        .sqrt();
    let direction = 0.5 * (2.0 * moments[(0, 1)]).atan2(moments[(0, 0)] - moments[(1, 1)]);
    let mut diameter = |moment: f64| {
        let d = 4.0 * moment.max(0.0).sqrt();
        d + (0.02 * d).hypot(0.05) * normal(random)
    };
    let (d1, d2) = (diameter(half_trace + spread), diameter(half_trace - spread));
    let sigma_px = 0.08 / d2.max(1.0).sqrt();
    let off = Vector2::new(normal(random), normal(random)) * sigma_px;
    let turned = if d2 > d1 {
        std::f64::consts::FRAC_PI_2
    } else {
        0.0
    };
    Some(Dot {
        centre_px: base + middle + off,
        sigma_px: sigma_px * random.random_range(0.7..1.2),
        major_px: d1.max(d2),
        minor_px: d1.min(d2),
        angle: (direction + turned).rem_euclid(std::f64::consts::PI),
        contrast: 150.0 * (1.0 + 0.1 * normal(random)).max(0.3),
        background: 20.0,
    })
}

/// Targets thrown at random onto a square of half side `half_mm` round `middle`: at least 3 pitches from every place of
/// `keep_off`, at least two diameters from each other.
pub(crate) fn thrown(
    keep_off: &[Vector2<f64>],
    middle: Vector2<f64>,
    half_mm: f64,
    tries: usize,
    random: &mut ChaCha8Rng,
) -> Vec<Vector2<f64>> {
    let mut places: Vec<Vector2<f64>> = Vec::new();
    for _ in 0..tries {
        let shift = Vector2::new(
            random.random_range(-half_mm..half_mm),
            random.random_range(-half_mm..half_mm),
        );
        let place = middle + shift;
        let free = |others: &[Vector2<f64>], least: f64| {
            others.iter().all(|other| (other - place).norm() >= least)
        };
        if free(keep_off, GUARD_PITCHES * PITCH_MM) && free(&places, 2.0 * DOT_MM) {
            places.push(place);
        }
    }
    places
}

/// A scene of codes among other targets.
#[derive(Clone, Default)]
pub(crate) struct Scene {
    /// Number and the six discs of each code; hidden dots are `None`.
    pub(crate) codes: Vec<(u32, [Option<Disc>; 6])>,
    pub(crate) others: Vec<Disc>,
}

impl Scene {
    pub(crate) fn with_code(mut self, id: u32, places: &[Vector2<f64>]) -> Self {
        let discs = std::array::from_fn(|k| Some(Disc::target(places[k])));
        self.codes.push((id, discs));
        self
    }

    pub(crate) fn with_targets(mut self, places: &[Vector2<f64>]) -> Self {
        self.others.extend(places.iter().copied().map(Disc::target));
        self
    }

    /// Hides `count` of a code's dots.
    pub(crate) fn hide(&mut self, code: usize, count: usize, random: &mut ChaCha8Rng) {
        for k in rand::seq::index::sample(random, 6, count) {
            self.codes[code].1[k] = None;
        }
    }

    /// Photographs the scene so that `middle` is seen in its place, reads it and compares with truth.
    fn trial(&self, middle: Vector2<f64>, view: &View, random: &mut ChaCha8Rng) -> Tally {
        let (dots, truth) = self.photographed(middle, view, random);
        judge(&read_dot420(&dots, &settings()).codes, &truth)
    }

    /// The dots in the picture by rows, as detection gives them, and the codes that are whole.
    fn photographed(
        &self,
        middle: Vector2<f64>,
        view: &View,
        random: &mut ChaCha8Rng,
    ) -> (Vec<Dot>, Vec<(u32, Vec<DotIndex>)>) {
        let (camera, pose) = (camera(view.lens), pose(middle, view));
        let own = self
            .codes
            .iter()
            .enumerate()
            .flat_map(|(code, (_, discs))| {
                discs
                    .iter()
                    .enumerate()
                    .filter_map(move |(k, disc)| Some((Some((code, k)), (*disc)?)))
            });
        let others = self.others.iter().map(|disc| (None, *disc));
        let mut seen: Vec<(Option<(usize, usize)>, Dot)> = own
            .chain(others)
            .filter_map(|(role, disc)| Some((role, measured(&camera, &pose, &disc, random)?)))
            .collect();
        seen.sort_by(|a, b| a.1.centre_px.y.total_cmp(&b.1.centre_px.y));
        let place_of = |code: usize, k: usize| {
            let index = seen.iter().position(|(role, _)| *role == Some((code, k)))?;
            Some(DotIndex(index as u32))
        };
        let truth = (0..self.codes.len())
            .filter_map(|code| {
                let dots = (0..6).map(|k| place_of(code, k)).collect::<Option<_>>()?;
                Some((self.codes[code].0, dots))
            })
            .collect();
        (seen.into_iter().map(|(_, dot)| dot).collect(), truth)
    }
}

/// Counts readings against the codes that were shown whole.
pub(crate) fn judge(readings: &[CodeReading], truth: &[(u32, Vec<DotIndex>)]) -> Tally {
    let mut tally = Tally {
        shown: truth.len(),
        ..Tally::default()
    };
    for reading in readings {
        let right = truth
            .iter()
            .any(|(id, dots)| *id == reading.id && *dots == reading.dots);
        let counter = match (right, &reading.doubt) {
            (true, None) => &mut tally.read,
            (true, Some(_)) => &mut tally.doubtful,
            (false, None) => &mut tally.wrong,
            (false, Some(_)) => &mut tally.wrong_doubtful,
        };
        *counter += 1;
    }
    tally
}

/// A code at a random turn, and the middle of its square.
pub(crate) fn any_code(random: &mut ChaCha8Rng) -> (u32, Vec<Vector2<f64>>, Vector2<f64>) {
    let id = random.random_range(1..=420);
    let turn = random.random_range(0.0..std::f64::consts::TAU);
    let places = code_places(id, Vector2::zeros(), turn);
    let middle = (places[1] + places[2]) / 2.0;
    (id, places, middle)
}

fn clean(random: &mut ChaCha8Rng, view: &View) -> Tally {
    let (id, places, middle) = any_code(random);
    Scene::default()
        .with_code(id, &places)
        .trial(middle, view, random)
}

/// A code among plain targets, `tries` of them thrown onto 150 x 150 mm, with `hidden` of its dots hidden.
fn in_field(random: &mut ChaCha8Rng, tries: usize, hidden: usize) -> Tally {
    let (id, places, middle) = any_code(random);
    let others = thrown(&places, middle, 75.0, tries, random);
    let mut scene = Scene::default()
        .with_code(id, &places)
        .with_targets(&others);
    scene.hide(0, hidden, random);
    let view = View::any(random);
    scene.trial(middle, &view, random)
}

/// Bright things of other sizes round a code, as near as its own dots allow.
fn in_clutter(random: &mut ChaCha8Rng) -> Tally {
    let (id, places, middle) = any_code(random);
    let mut scene = Scene::default().with_code(id, &places);
    for _ in 0..40 {
        let place = middle
            + Vector2::new(
                random.random_range(-40.0..40.0),
                random.random_range(-40.0..40.0),
            );
        let clear = |p: &Vector2<f64>, least: f64| (p - place).norm() > least;
        if places.iter().all(|p| clear(p, 1.6 * DOT_MM))
            && scene.others.iter().all(|o| clear(&o.place, 1.6 * DOT_MM))
        {
            scene.others.push(Disc {
                place,
                diameter_mm: DOT_MM * random.random_range(0.4..1.6),
            });
        }
    }
    let hidden = random.random_range(0..=2);
    scene.hide(0, hidden, random);
    let view = View::any(random);
    scene.trial(middle, &view, random)
}

/// Plain targets only, thrown at random or in rows with holes.
fn plain_targets(random: &mut ChaCha8Rng, rows: bool) -> Tally {
    let mut places = Vec::new();
    if rows {
        let spacing: [f64; 2] = std::array::from_fn(|_| random.random_range(10.0..30.0));
        let square = random.random_range(0..2) == 0;
        // Whole and half pitches are the likeliest to make codes.
        let [dx, dy] = spacing.map(|s: f64| (s / 2.5).round() * 2.5);
        let dy = if square { dx } else { dy };
        let holes = random.random_range(0.0..0.7);
        for i in -6..=6 {
            for j in -6..=6 {
                if random.random_range(0.0..1.0) >= holes {
                    places.push(Vector2::new(f64::from(i) * dx, f64::from(j) * dy));
                }
            }
        }
    } else {
        places = thrown(&[], Vector2::zeros(), 75.0, 300, random);
    }
    let view = View::any(random);
    let scene = Scene::default().with_targets(&places);
    scene.trial(Vector2::zeros(), &view, random)
}

/// Four codes side by side, 3 pitches from each other's dots at least; `hidden` dots of each of two codes are hidden.
fn side_by_side(random: &mut ChaCha8Rng, hidden: usize) -> Tally {
    let mut scene = Scene::default();
    let mut taken: Vec<Vector2<f64>> = Vec::new();
    let mut numbers = rand::seq::index::sample(random, 420, 4).into_iter();
    for cell in 0..4_i32 {
        let id = numbers.next().map_or(1, |n| n as u32 + 1);
        for _ in 0..60 {
            let turn = random.random_range(0.0..std::f64::consts::TAU);
            let own = code_places(id, Vector2::zeros(), turn);
            let middle = (own[1] + own[2]) / 2.0;
            let wanted = Vector2::new(f64::from(cell % 2) - 0.5, f64::from(cell / 2) - 0.5) * 36.0
                + Vector2::new(
                    random.random_range(-9.0..9.0),
                    random.random_range(-9.0..9.0),
                );
            let places: Vec<Vector2<f64>> = own.iter().map(|p| p - middle + wanted).collect();
            let apart = |p: &Vector2<f64>| {
                taken
                    .iter()
                    .all(|t| (t - p).norm() >= GUARD_PITCHES * PITCH_MM)
            };
            if places.iter().all(apart) {
                taken.extend(&places);
                scene = scene.with_code(id, &places);
                break;
            }
        }
    }
    for code in 0..scene.codes.len().min(2) {
        scene.hide(code, hidden, random);
    }
    let view = View::any(random);
    scene.trial(Vector2::zeros(), &view, random)
}

/// A code in a corner of the picture, under twice the lens distortion.
fn under_distortion(random: &mut ChaCha8Rng) -> Tally {
    let (id, places, middle) = any_code(random);
    let mut view = View::any(random);
    view.lens = 2.0;
    let side = |random: &mut ChaCha8Rng| {
        let sign = if random.random_range(0..2) == 0 {
            -1.0
        } else {
            1.0
        };
        sign * random.random_range(0.6..0.85)
    };
    view.aside = [side(random), side(random)];
    Scene::default()
        .with_code(id, &places)
        .trial(middle, &view, random)
}

pub(crate) fn kinds() -> Vec<Kind> {
    let kind = |name: String, trial: Box<dyn Fn(&mut ChaCha8Rng) -> Tally + Sync>| {
        Kind::new(Family::Dot420, name, trial)
    };
    let mut kinds = Vec::new();
    for dot_px in [6.0, 10.0, 20.0] {
        for incidence in [0.0, 20.0, 40.0, 60.0, 70.0] {
            kinds.push(kind(
                format!("clean {incidence:.0} deg {dot_px:.0} px"),
                Box::new(move |random| {
                    let view = View::random(random, incidence, dot_px);
                    clean(random, &view)
                }),
            ));
        }
    }
    kinds.push(kind("lens".into(), Box::new(under_distortion)));
    kinds.push(kind("clutter".into(), Box::new(in_clutter)));
    for (name, tries) in [("sparse", 10), ("dense", 60), ("crowded", 400)] {
        kinds.push(kind(
            format!("field {name}"),
            Box::new(move |random| in_field(random, tries, 0)),
        ));
        kinds.push(kind(
            format!("cover in field {name}"),
            Box::new(move |random| {
                let hidden = 1 + usize::from(random.random_range(0..4) == 0);
                in_field(random, tries, hidden)
            }),
        ));
    }
    kinds.push(kind(
        "cover".into(),
        Box::new(|random| {
            let hidden = random.random_range(1..=3);
            in_field(random, 0, hidden)
        }),
    ));
    kinds.push(kind(
        "plain thrown".into(),
        Box::new(|r| plain_targets(r, false)),
    ));
    kinds.push(kind(
        "plain rows".into(),
        Box::new(|r| plain_targets(r, true)),
    ));
    kinds.push(kind(
        "side by side".into(),
        Box::new(|r| side_by_side(r, 0)),
    ));
    kinds.push(kind(
        "side by side, cover".into(),
        Box::new(|r| side_by_side(r, 1)),
    ));
    kinds
}
