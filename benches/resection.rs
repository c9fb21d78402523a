//! Resection from few points against truth: `cargo bench --bench resection -- TRIALS` (the file that
//! `benches/resection_peers.py` writes). Prints shape, points, method, failures, trials and median us of a call, one thread;
//! on stderr every failure, with what tells whether the trial could have been won.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a program whose result is its rows"
)]

use std::collections::BTreeMap;
use std::time::Instant;

use nalgebra::{Vector2, Vector3};
use tiepoint::camera::{Camera, InteriorOrientation};
use tiepoint::geometry::Pose;
use tiepoint::orientation::{
    ConsensusSettings, PoseObservation, resect_by_consensus, resect_from_points,
};

/// A station farther from the true one is a failure, mm.
const FAILED_MM: f64 = 20.0;
/// Standard error of the trials' pixel coordinates, px.
const NOISE_PX: f64 = 0.04;
/// Principal distance of the trials' camera, px.
const FOCAL_PX: f64 = 2222.0;

struct Trial {
    observations: Vec<PoseObservation>,
    station: Vector3<f64>,
}

/// The trials by shape and number of points.
fn trials(path: &str) -> BTreeMap<(String, usize), Vec<Trial>> {
    let mut groups: BTreeMap<(String, usize), Vec<Trial>> = BTreeMap::new();
    let mut reader = csv::Reader::from_path(path).expect("a file of trials");
    for row in reader.deserialize() {
        type Row = (String, usize, usize, [f64; 3], [f64; 2], [f64; 3]);
        let (shape, count, number, point, pixel, station): Row = row.expect("a row of a trial");
        let group = groups.entry((shape, count)).or_default();
        if number == group.len() {
            group.push(Trial {
                observations: Vec::new(),
                station: Vector3::from(station),
            });
        }
        group[number].observations.push(PoseObservation {
            pixel: Vector2::from(pixel),
            point: Vector3::from(point),
            sigma_px: NOISE_PX,
        });
    }
    groups
}

fn from_points(camera: &Camera, observations: &[PoseObservation]) -> Vec<Pose> {
    let fitted = resect_from_points(camera, observations);
    fitted.iter().map(|f| f.pose).collect()
}

fn by_consensus(camera: &Camera, observations: &[PoseObservation]) -> Vec<Pose> {
    let found = resect_by_consensus(camera, observations, &[], &ConsensusSettings::default());
    found.iter().map(|f| f.pose).collect()
}

fn main() {
    let arguments: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with("--"))
        .collect();
    let [path] = &arguments[..] else {
        println!("usage: cargo bench --bench resection -- TRIALS");
        return;
    };
    let camera = Camera {
        width_px: 3072,
        height_px: 2048,
        pixel_pitch_mm: 0.009,
        interior: InteriorOrientation::pinhole(FOCAL_PX * 0.009),
    };
    type Method = fn(&Camera, &[PoseObservation]) -> Vec<Pose>;
    let methods: [(&str, Method); 2] = [("from points", from_points), ("consensus", by_consensus)];
    for ((shape, count), trials) in &trials(path) {
        for (name, resect) in methods {
            if name == "consensus" && *count < 4 {
                continue;
            }
            let (mut failures, mut times) = (0, Vec::new());
            for (number, trial) in trials.iter().enumerate() {
                let begun = Instant::now();
                let poses = resect(&camera, &trial.observations);
                times.push(begun.elapsed().as_secs_f64() * 1e6);
                let error = |pose: &Pose| (pose.centre_in_world - trial.station).norm();
                let counted = if *count == 3 { poses.len() } else { 1 };
                let errors: Vec<f64> = poses.iter().take(counted).map(error).collect();
                if !errors.iter().any(|e| *e <= FAILED_MM) {
                    failures += 1;
                    eprintln!(
                        "{shape}, {count} points, {name}, trial {number}: stations off by {errors:.1?} mm"
                    );
                }
            }
            times.sort_by(f64::total_cmp);
            let median = times[times.len() / 2];
            println!(
                "{shape},{count},{name},{failures},{},{median:.1}",
                trials.len()
            );
        }
    }
}
