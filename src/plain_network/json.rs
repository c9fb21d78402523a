//! The JSON format `tiepoint-network`, version 1: read with its faults named, written to be read back to the bit.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::check::NetworkFault;
use super::error::quote;
use super::json_form::{
    CameraForm, DatumForm, DatumPointsForm, DistanceForm, FORMAT, Form, ImageForm, KnownForm,
    ObjectForm, ObservationForm, PointForm, RoleForm, VERSION, ValuesForm,
    with_false_for_no_numbers,
};
use super::{
    DatumPoints, ImportError, ImportPlace, Known, NamedText, PlainCamera, PlainDatum,
    PlainDistance, PlainImage, PlainNetwork, PlainObservation, PlainParameter, PlainPoint,
    PointRole,
};
use crate::adjustment::Sharing;
use crate::camera::INTERIOR_NAMES;
use crate::geometry::Pose;
use crate::network::{Expansion, REFERENCE_CELSIUS};

/// Reads a network from its JSON text.
///
/// ```json
/// {"format": "tiepoint-network", "version": 1, "residuals": "measured", "sigma_px": 0.05,
///  "datum": {"inner_constraints": ["P1", "P2", "P3"]},
///  "cameras": [{"name": "A", "width_px": 4000, "height_px": 3000, "pixel_pitch_mm": 0.005,
///    "lens": {"displacing": {"balanced_radius_mm": 0}}, "values": {"c": 24, "K1": 1e-4},
///    "free": ["c", "x0", "y0"], "weighted": {"K1": 1e-6}, "per_image": ["x0", "y0"]}],
///  "images": [{"name": "left", "camera": "A", "centre_mm": [0, 0, 900], "camera_from_world": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}],
///  "points": [{"name": "P1", "start_mm": [0, 0, 0]}, {"name": "P2"},
///    {"name": "P3", "known": [{"value_mm": 10}, null, {"value_mm": 5, "sigma_mm": 0.01}], "role": "check"}],
///  "observations": [["left", "P1", 2000.5, 1500.25], ["left", "P3", 2050, 1490, 0.2]],
///  "distances": [{"name": "bar", "from": "P1", "to": "P2", "length_mm": 500, "sigma_mm": 0.01, "role": "control",
///    "temperature_c": 24.5, "calibrated_at_c": 20, "expansion_per_k": 11.5e-6}],
///  "object": {"temperature_c": 24.5, "reference_c": 20, "expansion_per_k": 23e-6}}
/// ```
///
/// What may be left out: `residuals` (measured), `sigma_px` where every observation gives its own, `datum` (control
/// where there are control points, else inner constraints on all points), `distances`, `lens` (correcting), values that
/// are 0, `free` and `weighted` (the parameter is fixed), `per_image` (all images of the camera share it), the camera of an image if
/// there is only one, starts, `known` with the `sigma_mm` in it (the coordinate is fixed) and `correlations` of x-y, x-z, y-z (zeros), `role` (control where something is known),
/// and what warmth did to a bar or to the object (nothing is known of it; `calibrated_at_c` and `reference_c` are 20). Other keys
/// are refused.
///
/// `lens` is one of `"correcting"`, `"correcting_affinity_first"`, `{"displacing": {"balanced_radius_mm": R0}}` and
/// `"displacing_affinity_last"` ([`crate::camera::LensDirection`]).
///
/// Image points whose numbers are none (`null`, or `NaN` as other programs write it) and several of one point in an image are
/// read: [`PlainNetwork::adjust`] leaves them out and names them.
///
/// # Errors
/// [`ImportError`], one line: with line and column where the text is no JSON or a key has the wrong type, with the name
/// of the thing where a name is unknown, given twice, or a value cannot be what it stands for ([`PlainNetwork::check`]).
pub fn from_json(source: NamedText<'_>) -> Result<PlainNetwork, ImportError> {
    let text = source.text.strip_prefix('\u{feff}').unwrap_or(source.text);
    let source = NamedText { text, ..source };
    let form: Form = form(text).map_err(|e| json_error(source, &e))?;
    network(form)
        .and_then(|network| network.check_but_observations().map(|()| network))
        .map_err(|fault| source.fault(fault))
}

