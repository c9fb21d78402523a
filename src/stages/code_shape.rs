//! Whether the coordinates of a code's dots have the shape of the code.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use crate::geometry::{Scale, fit_similarity};
use crate::network::{CodeDot, Network, PointId};
use crate::targets::{DOT420_AXES, Family, dot420_table};

/// Largest rms misfit of a code's dots, in pitches; targets that only look like a code from one side miss by more.
const SHAPE_TOLERANCE_PITCHES: f64 = 0.06;

/// Largest difference of a code's size from that of the others, as a share.
const SIZE_TOLERANCE: f64 = 0.06;

/// Where the coordinates are less sure than that, the misfit may be so many of their standard deviations.
const SIGMAS: f64 = 4.0;

/// Fewest dots that tell a shape: three more than any three points fit.
const DOTS_TO_TELL: usize = 5;

/// The size that codes have in a network.
pub(super) struct CodeShapes {
    /// Length of a pitch in the network's unit; `None` where no code tells it.
    pitch: Option<f64>,
}

/// The shape of one code as its coordinates show it.
struct Shape {
    pitch: f64,
    misfit_pitches: f64,
}

impl CodeShapes {
    /// The median size of all `dot420` codes.
    pub(super) fn of(network: &Network) -> Self {
        let mut pitches: Vec<f64> = codes_with_places(network)
            .iter()
            .filter_map(|(&code, places)| shape(code, places))
            .filter(|shape| shape.misfit_pitches < SHAPE_TOLERANCE_PITCHES)
            .map(|shape| shape.pitch)
            .collect();
        pitches.sort_by(f64::total_cmp);
        Self {
            pitch: pitches.get(pitches.len() / 2).copied(),
        }
    }

    /// Whether these places can be the code's dots; with too few of them nothing speaks for it. A ring code has one dot
    /// and so no shape: it fits.
    pub(super) fn fits(
        &self,
        family: Family,
        code: u32,
        places: &BTreeMap<PointId, Vector3<f64>>,
    ) -> bool {
        match family {
            Family::Ring(_) => true,
            Family::Dot420 => shape(code, places).is_some_and(|shape| self.accepts(&shape)),
        }
    }

    /// The codes of a network whose adjusted coordinates contradict their shape by more than their standard deviations explain;
    /// none where most do, for then it is not the codes that are wrong but the network, as with a lens far from its nominal one.
    pub(super) fn contradicted(&self, network: &Network) -> Vec<u32> {
        let shapes: Vec<(u32, bool)> = codes_with_places(network)
            .iter()
            .filter_map(|(&code, places)| {
                let shape = shape(code, places)?;
                let sigma = mean_sigma(network, places) / shape.pitch;
                Some((code, self.accepts_within(&shape, SIGMAS * sigma)))
            })
            .collect();
        let contradicted = shapes.iter().filter(|(_, fits)| !fits);
        let contradicted: Vec<u32> = contradicted.map(|(code, _)| *code).collect();
        if 2 * contradicted.len() > shapes.len() {
            return Vec::new();
        }
        contradicted
    }

    /// Whether the places of a code have its shape, as well as the coordinates of the others are known.
    pub(super) fn fits_as_well(&self, network: &Network, code: u32) -> bool {
        let mut places = BTreeMap::new();
        let mut variances = Vec::new();
        for (&id, point) in network.points.iter() {
            if id.code() == Some((Family::Dot420, code)) {
                places.insert(id, point.position);
            } else if let (Some(_), Some(covariance)) = (id.code(), &point.covariance) {
                variances.push(covariance.trace() / 3.0);
            }
        }
        variances.sort_by(f64::total_cmp);
        let sigma = variances.get(variances.len() / 2).map_or(0.0, |v| v.sqrt());
        shape(code, &places)
            .is_some_and(|shape| self.accepts_within(&shape, SIGMAS * sigma / shape.pitch))
    }

    fn accepts(&self, shape: &Shape) -> bool {
        self.accepts_within(shape, 0.0)
    }

