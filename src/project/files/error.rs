//! The one line that answers a bad file.

use std::fmt;
use std::path::Path;

/// A file that cannot be used, and why; its `Display` is one line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}{place}: {problem}")]
pub struct FileError {
    /// The file as the user named it.
    pub file: String,
    /// Where in the file.
    pub place: Place,
    /// What is wrong there.
    pub problem: Problem,
}

/// A place in a file; lines and columns count from 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// The file as a whole.
    File,
    /// A line.
    Line(usize),
    /// A character of a line.
    Character {
        /// The line.
        line: usize,
        /// The character in the line.
        column: usize,
    },
    /// A field of a table.
    Field {
        /// The line.
        line: usize,
        /// The field in the line.
        column: usize,
        /// Name of the column in the header.
        name: String,
    },
}

/// What is wrong with a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Problem {
    /// It cannot be read at all, with the system's reason.
    Unreadable(String),
    /// It holds something else than it should.
    Unexpected {
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::File => Ok(()),
            Place::Line(line) => write!(f, ", line {line}"),
            Place::Character { line, column } => write!(f, ", line {line}, column {column}"),
            Place::Field { line, column, name } => {
                write!(f, ", line {line}, column {column} ({name})")
            }
        }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Problem::Unreadable(reason) => write!(f, "cannot be read: {reason}"),
            Problem::Unexpected { found, expected } => {
                write!(f, "found {found}, expected {expected}")
            }
        }
    }
}

impl FileError {
    /// Something else than expected at a place.
    pub(super) fn unexpected(
        file: &str,
        place: Place,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self {
            file: file.to_owned(),
            place,
            problem: Problem::Unexpected {
                found: found.into(),
                expected: expected.into(),
            },
        }
    }
}

/// Longest piece of a file that is repeated in a message, characters.
const LONGEST_QUOTE: usize = 60;

/// A piece of a file in quotes, on one line and not too long.
pub(super) fn quote(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    let line: String = words
        .join(" ")
        .chars()
        .map(|c| if c.is_control() { '?' } else { c })
        .collect();
    if line.chars().count() <= LONGEST_QUOTE {
        return format!("'{line}'");
    }
    let start: String = line.chars().take(LONGEST_QUOTE).collect();
    format!("'{start}...'")
}

/// Reads a text file and gives its text to `parse` together with its name.
pub(super) fn read_with<T>(
    path: &Path,
    parse: impl FnOnce(&str, &str) -> Result<T, FileError>,
) -> Result<T, FileError> {
    let file = path.display().to_string();
    match std::fs::read(path) {
        Ok(bytes) => parse(&file, text(&file, &bytes)?),
        Err(e) => Err(FileError {
            file,
            place: Place::File,
            problem: Problem::Unreadable(e.to_string()),
        }),
    }
}

/// The text of a file.
///
/// # Errors
/// [`FileError`] where it cannot be read, or is no text.
pub(in crate::project) fn read_text(path: &Path) -> Result<String, FileError> {
    read_with(path, |_, text| Ok(text.to_owned()))
}

/// The text of a file's bytes.
fn text<'a>(file: &str, bytes: &'a [u8]) -> Result<&'a str, FileError> {
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err(FileError::unexpected(
            file,
            Place::File,
            "text in UTF-16",
            "UTF-8",
        ));
    }
    std::str::from_utf8(bytes).map_err(|e| {
        let before = &bytes[..e.valid_up_to()];
        let line = before.iter().filter(|&&b| b == b'\n').count() + 1;
        FileError::unexpected(
            file,
            Place::Line(line),
            format!("the byte 0x{:02x}", bytes[e.valid_up_to()]),
            "UTF-8 text",
        )
    })
}

/// The text without its byte order mark.
pub(super) fn without_mark(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_text_is_said_to_be_none() {
        let line = |bytes: &[u8]| text("a.csv", bytes).unwrap_err().to_string();
        assert_eq!(
            line(b"label\nM\xe4rz"),
            "a.csv, line 2: found the byte 0xe4, expected UTF-8 text"
        );
        assert_eq!(
            line(b"\xff\xfel\0"),
            "a.csv: found text in UTF-16, expected UTF-8"
        );
    }

    #[test]
    fn a_missing_file_is_named() {
        let error = read_with(Path::new("no/such.csv"), |_, _| Ok(())).unwrap_err();
        assert!(
            error
                .to_string()
                .starts_with("no/such.csv: cannot be read: "),
            "{error}"
        );
    }

    #[test]
    fn a_quote_is_one_short_line() {
        assert_eq!(quote("a\n b\tc"), "'a b c'");
        assert_eq!(quote(&"x".repeat(80)).len(), LONGEST_QUOTE + 5);
    }
}
