//! Why an adjustment was not made, and the names of unknowns.

use std::fmt;

use super::Termination;
use crate::camera::INTERIOR_NAMES;
use crate::geometry::ThreePointsError;
use crate::monitor::Interrupted;

/// One of the six unknowns of a station.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum StationComponent {
    /// Turn about the camera's x axis (to the right).
    TurnX,
    /// Turn about the camera's y axis (up).
    TurnY,
    /// Turn about the camera's z axis (backwards).
    TurnZ,
    /// Coordinate x of the projection centre.
    X,
    /// Coordinate y of the projection centre.
    Y,
    /// Coordinate z of the projection centre.
    Z,
}

impl StationComponent {
    pub(super) const ALL: [Self; 6] = [
        Self::TurnX,
        Self::TurnY,
        Self::TurnZ,
        Self::X,
        Self::Y,
        Self::Z,
    ];
}

impl fmt::Display for StationComponent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            StationComponent::TurnX => "turn about x",
            StationComponent::TurnY => "turn about y",
            StationComponent::TurnZ => "turn about z",
            StationComponent::X => "X",
            StationComponent::Y => "Y",
            StationComponent::Z => "Z",
        })
    }
}

/// An unknown of the adjustment, by its place in the problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ParameterName {
    /// A parameter of interior orientation.
    Camera {
        /// Index of the camera.
        index: usize,
        /// Index into [`INTERIOR_NAMES`].
        parameter: usize,
    },
    /// A parameter of interior orientation that a station has for itself.
    Image {
        /// Index of the station.
        index: usize,
        /// Index into [`INTERIOR_NAMES`].
        parameter: usize,
    },
    /// An unknown of a station.
    Station {
        /// Index of the station.
        index: usize,
        /// Which of its six.
        component: StationComponent,
    },
    /// Coordinates of an object point.
    Point {
        /// Index of the point.
        index: usize,
    },
}

impl fmt::Display for ParameterName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Camera { index, parameter } => {
                write!(f, "{} of camera {index}", INTERIOR_NAMES[*parameter])
            }
            Self::Image { index, parameter } => {
                write!(f, "{} of station {index}", INTERIOR_NAMES[*parameter])
            }
            Self::Station { index, component } => {
                write!(f, "{component} of station {index}")
            }
            Self::Point { index } => write!(f, "point {index}"),
        }
    }
}

/// A motion of the whole network that the observations do not notice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DatumMotion {
    /// Shift along x.
    ShiftX,
    /// Shift along y.
    ShiftY,
    /// Shift along z.
    ShiftZ,
    /// Turn about an axis parallel to x.
    TurnX,
    /// Turn about an axis parallel to y.
    TurnY,
    /// Turn about an axis parallel to z.
    TurnZ,
    /// Change of scale.
    Scale,
}

impl DatumMotion {
    pub(super) const ALL: [Self; 7] = [
        Self::ShiftX,
        Self::ShiftY,
        Self::ShiftZ,
        Self::TurnX,
        Self::TurnY,
        Self::TurnZ,
        Self::Scale,
    ];
}

/// Which list of the problem an error speaks of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProblemPart {
    /// A station (its camera index, or its pose).
    Station,
    /// A camera (its start values or priors).
    Camera,
    /// A point (its start value or priors).
    Point,
    /// An image observation.
    Observation,
    /// A distance.
    Distance,
    /// A datum point.
    Datum,
    /// A point of the frame.
    Frame,
}

/// Why an adjustment was not made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AdjustmentError {
    /// The operator asked to stop.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
    /// An index out of range, a sigma that is not positive or a number that is not finite.
    #[error("{part:?} {index} of the adjustment's input is not valid")]
    InvalidInput {
        /// The list.
        part: ProblemPart,
        /// The entry.
        index: usize,
    },
    /// Too few rays, distances and known coordinates.
    #[error("{} points have too few rays, the first is point {}", points.len(), points[0])]
    PointsUnderdetermined {
        /// Their indices.
        points: Vec<usize>,
    },
    /// Fewer used image points than a pose needs.
    #[error("station {station} has {found} used image points, needs 3")]
    StationUnderdetermined {
        /// Its index.
        station: usize,
        /// Used image points.
        found: usize,
    },
    /// The start values put points behind the camera or beyond the image its lens can form.
    #[error("{} observed points are not imaged by the start values, the first is observation {}", observations.len(), observations[0])]
    NotImaged {
        /// Indices of the observations.
        observations: Vec<usize>,
    },
    /// Control was to fix the frame but leaves it free.
    #[error("the known coordinates leave {defect} of 7 motions of the network free: {motions:?}")]
    DatumDefect {
        /// Dimension of the freedom.
        defect: usize,
        /// Motions that take part in it.
        motions: Vec<DatumMotion>,
    },
    /// The points chosen for the inner constraints cannot fix the frame (fewer than three, or all on one line).
    #[error(
        "{found} datum points take part, they cannot fix the {defect} free motions of the network"
    )]
    DatumPoints {
        /// Datum points that take part.
        found: usize,
        /// Motions to be fixed.
        defect: usize,
    },
    /// A point that gives the frame of the result takes no part.
    #[error("point {point} gives the frame but takes no part in the adjustment")]
    FramePoint {
        /// Its index.
        point: usize,
    },
    /// The three points that give the frame of the result do not determine it.
    #[error(transparent)]
    FrameShape(#[from] ThreePointsError),
    /// The observations leave unknowns undetermined.
    #[error(
        "rank defect of {defect}: the observations leave loose {}",
        list(loose)
    )]
    RankDefect {
        /// Dimension of the null space.
        defect: usize,
        /// The unknowns that move in it, the most affected first.
        loose: Vec<ParameterName>,
    },
    /// The iteration ended without convergence.
    #[error("the adjustment did not converge: {0:?}")]
    NotConverged(Termination),
    /// The result was asked for before the iteration had ended.
    #[error("the adjustment has not been iterated to its end")]
    NotFinished,
}

fn list(names: &[ParameterName]) -> String {
    /// More names than this do not help anybody.
    const SHOWN: usize = 12;
    let mut text = names
        .iter()
        .take(SHOWN)
        .map(ToString::to_string)
        .collect::<Vec<_>>()
        .join(", ");
    if names.len() > SHOWN {
        text.push_str(&format!(" and {} more", names.len() - SHOWN));
    }
    text
}