    /// Whether a shape is a code's where its places may be off by as many pitches as are given.
    fn accepts_within(&self, shape: &Shape, off_pitches: f64) -> bool {
        let size = self
            .pitch
            .map_or(0.0, |pitch| (shape.pitch / pitch - 1.0).abs());
        // The size is told over the code's six pitches.
        shape.misfit_pitches < SHAPE_TOLERANCE_PITCHES.max(off_pitches)
            && size < SIZE_TOLERANCE.max(off_pitches / 6.0)
    }
}

/// How far the `dot420` codes among these places are from their shape, in pitches each.
pub(super) fn misfits(places: &BTreeMap<PointId, Vector3<f64>>) -> impl Iterator<Item = f64> {
    let codes = by_code(places.iter().map(|(id, place)| (*id, *place))).into_iter();
    codes.filter_map(|(code, places)| Some(shape(code, &places)?.misfit_pitches))
}

/// The outward normal of a `dot420` code: from the front, the turn from OA to OB is counter-clockwise.
pub(super) fn normal_of_code(network: &Network, code: u32) -> Option<Vector3<f64>> {
    let place = |dot| {
        let id = PointId::Code {
            family: Family::Dot420,
            code,
            dot,
        };
        network.points.get(&id).map(|point| point.position)
    };
    let origin = place(CodeDot::O)?;
    (place(CodeDot::A)? - origin)
        .cross(&(place(CodeDot::B)? - origin))
        .try_normalize(1e-12)
}

/// Root mean square standard deviation of adjusted coordinates.
fn mean_sigma(network: &Network, places: &BTreeMap<PointId, Vector3<f64>>) -> f64 {
    let variances: Vec<f64> = places
        .keys()
        .filter_map(|id| Some(network.points.get(id)?.covariance?.trace() / 3.0))
        .collect();
    (variances.iter().sum::<f64>() / variances.len().max(1) as f64).sqrt()
}

/// The adjusted places of codes: coordinates that take no part stand where the network was before.
fn codes_with_places(network: &Network) -> BTreeMap<u32, BTreeMap<PointId, Vector3<f64>>> {
    let adjusted = network
        .points
        .iter()
        .filter(|(_, point)| point.covariance.is_some());
    by_code(adjusted.map(|(id, point)| (*id, point.position)))
}

/// The places of `dot420` codes, by code.
fn by_code(
    places: impl Iterator<Item = (PointId, Vector3<f64>)>,
) -> BTreeMap<u32, BTreeMap<PointId, Vector3<f64>>> {
    let mut codes: BTreeMap<u32, BTreeMap<PointId, Vector3<f64>>> = BTreeMap::new();
    for (id, place) in places {
        if let Some((Family::Dot420, code)) = id.code() {
            codes.entry(code).or_default().insert(id, place);
        }
    }
    codes
}

fn shape(code: u32, places: &BTreeMap<PointId, Vector3<f64>>) -> Option<Shape> {
    let pattern = dot420_table().get(code.checked_sub(1)? as usize)?;
    let in_code = DOT420_AXES
        .iter()
        .chain(pattern)
        .map(|&[x, y]| Vector3::new(f64::from(x), f64::from(y), 0.0));
    let pairs: Vec<(Vector3<f64>, Vector3<f64>)> = PointId::of_code(Family::Dot420, code)
        .iter()
        .zip(in_code)
        .filter_map(|(id, place)| Some((place, *places.get(id)?)))
        .collect();
    if pairs.len() < DOTS_TO_TELL {
        return None;
    }
    let fit = fit_similarity(&pairs, Scale::Free).ok()?;
    let squares: f64 = pairs
        .iter()
        .map(|(place, found)| (fit.apply(place) - found).norm_squared())
        .sum();
    Some(Shape {
        pitch: fit.scale,
        misfit_pitches: (squares / pairs.len() as f64).sqrt() / fit.scale,
    })
}
