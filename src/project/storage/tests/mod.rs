//! Laws of the project file: [`keeping`] what was saved, [`damage`], [`writers`] side by side. Here are the samples.

mod damage;
mod keeping;
mod writers;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use nalgebra::{Matrix3, Matrix6, Rotation3, SMatrix, Vector2, Vector3};

use super::{Opened, StorageError, Store};
use crate::camera::{Camera, InteriorOrientation, LensDirection};
use crate::geometry::Pose;
use crate::network::*;
use crate::targets::{CodeEvidence, CodeReading, Detections, Dot, DotIndex, Family, Rejected};

/// A folder that goes when the test ends.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("tiepoint-storage-{}-{number}", std::process::id());
        let path = std::env::temp_dir().join(name);
        fs::create_dir_all(&path).unwrap();
        Self(path.canonicalize().unwrap())
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(&self.0)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// A network in which every kind of number comes from `next`.
fn network(images: u32, mut next: impl FnMut() -> f64) -> Network {
    let mut n = Network::default();
    let camera = Camera {
        width_px: 4000,
        height_px: 3000,
        pixel_pitch_mm: next(),
        interior: InteriorOrientation {
            principal_distance: next(),
            principal_point: [next(), next()],
            radial: [next(), next(), next()],
            tangential: [next(), next()],
            affinity: [next(), next()],
            direction: LensDirection::Correcting,
        },
    };
    let entry = CameraEntry {
        name: "Kamera \"ü\"".into(),
        nominal: camera.clone(),
        camera,
        known_sigmas: [
            None,
            Some(next()),
            None,
            None,
            None,
            None,
            None,
            None,
            None,
            None,
        ],
        parameters: std::array::from_fn(|index| match index % 3 {
            0 => LensParameter::Automatic,
            1 => LensParameter::Free,
            _ => LensParameter::Held,
        }),
        stated: StatedScale {
            pitch: true,
            distance: false,
        },
        source: InteriorSource::Exif,
        exif_model: Some("X'); DROP TABLE images; --".into()),
    };
    n.cameras = Arc::new([(CameraId(0), Arc::new(entry))].into());
    let images = (0..images).map(|id| (ImageId(id), Arc::new(image(id, &mut next))));
    n.images = Arc::new(images.collect());
    let points = [
        PointId::Target(7),
        PointId::Device(0),
        PointId::of_code(Family::Dot420, 17)[3],
        PointId::of_code(Family::Ring(14), 57)[0],
    ];
    let points = points.map(|id| {
        let point = Point {
            position: Vector3::from_fn(|_, _| next()),
            covariance: Some(Matrix3::from_fn(|_, _| next())),
            rays: 3,
            circle: None,
        };
        (id, Arc::new(point))
    });
    n.points = Arc::new(points.into());
    n.names = Arc::new([(7, "1001 \"é\"".to_owned())].into());
    n.device = Arc::new(vec![DevicePoint {
        label: "X1".into(),
        position_mm: [next(), next(), next()],
    }]);
    n.scale_bars = Arc::new(vec![ScaleBar {
        name: "bar".into(),
        from: "C17.O".into(),
        to: "M7".into(),
        length_mm: next(),
        sigma_mm: next(),
        role: BarRole::Check,
        expansion: Some(Expansion {
            per_k: next(),
            temperature_c: next(),
            reference_c: next(),
        }),
    }]);
    n.control = Arc::new(vec![ControlPoint {
        label: "M7".into(),
        coordinates_mm: [Some(next()), None, Some(next())],
        sigmas_mm: [None, None, Some(next())],
        role: ControlRole::Weighted,
    }]);
    n.connection_order = Arc::new(n.images.keys().rev().copied().collect());
    n.passes = Arc::new(vec![IdentificationPass {
        expected_dots: 4,
        basis: u64::MAX,
        labelled: 1,
        remaining: 2,
        points: 3,
        sigma_station_mm: next(),
    }]);
    n.conclusions = BTreeMap::from([(
        Stage::FirstPair,
        Conclusion {
            basis: 3,
            outcome: Outcome::Incomplete,
        },
    )]);
    n.findings = Arc::new(vec![Finding {
        stage: Stage::Connect,
        kind: FindingKind::UnconnectedImage,
        about: About::Point(PointId::Target(7)),
        text: "a\nfinding\0".into(),
    }]);
    n.adjustment = Some(Arc::new(adjustment(&mut next)));
    n.inputs = u64::MAX;
    n.next_target = 8;
    Arc::make_mut(&mut n.settings).critical_w = next();
    n
}

