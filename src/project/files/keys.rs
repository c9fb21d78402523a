//! The keys of a TOML file with their places.

use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::FileError;
use super::error::{Place, quote};

/// The text of a file and its name.
#[derive(Clone, Copy, Debug)]
pub(super) struct Document<'a> {
    /// The file as the user named it.
    pub(super) file: &'a str,
    /// Its text without byte order mark.
    pub(super) text: &'a str,
}

/// A table of a TOML file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Keys<'a> {
    document: Document<'a>,
    table: &'a DeTable<'a>,
    /// Where the table begins; `None` for the file's own.
    start: Option<usize>,
}

/// The value of a key.
#[derive(Clone, Copy, Debug)]
pub(super) struct Value<'a> {
    document: Document<'a>,
    key: &'a str,
    value: &'a Spanned<DeValue<'a>>,
}

impl<'a> Document<'a> {
    /// Reads the text as TOML.
    pub(super) fn parse(self) -> Result<Spanned<DeTable<'a>>, FileError> {
        DeTable::parse(self.text).map_err(|e| {
            let span = e.span().unwrap_or(0..0);
            let start = span.start.min(self.text.len());
            let line = self.text[..start].rsplit('\n').next().map_or(0, str::len);
            let content = self.text[start - line..].lines().next().unwrap_or("");
            FileError::unexpected(
                self.file,
                self.place(start),
                quote(content),
                format!("TOML ({})", e.message().replace('\n', ", ")),
            )
        })
    }

    /// The keys of the whole file.
    pub(super) fn keys(self, table: &'a Spanned<DeTable<'a>>) -> Keys<'a> {
        Keys {
            document: self,
            table: table.get_ref(),
            start: None,
        }
    }

    fn place(self, offset: usize) -> Place {
        let before = &self.text[..offset.min(self.text.len())];
        Place::Character {
            line: before.matches('\n').count() + 1,
            column: before.rsplit('\n').next().unwrap_or("").chars().count() + 1,
        }
    }

    fn slice(self, span: Range<usize>) -> &'a str {
        self.text.get(span).unwrap_or("")
    }
}

impl<'a> Keys<'a> {
    /// Refuses keys that no one knows.
    pub(super) fn refuse_others(self, known: &[&str]) -> Result<(), FileError> {
        let other = self
            .table
            .keys()
            .filter(|key| !known.contains(&key.get_ref().as_ref()))
            .min_by_key(|key| key.span().start);
        match other {
            None => Ok(()),
            Some(key) => Err(FileError::unexpected(
                self.document.file,
                self.document.place(key.span().start),
                format!("the key {}", quote(key.get_ref())),
                format!("one of {}", known.join(", ")),
            )),
        }
    }

