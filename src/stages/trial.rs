//! Measurements without pictures for the trials of the stages.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::Vector2;

use super::detect::adopt;
use super::{Halt, Pictures};
use crate::imaging::GreyImage;
use crate::monitor::Monitor;
use crate::network::{
    CameraEntry, CameraId, CodeDot, Finding, ImageEntry, ImageFile, ImageId, InteriorSource,
    Network, PointId, Stage,
};
use crate::synthetic::{
    Experiment, PanelSettings, SimulatedObservation, panel, simulate_observations,
};
use crate::targets::{CodeEvidence, CodeReading, Detections, Dot, DotIndex, Family};

/// Noise of simulated dots, px.
pub(super) const SIGMA_PX: f64 = 0.02;

/// Pictures that nobody may ask for.
pub(super) struct NoPictures;

impl Pictures for NoPictures {
    fn load(&self, image: &ImageEntry, _monitor: &Monitor) -> Result<GreyImage, String> {
        Err(format!("{}: a trial has no pictures", image.file.path))
    }
}

/// A panel of `dot420` codes seen from all sides.
pub(super) fn code_panel(stations: usize) -> Experiment {
    code_panel_with(0, stations)
}

/// The same with plain targets between the codes.
pub(super) fn code_panel_with(plain_targets: usize, stations: usize) -> Experiment {
    panel(&PanelSettings {
        family: Family::Dot420,
        codes: 12,
        plain_targets,
        stations,
        ..PanelSettings::default()
    })
    .expect("a panel with room for its codes")
}

/// What detection would give: every dot that is seen, all codes that are whole.
pub(super) fn measured(experiment: &Experiment) -> Network {
    let simulated = simulate_observations(
        &experiment.scene,
        &experiment.camera,
        &experiment.poses(),
        SIGMA_PX,
        1,
    );
    let mut network = images_that_show(&vec![&[][..]; simulated.len()]);
    let nominal = experiment.nominal_camera();
    let camera = network.camera_mut(CameraId(1));
    camera.camera = nominal.clone();
    camera.nominal = nominal;
    for (number, observations) in (1..).zip(&simulated) {
        adopt(network.image_mut(ImageId(number)), detections(observations));
    }
    network
}

fn detections(observations: &[SimulatedObservation]) -> Detections {
    let mut places: BTreeMap<PointId, DotIndex> = BTreeMap::new();
    let mut dots = Vec::new();
    for observation in observations {
        if let Ok(point) = observation.label.parse() {
            places.insert(point, DotIndex(dots.len() as u32));
        }
        dots.push(dot(observation.centre_px));
    }
    let codes = places
        .keys()
        .filter(|point| {
            matches!(
                point,
                PointId::Code {
                    dot: CodeDot::O,
                    ..
                }
            )
        })
        .filter_map(|point| {
            let (family, id) = point.code()?;
            let of_code = PointId::of_code(family, id);
            let dots = of_code
                .iter()
                .map(|p| places.get(p).copied())
                .collect::<Option<_>>()?;
            Some(CodeReading {
                family,
                id,
                dots,
                misfit: 0.0,
                doubt: None,
                evidence: CodeEvidence::default(),
            })
        })
        .collect();
    Detections {
        dots,
        codes,
        ..Detections::default()
    }
}

fn dot(centre_px: Vector2<f64>) -> Dot {
    Dot {
        centre_px,
        sigma_px: SIGMA_PX,
        major_px: 12.0,
        minor_px: 12.0,
        angle: 0.0,
        contrast: 100.0,
        background: 10.0,
    }
}

/// A `dot420` reading of the six dots from this one on.
pub(super) fn reading(id: u32, first_dot: u32) -> CodeReading {
    CodeReading {
        family: Family::Dot420,
        id,
        dots: (first_dot..first_dot + 6).map(DotIndex).collect(),
        misfit: 0.0,
        doubt: None,
        evidence: CodeEvidence::default(),
    }
}

/// Images that show these codes, somewhere.
pub(super) fn images_that_show(codes_of_images: &[&[u32]]) -> Network {
    let mut network = Network::default();
    let nominal = code_camera();
    let camera = CameraEntry {
        name: "trial".into(),
        camera: nominal.clone(),
        nominal,
        known_sigmas: [None; 10],
        parameters: Default::default(),
        stated: Default::default(),
        source: InteriorSource::CameraFile,
        exif_model: None,
    };
    Arc::make_mut(&mut network.cameras).insert(CameraId(1), Arc::new(camera));
    for (number, codes) in (1..).zip(codes_of_images) {
        let file = ImageFile {
            path: format!("image{number}.png"),
            size_bytes: 0,
            sha256: String::new(),
            width_px: 3072,
            height_px: 2048,
        };
        let mut image = ImageEntry::new(file, CameraId(1));
        let detections = Detections {
            codes: (0..)
                .zip(*codes)
                .map(|(place, &id)| reading(id, 6 * place))
                .collect(),
            ..Detections::default()
        };
        image.detections = Some(Arc::new(detections));
        Arc::make_mut(&mut network.images).insert(ImageId(number), Arc::new(image));
    }
    network
}

pub(super) fn code_camera() -> crate::camera::Camera {
    crate::camera::Camera {
        width_px: 3072,
        height_px: 2048,
        pixel_pitch_mm: 0.009,
        interior: crate::camera::InteriorOrientation::pinhole(20.0),
    }
}

/// All steps of the stages up to this one, as a session does them.
pub(super) fn run(mut network: Network, until: Stage) -> Network {
    let monitor = Monitor::default();
    for stage in Stage::ALL.into_iter().filter(|stage| *stage <= until) {
        let mut failure = None;
        while let Some(step) = stage.next(&network) {
            match step.run(&network, &NoPictures, &monitor) {
                Ok(advance) => network = advance.network,
                Err(Halt::Failed(error)) => {
                    failure = Some(error);
                    break;
                }
                Err(Halt::Interrupted) => panic!("nobody interrupts a trial"),
            }
        }
        network = stage.conclude(&network, failure.as_ref());
    }
    network
}

/// The sentences of findings.
pub(super) fn texts(findings: &[Finding]) -> Vec<&str> {
    findings
        .iter()
        .map(|finding| finding.text.as_str())
        .collect()
}
