use std::sync::Arc;

use nalgebra::{Matrix3, Rotation3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::geometry::Similarity;
use crate::network::{AdjustedObservation, DevicePoint, ImageId, Point, PointId, Standing};
use crate::report::fixture;
use crate::targets::DotIndex;

/// Errors of the adjusted points, mm; those of the list are ten times as large.
const NOISE_MM: f64 = 0.05;

/// A network of `codes` dots and then targets with known places, and the list of them under the names T1, T2, ...
struct Scene {
    random: ChaCha8Rng,
    labels: Vec<(String, Vector3<f64>)>,
    list: Vec<(String, Vector3<f64>)>,
}

impl Scene {
    /// Targets in a room of 1000 mm; M1 is T1, and so on.
    fn of_targets(count: usize, seed: u64) -> Self {
        let mut scene = Self {
            random: ChaCha8Rng::seed_from_u64(seed),
            labels: Vec::new(),
            list: Vec::new(),
        };
        for number in 1..=count {
            let place = scene.place();
            scene.add(&format!("M{number}"), &format!("T{number}"), place);
        }
        scene
    }

    fn add(&mut self, label: &str, name: &str, place: Vector3<f64>) {
        let (own, listed) = (self.off(NOISE_MM), self.off(10.0 * NOISE_MM));
        self.labels.push((label.into(), place + own));
        self.list.push((name.into(), place + listed));
    }

    /// Dots of codes C1, C2, ... that both know.
    fn with_codes(mut self, count: usize) -> Self {
        for number in 1..=count {
            let place = self.place();
            self.add(&format!("C{number}"), &format!("C{number}"), place);
        }
        self
    }

    /// Points that only one of the two knows.
    fn with_extras(mut self, count: usize) -> Self {
        for number in 0..count {
            let (own, listed) = (self.place(), self.place());
            self.labels.push((format!("M{}", 500 + number), own));
            self.list.push((format!("E{number}"), listed));
        }
        self
    }

    /// The list in another frame.
    fn elsewhere(mut self, scale: f64) -> Self {
        let fit = Similarity {
            scale,
            rotation: Rotation3::from_euler_angles(0.4, -1.1, 2.5),
            translation: Vector3::new(300.0, -20.0, 77.0),
        };
        for (_, place) in &mut self.list {
            *place = fit.apply(place);
        }
        self
    }

    fn place(&mut self) -> Vector3<f64> {
        let size = [1000.0, 700.0, 400.0];
        Vector3::from(size.map(|size| self.random.random_range(0.0..size)))
    }

    fn off(&mut self, size: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.random.random_range(-size..size))
    }

    fn network(&self) -> Network {
        let mut network = fixture::network();
        network.device = Arc::new(Vec::<DevicePoint>::new());
        let point = |place: &Vector3<f64>| Point {
            position: *place,
            covariance: Some(Matrix3::identity() * NOISE_MM.powi(2)),
            rays: 5,
            circle: None,
        };
        let points = self.labels.iter().map(|(label, place)| {
            let id: PointId = label.parse().unwrap();
            (id, Arc::new(point(place)))
        });
        network.points = Arc::new(points.collect());
        let observations = network.points.keys().map(|&point| AdjustedObservation {
            image: ImageId(1),
            dot: DotIndex(0),
            point,
            residual_px: nalgebra::Vector2::zeros(),
            redundancy: 1.0,
            test: 0.0,
            standing: Standing::Used,
        });
        let mut adjustment = network.adjustment.as_deref().cloned().unwrap();
        adjustment.observations = observations.collect();
        network.adjustment = Some(Arc::new(adjustment));
        network
    }

    fn reference(&self) -> Vec<ReferencePoint> {
        let row = |(name, place): &(String, Vector3<f64>)| ReferencePoint {
            label: Some(name.clone()),
            name: name.clone(),
            coordinates_mm: [Some(place.x), Some(place.y), Some(place.z)],
            sigmas_mm: [None; 3],
        };
        // In another order than the points.
        self.list.iter().rev().map(row).collect()
    }

    fn named(&self, settings: &NamingSettings) -> Result<Naming, NamingError> {
        name_by_reference(&self.network(), &self.reference(), settings)
    }
}

fn free() -> NamingSettings {
    NamingSettings {
        scale: Scale::Free,
        ..NamingSettings::default()
    }
}

