//! The operator's word that an image does not show a target.

use std::sync::Arc;

use super::{EditError, path_of};
use crate::network::{Absence, ImageEntry, ImageId, Network, PointId};

/// Writes it down, also where the last look has another reason. The next look leaves the target out.
pub(super) fn set(network: &mut Network, image: ImageId, point: PointId) -> Result<(), EditError> {
    let path = path_of(network, image)?;
    if !network.points.contains_key(&point) {
        return Err(EditError::UnknownPoint(network.label(point)));
    }
    let entry = network.image_mut(image);
    if entry.labels.values().any(|label| label.point == point) {
        return Err(EditError::HasLabel { image: path });
    }
    Arc::make_mut(&mut entry.not_there).insert(point);
    if let Some(look) = &mut entry.look
        && let Some(absence) = look.absent.get(&point)
    {
        let denied = Absence::denied(absence.place_px);
        Arc::make_mut(look).absent.insert(point, denied);
    }
    Ok(())
}

/// The operator found it there all the same: nothing tells of the denial any more.
pub(super) fn take_back(entry: &mut ImageEntry, point: PointId) {
    if !entry.not_there.contains(&point) {
        return;
    }
    Arc::make_mut(&mut entry.not_there).remove(&point);
    if let Some(look) = &mut entry.look
        && look.absent.contains_key(&point)
    {
        Arc::make_mut(look).absent.remove(&point);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::network::{AbsenceKind, Look};
    use crate::project::edit::Edit;
    use crate::report::fixture;
    use crate::targets::DotIndex;

    #[test]
    fn what_is_not_there_is_told_so_until_it_is_named_by_hand() {
        let mut network = fixture::network();
        let (image, named) = network
            .used_images()
            .find_map(|(id, image)| Some((id, image.labels.values().next()?.point)))
            .unwrap();
        let point = PointId::Target(77);
        let edit = Edit::NotThere { image, point };
        assert_eq!(
            edit.apply(&mut network),
            Err(EditError::UnknownPoint("M77".into()))
        );
        let known = network.points.values().next().unwrap().clone();
        Arc::make_mut(&mut network.points).insert(point, known);
        let absence = Absence {
            place_px: Vector2::new(10.0, 20.0),
            kind: AbsenceKind::Weak,
            reason: "too weak".into(),
        };
        network.image_mut(image).look = Some(Arc::new(Look {
            absent: [(point, absence)].into(),
            ..Look::default()
        }));
        let inputs = network.inputs;
        edit.apply(&mut network).unwrap();
        assert_eq!(network.inputs, inputs, "no stage has anything to do again");
        let told: Vec<_> = network.images[&image].absent().collect();
        assert_eq!(told, [(point, &Absence::denied(Vector2::new(10.0, 20.0)))]);
        let refused = Edit::NotThere {
            image,
            point: named,
        };
        assert!(matches!(
            refused.apply(&mut network),
            Err(EditError::HasLabel { .. })
        ));
        let label = Edit::Label {
            image,
            dot: DotIndex(0),
            point,
        };
        label.apply(&mut network).unwrap();
        assert!(network.images[&image].not_there.is_empty());
        let unlabel = Edit::Unlabel {
            image,
            dot: DotIndex(0),
        };
        unlabel.apply(&mut network).unwrap();
        assert_eq!(network.images[&image].absent().count(), 0);
    }
}
