//! `codes`: the table of a family, or sheets of its targets to print.

use std::path::{Path, PathBuf};

use super::CommandError;
use crate::report::{codes_csv, sheet_pdf, sheet_svg, write_file};
use crate::targets::Family;
use crate::targets::sheet::{SheetSettings, sheet};

/// Writes the table of a code family.
///
/// # Errors
/// [`CommandError`] where the file cannot be written.
pub fn codes(table: &Path, family: Family) -> Result<(), CommandError> {
    write_file(table, codes_csv(family).as_bytes())?;
    Ok(())
}

/// What to print where.
#[derive(Clone, Debug)]
pub struct SheetRequest {
    /// File to write: its ending, `.pdf` or `.svg`, says as what.
    pub file: PathBuf,
    /// Codes and sizes.
    pub settings: SheetSettings,
}

/// Writes a sheet of targets.
///
/// # Errors
/// [`CommandError`] for another ending, codes and sizes that cannot be printed, and a file that cannot be written.
pub fn codes_sheet(request: &SheetRequest) -> Result<(), CommandError> {
    let SheetRequest { file, settings } = request;
    let ending = file
        .extension()
        .map(|ending| ending.to_string_lossy().to_lowercase());
    let draw = match ending.as_deref() {
        Some("pdf") => sheet_pdf,
        Some("svg") => |sheet: &_| sheet_svg(sheet).into_bytes(),
        _ => {
            return Err(CommandError::input(format!(
                "{}: found {}, expected a file that ends in .pdf or .svg",
                file.display(),
                ending.map_or_else(|| "no ending".into(), |ending| format!("ending .{ending}"))
            )));
        }
    };
    let sheet = sheet(settings)
        .map_err(|error| CommandError::input(format!("{}: {error}", file.display())))?;
    write_file(file, &draw(&sheet))?;
    Ok(())
}
