//! Random measurements as tables of observations, oriented and held against their truth.
//!
//! [`recipe`] chooses sizes and conditions, [`scene`] makes the observations, [`verdict`] runs the stages and judges every image.
//! A measurement is known by its number: a bad one can be looked at again.
#![allow(dead_code, reason = "every program uses its own part")]

pub(crate) mod recipe;
pub(crate) mod scene;
pub(crate) mod verdict;
