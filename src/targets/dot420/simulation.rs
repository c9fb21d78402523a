//! Readings of simulated pictures with known truth.

use nalgebra::{Matrix2, Vector2, Vector3};
use rand::RngExt as _;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use super::{Dot420Settings, NominalCamera, read_dot420};
use crate::camera::Camera;
use crate::camera::fixture::wide_angle_camera;
use crate::geometry::Pose;
use crate::targets::{CodeReading, DOT420_AXES, Dot, DotIndex, dot420_number, dot420_table};

const PITCH_MM: f64 = 5.0;
const DOT_MM: f64 = 5.0;

/// How the picture is taken and how well its dots are measured.
#[derive(Clone, Copy)]
struct View {
    tilt: f64,
    azimuth: f64,
    roll: f64,
    /// Diameter of a dot seen from the front, px.
    dot_px: f64,
    /// Standard deviation of a centre's coordinate, px.
    noise_px: f64,
    /// Standard deviation of the diameters, share.
    axis_noise: f64,
}

impl View {
    fn random(random: &mut ChaCha8Rng, tilt: f64, dot_px: f64) -> Self {
        Self {
            tilt,
            azimuth: random.random_range(0.0..std::f64::consts::TAU),
            roll: random.random_range(0.0..std::f64::consts::TAU),
            dot_px,
            noise_px: 0.03,
            axis_noise: 0.03,
        }
    }
}

/// Places on the plane z = 0 (mm): the six dots of a code (number from 1), its O at `origin`, turned by `turn`.
fn code_places(id: u32, origin: Vector2<f64>, turn: f64) -> Vec<Vector2<f64>> {
    let rotation = nalgebra::Rotation2::new(turn);
    DOT420_AXES
        .iter()
        .chain(&dot420_table()[id as usize - 1])
        .map(|&[x, y]| origin + rotation * Vector2::new(f64::from(x), f64::from(y)) * PITCH_MM)
        .collect()
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (
        random.random_range(1e-300..1.0),
        random.random_range(0.0..1.0),
    );
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// The dots of the places that lie in the picture; `aim` (mm on the plane) is seen at the middle.
fn photograph(
    places: &[Vector2<f64>],
    aim: Vector2<f64>,
    view: &View,
    random: &mut ChaCha8Rng,
) -> Vec<Option<Dot>> {
    let camera = wide_angle_camera();
    let distance =
        DOT_MM * camera.interior.principal_distance / (camera.pixel_pitch_mm * view.dot_px);
    let (st, ct) = view.tilt.sin_cos();
    let (sa, ca) = view.azimuth.sin_cos();
    let target = Vector3::new(aim.x, aim.y, 0.0);
    let centre = target + Vector3::new(st * ca, st * sa, ct) * distance;
    let pose = Pose::looking_at(centre, target, Vector3::new(0.3, 1.0, 0.0), view.roll);
    places
        .iter()
        .map(|place| dot_at(&camera, &pose, *place, view, random))
        .collect()
}

/// Area moments of the projected circle, with noise.
fn dot_at(
    camera: &Camera,
    pose: &Pose,
    place: Vector2<f64>,
    view: &View,
    random: &mut ChaCha8Rng,
) -> Option<Dot> {
    const CORNERS: usize = 24;
    let corner = |k: usize| {
        let (s, c) = (std::f64::consts::TAU * k as f64 / CORNERS as f64).sin_cos();
        let rim = place + Vector2::new(c, s) * (DOT_MM / 2.0);
        let pixel = camera.project(&pose.camera_from_point(&Vector3::new(rim.x, rim.y, 0.0)))?;
        camera.contains(&pixel).then_some(pixel)
    };
    let rim: Vec<Vector2<f64>> = (0..CORNERS).map(corner).collect::<Option<_>>()?;
    let base = rim[0];
    let (mut area, mut first, mut second) = (0.0, Vector2::zeros(), Matrix2::zeros());
    for k in 0..CORNERS {
        let (p, q) = (rim[k] - base, rim[(k + 1) % CORNERS] - base);
        let w = p.perp(&q) / 2.0;
        area += w;
        first += (p + q) * (w / 3.0);
        let both = p + q;
        second += (p * p.transpose() + q * q.transpose() + both * both.transpose()) * (w / 12.0);
    }
    let middle: Vector2<f64> = first / area;
    let moments: Matrix2<f64> = second / area - middle * middle.transpose();
    let eigen = moments.symmetric_eigen();
    let (large, small) = if eigen.eigenvalues[0] >= eigen.eigenvalues[1] {
        (0, 1)
    } else {
        (1, 0)
    };
    let direction = eigen.eigenvectors.column(large).into_owned();
    // Moments of an ellipse are a quarter of its squared semi-axes.
    let mut diameter =
        |i: usize| 4.0 * eigen.eigenvalues[i].sqrt() * (1.0 + view.axis_noise * normal(random));
    let (d1, d2) = (diameter(large), diameter(small));
    let angle = direction.y.atan2(direction.x)
        + if d2 > d1 {
            std::f64::consts::FRAC_PI_2
        } else {
            0.0
        };
    Some(Dot {
        centre_px: base + middle + Vector2::new(normal(random), normal(random)) * view.noise_px,
        sigma_px: view.noise_px,
        major_px: d1.max(d2),
        minor_px: d1.min(d2),
        angle: angle.rem_euclid(std::f64::consts::PI),
        contrast: 150.0,
        background: 20.0,
    })
}

/// Plain targets thrown at random onto a square of half side `half_mm` round the middle of the code: at least 3 pitches from
/// each of `codes`, at least two diameters from each other.
fn plain_places(
    codes: &[Vector2<f64>],
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
        let free = codes.iter().all(|c| (c - place).norm() >= 3.0 * PITCH_MM)
            && places.iter().all(|p| (p - place).norm() >= 2.0 * DOT_MM);
        if free {
            places.push(place);
        }
    }
    places
}

