//! What the operator does by hand: decisions that no stage overrides.
//!
//! An edit is checked again when it is applied: while a step runs, edits wait, and what they are about may be gone.

mod known;
mod names;
mod not_there;
mod readings;
mod settings;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::network::{
    BarRole, CodeDot, ControlRole, Frame, ImageEntry, ImageId, ImageUse, Label,
    MeasurementSettings, NameProblem, Network, PointId, Reading, ScaleBar, Source, Stage,
};
use crate::targets::{CodeReading, Dot, DotIndex};

pub use crate::network::{REJECTED_BY_OPERATOR, SET_ASIDE_BY_OPERATOR};

/// A change of the document by the operator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Edit {
    /// Names a dot.
    Label {
        /// The image.
        image: ImageId,
        /// The dot.
        dot: DotIndex,
        /// Its point.
        point: PointId,
    },
    /// Takes a dot's name away.
    Unlabel {
        /// The image.
        image: ImageId,
        /// The dot.
        dot: DotIndex,
    },
    /// The name of a dot is right: from now on it is the operator's.
    Accept {
        /// The image.
        image: ImageId,
        /// The dot.
        dot: DotIndex,
    },
    /// A dot takes no part: a named one keeps its name, one without a name is never named by a stage.
    Reject {
        /// The image.
        image: ImageId,
        /// The dot.
        dot: DotIndex,
    },
    /// A rejected dot takes part again.
    Restore {
        /// The image.
        image: ImageId,
        /// The dot.
        dot: DotIndex,
    },
    /// A code reading is right: its dots get its names, and from now on they are the operator's.
    AcceptCode {
        /// The image.
        image: ImageId,
        /// Place of the reading in the detections.
        reading: usize,
    },
    /// A code has another number than was read.
    Renumber {
        /// The image.
        image: ImageId,
        /// Place of the reading in the detections.
        reading: usize,
        /// The right number.
        id: u32,
    },
    /// A code reading is no code, or another one: its dots lose its names.
    SetAside {
        /// The image.
        image: ImageId,
        /// Place of the reading in the detections.
        reading: usize,
    },
    /// A dot measured by hand, with its point where it is known.
    AddDot {
        /// The image.
        image: ImageId,
        /// The dot.
        dot: Dot,
        /// Its point.
        point: Option<PointId>,
    },
    /// Of several readings of some dots this one is right: they are named so.
    TakeReading(Box<Reading>),
    /// None of the readings of these dots is right: no stage names them.
    DismissReadings {
        /// The dots.
        dots: Vec<(ImageId, DotIndex)>,
    },
    /// An image does not show a point: nobody looks or asks for it there.
    NotThere {
        /// The image.
        image: ImageId,
        /// The point.
        point: PointId,
    },
    /// A known distance between two points.
    AddBar {
        /// Its name; no other bar has it.
        name: String,
        /// Label of one end.
        from: String,
        /// Label of the other end.
        to: String,
        /// Known length, mm.
        length_mm: f64,
        /// Its standard deviation, mm.
        sigma_mm: f64,
        /// Whether it gives scale or only checks it.
        role: BarRole,
    },
    /// A scale bar goes.
    RemoveBar {
        /// Its name.
        name: String,
    },
    /// A point has known coordinates; they take the place of those it had.
    SetControl {
        /// Label of the point.
        label: String,
        /// Known coordinates, mm; `None` where one is unknown.
        coordinates_mm: [Option<f64>; 3],
        /// Their standard deviations, mm.
        sigmas_mm: [Option<f64>; 3],
        /// What it is for.
        role: ControlRole,
    },
    /// A point has no known coordinates any more.
    RemoveControl {
        /// Label of the point.
        label: String,
    },
    /// Plain targets get names; another target that had one of them loses it. Bars and control points go along.
    NameTargets {
        /// Names by the numbers of targets.
        names: BTreeMap<u32, String>,
    },
    /// A plain target gets another name, or its number again.
    RenameTarget {
        /// Number of the target.
        target: u32,
        /// The name; `None`: `M` and its number.
        name: Option<String>,
    },
    /// An image takes part or not.
    UseImage {
        /// The image.
        image: ImageId,
        /// Whether.
        usage: ImageUse,
    },
    /// Other settings.
    Settings(Box<MeasurementSettings>),
    /// Another coordinate system of the result; only the final adjustment has something to do again.
    Frame(Frame),
}

