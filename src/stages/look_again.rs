//! Second chances: with the network known, every image is looked at again where a target must be.
//!
//! The place, its covariance and the ellipse of the dot's image are predicted from the point, its circle, the image's orientation and
//! the camera, with their covariances. A dot too weak, too oblique or too near to a neighbour for detection is measured there, and
//! accepted only by its tests; what is not measured is written down with its reason, so that no target is missing without one.
//!
//! Cost: a measurement for each target that an image ought to show and does not; a picture read for each image that has any.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::identify::precision;
use super::{Advance, Halt, Pictures, Step};
use crate::adjustment::{EllipseSight, MeasuredEllipse, estimate_circle};
use crate::camera::Camera;
use crate::geometry::{Circle, Pose};
use crate::imaging::GreyImage;
use crate::matching::{Predictor, View};
use crate::monitor::Monitor;
use crate::network::{
    Absence, AbsenceKind, ImageEntry, ImageId, Label, Look, Network, PointId, Sought, Source,
    Station, Tentative,
};
use crate::targets::{
    Detections, Dot, DotIndex, Expected, ExpectedSettings, ExpectedView, NotThere, measure_expected,
};

/// Images of one step, and the steps of a large network at most; the same whatever the cores. Each step goes through all rays
/// for what there is to look for.
const BATCH: usize = 16;
const BATCHES: usize = 16;
/// A target at a greater angle of incidence, as a cosine (80 degrees), is not looked for.
const LEAST_COSINE: f64 = 0.17;
/// A target whose normal nobody knows is looked for within this angle (60 degrees, as a cosine) of an image that shows it.
const LEAST_COSINE_BETWEEN: f64 = 0.5;
/// A place that is predicted less exactly is not looked at, px: any dot might be the one.
const VAGUEST_PX: f64 = 1.5;
/// Two dots of a picture are one where their centres are nearer than this share of the larger diameter.
const SAME_DOT: f64 = 0.5;

/// The images of the next step: the first ones that nobody looked at, or not for what there is to look for by now. An edit that
/// changes neither needs no picture again.
pub(super) fn next(network: &Network) -> Option<Step> {
    network.adjustment.as_ref()?;
    let batch: Vec<ImageId> = network
        .oriented_images()
        .filter(|(_, image, _)| image.detections.is_some())
        .filter(|(_, image, _)| image.look.as_ref().is_none_or(|look| is_old(network, look)))
        .map(|(id, ..)| id)
        .take(BATCH.max(network.images.len() / BATCHES))
        .collect();
    (!batch.is_empty()).then_some(Step::LookAgain(batch))
}

/// Whether the inputs changed since a look, and with them what there is to look for.
fn is_old(network: &Network, look: &Look) -> bool {
    look.basis != network.inputs && look.sought != Sought::of(network)
}

/// Dots of all images that were measured where a target must be.
pub(super) fn expected_dots(network: &Network) -> usize {
    let images = network.images.values();
    images
        .filter_map(|image| image.detections.as_ref())
        .map(|detections| detections.expected.len())
        .sum()
}

/// Looks at a batch of images; an interrupt keeps those that were finished.
pub(super) fn run(
    mut network: Network,
    images: &[ImageId],
    pictures: &dyn Pictures,
    monitor: &Monitor,
) -> Result<Advance, Halt> {
    let task = monitor.task("looking for missing targets", images.len() as u64);
    let targets = targets(&network);
    let looked: Vec<Option<Looked>> = images
        .par_iter()
        .map(|id| {
            task.step().ok()?;
            look_at(&network, *id, &targets, pictures, monitor)
        })
        .collect();
    let complete = looked.iter().all(Option::is_some);
    if !complete && looked.iter().all(Option::is_none) {
        return Err(Halt::Interrupted);
    }
    for (id, looked) in images.iter().zip(looked) {
        if let Some(looked) = looked {
            looked.put_into(network.image_mut(*id));
        }
    }
    Ok(Advance { network, complete })
}

/// A point that images ought to show.
struct Target {
    /// `None`: two dots may show it, and a third image must confirm it.
    id: Option<PointId>,
    place: Vector3<f64>,
    covariance: Matrix3<f64>,
    /// Its edge, the normal on the side from which it is seen.
    circle: Option<Circle>,
    /// Unit vectors to the stations that see it.
    seen_from: Vec<Vector3<f64>>,
}