/// Counts over many scenes.
#[derive(Debug, Default)]
struct Tally {
    scenes: usize,
    read: usize,
    read_with_doubt: usize,
    wrong_dots: usize,
    /// Readings that are no code of the scene, without and with a doubt.
    false_certain: usize,
    false_doubtful: usize,
    plain_dots: usize,
}

impl Tally {
    /// Counts the readings of a scene whose only code `id` (0: none) has the dots `truth`.
    fn count(&mut self, codes: &[CodeReading], id: u32, truth: &[DotIndex]) {
        self.scenes += 1;
        for code in codes {
            let shared = code.dots.iter().filter(|d| truth.contains(d)).count();
            if code.id == id && code.dots == truth {
                self.read += 1;
                self.read_with_doubt += usize::from(code.doubt.is_some());
            } else if code.id == id && shared == 6 {
                self.wrong_dots += 1;
            } else if code.doubt.is_none() {
                self.false_certain += 1;
            } else {
                self.false_doubtful += 1;
            }
        }
    }
}

/// The dots that were imaged, shuffled by a fixed stride, and where the first six went; `None` unless all six are there.
fn shuffled(seen: Vec<Option<Dot>>, code_dots: usize) -> Option<(Vec<Dot>, Vec<DotIndex>)> {
    let n = seen.len();
    let stride = (1..).find(|s| s * 7 > n && gcd(*s, n) == 1)?;
    let mut dots = Vec::new();
    let mut truth = vec![None; code_dots];
    for k in 0..n {
        let from = k * stride % n;
        if let Some(dot) = &seen[from] {
            if from < code_dots {
                truth[from] = Some(DotIndex(dots.len() as u32));
            }
            dots.push(dot.clone());
        }
    }
    Some((dots, truth.into_iter().collect::<Option<_>>()?))
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// One scene: a code, `tries` plain targets thrown round it, the code's dot `missing` hidden.
fn code_scene(tally: &mut Tally, seed: u64, tries: usize, missing: Option<usize>) {
    code_scene_by(&Dot420Settings::default(), tally, seed, tries, missing);
}

fn code_scene_by(
    settings: &Dot420Settings,
    tally: &mut Tally,
    seed: u64,
    tries: usize,
    missing: Option<usize>,
) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let id = seed as u32 % 420 + 1;
    let tilt = random.random_range(0.0..70_f64.to_radians());
    let dot_px = random.random_range(5.0..25.0);
    let view = View::random(&mut random, tilt, dot_px);
    let turn = random.random_range(0.0..6.3);
    let code = code_places(id, Vector2::new(10.0, -20.0), turn);
    let middle = (code[1] + code[2]) / 2.0;
    let reach = if tries > 0 { 12.0 } else { 40.0 };
    let aim = middle
        + Vector2::new(
            random.random_range(-reach..reach),
            random.random_range(-reach..reach),
        );
    let plain = plain_places(&code, middle, 75.0, tries, &mut random);
    let mut places = code;
    places.extend(plain);
    let mut seen = photograph(&places, aim, &view, &mut random);
    if let Some(missing) = missing {
        seen[missing] = None;
        let (dots, _) = shuffled(seen, 0).unwrap();
        tally.plain_dots += dots.len() - 5;
        let reading = read_dot420(&dots, settings);
        tally.count(&reading.codes, 0, &[]);
        return;
    }
    let Some((dots, truth)) = shuffled(seen, 6) else {
        return;
    };
    tally.plain_dots += dots.len() - 6;
    let reading = read_dot420(&dots, settings);
    tally.count(&reading.codes, id, &truth);
}

