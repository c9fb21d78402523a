//! The exterior orientation device (reference cross) in the images.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::Halt;
use crate::geometry::Pose;
use crate::monitor::Monitor;
use crate::network::{DevicePose, ImageEntry, ImageId, Label, Network, PointId, Source};
use crate::orientation::device::{DeviceSettings, ImageDot, recognise_device};
use crate::orientation::dlt::{DltSettings, direct_linear_transformation};
use crate::orientation::refine::{IdealPoint, refine_on_ideal_points};
use crate::targets::DotIndex;

/// The cross as one image shows it.
#[derive(Clone, Debug)]
pub(super) struct DeviceView {
    pub(super) image: ImageId,
    /// Dots by the device's points.
    pub(super) dots: BTreeMap<u16, DotIndex>,
    /// Poses in the device's frame, best first.
    pub(super) poses: Vec<Pose>,
    /// 1 where the device is imaged in the image centre, 0 in a corner.
    pub(super) centrality: f64,
}

/// Recognises the device in every image that has one dot or more without the name of a code.
///
/// Cost: images times (dots times their neighbours squared).
pub(super) fn device_views(network: &Network, monitor: &Monitor) -> Result<Vec<DeviceView>, Halt> {
    if network.device.is_empty() {
        return Ok(Vec::new());
    }
    let images: Vec<(ImageId, &ImageEntry)> = network
        .used_images()
        .filter(|(_, image)| image.detections.is_some())
        .collect();
    let task = monitor.task("recognising the cross", images.len() as u64);
    let views: Vec<Option<DeviceView>> = images
        .par_iter()
        .map(|(id, image)| {
            task.step()?;
            Ok(recognise(network, *id, image))
        })
        .collect::<Result<_, Halt>>()?;
    Ok(views.into_iter().flatten().collect())
}

fn recognise(network: &Network, id: ImageId, image: &ImageEntry) -> Option<DeviceView> {
    let detections = image.detections.as_ref()?;
    let camera = &network.camera_of(image).camera;
    let device: Vec<Vector3<f64>> = network
        .device
        .iter()
        .map(|p| Vector3::from(p.position_mm))
        .collect();
    let dots: Vec<ImageDot> = detections
        .dots
        .iter()
        .map(|dot| ImageDot {
            ideal: camera.ideal_from_pixel(&dot.centre_px),
            diameter_mm: Some(dot.major_px * camera.pixel_pitch_mm),
        })
        .collect();
    let ignored: Vec<usize> = image
        .labels
        .iter()
        .filter(|(_, label)| !matches!(label.point, PointId::Device(_)))
        .map(|(dot, _)| dot.slot())
        .chain(image.rejected_dots.keys().map(|dot| dot.slot()))
        .collect();
    let c = camera.interior.principal_distance;
    let settings = DeviceSettings {
        pixel_pitch_mm: camera.pixel_pitch_mm,
        dot_diameter_mm: Some(network.settings.targets.plain_dot_mm),
        ..DeviceSettings::default()
    };
    let found = recognise_device(&device, &dots, &ignored, c, &settings).ok()?;
    let named: BTreeMap<u16, DotIndex> = found
        .dots
        .iter()
        .enumerate()
        .filter_map(|(index, dot)| Some((index as u16, DotIndex((*dot)? as u32))))
        .collect();
    let points: Vec<IdealPoint> = named
        .iter()
        .map(|(index, dot)| IdealPoint {
            ideal: dots[dot.slot()].ideal,
            point: device[usize::from(*index)],
        })
        .collect();
    let nominal = found.poses.iter().map(|p| p.pose);
    let by_dlt = match network.settings.device_pose {
        DevicePose::Nominal => None,
        DevicePose::Dlt => dlt_pose(&points, c, camera.pixel_pitch_mm),
    };
    let poses = by_dlt.into_iter().chain(nominal).collect();
    let centre = points
        .iter()
        .map(|p| p.ideal)
        .sum::<nalgebra::Vector2<f64>>()
        / points.len().max(1) as f64;
    let half_diagonal =
        camera.pixel_pitch_mm * f64::from(camera.width_px).hypot(f64::from(camera.height_px)) / 2.0;
    let centrality = (1.0 - centre.norm() / half_diagonal).clamp(0.05, 1.0);
    Some(DeviceView {
        image: id,
        dots: named,
        poses,
        centrality,
    })
}

/// The paper's way: the eleven-parameter DLT converted to an exterior orientation, its interior orientation
/// disregarded, refined with the nominal principal distance; `None` where the device's shape leaves the DLT singular.
fn dlt_pose(points: &[IdealPoint], c: f64, pixel_pitch_mm: f64) -> Option<Pose> {
    let settings = DltSettings {
        image_sigma_mm: 0.1 * pixel_pitch_mm,
    };
    let start = direct_linear_transformation(points, &settings).ok()?.pose;
    refine_on_ideal_points(points, c, &start)
        .ok()
        .map(|fit| fit.pose)
}

/// Names the device's dots in an image; dots that carry a name keep it.
pub(super) fn label_device(network: &mut Network, view: &DeviceView) {
    let image = network.image_mut(view.image);
    let labels = Arc::make_mut(&mut image.labels);
    for (&index, &dot) in &view.dots {
        let point = PointId::Device(index);
        let elsewhere = labels.values().any(|label| label.point == point);
        if !elsewhere {
            labels.entry(dot).or_insert(Label {
                point,
                source: Source::Automatic,
                rejected: None,
            });
        }
    }
}
