//! Data that others measured. They are not part of the project: where they are absent, the tests say so.

use std::io::Write as _;
use std::path::{Path, PathBuf};

/// A line that is seen although the test passes: the test harness keeps back what the print macros write.
pub(crate) fn say(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// The folder of a data set; `None`, with one line that says so, where it is absent.
pub(crate) fn data(name: &str) -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let folder = std::env::var_os("TIEPOINT_DATA")
        .map_or(beside, PathBuf::from)
        .join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    say(&format!(
        "{name}: did not run, found no {}, expected the data set (TIEPOINT_DATA)",
        folder.display()
    ));
    None
}