fn image(id: u32, next: &mut impl FnMut() -> f64) -> ImageEntry {
    let file = ImageFile {
        path: format!("pictures/IMG {id}.png"),
        size_bytes: u64::MAX,
        sha256: "00ff".into(),
        width_px: 4000,
        height_px: 3000,
    };
    let dots = (0..3).map(|_| Dot {
        centre_px: Vector2::new(next(), next()),
        sigma_px: next(),
        major_px: next(),
        minor_px: next(),
        angle: next(),
        contrast: next(),
        background: next(),
    });
    let detections = Detections {
        by_hand: Vec::new(),
        expected: vec![DotIndex(0)],
        width_px: 4000,
        height_px: 3000,
        dots: dots.collect(),
        codes: vec![CodeReading {
            family: Family::Ring(14),
            id: 57,
            dots: vec![DotIndex(0)],
            misfit: next(),
            doubt: Some("blurred".into()),
            evidence: CodeEvidence::default(),
        }],
        rejected: vec![Rejected {
            place_px: Vector2::new(next(), next()),
            reason: "too small".into(),
        }],
    };
    let label = Label {
        point: PointId::of_code(Family::Ring(14), 57)[0],
        source: Source::Operator,
        rejected: Some("|w| = 5".into()),
    };
    ImageEntry {
        detections: Some(Arc::new(detections)),
        labels: Arc::new([(DotIndex(0), label)].into()),
        set_aside: Arc::new([(0, "does not fit".into())].into()),
        unlabelled: Arc::new([(DotIndex(2), "one ray".into())].into()),
        rejected_dots: Arc::new([(DotIndex(1), "no target".into())].into()),
        not_there: Arc::new([PointId::Target(7)].into()),
        station: Some(Station {
            pose: Pose {
                camera_from_world: Rotation3::from_matrix_unchecked(Matrix3::from_fn(|_, _| {
                    next()
                })),
                centre_in_world: Vector3::from_fn(|_, _| next()),
            },
            covariance: Some(Matrix6::from_fn(|_, _| next())),
            with_camera: Some(SMatrix::from_fn(|_, _| next())),
        }),
        attempt: Some(Attempt {
            basis: 2,
            known_points: 3,
            oriented: 2,
            knowledge: 1,
            reason: "too few".into(),
        }),
        ..ImageEntry::new(file, CameraId(0))
    }
}

fn adjustment(next: &mut impl FnMut() -> f64) -> AdjustmentResult {
    AdjustmentResult {
        stage: Stage::Adjust,
        basis: 1,
        sigma0: next(),
        sigma0_px: next(),
        rms_px: next(),
        sigma_station_mm: next(),
        redundancy: -1,
        datum: "free".into(),
        frame: FrameResult::default(),
        scale_from: ScaleSource::Arbitrary,
        cameras: vec![CameraResult {
            camera: CameraId(0),
            covariance: SMatrix::from_fn(|_, _| next()),
        }],
        components: Vec::new(),
        bars: vec![BarResult {
            name: "bar".into(),
            difference_mm: next(),
            test: None,
        }],
        observations: vec![AdjustedObservation {
            image: ImageId(0),
            dot: DotIndex(0),
            point: PointId::Target(7),
            residual_px: Vector2::new(next(), next()),
            redundancy: next(),
            test: next(),
            standing: Standing::Rejected,
        }],
    }
}

/// A network with three images and plausible numbers.
fn ordinary() -> Arc<Network> {
    let mut number = 0.1;
    Arc::new(network(3, || {
        number = (number * 1.7) % 91.0;
        number
    }))
}

fn opened(file: &Path) -> (Store, Arc<Network>) {
    let opened = Store::open(file).unwrap();
    assert_eq!(opened.warnings, Vec::<String>::new());
    (opened.store.unwrap(), opened.network)
}

fn refusal(result: Result<Opened, StorageError>) -> String {
    let line = result
        .err()
        .map(|error| error.to_string())
        .unwrap_or_default();
    assert!(!line.is_empty() && !line.contains('\n'), "one line: {line}");
    line
}
