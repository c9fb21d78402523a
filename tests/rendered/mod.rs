//! Rendered scenes in memory: a network without files, and the pictures of its images.
#![allow(dead_code, reason = "every test file uses its own part")]

use std::collections::BTreeMap;
use std::sync::Arc;

use rayon::prelude::*;
use tiepoint::imaging::{BitDepth, GreyImage};
use tiepoint::monitor::Monitor;
use tiepoint::network::{
    CameraEntry, CameraId, DevicePoint, ImageEntry, ImageFile, ImageId, InteriorSource, Network,
    ScaleBar, Stage,
};
use tiepoint::stages::{Advance, Halt, Pictures};
use tiepoint::synthetic::{
    BoxSettings, CrossPlan, Experiment, PanelSettings, RenderSettings, Truth, box_experiment,
    panel, render,
};
use tiepoint::targets::Family;

/// A scene with its pictures and its truth.
pub(crate) struct Rendered {
    pub(crate) network: Network,
    pub(crate) pictures: Memory,
    pub(crate) truth: Truth,
}

/// Pictures by the path of their image.
pub(crate) struct Memory(BTreeMap<String, GreyImage>);

impl Pictures for Memory {
    fn load(&self, image: &ImageEntry, _monitor: &Monitor) -> Result<GreyImage, String> {
        let path = &image.file.path;
        self.0
            .get(path)
            .cloned()
            .ok_or_else(|| format!("{path}: found no such picture"))
    }
}

/// The paper's box in small: fewer and smaller pictures of the same field, so that a test is quick.
pub(crate) fn small_box(seed: u64, cross: Option<CrossPlan>) -> Rendered {
    let settings = BoxSettings {
        seed,
        stations: 18,
        plain_targets: 80,
        codes: 28,
        cross,
        width_px: 1536,
        height_px: 1024,
        pixel_pitch_mm: 0.018,
        dot_mm: 6.0,
        pitch_mm: 6.0,
        ..BoxSettings::default()
    };
    let mut rendered = of_experiment(
        &box_experiment(&settings).expect("a scene"),
        seed,
        Family::Dot420,
    );
    let measurement = Arc::make_mut(&mut rendered.network.settings);
    measurement.targets.plain_dot_mm = 6.0;
    measurement.targets.families = vec![tiepoint::network::DotFamily {
        family: Family::Dot420,
        pitch_mm: 6.0,
        dot_mm: 6.0,
    }];
    rendered
}

/// The paper's box as it is.
pub(crate) fn whole_box(seed: u64, cross: Option<CrossPlan>) -> Rendered {
    let settings = BoxSettings {
        seed,
        cross,
        ..BoxSettings::default()
    };
    of_experiment(
        &box_experiment(&settings).expect("a scene"),
        seed,
        Family::Dot420,
    )
}

/// A flat field of ring codes with some raised ones.
pub(crate) fn ring_panel(seed: u64, family: Family) -> Rendered {
    let settings = PanelSettings {
        seed,
        family,
        ..PanelSettings::default()
    };
    of_experiment(&panel(&settings).expect("a panel"), seed, family)
}

fn of_experiment(experiment: &Experiment, seed: u64, family: Family) -> Rendered {
    of_experiment_with(experiment, seed, family, &RenderSettings::default())
}

/// A network of all pictures of an experiment, with what a user would know.
pub(crate) fn of_experiment_with(
    experiment: &Experiment,
    seed: u64,
    family: Family,
    settings: &RenderSettings,
) -> Rendered {
    let pictures: BTreeMap<String, GreyImage> = experiment
        .stations
        .par_iter()
        .enumerate()
        .map(|(index, station)| {
            let noise_seed = seed * 1000 + index as u64;
            let picture = render(
                &experiment.scene,
                &experiment.camera,
                &station.pose,
                settings,
                noise_seed,
            );
            let grey = picture.image.iter().map(|&g| u16::from(g)).collect();
            let grey = GreyImage::new(picture.width_px, picture.height_px, BitDepth::Eight, grey);
            (
                station.image.clone(),
                grey.expect("as many samples as pixels"),
            )
        })
        .collect();
    let mut network = Network::default();
    Arc::make_mut(&mut network.settings).families = vec![family];
    let nominal = experiment.nominal_camera();
    let camera = CameraEntry {
        name: "rendered".into(),
        camera: nominal.clone(),
        nominal,
        known_sigmas: [None; 10],
        parameters: Default::default(),
        stated: Default::default(),
        source: InteriorSource::CameraFile,
        exif_model: None,
    };
    network.cameras = Arc::new(BTreeMap::from([(CameraId(1), Arc::new(camera))]));
    network.images = Arc::new(
        (1..)
            .zip(pictures.iter())
            .map(|(number, (path, picture))| {
                let file = ImageFile {
                    path: path.clone(),
                    size_bytes: 0,
                    sha256: String::new(),
                    width_px: picture.width() as u32,
                    height_px: picture.height() as u32,
                };
                (
                    ImageId(number),
                    Arc::new(ImageEntry::new(file, CameraId(1))),
                )
            })
            .collect(),
    );
    let device = experiment.cross_points().iter();
    network.device = Arc::new(device.map(DevicePoint::from).collect());
    network.scale_bars = Arc::new(experiment.bars().into_iter().map(ScaleBar::from).collect());
    Rendered {
        network,
        pictures: Memory(pictures),
        truth: experiment.truth(),
    }
}

/// Runs all stages as a session does: steps until there is no next one, then the conclusion.
pub(crate) fn measure(network: Network, pictures: &dyn Pictures) -> Network {
    Stage::ALL.into_iter().fold(network, |network, stage| {
        run_stage(network, stage, pictures)
    })
}

/// Runs one stage to its conclusion.
pub(crate) fn run_stage(mut network: Network, stage: Stage, pictures: &dyn Pictures) -> Network {
    while let Some(step) = stage.next(&network) {
        match step.run(&network, pictures, &Monitor::new()) {
            Ok(Advance { network: after, .. }) => network = after,
            Err(Halt::Failed(error)) => return stage.conclude(&network, Some(&error)),
            Err(Halt::Interrupted) => unreachable!("nobody interrupts"),
        }
    }
    stage.conclude(&network, None)
}
