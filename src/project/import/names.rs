//! Which points the names of another program are.

use std::collections::BTreeMap;

use super::ImportingError;
use crate::network::PointId;
use crate::plain_network::PlainPoint;

/// The ids of points, and the names of those that are plain targets here.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ids {
    /// The id of every point.
    pub(super) of_points: Vec<PointId>,
    /// Names by the numbers of targets.
    pub(super) names: BTreeMap<u32, String>,
    /// The highest number of a target.
    pub(super) last: u32,
}

/// The point that a name is the label of; `None` where it is any other name.
fn labelled(name: &str) -> Option<PointId> {
    match name.parse().ok()? {
        // The cross of this program is none of another.
        PointId::Device(_) => None,
        id => Some(id),
    }
}

impl Ids {
    /// Names that are labels of codes or targets are these points; the others are targets with numbers behind them, in
    /// their order.
    ///
    /// # Errors
    /// [`ImportingError::OneLabel`] where two names are one label.
    pub(super) fn of(points: &[PlainPoint]) -> Result<Self, ImportingError> {
        let mut taken: BTreeMap<PointId, &str> = BTreeMap::new();
        let mut last = 0;
        for point in points {
            let Some(id) = labelled(&point.name) else {
                continue;
            };
            if let Some(first) = taken.insert(id, &point.name) {
                return Err(ImportingError::OneLabel {
                    first: first.to_owned(),
                    second: point.name.clone(),
                    label: id.to_string(),
                });
            }
            if let PointId::Target(number) = id {
                last = last.max(number);
            }
        }
        let mut names = BTreeMap::new();
        let mut of_points = Vec::with_capacity(points.len());
        for point in points {
            of_points.push(labelled(&point.name).unwrap_or_else(|| {
                last += 1;
                names.insert(last, point.name.clone());
                PointId::Target(last)
            }));
        }
        Ok(Self {
            of_points,
            names,
            last,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ids(names: &[&str]) -> Result<Ids, ImportingError> {
        let point = |name: &&str| PlainPoint::new(*name, None);
        Ids::of(&names.iter().map(point).collect::<Vec<_>>())
    }

    #[test]
    fn labels_stay_and_other_names_are_targets_behind_them() {
        let ids = ids(&["1001", "C17.A", "M5", "R14-57", "cross:1", "ABC"]).unwrap();
        let labels: Vec<String> = ids.of_points.iter().map(PointId::to_string).collect();
        assert_eq!(labels, ["M6", "C17.A", "M5", "R14-57", "M7", "M8"]);
        let names = [(6, "1001"), (7, "cross:1"), (8, "ABC")];
        assert_eq!(
            ids.names,
            names.map(|(n, name)| (n, name.to_owned())).into()
        );
        assert_eq!(ids.last, 8);
    }

    #[test]
    fn two_names_of_one_label_are_refused() {
        assert_eq!(
            ids(&["C17", "A", "C17.O"]).unwrap_err().to_string(),
            "points 'C17' and 'C17.O': found two names of C17.O, expected one of each point"
        );
    }
}
