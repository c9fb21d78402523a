//! Names of plain targets by hand or by a list.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::EditError;
use crate::network::{Network, PointId};

pub(super) fn rename_title(network: &Network, target: u32, name: &Option<String>) -> String {
    let label = network.label(PointId::Target(target));
    match name {
        Some(name) => format!("call {label} '{}'", name.trim()),
        None => format!("take the name of '{label}' away"),
    }
}

/// Gives targets names; others that had one of them lose it.
pub(super) fn name_targets(
    network: &mut Network,
    names: &BTreeMap<u32, String>,
) -> Result<(), EditError> {
    let there = network.targets();
    if let Some(gone) = names.keys().find(|number| !there.contains(number)) {
        return Err(unknown(network, *gone));
    }
    let mut all = network.names.as_ref().clone();
    all.retain(|_, had| names.values().all(|name| name.trim() != had));
    all.extend(
        names
            .iter()
            .map(|(number, name)| (*number, name.trim().to_owned())),
    );
    adopt(network, all)
}

/// Gives a target another name, or takes it away. A name that a target still has is refused, one of a target that
/// nothing shows any more is free.
pub(super) fn rename_target(
    network: &mut Network,
    target: u32,
    name: Option<&str>,
) -> Result<(), EditError> {
    let there = network.targets();
    if !there.contains(&target) {
        return Err(unknown(network, target));
    }
    let mut all = network.names.as_ref().clone();
    all.remove(&target);
    if let Some(name) = name.map(str::trim) {
        all.retain(|number, had| there.contains(number) || had != name);
        all.insert(target, name.to_owned());
    }
    adopt(network, all)
}

fn unknown(network: &Network, target: u32) -> EditError {
    EditError::UnknownPoint(network.label(PointId::Target(target)))
}

/// Sets the names, with the labels of bars and control points that mean these targets. Only where one of them did not
/// mean a point before and now does are the inputs others.
fn adopt(network: &mut Network, names: BTreeMap<u32, String>) -> Result<(), EditError> {
    let before = meanings(network);
    let last = names.keys().next_back().copied().unwrap_or_default();
    network.name_targets(names)?;
    network.next_target = network.next_target.max(last);
    relabel(network, &before);
    if meanings(network) != before {
        network.inputs += 1;
    }
    Ok(())
}

/// The points that the ends of bars, then control points mean.
fn meanings(network: &Network) -> Vec<Option<PointId>> {
    let ends = network
        .scale_bars
        .iter()
        .flat_map(|bar| [&bar.from, &bar.to]);
    let labels = ends.chain(network.control.iter().map(|control| &control.label));
    labels
        .map(|label| network.point_of_label(label).ok())
        .collect()
}

