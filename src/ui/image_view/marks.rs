//! What is to be drawn over an image: gathered once from the document, drawn every frame.

use std::collections::BTreeMap;
use std::sync::Arc;

use egui::Color32;
use nalgebra::Vector2;

use super::prediction::{Predicted, missed_targets};
use crate::network::{
    AdjustedObservation, AdjustmentResult, CameraEntry, CameraId, ImageEntry, ImageId, Network,
    Point, PointId, Source, Standing,
};
use crate::targets::{CodeReading, Detections, Dot, DotIndex, Rejected};
use crate::ui::theme;

/// What a dot counts for; each has its colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DotClass {
    /// A named plain target or dot of the cross.
    Used,
    /// A dot of a code.
    Code,
    /// It has no name, or a doubtful one.
    Doubtful,
    /// It takes no part.
    Rejected,
}

impl DotClass {
    pub(super) fn colour(self) -> Color32 {
        match self {
            DotClass::Used => theme::USED,
            DotClass::Code => theme::CODE,
            DotClass::Doubtful => theme::DOUBTFUL,
            DotClass::Rejected => theme::REJECTED,
        }
    }

    pub(super) fn words(self) -> &'static str {
        match self {
            DotClass::Used => "used",
            DotClass::Code => "used, dot of a code",
            DotClass::Doubtful => "without a certain label",
            DotClass::Rejected => "rejected",
        }
    }
}

/// A dot with all that is said of it.
#[derive(Clone, Debug)]
pub(super) struct Mark {
    pub(super) index: DotIndex,
    pub(super) dot: Dot,
    /// Its name; in parentheses where only a code reading gives it.
    pub(super) label: Option<String>,
    pub(super) point: Option<PointId>,
    pub(super) class: DotClass,
    pub(super) origin: Origin,
    /// Why it is rejected, doubtful or without a name.
    pub(super) reason: Option<String>,
    /// The code reading it belongs to, by its place in the detections.
    pub(super) reading: Option<usize>,
    pub(super) observation: Option<AdjustedObservation>,
}

/// Where a dot and its name come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Origin {
    Automatic,
    /// Named by the operator.
    Named,
    /// Measured by the operator.
    Measured,
}

impl Origin {
    pub(super) fn words(self) -> &'static str {
        match self {
            Origin::Automatic => "automatic",
            Origin::Named => "labelled by the operator",
            Origin::Measured => "measured by the operator",
        }
    }
}

impl Mark {
    /// The name within its code ("O", "A", "1"): the code's number is written once for all its dots. `None` for a dot
    /// that is in no code, or has a name of its own.
    pub(super) fn part(&self) -> Option<&str> {
        let of_code = matches!(self.point, None | Some(PointId::Code { .. }));
        self.reading.filter(|_| of_code)?;
        let label = self.label.as_deref()?;
        let part = label.split_once('.').map_or("", |(_, part)| part);
        Some(part.trim_end_matches(')'))
    }
}

/// A code with its axes.
#[derive(Clone, Debug)]
pub(super) struct CodeMark {
    /// Its number; in parentheses where it is not used.
    pub(super) label: String,
    /// O, A, B of a six-dot code; the dot alone of a ring code.
    pub(super) axes: Vec<Vector2<f64>>,
    pub(super) doubt: Option<String>,
    /// Least distance between two of its dots, px; infinite for a single dot.
    pub(super) spacing_px: f64,
    /// Diameter of its first dot, px.
    pub(super) dot_px: f64,
}

impl CodeMark {
    fn of(
        entry: &ImageEntry,
        detections: &Detections,
        reading: usize,
        code: &CodeReading,
        doubt: Option<&str>,
    ) -> Self {
        let (family, number) = entry
            .code_of_reading(reading)
            .unwrap_or((code.family, code.id));
        let label = family.code_label(number);
        let dots = || {
            code.dots
                .iter()
                .filter_map(|d| detections.dots.get(d.slot()))
        };
        let mut spacing_px = f64::INFINITY;
        for (place, dot) in dots().enumerate() {
            for other in dots().skip(place + 1) {
                spacing_px = spacing_px.min((dot.centre_px - other.centre_px).norm());
            }
        }
        Self {
            label: match doubt {
                Some(_) => format!("({label})"),
                None => label,
            },
            axes: dots().take(3).map(|dot| dot.centre_px).collect(),
            doubt: doubt.map(str::to_owned),
            spacing_px,
            dot_px: dots().next().map_or(0.0, |dot| dot.major_px),
        }
    }

