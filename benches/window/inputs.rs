//! What is opened: the demo's 34 pictures, one picture of 24 megapixels, a network of 2,000 stations.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use tiepoint::camera::{Camera, InteriorOrientation};
use tiepoint::commands::{DemoRequest, NewRequest, new, prepare_demo};
use tiepoint::geometry::Pose;
use tiepoint::monitor::Monitor;
use tiepoint::network::{
    CameraEntry, CameraId, ImageEntry, ImageFile, ImageId, InteriorSource, Label, Network, Point,
    PointId, Source, Stage, Station,
};
use tiepoint::project::session::Session;
use tiepoint::report::{CameraFile, cameras_toml};
use tiepoint::synthetic::{BoxSettings, RenderSettings, box_experiment, render};
use tiepoint::targets::{DotIndex, Family};

/// The folder with everything that is opened.
pub(crate) struct Inputs {
    folder: PathBuf,
}

impl Inputs {
    /// Makes what is not there yet.
    pub(crate) fn prepare() -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("window");
        fs::create_dir_all(&folder).expect("a folder under target");
        let inputs = Self { folder };
        prepare_demo(&DemoRequest::usual(&inputs.folder), &Monitor::new()).expect("the demo");
        inputs
    }

    /// A project of the 34 pictures as it stands before a stage, or measured (`None`), in a file of its own.
    pub(crate) fn before(&self, stage: Option<Stage>, name: &str) -> PathBuf {
        let file = |stage: Option<Stage>| {
            let name = stage.map_or_else(|| "measured".into(), |stage| format!("before-{stage}"));
            self.folder.join(format!("{name}.project"))
        };
        if !file(None).exists() {
            let path = self.folder.join("stages.tiepoint");
            let _ = fs::remove_file(&path);
            fs::copy(self.folder.join("box.tiepoint"), &path).expect("a copy");
            let mut session = Session::open(&path).expect("the demo's project");
            for stage in Stage::ALL {
                session.flush().expect("it is saved");
                let _ = fs::remove_file(file(Some(stage)));
                session.save_copy(&file(Some(stage))).expect("a copy");
                while let Some(run) = session.begin(stage).expect("a step") {
                    session
                        .finish(run.compute(&Monitor::new()))
                        .expect("a step that can be done");
                }
            }
            session.save_copy(&file(None)).expect("a copy");
        }
        let copy = self.folder.join(name);
        let _ = fs::remove_file(&copy);
        fs::copy(file(stage), &copy).expect("a copy");
        copy
    }

    /// A project with one picture of 6000 x 4000 px.
    pub(crate) fn large_picture(&self) -> PathBuf {
        let folder = self.folder.join("large");
        let project = folder.join("large.tiepoint");
        if project.exists() {
            return project;
        }
        fs::create_dir_all(&folder).expect("a folder under target");
        let settings = BoxSettings {
            width_px: 6000,
            height_px: 4000,
            pixel_pitch_mm: 0.009 * 3072.0 / 6000.0,
            ..BoxSettings::default()
        };
        let experiment = box_experiment(&settings).expect("a scene");
        let station = &experiment.stations[0];
        let picture = render(
            &experiment.scene,
            &experiment.camera,
            &station.pose,
            &RenderSettings::default(),
            1,
        );
        let (width, height) = (picture.width_px, picture.height_px);
        let grey = image::GrayImage::from_raw(width, height, picture.image).expect("all pixels");
        grey.save(folder.join("large.png")).expect("a picture file");
        let camera = CameraFile {
            name: "large".into(),
            width_px: width,
            height_px: height,
            pixel_pitch_mm: Some(settings.pixel_pitch_mm),
            principal_distance_mm: Some(settings.principal_distance_mm),
            principal_point: [0.0; 2],
            radial: [0.0; 3],
            tangential: [0.0; 2],
            affinity: [0.0; 2],
            direction: Default::default(),
            known_sigmas: [None; 10],
        };
        fs::write(folder.join("camera.toml"), cameras_toml(&[camera])).expect("a camera file");
        let plan = NewRequest {
            project: project.clone(),
            images: vec![folder.join("large.png")],
            cameras: vec![folder.join("camera.toml")],
            targets: None,
            cross: None,
            bars: None,
            control: None,
            families: vec![Family::Dot420],
            identification: Default::default(),
        };
        new(&plan, &Monitor::new()).expect("a project");
        project
    }
}

/// Stations on a ring round a box with points on its top; every station shows every fifth point.
pub(crate) fn ring_of_stations(stations: u32, points: u32) -> Network {
    let camera = Camera {
        width_px: 3000,
        height_px: 2000,
        pixel_pitch_mm: 0.008,
        interior: InteriorOrientation::pinhole(24.0),
    };
    let camera = CameraEntry {
        name: "camera".into(),
        nominal: camera.clone(),
        camera,
        known_sigmas: [None; 10],
        parameters: Default::default(),
        stated: Default::default(),
        source: InteriorSource::CameraFile,
        exif_model: None,
    };
    let images = Arc::new(
        (0..stations)
            .map(|number| (ImageId(number), Arc::new(station(number, stations, points))))
            .collect(),
    );
    let points = Arc::new(
        (0..points)
            .map(|number| (PointId::Target(number), Arc::new(point(number))))
            .collect(),
    );
    Network {
        cameras: Arc::new(BTreeMap::from([(CameraId(0), Arc::new(camera))])),
        points,
        images,
        connection_order: Arc::new((0..stations).map(ImageId).collect()),
        ..Network::default()
    }
}

fn point(number: u32) -> Point {
    let number = f64::from(number);
    let [x, y, z] =
        [0.618_034, 0.754_878, 0.569_840].map(|step: f64| (number * step).fract() - 0.5);
    let sigma = 0.01 + 0.02 * (z + 0.5);
    Point {
        position: Vector3::new(600.0 * x, 400.0 * y, 300.0 * z),
        covariance: Some(Matrix3::from_diagonal(&Vector3::new(1.0, 1.5, 3.0)) * (sigma * sigma)),
        rays: 4,
        circle: None,
    }
}

fn station(number: u32, stations: u32, points: u32) -> ImageEntry {
    let angle = std::f64::consts::TAU * f64::from(number) / f64::from(stations);
    let centre = Vector3::new(
        1500.0 * angle.cos(),
        1500.0 * angle.sin(),
        250.0 + 650.0 * f64::from(number % 2),
    );
    let file = ImageFile {
        path: format!("images/image{number:04}.png"),
        size_bytes: 1,
        sha256: String::new(),
        width_px: 3000,
        height_px: 2000,
    };
    let mut image = ImageEntry::new(file, CameraId(0));
    let pose = Pose::looking_at(centre, Vector3::zeros(), Vector3::z(), 0.0);
    image.station = Some(Station {
        pose,
        covariance: None,
        with_camera: None,
    });
    let seen = (0..points).filter(|point| (point + number).is_multiple_of(5));
    let label = |point| Label {
        point: PointId::Target(point),
        source: Source::Automatic,
        rejected: None,
    };
    image.labels = Arc::new(seen.map(|point| (DotIndex(point), label(point))).collect());
    image
}
