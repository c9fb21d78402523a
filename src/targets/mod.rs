//! Targets in one picture: dots, coded targets, the reference cross.

mod detections;
mod dot420;
mod family;

pub use detections::{CodeReading, Detections, Dot, DotIndex, Rejected};
pub use dot420::{Dot420Reading, Dot420Settings, read_dot420};
pub use family::{
    DOT420_AXES, Family, UnknownFamily, dot420_number, dot420_positions, dot420_table,
    least_rotation, ring_number, ring_table,
};