/// A field of plain targets at `spacing` mm (two directions), each left out with probability `holes`.
fn grid_scene(tally: &mut Tally, seed: u64, spacing: [f64; 2], holes: f64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let tilt = random.random_range(0.0..70_f64.to_radians());
    let dot_px = random.random_range(5.0..25.0);
    let view = View::random(&mut random, tilt, dot_px);
    let mut places = Vec::new();
    for i in -7..=7 {
        for j in -7..=7 {
            if random.random_range(0.0..1.0) >= holes {
                places.push(Vector2::new(
                    f64::from(i) * spacing[0],
                    f64::from(j) * spacing[1],
                ));
            }
        }
    }
    let seen = photograph(&places, Vector2::zeros(), &view, &mut random);
    let (dots, _) = shuffled(seen, 0).unwrap();
    tally.plain_dots += dots.len();
    let codes = read_dot420(&dots, &Dot420Settings::default()).codes;
    tally.count(&codes, 0, &[]);
}

/// Every code once, at tilts up to 70 degrees, any roll, dots of 5 to 25 px.
#[test]
fn every_code_is_read_at_any_obliquity() {
    let mut tally = Tally::default();
    for seed in 0..420 {
        code_scene(&mut tally, seed, 0, None);
    }
    assert!(tally.scenes >= 415, "{tally:?}");
    assert!(tally.read * 100 >= tally.scenes * 99, "{tally:?}");
    assert!(tally.read_with_doubt * 100 <= tally.scenes, "{tally:?}");
    assert_eq!(
        (tally.wrong_dots, tally.false_certain + tally.false_doubtful),
        (0, 0),
        "{tally:?}"
    );
}

#[test]
fn codes_are_read_in_dense_fields_and_no_plain_targets_are() {
    let mut tally = Tally::default();
    for seed in 0..60 {
        code_scene(
            &mut tally,
            1000 + 7 * seed,
            if seed % 4 == 0 { 400 } else { 60 },
            None,
        );
    }
    assert!(tally.read * 100 >= tally.scenes * 98, "{tally:?}");
    assert_eq!((tally.wrong_dots, tally.false_certain), (0, 0), "{tally:?}");
}

/// A plain target that stands where the hidden dot would make another code, to within the noise, cannot be told by its
/// place: such a reading carries a doubt.
#[test]
fn a_code_with_a_hidden_dot_gets_no_other_number_without_a_doubt() {
    let mut tally = Tally::default();
    for seed in 0..600 {
        code_scene(&mut tally, 5000 + seed, 60, Some(seed as usize % 6));
    }
    assert_eq!(tally.false_certain, 0, "{tally:?}");
}

/// A principal distance known to a tenth binds the perspective, and so leaves a plain target less room to pass for a dot.
#[test]
fn a_known_camera_takes_doubts_away() {
    let camera = wide_angle_camera();
    let unknown = Dot420Settings {
        rival_chance: 1e-4,
        ..Dot420Settings::default()
    };
    let known = Dot420Settings {
        camera: Some(NominalCamera {
            principal_distance_px: 0.93 * camera.interior.principal_distance
                / camera.pixel_pitch_mm,
            principal_point_px: [camera.width_px, camera.height_px].map(|n| 0.5 * f64::from(n)),
            principal_distance_share: 0.1,
        }),
        ..unknown.clone()
    };
    let run = |settings: &Dot420Settings| {
        let mut tally = Tally::default();
        for seed in 0..200 {
            code_scene_by(settings, &mut tally, 9000 + seed, 15, None);
        }
        tally
    };
    let (without, with) = (run(&unknown), run(&known));
    assert_eq!(with.read, with.scenes, "{with:?}");
    assert!(
        4 * with.read_with_doubt < 3 * without.read_with_doubt,
        "{without:?} {with:?}"
    );
    assert_eq!(with.false_certain, 0, "{with:?}");
}

