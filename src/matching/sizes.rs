//! Which sizes of targets are common: two targets whose images run together look like one larger one midway, in every image alike.

/// Diameters within this share of each other are one size.
const SAME: f64 = 0.12;
/// A size is common that this share of the targets has.
const SHARE: f64 = 0.05;
/// Fewer targets of one size make none common.
const FEWEST: usize = 5;
/// So many rays, and a target may have any size.
const RAYS_OF_ODD: usize = 8;

/// Diameters of targets and of what may be targets, ascending, mm.
pub(super) struct Sizes(Vec<f64>);

impl Sizes {
    pub(super) fn of(diameters: impl IntoIterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = diameters.into_iter().filter(|d| d.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        Self(sorted)
    }

    /// Whether a target of so many rays may have this size.
    pub(super) fn allow(&self, diameter: Option<f64>, rays: usize) -> bool {
        let Some(diameter) = diameter.filter(|_| rays < RAYS_OF_ODD) else {
            return true;
        };
        let from = self.0.partition_point(|d| *d < diameter / (1.0 + SAME));
        let to = self.0.partition_point(|d| *d <= diameter * (1.0 + SAME));
        // Where there are too few of all, nothing is common.
        self.0.len() < 2 * FEWEST || to - from >= FEWEST.max((SHARE * self.0.len() as f64) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_target_of_an_odd_size_needs_many_rays() {
        let sizes = Sizes::of(
            (0..40)
                .map(|k| if k < 30 { 5.0 } else { 8.0 })
                .chain([11.0]),
        );
        assert!(sizes.allow(Some(5.2), 3) && sizes.allow(Some(7.8), 3));
        assert!(!sizes.allow(Some(11.0), 3));
        assert!(sizes.allow(Some(11.0), 8) && sizes.allow(None, 3));
        assert!(
            Sizes::of([5.0, 5.0]).allow(Some(11.0), 3),
            "too few to tell"
        );
    }
}
