//! What makes a network meaningless, found before an adjustment sees it.

use std::collections::{BTreeMap, BTreeSet};

use super::error::quote;
use super::{
    DatumPoints, PlainCamera, PlainDatum, PlainDistance, PlainImage, PlainNetwork,
    PlainObservation, PlainParameter, PlainPoint, PointRole,
};
use crate::adjustment::Sharing;
use crate::camera::INTERIOR_NAMES;
use crate::camera::LensDirection;
use crate::network::Expansion;

/// What is wrong with a network; its `Display` is one line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{about}: found {found}, expected {expected}")]
pub struct NetworkFault {
    /// The thing that is wrong, by its name: `camera 'left'`.
    pub about: String,
    /// What was found.
    pub found: String,
    /// What was expected.
    pub expected: String,
}

/// Largest entry of `M M^T - I` that counts as a rotation: printed matrices have six decimals or more.
const ROTATION_TOLERANCE: f64 = 1e-5;

/// Names of the coordinates.
pub(super) const AXES: [&str; 3] = ["x", "y", "z"];

impl NetworkFault {
    pub(super) fn new(
        about: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self {
            about: about.into(),
            found: found.into(),
            expected: expected.into(),
        }
    }

    /// What kind of thing is wrong: `camera`, `image`, `point`, `observation`, `distance`, `datum`.
    pub(super) fn kind(&self) -> &str {
        self.about.split(' ').next().unwrap_or_default()
    }
}

impl PlainNetwork {
    /// Whether every value can be what it stands for: finite numbers, sigmas and lengths greater than zero, names that
    /// are unique, indices that exist, one observation of a point in an image, rotations that rotate.
    ///
    /// A camera without image and a point without observation are no faults.
    ///
    /// # Errors
    /// [`NetworkFault`]: the first thing that is wrong.
    pub fn check(&self) -> Result<(), NetworkFault> {
        self.check_but_observations()?;
        let mut seen = BTreeSet::new();
        for (index, observation) in self.observations.iter().enumerate() {
            self.check_observation(index, observation)?;
            if !seen.insert((observation.image, observation.point)) {
                let about = self.name_of(index, observation);
                return Err(NetworkFault::new(about, "a second one of it", "one"));
            }
        }
        Ok(())
    }

    /// [`Self::check`] without the numbers of the image points, nor whether a point has several in an image: such ones
    /// an adjustment leaves out.
    pub(super) fn check_but_observations(&self) -> Result<(), NetworkFault> {
        unique("camera", self.cameras.iter().map(|c| c.name.as_str()))?;
        unique("image", self.images.iter().map(|i| i.name.as_str()))?;
        self.check_names_of_points()?;
        unique("distance", self.distances.iter().map(|d| d.name.as_str()))?;
        self.cameras.iter().try_for_each(check_camera)?;
        for image in &self.images {
            self.check_image(image)?;
        }
        self.points.iter().try_for_each(check_point)?;
        for (index, observation) in self.observations.iter().enumerate() {
            let about = format!("observation {}", index + 1);
            within(&about, "image", observation.image, self.images.len())?;
            within(&about, "point", observation.point, self.points.len())?;
        }
        for distance in &self.distances {
            self.check_distance(distance)?;
        }
        if let Some(object) = &self.object {
            check_expansion("object", object)?;
        }
        self.check_datum()
    }

    /// Points of one name are told with what their known coordinates differ by.
    fn check_names_of_points(&self) -> Result<(), NetworkFault> {
        let mut first = BTreeMap::new();
        for point in &self.points {
            let Some(other) = first.insert(point.name.as_str(), point) else {
                continue;
            };
            let axes = AXES.iter().zip(other.known.iter().zip(&point.known));
            let differing = axes.filter_map(|(axis, (one, two))| {
                let [one, two] = [one.as_ref()?.value_mm, two.as_ref()?.value_mm];
                (one != two).then(|| format!("{axis} {two} mm after {one} mm"))
            });
            let differing: Vec<String> = differing.collect();
            if !differing.is_empty() {
                let about = format!("point {}", quote(&point.name));
                let found = format!("a second one of this name with {}", differing.join(", "));
                return Err(NetworkFault::new(about, found, "one"));
            }
        }
        unique("point", self.points.iter().map(|p| p.name.as_str()))
    }

