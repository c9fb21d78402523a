//! Targets in one picture: dots and the codes that they make.
//!
//! Detection proposes places that keep an elliptic shape over several grey levels (see [`crate::imaging::LevelTree`]),
//! then fits to each the grey values of a blurred elliptic dot, `background + amplitude Phi(d / blur)`, by least
//! squares over its pixels: centre, ellipse, blur, amplitude and background are one estimate (after the models of
//! Luhmann, Robson, Kyle and Boehm, Close-Range Photogrammetry, 2014, chapter 5.4). The centre's sigma comes from that
//! fit's residuals, not from an assumed noise. A dot that is covered, cut off or no ellipse is refused by its misfit,
//! with a reason.
//!
//! The profile takes the edge as straight within its blur; where that is not so, the exact picture of the ellipse (chords, in
//! closed form) corrects what is left. Reached against the Cramer-Rao bound, all nuisance parameters unknown
//! (`cargo bench --bench centres -- 25`, 8 and 16 bit, blur 0.5 to 2 px, incidence 0 to 70 degrees, amplitude 5 to 200
//! times the noise; peaks of 5 sigmas and more, bounds up to 0.1 px):
//!
//! | diameter, px | 4 | 6 | 8 | 12 | 20 | 30 | 50 | 100 |
//! | --- | --- | --- | --- | --- | --- | --- | --- | --- |
//! | found | 99.6 % | 99.9 % | 99.9 % | 100 % | 99.98 % | 99.99 % | 100 % | 100 % |
//! | rms of the centre over the bound | 1.02 | 1.03 | 1.05 | 1.05 | 1.09 | 1.07 | 1.04 | 1.04 |
//! | rms over the stated sigma | 1.00 | 1.01 | 1.02 | 1.01 | 1.00 | 0.98 | 0.97 | 0.98 |
//! | bias without noise, px | 0.0004 | 0.0005 | 0.0002 | 0.0002 | 0.0001 | 0.0000 | 0.0000 | 0.0000 |
//! | largest error without noise, px | 0.0033 | 0.0026 | 0.0024 | 0.0010 | 0.0012 | 0.0004 | 0.0003 | 0.0003 |
//!
//! The 0.006 px are those of 8 px dots at 70 degrees under a blur of 2 px, which is more than their smaller semi-axis; up to a
//! blur of 1.2 px it is 0.0009 px.
//! The plot is `assets/centres.svg`.
//!
//! Dots whose pixels hardly rise above the noise are sought a second time, in grey values smoothed by a binomial, where the
//! noise is that of independent pixels; what counts is the signal to noise of the whole dot, as of a filter matched to it
//! (Turin, 1960), not that of a pixel.
//!
//! Where a network says that a target must be, its ellipse and blur are known, and the centre of far weaker, more oblique and
//! closer dots can be measured: [`measure_expected`].
//!
//! Ring codes are read by computing the picture of the whole code, blur and perspective included, from the frame that their dot's
//! ellipse gives; the rule is to read a number rightly or to say why not.
//!
//! Invariant: pure functions of one picture; no orientation, no adjustment, the same digits on any number of threads.

mod columns;
mod detect;
mod detections;
mod dot;
mod dot420;
mod ellipse;
mod exact;
mod expected;
mod faint;
mod family;
mod finding;
mod fit;
mod lanes;
mod measure_at;
mod profile;
#[cfg(test)]
mod rendering;
mod ring;
mod rows;
pub mod sheet;
mod trust;
mod window;

pub use detect::{DetectSettings, detect, detect_unless_interrupted};
pub use detections::{CodeEvidence, CodeReading, Detections, Dot, DotIndex, Rejected};
pub use dot::{DotSettings, SmallestDot};
pub use dot420::{Dot420Reading, Dot420Settings, NominalCamera, read_dot420};
pub use expected::{Expected, ExpectedSettings, ExpectedView, NotThere, measure_expected};
pub use family::{
    DOT420_AXES, Family, UnknownFamily, dot420_number, dot420_positions, dot420_table,
    least_rotation, ring_number, ring_table,
};
pub use measure_at::{MeasureAtSettings, centre_by_hand, measure_at};
