//! A scene with its camera and stations, and what of it is published to the one who measures.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{LabelledPoint, Scene, TruthDot, truth_dots};
use crate::camera::{Camera, InteriorOrientation};
use crate::geometry::Pose;

/// A camera station and the name of its picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Station {
    /// File name of the picture.
    pub image: String,
    /// Where the camera stands and how it looks.
    pub pose: Pose,
}

/// What is photographed, with which camera, from where.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Experiment {
    /// The scene.
    pub scene: Scene,
    /// The true camera.
    pub camera: Camera,
    /// What the maker of the lens states, mm.
    pub nominal_principal_distance_mm: f64,
    /// Stations in the order the pictures were taken.
    pub stations: Vec<Station>,
}

/// A scale bar as its certificate states it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PublishedBar {
    /// Name.
    pub name: String,
    /// Label of the first end point.
    pub from: String,
    /// Label of the second end point.
    pub to: String,
    /// Stated length, mm.
    pub length_mm: f64,
    /// Stated standard error, mm.
    pub sigma_mm: f64,
}

/// A scale bar's exact length.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BarTruth {
    /// Name.
    pub name: String,
    /// Label of the first end point.
    pub from: String,
    /// Label of the second end point.
    pub to: String,
    /// Exact length, mm.
    pub length_mm: f64,
}

/// Everything that is true of an experiment, as plain data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// World coordinates of every dot by label, mm.
    pub points: BTreeMap<String, [f64; 3]>,
    /// The dots of every picture, by file name.
    pub images: BTreeMap<String, Vec<TruthDot>>,
    /// The pose of every picture, by file name.
    pub stations: BTreeMap<String, Pose>,
    /// The camera.
    pub camera: Camera,
    /// The scale bars.
    pub bars: Vec<BarTruth>,
}

impl Experiment {
    /// The camera as one would write it down beforehand: frame, pitch and nominal principal distance, no distortion.
    #[must_use]
    pub fn nominal_camera(&self) -> Camera {
        Camera {
            interior: InteriorOrientation::pinhole(self.nominal_principal_distance_mm),
            ..self.camera.clone()
        }
    }

    /// The scale bars as their certificates state them.
    #[must_use]
    pub fn bars(&self) -> Vec<PublishedBar> {
        let published = |bar: &super::ScaleBar| PublishedBar {
            name: bar.name.clone(),
            from: bar.from.clone(),
            to: bar.to.clone(),
            length_mm: bar.known_length_mm,
            sigma_mm: bar.sigma_mm,
        };
        self.scene.bars.iter().map(published).collect()
    }

    /// The reference cross in its own frame; empty without one.
    #[must_use]
    pub fn cross_points(&self) -> &[LabelledPoint] {
        &self.scene.cross
    }

    /// The poses of the stations, in order.
    #[must_use]
    pub fn poses(&self) -> Vec<Pose> {
        self.stations.iter().map(|station| station.pose).collect()
    }

    /// All truth of all pictures, without rendering them.
    #[must_use]
    pub fn truth(&self) -> Truth {
        let images: Vec<Vec<TruthDot>> = self
            .stations
            .par_iter()
            .map(|station| truth_dots(&self.scene, &self.camera, &station.pose))
            .collect();
        let names = || self.stations.iter().map(|station| station.image.clone());
        let point = |disc: &super::Disc| (disc.label.clone(), disc.placement.origin.into());
        let bar = |bar: &super::ScaleBar| BarTruth {
            name: bar.name.clone(),
            from: bar.from.clone(),
            to: bar.to.clone(),
            length_mm: bar.true_length_mm,
        };
        Truth {
            points: self.scene.discs.iter().map(point).collect(),
            images: names().zip(images).collect(),
            stations: names().zip(self.poses()).collect(),
            camera: self.camera.clone(),
            bars: self.scene.bars.iter().map(bar).collect(),
        }
    }
}