fn within(within_mm: f64) -> NamingSettings {
    NamingSettings {
        within_mm: Some(within_mm),
        ..NamingSettings::default()
    }
}

/// Asserts that every name is that of its target, and gives how many there are.
#[track_caller]
fn right(naming: &Naming) -> usize {
    for (number, name) in &naming.names {
        assert_eq!(*name, format!("T{number}"));
    }
    assert_eq!(naming.named.points, naming.names.len());
    naming.names.len()
}

#[test]
fn targets_are_named_by_codes_by_the_frame_and_by_geometry() {
    for seed in 1..=20 {
        let by_codes = Scene::of_targets(50, seed).with_codes(5).elsewhere(1.0);
        let in_frame = Scene::of_targets(50, seed);
        let by_geometry = Scene::of_targets(50, seed).elsewhere(1.0);
        for (scene, way) in [
            (by_codes, Way::Labels),
            (in_frame, Way::Frame),
            (by_geometry, Way::Geometry),
        ] {
            let naming = scene.named(&within(3.0)).unwrap();
            assert_eq!((naming.way, right(&naming)), (way, 50), "seed {seed}");
            assert!(naming.ambiguous.is_empty() && naming.reference_left.is_empty());
            // Uniform errors of 0.5 and 0.05 mm: 0.29 mm.
            let rms = naming.fit.rms_mm.unwrap();
            assert!((0.24..0.34).contains(&rms), "{rms}");
            assert!(naming.fit.largest_mm.unwrap() < 1.0);
        }
    }
}

#[test]
fn extra_points_on_both_sides_are_left_over() {
    for seed in 1..=20 {
        for (codes, way) in [(4, Way::Labels), (0, Way::Geometry)] {
            let scene = Scene::of_targets(42, seed)
                .with_codes(codes)
                .with_extras(18)
                .elsewhere(1.0);
            let naming = scene.named(&within(3.0)).unwrap();
            assert_eq!(naming.way, way);
            // Here and there an extra lies near by chance: that is ambiguous, or a wrong name of an extra at most.
            let of_targets = naming.names.iter().filter(|(number, _)| **number < 500);
            for (number, name) in of_targets.clone() {
                assert_eq!(*name, format!("T{number}"), "seed {seed}");
            }
            assert!(of_targets.count() >= 41, "seed {seed}");
            assert!(naming.reference_left.len() >= 16 && naming.targets_left.len() >= 16);
        }
    }
}

#[test]
fn a_list_of_another_scale_needs_a_free_one() {
    for codes in [5, 0] {
        let scene = Scene::of_targets(40, 3).with_codes(codes).elsewhere(1.7);
        let kept = scene.named(&within(3.0)).unwrap_err();
        let line = kept.to_string();
        match codes {
            0 => assert!(matches!(kept, NamingError::NoPose { .. }), "{line}"),
            _ => assert!(line.contains("--with-scale"), "{line}"),
        }
        let naming = scene
            .named(&NamingSettings {
                within_mm: Some(5.0),
                ..free()
            })
            .unwrap();
        assert_eq!(right(&naming), 40);
        assert!((naming.scale - 1.7).abs() < 1e-3);
    }
}

#[test]
fn a_mirrored_list_names_nothing() {
    for seed in 1..=5 {
        for codes in [6, 0] {
            let mut scene = Scene::of_targets(40, seed).with_codes(codes);
            for (_, place) in &mut scene.list {
                place.y = -place.y;
            }
            let error = scene.named(&within(3.0)).unwrap_err();
            assert!(matches!(error, NamingError::Mirrored { .. }), "{error}");
        }
    }
}

#[test]
fn the_flat_part_of_a_mirrored_list_names_nothing() {
    let mut scene = Scene::of_targets(0, 1);
    for number in 1..=60 {
        let mut place = scene.place();
        if number > 12 {
            place.z = 0.0;
        }
        scene.add(&format!("M{number}"), &format!("T{number}"), place);
    }
    assert_eq!(right(&scene.named(&within(3.0)).unwrap()), 60);
    for (_, place) in &mut scene.list {
        *place = Vector3::new(-place.x, place.y, place.z);
    }
    let error = scene.named(&within(3.0)).unwrap_err();
    assert!(matches!(error, NamingError::Mirrored { .. }), "{error}");
}

