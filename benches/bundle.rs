//! Bundle adjustments of large networks: `cargo bench --bench bundle -- FOLDER [THREADS [opencv|brown]]`, with a folder of the
//! tables that `benches/bundle_peers.py` writes (camera, stations0, points0, obs). Prints one line of JSON. `brown` is the lens of
//! ten parameters that corrects what is measured, in place of the nine of OpenCV that the networks were made with.

#![allow(clippy::print_stdout, reason = "a program whose result is its line")]

use std::collections::BTreeSet;
use std::path::Path;
use std::time::Instant;

use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector2, Vector3};
use tiepoint::adjustment::{
    BundleProblem, BundleSettings, BundleSolver, CameraBlock, Datum, ImageObservation,
    ParameterState, PointBlock, ResidualPlane, Sharing, StationBlock,
};
use tiepoint::camera::{Camera, InteriorOrientation, LensDirection};
use tiepoint::geometry::Pose;
use tiepoint::monitor::Monitor;

/// Standard deviation of the simulated image points, px.
const SIGMA_PX: f64 = 0.04;

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| !word.starts_with("--"))
        .collect();
    let Some(folder) = words.first() else {
        println!(
            "did not run: expected a folder with camera.txt, stations0.txt, points0.txt, obs.txt"
        );
        return;
    };
    let threads = words.get(1).and_then(|word| word.parse().ok()).unwrap_or(2);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("a pool of threads");
    let lens = match words.get(2).map(String::as_str) {
        Some("brown") => Lens::Brown,
        _ => Lens::OpenCv,
    };
    pool.install(|| measure(Path::new(folder), lens));
}

/// What is estimated of the camera.
#[derive(Clone, Copy)]
enum Lens {
    /// Nine parameters that displace the ideal image.
    OpenCv,
    /// Ten that correct the measured one.
    Brown,
}

fn measure(folder: &Path, lens: Lens) {
    let problem = problem(folder, lens);
    let [stations, points, observations] = [
        problem.stations.len(),
        problem.points.len(),
        problem.observations.len(),
    ];
    let begun = Instant::now();
    let mut solver = BundleSolver::new(problem, BundleSettings::default(), &Monitor::new())
        .expect("a sound problem");
    let mut iterations = 0;
    loop {
        let iteration = solver.iterate(&Monitor::new()).expect("a step");
        iterations += 1;
        if iteration.termination.is_some() {
            break;
        }
    }
    let solved = begun.elapsed().as_secs_f64();
    let begun = Instant::now();
    let adjustment = solver.finish(&Monitor::new()).expect("an end");
    let statistics = begun.elapsed().as_secs_f64();
    let sigmas: Vec<f64> = adjustment
        .points
        .iter()
        .filter_map(|point| Some((point.covariance?.trace() / 3.0).sqrt()))
        .collect();
    println!(
        "{{\"net\": \"{}\", \"stations\": {stations}, \"points\": {points}, \"observations\": {observations}, \"iterations\": {iterations}, \"solve_s\": {solved:.4}, \"statistics_s\": {statistics:.4}, \"sigma0_px\": {:.8}, \"mean_sd_mm\": {:.6}}}",
        folder.file_name().unwrap_or_default().to_string_lossy(),
        adjustment.sigma0 * SIGMA_PX,
        sigmas.iter().sum::<f64>() / sigmas.len() as f64,
    );
}

/// The numbers of a table's rows.
fn table(folder: &Path, file: &str) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(folder.join(file)).expect("a table");
    text.lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| {
            line.split_whitespace()
                .map(|word| word.parse().expect("a number"))
                .collect()
        })
        .collect()
}

/// The network with its disturbed starts, the parameters of the lens free, inner constraints over all points.
fn problem(folder: &Path, lens: Lens) -> BundleProblem {
    let camera = table(folder, "camera.txt");
    let [width, height, pitch] = [camera[0][0], camera[0][1], camera[0][2]];
    let [fx, fy, cx, cy] = [camera[2][0], camera[2][1], camera[2][2], camera[2][3]];
    let c = fy * pitch;
    let mut interior = InteriorOrientation::pinhole(c);
    interior.principal_point = [(cx - width / 2.0) * pitch, (height / 2.0 - cy) * pitch];
    interior.affinity = [fx / fy - 1.0, 0.0];
    let mut parameters = [ParameterState::Free; 10];
    if let Lens::OpenCv = lens {
        interior.direction = LensDirection::DisplacingAffinityLast;
        parameters[9] = ParameterState::Fixed;
    }
    let points: Vec<PointBlock> = table(folder, "points0.txt")
        .iter()
        .map(|row| PointBlock::unknown(Vector3::new(row[1], row[2], row[3])))
        .collect();
    // The tables' camera looks along +z with y down.
    let turned = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let stations = table(folder, "stations0.txt");
    let station = |row: &Vec<f64>| {
        let attitude =
            UnitQuaternion::from_quaternion(Quaternion::new(row[4], row[5], row[6], row[7]));
        StationBlock {
            camera: 0,
            pose: Pose {
                camera_from_world: turned * attitude.to_rotation_matrix(),
                centre_in_world: Vector3::new(row[1], row[2], row[3]),
            },
        }
    };
    let observations = table(folder, "obs.txt");
    let observation = |row: &Vec<f64>| ImageObservation {
        station: row[0] as usize,
        point: row[1] as usize,
        pixel: Vector2::new(row[2], row[3]),
        sigma_px: SIGMA_PX,
    };
    BundleProblem {
        cameras: vec![CameraBlock {
            camera: Camera {
                width_px: width as u32,
                height_px: height as u32,
                pixel_pitch_mm: pitch,
                interior,
            },
            parameters,
            sharing: [Sharing::Camera; 10],
        }],
        stations: stations.iter().map(station).collect(),
        datum: Datum::InnerConstraints {
            points: (0..points.len()).collect(),
        },
        points,
        observations: observations.iter().map(observation).collect(),
        distances: Vec::new(),
        residuals: ResidualPlane::Measured,
        frame: None,
        rejected: BTreeSet::new(),
    }
}
