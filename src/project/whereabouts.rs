//! Pictures that are not where they were: which are missing, and where they are now.
//!
//! A picture is known by its content (size and SHA-256 of its file), looked for by its name. Searching is slow and
//! changes nothing: it belongs on a worker. What it found is then put into the document by
//! [`Session::move_pictures`](super::session::Session::move_pictures).

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use super::intake::{hash, picture_path, stored_path};
use crate::imaging::read_size;
use crate::monitor::{Interrupted, Monitor};
use crate::network::{ImageEntry, ImageFile, ImageId, Network};

/// Why a search gave nothing.
#[derive(Debug, thiserror::Error)]
pub enum SearchError {
    /// The folder cannot be read.
    #[error("{}: found no folder that can be read ({source}), expected one with pictures", folder.display())]
    NoFolder {
        /// The folder.
        folder: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The operator stopped it.
    #[error("the search was interrupted")]
    Interrupted,
}

impl From<Interrupted> for SearchError {
    fn from(_: Interrupted) -> Self {
        Self::Interrupted
    }
}

/// A picture that was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundPicture {
    /// Its path as it is stored: relative to the project's folder where it can be.
    pub path: String,
    /// SHA-256 of its content.
    pub sha256: String,
}

/// What a search found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PictureMoves {
    /// Where it was looked for.
    pub folder: PathBuf,
    /// Pictures that were found; those that are at their old place again are among them.
    pub found: BTreeMap<ImageId, FoundPicture>,
    /// Images of whose picture nothing was found.
    pub still_missing: Vec<ImageId>,
    /// Images of which only files of the same name and another content were found, with the first of these.
    pub other_content: BTreeMap<ImageId, PathBuf>,
}

/// How many pictures a search found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// Found by name and content.
    pub found: usize,
    /// Not found at all.
    pub still_missing: usize,
    /// Of the same name, and another content.
    pub other_content: usize,
}

impl PictureMoves {
    /// How many.
    #[must_use]
    pub fn counts(&self) -> Found {
        Found {
            found: self.found.len(),
            still_missing: self.still_missing.len(),
            other_content: self.other_content.len(),
        }
    }
}

impl std::fmt::Display for Found {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let pictures = if self.found == 1 {
            "picture"
        } else {
            "pictures"
        };
        write!(
            f,
            "{} {pictures} found, {} still missing",
            self.found, self.still_missing
        )?;
        if self.other_content > 0 {
            write!(
                f,
                ", {} with the same name but other content",
                self.other_content
            )?;
        }
        Ok(())
    }
}

/// The images whose picture file is not at its place, excluded ones too. Asks the file system for names only.
#[must_use]
pub fn pictures_missing(network: &Network, project_folder: &Path) -> Vec<ImageId> {
    let images = network.images.iter();
    images
        .filter(|(_, image)| !picture_path(project_folder, &image.file.path).is_file())
        .map(|(id, _)| *id)
        .collect()
}

/// Looks for lost pictures (missing ones, and unreadable ones whose file is no longer the one that was added) in a
/// folder and all folders in it.
///
/// Cost: names of all files there, content of those that have the name and the size of a lost one.
///
/// # Errors
/// [`SearchError`]: no such folder, or interrupted.
pub fn search_folder(
    network: &Network,
    project_folder: &Path,
    folder: &Path,
    monitor: &Monitor,
) -> Result<PictureMoves, SearchError> {
    let mut hashes = Hashes::default();
    let mut moves = look_again(network, project_folder, &mut hashes, monitor)?;
    moves.folder = folder.to_owned();
    let lost = std::mem::take(&mut moves.still_missing);
    let wanted: BTreeSet<String> = lost.iter().map(|id| name_of(&network.images[id])).collect();
    let there = files_by_name(folder, &wanted, monitor)?;
    let task = monitor.task("comparing pictures", lost.len() as u64);
    for &id in &lost {
        task.step()?;
        let image = &network.images[&id];
        let candidates = there.get(&name_of(image)).map_or(&[][..], Vec::as_slice);
        let rivals = namesakes(network, &lost, id);
        let mut same = None;
        for path in candidates {
            if monitor.is_interrupted() {
                return Err(SearchError::Interrupted);
            }
            if hashes.is(path, &image.file) && is_nearest(path, image, &rivals) {
                same = Some(path);
                break;
            }
        }
        match (same, candidates) {
            (Some(path), _) => {
                moves.other_content.remove(&id);
                let found = FoundPicture {
                    path: stored_path(path, project_folder),
                    sha256: image.file.sha256.clone(),
                };
                moves.found.insert(id, found);
            }
            (None, [first, ..]) if rivals.is_empty() => {
                moves.other_content.insert(id, first.clone());
            }
            (None, _) if moves.other_content.contains_key(&id) => {}
            (None, _) => moves.still_missing.push(id),
        }
    }
    Ok(moves)
}