/// All points whose place is known well enough. What earlier batches of the look found counts for nothing here, so that it is the same
/// however the images are divided.
fn targets(network: &Network) -> Vec<Target> {
    let mut seen: BTreeMap<PointId, Vec<Vector3<f64>>> = BTreeMap::new();
    for (_, image, station) in network.oriented_images() {
        let expected = image.detections.as_ref().map(|d| d.expected.as_slice());
        let of_detection = image
            .used_labels()
            .filter(|(dot, _)| !expected.is_some_and(|expected| expected.contains(dot)));
        for (_, label) in of_detection {
            if let Some(point) = network.points.get(&label.point) {
                let towards = station.pose.centre_in_world - point.position;
                seen.entry(label.point)
                    .or_default()
                    .push(towards.normalize());
            }
        }
    }
    let needed = network.settings.min_rays.max(3);
    let points = network.points.iter();
    let known = points
        // The name of a code's dot does not hang on its rays.
        .filter(|(id, point)| point.rays >= if id.code().is_some() { 2 } else { needed })
        .filter_map(|(&id, point)| {
            let seen_from = seen.remove(&id)?;
            let side: Vector3<f64> = seen_from.iter().sum();
            Some(Target {
                id: Some(id),
                place: point.position,
                covariance: point.covariance?,
                circle: point.circle.map(|circle| circle.facing(&side)),
                seen_from,
            })
        });
    let tentative = network.tentative.iter().filter_map(|pair| {
        let towards = |(image, dot): &(ImageId, DotIndex)| {
            let image = network.images.get(image)?;
            let nameless = !image.labels.contains_key(dot);
            let station = image.station.as_ref().filter(|_| nameless)?;
            Some((station.pose.centre_in_world - pair.position).normalize())
        };
        Some(Target {
            id: None,
            place: pair.position,
            covariance: pair.covariance,
            circle: circle_of_pair(network, pair),
            seen_from: pair.dots.iter().map(towards).collect::<Option<_>>()?,
        })
    });
    known.chain(tentative).collect()
}

/// The circle on which the ellipses of a pair agree.
fn circle_of_pair(network: &Network, pair: &Tentative) -> Option<Circle> {
    let sights = pair.dots.iter().filter_map(|(image, dot)| {
        let image = network.images.get(image)?;
        let dot = &image.detections.as_ref()?.dots.get(dot.slot())?;
        let ellipse = MeasuredEllipse {
            major_px: dot.major_px,
            minor_px: dot.minor_px,
            angle: dot.angle,
            sigma_px: dot.sigma_px,
        };
        let camera = &network.camera_of(image).camera;
        EllipseSight::new(
            camera,
            &image.station.as_ref()?.pose,
            &pair.position,
            &ellipse,
        )
    });
    let sights: Vec<EllipseSight> = sights.collect();
    Some(estimate_circle(&sights)?.circle)
}

/// What a look brought.
struct Looked {
    look: Look,
    /// Dots with their points; those of tentative targets have none yet.
    found: Vec<(Option<PointId>, Dot)>,
}

impl Looked {
    /// Writes down why a target is not there; of a tentative one nobody expects it.
    fn note(&mut self, target: &Target, absence: Absence) {
        if let Some(id) = target.id {
            self.look.absent.insert(id, absence);
        }
    }

    fn put_into(self, image: &mut ImageEntry) {
        if !self.found.is_empty()
            && let Some(detections) = &mut image.detections
        {
            let detections: &mut Detections = Arc::make_mut(detections);
            let labels = Arc::make_mut(&mut image.labels);
            for (point, dot) in self.found {
                let index = DotIndex(detections.dots.len() as u32);
                detections.dots.push(dot);
                detections.expected.push(index);
                if let Some(point) = point {
                    let label = Label {
                        point,
                        source: Source::Automatic,
                        rejected: None,
                    };
                    labels.insert(index, label);
                }
            }
        }
        image.look = Some(Arc::new(self.look));
    }
}

/// An image as its missing targets are predicted in it.
struct Sight<'a> {
    camera: &'a Camera,
    pose: &'a Pose,
    predictor: Predictor,
    dots: &'a [Dot],
    image: &'a ImageEntry,
}