/// Why an edit cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EditError {
    /// The image is gone.
    #[error("found no such image any more")]
    NoImage,
    /// The dot is gone.
    #[error("{image}: found no such dot any more")]
    NoDot {
        /// Path of the image.
        image: String,
    },
    /// The dot has no name.
    #[error("{image}: the dot has no label, expected a labelled one")]
    NoLabel {
        /// Path of the image.
        image: String,
    },
    /// The dot has a name, or was rejected.
    #[error(
        "{image}: found a dot that was named or rejected meanwhile, expected one without a label"
    )]
    HasLabel {
        /// Path of the image.
        image: String,
    },
    /// The reading is gone.
    #[error("{image}: found no such code reading any more")]
    NoReading {
        /// Path of the image.
        image: String,
    },
    /// The family has no such code.
    #[error("found code number {found}, expected 1 to {largest}")]
    NoSuchCode {
        /// Number given.
        found: u32,
        /// Largest number of the family.
        largest: u32,
    },
    /// No image shows such a point.
    #[error("found no point '{0}' in any image, expected the label of a target")]
    UnknownPoint(String),
    /// Both ends of a bar are one point.
    #[error("both ends of bar '{name}' are {label}, expected two points")]
    SameEnds {
        /// Name of the bar.
        name: String,
        /// Label of the point.
        label: String,
    },
    /// A bar without a name.
    #[error("found a bar without a name, expected one that its results are listed under")]
    NoBarName,
    /// There is a bar of this name.
    #[error("found a bar '{0}' already, expected another name")]
    BarExists(String),
    /// The bar is gone.
    #[error("found no bar '{0}' any more")]
    NoBar(String),
    /// The point has no known coordinates.
    #[error("{0} has no known coordinates any more")]
    NoControl(String),
    /// A length or standard deviation that is none.
    #[error("found {what} of {found} mm, expected a number above 0")]
    NotPositive {
        /// What the number is.
        what: &'static str,
        /// The number, mm.
        found: f64,
    },
    /// A target cannot have this name.
    #[error(transparent)]
    Name(#[from] NameProblem),
    /// A point with known coordinates of which none is given.
    #[error("{0}: found no coordinate, expected one at least, in mm")]
    NoCoordinate(String),
}

impl Edit {
    /// What it does, as an entry of the history.
    #[must_use]
    pub fn title(&self, network: &Network) -> String {
        let path = |id: &ImageId| {
            network
                .images
                .get(id)
                .map_or("an image", |i| i.file.path.as_str())
        };
        match self {
            Edit::Label { image, point, .. } => {
                format!("label {} in {}", network.label(*point), path(image))
            }
            Edit::Unlabel { image, .. } => format!("take a label away in {}", path(image)),
            Edit::Accept { image, dot } => format!(
                "accept {} in {}",
                dot_name(network, *image, *dot),
                path(image)
            ),
            Edit::Reject { image, dot } => format!(
                "reject {} in {}",
                dot_name(network, *image, *dot),
                path(image)
            ),
            Edit::Restore { image, dot } => format!(
                "restore {} in {}",
                dot_name(network, *image, *dot),
                path(image)
            ),
            Edit::AcceptCode { image, reading } => match reading_of(network, *image, *reading) {
                Ok(code) => format!(
                    "accept code {} in {}",
                    code.family.code_label(code.id),
                    path(image)
                ),
                Err(_) => format!("accept a code in {}", path(image)),
            },
            Edit::Renumber { image, id, .. } => {
                format!("renumber a code to {id} in {}", path(image))
            }
            Edit::SetAside { image, .. } => format!("set a code aside in {}", path(image)),
            Edit::AddDot {
                image,
                point: Some(point),
                ..
            } => {
                format!(
                    "measure {} by hand in {}",
                    network.label(*point),
                    path(image)
                )
            }
            Edit::AddDot { image, .. } => format!("measure a dot by hand in {}", path(image)),
            Edit::TakeReading(reading) => readings::title(network, reading),
            Edit::DismissReadings { dots } => format!("no reading of {} dots is right", dots.len()),
            Edit::NotThere { image, point } => {
                format!("{} is not there in {}", network.label(*point), path(image))
            }
            Edit::AddBar { name, from, to, .. } => {
                format!("add scale bar '{name}' from {from} to {to}")
            }
            Edit::RemoveBar { name } => format!("remove scale bar '{name}'"),
            Edit::SetControl { label, .. } => format!("give {label} known coordinates"),
            Edit::RemoveControl { label } => format!("take the known coordinates of {label} away"),
            Edit::NameTargets { names } => format!("name {} targets", names.len()),
            Edit::RenameTarget { target, name } => names::rename_title(network, *target, name),
            Edit::UseImage {
                image,
                usage: ImageUse::Used,
            } => format!("use {}", path(image)),
            Edit::UseImage {
                image,
                usage: ImageUse::Excluded,
            } => format!("exclude {}", path(image)),
            Edit::Settings(_) => "change settings".into(),
            Edit::Frame(frame) => format!("set the frame {}", frame.in_words(network)),
        }
    }

