//! The network in three dimensions: stations, points with their precision, rays, scale bars.
//!
//! What there is to see (`scene`) is made from the network's tables and the display options, and made again only when
//! one of them is another (`Arc::ptr_eq`); what the selection adds (`highlight`) likewise. Both are lists of instances
//! relative to the scene's centre, so that `f32` suffices on the graphics card; the viewpoint (`camera`) stays in the
//! world's `f64` and is handed over as one matrix. The picture is drawn with its own depth and copied onto the window
//! (`render`). Picking projects all places on the processor (`picking`).
//!
//! The viewpoint is the operator's: it fits itself once, when the first points appear, and never moves by itself after
//! that. Stations that come later fade in.
//!
//! An error ellipsoid is the surface at one sigma times the exaggeration that the legend names. Colours of precision are
//! viridis (van der Walt and Smith, 2015), whose steps look equally large to the eye.

mod boxing;
mod camera;
mod colour;
mod highlight;
mod instances;
mod legend;
mod options;
mod overlay;
mod picking;
mod pipelines;
mod render;
mod scene;
#[cfg(test)]
mod tests;
mod toolbar;
mod view;

pub use camera::{OrbitCamera, Projected, Projector, StandardView};
pub use options::{Colouring, DisplayOptions, Exaggeration, Show};
pub use picking::{PICK_RADIUS, Target};
pub use view::NetworkView;
