//! What is doubtful in a network, with the evidence in words and what a decision would change.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::fmt;

use nalgebra::Vector2;

use super::questions::question_items;
use crate::network::{
    AbsenceKind, AdjustedObservation, ImageEntry, ImageId, ImageUse, Network, PointId, Source,
    Standing,
};
use crate::project::edit::{Edit, SET_ASIDE_BY_OPERATOR};
use crate::targets::{Detections, Dot, DotIndex};
use crate::ui::action::Selection;
use crate::ui::image_view::{Directions, Facing, Misfit, Predicted, misfit_of, missed_with};
use crate::ui::panels::facts::select_observation;

/// A dot without a name is offered a target that is predicted within this distance, px: a few dot diameters, beyond
/// which neighbours are as likely.
const NEAR_PX: f64 = 10.0;

/// A used observation with a larger |w| is shown: one good one in 370 has it.
const HIGH_W: f64 = 3.0;

/// A dot whose axes have a smaller ratio is shown: it is seen 70 degrees or more from its normal, where the fit is weak.
const OBLIQUE_RATIO: f64 = 0.342;

/// Why an item is in the queue, in the order of the queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ReviewKind {
    /// A code reading with a doubt, or one that does not fit the network.
    DoubtfulCode,
    /// Dots whose readings exclude each other.
    AmbiguousGroup,
    /// A dot without a name near a predicted target.
    UnnamedDot,
    /// A target that should be seen, where detection found no dot.
    MissedTarget,
    /// The adjustment does not use it.
    RejectedObservation,
    /// It is used, but its residual is high.
    HighResidual,
    /// It is seen very obliquely.
    ObliqueDot,
}

impl ReviewKind {
    /// Whether its evidence comes from the newest adjustment.
    pub(super) fn needs_adjustment(self) -> bool {
        matches!(
            self,
            ReviewKind::AmbiguousGroup
                | ReviewKind::UnnamedDot
                | ReviewKind::MissedTarget
                | ReviewKind::RejectedObservation
                | ReviewKind::HighResidual
        )
    }
}

impl fmt::Display for ReviewKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ReviewKind::DoubtfulCode => "doubtful code",
            ReviewKind::AmbiguousGroup => "ambiguous group",
            ReviewKind::UnnamedDot => "dot without a name",
            ReviewKind::MissedTarget => "missed target",
            ReviewKind::RejectedObservation => "rejected observation",
            ReviewKind::HighResidual => "high residual",
            ReviewKind::ObliqueDot => "oblique dot",
        })
    }
}

/// Something doubtful that waits for the operator.
#[derive(Clone, Debug, PartialEq)]
pub struct ReviewItem {
    /// Why it is here.
    pub kind: ReviewKind,
    /// Where to look.
    pub about: Selection,
    /// What speaks for and against it.
    pub evidence: String,
    /// What accepting changes; `None`: for a missed target, the dot that is measured there.
    pub accept: Option<Edit>,
    /// What rejecting changes.
    pub reject: Edit,
    /// Place among items of its kind: smaller comes first.
    pub(super) rank: f64,
}

impl ReviewItem {
    /// What tells it from other items.
    pub(super) fn key(&self) -> (ReviewKind, Selection) {
        // A predicted place moves with every adjustment, the target stays the same; so do the figures of readings.
        let about = Selection {
            place: None,
            question: None,
            ..self.about.clone()
        };
        (self.kind, about)
    }
}

/// Everything doubtful in the images in use, by kind, best evidence first.
#[must_use]
pub fn review_items(network: &Network) -> Vec<ReviewItem> {
    let directions = Directions::of(network);
    let mut items: Vec<ReviewItem> = network
        .used_images()
        .flat_map(|(id, image)| items_of_image(network, id, image, &directions))
        .chain(question_items(network))
        .collect();
    items.sort_by(in_order);
    items
}

/// The order of the queue.
pub(super) fn in_order(a: &ReviewItem, b: &ReviewItem) -> Ordering {
    a.kind
        .cmp(&b.kind)
        .then(a.rank.total_cmp(&b.rank))
        .then_with(|| {
            (a.about.dot, a.about.image, a.about.point).cmp(&(
                b.about.dot,
                b.about.image,
                b.about.point,
            ))
        })
}