    fn check_image(&self, image: &PlainImage) -> Result<(), NetworkFault> {
        let about = format!("image {}", quote(&image.name));
        within(&about, "camera", image.camera, self.cameras.len())?;
        let Some(pose) = &image.start else {
            return Ok(());
        };
        for coordinate in pose.centre_in_world.iter() {
            finite(&about, "the centre", *coordinate)?;
        }
        let m = pose.camera_from_world.matrix();
        for entry in m.iter() {
            finite(&about, "camera_from_world", *entry)?;
        }
        let bent = (m * m.transpose() - nalgebra::Matrix3::identity()).amax();
        if bent > ROTATION_TOLERANCE || m.determinant() < 0.0 {
            let found = match m.determinant() < 0.0 && bent <= ROTATION_TOLERANCE {
                true => "a camera_from_world that mirrors".to_owned(),
                false => format!("a camera_from_world that is off a rotation by {bent:.1e}"),
            };
            return Err(NetworkFault::new(about, found, "a rotation matrix"));
        }
        Ok(())
    }

    /// Whether the numbers of an image point can be what they stand for.
    pub(super) fn check_observation(
        &self,
        index: usize,
        observation: &PlainObservation,
    ) -> Result<(), NetworkFault> {
        let about = self.name_of(index, observation);
        finite(&about, "x_px", observation.x_px)?;
        finite(&about, "y_px", observation.y_px)?;
        positive(&about, "sigma_px", observation.sigma_px)
    }

    fn name_of(&self, index: usize, observation: &PlainObservation) -> String {
        format!(
            "observation {} of point {} in image {}",
            index + 1,
            quote(&self.points[observation.point].name),
            quote(&self.images[observation.image].name)
        )
    }

    fn check_distance(&self, distance: &PlainDistance) -> Result<(), NetworkFault> {
        let about = format!("distance {}", quote(&distance.name));
        within(&about, "point", distance.from, self.points.len())?;
        within(&about, "point", distance.to, self.points.len())?;
        if distance.from == distance.to {
            return Err(NetworkFault::new(
                about,
                format!(
                    "point {} at both ends",
                    quote(&self.points[distance.from].name)
                ),
                "two points",
            ));
        }
        positive(&about, "length_mm", distance.length_mm)?;
        positive(&about, "sigma_mm", distance.sigma_mm)?;
        if distance.sigma_mm >= distance.length_mm {
            return Err(NetworkFault::new(
                about,
                format!("sigma_mm {}", distance.sigma_mm),
                "less than the length",
            ));
        }
        match &distance.expansion {
            Some(expansion) => check_expansion(&about, expansion),
            None => Ok(()),
        }
    }

    /// Whether the datum can be what it says: control points, or three listed points or more, each once.
    ///
    /// # Errors
    /// [`NetworkFault`] about the datum.
    pub fn check_datum(&self) -> Result<(), NetworkFault> {
        match &self.datum {
            PlainDatum::Control => {
                let control = |point: &PlainPoint| point.role == PointRole::Control;
                if !self.points.iter().any(control) {
                    return Err(NetworkFault::new(
                        "datum",
                        "control without a control point",
                        "control points, or inner constraints",
                    ));
                }
            }
            PlainDatum::InnerConstraints(DatumPoints::All) => {}
            PlainDatum::InnerConstraints(DatumPoints::Listed(points)) => {
                let mut seen = BTreeSet::new();
                for &point in points {
                    within("datum", "point", point, self.points.len())?;
                    if !seen.insert(point) {
                        let name = quote(&self.points[point].name);
                        let found = format!("point {name} again");
                        return Err(NetworkFault::new("datum", found, "it once"));
                    }
                }
                // Two points leave the turn about their line free.
                if points.len() < 3 {
                    let found = format!("{} points", points.len());
                    return Err(NetworkFault::new("datum", found, "three or more"));
                }
            }
        }
        Ok(())
    }
}

fn check_camera(camera: &PlainCamera) -> Result<(), NetworkFault> {
    let about = format!("camera {}", quote(&camera.name));
    for (name, side) in [
        ("width_px", camera.width_px),
        ("height_px", camera.height_px),
    ] {
        if side == 0 {
            return Err(NetworkFault::new(about, format!("{name} 0"), "1 or more"));
        }
    }
    positive(&about, "pixel_pitch_mm", camera.pixel_pitch_mm)?;
    for (name, value) in INTERIOR_NAMES.iter().zip(camera.values) {
        finite(&about, name, value)?;
    }
    positive(&about, "c", camera.values[0])?;
    if let LensDirection::Displacing {
        balanced_radius_mm: radius,
    } = camera.lens
        && !(radius.is_finite() && radius >= 0.0)
    {
        let found = format!("balanced_radius_mm {radius}");
        return Err(NetworkFault::new(about, found, "0 or more"));
    }
    let parameters = INTERIOR_NAMES.iter().zip(camera.parameters);
    for ((name, parameter), sharing) in parameters.zip(camera.sharing) {
        if let PlainParameter::Weighted { sigma } = parameter {
            positive(&about, &format!("sigma of {name}"), sigma)?;
        }
        if parameter == PlainParameter::Fixed && sharing == Sharing::Image {
            let found = format!("{name} for each image but fixed");
            return Err(NetworkFault::new(about, found, "it free or weighted"));
        }
    }
    Ok(())
}

