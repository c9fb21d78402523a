//! What is doubtful in a network, with the evidence in words and what a decision would change.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::fmt;

use nalgebra::Vector2;

use crate::network::{
    AdjustedObservation, ImageEntry, ImageId, ImageUse, Network, PointId, Source, Standing,
};
use crate::project::edit::{Edit, SET_ASIDE_BY_OPERATOR};
use crate::targets::{Detections, Dot, DotIndex};
use crate::ui::action::Selection;
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
    /// A dot without a name near a predicted target.
    UnnamedDot,
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
            ReviewKind::UnnamedDot | ReviewKind::RejectedObservation | ReviewKind::HighResidual
        )
    }
}

impl fmt::Display for ReviewKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ReviewKind::DoubtfulCode => "doubtful code",
            ReviewKind::UnnamedDot => "dot without a name",
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
    /// What accepting changes; `None`: nothing.
    pub accept: Option<Edit>,
    /// What rejecting changes; `None`: nothing.
    pub reject: Option<Edit>,
    /// Place among items of its kind: smaller comes first.
    rank: f64,
}

impl ReviewItem {
    /// What tells it from other items.
    pub(super) fn key(&self) -> (ReviewKind, Selection) {
        (self.kind, self.about.clone())
    }
}

/// Everything doubtful in the images in use, by kind, best evidence first.
#[must_use]
pub fn review_items(network: &Network) -> Vec<ReviewItem> {
    let mut items: Vec<ReviewItem> = network
        .used_images()
        .flat_map(|(id, image)| items_of_image(network, id, image))
        .collect();
    items.sort_by(in_order);
    items
}

/// The order of the queue.
pub(super) fn in_order(a: &ReviewItem, b: &ReviewItem) -> Ordering {
    a.kind
        .cmp(&b.kind)
        .then(a.rank.total_cmp(&b.rank))
        .then_with(|| a.about.dot.cmp(&b.about.dot))
}