    /// Makes the change; inputs count up, so every stage that worked on the old ones has something to do again. A frame
    /// is no input: points and labels stay what they are, and the final adjustment alone is made again. Nor is a name:
    /// nothing that was computed asks what a point is called; nor what is not there: nothing was computed from it.
    ///
    /// # Errors
    /// [`EditError`]; the network is unchanged then.
    pub fn apply(&self, network: &mut Network) -> Result<(), EditError> {
        match self {
            Edit::Label { image, dot, point } => {
                existing_dot(network, *image, *dot)?;
                name(network, *image, *dot, *point);
            }
            Edit::Unlabel { image, dot } => {
                labelled(network, *image, *dot)?;
                unlabel(network, *image, *dot);
            }
            Edit::Accept { image, dot } => accept(network, *image, *dot)?,
            Edit::Reject { image, dot } => reject(network, *image, *dot)?,
            Edit::Restore { image, dot } => restore(network, *image, *dot)?,
            Edit::AcceptCode { image, reading } => {
                let id = reading_of(network, *image, *reading)?.id;
                renumber(network, *image, *reading, id)?;
            }
            Edit::Renumber { image, reading, id } => renumber(network, *image, *reading, *id)?,
            Edit::SetAside { image, reading } => set_aside(network, *image, *reading)?,
            Edit::AddDot { image, dot, point } => {
                let index = add_dot(network, *image, dot.clone())?;
                if let Some(point) = point {
                    name(network, *image, index, *point);
                }
            }
            Edit::TakeReading(reading) => readings::take(network, reading)?,
            Edit::DismissReadings { dots } => readings::dismiss(network, dots)?,
            Edit::NotThere { image, point } => return not_there::set(network, *image, *point),
            Edit::AddBar {
                name,
                from,
                to,
                length_mm,
                sigma_mm,
                role,
            } => {
                let bar = ScaleBar {
                    name: name.trim().to_owned(),
                    from: from.clone(),
                    to: to.clone(),
                    length_mm: *length_mm,
                    sigma_mm: *sigma_mm,
                    role: *role,
                    expansion: None,
                };
                known::add_bar(network, bar)?;
            }
            Edit::RemoveBar { name } => known::remove_bar(network, name)?,
            Edit::SetControl {
                label,
                coordinates_mm,
                sigmas_mm,
                role,
            } => known::set_control(network, label, *coordinates_mm, *sigmas_mm, *role)?,
            Edit::RemoveControl { label } => known::remove_control(network, label)?,
            Edit::NameTargets { names } => return names::name_targets(network, names),
            Edit::RenameTarget { target, name } => {
                return names::rename_target(network, *target, name.as_deref());
            }
            Edit::UseImage { image, usage } => {
                if !network.images.contains_key(image) {
                    return Err(EditError::NoImage);
                }
                network.image_mut(*image).usage = *usage;
            }
            Edit::Settings(settings) => settings::set(network, settings),
            Edit::Frame(frame) => {
                network.frame = *frame;
                network.conclusions.remove(&Stage::Adjust);
                return Ok(());
            }
        }
        network.inputs += 1;
        Ok(())
    }
}

fn path_of(network: &Network, image: ImageId) -> Result<String, EditError> {
    network
        .images
        .get(&image)
        .map(|i| i.file.path.clone())
        .ok_or(EditError::NoImage)
}

fn existing_dot(network: &Network, image: ImageId, dot: DotIndex) -> Result<(), EditError> {
    let path = path_of(network, image)?;
    let found = network.images[&image]
        .detections
        .as_ref()
        .is_some_and(|d| dot.slot() < d.dots.len());
    found.then_some(()).ok_or(EditError::NoDot { image: path })
}

fn reading_of(
    network: &Network,
    image: ImageId,
    reading: usize,
) -> Result<&CodeReading, EditError> {
    let path = path_of(network, image)?;
    let detections = network.images[&image].detections.as_ref();
    detections
        .and_then(|d| d.codes.get(reading))
        .ok_or(EditError::NoReading { image: path })
}

/// A dot in the words of a title: its label, where it has one.
fn dot_name(network: &Network, image: ImageId, dot: DotIndex) -> String {
    let label = network
        .images
        .get(&image)
        .and_then(|entry| entry.labels.get(&dot));
    label.map_or_else(|| "a dot".to_owned(), |label| network.label(label.point))
}

fn labelled(network: &Network, image: ImageId, dot: DotIndex) -> Result<(), EditError> {
    existing_dot(network, image, dot)?;
    let path = path_of(network, image)?;
    let found = network.images[&image].labels.contains_key(&dot);
    found
        .then_some(())
        .ok_or(EditError::NoLabel { image: path })
}

