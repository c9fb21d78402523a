//! A small network for the tests of this folder.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Matrix3, Matrix6, SMatrix, Vector2, Vector3};

use crate::camera::{Camera, InteriorOrientation};
use crate::geometry::{OmegaPhiKappa, Pose};
use crate::network::{
    AdjustedObservation, AdjustmentResult, Attempt, CameraEntry, CameraId, CameraResult,
    ControlPoint, ControlRole, DevicePoint, FrameResult, ImageEntry, ImageFile, ImageId, ImageUse,
    InteriorSource, Label, Network, Point, PointId, ScaleSource, Source, Stage, Standing, Station,
};
use crate::targets::{CodeEvidence, CodeReading, Detections, Dot, DotIndex, Family};

/// Two images in use (one oriented), one excluded; three adjusted points; one code reading set aside.
pub(crate) fn network() -> Network {
    let images = [
        (ImageId(1), Arc::new(oriented_image())),
        (ImageId(2), Arc::new(lost_image())),
        (ImageId(3), Arc::new(excluded_image())),
    ];
    let point = |x, y, z| {
        Arc::new(Point {
            position: Vector3::new(x, y, z),
            covariance: Some(Matrix3::from_diagonal(&Vector3::new(1e-4, 4e-4, 9e-4))),
            rays: 2,
            circle: None,
        })
    };
    let points = [
        ("C1", point(100.0, -1e-9, -50.25)),
        ("C2", point(5.0, 5.0, 5.0)),
        ("cross:1", point(0.0, 0.0, 40.0)),
        ("M1", point(1.0, 2.0, 3.0)),
    ];
    Network {
        cameras: Arc::new(BTreeMap::from([(CameraId(1), Arc::new(camera()))])),
        images: Arc::new(images.into()),
        points: Arc::new(points.map(|(label, p)| (id(label), p)).into()),
        device: Arc::new(vec![DevicePoint {
            label: "X1".into(),
            position_mm: [0.0, 0.0, 40.0],
        }]),
        control: Arc::new(vec![ControlPoint {
            label: "C1".into(),
            coordinates_mm: [Some(100.0), Some(0.0), None],
            sigmas_mm: [None; 3],
            role: ControlRole::Align,
        }]),
        adjustment: Some(Arc::new(adjustment())),
        inputs: 7,
        ..Network::default()
    }
}

fn id(label: &str) -> PointId {
    label.parse().unwrap()
}

fn camera() -> CameraEntry {
    let camera = Camera {
        width_px: 3008,
        height_px: 1960,
        pixel_pitch_mm: 0.00787,
        interior: InteriorOrientation {
            radial: [1e-4, -2e-7, 0.0],
            ..InteriorOrientation::pinhole(20.125)
        },
    };
    CameraEntry {
        name: "D1x".into(),
        nominal: camera.clone(),
        camera,
        known_sigmas: [None; 10],
        parameters: Default::default(),
        stated: Default::default(),
        source: InteriorSource::CameraFile,
        exif_model: None,
    }
}

fn image(number: u32, dots: u32) -> ImageEntry {
    let file = ImageFile {
        path: format!("img_{number}.png"),
        size_bytes: 1,
        sha256: String::new(),
        width_px: 3008,
        height_px: 1960,
    };
    let dot = |i: u32| Dot {
        centre_px: Vector2::new(10.0 + f64::from(i), 20.0),
        sigma_px: 0.02,
        major_px: 8.0,
        minor_px: 7.0,
        angle: 0.0,
        contrast: 100.0,
        background: 10.0,
    };
    let mut image = ImageEntry::new(file, CameraId(1));
    image.detections = Some(Arc::new(Detections {
        width_px: 3008,
        height_px: 1960,
        dots: (0..dots).map(dot).collect(),
        codes: vec![CodeReading {
            family: Family::Ring(14),
            id: 5,
            dots: vec![DotIndex(5)],
            misfit: 0.0,
            doubt: None,
            evidence: CodeEvidence::default(),
        }],
        rejected: Vec::new(),
        by_hand: Vec::new(),
        expected: Vec::new(),
    }));
    image
}

fn label(text: &str, source: Source, rejected: Option<&str>) -> Label {
    Label {
        point: id(text),
        source,
        rejected: rejected.map(str::to_owned),
    }
}

fn oriented_image() -> ImageEntry {
    let mut image = image(1, 7);
    image.labels = Arc::new(BTreeMap::from([
        (DotIndex(0), label("C1", Source::Automatic, None)),
        (
            DotIndex(1),
            label("M1", Source::Automatic, Some("residual 3 px")),
        ),
        (DotIndex(2), label("cross:1", Source::Operator, None)),
        (DotIndex(3), label("C2", Source::Automatic, None)),
    ]));
    image.unlabelled = Arc::new(BTreeMap::from([(
        DotIndex(4),
        "two points are as near".into(),
    )]));
    image.set_aside = Arc::new(BTreeMap::from([(0, "it does not fit".into())]));
    let angles = OmegaPhiKappa {
        omega: 0.3,
        phi: -0.7,
        kappa: 2.0,
    };
    image.station = Some(Station {
        pose: Pose {
            camera_from_world: angles.rotation(),
            centre_in_world: Vector3::new(1.0, 2.0, 1500.0),
        },
        covariance: Some(Matrix6::from_diagonal(
            &[1e-8, 1e-8, 1e-8, 0.01, 0.04, 0.09].into(),
        )),
        with_camera: None,
    });
    image
}

fn lost_image() -> ImageEntry {
    let mut image = image(2, 1);
    image.labels = Arc::new(BTreeMap::from([(
        DotIndex(0),
        label("C1", Source::Automatic, None),
    )]));
    image.attempt = Some(Attempt {
        basis: 7,
        known_points: 1,
        oriented: 2,
        knowledge: 1,
        reason: "too few codes".into(),
    });
    image
}

fn excluded_image() -> ImageEntry {
    ImageEntry {
        usage: ImageUse::Excluded,
        ..image(3, 4)
    }
}

fn adjustment() -> AdjustmentResult {
    let used = |dot, point: &str| AdjustedObservation {
        image: ImageId(1),
        dot: DotIndex(dot),
        point: id(point),
        residual_px: Vector2::new(0.01, -0.02),
        redundancy: 1.2,
        test: 0.8,
        standing: Standing::Used,
    };
    let mut covariance = SMatrix::<f64, 10, 10>::zeros();
    covariance[(0, 0)] = 0.25;
    covariance[(3, 3)] = 0.0625;
    covariance[(4, 4)] = 0.0625;
    AdjustmentResult {
        stage: Stage::Adjust,
        basis: 7,
        sigma0: 1.02,
        sigma0_px: 0.0204,
        rms_px: 0.018,
        sigma_station_mm: 0.21,
        redundancy: 42,
        datum: "inner constraints on the plain targets".into(),
        frame: FrameResult::default(),
        scale_from: ScaleSource::Codes,
        cameras: vec![CameraResult {
            camera: CameraId(1),
            covariance,
        }],
        components: Vec::new(),
        bars: Vec::new(),
        observations: vec![
            used(0, "C1"),
            AdjustedObservation {
                residual_px: Vector2::new(3.0, 0.0),
                redundancy: 0.0,
                test: 9.0,
                standing: Standing::Rejected,
                ..used(1, "M1")
            },
            used(2, "cross:1"),
            AdjustedObservation {
                image: ImageId(9),
                ..used(0, "M1")
            },
        ],
    }
}
