//! Random networks of which the truth is known, adjusted: whether the sigmas they print are the errors they make.
//!
//! [`scene`] makes a network of a number, [`outcome`] adjusts it and compares, [`tally`] counts over many.
#![allow(dead_code, reason = "every program uses its own part")]

pub(crate) mod outcome;
pub(crate) mod scene;
pub(crate) mod tally;
