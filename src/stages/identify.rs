//! Identification of the plain targets by multi-ray intersection, one pass a step; passes end when nothing more comes.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::{Matrix3, SMatrix, Vector3};
use rayon::prelude::*;

use super::code_shape::{CodeShapes, normal_of_code};
use super::look_again::expected_dots;
use super::set_aside::{OF_OTHER_TARGETS, codes_set_aside, set_code_aside};
use super::{Halt, adjust, circles};
use crate::matching::{
    Identification, IdentificationInput, IdentificationSettings, KnownCircle, KnownPoint, Leftover,
    LeftoverReason, Member, ObjectSpace, OrientationPrecision, Track, View, ViewDot, identify,
    identify_by_threshold,
};
use crate::monitor::{Interrupted, Monitor};
use crate::network::{
    AdjustmentResult, CameraId, Connectivity, Finding, IdentificationPass, IdentificationRule,
    ImageId, Label, Network, Point, PointId, ScaleSource, Source, Stage, Station, Tentative,
};
use crate::targets::{DotIndex, Family};

/// Most passes on the same inputs; the paper needed two.
const MAX_PASSES: usize = 8;

/// Names that are fewer than this share of all are no reason to adjust between two passes.
const WORTH_ADJUSTING: f64 = 0.001;

/// How far dots lie from predicted places before the plain targets have improved lens and orientations, px: lens
/// parameters from the codes alone do not yet hold in the corners.
const FIRST_TOLERANCE_PX: f64 = 0.3;

/// Least tolerance afterwards, px: three sigmas of a good dot.
const LEAST_TOLERANCE_PX: f64 = 0.06;

/// By how much of its diagonal the space of the known points is widened to hold all targets.
const SPACE_MARGIN: f64 = 0.5;

/// Whether another pass may name more dots of those that detection found.
pub(super) fn is_unfinished(network: &Network) -> bool {
    let done = passes(network);
    let more = |pass: &&IdentificationPass| pass.labelled > 0 || adjust::leaves_images_out(network);
    done.last().is_none_or(more) && done.len() < MAX_PASSES
}

/// Whether dots were measured, where targets must be, that no adjustment knows yet.
pub(super) fn has_new_dots(network: &Network) -> bool {
    expected_dots(network) != expected_dots_known(network)
}

/// Dots that were measured where targets must be before the last pass.
fn expected_dots_known(network: &Network) -> usize {
    let done = passes(network);
    done.last().map_or(0, |pass| pass.expected_dots as usize)
}

/// The passes on the present inputs.
fn passes(network: &Network) -> Vec<&IdentificationPass> {
    let passes = network.passes.iter();
    passes.filter(|p| p.basis == network.inputs).collect()
}

/// One pass: names dots of known points and new targets, then adjusts everything.
pub(super) fn run(network: &mut Network, monitor: &Monitor) -> Result<(), Halt> {
    let Scene {
        views,
        images,
        known,
        known_ids,
        neighbours,
    } = Scene::of(network, monitor)?;
    let sigma_station_mm = network
        .adjustment
        .as_ref()
        .map_or(0.0, |a| a.sigma_station_mm);
    let space = ObjectSpace::around(known.iter().map(|k| &k.position), SPACE_MARGIN);
    let offered: usize = views.iter().map(|v| v.dots.len()).sum();
    let expected = expected_dots(network);
    let mut labelled = 0;
    let mut new_points = 0;
    if let Some(space) = space {
        let plain: Vec<View> = views.iter().map(|v| v.view.clone()).collect();
        let input = IdentificationInput {
            views: &plain,
            neighbours: &neighbours,
            known: &known,
            space,
            station_sigma_mm: sigma_station_mm,
            image_tolerance_px: tolerance_px(network, monitor)?,
            ellipses: circles::ellipse_precision(network),
        };
        let settings = IdentificationSettings {
            min_rays: network.settings.min_rays as usize,
            ..IdentificationSettings::default()
        };
        let found = match network.settings.identification {
            IdentificationRule::Statistics => identify(&input, &settings, monitor)?,
            IdentificationRule::Paper => identify_by_threshold(&input, &settings, monitor)?,
        };
        let before = network.points.len();
        labelled = Names {
            images: &images,
            views: &views,
            known_ids: &known_ids,
        }
        .give(network, &found, monitor)?;
        new_points = network.points.len() - before;
    }
    let names: usize = network.images.values().map(|i| i.labels.len()).sum();
    // A few names more do not change the orientations: the final adjustment takes them up.
    let is_news = |names_more: usize| names_more as f64 > WORTH_ADJUSTING * names as f64;
    let unknown = expected.abs_diff(expected_dots_known(network));
    if is_news(labelled) || is_news(unknown) || adjust::leaves_images_out(network) {
        adjust::adjust(network, Stage::Identify, monitor)?;
    }
    let pass = IdentificationPass {
        basis: network.inputs,
        expected_dots: expected as u32,
        labelled: labelled as u32,
        remaining: offered.saturating_sub(labelled) as u32,
        points: new_points as u32,
        sigma_station_mm,
    };
    let passes = Arc::make_mut(&mut network.passes);
    passes.retain(|earlier| earlier.basis == pass.basis);
    passes.push(pass);
    Ok(())
}

