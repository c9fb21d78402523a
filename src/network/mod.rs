//! The measurement: names for the numbers.
//!
//! A [`Network`] is a value: everything the operator gave (images, cameras, bars, settings, decisions) and everything
//! the stages found (detections, labels, orientations, points, the adjustment). Its tables are `Arc<BTreeMap<..>>`, so a
//! copy costs a few pointers and a change copies only what it touches: whoever holds a network never sees it
//! half-changed. What a step changes never shares an `Arc` with what it does not: an image's detections stay where they
//! are when all stations move.
//!
//! Deliberately absent: files, threads, algorithms.

mod ambiguity;
mod camera;
mod connectivity;
mod expansion;
mod frame;
mod image;
mod label;
mod look;
mod names;
mod result;
mod settings;
mod stage;

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::geometry::Similarity;

pub use ambiguity::{Agreement, AmbiguousGroup, ReadTarget, Reading};
pub use camera::{CameraEntry, CameraId, InteriorSource, LensParameter, StatedScale};
pub use connectivity::{CODES_TO_CONNECT, Code, Connectivity, ImageConnectivity};
pub use expansion::{Expansion, REFERENCE_CELSIUS, length_at_reference, reason_of_length};
pub use frame::{Frame, FrameProblem, FrameResult};
pub use image::{
    Attempt, ImageEntry, ImageFile, ImageId, ImageUse, Label, NO_READING_BY_OPERATOR,
    REJECTED_BY_OPERATOR, SET_ASIDE_BY_OPERATOR, Source, Station,
};
pub use label::{CodeDot, PointId, PointKind, UnknownLabel};
pub use look::{Absence, AbsenceKind, Look, Sought};
pub use names::NameProblem;
pub use result::{
    AdjustedObservation, AdjustmentResult, BarResult, CameraResult, ComponentResult,
    IdentificationPass, Point, ScaleSource, Standing, Tentative,
};
pub use settings::{
    DevicePose, DotFamily, GrossErrors, IdentificationRule, MeasurementSettings, TargetSizes,
};
pub use stage::{About, Conclusion, Finding, FindingKind, Outcome, Stage};

/// One scale bar: a known distance between two points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScaleBar {
    /// Name of the bar.
    pub name: String,
    /// Label of one end.
    pub from: String,
    /// Label of the other end.
    pub to: String,
    /// Calibrated length, mm; [`Network::bar_length_mm`] is what it is at the photographs.
    pub length_mm: f64,
    /// Its standard deviation, mm.
    pub sigma_mm: f64,
    /// Whether it gives scale or only checks it.
    pub role: BarRole,
    /// What warmth did to it, from its calibration to the photographs; `None`: nothing is known of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expansion: Option<Expansion>,
}

/// What a scale bar is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BarRole {
    /// Enters the adjustment with its weight.
    Control,
    /// Is only compared with the result.
    Check,
}

/// What a point with known coordinates is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ControlRole {
    /// The free network is moved onto it by a best fit; nothing is bent.
    Align,
    /// Its coordinates enter the adjustment with their weights.
    Weighted,
    /// Its coordinates are not changed.
    Fixed,
    /// It is only compared with the result.
    Check,
}

/// A point with known coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlPoint {
    /// Label of the point.
    pub label: String,
    /// Known coordinates, mm; `None` where one is unknown.
    pub coordinates_mm: [Option<f64>; 3],
    /// Their standard deviations, mm.
    pub sigmas_mm: [Option<f64>; 3],
    /// What it is for.
    pub role: ControlRole,
}

/// One dot of the exterior orientation device (reference cross) in the device's own frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DevicePoint {
    /// Label of the dot.
    pub label: String,
    /// Coordinates, mm.
    pub position_mm: [f64; 3],
}

/// The whole measurement as a value.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Network {
    /// What was asked for.
    pub settings: Arc<MeasurementSettings>,
    /// Cameras.
    pub cameras: Arc<BTreeMap<CameraId, Arc<CameraEntry>>>,
    /// Images.
    pub images: Arc<BTreeMap<ImageId, Arc<ImageEntry>>>,
    /// Points whose coordinates are known at least approximately.
    pub points: Arc<BTreeMap<PointId, Arc<Point>>>,
    /// Names that plain targets have in place of `M` and their number: those of another program, or the operator's.
    #[serde(default)]
    pub names: Arc<BTreeMap<u32, String>>,
    /// The exterior orientation device; empty where none is used.
    pub device: Arc<Vec<DevicePoint>>,
    /// Scale bars.
    pub scale_bars: Arc<Vec<ScaleBar>>,
    /// Points with known coordinates.
    pub control: Arc<Vec<ControlPoint>>,
    /// The coordinate system that the result shall have.
    #[serde(default)]
    pub frame: Frame,
    /// The motion that brought the network out of its own frame into one by three points; `None` while it stands in its
    /// own or on control.
    #[serde(default)]
    pub moved_by: Option<Similarity>,
    /// Oriented images in the order in which they were connected.
    pub connection_order: Arc<Vec<ImageId>>,
    /// The passes of identification since the last change of inputs.
    pub passes: Arc<Vec<IdentificationPass>>,
    /// What the last pass left as perhaps a target.
    #[serde(default)]
    pub tentative: Arc<Vec<Tentative>>,
    /// Dots whose readings exclude each other as the last pass left them; [`Network::open_groups`] says which still wait.
    #[serde(default)]
    pub ambiguous: Arc<Vec<AmbiguousGroup>>,
    /// Which stages are done, and on what basis.
    pub conclusions: BTreeMap<Stage, Conclusion>,
    /// What the stages noticed.
    pub findings: Arc<Vec<Finding>>,
    /// The newest adjustment.
    pub adjustment: Option<Arc<AdjustmentResult>>,
    /// Counts changes of inputs (images, detections, the operator's decisions, settings), never of estimates.
    pub inputs: u64,
    /// The highest number that was given to a plain target; the next one gets a higher one.
    pub next_target: u32,
}

