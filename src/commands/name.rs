//! `name`: plain targets get the names of approximate coordinates.

use std::path::PathBuf;

use super::terminal::show;
use super::{CommandError, Form, open_to_change};
use crate::project::edit::Edit;
use crate::project::files::read_reference;
use crate::report::{NamingError, NamingSettings, name_by_reference};

/// What to name by what.
#[derive(Clone, Debug)]
pub struct NameRequest {
    /// Project file.
    pub project: PathBuf,
    /// Names with approximate coordinates.
    pub reference: PathBuf,
    /// How.
    pub settings: NamingSettings,
}

/// Names the targets of a project by a list, as one edit, and tells what was named and what is left.
///
/// # Errors
/// [`CommandError`] where a file is bad, nothing is adjusted, or no transformation is beyond doubt; the project is
/// unchanged then.
pub fn name(request: &NameRequest, form: Form) -> Result<(), CommandError> {
    let reference = read_reference(&request.reference)?;
    let mut session = open_to_change(&request.project)?;
    let naming = name_by_reference(session.network(), &reference, &request.settings).map_err(
        |e| match e {
            NamingError::BadDistance { .. } => CommandError::input(e.to_string()),
            _ => CommandError::work(format!("{}: {e}", request.project.display())),
        },
    )?;
    if !naming.names.is_empty() {
        session.apply(&Edit::NameTargets {
            names: naming.names.clone(),
        })?;
        session.flush()?;
    }
    match form {
        Form::Json => {
            let json = serde_json::to_string_pretty(&naming)
                .map_err(|e| CommandError::work(format!("result as JSON: {e}")))?;
            show(&json)
        }
        Form::Text => show(&format!(
            "{}: {} targets named\n{}",
            request.project.display(),
            naming.names.len(),
            naming.text()
        )),
    }
}