fn check_point(point: &PlainPoint) -> Result<(), NetworkFault> {
    let about = format!("point {}", quote(&point.name));
    for coordinate in point.start.iter().flatten() {
        finite(&about, "the start", *coordinate)?;
    }
    for known in point.known.iter().flatten() {
        finite(&about, "value_mm", known.value_mm)?;
        if let Some(sigma) = known.sigma_mm {
            positive(&about, "sigma_mm", sigma)?;
        }
    }
    if !are_correlations(point.correlations) {
        let [a, b, c] = point.correlations;
        return Err(NetworkFault::new(
            about,
            format!("correlations {a}, {b}, {c}"),
            "those of a covariance matrix (x-y, x-z, y-z)",
        ));
    }
    let knows = point.known.iter().any(Option::is_some);
    match point.role {
        PointRole::New if knows => Err(NetworkFault::new(
            about,
            "known coordinates of a new point",
            "the role control or check",
        )),
        PointRole::Control | PointRole::Check if !knows => Err(NetworkFault::new(
            about,
            "no known coordinate",
            "at least one of a control or check point",
        )),
        _ => Ok(()),
    }
}

/// Whether three coordinates can be correlated so: whether the matrix of the coefficients is positive definite.
fn are_correlations([xy, xz, yz]: [f64; 3]) -> bool {
    let determinant = 1.0 + 2.0 * xy * xz * yz - xy * xy - xz * xz - yz * yz;
    xy.abs() < 1.0 && determinant > 0.0
}

fn check_expansion(about: &str, expansion: &Expansion) -> Result<(), NetworkFault> {
    for (name, value, range) in [
        ("expansion_per_k", expansion.per_k, Expansion::PER_K),
        ("temperature_c", expansion.temperature_c, Expansion::CELSIUS),
        (
            "the reference temperature",
            expansion.reference_c,
            Expansion::CELSIUS,
        ),
    ] {
        if !range.contains(&value) {
            let expected = format!("a number from {} to {}", range.start(), range.end());
            return Err(NetworkFault::new(
                about,
                format!("{name} {value}"),
                expected,
            ));
        }
    }
    Ok(())
}

fn unique<'a>(kind: &str, names: impl Iterator<Item = &'a str>) -> Result<(), NetworkFault> {
    let mut seen = BTreeSet::new();
    for (index, name) in names.enumerate() {
        if name.trim().is_empty() {
            let about = format!("{kind} {}", index + 1);
            return Err(NetworkFault::new(about, "no name", "a name"));
        }
        if !seen.insert(name) {
            let about = format!("{kind} {}", quote(name));
            return Err(NetworkFault::new(about, "a second one of this name", "one"));
        }
    }
    Ok(())
}

fn within(about: &str, kind: &str, index: usize, count: usize) -> Result<(), NetworkFault> {
    if index < count {
        return Ok(());
    }
    let found = format!("{kind} number {index}");
    Err(NetworkFault::new(
        about,
        found,
        format!("less than {count}"),
    ))
}

fn finite(about: &str, name: &str, value: f64) -> Result<(), NetworkFault> {
    if value.is_finite() {
        return Ok(());
    }
    let found = format!("{name} {value}");
    Err(NetworkFault::new(about, found, "a finite number"))
}

fn positive(about: &str, name: &str, value: f64) -> Result<(), NetworkFault> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    let found = format!("{name} {value}");
    Err(NetworkFault::new(about, found, "a number greater than 0"))
}

#[cfg(test)]
mod tests {
    use super::super::fixture::small_network;
    use super::*;
    use crate::geometry::Pose;
    use nalgebra::{Matrix3, Rotation3, Vector3};

    #[test]
    fn a_sound_network_passes() {
        assert_eq!(small_network().check(), Ok(()));
    }

    #[test]
    fn a_camera_without_image_is_allowed() {
        let mut network = small_network();
        let mut spare = network.cameras[0].clone();
        spare.name = "spare".into();
        network.cameras.push(spare);
        assert_eq!(network.check(), Ok(()));
    }

    fn warm(per_k: f64, temperature_c: f64) -> Expansion {
        Expansion {
            per_k,
            temperature_c,
            reference_c: 20.0,
        }
    }

