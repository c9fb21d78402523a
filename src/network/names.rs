//! What points are called: labels by kind and number, and the names that plain targets have in their place.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::{Network, PointId, UnknownLabel};

/// Why a target cannot have a name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NameProblem {
    /// There is nothing to read.
    #[error("found no name, expected one")]
    Empty,
    /// The name would mean another point.
    #[error("found the name '{name}', expected one that is no label such as C17, R14-57 or M5")]
    IsLabel {
        /// The name.
        name: String,
    },
    /// Another point is called so.
    #[error("found the name '{name}' twice, expected every name once")]
    Twice {
        /// The name.
        name: String,
    },
}

impl Network {
    /// The label of a point as the operator reads it: `C17.O`, `R14-57`, `X1`, `M5`, or the name of a target.
    #[must_use]
    pub fn label(&self, id: PointId) -> String {
        let own = match id {
            PointId::Device(index) => self.device.get(usize::from(index)).map(|dot| &dot.label),
            PointId::Target(number) => self.names.get(&number),
            PointId::Code { .. } => None,
        };
        own.map_or_else(|| id.to_string(), Clone::clone)
    }

    /// The point of a label; `C17` means `C17.O`.
    ///
    /// Cost: names of all targets.
    ///
    /// # Errors
    /// [`UnknownLabel`] where the text is the label of no point of this project's kinds.
    pub fn point_of_label(&self, label: &str) -> Result<PointId, UnknownLabel> {
        let label = label.trim();
        if let Some(index) = self.device.iter().position(|point| point.label == label) {
            return Ok(PointId::Device(index as u16));
        }
        if let Some((number, _)) = self.names.iter().find(|(_, name)| *name == label) {
            return Ok(PointId::Target(*number));
        }
        label.parse()
    }

    /// The numbers of the plain targets that there are: they have coordinates, or an image shows them.
    #[must_use]
    pub fn targets(&self) -> BTreeSet<u32> {
        let shown = self.images.values().flat_map(|image| image.labels.values());
        let points = shown
            .map(|label| label.point)
            .chain(self.points.keys().copied());
        points
            .filter_map(|point| match point {
                PointId::Target(number) => Some(number),
                PointId::Code { .. } | PointId::Device(_) => None,
            })
            .collect()
    }

    /// A plain target of a number that none ever had: numbers are given once.
    #[must_use]
    pub fn new_target(&self) -> PointId {
        let highest = self.targets().last().copied().unwrap_or_default();
        PointId::Target(self.next_target.max(highest) + 1)
    }

    /// Gives the plain targets of these numbers names, and takes away those that they had. A number stays with its name
    /// where nothing shows the target any more: numbers are given once, so that no other target can inherit it.
    ///
    /// # Errors
    /// [`NameProblem`]: the name says nothing, or means another point; the network is unchanged then.
    pub fn name_targets(&mut self, names: BTreeMap<u32, String>) -> Result<(), NameProblem> {
        let mut seen: BTreeSet<&str> = self.device.iter().map(|dot| dot.label.as_str()).collect();
        for name in names.values() {
            if name.trim().is_empty() {
                return Err(NameProblem::Empty);
            }
            let label = name.parse::<PointId>();
            if label.is_ok_and(|id| !matches!(id, PointId::Device(_))) {
                return Err(NameProblem::IsLabel { name: name.clone() });
            }
            if !seen.insert(name) {
                return Err(NameProblem::Twice { name: name.clone() });
            }
        }
        self.names = Arc::new(names);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::DevicePoint;

    fn named(names: &[(u32, &str)]) -> Result<Network, NameProblem> {
        let mut network = Network {
            device: Arc::new(vec![DevicePoint {
                label: "X1".into(),
                position_mm: [0.0; 3],
            }]),
            ..Network::default()
        };
        let names = names.iter().map(|(number, name)| (*number, (*name).into()));
        network.name_targets(names.collect())?;
        Ok(network)
    }

    #[test]
    fn a_name_stands_for_its_target_and_for_no_other() {
        let network = named(&[(7, "1001"), (8, "edge, left")]).unwrap();
        for (number, label) in [(7, "1001"), (8, "edge, left"), (9, "M9")] {
            let id = PointId::Target(number);
            assert_eq!(network.label(id), label);
            assert_eq!(network.point_of_label(label), Ok(id));
        }
        assert_eq!(network.point_of_label(" X1 "), Ok(PointId::Device(0)));
        assert!(network.point_of_label("1002").is_err());
    }

    #[test]
    fn names_that_mean_another_point_are_refused() {
        for (names, line) in [
            (
                &[(1, "A"), (2, "A")][..],
                "found the name 'A' twice, expected every name once",
            ),
            (
                &[(1, "X1")],
                "found the name 'X1' twice, expected every name once",
            ),
            (
                &[(1, "R14-57")],
                "found the name 'R14-57', expected one that is no label such as C17, R14-57 or M5",
            ),
            (&[(1, " ")], "found no name, expected one"),
        ] {
            assert_eq!(named(names).unwrap_err().to_string(), line);
        }
    }
}
