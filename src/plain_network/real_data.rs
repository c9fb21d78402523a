//! Where the tests find data that others measured; it is no part of the project.

use std::io::Write;
use std::path::{Path, PathBuf};

/// A line that is seen although the test passes: the test harness keeps back what the print macros write.
pub(super) fn say(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// The folder of a data set; `None`, with one line that says so, where it is absent.
pub(super) fn data(name: &str) -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let folder = std::env::var_os("TIEPOINT_DATA")
        .map_or(beside, PathBuf::from)
        .join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    say(&format!(
        "not run: found no {}, expected the data set (TIEPOINT_DATA)",
        folder.display()
    ));
    None
}

/// The text of a file of the data set.
pub(super) fn text_of(folder: &Path, file: &str) -> String {
    std::fs::read_to_string(folder.join(file)).expect("a file of the data set")
}