/// Looks at one image; `None` where the work was stopped.
fn look_at(
    network: &Network,
    id: ImageId,
    targets: &[Target],
    pictures: &dyn Pictures,
    monitor: &Monitor,
) -> Option<Looked> {
    let image = &network.images[&id];
    let mut looked = Looked {
        look: Look {
            basis: network.inputs,
            sought: Sought::of(network),
            ..Look::default()
        },
        found: Vec::new(),
    };
    let (Some(station), Some(detections)) = (&image.station, &image.detections) else {
        return Some(looked);
    };
    let sight = Sight::of(network, image, station, detections);
    let named: BTreeSet<PointId> = image.labels.values().map(|label| label.point).collect();
    let mut wanted = Vec::new();
    let missing = |target: &&Target| target.id.is_none_or(|id| !named.contains(&id));
    for target in targets.iter().filter(missing) {
        match sight.expected(target) {
            Some(Ok(expected)) if target.id.is_some_and(|id| image.not_there.contains(&id)) => {
                looked.note(target, Absence::denied(expected.centre_px));
            }
            Some(Ok(expected)) => wanted.push((target, expected)),
            Some(Err(absence)) => looked.note(target, absence),
            None => {}
        }
    }
    if wanted.is_empty() {
        return Some(looked);
    }
    let picture = match pictures.load(image, monitor) {
        Ok(picture) => picture,
        Err(_) if monitor.is_interrupted() => return None,
        Err(reason) => {
            for (target, expected) in &wanted {
                let absence = Absence {
                    place_px: expected.centre_px,
                    kind: AbsenceKind::Unreadable,
                    reason: format!("not looked for: {reason}"),
                };
                looked.note(target, absence);
            }
            looked.look.unreadable = Some(reason);
            return Some(looked);
        }
    };
    sight.measure(network, &picture, &wanted, &mut looked, monitor)?;
    Some(looked)
}

impl<'a> Sight<'a> {
    fn of(
        network: &'a Network,
        image: &'a ImageEntry,
        station: &'a Station,
        detections: &'a Detections,
    ) -> Self {
        let camera = &network.camera_of(image).camera;
        let view = View {
            camera: camera.clone(),
            pose: station.pose,
            precision: precision(network, image.camera, station),
            dots: Vec::new(),
        };
        Self {
            camera,
            pose: &station.pose,
            predictor: Predictor::new(&view),
            dots: &detections.dots,
            image,
        }
    }

    /// What the image ought to show of a target; an error where it cannot be looked for, `None` where the image does not show that side or
    /// place of the object.
    fn expected(&self, target: &Target) -> Option<Result<Expected, Absence>> {
        let towards = (self.pose.centre_in_world - target.place).normalize();
        let cosine = match &target.circle {
            Some(circle) => circle.normal.dot(&towards),
            None => {
                let seen = target.seen_from.iter().map(|other| other.dot(&towards));
                let nearest = seen.fold(-1.0, f64::max);
                if nearest > LEAST_COSINE_BETWEEN {
                    1.0
                } else {
                    0.0
                }
            }
        };
        if cosine <= 0.0 {
            return None;
        }
        let circle = target.circle.as_ref();
        let place_px = self
            .camera
            .image_of_target(self.pose, &target.place, circle)?;
        if !self.camera.contains(&place_px) {
            return None;
        }
        let absent = |kind, reason| {
            Some(Err(Absence {
                place_px,
                kind,
                reason,
            }))
        };
        if cosine < LEAST_COSINE {
            let incidence = cosine.acos().to_degrees();
            return absent(
                AbsenceKind::Oblique,
                format!("seen at {incidence:.0} degrees, too obliquely"),
            );
        }
        let covariance_px2 = self
            .predictor
            .covariance(&target.place, &target.covariance)?;
        let sigma = (covariance_px2.trace() / 2.0).sqrt();
        if sigma > VAGUEST_PX {
            return absent(
                AbsenceKind::Vague,
                format!("its place is known to {sigma:.1} px only"),
            );
        }
        // One without a circle is as its neighbours in the picture.
        let circle = target.circle.or_else(|| {
            Some(Circle {
                normal: towards,
                radius_mm: self.radius_of_nearest(target)?,
            })
        })?;
        let ellipse = self
            .camera
            .ellipse_of_target(self.pose, &target.place, &circle)?;
        Some(Ok(Expected {
            centre_px: place_px,
            covariance_px2,
            major_px: ellipse.major_px,
            minor_px: ellipse.minor_px,
            angle: ellipse.angle,
            blur_px: None,
            contrast: None,
        }))
    }

    /// Half diameter, at the distance of the target, of the dot nearest to where it is imaged, mm.
    fn radius_of_nearest(&self, target: &Target) -> Option<f64> {
        let place = self
            .camera
            .image_of_target(self.pose, &target.place, None)?;
        let distance = |dot: &Dot| (dot.centre_px - place).norm_squared();
        let nearest = self
            .dots
            .iter()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        let away = (self.pose.centre_in_world - target.place).norm();
        let focal_px = self.camera.interior.principal_distance / self.camera.pixel_pitch_mm;
        Some(0.5 * nearest.major_px * away / focal_px)
    }

