//! Targets in one picture: dots and the codes that they make.
//!
//! Detection proposes places that keep an elliptic shape over several grey levels (see [`crate::imaging::LevelTree`]),
//! then fits to each the grey values of a blurred elliptic dot, `background + amplitude Phi(d / blur)`, by least
//! squares over its pixels: centre, ellipse, blur, amplitude and background are one estimate (after the models of
//! Luhmann, Robson, Kyle and Boehm, Close-Range Photogrammetry, 2014, chapter 5.4). The centre's sigma comes from that
//! fit's residuals, not from an assumed noise. A dot that is covered, cut off or no ellipse is refused by its misfit,
//! with a reason.
//!
//! Ring codes are read in the frame that their dot's ellipse gives, corrected by the ring's own edges; the rule is to
//! read a number rightly or to say why not.
//!
//! Invariant: pure functions of one picture; no orientation, no adjustment, the same digits on any number of threads.

mod detect;
mod detections;
mod dot;
mod dot420;
mod ellipse;
mod family;
mod finding;
mod fit;
mod measure_at;
mod profile;
#[cfg(test)]
mod rendering;
mod ring;
mod window;

pub use detect::{DetectSettings, detect, detect_unless_interrupted};
pub use detections::{CodeEvidence, CodeReading, Detections, Dot, DotIndex, Rejected};
pub use dot::DotSettings;
pub use dot420::{Dot420Reading, Dot420Settings, read_dot420};
pub use family::{
    DOT420_AXES, Family, UnknownFamily, dot420_number, dot420_positions, dot420_table,
    least_rotation, ring_number, ring_table,
};
pub use measure_at::{MeasureAtSettings, centre_by_hand, measure_at};
