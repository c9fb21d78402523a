//! Tiepoint: vision metrology from photographs of coded and plain targets.
//!
//! Targets and codes are found in every image, two images are oriented to each other, the others are connected one by
//! one, plain targets are identified by multi-ray intersection, and a free-network bundle adjustment with
//! self-calibration gives coordinates with their standard errors (Hattori, Akimoto, Fraser and Imoto, 2002).
//!
//! # Conventions
//! - Lengths are in millimetres, image measurements in pixels, angles in radians; a name says otherwise (`_px`, `_deg`).
//!   All numbers are `f64`; grey values alone are `f32`.
//! - Pixel coordinates: x to the right, y down, origin at the top-left *corner* of the image, so that the centre of the
//!   first pixel is (0.5, 0.5).
//! - Image coordinates (mm): x to the right, y up, origin at the image centre, before the principal point is applied.
//! - Camera frame: x to the right, y up, z backwards; the camera looks along -z. A pose holds `camera_from_world` and
//!   the projection centre in the world; transforms are named by their ends.
//! - Interior orientation: ten parameters in the order of [`camera::INTERIOR_NAMES`], photogrammetric sign: corrections
//!   are added to measured coordinates, so that a ray needs no inversion.
//! - Residuals are computed minus measured, in the measured image. Standard errors of unknowns are a-posteriori, and the
//!   datum they refer to is named.
//! - The same inputs give the same digits on any number of threads: chunks and sums have a fixed order, random samples
//!   a seed in the settings.
//!
//! # Modules
//! Each uses those before it, never those after it; `tests/architecture.rs` reads the source and holds it to that.
//!
//! Common ground
//! - [`monitor`]: progress out, interrupts in; whoever reports progress obeys the interrupt, by the same call.
//!
//! Mathematics: plain numbers, no names, no files, no pictures
//! - [`geometry`]: rotation, pose, similarity, plane, homography, intersection of rays; uses nothing else here.
//! - [`camera`]: interior orientation, distortion, projection; every Jacobian is tested against differences.
//!
//! Pictures: grey values in, image measurements out
//! - [`imaging`]: grey images, their noise and level sets; the only place that decodes a picture file.
//! - [`targets`]: dots, codes and why candidates were refused; knows one picture at a time and no adjustment.
//!
//! Networks of rays: image measurements in, orientations and points out; indices instead of names
//! - [`adjustment`]: bundle adjustment with exact statistics; a rank defect is an error that names what is loose.
//! - [`orientation`]: where a camera stood, with all poses that fit; an ambiguity is returned, not decided.
//! - [`matching`]: which dots of which images show one target; names what is certain and says why the rest is not.
//!
//! The measurement: names for the numbers
//! - [`network`]: the document as a value; a change copies what it touches, so that nobody sees it half-changed.
//! - [`plain_network`]: a network of rays without pictures, read, written, adjusted; what is bad is named.
//! - [`synthetic`]: scenes and pictures of which everything is known exactly; never uses what it is to test.
//! - [`stages`]: the six stages; a step is a pure function of the network, and the next one follows from it alone.
//! - [`report`]: tables, CSV, TOML, JSON; no figure that is older than its inputs leaves the program.
//! - [`project`]: document, history and file; two doors change the document, and both save.
//! - [`commands`]: what the program does when it is called; prints results, asks the floors above for them.
//!
//! The window
//! - [`worker`]: one named thread that computes while the window stays alive; knows no stage.
//! - [`ui`]: the window; the only place that knows egui, eframe and wgpu. Panels draw and ask, one place applies.

pub mod adjustment;
pub mod camera;
pub mod commands;
pub mod geometry;
pub mod imaging;
pub mod matching;
pub mod monitor;
pub mod network;
pub mod orientation;
pub mod plain_network;
pub mod project;
pub mod report;
pub mod stages;
pub mod synthetic;
pub mod targets;
pub mod ui;
pub mod worker;
