//! What identification is given and what it gives back.

use nalgebra::{Matrix3, SMatrix, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::ellipses::EllipsePrecision;
use super::readings::Group;
use crate::camera::Camera;
use crate::geometry::Pose;

/// An unlabelled dot of one oriented image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewDot {
    /// Measured centre, px.
    pub pixel: Vector2<f64>,
    /// Standard error of the centre, rms over x and y, px.
    pub sigma_px: f64,
    /// Larger full diameter of its ellipse, px; 0 where the shape is not known.
    pub major_px: f64,
    /// Smaller full diameter of its ellipse, px.
    pub minor_px: f64,
    /// Direction of the larger diameter, radians from +x towards +y (down).
    pub angle: f64,
}

/// An oriented image with its unlabelled dots.
#[derive(Clone, Debug)]
pub struct View {
    /// Sensor and lens.
    pub camera: Camera,
    /// Exterior orientation as the preceding adjustment left it.
    pub pose: Pose,
    /// How well it is known; `None` where no adjustment told.
    pub precision: Option<OrientationPrecision>,
    /// The dots that carry no label yet.
    pub dots: Vec<ViewDot>,
}

/// Covariance of an orientation: turn in the camera frame (rad), projection centre (mm), the ten parameters of the camera.
///
/// The parts compensate each other: a place in the picture is predicted ten times as well and better as the variances alone would say.
#[derive(Clone, Debug, PartialEq)]
pub struct OrientationPrecision(pub Box<SMatrix<f64, 16, 16>>);

/// A circle of which a known point is the centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownCircle {
    /// Diameter, mm; `None` where only the plane is known.
    pub diameter_mm: Option<f64>,
    /// Unit normal that points away from the object, towards the cameras.
    pub normal: Vector3<f64>,
}

/// A point that exists already: a target of an earlier pass, a code's dot, a dot of the cross.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownPoint {
    /// Where, mm.
    pub position: Vector3<f64>,
    /// Covariance of its coordinates, mm^2.
    pub covariance: Matrix3<f64>,
    /// Views (indices) in which it is labelled already.
    pub seen_in: Vec<usize>,
    /// Its circle; decides from where it can be seen.
    pub circle: Option<KnownCircle>,
}

/// The part of space in which targets may lie: an upright box, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectSpace {
    /// Least coordinates.
    pub min: Vector3<f64>,
    /// Greatest coordinates.
    pub max: Vector3<f64>,
}

impl ObjectSpace {
    /// The box round `points`, widened on all sides by `margin` times its diagonal; `None` without points.
    #[must_use]
    pub fn around<'a>(
        points: impl IntoIterator<Item = &'a Vector3<f64>>,
        margin: f64,
    ) -> Option<Self> {
        let mut points = points.into_iter();
        let first = *points.next()?;
        let (min, max) = points.fold((first, first), |(min, max), p| (min.inf(p), max.sup(p)));
        let widening = Vector3::repeat(margin * (max - min).norm());
        Some(Self {
            min: min - widening,
            max: max + widening,
        })
    }

    /// What both boxes hold; the other one where they have nothing in common.
    #[must_use]
    pub fn common(&self, other: &Self) -> Self {
        let common = Self {
            min: self.min.sup(&other.min),
            max: self.max.inf(&other.max),
        };
        if common.min < common.max {
            common
        } else {
            *other
        }
    }

    /// The middle of the box.
    #[must_use]
    pub fn centre(&self) -> Vector3<f64> {
        (self.min + self.max) / 2.0
    }

    /// Whether a point lies in the box, or a millimetre beside it.
    #[must_use]
    pub fn holds(&self, point: &Vector3<f64>) -> bool {
        (0..3).all(|i| point[i] >= self.min[i] - 1.0 && point[i] <= self.max[i] + 1.0)
    }

    /// The stretch `[near, far]` (multiples of `direction`, never negative) of a ray inside the box.
    #[must_use]
    pub fn stretch(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<[f64; 2]> {
        let mut stretch = [0.0, f64::INFINITY];
        for axis in 0..3 {
            let (o, d) = (origin[axis], direction[axis]);
            if d.abs() < 1e-12 {
                if o < self.min[axis] || o > self.max[axis] {
                    return None;
                }
                continue;
            }
            let (a, b) = ((self.min[axis] - o) / d, (self.max[axis] - o) / d);
            stretch[0] = f64::max(stretch[0], a.min(b));
            stretch[1] = f64::min(stretch[1], a.max(b));
        }
        (stretch[0] < stretch[1]).then_some(stretch)
    }
}

/// Everything one pass of identification is given.
#[derive(Clone, Copy, Debug)]
pub struct IdentificationInput<'a> {
    /// The oriented images.
    pub views: &'a [View],
    /// For each view the views that show, or ought to show, some of the same points.
    pub neighbours: &'a [Vec<usize>],
    /// Points that exist already.
    pub known: &'a [KnownPoint],
    /// Where targets may lie.
    pub space: ObjectSpace,
    /// sigma_S: rms standard error of the station coordinates in the preceding adjustment, mm. Counts for views whose precision
    /// nobody told.
    pub station_sigma_mm: f64,
    /// How far dots lie from the places that *good* orientations predict, px, one sigma of a coordinate, in views whose precision
    /// nobody told.
    pub image_tolerance_px: f64,
    /// How exact the dots' ellipses are; `None` where no named targets tell it yet.
    pub ellipses: Option<EllipsePrecision>,
}