    /// The value of a key.
    pub(super) fn get(self, key: &'a str) -> Option<Value<'a>> {
        let value = self.table.get(key)?;
        Some(Value {
            document: self.document,
            key,
            value,
        })
    }

    /// The value of a key that must be there.
    pub(super) fn required(self, key: &'a str) -> Result<Value<'a>, FileError> {
        self.get(key).ok_or_else(|| {
            let place = self
                .start
                .map_or(Place::File, |start| self.document.place(start));
            let found = format!("no key {key}");
            FileError::unexpected(self.document.file, place, found, "it")
        })
    }
}

impl<'a> Value<'a> {
    /// An error at this value that repeats it.
    pub(super) fn expected(self, expected: impl Into<String>) -> FileError {
        let source = self.document.slice(self.value.span());
        let found = match self.value.get_ref() {
            DeValue::Table(_) => format!("the table {}", self.key),
            _ => quote(&format!("{} = {source}", self.key)),
        };
        let place = self.document.place(self.value.span().start);
        FileError::unexpected(self.document.file, place, found, expected)
    }

    /// An error at this value in other words.
    pub(super) fn unexpected(
        self,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> FileError {
        let place = self.document.place(self.value.span().start);
        FileError::unexpected(self.document.file, place, found, expected)
    }

    /// A text that is not empty.
    pub(super) fn text(self) -> Result<&'a str, FileError> {
        match self.value.get_ref().as_str() {
            Some(text) if !text.trim().is_empty() => Ok(text.trim()),
            _ => Err(self.expected("a text in quotation marks")),
        }
    }

    /// A whole number from `range`.
    pub(super) fn count(self, range: std::ops::RangeInclusive<u32>) -> Result<u32, FileError> {
        self.value
            .get_ref()
            .as_integer()
            .and_then(|i| i.to_string().parse::<u32>().ok())
            .filter(|count| range.contains(count))
            .ok_or_else(|| {
                let (least, most) = (range.start(), range.end());
                self.expected(format!("a whole number from {least} to {most}"))
            })
    }

    /// A number from `range`, in `unit`.
    pub(super) fn within(
        self,
        range: std::ops::RangeInclusive<f64>,
        unit: &str,
    ) -> Result<f64, FileError> {
        number(self.value.get_ref())
            .filter(|value| range.contains(value))
            .ok_or_else(|| {
                let (least, most) = (range.start(), range.end());
                self.expected(format!("a number from {least} to {most} ({unit})"))
            })
    }

    /// A standard deviation: greater than zero; `None` for `inf`, which says that there is no such knowledge.
    pub(super) fn sigma(self) -> Result<Option<f64>, FileError> {
        let sigma = number(self.value.get_ref()).filter(|sigma| *sigma > 0.0);
        match sigma {
            Some(sigma) => Ok(sigma.is_finite().then_some(sigma)),
            None => Err(self.expected("a number greater than 0")),
        }
    }

    /// `N` finite numbers.
    pub(super) fn numbers<const N: usize>(self) -> Result<[f64; N], FileError> {
        self.array()
            .filter(|values: &[f64; N]| values.iter().all(|v| v.is_finite()))
            .ok_or_else(|| self.expected(format!("{N} numbers in brackets")))
    }

    /// `N` standard deviations, see [`Self::sigma`].
    pub(super) fn sigmas<const N: usize>(self) -> Result<[Option<f64>; N], FileError> {
        self.array()
            .filter(|sigmas: &[f64; N]| sigmas.iter().all(|s| *s > 0.0))
            .map(|sigmas| sigmas.map(|s| s.is_finite().then_some(s)))
            .ok_or_else(|| self.expected(format!("{N} numbers greater than 0 in brackets")))
    }

    /// The tables of `[[key]]`.
    pub(super) fn tables(self) -> Result<Vec<Keys<'a>>, FileError> {
        let wrong = || self.expected(format!("tables [[{}]]", self.key));
        let array = self.value.get_ref().as_array().ok_or_else(wrong)?;
        array
            .iter()
            .map(|entry| {
                Ok(Keys {
                    document: self.document,
                    table: entry.get_ref().as_table().ok_or_else(wrong)?,
                    start: Some(entry.span().start),
                })
            })
            .collect()
    }

    /// The table of `[key]`.
    pub(super) fn table(self) -> Result<Keys<'a>, FileError> {
        let wrong = || self.expected(format!("a table [{}]", self.key));
        Ok(Keys {
            document: self.document,
            table: self.value.get_ref().as_table().ok_or_else(wrong)?,
            start: Some(self.value.span().start),
        })
    }

    fn array<const N: usize>(self) -> Option<[f64; N]> {
        let array = self.value.get_ref().as_array()?;
        let values: Option<Vec<f64>> = array.iter().map(|v| number(v.get_ref())).collect();
        values?.try_into().ok()
    }
}

/// A number, whole or not; `None` for other types.
fn number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(float) => float.as_str().parse().ok(),
        DeValue::Integer(integer) => integer.to_string().parse().ok(),
        _ => None,
    }
}
