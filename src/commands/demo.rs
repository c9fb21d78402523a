//! `demo`: the paper's box experiment, rendered, measured, and compared with its truth.

use std::fmt::Write;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::project::{NewRequest, new};
use super::run::measure;
use super::terminal::{say, show};
use super::{CommandError, ExportRequest, export, open_to_change};
use crate::monitor::{Interrupted, Monitor};
use crate::network::{DevicePoint, Network, Outcome, ScaleBar, Stage};
use crate::project::files::{ReferencePoint, bars_csv, cross_csv, reference_csv};
use crate::report::{
    CameraFile, StageRun, TruthCheck, cameras_toml, check_against_truth, write_file,
};
use crate::synthetic::{
    BoxSettings, CrossPlan, Experiment, RenderSettings, Truth, box_experiment, render,
};
use crate::targets::Family;

/// Whether the scene has a reference cross.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DemoCross {
    /// As in the paper.
    Present,
    /// The first pair must start from the codes.
    Absent,
}

/// Which demo, where.
#[derive(Clone, Debug)]
pub struct DemoRequest {
    /// Folder of pictures, project and tables.
    pub folder: PathBuf,
    /// Seed of the scene.
    pub seed: u64,
    /// Whether the scene has a reference cross.
    pub cross: DemoCross,
}

impl DemoRequest {
    /// The demo of seed 1 with its cross.
    #[must_use]
    pub fn usual(folder: &Path) -> Self {
        Self {
            folder: folder.to_owned(),
            seed: 1,
            cross: DemoCross::Present,
        }
    }
}

/// A demo that is ready to be measured.
pub struct PreparedDemo {
    /// Its project.
    pub project: PathBuf,
    truth: Truth,
    pictures: DemoPictures,
}

/// Where the pictures of a demo come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum DemoPictures {
    Rendered,
    Reused,
}

/// The truth beside the pictures; written last, so that it says that they are complete.
#[derive(Serialize, Deserialize)]
struct DemoTruth {
    seed: u64,
    cross: DemoCross,
    render: RenderSettings,
    truth: Truth,
}

/// What the demo writes under names that a user's files may have.
const DEMO_NAMES: [&str; 10] = [
    "images",
    "camera.toml",
    "cross.csv",
    "bars.csv",
    "reference.csv",
    "box.tiepoint",
    "points.csv",
    "observations.csv",
    "stations.csv",
    "cameras.toml",
];

/// Says that pictures of a demo are being rendered.
const RENDERING: &str = ".tiepoint-demo-unfinished";

/// The files of a demo.
struct DemoFiles {
    folder: PathBuf,
}

impl DemoFiles {
    fn at(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }
}

/// Renders the box experiment (or reuses the pictures where they are complete), measures it and prints the result
/// beside the paper's.
///
/// # Errors
/// [`CommandError`] where the folder cannot be written, the measurement fails, or it is interrupted.
pub fn demo(request: &DemoRequest, monitor: &Monitor) -> Result<(), CommandError> {
    let files = DemoFiles {
        folder: request.folder.clone(),
    };
    let begun = Instant::now();
    let demo = prepare_demo(request, monitor)?;
    let rendered = begun.elapsed().as_secs_f64();
    if demo.pictures == DemoPictures::Reused {
        say(&format!(
            "{}: pictures are there already, reused",
            request.folder.display()
        ));
    }
    let mut session = open_to_change(&demo.project)?;
    let begun = Instant::now();
    let runs = measure(&mut session, Stage::Adjust, monitor)?;
    let measured = begun.elapsed().as_secs_f64();
    if runs.iter().any(|run| run.outcome == Outcome::Interrupted) {
        return Err(CommandError::interrupted_between_steps());
    }
    let network = session.network().clone();
    drop(session);
    let project = demo.project;
    let check = check_against_truth(&network, &demo.truth)
        .map_err(|e| CommandError::work(format!("{}: {e}", project.display())))?;
    show(&result_table(&network, &check, &runs, rendered, measured))?;
    export(&ExportRequest {
        project: project.clone(),
        points: Some(files.at("points.csv")),
        observations: Some(files.at("observations.csv")),
        missing: None,
        stations: Some(files.at("stations.csv")),
        cameras: Some(files.at("cameras.toml")),
    })?;
    show(&file_list(&files))
}

