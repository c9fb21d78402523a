//! A CSV table whose columns are known by name.

use super::FileError;
use super::error::{Place, quote, without_mark};

/// What becomes of columns that no one knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum OtherColumns {
    /// They are refused.
    Refused,
    /// They are passed over.
    Ignored,
}

/// The columns a table has.
#[derive(Clone, Copy, Debug)]
pub(super) struct Columns {
    /// Without these it is not this table.
    pub(super) required: &'static [&'static str],
    /// These may be there.
    pub(super) optional: &'static [&'static str],
    /// What becomes of others.
    pub(super) others: OtherColumns,
}

/// A table as read: every row has as many fields as the header.
#[derive(Debug)]
pub(super) struct Table<'a> {
    file: &'a str,
    header: Vec<String>,
    rows: Vec<Row>,
}

#[derive(Debug)]
struct Row {
    line: usize,
    fields: Vec<String>,
}

/// One line of a table.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line<'a> {
    table: &'a Table<'a>,
    row: &'a Row,
}

/// One field of a table.
#[derive(Clone, Copy, Debug)]
pub(super) struct Field<'a> {
    file: &'a str,
    line: usize,
    column: usize,
    name: &'a str,
    /// Its text without blanks around.
    pub(super) text: &'a str,
}

impl Columns {
    /// The header in words: `name,from,to[,use]`.
    fn header(&self) -> String {
        let mut text = self.required.join(",");
        for name in self.optional {
            text.push_str(&format!("[,{name}]"));
        }
        text
    }

    fn knows(&self, name: &str) -> bool {
        self.required.contains(&name) || self.optional.contains(&name)
    }

    fn check(
        &self,
        file: &str,
        line: usize,
        header: &str,
        names: &[String],
    ) -> Result<(), FileError> {
        let unexpected = |found: String, expected: String| {
            Err(FileError::unexpected(
                file,
                Place::Line(line),
                found,
                expected,
            ))
        };
        let expected = self.header();
        if !header.contains(',') {
            for (separator, words) in [(';', "semicolons"), ('\t', "tabs")] {
                if header.contains(separator) {
                    return unexpected(
                        format!("{words} between the columns"),
                        format!("commas (and decimal points): {expected}"),
                    );
                }
            }
        }
        let has = |name: &str| names.iter().any(|n| n == name);
        if !self.required.iter().any(|&name| has(name)) {
            return unexpected(quote(header), format!("the header {expected}"));
        }
        if let Some(missing) = self.required.iter().find(|&&name| !has(name)) {
            return unexpected(
                format!("no column {missing} in the header {}", quote(header)),
                expected,
            );
        }
        for (index, name) in names.iter().enumerate() {
            let place = Place::Character {
                line,
                column: index + 1,
            };
            if names[..index].contains(name) && self.knows(name) {
                let found = format!("the column {name} again");
                return Err(FileError::unexpected(file, place, found, "it once"));
            }
            if self.others == OtherColumns::Refused && !self.knows(name) {
                let found = format!("the column {}", quote(name));
                return Err(FileError::unexpected(file, place, found, expected));
            }
        }
        Ok(())
    }
}

/// The names in the first line that is not blank; empty where there is none.
pub(super) fn header_names(text: &str) -> Vec<String> {
    without_mark(text)
        .lines()
        .find(|line| !line.trim().is_empty())
        .map(fields_of)
        .unwrap_or_default()
}

/// The fields of one line, without blanks around.
fn fields_of(line: &str) -> Vec<String> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .buffer_capacity(line.len().max(1))
        .from_reader(line.as_bytes());
    let mut record = csv::StringRecord::new();
    // The line is valid UTF-8 in memory, so that reading it cannot fail.
    let _ = reader.read_record(&mut record);
    record
        .iter()
        .map(|field| unquoted(field).to_owned())
        .collect()
}

/// The field without the quotation marks that a blank before them made part of it.
fn unquoted(field: &str) -> &str {
    field
        .strip_prefix('"')
        .and_then(|inner| inner.strip_suffix('"'))
        .unwrap_or(field)
}

impl<'a> Table<'a> {
    /// Reads a table; blank lines (also such of commas alone) are passed over.
    pub(super) fn parse(file: &'a str, text: &str, columns: Columns) -> Result<Self, FileError> {
        // Line by line, so that a line number is always the one an editor shows: no field of ours holds a line break.
        let mut lines = without_mark(text)
            .lines()
            .enumerate()
            .map(|(index, line)| (index + 1, line))
            .filter(|(_, line)| line.chars().any(|c| c != ',' && !c.is_whitespace()));
        let Some((line, first)) = lines.next() else {
            let expected = format!("the header {}", columns.header());
            return Err(FileError::unexpected(
                file,
                Place::File,
                "nothing",
                expected,
            ));
        };
        let header = fields_of(first);
        columns.check(file, line, first, &header)?;
        let mut rows = Vec::new();
        for (line, content) in lines {
            rows.push(Self::row(file, line, content, &header)?);
        }
        if rows.is_empty() {
            return Err(FileError::unexpected(
                file,
                Place::File,
                "nothing below the header",
                "at least one line",
            ));
        }
        Ok(Self { file, header, rows })
    }

