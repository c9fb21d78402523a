//! The coordinate system that the operator wants for the result.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{ControlRole, Network, PointId};
use crate::geometry::{FitError, Scale, Similarity, ThreePointsError, ThreeTwoOne, fit_similarity};

/// The coordinate system of the result. Choosing one changes no residual, no scale and no distance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Frame {
    /// Nothing was chosen: onto the control points where three or more are known, else the network's own.
    #[default]
    Automatic,
    /// The network's own: where its first images put it.
    Free,
    /// Best fit onto the control points.
    Control,
    /// By three points: origin, axis, plane.
    ThreeTwoOne(ThreeTwoOne<PointId>),
}

/// The frame that was asked of an adjustment, and why it has another one.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameResult {
    /// What was asked for.
    pub asked: Frame,
    /// Why the result does not have it; `None` where it has.
    pub refused: Option<String>,
}

/// Why a frame cannot be had; one line for the operator.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FrameProblem {
    /// One point was given twice.
    #[error("found {label} twice, expected three different points for origin, axis and plane")]
    SamePoint {
        /// Its label.
        label: String,
    },
    /// A point has no coordinates.
    #[error(
        "found no coordinates of {label}, expected a point that two or more oriented images show"
    )]
    NoCoordinates {
        /// Its label.
        label: String,
    },
    /// The points are not spread well enough.
    #[error("{origin} (origin), {axis} (axis), {plane} (plane): {error}")]
    Spread {
        /// Label of the origin.
        origin: String,
        /// Label of the axis point.
        axis: String,
        /// Label of the plane point.
        plane: String,
        /// What is too small.
        error: ThreePointsError,
    },
    /// The control points give no best fit.
    #[error("best fit onto control: {0}; expected x, y and z known of 3 or more measured points")]
    Control(#[from] FitError),
    /// Weighted or fixed control is part of the adjustment.
    #[error(
        "found weighted or fixed control points, which hold the frame themselves; expected none, or control points that only align"
    )]
    HeldByControl,
}

impl Frame {
    /// The choice as the end of "set the frame ...".
    #[must_use]
    pub fn in_words(&self, network: &Network) -> String {
        match self {
            Frame::Automatic => "onto control where it is known".to_owned(),
            Frame::Free => "as the network's own".to_owned(),
            Frame::Control => "by best fit onto control".to_owned(),
            Frame::ThreeTwoOne(points) => {
                let ThreeTwoOne {
                    origin,
                    axis,
                    plane,
                    ..
                } = points.map(|p| network.label(*p));
                format!("by {origin}, {axis}, {plane}")
            }
        }
    }
}

impl Network {
    /// Why a frame cannot be had with the points as they are; `None` where it can.
    #[must_use]
    pub fn frame_problem(&self, frame: &Frame) -> Option<FrameProblem> {
        match frame {
            Frame::Automatic => None,
            Frame::Free => self.control_holds().then_some(FrameProblem::HeldByControl),
            Frame::Control => fit_similarity(&self.control_pairs(), Scale::Free)
                .err()
                .map(FrameProblem::Control),
            Frame::ThreeTwoOne(points) => self.motion_into(points).err(),
        }
    }

    /// The motion that brings the points as they are into the frame by three of them.
    ///
    /// # Errors
    /// [`FrameProblem`] where they do not give a frame.
    pub fn motion_into(&self, frame: &ThreeTwoOne<PointId>) -> Result<Similarity, FrameProblem> {
        let points = [frame.origin, frame.axis, frame.plane];
        for (index, point) in points.iter().enumerate() {
            if points[..index].contains(point) {
                return Err(FrameProblem::SamePoint {
                    label: self.label(*point),
                });
            }
        }
        for point in points {
            if !self.points.contains_key(&point) {
                return Err(FrameProblem::NoCoordinates {
                    label: self.label(point),
                });
            }
        }
        let labels = frame.map(|p| self.label(*p));
        frame
            .map(|p| self.points[p].position)
            .motion()
            .map_err(|error| FrameProblem::Spread {
                origin: labels.origin,
                axis: labels.axis,
                plane: labels.plane,
                error,
            })
    }