/// Writes the labels of these points where others stood, in the order of [`meanings`].
fn relabel(network: &mut Network, meanings: &[Option<PointId>]) {
    let is_target = |id: &PointId| matches!(id, PointId::Target(_));
    let labels: Vec<Option<String>> = meanings
        .iter()
        .map(|id| id.filter(is_target).map(|id| network.label(id)))
        .collect();
    if labels.iter().all(Option::is_none) {
        return;
    }
    let ends = Arc::make_mut(&mut network.scale_bars)
        .iter_mut()
        .flat_map(|bar| [&mut bar.from, &mut bar.to]);
    let control = Arc::make_mut(&mut network.control);
    let places = ends.chain(control.iter_mut().map(|control| &mut control.label));
    for (place, label) in places.zip(labels) {
        if let Some(label) = label {
            *place = label;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{BarRole, ControlRole, NameProblem, Point, ScaleBar};
    use crate::project::edit::Edit;
    use crate::report::export_points;
    use crate::report::fixture;
    use crate::targets::Family;

    /// The small network of the reports with targets M1 to M4, a bar from M2 to M3 and control on M4.
    fn network() -> Network {
        let mut network = fixture::network();
        let point: Point = network.points[&PointId::Target(1)].as_ref().clone();
        let points = Arc::make_mut(&mut network.points);
        points.extend((2..=4).map(|n| (PointId::Target(n), Arc::new(point.clone()))));
        network.next_target = 4;
        let bar = Edit::AddBar {
            name: "steel".into(),
            from: "M2".into(),
            to: "M3".into(),
            length_mm: 500.0,
            sigma_mm: 0.01,
            role: BarRole::Control,
        };
        bar.apply(&mut network).unwrap();
        let control = Edit::SetControl {
            label: "M4".into(),
            coordinates_mm: [Some(1.0), None, None],
            sigmas_mm: [None; 3],
            role: ControlRole::Align,
        };
        control.apply(&mut network).unwrap();
        network
    }

    fn names(names: &[(u32, &str)]) -> Edit {
        let names = names.iter().map(|(number, name)| (*number, (*name).into()));
        Edit::NameTargets {
            names: names.collect(),
        }
    }

    fn rename(target: u32, name: Option<&str>) -> Edit {
        Edit::RenameTarget {
            target,
            name: name.map(str::to_owned),
        }
    }

    fn after(edits: &[Edit]) -> Network {
        let mut network = network();
        for edit in edits {
            edit.apply(&mut network).unwrap();
        }
        network
    }

    fn bar(network: &Network) -> &ScaleBar {
        network.scale_bars.last().unwrap()
    }

    #[test]
    fn bars_and_control_go_along_and_nothing_is_computed_again() {
        let named = after(&[names(&[(2, "1001"), (3, " edge "), (4, "top")])]);
        assert_eq!(named.inputs, network().inputs);
        assert_eq!(
            (bar(&named).from.as_str(), bar(&named).to.as_str()),
            ("1001", "edge")
        );
        assert_eq!(named.control.last().unwrap().label, "top");
        assert_eq!(named.control[0].label, "C1", "no name of a target");
        assert_eq!(named.point_of_label("edge"), Ok(PointId::Target(3)));
        // Other names, one of them gone: the bar still means its two targets.
        let changed = after(&[
            names(&[(2, "1001"), (3, "edge")]),
            rename(2, Some("1002")),
            rename(3, None),
        ]);
        assert_eq!(
            (bar(&changed).from.as_str(), bar(&changed).to.as_str()),
            ("1002", "M3")
        );
        assert_eq!(changed.inputs, network().inputs);
    }

    #[test]
    fn tables_and_bars_by_hand_know_a_target_by_its_name() {
        let mut network = fixture::network();
        names(&[(1, "edge")]).apply(&mut network).unwrap();
        assert!(export_points(&network).unwrap().contains("\nedge,target,"));
        let bar = Edit::AddBar {
            name: "steel".into(),
            from: "edge".into(),
            to: "C1".into(),
            length_mm: 500.0,
            sigma_mm: 0.01,
            role: BarRole::Check,
        };
        bar.apply(&mut network).unwrap();
        assert_eq!(network.scale_bars[0].from, "edge");
    }

    #[test]
    fn a_name_that_moves_leaves_its_target() {
        let moved = after(&[names(&[(1, "A"), (2, "B")]), names(&[(2, "A"), (3, "B")])]);
        let names = [(2, "A".to_owned()), (3, "B".to_owned())];
        assert_eq!(*moved.names, names.into());
    }

    #[test]
    fn a_label_that_comes_to_mean_a_point_is_another_input() {
        let mut network = network();
        let mut stray = bar(&network).clone();
        stray.from = "1001".into();
        Arc::make_mut(&mut network.scale_bars).push(stray);
        let inputs = network.inputs;
        names(&[(1, "1001")]).apply(&mut network).unwrap();
        assert_eq!(network.inputs, inputs + 1);
    }

    #[test]
    fn names_that_cannot_be_are_refused_and_nothing_changes() {
        for (edit, line) in [
            (
                rename(9, Some("A")),
                "found no point 'M9' in any image, expected the label of a target",
            ),
            (
                names(&[(9, "A")]),
                "found no point 'M9' in any image, expected the label of a target",
            ),
            (
                rename(1, Some("edge")),
                "found the name 'edge' twice, expected every name once",
            ),
            (rename(1, Some(" ")), "found no name, expected one"),
            (
                names(&[(1, "M3")]),
                "found the name 'M3', expected one that is no label such as C17, R14-57 or M5",
            ),
        ] {
            let mut changed = after(&[rename(3, Some("edge"))]);
            let before = changed.clone();
            assert_eq!(edit.apply(&mut changed).unwrap_err().to_string(), line);
            assert_eq!(changed, before);
        }
        let twice = names(&[(1, "A"), (2, "A ")]).apply(&mut network());
        let problem = NameProblem::Twice { name: "A".into() };
        assert_eq!(twice, Err(EditError::Name(problem)));
    }

    #[test]
    fn titles_say_what_is_called_how() {
        let named = after(&[rename(3, Some("edge"))]);
        for (edit, title) in [
            (names(&[(1, "A"), (2, "B")]), "name 2 targets"),
            (rename(1, Some("A")), "call M1 'A'"),
            (rename(3, Some("A")), "call edge 'A'"),
            (rename(3, None), "take the name of 'edge' away"),
        ] {
            assert_eq!(edit.title(&named), title);
        }
    }

    #[test]
    fn a_name_stays_with_its_number_and_no_new_target_inherits_it() {
        let mut network = after(&[names(&[(4, "edge")])]);
        let mut settings = network.settings.as_ref().clone();
        settings.families = vec![Family::Ring(14)];
        Edit::Settings(Box::new(settings))
            .apply(&mut network)
            .unwrap();
        assert!(network.targets().is_empty(), "all is detected again");
        assert_eq!(network.names[&4], "edge");
        // A stage gives the number behind the last one.
        network.next_target += 1;
        let new = PointId::Target(network.next_target);
        let point = Point {
            position: Default::default(),
            covariance: None,
            rays: 2,
            circle: None,
        };
        Arc::make_mut(&mut network.points).insert(new, Arc::new(point));
        assert_eq!(network.label(new), "M5");
        // The name of a target that is gone is free.
        rename(5, Some("edge")).apply(&mut network).unwrap();
        assert_eq!(network.point_of_label("edge"), Ok(new));
        assert_eq!(network.names.len(), 1);
    }
}
