//! Random dense fields of plain targets as tables of observations, identified and held against their truth.
//!
//! [`recipe`] chooses sizes and conditions, [`object`] places codes and targets on flat and curved faces, [`table`] makes what
//! detection would find (missed dots, false dots, clusters, glints that move with the camera, dots that merge), [`scene`] puts the
//! pictures together and [`verdict`] runs the stages and judges every dot. A measurement is known by its number.
#![allow(dead_code, reason = "every program uses its own part")]

pub(crate) mod object;
pub(crate) mod picture;
pub(crate) mod recipe;
pub(crate) mod scene;
pub(crate) mod table;
pub(crate) mod verdict;
