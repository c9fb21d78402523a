//! Synthetic truth: scenes of targets, camera stations and rendered pictures of which everything is known exactly.
//!
//! A [`Scene`] is made of flat elements in the world (mm): round dots, codes made of dots, ring codes, the reference
//! cross, scale bars, and opaque convex surfaces that hide what is behind them. [`box_experiment`] builds the box of
//! Hattori, Akimoto, Fraser and Imoto (2002), [`panel`] a flat field of codes with some raised targets.
//!
//! [`render`] draws what a camera with a ring flash records: the exact perspective and distorted image of every dot,
//! integrated over the pixels, blurred by a Gaussian, over a dim background, with noise, in 8 bits. [`truth_dots`] says
//! where each dot is imaged and how much of it is seen. The image of a circle's centre is not the centre of the
//! circle's image (Heikkilae, 1997): both are given. [`simulate_observations`] skips the pictures.
//!
//! Invariant: everything follows from settings and seeds; the number of threads changes no digit, and no file is
//! touched.

mod background;
mod box_experiment;
mod experiment;
mod noise;
mod observations;
mod panel;
mod patch;
mod placing;
mod render;
mod scene;
mod stations;
mod surface;
mod truth;

pub use box_experiment::{BoxSettings, CrossPlan, box_experiment};
pub use experiment::{BarTruth, Experiment, PublishedBar, Station, Truth};
pub use observations::{MAX_OBSERVED_INCIDENCE_DEG, SimulatedObservation, simulate_observations};
pub use panel::{PanelSettings, panel};
pub use placing::SceneError;
pub use render::{RenderSettings, Rendered, render};
pub use scene::{Disc, Finish, LabelledPoint, Placement, Ring, ScaleBar, Scene, default_cross};
pub use surface::Surface;
pub use truth::{TruthDot, Visibility, truth_dots};
