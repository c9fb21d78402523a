//! Known lengths and coordinates: scale bars and control points by hand.

use std::sync::Arc;

use super::EditError;
use crate::network::{ControlPoint, ControlRole, Network, PointId, ScaleBar};

/// The point of a label that the operator can mean: it has coordinates, or an image shows it.
fn point_of(network: &Network, label: &str) -> Result<PointId, EditError> {
    let unknown = || EditError::UnknownPoint(label.trim().to_owned());
    let point = network.point_of_label(label).map_err(|_| unknown())?;
    let shown = |point| {
        let mut labels = network
            .images
            .values()
            .flat_map(|image| image.labels.values());
        labels.any(|label| label.point == point)
    };
    let known = network.points.contains_key(&point) || shown(point);
    known.then_some(point).ok_or_else(unknown)
}

fn positive(what: &'static str, found: f64) -> Result<(), EditError> {
    let is_positive = found.is_finite() && found > 0.0;
    is_positive
        .then_some(())
        .ok_or(EditError::NotPositive { what, found })
}

pub(super) fn add_bar(network: &mut Network, bar: ScaleBar) -> Result<(), EditError> {
    if bar.name.is_empty() {
        return Err(EditError::NoBarName);
    }
    if network
        .scale_bars
        .iter()
        .any(|other| other.name == bar.name)
    {
        return Err(EditError::BarExists(bar.name));
    }
    let ends = [point_of(network, &bar.from)?, point_of(network, &bar.to)?];
    let [from, to] = ends.map(|end| network.label(end));
    if ends[0] == ends[1] {
        return Err(EditError::SameEnds {
            name: bar.name,
            label: from,
        });
    }
    positive("a length", bar.length_mm)?;
    positive("a standard deviation", bar.sigma_mm)?;
    Arc::make_mut(&mut network.scale_bars).push(ScaleBar { from, to, ..bar });
    Ok(())
}

pub(super) fn remove_bar(network: &mut Network, name: &str) -> Result<(), EditError> {
    let place = network.scale_bars.iter().position(|bar| bar.name == name);
    let place = place.ok_or_else(|| EditError::NoBar(name.to_owned()))?;
    Arc::make_mut(&mut network.scale_bars).remove(place);
    Ok(())
}

pub(super) fn set_control(
    network: &mut Network,
    label: &str,
    coordinates_mm: [Option<f64>; 3],
    sigmas_mm: [Option<f64>; 3],
    role: ControlRole,
) -> Result<(), EditError> {
    let point = point_of(network, label)?;
    let label = network.label(point);
    let usable = |value: &Option<f64>| value.is_none_or(f64::is_finite);
    let given = coordinates_mm.iter().flatten().count();
    if given == 0 || !coordinates_mm.iter().all(usable) {
        return Err(EditError::NoCoordinate(label));
    }
    for sigma in sigmas_mm.into_iter().flatten() {
        positive("a standard deviation", sigma)?;
    }
    let control = ControlPoint {
        label,
        coordinates_mm,
        sigmas_mm,
        role,
    };
    match place_of_control(network, point) {
        Some(place) => Arc::make_mut(&mut network.control)[place] = control,
        None => Arc::make_mut(&mut network.control).push(control),
    }
    Ok(())
}

pub(super) fn remove_control(network: &mut Network, label: &str) -> Result<(), EditError> {
    let gone = || EditError::NoControl(label.trim().to_owned());
    let point = network.point_of_label(label).map_err(|_| gone())?;
    let place = place_of_control(network, point).ok_or_else(gone)?;
    Arc::make_mut(&mut network.control).remove(place);
    Ok(())
}

fn place_of_control(network: &Network, point: PointId) -> Option<usize> {
    let is_of = |label: &str| {
        network
            .point_of_label(label)
            .is_ok_and(|other| other == point)
    };
    network
        .control
        .iter()
        .position(|control| is_of(&control.label))
}
