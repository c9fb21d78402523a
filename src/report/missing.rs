//! Targets that images ought to show and do not, with the reasons.

use std::collections::BTreeMap;

use super::csv_text::{csv_text, fixed};
use crate::network::{AbsenceKind, Network};

/// Digits of a pixel coordinate.
const PX: usize = 3;

/// Every target that an oriented image ought to show and has no dot of: `image,label,x_px,y_px,class,reason`, the place as predicted.
#[must_use]
pub fn export_missing(network: &Network) -> String {
    let rows = network.oriented_images().flat_map(|(_, image, _)| {
        image.absent().map(|(point, absence)| {
            vec![
                image.file.path.clone(),
                network.label(point),
                fixed(absence.place_px.x, PX),
                fixed(absence.place_px.y, PX),
                absence.kind.to_string(),
                absence.reason.clone(),
            ]
        })
    });
    csv_text("image,label,x_px,y_px,class,reason", rows)
}

/// How many there are of each class.
#[must_use]
pub fn missing_by_class(network: &Network) -> BTreeMap<AbsenceKind, usize> {
    let mut counts = BTreeMap::new();
    for (_, image, _) in network.oriented_images() {
        for (_, absence) in image.absent() {
            *counts.entry(absence.kind).or_default() += 1;
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::Vector2;

    use super::super::fixture::network;
    use super::*;
    use crate::network::{Absence, Look, PointId};

    #[test]
    fn missing_targets_are_told_until_they_have_a_dot() {
        let mut network = network();
        assert_eq!(export_missing(&network).lines().count(), 1);
        let id = network.oriented_images().map(|(id, ..)| id).next();
        let id = id.expect("an oriented image");
        let named = network.images[&id].labels.values().next();
        let named = named.expect("a labelled dot").point;
        let absence = |kind, reason: &str| Absence {
            place_px: Vector2::new(10.0, 20.5),
            kind,
            reason: reason.into(),
        };
        network.image_mut(id).look = Some(Arc::new(Look {
            absent: BTreeMap::from([
                (
                    PointId::Target(99),
                    absence(AbsenceKind::Weak, "too weak: 1, 2 needed"),
                ),
                (named, absence(AbsenceKind::Covered, "no longer")),
            ]),
            ..Look::default()
        }));
        let text = export_missing(&network);
        let row = text.lines().nth(1).expect("a row");
        assert!(
            row.ends_with(",M99,10.000,20.500,too weak,\"too weak: 1, 2 needed\""),
            "{row}"
        );
        assert_eq!(
            text.lines().count(),
            2,
            "a target that has a dot is not missing"
        );
        assert_eq!(
            missing_by_class(&network),
            BTreeMap::from([(AbsenceKind::Weak, 1)])
        );
    }
}