#[test]
fn a_grid_without_labels_names_nothing_and_tells_its_poses() {
    let mut scene = Scene::of_targets(0, 1);
    for number in 0..35 {
        let place = Vector3::new(f64::from(number % 7), f64::from(number / 7), 0.0) * 80.0;
        scene.add(
            &format!("M{}", number + 1),
            &format!("T{}", number + 1),
            place,
        );
    }
    let mut scene = scene.elsewhere(1.0);
    assert_eq!(
        scene.named(&within(5.0)).unwrap_err().to_string(),
        "naming: found 4 poses in which the reference fits equally well (35 points each), expected one; 3 common labels would decide"
    );
    // Three labels in common decide, the names of targets too.
    let mut network = scene.network();
    let own = [(1, "T1"), (7, "T7"), (20, "T20")].map(|(n, name)| (n, name.to_owned()));
    network.name_targets(own.into()).unwrap();
    let naming = name_by_reference(&network, &scene.reference(), &within(5.0)).unwrap();
    assert_eq!((right(&naming), naming.named_before), (32, 3));
    scene.list.truncate(2);
    let few = scene.named(&within(5.0)).unwrap_err();
    assert!(matches!(
        few,
        NamingError::TooFew {
            points: 35,
            reference: 2
        }
    ));
}

#[test]
fn places_nearer_than_the_distance_are_ambiguous() {
    let mut scene = Scene::of_targets(40, 2).with_codes(4);
    let twin = scene.list[6].1 + Vector3::new(1.5, 0.0, 0.0);
    scene.list.push(("T7b".into(), twin));
    let beside = scene.labels[10].1 + Vector3::new(0.0, 2.0, 0.0);
    scene.labels.push(("M600".into(), beside));
    let naming = scene.named(&within(4.0)).unwrap();
    assert_eq!(right(&naming), 38);
    let mut told: Vec<String> = naming
        .ambiguous
        .iter()
        .map(|a| match &a.rival {
            Rival::Point { label, .. } => format!("{}: {} or {label}", a.reference, a.point),
            Rival::Reference { label, .. } => format!("{}: {} or {label}", a.point, a.reference),
        })
        .collect();
    told.sort();
    assert_eq!(told, ["M7: T7 or T7b", "M7: T7b or T7", "T11: M11 or M600"]);
    let text = naming.text();
    assert!(text.contains("3 ambiguous:\n"), "{text}");
}

#[test]
fn codes_keep_their_labels_and_wrong_ones_are_told() {
    let mut scene = Scene::of_targets(30, 4).with_codes(6);
    // A name at the place of C2, a label of a code that is not there, a code that moved, a label of any target.
    let at_code = scene.list.iter().find(|(name, _)| name == "C2").unwrap().1;
    scene.list.retain(|(name, _)| name != "C2");
    scene.list.push(("X".into(), at_code));
    scene.list[2].0 = "C77".into();
    scene.list[4].0 = "M99".into();
    let moved = scene
        .list
        .iter_mut()
        .find(|(name, _)| name == "C4")
        .unwrap();
    moved.1.x += 30.0;
    let mut reference = scene.reference();
    reference.iter_mut().find(|r| r.name == "T8").unwrap().label = None;
    reference
        .iter_mut()
        .find(|r| r.name == "T9")
        .unwrap()
        .coordinates_mm[1] = None;
    let naming = name_by_reference(&scene.network(), &reference, &within(4.0)).unwrap();
    assert_eq!(right(&naming), 26);
    let left: Vec<String> = naming
        .reference_left
        .iter()
        .map(|left| format!("{} {}", left.reference, left.why))
        .collect();
    let has = |text: &str| left.iter().any(|line| line.starts_with(text));
    assert!(has("X lies at C2.O, which keeps its label"), "{left:?}");
    assert!(has("C77 is no adjusted point"), "{left:?}");
    assert!(has("M99 is a label as any target gets it"), "{left:?}");
    assert!(has("T8 has no name to give M8"), "{left:?}");
    assert!(has("T9 has fewer than three coordinates"), "{left:?}");
    assert_eq!(naming.labels_off.len(), 1);
    assert_eq!(naming.labels_off[0].label, "C4.O");
    assert_eq!(naming.targets_left.len(), 1, "M9: its row has no place");
}

