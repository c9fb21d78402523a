//! Small networks for the tests, and the displacing lens written down once more.

use nalgebra::{Rotation3, Vector2, Vector3};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{
    DatumPoints, Known, NamedText, PlainCamera, PlainDatum, PlainDistance, PlainImage,
    PlainNetwork, PlainObservation, PlainParameter, PlainPoint, PointRole, from_json, to_json,
};
use crate::adjustment::{ResidualPlane, Sharing};
use crate::camera::LensDirection;
use crate::geometry::Pose;
use crate::network::{BarRole, Expansion};

/// Two images of four points, one of them known, and a distance.
pub(crate) fn small_network() -> PlainNetwork {
    let pose = |x: f64| {
        Pose::looking_at(
            Vector3::new(x, 0.0, 1000.0),
            Vector3::zeros(),
            Vector3::y(),
            0.3,
        )
    };
    let image = |name: &str, x| PlainImage {
        name: name.into(),
        camera: 0,
        start: Some(pose(x)),
    };
    let mut points: Vec<PlainPoint> = [
        [0.0, 0.0, 0.0],
        [100.0, 0.0, 10.0],
        [0.0, 100.0, 5.0],
        [90.0, 90.0, 0.0],
    ]
    .into_iter()
    .enumerate()
    .map(|(index, at)| PlainPoint::new(format!("P{}", index + 1), Some(at)))
    .collect();
    points[3].known = [90.0, 90.0, 0.0].map(|value_mm| {
        Some(Known {
            value_mm,
            sigma_mm: Some(0.1),
        })
    });
    points[3].role = PointRole::Control;
    PlainNetwork {
        cameras: vec![PlainCamera {
            name: "A".into(),
            width_px: 4000,
            height_px: 3000,
            pixel_pitch_mm: 0.005,
            lens: LensDirection::Correcting,
            values: [24.0, 0.1, -0.05, 1e-4, -2e-7, 0.0, 1e-5, -2e-5, 1e-4, 0.0],
            parameters: [PlainParameter::Free; 10],
            sharing: [Sharing::Camera; 10],
        }],
        images: vec![image("left", -300.0), image("right", 300.0)],
        points,
        observations: (0..8)
            .map(|k| PlainObservation {
                image: k / 4,
                point: k % 4,
                x_px: 2000.0 + 100.0 * k as f64,
                y_px: 1500.5,
                sigma_px: 0.05,
            })
            .collect(),
        distances: vec![PlainDistance {
            name: "bar".into(),
            from: 0,
            to: 1,
            length_mm: 100.5,
            sigma_mm: 0.01,
            role: BarRole::Control,
            expansion: None,
        }],
        datum: PlainDatum::Control,
        residuals: ResidualPlane::Measured,
        object: None,
    }
}

/// Eight images round thirty points, without noise, a distance, all starts.
pub(crate) fn network(direction: LensDirection) -> PlainNetwork {
    let places = places();
    imaged(lens(direction), &places, &ring_poses(&places))
}

/// A camera whose parameters are all fixed.
pub(super) fn lens(direction: LensDirection) -> PlainCamera {
    PlainCamera {
        name: "A".into(),
        width_px: 4000,
        height_px: 3000,
        pixel_pitch_mm: 0.005,
        lens: direction,
        values: [24.0, 0.05, -0.03, 1e-4, -1e-7, 0.0, 1e-6, 2e-6, 1e-4, 0.0],
        parameters: [PlainParameter::Fixed; 10],
        sharing: [Sharing::Camera; 10],
    }
}

/// Thirty places on three levels, 450 x 440 x 120 mm.
pub(crate) fn places() -> Vec<Vector3<f64>> {
    let number = |k: usize, n: usize| (k % n) as f64;
    (0..30)
        .map(|k| {
            Vector3::new(
                90.0 * number(k, 6),
                110.0 * number(k / 6, 5),
                40.0 * number(k, 4),
            )
        })
        .collect()
}

