//! Random measurements as tables of observations or from pictures, oriented and held against their truth.
//!
//! [`recipe`] chooses sizes and conditions, [`world`] and [`cameras`] are what is measured and with what, [`scene`] plans the pictures;
//! [`table`] makes observations without pictures, [`picture`] renders them and has the program detect the targets; [`readings`] are
//! made wrong; [`verdict`] runs the stages and judges every image, and [`bound`] says what the observations can tell at best. A measurement is known by its number: a bad one can be looked at
//! again, and one number is the same object, seen from the same places, as a table and in pictures.
#![allow(dead_code, reason = "every program uses its own part")]

pub(crate) mod bound;
pub(crate) mod cameras;
pub(crate) mod picture;
pub(crate) mod readings;
pub(crate) mod recipe;
pub(crate) mod scene;
pub(crate) mod table;
pub(crate) mod verdict;
pub(crate) mod world;