fn tolerance_px(network: &Network, monitor: &Monitor) -> Result<f64, Interrupted> {
    let adjusted_with_targets =
        |a: &&Arc<AdjustmentResult>| matches!(a.stage, Stage::Identify | Stage::Adjust);
    let of_lens = match network.adjustment.as_ref().filter(adjusted_with_targets) {
        Some(adjustment) => (3.0 * adjustment.rms_px).clamp(LEAST_TOLERANCE_PX, FIRST_TOLERANCE_PX),
        None => FIRST_TOLERANCE_PX,
    };
    // Identification takes a dot for the image of its target's centre.
    Ok(of_lens.max(circles::largest_eccentricity(network, monitor)?))
}

/// An image's view for identification with the places of its dots in the image's detections.
pub(super) struct ImageView {
    view: View,
    pub(super) dots: Vec<DotIndex>,
}

/// The network in the numbers of identification.
struct Scene {
    views: Vec<ImageView>,
    images: Vec<ImageId>,
    known: Vec<KnownPoint>,
    known_ids: Vec<PointId>,
    neighbours: Vec<Vec<usize>>,
}

impl Scene {
    fn of(network: &Network, monitor: &Monitor) -> Result<Self, Interrupted> {
        let mut views = Vec::new();
        let mut images = Vec::new();
        for (id, image, station) in network.oriented_images() {
            monitor.check()?;
            let Some(detections) = &image.detections else {
                continue;
            };
            let dots: Vec<DotIndex> = (0..detections.dots.len() as u32)
                .map(DotIndex)
                .filter(|dot| network.awaits_name(image, *dot))
                .collect();
            let view_dots = dots
                .iter()
                .map(|dot| {
                    let dot = &detections.dots[dot.slot()];
                    ViewDot {
                        pixel: dot.centre_px,
                        sigma_px: dot.sigma_px,
                        major_px: dot.major_px,
                        minor_px: dot.minor_px,
                        angle: dot.angle,
                    }
                })
                .collect();
            let camera = network.camera_of(image).camera.clone();
            views.push(ImageView {
                view: View {
                    camera,
                    pose: station.pose,
                    precision: precision(network, image.camera, station),
                    dots: view_dots,
                },
                dots,
            });
            images.push(id);
        }
        let (known_ids, known): (Vec<PointId>, Vec<KnownPoint>) =
            known_points(network, &images).into_iter().unzip();
        let neighbours = match network.settings.identification {
            IdentificationRule::Statistics => neighbours(&views, &known, monitor)?,
            IdentificationRule::Paper => sharing_codes(network, &images),
        };
        Ok(Self {
            views,
            images,
            known,
            known_ids,
            neighbours,
        })
    }
}

