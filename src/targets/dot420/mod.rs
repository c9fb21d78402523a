//! Six-dot codes (`dot420`): found and read among the dots of one picture, by geometry alone.
//!
//! Hattori, Akimoto, Fraser and Imoto (2002) group the six dots by dilation, which needs a clear zone round a code.
//! Here no clear zone is needed; hypotheses decide:
//!
//! 1. **Outlines give the metric.** A dot is a circle of known diameter d in a plane whose unit is the pitch p, so its
//!    ellipse is `E = (d / 2p)^2 J J^T` with `J` the local map from pitches to pixels: distances in pitches follow from
//!    `E` without knowing the camera. Neighbours O, A, B are tried where |OA| and |OB| are 6 pitches within what
//!    the outlines can be trusted to, where the turn from OA to OB is counter-clockwise as seen (clockwise in pixels,
//!    y down), and where the affine map they define predicts their own outlines.
//! 2. **The affine frame assigns** the dots inside the parallelogram to the 21 positions; every three of them that make a
//!    code of the table are a hypothesis.
//! 3. **A plane in perspective** (homography, eight unknowns) is fitted to the six centres; its two perspective terms are
//!    also observed by the areas of the six outlines (`det J ~ w^-3`) and, where the camera is known if only roughly, by the
//!    fitted map itself, without which they would swallow much of a foreign dot's misfit. The misfit, the six outlines, the
//!    contrasts and the dots standing nearer than the design allows decide: read, read with a doubt, or refused.
//! 4. **One dot, one code.** Where readings share dots the best fit stays; if the loser would have passed by itself, the
//!    winner carries a doubt. A number read twice in one picture carries a doubt at both places.
//! 5. **What stands round it.** A hidden dot and a plain target in the right place make another number that no fit tells from
//!    a true one. The likelihood of such exchanges, by the density of foreign dots and the area in which one would pass,
//!    against that of a true code decides whether the reading carries a doubt; so do foreign dots that continue the code's
//!    grid, as targets in rows do.
//!
//! The mirror image of a code is itself a code (A and B change roles, x and y of the positions are swapped), so a
//! mirrored picture gives other numbers and cannot be noticed here; the handedness is what keeps an upright one right.

mod hypothesis;
mod neighbours;
mod outline;
mod perspective;
mod plane;
mod reading;
mod rivals;
mod settings;
#[cfg(test)]
mod simulation;
mod surroundings;

pub use perspective::NominalCamera;
pub use reading::{Dot420Reading, read_dot420};
pub use settings::Dot420Settings;
