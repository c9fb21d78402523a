//! The project file that follows the network in memory.

use std::fs::{self, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use rusqlite::config::DbConfig;
use rusqlite::{Connection, OpenFlags, Transaction, TransactionBehavior, params};

use super::journal::{DEFINITION, JournalEntry, JournalLine, add_to_journal, read_journal};
use super::lock::{Lock, Refusal};
use super::reading::read;
use super::rows::{Changes, Table, checksum};
use super::{APPLICATION_ID, FORMAT_VERSION, NotStorable, StorageError, save_as};
use crate::network::Network;

/// How long a save waits for somebody who reads the file.
const PATIENCE: Duration = Duration::from_secs(5);

/// How long closing waits for somebody who reads the file; after that the `-wal` file is left to the next one.
const PATIENCE_AT_CLOSE: Duration = Duration::from_millis(200);

/// What a save changed in the file, without the journal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Saved {
    /// Rows inserted or replaced.
    pub rows_written: usize,
    /// Rows removed.
    pub rows_deleted: usize,
}

/// A project that was opened.
#[derive(Debug)]
pub struct Opened {
    /// The measurement, as far as it could be read.
    pub network: Arc<Network>,
    /// The journal, as far as it could be read.
    pub journal: Vec<JournalEntry>,
    /// Where to save; `None` where the project is open for reading only.
    pub store: Option<Store>,
    /// Why the project is open for reading only although writing was asked for, and what could not be read; empty
    /// where all is well.
    pub warnings: Vec<String>,
}

/// A project file that only we write to.
#[derive(Debug)]
pub struct Store {
    /// Before the lock: it is closed before the lock is given back.
    connection: Connection,
    _lock: Lock,
    file: PathBuf,
    /// What the file holds.
    saved: Network,
    /// How often it was saved, so that a foreign change is noticed where locks do not work (network drives).
    saves: i64,
}

impl Store {
    /// Makes a new project file.
    ///
    /// # Errors
    /// Where the file is there already, cannot be made, or the network holds a number that is not finite.
    pub fn create(path: &Path, network: &Network) -> Result<Self, StorageError> {
        Self::create_with(path, network, &[])
    }

