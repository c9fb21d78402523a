//! A project saved under another name, with paths of images that still lead to them.

use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use super::StorageError;
use super::journal::JournalEntry;
use super::store::{Store, absolute};
use crate::network::Network;

/// Writes a network into a new file; `project` is the file that its relative paths start from. This also saves what
/// could be read of a damaged project.
///
/// # Errors
/// Where the file is there already or cannot be written.
pub fn save_as(
    path: &Path,
    network: &Network,
    project: &Path,
    journal: &[JournalEntry],
) -> Result<(), StorageError> {
    let file = absolute(path)?;
    let project = absolute(project)?;
    let (Some(from), Some(to)) = (project.parent(), file.parent()) else {
        return Err(StorageError::Exists { file });
    };
    Store::create_with(&file, &rebased(network, from, to), journal).map(drop)
}

/// The network with paths of images relative to the folder `to` instead of `from` (both absolute).
#[must_use]
pub fn rebased(network: &Network, from: &Path, to: &Path) -> Network {
    let mut network = network.clone();
    if from == to {
        return network;
    }
    for image in Arc::make_mut(&mut network.images).values_mut() {
        let path = Path::new(&image.file.path);
        if path.is_relative() {
            let path = relative(&tidy(&from.join(path)), to);
            Arc::make_mut(image).file.path = path;
        }
    }
    network
}

/// A path without `.` and `..`.
fn tidy(path: &Path) -> PathBuf {
    let mut tidy = PathBuf::new();
    for component in path.components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir => {
                tidy.pop();
            }
            other => tidy.push(other),
        }
    }
    tidy
}

/// An absolute path as seen from a folder, with forward slashes; the path itself where no way leads there (another drive).
fn relative(path: &Path, folder: &Path) -> String {
    let folder = tidy(folder);
    let common = path
        .components()
        .zip(folder.components())
        .take_while(|(a, b)| a == b)
        .count();
    let text = |component: Component<'_>| component.as_os_str().to_string_lossy().into_owned();
    if common == 0 {
        return path.to_string_lossy().into_owned();
    }
    let up = folder.components().skip(common).map(|_| "..".to_owned());
    let down = path.components().skip(common).map(text);
    up.chain(down).collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_path_seen_from_another_folder_leads_to_the_same_file() {
        for (path, folder, seen) in [
            ("/a/b/c.png", "/a/b", "c.png"),
            ("/a/b/c.png", "/a", "b/c.png"),
            ("/a/b/c.png", "/a/d/e", "../../b/c.png"),
            ("/x/c.png", "/a", "../x/c.png"),
        ] {
            assert_eq!(relative(Path::new(path), Path::new(folder)), seen);
            assert_eq!(tidy(&Path::new(folder).join(seen)), Path::new(path));
        }
    }
}
