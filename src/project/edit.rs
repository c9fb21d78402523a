//! What the operator does by hand: decisions that no stage overrides.
//!
//! An edit is checked again when it is applied: while a step runs, edits wait, and what they are about may be gone.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::network::{ImageId, ImageUse, Label, MeasurementSettings, Network, PointId, Source};
use crate::targets::{Dot, DotIndex};

/// Reason of an operator's rejection, as shown and exported.
pub const REJECTED_BY_OPERATOR: &str = "rejected by the operator";

/// Reason of a reading that the operator set aside, as shown and exported.
pub const SET_ASIDE_BY_OPERATOR: &str = "set aside by the operator";

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
    /// A dot takes no part.
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
    /// An image takes part or not.
    UseImage {
        /// The image.
        image: ImageId,
        /// Whether.
        usage: ImageUse,
    },
    /// Other settings.
    Settings(Box<MeasurementSettings>),
}

/// Why an edit cannot be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
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
            Edit::Reject { image, .. } => format!("reject a dot in {}", path(image)),
            Edit::Restore { image, .. } => format!("restore a dot in {}", path(image)),
            Edit::Renumber { image, id, .. } => {
                format!("renumber a code to {id} in {}", path(image))
            }
            Edit::SetAside { image, .. } => format!("set a code aside in {}", path(image)),
            Edit::AddDot { image, .. } => format!("measure a dot by hand in {}", path(image)),
            Edit::UseImage {
                image,
                usage: ImageUse::Used,
            } => format!("use {}", path(image)),
            Edit::UseImage {
                image,
                usage: ImageUse::Excluded,
            } => format!("exclude {}", path(image)),
            Edit::Settings(_) => "change settings".into(),
        }
    }

    /// Makes the change; inputs count up, so every stage that worked on the old ones has something to do again.
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
                Arc::make_mut(&mut network.image_mut(*image).labels).remove(dot);
            }
            Edit::Reject { image, dot } => {
                decide(network, *image, *dot, Some(REJECTED_BY_OPERATOR))?
            }
            Edit::Restore { image, dot } => decide(network, *image, *dot, None)?,
            Edit::Renumber { image, reading, id } => renumber(network, *image, *reading, *id)?,
            Edit::SetAside { image, reading } => set_aside(network, *image, *reading)?,
            Edit::AddDot { image, dot, point } => {
                let index = add_dot(network, *image, dot.clone())?;
                if let Some(point) = point {
                    name(network, *image, index, *point);
                }
            }
            Edit::UseImage { image, usage } => {
                if !network.images.contains_key(image) {
                    return Err(EditError::NoImage);
                }
                network.image_mut(*image).usage = *usage;
            }
            Edit::Settings(settings) => network.settings = Arc::new(settings.as_ref().clone()),
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

fn labelled(network: &Network, image: ImageId, dot: DotIndex) -> Result<(), EditError> {
    existing_dot(network, image, dot)?;
    let path = path_of(network, image)?;
    let found = network.images[&image].labels.contains_key(&dot);
    found
        .then_some(())
        .ok_or(EditError::NoLabel { image: path })
}

/// Names a dot; another dot of the image that carried this name loses it, for a point has one image in a picture.
fn name(network: &mut Network, image: ImageId, dot: DotIndex, point: PointId) {
    let labels = Arc::make_mut(&mut network.image_mut(image).labels);
    labels.retain(|other, label| *other == dot || label.point != point);
    labels.insert(
        dot,
        Label {
            point,
            source: Source::Operator,
            rejected: None,
        },
    );
}

fn decide(
    network: &mut Network,
    image: ImageId,
    dot: DotIndex,
    rejected: Option<&str>,
) -> Result<(), EditError> {
    labelled(network, image, dot)?;
    let labels = Arc::make_mut(&mut network.image_mut(image).labels);
    if let Some(label) = labels.get_mut(&dot) {
        label.source = Source::Operator;
        label.rejected = rejected.map(str::to_owned);
    }
    Ok(())
}

fn renumber(
    network: &mut Network,
    image: ImageId,
    reading: usize,
    id: u32,
) -> Result<(), EditError> {
    let path = path_of(network, image)?;
    let detections = network.images[&image].detections.clone();
    let code = detections
        .as_ref()
        .and_then(|d| d.codes.get(reading))
        .ok_or(EditError::NoReading { image: path })?;
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
    let path = path_of(network, image)?;
    let detections = network.images[&image].detections.clone();
    let code = detections
        .as_ref()
        .and_then(|d| d.codes.get(reading))
        .ok_or(EditError::NoReading { image: path })?;
    let points = PointId::of_code(code.family, code.id);
    let entry = network.image_mut(image);
    Arc::make_mut(&mut entry.labels)
        .retain(|dot, label| !(code.dots.contains(dot) && points.contains(&label.point)));
    Arc::make_mut(&mut entry.set_aside).insert(reading, SET_ASIDE_BY_OPERATOR.to_owned());
    Ok(())
}

fn add_dot(network: &mut Network, image: ImageId, dot: Dot) -> Result<DotIndex, EditError> {
    let path = path_of(network, image)?;
    let entry = network.image_mut(image);
    let detections = entry
        .detections
        .as_mut()
        .ok_or(EditError::NoDot { image: path })?;
    let detections = Arc::make_mut(detections);
    detections.dots.push(dot);
    let index = DotIndex(detections.dots.len() as u32 - 1);
    detections.by_hand.push(index);
    Ok(index)
}