/// Renders the box experiment (or reuses the pictures where they are complete) and makes its project where there is none.
///
/// # Errors
/// [`CommandError`] where the folder cannot be written, holds another demo, or the work is interrupted.
pub fn prepare_demo(
    request: &DemoRequest,
    monitor: &Monitor,
) -> Result<PreparedDemo, CommandError> {
    let files = DemoFiles {
        folder: request.folder.clone(),
    };
    let (demo, pictures) = match complete_truth(&files, request)? {
        Some(demo) => (demo, DemoPictures::Reused),
        None => (
            render_demo(&files, request, monitor)?,
            DemoPictures::Rendered,
        ),
    };
    let project = files.at("box.tiepoint");
    if !project.exists() {
        let plan = NewRequest {
            project: project.clone(),
            images: vec![files.at("images")],
            cameras: vec![files.at("camera.toml")],
            targets: None,
            cross: (request.cross == DemoCross::Present).then(|| files.at("cross.csv")),
            bars: Some(files.at("bars.csv")),
            control: None,
            families: vec![Family::Dot420],
            identification: Default::default(),
        };
        new(&plan, monitor)?;
    }
    Ok(PreparedDemo {
        project,
        truth: demo.truth,
        pictures,
    })
}

/// The truth of a complete demo in the folder; `None` where there is none.
fn complete_truth(
    files: &DemoFiles,
    request: &DemoRequest,
) -> Result<Option<DemoTruth>, CommandError> {
    let path = files.at("truth.json");
    let text = match fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if is_absent(&error) => {
            refuse_foreign(files)?;
            return Ok(None);
        }
        Err(error) => {
            return Err(CommandError::input(format!("{}: {error}", path.display())));
        }
    };
    let demo: DemoTruth = serde_json::from_str(&text).map_err(|e| {
        CommandError::input(format!(
            "{}: found no truth of a demo ({e}), expected one, or no file",
            path.display()
        ))
    })?;
    if demo.seed != request.seed
        || demo.cross != request.cross
        || demo.render != RenderSettings::default()
    {
        return Err(CommandError::input(format!(
            "{}: found the demo of {} in this folder, expected that of {}: name another folder",
            path.display(),
            demo_name(demo.seed, demo.cross),
            demo_name(request.seed, request.cross)
        )));
    }
    let complete = demo
        .truth
        .images
        .keys()
        .all(|image| files.at("images").join(image).is_file());
    Ok(complete.then_some(demo))
}

fn is_absent(error: &io::Error) -> bool {
    [io::ErrorKind::NotFound, io::ErrorKind::NotADirectory].contains(&error.kind())
}

fn demo_name(seed: u64, cross: DemoCross) -> String {
    match cross {
        DemoCross::Present => format!("seed {seed} with its cross"),
        DemoCross::Absent => format!("seed {seed} without a cross"),
    }
}

/// Refuses a folder that holds somebody's files under the demo's names, for they would be written over. Where a rendering was cut
/// off, its mark is there still.
fn refuse_foreign(files: &DemoFiles) -> Result<(), CommandError> {
    if files.at(RENDERING).exists() {
        return Ok(());
    }
    let foreign = DEMO_NAMES.iter().map(|name| files.at(name));
    match foreign.into_iter().find(|path| path.exists()) {
        None => Ok(()),
        Some(path) => Err(CommandError::input(format!(
            "{}: found something that is no demo's, expected a folder without it: name another folder",
            path.display()
        ))),
    }
}