#[test]
fn names_stay_unless_they_are_to_give_way() {
    let scene = Scene::of_targets(30, 5).with_codes(4);
    let mut network = scene.network();
    let own =
        [(1, "edge"), (2, "T3"), (4, "T4"), (900, "T5")].map(|(n, name)| (n, name.to_owned()));
    network.name_targets(own.into()).unwrap();
    let kept = name_by_reference(&network, &scene.reference(), &within(3.0)).unwrap();
    // T1 lies at 'edge'; T3 is the name of M2, so that neither T2 nor T3 is given; M900 is gone, T5 is free.
    assert_eq!((right(&kept), kept.named_before), (26, 2));
    assert!(kept.names.contains_key(&5));
    let told = |name: &str| {
        let left = kept
            .reference_left
            .iter()
            .find(|left| left.reference == name);
        left.map(|left| left.why.to_string()).unwrap_or_default()
    };
    assert!(told("T1").starts_with("lies at 'edge', which keeps its name"));
    assert!(told("T2").starts_with("lies at 'T3', which keeps its name"));
    assert_eq!(kept.labels_off.len(), 1, "T3 is far from M2");

    let settings = NamingSettings {
        existing: ExistingNames::GiveWay,
        ..within(3.0)
    };
    let renamed = name_by_reference(&network, &scene.reference(), &settings).unwrap();
    assert_eq!((right(&renamed), renamed.named_before), (29, 1));
}

#[test]
fn a_fit_by_a_corner_reaches_no_farther_than_it_is_known() {
    // Codes within 60 mm, targets in a row that begins there: the far ones wait until the near ones hold the fit.
    let mut scene = Scene::of_targets(0, 6);
    for number in 1..=4_u32 {
        let place = scene.place() * 0.06;
        scene.add(&format!("C{number}"), &format!("C{number}"), place);
    }
    for number in 1..=200 {
        let x = f64::from(number) * 20.0;
        let place = Vector3::new(
            x,
            f64::from(number % 3) * 15.0,
            f64::from(number % 4) * 15.0,
        );
        scene.add(&format!("M{number}"), &format!("T{number}"), place);
    }
    let chain = scene.elsewhere(1.0);
    assert_eq!(right(&chain.named(&within(5.0)).unwrap()), 200);
    // Without the near ones nothing is said of the far ones.
    let mut gap = chain;
    let is_far =
        |label: &str| !label.starts_with(['M', 'T']) || label[1..].parse::<u32>().unwrap() > 150;
    gap.labels.retain(|(label, _)| is_far(label));
    gap.list.retain(|(name, _)| is_far(name));
    let naming = gap.named(&within(5.0)).unwrap();
    assert_eq!(naming.names.len(), 0);
    let out_of_reach = |left: &&ReferenceLeft| !matches!(left.why, WhyLeft::NoPlace);
    assert_eq!(
        naming.reference_left.iter().filter(out_of_reach).count(),
        50
    );
}

#[test]
fn other_lists_and_bad_settings_are_answered_in_one_line() {
    let mut scene = Scene::of_targets(40, 7);
    scene.list = Scene::of_targets(40, 8).list;
    let error = scene.named(&within(3.0)).unwrap_err().to_string();
    assert!(
        error.starts_with("naming: found 0 labels in common and no pose"),
        "{error}"
    );
    assert_eq!(
        scene.named(&within(-1.0)).unwrap_err().to_string(),
        "naming: found a distance of -1 mm, expected a number above 0"
    );
    let mut network = scene.network();
    network.inputs += 1;
    let stale = name_by_reference(&network, &scene.reference(), &within(3.0));
    assert!(matches!(stale, Err(NamingError::NoFigures(_))));
    let mut wrong = Scene::of_targets(10, 9).with_codes(6);
    for (place, (_, at)) in wrong.list.iter_mut().skip(10).enumerate() {
        at.x += 25.0 * place as f64 * place as f64;
    }
    let error = wrong.named(&within(3.0)).unwrap_err().to_string();
    assert!(
        error.contains("of 6 common labels within 3.000 mm"),
        "{error}"
    );
}

#[test]
fn the_same_list_gives_the_same_names_whatever_its_order() {
    let scene = Scene::of_targets(42, 11).with_extras(18).elsewhere(1.0);
    let first = scene.named(&within(3.0)).unwrap();
    let mut reference = scene.reference();
    reference.reverse();
    let second = name_by_reference(&scene.network(), &reference, &within(3.0)).unwrap();
    assert_eq!(first.names, second.names);
    let json = serde_json::to_value(&first).unwrap();
    assert_eq!(json["way"], "geometry");
    assert_eq!(json["named"]["points"], first.names.len());
}
