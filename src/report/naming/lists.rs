//! The two lists, and what their labels have in common.

use nalgebra::Vector3;

use super::{ExistingNames, NamingError, NamingSettings};
use crate::network::{Network, PointId};
use crate::report::compare::{ReferencePoint, place_distance};
use crate::report::export::AdjustedPoint;

/// An adjusted point and a known place, by their places in the lists.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Pair {
    pub(super) known: usize,
    pub(super) point: usize,
}

/// What the label of a reference point means to this network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Meaning {
    /// It has none.
    Unnamed,
    /// A dot of a code or of the cross.
    Dot(PointId),
    /// The name of a target that there is.
    Target(u32),
    /// `M` and a number, which every project gives anew: no name, and no sign of the same target.
    Number(u32),
    /// A name that is free.
    Free,
}

/// A reference point with three coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    /// Its place in the reference.
    pub(super) row: usize,
    pub(super) meaning: Meaning,
}

/// The lists.
pub(super) struct Lists<'a> {
    pub(super) network: &'a Network,
    pub(super) settings: &'a NamingSettings,
    pub(super) reference: &'a [ReferencePoint],
    /// Adjusted points, by id.
    pub(super) points: Vec<AdjustedPoint<'a>>,
    /// Their places, mm.
    pub(super) places: Vec<Vector3<f64>>,
    /// Reference points with three coordinates.
    pub(super) known: Vec<Known>,
    /// Their places, mm.
    pub(super) known_places: Vec<Vector3<f64>>,
    /// Pairs of the same label, by the known place.
    pub(super) common: Vec<Pair>,
    /// Within what distance a point is at a known place, mm.
    pub(super) within: f64,
}

/// Fewest places that hold a transformation.
const LEAST_PLACES: usize = 3;

impl<'a> Lists<'a> {
    /// # Errors
    /// [`NamingError::BadDistance`], [`NamingError::TooFew`].
    pub(super) fn new(
        network: &'a Network,
        points: Vec<AdjustedPoint<'a>>,
        reference: &'a [ReferencePoint],
        settings: &'a NamingSettings,
    ) -> Result<Self, NamingError> {
        let is_distance = |found: &f64| found.is_finite() && *found > 0.0;
        if let Some(found) = settings.within_mm.filter(|found| !is_distance(found)) {
            return Err(NamingError::BadDistance { found });
        }
        let within = settings
            .within_mm
            .unwrap_or_else(|| place_distance(reference));
        let there = network.targets();
        let meaning = |point: &ReferencePoint| {
            let Some(label) = point.label.as_deref().map(str::trim) else {
                return Meaning::Unnamed;
            };
            match network.point_of_label(label) {
                Ok(PointId::Target(number))
                    if network.names.get(&number).is_none_or(|n| n != label) =>
                {
                    Meaning::Number(number)
                }
                Ok(PointId::Target(number)) if there.contains(&number) => Meaning::Target(number),
                Ok(PointId::Target(_)) | Err(_) => Meaning::Free,
                Ok(dot) => Meaning::Dot(dot),
            }
        };
        let (mut known, mut known_places) = (Vec::new(), Vec::new());
        for (row, point) in reference.iter().enumerate() {
            if let Some(place) = point.position() {
                let meaning = meaning(point);
                known.push(Known { row, meaning });
                known_places.push(place);
            }
        }
        if within <= 0.0 || points.len().min(known.len()) < LEAST_PLACES {
            return Err(NamingError::TooFew {
                points: points.len(),
                reference: known.len(),
            });
        }
        let common = common(&points, &known);
        Ok(Self {
            network,
            settings,
            reference,
            places: points.iter().map(|point| point.point.position).collect(),
            points,
            known,
            known_places,
            common,
            within,
        })
    }

    /// The pairs whose label stays: they belong together wherever they lie.
    pub(super) fn tied(&self) -> impl Iterator<Item = &Pair> {
        self.common.iter().filter(|pair| {
            let meaning = self.known[pair.known].meaning;
            matches!(meaning, Meaning::Dot(_)) || self.settings.existing == ExistingNames::Stay
        })
    }

    /// The reference point of a known place.
    pub(super) fn row(&self, known: usize) -> &'a ReferencePoint {
        &self.reference[self.known[known].row]
    }

    /// The label of a point.
    pub(super) fn label(&self, point: usize) -> String {
        self.network.label(self.points[point].id)
    }

    /// The places of pairs: of the point, of the reference, mm.
    pub(super) fn places_of(&self, pairs: &[Pair]) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        pairs
            .iter()
            .map(|pair| (self.places[pair.point], self.known_places[pair.known]))
            .collect()
    }
}

fn common(points: &[AdjustedPoint<'_>], known: &[Known]) -> Vec<Pair> {
    let same = |(index, known): (usize, &Known)| {
        let id = match known.meaning {
            Meaning::Dot(id) => id,
            Meaning::Target(number) => PointId::Target(number),
            Meaning::Unnamed | Meaning::Number(_) | Meaning::Free => return None,
        };
        // Points come by id.
        let point = points.binary_search_by_key(&id, |point| point.id).ok()?;
        Some(Pair {
            known: index,
            point,
        })
    };
    known.iter().enumerate().filter_map(same).collect()
}
