//! A small scene, rendered once, and the program as a user calls it.

// Every test file uses a part of this.
#![allow(dead_code, unreachable_pub)]

pub mod rays;

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use image::{GrayImage, ImageFormat};
use tiepoint::network::{DevicePoint, ScaleBar};
use tiepoint::project::files::{ReferencePoint, bars_csv, cross_csv, reference_csv};
use tiepoint::report::{CameraFile, cameras_toml};
use tiepoint::synthetic::{
    BoxSettings, CrossPlan, Experiment, RenderSettings, box_experiment, render,
};

/// Columns of the pictures.
pub const WIDTH_PX: u32 = 1200;
/// Rows of the pictures.
pub const HEIGHT_PX: u32 = 800;
/// Pictures of the scene.
pub const IMAGES: usize = 10;

/// The scene's files in memory: every test writes those it needs into a folder of its own.
pub struct Scene {
    /// What was rendered.
    pub experiment: Experiment,
    /// PNG files by name.
    pub pictures: Vec<(String, Vec<u8>)>,
    /// `camera.toml`.
    pub camera: String,
    /// `targets.toml`.
    pub targets: String,
    /// `cross.csv`.
    pub cross: String,
    /// `bars.csv`.
    pub bars: String,
    /// `reference.csv`.
    pub reference: String,
}

/// The scene, rendered at the first call.
pub fn scene() -> &'static Scene {
    static SCENE: OnceLock<Scene> = OnceLock::new();
    SCENE.get_or_init(rendered)
}

/// The box of the demo under large dots, so that small pictures are enough.
pub fn settings() -> BoxSettings {
    BoxSettings {
        seed: 4,
        stations: IMAGES,
        plain_targets: 40,
        codes: 24,
        cross: Some(CrossPlan {
            dot_mm: 9.0,
            ..CrossPlan::default()
        }),
        dot_mm: 9.0,
        pitch_mm: 9.0,
        width_px: WIDTH_PX,
        height_px: HEIGHT_PX,
        pixel_pitch_mm: 0.009 * 3072.0 / f64::from(WIDTH_PX),
        ..BoxSettings::default()
    }
}

fn rendered() -> Scene {
    let experiment = box_experiment(&settings()).expect("a scene with room for its targets");
    let pictures = experiment
        .stations
        .iter()
        .zip(1..)
        .map(|(station, seed)| {
            let picture = render(
                &experiment.scene,
                &experiment.camera,
                &station.pose,
                &RenderSettings::default(),
                seed,
            );
            let (width, height) = (picture.width_px, picture.height_px);
            let grey = GrayImage::from_raw(width, height, picture.image).expect("all pixels");
            (station.image.clone(), encoded(&grey, ImageFormat::Png))
        })
        .collect();
    let nominal = experiment.nominal_camera();
    let camera = CameraFile {
        name: "small".into(),
        width_px: WIDTH_PX,
        height_px: HEIGHT_PX,
        pixel_pitch_mm: Some(nominal.pixel_pitch_mm),
        principal_distance_mm: Some(nominal.interior.principal_distance),
        principal_point: [0.0; 2],
        radial: [0.0; 3],
        tangential: [0.0; 2],
        affinity: [0.0; 2],
        direction: Default::default(),
        known_sigmas: [None; 10],
    };
    let cross: Vec<DevicePoint> = experiment
        .cross_points()
        .iter()
        .map(DevicePoint::from)
        .collect();
    let bars: Vec<ScaleBar> = experiment.bars().into_iter().map(ScaleBar::from).collect();
    let reference: Vec<ReferencePoint> = experiment
        .truth()
        .points
        .into_iter()
        .map(|(name, place)| ReferencePoint {
            label: Some(name.clone()).filter(|name| !name.starts_with('T')),
            name,
            coordinates_mm: place.map(Some),
            sigmas_mm: [None; 3],
        })
        .collect();
    Scene {
        pictures,
        camera: cameras_toml(&[camera]),
        targets:
            "[[family]]\nname = 'dot420'\npitch_mm = 9.0\ndot_mm = 9.0\n\n[plain]\ndot_mm = 9.0\n"
                .into(),
        cross: cross_csv(&cross),
        bars: bars_csv(&bars),
        reference: reference_csv(&reference),
        experiment,
    }
}

/// A picture as a file.
pub fn encoded(grey: &GrayImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    grey.write_to(&mut bytes, format)
        .expect("a picture in memory");
    bytes.into_inner()
}

/// The pixels of a picture of the scene.
pub fn pixels(index: usize) -> GrayImage {
    image::load_from_memory(&scene().pictures[index].1)
        .expect("a picture of the scene")
        .into_luma8()
}

/// The project that `new` and `run` made of the whole scene, as the bytes of its file; measured at the first call.
pub fn measured() -> &'static [u8] {
    static MEASURED: OnceLock<Vec<u8>> = OnceLock::new();
    MEASURED.get_or_init(|| {
        let folder = Folder::with_scene("measured");
        folder.run(&NEW).done();
        folder.run(&["run", "p.tiepoint"]).done();
        folder.read("p.tiepoint")
    })
}

/// The arguments that make the project of the whole scene.
pub const NEW: [&str; 12] = [
    "new",
    "p.tiepoint",
    "--images",
    "images",
    "--camera",
    "camera.toml",
    "--targets",
    "targets.toml",
    "--cross",
    "cross.csv",
    "--bars",
    "bars.csv",
];

