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

/// Names of standard output. They are written to as a stream: where they lead to a file, it is one that the shell opened, whose
/// end is not ours to choose and whose content is not ours to replace.
const STANDARD_OUTPUT: [&str; 3] = ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"];

fn is_standard_output(path: &Path) -> bool {
    STANDARD_OUTPUT.iter().any(|name| path == Path::new(name))
}

/// The folder that a file lies in.
fn folder_of(file: &Path) -> &Path {
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// A reader that has gone away has what it wanted.
fn without_reader(written: io::Result<()>) -> io::Result<()> {
    match written {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        other => other,
    }
}

fn write(path: &Path, content: &[u8]) -> io::Result<()> {
    if is_standard_output(path) {
        let mut out = io::stdout().lock();
        return without_reader(out.write_all(content).and_then(|()| out.flush()));
    }
    // A link stays a link: what it points to is replaced.
    let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let existing = fs::metadata(&path).ok();
    if existing.as_ref().is_some_and(|m| !m.is_file()) {
        let mut stream = OpenOptions::new().write(true).open(&path)?;
        return without_reader(stream.write_all(content));
    }
    let name = path
        .file_name()
        .ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?;
    let folder = folder_of(&path);
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

/// One file in two roles, of which one would be lost; one line.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}: found the file of {first} and of {second}, expected two", path.display())]
pub struct SameFile {
    /// The file as given for the second role.
    pub path: PathBuf,
    /// What it is first.
    pub first: &'static str,
    /// What it is besides.
    pub second: &'static str,
}

/// Refuses to write where something is read from, or two tables into one file; a pipe or a device takes several.
///
/// # Errors
/// [`SameFile`] with the roles of the file.
pub fn check_apart(
    read: &[(&'static str, &Path)],
    written: &[(&'static str, &Path)],
) -> Result<(), SameFile> {
    let mut known: Vec<(PathBuf, &'static str)> = read
        .iter()
        .map(|(role, path)| (whole(path), *role))
        .collect();
    for &(second, path) in written {
        let is_stream =
            fs::metadata(path).is_ok_and(|found| !found.is_file()) || is_standard_output(path);
        if is_stream {
            continue;
        }
        let file = whole(path);
        if let Some((_, first)) = known.iter().find(|(other, _)| *other == file) {
            return Err(SameFile {
                path: path.to_owned(),
                first,
                second,
            });
        }
        known.push((file, second));
    }
    Ok(())
}

/// The path without links, also of a file that does not exist yet.
fn whole(path: &Path) -> PathBuf {
    let of_folder = || {
        let folder = fs::canonicalize(folder_of(path)).ok()?;
        Some(folder.join(path.file_name()?))
    };
    fs::canonicalize(path)
        .ok()
        .or_else(of_folder)
        .unwrap_or_else(|| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_read_or_written_and_written_once() {
        let folder = std::env::temp_dir().join(format!("tiepoint-apart-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let project = folder.join("box.tiepoint");
        fs::write(&project, b"").unwrap();
        let table = folder.join("points.csv");
        let read = [("the project", project.as_path())];
        assert_eq!(check_apart(&read, &[("--points", &table)]), Ok(()));
        let roundabout = folder.join("../").join(folder.file_name().unwrap());
        let again = roundabout.join("box.tiepoint");
        let same = check_apart(&read, &[("--points", &again)]).unwrap_err();
        assert!(
            same.to_string()
                .ends_with("found the file of the project and of --points, expected two"),
            "{same}"
        );
        let new = roundabout.join("points.csv");
        let written = [("--points", table.as_path()), ("--stations", &new)];
        assert_eq!(
            check_apart(&read, &written).unwrap_err().second,
            "--stations"
        );
        let stream = Path::new("/dev/stdout");
        let written = [("--points", stream), ("--stations", stream)];
        assert_eq!(check_apart(&read, &written), Ok(()));
        fs::remove_dir_all(&folder).unwrap();
    }

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
