//! From rows to the network, as far as they can be read.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use rusqlite::config::DbConfig;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, ErrorCode};
use serde::de::DeserializeOwned;

use super::journal::{JournalEntry, read_journal};
use super::repair::repair;
use super::rows::{Marks, Place, RowId, Table, checksum, singleton};
use super::{APPLICATION_ID, FORMAT_VERSION, StorageError};
use crate::network::{CameraId, ImageEntry, ImageId, Network, PointId};

/// What a project file holds.
#[derive(Debug)]
pub(super) struct Contents {
    /// The network.
    pub(super) network: Network,
    /// The journal.
    pub(super) journal: Vec<JournalEntry>,
    /// How often the file was saved; `None` where that cannot be read.
    pub(super) saves: Option<i64>,
    /// What could not be read; empty for a sound file.
    pub(super) damage: Vec<String>,
}

/// Faults of the database's structure that are listed one by one.
const STRUCTURE_FAULTS: u32 = 5;

/// Reads a project.
///
/// # Errors
/// Where it is no project, a newer one, or nothing at all can be read.
pub(super) fn read(connection: &Connection, file: &Path) -> Result<Contents, StorageError> {
    let refused = |error| StorageError::of_database(file, "read", error);
    // One transaction: a writer beside us never shows us half of two saves.
    let transaction = connection.unchecked_transaction().map_err(refused)?;
    let mut reader = Reader {
        connection: &transaction,
        damage: Vec::new(),
        rows_read: 0,
    };
    reader.identify(file)?;
    reader.check_structure();
    let network = reader.network();
    let journal = reader.journal();
    let saves = reader.saves();
    if reader.rows_read == 0 {
        return Err(StorageError::Damaged {
            file: file.to_owned(),
            found: reader.damage.into_iter().next().unwrap_or_default(),
        });
    }
    Ok(Contents {
        network,
        journal,
        saves,
        damage: reader.damage,
    })
}

struct Reader<'a> {
    connection: &'a Connection,
    damage: Vec<String>,
    rows_read: usize,
}

/// From which end a table is read.
#[derive(Clone, Copy)]
enum Direction {
    Up,
    Down,
}