    pub(super) fn colour(&self) -> Color32 {
        match self.doubt {
            Some(_) => theme::DOUBTFUL,
            None => theme::CODE,
        }
    }
}

/// All marks of one image.
#[derive(Debug, Default)]
pub(super) struct Marks {
    pub(super) dots: Vec<Mark>,
    pub(super) codes: Vec<CodeMark>,
    pub(super) detections: Option<Arc<Detections>>,
    pub(super) missed: Vec<Predicted>,
    /// Median diameter of the dots, px.
    pub(super) dot_px: f64,
}

impl Marks {
    pub(super) fn of(&self, index: DotIndex) -> Option<&Mark> {
        self.dots.get(index.slot())
    }

    /// The refused candidate nearest to a place, within the diameter of a dot.
    pub(super) fn refused_near(&self, place_px: Vector2<f64>) -> Option<&Rejected> {
        let distance = |rejected: &Rejected| (rejected.place_px - place_px).norm();
        let all = self.detections.iter().flat_map(|d| &d.rejected);
        all.filter(|rejected| distance(rejected) <= self.dot_px)
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    /// The dot with a point's name.
    pub(super) fn of_point(&self, point: PointId) -> Option<&Mark> {
        self.dots.iter().find(|mark| mark.point == Some(point))
    }
}

/// Marks of the last document that was looked at.
#[derive(Default)]
pub(super) struct MarksCache {
    basis: Option<Basis>,
    marks: Arc<Marks>,
}

/// What the marks come from; it is held, so that no other value can take its place in memory.
struct Basis {
    image: ImageId,
    images: Arc<BTreeMap<ImageId, Arc<ImageEntry>>>,
    points: Arc<BTreeMap<PointId, Arc<Point>>>,
    names: Arc<BTreeMap<u32, String>>,
    cameras: Arc<BTreeMap<CameraId, Arc<CameraEntry>>>,
    adjustment: Option<Arc<AdjustmentResult>>,
}

impl Basis {
    fn of(network: &Network, image: ImageId) -> Self {
        Self {
            image,
            images: Arc::clone(&network.images),
            points: Arc::clone(&network.points),
            names: Arc::clone(&network.names),
            cameras: Arc::clone(&network.cameras),
            adjustment: network.adjustment.clone(),
        }
    }

    fn is_of(&self, network: &Network, image: ImageId) -> bool {
        let same_adjustment = match (&self.adjustment, &network.adjustment) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (None, None) => true,
            _ => false,
        };
        self.image == image
            && same_adjustment
            && Arc::ptr_eq(&self.images, &network.images)
            && Arc::ptr_eq(&self.points, &network.points)
            && Arc::ptr_eq(&self.names, &network.names)
            && Arc::ptr_eq(&self.cameras, &network.cameras)
    }
}

impl MarksCache {
    pub(super) fn get(&mut self, network: &Network, image: ImageId) -> Arc<Marks> {
        let known = self
            .basis
            .as_ref()
            .is_some_and(|basis| basis.is_of(network, image));
        if !known {
            self.marks = Arc::new(gathered(network, image));
            self.basis = Some(Basis::of(network, image));
        }
        Arc::clone(&self.marks)
    }
}

