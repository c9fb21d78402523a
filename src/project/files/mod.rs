//! The files a user writes: cameras, target sizes, the reference cross, scale bars, known coordinates.
//!
//! Tables are CSV (RFC 4180: commas between columns, decimal points, one header line), settings are TOML 1. A byte order mark, CRLF
//! and blank lines are no faults; everything else that is not understood is refused, because a misspelt `sigma` that is
//! silently passed over bends a measurement. Every fault is one line: the file, the line and column, what was found and
//! what was expected ([`FileError`]).
//!
//! Every `read_*` takes a path; the `parse_*` beside it takes the text, and the `*_csv` or `*_toml` writes what is read back equal.

mod bars;
mod camera;
mod control;
mod cross;
mod error;
mod keys;
mod table;
mod targets;

pub use bars::{bars_csv, parse_bars, read_bars};
pub use camera::{parse_cameras, read_cameras};
pub use control::{
    control_csv, parse_control, parse_reference, read_control, read_reference, reference_csv,
};
pub use cross::{cross_csv, parse_cross, read_cross};
pub(super) use error::read_text;
pub use error::{FileError, Place, Problem};
pub use targets::{parse_targets, read_targets, targets_toml};

pub use crate::report::{CameraFile, ReferencePoint};

use crate::network::{DevicePoint, PointId, UnknownLabel};

/// The point of a label where the dots of the cross are `device`; `C17` means `C17.O`.
fn point_of_label(device: &[DevicePoint], label: &str) -> Result<PointId, UnknownLabel> {
    match device.iter().position(|point| point.label == label) {
        Some(index) => Ok(PointId::Device(index as u16)),
        None => label.parse(),
    }
}

/// What a label of a point may look like, in words.
fn expected_label(device: &[DevicePoint]) -> String {
    let cross = match device {
        [] => "a dot of the cross (no cross was given)".to_owned(),
        [only] => only.label.clone(),
        [first, .., last] => format!("a dot of the cross ({} .. {})", first.label, last.label),
    };
    format!("the label of a point such as C17, C17.A, R14-57, M5 or {cross}")
}
