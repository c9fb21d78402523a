//! Whether what lies together is only the flat part of a mirrored list: a plane laid on its mirror image fits, and what
//! stands in front of it comes to lie behind it.

use nalgebra::Vector3;

use super::NamingError;
use super::assignment::Assignment;
use super::lists::Lists;
use super::places::Places;

/// Points by which the mirrored list must be better: one or two lie somewhere by chance.
const LEAST_BETTER: usize = 3;

/// # Errors
/// [`NamingError::Mirrored`] where the pairs lie in a plane and the points mirrored in it fit better.
pub(super) fn check(lists: &Lists<'_>, assignment: &Assignment) -> Result<(), NamingError> {
    let places: Vec<Vector3<f64>> = assignment
        .pairs
        .iter()
        .map(|pair| lists.known_places[pair.known])
        .collect();
    let centre = places.iter().sum::<Vector3<f64>>() / places.len() as f64;
    let square = |place: &Vector3<f64>| (place - centre) * (place - centre).transpose();
    let eigen = places
        .iter()
        .map(square)
        .sum::<nalgebra::Matrix3<f64>>()
        .symmetric_eigen();
    let normal = eigen
        .eigenvectors
        .column(eigen.eigenvalues.imin())
        .into_owned();
    let height = |place: &Vector3<f64>| normal.dot(&(place - centre));
    if places
        .iter()
        .any(|place| height(place).abs() > lists.within)
    {
        return Ok(());
    }
    let known = Places::new(&lists.known_places);
    let near = |place: &Vector3<f64>| known.nearest(place, lists.within).is_some();
    let points = assignment.moved.iter().filter(|place| near(place)).count();
    let behind = |place: &Vector3<f64>| place - 2.0 * height(place) * normal;
    let mirrored = assignment.moved.iter().map(behind).filter(near).count();
    if mirrored >= points + LEAST_BETTER {
        return Err(NamingError::Mirrored { mirrored, points });
    }
    Ok(())
}