/// Thresholds of identification.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IdentificationSettings {
    /// Least number of rays of a target; below 3 nothing checks a target.
    pub min_rays: usize,
    /// Critical value of a ray's squared standardised misfit (chi-square, 2 degrees of freedom; 16 rejects 3 in 10,000).
    pub critical_ray: f64,
    /// Level of the chi-square test of a whole intersection: the share of true targets that it rejects.
    pub level_whole: f64,
    /// By how much the squared misfit of the second best must exceed the best's where two dots claim one place, or two
    /// targets one dot (9: three sigma).
    pub critical_margin: f64,
    /// Largest number of accidental intersections as good as it that the whole measurement must be expected to hold where a target is
    /// accepted, as log10.
    pub log10_accidents: f64,
    /// Least angle between the two rays that propose a target, radians (flatter pairs tell no depth).
    pub min_angle: f64,
    /// Largest incidence (angle between the target's normal and the ray) at which a target can be seen, radians.
    pub max_incidence: f64,
    /// Standard deviation of a dot's diameters, px, that adds to [`Self::axis_share`]: the least that is asked of them. How large it
    /// really is is measured.
    pub axis_sigma_px: f64,
    /// Standard deviation of a dot's diameters as a share of them.
    pub axis_share: f64,
    /// Critical value of an ellipse's squared standardised misfit (chi-square, 3 degrees of freedom; 25 rejects 2 in 100,000).
    pub critical_shape: f64,
    /// Most rounds of proposing, accepting and taking away.
    pub max_rounds: usize,
}

impl Default for IdentificationSettings {
    fn default() -> Self {
        Self {
            min_rays: 3,
            critical_ray: 16.0,
            level_whole: 1e-4,
            critical_margin: 9.0,
            log10_accidents: -2.5,
            min_angle: 0.05,
            max_incidence: 1.45,
            axis_sigma_px: 0.1,
            axis_share: 0.02,
            critical_shape: 25.0,
            max_rounds: 8,
        }
    }
}

/// A dot by its view and its place among the view's dots.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Member {
    /// Index of the view.
    pub view: usize,
    /// Index of the dot in [`View::dots`].
    pub dot: usize,
}

/// A newly identified target.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Intersection of its rays, mm.
    pub position: Vector3<f64>,
    /// Covariance of the intersection from the rays, mm^2.
    pub covariance: Matrix3<f64>,
    /// Its dots, by view; at most one a view.
    pub members: Vec<Member>,
    /// Root mean square residual per coordinate, px.
    pub rms_px: f64,
    /// Weighted square sum of the residuals.
    pub chi_square: f64,
    /// Its degrees of freedom: 2 rays - 3.
    pub redundancy: usize,
    /// Expected number of accidental intersections as good as this one when it was accepted, log10; `None` by a rule that counts
    /// none.
    pub log10_accidents: Option<f64>,
    /// Most rays that any other intersection through one of its dots gathers.
    pub rival_rays: usize,
    /// Normal towards the cameras and diameter, where the ellipses tell them.
    pub circle: Option<KnownCircle>,
}

/// Two dots that meet on the surface of the accepted targets: a target perhaps, which a third image must confirm.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// The dots.
    pub members: [Member; 2],
    /// Where their rays meet, mm.
    pub position: Vector3<f64>,
    /// Covariance of the place, mm^2.
    pub covariance: Matrix3<f64>,
}

/// A dot of a point that exists already.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Claim {
    /// Index among the known points.
    pub known: usize,
    /// The dot.
    pub member: Member,
    /// Distance from the predicted place, px.
    pub distance_px: f64,
}

/// Why a dot stays without label in this pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LeftoverReason {
    /// No dot of a neighbouring view lies near its epipolar line.
    NoPartner,
    /// Its best intersection gathers fewer rays than asked for.
    TooFewRays {
        /// Rays found.
        found: usize,
        /// Rays asked for.
        needed: usize,
    },
    /// Enough rays, but as many accidental ones must be expected.
    Accidental {
        /// Rays found.
        rays: usize,
        /// Expected number of accidental intersections as good, log10.
        log10_accidents: f64,
    },
    /// Few rays, and a size that other targets do not have: two targets whose images run together look so.
    OddSize {
        /// Rays found.
        rays: usize,
        /// Its diameter, in the unit of the network.
        diameter_mm: f64,
    },
    /// Another intersection through it, or through one of the partners, competes.
    Ambiguous {
        /// Rays of the best intersection.
        rays: usize,
        /// Rays of the rival.
        rival_rays: usize,
    },
    /// It lies near the predicted place of a target, yet a rival dot or target is as near, or shape or place disagree.
    Contested {
        /// Distance from the predicted place, px.
        distance_px: f64,
    },
}

/// A dot without label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leftover {
    /// The dot.
    pub member: Member,
    /// Why.
    pub reason: LeftoverReason,
}

/// The result of one pass.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Identification {
    /// New targets, by their first member.
    pub tracks: Vec<Track>,
    /// Dots of known points, by dot.
    pub claims: Vec<Claim>,
    /// All other dots, by dot.
    pub leftover: Vec<Leftover>,
    /// Pairs of these dots that may be targets, each once.
    pub pairs: Vec<Pair>,
    /// Those of these dots whose readings exclude each other, the question first that settles most dots.
    pub groups: Vec<Group>,
    /// Standard error of a ray's coordinate in each view, px, that neither its dot nor the precision of the orientation explains: from
    /// the residuals.
    pub unexplained_px: Vec<f64>,
}