/// Which pictures are lost, and which of the unreadable ones are at their place after all.
fn look_again(
    network: &Network,
    project_folder: &Path,
    hashes: &mut Hashes,
    monitor: &Monitor,
) -> Result<PictureMoves, SearchError> {
    let mut moves = PictureMoves::default();
    let task = monitor.task("looking for pictures", network.images.len() as u64);
    for (&id, image) in network.images.iter() {
        task.step()?;
        let path = picture_path(project_folder, &image.file.path);
        let is_there = path.is_file();
        if is_there && image.unreadable.is_none() {
            continue;
        }
        if is_there && hashes.is(&path, &image.file) {
            let found = FoundPicture {
                path: image.file.path.clone(),
                sha256: image.file.sha256.clone(),
            };
            moves.found.insert(id, found);
            continue;
        }
        if is_there {
            moves.other_content.insert(id, path);
        }
        moves.still_missing.push(id);
    }
    Ok(moves)
}

/// The other lost images that a file of an image's name may be the picture of, where no checksum tells it: only the folders of their
/// paths do then. None where the image has a checksum.
fn namesakes<'a>(network: &'a Network, lost: &[ImageId], id: ImageId) -> Vec<&'a ImageEntry> {
    let image = &network.images[&id];
    if !image.file.sha256.is_empty() {
        return Vec::new();
    }
    let name = name_of(image);
    let others = lost.iter().filter(|other| **other != id);
    others
        .map(|other| network.images[other].as_ref())
        .filter(|other| other.file.sha256.is_empty() && name_of(other) == name)
        .collect()
}

/// Whether more of the folders of a file are those of this image than of any other that it may be the picture of.
fn is_nearest(path: &Path, image: &ImageEntry, rivals: &[&ImageEntry]) -> bool {
    let own = shared_folders(path, &image.file.path);
    rivals
        .iter()
        .all(|rival| shared_folders(path, &rival.file.path) < own)
}

/// How many parts of a path, from its end, are those of a stored one.
fn shared_folders(path: &Path, stored: &str) -> usize {
    let path = path.to_string_lossy().to_lowercase();
    let stored = stored.to_lowercase();
    let parts = path.rsplit(['/', '\\']).zip(stored.rsplit(['/', '\\']));
    parts.take_while(|(one, other)| one == other).count()
}

/// The name of an image's file, as it is looked for: cards and drives change capitals.
fn name_of(image: &ImageEntry) -> String {
    let path = &image.file.path;
    path.rsplit(['/', '\\'])
        .next()
        .unwrap_or(path)
        .to_lowercase()
}

/// Files of wanted names in a folder and all in it, in the order of their paths.
fn files_by_name(
    folder: &Path,
    wanted: &BTreeSet<String>,
    monitor: &Monitor,
) -> Result<BTreeMap<String, Vec<PathBuf>>, SearchError> {
    fs::read_dir(folder).map_err(|source| SearchError::NoFolder {
        folder: folder.to_owned(),
        source,
    })?;
    let task = monitor.task("looking through folders", 0);
    let mut files: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    // Links can lead round in circles.
    let mut seen = BTreeSet::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        task.step()?;
        if !folder.canonicalize().is_ok_and(|real| seen.insert(real)) {
            continue;
        }
        // A folder that may not be read holds no picture for us.
        for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
            let path = entry.path();
            let name = entry.file_name().to_string_lossy().to_lowercase();
            if wanted.contains(&name) && path.is_file() {
                files.entry(name).or_default().push(path);
            } else if entry.file_type().is_ok_and(|kind| !kind.is_file()) && path.is_dir() {
                open.push(path);
            }
        }
    }
    for paths in files.values_mut() {
        paths.sort();
    }
    Ok(files)
}

/// SHA-256 of files that were read once.
#[derive(Default)]
struct Hashes {
    known: BTreeMap<PathBuf, Option<String>>,
}