/// The JSON text of a network; [`from_json`] gives back an equal one, every number to the bit.
///
/// # Errors
/// [`NetworkFault`] where [`PlainNetwork::check`] finds one.
pub fn to_json(network: &PlainNetwork) -> Result<String, NetworkFault> {
    network.check()?;
    let sigma = network.observations.first().map(|o| o.sigma_px);
    let mut text = String::from("{\n");
    let mut key = |name: &str, value: &str| {
        let comma = if name == "distances" { "" } else { "," };
        text.push_str(&format!("\"{name}\": {value}{comma}\n"));
    };
    key("format", &json(&FORMAT));
    key("version", &json(&VERSION));
    key("residuals", &json(&network.residuals));
    if let Some(sigma) = sigma {
        key("sigma_px", &json(&sigma));
    }
    key("datum", &json(&datum_form(network)));
    if let Some(object) = &network.object {
        key("object", &json(&object_form(object)));
    }
    key("cameras", &list(network.cameras.iter().map(camera_form)));
    let images = network.images.iter().map(|i| image_form(network, i));
    key("images", &list(images));
    key("points", &list(network.points.iter().map(point_form)));
    let observations = network.observations.iter();
    let observations = observations.map(|o| observation_form(network, o, sigma));
    key("observations", &list(observations));
    let distances = network.distances.iter().map(|d| distance_form(network, d));
    key("distances", &list(distances));
    text.push_str("}\n");
    Ok(text)
}

/// A text that is no JSON only because other programs write `NaN` for numbers that they do not have is read all the same.
fn form(text: &str) -> Result<Form, serde_json::Error> {
    serde_json::from_str(text).or_else(|error| {
        let Some(with_false) = with_false_for_no_numbers(text) else {
            return Err(error);
        };
        serde_json::from_str(&with_false).map_err(|_| error)
    })
}

fn json(value: &impl serde::Serialize) -> String {
    // Texts and checked finite numbers: writing them to memory cannot fail.
    serde_json::to_string(value).unwrap_or_default()
}

/// A list with one entry a line.
fn list<T: serde::Serialize>(entries: impl Iterator<Item = T>) -> String {
    let lines: Vec<String> = entries.map(|entry| json(&entry)).collect();
    match lines.is_empty() {
        true => "[]".to_owned(),
        false => format!("[\n{}\n]", lines.join(",\n")),
    }
}

fn camera_form(camera: &PlainCamera) -> CameraForm {
    let parameters = || INTERIOR_NAMES.iter().zip(camera.parameters);
    CameraForm {
        name: camera.name.clone(),
        width_px: camera.width_px,
        height_px: camera.height_px,
        pixel_pitch_mm: camera.pixel_pitch_mm,
        lens: camera.lens,
        values: ValuesForm::new(camera.values),
        free: parameters()
            .filter(|(_, parameter)| *parameter == PlainParameter::Free)
            .map(|(name, _)| (*name).to_owned())
            .collect(),
        weighted: parameters()
            .filter_map(|(name, parameter)| match parameter {
                PlainParameter::Weighted { sigma } => Some(((*name).to_owned(), sigma)),
                _ => None,
            })
            .collect(),
        per_image: INTERIOR_NAMES
            .iter()
            .zip(camera.sharing)
            .filter(|(_, sharing)| *sharing == Sharing::Image)
            .map(|(name, _)| (*name).to_owned())
            .collect(),
    }
}

fn image_form(network: &PlainNetwork, image: &PlainImage) -> ImageForm {
    ImageForm {
        name: image.name.clone(),
        camera: Some(network.cameras[image.camera].name.clone()),
        centre_mm: image.start.map(|pose| pose.centre_in_world.into()),
        camera_from_world: image.start.map(|pose| {
            let m = pose.camera_from_world.matrix();
            [0, 1, 2].map(|row| [0, 1, 2].map(|column| m[(row, column)]))
        }),
    }
}

fn point_form(point: &PlainPoint) -> PointForm {
    let known = point.known.map(|coordinate| {
        coordinate.map(|known| KnownForm {
            value_mm: known.value_mm,
            sigma_mm: known.sigma_mm,
        })
    });
    let role = match point.role {
        PointRole::Control => Some(RoleForm::Control),
        PointRole::Check => Some(RoleForm::Check),
        PointRole::New => None,
    };
    PointForm {
        name: point.name.clone(),
        start_mm: point.start,
        known: known.iter().any(Option::is_some).then_some(known),
        correlations: (point.correlations != [0.0; 3]).then_some(point.correlations),
        role,
    }
}