    /// The dot that is there already, where one is.
    fn dot_at(&self, expected: &Expected) -> Option<(DotIndex, f64)> {
        let slots = self.dots.iter().enumerate();
        slots
            .map(|(slot, dot)| (slot, (dot.centre_px - expected.centre_px).norm()))
            .filter(|(slot, distance)| {
                *distance < SAME_DOT * expected.major_px.max(self.dots[*slot].major_px)
            })
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(slot, distance)| (DotIndex(slot as u32), distance))
    }

    /// Measures what is wanted; `None` where the work was stopped.
    fn measure(
        &self,
        network: &Network,
        picture: &GreyImage,
        wanted: &[(&Target, Expected)],
        looked: &mut Looked,
        monitor: &Monitor,
    ) -> Option<()> {
        let view = ExpectedView::new(picture, self.dots);
        let settings = ExpectedSettings::default();
        for (target, expected) in wanted {
            monitor.check().ok()?;
            let absent = |kind, reason| Absence {
                place_px: expected.centre_px,
                kind,
                reason,
            };
            if let Some((dot, distance)) = self.dot_at(expected) {
                let (kind, reason) = self.words_of_dot(network, dot, distance);
                looked.note(target, absent(kind, reason));
                continue;
            }
            match measure_expected(&view, expected, &settings) {
                Ok(dot) => looked.found.push((target.id, dot)),
                Err(reason) => {
                    let kind = kind_of(&reason);
                    looked.note(target, absent(kind, reason.to_string()));
                }
            }
        }
        self.refuse_twins(network, looked);
        Some(())
    }

    /// Two targets cannot both be the dot at one place; a tentative one gives way.
    fn refuse_twins(&self, network: &Network, looked: &mut Looked) {
        let found = std::mem::take(&mut looked.found);
        let near = |a: &Dot, b: &Dot| {
            (a.centre_px - b.centre_px).norm() < SAME_DOT * a.major_px.max(b.major_px)
        };
        for (index, (point, dot)) in found.iter().enumerate() {
            let twin = found.iter().enumerate().find(|(other, (rival, b))| {
                let counts = match (point, rival) {
                    (Some(_), None) => false,
                    (None, None) => *other < index,
                    _ => *other != index,
                };
                counts && near(dot, b)
            });
            match (twin, point) {
                (None, _) => looked.found.push((*point, dot.clone())),
                (Some((_, (Some(other), _))), Some(point)) => {
                    let absence = Absence {
                        place_px: dot.centre_px,
                        kind: AbsenceKind::Merged,
                        reason: format!("one dot there for it and for {}", network.label(*other)),
                    };
                    looked.look.absent.insert(*point, absence);
                }
                (Some(_), _) => {}
            }
        }
    }

    /// What a dot that is there already is, in words.
    fn words_of_dot(
        &self,
        network: &Network,
        dot: DotIndex,
        distance_px: f64,
    ) -> (AbsenceKind, String) {
        if let Some(label) = self.image.labels.get(&dot) {
            let label = network.label(label.point);
            let text = format!("the dot there, {distance_px:.2} px off, is {label}");
            return (AbsenceKind::Merged, text);
        }
        let reasons = [&self.image.rejected_dots, &self.image.unlabelled];
        let reason = reasons.iter().find_map(|reasons| reasons.get(&dot));
        let text = match reason {
            Some(reason) => {
                format!("the dot there, {distance_px:.2} px off, has no name: {reason}")
            }
            None => format!("the dot there, {distance_px:.2} px off, has no name"),
        };
        (AbsenceKind::Ambiguous, text)
    }
}

fn kind_of(reason: &NotThere) -> AbsenceKind {
    match reason {
        NotThere::Outside { .. } | NotThere::CutOffAtBorder => AbsenceKind::Border,
        NotThere::InShadowOf { .. } | NotThere::Touched => AbsenceKind::Merged,
        NotThere::Saturated { .. } | NotThere::Uneven { .. } => AbsenceKind::Glare,
        NotThere::Covered { .. } => AbsenceKind::Covered,
        NotThere::TooWeak { .. } | NotThere::TooUncertain { .. } => AbsenceKind::Weak,
        NotThere::Unpredicted => AbsenceKind::Vague,
        NotThere::TooLarge { .. }
        | NotThere::Unfitted
        | NotThere::NotRound { .. }
        | NotThere::OtherShape { .. } => AbsenceKind::Shape,
        NotThere::Elsewhere { .. } => AbsenceKind::Elsewhere,
    }
}
