//! Real pictures given in other orders and with other knowledge of the camera: is the same measured? `cargo bench --bench shuffle --
//! FOLDER CAMERA FAMILY [N]` (pictures, camera file, code family, orders of each; without N 50).

#![allow(clippy::print_stdout, reason = "a program whose result is its table")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use nalgebra::Vector3;
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use tiepoint::geometry::{Scale, fit_similarity};
use tiepoint::imaging::{GreyImage, LoadSettings, load_picture};
use tiepoint::monitor::Monitor;
use tiepoint::network::{ImageEntry, Network, Stage, Standing};
use tiepoint::project::files::{CameraFile, read_cameras};
use tiepoint::project::intake::{add_cameras, add_images};
use tiepoint::stages::{Halt, Pictures, adopt};
use tiepoint::targets::{Detections, Family};

struct Files;

impl Pictures for Files {
    fn load(&self, image: &ImageEntry, _monitor: &Monitor) -> Result<GreyImage, String> {
        let picture = load_picture(Path::new(&image.file.path), &LoadSettings::default());
        picture.map(|p| p.image).map_err(|e| e.to_string())
    }
}

fn concluded(mut network: Network, stage: Stage) -> Network {
    while let Some(step) = stage.next(&network) {
        match step.run(&network, &Files, &Monitor::new()) {
            Ok(advance) => network = advance.network,
            Err(Halt::Failed(error)) => return stage.conclude(&network, Some(&error)),
            Err(Halt::Interrupted) => unreachable!("nobody interrupts"),
        }
    }
    stage.conclude(&network, None)
}

/// A measurement of these pictures in this order.
fn project(family: Family, cameras: &[CameraFile], files: &[PathBuf]) -> Network {
    let mut network = Network::default();
    Arc::make_mut(&mut network.settings).families = vec![family];
    add_cameras(&mut network, cameras);
    for file in files {
        let files = std::slice::from_ref(file);
        add_images(&mut network, Path::new("/"), files, &Monitor::new()).expect("a picture");
    }
    network
}

/// What was measured, in words that no order changes: observations by picture and dot, and the coordinates of the points by theirs.
struct Measured {
    oriented: usize,
    accepted: BTreeSet<(String, u32)>,
    points: BTreeMap<BTreeSet<(String, u32)>, Vector3<f64>>,
    sigma0: f64,
}

impl Measured {
    fn of(network: &Network) -> Self {
        let mut accepted = BTreeSet::new();
        let mut of_points = BTreeMap::<_, BTreeSet<_>>::new();
        let adjustment = network.adjustment.as_ref();
        for row in adjustment.iter().flat_map(|a| &a.observations) {
            if row.standing == Standing::Used {
                let seen = (network.images[&row.image].file.path.clone(), row.dot.0);
                accepted.insert(seen.clone());
                of_points.entry(row.point).or_default().insert(seen);
            }
        }
        let points = of_points.into_iter();
        Self {
            oriented: network.oriented_images().count(),
            accepted,
            points: points
                .filter_map(|(id, seen)| Some((seen, network.points.get(&id)?.position)))
                .collect(),
            sigma0: adjustment.map_or(f64::NAN, |a| a.sigma0),
        }
    }

    /// Observations that only one of two measurements accepts, and the largest difference of a point of both after the best fit with
    /// scale, mm.
    fn apart(&self, other: &Self) -> (usize, f64) {
        let pairs: Vec<(Vector3<f64>, Vector3<f64>)> = self
            .points
            .iter()
            .filter_map(|(seen, place)| Some((*place, *other.points.get(seen)?)))
            .collect();
        let different = self.accepted.symmetric_difference(&other.accepted).count();
        let Ok(fit) = fit_similarity(&pairs, Scale::Free) else {
            return (different, f64::INFINITY);
        };
        let off = |(a, b): &(Vector3<f64>, Vector3<f64>)| (fit.apply(a) - b).norm();
        (different, pairs.iter().map(off).fold(0.0, f64::max))
    }
}

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| !word.starts_with("--"))
        .collect();
    let [folder, camera, family, ..] = &words[..] else {
        println!("usage: cargo bench --bench shuffle -- FOLDER CAMERA FAMILY [N]");
        return;
    };
    let orders: u64 = words.get(3).map_or(50, |n| n.parse().expect("a number"));
    let family: Family = family
        .parse()
        .expect("a family: dot420, ring12, ring14, ring20");
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .expect("a folder of pictures")
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .map(|path| path.canonicalize().expect("a picture"))
        .collect();
    files.sort();
    let stated = read_cameras(Path::new(camera)).expect("a camera file");
    let wrong = |share: f64| {
        let mut cameras = stated.clone();
        for camera in &mut cameras {
            if let Some(distance) = &mut camera.principal_distance_mm {
                *distance *= share;
            }
        }
        cameras
    };
    let knowledge = [
        ("as stated", wrong(1.0)),
        ("10 % too long", wrong(1.1)),
        ("10 % too short", wrong(0.9)),
        ("none", Vec::new()),
    ];
    println!(
        "| principal distance | orders | oriented | accepted | differently accepted, at most | coordinates apart, mm, at most | sigma0 | s each |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- |");
    let mut first: Option<Measured> = None;
    for (name, cameras) in &knowledge {
        let detected = concluded(project(family, cameras, &files), Stage::Detect);
        let detections: BTreeMap<&str, &Arc<Detections>> = detected
            .images
            .values()
            .filter_map(|image| Some((image.file.path.as_str(), image.detections.as_ref()?)))
            .collect();
        let begun = Instant::now();
        let all: Vec<Measured> = (0..orders)
            .into_par_iter()
            .map(|number| {
                let mut files = files.clone();
                files.shuffle(&mut ChaCha8Rng::seed_from_u64(number));
                let mut network = project(family, cameras, &files);
                let ids: Vec<_> = network.images.keys().copied().collect();
                for id in ids {
                    let path = network.images[&id].file.path.clone();
                    adopt(
                        network.image_mut(id),
                        detections[path.as_str()].as_ref().clone(),
                    );
                }
                network.inputs += 1;
                let measured = Stage::ALL.into_iter().fold(network, concluded);
                Measured::of(&measured)
            })
            .collect();
        let seconds = begun.elapsed().as_secs_f64() / orders.max(1) as f64;
        let Some(reference) = first.as_ref().or(all.first()) else {
            continue;
        };
        let apart: Vec<(usize, f64)> = all.iter().map(|one| reference.apart(one)).collect();
        println!(
            "| {name} | {orders} | {} | {} | {} | {:.1e} | {:.3} | {seconds:.2} |",
            all.iter().map(|one| one.oriented).min().unwrap_or(0),
            reference.accepted.len(),
            apart.iter().map(|a| a.0).max().unwrap_or(0),
            apart.iter().map(|a| a.1).fold(0.0, f64::max),
            reference.sigma0,
        );
        if first.is_none() {
            first = all.into_iter().next();
        }
    }
}
