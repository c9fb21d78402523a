//! The operator's answers where readings of dots exclude each other.

use std::sync::Arc;

use super::{EditError, existing_dot, name, path_of};
use crate::network::{ImageId, NO_READING_BY_OPERATOR, Network, Point, ReadTarget, Reading};
use crate::targets::DotIndex;

pub(super) fn title(network: &Network, reading: &Reading) -> String {
    let dots = match reading.dots.len() {
        1 => "1 dot".to_owned(),
        count => format!("{count} dots"),
    };
    match reading.target {
        ReadTarget::New { .. } => format!("read {dots} as a new target"),
        ReadTarget::Known(point) => format!("read {dots} as {}", network.label(point)),
    }
}

/// Names the dots of a reading. A new target gets the next number and the place at which its rays meet, so that what goes on finds it
/// as a known one.
pub(super) fn take(network: &mut Network, reading: &Reading) -> Result<(), EditError> {
    for (image, dot) in &reading.dots {
        waiting(network, *image, *dot)?;
    }
    let point = match &reading.target {
        ReadTarget::Known(point) if network.points.contains_key(point) => *point,
        ReadTarget::Known(point) => return Err(EditError::UnknownPoint(network.label(*point))),
        ReadTarget::New {
            position,
            covariance,
        } => {
            let id = network.new_target();
            let point = Point {
                position: *position,
                covariance: Some(*covariance),
                rays: reading.dots.len() as u32,
                circle: None,
            };
            Arc::make_mut(&mut network.points).insert(id, Arc::new(point));
            id
        }
    };
    for (image, dot) in &reading.dots {
        name(network, *image, *dot, point);
    }
    Ok(())
}

/// None of the readings is right: no stage looks at these dots again.
pub(super) fn dismiss(
    network: &mut Network,
    dots: &[(ImageId, DotIndex)],
) -> Result<(), EditError> {
    for (image, dot) in dots {
        waiting(network, *image, *dot)?;
    }
    for (image, dot) in dots {
        let entry = network.image_mut(*image);
        // The name of a code that only this image shows is given up with the dot.
        if entry.labels.contains_key(dot) {
            Arc::make_mut(&mut entry.labels).remove(dot);
        }
        let reason = NO_READING_BY_OPERATOR.to_owned();
        Arc::make_mut(&mut entry.rejected_dots).insert(*dot, reason);
    }
    Ok(())
}

fn waiting(network: &Network, image: ImageId, dot: DotIndex) -> Result<(), EditError> {
    existing_dot(network, image, dot)?;
    let waits = network.awaits_name(&network.images[&image], dot);
    let path = path_of(network, image)?;
    waits
        .then_some(())
        .ok_or(EditError::HasLabel { image: path })
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Vector3};

    use super::*;
    use crate::network::{Agreement, AmbiguousGroup, PointId, Source};
    use crate::project::edit::Edit;
    use crate::report::fixture;

    /// The small network of the reports, and a dot without a name of it.
    fn network() -> (Network, (ImageId, DotIndex)) {
        let network = fixture::network();
        let free = network.images.iter().find_map(|(id, image)| {
            let dots = image.detections.as_ref()?.dots.len() as u32;
            let mut dots = (0..dots).map(DotIndex);
            let dot = dots.find(|dot| network.awaits_name(image, *dot))?;
            Some((*id, dot))
        });
        let free = free.expect("a dot without a name");
        (network, free)
    }

    fn reading(target: ReadTarget, dot: (ImageId, DotIndex)) -> Reading {
        Reading {
            target,
            dots: vec![dot],
            rays: Agreement::default(),
            shape: Agreement::default(),
            diameter_mm: None,
            log_likelihood: 1.0,
        }
    }

    fn new_target() -> ReadTarget {
        ReadTarget::New {
            position: Vector3::new(1.0, 2.0, 3.0),
            covariance: Matrix3::identity(),
        }
    }

    #[test]
    fn a_reading_as_a_new_target_gives_number_place_and_names_by_hand() {
        let (mut network, dot) = network();
        let (inputs, number) = (network.inputs, 2);
        let edit = Edit::TakeReading(Box::new(reading(new_target(), dot)));
        assert_eq!(edit.title(&network), "read 1 dot as a new target");
        edit.apply(&mut network).unwrap();
        let id = PointId::Target(number);
        let label = &network.images[&dot.0].labels[&dot.1];
        assert_eq!((label.point, label.source), (id, Source::Operator));
        assert_eq!(network.points[&id].position, Vector3::new(1.0, 2.0, 3.0));
        assert_eq!((network.inputs, network.next_target), (inputs + 1, number));
        let before = network.clone();
        assert!(matches!(
            edit.apply(&mut network),
            Err(EditError::HasLabel { .. })
        ));
        assert_eq!(network, before, "a refused edit changes nothing");
    }

    #[test]
    fn a_reading_of_a_point_that_is_gone_is_refused() {
        let (mut network, dot) = network();
        let gone = ReadTarget::Known(PointId::Target(99));
        let edit = Edit::TakeReading(Box::new(reading(gone, dot)));
        assert_eq!(
            edit.apply(&mut network),
            Err(EditError::UnknownPoint("M99".into()))
        );
    }

    #[test]
    fn an_answer_leaves_no_question_and_none_of_them_is_one_too() {
        let (mut network, dot) = network();
        let known = *network.points.keys().next().expect("a point");
        let readings = vec![
            reading(new_target(), dot),
            reading(ReadTarget::Known(known), dot),
        ];
        let image = network.image_mut(dot.0);
        Arc::make_mut(&mut image.labels).retain(|_, label| label.point != known);
        network.ambiguous = Arc::new(vec![AmbiguousGroup { readings }]);
        let groups = network.open_groups();
        assert_eq!(groups.len(), 1);
        let taken = Edit::TakeReading(Box::new(groups[0].readings[1].clone()));
        let mut decided = network.clone();
        taken.apply(&mut decided).unwrap();
        assert_eq!(decided.images[&dot.0].labels[&dot.1].point, known);
        assert!(decided.open_groups().is_empty());
        let none = Edit::DismissReadings {
            dots: groups[0].dots().into_iter().collect(),
        };
        none.apply(&mut network).unwrap();
        assert!(network.open_groups().is_empty());
        assert_eq!(
            network.images[&dot.0].rejected_dots[&dot.1],
            NO_READING_BY_OPERATOR
        );
        let (image, dot) = dot;
        Edit::Restore { image, dot }.apply(&mut network).unwrap();
        assert_eq!(network.open_groups().len(), 1, "it is asked again");
    }
}