impl Reader<'_> {
    /// Application id and format first, before any table is touched.
    fn identify(&mut self, file: &Path) -> Result<(), StorageError> {
        let mut application = self.header("application_id");
        let corrupt =
            |error: &rusqlite::Error| error.sqlite_error_code() == Some(ErrorCode::DatabaseCorrupt);
        if let Some(error) = application.as_ref().err().filter(|error| corrupt(error)) {
            self.damaged(&format!("the file is cut off: {error}"));
            self.tolerate_faults();
            application = self.header("application_id");
        }
        let refused = |error| StorageError::of_database(file, "read", error);
        let application = application.map_err(refused)?;
        if application != APPLICATION_ID {
            return Err(StorageError::NotAProject {
                file: file.to_owned(),
                found: format!("application id 0x{application:08x}"),
            });
        }
        let version = self.header("user_version").map_err(refused)?;
        if version > FORMAT_VERSION {
            return Err(StorageError::Newer {
                file: file.to_owned(),
                found: version,
                expected: FORMAT_VERSION,
            });
        }
        if version < 1 {
            self.damaged(&format!("found format {version}, expected at least 1"));
        }
        Ok(())
    }

    fn header(&self, name: &str) -> rusqlite::Result<i32> {
        self.connection
            .pragma_query_value(None, name, |row| row.get(0))
    }

    /// SQLite refuses a file that is shorter than its header says, or one table of which it cannot understand, unless
    /// told that its schema is being repaired.
    fn tolerate_faults(&mut self) {
        let repairing = DbConfig::SQLITE_DBCONFIG_WRITABLE_SCHEMA;
        if let Err(error) = self.connection.set_db_config(repairing, true) {
            self.damaged(&error.to_string());
        }
    }

    fn check_structure(&mut self) {
        let mut faults = Vec::new();
        if let Err(error) = self.find_faults(&mut faults) {
            faults.push(error.to_string());
            self.tolerate_faults();
        }
        for fault in faults.iter().filter(|fault| *fault != "ok") {
            self.damaged(&format!("structure of the file: {fault}"));
        }
    }

    fn find_faults(&self, faults: &mut Vec<String>) -> rusqlite::Result<()> {
        let query = format!("PRAGMA quick_check({STRUCTURE_FAULTS})");
        let mut statement = self.connection.prepare(&query)?;
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            faults.push(row.get(0)?);
        }
        Ok(())
    }

    /// The rows of a table that are whole.
    fn rows(&mut self, table: Table) -> BTreeMap<RowId, String> {
        let mut rows = BTreeMap::new();
        if let Err(error) = self.scan(table, Direction::Up, &mut rows) {
            let name = table.name();
            self.damaged(&format!("{name}: some rows cannot be read: {error}"));
            // What lies behind the broken place is reached from the other end; a second error says nothing new.
            let _ = self.scan(table, Direction::Down, &mut rows);
        }
        self.rows_read += rows.len();
        rows
    }

    fn scan(
        &mut self,
        table: Table,
        direction: Direction,
        found: &mut BTreeMap<RowId, String>,
    ) -> rusqlite::Result<()> {
        let name = table.name();
        let order = match direction {
            Direction::Up => "ASC",
            Direction::Down => "DESC",
        };
        let query = format!("SELECT id, json, sha256 FROM {name} ORDER BY id {order}");
        let mut statement = self.connection.prepare(&query)?;
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            let id = match row.get_ref(0)? {
                ValueRef::Integer(number) => u32::try_from(number).ok().map(RowId::Number),
                text @ ValueRef::Text(_) => text.as_str().ok().map(|t| RowId::Text(t.to_owned())),
                _ => None,
            };
            let Some(id) = id else {
                self.damaged(&format!("{name}: found a row without an id"));
                continue;
            };
            let place = Place { table, id };
            let json = row.get_ref(1)?.as_str().ok();
            let sum = row.get_ref(2)?.as_blob().ok();
            match json {
                Some(json) if sum == Some(checksum(&place, json).as_slice()) => {
                    found.insert(place.id, json.to_owned());
                }
                _ => self.lost(&place, "found other contents than its checksum tells"),
            }
        }
        Ok(())
    }

    fn lost(&mut self, place: &Place, reason: &str) {
        self.damaged(&format!("{} {}: {reason}", place.table.name(), place.id));
    }

    /// Notes damage, in one line and once.
    fn damaged(&mut self, what: &str) {
        let line = what.split_whitespace().collect::<Vec<_>>().join(" ");
        if !self.damage.contains(&line) {
            self.damage.push(line);
        }
    }

    fn decoded<T: DeserializeOwned>(&mut self, place: &Place, json: &str) -> Option<T> {
        serde_json::from_str(json)
            .map_err(|error| self.lost(place, &error.to_string()))
            .ok()
    }

    /// A table with numbers as ids.
    fn numbered<T: DeserializeOwned>(&mut self, table: Table) -> BTreeMap<u32, T> {
        let mut values = BTreeMap::new();
        for (id, json) in self.rows(table) {
            let place = Place { table, id };
            if let (RowId::Number(number), Some(value)) = (&place.id, self.decoded(&place, &json)) {
                values.insert(*number, value);
            }
        }
        values
    }

    fn network(&mut self) -> Network {
        let mut network = self.document();
        let cameras = self.numbered(Table::Cameras).into_iter();
        network.cameras = Arc::new(cameras.map(|(id, camera)| (CameraId(id), camera)).collect());
        network.images = Arc::new(self.images());
        let mut points = BTreeMap::new();
        for (id, json) in self.rows(Table::Points) {
            let place = Place {
                table: Table::Points,
                id,
            };
            match place.id.to_string().parse::<PointId>() {
                Ok(id) => points.extend(self.decoded(&place, &json).map(|point| (id, point))),
                Err(unknown) => self.lost(&place, &unknown.to_string()),
            }
        }
        network.points = Arc::new(points);
        if !self.damage.is_empty() {
            self.damage.extend(repair(&mut network));
        }
        network
    }

    fn document(&mut self) -> Network {
        let mut rows = self.rows(Table::Document);
        let rows = &mut rows;
        Network {
            settings: self.part(rows, "settings"),
            cameras: Arc::default(),
            images: Arc::default(),
            points: Arc::default(),
            names: self.newer_part(rows, "names"),
            device: self.part(rows, "device"),
            scale_bars: self.part(rows, "scale_bars"),
            control: self.part(rows, "control"),
            frame: self.newer_part(rows, "frame"),
            moved_by: self.newer_part(rows, "moved_by"),
            connection_order: self.part(rows, "connection_order"),
            passes: self.part(rows, "passes"),
            tentative: self.newer_part(rows, "tentative"),
            ambiguous: self.newer_part(rows, "ambiguous"),
            conclusions: self.part(rows, "conclusions"),
            findings: self.part(rows, "findings"),
            adjustment: rows
                .remove(&singleton("adjustment").id)
                .and_then(|json| self.decoded(&singleton("adjustment"), &json)),
            inputs: self.part(rows, "inputs"),
            next_target: self.part(rows, "next_target"),
        }
    }

    /// A part of the document that every project has.
    fn part<T: DeserializeOwned + Default>(
        &mut self,
        rows: &mut BTreeMap<RowId, String>,
        name: &str,
    ) -> T {
        let place = singleton(name);
        match rows.remove(&place.id) {
            Some(json) => self.decoded(&place, &json),
            None => {
                self.lost(&place, "missing");
                None
            }
        }
        .unwrap_or_default()
    }

    /// A part of the document that files of earlier programs do not have.
    fn newer_part<T: DeserializeOwned + Default>(
        &mut self,
        rows: &mut BTreeMap<RowId, String>,
        name: &str,
    ) -> T {
        let place = singleton(name);
        let json = rows.remove(&place.id);
        json.and_then(|json| self.decoded(&place, &json))
            .unwrap_or_default()
    }

    fn images(&mut self) -> BTreeMap<ImageId, Arc<ImageEntry>> {
        let bare = self.numbered::<ImageEntry>(Table::Images);
        let mut detections = self.numbered(Table::Detections);
        let mut marks = self.numbered::<Marks>(Table::Marks);
        let images = bare.into_iter().map(|(id, image)| {
            let marks = marks.remove(&id).unwrap_or_default();
            let image = ImageEntry {
                detections: detections.remove(&id).map(Arc::new),
                labels: marks.labels,
                set_aside: marks.set_aside,
                unlabelled: marks.unlabelled,
                ..image
            };
            (ImageId(id), Arc::new(image))
        });
        images.collect()
    }

    fn journal(&mut self) -> Vec<JournalEntry> {
        let mut entries = Vec::new();
        if let Err(error) = read_journal(self.connection, &mut entries) {
            self.damaged(&format!("journal: some lines cannot be read: {error}"));
        }
        entries
    }

    fn saves(&mut self) -> Option<i64> {
        let count = self
            .connection
            .query_row("SELECT count FROM saves", [], |row| row.get(0));
        count
            .map_err(|error| self.damaged(&format!("number of saves: {error}")))
            .ok()
    }
}