fn gathered(network: &Network, image: ImageId) -> Marks {
    let Some(entry) = network.images.get(&image) else {
        return Marks::default();
    };
    let missed = missed_targets(network, entry);
    let Some(detections) = &entry.detections else {
        return Marks {
            missed,
            dot_px: USUAL_DIAMETER_PX,
            ..Marks::default()
        };
    };
    let observations: BTreeMap<DotIndex, &AdjustedObservation> = network
        .adjustment
        .iter()
        .flat_map(|adjustment| &adjustment.observations)
        .filter(|observation| observation.image == image)
        .map(|observation| (observation.dot, observation))
        .collect();
    let of_codes = dots_of_codes(network, entry, detections);
    let dots = (0..)
        .zip(&detections.dots)
        .map(|(slot, dot)| {
            let index = DotIndex(slot);
            let code = of_codes.get(&index);
            mark(
                network,
                entry,
                (index, dot),
                code,
                observations.get(&index).copied(),
            )
        })
        .collect();
    let codes = detections.codes.iter().enumerate().map(|(reading, code)| {
        let doubt = network.doubt_of(entry, reading);
        CodeMark::of(entry, detections, reading, code, doubt)
    });
    Marks {
        dots,
        codes: codes.collect(),
        dot_px: median_diameter(&detections.dots),
        detections: Some(Arc::clone(detections)),
        missed,
    }
}

/// Diameter of a dot where no dot tells one, px.
const USUAL_DIAMETER_PX: f64 = 8.0;

fn median_diameter(dots: &[Dot]) -> f64 {
    let mut sizes: Vec<f64> = dots.iter().map(|dot| dot.major_px).collect();
    sizes.sort_by(f64::total_cmp);
    let median = sizes.get(sizes.len() / 2).copied();
    median.unwrap_or(USUAL_DIAMETER_PX)
}

/// What a code reading says of one of its dots.
struct OfCode {
    reading: usize,
    point: PointId,
    doubt: Option<String>,
}

fn dots_of_codes(
    network: &Network,
    entry: &ImageEntry,
    detections: &Detections,
) -> BTreeMap<DotIndex, OfCode> {
    let mut found = BTreeMap::new();
    for (reading, code) in detections.codes.iter().enumerate() {
        let doubt = network.doubt_of(entry, reading);
        for (dot, point) in code.dots.iter().zip(PointId::of_code(code.family, code.id)) {
            found.insert(
                *dot,
                OfCode {
                    reading,
                    point,
                    doubt: doubt.map(str::to_owned),
                },
            );
        }
    }
    found
}

fn mark(
    network: &Network,
    entry: &ImageEntry,
    (index, dot): (DotIndex, &Dot),
    code: Option<&OfCode>,
    observation: Option<&AdjustedObservation>,
) -> Mark {
    let label = entry.labels.get(&index);
    // An observation of an older adjustment may be of another name.
    let observation = observation.filter(|o| label.is_some_and(|label| label.point == o.point));
    let by_hand = entry
        .detections
        .as_ref()
        .is_some_and(|d| d.by_hand.contains(&index));
    let origin = match label {
        _ if by_hand => Origin::Measured,
        Some(label) if label.source == Source::Operator => Origin::Named,
        _ => Origin::Automatic,
    };
    let tested = observation.filter(|o| o.standing == Standing::Rejected);
    let tested = tested.map(|o| format!("rejected by the adjustment, |w| {:.1}", o.test));
    let (class, name, reason) = match (label, code) {
        (Some(label), _) => {
            let reason = label.rejected.clone().or(tested);
            let class = match (&reason, label.point) {
                (Some(_), _) => DotClass::Rejected,
                (None, PointId::Code { .. }) => DotClass::Code,
                (None, _) => DotClass::Used,
            };
            (class, Some(network.label(label.point)), reason)
        }
        (None, Some(code)) if !entry.rejected_dots.contains_key(&index) => {
            let class = if code.doubt.is_some() {
                DotClass::Doubtful
            } else {
                DotClass::Code
            };
            (
                class,
                Some(format!("({})", network.label(code.point))),
                code.doubt.clone(),
            )
        }
        (None, _) => {
            let rejected = entry.rejected_dots.get(&index);
            let class = match rejected {
                Some(_) => DotClass::Rejected,
                None => DotClass::Doubtful,
            };
            let reason = rejected.or_else(|| entry.unlabelled.get(&index));
            (class, None, reason.cloned())
        }
    };
    Mark {
        index,
        dot: dot.clone(),
        label: name,
        point: label.map(|label| label.point),
        class,
        origin,
        reason,
        reading: code.map(|code| code.reading),
        observation: observation.cloned(),
    }
}