#[test]
fn plain_targets_in_rows_are_no_certain_codes() {
    for spacing in [
        [10.0, 10.0],
        [15.0, 15.0],
        [20.0, 20.0],
        [30.0, 30.0],
        [10.0, 15.0],
    ] {
        for holes in [0.0, 0.4] {
            let mut tally = Tally::default();
            for seed in 0..4 {
                grid_scene(&mut tally, 77 + seed, spacing, holes);
            }
            assert_eq!(tally.false_certain, 0, "{spacing:?} {tally:?}");
        }
    }
}

/// With holes such rows look like codes now and then.
#[test]
fn rows_at_two_and_a_half_pitches_make_no_certain_codes() {
    let mut tally = Tally::default();
    for seed in 0..12 {
        grid_scene(&mut tally, 77 + seed, [12.5, 12.5], 0.4);
    }
    assert_eq!(tally.false_certain, 0, "{tally:?}");
}

fn upright(random: &mut ChaCha8Rng) -> View {
    View::random(random, 0.6, 12.0)
}

/// The mirror image of a code is the code with x and y exchanged, never itself.
#[test]
fn a_mirrored_code_is_not_read_as_itself() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    for id in (1..=420).step_by(20) {
        let places: Vec<Vector2<f64>> = code_places(id, Vector2::zeros(), 0.3)
            .iter()
            .map(|p| Vector2::new(-p.x, p.y))
            .collect();
        let view = upright(&mut random);
        let (dots, truth) =
            shuffled(photograph(&places, places[0], &view, &mut random), 6).unwrap();
        let reading = read_dot420(&dots, &Dot420Settings::default());
        let swapped = dot420_table()[id as usize - 1].map(|[x, y]| [y, x]);
        assert_eq!(reading.codes.len(), 1);
        assert_eq!(
            Some(reading.codes[0].id),
            dot420_number(swapped),
            "mirror of {id}"
        );
        assert_eq!(reading.codes[0].dots[..3], [truth[0], truth[2], truth[1]]);
    }
}

#[test]
fn a_number_read_twice_is_doubted_at_both_places() {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let mut places = code_places(17, Vector2::zeros(), 0.0);
    places.extend(code_places(17, Vector2::new(45.0, 5.0), 0.2));
    places.extend(code_places(300, Vector2::new(0.0, 60.0), -0.1));
    let view = upright(&mut random);
    let aim = Vector2::new(35.0, 35.0);
    let (dots, truth) = shuffled(photograph(&places, aim, &view, &mut random), 18).unwrap();
    let codes = read_dot420(&dots, &Dot420Settings::default()).codes;
    let ids: Vec<u32> = codes.iter().map(|c| c.id).collect();
    assert_eq!(ids, [17, 17, 300]);
    assert!(
        codes[..2]
            .iter()
            .all(|c| c.doubt.as_ref().is_some_and(|d| d.contains("2 times")))
    );
    assert_eq!(codes[2].doubt, None);
    assert_eq!(codes[2].dots, truth[12..]);
}

#[test]
fn a_bent_code_is_refused_with_a_reason() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut places = code_places(100, Vector2::zeros(), 0.0);
    places[4] += Vector2::new(0.5, 0.3);
    let view = upright(&mut random);
    let (dots, _) = shuffled(photograph(&places, places[0], &view, &mut random), 6).unwrap();
    let reading = read_dot420(&dots, &Dot420Settings::default());
    assert_eq!(reading.codes, []);
    assert_eq!(reading.rejected.len(), 1, "{:?}", reading.rejected);
    assert!(
        reading.rejected[0].reason.contains("C100"),
        "{:?}",
        reading.rejected
    );
}

#[test]
fn unusable_dots_are_passed_over() {
    let broken = |x: f64, major_px: f64| Dot {
        centre_px: Vector2::new(x, 5.0),
        sigma_px: 0.03,
        major_px,
        minor_px: 3.0,
        angle: 0.0,
        contrast: 0.0,
        background: 0.0,
    };
    let dots = [
        broken(f64::NAN, 5.0),
        broken(1.0, f64::INFINITY),
        broken(2.0, 1.0),
        broken(1e300, 4.0),
    ];
    let reading = read_dot420(&dots, &Dot420Settings::default());
    assert_eq!(reading.codes, []);
    assert_eq!(read_dot420(&[], &Dot420Settings::default()).codes, []);
}
