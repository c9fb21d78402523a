//! The one line that answers a text which is no network.

use std::fmt;

use super::NetworkFault;

/// A text with the name that messages give it.
#[derive(Clone, Copy, Debug)]
pub struct NamedText<'a> {
    /// The file as the user named it.
    pub file: &'a str,
    /// What stands in it.
    pub text: &'a str,
}

/// A text that cannot be used, and why; its `Display` is one line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}{place}: found {found}, expected {expected}")]
pub struct ImportError {
    /// The file as the user named it.
    pub file: String,
    /// Where in the file.
    pub place: ImportPlace,
    /// What was found there.
    pub found: String,
    /// What was expected.
    pub expected: String,
}

/// A place in a text; lines and columns count from 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ImportPlace {
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
    /// A field of a row.
    Field {
        /// The line.
        line: usize,
        /// The field in the line.
        column: usize,
        /// What the field holds.
        name: &'static str,
    },
    /// A thing by its name: `image 'left'`.
    Thing(String),
}

impl fmt::Display for ImportPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => Ok(()),
            Self::Line(line) => write!(f, ", line {line}"),
            Self::Character { line, column } => write!(f, ", line {line}, column {column}"),
            Self::Field { line, column, name } => {
                write!(f, ", line {line}, column {column} ({name})")
            }
            Self::Thing(name) => write!(f, ", {name}"),
        }
    }
}

impl NamedText<'_> {
    /// An error in this text.
    pub(super) fn unexpected(
        self,
        place: ImportPlace,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> ImportError {
        ImportError {
            file: self.file.to_owned(),
            place,
            found: in_one_line(&found.into()),
            expected: in_one_line(&expected.into()),
        }
    }

    /// The fault of a network that was read from this text.
    pub(super) fn fault(self, fault: NetworkFault) -> ImportError {
        self.unexpected(ImportPlace::Thing(fault.about), fault.found, fault.expected)
    }
}

/// A text without line breaks and other controls: a JSON string may hold them as escapes.
fn in_one_line(text: &str) -> String {
    text.replace(char::is_control, "?")
}

/// Longest piece of a text that is repeated in a message, characters.
const LONGEST_QUOTE: usize = 60;

/// A piece of a text in quotes, on one line and not too long.
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