    /// Makes a new project file with a journal.
    pub(super) fn create_with(
        path: &Path,
        network: &Network,
        journal: &[JournalEntry],
    ) -> Result<Self, StorageError> {
        let file = absolute(path)?;
        let changes = Changes::between(None, network).map_err(|e| not_storable(&file, e))?;
        if file.exists() {
            return Err(StorageError::Exists { file });
        }
        let lock = Lock::acquire(&file).map_err(|refusal| match refusal {
            Refusal::Held { process } => in_use(&file, process),
            Refusal::Impossible(e) => StorageError::of_file(&file, "create the file", e),
        })?;
        let made = OpenOptions::new().write(true).create_new(true).open(&file);
        made.map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => StorageError::Exists { file: file.clone() },
            _ => StorageError::of_file(&file, "create the file", error),
        })?;
        match filled(&file, &changes, journal) {
            Ok(connection) => Ok(Self {
                connection,
                _lock: lock,
                file,
                saved: network.clone(),
                saves: 0,
            }),
            Err(error) => {
                let _ = fs::remove_file(&file);
                Err(error)
            }
        }
    }

    /// Opens a project, for reading only where it is damaged or write-protected.
    ///
    /// # Errors
    /// Where it is no project, a newer one, open elsewhere, or nothing can be read.
    pub fn open(path: &Path) -> Result<Opened, StorageError> {
        let file = existing(path)?;
        match Lock::acquire(&file) {
            Ok(lock) => Self::open_locked(file, lock),
            Err(Refusal::Held { process }) => Err(in_use(&file, process)),
            Err(Refusal::Impossible(error)) => {
                let mut opened = Self::open_read_only(path)?;
                let reason = format!("open for reading only: no lock file can be made: {error}");
                opened.warnings.insert(0, reason);
                Ok(opened)
            }
        }
    }

    /// Opens a project for reading, also while another Tiepoint writes to it; later saves are not seen.
    ///
    /// # Errors
    /// Where it is no project, a newer one, or nothing can be read.
    pub fn open_read_only(path: &Path) -> Result<Opened, StorageError> {
        let file = existing(path)?;
        let connection = connected(&file, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
        let contents = read(&connection, &file)?;
        Ok(Opened {
            network: Arc::new(contents.network),
            journal: contents.journal,
            store: None,
            warnings: contents.damage,
        })
    }

    fn open_locked(file: PathBuf, lock: Lock) -> Result<Opened, StorageError> {
        let refused = |error| StorageError::of_database(&file, "open", error);
        let connection = connected(&file, OpenFlags::SQLITE_OPEN_READ_WRITE)?;
        // A damaged file is left as it was found, its -wal file included.
        let keep_wal = DbConfig::SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE;
        connection.set_db_config(keep_wal, true).map_err(refused)?;
        let contents = read(&connection, &file)?;
        let mut warnings = contents.damage;
        if !warnings.is_empty() {
            warnings.insert(0, "damaged, open for reading only".into());
        } else if connection.is_readonly("main").map_err(refused)? {
            warnings.push("write-protected, open for reading only".into());
        }
        let network = Arc::new(contents.network);
        let store = match contents.saves {
            Some(saves) if warnings.is_empty() => {
                connection.set_db_config(keep_wal, false).map_err(refused)?;
                Some(Self {
                    connection,
                    _lock: lock,
                    saved: network.as_ref().clone(),
                    saves,
                    file,
                })
            }
            _ => None,
        };
        Ok(Opened {
            network,
            journal: contents.journal,
            store,
            warnings,
        })
    }

    /// The project file, as an absolute path without links.
    #[must_use]
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// What was saved last.
    #[must_use]
    pub fn saved(&self) -> &Network {
        &self.saved
    }

    /// Writes what changed since the last save, with lines of the journal, in one transaction. When it returns, the
    /// network is on the disk; when it fails, the file holds what it held before.
    ///
    /// # Errors
    /// Where the network holds a number that is not finite, or the file cannot be written.
    pub fn save<'a>(
        &mut self,
        network: &Network,
        lines: impl IntoIterator<Item = &'a JournalLine>,
    ) -> Result<Saved, StorageError> {
        let lines: Vec<&JournalLine> = lines.into_iter().collect();
        let changes = Changes::between(Some(&self.saved), network)
            .map_err(|e| not_storable(&self.file, e))?;
        if !changes.is_empty() || !lines.is_empty() {
            self.write(&changes, &lines)?;
            self.saves += 1;
        }
        self.saved = network.clone();
        Ok(Saved {
            rows_written: changes.written.len(),
            rows_deleted: changes.deleted.len(),
        })
    }

    fn write(&mut self, changes: &Changes, lines: &[&JournalLine]) -> Result<(), StorageError> {
        let refused = |error| StorageError::of_database(&self.file, "save", error);
        self.connection
            .pragma_update(None, "synchronous", "FULL")
            .map_err(refused)?;
        // Where somebody reads the file at this very moment the mode stays as it is: slower, and as safe.
        let _ = set_journal_mode(&self.connection, "WAL");
        let transaction = self
            .connection
            .transaction_with_behavior(TransactionBehavior::Immediate)
            .map_err(refused)?;
        let counted = transaction
            .execute(
                "UPDATE saves SET count = count + 1 WHERE count = ?1",
                [self.saves],
            )
            .map_err(refused)?;
        if counted != 1 {
            return Err(StorageError::Changed {
                file: self.file.clone(),
            });
        }
        apply(&transaction, changes).map_err(refused)?;
        for line in lines {
            add_to_journal(&transaction, &self.file, line)?;
        }
        transaction.commit().map_err(refused)
    }

    /// The journal, oldest line first.
    ///
    /// # Errors
    /// Where the file cannot be read.
    pub fn journal(&self) -> Result<Vec<JournalEntry>, StorageError> {
        let mut entries = Vec::new();
        read_journal(&self.connection, &mut entries)
            .map_err(|error| StorageError::of_database(&self.file, "read the journal", error))?;
        Ok(entries)
    }

    /// Writes what was saved last into a new file, journal included; paths of images are made relative to its folder.
    ///
    /// # Errors
    /// Where the file is there already or cannot be written.
    pub fn save_copy(&self, path: &Path) -> Result<(), StorageError> {
        save_as(path, &self.saved, &self.file, &self.journal()?)
    }
}

impl Drop for Store {
    fn drop(&mut self) {
        // Every save is on the disk already; this only folds the -wal file into the project file.
        let _ = self.connection.busy_timeout(PATIENCE_AT_CLOSE);
        let _ = set_journal_mode(&self.connection, "DELETE");
    }
}

