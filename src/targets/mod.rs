//! Targets in one picture: dots, coded targets, the reference cross.

mod detect;
mod detections;
mod dot420;
mod dot;
mod ellipse;
mod family;
mod finding;
mod fit;
mod profile;
#[cfg(test)]
mod rendering;
mod ring;
mod window;

pub use detect::{DetectSettings, detect};
pub use detections::{CodeReading, Detections, Dot, DotIndex, Rejected};
pub use dot420::{Dot420Reading, Dot420Settings, read_dot420};
pub use dot::DotSettings;
pub use family::{
    DOT420_AXES, Family, UnknownFamily, dot420_number, dot420_positions, dot420_table,
    least_rotation, ring_number, ring_table,
};
