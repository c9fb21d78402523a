//! Exterior orientation from plain numbers: where a camera stood, from image points and object points.
//!
//! Image points come in pixels with a [`crate::camera::Camera`], or as *ideal* image points in millimetres (distortion
//! removed) with a principal distance. Every pose obeys `[x', y', -c] ~ M (X - X0)`.
//!
//! - [`dlt`]: the 11-parameter direct linear transformation (Abdel-Aziz and Karara, 1971), the method of Hattori et al.
//!   (2002) for the first images; its rank is tested, because flat point sets have none to spare.
//! - [`plane_pose`]: both poses of a flat set with known principal distance (Schweighofer and Pinz, 2006; Collins and
//!   Bartoli, 2014).
//! - [`similarity`]: the closed-form resection of Hattori et al. (2002, equations 1-12) from coded targets.
//! - [`p3p`] and [`consensus`]: three-point resection (Grunert, 1841; Haralick et al., 1994) in sample consensus
//!   (Fischler and Bolles, 1981).
//! - [`from_points`]: all poses of points without gross errors.
//! - [`refine`]: the collinearity refinement that all of them end with.
//! - [`relative`]: relative orientation by five points (Nister, 2004) or a plane (Faugeras and Lustman, 1988; Ma et al.,
//!   2004).
//! - [`device`]: recognition of the reference cross among all dots of an image by its coordinates alone.

#![allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "`!(x > limit)` also refuses what is not a number, which `x <= limit` would let pass"
)]

mod bodies;
pub mod consensus;
pub mod device;
mod device_search;
pub mod dlt;
mod five_point;
pub mod from_points;
pub mod p3p;
pub mod plane_pose;
pub mod refine;
pub mod relative;
pub mod similarity;
#[cfg(test)]
mod simulation;

pub use consensus::{ConsensusSettings, Resection, ResectionError, resect_by_consensus};
pub use device::{
    DeviceRecognition, DeviceSettings, ImageDot, NotRecognised, RivalAssignment, recognise_device,
};
pub use dlt::{DltError, DltSettings, DltSolution, direct_linear_transformation};
pub use from_points::{FittedPose, resect_from_points};
pub use p3p::three_point_poses;
pub use plane_pose::{NominalPose, PlanePoseError, plane_poses, poses_with_nominal_camera};
pub use refine::{
    IdealPoint, Loss, PoseObservation, RefineError, RefineSettings, RefinedPose, refine_pose,
};
pub use relative::{
    PixelPair, RelativeError, RelativeOrientation, RelativePose, RelativeSettings,
    relative_orientation,
};
pub use similarity::{
    CodeView, RotationGround, SimilarityError, SimilarityResection, resect_by_similarity,
};