impl Network {
    /// The images in use, by id.
    pub fn used_images(&self) -> impl Iterator<Item = (ImageId, &ImageEntry)> {
        self.images
            .iter()
            .filter(|(_, i)| i.usage == ImageUse::Used)
            .map(|(id, i)| (*id, i.as_ref()))
    }

    /// The images in use that have an orientation, by id.
    pub fn oriented_images(&self) -> impl Iterator<Item = (ImageId, &ImageEntry, &Station)> {
        self.used_images()
            .filter_map(|(id, i)| i.station.as_ref().map(|s| (id, i, s)))
    }

    /// The camera of an image.
    ///
    /// # Panics
    /// Where the image names a camera that is not there, which would be our fault.
    #[must_use]
    pub fn camera_of(&self, image: &ImageEntry) -> &CameraEntry {
        &self.cameras[&image.camera]
    }

    /// An image to change.
    ///
    /// # Panics
    /// Where there is no such image, which would be our fault.
    pub fn image_mut(&mut self, id: ImageId) -> &mut ImageEntry {
        let images = Arc::make_mut(&mut self.images);
        Arc::make_mut(images.get_mut(&id).expect("an image of this network"))
    }

    /// A camera to change.
    ///
    /// # Panics
    /// Where there is no such camera, which would be our fault.
    pub fn camera_mut(&mut self, id: CameraId) -> &mut CameraEntry {
        let cameras = Arc::make_mut(&mut self.cameras);
        Arc::make_mut(cameras.get_mut(&id).expect("a camera of this network"))
    }

    /// Whether a stage has done its work on the present inputs.
    #[must_use]
    pub fn is_concluded(&self, stage: Stage) -> bool {
        self.conclusions
            .get(&stage)
            .is_some_and(|c| c.basis == self.inputs)
    }

    /// Passes of identification on the present inputs, and one more where there is an adjustment.
    #[must_use]
    pub fn knowledge(&self) -> usize {
        let adjusted = self.adjustment.as_ref();
        let passes = self.passes.iter().filter(|p| p.basis == self.inputs);
        passes.count() + usize::from(adjusted.is_some_and(|a| a.basis == self.inputs))
    }

    /// Why a code's reading is doubtful: it was set aside, or detection doubts it and the network does not bear it out.
    #[must_use]
    pub fn doubt_of<'a>(&self, image: &'a ImageEntry, reading: usize) -> Option<&'a str> {
        let aside = image.set_aside.get(&reading);
        let read = image.detections.as_ref()?.codes.get(reading)?;
        let doubt = read
            .doubt
            .as_ref()
            .filter(|_| !self.bears_out(image, reading));
        aside.or(doubt).map(String::as_str)
    }

    /// Whether the network bears out a reading: its image is oriented, its dots are used under the code's own name, and other
    /// images see these points too. The dots of a code that is read wrongly would all lie elsewhere: one of several that the
    /// adjustment rejects, as something hides part of it, speaks against that dot and not against the number.
    #[must_use]
    pub fn bears_out(&self, image: &ImageEntry, reading: usize) -> bool {
        /// Two rays pass each other closely anywhere on an epipolar line; a third does not by chance.
        const LEAST_RAYS: u32 = 3;
        let read = image.detections.as_ref().and_then(|d| d.codes.get(reading));
        let (Some(read), Some(_), false) =
            (read, &image.station, image.set_aside.contains_key(&reading))
        else {
            return false;
        };
        let points = PointId::of_code(read.family, read.id);
        let dots = read.dots.iter().zip(points);
        let borne_out = dots
            .filter(|(dot, point)| {
                let used = image
                    .labels
                    .get(dot)
                    .is_some_and(|label| label.point == *point && label.rejected.is_none());
                let rays = self.points.get(point).map_or(0, |point| point.rays);
                used && rays >= LEAST_RAYS
            })
            .count();
        borne_out > 0 && borne_out + 1 >= read.dots.len()
    }

    /// Adds a finding unless the same one is there already.
    pub fn note(&mut self, finding: Finding) {
        if !self.findings.contains(&finding) {
            Arc::make_mut(&mut self.findings).push(finding);
        }
    }

    /// Whether the newest adjustment belongs to the present inputs and stands in the frame that is asked for.
    #[must_use]
    pub fn adjustment_is_fresh(&self) -> bool {
        self.adjustment
            .as_ref()
            .is_some_and(|a| a.basis == self.inputs && self.frame_is_tried(a))
    }

    /// Whether an adjustment was made for the frame that is asked for; only the final one cares.
    #[must_use]
    pub fn frame_is_tried(&self, adjustment: &AdjustmentResult) -> bool {
        adjustment.stage != Stage::Adjust || adjustment.frame.asked == self.frame
    }
}
