//! A network of rays without pictures: cameras, images, points, image measurements and distances as plain numbers.
//!
//! Other programs' networks come in here, so that they can be adjusted and compared, and ours go out. [`from_json`]
//! and [`to_json`] are this program's own format; [`from_aicon`], [`from_dbat`] and [`from_colmap`] read three others
//! and [`to_colmap`] writes one. Readers take texts, never paths: whoever calls reads the files.
//!
//! - **Frames and signs are ours** whatever the source: pixels from the top-left corner, the camera looking along -z
//!   with y up, parameters in the order and sign of [`crate::camera::INTERIOR_NAMES`].
//! - **The direction of the lens is kept**, because a polynomial in the measured point is none in the ideal one:
//!   [`crate::camera::LensDirection`] says which of the two its parameters correct or displace.
//! - **Lengths are millimetres** where the source has a scale; a source in other units keeps them, and all of its
//!   object coordinates, centres and distances are in that one unit.
//! - **Every fault is one line** ([`ImportError`]): where, what was found, what was expected. A reader that cannot hold
//!   something refuses it; nothing is passed over in silence but what its documentation names.
//!
//! - **Bad networks are adjusted where they can be.** What cannot take part is left out, what the observations do not
//!   determine is held or left out ([`PlainNetwork::adjust`]), and each has its line.
//!
//! Invariant: a network that came out of a reader satisfies [`PlainNetwork::check`], but for image points of a JSON file that an
//! adjustment leaves out.

mod adjust;
#[cfg(test)]
mod adjust_tests;
mod aicon;
mod blocks;
mod check;
mod colmap;
mod colmap_export;
mod colmap_lens;
mod components;
mod contradictions;
mod dbat;
mod dbat_camera;
mod doubtful;
mod error;
mod json;
mod json_form;
mod known_values;
mod model;
mod repair;
mod rows;
mod shape;
mod starts;
mod usable;
mod weak;
mod words;

#[cfg(test)]
mod bad_network_fixture;
#[cfg(test)]
mod bad_network_tests;
#[cfg(test)]
mod contradiction_tests;
#[cfg(test)]
mod damaged;
#[cfg(test)]
pub(crate) mod fixture;
#[cfg(test)]
mod real_data;

pub use adjust::{HeldParameter, PlainAdjustment, PlainError, PlainSettings};
pub use aicon::{AICON_SIGMA_MM, AiconTexts, from_aicon};
pub use check::NetworkFault;
pub use colmap::{COLMAP_PITCH_MM, COLMAP_SIGMA_PX, ColmapTexts, from_colmap};
pub use colmap_export::{ColmapFiles, to_colmap};
pub use components::{GroupComponent, Weights};
pub use contradictions::{Contradiction, KnownValue};
pub use dbat::{DBAT_SIGMA_PX, DbatTexts, from_dbat};
pub use error::{ImportError, ImportPlace, NamedText};
pub use json::{from_json, to_json};
pub use model::{
    DatumPoints, Known, PlainCamera, PlainDatum, PlainDistance, PlainImage, PlainNetwork,
    PlainObservation, PlainParameter, PlainPoint, PointRole,
};
