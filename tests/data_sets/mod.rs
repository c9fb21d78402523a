//! Data that others measured. They are not part of the project: where they are absent, the tests say so.
#![allow(dead_code, reason = "every test uses its own part")]

use std::io::Write as _;
use std::path::{Path, PathBuf};

use tiepoint::monitor::Monitor;
use tiepoint::plain_network::{NamedText, PlainAdjustment, PlainNetwork, PlainSettings};

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

/// A file of a data set.
pub(crate) fn text(folder: &Path, file: &str) -> String {
    std::fs::read_to_string(folder.join(file)).expect("a file of the data set")
}

/// A text as a reader takes it.
pub(crate) fn named(text: &str) -> NamedText<'_> {
    NamedText { file: "file", text }
}

/// A network of a data set, adjusted as it is.
pub(crate) fn adjusted(network: &PlainNetwork) -> PlainAdjustment {
    network
        .adjust(&PlainSettings::default(), &Monitor::new())
        .expect("a network that can be adjusted")
}