    fn row(file: &str, line: usize, content: &str, header: &[String]) -> Result<Row, FileError> {
        if content.matches('"').count() % 2 == 1 {
            return Err(FileError::unexpected(
                file,
                Place::Line(line),
                "a quotation mark that is not closed",
                "the other one in the same line",
            ));
        }
        let fields = fields_of(content);
        if fields.len() == header.len() {
            return Ok(Row { line, fields });
        }
        let names = header.join(",");
        let hint = if fields.len() > header.len() {
            ", numbers with a decimal point"
        } else {
            ""
        };
        let count = |n: usize| {
            if n == 1 {
                "1 field".to_owned()
            } else {
                format!("{n} fields")
            }
        };
        Err(FileError::unexpected(
            file,
            Place::Line(line),
            count(fields.len()),
            format!("{} ({names}){hint}", header.len()),
        ))
    }

    /// Its lines.
    pub(super) fn lines(&'a self) -> impl Iterator<Item = Line<'a>> {
        self.rows.iter().map(|row| Line { table: self, row })
    }
}

impl<'a> Line<'a> {
    /// The line's number in the file, from 1.
    pub(super) fn number(self) -> usize {
        self.row.line
    }

    /// The field of a column; `None` where the table has no such column.
    pub(super) fn field(self, name: &str) -> Option<Field<'a>> {
        let index = self.table.header.iter().position(|n| n == name)?;
        Some(Field {
            file: self.table.file,
            line: self.row.line,
            column: index + 1,
            name: &self.table.header[index],
            text: &self.row.fields[index],
        })
    }

    /// The field of a column that the header was checked to have.
    pub(super) fn required(self, name: &str) -> Result<Field<'a>, FileError> {
        self.field(name).ok_or_else(|| {
            let found = format!("no column {name}");
            FileError::unexpected(self.table.file, Place::Line(self.row.line), found, "it")
        })
    }
}

impl<'a> Field<'a> {
    /// An error at this field that repeats its text.
    pub(super) fn expected(self, expected: impl Into<String>) -> FileError {
        let found = if self.text.is_empty() {
            "nothing".to_owned()
        } else {
            quote(self.text)
        };
        self.unexpected(found, expected)
    }

    /// An error at this field in other words.
    pub(super) fn unexpected(
        self,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> FileError {
        let place = Place::Field {
            line: self.line,
            column: self.column,
            name: self.name.to_owned(),
        };
        FileError::unexpected(self.file, place, found, expected)
    }

    /// Its text, which may not be empty.
    pub(super) fn name(self) -> Result<&'a str, FileError> {
        if self.text.is_empty() {
            return Err(self.expected("a name"));
        }
        Ok(self.text)
    }

    /// A finite number.
    pub(super) fn number(self) -> Result<f64, FileError> {
        match self.text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            Ok(_) => Err(self.expected("a finite number")),
            Err(_) if self.text.contains(',') => {
                Err(self.expected("a number with a decimal point"))
            }
            Err(_) => Err(self.expected("a number")),
        }
    }

    /// A finite number from `range`.
    pub(super) fn within(self, range: std::ops::RangeInclusive<f64>) -> Result<f64, FileError> {
        let value = self.number()?;
        if !range.contains(&value) {
            let (least, most) = (range.start(), range.end());
            return Err(self.expected(format!("a number from {least} to {most}")));
        }
        Ok(value)
    }

    /// A finite number or nothing.
    pub(super) fn number_or_nothing(self) -> Result<Option<f64>, FileError> {
        if self.text.is_empty() {
            return Ok(None);
        }
        self.number().map(Some)
    }

    /// A number greater than zero.
    pub(super) fn positive(self) -> Result<f64, FileError> {
        let value = self.number()?;
        if value <= 0.0 {
            return Err(self.expected("a number greater than 0"));
        }
        Ok(value)
    }

    /// A number greater than zero or nothing.
    pub(super) fn positive_or_nothing(self) -> Result<Option<f64>, FileError> {
        if self.text.is_empty() {
            return Ok(None);
        }
        self.positive().map(Some)
    }
}
