//! Rows of fields between blanks or commas, as the programs of the field write them.

use super::error::quote;
use super::{ImportError, ImportPlace, NamedText};

/// One line of a text, cut into fields.
#[derive(Clone, Debug)]
pub(super) struct Row<'a> {
    source: NamedText<'a>,
    /// The line's number, from 1.
    pub(super) line: usize,
    /// The fields without blanks around.
    pub(super) fields: Vec<&'a str>,
}

impl<'a> NamedText<'a> {
    /// Lines that are neither blank nor a comment (`#`), with their numbers.
    pub(super) fn lines(self) -> impl Iterator<Item = (usize, &'a str)> {
        self.all_lines()
            .filter(|(_, line)| !line.trim().is_empty() && !is_comment(line))
    }

    /// Every line with its number.
    pub(super) fn all_lines(self) -> impl Iterator<Item = (usize, &'a str)> {
        let text = self.text.strip_prefix('\u{feff}').unwrap_or(self.text);
        text.lines()
            .enumerate()
            .map(|(index, line)| (index + 1, line))
    }

    /// Rows of words between blanks.
    pub(super) fn words(self) -> impl Iterator<Item = Row<'a>> {
        self.lines()
            .map(move |(line, content)| self.words_of(line, content))
    }

    /// The words of one line.
    pub(super) fn words_of(self, line: usize, content: &'a str) -> Row<'a> {
        Row {
            source: self,
            line,
            fields: content.split_whitespace().collect(),
        }
    }

    /// Rows of fields between commas.
    pub(super) fn commas(self) -> impl Iterator<Item = Row<'a>> {
        self.lines().map(move |(line, content)| Row {
            source: self,
            line,
            fields: content.split(',').map(str::trim).collect(),
        })
    }
}

/// Whether a line is a comment.
pub(super) fn is_comment(line: &str) -> bool {
    line.trim_start().starts_with('#')
}

impl<'a> Row<'a> {
    /// An error of the whole row.
    pub(super) fn unexpected(
        &self,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> ImportError {
        self.source
            .unexpected(ImportPlace::Line(self.line), found, expected)
    }

    /// An error at a field that repeats its text.
    pub(super) fn wrong(
        &self,
        index: usize,
        name: &'static str,
        expected: impl Into<String>,
    ) -> ImportError {
        let found = match self.fields.get(index) {
            None | Some(&"") => "nothing".to_owned(),
            Some(text) => quote(text),
        };
        let place = ImportPlace::Field {
            line: self.line,
            column: index + 1,
            name,
        };
        self.source.unexpected(place, found, expected)
    }

    /// Refuses a row of fewer fields than these.
    pub(super) fn at_least(&self, names: &[&str]) -> Result<(), ImportError> {
        if self.fields.len() >= names.len() {
            return Ok(());
        }
        let found = match self.fields.len() {
            1 => "1 field".to_owned(),
            n => format!("{n} fields"),
        };
        let expected = format!("{} ({})", names.len(), names.join(", "));
        Err(self.unexpected(found, expected))
    }

    /// A field's text, which may not be empty.
    pub(super) fn text(&self, index: usize, name: &'static str) -> Result<&'a str, ImportError> {
        match self.fields.get(index) {
            Some(text) if !text.is_empty() => Ok(text),
            _ => Err(self.wrong(index, name, "a name")),
        }
    }

    /// A finite number.
    pub(super) fn number(&self, index: usize, name: &'static str) -> Result<f64, ImportError> {
        match self.fields.get(index).map(|text| text.parse::<f64>()) {
            Some(Ok(value)) if value.is_finite() => Ok(value),
            Some(Ok(_)) => Err(self.wrong(index, name, "a finite number")),
            _ => Err(self.wrong(index, name, "a number")),
        }
    }

    /// Finite numbers in successive fields.
    pub(super) fn numbers<const N: usize>(
        &self,
        first: usize,
        names: [&'static str; N],
    ) -> Result<[f64; N], ImportError> {
        let mut values = [0.0; N];
        for (offset, name) in names.into_iter().enumerate() {
            values[offset] = self.number(first + offset, name)?;
        }
        Ok(values)
    }

    /// A number greater than zero.
    pub(super) fn positive(&self, index: usize, name: &'static str) -> Result<f64, ImportError> {
        let value = self.number(index, name)?;
        if value <= 0.0 {
            return Err(self.wrong(index, name, "a number greater than 0"));
        }
        Ok(value)
    }

    /// A whole number of pixels.
    pub(super) fn side(&self, index: usize, name: &'static str) -> Result<u32, ImportError> {
        match self.fields.get(index).map(|text| text.parse::<u32>()) {
            Some(Ok(side)) if side > 0 => Ok(side),
            _ => Err(self.wrong(index, name, "a number of pixels")),
        }
    }
}
