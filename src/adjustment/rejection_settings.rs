//! What counts as a gross error, and how long they are searched.

use super::RobustStart;

/// What a normalised residual is compared with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OutlierTest {
    /// The critical value times 1.4826 times the median `|w|`: sigma0 as gross errors cannot spoil it.
    #[default]
    RobustScale,
    /// The critical value itself: the a-priori sigmas are believed (Baarda, 1968).
    APriori,
    /// Pope's tau (1976) times sigma0, at the level of the critical value: the sigmas are believed as to their ratios only.
    APosteriori,
}

/// What counts as a gross error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RejectionSettings {
    /// What residuals are compared with; default the robust scale.
    pub test: OutlierTest,
    /// Critical value of `|w|` over its scale; default 4.0 (6e-5 two-sided: less than one false alarm in
    /// some 10,000 numbers; 3.29 would be the level 0.001).
    pub critical: f64,
    /// A rejected observation is restored when its predicted `|w|`, compared in the same way, is below this; default 3.3.
    pub restore: f64,
    /// At most so many adjustments; default 40.
    pub passes: usize,
    /// The last adjustment follows where one changed the standing of no more than this share of the observations; default 0: where it
    /// changed none. What comes of more than 0 is good for going on, not as a result.
    pub enough: f64,
    /// A point with fewer used rays (and unknown coordinates) is dropped; at least and by default 2.
    pub min_rays: usize,
    /// No observation is rejected by the test when its station would keep fewer; default 6.
    pub min_station_rays: usize,
    /// Weights of the first iterations; default Huber with threshold 2 and 15 iterations.
    pub robust_start: RobustStart,
}

impl Default for RejectionSettings {
    fn default() -> Self {
        Self {
            test: OutlierTest::RobustScale,
            critical: 4.0,
            restore: 3.3,
            passes: 40,
            enough: 0.0,
            min_rays: 2,
            min_station_rays: 6,
            robust_start: RobustStart::Huber {
                threshold: 2.0,
                iterations: 15,
            },
        }
    }
}