fn observation_form(
    network: &PlainNetwork,
    observation: &PlainObservation,
    common: Option<f64>,
) -> ObservationForm {
    ObservationForm {
        image: network.images[observation.image].name.clone(),
        point: network.points[observation.point].name.clone(),
        x_px: observation.x_px,
        y_px: observation.y_px,
        sigma_px: Some(observation.sigma_px).filter(|sigma| Some(*sigma) != common),
    }
}

fn distance_form(network: &PlainNetwork, distance: &PlainDistance) -> DistanceForm {
    DistanceForm {
        name: distance.name.clone(),
        from: network.points[distance.from].name.clone(),
        to: network.points[distance.to].name.clone(),
        length_mm: distance.length_mm,
        sigma_mm: distance.sigma_mm,
        role: distance.role,
        temperature_c: distance.expansion.map(|bar| bar.temperature_c),
        calibrated_at_c: distance.expansion.map(|bar| bar.reference_c),
        expansion_per_k: distance.expansion.map(|bar| bar.per_k),
    }
}

fn object_form(object: &Expansion) -> ObjectForm {
    ObjectForm {
        temperature_c: object.temperature_c,
        reference_c: object.reference_c,
        expansion_per_k: object.per_k,
    }
}

fn datum_form(network: &PlainNetwork) -> DatumForm {
    match &network.datum {
        PlainDatum::Control => DatumForm::Control,
        PlainDatum::InnerConstraints(DatumPoints::All) => {
            DatumForm::InnerConstraints(DatumPointsForm::All)
        }
        PlainDatum::InnerConstraints(DatumPoints::Listed(points)) => {
            let name = |&point: &usize| network.points[point].name.clone();
            DatumForm::InnerConstraints(DatumPointsForm::Listed(points.iter().map(name).collect()))
        }
    }
}

/// The error of the JSON reader in the words of this program.
fn json_error(source: NamedText<'_>, error: &serde_json::Error) -> ImportError {
    let place = match error.line() {
        0 => ImportPlace::File,
        line => ImportPlace::Character {
            line,
            column: error.column().max(1),
        },
    };
    let text = error.to_string();
    let text = text.split(" at line ").next().unwrap_or(&text);
    let key = |text: &str| text.replace('`', "");
    let (found, expected) = if !error.is_data() {
        (remainder(source.text, error), format!("JSON ({text})"))
    } else if let Some(name) = text.strip_prefix("missing field ") {
        (format!("no key {}", key(name)), "it".to_owned())
    } else if let Some(name) = text.strip_prefix("duplicate field ") {
        (format!("the key {} again", key(name)), "it once".to_owned())
    } else if let Some((found, expected)) = text.split_once(", expected ") {
        let found = found
            .replace("unknown field ", "the key ")
            .replace("unknown variant ", "the word ")
            .replace("invalid type: ", "")
            .replace("invalid value: ", "")
            .replace("invalid length ", "a list of ");
        (found.replace('`', "'"), key(expected))
    } else {
        (text.to_owned(), format!("a network of version {VERSION}"))
    };
    source.unexpected(place, found, expected)
}

/// What stands where the reader stopped.
fn remainder(text: &str, error: &serde_json::Error) -> String {
    let line = text.lines().nth(error.line().saturating_sub(1));
    let rest = line.and_then(|line| line.get(error.column().saturating_sub(1)..));
    match rest.map(str::trim) {
        None | Some("") => "the end of the text".to_owned(),
        Some(rest) => quote(rest),
    }
}

/// The places of names in a list; the first of equal ones, the check names the second.
struct Names<'a> {
    kind: &'static str,
    index: BTreeMap<&'a str, usize>,
}

impl<'a> Names<'a> {
    fn new(kind: &'static str, names: impl DoubleEndedIterator<Item = (usize, &'a str)>) -> Self {
        let index = names.rev().map(|(index, name)| (name, index)).collect();
        Self { kind, index }
    }

    fn find(&self, name: &str, about: impl FnOnce() -> String) -> Result<usize, NetworkFault> {
        self.index.get(name).copied().ok_or_else(|| {
            let found = format!("the {} {}", self.kind, quote(name));
            NetworkFault::new(about(), found, "the name of one that is listed")
        })
    }
}