/// Names a dot; another dot of the image that carried this name loses it, for a point has one image in a picture. A dot
/// that was rejected takes part again, and a number that is new for a plain target is given to no other one.
fn name(network: &mut Network, image: ImageId, dot: DotIndex, point: PointId) {
    let entry = network.image_mut(image);
    unlabel_where(entry, |other, label| *other != dot && label.point == point);
    Arc::make_mut(&mut entry.labels).insert(
        dot,
        Label {
            point,
            source: Source::Operator,
            rejected: None,
        },
    );
    if entry.rejected_dots.contains_key(&dot) {
        Arc::make_mut(&mut entry.rejected_dots).remove(&dot);
    }
    not_there::take_back(entry, point);
    if let PointId::Target(number) = point {
        network.next_target = network.next_target.max(number);
    }
}

/// Takes a name away; a dot that the operator rejected stays rejected.
fn unlabel(network: &mut Network, image: ImageId, dot: DotIndex) {
    unlabel_where(network.image_mut(image), |other, _| *other == dot);
}

/// Takes the names of these dots away; those that the operator rejected stay rejected.
fn unlabel_where(entry: &mut ImageEntry, is_meant: impl Fn(&DotIndex, &Label) -> bool) {
    let meant = entry
        .labels
        .iter()
        .filter(|(dot, label)| is_meant(dot, label));
    let rejected: Vec<DotIndex> = meant
        .filter(|(_, label)| label.is_rejected_by_operator())
        .map(|(dot, _)| *dot)
        .collect();
    Arc::make_mut(&mut entry.labels).retain(|dot, label| !is_meant(dot, label));
    for dot in rejected {
        Arc::make_mut(&mut entry.rejected_dots).insert(dot, REJECTED_BY_OPERATOR.to_owned());
    }
}

fn accept(network: &mut Network, image: ImageId, dot: DotIndex) -> Result<(), EditError> {
    labelled(network, image, dot)?;
    if let Some(label) = Arc::make_mut(&mut network.image_mut(image).labels).get_mut(&dot) {
        label.source = Source::Operator;
        label.rejected = None;
    }
    Ok(())
}

fn reject(network: &mut Network, image: ImageId, dot: DotIndex) -> Result<(), EditError> {
    existing_dot(network, image, dot)?;
    let entry = network.image_mut(image);
    match Arc::make_mut(&mut entry.labels).get_mut(&dot) {
        Some(label) => {
            label.source = Source::Operator;
            label.rejected = Some(REJECTED_BY_OPERATOR.to_owned());
        }
        None => {
            Arc::make_mut(&mut entry.rejected_dots).insert(dot, REJECTED_BY_OPERATOR.to_owned());
        }
    }
    Ok(())
}

fn restore(network: &mut Network, image: ImageId, dot: DotIndex) -> Result<(), EditError> {
    existing_dot(network, image, dot)?;
    let entry = network.image_mut(image);
    if entry.rejected_dots.contains_key(&dot) {
        Arc::make_mut(&mut entry.rejected_dots).remove(&dot);
        return Ok(());
    }
    accept(network, image, dot)
}

fn renumber(
    network: &mut Network,
    image: ImageId,
    reading: usize,
    id: u32,
) -> Result<(), EditError> {
    let code = reading_of(network, image, reading)?.clone();
    let largest = code.family.code_count();
    if !(1..=largest).contains(&id) {
        return Err(EditError::NoSuchCode { found: id, largest });
    }
    for (dot, point) in code.dots.iter().zip(PointId::of_code(code.family, id)) {
        name(network, image, *dot, point);
    }
    Arc::make_mut(&mut network.image_mut(image).set_aside).remove(&reading);
    Ok(())
}

fn set_aside(network: &mut Network, image: ImageId, reading: usize) -> Result<(), EditError> {
    let code = reading_of(network, image, reading)?.clone();
    // Whatever number it has by now: each dot loses the name that it has for its place in this code.
    let of_reading = |dot: &DotIndex, label: &Label| {
        let place = code.dots.iter().position(|other| other == dot);
        match (place.and_then(|place| CodeDot::ALL.get(place)), label.point) {
            (Some(place), PointId::Code { family, dot, .. }) => {
                family == code.family && dot == *place
            }
            _ => false,
        }
    };
    let entry = network.image_mut(image);
    unlabel_where(entry, of_reading);
    Arc::make_mut(&mut entry.set_aside).insert(reading, SET_ASIDE_BY_OPERATOR.to_owned());
    Ok(())
}

/// A dot measured by hand stands behind the detected ones, so that no index changes.
fn add_dot(network: &mut Network, image: ImageId, dot: Dot) -> Result<DotIndex, EditError> {
    let path = path_of(network, image)?;
    if network.images[&image].detections.is_none() {
        return Err(EditError::NoDot { image: path });
    }
    let entry = network.image_mut(image);
    let detections = Arc::make_mut(entry.detections.get_or_insert_default());
    detections.dots.push(dot);
    let index = DotIndex(detections.dots.len() as u32 - 1);
    detections.by_hand.push(index);
    Ok(index)
}
