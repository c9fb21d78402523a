//! One writer per project: a lock held by the operating system.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// Rounds of taking a lock file that its last holder removes at the same moment.
const ATTEMPTS: usize = 100;

/// Why the lock could not be had.
#[derive(Debug)]
pub(super) enum Refusal {
    /// Another program (or another store of this one) holds it.
    Held {
        /// Its process, where it could be read.
        process: Option<u32>,
    },
    /// The lock file could not be made or locked.
    Impossible(io::Error),
}

/// The right to write to a project, until dropped or until the process ends.
#[derive(Debug)]
pub(super) struct Lock {
    file: File,
    path: PathBuf,
}

impl Lock {
    /// The lock of the project at `project`, which must be a path without links so that all ways lead to one lock.
    pub(super) fn acquire(project: &Path) -> Result<Self, Refusal> {
        let mut name = project.as_os_str().to_owned();
        name.push("-lock");
        let path = PathBuf::from(name);
        for _ in 0..ATTEMPTS {
            let mut file = OpenOptions::new()
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                .open(&path)
                .map_err(Refusal::Impossible)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    return Err(Refusal::Held {
                        process: process_in(&mut file),
                    });
                }
                Err(TryLockError::Error(error)) => return Err(Refusal::Impossible(error)),
            }
            if is_at(&file, &path) {
                sign(&mut file).map_err(Refusal::Impossible)?;
                return Ok(Self { file, path });
            }
        }
        Err(Refusal::Held { process: None })
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Removed while still locked: whoever gets the orphaned lock sees by `is_at` that it is worth nothing. Where
        // that cannot be seen the file stays; it is the lock that counts, not the file.
        if cfg!(unix) {
            let _ = std::fs::remove_file(&self.path);
        }
        let _ = self.file.unlock();
    }
}

/// The process that signed a lock file.
fn process_in(file: &mut File) -> Option<u32> {
    let mut text = String::new();
    file.take(16).read_to_string(&mut text).ok()?;
    text.trim().parse().ok()
}

/// Writes this process into the lock file, for the message that another one shows.
fn sign(file: &mut File) -> io::Result<()> {
    file.set_len(0)?;
    writeln!(file, "{}", std::process::id())
}

/// Whether `file` is still the one that `path` leads to.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), std::fs::metadata(path)) {
        (Ok(held), Ok(there)) => (held.dev(), held.ino()) == (there.dev(), there.ino()),
        _ => false,
    }
}

/// Whether `file` is still the one that `path` leads to: it is, as nobody removes it.
#[cfg(not(unix))]
fn is_at(_file: &File, _path: &Path) -> bool {
    true
}