fn network(form: Form) -> Result<PlainNetwork, NetworkFault> {
    if form.format != FORMAT {
        return Err(NetworkFault::new("format", quote(&form.format), FORMAT));
    }
    if form.version != VERSION {
        let found = form.version.to_string();
        return Err(NetworkFault::new("version", found, VERSION.to_string()));
    }
    let cameras = form.cameras.iter().map(|c| c.name.as_str()).enumerate();
    let cameras = Names::new("camera", cameras);
    let images = form.images.iter().map(|i| i.name.as_str()).enumerate();
    let images = Names::new("image", images);
    let points = form.points.iter().map(|p| p.name.as_str()).enumerate();
    let points = Names::new("point", points);
    let read_points: Vec<PlainPoint> = form.points.iter().map(point).collect();
    Ok(PlainNetwork {
        images: form
            .images
            .iter()
            .map(|image| read_image(image, &cameras))
            .collect::<Result<_, _>>()?,
        observations: read_observations(&form, &images, &points)?,
        distances: form
            .distances
            .iter()
            .map(|distance| read_distance(distance, &points))
            .collect::<Result<_, _>>()?,
        datum: read_datum(form.datum.as_ref(), &read_points, &points)?,
        cameras: form
            .cameras
            .iter()
            .map(read_camera)
            .collect::<Result<_, _>>()?,
        points: read_points,
        residuals: form.residuals,
        object: form.object.map(|object| Expansion {
            per_k: object.expansion_per_k,
            temperature_c: object.temperature_c,
            reference_c: object.reference_c,
        }),
    })
}

fn read_camera(form: &CameraForm) -> Result<PlainCamera, NetworkFault> {
    let about = || format!("camera {}", quote(&form.name));
    let mut parameters = [PlainParameter::Fixed; 10];
    let free = form.free.iter().map(|name| (name, PlainParameter::Free));
    let weighted = form
        .weighted
        .iter()
        .map(|(name, &sigma)| (name, PlainParameter::Weighted { sigma }));
    let index_of = |name: &String| {
        let index = INTERIOR_NAMES.iter().position(|known| known == name);
        index.ok_or_else(|| {
            let found = format!("the parameter {}", quote(name));
            let expected = format!("one of {}", INTERIOR_NAMES.join(", "));
            NetworkFault::new(about(), found, expected)
        })
    };
    let again = |name: &str| {
        let found = format!("the parameter {name} again");
        NetworkFault::new(about(), found, "it once")
    };
    for (name, parameter) in free.chain(weighted) {
        let index = index_of(name)?;
        if parameters[index] != PlainParameter::Fixed {
            return Err(again(name));
        }
        parameters[index] = parameter;
    }
    let mut sharing = [Sharing::Camera; 10];
    for name in &form.per_image {
        let index = index_of(name)?;
        if sharing[index] == Sharing::Image {
            return Err(again(name));
        }
        sharing[index] = Sharing::Image;
    }
    Ok(PlainCamera {
        name: form.name.clone(),
        width_px: form.width_px,
        height_px: form.height_px,
        pixel_pitch_mm: form.pixel_pitch_mm,
        lens: form.lens,
        values: form.values.values(),
        parameters,
        sharing,
    })
}

fn read_image(form: &ImageForm, cameras: &Names<'_>) -> Result<PlainImage, NetworkFault> {
    let about = || format!("image {}", quote(&form.name));
    let camera = match &form.camera {
        Some(name) => cameras.find(name, about)?,
        None if cameras.index.len() == 1 => 0,
        None => {
            let found = format!("no camera, of {}", cameras.index.len());
            return Err(NetworkFault::new(about(), found, "the name of one"));
        }
    };
    let start = match (&form.centre_mm, &form.camera_from_world) {
        (Some(centre), Some(rows)) => Some(Pose {
            camera_from_world: Rotation3::from_matrix_unchecked(Matrix3::from_fn(|row, column| {
                rows[row][column]
            })),
            centre_in_world: Vector3::from(*centre),
        }),
        (None, None) => None,
        (Some(_), None) => {
            let expected = "camera_from_world with it";
            return Err(NetworkFault::new(about(), "centre_mm alone", expected));
        }
        (None, Some(_)) => {
            let expected = "centre_mm with it";
            return Err(NetworkFault::new(
                about(),
                "camera_from_world alone",
                expected,
            ));
        }
    };
    Ok(PlainImage {
        name: form.name.clone(),
        camera,
        start,
    })
}

