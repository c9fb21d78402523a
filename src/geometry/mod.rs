//! The plain mathematics of directions and places: rotation, pose, similarity, circle, plane, frame by three
//! points, homography, intersection of rays.
//!
//! Frames follow Kraus (2007): the world is right-handed; the camera frame has x right, y up, z backwards, so that the
//! camera looks along -z. A rotation matrix `M` takes world directions to the camera frame, `X0` is the projection
//! centre, and `[x', y', -c] ~ M (X - X0)`.

#![allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "`!(x > limit)` also refuses what is not a number, which `x <= limit` would let pass"
)]

mod chi_square;
mod circle;
mod homography;
mod intersection;
mod plane;
mod pose;
mod roots;
mod rotation;
mod similarity;
mod three_two_one;

pub use chi_square::chi_square_critical;
pub use circle::Circle;
pub use homography::{HomographyError, PlanePair, apply_homography, fit_homography};
pub use intersection::{
    Intersection, IntersectionError, Ray, ShortestSegment, intersect_rays, shortest_segment,
};
pub use plane::{Plane, PlaneError, PlaneFit, fit_plane};
pub use pose::Pose;
pub use roots::real_roots;
pub use rotation::{OmegaPhiKappa, rotation_from_vector, skew};
pub use similarity::{FitError, Scale, Similarity, fit_similarity};
pub use three_two_one::{AxisOrder, LEAST_SPREAD, ThreePointsError, ThreeTwoOne};