    /// Pairs (present, known) of the points the network can be aligned to.
    #[must_use]
    pub fn control_pairs(&self) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        self.control
            .iter()
            .filter(|point| point.role != ControlRole::Check)
            .filter_map(|point| {
                let [x, y, z] = point.coordinates_mm;
                let id = self.point_of_label(&point.label).ok()?;
                Some((self.points.get(&id)?.position, Vector3::new(x?, y?, z?)))
            })
            .collect()
    }

    /// Whether weighted or fixed control points are enough to hold the frame: three with all coordinates.
    #[must_use]
    pub fn control_holds(&self) -> bool {
        let holds = |role| matches!(role, ControlRole::Weighted | ControlRole::Fixed);
        let whole = self.control.iter().filter(|point| {
            let measured = self
                .point_of_label(&point.label)
                .is_ok_and(|id| self.points.contains_key(&id));
            holds(point.role) && measured && point.coordinates_mm.iter().all(Option::is_some)
        });
        whole.count() >= 3
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::AxisOrder;
    use crate::network::{ControlPoint, Point};
    use std::sync::Arc;

    fn network() -> Network {
        let places = [
            ("M1", 0.0, 0.0),
            ("M2", 100.0, 0.0),
            ("M3", 0.0, 50.0),
            ("M4", 50.0, 0.01),
        ];
        let points = places.map(|(label, x, y)| {
            let point = Point {
                position: Vector3::new(x, y, 7.0),
                covariance: None,
                rays: 2,
                circle: None,
            };
            (label.parse().unwrap(), Arc::new(point))
        });
        Network {
            points: Arc::new(points.into()),
            ..Network::default()
        }
    }

    fn frame(labels: [&str; 3]) -> Frame {
        let [origin, axis, plane] = labels.map(|label| label.parse().unwrap());
        Frame::ThreeTwoOne(ThreeTwoOne {
            origin,
            axis,
            plane,
            order: AxisOrder::Xy,
        })
    }

    #[test]
    fn what_cannot_be_had_is_told_in_one_line() {
        let network = network();
        let told = |labels| network.frame_problem(&frame(labels)).map(|p| p.to_string());
        assert_eq!(told(["M1", "M2", "M3"]), None);
        assert_eq!(
            told(["M1", "M2", "M1"]).unwrap(),
            "found M1 twice, expected three different points for origin, axis and plane"
        );
        assert_eq!(
            told(["M1", "M9", "M3"]).unwrap(),
            "found no coordinates of M9, expected a point that two or more oriented images show"
        );
        assert_eq!(
            told(["M1", "M2", "M4"]).unwrap(),
            "M1 (origin), M2 (axis), M4 (plane): the plane point lies 0.0100 mm off the axis, expected more than 0.1000 mm"
        );
        assert_eq!(
            network.frame_problem(&Frame::Control).unwrap().to_string(),
            "best fit onto control: a best fit needs 3 common points, found 0; expected x, y and z known of 3 or more measured points"
        );
        assert_eq!(network.frame_problem(&Frame::Free), None);
        assert_eq!(network.frame_problem(&Frame::Automatic), None);
    }

    #[test]
    fn control_that_is_adjusted_leaves_no_free_frame() {
        let mut network = network();
        let control = |label: &str, role| ControlPoint {
            label: label.into(),
            coordinates_mm: [Some(0.0); 3],
            sigmas_mm: [None; 3],
            role,
        };
        network.control = Arc::new(
            ["M1", "M2", "M3"]
                .map(|l| control(l, ControlRole::Fixed))
                .into(),
        );
        assert_eq!(
            network.frame_problem(&Frame::Free),
            Some(FrameProblem::HeldByControl)
        );
        network.control = Arc::new(
            ["M1", "M2", "M3"]
                .map(|l| control(l, ControlRole::Align))
                .into(),
        );
        assert_eq!(network.frame_problem(&Frame::Free), None);
    }

    #[test]
    fn old_results_and_choices_are_read() {
        let json = serde_json::to_string(&frame(["M1", "C17.O", "C18.A"])).unwrap();
        assert_eq!(
            json,
            r#"{"three-two-one":{"origin":"M1","axis":"C17.O","plane":"C18.A","order":"xy"}}"#
        );
        assert_eq!(
            serde_json::from_str::<Frame>(&json).unwrap(),
            frame(["M1", "C17.O", "C18.A"])
        );
    }
}
