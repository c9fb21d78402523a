//! `adjust`: a network without pictures.

use std::path::{Path, PathBuf};

use super::terminal::show;
use super::{CommandError, Form};
use crate::adjustment::RejectionSettings;
use crate::monitor::Monitor;
use crate::plain_network::{NamedText, PlainError, PlainSettings, from_json};
use crate::report::PlainReport;

/// Which network to adjust, and how.
#[derive(Clone, Debug)]
pub struct AdjustRequest {
    /// File of the network.
    pub network: PathBuf,
    /// Reject image points whose |w| exceeds this; `None`: all are used.
    pub reject: Option<f64>,
}

/// Adjusts a network and prints the result.
///
/// # Errors
/// [`CommandError`] where the file is bad or the network cannot be adjusted.
pub fn adjust(request: &AdjustRequest, form: Form, monitor: &Monitor) -> Result<(), CommandError> {
    let text = read(&request.network)?;
    let name = request.network.to_string_lossy();
    let network = from_json(NamedText {
        file: &name,
        text: &text,
    })
    .map_err(|error| CommandError::input(error.to_string()))?;
    let rejection = match request.reject {
        Some(critical) if critical.is_finite() && critical > 0.0 => Some(RejectionSettings {
            critical,
            restore: RejectionSettings::default().restore.min(critical),
            ..RejectionSettings::default()
        }),
        Some(other) => {
            return Err(CommandError::input(format!(
                "--reject: found {other}, expected a number greater than 0"
            )));
        }
        None => None,
    };
    let settings = PlainSettings {
        rejection,
        ..PlainSettings::default()
    };
    let adjusted = network
        .adjust(&settings, monitor)
        .map_err(|error| match error {
            PlainError::Interrupted => CommandError::interrupted(),
            other => CommandError::work(format!("{name}: {other}")),
        })?;
    let report = PlainReport::new(&network, &adjusted);
    match form {
        Form::Json => {
            let json = serde_json::to_string_pretty(&report)
                .map_err(|e| CommandError::work(format!("result as JSON: {e}")))?;
            show(&json)
        }
        Form::Text => show(&report.text()),
    }
}

fn read(path: &Path) -> Result<String, CommandError> {
    let bytes = std::fs::read(path)
        .map_err(|error| CommandError::input(format!("{}: {error}", path.display())))?;
    String::from_utf8(bytes).map_err(|error| {
        CommandError::input(format!(
            "{}: found no text at byte {}, expected UTF-8",
            path.display(),
            error.utf8_error().valid_up_to()
        ))
    })
}