/// Everything doubtful in one image, without order.
pub(super) fn items_of_image(
    network: &Network,
    id: ImageId,
    image: &ImageEntry,
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
            let settled = code.dots.iter().all(|dot| {
                let label = self.image.labels.get(dot);
                label.is_some_and(|l| l.source == Source::Operator)
            });
            let Some(why) = aside.or(code.doubt.as_ref()) else {
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
                accept: Some(Edit::Renumber {
                    image: self.id,
                    reading,
                    id: code.id,
                }),
                reject: Some(Edit::SetAside {
                    image: self.id,
                    reading,
                }),
                rank: code.misfit,
            });
        }
        items
    }

    fn unnamed_dots(&self) -> Vec<ReviewItem> {
        let unnamed: Vec<(DotIndex, &Dot)> = self
            .dots()
            .filter(|(dot, _)| !self.image.labels.contains_key(dot))
            .collect();
        if unnamed.is_empty() {
            return Vec::new();
        }
        let predictions = self.missing_targets();
        let offer = |(index, dot): (DotIndex, &Dot)| {
            let from = predictions.partition_point(|p| p.place_px.x < dot.centre_px.x - NEAR_PX);
            let mut near: Vec<(f64, PointId)> = predictions[from..]
                .iter()
                .take_while(|p| p.place_px.x <= dot.centre_px.x + NEAR_PX)
                .map(|p| ((p.place_px - dot.centre_px).norm(), p.point))
                .filter(|(distance, _)| *distance <= NEAR_PX)
                .collect();
            near.sort_by(|a, b| a.0.total_cmp(&b.0));
            let (distance, point) = *near.first()?;
            Some(self.offered_name(index, point, distance, near.get(1)))
        };
        unnamed.into_iter().filter_map(offer).collect()
    }

    fn offered_name(
        &self,
        dot: DotIndex,
        point: PointId,
        distance: f64,
        rival: Option<&(f64, PointId)>,
    ) -> ReviewItem {
        let label = self.network.label(point);
        let mut evidence = format!(
            "{}: a dot without a name, {distance:.2} px from where {label} should be",
            self.name()
        );
        if let Some((distance, other)) = rival {
            let other = self.network.label(*other);
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
            reject: None,
            rank: distance,
        }
    }

    /// Points that no dot of this image is named by, where they should be seen, from left to right.
    fn missing_targets(&self) -> Vec<Prediction> {
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
                let place_px = camera.project(&station.pose.camera_from_point(&p.position))?;
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
                        None,
                    )
                }
                None => continue,
            };
            items.push(ReviewItem {
                kind,
                about: select_observation(self.id, *dot, Some(label.point)),
                evidence,
                accept,
                reject: Some(Edit::Reject {
                    image: self.id,
                    dot: *dot,
                }),
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
                    accept: None,
                    reject: Some(Edit::Reject {
                        image: self.id,
                        dot: index,
                    }),
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
mod tests {
    use super::*;
    use crate::ui::panels::fixture::network;
    use std::sync::Arc;

    fn with_dot(network: &mut Network, slot: usize, change: impl FnOnce(&mut Dot)) {
        let image = network.image_mut(ImageId(1));
        let detections = Arc::make_mut(image.detections.as_mut().unwrap());
        change(&mut detections.dots[slot]);
    }

    fn of_kind(network: &Network, kind: ReviewKind) -> Vec<ReviewItem> {
        let mut items = review_items(network);
        items.retain(|i| i.kind == kind);
        items
    }

    #[test]
    fn a_rejected_observation_can_be_restored_or_stay_rejected() {
        let items = of_kind(&network(), ReviewKind::RejectedObservation);
        let (image, dot) = (ImageId(1), DotIndex(1));
        assert_eq!(items.len(), 1);
        assert_eq!(items[0].accept, Some(Edit::Restore { image, dot }));
        assert_eq!(items[0].reject, Some(Edit::Reject { image, dot }));
        let expected = "img_1.png: M1 is rejected: residual 3 px; |w| = 9.0, residual 3.00 px";
        assert_eq!(items[0].evidence, expected);
        let mut decided = network();
        items[0]
            .accept
            .clone()
            .unwrap()
            .apply(&mut decided)
            .unwrap();
        assert!(of_kind(&decided, ReviewKind::RejectedObservation).is_empty());
    }

    #[test]
    fn a_doubtful_code_leaves_the_queue_by_either_decision() {
        let before = of_kind(&network(), ReviewKind::DoubtfulCode);
        assert_eq!(before.len(), 1, "the reading that is set aside");
        for edit in [before[0].accept.clone(), before[0].reject.clone()] {
            let mut network = network();
            edit.unwrap().apply(&mut network).unwrap();
            assert!(of_kind(&network, ReviewKind::DoubtfulCode).is_empty());
        }
    }

    #[test]
    fn a_dot_near_a_missing_target_is_offered_its_name() {
        let mut network = network();
        let image = network.images[&ImageId(1)].clone();
        let point: PointId = "C300.B".parse().unwrap();
        let station = image.station.as_ref().unwrap();
        let camera = &network.camera_of(&image).camera;
        // Straight ahead of the camera, so that it is in the picture.
        let ahead = station
            .pose
            .world_from_direction(&nalgebra::Vector3::new(0.0, 0.0, -1000.0));
        let position = station.pose.centre_in_world + ahead;
        let place = camera
            .project(&station.pose.camera_from_point(&position))
            .unwrap();
        let missing = crate::network::Point {
            position,
            covariance: None,
            rays: 2,
        };
        Arc::make_mut(&mut network.points).insert(point, Arc::new(missing));
        assert!(of_kind(&network, ReviewKind::UnnamedDot).is_empty());
        with_dot(&mut network, 4, |dot| {
            dot.centre_px = place + Vector2::new(0.6, 0.8)
        });
        let items = of_kind(&network, ReviewKind::UnnamedDot);
        let (image, dot) = (ImageId(1), DotIndex(4));
        assert_eq!(items.len(), 1);
        assert_eq!(items[0].accept, Some(Edit::Label { image, dot, point }));
        assert!(
            items[0]
                .evidence
                .contains("1.00 px from where C300.B should be")
        );
        assert!(items[0].evidence.contains("two points are as near"));
    }

    #[test]
    fn high_residuals_and_oblique_dots_come_last() {
        let mut network = network();
        with_dot(&mut network, 3, |dot| dot.minor_px = 0.2 * dot.major_px);
        let mut adjustment = network.adjustment.as_deref().unwrap().clone();
        adjustment.observations[0].test = 3.4;
        network.adjustment = Some(Arc::new(adjustment));
        let kinds: Vec<ReviewKind> = review_items(&network).iter().map(|i| i.kind).collect();
        assert!(kinds.is_sorted());
        assert_eq!(
            kinds[kinds.len() - 2..],
            [ReviewKind::HighResidual, ReviewKind::ObliqueDot]
        );
    }
}