/// Eight poses on a circle above the places, turned about their axes in turn.
pub(super) fn ring_poses(places: &[Vector3<f64>]) -> Vec<Pose> {
    let middle = places.iter().sum::<Vector3<f64>>() / places.len() as f64;
    (0..8)
        .map(|image| {
            let around = std::f64::consts::TAU * f64::from(image) / 8.0;
            let from = middle + Vector3::new(500.0 * around.cos(), 500.0 * around.sin(), 900.0);
            Pose::looking_at(from, middle, Vector3::y(), 1.6 * f64::from(image))
        })
        .collect()
}

/// All places in all images without noise, with true starts, and the distance of the first place from the last.
pub(super) fn imaged(camera: PlainCamera, places: &[Vector3<f64>], poses: &[Pose]) -> PlainNetwork {
    let mut observations = Vec::new();
    for (image, pose) in poses.iter().enumerate() {
        for (point, place) in places.iter().enumerate() {
            let pixel = camera.camera().project(&pose.camera_from_point(place));
            let pixel = pixel.unwrap();
            observations.push(PlainObservation {
                image,
                point,
                x_px: pixel.x,
                y_px: pixel.y,
                sigma_px: 0.1,
            });
        }
    }
    let image = |(k, pose): (usize, &Pose)| PlainImage {
        name: format!("I{k}"),
        camera: 0,
        start: Some(*pose),
    };
    let point = |(k, place): (usize, &Vector3<f64>)| {
        PlainPoint::new(format!("P{k}"), Some((*place).into()))
    };
    let last = places.len() - 1;
    PlainNetwork {
        cameras: vec![camera],
        images: poses.iter().enumerate().map(image).collect(),
        points: places.iter().enumerate().map(point).collect(),
        observations,
        distances: vec![PlainDistance {
            name: "bar".into(),
            from: 0,
            to: last,
            length_mm: (places[last] - places[0]).norm(),
            sigma_mm: 0.01,
            role: BarRole::Control,
            expansion: None,
        }],
        datum: PlainDatum::InnerConstraints(DatumPoints::All),
        residuals: ResidualPlane::Measured,
        object: None,
    }
}

/// A network of numbers that mean nothing but are allowed, with every kind of entry.
pub(super) fn random_network(seed: u64) -> PlainNetwork {
    let random = &mut ChaCha8Rng::seed_from_u64(seed);
    // Sums of powers of ten give mantissas of all lengths and exponents from -12 to 4.
    fn number(random: &mut impl Rng) -> f64 {
        match random.random_range(0..8) {
            0 => -0.0,
            1 => random.random_range(-1e4..1e4),
            _ => random.random_range(-1.0..1.0) * 10f64.powi(random.random_range(-12..4)),
        }
    }
    fn size(random: &mut impl Rng) -> f64 {
        number(random).abs() + 1e-9
    }
    fn body(random: &mut impl Rng) -> Option<Expansion> {
        (random.random_range(0..2) > 0).then(|| Expansion {
            per_k: random.random_range(-5e-4..5e-4),
            temperature_c: random.random_range(-50.0..90.0),
            reference_c: random.random_range(-50.0..90.0),
        })
    }
    let mut network = small_network();
    network.cameras = (0..random.random_range(1..4))
        .map(|k| PlainCamera {
            name: format!("camera \"{k}\" \u{e9}"),
            width_px: random.random_range(1..9000),
            height_px: random.random_range(1..9000),
            pixel_pitch_mm: size(random),
            lens: match random.random_range(0..2) {
                0 => LensDirection::Correcting,
                _ => LensDirection::Displacing {
                    balanced_radius_mm: size(random),
                },
            },
            values: std::array::from_fn(|index| match index {
                0 => size(random),
                _ => number(random),
            }),
            parameters: std::array::from_fn(|_| match random.random_range(0..3) {
                0 => PlainParameter::Fixed,
                1 => PlainParameter::Free,
                _ => PlainParameter::Weighted {
                    sigma: size(random),
                },
            }),
            sharing: [Sharing::Camera; 10],
        })
        .collect();
    for camera in &mut network.cameras {
        for (parameter, sharing) in camera.parameters.iter().zip(&mut camera.sharing) {
            if *parameter != PlainParameter::Fixed && random.random_range(0..3) == 0 {
                *sharing = Sharing::Image;
            }
        }
    }
    for image in &mut network.images {
        image.camera = random.random_range(0..network.cameras.len());
        let turn = Vector3::from_fn(|_, _| random.random_range(-2.0..2.0));
        image.start = (random.random_range(0..3) > 0).then(|| Pose {
            camera_from_world: Rotation3::new(turn),
            centre_in_world: Vector3::from_fn(|_, _| number(random)),
        });
    }
    for point in &mut network.points[..3] {
        point.start = (random.random_range(0..2) > 0).then(|| [0; 3].map(|_| number(random)));
        if random.random_range(0..2) > 0 {
            point.role = PointRole::Check;
            point.known = [0; 3].map(|_| None);
            point.known[1] = Some(Known {
                value_mm: number(random),
                sigma_mm: None,
            });
        }
    }
    if random.random_range(0..2) > 0 {
        network.points[3].correlations = [0; 3].map(|_| random.random_range(-0.5..0.5));
    }
    for observation in &mut network.observations {
        observation.x_px = number(random);
        observation.y_px = number(random);
        if random.random_range(0..3) == 0 {
            observation.sigma_px = size(random);
        }
    }
    network.distances[0].length_mm = 10.0 + size(random);
    network.distances[0].expansion = body(random);
    network.object = body(random);
    network.residuals =
        [ResidualPlane::Measured, ResidualPlane::Corrected][random.random_range(0..2)];
    network.datum = match random.random_range(0..3) {
        0 => PlainDatum::Control,
        1 => PlainDatum::InnerConstraints(DatumPoints::All),
        _ => PlainDatum::InnerConstraints(DatumPoints::Listed(vec![3, 0, 2])),
    };
    network
}

