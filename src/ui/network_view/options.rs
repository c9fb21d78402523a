//! What the operator wants to see.

/// What the colour of a point means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colouring {
    /// Code, plain target, reference cross.
    Kind,
    /// Mean standard error of the three coordinates, mm.
    Precision,
    /// Rays used.
    Rays,
}

impl Colouring {
    /// All of them, in the order of the menu.
    pub const ALL: [Self; 3] = [Self::Kind, Self::Precision, Self::Rays];

    /// Text in the menu.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Kind => "by kind",
            Self::Precision => "by precision",
            Self::Rays => "by rays",
        }
    }
}

/// How much larger than one sigma the ellipsoids are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exaggeration {
    /// A round number that makes the middle one just large enough to be judged; chosen again when the points change.
    Automatic,
    /// The operator's.
    Fixed(f64),
}

/// Whether something is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Show {
    /// Drawn.
    Shown,
    /// Not drawn.
    Hidden,
}

impl Show {
    /// Whether it is drawn.
    #[must_use]
    pub fn is_shown(self) -> bool {
        self == Self::Shown
    }
}

/// What is drawn, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplayOptions {
    /// What the colour of points means.
    pub colouring: Colouring,
    /// Error ellipsoids of the points.
    pub ellipsoids: Show,
    /// How much they are enlarged.
    pub exaggeration: Exaggeration,
    /// Image stations.
    pub stations: Show,
    /// Length of a station's frustum relative to the automatic one, without unit.
    pub station_size: f64,
    /// Names of stations.
    pub station_names: Show,
    /// Names of points.
    pub point_names: Show,
    /// Rays of the selected point.
    pub rays: Show,
    /// Scale bars.
    pub scale_bars: Show,
    /// The line through the stations in the order in which they were connected.
    pub connection_order: Show,
}

impl Default for DisplayOptions {
    fn default() -> Self {
        Self {
            colouring: Colouring::Kind,
            ellipsoids: Show::Shown,
            exaggeration: Exaggeration::Automatic,
            stations: Show::Shown,
            station_size: 1.0,
            station_names: Show::Shown,
            point_names: Show::Hidden,
            rays: Show::Shown,
            scale_bars: Show::Shown,
            connection_order: Show::Hidden,
        }
    }
}
