//! Critical values of chi-square, looked up instead of computed for every intersection.

use super::problem::IdentificationSettings;
use crate::geometry::chi_square_critical;

/// Critical values of whole intersections by degrees of freedom.
#[derive(Clone, Debug)]
pub(super) struct Limits(Vec<f64>);

impl Limits {
    /// Those of intersections of up to `most_rays` rays.
    pub(super) fn new(settings: &IdentificationSettings, most_rays: usize) -> Self {
        let value =
            |freedom| chi_square_critical(settings.level_whole, freedom).unwrap_or(f64::INFINITY);
        Self((1..=(2 * most_rays).max(3)).map(value).collect())
    }

    /// That of an intersection with so many degrees of freedom.
    pub(super) fn whole(&self, redundancy: usize) -> f64 {
        self.0[redundancy.clamp(1, self.0.len()) - 1]
    }
}