/// Writes a network as JSON and reads it back.
pub(super) fn assert_comes_back(network: &PlainNetwork) {
    let text = to_json(network).unwrap();
    let back = from_json(NamedText {
        file: "net.json",
        text: &text,
    });
    assert_eq!(back.as_ref(), Ok(network));
}

/// The measured image point (mm from the image centre) of an ideal one of a displacing lens, term by term as [`LensDirection`]
/// writes it.
pub(super) fn displaced(camera: &PlainCamera, ideal: &Vector2<f64>) -> Vector2<f64> {
    let [_, x0, y0, k1, k2, k3, p1, p2, b1, b2] = camera.values;
    let (r0, is_last) = match camera.lens {
        LensDirection::Displacing { balanced_radius_mm } => (balanced_radius_mm, false),
        LensDirection::DisplacingAffinityLast => (0.0, true),
        other => panic!("{other:?} is no displacing lens"),
    };
    let (x, y) = (ideal.x, ideal.y);
    let r2 = x * x + y * y;
    let f =
        k1 * (r2 - r0.powi(2)) + k2 * (r2.powi(2) - r0.powi(4)) + k3 * (r2.powi(3) - r0.powi(6));
    let distorted = Vector2::new(
        x + x * f + p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y,
        y + y * f + p2 * (r2 + 2.0 * y * y) + 2.0 * p1 * x * y,
    );
    let stretched = if is_last { distorted } else { *ideal };
    Vector2::new(
        x0 + distorted.x + b1 * stretched.x + b2 * stretched.y,
        y0 + distorted.y,
    )
}

/// The ideal image point (mm from the principal point) of a world point.
pub(super) fn ideal(camera: &PlainCamera, pose: &Pose, point: [f64; 3]) -> Vector2<f64> {
    let k = pose.camera_from_point(&Vector3::from(point));
    Vector2::new(k.x, k.y) * (-camera.values[0] / k.z)
}

/// The root of the mean square over the coordinates of residuals.
pub(super) fn rms(residuals: &[Vector2<f64>]) -> f64 {
    let sum: f64 = residuals.iter().map(Vector2::norm_squared).sum();
    (sum / (2.0 * residuals.len() as f64)).sqrt()
}
