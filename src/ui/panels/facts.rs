//! What lists and tables say about an image, and where a point is seen.

use std::collections::BTreeMap;

use egui::{Color32, Sense, Ui, vec2};
use nalgebra::Vector2;

use crate::network::{
    About, AdjustedObservation, ImageEntry, ImageId, ImageUse, Network, PointId, ScaleSource,
    Standing,
};
use crate::targets::DotIndex;
use crate::ui::action::Selection;
use crate::ui::theme;

/// Whether an image has an orientation, and why not.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Orientation {
    /// It has one.
    Oriented,
    /// Nobody has tried.
    Waiting,
    /// The last attempt failed, for this reason.
    Failed(String),
    /// The picture cannot be read, for this reason.
    Unreadable(String),
}

impl Orientation {
    /// One word.
    pub(super) fn word(&self) -> &'static str {
        match self {
            Orientation::Oriented => "oriented",
            Orientation::Waiting => "waiting",
            Orientation::Failed(_) => "failed",
            Orientation::Unreadable(_) => "unreadable",
        }
    }

    /// Why it failed.
    pub(super) fn reason(&self) -> Option<&str> {
        match self {
            Orientation::Failed(reason) | Orientation::Unreadable(reason) => Some(reason),
            _ => None,
        }
    }

    /// Its colour; `None` for what is only waiting.
    pub(super) fn colour(&self) -> Option<Color32> {
        match self {
            Orientation::Oriented => Some(theme::CODE),
            Orientation::Waiting => None,
            Orientation::Failed(_) => Some(theme::DOUBTFUL),
            Orientation::Unreadable(_) => Some(theme::REJECTED),
        }
    }

    fn of(image: &ImageEntry) -> Self {
        if let Some(reason) = &image.unreadable {
            Orientation::Unreadable(reason.clone())
        } else if image.station.is_some() {
            Orientation::Oriented
        } else if let Some(attempt) = &image.attempt {
            Orientation::Failed(attempt.reason.clone())
        } else {
            Orientation::Waiting
        }
    }
}

/// What lists say about an image.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ImageFacts {
    pub(super) id: ImageId,
    /// Its path.
    pub(super) name: String,
    /// The last part of its path, or all of it where two images have the same.
    pub(super) short: String,
    pub(super) usage: ImageUse,
    pub(super) targets: usize,
    pub(super) labelled: usize,
    pub(super) codes: usize,
    pub(super) orientation: Orientation,
    /// Rms residual per coordinate of its used observations, px.
    pub(super) rms_px: Option<f64>,
    /// Findings about it.
    pub(super) findings: Vec<String>,
}

/// The facts of all images, by id.
pub(super) fn image_facts(network: &Network) -> Vec<ImageFacts> {
    let rms = rms_of_images(network);
    let mut findings: BTreeMap<ImageId, Vec<String>> = BTreeMap::new();
    for finding in network.findings.iter() {
        if let About::Image(id) = finding.about {
            findings.entry(id).or_default().push(finding.text.clone());
        }
    }
    let last = |path: &str| path.rsplit('/').next().unwrap_or(path).to_owned();
    let mut carriers: BTreeMap<String, usize> = BTreeMap::new();
    for image in network.images.values() {
        *carriers.entry(last(&image.file.path)).or_default() += 1;
    }
    let short = |path: &str| {
        let last = last(path);
        match carriers.get(&last) {
            Some(1) => last,
            _ => path.to_owned(),
        }
    };
    network
        .images
        .iter()
        .map(|(id, image)| ImageFacts {
            id: *id,
            name: image.file.path.clone(),
            short: short(&image.file.path),
            usage: image.usage,
            targets: image.detections.as_ref().map_or(0, |d| d.dots.len()),
            labelled: image.labels.len(),
            codes: image.detections.as_ref().map_or(0, |d| d.codes.len()),
            orientation: Orientation::of(image),
            rms_px: rms.get(id).copied(),
            findings: findings.remove(id).unwrap_or_default(),
        })
        .collect()
}

fn rms_of_images(network: &Network) -> BTreeMap<ImageId, f64> {
    let mut sums: BTreeMap<ImageId, (f64, f64)> = BTreeMap::new();
    for observation in used_observations(network) {
        let (sum, count) = sums.entry(observation.image).or_default();
        *sum += observation.residual_px.norm_squared();
        *count += 2.0;
    }
    sums.into_iter()
        .map(|(id, (sum, count))| (id, (sum / count).sqrt()))
        .collect()
}

/// The observations that the newest adjustment used.
pub(super) fn used_observations(network: &Network) -> impl Iterator<Item = &AdjustedObservation> {
    network
        .adjustment
        .iter()
        .flat_map(|a| &a.observations)
        .filter(|o| o.standing == Standing::Used)
}