    #[test]
    fn every_fault_names_the_thing() {
        type Damage = fn(&mut PlainNetwork);
        let turned = |network: &mut PlainNetwork, diagonal: [f64; 3]| {
            network.images[0].start = Some(Pose {
                camera_from_world: Rotation3::from_matrix_unchecked(Matrix3::from_diagonal(
                    &diagonal.into(),
                )),
                centre_in_world: Vector3::zeros(),
            });
        };
        let cases: [(Damage, &str); 23] = [
            (
                |n| n.points[3].correlations = [0.9, 0.9, -0.9],
                "point 'P4': found correlations 0.9, 0.9, -0.9, expected those of a covariance matrix (x-y, x-z, y-z)",
            ),
            (
                |n| n.images[1].name = "left".into(),
                "image 'left': found a second one of this name, expected one",
            ),
            (
                |n| {
                    n.points.push(n.points[3].clone());
                    n.points[4].known[1].as_mut().unwrap().value_mm = 91.5;
                },
                "point 'P4': found a second one of this name with y 91.5 mm after 90 mm, expected one",
            ),
            (
                |n| n.points[0].name = " ".into(),
                "point 1: found no name, expected a name",
            ),
            (
                |n| n.cameras[0].width_px = 0,
                "camera 'A': found width_px 0, expected 1 or more",
            ),
            (
                |n| n.cameras[0].values[3] = f64::NAN,
                "camera 'A': found K1 NaN, expected a finite number",
            ),
            (
                |n| n.cameras[0].values[0] = -20.0,
                "camera 'A': found c -20, expected a number greater than 0",
            ),
            (
                |n| n.cameras[0].parameters[4] = PlainParameter::Weighted { sigma: 0.0 },
                "camera 'A': found sigma of K2 0, expected a number greater than 0",
            ),
            (
                |n| {
                    n.cameras[0].parameters[5] = PlainParameter::Fixed;
                    n.cameras[0].sharing[5] = Sharing::Image;
                },
                "camera 'A': found K3 for each image but fixed, expected it free or weighted",
            ),
            (
                |n| {
                    n.cameras[0].lens = LensDirection::Displacing {
                        balanced_radius_mm: -1.0,
                    }
                },
                "camera 'A': found balanced_radius_mm -1, expected 0 or more",
            ),
            (
                |n| n.images[0].camera = 7,
                "image 'left': found camera number 7, expected less than 1",
            ),
            (
                |n| n.images[0].start.as_mut().unwrap().centre_in_world.x = f64::INFINITY,
                "image 'left': found the centre inf, expected a finite number",
            ),
            (
                |n| n.points[3].role = PointRole::New,
                "point 'P4': found known coordinates of a new point, expected the role control or check",
            ),
            (
                |n| n.points[0].role = PointRole::Check,
                "point 'P1': found no known coordinate, expected at least one of a control or check point",
            ),
            (
                |n| n.observations[1] = n.observations[0],
                "observation 2 of point 'P1' in image 'left': found a second one of it, expected one",
            ),
            (
                |n| n.observations[2].sigma_px = -0.1,
                "observation 3 of point 'P3' in image 'left': found sigma_px -0.1, expected a number greater than 0",
            ),
            (
                |n| n.observations[2].y_px = f64::NAN,
                "observation 3 of point 'P3' in image 'left': found y_px NaN, expected a finite number",
            ),
            (
                |n| n.distances[0].to = n.distances[0].from,
                "distance 'bar': found point 'P1' at both ends, expected two points",
            ),
            (
                |n| n.distances[0].sigma_mm = 1e9,
                "distance 'bar': found sigma_mm 1000000000, expected less than the length",
            ),
            (
                |n| n.distances[0].expansion = Some(warm(11.5, 30.0)),
                "distance 'bar': found expansion_per_k 11.5, expected a number from -0.0005 to 0.0005",
            ),
            (
                |n| n.object = Some(warm(11.5e-6, -300.0)),
                "object: found temperature_c -300, expected a number from -273.15 to 1000",
            ),
            (
                |n| n.datum = PlainDatum::InnerConstraints(DatumPoints::Listed(vec![0, 0, 1])),
                "datum: found point 'P1' again, expected it once",
            ),
            (
                |n| n.datum = PlainDatum::InnerConstraints(DatumPoints::Listed(vec![0, 1])),
                "datum: found 2 points, expected three or more",
            ),
        ];
        for (damage, line) in cases {
            let mut network = small_network();
            damage(&mut network);
            let fault = network.check().unwrap_err();
            assert_eq!(fault.to_string(), line);
        }
        for (diagonal, found) in [
            ([1.0, 1.0, -1.0], "mirrors"),
            ([1.0, 1.0, 1.1], "is off a rotation by 2.1e-1"),
        ] {
            let mut network = small_network();
            turned(&mut network, diagonal);
            assert_eq!(
                network.check().unwrap_err().to_string(),
                format!(
                    "image 'left': found a camera_from_world that {found}, expected a rotation matrix"
                )
            );
        }
    }
}
