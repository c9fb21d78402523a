//! Pictures: grey values in memory, reading them from files, their noise, and their level sets.
//!
//! Segmentation does not choose one threshold. One reading in tiles leaves the [`Region`]s that rise above their
//! surroundings; [`LevelTree`] cuts each of them at some twenty grey levels in geometric
//! progression above its ground and keeps the connected components of every level with the component of the level below that holds
//! them: a coarse component tree, the structure behind maximally stable extremal regions (Matas, Chum, Urban and
//! Pajdla, 2002). A target is a component that keeps its shape over several levels, so neither a flash hot spot nor
//! a textured panel nor the neighbouring targets can spoil "the" local background: the ground only says where nothing
//! is. Components are found by run lengths and union-find, a level inside the runs of the level below.
//!
//! What is too faint for that shows by the sums of 2 x 2 pixels, and is cut in grey values that [`Smoothed`] has made quieter.
//!
//! The noise is the robust spread (Rousseeuw and Croux's 1.4826 times the median absolute value) of the second
//! differences of neighbouring pixels. The same of means of 2 x 2 pixels says more where pixels hang together: texture.
//!
//! Invariant: only `load` touches files; orientation tags never turn coordinates.

mod grey;
mod levels;
mod load;
mod noise;
mod regions;
mod smoothed;
mod tiles;

pub use grey::{BitDepth, GreyImage, WrongSampleCount};
pub use levels::{LevelNode, LevelSettings, LevelTree};
pub use load::{
    LoadError, LoadSettings, Picture, PictureMeta, load_picture, load_picture_until, read_meta,
    read_size,
};
pub use noise::{noise_level, noise_of_means};
pub use regions::Region;
pub use smoothed::Smoothed;
pub use tiles::Tiles;