/// A point in one image.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sight {
    pub(super) image: ImageId,
    pub(super) dot: DotIndex,
    /// Residual and the larger |w|, where the newest adjustment has them.
    pub(super) residual: Option<(Vector2<f64>, f64)>,
    /// Why it takes no part.
    pub(super) rejected: Option<String>,
}

/// The images in use that show a point, by id.
pub(super) fn sights(network: &Network, point: PointId) -> Vec<Sight> {
    let observations = network.adjustment.iter().flat_map(|a| &a.observations);
    let residuals: BTreeMap<(ImageId, DotIndex), (Vector2<f64>, f64)> = observations
        .filter(|o| o.point == point)
        .map(|o| ((o.image, o.dot), (o.residual_px, o.test)))
        .collect();
    let of_image = |(id, image): (ImageId, &ImageEntry)| {
        let (dot, label) = image.labels.iter().find(|(_, l)| l.point == point)?;
        Some(Sight {
            image: id,
            dot: *dot,
            residual: residuals.get(&(id, *dot)).copied(),
            rejected: label.rejected.clone(),
        })
    };
    network.used_images().filter_map(of_image).collect()
}

/// The name of an image's file.
pub(super) fn image_name(network: &Network, id: ImageId) -> &str {
    network
        .images
        .get(&id)
        .map_or("an image that is gone", |i| i.file.path.as_str())
}

/// Selects an image and nothing else.
pub(super) fn select_image(id: ImageId) -> Selection {
    Selection {
        image: Some(id),
        ..Selection::default()
    }
}

/// Selects a point and nothing else.
pub(super) fn select_point(id: PointId) -> Selection {
    Selection {
        point: Some(id),
        ..Selection::default()
    }
}

/// Selects a point by its dot in one image.
pub(super) fn select_observation(
    image: ImageId,
    dot: DotIndex,
    point: Option<PointId>,
) -> Selection {
    Selection {
        point,
        image: Some(image),
        dot: Some((image, dot)),
        ..Selection::default()
    }
}

/// Says that lengths are no true ones, where nothing gave the scale.
pub(super) fn arbitrary_scale(ui: &mut Ui, network: &Network) {
    let scale = network.adjustment.as_ref().map(|a| a.scale_from);
    if scale == Some(ScaleSource::Arbitrary) {
        mark(ui, Some(theme::DOUBTFUL));
        ui.label(ARBITRARY_SCALE).on_hover_text(
            "The first base counts 1000 mm. A scale bar, two control points, the reference cross or codes of known size \
             give true lengths.",
        );
    }
}

/// What stands beside lengths without a scale.
const ARBITRARY_SCALE: &str = "The scale is arbitrary: mm are no true millimetres.";

/// Diameter of a coloured mark, points.
const MARK: f32 = 9.0;

/// A coloured mark before a text: colour on the mark, so that the text stays legible in both themes.
pub(in crate::ui) fn mark(ui: &mut Ui, colour: Option<Color32>) {
    let (rect, _) = ui.allocate_exact_size(vec2(MARK, MARK), Sense::empty());
    if let Some(colour) = colour {
        ui.painter()
            .circle_filled(rect.center(), MARK / 2.0, colour);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ui::panels::fixture::network;

    #[test]
    fn facts_say_what_became_of_each_image() {
        let network = network();
        let facts = image_facts(&network);
        assert_eq!(facts.len(), 3);
        assert_eq!(facts[0].orientation, Orientation::Oriented);
        // Two used observations with (0.01, -0.02) px.
        let rms = (0.0005_f64 / 2.0).sqrt();
        assert!((facts[0].rms_px.unwrap() - rms).abs() < 1e-12);
        assert_eq!(facts[1].orientation.reason(), Some("too few codes"));
        assert_eq!(facts[2].usage, ImageUse::Excluded);
        assert_eq!(facts[1].findings.len(), 1);
    }

    #[test]
    fn images_are_named_by_their_file_where_that_tells_them_apart() {
        let mut network = network();
        for (id, path) in [(1, "../a/x.png"), (2, "../a/y.png"), (3, "../b/y.png")] {
            network.image_mut(ImageId(id)).file.path = path.into();
        }
        let names: Vec<String> = image_facts(&network).into_iter().map(|f| f.short).collect();
        assert_eq!(names, ["x.png", "../a/y.png", "../b/y.png"]);
    }

    #[test]
    fn sights_tell_residuals_and_rejections() {
        let network = network();
        let point = "M1".parse().unwrap();
        let found = sights(&network, point);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].residual, Some((Vector2::new(3.0, 0.0), 9.0)));
        assert_eq!(found[0].rejected.as_deref(), Some("residual 3 px"));
    }
}