/// Covariance of an orientation with its camera, where the last adjustment told it.
pub(super) fn precision(
    network: &Network,
    camera: CameraId,
    station: &Station,
) -> Option<OrientationPrecision> {
    let of_camera = network.adjustment.as_ref().map(|a| &a.cameras)?;
    let of_camera = of_camera.iter().find(|result| result.camera == camera)?;
    let (own, with_camera) = (station.covariance?, station.with_camera?);
    let mut joint = Box::new(SMatrix::<f64, 16, 16>::zeros());
    joint.fixed_view_mut::<6, 6>(0, 0).copy_from(&own);
    joint.fixed_view_mut::<6, 10>(0, 6).copy_from(&with_camera);
    joint
        .fixed_view_mut::<10, 6>(6, 0)
        .copy_from(&with_camera.transpose());
    joint
        .fixed_view_mut::<10, 10>(6, 6)
        .copy_from(&of_camera.covariance);
    Some(OrientationPrecision(joint))
}

/// For each image the others in which one of its codes is read.
fn sharing_codes(network: &Network, images: &[ImageId]) -> Vec<Vec<usize>> {
    let places: BTreeMap<ImageId, usize> = (0..).zip(images).map(|(i, id)| (*id, i)).collect();
    let mut neighbours = vec![Vec::new(); images.len()];
    for image in Connectivity::of(network).images {
        if let Some(&index) = places.get(&image.image) {
            let others = image.shared.keys();
            neighbours[index] = others.filter_map(|id| places.get(id).copied()).collect();
        }
    }
    neighbours
}

/// For each view those that ought to show one of the known points that it ought to show: sharing a code that is read in both, as the
/// paper has it, is more than needs be.
///
/// Cost: a bit for each pair of views and known point.
fn neighbours(
    views: &[ImageView],
    known: &[KnownPoint],
    monitor: &Monitor,
) -> Result<Vec<Vec<usize>>, Interrupted> {
    /// Largest angle to the normal, as a cosine, at which a target is seen.
    const LEAST_COSINE: f64 = 0.25;
    /// Without a normal: largest angle to a view that does see the point, as a cosine.
    const LEAST_COSINE_BETWEEN: f64 = 0.5;
    let centres: Vec<_> = views.iter().map(|v| v.view.pose.centre_in_world).collect();
    let shown = |(index, view): (usize, &ImageView)| {
        monitor.check()?;
        let View { camera, pose, .. } = &view.view;
        let mut bits = vec![0_u64; known.len().div_ceil(64)];
        for (place, point) in known.iter().enumerate() {
            let towards = (pose.centre_in_world - point.position).normalize();
            let faces = match &point.circle {
                Some(circle) => circle.normal.dot(&towards) > LEAST_COSINE,
                None => point.seen_in.iter().any(|other| {
                    let other = (centres[*other] - point.position).normalize();
                    other.dot(&towards) > LEAST_COSINE_BETWEEN
                }),
            };
            let in_frame = || {
                let pixel = camera.project(&pose.camera_from_point(&point.position));
                pixel.is_some_and(|pixel| camera.contains(&pixel))
            };
            if point.seen_in.contains(&index) || faces && in_frame() {
                bits[place / 64] |= 1 << (place % 64);
            }
        }
        Ok(bits)
    };
    let shown: Vec<Vec<u64>> = views
        .par_iter()
        .enumerate()
        .map(shown)
        .collect::<Result<_, Interrupted>>()?;
    let share = |a: usize, b: usize| shown[a].iter().zip(&shown[b]).any(|(x, y)| x & y != 0);
    let of_view = |a: usize| {
        (0..views.len())
            .filter(|b| *b != a && share(a, *b))
            .collect()
    };
    Ok((0..views.len()).into_par_iter().map(of_view).collect())
}