fn point(form: &PointForm) -> PlainPoint {
    let known = form.known.unwrap_or_default().map(|coordinate| {
        coordinate.map(|known| Known {
            value_mm: known.value_mm,
            sigma_mm: known.sigma_mm,
        })
    });
    PlainPoint {
        name: form.name.clone(),
        start: form.start_mm,
        known,
        correlations: form.correlations.unwrap_or_default(),
        role: match form.role {
            Some(RoleForm::Control) => PointRole::Control,
            Some(RoleForm::Check) => PointRole::Check,
            Some(RoleForm::New) => PointRole::New,
            None if known.iter().any(Option::is_some) => PointRole::Control,
            None => PointRole::New,
        },
    }
}

fn read_observations(
    form: &Form,
    images: &Names<'_>,
    points: &Names<'_>,
) -> Result<Vec<PlainObservation>, NetworkFault> {
    let read = |(index, observation): (usize, &ObservationForm)| {
        let about = || {
            format!(
                "observation {} of point {} in image {}",
                index + 1,
                quote(&observation.point),
                quote(&observation.image)
            )
        };
        let sigma = observation.sigma_px.or(form.sigma_px);
        Ok(PlainObservation {
            image: images.find(&observation.image, about)?,
            point: points.find(&observation.point, about)?,
            x_px: observation.x_px,
            y_px: observation.y_px,
            sigma_px: sigma.ok_or_else(|| {
                let expected = "sigma_px as its fifth number, or one for all in the file";
                NetworkFault::new(about(), "no sigma", expected)
            })?,
        })
    };
    form.observations.iter().enumerate().map(read).collect()
}

fn read_distance(form: &DistanceForm, points: &Names<'_>) -> Result<PlainDistance, NetworkFault> {
    let about = || format!("distance {}", quote(&form.name));
    Ok(PlainDistance {
        name: form.name.clone(),
        from: points.find(&form.from, about)?,
        to: points.find(&form.to, about)?,
        length_mm: form.length_mm,
        sigma_mm: form.sigma_mm,
        role: form.role,
        expansion: read_expansion(form, &about())?,
    })
}

/// What warmth did to a bar: its temperature and its coefficient together, or nothing.
fn read_expansion(form: &DistanceForm, about: &str) -> Result<Option<Expansion>, NetworkFault> {
    let alone = |found: &str, expected: &str| {
        let found = format!("{found} alone");
        Err(NetworkFault::new(
            about,
            found,
            format!("{expected} with it"),
        ))
    };
    match (
        form.temperature_c,
        form.expansion_per_k,
        form.calibrated_at_c,
    ) {
        (Some(temperature_c), Some(per_k), calibrated_at_c) => Ok(Some(Expansion {
            per_k,
            temperature_c,
            reference_c: calibrated_at_c.unwrap_or(REFERENCE_CELSIUS),
        })),
        (Some(_), None, _) => alone("temperature_c", "expansion_per_k"),
        (None, Some(_), _) => alone("expansion_per_k", "temperature_c"),
        (None, None, Some(_)) => alone("calibrated_at_c", "temperature_c and expansion_per_k"),
        (None, None, None) => Ok(None),
    }
}

fn read_datum(
    form: Option<&DatumForm>,
    points: &[PlainPoint],
    names: &Names<'_>,
) -> Result<PlainDatum, NetworkFault> {
    Ok(match form {
        Some(DatumForm::Control) => PlainDatum::Control,
        None if points.iter().any(|p| p.role == PointRole::Control) => PlainDatum::Control,
        None | Some(DatumForm::InnerConstraints(DatumPointsForm::All)) => {
            PlainDatum::InnerConstraints(DatumPoints::All)
        }
        Some(DatumForm::InnerConstraints(DatumPointsForm::Listed(listed))) => {
            let find = |name: &String| names.find(name, || "datum".to_owned());
            let listed = listed.iter().map(find).collect::<Result<_, _>>()?;
            PlainDatum::InnerConstraints(DatumPoints::Listed(listed))
        }
    })
}

#[cfg(test)]
#[path = "json_tests.rs"]
mod tests;