/// Tables and first rows of a file that was just made empty.
fn filled(
    file: &Path,
    changes: &Changes,
    journal: &[JournalEntry],
) -> Result<Connection, StorageError> {
    let refused = |error| StorageError::of_database(file, "write", error);
    let mut connection = connected(file, OpenFlags::SQLITE_OPEN_READ_WRITE)?;
    connection
        .pragma_update(None, "synchronous", "FULL")
        .map_err(refused)?;
    let transaction = connection.transaction().map_err(refused)?;
    define(&transaction).map_err(refused)?;
    apply(&transaction, changes).map_err(refused)?;
    for entry in journal {
        add_to_journal(&transaction, file, &entry.line)?;
    }
    transaction.commit().map_err(refused)?;
    Ok(connection)
}

fn define(transaction: &Transaction<'_>) -> rusqlite::Result<()> {
    transaction.pragma_update(None, "application_id", APPLICATION_ID)?;
    transaction.pragma_update(None, "user_version", FORMAT_VERSION)?;
    for table in Table::ALL {
        transaction.execute(&table.definition(), [])?;
    }
    transaction.execute(DEFINITION, [])?;
    transaction.execute("CREATE TABLE saves (count INTEGER NOT NULL)", [])?;
    transaction.execute("INSERT INTO saves VALUES (0)", [])?;
    Ok(())
}

fn apply(transaction: &Transaction<'_>, changes: &Changes) -> rusqlite::Result<()> {
    for place in &changes.deleted {
        let query = format!("DELETE FROM {} WHERE id = ?1", place.table.name());
        transaction.prepare_cached(&query)?.execute([&place.id])?;
    }
    for row in &changes.written {
        let query = format!(
            "INSERT OR REPLACE INTO {} (id, json, sha256) VALUES (?1, ?2, ?3)",
            row.place.table.name()
        );
        let sum = checksum(&row.place, &row.json);
        transaction
            .prepare_cached(&query)?
            .execute(params![row.place.id, row.json, sum])?;
    }
    Ok(())
}

/// A connection that trusts nothing in the file and does not look into it yet.
fn connected(file: &Path, flags: OpenFlags) -> Result<Connection, StorageError> {
    let open = || -> rusqlite::Result<Connection> {
        let connection =
            Connection::open_with_flags(file, flags | OpenFlags::SQLITE_OPEN_NO_MUTEX)?;
        connection.busy_timeout(PATIENCE)?;
        connection.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
        connection.pragma_update(None, "cell_size_check", true)?;
        Ok(connection)
    };
    open().map_err(|error| StorageError::of_database(file, "open", error))
}

fn set_journal_mode(connection: &Connection, mode: &str) -> rusqlite::Result<()> {
    connection.pragma_update_and_check(None, "journal_mode", mode, |_| Ok(()))
}

/// The file that a path of a project leads to.
fn existing(path: &Path) -> Result<PathBuf, StorageError> {
    let file = path.canonicalize().map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => StorageError::Missing {
            file: path.to_owned(),
        },
        _ => StorageError::of_file(path, "open", error),
    })?;
    let metadata = fs::metadata(&file).map_err(|e| StorageError::of_file(path, "open", e))?;
    let found = match (metadata.is_file(), metadata.len()) {
        (false, _) if metadata.is_dir() => "a folder",
        (false, _) => "something that is no file",
        (true, 0) => "an empty file",
        (true, _) => return Ok(file),
    };
    Err(StorageError::NotAProject {
        file: path.to_owned(),
        found: found.into(),
    })
}

/// The path of a file that need not be there, in a folder that must.
pub(super) fn absolute(path: &Path) -> Result<PathBuf, StorageError> {
    let refused = |error| StorageError::of_file(path, "create the file", error);
    let path = std::path::absolute(path).map_err(refused)?;
    match (path.parent(), path.file_name()) {
        (Some(folder), Some(name)) => Ok(folder.canonicalize().map_err(refused)?.join(name)),
        _ => Err(StorageError::Exists { file: path }),
    }
}

fn not_storable(file: &Path, source: NotStorable) -> StorageError {
    StorageError::NotStorable {
        file: file.to_owned(),
        source,
    }
}

fn in_use(file: &Path, process: Option<u32>) -> StorageError {
    StorageError::InUse {
        file: file.to_owned(),
        process,
    }
}