/// Renders all pictures and writes what a user would have: pictures, camera, cross, bars; and the truth.
///
/// Cost: pixels of all pictures (noise), a little for the dots.
fn render_demo(
    files: &DemoFiles,
    request: &DemoRequest,
    monitor: &Monitor,
) -> Result<DemoTruth, CommandError> {
    let settings = BoxSettings {
        seed: request.seed,
        cross: (request.cross == DemoCross::Present).then(CrossPlan::default),
        ..BoxSettings::default()
    };
    let experiment = box_experiment(&settings)
        .map_err(|e| CommandError::input(format!("seed {}: {e}", request.seed)))?;
    let images = files.at("images");
    fs::create_dir_all(&images)
        .map_err(|e| CommandError::input(format!("{}: {e}", images.display())))?;
    let mark = files.at(RENDERING);
    write_file(&mark, b"")?;
    let render_settings = RenderSettings::default();
    let task = monitor.task("rendering pictures", experiment.stations.len() as u64);
    experiment
        .stations
        .par_iter()
        .enumerate()
        .map(|(index, station)| {
            task.step().map_err(|Interrupted| {
                CommandError::interrupted(
                    "interrupted while rendering; the same command renders the pictures again",
                )
            })?;
            // Every picture its own noise, the same in every run.
            let noise_seed = request.seed.wrapping_mul(1000).wrapping_add(index as u64);
            let picture = render(
                &experiment.scene,
                &experiment.camera,
                &station.pose,
                &render_settings,
                noise_seed,
            );
            let png = encode(&picture.image, picture.width_px, picture.height_px)
                .map_err(|e| CommandError::work(format!("{}: {e}", station.image)))?;
            Ok(write_file(&images.join(&station.image), &png)?)
        })
        .collect::<Vec<Result<(), CommandError>>>()
        .into_iter()
        .collect::<Result<(), CommandError>>()?;
    write_inputs(files, &experiment)?;
    let demo = DemoTruth {
        seed: request.seed,
        cross: request.cross,
        render: render_settings,
        truth: experiment.truth(),
    };
    let json = serde_json::to_string(&demo)
        .map_err(|e| CommandError::work(format!("truth as JSON: {e}")))?;
    write_file(&files.at("truth.json"), json.as_bytes())?;
    // The truth says that the demo is complete; a mark that stays does no harm beside it.
    let _ = fs::remove_file(mark);
    Ok(demo)
}

fn encode(grey: &[u8], width: u32, height: u32) -> image::ImageResult<Vec<u8>> {
    let mut png = Vec::new();
    // Noise does not compress: the fast setting is as small as the slow one.
    PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Sub).write_image(
        grey,
        width,
        height,
        ExtendedColorType::L8,
    )?;
    Ok(png)
}

fn write_inputs(files: &DemoFiles, experiment: &Experiment) -> Result<(), CommandError> {
    let nominal = experiment.nominal_camera();
    let camera = CameraFile {
        name: "DCS460, 20 mm".into(),
        width_px: nominal.width_px,
        height_px: nominal.height_px,
        pixel_pitch_mm: Some(nominal.pixel_pitch_mm),
        principal_distance_mm: Some(nominal.interior.principal_distance),
        principal_point: [0.0; 2],
        radial: [0.0; 3],
        tangential: [0.0; 2],
        affinity: [0.0; 2],
        direction: Default::default(),
        known_sigmas: [None; 10],
    };
    write_file(&files.at("camera.toml"), cameras_toml(&[camera]).as_bytes())?;
    let cross: Vec<DevicePoint> = experiment
        .cross_points()
        .iter()
        .map(DevicePoint::from)
        .collect();
    if !cross.is_empty() {
        write_file(&files.at("cross.csv"), cross_csv(&cross).as_bytes())?;
    }
    let bars: Vec<ScaleBar> = experiment.bars().into_iter().map(ScaleBar::from).collect();
    write_file(&files.at("bars.csv"), bars_csv(&bars).as_bytes())?;
    let reference: Vec<ReferencePoint> = experiment
        .truth()
        .points
        .into_iter()
        .map(reference_point)
        .collect();
    write_file(
        &files.at("reference.csv"),
        reference_csv(&reference).as_bytes(),
    )?;
    Ok(())
}

