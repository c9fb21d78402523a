//! The projects that were open last: a convenience, so that reading it never fails and nothing depends on it.
//!
//! A plain text file with one absolute path a line, newest first. A project that is not there now (a drive that is not
//! connected) stays in the list.

use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Projects that are remembered; a longer list is not read.
const REMEMBERED: usize = 12;

/// Name of the file in the state folder.
const FILE: &str = "recent";

/// The folder for what programs keep between two starts (XDG base directories), with this program's name; `None` where
/// the system names neither it nor a home.
#[must_use]
pub fn state_folder() -> Option<PathBuf> {
    state_folder_of(std::env::var_os("XDG_STATE_HOME"), std::env::home_dir())
}

fn state_folder_of(state_home: Option<OsString>, home: Option<PathBuf>) -> Option<PathBuf> {
    // A relative path is to be ignored, says the specification.
    let state_home = state_home.map(PathBuf::from).filter(|p| p.is_absolute());
    let home = home.filter(|p| p.is_absolute());
    let folder = state_home.or_else(|| Some(home?.join(".local").join("state")))?;
    Some(folder.join("tiepoint"))
}

/// The projects that were open last, newest first; empty where nothing can be read.
#[must_use]
pub fn recent_projects(state_folder: &Path) -> Vec<PathBuf> {
    let bytes = fs::read(state_folder.join(FILE)).unwrap_or_default();
    let text = String::from_utf8_lossy(&bytes);
    let mut projects: Vec<PathBuf> = Vec::new();
    for line in text.lines() {
        let project = PathBuf::from(line);
        // A line with the replacement character is no path that was ever written here.
        let is_path = project.is_absolute() && !line.contains(['\u{fffd}', '\0']);
        if is_path && !projects.contains(&project) && projects.len() < REMEMBERED {
            projects.push(project);
        }
    }
    projects
}

/// Puts a project at the head of the list.
///
/// # Errors
/// Where the list cannot be written, or the path is no text of one line.
pub fn remember_project(state_folder: &Path, project: &Path) -> io::Result<()> {
    let project = one_path(project)?;
    let line = project.to_str().filter(|text| !text.contains(['\n', '\r']));
    if line.is_none() {
        let reason = "the path is no text of one line";
        return Err(io::Error::new(io::ErrorKind::InvalidFilename, reason));
    }
    let mut projects = recent_projects(state_folder);
    projects.retain(|other| *other != project);
    projects.insert(0, project);
    projects.truncate(REMEMBERED);
    write(state_folder, &projects)
}

/// Takes a project out of the list.
///
/// # Errors
/// Where the list cannot be written.
pub fn forget_project(state_folder: &Path, project: &Path) -> io::Result<()> {
    let same = one_path(project)?;
    let mut projects = recent_projects(state_folder);
    let before = projects.len();
    projects.retain(|other| *other != same && other != project);
    if projects.len() == before {
        return Ok(());
    }
    write(state_folder, &projects)
}

/// The one path of a file that several may lead to.
fn one_path(project: &Path) -> io::Result<PathBuf> {
    project
        .canonicalize()
        .or_else(|_| std::path::absolute(project))
}

/// Writes the list in one step: whoever reads it sees the old or the new one.
fn write(state_folder: &Path, projects: &[PathBuf]) -> io::Result<()> {
    fs::create_dir_all(state_folder)?;
    let text: String = projects
        .iter()
        .map(|project| format!("{}\n", project.display()))
        .collect();
    let new = state_folder.join(format!("{FILE}-{}", std::process::id()));
    let written = fs::write(&new, text).and_then(|()| fs::rename(&new, state_folder.join(FILE)));
    if written.is_err() {
        let _ = fs::remove_file(&new);
    }
    written
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::project::sample_folder::Folder;

    #[test]
    fn the_newest_is_first_and_every_file_once() {
        let folder = Folder::new("recent");
        let state = folder.at("state/tiepoint");
        assert!(recent_projects(&state).is_empty());
        let projects: Vec<PathBuf> = (0..15)
            .map(|n| folder.at(&format!("{n}.tiepoint")))
            .collect();
        for project in &projects {
            remember_project(&state, project).unwrap();
        }
        let newest: Vec<PathBuf> = projects.iter().rev().take(REMEMBERED).cloned().collect();
        assert_eq!(recent_projects(&state), newest);
        // The same file by another way.
        fs::write(&projects[10], "").unwrap();
        let roundabout = folder.at("state/../10.tiepoint");
        remember_project(&state, &roundabout).unwrap();
        let now = recent_projects(&state);
        assert_eq!((now.len(), &now[0]), (REMEMBERED, &projects[10]));
        assert_eq!(now.iter().filter(|p| p.ends_with("10.tiepoint")).count(), 1);
        forget_project(&state, &projects[14]).unwrap();
        assert!(!recent_projects(&state).contains(&projects[14]));
        assert_eq!(folder.names("state/tiepoint"), [FILE]);
    }

    #[test]
    fn a_broken_list_is_read_as_far_as_it_goes() {
        let folder = Folder::new("recent-broken");
        for broken in [&b"\xff\xfe\0\n"[..], b"relative.tiepoint\n\n", b""] {
            folder.write(FILE, broken);
            assert!(recent_projects(&folder.at(".")).is_empty());
        }
        let good = folder.at("a.tiepoint");
        let line = good.to_str().unwrap();
        folder.write(FILE, format!("x\0\n{line}\n{line}\n").as_bytes());
        assert_eq!(recent_projects(&folder.at(".")), [good]);
        assert!(recent_projects(&folder.at("recent/no-folder")).is_empty());
    }

    #[cfg(unix)]
    #[test]
    fn what_is_no_line_of_text_is_not_remembered() {
        let folder = Folder::new("recent-odd");
        assert!(remember_project(&folder.at("."), Path::new("/a\nb")).is_err());
        assert!(recent_projects(&folder.at(".")).is_empty());
    }

    #[cfg(unix)]
    #[test]
    fn the_state_folder_is_the_systems_or_in_the_home() {
        let of = |state: Option<&str>, home: Option<&str>| {
            state_folder_of(state.map(OsString::from), home.map(PathBuf::from))
        };
        let expected = |path: &str| Some(PathBuf::from(path));
        assert_eq!(of(Some("/s"), Some("/h")), expected("/s/tiepoint"));
        for ignored in [None, Some(""), Some("relative")] {
            assert_eq!(
                of(ignored, Some("/h")),
                expected("/h/.local/state/tiepoint")
            );
        }
        assert_eq!(of(None, None), None);
    }
}