/// Everything doubtful in one image, without order.
pub(super) fn items_of_image(
    network: &Network,
    id: ImageId,
    image: &ImageEntry,
    directions: &Directions,
) -> Vec<ReviewItem> {
    let Some(detections) = &image.detections else {
        return Vec::new();
    };
    if image.usage == ImageUse::Excluded {
        return Vec::new();
    }
    let view = View {
        network,
        id,
        image,
        detections,
    };
    let mut items = view.doubtful_codes();
    items.extend(view.unnamed_dots());
    items.extend(view.missed_targets(directions));
    items.extend(view.doubtful_observations());
    items.extend(view.oblique_dots());
    items
}

/// One image with its detections.
struct View<'a> {
    network: &'a Network,
    id: ImageId,
    image: &'a ImageEntry,
    detections: &'a Detections,
}

/// A target that should be seen.
struct Prediction {
    point: PointId,
    place_px: Vector2<f64>,
}

impl View<'_> {
    fn name(&self) -> &str {
        &self.image.file.path
    }

    fn doubtful_codes(&self) -> Vec<ReviewItem> {
        let mut items = Vec::new();
        for (reading, code) in self.detections.codes.iter().enumerate() {
            let aside = self.image.set_aside.get(&reading);
            let settled = self.image.is_reading_of_operator(reading);
            let Some(why) = self.network.doubt_of(self.image, reading) else {
                continue;
            };
            if why == SET_ASIDE_BY_OPERATOR || settled {
                continue;
            }
            let label = code.family.code_label(code.id);
            let state = if aside.is_some() {
                "set aside"
            } else {
                "doubtful"
            };
            let first = code.dots.first().copied();
            items.push(ReviewItem {
                kind: ReviewKind::DoubtfulCode,
                about: Selection {
                    image: Some(self.id),
                    dot: first.map(|dot| (self.id, dot)),
                    ..Selection::default()
                },
                evidence: format!("{}: code {label} is {state}: {why}", self.name()),
                accept: Some(Edit::AcceptCode {
                    image: self.id,
                    reading,
                }),
                reject: Edit::SetAside {
                    image: self.id,
                    reading,
                },
                rank: code.misfit,
            });
        }
        items
    }

    fn unnamed_dots(&self) -> Vec<ReviewItem> {
        let unnamed: Vec<(DotIndex, &Dot)> = self
            .dots()
            .filter(|(dot, _)| !self.is_settled(*dot))
            .collect();
        if unnamed.is_empty() {
            return Vec::new();
        }
        let predictions = self.predictions();
        let offer = |(index, dot): (DotIndex, &Dot)| {
            let from = predictions.partition_point(|p| p.place_px.x < dot.centre_px.x - NEAR_PX);
            let mut near: Vec<(Misfit, PointId)> = predictions[from..]
                .iter()
                .take_while(|p| p.place_px.x <= dot.centre_px.x + NEAR_PX)
                .filter(|p| (p.place_px - dot.centre_px).norm() <= NEAR_PX)
                .filter_map(|p| {
                    let misfit = misfit_of(self.network, self.image, p.point, dot.centre_px)?;
                    Some((misfit, p.point))
                })
                .collect();
            near.sort_by(|a, b| a.0.rank.total_cmp(&b.0.rank));
            let (misfit, point) = *near.first()?;
            Some(self.offered_name(index, point, misfit, near.get(1)))
        };
        unnamed.into_iter().filter_map(offer).collect()
    }

    fn offered_name(
        &self,
        dot: DotIndex,
        point: PointId,
        misfit: Misfit,
        rival: Option<&(Misfit, PointId)>,
    ) -> ReviewItem {
        let label = self.network.label(point);
        let mut evidence = format!(
            "{}: a dot without a name, {:.2} px ({:.1} sigma) from where {label} should be",
            self.name(),
            misfit.distance_px,
            misfit.sigmas
        );
        if let Some((misfit, other)) = rival {
            let (other, distance) = (self.network.label(*other), misfit.distance_px);
            evidence += &format!("; {other} should be {distance:.2} px away");
        }
        if let Some(reason) = self.image.unlabelled.get(&dot) {
            evidence += &format!("; left without a name: {reason}");
        }
        ReviewItem {
            kind: ReviewKind::UnnamedDot,
            about: select_observation(self.id, dot, Some(point)),
            evidence,
            accept: Some(Edit::Label {
                image: self.id,
                dot,
                point,
            }),
            reject: Edit::Reject {
                image: self.id,
                dot,
            },
            rank: misfit.distance_px,
        }
    }

    /// Whether a dot has a name, or the operator said that it is none.
    fn is_settled(&self, dot: DotIndex) -> bool {
        self.image.labels.contains_key(&dot) || self.image.rejected_dots.contains_key(&dot)
    }

    /// Targets that the last look missed for a reason that leaves hope; before a look those that are turned this way, that other images
    /// see from near here, and that have no dot here. Those first that detection saw something of, then those that face the camera
    /// best.
    fn missed_targets(&self, directions: &Directions) -> Vec<ReviewItem> {
        let unnamed: Vec<Vector2<f64>> = self
            .dots()
            .filter(|(dot, _)| !self.is_settled(*dot))
            .map(|(_, dot)| dot.centre_px)
            .collect();
        let near = |place: &Vector2<f64>, other: &Vector2<f64>| (place - other).norm() <= NEAR_PX;
        missed_with(self.network, self.image, directions)
            .into_iter()
            .filter(|missed| missed.facing == Facing::Towards)
            .filter(|missed| match missed.absence {
                None => true,
                // Of what is seen flatly faint light is all that can be expected.
                Some(AbsenceKind::Weak) => missed.turned == Facing::Towards,
                Some(kind) => kind.is_doubtful(),
            })
            // Such a dot is offered the name already.
            .filter(|missed| !unnamed.iter().any(|dot| near(&missed.place_px, dot)))
            .map(|missed| {
                let refused = self.detections.rejected.iter();
                let refused = refused
                    .filter(|r| near(&missed.place_px, &r.place_px))
                    .min_by(|a, b| {
                        let distance = |place: &Vector2<f64>| (place - missed.place_px).norm();
                        distance(&a.place_px).total_cmp(&distance(&b.place_px))
                    });
                self.missed_target(&missed, refused.map(|r| r.reason.as_str()))
            })
            .collect()
    }

    fn missed_target(&self, missed: &Predicted, refused: Option<&str>) -> ReviewItem {
        /// Where detection saw something that it refused, a target is as likely as so many degrees nearer to its normal:
        /// most refusals are of faint light, seen flatly.
        const SEEN_BY_DETECTION: f64 = 15.0;
        let label = self.network.label(missed.point);
        let rays = self
            .network
            .points
            .get(&missed.point)
            .map_or(0, |point| point.rays);
        let mut evidence = format!("{}: {label} should be seen here", self.name());
        if let Some(angle) = missed.incidence_deg {
            evidence += &format!(", {angle:.0} deg from its normal");
        }
        if let Some(angle) = missed.nearest_deg {
            evidence += &format!(", {angle:.0} deg from the nearest of its {rays} rays");
        }
        let look = self
            .image
            .look
            .as_ref()
            .filter(|_| missed.absence.is_some());
        match look.and_then(|look| look.absent.get(&missed.point)) {
            Some(absence) => evidence += &format!("; {absence}"),
            None => evidence += "; no dot was found",
        }
        if let Some(reason) = refused {
            evidence += &format!("; detection refused one: {reason}");
        }
        ReviewItem {
            kind: ReviewKind::MissedTarget,
            about: Selection {
                point: Some(missed.point),
                image: Some(self.id),
                place: Some((self.id, missed.place_px.into())),
                ..Selection::default()
            },
            evidence,
            accept: None,
            reject: Edit::NotThere {
                image: self.id,
                point: missed.point,
            },
            rank: missed.incidence_deg.or(missed.nearest_deg).unwrap_or(90.0)
                - refused.map_or(0.0, |_| SEEN_BY_DETECTION),
        }
    }

    /// Points that no dot of this image is named by, where they should be seen, from left to right.
    fn predictions(&self) -> Vec<Prediction> {
        let Some(station) = &self.image.station else {
            return Vec::new();
        };
        let camera = &self.network.camera_of(self.image).camera;
        let named: BTreeSet<PointId> = self.image.labels.values().map(|l| l.point).collect();
        let mut predictions: Vec<Prediction> = self
            .network
            .points
            .iter()
            .filter(|(point, _)| !named.contains(point))
            .filter_map(|(point, p)| {
                let place_px =
                    camera.image_of_target(&station.pose, &p.position, p.circle.as_ref())?;
                camera.contains(&place_px).then_some(Prediction {
                    point: *point,
                    place_px,
                })
            })
            .collect();
        predictions.sort_by(|a, b| a.place_px.x.total_cmp(&b.place_px.x));
        predictions
    }

    fn doubtful_observations(&self) -> Vec<ReviewItem> {
        let observations = self.observations();
        let mut items = Vec::new();
        for (dot, label) in self.image.labels.iter() {
            if label.source == Source::Operator {
                continue;
            }
            let observation = observations
                .binary_search_by_key(dot, |o| o.dot)
                .ok()
                .map(|place| &observations[place])
                .filter(|o| o.point == label.point);
            let name = self.network.label(label.point);
            let figures = observation.map_or(String::new(), |o| {
                format!(
                    "; |w| = {:.1}, residual {:.2} px",
                    o.test,
                    o.residual_px.norm()
                )
            });
            let test = observation.map_or(0.0, |o| o.test);
            let (kind, evidence, accept) = match &label.rejected {
                Some(reason) => (
                    ReviewKind::RejectedObservation,
                    format!("{}: {name} is rejected: {reason}{figures}", self.name()),
                    Some(Edit::Restore {
                        image: self.id,
                        dot: *dot,
                    }),
                ),
                None if test > HIGH_W
                    && observation.is_some_and(|o| o.standing == Standing::Used) =>
                {
                    (
                        ReviewKind::HighResidual,
                        format!(
                            "{}: {name} is used with a high residual{figures}",
                            self.name()
                        ),
                        Some(Edit::Accept {
                            image: self.id,
                            dot: *dot,
                        }),
                    )
                }
                None => continue,
            };
            items.push(ReviewItem {
                kind,
                about: select_observation(self.id, *dot, Some(label.point)),
                evidence,
                accept,
                reject: Edit::Reject {
                    image: self.id,
                    dot: *dot,
                },
                rank: -test,
            });
        }
        items
    }

    fn oblique_dots(&self) -> Vec<ReviewItem> {
        let labelled = self.dots().filter_map(|(index, dot)| {
            let label = self.image.labels.get(&index)?;
            let open = label.source == Source::Automatic && label.rejected.is_none();
            open.then_some((index, dot, label.point))
        });
        labelled
            .filter(|(_, dot, _)| dot.minor_px < OBLIQUE_RATIO * dot.major_px)
            .map(|(index, dot, point)| {
                let ratio = dot.minor_px / dot.major_px;
                ReviewItem {
                    kind: ReviewKind::ObliqueDot,
                    about: select_observation(self.id, index, Some(point)),
                    evidence: format!(
                        "{}: {} is seen {:.0} deg from its normal: axes {:.1} x {:.1} px",
                        self.name(),
                        self.network.label(point),
                        ratio.clamp(0.0, 1.0).acos().to_degrees(),
                        dot.major_px,
                        dot.minor_px
                    ),
                    accept: Some(Edit::Accept {
                        image: self.id,
                        dot: index,
                    }),
                    reject: Edit::Reject {
                        image: self.id,
                        dot: index,
                    },
                    rank: ratio,
                }
            })
            .collect()
    }

    fn dots(&self) -> impl Iterator<Item = (DotIndex, &Dot)> {
        let dots = self.detections.dots.iter().enumerate();
        dots.map(|(slot, dot)| (DotIndex(slot as u32), dot))
    }

    /// The image's part of the newest adjustment, which is ordered by image and dot.
    fn observations(&self) -> &[AdjustedObservation] {
        let Some(adjustment) = &self.network.adjustment else {
            return &[];
        };
        let all = &adjustment.observations;
        let from = all.partition_point(|o| o.image < self.id);
        let to = all.partition_point(|o| o.image <= self.id);
        &all[from..to]
    }
}

#[cfg(test)]
#[path = "items_tests.rs"]
mod tests;