/// All points with coordinates; a code's dots face the way its axes say.
fn known_points(network: &Network, images: &[ImageId]) -> Vec<(PointId, KnownPoint)> {
    let mut seen_in: BTreeMap<PointId, Vec<usize>> = BTreeMap::new();
    for (index, id) in images.iter().enumerate() {
        for label in network.images[id].labels.values() {
            seen_in.entry(label.point).or_default().push(index);
        }
    }
    let metric = network
        .adjustment
        .as_ref()
        .is_some_and(|a| a.scale_from != ScaleSource::Arbitrary);
    network
        .points
        .iter()
        .map(|(&id, point)| {
            let of_code = || match id {
                PointId::Code {
                    family: Family::Dot420,
                    code,
                    ..
                } => normal_of_code(network, code).map(|normal| {
                    let diameter = network.settings.targets.of(Family::Dot420).dot_mm;
                    KnownCircle {
                        diameter_mm: metric.then_some(diameter),
                        normal,
                    }
                }),
                _ => None,
            };
            let seen_in = seen_in.remove(&id).unwrap_or_default();
            let carried = point.circle.map(|circle| KnownCircle {
                diameter_mm: Some(2.0 * circle.radius_mm),
                normal: circle
                    .facing(&side(network, images, &point.position, &seen_in))
                    .normal,
            });
            let known = KnownPoint {
                position: point.position,
                covariance: point.covariance.unwrap_or_else(Matrix3::zeros),
                seen_in,
                circle: carried.or_else(of_code),
            };
            (id, known)
        })
        .collect()
}

/// From a point to the middle of the views that see it.
fn side(
    network: &Network,
    images: &[ImageId],
    point: &Vector3<f64>,
    seen_in: &[usize],
) -> Vector3<f64> {
    let stations = seen_in
        .iter()
        .filter_map(|index| network.images[&images[*index]].station.as_ref());
    stations
        .map(|station| (station.pose.centre_in_world - point).normalize())
        .sum()
}

/// Puts the result of a pass into the network.
pub(super) struct Names<'a> {
    pub(super) images: &'a [ImageId],
    pub(super) views: &'a [ImageView],
    pub(super) known_ids: &'a [PointId],
}

