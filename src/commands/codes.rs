//! `codes`: the table of a family.

use std::path::Path;

use super::CommandError;
use crate::report::{codes_csv, write_file};
use crate::targets::Family;

/// Writes the table of a code family.
///
/// # Errors
/// [`CommandError`] where the file cannot be written.
pub fn codes(table: &Path, family: Family) -> Result<(), CommandError> {
    write_file(table, codes_csv(family).as_bytes())?;
    Ok(())
}
