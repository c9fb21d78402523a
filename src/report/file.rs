//! Files are written whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// A file that could not be written; one line.
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot be written: {reason}", path.display())]
pub struct WriteError {
    /// The file.
    pub path: PathBuf,
    /// The system's reason.
    pub reason: io::Error,
}

/// Writes a file: the new content stands beside it under another name until it is safely on the disk, then takes its
/// place, so that a reader sees the old file or the new one and never a part. A pipe or a device is written to as it is.
///
/// # Errors
/// [`WriteError`]; the old file is untouched then.
pub fn write_file(path: &Path, content: &[u8]) -> Result<(), WriteError> {
    write(path, content).map_err(|reason| WriteError {
        path: path.to_owned(),
        reason,
    })
}

fn write(path: &Path, content: &[u8]) -> io::Result<()> {
    // A link stays a link: what it points to is replaced.
    let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let existing = fs::metadata(&path).ok();
    if existing.as_ref().is_some_and(|m| !m.is_file()) {
        return OpenOptions::new()
            .write(true)
            .open(&path)?
            .write_all(content);
    }
    let name = path
        .file_name()
        .ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?;
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let beside = folder.join(format!(
        ".{}.{}.part",
        name.to_string_lossy(),
        std::process::id()
    ));
    let written = write_through(&beside, content).and_then(|()| {
        if let Some(existing) = existing {
            fs::set_permissions(&beside, existing.permissions())?;
        }
        fs::rename(&beside, &path)
    });
    if written.is_err() {
        // The first error is the one to tell.
        let _ = fs::remove_file(&beside);
        return written;
    }
    // The rename itself is safe once the folder is; not every file system can say so.
    let _ = File::open(folder).and_then(|f| f.sync_all());
    Ok(())
}

fn write_through(path: &Path, content: &[u8]) -> io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(content)?;
    file.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_and_nothing_is_left_beside_it() {
        let folder = std::env::temp_dir().join(format!("tiepoint-write-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let path = folder.join("points.csv");
        write_file(&path, b"old").unwrap();
        write_file(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
        let error = write_file(&folder.join("no/such.csv"), b"").unwrap_err();
        assert!(
            error
                .to_string()
                .contains("no/such.csv: cannot be written: ")
        );
        assert!(write_file(&folder, b"").is_err(), "a folder is no file");
        fs::remove_dir_all(&folder).unwrap();
    }
}