impl Hashes {
    /// Whether the file at a path is the one that was added; where none was there, whether it is a picture of the size.
    fn is(&mut self, path: &Path, file: &ImageFile) -> bool {
        if file.sha256.is_empty() {
            return read_size(path).is_ok_and(|size| size == (file.width_px, file.height_px));
        }
        if !fs::metadata(path).is_ok_and(|found| found.len() == file.size_bytes) {
            return false;
        }
        let known = self.known.entry(path.to_owned());
        let found = known.or_insert_with(|| hash(path).ok().map(|(_, sha256)| sha256));
        found.as_ref() == Some(&file.sha256)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::project::making::{ProjectPlan, make};
    use crate::project::sample_folder::Folder;
    use crate::project::session::Session;
    use crate::project::storage::StorageError;

    /// A project of four pictures in `p/images`.
    fn project(folder: &Folder) -> Session {
        for grey in 1..=4 {
            folder.picture(&format!("p/images/{grey}.pgm"), grey);
        }
        let plan = ProjectPlan::of_images(folder.at("p/p.tiepoint"), vec![folder.at("p/images")]);
        make(&plan, &Monitor::new()).unwrap()
    }

    fn search(session: &Session, folder: &Folder, place: &str) -> PictureMoves {
        let project_folder = folder.at("p");
        let place = folder.at(place);
        search_folder(session.network(), &project_folder, &place, &Monitor::new()).unwrap()
    }

    fn paths(session: &Session) -> Vec<&str> {
        let images = session.network().images.values();
        images.map(|image| image.file.path.as_str()).collect()
    }

    fn mark_unreadable(session: &mut Session) {
        let marked: Result<(), StorageError> = session.edit("detect", |network| {
            for id in [1, 2] {
                network.image_mut(ImageId(id)).unreadable = Some("not there".into());
            }
            Ok(())
        });
        marked.unwrap();
    }

    #[test]
    fn moved_pictures_are_found_by_name_and_content() {
        let folder = Folder::new("whereabouts");
        let mut session = project(&folder);
        assert!(pictures_missing(session.network(), &folder.at("p")).is_empty());
        folder.rename("p/images/1.pgm", "drive/deep/er/1.PGM");
        folder.rename("p/images/2.pgm", "drive/2.pgm");
        folder.rename("p/images/3.pgm", "away/3.pgm");
        folder.picture("drive/3.pgm", 99);
        // The same name twice: the content tells which.
        folder.picture("drive/a/2.pgm", 98);
        std::fs::remove_file(folder.at("p/images/4.pgm")).unwrap();
        let all: Vec<ImageId> = (1..=4).map(ImageId).collect();
        assert_eq!(pictures_missing(session.network(), &folder.at("p")), all);
        mark_unreadable(&mut session);

        let moves = search(&session, &folder, "drive");
        let counts = moves.counts();
        let expected = Found {
            found: 2,
            still_missing: 1,
            other_content: 1,
        };
        assert_eq!(counts, expected);
        let line = "2 pictures found, 1 still missing, 1 with the same name but other content";
        assert_eq!(counts.to_string(), line);
        assert_eq!(moves.other_content[&ImageId(3)], folder.at("drive/3.pgm"));

        let before = session.network().clone();
        assert_eq!(session.move_pictures(&moves).unwrap(), expected);
        let now = [
            "../drive/deep/er/1.PGM",
            "../drive/2.pgm",
            "images/3.pgm",
            "images/4.pgm",
        ];
        assert_eq!(paths(&session), now);
        assert!(
            session
                .network()
                .images
                .values()
                .all(|image| image.unreadable.is_none())
        );
        assert!(
            session.network().inputs > before.inputs,
            "there is something to detect"
        );
        let title = format!("pictures found in {}", folder.at("drive").display());
        assert_eq!(session.undo().unwrap(), Some(title));
        assert!(*session.network() == before);
        session.redo().unwrap();
        assert_eq!(
            pictures_missing(session.network(), &folder.at("p")),
            all[2..]
        );
    }

    #[test]
    fn a_new_path_alone_asks_no_stage_to_work_again() {
        let folder = Folder::new("whereabouts-moved");
        let mut session = project(&folder);
        let inputs = session.network().inputs;
        folder.rename("p/images", "elsewhere/images");
        let moves = search(&session, &folder, "elsewhere");
        session.move_pictures(&moves).unwrap();
        assert_eq!(session.network().inputs, inputs);
        assert!(pictures_missing(session.network(), &folder.at("p")).is_empty());
        assert_eq!(
            session.move_pictures(&PictureMoves::default()).unwrap(),
            Found::default()
        );
        assert_eq!(
            session.history().undo_titles().count(),
            1,
            "nothing found is no edit"
        );
    }

    #[test]
    fn a_picture_that_is_at_its_place_again_is_found_there() {
        let folder = Folder::new("whereabouts-again");
        let mut session = project(&folder);
        mark_unreadable(&mut session);
        folder.picture("p/images/2.pgm", 77);
        let moves = search(&session, &folder, "p");
        assert_eq!(moves.found.keys().collect::<Vec<_>>(), [&ImageId(1)]);
        let other = moves.other_content.get(&ImageId(2));
        assert_eq!(other, Some(&folder.at("p/images/2.pgm")));
        session.move_pictures(&moves).unwrap();
        let unreadable = |id| session.network().images[&ImageId(id)].unreadable.is_some();
        assert_eq!([unreadable(1), unreadable(2)], [false, true]);
    }

    #[test]
    fn a_picture_that_was_not_there_at_the_import_is_known_by_name_and_size() {
        let folder = Folder::new("whereabouts-imported");
        let mut session = project(&folder);
        let imported: Result<(), StorageError> = session.edit("import", |network| {
            for id in [1, 2] {
                let file = &mut network.image_mut(ImageId(id)).file;
                (file.size_bytes, file.sha256) = (0, String::new());
            }
            network.image_mut(ImageId(2)).file.width_px = 5;
            Ok(())
        });
        imported.unwrap();
        folder.rename("p/images", "elsewhere");
        let moves = search(&session, &folder, "elsewhere");
        assert_eq!(
            moves.other_content.keys().collect::<Vec<_>>(),
            [&ImageId(2)]
        );
        assert_eq!(session.move_pictures(&moves).unwrap().found, 3);
        assert_eq!(paths(&session)[..2], ["../elsewhere/1.pgm", "images/2.pgm"]);
    }

    #[test]
    fn pictures_that_nobody_has_seen_are_told_apart_by_their_folders() {
        let folder = Folder::new("whereabouts-cameras");
        let mut session = project(&folder);
        let imported: Result<(), StorageError> = session.edit("import", |network| {
            for (id, path) in [(1, "left/7.pgm"), (2, "right/7.pgm")] {
                let file = &mut network.image_mut(ImageId(id)).file;
                (file.size_bytes, file.sha256) = (0, String::new());
                file.path = path.into();
            }
            Ok(())
        });
        imported.unwrap();
        folder.picture("found/right/7.pgm", 5);
        let moves = search(&session, &folder, "found");
        assert_eq!(moves.found.keys().collect::<Vec<_>>(), [&ImageId(2)]);
        assert_eq!(moves.still_missing, [ImageId(1)]);
        // Which of the two it is, nobody can tell.
        folder.rename("found/right/7.pgm", "flat/7.pgm");
        assert!(search(&session, &folder, "flat").found.is_empty());
        folder.picture("found/left/7.pgm", 6);
        folder.picture("found/right/7.pgm", 5);
        let moves = search(&session, &folder, "found");
        let paths: Vec<&str> = moves.found.values().map(|f| f.path.as_str()).collect();
        assert_eq!(paths, ["../found/left/7.pgm", "../found/right/7.pgm"]);
    }

    #[test]
    fn a_search_can_be_interrupted_and_needs_a_folder() {
        let folder = Folder::new("whereabouts-stop");
        let session = project(&folder);
        folder.rename("p/images", "images");
        let (network, project) = (session.network(), folder.at("p"));
        let monitor = Monitor::new();
        monitor.interrupt();
        let stopped = search_folder(network, &project, &folder.at("."), &monitor);
        assert!(
            matches!(stopped, Err(SearchError::Interrupted)),
            "{stopped:?}"
        );
        let none = search_folder(network, &project, &folder.at("none"), &Monitor::new());
        assert!(
            matches!(none, Err(SearchError::NoFolder { .. })),
            "{none:?}"
        );
    }

    #[cfg(unix)]
    #[test]
    fn links_that_lead_in_circles_end() {
        let folder = Folder::new("whereabouts-links");
        let session = project(&folder);
        folder.rename("p/images", "images");
        std::os::unix::fs::symlink(folder.at("images"), folder.at("images/round")).unwrap();
        assert_eq!(search(&session, &folder, "images").counts().found, 4);
    }
}