impl Names<'_> {
    /// Returns the number of dots that got a name.
    fn give(
        &self,
        network: &mut Network,
        found: &Identification,
        monitor: &Monitor,
    ) -> Result<usize, Interrupted> {
        let mut labelled = 0;
        let by_operator = self.named_by_operator(network);
        for claim in &found.claims {
            monitor.check()?;
            let known = self.known_ids[claim.known];
            self.name(network, claim.member, known, &by_operator);
            labelled += 1;
        }
        let code_names = self.names_of_single_codes(network, &found.tracks);
        let mut names_of_tracks = Vec::with_capacity(found.tracks.len());
        for (index, track) in found.tracks.iter().enumerate() {
            let point = code_names.get(&index).copied().unwrap_or_else(|| {
                network.next_target += 1;
                PointId::Target(network.next_target)
            });
            monitor.check()?;
            names_of_tracks.push(point);
            let coordinates = Point {
                position: track.position,
                covariance: Some(track.covariance),
                rays: track.members.len() as u32,
                circle: None,
            };
            Arc::make_mut(&mut network.points).insert(point, Arc::new(coordinates));
            for member in &track.members {
                self.name(network, *member, point, &by_operator);
                labelled += 1;
            }
        }
        self.explain(network, &found.leftover);
        let tentative = found.pairs.iter().map(|pair| Tentative {
            position: pair.position,
            covariance: pair.covariance,
            dots: pair
                .members
                .map(|m| (self.images[m.view], self.views[m.view].dots[m.dot])),
        });
        network.tentative = Arc::new(tentative.collect());
        network.ambiguous = Arc::new(self.ambiguous(&found.groups, &names_of_tracks));
        Ok(labelled)
    }

    /// By view, the points that the operator named in it.
    fn named_by_operator(&self, network: &Network) -> Vec<BTreeSet<PointId>> {
        let of_image = |id: &ImageId| {
            let labels = network.images[id].labels.values();
            let by_operator = labels.filter(|label| label.source == Source::Operator);
            by_operator.map(|label| label.point).collect()
        };
        self.images.iter().map(of_image).collect()
    }

    /// Names a dot, where the operator named neither it nor another one so.
    fn name(
        &self,
        network: &mut Network,
        member: Member,
        point: PointId,
        by_operator: &[BTreeSet<PointId>],
    ) {
        let dot = self.views[member.view].dots[member.dot];
        let image = network.image_mut(self.images[member.view]);
        let named = image.labels.get(&dot);
        let is_operators = named.is_some_and(|label| label.source == Source::Operator);
        if is_operators || by_operator[member.view].contains(&point) {
            return;
        }
        let previous = image.labels.get(&dot).map(|label| label.point);
        if let Some((family, code)) = previous.filter(|p| *p != point).and_then(PointId::code) {
            set_code_aside(image, family, code, OF_OTHER_TARGETS);
        }
        let label = Label {
            point,
            source: Source::Automatic,
            rejected: None,
        };
        Arc::make_mut(&mut image.labels).insert(dot, label);
    }

    /// Codes that a single image shows have no coordinates yet; where the intersections of their dots have the shape of
    /// the code, the intersections get the code's names instead of new ones.
    fn names_of_single_codes(
        &self,
        network: &Network,
        tracks: &[Track],
    ) -> BTreeMap<usize, PointId> {
        let mut track_of_point: BTreeMap<PointId, BTreeSet<usize>> = BTreeMap::new();
        for (index, track) in tracks.iter().enumerate() {
            for member in &track.members {
                let dot = self.views[member.view].dots[member.dot];
                let image = &network.images[&self.images[member.view]];
                if let Some(label) = image.labels.get(&dot) {
                    track_of_point.entry(label.point).or_default().insert(index);
                }
            }
        }
        let unique: BTreeMap<PointId, usize> = track_of_point
            .into_iter()
            .filter(|(_, tracks)| tracks.len() == 1)
            .filter_map(|(point, tracks)| Some((point, *tracks.first()?)))
            .collect();
        let shapes = CodeShapes::of(network);
        let mut names = BTreeMap::new();
        for (&point, &index) in &unique {
            let PointId::Code { family, code, .. } = point else {
                continue;
            };
            let places: BTreeMap<PointId, _> = PointId::of_code(family, code)
                .into_iter()
                .filter_map(|p| Some((p, tracks[*unique.get(&p)?].position)))
                .collect();
            if shapes.fits(family, code, &places) {
                names.insert(index, point);
            }
        }
        names
    }

    fn explain(&self, network: &mut Network, leftover: &[Leftover]) {
        let mut reasons: BTreeMap<usize, BTreeMap<DotIndex, String>> = BTreeMap::new();
        for left in leftover {
            let dot = self.views[left.member.view].dots[left.member.dot];
            reasons
                .entry(left.member.view)
                .or_default()
                .insert(dot, in_words(&left.reason));
        }
        for (view, id) in self.images.iter().enumerate() {
            network.image_mut(*id).unlabelled = Arc::new(reasons.remove(&view).unwrap_or_default());
        }
    }
}

/// Readings whose dots turned out to be other targets.
pub(super) fn findings(network: &Network) -> Vec<Finding> {
    codes_set_aside(network, Stage::Identify, OF_OTHER_TARGETS)
}

fn in_words(reason: &LeftoverReason) -> String {
    match reason {
        LeftoverReason::NoPartner => "no dot of another image lies on its ray".into(),
        LeftoverReason::TooFewRays { found, needed } => {
            format!("its best intersection has {found} rays, {needed} are needed")
        }
        LeftoverReason::Accidental { rays, .. } => {
            format!("its {rays} rays may meet by accident")
        }
        LeftoverReason::OddSize { rays, diameter_mm } => format!(
            "its {rays} rays meet, but in a target of another size ({diameter_mm:.1} mm) than the others"
        ),
        LeftoverReason::Ambiguous { rays, rival_rays } => {
            format!("ambiguous: {rays} rays against {rival_rays} of another reading")
        }
        LeftoverReason::Contested { distance_px } => {
            format!(
                "{distance_px:.2} px from the predicted place of a target that another dot claims too"
            )
        }
    }
}