fn result_table(
    network: &Network,
    check: &TruthCheck,
    runs: &[StageRun],
    rendered: f64,
    measured: f64,
) -> String {
    let share = |part: usize, all: usize| 100.0 * part as f64 / all.max(1) as f64;
    let adjustment = network.adjustment.as_deref();
    let first = network.passes.first();
    let rows: Vec<(&str, String, &str)> = vec![
        (
            "images oriented",
            format!("{} of {}", check.images_oriented, check.images),
            "34 of 34",
        ),
        (
            "dots labelled, of those seen in 3 or more images",
            format!(
                "{} of {} ({:.2} %)",
                check.countable_labelled,
                check.countable_dots,
                share(check.countable_labelled, check.countable_dots)
            ),
            "1659 of 1682 (98.6 %), 23 by hand",
        ),
        (
            "  of the dots wholly visible in truth",
            format!(
                "{} of {} ({:.2} %)",
                check.visible_labelled,
                check.visible_dots,
                share(check.visible_labelled, check.visible_dots)
            ),
            "-",
        ),
        (
            "plain targets as points",
            format!("{} of {}", check.targets_as_points, check.targets),
            "144 of 144",
        ),
        (
            "targets with two labels",
            check.split_targets.len().to_string(),
            "-",
        ),
        (
            "wrong labels",
            check.wrong_labels.len().to_string(),
            "0 after hand work",
        ),
        (
            "codes read, wrong",
            format!("{}, {}", check.codes, check.wrong_codes.len()),
            "352, 0",
        ),
        (
            "rms of coordinates against truth",
            format!("{:.4} mm", check.rms_mm),
            "0.04 mm",
        ),
        (
            "largest difference",
            format!("{:.4} mm", check.largest_mm),
            "-",
        ),
        (
            "sigma0",
            adjustment.map_or("-".into(), |a| {
                format!("{:.3} ({:.4} px)", a.sigma0, a.sigma0_px)
            }),
            "-",
        ),
        (
            "errors over printed sigmas",
            format!("{:.2}", check.error_over_sigma),
            "-",
        ),
        (
            "sigma of stations, codes alone",
            first.map_or("-".into(), |p| format!("{:.3} mm", p.sigma_station_mm)),
            "0.7 mm",
        ),
        (
            "sigma of stations, final",
            adjustment.map_or("-".into(), |a| format!("{:.3} mm", a.sigma_station_mm)),
            "0.1 mm",
        ),
        (
            "time to measure",
            format!("{measured:.1} s (rendering {rendered:.1} s)"),
            "4 min (60 min by hand)",
        ),
    ];
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = writeln!(text, "{:<50}{:<32}Hattori et al. (2002)", "", "Tiepoint");
    for (name, ours, paper) in rows {
        let _ = writeln!(text, "{name:<50}{ours:<32}{paper}");
    }
    for wrong in check
        .wrong_labels
        .iter()
        .chain(&check.wrong_codes)
        .chain(&check.split_targets)
        .take(20)
    {
        let _ = writeln!(text, "! {wrong}");
    }
    let stages: Vec<String> = runs
        .iter()
        .map(|r| format!("{} {:.1} s", r.stage, r.seconds))
        .collect();
    let _ = writeln!(text, "stages: {}", stages.join(", "));
    text
}

fn file_list(files: &DemoFiles) -> String {
    let folder = files.folder.display();
    format!(
        "{folder}/box.tiepoint      the project\n\
         {folder}/images            the pictures\n\
         {folder}/points.csv        coordinates with sigmas (also observations.csv, stations.csv, cameras.toml)\n\
         {folder}/reference.csv     the true coordinates; compare: tiepoint compare {folder}/box.tiepoint --reference {folder}/reference.csv\n"
    )
}

/// Plain targets stand under the scene's own names, which no measurement knows: they are compared by place.
fn reference_point((name, [x, y, z]): (String, [f64; 3])) -> ReferencePoint {
    ReferencePoint {
        label: Some(name.clone()).filter(|name| !name.starts_with('T')),
        name,
        coordinates_mm: [Some(x), Some(y), Some(z)],
        sigmas_mm: [None; 3],
    }
}
