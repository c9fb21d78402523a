//! What was done, when, and what came out.

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use rusqlite::{Connection, Transaction, params};

use super::{NotStorable, StorageError};

/// What is written into the journal with a save.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JournalLine {
    /// When, as [`utc_text`] writes it.
    pub utc: String,
    /// The stage, step or edit.
    pub what: String,
    /// The settings it ran with.
    pub settings: String,
    /// How it ended.
    pub outcome: String,
    /// Standard deviation of unit weight, where there was an adjustment.
    pub sigma0: Option<f64>,
}

/// A line of the journal.
#[derive(Clone, Debug, PartialEq)]
pub struct JournalEntry {
    /// Its place in the journal, from 1.
    pub sequence: i64,
    /// What it says.
    pub line: JournalLine,
}

/// A time as `2026-03-04T05:06:07Z`; times before 1970 count as 1970.
#[must_use]
pub fn utc_text(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
    let (days, second) = (seconds / 86_400, seconds % 86_400);
    // Years begin in March, so that the leap day is the last of its year; 400 years have 146,097 days.
    let days = days + 719_468;
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1_460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let (year, month) = match month {
        0..=9 => (400 * era + year, month + 3),
        _ => (400 * era + year + 1, month - 9),
    };
    let (hour, minute, second) = (second / 3_600, second / 60 % 60, second % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// The statement that makes the journal's table.
pub(super) const DEFINITION: &str = "CREATE TABLE journal (sequence INTEGER PRIMARY KEY, utc TEXT NOT NULL, what TEXT NOT NULL, \
     settings TEXT NOT NULL, outcome TEXT NOT NULL, sigma0 REAL)";

/// The journal, up to the first line that cannot be read.
pub(super) fn read_journal(
    connection: &Connection,
    entries: &mut Vec<JournalEntry>,
) -> rusqlite::Result<()> {
    let mut statement = connection.prepare(
        "SELECT sequence, utc, what, settings, outcome, sigma0 FROM journal ORDER BY sequence",
    )?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        entries.push(JournalEntry {
            sequence: row.get(0)?,
            line: JournalLine {
                utc: row.get(1)?,
                what: row.get(2)?,
                settings: row.get(3)?,
                outcome: row.get(4)?,
                sigma0: row.get(5)?,
            },
        });
    }
    Ok(())
}

/// Adds a line.
pub(super) fn add_to_journal(
    transaction: &Transaction<'_>,
    file: &Path,
    line: &JournalLine,
) -> Result<(), StorageError> {
    if let Some(sigma0) = line.sigma0.filter(|sigma0| !sigma0.is_finite()) {
        return Err(StorageError::NotStorable {
            file: file.to_owned(),
            source: NotStorable {
                table: "journal",
                id: line.what.clone(),
                reason: format!("found a number that is not finite, sigma0: {sigma0}"),
            },
        });
    }
    let query =
        "INSERT INTO journal (utc, what, settings, outcome, sigma0) VALUES (?1, ?2, ?3, ?4, ?5)";
    let columns = params![
        line.utc,
        line.what,
        line.settings,
        line.outcome,
        line.sigma0
    ];
    transaction
        .prepare_cached(query)
        .and_then(|mut statement| statement.execute(columns))
        .map_err(|error| StorageError::of_database(file, "write the journal", error))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn times_are_written_as_sqlite_writes_them() {
        let connection = Connection::open_in_memory().unwrap();
        let query = "SELECT strftime('%Y-%m-%dT%H:%M:%SZ', ?1, 'unixepoch')";
        for seconds in (0..8_000_000_000_i64).step_by(12_345_678) {
            let expected: String = connection
                .query_row(query, [seconds], |row| row.get(0))
                .unwrap();
            let time = UNIX_EPOCH + Duration::from_secs(seconds.unsigned_abs());
            assert_eq!(utc_text(time), expected);
        }
    }
}