/// A folder of one test, removed when the test ends.
pub struct Folder(PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

impl Folder {
    /// An empty folder that no other test has.
    pub fn new(name: &str) -> Self {
        static COUNT: AtomicUsize = AtomicUsize::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let process = std::process::id();
        let path = std::env::temp_dir().join(format!("tiepoint-test-{process}-{number}-{name}"));
        fs::create_dir_all(&path).expect("a temporary folder");
        Self(path.canonicalize().expect("the folder just made"))
    }

    /// A folder with the camera, cross, bars, and all pictures in `images`.
    pub fn with_scene(name: &str) -> Self {
        let folder = Self::with_inputs(name);
        for index in 0..IMAGES {
            folder.add_picture(index);
        }
        folder
    }

    /// A folder with the camera, cross and bars; `images` is empty.
    pub fn with_inputs(name: &str) -> Self {
        let folder = Self::new(name);
        folder.write("camera.toml", &scene().camera);
        folder.write("targets.toml", &scene().targets);
        folder.write("cross.csv", &scene().cross);
        folder.write("bars.csv", &scene().bars);
        folder.write("reference.csv", &scene().reference);
        fs::create_dir(folder.at("images")).expect("a folder in the temporary folder");
        folder
    }

    /// A folder with the scene and its measured project `p.tiepoint`.
    pub fn with_measured(name: &str) -> Self {
        let project = measured();
        let folder = Self::with_scene(name);
        folder.write("p.tiepoint", project);
        folder
    }

    /// Puts a picture of the scene into `images`.
    pub fn add_picture(&self, index: usize) {
        let (name, bytes) = &scene().pictures[index];
        self.write(&format!("images/{name}"), bytes);
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// The path of a file in the folder.
    pub fn at(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Writes a file.
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.at(name), content).expect("a file in the temporary folder");
    }

    /// The bytes of a file.
    pub fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.at(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    /// A file's text.
    pub fn text(&self, name: &str) -> String {
        String::from_utf8(self.read(name)).expect("UTF-8")
    }

    /// The names in the folder, sorted.
    pub fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.0).expect("the temporary folder");
        let mut names: Vec<String> = entries
            .map(|e| e.expect("an entry").file_name().to_string_lossy().into())
            .collect();
        names.sort();
        names
    }

    /// Calls the program in this folder.
    pub fn run(&self, arguments: &[&str]) -> Answer {
        let output = program(&self.0, arguments)
            .output()
            .expect("the program starts");
        Answer {
            arguments: arguments.iter().map(|&a| a.to_owned()).collect(),
            status: output.status.code(),
            stdout: String::from_utf8(output.stdout).expect("UTF-8 on stdout"),
            stderr: String::from_utf8(output.stderr).expect("UTF-8 on stderr"),
        }
    }

    /// Makes the project of the whole scene again, of another name or with other files.
    pub fn new_with(&self, key: &str, value: &str) -> Answer {
        let mut arguments = NEW.to_vec();
        match arguments.iter().position(|a| *a == key) {
            Some(place) => arguments[place + 1] = value,
            None => arguments.extend([key, value]),
        }
        self.run(&arguments)
    }
}

/// The program, to be called in a folder; its streams are pipes.
pub fn program(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tiepoint"));
    command
        .args(arguments)
        .current_dir(folder)
        .env_remove("RUST_BACKTRACE")
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// How the program answered.
#[derive(Debug)]
pub struct Answer {
    /// What it was called with.
    pub arguments: Vec<String>,
    /// Its exit status; `None` where a signal ended it.
    pub status: Option<i32>,
    /// Results.
    pub stdout: String,
    /// Progress and failures.
    pub stderr: String,
}

impl Answer {
    /// Asserts that it did what it was asked, and gives the results.
    #[track_caller]
    pub fn done(&self) -> &str {
        assert_eq!(self.status, Some(0), "{self:#?}");
        self.assert_no_panic();
        assert!(!self.stderr.contains("tiepoint: "), "{self:#?}");
        &self.stdout
    }

    /// Asserts that it refused with this status in one line that holds all of `words`, and nothing else on stderr or stdout.
    #[track_caller]
    pub fn refused(&self, status: i32, words: &[&str]) {
        self.failed(status, words);
        assert_eq!(self.stderr.lines().count(), 1, "{self:#?}");
        assert_eq!(self.stdout, "", "{self:#?}");
    }

    /// Asserts that it failed with this status and that the last line of stderr, after progress, holds all of `words`.
    #[track_caller]
    pub fn failed(&self, status: i32, words: &[&str]) {
        assert_eq!(self.status, Some(status), "{self:#?}");
        self.assert_no_panic();
        let lines: Vec<&str> = self
            .stderr
            .lines()
            .filter(|line| line.starts_with("tiepoint: "))
            .collect();
        assert_eq!(lines.len(), 1, "{self:#?}");
        assert_eq!(self.stderr.lines().last(), Some(lines[0]), "{self:#?}");
        for word in words {
            assert!(lines[0].contains(word), "'{word}' is not in: {}", lines[0]);
        }
    }

    #[track_caller]
    fn assert_no_panic(&self) {
        for trace in ["panicked", "RUST_BACKTRACE", "stack backtrace"] {
            assert!(!self.stderr.contains(trace), "{self:#?}");
        }
    }

    /// The result as JSON.
    #[track_caller]
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(self.done()).unwrap_or_else(|e| panic!("{e}: {self:#?}"))
    }
}
